"""Virial along each axis, for a barostat whose edges change apart. Without an array for it this is compiled out.

A force gives this virial if its parts have a field ``along``: None, or an array (rows, 3) that the force fills whenever
it sums energy and virial. The rows are chunks of the force, whose sum is the virial along x, y and z.
"""

from __future__ import annotations

from typing import Any

from numba import types

from kickdrift.forces.lists.pair_rows import in_float64
from kickdrift.jit.inner import overload
from kickdrift.jit.lanes.functions import lane_sum, splat


def zeros_along(along: Any, sums: Any) -> Any:
    """Sums to begin with: three times eight zeros, or None if nobody asks."""
    raise NotImplementedError("for compiled code")


@overload(zeros_along)
def _zeros_along(along, sums):
    if isinstance(along, types.NoneType) or isinstance(sums, types.NoneType):
        return lambda along, sums: None
    return lambda along, sums: (splat(0.0), splat(0.0), splat(0.0))


def add_along(total: Any, x: Any, y: Any, z: Any) -> Any:
    """Sums with the virials x, y and z of more pairs: force times displacement along each axis."""
    raise NotImplementedError("for compiled code")


@overload(add_along)
def _add_along(total, x, y, z):
    if isinstance(total, types.NoneType):
        return lambda total, x, y, z: None

    def each(total, x, y, z):
        sum_x, sum_y, sum_z = total
        return sum_x + in_float64(x), sum_y + in_float64(y), sum_z + in_float64(z)

    return each


def store_along(total: Any, along: Any, c: int) -> None:
    """Write the sums of chunk c."""


@overload(store_along)
def _store_along(total, along, c):
    if isinstance(total, types.NoneType):
        return lambda total, along, c: None

    def each(total, along, c):
        x, y, z = total
        along[c, 0], along[c, 1], along[c, 2] = lane_sum(x), lane_sum(y), lane_sum(z)

    return each
