"""Derivatives of pair laws on neighbour lists: beside a complex step of the plain NumPy oracle, and along runs."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.forces import FORCES
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.forces.pairs.ends import TRUNCATIONS
from kickdrift.forces.pairs.law import pair_law
from kickdrift.forces.slopes.variations import varied
from kickdrift.model.starts.builders import lattice
from tests.long import shortened
from tests.oracle.forces import pair_slopes
from tests.systems import PAIRS, SPECIES, liquid

ALONG = 18  # more than the compiled code takes at once


def system_of(truncation: str, mixed: bool, leaning: bool, chained: bool) -> kd.System:
    """60 particles in a small box."""
    rng, n, edge = np.random.default_rng(4), 60, 5.2
    sites = np.indices((4, 4, 4)).reshape(3, -1).T[:n] * edge / 4
    x = sites + rng.uniform(-0.15, 0.15, (n, 3))
    options = {"species": SPECIES, "pairs": PAIRS} if mixed else {"epsilon": 1.3, "sigma": 0.95}
    force = kd.LennardJones(cutoff=2.5, truncation=truncation, **options)
    chains = kd.Topology.chains(15, 4, factors=(0.4, 1.0, 1.0)) if chained else None
    box = kd.Box.from_vectors([[edge, 0, 0], [1.1, edge, 0], [-0.8, 0.9, edge]]).box if leaning else kd.Box([edge] * 3)
    species = [*"AB", *rng.choice(list("ABC"), n - 2)] if mixed else None
    masses = rng.uniform(0.5, 2.0, n)
    return kd.System(x, rng.normal(size=x.shape), masses, box, [force], topology=chains, species=species)


CASES = [(truncation, *kind) for truncation in TRUNCATIONS for kind in ((0, 0, 0), (1, 0, 0), (1, 1, 1))]


@pytest.mark.parametrize("case", shortened(CASES, [("switch", 1, 0, 0)]), ids=str)
def test_slopes_are_those_of_the_oracle(case):
    system = system_of(*case)
    n, deviations = len(system), np.random.default_rng(5).normal(size=(2, 3, len(system), ALONG))
    made = varied(system, deviations.reshape(2, 3, -1))
    found = BoundForces(made).measure(0.0, made.state.phase).accelerations
    plain = BoundForces(system).measure(0.0, system.state.phase)
    np.testing.assert_array_equal(found[:, :n], plain.accelerations)
    assert plain.pairs > 10 * n
    slopes = found[:, n:].reshape(3, n, ALONG)
    for k in range(ALONG):
        wanted = pair_slopes(system, deviations[0, :, :, k].T).T / system.state.masses
        np.testing.assert_allclose(slopes[..., k], wanted, rtol=0, atol=1e-13 * np.abs(wanted).max())


@pair_law
class Elementary(NamedTuple):
    """U = a exp(-r / rho) + r^-n + log(1 + r^2) below r = 2, and the law returns what np.where gives."""

    a: float = 30.0
    rho: float = 0.4
    n: float = 7.5

    def law(p, r2):
        r = math.sqrt(r2)
        wall, core = p.a * math.exp(-r / p.rho), r2 ** (-0.5 * p.n)
        energy, pull = wall + core + math.log(1.0 + r2), wall / (p.rho * r) + p.n * core / r2 - 2.0 * (1.0 + r2) ** -1
        return np.where(r2 < 4.0, energy, 0.0), np.where(r2 < 4.0, pull, 0.0)


@pytest.mark.long
def test_a_law_of_exponentials_and_powers_in_a_mixture():
    still, numbers = (
        system_of("cut", 1, 0, 0),
        {"A": Elementary.Parameters(), "B": Elementary.Parameters(20.0, 0.5, 6.5)},
    )
    across = Elementary.Parameters(25.0, 0.45, 7.0)
    force = Elementary(
        cutoff=2.5, truncation="cut", species={name: each._asdict() for name, each in numbers.items()},
        pairs={("A", "B"): across._asdict()},
    )  # fmt: skip
    species = ["A" if k % 3 else "B" for k in range(len(still))]
    state = still.state
    system = kd.System(state.positions, state.velocities, state.masses, still.box, [force], species=species)
    energy, pull = 0.0, np.zeros((len(system), 3))
    for i, j in itertools.combinations(range(len(system)), 2):
        d = system.box.minimum_image(state.positions[i] - state.positions[j])
        if (r2 := float(d @ d)) < 2.5**2:
            u, over_r = (numbers[species[i]] if species[i] == species[j] else across).law(r2)
            energy, pull[i], pull[j] = energy + u, pull[i] + over_r * d, pull[j] - over_r * d
    plain = BoundForces(system).measure(0.0, system.state.phase)
    assert plain.potential == pytest.approx(energy, rel=1e-13)
    wanted = pull.T / system.state.masses
    np.testing.assert_allclose(plain.accelerations, wanted, rtol=0, atol=1e-13 * np.abs(wanted).max())
    along = np.random.default_rng(5).normal(size=(2, 3, len(system)))
    made = varied(system, along)
    slopes = BoundForces(made).measure(0.0, made.state.phase).accelerations[:, len(system) :]

    def at(step: float) -> np.ndarray:
        there = moved(system, step * along)
        return BoundForces(there).measure(0.0, there.state.phase).accelerations

    h = 1e-5
    found = (8.0 * (at(h) - at(-h)) - (at(2 * h) - at(-2 * h))) / (12.0 * h)
    np.testing.assert_allclose(slopes, found, rtol=0, atol=1e-8 * np.abs(found).max())


def moved(system: kd.System, along: np.ndarray, masses=None) -> kd.System:
    """The system with its phase (2, 3, n) moved, and perhaps other masses."""
    (x, v), names = system.state.phase + along, [system.species[k] for k in system.species_index]
    masses = system.state.masses if masses is None else masses
    return kd.System(x.T, v.T, masses, system.box, system.forces, system.units, topology=system.topology, species=names)


def ends(of, h: float) -> np.ndarray:
    """Derivative of the end of short runs of the systems ``of(step)``: differences of order 6."""

    def end(k: int) -> np.ndarray:
        sim = kd.Simulation(of(k * h), "velocity-verlet", dt=0.002)
        sim.run(20)
        return np.concatenate([sim.state.positions.ravel(), sim.state.velocities.ravel()])

    return (45 * (end(1) - end(-1)) - 9 * (end(2) - end(-2)) + (end(3) - end(-3))) / (60 * h)


def test_a_liquids_matrix_is_that_of_its_runs_and_symplectic():
    system = system_of("switch", 1, 0, 0)
    found = kd.transition_matrix(system, 0.04, "velocity-verlet", 0.002)
    assert found.by_differences == ()
    assert found.symplectic_error < 1e-15
    along = np.random.default_rng(6).normal(size=(2, 3, len(system)))
    wanted = ends(lambda h: moved(system, h * along), 1e-4)
    columns = along.swapaxes(1, 2).ravel()
    np.testing.assert_allclose(found.matrix @ columns, wanted, rtol=0, atol=3e-10 * np.abs(wanted).max())
    sim = kd.Simulation(system, "velocity-verlet", dt=0.002)
    sim.run(20)
    np.testing.assert_array_equal(found.end.positions, sim.state.positions)
    spectrum = kd.lyapunov_spectrum(system, 0.2, "velocity-verlet", 0.002, count=3)
    assert spectrum.exponents[0] > 1.0


@pytest.mark.long
@pytest.mark.parametrize("truncation", ["force-shift", "switch", "shift"])
@pytest.mark.parametrize("mixed", [False, True])
def test_gradients_by_parameters_and_masses_are_those_of_runs(truncation, mixed):
    system = system_of(truncation, mixed, False, mixed)
    (force,) = system.forces
    keys = ("epsilon", "sigma")
    names = [f"lennard-jones.{key}" for key in keys]
    found = kd.transition_matrix(system, 0.04, "velocity-verlet", 0.002, bodies=[0], parameters=names, masses=True)
    for k, key in enumerate(keys):
        value = getattr(force, key)
        wanted = ends(lambda h, key=key, value=value: system.with_forces(replace(force, **{key: value + h})), 1e-3)
        assert np.abs(wanted).max() > 1e-2
        np.testing.assert_allclose(found.by_parameters[:, k], wanted, rtol=0, atol=1e-9 * np.abs(wanted).max())
    heavier = np.arange(len(system)) == 7
    wanted = ends(lambda h: moved(system, 0.0, system.state.masses + h * heavier), 1e-3)
    np.testing.assert_allclose(found.by_masses[:, 7], wanted, rtol=0, atol=1e-9 * np.abs(wanted).max())


@kd.pair_law
class Screened(NamedTuple):
    """A user's law with what a pair law may use."""

    strength: float = 1.0
    width: float = 1.0
    hardness: float = 0.2

    def law(p, r2):
        r = math.sqrt(r2)
        wave = p.strength * math.exp(-r / p.width) * math.cos(2.0 * r)
        slope = -wave / p.width - 2.0 * p.strength * math.exp(-r / p.width) * math.sin(2.0 * r)
        inside = np.where(r < 1.2, 1.2 - r, 0.0)
        energy = wave + p.hardness * inside**4 + 0.1 * p.strength * math.log(r) + p.hardness / r2**3
        slope = slope - 4.0 * p.hardness * inside**3 + 0.1 * p.strength / r
        return energy, max(abs(6.0 * p.hardness / r2**4), 0.0) - slope / r


