"""Second derivatives of motions, and derivatives by orbital elements, against differences of runs and of orbits."""

from __future__ import annotations

import json

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.analysis.tangents.element_slopes import named, slopes_of
from kickdrift.errors import InputError
from kickdrift.model.starts.elements import states
from tests.systems import slope

MASSES = np.array([1.0, 1e-3, 3e-4])
PLAIN = {"a": 1.1, "e": 0.2, "inc": 20.0, "Omega": 50.0, "omega": 100.0, "M": 130.0, "mass": 1e-3}


def planets(**moved: float) -> kd.System:
    """A star and two planets; planet b has the elements of PLAIN, or moved ones, about the star."""
    of = PLAIN | moved
    angles = {key: np.radians(of[key]) for key in ("inc", "Omega", "omega", "M")}
    own = states(1.0 + of["mass"], a=of["a"], e=of["e"], **angles)
    x = np.array([[0.0, 0.0, 0.0], own[0], [-1.9, 0.1, 0.0]])
    v = np.array([[0.0, 0.0, 0.0], own[1], [0.0, -0.7, 0.05]])
    masses = np.array([1.0, of["mass"], 3e-4])
    return kd.System(x, v, masses, forces=[kd.Gravity(G=1.0)], units="nbody", names=["star", "b", "c"])


def test_derivatives_by_elements_are_slopes_of_runs():
    """The matrix by elements at one start is its own difference in the second derivatives at another."""
    keys = ("a", "omega", "mass")
    names = [f"b.{key}" for key in keys]
    found = kd.transition_matrix(planets(), 1.0, "gauss-radau15", elements=names, second=True)
    assert found.matrix.shape == (18, 0)
    assert found.second.shape == (18, 3, 3)
    for k, (key, h) in enumerate(zip(keys, (1e-3, 1e-2, 1e-4), strict=True)):

        def moved(by, key=key):
            other = planets(**{key: PLAIN[key] + by})
            near = kd.transition_matrix(other, 1.0, "gauss-radau15", elements=names)
            end = np.concatenate([near.end.positions.ravel(), near.end.velocities.ravel()])
            return np.column_stack([end, near.by_elements])

        wanted = slope(moved, h)
        size = np.abs(wanted).max(axis=0)
        np.testing.assert_allclose(found.by_elements[:, k], wanted[:, 0], rtol=0, atol=1e-10 * size[0])
        np.testing.assert_allclose(found.second[:, :, k] / size[1:], wanted[:, 1:] / size[1:], rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    "keys",
    [
        ("a", "e", "inc", "Omega", "omega", "M", "mass"),
        ("P", "e", "inc", "Omega", "omega", "f", "mass"),
        ("a", "e", "inc", "Omega", "omega", "E"),
        ("P", "h", "k", "ix", "iy", "lambda", "mass"),
    ],
)
def test_a_start_by_elements_against_forty_digits(keys):
    """The orbit's formulas in mpmath, by Kepler's equation in the orbit's plane, and differences there."""
    mp = pytest.importorskip("mpmath")
    system = planets()
    orbit = system["b"].elements()
    around, tilt = np.radians(orbit.omega + orbit.Omega), 2 * np.sin(np.radians(orbit.inc) / 2)
    known = orbit._asdict() | {
        "h": orbit.e * np.sin(around), "k": orbit.e * np.cos(around), "lambda": orbit.M + orbit.omega + orbit.Omega,
        "ix": tilt * np.cos(np.radians(orbit.Omega)), "iy": tilt * np.sin(np.radians(orbit.Omega)), "mass": 1e-3,
    }  # fmt: skip

    def start(values):
        of = dict(zip(keys, values, strict=True))
        mu = 1 + of.get("mass", mp.mpf(1e-3))
        turn = mp.pi / 180
        if "h" in of:
            e, tilted = mp.hypot(of["h"], of["k"]), mp.hypot(of["ix"], of["iy"])
            inc, node, whole = 2 * mp.asin(tilted / 2), mp.atan2(of["iy"], of["ix"]), mp.atan2(of["h"], of["k"])
            peri, mean = whole - node, of["lambda"] * turn - whole
        else:
            e, inc, node, peri = of["e"], of["inc"] * turn, of["Omega"] * turn, of["omega"] * turn
            place = of.get("E", mp.mpf(0)) * turn
            if "f" in of:
                place = 2 * mp.atan(mp.sqrt((1 - e) / (1 + e)) * mp.tan(of["f"] * turn / 2))
            mean = of["M"] * turn if "M" in of else place - e * mp.sin(place)
        a = of["a"] if "a" in of else mp.cbrt(mu * (of["P"] / (2 * mp.pi)) ** 2)
        E = mean
        for _ in range(60):
            E -= (E - e * mp.sin(E) - mean) / (1 - e * mp.cos(E))
        n, b, r = mp.sqrt(mu / a**3), mp.sqrt(1 - e * e), 1 - e * mp.cos(E)
        rows = []
        for x, y in ((a * (mp.cos(E) - e), a * b * mp.sin(E)), (-n * a * mp.sin(E) / r, n * a * b * mp.cos(E) / r)):
            along, ahead = x * mp.cos(peri) - y * mp.sin(peri), x * mp.sin(peri) + y * mp.cos(peri)
            flat = ahead * mp.cos(inc)
            rows += [along * mp.cos(node) - flat * mp.sin(node), along * mp.sin(node) + flat * mp.cos(node)]
            rows.append(ahead * mp.sin(inc))
        return np.array(rows)

    with mp.workdps(40):
        at, h, count = [mp.mpf(float(known[key])) for key in keys], mp.mpf(10) ** -12, len(keys)

        def moved(*steps):
            values = list(at)
            for k, sign in steps:
                values[k] += sign * h
            return start(values)

        first = [(moved((i, 1)) - moved((i, -1))) / (2 * h) for i in range(count)]
        second = {
            (i, j): (moved((i, 1), (j, 1)) - moved((i, 1), (j, -1)) - moved((i, -1), (j, 1)) + moved((i, -1), (j, -1)))
            / (4 * h * h)
            for i in range(count)
            for j in range(i + 1)
        }
    found = slopes_of(system, named(system, tuple(f"b.{key}" for key in keys)))
    for i in range(count):
        wanted = np.array(first[i].tolist(), dtype=float)
        np.testing.assert_allclose(found.first[:, :, 1, i].ravel(), wanted, rtol=0, atol=2e-14 * np.abs(wanted).max())
    for (i, j), each in second.items():
        wanted = np.array(each.tolist(), dtype=float)
        size = np.abs(wanted).max()
        np.testing.assert_allclose(found.second[:, :, 1, i, j].ravel(), wanted, rtol=0, atol=1e-13 * size)


