"""Vectors of three as a type, of lanes or of numbers, with operators and functions, so that kernels read as formulas.

numba learns ``Vector3`` with +, -, the sign, products with lanes and with numbers, and ``.x .y .z``. In a function
without fast-math flags, a product of lanes inside a sum is fused with the sum. Numbers that meet lanes are copied to
all lanes. An operation has the bits of its components written out, as `lanes` or numbers have them, with the fast-math
flags of the function around it.
"""

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic, lower_builtin, lower_getattr_generic, models, register_model

from kickdrift.jit.lanes.vectors import (
    F64,
    F64X8,
    I32,
    WIDTH,
    Lanes,
    added,
    copied,
    flags_of,
    folded,
    lanes_type,
    mask_type,
    pointer_to,
    subtracted,
)
from kickdrift.jit.numba_private import AbstractTemplate, AttributeTemplate, infer_getattr, infer_global, signature

AXES = ("x", "y", "z")


class Vector3(types.Type):
    """Three values of the type ``of``: lanes or float64."""

    def __init__(self, of: types.Type) -> None:
        self.of = of
        super().__init__(name=f"Vector3({of.name})")


@register_model(Vector3)
class _Vector3Model(models.StructModel):
    def __init__(self, dmm: Any, fe_type: Vector3) -> None:
        super().__init__(dmm, fe_type, [(axis, fe_type.of) for axis in AXES])


def components(builder: ir.IRBuilder, vector: ir.Value) -> list[ir.Value]:
    """Components of a vector. For a vector just put together, these are its original values, so that `lanes.added`
    still recognises a product."""
    known: dict[int, ir.Value] = {}
    while isinstance(vector, ir.instructions.InsertValue):
        (place,), (vector, value) = vector.indices, vector.operands
        known.setdefault(place, value)
    return [known[k] if k in known else builder.extract_value(vector, k) for k in range(3)]


def joined(builder: ir.IRBuilder, parts: list[ir.Value]) -> ir.Value:
    """Vector of three components."""
    vector = ir.Constant(ir.LiteralStructType([part.type for part in parts]), ir.Undefined)
    for k, part in enumerate(parts):
        vector = builder.insert_value(vector, part, k)
    return vector


def common(*kinds: types.Type) -> types.Type | None:
    """Common type of vectors, lanes and numbers in one operation, or None if they do not mix."""
    inner = [kind.of if isinstance(kind, Vector3) else kind for kind in kinds]
    lanes = {kind for kind in inner if isinstance(kind, Lanes)}
    if len(lanes) > 1 or not all(isinstance(kind, Lanes | types.Number) for kind in inner):
        return None
    return lanes.pop() if lanes else types.float64


def passed(kind: types.Type) -> types.Type:
    """Type of a vector, lanes or a number as an argument: whole numbers become float64."""
    return types.float64 if isinstance(kind, types.Number) else kind


def parts_of(builder: ir.IRBuilder, value: ir.Value, kind: types.Type, of: types.Type) -> list[ir.Value]:
    """Three values of the type ``of``: a vector's components, or lanes or a number three times."""
    parts = components(builder, value) if isinstance(kind, Vector3) else [value]
    if isinstance(of, Lanes) and not isinstance(parts[0].type, ir.VectorType):
        parts = [copied(builder, part, of.vector) for part in parts]
    return parts if len(parts) == 3 else 3 * parts


def _multiplied(builder: ir.IRBuilder, a: ir.Value, b: ir.Value, flags: tuple[str, ...]) -> ir.Value:
    return builder.fmul(a, b, flags=flags)


def _teach(function: Callable[..., Any], emit: Callable[..., ir.Value], *pairs: tuple[Any, Any]) -> None:
    """Teach numba an operator on two operands of these classes, component by component."""

    def generic(self: Any, args: Any, kws: Any) -> Any:
        if not any(isinstance(kind, Vector3) for kind in args) or len(args) != 2:
            return None
        given = [passed(kind) for kind in args]
        of = common(*given)
        known = any(all(map(isinstance, given, pair)) for pair in pairs)
        return signature(Vector3(of), *given) if known and of else None

    infer_global(function)(type("Vector3Template", (AbstractTemplate,), {"key": function, "generic": generic}))

    def lowered(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        of, flags = sig.return_type.of, flags_of(context)
        a, b = (parts_of(builder, value, kind, of) for value, kind in zip(args, sig.args, strict=True))
        return joined(builder, [emit(builder, *pair, flags) for pair in zip(a, b, strict=True)])

    for pair in pairs:
        lower_builtin(function, *pair)(lowered)


_teach(operator.add, added, (Vector3, Vector3))
_teach(operator.sub, subtracted, (Vector3, Vector3))
_NUMBER_FIRST = ((Lanes, Vector3), (types.Float, Vector3))
_teach(operator.mul, _multiplied, *_NUMBER_FIRST, *(pair[::-1] for pair in _NUMBER_FIRST))


@infer_global(operator.neg)
class _Negative(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        return signature(args[0], args[0]) if isinstance(args[0], Vector3) else None


@lower_builtin(operator.neg, Vector3)
def _negative(context, builder, sig, args):
    return joined(builder, [builder.fneg(part, flags=flags_of(context)) for part in components(builder, args[0])])


@infer_getattr
class _Components(AttributeTemplate):
    key = Vector3

    def generic_resolve(self, vector: Vector3, name: str) -> Any:
        return vector.of if name in AXES else None


@lower_getattr_generic(Vector3)
def _component(context, builder, kind, value, name):
    return components(builder, value)[AXES.index(name)]


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
