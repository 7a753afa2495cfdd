"""Lanes against NumPy: arithmetic, and NaN and infinity, which reveal a blow-up."""

from __future__ import annotations

import math
import operator
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numba import njit, types

from kickdrift.jit.compile import as_written, jit
from kickdrift.jit.lanes import elementary as elementary  # exponential and logarithm
from kickdrift.jit.lanes.functions import inverse_sqrt, lane_max, lane_numbers, lane_sum, multiply_add, rotated, splat
from kickdrift.jit.lanes.masks import any_lane, mask_bits, select
from kickdrift.jit.lanes.memory import aligned, flat, load, load_like, masked_load, masked_store, store
from kickdrift.jit.lanes.packing import fill_places, pack_counted, pack_places, packed, transpose_places
from kickdrift.jit.lanes.single import single_exp, single_log, single_sine_cosine, zeros_in
from kickdrift.jit.lanes.tabled import KINDS
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.jit.numba_private import cpu_target
from tests.processes import python

POWERS = (1, 2, 3, 5, 6, 12, 31, 32)
SPECIAL = (0.0, -0.0, np.inf, -np.inf, np.nan, 5e-324, 1e-310, 2.3e-308, 1e-154, 1.0, -3.0, 1e154, 8.9e307, -1.7e308)


@jit
def arithmetic(a, b, c, out):
    x, y, z = load(a, 0), load(b, 0), load(c, 0)
    s = b[0]
    store(out[0], 0, x + y)
    store(out[1], 0, x - y)
    store(out[2], 0, x * y)
    store(out[3], 0, x / y)
    store(out[4], 0, multiply_add(x, y, z))
    store(out[5], 0, select(x < y, x, z))
    store(out[6], 0, x + s)
    store(out[7], 0, s - x)
    store(out[8], 0, 2 * x)  # a whole number becomes a float
    store(out[9], 0, 1.0 / x)
    store(out[10], 0, -x)
    store(out[11], 0, lane_numbers() + splat(s) * 0.0)


@jit
def functions(a, out):
    x = load(a, 0)
    store(out[0], 0, math.sqrt(x))
    store(out[1], 0, math.exp(x))
    store(out[2], 0, math.log(x))
    store(out[3], 0, abs(x))
    store(out[4], 0, math.fabs(x))
    store(out[5], 0, x**1)
    store(out[6], 0, x**2)
    store(out[7], 0, x**3)
    store(out[8], 0, x**5)
    store(out[9], 0, x**6)
    store(out[10], 0, x**12)
    store(out[11], 0, x**31)
    store(out[12], 0, x**32)


@jit
def comparisons(a, b, bits):
    x, y = load(a, 0), load(b, 0)
    bits[0], bits[1], bits[2] = mask_bits(x < y), mask_bits(x <= y), mask_bits(x > y)
    bits[3], bits[4] = mask_bits(x >= y), mask_bits(x == y)
    bits[5] = mask_bits((x < y) & (x > 0.0))
    bits[6] = any_lane(x < y)
    return lane_sum(x), lane_max(x)


@jit
def copy_from(a, index, out, to):
    store(out, to, load(a, index))


def computed(function, rows, *inputs):
    out = np.full((rows, WIDTH), 123.0)
    function(*inputs, out)
    return out


def numpy_arithmetic(a, b, c):
    with np.errstate(all="ignore"):
        s, smaller = b[0], np.where(a < b, a, c)
        lanes = np.arange(8.0) + s * 0.0
        return np.array([a + b, a - b, a * b, a / b, a * b + c, smaller, a + s, s - a, 2 * a, 1 / a, -a, lanes])


def numpy_functions(a):
    with np.errstate(all="ignore"):
        return np.array([np.sqrt(a), np.exp(a), np.log(a), np.abs(a), np.abs(a), *(a**k for k in POWERS)])


def ulps(got, expected):
    """Largest error in units in the last place, among finite numbers above the subnormal ones."""
    normal = np.isfinite(expected) & (np.abs(expected) > 1e-290)
    return np.max(np.abs(got - expected)[normal] / np.spacing(np.abs(expected[normal])), initial=0.0)


def eight(elements):
    return st.lists(elements, min_size=WIDTH, max_size=WIDTH).map(np.array)


moderate = st.floats(1e-100, 1e100) | st.floats(-1e100, -1e-100)
anything = st.floats(width=64) | st.sampled_from(SPECIAL)
EXACT, DIVISIONS, FUSED = [0, 1, 2, 5, 6, 7, 8, 10, 11], [3, 9], 4


