"""Checks of a System's positions, velocities and box against its number of dimensions."""

from __future__ import annotations

from collections.abc import Sized
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from kickdrift.errors import InputError
from kickdrift.model.box.box import Box
from kickdrift.model.checks.values import numbers
from kickdrift.model.state import Floats


def box_for(given: Any, dimensions: int) -> Box:
    """Return the Box of a System with this number of dimensions. Raises InputError if the box has another number."""
    if dimensions == 3 and isinstance(given, Sized) and not isinstance(given, str) and len(given) == 2:
        raise InputError("box: expected three edge lengths or None, got 2; two go with dimensions = 2")
    box = Box.of(given)
    if dimensions == 2 and box.periodic_axes[2]:
        raise InputError(
            f"box: expected two edge lengths, since a two-dimensional system is not periodic along z, got {box.shape}"
        )
    return box


def check_plane(phase: Floats) -> None:
    """Refuse positions and velocities (2, 3, n) of a two-dimensional system unless they are in one plane."""
    z, v = phase[:, 2]
    for key, values, first, what in (("positions", z, z[0], "z"), ("velocities", v, 0.0, "vz")):
        off = np.flatnonzero(values != first)
        if off.size:
            expected = f"{what} = {first:.6g}, as of particle 0," if key == "positions" else f"{what} = 0"
            raise InputError(
                f"{key}: particle {off[0]} has {what} = {values[off[0]]:.6g}; expected {expected} in two dimensions"
            )


def vectors_of(key: str, values: ArrayLike, dimensions: int) -> Floats:
    """Check positions or velocities and return them as (n, 3). In two dimensions (n, 2) is accepted."""
    array = numbers(key, values, "numbers of shape (n, 3)")
    if dimensions == 2 and array.ndim == 2 and array.shape[1] == 2:
        array = np.column_stack([array, np.zeros(len(array))])
    if array.ndim != 2 or array.shape[1] != 3 or len(array) == 0:
        raise InputError(f"{key}: expected shape (n, 3) with n >= 1, got {array.shape}")
    bad = np.argwhere(~np.isfinite(array))
    if bad.size:
        particle, axis = bad[0]
        raise InputError(
            f"{key}: particle {particle} has {array[particle, axis]} in {'xyz'[axis]}; expected finite numbers"
        )
    return array
