"""Vectors in LLVM code: numba types for lanes and masks, and emitters that make and combine them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import models, register_model

from kickdrift.jit.numba_private import cgutils

WIDTH = 8
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
