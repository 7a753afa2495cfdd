"""Vectors in LLVM code, and the operators of SIMD lanes that numba learns for the type ``Lanes``.

Lanes mix with scalars, which are copied to all lanes. Like scalars, they have the fast-math flags of the function
around them. In a function without such flags, a product inside a sum is always fused with the sum, in the same way.

For AVX-512, whose divide would take over half of a pair kernel's time, division of 512 bits is a 14-bit estimate
refined by a series, within 2 ulp. Zero, infinity and NaN give a result that is not finite, so they stay visible.
Elsewhere division is a plain divide: in a pair kernel for AVX2 estimates were no faster.
"""

import math
import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import lower_builtin, models, register_model

from kickdrift.jit.compile import features
from kickdrift.jit.numba_private import AbstractTemplate, ConcreteTemplate, cgutils, infer_global, signature

WIDTH = 8
LARGEST_POWER = 64  # that is a product; other powers are exponentials of logarithms
F64 = ir.DoubleType()
F32 = ir.FloatType()
F64X8 = ir.VectorType(F64, WIDTH)
F32X16 = ir.VectorType(F32, 2 * WIDTH)
F64X4 = ir.VectorType(F64, WIDTH // 2)
F32X8 = ir.VectorType(F32, WIDTH)
FULL = (F64X8, F32X16)  # 512 bits, as in AVX-512
I1X8 = ir.VectorType(ir.IntType(1), WIDTH)
I32 = ir.IntType(32)


class Mask(types.Type):
    """Booleans side by side."""

    def __init__(self, count: int) -> None:
        self.count = count
        super().__init__(name=f"Mask({count})")


class Lanes(types.Type):
    """Numbers side by side, with the LLVM type ``vector``. Comparisons give a ``mask``."""

    whole_powers = True

    def __init__(self, vector: ir.VectorType, mask: Mask) -> None:
        self.vector, self.mask = vector, mask
        super().__init__(name=f"Lanes({vector.count} x {vector.element})")


mask_type, single_mask_type, half_mask_type = MASKS = Mask(WIDTH), Mask(2 * WIDTH), Mask(WIDTH // 2)
lanes_type, single_type = Lanes(F64X8, mask_type), Lanes(F32X16, single_mask_type)
half_type, half_single_type = Lanes(F64X4, half_mask_type), Lanes(F32X8, mask_type)
KINDS = (lanes_type, single_type, half_type, half_single_type)


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, dmm: Any, fe_type: Lanes) -> None:
        super().__init__(dmm, fe_type, fe_type.vector)


@register_model(Mask)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, dmm: Any, fe_type: Mask) -> None:
        super().__init__(dmm, fe_type, ir.VectorType(ir.IntType(1), fe_type.count))


def copied(builder: ir.IRBuilder, scalar: ir.Value, vector: ir.VectorType = F64X8) -> ir.Value:
    if scalar.type != vector.element:
        scalar = builder.fptrunc(scalar, vector.element)
    one = builder.insert_element(ir.Constant(vector, ir.Undefined), scalar, I32(0))
    zeros = ir.Constant(ir.VectorType(I32, vector.count), [0] * vector.count)
    return builder.shuffle_vector(one, ir.Constant(vector, ir.Undefined), zeros)


def constant(value: float, vector: ir.VectorType = F64X8) -> ir.Constant:
    return ir.Constant(vector, [value] * vector.count)


def as_lanes(builder: ir.IRBuilder, value: ir.Value, kind: types.Type, vector: ir.VectorType) -> ir.Value:
    """Convert a value of a numba type, lanes or a number, to lanes."""
    return value if isinstance(kind, Lanes) else copied(builder, value, vector)


def bytes_of(element: ir.Type) -> int:
    """Bytes of a lane of float64 or float32."""
    return 8 if element == F64 else 4


def suffix(vector: ir.VectorType) -> str:
    return f"v{vector.count}f{8 * bytes_of(vector.element)}"


def fused(builder: ir.IRBuilder, a: ir.Value, b: ir.Value, c: ir.Value, name: str = "fmuladd") -> ir.Value:
    kind = ir.FunctionType(a.type, [a.type] * 3)
    function = cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.{suffix(a.type)}")
    return builder.call(function, [a, b, c])