@given(eight(moderate), eight(moderate), eight(moderate))
@settings(max_examples=300, deadline=None)
def test_arithmetic_is_numpys(a, b, c):
    got, expected = computed(arithmetic, 12, a, b, c), numpy_arithmetic(a, b, c)
    np.testing.assert_array_equal(got[EXACT], expected[EXACT])
    assert ulps(got[DIVISIONS], expected[DIVISIONS]) <= 2
    # a b + c has one rounding or two; where it cancels, the error is that of a b
    assert (
        np.abs(got[FUSED] - expected[FUSED]) <= np.spacing(np.abs(a * b)) + np.spacing(np.abs(expected[FUSED]))
    ).all()


@given(eight(anything), eight(anything), eight(anything))
@example(np.full(8, 1.0), np.array([0.0, -0.0, np.inf, -np.inf, np.nan, 5e-324, 1e-310, 1e308]), np.zeros(8))
@example(np.array([0.0, 0.0, np.inf, np.nan, np.nan, -1.0, 1e308, -np.inf]), np.zeros(8), np.full(8, np.nan))
@example(np.full(8, 3.9705154821422376e16), np.full(8, 1.690585191635847e308), np.zeros(8))
@settings(max_examples=500, deadline=None)
def test_what_is_not_finite_stays_visible(a, b, c):
    """A number in place of NaN or infinity would hide a blow-up; NaN in place of infinity would not."""
    got, expected = computed(arithmetic, 12, a, b, c), numpy_arithmetic(a, b, c)
    np.testing.assert_array_equal(got[EXACT], expected[EXACT])  # NaN exactly where NumPy has NaN
    quotients, right = got[DIVISIONS], expected[DIVISIONS]
    assert not np.isfinite(quotients[~np.isfinite(right)]).any()
    both = np.isfinite(quotients)
    error = np.abs(quotients[both] - right[both])
    # The reciprocal of a divisor over 2^1022 is subnormal, and its own rounding up to 2^-51 of it.
    part = np.where(np.abs(np.array([b, a])) > 2.0**1022, 2**-50, 2**-51)[both]
    assert (error <= part * np.abs(right[both]) + 2 * np.finfo(float).smallest_normal).all()
    assert np.isnan(got[FUSED][np.isnan(a) | np.isnan(b) | np.isnan(c)]).all()


def test_division_over_the_whole_range_of_sizes():
    rng = np.random.default_rng(1)
    for _ in range(2000):
        a, b = np.exp(rng.uniform(-300, 300, (2, 8))) * rng.choice([-1.0, 1.0], (2, 8))
        assert ulps(computed(arithmetic, 12, a, b, a)[3], a / b) <= 2


@given(eight(st.floats(1e-300, 1e300)))
@settings(max_examples=200, deadline=None)
def test_functions_are_numpys(a):
    a = np.where(np.arange(8) % 2, a, np.log(a))  # large and small
    got = computed(functions, 13, a)
    with np.errstate(all="ignore"):
        expected = numpy_functions(a)
        np.testing.assert_array_equal(got[[0, 3, 4]], expected[[0, 3, 4]])
        np.testing.assert_array_equal(np.isfinite(got), np.isfinite(expected))
        assert ulps(got[:5], expected[:5]) <= 2
        assert ulps(got[5:], expected[5:]) <= 34  # k - 1 roundings


def test_functions_of_what_is_not_finite():
    a = np.array([np.nan, np.inf, -np.inf, -1.0, 0.0, -0.0, 710.0, 1e200])
    got = computed(functions, 13, a)
    expected = numpy_functions(a)
    np.testing.assert_array_equal(np.isnan(got), np.isnan(expected))
    np.testing.assert_array_equal(np.isinf(got), np.isinf(expected))


@given(eight(anything | st.sampled_from([1.0, 2.0])), eight(anything | st.sampled_from([1.0, 2.0])))
@settings(max_examples=300, deadline=None)
def test_comparisons_masks_and_folds(a, b):
    bits = np.zeros(7, np.int64)
    total, largest = comparisons(a, b, bits)
    masks = [a < b, a <= b, a > b, a >= b, a == b, (a < b) & (a > 0)]
    assert bits[:6].tolist() == [sum(1 << k for k in np.flatnonzero(mask)) for mask in masks]
    assert bits[6] == masks[0].any()
    with np.errstate(all="ignore"):
        quarters = a[:4] + a[4:]
        halves = quarters[:2] + quarters[2:]
        np.testing.assert_equal(total, halves[0] + halves[1])  # always in this order
    if np.isnan(a).all():
        assert np.isnan(largest)
    else:
        assert largest == np.nanmax(a)  # one of two zeros with different signs


