"""Exponential, logarithm and powers of lanes as polynomials, since LLVM would call the C library for each lane.

In float64 the exponential and the logarithm are within 1 unit in the last place, in float32 within 2. A power x^y that
is no small whole power is the exponential of y log x. Its relative error is below 2^-52 (2 + |y log x|), and a negative
x gives nan. An exponential below twice the smallest normal number is zero. The bits are the same wherever lanes of one
kind run, since no library takes part.

Source of the logarithm: FreeBSD's msun, e_log.c of Sun Microsystems. With s = f / (2 + f),
log(1 + f) = f - (f^2/2 - s (f^2/2 + R(s^2))).
"""

from __future__ import annotations

import math
import operator
import struct
from typing import Any, NamedTuple

from llvmlite import ir
from numba import types
from numba.extending import lower_builtin

from kickdrift.jit.lanes.vectors import (
    F64,
    KINDS,
    as_lanes,
    bytes_of,
    constant,
    divided,
    fused,
    register,
    suffix,
)
from kickdrift.jit.numba_private import cgutils, signature


class Numbers(NamedTuple):
    """Constants for one precision. ``mantissa`` counts its stored bits."""

    mantissa: int
    bias: int  # of the exponent
    ln2: tuple[float, float]  # its first digits, with zeros at the end, and the rest
    least: float  # below this an exponential is zero
    most: float  # an exponential of this is infinite
    terms: int  # of the exponential's series after 1 + r
    smallest: float  # normal number
    series: tuple[float, ...]  # R(z) / z


DOUBLE = Numbers(
    52, 1023, (0.693147180369123816490, 1.90821492927058770002e-10), -707.7, 710.0, 12, 2.0**-1022,
    (0.6666666666666735130, 0.3999999999940941908, 0.2857142874366239149, 0.2222219843214978396,
     0.1818357216161805012, 0.1531383769920937332, 0.1479819860511658591),
)  # fmt: skip
SINGLE = Numbers(
    23, 127, (0.693145751953125, 1.42860682030941723212e-6), -86.9, 89.0, 7, 2.0**-126,
    (0.66666662693, 0.40000972152, 0.28498786688, 0.24279078841),
)  # fmt: skip


def _numbers(x: ir.Value) -> Numbers:
    return DOUBLE if x.type.element == F64 else SINGLE


def _whole(kind: ir.VectorType) -> ir.VectorType:
    return ir.VectorType(ir.IntType(8 * bytes_of(kind.element)), kind.count)


def _every(kind: ir.VectorType, number: int) -> ir.Constant:
    return ir.Constant(_whole(kind), [number] * kind.count)


def _bits(kind: ir.VectorType, number: float) -> int:
    """The bits of a number in the precision of a vector."""
    form = ("<d", "<q") if kind.element == F64 else ("<f", "<i")
    return int(struct.unpack(form[1], struct.pack(form[0], number))[0])


def _polynomial(builder: ir.IRBuilder, coefficients: tuple[float, ...], x: ir.Value) -> ir.Value:
    """Emit a polynomial, lowest power first."""
    total = constant(coefficients[-1], x.type)
    for each in coefficients[-2::-1]:
        total = fused(builder, total, x, constant(each, x.type))
    return total


