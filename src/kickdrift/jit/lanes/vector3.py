"""Vectors of three as a type, of lanes or of numbers: functions in compiled kernels, which then read as formulas.

`vector3_operators` has the type and its operators. An operation has the bits of its components written out, as `lanes`
or numbers have them, with the fast-math flags of the function around it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from kickdrift.jit.lanes.operators import added, subtracted
from kickdrift.jit.lanes.vector3_operators import Vector3, common, components, joined, parts_of, passed
from kickdrift.jit.lanes.vectors import (
    F64,
    F64X8,
    I32,
    WIDTH,
    flags_of,
    folded,
    lanes_type,
    mask_type,
    pointer_to,
)

_lanes3, _numbers3 = Vector3(lanes_type), Vector3(types.float64)


def _each(builder: ir.IRBuilder, vector: ir.Value, emit: Callable[[ir.Value], ir.Value]) -> ir.Value:
    return joined(builder, [emit(part) for part in components(builder, vector)])


# --- constructors ---


@intrinsic
def vector3(typingctx, x, y, z):
    """Vector of three components, lanes or numbers."""
    of = common(x, y, z)

    def codegen(context, builder, sig, args):
        return joined(builder, [parts_of(builder, *each, of)[0] for each in zip(args, sig.args, strict=True)])

    return (Vector3(of)(passed(x), passed(y), passed(z)), codegen) if of else None


@intrinsic
def thrice(typingctx, value):
    """Vector of three equal components, lanes or a number."""
    given = passed(value)

    def codegen(context, builder, sig, args):
        return joined(builder, 3 * [args[0]])

    return Vector3(given)(given), codegen


# --- memory: contiguous arrays of float64; the index counts all their numbers from 0 ---


def _pointers(context: Any, builder: Any, sig: Any, args: Any, to: ir.Type) -> list[ir.Value]:
    """Pointers to the three components. The arguments begin with the array, the index of x, and the stride from x to y
    and from y to z."""
    array, place, stride = args[:3]
    places = [place, builder.add(place, stride), builder.add(place, builder.add(stride, stride))]
    return [pointer_to(context, builder, sig, (array, each), to) for each in places]


def _loading(to: ir.Type) -> Callable[..., ir.Value]:
    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> ir.Value:
        parts = [builder.load(pointer) for pointer in _pointers(context, builder, sig, args, to)]
        for part in parts:
            part.align = 8
        return joined(builder, parts)

    return codegen


def _is_plain(array: types.Type) -> bool:
    return isinstance(array, types.Array) and array.layout == "C" and array.dtype == types.float64


@intrinsic
def load3(typingctx, array, place, stride):
    """Load eight x from ``place`` on, eight y ``stride`` behind, eight z twice as far."""
    return (_lanes3(array, types.intp, types.intp), _loading(F64X8)) if _is_plain(array) else None


@intrinsic
def numbers3(typingctx, array, place, stride):
    """Load the number x at ``place``, y ``stride`` behind, z twice as far."""
    return (_numbers3(array, types.intp, types.intp), _loading(F64)) if _is_plain(array) else None


@intrinsic
def store3(typingctx, array, place, stride, vector):
    """Store a vector: lanes in the layout of ``load3``, numbers in the layout of ``numbers3``."""

    def codegen(context, builder, sig, args):
        parts = components(builder, args[3])
        for part, pointer in zip(parts, _pointers(context, builder, sig, args, parts[0].type), strict=True):
            builder.store(part, pointer).align = 8
        return context.get_dummy_value()

    known = _is_plain(array) and vector in (_lanes3, _numbers3)
    return (types.void(array, types.intp, types.intp, vector), codegen) if known else None


# --- products, lanes ---


def _sum_of_products(
    builder: ir.IRBuilder, start: ir.Value | None, a: list[ir.Value], b: list[ir.Value], flags: tuple[str, ...]
) -> ir.Value:
    for one, other in zip(a, b, strict=True):
        product = builder.fmul(one, other, flags=flags)
        start = product if start is None else added(builder, start, product, flags)
    return start


@intrinsic
def dot(typingctx, a, b):
    """Scalar product a_x b_x + a_y b_y + a_z b_z."""
    of = common(a, b)

    def codegen(context, builder, sig, args):
        one, other = (parts_of(builder, *each, of) for each in zip(args, sig.args, strict=True))
        return _sum_of_products(builder, None, one, other, flags_of(context))

    return (of(a, b), codegen) if of and isinstance(a, Vector3) and isinstance(b, Vector3) else None


@intrinsic
def plus_dot(typingctx, start, a, b):
    """Return start + a_x b_x + a_y b_y + a_z b_z. It rounds differently from start + dot(a, b)."""
    of = common(start, a, b)

    def codegen(context, builder, sig, args):
        first, one, other = (parts_of(builder, *each, of) for each in zip(args, sig.args, strict=True))
        return _sum_of_products(builder, first[0], one, other, flags_of(context))

    return (of(passed(start), a, b), codegen) if of and isinstance(a, Vector3) and isinstance(b, Vector3) else None


@intrinsic
def cross(typingctx, a, b):
    """Vector product a x b."""
    of = common(a, b)

    def codegen(context, builder, sig, args):
        flags = flags_of(context)
        (ax, ay, az), (bx, by, bz) = (parts_of(builder, *each, of) for each in zip(args, sig.args, strict=True))

        def minor(p, q, r, s):
            return subtracted(builder, builder.fmul(p, q, flags=flags), builder.fmul(r, s, flags=flags), flags)

        return joined(builder, [minor(ay, bz, az, by), minor(az, bx, ax, bz), minor(ax, by, ay, bx)])

    return (Vector3(of)(a, b), codegen) if of and isinstance(a, Vector3) and isinstance(b, Vector3) else None


@intrinsic
def select3(typingctx, mask, yes, no):
    """Like `masks.select`, for two vectors of lanes."""

    def codegen(context, builder, sig, args):
        pairs = zip(components(builder, args[1]), components(builder, args[2]), strict=True)
        return joined(builder, [builder.select(args[0], *pair) for pair in pairs])

    return (_lanes3(mask, yes, no), codegen) if yes == no == _lanes3 and mask == mask_type else None


@intrinsic(prefer_literal=True)
def rotated3(typingctx, vector, places):
    """Like `lanes.rotated`, for each component."""
    order = [(k + places.literal_value) % WIDTH for k in range(WIDTH)]

    def codegen(context, builder, sig, args):
        turn = ir.Constant(ir.VectorType(I32, WIDTH), order)
        return _each(builder, args[0], lambda part: builder.shuffle_vector(part, part, turn))

    return _lanes3(_lanes3, places), codegen


@intrinsic
def lane_sums(typingctx, vector):
    """Vector of the lane sums of each component."""

    def codegen(context, builder, sig, args):
        return _each(builder, args[0], lambda part: folded(builder, part, builder.fadd))

    return _numbers3(_lanes3), codegen