@pytest.mark.parametrize("start", range(9))
def test_load_and_store_anywhere(start):
    a, out = np.arange(20.0), np.zeros(20)
    copy_from(a, start, out, 11 - start)
    assert out.tolist() == [0.0] * (11 - start) + list(range(start, start + 8)) + [0.0] * (1 + start)


@jit
def roots(a, out):
    x = load(a, 0)
    store(out[0], 0, inverse_sqrt(x))
    store(out[1], 0, rotated(x, 1))
    store(out[2], 0, rotated(x, 5))


@given(eight(st.floats(1e-300, 1e300)))
@settings(max_examples=300, deadline=None)
def test_inverse_square_roots(a):
    got = computed(roots, 3, a)
    exact = 1 / np.sqrt(a.astype(np.longdouble))
    assert np.max(np.abs(got[0] - exact) / np.spacing(exact.astype(float))) <= 2
    np.testing.assert_array_equal(got[1:], [np.roll(a, -1), np.roll(a, -5)])


def test_an_inverse_square_root_never_hides_what_is_no_number():
    a = np.array([0.0, -0.0, -1.0, np.nan, np.inf, -np.inf, 4.0, 0.25])
    got = computed(roots, 3, a)[0]
    assert not np.isfinite(got[[0, 1, 2, 3, 5]]).any()
    assert not got[4] > 0  # 0, the true value, or NaN
    assert got[6:].tolist() == [0.5, 2.0]


@jit
def first_lanes(a, start, count, out, to):
    whole = flat(a)
    masked_store(flat(out), to, masked_load(whole, start, count) + 1.0, count)
    return whole.size


@pytest.mark.parametrize("count", range(9))
def test_the_first_lanes_alone(count):
    a, out = np.arange(24.0).reshape(2, 3, 4), np.zeros((4, 6))
    assert first_lanes(a, 24 - count, count, out, 24 - count) == 24  # memory beyond the end is not touched
    assert out.ravel().tolist() == [0.0] * (24 - count) + list(np.arange(25.0 - count, 25.0))


@pytest.mark.parametrize("shape", [(8,), (3, 16), (1,), (2, 3, 5)])
def test_aligned(shape):
    for _ in range(5):
        array = aligned(shape, 1e30)
        assert array.ctypes.data % 64 == 0
        assert array.shape == shape
        assert array.dtype == np.float64
        assert array.flags.c_contiguous
        assert (array == 1e30).all()
        array[...] = 0.0


@pytest.mark.parametrize("exponent", [0, 33, -1, -7])
def test_whole_powers_take_negative_numbers(exponent):
    @jit
    def power(a):
        store(a, 0, load(a, 0) ** exponent)

    a = np.linspace(-1.6, 1.2, 8)
    expected = a**exponent
    power(a)
    np.testing.assert_allclose(a, expected, rtol=34 * 2.0**-52)


# --- processor features of compiled code ---

WITHOUT_AVX = """
import numpy as np
from kickdrift.jit.compile import features, jit
from kickdrift.jit.lanes.functions import inverse_sqrt
from kickdrift.jit.lanes.memory import load, store

@jit
def quotient(a, out):
    store(out[0], 0, 1.0 / load(a, 0))
    store(out[1], 0, inverse_sqrt(load(a, 0)))

a, out = np.linspace(0.3, 7.0, 8), np.zeros((2, 8))
quotient(a, out)
assert not [name for name in features() if name.startswith("avx")]
np.testing.assert_allclose(out, [1 / a, a**-0.5], rtol=5e-16)
"""


def test_code_follows_the_features_that_numba_compiles_for():
    """NUMBA_ENABLE_AVX=0 on a machine with AVX-512: AVX-512's estimates would crash the process inside LLVM."""
    done = python(WITHOUT_AVX, NUMBA_ENABLE_AVX="0")
    assert done.returncode == 0, done.stderr


@jit
def sums_of_products(a, b, c, out):
    x, y, z = load(a, 0), load(b, 0), load(c, 0)
    store(out[0], 0, x * y + z)
    store(out[1], 0, z - x * y)
    store(out[2], 0, x * y - z)


def test_a_product_inside_a_sum_is_fused_in_one_way_only():
    """In a function without fast-math flags: one rounding if the machine can fuse, else always two."""
    written = as_written(sums_of_products.py_func)
    rng = np.random.default_rng(3)
    a, b, c = rng.normal(size=(3, WIDTH))
    out = np.zeros((3, WIDTH))
    written(a, b, c, out)
    exact = [[Fraction(x) * Fraction(y) for x, y in zip(a, b, strict=True)], [Fraction(z) for z in c]]
    product, third = exact
    fused = [
        [float(p + z) for p, z in zip(product, third, strict=True)],
        [float(z - p) for p, z in zip(product, third, strict=True)],
        [float(p - z) for p, z in zip(product, third, strict=True)],
    ]
    apart = [a * b + c, c - a * b, a * b - c]
    assert any(np.array_equal(out, expected) for expected in (fused, apart))


