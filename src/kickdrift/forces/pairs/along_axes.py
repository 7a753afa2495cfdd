"""The virial along each axis, which pair sums add up for a barostat whose edges change apart.

Without an array for it all this is compiled out.
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


def add_along(total: Any, factor: Any, g: Any, dx: Any, dy: Any, dz: Any) -> Any:
    """Sums with those of more pairs, of displacement (dx, dy, dz) and force over r ``g``, times ``factor``."""
    raise NotImplementedError("for compiled code")


@overload(add_along)
def _add_along(total, factor, g, dx, dy, dz):
    if isinstance(total, types.NoneType):
        return lambda total, factor, g, dx, dy, dz: None

    def each(total, factor, g, dx, dy, dz):
        x, y, z = total
        g = factor * g
        return x + in_float64(g * dx * dx), y + in_float64(g * dy * dy), z + in_float64(g * dz * dz)

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
