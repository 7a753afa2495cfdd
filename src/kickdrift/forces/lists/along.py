"""Virial along each axis, for a barostat whose edges change apart. Without an array for it this is compiled out.

A force gives this virial if its parts have a field ``along`` that the force fills whenever it sums energy and virial:

- None, for nobody asks;
- an array (rows, 3), whose rows are chunks of the force. Their sum is the virial along x, y and z;
- an array (rows, 2, 3), for a box that changes its shape. In each row the virial across the axes follows: force along
  one axis times displacement along another, in the order yz, xz, xy.
"""

from __future__ import annotations

from numba import types

from kickdrift.forces.lists.pair_rows import in_float64
from kickdrift.jit.inner import by_type
from kickdrift.jit.lanes.functions import lane_sum, multiply_add, splat
from kickdrift.jit.lanes.vectors import lanes_type

ALL = 3  # dimensions of an array for the virial across the axes too


@by_type
def zeros_along(along, sums):
    """Sums to begin with: three or six times eight zeros, or None if nobody asks."""
    if isinstance(along, types.NoneType) or isinstance(sums, types.NoneType):
        return lambda along, sums: None
    if along.ndim == ALL:
        return lambda along, sums: (splat(0.0), splat(0.0), splat(0.0), splat(0.0), splat(0.0), splat(0.0))
    return lambda along, sums: (splat(0.0), splat(0.0), splat(0.0))


@by_type
def add_along(total, fx, fy, fz, dx, dy, dz):
    """Sums with the virials of more pairs, by their forces and displacements along each axis."""
    if isinstance(total, types.NoneType):
        return lambda total, fx, fy, fz, dx, dy, dz: None
    if len(total) == 6:

        def all_six(total, fx, fy, fz, dx, dy, dz):
            xx, yy, zz, yz, xz, xy = total
            xx, yy, zz = add_product(fx, dx, xx), add_product(fy, dy, yy), add_product(fz, dz, zz)
            return xx, yy, zz, add_product(fy, dz, yz), add_product(fx, dz, xz), add_product(fx, dy, xy)

        return all_six

    def each(total, fx, fy, fz, dx, dy, dz):
        sum_x, sum_y, sum_z = total
        return add_product(fx, dx, sum_x), add_product(fy, dy, sum_y), add_product(fz, dz, sum_z)

    return each


@by_type
def add_product(a, b, total):
    """Return the sum, eight lanes of float64, with the products of the lanes a and b."""
    if a == b == lanes_type:
        return lambda a, b, total: multiply_add(a, b, total)
    return lambda a, b, total: total + in_float64(a * b)


@by_type
def trace_of(total, virial):
    """Return the virial as the sum of those along the axes; ``virial`` itself if nobody asks for these."""
    if isinstance(total, types.NoneType):
        return lambda total, virial: virial
    return lambda total, virial: total[0] + total[1] + total[2]


@by_type
def store_along(total, along, c):
    """Write the sums of chunk c."""
    if isinstance(total, types.NoneType):
        return lambda total, along, c: None
    if len(total) == 6:

        def all_six(total, along, c):
            xx, yy, zz, yz, xz, xy = total
            along[c, 0, 0], along[c, 0, 1], along[c, 0, 2] = lane_sum(xx), lane_sum(yy), lane_sum(zz)
            along[c, 1, 0], along[c, 1, 1], along[c, 1, 2] = lane_sum(yz), lane_sum(xz), lane_sum(xy)

        return all_six

    def each(total, along, c):
        x, y, z = total
        along[c, 0], along[c, 1], along[c, 2] = lane_sum(x), lane_sum(y), lane_sum(z)

    return each
