"""Motion in Hill's frame in closed form, in extended precision."""

from __future__ import annotations

import mpmath
import numpy as np


def moved(x, v, time, omega, vertical=1.0):
    """Positions and velocities (n, 3) after a time (an mpmath number or a float) without other forces."""
    with mpmath.workdps(40):
        w, t = mpmath.mpf(omega), mpmath.mpf(time)
        u = abs(w) * mpmath.mpf(vertical)
        c, s, c_z, s_z = mpmath.cos(w * t), mpmath.sin(w * t), mpmath.cos(u * t), mpmath.sin(u * t)
        found = np.zeros((2, len(x), 3))
        for i in range(len(x)):
            (a, b, z), (v_a, v_b, v_z) = (list(map(mpmath.mpf, row[i])) for row in (np.asarray(x), np.asarray(v)))
            centre = 4 * a + 2 * v_b / w
            apart, speed = (a - centre) * c + v_a / w * s, v_a / w * c - (a - centre) * s
            y = b - 2 * v_a / w - mpmath.mpf(1.5) * w * centre * t + 2 * speed
            found[0, i] = centre + apart, y, z * c_z + v_z / u * s_z
            found[1, i] = w * speed, -mpmath.mpf(1.5) * w * centre - 2 * w * apart, v_z * c_z - z * u * s_z
    return found