def estimate(builder: ir.IRBuilder, name: str, x: ir.Value) -> ir.Value:
    """AVX-512's estimate of 1 / x (rcp14) or 1 / sqrt(x) (rsqrt14), to 14 bits, for the ``FULL`` vectors."""
    letter = "d" if x.type == F64X8 else "s"
    every = ir.Constant(ir.IntType(x.type.count), -1)
    kind = ir.FunctionType(x.type, [x.type, x.type, every.type])
    estimate = cgutils.get_or_insert_function(builder.module, kind, f"llvm.x86.avx512.{name}.p{letter}.512")
    return builder.call(estimate, [x, constant(0.0, x.type), every])


def flags_of(context: Any) -> tuple[str, ...]:
    """Fast-math flags of the function being compiled."""
    return tuple(sorted(context.fastmath.flags)) if context.fastmath else ()


def pointer_to(context: Any, builder: Any, sig: Any, args: Any, vector: ir.VectorType = F64X8) -> ir.Value:
    array, index = args[:2]
    data = context.make_array(sig.args[0])(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), vector.as_pointer())


def first_lanes(builder: ir.IRBuilder, count: ir.Value) -> ir.Value:
    """Mask of the first ``count`` lanes."""
    lanes, kind = ir.Constant(ir.VectorType(count.type, WIDTH), list(range(WIDTH))), ir.VectorType(I32, WIDTH)
    one = builder.insert_element(ir.Constant(lanes.type, ir.Undefined), count, I32(0))
    many = builder.shuffle_vector(one, ir.Constant(lanes.type, ir.Undefined), ir.Constant(kind, [0] * WIDTH))
    return builder.icmp_signed("<", lanes, many)


def folded(builder: ir.IRBuilder, vector: ir.Value, combine: Callable[[ir.Value, ir.Value], ir.Value]) -> ir.Value:
    """Combine the lanes to one number, always in the same order: halves, quarters, eighths."""
    width = WIDTH
    while width > 1:
        width //= 2
        kind = ir.VectorType(I32, width)
        low = builder.shuffle_vector(vector, vector, ir.Constant(kind, list(range(width))))
        high = builder.shuffle_vector(vector, vector, ir.Constant(kind, list(range(width, 2 * width))))
        vector = combine(low, high)
    return builder.extract_element(vector, I32(0))


def divided(builder: ir.IRBuilder, a: ir.Value, b: ir.Value, flags: tuple[str, ...]) -> ir.Value:
    """Emit a / b. An estimate y with e = 1 - b y < 2^-13 gives 1 / b = y (1 + e) (1 + e^2) to 2^-52, or y (1 + e) to
    2^-26."""
    if "avx512f" not in features() or b.type not in FULL:
        return builder.fdiv(a, b, flags=flags)
    y = estimate(builder, "rcp14", b)
    e = fused(builder, builder.fneg(b), y, constant(1.0, b.type), "fma")
    y = fused(builder, y, e, y, "fma")
    if b.type == F64X8:
        y = fused(builder, y, builder.fmul(e, e), y, "fma")
    return builder.fmul(a, y, flags=flags)


def _is_product(value: ir.Value) -> bool:
    return isinstance(value, ir.Instruction) and value.opname == "fmul" and isinstance(value.type, ir.VectorType)


def added(builder: ir.IRBuilder, a: ir.Value, b: ir.Value, flags: tuple[str, ...]) -> ir.Value:
    """Emit a + b, fused if one is a product. LLVM fuses by itself where the flag "contract" allows it."""
    if not flags and _is_product(b):
        return fused(builder, b.operands[0], b.operands[1], a)
    if not flags and _is_product(a):
        return fused(builder, a.operands[0], a.operands[1], b)
    return builder.fadd(a, b, flags=flags)


def subtracted(builder: ir.IRBuilder, a: ir.Value, b: ir.Value, flags: tuple[str, ...]) -> ir.Value:
    """Emit a - b, likewise."""
    if not flags and _is_product(b):
        return fused(builder, builder.fneg(b.operands[0]), b.operands[1], a)
    if not flags and _is_product(a):
        return fused(builder, a.operands[0], a.operands[1], builder.fneg(b))
    return builder.fsub(a, b, flags=flags)