def exponential(builder: ir.IRBuilder, x: ir.Value) -> ir.Value:
    """Emit exp(x) = 2^k exp(r), |r| < 0.35."""
    kind, own = x.type, _numbers(x)
    low = builder.fcmp_ordered("<", x, constant(own.least, kind))
    x = builder.select(low, constant(own.least, kind), x)
    x = builder.select(builder.fcmp_ordered(">", x, constant(own.most, kind)), constant(own.most, kind), x)
    rint = ir.FunctionType(kind, [kind])
    nearest = cgutils.get_or_insert_function(builder.module, rint, f"llvm.nearbyint.{suffix(kind)}")
    k = builder.call(nearest, [builder.fmul(x, constant(1.0 / math.log(2.0), kind))])
    minus = builder.fneg(k)
    r = fused(builder, minus, constant(own.ln2[1], kind), fused(builder, minus, constant(own.ln2[0], kind), x))
    series = _polynomial(builder, tuple(1.0 / math.factorial(n) for n in range(2, 2 + own.terms)), r)
    grown = builder.fadd(constant(1.0, kind), fused(builder, builder.fmul(r, r), series, r))
    # 2 exp(r) 2^(k - 1), since 2^k alone may be too large; the last bits of k + 1.5 2^mantissa are those of k
    bits = builder.bitcast(builder.fadd(k, constant(1.5 * 2.0**own.mantissa, kind)), _whole(kind))
    scale = builder.shl(builder.add(bits, _every(kind, own.bias - 1)), _every(kind, own.mantissa))
    found = builder.fmul(builder.fadd(grown, grown), builder.bitcast(scale, kind))
    return builder.select(low, constant(0.0, kind), found)


def logarithm(builder: ir.IRBuilder, x: ir.Value) -> ir.Value:
    """Emit log(x) = k log(2) + log(1 + f), where 1 + f lies between sqrt(1/2) and sqrt(2)."""
    kind, own = x.type, _numbers(x)
    tiny = builder.fcmp_ordered("<", x, constant(own.smallest, kind))
    larger = builder.fmul(x, constant(2.0 ** (own.mantissa + 2), kind))
    normal = builder.bitcast(builder.select(tiny, larger, x), _whole(kind))
    root = _bits(kind, math.sqrt(0.5))
    moved = builder.add(normal, _every(kind, _bits(kind, 1.0) - root))
    high = 2.0**own.mantissa
    exponent = builder.or_(builder.lshr(moved, _every(kind, own.mantissa)), _every(kind, _bits(kind, high)))
    down = builder.select(tiny, constant(high + own.bias + own.mantissa + 2, kind), constant(high + own.bias, kind))
    k = builder.fsub(builder.bitcast(exponent, kind), down)
    within = builder.and_(moved, _every(kind, (1 << own.mantissa) - 1))
    f = builder.fsub(builder.bitcast(builder.add(within, _every(kind, root)), kind), constant(1.0, kind))
    s = divided(builder, f, builder.fadd(f, constant(2.0, kind)), ())
    z, half = builder.fmul(s, s), builder.fmul(constant(0.5, kind), builder.fmul(f, f))
    inner = fused(builder, z, _polynomial(builder, own.series, z), half)
    rest = builder.fsub(half, fused(builder, s, inner, builder.fmul(k, constant(own.ln2[1], kind))))
    found = fused(builder, k, constant(own.ln2[0], kind), builder.fsub(f, rest))
    infinite, zero = constant(math.inf, kind), constant(0.0, kind)
    lowest = builder.select(
        builder.fcmp_ordered("==", x, zero), constant(-math.inf, kind), constant(math.nan, kind)
    )  # of numbers that are not positive
    usual = builder.select(builder.fcmp_ordered("<", x, infinite), found, infinite)
    return builder.select(builder.fcmp_ordered(">", x, zero), usual, lowest)


for _kind in KINDS:
    for _function, _emit in ((math.exp, exponential), (math.log, logarithm)):
        register(_function, [signature(_kind, _kind)])

        @lower_builtin(_function, _kind)
        def _lowered(context: Any, builder: Any, sig: Any, args: Any, emit: Any = _emit) -> Any:
            return emit(builder, args[0])

    for _pair in ((_kind, _kind), (_kind, types.float64), (types.float64, _kind)):
        register(operator.pow, [signature(_kind, *_pair)])

        @lower_builtin(operator.pow, *_pair)
        def _power(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            vector = sig.return_type.vector
            x, y = (as_lanes(builder, value, kind, vector) for value, kind in zip(args, sig.args, strict=True))
            return exponential(builder, builder.fmul(y, logarithm(builder, x)))
