"""Kepler's elements and states on every conic, against 50 digits and against their inverses."""

import math
from functools import partial

import mpmath as mp
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from kickdrift.errors import InputError
from kickdrift.model.starts.elements import Elements, elements, states, stumpff

EPS = np.finfo(float).eps
ECCENTRICITIES = [0.0, 1e-12, 0.1, 0.9, 0.999999, 1 - 1e-15, 1.0, 1 + 1e-15, 1.000001, 1.5, 30.0]


def exact_plane(q, e, since):
    """Position and velocity in the orbit's plane with 50 digits, G M = 1, by the textbook equation of each conic."""
    q, e, t = mp.mpf(q), mp.mpf(e), mp.mpf(since)
    if e == 1:  # Barker's equation, in closed form
        w = 3 * t / mp.sqrt(2 * q**3) / 2
        u = mp.cbrt(w + mp.sqrt(w**2 + 1)) if w >= 0 else -mp.cbrt(-w + mp.sqrt(w**2 + 1))
        f = 2 * mp.atan(u - 1 / u)
    else:
        a = q / (1 - e)
        m = t / mp.sqrt(abs(a) ** 3)
        if e < 1:
            low, high = mp.mpf(-4), mp.mpf(4)
            m -= 2 * mp.pi * mp.nint(m / (2 * mp.pi))
            kepler_equation = lambda anomaly: anomaly - e * mp.sin(anomaly) - m  # noqa: E731
        else:
            high = mp.asinh(abs(m) / (e - 1)) + 1
            low = -high
            kepler_equation = lambda anomaly: e * mp.sinh(anomaly) - anomaly - m  # noqa: E731
        anomaly = mp.findroot(kepler_equation, (low, high), solver="anderson", tol=1e-90, maxsteps=2000)
        half = mp.tan(anomaly / 2) if e < 1 else mp.tanh(anomaly / 2)
        f = 2 * mp.atan(mp.sqrt((1 + e) / abs(1 - e)) * half)
    p = q * (1 + e)
    r = p / (1 + e * mp.cos(f))
    speed = 1 / mp.sqrt(p)
    return [r * mp.cos(f), r * mp.sin(f), -speed * mp.sin(f), speed * (e + mp.cos(f))], f


@pytest.mark.parametrize("e", ECCENTRICITIES)
def test_positions_at_a_time_agree_with_fifty_digits(e):
    worst = 0.0
    with mp.workdps(50):
        for since in (-700.0, -3.0, -1e-3, 0.0, 1e-9, 0.4, 2.0, 41.0):
            if e < 1 and abs(since) > math.pi * (1 - e) ** -1.5:
                continue  # more than half a turn: tested below, where the rounding of 2 pi counts
            exact, f = exact_plane(1.0, e, since)
            x, v = states(1.0, q=1.0, e=e, T=-since)
            size, speed = mp.hypot(*exact[:2]), mp.hypot(*exact[2:])
            off = max(mp.hypot(x[0] - exact[0], x[1] - exact[1]) / size,
                      mp.hypot(v[0] - exact[2], v[1] - exact[3]) / speed)  # fmt: skip
            worst = max(worst, float(off))
            again = elements(x, v, 1.0)
            assert float(again.since_pericentre(1.0)) == pytest.approx(since, rel=1e-12, abs=1e-14) or e < 1e-3
            # an error of eps in the state rotates the pericentre by eps (1 + r / q) / e, and f with it
            assert abs(float(again.f) - float(f)) < 4 * EPS * (1 + float(size)) / min(max(e, 1e-30), 1.0)
    assert worst < 6 * EPS  # 3.4 measured


@pytest.mark.parametrize("e", [0.3, 0.99, 1.2])
def test_anomalies_agree_with_each_other(e):
    given_m = np.linspace(-3.0, 3.0, 41)
    x, v = states(1.0, a=1.0 / (1 - e) if e > 1 else 1.0, e=e, M=given_m)
    found = elements(x, v, 1.0)
    assert pytest.approx(given_m, abs=2e-14) == found.M
    for kind, values in (("E", found.E), ("f", found.f)):
        again, _ = states(1.0, q=float(found.q[0]), e=e, **{kind: values})
        assert np.abs(again - x).max() < 2e-13
    kept = found.E - e * np.sin(found.E) if e < 1 else e * np.sinh(found.E) - found.E
    assert kept == pytest.approx(given_m, abs=3e-14)


def term(z, k, j):
    return (-z) ** j / mp.factorial(2 * j + k)