def test_transits_by_elements_are_products_of_two_jacobians(tmp_path, kickdrift):
    system = kd.load("trappist-1")
    given = {"until": "4 day", "direction": (0, -1, 0), "bodies": ["c"], "masses": True}
    names = ("c.P", "c.h", "c.lambda", "c.mass")
    found = kd.transits(system, "b", elements=names, **given)
    own = slopes_of(system, named(system, names))
    wanted = found.jacobian @ own.first[:, :, 2].reshape(6, 4) + found.by_masses @ own.masses
    np.testing.assert_allclose(found.by_elements, wanted, rtol=1e-9, atol=1e-11 * np.abs(wanted).max())
    file = tmp_path / "transits.json"
    words = ["transits", "trappist-1", "b", "--until", "2 day", "--direction", "0,-1,0", "--json", file]
    code, out, _ = kickdrift(*words, "--elements", "c.P", "--elements", "c.mass")
    assert not code
    assert "1, with derivatives by 2 numbers of the start" in out
    np.testing.assert_allclose(json.loads(file.read_text())["by_elements"], found.by_elements[:1, [0, 3]], rtol=1e-8)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"elements": "b"}, "elements: expected BODY.KEY with a key of a, P, e, inc"),
        ({"elements": "b.ecc"}, "elements: expected BODY.KEY with a key of"),
        ({"elements": "d.e"}, "elements: there is no body 'd'"),
        ({"elements": ["b.e", "b.e"]}, "elements: expected each element once, got b.e, b.e"),
        ({"elements": ["b.e", "b.h"]}, "elements: b: e and h belong to different sets; give one of them"),
        ({"elements": ["b.M", "b.f"]}, "elements: b: M and f belong to different sets"),
        ({"elements": "star.e"}, "elements: star does not orbit itself; give a primary"),
        ({"elements": "c.e", "primary": "b"}, "elements: c is not on an ellipse about b: e = "),
        ({"second": True, "parameters": "gravity.G"}, "second: goes without parameters"),
    ],
)
def test_what_makes_no_sense_is_said(given, message):
    with pytest.raises(InputError, match=message):
        kd.transition_matrix(planets(), 1.0, **given)


