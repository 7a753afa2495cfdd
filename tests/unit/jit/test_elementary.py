"""Exponential, logarithm and powers of lanes against extended precision and against the special values of C."""

from __future__ import annotations

import math

import numpy as np
import pytest

from kickdrift.forces.lists.row_lanes import LANES, Narrow, NarrowSingle, Wide, WideSingle, nothing
from kickdrift.jit.compile import jit
from kickdrift.jit.lanes import elementary as elementary  # the functions under test
from kickdrift.jit.lanes.memory import load_like, store

COUNT = 40_000
every_kind = pytest.mark.parametrize("kind", [Wide(), WideSingle(), Narrow(), NarrowSingle()])


@jit
def compute(kind, width, x, y, out):
    zero = nothing(kind)
    for k in range(0, x.size, width):
        a, b = load_like(x, k, zero), load_like(y, k, zero)
        store(out[0], k, math.exp(a))
        store(out[1], k, math.log(a))
        store(out[2], k, a**b)


def computed(kind, x, y):
    vector = LANES[type(kind)].vector
    dtype = np.float64 if str(vector.element) == "double" else np.float32
    x, y = (np.ascontiguousarray(each, dtype) for each in (x, y))
    out = np.zeros((3, len(x)), dtype)
    compute(kind, vector.count, x, y, out)
    return x, y, out


def ulps(got, right):
    """Largest error in units in the last place of the right values, which are in extended precision."""
    unit = np.spacing(np.abs(right).astype(got.dtype)).astype(np.longdouble)
    return float(np.max(np.abs(got.astype(np.longdouble) - right) / unit))


@every_kind
def test_exponentials_and_logarithms_are_within_one_unit(kind):
    rng = np.random.default_rng(1)
    single = kind in (WideSingle(), NarrowSingle())
    wide = (-86.8, 88.7) if single else (-707.6, 709.78)
    bound = 2.0 if single else 1.0
    for low, high in (wide, (-1.0, 1.0), (-1e-3, 1e-3)):
        x, _, out = computed(kind, rng.uniform(low, high, COUNT), np.ones(COUNT))
        assert ulps(out[0], np.exp(x.astype(np.longdouble))) < bound
    largest = 37.0 if single else 307.0
    powers = rng.uniform(-largest, largest, COUNT)
    for x in (
        10.0**powers,
        rng.uniform(0.5, 2.0, COUNT),
        1.0 + rng.uniform(-1e-3, 1e-3, COUNT),
        np.full(COUNT, 5e-324),
    ):
        x, _, out = computed(kind, x, np.ones(COUNT))
        if x[0] > 0.0:
            assert ulps(out[1], np.log(x.astype(np.longdouble))) < bound


@every_kind
def test_powers_are_within_their_bound(kind):
    rng = np.random.default_rng(2)
    x, y, out = computed(kind, 10.0 ** rng.uniform(-3, 3, COUNT), rng.uniform(-9.0, 9.0, COUNT))
    a, b = x.astype(np.longdouble), y.astype(np.longdouble)
    right = a**b
    bound = np.finfo(x.dtype).eps * (2.0 + np.abs(b * np.log(a)))
    assert np.all(np.abs(out[2] - right) <= bound * np.abs(right))


@every_kind
def test_special_values(kind):
    x = np.resize([0.0, -0.0, math.inf, -math.inf, math.nan, -1.0, 1.0, 1e4], 16)
    _, _, out = computed(kind, x, np.resize([2.5, 2.5, 2.5, 2.5, 2.5, 2.5, 2.5, 0.5], 16))
    np.testing.assert_array_equal(out[0][:8], [1.0, 1.0, math.inf, 0.0, math.nan, out[0][5], out[0][6], math.inf])
    np.testing.assert_array_equal(out[1][:7], [-math.inf, -math.inf, math.inf, math.nan, math.nan, math.nan, 0.0])
    np.testing.assert_array_equal(out[2][:7], [0.0, 0.0, math.inf, math.nan, math.nan, math.nan, 1.0])
