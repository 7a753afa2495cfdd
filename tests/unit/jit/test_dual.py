"""Duals against derivatives that mpmath finds."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kickdrift.jit.compile import as_written, driver
from kickdrift.jit.duals import arrays as arrays
from kickdrift.jit.duals.dual import SLOT, dual, dual_rows
from kickdrift.jit.lanes.functions import lane_numbers, splat
from kickdrift.jit.lanes.memory import store


@as_written
def arithmetic(x, y):
    total = 0.0
    for k in range(3):
        total += (x + k) * y - 2.0 * x / (1.0 + y) + 3 / x
        total *= 0.5
        total -= -y / 2
    return total + x**3 + y**-2 + x**1.5 + 2.0**y + x**y


@as_written
def of_math(x, y):
    waves = math.sin(x) * math.cos(y) + math.tan(0.1 * x) + math.atan2(y, x) + math.hypot(x, y)
    powers = math.exp(-x) + math.log(y) + math.sqrt(x + y) + math.expm1(0.1 * y) + math.log1p(x) + math.log10(x)
    inverse = math.asin(0.1 * x) - math.acos(0.1 * y) + math.atan(x) + math.asinh(y) + math.acosh(1.0 + x)
    return waves * powers + inverse + math.sinh(0.3 * x) * math.cosh(0.2 * y) + math.tanh(x) + math.erf(y)


@as_written
def of_numpy(x, y):
    waves = np.sin(x) * np.cos(y) + np.tan(0.1 * x) + np.arctan2(y, x) + np.hypot(x, y)
    return waves * np.exp(-x) + np.log(y) * np.sqrt(x) + np.arcsin(0.1 * x) + np.arctan(y) + np.tanh(x)


@as_written
def with_choices(x, y):
    larger = x if x > y else 2.0 * y
    if x <= y and y != 3.0:
        larger = -larger
    kept = np.where(x < 1.0, x * x, 4.0)
    return larger + max(x, y) * min(x, 2.0) + abs(x - y) + kept + math.copysign(x, -y) + math.floor(x) + math.fabs(y)


def arithmetic_mp(x, y):
    total = mpmath.mpf(0)
    for k in range(3):
        total += (x + k) * y - 2 * x / (1 + y) + 3 / x
        total *= mpmath.mpf("0.5")
        total -= -y / 2
    return total + x**3 + y**-2 + x ** mpmath.mpf(1.5) + 2**y + x**y


def of_math_mp(x, y):
    m, tenth = mpmath, mpmath.mpf(0.1)
    waves = m.sin(x) * m.cos(y) + m.tan(tenth * x) + m.atan2(y, x) + m.hypot(x, y)
    powers = m.exp(-x) + m.log(y) + m.sqrt(x + y) + m.expm1(tenth * y) + m.log1p(x) + m.log10(x)
    inverse = m.asin(tenth * x) - m.acos(tenth * y) + m.atan(x) + m.asinh(y) + m.acosh(1 + x)
    last = m.sinh(m.mpf(0.3) * x) * m.cosh(m.mpf(0.2) * y) + m.tanh(x) + m.erf(y)
    return waves * powers + inverse + last


def of_numpy_mp(x, y):
    m, tenth = mpmath, mpmath.mpf(0.1)
    waves = m.sin(x) * m.cos(y) + m.tan(tenth * x) + m.atan2(y, x) + m.hypot(x, y)
    return waves * m.exp(-x) + m.log(y) * m.sqrt(x) + m.asin(tenth * x) + m.atan(y) + m.tanh(x)


def with_choices_mp(x, y):
    larger = x if x > y else 2 * y
    if x <= y:
        larger = -larger
    kept = x * x if x < 1 else mpmath.mpf(4)
    return larger + max(x, y) * min(x, mpmath.mpf(2)) + abs(x - y) + kept - x + mpmath.floor(x) + y


@driver
def evaluate(which, x, y, out):
    """out (9,) <- value, and slopes along (1, k) for k = 0 to 7."""
    x, y = dual(x, splat(1.0)), dual(y, lane_numbers())
    found = dual_rows(out, 1)
    if which == 0:
        found[0, 0] = arithmetic(x, y)
    elif which == 1:
        found[0, 0] = of_math(x, y)
    elif which == 2:
        found[0, 0] = of_numpy(x, y)
    else:
        found[0, 0] = with_choices(x, y)


REFERENCES = (arithmetic_mp, of_math_mp, of_numpy_mp, with_choices_mp)


@pytest.mark.parametrize("which", range(4))
@settings(max_examples=25, deadline=None)
@given(x=st.floats(0.1, 4.0), y=st.floats(0.1, 4.0))
def test_slopes_are_the_derivatives(which, x, y):
    if which == 3 and min(abs(x - y), abs(y - 3.0), *(abs(x - k) for k in range(1, 5))) < 1e-3:
        return  # a kink or a jump
    out = np.zeros(3 * SLOT)
    evaluate(which, x, y, out)
    with mpmath.workdps(40):
        function, at = REFERENCES[which], (mpmath.mpf(x), mpmath.mpf(y))
        value = float(function(*at))
        along_x, along_y = (float(mpmath.diff(function, at, way)) for way in ((1, 0), (0, 1)))
    size = 1.0 + abs(value) + abs(along_x) + abs(along_y)
    assert abs(out[0] - value) <= 1e-13 * size
    np.testing.assert_allclose(out[1:9], along_x + np.arange(8) * along_y, rtol=0, atol=3e-12 * size)


@driver
def summed(memory, slopes, columns):
    """Write a number and a dual into an array, and read them from a slice and a copy of it."""
    rows = dual_rows(memory, columns)
    rows[0, 0] = 2.0
    rows[1, 0] = dual(3.0, splat(1.0))
    rows[1, 0] += rows[0, 0]
    column = rows[:, 0].copy()
    store(slopes, 0, column[1].slope)
    return column[1].value * rows.shape[1]


def test_arrays_of_duals_are_arrays():
    memory, slopes = np.zeros(3 * 2 * SLOT), np.zeros(8)
    assert summed(memory, slopes, 2) == 10.0
    np.testing.assert_array_equal(slopes, 1.0)
    assert memory[2 * SLOT] == 5.0


@as_written
def of_arrays(x, m, a):
    r2 = np.sum(x * x, axis=0) + 1.0
    a += x / np.sqrt(r2) * np.exp(-r2)
    a[0] += np.linalg.norm(x[:, 0]) * x[1]
    a *= m
    a[2] -= np.dot(x[0], x[1]) / (2.0 + x[2] ** 2)
    for i in range(x.shape[1]):
        push = np.zeros_like(x[:, i])
        for j in range(x.shape[1]):
            d = x[:, j] - x[:, i]
            push += m[j] * d / (d @ d + 0.1) ** 1.5
        a[:, i] += -push


@driver
def over_arrays(numbers, m):
    of_arrays(dual_rows(numbers[0], m.size), m, dual_rows(numbers[1], m.size))


@pytest.mark.long
def test_whole_arrays_of_duals():
    rng, n, h = np.random.default_rng(0), 4, 1e-3
    numbers = rng.normal(size=(2, 3 * n * SLOT))
    numbers[1] = 0.0
    x, m = numbers[0].reshape(3, n, SLOT).copy(), rng.uniform(size=n)
    over_arrays(numbers, m)
    found = numbers[1].reshape(3, n, SLOT)

    def there(k: int, direction: int) -> np.ndarray:
        a = np.zeros((3, n))
        of_arrays.py_func(x[..., 0] + k * h * x[..., 1 + direction], m, a)
        return a

    np.testing.assert_allclose(found[..., 0], there(0, 0), rtol=0, atol=1e-14)
    for k in range(8):
        wanted = (
            45 * (there(1, k) - there(-1, k)) - 9 * (there(2, k) - there(-2, k)) + (there(3, k) - there(-3, k))
        ) / (60 * h)
        np.testing.assert_allclose(found[..., 1 + k], wanted, rtol=0, atol=1e-9 * np.abs(wanted).max())