@pytest.mark.parametrize(
    ("key", "inc", "message"),
    [
        ("e", 10.0, "elements: b is on a circle, so its pericentre has no direction; h and k"),
        ("inc", 1e-11, "elements: b's orbit is flat, so its node has no direction; ix and iy"),
    ],
)
def test_circles_and_flat_orbits_have_no_direction_to_differentiate_by(key, inc, message):
    bodies = [{"name": "star", "mass": 1.0}, {"name": "b", "mass": 1e-3, "a": 1.0, "M": 40.0, "inc": inc}]
    system = kd.System.from_elements(bodies, units="nbody")
    with pytest.raises(InputError, match=message):
        kd.transition_matrix(system, 1.0, elements=f"b.{key}")


@pytest.mark.parametrize(
    ("name", "given"),
    [
        pytest.param("wisdom-holman", {"corrector": 17}, marks=pytest.mark.long),
        ("wisdom-holman", {"kernel": "lazy", "corrector": 3}),
        pytest.param("wisdom-holman", {"kernel": "modified-kick", "corrector": 5}, marks=pytest.mark.long),
        pytest.param("wisdom-holman", {"kernel": "composition"}, marks=pytest.mark.long),
        pytest.param("saba", {"order": "10,6,4"}, marks=pytest.mark.long),
        pytest.param("trace", {}, marks=pytest.mark.long),
    ],
)
def test_second_derivatives_of_maps_by_elements_and_masses(name, given):
    """The matrix of the same map, whose differences by two elements are the second derivatives."""
    keys = ("a", "lambda", "mass")
    names = [f"b.{key}" for key in keys]
    given = {"elements": names, "masses": True, **given}

    def matrix(system):
        found = kd.transition_matrix(system, 1.5, name, 0.05, **given)
        return np.hstack([found.by_masses, found.by_elements])

    system = planets()
    found = kd.transition_matrix(system, 1.5, name, 0.05, second=True, **given)
    assert found.second.shape == (18, 6, 6)
    np.testing.assert_allclose(np.hstack([found.by_masses, found.by_elements]), matrix(system), rtol=1e-12, atol=1e-12)
    own = slopes_of(system, named(system, tuple(names)))
    for k, h in ((3, 1e-4), (4, 1e-2), (5, 1e-5)):

        def moved(by, k=k):
            """The system after a small change of one element, of the start to third order in it."""
            first, second = own.first[..., k - 3], own.second[..., k - 3, k - 3]
            phase = system.state.phase + by * first + 0.5 * by * by * second
            masses = system.state.masses + by * own.masses[:, k - 3]
            return kd.System(*phase.transpose(0, 2, 1), masses, forces=system.forces, units="nbody", names=system.names)

        wanted = slope(lambda by, moved=moved: matrix(moved(by)), h)
        size = np.abs(wanted).max(axis=0)
        np.testing.assert_allclose(found.second[:, :, k] / size, wanted / size, rtol=0, atol=1e-7)


@pytest.mark.parametrize("name", ["wisdom-holman", pytest.param("trace", marks=pytest.mark.long)])
def test_second_derivatives_of_a_map_approach_those_of_the_motion(name):
    """The map has order 2 in its step, and so do the derivatives."""
    exact = kd.transition_matrix(planets(), 2.0, "gauss-radau15", bodies="b", second=True).second
    errors = [
        np.abs(kd.transition_matrix(planets(), 2.0, name, dt, bodies="b", second=True).second - exact).max()
        for dt in (0.1, 0.05, 0.025)
    ]
    powers = np.log2(np.divide(errors[:-1], errors[1:]))
    np.testing.assert_allclose(powers, 2.0, atol=0.3)
