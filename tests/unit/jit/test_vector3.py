"""Vectors of three components against the formula of each component, in lanes and numbers, to the last bit."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import types
from numba.core.errors import TypingError

from kickdrift.jit.compile import as_written, in_order, inlined, jit, strict
from kickdrift.jit.lanes.functions import lane_sum, splat
from kickdrift.jit.lanes.memory import load
from kickdrift.jit.lanes.vector3 import (
    Vector3,
    cross,
    dot,
    lane_sums,
    load3,
    numbers3,
    plus_dot,
    rotated3,
    select3,
    store3,
    thrice,
    vector3,
)
from kickdrift.jit.lanes.vectors import WIDTH, lanes_type
from tests.long import shortened

KINDS = {"jit": jit, "inlined": inlined, "in_order": in_order, "strict": strict, "as_written": as_written}
ROWS = 11  # number of vectors from the formulas below


# The same formula with vectors and without; ``a``, ``b`` are vectors, ``w`` is a number or lanes.


def in_vectors(a, b, w, out, stride):
    store3(out[0], 0, stride, a + b)
    store3(out[1], 0, stride, a - b)
    store3(out[2], 0, stride, -a)
    store3(out[3], 0, stride, w * a)
    store3(out[4], 0, stride, a * w)
    store3(out[5], 0, stride, a + w * b)
    store3(out[6], 0, stride, w * a - b)
    store3(out[7], 0, stride, a - w * b + b * w)
    store3(out[8], 0, stride, (a + w * b) + (w * a - w * b))
    store3(out[9], 0, stride, cross(a, b))
    store3(out[10], 0, stride, vector3(dot(a, b), plus_dot(w, a, b), dot(b, b) + w))


def written_out(a, b, w, out, stride):
    ax, ay, az = a.x, a.y, a.z
    bx, by, bz = b.x, b.y, b.z
    store3(out[0], 0, stride, vector3(ax + bx, ay + by, az + bz))
    store3(out[1], 0, stride, vector3(ax - bx, ay - by, az - bz))
    store3(out[2], 0, stride, vector3(-ax, -ay, -az))
    store3(out[3], 0, stride, vector3(w * ax, w * ay, w * az))
    store3(out[4], 0, stride, vector3(ax * w, ay * w, az * w))
    store3(out[5], 0, stride, vector3(ax + w * bx, ay + w * by, az + w * bz))
    store3(out[6], 0, stride, vector3(w * ax - bx, w * ay - by, w * az - bz))
    store3(out[7], 0, stride, vector3(ax - w * bx + bx * w, ay - w * by + by * w, az - w * bz + bz * w))
    x, y = (ax + w * bx) + (w * ax - w * bx), (ay + w * by) + (w * ay - w * by)
    store3(out[8], 0, stride, vector3(x, y, (az + w * bz) + (w * az - w * bz)))
    store3(out[9], 0, stride, vector3(ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx))
    inner, square = ax * bx + ay * by + az * bz, bx * bx + by * by + bz * bz
    store3(out[10], 0, stride, vector3(inner, w + ax * bx + ay * by + az * bz, square + w))


def compiled(formula, kind: str, lanes: tuple[bool, bool, bool]):
    """Compiled formula for arrays a, b (3, 8), w (8,) and out (ROWS, 3, 8). Flags say which of a, b, w are lanes; the
    others are the numbers in lane 0."""
    inside = KINDS[kind](formula)
    a_lanes, b_lanes, w_lanes = lanes

    @jit
    def run(a, b, w, out):
        one = load3(a, 0, WIDTH) if a_lanes else numbers3(a, 0, WIDTH)
        other = load3(b, 0, WIDTH) if b_lanes else numbers3(b, 0, WIDTH)
        inside(one, other, load(w, 0) if w_lanes else w[0], out, WIDTH)

    return run


MIXTURES = [(True, True, True), (True, True, False), (True, False, True), (False, True, False), (False, False, False)]
LANES, NUMBERS = MIXTURES[0], MIXTURES[-1]
RUNS = {
    (kind, lanes): [compiled(f, kind, lanes) for f in (in_vectors, written_out)] for kind in KINDS for lanes in MIXTURES
}
SHORT = [*((kind, LANES) for kind in KINDS), ("jit", MIXTURES[1]), ("jit", NUMBERS), ("as_written", NUMBERS)]
ALIKE = shortened([run for run in RUNS if run[1] in (LANES, NUMBERS)], [run for run in SHORT if run[1] != MIXTURES[1]])
moderate = st.floats(1e-60, 1e60) | st.floats(-1e60, -1e-60)
near_one = st.floats(0.5, 2.0) | st.floats(-2.0, -0.5)  # sums cancel here


@st.composite
def operands(draw):
    """a, b (3, 8), w (8,)."""
    each = draw(st.sampled_from([moderate, near_one]))
    numbers = draw(st.lists(each, min_size=7 * WIDTH, max_size=7 * WIDTH))
    table = np.array(numbers).reshape(7, WIDTH)
    return table[:3].copy(), table[3:6].copy(), table[6].copy()


def found(run, a, b, w):
    out = np.zeros((ROWS, 3, WIDTH))
    run(a, b, w, out)
    return out


@pytest.mark.parametrize("run", shortened(RUNS, SHORT), ids=str)
@given(operands())
@settings(max_examples=20, deadline=None)
def test_bits_are_those_of_components_written_out(run, numbers):
    vectors, components = RUNS[run]
    np.testing.assert_array_equal(found(vectors, *numbers), found(components, *numbers))


@pytest.mark.parametrize("run", ALIKE, ids=str)
@given(operands())
@settings(max_examples=60, deadline=None)
def test_values_are_numpys(run, numbers):
    """Equal to the last bit if there is one rounding, else within that of the largest term."""
    a, b, w = numbers
    got = found(RUNS[run][0], a, b, w)
    if run[1] == NUMBERS:
        a, b, w, got = a[:, :1], b[:, :1], w[:1], got[:, :, :1]
    np.testing.assert_array_equal(got[:5], [a + b, a - b, -a, w * a, a * w])
    products = np.array([(a * b).sum(axis=0), w + (a * b).sum(axis=0), (b * b).sum(axis=0) + w])
    expected = [a + w * b, w * a - b, a, (a + w * b) + (w * a - w * b), np.cross(a, b, axis=0), products]
    size = np.abs(a).max(axis=0) + np.abs(b).max(axis=0)
    size = (np.abs(w) + size) * (1.0 + size)
    assert (np.abs(got[5:] - expected) <= 8 * np.finfo(float).eps * size).all()


@as_written
def difference(one, factor, v, out):
    store3(out, 0, WIDTH, one - factor * v)


@jit
def one_less(a, b, e, out):
    difference(load3(a, 0, WIDTH), 1.0 + e, load3(b, 0, WIDTH), out)


def test_a_product_in_a_sum_is_fused_where_nothing_else_may_be():
    """The rule is that of lanes: 1 - (1 + e) (1 - e) is e^2, which two roundings lose."""
    e = 2.0**-40
    a, b, out = np.full((3, WIDTH), 1.0), np.full((3, WIDTH), 1.0 - e), np.zeros((3, WIDTH))
    one_less(a, b, e, out)
    np.testing.assert_array_equal(out, e * e)


@jit
def across_lanes(a, b, out, sums):
    x, y = load3(a, 0, WIDTH), load3(b, 0, WIDTH)
    store3(out[0], 0, WIDTH, rotated3(x, 3))
    store3(out[1], 0, WIDTH, select3(x.x < y.x, x, y))
    store3(out[2], 0, WIDTH, thrice(x.y))
    store3(sums, 0, 1, lane_sums(x))
    store3(sums, 3, 1, thrice(2))  # a whole number becomes a float
    sums[6] = lane_sum(x.z)


@given(operands())
@settings(max_examples=60, deadline=None)
def test_turns_choices_and_sums_are_by_component(numbers):
    a, b, _ = numbers
    out, sums = np.zeros((3, 3, WIDTH)), np.zeros(7)
    across_lanes(a, b, out, sums)
    np.testing.assert_array_equal(out[0], np.roll(a, -3, axis=1))
    np.testing.assert_array_equal(out[1], np.where(a[0] < b[0], a, b))
    np.testing.assert_array_equal(out[2], np.broadcast_to(a[1], (3, WIDTH)))
    fourths = a[:, :4] + a[:, 4:]
    halves = fourths[:, :2] + fourths[:, 2:]
    np.testing.assert_array_equal(sums[:3], halves[:, 0] + halves[:, 1])
    np.testing.assert_array_equal(sums[3:], [2.0, 2.0, 2.0, sums[2]])


@jit
def carried(a, count):
    """A vector carried through a loop, a branch and a tuple."""
    total, last = thrice(splat(0.0)), thrice(0.0)
    for p in range(count):
        here = load3(a, p * WIDTH, count * WIDTH)
        if p % 2:
            here = -here
        pair = total + here, numbers3(a, p * WIDTH, count * WIDTH)
        total, last = pair
    sums = lane_sums(total) + last
    return sums.x, sums.y, sums.z


def test_vectors_go_through_loops_branches_and_tuples():
    a = np.random.default_rng(1).normal(size=(3, 5, WIDTH))
    signs = np.array([1.0, -1.0, 1.0, -1.0, 1.0])
    expected = (a * signs[:, None]).sum(axis=(1, 2)) + a[:, 4, 0]
    np.testing.assert_allclose(carried(a, 5), expected, rtol=1e-13)


@pytest.mark.parametrize(
    "wrong",
    [
        lambda a: load3(a, 0, 8) + a[0, 0],
        lambda a: load3(a, 0, 8) - load(a, 0),
        lambda a: dot(load3(a, 0, 8), load(a, 0)),
        lambda a: load3(a, 0, 8).w,
        lambda a: load3(a[:, ::2], 0, 8),
        lambda a: select3(load(a, 0) > 0.0, load3(a, 0, 8), numbers3(a, 0, 8)),
    ],
    ids=["add a number", "subtract lanes", "dot lanes", "w", "strided array", "select numbers"],
)
def test_what_has_no_meaning_is_refused(wrong):
    inner = jit(wrong)

    @jit
    def run(a):
        inner(a)

    with pytest.raises(TypingError):
        run(np.zeros((3, 16)))


def test_types_are_known_by_what_they_are_of():
    assert Vector3(types.float64) == Vector3(types.float64) != Vector3(lanes_type)
