"""Random numbers that need no state: Philox 4x32-10 in eight lanes, and normal numbers from it.

A number is a function of its key and counter (Salmon et al. 2011, doi:10.1145/2063384.2063405). So it does not depend
on threads, on how a run is cut, or on the order of particles.
"""

import math

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from kickdrift.jit.compile import as_written
from kickdrift.jit.lanes.functions import inverse_sqrt
from kickdrift.jit.lanes.vectors import F64X8, I32, WIDTH, constant, lanes_type

ROUNDS = 10
MULTIPLIERS = (0xD2511F53, 0xCD9E8D57)
WEYL = (0x9E3779B9, 0xBB67AE85)  # added to the key after each round

_I64 = ir.IntType(64)
_I64X8 = ir.VectorType(_I64, WIDTH)
_LOW = (1 << 32) - 1
_PAIR, _FOUR = types.UniTuple(lanes_type, 2), types.UniTuple(lanes_type, 4)
_TWO52 = 0x4330000000000000  # the bits of 2^52; with a whole number below 2^32 in the last bits, 2^52 plus that number


def _all(number: int) -> ir.Constant:
    return ir.Constant(_I64X8, [number] * WIDTH)


def _copied(builder: ir.IRBuilder, scalar: ir.Value) -> ir.Value:
    one = builder.insert_element(ir.Constant(_I64X8, ir.Undefined), scalar, I32(0))
    places = ir.Constant(ir.VectorType(I32, WIDTH), [0] * WIDTH)
    return builder.shuffle_vector(one, ir.Constant(_I64X8, ir.Undefined), places)


def _philox(builder: ir.IRBuilder, counter: list[ir.Value], key: list[ir.Value]) -> list[ir.Value]:
    """Emit the ten rounds; words of 32 bits in lanes of 64."""
    low = _all(_LOW)
    for _ in range(ROUNDS):
        first, second = (builder.mul(counter[2 * k], _all(MULTIPLIERS[k])) for k in (0, 1))
        high = [builder.lshr(product, _all(32)) for product in (second, first)]
        mixed = [builder.xor(builder.xor(high[k], counter[2 * k + 1]), _copied(builder, key[k])) for k in (0, 1)]
        counter = [mixed[0], builder.and_(second, low), mixed[1], builder.and_(first, low)]
        key = [builder.and_(builder.add(key[k], _I64(WEYL[k])), _I64(_LOW)) for k in (0, 1)]
    return counter


@intrinsic
def uniforms(typingctx, ids, index, stage, step, seed):
    """Return four times eight numbers (k + 1/2) / 2^32 between 0 and 1, for the eight ``ids`` from ``index`` on.

    The counter is (id, stage, low half of step, high half of step), the key is (low half of seed, high half). ``ids``
    is a contiguous array of int64. The upper half of an id is shifted by 16 bits and added to the stage."""

    def codegen(context, builder, sig, args):
        data = context.make_array(sig.args[0])(context, builder, args[0]).data
        pointer = builder.bitcast(builder.gep(data, [args[1]]), _I64X8.as_pointer())
        number = builder.load(pointer)
        number.align = 8
        stage, step, seed = args[2:]

        def halves(value):
            return [builder.and_(value, _I64(_LOW)), builder.lshr(value, _I64(32))]

        upper = builder.shl(builder.lshr(number, _all(32)), _all(16))
        second = builder.and_(builder.add(upper, _copied(builder, stage)), _all(_LOW))
        counter = [builder.and_(number, _all(_LOW)), second, *(_copied(builder, half) for half in halves(step))]
        made = []
        for word in _philox(builder, counter, halves(seed)):
            shifted = builder.bitcast(builder.or_(word, _all(_TWO52)), F64X8)
            made.append(builder.fmul(builder.fsub(shifted, constant(2.0**52 - 0.5)), constant(2.0**-32)))
        return context.make_tuple(builder, sig.return_type, made)

    return _FOUR(ids, types.intp, types.int64, types.int64, types.int64), codegen


@intrinsic
def parts_of(typingctx, value):
    """Return m in [1, 2) and e, with value = m 2^e, of positive normal numbers."""

    def codegen(context, builder, sig, args):
        bits = builder.bitcast(args[0], _I64X8)
        exponent = builder.or_(builder.lshr(bits, _all(52)), _all(_TWO52))
        e = builder.fsub(builder.bitcast(exponent, F64X8), constant(2.0**52 + 1023))
        mantissa = builder.or_(builder.and_(bits, _all((1 << 52) - 1)), _all(1023 << 52))
        return context.make_tuple(builder, sig.return_type, [builder.bitcast(mantissa, F64X8), e])

    return _PAIR(lanes_type), codegen


# Coefficients of powers, the highest first, without the highest two of the logarithm.
ARTANH = (1 / 17, 1 / 15, 1 / 13, 1 / 11, 1 / 9, 1 / 7, 1 / 5, 1 / 3, 1.0)
SINE = tuple((-1) ** k / math.factorial(2 * k + 1) for k in range(10, 0, -1))
COSINE = tuple((-1) ** k / math.factorial(2 * k) for k in range(11, -1, -1))


@as_written
def horner(x, first, rest):
    """first x^k + rest[0] x^(k - 1) + ... + rest[-1], by Horner's scheme."""
    value = first
    for coefficient in rest:
        value = x * value + coefficient
    return value


@as_written
def logarithm(value):
    """ln of positive normal numbers, within 1e-15: ln(m) = ln(sqrt 2) + 2 artanh((m - sqrt 2) / (m + sqrt 2))."""
    m, e = parts_of(value)
    root = math.sqrt(2.0)
    s = (m - root) / (m + root)
    t = s * s
    return (e + 0.5) * math.log(2.0) + 2.0 * s * horner(t, t / 21.0 + 1.0 / 19.0, ARTANH)


@as_written
def sine(y):
    """sin y for |y| <= pi/2, by its series to y^21, whose first omitted term is 2e-18 of y."""
    q = y * y
    return y + y * (q * horner(q, q * SINE[0] + SINE[1], SINE[2:]))


@as_written
def cosine(y):
    """cos y for |y| <= pi/2, by its series to y^22."""
    q = y * y
    return horner(q, q * COSINE[0] + COSINE[1], COSINE[2:])


@as_written
def normals(first, second, third, fourth):
    """Three times eight standard normal numbers from four uniform ones (Box & Muller 1958,
    doi:10.1214/aoms/1177706645). The angle is that of 2 pi u - pi."""
    w = -2.0 * logarithm(first)
    radius = w * inverse_sqrt(w)
    half = (second - 0.5) * math.pi
    s, c = sine(half), cosine(half)
    w = -2.0 * logarithm(third)
    other = sine((fourth - 0.5) * math.pi)
    radius3 = w * inverse_sqrt(w)
    return radius * (1.0 - 2.0 * s * s), radius * (2.0 * s * c), radius3 * (1.0 - 2.0 * other * other)
