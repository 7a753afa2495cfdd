"""Exponential, logarithm, sine and cosine of eight lanes, by polynomials. LLVM would call the C library for each lane.

Each is within 3 units in the last place of the true value, for the arguments that its docstring names. The bits are the
same wherever the code runs in lanes of the same kind, since no library takes part.
"""

from __future__ import annotations

import math
from typing import Any

from llvmlite import ir
from numba.extending import intrinsic

from kickdrift.jit.compile import as_written
from kickdrift.jit.lanes.functions import splat
from kickdrift.jit.lanes.gathering import lane_round
from kickdrift.jit.lanes.masks import select
from kickdrift.jit.lanes.vectors import F64X8, WIDTH, constant, fused, lanes_type

_WHOLE = ir.VectorType(ir.IntType(64), WIDTH)
LOG2_E = 1.4426950408889634
LN2_HIGH = 0.693147180369123816490  # with zeros at the end, so that whole multiples are exact
LN2_LOW = 1.90821492927058770002e-10
ROOT_HALF = 0.7071067811865476


def _all(value: int) -> ir.Constant:
    return ir.Constant(_WHOLE, [value] * WIDTH)


@intrinsic
def power_of_two(typingctx, exponent):
    """Return 2^k for lanes of whole numbers k from -1022 to 1023."""

    def codegen(context, builder, sig, args):
        whole = builder.fptosi(args[0], _WHOLE)
        return builder.bitcast(builder.shl(builder.add(whole, _all(1023)), _all(52)), F64X8)

    return lanes_type(lanes_type), codegen


@intrinsic
def exponent_of(typingctx, value):
    """Return k for lanes m 2^k with m from 1 up to 2; the lanes are positive and normal."""

    def codegen(context, builder, sig, args):
        bits = builder.lshr(builder.bitcast(args[0], _WHOLE), _all(52))
        return builder.sitofp(builder.sub(bits, _all(1023)), F64X8)

    return lanes_type(lanes_type), codegen


def _polynomial(coefficients: tuple[float, ...]) -> Any:
    """Return a function of lanes x: the polynomial with these coefficients, lowest power first."""

    @intrinsic
    def polynomial(typingctx, x):
        def codegen(context, builder, sig, args):
            total = constant(coefficients[-1])
            for each in coefficients[-2::-1]:
                total = fused(builder, total, args[0], constant(each))
            return total

        return lanes_type(lanes_type), codegen

    return polynomial


exp_series = _polynomial(tuple(1.0 / math.factorial(k) for k in range(14)))
log_series = _polynomial(tuple(2.0 / (2 * k + 1) for k in range(12)))
sine_series = _polynomial(tuple((-1.0) ** k / math.factorial(2 * k + 1) for k in range(11)))
cosine_series = _polynomial(tuple((-1.0) ** k / math.factorial(2 * k) for k in range(12)))


@as_written
def lane_exp(x):
    """Return exp(x) of lanes, 0 below -708 and exp(708) above 708; nan stays nan."""
    low = x < -708.0
    x = select(low, splat(-708.0), x)
    x = select(x > 708.0, splat(708.0), x)
    k = lane_round(x * LOG2_E)
    r = (x - k * LN2_HIGH) - k * LN2_LOW
    return select(low, splat(0.0), exp_series(r) * power_of_two(k))


@as_written
def lane_log(x):
    """Return log(x) of lanes that are positive and normal."""
    k = exponent_of(x)
    m = x * power_of_two(splat(0.0) - k)
    high = m > 2.0 * ROOT_HALF
    m, k = select(high, 0.5 * m, m), select(high, k + 1.0, k)
    s = (m - 1.0) / (m + 1.0)
    return k * LN2_HIGH + (s * log_series(s * s) + k * LN2_LOW)


@as_written
def lane_sine_cosine(x):
    """Return sin(x) and cos(x) of lanes from -pi/2 to pi/2."""
    square = x * x
    return x * sine_series(square), cosine_series(square)
