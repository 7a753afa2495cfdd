"""The tree against the direct sum: accuracy for many distributions of particles, order, and bits."""

from __future__ import annotations

import hashlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.forces import Gravity, GravityTree
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.systemfile.reading import loads
from tests.oracle.forces import gravity_accelerations
from tests.processes import python


def measured(x, masses, force, threads=1):
    system = kd.System(x, masses=masses, forces=[force], units="nbody")
    return BoundForces(system, threads).measure(0.0, system.state.phase)


def plummer(n, rng):
    """Plummer's density with scale length 1."""
    direction = rng.normal(size=(n, 3))
    r = 1.0 / np.sqrt(rng.uniform(size=n) ** (-2 / 3) - 1.0)
    return (r / np.linalg.norm(direction, axis=1))[:, None] * direction


def far_clusters(n, rng):
    return plummer(n, rng) + np.where(np.arange(n) < n // 2, 0.0, 1e6)[:, None] * np.array([1.0, 0.5, 0.0])


def plane(n, rng):
    return rng.normal(size=(n, 3)) * np.array([1.0, 1.0, 0.0])


def line(n, rng):
    return rng.uniform(size=(n, 1)) * np.array([1.0, -2.0, 3.0])


def nested(n, rng):
    """Distances over ten decades."""
    return plummer(n, rng) * 10.0 ** -rng.uniform(0, 10, (n, 1))


SHAPES = {
    "plummer": plummer,
    "cube": lambda n, rng: rng.uniform(size=(n, 3)),
    "far clusters": far_clusters,
    "plane": plane,
    "line": line,
    "nested": nested,
    "lattice": lambda n, rng: np.indices((13, 13, 13)).reshape(3, -1).T[:n] + 0.0,
}


def relative_errors(got, direct):
    difference = np.linalg.norm(got.accelerations - direct.accelerations, axis=0)
    return difference / np.linalg.norm(direct.accelerations, axis=0)


@pytest.mark.parametrize("softening", [0.0, 0.02])
@pytest.mark.parametrize("shape", SHAPES)
def test_accuracy(shape, softening):
    """The accuracy holds for 99 % of the particles. On a line softened over many neighbours, the attractions of both
    sides cancel. There one particle in a hundred has less than a hundredth of the usual acceleration, which is the
    scale of its errors."""
    rng = np.random.default_rng(1)
    x = SHAPES[shape](2100, rng)
    masses = rng.pareto(2.0, len(x)) + 0.01
    masses[::7] = 0.0
    direct = measured(x, masses, Gravity(softening=softening))
    sizes = np.linalg.norm(direct.accelerations, axis=0)
    if shape == "line" and softening:
        sizes = np.maximum(sizes, np.sqrt(np.mean(sizes**2)))
    for accuracy in (1e-1, 1e-2, 1e-3, 1e-4):
        got = measured(x, masses, GravityTree(accuracy, softening))
        errors = np.linalg.norm(got.accelerations - direct.accelerations, axis=0) / sizes
        assert np.quantile(errors, 0.99) < accuracy
        assert got.potential == pytest.approx(direct.potential, rel=accuracy)
        assert got.pairs == direct.pairs


@pytest.mark.parametrize("shape", ["plummer", "cube"])
def test_the_work_is_not_for_nothing(shape):
    """A looser accuracy leaves larger errors. A tree that opened every node would pass the test above too."""
    x = SHAPES[shape](6000, np.random.default_rng(2))
    direct = measured(x, 1.0, Gravity())
    loose, tight = (relative_errors(measured(x, 1.0, GravityTree(a)), direct).mean() for a in (1e-2, 1e-4))
    assert 2e-4 < loose < 1e-2
    assert 2e-6 < tight < 1e-4


@pytest.mark.parametrize("softening", [0.0, 0.1])
@pytest.mark.parametrize("n", [1, 2, 8, 9, 64])
def test_few_particles_are_summed_directly(n, softening):
    rng = np.random.default_rng(n)
    x, masses = plummer(n, rng), rng.uniform(0.5, 2, n)
    masses[1 : n // 2] = 0.0
    system = kd.System(x, masses=masses, forces=[GravityTree(0.1, softening)], units="nbody")
    got = BoundForces(system).measure(0.0, system.state.phase)
    expected = gravity_accelerations(system)
    np.testing.assert_allclose(got.accelerations.T, expected, rtol=0, atol=1e-12 * np.abs(expected).max(initial=0.0))
    direct = measured(x, masses, Gravity(softening=softening))
    assert got.potential == pytest.approx(direct.potential, rel=1e-12)
    assert got.virial == pytest.approx(direct.virial, rel=1e-11)


@given(st.integers(0, 2**32 - 1), st.integers(1, 300), st.sampled_from(list(SHAPES)), st.sampled_from([0.0, 0.3]))
@settings(max_examples=60, deadline=None)
def test_all_opened_is_the_direct_sum(seed, n, shape, softening):
    rng = np.random.default_rng(seed)
    x, masses = SHAPES[shape](n, rng), rng.choice([0.0, 0.1, 1.0, 100.0], n)
    masses[0] = 1.0
    direct = measured(x, masses, Gravity(softening=softening))
    got = measured(x, masses, GravityTree(1e-13, softening))
    atol = 1e-11 * np.abs(direct.accelerations).max()
    np.testing.assert_allclose(got.accelerations, direct.accelerations, rtol=1e-11, atol=atol)
    assert got.potential == pytest.approx(direct.potential, rel=1e-11)


@pytest.mark.parametrize("softening", [0.0, 3.0])
def test_quadrupoles(softening):
    """The relative error of a far body's field falls as the third power of the distance; with monopoles alone, as the
    second."""
    rng = np.random.default_rng(3)
    body, probes = rng.uniform(size=(64, 3)) * [1, 2, 3], rng.uniform(size=(64, 3))
    masses = np.concatenate([rng.uniform(1, 2, 64), np.zeros(64)])
    errors = []
    for distance in (16.0, 32.0, 64.0):
        x = np.concatenate([body, probes + distance * np.array([1.0, 0.3, 0.0])])
        got, direct = (measured(x, masses, f) for f in (GravityTree(0.3, softening), Gravity(softening=softening)))
        errors.append(relative_errors(got, direct)[64:].mean())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert orders == pytest.approx(3, abs=0.3)


def test_test_particles_in_one_place():
    rng = np.random.default_rng(4)
    x = np.concatenate([plummer(500, rng), np.full((3000, 3), 0.7), np.full((1000, 3), [5.0, 0, 0])])
    masses = np.concatenate([rng.uniform(1, 2, 500), np.zeros(4000)])
    direct = measured(x, masses, Gravity())
    errors = relative_errors(measured(x, masses, GravityTree(1e-3)), direct)
    assert errors.max() < 1e-3
    around_one = measured(np.zeros((700, 3)) + np.eye(700, 3), np.eye(700)[0], GravityTree())
    assert around_one.potential == around_one.virial == 0.0
    assert np.all(around_one.accelerations[0, 3:] == 1.0)


def test_a_sun_and_test_particles():
    rng = np.random.default_rng(5)
    x = np.concatenate([rng.normal(size=(2000, 3)), [[0.1, 0.2, 0.3]]])
    masses = np.concatenate([np.zeros(2000), [1.0]])
    got, direct = (measured(x, masses, force) for force in (GravityTree(0.1), Gravity()))
    apart = np.linalg.norm(got.accelerations - direct.accelerations, axis=0)
    assert np.all(apart <= 1e-14 * np.linalg.norm(direct.accelerations, axis=0))
    assert not got.accelerations[:, -1].any()


def test_massive_bodies_in_one_place():
    x = plummer(300, np.random.default_rng(6))
    x[200] = x[3]
    assert measured(x, 1.0, GravityTree()) is None
    direct, got = (measured(x, 1.0, force) for force in (Gravity(softening=0.1), GravityTree(1e-3, 0.1)))
    assert np.quantile(relative_errors(got, direct), 0.99) < 1e-3


@pytest.mark.parametrize("culprit", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("massless", [False, True])
def test_positions_that_are_no_numbers(culprit, massless):
    masses = np.ones(100)
    masses[8] = 0.0 if massless else 1.0
    system = kd.System(plummer(100, np.random.default_rng(7)), masses=masses, forces=[GravityTree(G=1.0)])
    for axis in range(3):
        phase = system.state.phase.copy()
        phase[0, axis, 8] = culprit
        assert BoundForces(system).measure(0.0, phase) is None


def test_lengths_of_any_size():
    """The tree has no intrinsic length."""
    x = plummer(1000, np.random.default_rng(8))
    plain = measured(x, 1.0, GravityTree())
    for factor in (2.0**-100, 2.0**40):
        scaled = measured(factor * x, 1.0, GravityTree())
        np.testing.assert_allclose(scaled.accelerations * factor**2, plain.accelerations, rtol=1e-13)


def test_force_is_about_the_slope_of_the_energy():
    x = plummer(400, np.random.default_rng(9))
    shift = np.random.default_rng(10).normal(size=x.shape)
    got, above, below = (measured(x + s * shift, 1.0, GravityTree(1e-6, 0.1)) for s in (0.0, 1e-4, -1e-4))
    slope = (below.potential - above.potential) / 2e-4
    assert slope == pytest.approx((got.accelerations.T * shift).sum(), rel=1e-4)


def fingerprint(n, threads):
    rng = np.random.default_rng(n)
    masses = rng.uniform(0.1, 3.0, n)
    masses[:: n // 3] = 0.0
    got = measured(plummer(n, rng), masses, GravityTree(1e-2, 0.01), threads)
    return hashlib.sha256(got.accelerations.tobytes() + np.array(got[1:]).tobytes()).hexdigest()


MANY = 33_000  # particles whose largest nodes all chunks cut together


@pytest.mark.parametrize("shape", ["plummer", "lattice", "in one place"])
def test_large_nodes(shape):
    """The accuracy holds where all chunks cut a node together, also with equal coordinates on both sides of a cut."""
    rng = np.random.default_rng(12)
    x = np.indices((33, 33, 33)).reshape(3, -1).T[:MANY] + 0.0 if shape == "lattice" else plummer(MANY, rng)
    if shape == "in one place":
        x[1000:] = 0.3
    masses = rng.uniform(0.1, 3.0, MANY) * (np.arange(MANY) % 1000 < 30)
    got = measured(x, masses, GravityTree(1e-3, 0.01))
    chosen, massive = rng.integers(0, MANY, 200), masses > 0
    d = x[massive][None] - x[chosen][:, None]
    exact = np.einsum("j,ijk->ki", masses[massive], d / ((d**2).sum(-1) + 1e-4)[..., None] ** 1.5)
    errors = np.linalg.norm(got.accelerations[:, chosen] - exact, axis=0) / np.linalg.norm(exact, axis=0)
    assert np.quantile(errors, 0.98) < 1e-3


def test_threads_and_reruns_do_not_change_the_bits():
    pairs = [(n, k) for n in (9, 3000) for k in (1, 2, 3, 4)] + [(MANY, 2)]
    code = f"from {__name__} import fingerprint as f; print(*(f(*pair) for pair in {pairs}))"
    run = python(code, NUMBA_NUM_THREADS="4")
    expected = [fingerprint(9, 1)] * 4 + [fingerprint(3000, 1)] * 4 + [fingerprint(MANY, 1)]
    assert run.stdout.split() == expected, run.stderr
    assert fingerprint(3000, 1) == fingerprint(3000, 1)


def test_refusals():
    for options, message in [
        ({"accuracy": 0.0}, "accuracy must be between 0 and 1, got 0.0"),
        ({"accuracy": 1.0}, "accuracy must be between 0 and 1, got 1.0"),
        ({"accuracy": np.nan}, "accuracy: expected a finite number, got nan"),
        ({"accuracy": "high"}, "accuracy: expected a finite number, got 'high'"),
        ({"softening": -1.0}, "softening must be a length, zero or more, got -1.0"),
        ({"G": 0.0}, "G must be a positive number, got 0.0"),
    ]:
        with pytest.raises(InputError, match=f"^gravity-tree: {message}$"):
            GravityTree(**options)
    with pytest.raises(InputError, match=r"^gravity-tree: needs open space, and the box is periodic"):
        kd.System(np.eye(3), box=(1, 1, 1), forces=[GravityTree(G=1.0)])
    with pytest.raises(InputError, match=r"^gravity-tree: no particle has a mass"):
        kd.System(np.eye(3), masses=0.0, forces=[GravityTree(G=1.0)])
    with pytest.raises(InputError, match=r"^gravity-tree: units 'lj' define no G; give G"):
        kd.System(np.eye(3), forces=[GravityTree()])


def test_in_a_file():
    text = 'units = "astro"\n[particles]\npositions = [[0, 0, 0], [1, 0, 0]]\nmass = 1.0\n[[force]]\n'
    (force,) = loads(text + 'type = "gravity-tree"\naccuracy = 1e-4\nsoftening = "0.1 AU"').forces
    assert force == GravityTree(1e-4, 0.1)
    with pytest.raises(InputError, match="accuracy: expected a plain number, got 'fine'"):
        loads(text + 'type = "gravity-tree"\naccuracy = "fine"')
