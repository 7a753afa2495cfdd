"""Direct gravity against the plain oracle, and its slopes along deviations against forty digits."""

from __future__ import annotations

import hashlib
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import kickdrift
import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.forces import Gravity, GravityTree, LennardJones, UniformField
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.forces.slopes import variations_kernel
from kickdrift.forces.slopes.variations import varied
from kickdrift.forces.slopes.variations_kernel import prefers_bodies
from kickdrift.model.starts.builders import check_overlaps
from kickdrift.model.system import System
from kickdrift.model.units.unit_systems import UNIT_SYSTEMS
from kickdrift.run.simulation import Simulation
from tests.oracle.forces import gravity_accelerations, interacting_pairs, pair_oracle
from tests.processes import python


def cloud(n, seed=0, massless=0, G=1.0, softening=0.0, **options):
    rng = np.random.default_rng(seed)
    masses = rng.uniform(0.1, 3.0, n)
    masses[rng.permutation(n)[:massless]] = 0.0
    x = rng.normal(size=(n, 3)) * rng.choice([0.1, 1.0, 10.0], size=(n, 1))
    return System(x, rng.normal(size=(n, 3)), masses, forces=[Gravity(G, softening)], **options)


def assert_right(system):
    measured = BoundForces(system).measure(0.0, system.state.phase)
    expected = gravity_accelerations(system)
    np.testing.assert_allclose(
        measured.accelerations.T, expected, rtol=0, atol=1e-12 * np.abs(expected).max(initial=0.0)
    )
    forces, energy, virial, count = pair_oracle(system)
    assert measured.pairs == count
    assert measured.potential == pytest.approx(energy, rel=1e-12, abs=0)
    assert measured.virial == pytest.approx(virial, rel=1e-12, abs=0)
    on_masses = measured.accelerations.T * system.coherent_masses[:, None]
    np.testing.assert_allclose(on_masses, forces, rtol=0, atol=1e-12 * np.abs(forces).max(initial=0.0))
    return measured


