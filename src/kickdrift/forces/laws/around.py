"""One loop for the forces of a central body on each other body: the law's ``pull`` is the formula.

A body law takes the loop by ``law = staticmethod(around)``. Its ``pull(p, i, d, u, t)`` gets the position ``d`` and the
velocity ``u`` of body i from the central body, as vectors, and the time. It returns the potential energy per mass and
the acceleration. ``p``, what the law's ``bound`` returns, has ``central`` and ``share``, see ``Attraction``.

In plain Python a vector is a NumPy array; ``body_kernel`` teaches numba the functions below.
"""

from __future__ import annotations

from typing import Any

import numpy as np


def around(p, x, v, m, t, a):
    """Add the pull of the central body on each other body, and the opposite force on the central body."""
    c, n = p.central, x.shape[1]
    centre, motion = column(x, c), column(v, c)
    back_x = back_y = back_z = energy = virial = 0.0
    for i in range(n):
        if i == c:
            continue
        d = column(x, i) - centre
        potential, push = pull(p, i, d, column(v, i) - motion, t)
        ax, ay, az, share = push[0], push[1], push[2], p.share[i]
        a[0, i] += ax
        a[1, i] += ay
        a[2, i] += az
        back_x, back_y, back_z = back_x + share * ax, back_y + share * ay, back_z + share * az
        energy += m[i] * potential
        virial += m[i] * (push @ d)
    a[0, c] -= back_x
    a[1, c] -= back_y
    a[2, c] -= back_z
    return energy, virial, n - 1


def pull(p: Any, i: int, d: Any, u: Any, t: float) -> Any:
    """Energy per mass and acceleration of body i, by the ``pull`` of the law of ``p``."""
    return p.pull(i, d, u, t)


def column(array: Any, i: int) -> Any:
    """Vector of body i, from an array (3, n)."""
    return array[:, i]


def room(array: Any) -> Any:
    """Zeros in the shape of an array (3, n)."""
    return np.zeros_like(array)


def vector(numbers: Any) -> Any:
    """Vector of three numbers."""
    return np.array(numbers)