@pytest.mark.parametrize(("first", "whole"), [("strict", types.int8), ("fast", types.int16)])
def test_a_power_has_the_flags_of_its_own_function(first, whole):
    """numba compiles x**k once for each pair of types, whatever the flags of the functions that use it."""
    flags = {"strict": False, "fast": {"contract"}}
    marked = {}
    for name in sorted(flags, key=lambda name: name != first):

        def power(x, k):
            return x**k

        made = njit(types.float64(types.float64, whole), fastmath=flags[name], error_model="numpy")(power)
        (code,) = made.inspect_llvm().values()
        products = [line for line in code.splitlines() if " fmul " in line]
        assert products
        marked[name] = {"contract" in line for line in products}
    assert marked == {"strict": {False}, "fast": {True}}


# --- float32, and packing ---


@jit
def single_functions(a, out):
    x = load_like(a, 0, zeros_in(a))
    store(out[0], 0, single_exp(x))
    store(out[1], 0, single_log(abs(x)))
    sine, cosine = single_sine_cosine(1.5 * x / (1.0 + abs(x)))
    store(out[2], 0, sine)
    store(out[3], 0, cosine)


def test_functions_of_float32_are_within_3_units_in_the_last_place():
    rng = np.random.default_rng(5)
    run = njit(lambda a, out: single_functions(a, out))
    for scale in (1e-3, 1.0, 60.0):
        a, out = (scale * rng.normal(size=8)).astype(np.float32), np.zeros((4, 8), np.float32)
        run(a, out)
        x = a.astype(float)
        angle = (np.float32(1.5) * a / (np.float32(1.0) + np.abs(a))).astype(float)
        for found, true in zip(out[:3], (np.exp(x), np.log(np.abs(x)), np.sin(angle)), strict=True):
            assert np.all(np.abs(found - true) <= 3 * np.spacing(np.abs(true).astype(np.float32)))
        assert np.all(np.abs(out[3] - np.cos(angle)) <= 2.0**-23)


def test_the_exponential_of_float32_ends_as_that_of_float64():
    a, out = np.array([-1e3, -88.0, 0.0, np.nan, 90.0, 1e3, np.inf, -np.inf], np.float32), np.zeros((4, 8), np.float32)
    njit(lambda a, out: single_functions(a, out))(a, out)
    assert out[0, [0, 1, 7]].tolist() == [0.0, 0.0, 0.0]
    assert out[0, 2] == 1.0
    assert np.isnan(out[0, 3])
    assert np.allclose(out[0, 4:7], np.exp(87.0), rtol=1e-6)


@jit
def packing(a, places, out, rows):
    x = load(a, 0)
    made = pack_places(rows, 0, places, 0, x > 0.0)
    store(out, 0, packed(x > 0.0, x))
    other = pack_counted(rows, 8, 40, x > 0.0)
    fill_places(rows, 16, 7)
    transpose_places(places, 0, 8, rows, 24)
    return made, other


PACKING = """
import numpy as np
from numba import njit
from tests.unit.jit.test_lanes import packing
run, rng = njit(lambda a, places, out, rows: packing(a, places, out, rows)), np.random.default_rng(2)
for _ in range(50):
    a, places = rng.normal(size=8), rng.integers(0, 99, 64).astype(np.int32)
    out, rows = np.zeros(8), np.zeros(88, np.int32)
    found, chosen = run(a, places, out, rows), np.flatnonzero(a > 0)
    n = len(chosen)
    assert found == (n, n)
    assert out[:n].tolist() == a[chosen].tolist()
    assert rows[:n].tolist() == places[chosen].tolist()
    assert rows[8 : 8 + n].tolist() == (40 + chosen).tolist()
    assert rows[16:24].tolist() == [7] * 8
    assert rows[24:].reshape(8, 8).T.tolist() == places.reshape(8, 8).tolist()
"""


@pytest.mark.parametrize("settings", [{}, {"NUMBA_ENABLE_AVX": "0"}], ids=["own", "without AVX"])
def test_packing_is_that_of_numpy_whatever_the_processors_instructions(settings):
    done = python(PACKING, **settings)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("kind", KINDS, ids=str)
def test_whole_powers_of_a_mixtures_numbers_stay_in_its_table(kind):
    """As lanes they would be exponentials of logarithms, for each pair: four times the time of Lennard-Jones."""
    context = cpu_target.typing_context
    context.refresh()
    assert context.resolve_function_type(operator.pow, (kind, types.literal(6)), {}).return_type == kind
