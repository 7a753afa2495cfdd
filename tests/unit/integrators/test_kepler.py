"""Kepler's problem: every conic and any step, to round-off; and eight orbits at once."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kickdrift.integrators.wisdom_holman.kepler import kepler_increments, lanes_increments
from kickdrift.jit.compile import jit
from kickdrift.jit.lanes.masks import mask_bits
from kickdrift.jit.lanes.memory import aligned, load
from kickdrift.jit.lanes.vector3 import load3, numbers3, store3
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift_validation.problems import kepler
from tests.oracle.kepler import moved

EPS = float(np.finfo(float).eps)


@jit
def kepler_step(gm, dt, position, velocity):
    """Return the relative position and velocity (3,) of two bodies of G (m1 + m2) = ``gm`` after a time ``dt``.

    Takes their relative position and velocity (3,), any conic, any dt of either sign, also many periods.
    """
    x, v = numbers3(position, 0, 1), numbers3(velocity, 0, 1)
    moved, kicked = kepler_increments(gm, dt, x, v)
    after = np.empty((2, 3))
    store3(after, 0, 1, x + moved)
    store3(after, 3, 1, v + kicked)
    return after[0], after[1]


@jit
def eight(gm, dt, state, change):
    """Increments of eight orbits (6, 8), the mask of the solved orbits, and the mask of those with beta <= 0."""
    move, kick, beta, solved = lanes_increments(load(gm, 0), dt, load3(state, 0, WIDTH), load3(state, 3 * WIDTH, WIDTH))
    store3(change, 0, WIDTH, move)
    store3(change, 3 * WIDTH, WIDTH, kick)
    return mask_bits(solved), mask_bits(beta <= 0.0)


def start(e, f, gm=1.0, q=1.0, tilt=0.4):
    """Position and velocity at the true anomaly f on a conic with eccentricity e and pericentre distance q."""
    r, h = q * (1.0 + e) / (1.0 + e * math.cos(f)), math.sqrt(gm * q * (1.0 + e))
    x, u = r * math.cos(f), -gm / h * math.sin(f)
    y, v = r * math.sin(f), gm / h * (e + math.cos(f))
    c, s = math.cos(tilt), math.sin(tilt)
    return np.array([x, c * y, s * y]), np.array([u, c * v, s * v])


def errors_and_rounding(gm, dt, x, v):
    """Error of the solver, in units of the error that rounding the given numbers and the result would cause."""
    truth = np.array(moved(gm, dt, x, v))
    found = np.array(kepler_step(gm, dt, x, v))
    allowed = EPS * np.abs(truth).max(axis=1)
    h = 2.0**-30  # a small change, scaled down: differences in extended precision are exact enough
    for k in range(8):
        given_x, given_v, mass, time = x.copy(), v.copy(), gm, dt
        if k < 3:
            given_x[k] += h * np.linalg.norm(x)
        elif k < 6:
            given_v[k - 3] += h * np.linalg.norm(v)
        elif k == 6:
            mass *= 1.0 + h
        else:
            time *= 1.0 + h
        allowed = allowed + EPS / h * np.abs(np.array(moved(mass, time, given_x, given_v)) - truth).max(axis=1)
    return (np.abs(found - truth).max(axis=1) / allowed).astype(float)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    e=st.one_of(st.floats(0.0, 0.99), st.floats(0.99, 1.01), st.floats(1.01, 20.0), st.just(1.0)),
    angle=st.floats(-0.9, 0.9),
    step=st.floats(-1.5, 1.5),
    gm=st.floats(1e-3, 1e3),
    q=st.floats(1e-2, 1e2),
)
def test_error_is_of_round_off(e, angle, step, gm, q):
    """Anywhere on any conic, for steps of up to one and a half periods of a circle at that distance."""
    limit = math.acos(-1.0 / e) if e > 1.0 else math.pi
    x, v = start(e, angle * limit, gm, q)
    dt = step * 2.0 * math.pi * math.sqrt(np.linalg.norm(x) ** 3 / gm)
    assert (errors_and_rounding(gm, dt, x, v) < 2.0).all()


@pytest.mark.parametrize("periods", [0.5, 1.0, 3.25, 1000.3, -1e6])
@pytest.mark.parametrize("e", [0.0, 0.3, 0.97])
def test_many_periods_in_one_step(e, periods):
    """The error of the time within a period is one rounding for each period."""
    x, v = start(e, 1.0)
    a = 1.0 / (2.0 / np.linalg.norm(x) - v @ v)
    dt = periods * 2.0 * math.pi * a**1.5
    assert (errors_and_rounding(1.0, dt, x, v) < 2.0).all()


@pytest.mark.parametrize("speed", [0.0, 1e-12, 1e-6, 1e-3])
def test_near_radial_orbits(speed):
    """From apocentre nearly to the centre, through it and out again."""
    x, v = np.array([1.0, 0.0, 0.0]), np.array([0.0, speed, 0.0])
    for dt in (0.1, 1.0, 1.2, 2.0, 2.2):
        assert (errors_and_rounding(1.0, dt, x, v) < 2.0).all()


@pytest.mark.parametrize("t", [0.7, 2.2, 60.0, -1e4])
@pytest.mark.parametrize("e", [1.001, 1.01])
def test_hyperbolas_that_are_left_far_behind_in_one_step(e, t):
    """From a pericentre near the star, at the first guess exp(X) is huge, or overflows."""
    b = math.sqrt(e * e - 1.0)
    x, v = np.array([e - 1.0, 0.0, 0.0]), np.array([0.0, b / (e - 1.0), 0.0])  # a = -1
    assert (errors_and_rounding(1.0, t, x, v) < 2.0).all()


@pytest.mark.parametrize("t", [0.1, 2.0, 7.0, -4.0])
def test_ellipse_against_keplers_equation(t):
    x, v = kepler(0.0, 0.3)
    found = kepler_step(1.0, t, x, v)
    np.testing.assert_allclose(found, kepler(t, 0.3), rtol=0.0, atol=2e-15 * (1.0 + abs(t)))


def test_no_time_no_motion():
    x, v = start(0.5, 2.0)
    found = kepler_step(1.0, 0.0, x, v)
    np.testing.assert_array_equal(found, (x, v))


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    e=st.lists(st.floats(0.0, 1.5), min_size=8, max_size=8),
    angle=st.lists(st.floats(-0.9, 0.9), min_size=8, max_size=8),
    step=st.floats(-0.4, 0.4),
)
def test_lanes_agree_with_numbers_where_they_say_so(e, angle, step):
    """A lane also has the same bits whatever its neighbours contain."""
    orbits = [start(a, b * (math.acos(-1.0 / a) if a > 1.0 else math.pi)) for a, b in zip(e, angle, strict=True)]
    state, change = aligned((6, 8)), aligned((6, 8))
    state[...] = np.array(orbits).reshape(8, 6).T
    masses = aligned((8,), 1.0)
    solved, unbound = eight(masses, step, state, change)
    turned, again = state[:, ::-1].copy(), aligned((6, 8))
    eight(masses, step, turned, again)
    for k, (x, v) in enumerate(orbits):
        expected = np.array(kepler_step(1.0, step, x, v)).reshape(6)
        if (solved >> k) & 1:
            growth = max(1.0, np.abs(change[3:, k]).max() / np.abs(v).max())
            np.testing.assert_allclose(state[:, k] + change[:, k], expected, rtol=0.0, atol=2e-14 * growth**2)
            np.testing.assert_array_equal(change[:, k], again[:, 7 - k])
        assert (unbound >> k) & 1 == (v @ v >= 2.0 / np.linalg.norm(x)) or abs(e[k] - 1.0) < 1e-12


def test_ordinary_steps_need_no_numbers_one_by_one():
    """Eight planets, with a tenth of the innermost period and less."""
    a = np.array([0.387, 0.723, 1.0, 1.52, 5.2, 9.5, 19.0, 30.0])
    state, change = aligned((6, 8)), aligned((6, 8))
    for k, size in enumerate(a):
        state[:, k] = np.concatenate(start(0.2, 1.3 * k, q=0.8 * size))
    for steps in (10, 20, 100):
        assert eight(aligned((8,), 1.0), 2.0 * math.pi * 0.387**1.5 / steps, state, change)[0] == 255