def test_stumpffs_functions():
    z = np.concatenate([-np.geomspace(1e-12, 400, 60), [0.0], np.geomspace(1e-12, 400, 60), [1.0, -1.0, 0.999999]])
    with mp.workdps(40):
        for k, found in enumerate(stumpff(z)):
            exact = [mp.nsum(partial(term, mp.mpf(zz), k), [0, mp.inf], method="direct") for zz in z]
            # near a zero of an oscillation, its amplitude is the scale
            scale = [max(abs(x), zz ** (-k / 2) if zz > 1 else 0.0) for x, zz in zip(exact, z, strict=True)]
            off = max(float(abs(f - x) / s) for f, x, s in zip(found, exact, scale, strict=True) if s)
            assert off < 6e-15


angles = st.floats(0.0, 2 * math.pi)
conics = st.one_of(st.floats(0.0, 0.95), st.floats(0.95, 1.05), st.floats(1.05, 20.0), st.sampled_from(ECCENTRICITIES))


@given(conics, st.floats(-5, 5), angles, angles, st.floats(0, math.pi), st.floats(-100, 100), st.floats(-3, 3))
def test_states_come_back_whole(e, size, Omega, omega, inc, since, mass):
    q, mu = 10.0**size, 10.0**mass
    unit = math.sqrt(q**3 / mu)
    x, v = states(mu, q=q, e=e, inc=inc, Omega=Omega, omega=omega, T=-since * unit)
    found = elements(x, v, mu)
    again = states(mu, q=found.q, e=found.e, inc=found.inc, Omega=found.Omega, omega=found.omega, f=found.f)
    # near the asymptote, f fixes the distance poorly: its condition is r / q times the slope of the conic
    reach = np.linalg.norm(x) / q * (1 + e)
    assert np.linalg.norm(again[0] - x) <= 60 * EPS * reach * np.linalg.norm(x)
    assert np.linalg.norm(again[1] - v) <= 60 * EPS * reach * np.linalg.norm(v)
    assert found.q == pytest.approx(q, rel=60 * EPS * reach)
    assert found.e == pytest.approx(e, rel=60 * EPS * reach, abs=60 * EPS * reach)
    assert found.inc == pytest.approx(inc, abs=1e-13)


@pytest.mark.parametrize("e", [0.0, 0.4, 1.0, 2.0])
@pytest.mark.parametrize("inc", [0.0, math.pi / 2, math.pi])
def test_angles_that_an_orbit_does_not_have_are_zero(e, inc):
    x, v = states(1.0, q=1.0, e=e, inc=inc, Omega=0.0, omega=0.0, f=0.7)
    if inc == math.pi:
        x[2] = v[2] = 0.0  # sin(pi) is 1e-16
    found = elements(x, v, 1.0)
    assert found.inc == pytest.approx(inc, abs=1e-15)
    assert found.Omega == pytest.approx(0.0, abs=1e-15)
    assert (found.omega + found.f) % (2 * math.pi) == pytest.approx(0.7, abs=1e-15)
    back = states(1.0, q=found.q, e=found.e, inc=found.inc, Omega=found.Omega, omega=found.omega, f=found.f)
    assert np.allclose(back, (x, v), rtol=0, atol=1e-15)


def test_an_exact_circle_has_no_pericentre():
    found = elements([0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], 1.0)
    assert (found.e, found.omega, found.Omega) == (0.0, 0.0, 0.0)
    assert found.f == pytest.approx(math.pi / 2)
    assert found.period(1.0) == pytest.approx(2 * math.pi)


def test_a_straight_fall_has_no_plane():
    found = elements([[1.0, 0.0, 0.0], [1.0, 0.0, 0.0]], [[-0.3, 0.0, 0.0], [0.0, 1.0, 0.0]], 1.0)
    assert found.e[0] == 1.0
    assert found.q[0] == 0.0
    assert np.isnan([found.inc[0], found.Omega[0], found.omega[0], found.f[0]]).all()
    assert np.isfinite(np.array(found)[:, 1]).all()


def test_many_orbits_at_once_are_the_same_as_one_by_one():
    rng = np.random.default_rng(1)
    e = np.array([0.0, 0.5, 1.0, 1.7, 0.99])
    q, inc, big, small, since = rng.uniform(0.5, 2, (5, 5))
    x, v = states(1.0, q=q, e=e, inc=inc, Omega=big, omega=small, T=-since)
    for k in range(5):
        one = states(1.0, q=q[k], e=e[k], inc=inc[k], Omega=big[k], omega=small[k], T=-since[k])
        assert np.allclose(one, (x[k], v[k]), rtol=1e-15, atol=1e-15)
    grid = elements(np.stack([x, x]), np.stack([v, v]), 1.0)
    assert isinstance(grid, Elements)
    assert grid.e.shape == (2, 5)