@pytest.mark.parametrize("softening", [0.0, 0.05, 3.0])
@pytest.mark.parametrize("n", [1, 2, 3, 7, 8, 9, 16, 31, 100, 257])
def test_sizes(n, softening):
    assert_right(cloud(n, seed=n, softening=softening))
    assert_right(cloud(n, seed=n, softening=softening, massless=n // 3))


@given(st.integers(0, 2**32 - 1), st.integers(1, 60), st.floats(1e-3, 1e3), st.sampled_from([0.0, 0.1]))
@settings(max_examples=100, deadline=None)
def test_any_cloud(seed, n, G, softening):
    assert_right(cloud(n, seed, n // 5, G, softening))


@pytest.mark.parametrize("force", [Gravity(), GravityTree()], ids=["direct", "tree"])
def test_sums_from_the_evaluation_before_are_those_of_the_same_positions(force):
    """The second evaluation in a row expects to be asked for sums; they are taken if the positions are the same."""
    own = cloud(40).state
    system = System(own.positions, own.velocities, own.masses, forces=[force], units="nbody")
    here, there = own.phase, 1.1 * own.phase
    apart = [BoundForces(system).measure(0.0, each) for each in (here, there)]
    forces = BoundForces(system)
    forces.derivative(0.0, here)
    for at, asked in ((here, here), (there, there), (there, here), (here, here)):
        forces.derivative(0.0, at)
        found, wanted = forces.measure(0.0, asked), apart[asked is there]
        np.testing.assert_array_equal(found.accelerations, wanted.accelerations)
        assert found[1:] == wanted[1:]


@pytest.mark.parametrize("units", UNIT_SYSTEMS)
def test_the_units_own_constant(units):
    system = cloud(20, units=units, G=None if UNIT_SYSTEMS[units].gravity else 2.0)
    assert_right(system)


def test_momentum_and_virial():
    system = cloud(300)
    measured = assert_right(system)
    forces = measured.accelerations * system.coherent_masses
    assert np.abs(forces.sum(axis=1)).max() <= 1e-12 * np.abs(forces).sum()
    assert measured.virial == pytest.approx(measured.potential, rel=1e-12)  # U ~ 1/r


def test_massless_particles_feel_and_do_not_pull():
    x = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]])
    system = System(x, masses=[4.0, 0.0, 0.0], forces=[Gravity(1.0)])
    measured = assert_right(system)
    assert measured.accelerations[:, 0].tolist() == [0.0, 0.0, 0.0]
    np.testing.assert_allclose(measured.accelerations[:, 1:], [[-1.0, 0.0], [0.0, -1.0], [0.0, 0.0]], rtol=1e-14)
    assert measured.potential == 0.0


def test_bodies_in_one_place():
    x = np.array([[1.0, 2.0, 3.0], [1.0, 2.0, 3.0], [0.0, 0.0, 0.0]])
    softened = System(x, forces=[Gravity(1.0, softening=0.5)])
    assert_right(softened)  # no force between these bodies, but an energy
    system = System(x, forces=[Gravity(1.0)])
    assert BoundForces(system).measure(0.0, system.state.phase) is None
    test_particles = System(x, masses=[0.0, 0.0, 1.0], forces=[Gravity(1.0)])
    assert_right(test_particles)
    check_overlaps(softened)
    check_overlaps(test_particles)
    with pytest.raises(InputError, match="particles 0 and 1 are at the same place, distance 0"):
        check_overlaps(system)
    on_a_body = System(x, masses=[0.0, 1.0, 1.0], forces=[Gravity(1.0)], names=["Probe", "Sun", "Vega"])
    with pytest.raises(InputError, match="positions: Probe and Sun are at the same place, distance 0"):
        check_overlaps(on_a_body)


@pytest.mark.parametrize("culprit", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("massless", [False, True])
def test_positions_that_are_no_numbers(culprit, massless):
    system = System(np.eye(9, 3), masses=[1.0] * 8 + [0.0 if massless else 1.0], forces=[Gravity(1.0, 0.1)])
    for axis in range(3):
        phase = system.state.phase.copy()
        phase[0, axis, 8] = culprit
        assert BoundForces(system).measure(0.0, phase) is None


@pytest.mark.parametrize("massive", [1, 8, 9, 20])
def test_test_particles_anywhere(massive):
    """Bodies and test particles in mixed order, many test particles at one place; clusters are partly empty on both
    sides."""
    n, rng = 61, np.random.default_rng(massive)
    masses = np.zeros(n)
    masses[rng.permutation(n)[:massive]] = rng.uniform(0.5, 2.0, massive)
    x = rng.normal(size=(n, 3))
    x[np.flatnonzero(masses == 0.0)[:5]] = 0.25
    system = System(x, masses=masses, forces=[Gravity(1.0)])
    check_overlaps(system)
    assert assert_right(system).pairs == massive * (massive - 1) // 2 + massive * (n - massive)


def test_sources_are_the_massive_bodies_alone():
    """Sun, planets and 2000 test particles: only pairs with a massive body count."""
    system = cloud(2009, massless=2000)
    force = BoundForces(system).forces[0].parts
    assert (force.massive, force.sources, force.clusters) == (9, 2, 252)
    assert_right(system)


def test_a_sample_has_the_centre_of_mass():
    system = cloud(30, massless=10)
    sample = Simulation(system, dt=1e-3).sample()
    m, state = system.state.masses, system.state
    np.testing.assert_allclose(sample.centre_of_mass, m @ state.positions / m.sum(), rtol=1e-13)
    np.testing.assert_allclose(sample.centre_of_mass_velocity, m @ state.velocities / m.sum(), rtol=1e-13)
    np.testing.assert_array_equal(sample.observables()["centre_of_mass"], sample.centre_of_mass)
    massless = System(np.eye(3), masses=0.0)
    assert Simulation(massless, dt=1e-3).sample().centre_of_mass is None


def test_refusals():
    with pytest.raises(InputError, match="needs open space, and the box is periodic"):
        System(np.eye(3), box=(1, 1, 1), forces=[Gravity(1.0)])
    with pytest.raises(InputError, match="units 'lj' define no G; give G"):
        System(np.eye(3), forces=[Gravity()])
    with pytest.raises(InputError, match="gravity: no particle has a mass, so there is no attraction"):
        System(np.eye(3), masses=0.0, forces=[Gravity(1.0)])
    with pytest.raises(InputError, match="gravity-tree: no particle has a mass"):
        System(np.eye(3), masses=0.0, forces=[GravityTree(G=1.0)])
    System(np.eye(3), masses=0.0, forces=[Gravity(1.0), UniformField((0.0, 0.0, -1.0))])  # they fall
    for options in ({"G": 0.0}, {"G": np.nan}, {"G": -1.0}, {"softening": -1.0}, {"softening": np.inf}):
        with pytest.raises(InputError, match="gravity: "):
            Gravity(**{"G": 1.0, **options})


def test_two_forces_add_up():
    rng = np.random.default_rng(2)
    x = np.indices((4, 4, 4)).reshape(3, -1).T * 1.1 + rng.uniform(-0.1, 0.1, (64, 3))
    forces = [LennardJones(cutoff=2.5), Gravity(3.0, softening=0.1)]
    system = System(x, masses=rng.uniform(1, 5, 64), forces=forces)
    measured = BoundForces(system).measure(0.0, system.state.phase)
    expected, energy, virial, count = pair_oracle(system)
    got = (measured.accelerations * system.coherent_masses).T
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-12 * np.abs(expected).max())
    assert measured.potential == pytest.approx(energy, rel=1e-12)
    scale = sum(np.abs(p.force * p.r).sum() for p in (interacting_pairs(force, system) for force in forces))
    assert measured.virial == pytest.approx(virial, abs=1e-12 * scale)
    assert measured.pairs == count


def fingerprint(n, threads):
    system = cloud(n, massless=3)
    measured = BoundForces(system, threads).measure(0.0, system.state.phase)
    return hashlib.sha256(measured.accelerations.tobytes() + np.array(measured[1:]).tobytes()).hexdigest()


@pytest.mark.long
def test_a_new_compilation_rounds_like_the_cached_one(tmp_path):
    """The compiling process and processes that load the machine code get the same bits, for few bodies and for many."""
    package = Path(kickdrift.__file__).parent
    shutil.copytree(package, tmp_path / "kickdrift", ignore=shutil.ignore_patterns("__pycache__"))
    code = f"from {__name__} import fingerprint as f; print(f(9, 1), f(100, 1))"
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    runs = [python(code, PYTHONPATH=path) for _ in range(2)]
    assert runs[0].stdout == runs[1].stdout != "", runs[0].stderr


def by_mpmath(mp, force, x, m, dx, dm):
    """Accelerations of the deviations: mixed differences of a(x + p u + q w + p q s, m + p m_u + q m_w)."""
    n, count = len(m), 2

    def accelerations(x, m):
        a = np.full((3, n), mp.mpf(0))
        for i in range(n):
            for j in range(n):
                if i != j:
                    d = x[:, j] - x[:, i]
                    a[:, i] += m[j] * d / mp.sqrt(sum(d * d) + mp.mpf(force.softening) ** 2) ** 3
        return a

    h, found = mp.mpf(10) ** -12, []
    exact = np.vectorize(lambda value: mp.mpf(float(value)), otypes=[object])
    x, m, dx, dm = (exact(each) for each in (x, m, dx, dm))
    for k in range(count):
        both = [accelerations(x + sign * h * dx[..., k], m + sign * h * dm[:, k]) for sign in (1, -1)]
        found.append((both[0] - both[1]) / (2 * h))
    pairs = [(one, two) for one in range(count) for two in range(one, count)]
    for column, (one, two) in enumerate(pairs, count):
        total = 0
        for p in (1, -1):
            for q in (1, -1):
                there = x + p * h * dx[..., one] + q * h * dx[..., two] + p * q * h * h * dx[..., column]
                total = total + p * q * accelerations(there, m + p * h * dm[:, one] + q * h * dm[:, two])
        found.append(total / (4 * h * h))
    return np.stack(found, axis=-1).astype(float)


@pytest.mark.parametrize(
    ("n", "light", "softening", "moves"), [(3, 0, 0.0, True), (9, 2, 0.3, True), (10, 6, 0.0, False)]
)
def test_slopes_have_their_digits(n, light, softening, moves, monkeypatch):
    mp = pytest.importorskip("mpmath")
    rng = np.random.default_rng(n)
    x, v, dx, dm = rng.normal(size=(3, n)), np.zeros((3, n)), rng.normal(size=(3, n, 5)), np.zeros((n, 2))
    m = rng.uniform(0.1, 1.0, n)
    m[1 : 1 + light] = 0.0
    if moves:  # one of a massless body too
        dm[[0, 1], [0, 1]] = 0.5, 0.25
    force = kd.Gravity(G=1.0, softening=softening)
    system = kd.System(x.T, v.T, m, forces=[force], units="nbody")
    deviations = np.array([dx, np.zeros_like(dx)]).reshape(2, 3, -1)
    with mp.workdps(40):
        wanted = by_mpmath(mp, force, x, m, dx, dm)
    for cheaper in (0.0, np.inf):  # lanes of deviations, lanes of bodies
        monkeypatch.setattr(variations_kernel, "CHEAPER", cheaper)
        masses = np.concatenate([dm, np.zeros((n, 3))], axis=1) if moves else None
        made = varied(system, deviations, masses, (), 2)
        found = BoundForces(made).measure(0.0, made.state.phase).accelerations[:, n:].reshape(3, n, 5)
        for column in range(5):
            size = np.abs(wanted[..., column]).max()
            np.testing.assert_allclose(found[..., column], wanted[..., column], rtol=0, atol=2e-14 * size)


def test_few_deviations_of_some_bodies_prefer_lanes_of_bodies():
    assert prefers_bodies(8, 8, 6, 6)
    assert not prefers_bodies(3, 3, 6, 6)
    assert prefers_bodies(8, 8, 48 + 48 * 49 // 2, 48)
    assert not prefers_bodies(100, 100, 48, 48)