@pytest.mark.long
def test_a_users_law_has_slopes_by_positions_and_parameters():
    rng = np.random.default_rng(4)
    x = np.indices((4, 4, 4)).reshape(3, -1).T * 1.3 + rng.uniform(-0.2, 0.2, (64, 3))
    force = Screened(cutoff=2.5, truncation="switch")
    system = kd.System(x, rng.normal(size=x.shape), box=(5.2,) * 3, forces=[force])
    names = [f"screened.{key}" for key in ("strength", "width", "hardness")]
    found = kd.transition_matrix(system, 0.04, "velocity-verlet", 0.002, parameters=names)
    assert found.symplectic_error < 4e-15  # rounding, which differs between processors: 1.5e-15 on one
    along = rng.normal(size=(2, 3, len(system)))
    wanted = ends(lambda h: moved(system, h * along), 1e-4)
    got = found.matrix @ along.swapaxes(1, 2).ravel()
    np.testing.assert_allclose(got, wanted, rtol=0, atol=1e-8 * np.abs(wanted).max())
    for k, key in enumerate(("strength", "width", "hardness")):
        value = getattr(force, key)
        wanted = ends(lambda h, key=key, value=value: system.with_forces(replace(force, **{key: value + h})), 1e-3)
        np.testing.assert_allclose(found.by_parameters[:, k], wanted, rtol=0, atol=1e-9 * np.abs(wanted).max())