ARITHMETIC: dict[Callable[..., Any], Callable[..., ir.Value]] = {
    operator.add: added,
    operator.sub: subtracted,
    operator.mul: lambda builder, a, b, flags: builder.fmul(a, b, flags=flags),
    operator.truediv: divided,
}
_COMPARISONS = {operator.lt: "<", operator.le: "<=", operator.gt: ">", operator.ge: ">=", operator.eq: "=="}
_FUNCTIONS: dict[Callable[..., Any], str] = {
    math.sqrt: "sqrt",
    abs: "fabs",
    math.fabs: "fabs",
}


def register(function: Callable[..., Any], signatures: list[Any]) -> None:
    """Teach numba the argument types and result types of a function."""
    infer_global(function)(type("LanesTemplate", (ConcreteTemplate,), {"key": function, "cases": signatures}))


def _lower_binary(function: Callable[..., Any], emit: Callable[..., ir.Value], compares: bool) -> None:
    cases = [
        signature(kind.mask if compares else kind, *pair)
        for kind in KINDS
        for pair in ((kind, kind), (kind, types.float64), (types.float64, kind))
    ]
    register(function, cases)
    for case in cases:

        def lowered(context, builder, sig, args):
            vector = next(kind.vector for kind in sig.args if isinstance(kind, Lanes))
            a, b = (as_lanes(builder, value, kind, vector) for kind, value in zip(sig.args, args, strict=True))
            return emit(builder, a, b, flags_of(context))

        lower_builtin(function, *case.args)(lowered)


def _lower_function(function: Callable[..., Any], name: str) -> None:
    register(function, [signature(kind, kind) for kind in KINDS])
    for kind in KINDS:
        lower_builtin(function, kind)(_calling(name))


def _calling(name: str) -> Callable[..., ir.Value]:
    def lowered(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        vector = args[0].type
        kind = ir.FunctionType(vector, [vector])
        called = cgutils.get_or_insert_function(builder.module, kind, f"llvm.{name}.{suffix(vector)}")
        return builder.call(called, args)

    return lowered


for _function, _emit in ARITHMETIC.items():
    _lower_binary(_function, _emit, False)
for _function, _sign in _COMPARISONS.items():
    _lower_binary(_function, lambda builder, a, b, flags, sign=_sign: builder.fcmp_ordered(sign, a, b), True)
for _function, _name in _FUNCTIONS.items():
    _lower_function(_function, _name)
register(operator.neg, [signature(kind, kind) for kind in KINDS])


@lower_builtin(operator.neg, Lanes)
def _negative(context, builder, sig, args):
    return builder.fneg(args[0], flags=flags_of(context))


@infer_global(operator.pow)
class _WholePower(AbstractTemplate):
    """``x**k`` for a literal whole k from -LARGEST_POWER to LARGEST_POWER, of lanes and of types that become lanes.

    It stands before the other powers of lanes, see `elementary`: numba takes the first template that fits, and those
    would turn a table into lanes and take logarithms."""

    def generic(self, args: Any, kws: Any) -> Any:
        whole = len(args) == 2 and hasattr(args[0], "whole_powers") and isinstance(args[1], types.IntegerLiteral)
        return signature(args[0], *args) if whole and abs(args[1].literal_value) <= LARGEST_POWER else None


@lower_builtin(operator.pow, Lanes, types.IntegerLiteral)
def _whole_power(context, builder, sig, args):
    return whole_power(builder, args[0], sig.args[1].literal_value, flags_of(context))


def whole_power(builder: ir.IRBuilder, x: ir.Value, exponent: int, flags: tuple[str, ...]) -> ir.Value:
    """Emit x to a whole power."""
    if exponent <= 0:
        one = constant(1.0, x.type)
        return divided(builder, one, whole_power(builder, x, -exponent, flags), flags) if exponent else one
    square, result = x, None
    while exponent:
        if exponent & 1:
            result = square if result is None else builder.fmul(result, square, flags=flags)
        square = builder.fmul(square, square, flags=flags)
        exponent >>= 1
    return result