def test_time_of_pericentre_and_period():
    x, v = states(4.0, a=2.0, e=0.6, T=0.3, t=1.0)
    assert elements(x, v, 4.0).since_pericentre(4.0) == pytest.approx(0.7, rel=1e-14)
    later = states(4.0, a=2.0, e=0.6, T=0.3, t=1.0 + 7 * float(elements(x, v, 4.0).period(4.0)))
    assert np.allclose(later, (x, v), rtol=0, atol=1e-12)
    parabola = Elements(*np.array([1.0, 1.0, 0.0, 0.0, 0.0, 0.5]))
    assert np.isinf(parabola.period(1.0))
    assert np.isnan(parabola.M)


@pytest.mark.parametrize("mean", [1e-300, 1e-12, 3.14, 1e3, 1e12, 1e200])
def test_hyperbolas_of_any_size_are_solved(mean):
    for e in (1.0 + 1e-9, 1.5, 1e3):
        x, v = states(1.0, q=1.0, e=e, M=mean)
        assert np.isfinite(x).all()
        assert np.isfinite(v).all()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"a": 1.0, "e": -0.1}, "e: expected an eccentricity, zero or more, got -0.1"),
        ({"a": 1.0, "e": 1.0}, "a parabola (e = 1) has no semi-major axis; give its pericentre distance q"),
        ({"a": -1.0, "e": 0.5}, "a: an ellipse (e < 1) has a positive semi-major axis, got -1"),
        ({"a": 1.0, "e": 1.5}, "a: a hyperbola (e > 1) has a negative semi-major axis, got 1"),
        ({"q": 0.0, "e": 0.5}, "q: expected a positive pericentre distance"),
        ({"q": 1.0, "e": 1.5, "f": 2.4}, "f: a hyperbola or parabola ends at its asymptote"),
        ({"q": 1.0, "e": 1.0, "f": math.pi}, "f: a hyperbola or parabola ends at its asymptote"),
        ({"q": 1.0, "e": 1.0, "M": 0.1}, "M: a parabola has no mean or eccentric anomaly; expected f or T"),
        ({"q": 1.0, "a": 1.0, "e": 0.1}, "expected exactly one of a, q"),
        ({"e": 0.1}, "expected exactly one of a, q"),
        ({"q": 1.0, "e": 0.1, "f": 0.1, "M": 0.1}, "expected one of f, M, E, T, got f and M"),
        ({"q": 1.0, "e": math.nan}, "e: expected a finite number, got nan"),
        ({"q": [1.0, 2.0], "e": [0.1, -2.0]}, "e of body 1: expected an eccentricity"),
        ({"q": [1.0, 2.0], "e": [0.1, 0.2, 0.3]}, "elements: expected numbers, or arrays of one shape"),
        ({"q": "x", "e": 0.2}, "elements: expected numbers"),
    ],
)
def test_what_is_no_orbit_is_refused(given, message):
    with pytest.raises(InputError) as error:
        states(1.0, **given)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_what_was_given_is_shown_as_it_was_given():
    with pytest.raises(InputError, match=r"e: .*, got -0\.1$"):
        states(1.0, a=1.0, e=-0.1)
    with pytest.raises(InputError, match=r"f of body 1: .*, got 2\.5 rad \(143\.239449 deg\)$"):
        states(1.0, q=1.0, e=2.0, f=[0.0, 2.5])


@pytest.mark.parametrize(("x", "v", "mu"), [((2, 3), (1, 3), 1), ((2, 3), (2, 3), 3), ((2,), (2,), 1)])
def test_shapes_that_do_not_fit_are_refused(x, v, mu):
    with pytest.raises(InputError, match=r"elements: expected positions and velocities \(…, 3\) and mu"):
        elements(np.ones(x), np.ones(v), np.ones(mu))


def test_no_mass_and_no_distance_are_refused():
    with pytest.raises(InputError, match="mu: expected a positive number"):
        states(0.0, q=1.0, e=0.0)
    with pytest.raises(InputError, match="mu: expected a positive number"):
        elements([1.0, 0, 0], [0, 1.0, 0], 0.0)
    with pytest.raises(InputError, match="the body is at the centre"):
        elements([0.0, 0, 0], [0, 1.0, 0], 1.0)


@given(st.floats(-1e3, 1e3), st.floats(0, 0.999999))
def test_keplers_equation_holds(mean, e):
    x, _ = states(1.0, a=1.0, e=e, M=mean)
    anomaly = math.atan2(x[1] / math.sqrt((1 - e) * (1 + e)), x[0] + e)
    back = anomaly - e * math.sin(anomaly)
    assume(abs(abs(back) - math.pi) > 1e-6)
    off = (back - mean + math.pi) % (2 * math.pi) - math.pi
    assert abs(off) < 1e-12 + EPS * abs(mean) * 4