@pytest.mark.long
def test_threads_do_not_change_the_bits():
    system = liquid(512)
    deviations = np.random.default_rng(5).normal(size=(2, 3, 512 * 2))
    made = varied(system, deviations)
    one, two = (BoundForces(made, threads).measure(0.0, made.state.phase).accelerations for threads in (1, 2))
    np.testing.assert_array_equal(one, two)


@pytest.mark.long
@pytest.mark.parametrize("name", ["stillinger-weber", "tersoff"])
def test_matrices_of_many_body_forces_are_those_of_their_runs_and_symplectic(name):
    force, rng = FORCES[name](), np.random.default_rng(2)
    x, edges = lattice("diamond", 64, 8 / 5.431**3)
    x = x + 0.1 * rng.normal(size=x.shape)
    system = kd.System(x, rng.normal(size=x.shape), 28.0855, edges, [force], "metal", species=["Si"] * 64)
    found = kd.transition_matrix(system, 0.04, "velocity-verlet", 0.002)
    assert found.by_differences == ()
    assert found.symplectic_error < 1e-15
    along = rng.normal(size=(2, 3, len(system)))
    wanted = ends(lambda h: moved(system, h * along), 1e-4)
    got = found.matrix @ along.swapaxes(1, 2).ravel()
    np.testing.assert_allclose(got, wanted, rtol=0, atol=3e-10 * np.abs(wanted).max())


def test_what_has_no_derivative_is_said():
    system = liquid()
    for key in ("cutoff", "tail"):
        with pytest.raises(InputError, match=f"parameters: lennard-jones.{key}: "):
            kd.transition_matrix(system, 0.1, "velocity-verlet", 0.01, parameters=[f"lennard-jones.{key}"])
    with pytest.raises(InputError, match="precision: variational equations need double"):
        kd.megno(system, 0.1, "velocity-verlet", 0.01, precision="mixed")
    with pytest.raises(
        InputError, match=r"parameters: stillinger-weber\.cutoff: many-body forces have no derivatives by"
    ):
        kd.transition_matrix(kd.load("silicon-512"), 0.1, parameters="stillinger-weber.cutoff")
    planets = kd.load("outer-solar-system")
    with pytest.raises(InputError, match="force 'lennard-jones': the tangent map of trace takes no forces on a list"):
        kd.transition_matrix(planets.with_forces(*planets.forces, kd.LennardJones(cutoff=1.0)), 1.0, "trace", 0.1)
