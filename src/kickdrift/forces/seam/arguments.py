"""Checks of the arguments of forces. Every error names the force and the key."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError
from kickdrift.model.checks.values import number as real
from kickdrift.text import shown

if TYPE_CHECKING:
    from kickdrift.model.subject import Subject

Vector = tuple[float, float, float]


def is_one(value: Any) -> bool:
    """Tell whether the value is one number, not a list of them."""
    return np.ndim(value) == 0 if isinstance(value, np.ndarray) else not isinstance(value, Iterable)


def number(name: str, key: str, value: Any) -> float:
    """Return the value as a finite float. Raises an InputError that names the force and the key."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    found = real(value)
    if not math.isfinite(found):
        raise InputError(f"{name}: {key}: expected a finite number, got {shown(value)}")
    return found


def items(name: str, key: str, values: Any) -> list[Any]:
    """Return the values as a list. Raises an InputError that names the force and the key."""
    if isinstance(values, str) or not isinstance(values, Iterable):
        raise InputError(f"{name}: {key}: expected a list, got {shown(values)}")
    return list(values)


def vector(name: str, key: str, values: Any) -> Vector:
    """Return three finite floats. Raises an InputError that names the force and the key."""
    given = [] if isinstance(values, str) or not isinstance(values, Iterable) else list(values)
    if len(given) != 3:
        raise InputError(f"{name}: {key}: expected three numbers, got {shown(values)}")
    x, y, z = (number(name, key, value) for value in given)
    return x, y, z


def values_in(given: Any) -> NDArray[np.float64]:
    """All numbers of a parameter with one value, or with one for each particle or species."""
    return np.array(list(given.values()) if isinstance(given, Mapping) else given, dtype=float)


def check_not_negative(**values: Any) -> None:
    """Refuse a parameter with a value below zero."""
    for key, given in values.items():
        if (values_in(given) < 0).any():
            raise InputError(f"{key} must be zero or more, got {shown(given)}")


def opposite(given: Any) -> Any:
    """The values of a parameter with the other sign."""
    if isinstance(given, Mapping):
        return {species: opposite(value) for species, value in given.items()}
    return tuple(map(opposite, given)) if isinstance(given, tuple) else -given


def check_in_plane(name: str, key: str, along: Vector, system: Subject) -> None:
    """Refuse a vector out of the plane of a two-dimensional system."""
    if system.dimensions == 2 and along[2] != 0:
        raise InputError(f"{name}: {key} has a z component of {along[2]:.6g}, but the system has two dimensions")


def check_place_in_plane(name: str, key: str, place: Vector, system: Subject) -> None:
    """Refuse a place out of the plane of a two-dimensional system."""
    z = float(system.state.positions[0, 2])
    if system.dimensions == 2 and place[2] != z:
        raise InputError(
            f"{name}: {key} has z = {place[2]:.6g}, but the particles of this two-dimensional system have z = {z:.6g}"
        )


def check_alike(key: str, values: Any, system: Subject) -> None:
    """Refuse values that differ along axes in a leaning box: the nearest image is then not that of least energy, so the
    energy of a particle half the box away would jump."""
    if system.box.triclinic and len({*np.broadcast_to(values, 3).tolist()}) > 1:
        raise InputError(f"{key} has three values, but a leaning box takes one, so that the energy does not jump")


def check_massive(name: str, system: Subject, ids: Iterable[int]) -> None:
    """Refuse massless particles, which this force would accelerate without limit."""
    for i in ids:
        if system.state.masses[i] == 0:
            raise InputError(f"{name}: particle {i} has no mass, so this force would accelerate it without limit")
