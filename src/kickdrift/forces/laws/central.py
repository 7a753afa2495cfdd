"""Common parts of the forces of one central body: the body, its constants, checks, and the loop over the others.

A body law takes the loop over the bodies around the central one by ``law = staticmethod(around)``. Its
``pull(p, i, d, u, t)`` gets the position ``d`` and the velocity ``u`` of body i from the central body, as vectors, and
the time. It returns the potential energy per mass and the acceleration. ``p``, what the law's ``bound`` returns, has
``central`` and ``share``, see ``Attraction``. In plain Python a vector is a NumPy array; ``body_kernel`` teaches numba
the functions that make vectors.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.seam.arguments import number
from kickdrift.model.state import Floats
from kickdrift.text import choices, shown

if TYPE_CHECKING:
    from kickdrift.model.subject import Subject


Central = Any  # int, str or None; checked here, since pydantic's error for a union does not name the key


def check_central(name: str, central: Central) -> None:
    """Refuse a value that cannot name a body: a number, a name or None is expected."""
    whole = isinstance(central, int | np.integer) and not isinstance(central, bool)
    if not (central is None or isinstance(central, str) or (whole and central >= 0)):
        raise InputError(f"{name}: central: expected a body's name or its number from 0 on, got {shown(central)}")


def central_body(name: str, central: Central, system: Subject) -> int:
    """Index of the central body, by name or number; default the most massive body (the first of equals)."""
    masses = system.state.masses
    if central is None:
        index = int(np.argmax(masses))
    elif isinstance(central, str):
        if central not in system.names:
            known = (
                f"bodies are {choices(system.names, central)}" if system.names else "this system's bodies have no names"
            )
            raise InputError(f"{name}: central: there is no body {shown(central)}; {known}")
        index = system.names.index(central)
    else:
        found = np.flatnonzero(system.state.ids == central)  # by number, even if other bodies have left
        if not found.size:
            raise InputError(f"{name}: central: there is no body {central}; expected 0 to {len(masses) - 1}")
        index = int(found[0])
    if masses[index] == 0:
        raise InputError(f"{name}: central: {system.body(index)} has no mass")
    return index


def gravitational_constant(name: str, given: float | None, system: Subject) -> float:
    """The given G, or the unit system's own by default."""
    value = given if given is not None else system.units.gravity
    if value is None:
        raise InputError(f"{name}: units {system.units.name!r} define no G; give G")
    return value


def light(name: str, given: float | None, system: Subject) -> float:
    """Speed of light: the given one, or the unit system's own by default."""
    value = given if given is not None else system.units.light
    if value is None:
        raise InputError(f"{name}: units {system.units.name!r} define no speed of light; give c")
    return value


class Attraction(NamedTuple):
    """Attraction of a central body, for the compiled forces."""

    central: int
    gm: float  # G M
    share: Floats  # (n,) m / M, the central body's share of a body's acceleration

    @classmethod
    def of(cls, name: str, law: Any, system: Subject) -> Attraction:
        """Attraction of the body that a law names with ``central`` and ``G``."""
        central = central_body(name, law.central, system)
        masses = system.state.masses
        gm = gravitational_constant(name, law.G, system) * float(masses[central])
        return cls(central, gm, masses / masses[central])


def check_positive(name: str, **values: float | None) -> None:
    """Refuse a value that is given but not positive."""
    for key, value in values.items():
        if value is not None and number(name, key, value) <= 0:
            raise InputError(f"{name}: {key} must be a positive number, got {shown(value)}")


def check_open(name: str, system: Subject) -> None:
    """Refuse a periodic box."""
    if system.box.periodic:
        raise InputError(f"{name}: needs open space, and the box is periodic")


def check_around(name: str, law: Any, system: Subject) -> None:
    """Refuse a periodic box, and a law whose ``central`` or ``G`` the system cannot give."""
    check_open(name, system)
    central_body(name, law.central, system)
    if hasattr(law, "G"):
        gravitational_constant(name, law.G, system)


def check_axis(key: str, axis: Sequence[float]) -> None:
    """Refuse a vector without a direction."""
    if not any(axis):
        raise InputError(f"{key}: expected a vector with a direction, got {list(axis)}")


def check_along_z(key: str, axis: Sequence[float], system: Subject) -> None:
    """Refuse a vector that leans out of z in a two-dimensional system."""
    if system.dimensions == 2 and any(axis[:2]):
        raise InputError(f"{key}: expected a vector along z in this two-dimensional system, got {list(axis)}")


def check_masses(name: str, system: Subject) -> None:
    """Refuse a system without any mass if all forces act on mass (``by_mass``)."""
    if not system.state.masses.any() and all(getattr(force, "by_mass", False) for force in system.forces):
        raise InputError(
            f"{name}: no particle has a mass, so there is no attraction; give one or more particles a mass"
        )


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
