"""leapfrog-exact: whole numbers return exactly after a reversed run, and the method is as accurate as leapfrog."""

from __future__ import annotations

import math
import subprocess
import sys
from typing import NamedTuple

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError, RunError
from kickdrift.forces.pairs.law import pair_law
from kickdrift.integrators.exact import stepper as exact_stepper
from kickdrift.integrators.exact.stepper import Lattice
from kickdrift.integrators.stepping import loops
from kickdrift.jit.compile import jit
from kickdrift.model.starts.builders import lattice, maxwell_boltzmann
from kickdrift_validation.problems import kepler
from tests.long import rest, shortened
from tests.oracle.forces import pair_oracle


def fluid(count: int = 125, truncation: str = "shift", mixture: bool = False) -> kd.System:
    """A lattice that melts; in a mixture every third particle is larger and heavier."""
    positions, edges = lattice("sc", count, 0.8)
    heavy = (np.arange(count) % 3 == 0) & mixture
    masses = np.where(heavy, 2.5, 1.0)
    velocities = maxwell_boltzmann(masses, 1.4, 1.0, 7)
    kinds = {"A": {"epsilon": 1.0, "sigma": 1.0}, "B": {"epsilon": 0.8, "sigma": 1.05}}
    force = kd.LennardJones(cutoff=2.0, truncation=truncation, species=kinds if mixture else None)
    names = np.where(heavy, "B", "A")
    return kd.System(
        positions, velocities, masses=masses, box=edges, forces=[force], species=names if mixture else None
    )


def planets() -> kd.System:
    """A star, a comet at e = 0.95, a planet and two massless particles."""
    r, v = kepler(3.0, 0.95)
    x = [[0.0, 0.0, 0.0], r, [0.0, 2.0, 0.1], [-1.5, 0.0, 0.0], [0.0, -3.0, 0.0]]
    u = [[0.0, 0.0, 0.0], v, [-0.7, 0.0, 0.0], [0.0, -0.8, 0.1], [0.55, 0.0, 0.0]]
    masses = [1.0, 1e-9, 1e-3, 0.0, 0.0]
    return kd.System(x, u, masses=masses, forces=[kd.Gravity(softening=1e-3)], units="nbody")


def drop() -> kd.System:
    """Particles in open space, under a pair force and gravity at once."""
    positions, _ = lattice("fcc", 32, 1.0)
    forces = [kd.LennardJones(cutoff=3.0, truncation="force-shift"), kd.Gravity(G=0.02, softening=0.1)]
    return kd.System(positions, masses=np.linspace(1.0, 3.0, 32), forces=forces)


SYSTEMS = {
    "fluid": (fluid, 0.004),
    "mixture": (lambda: fluid(truncation="switch", mixture=True), 0.004),
    "planets": (planets, 0.002),
    "drop": (drop, 0.01),
}


def there_and_back(system: kd.System, dt: float, steps: int) -> None:
    sim = kd.Simulation(system, "leapfrog-exact", dt=dt)
    start = sim.method_state
    sim.run(steps, every=steps)
    there = sim.method_state
    moving = np.abs(sim.state.phase - system.state.phase).max(axis=(0, 1)) > 0.01
    assert moving.sum() > len(system) / 2
    sim.method_state = there.reversed()
    sim.run(steps, every=steps)
    assert sim.method_state.reversed().same(start)
    assert not there.same(start)


@pytest.mark.parametrize("name", shortened(SYSTEMS, ["fluid", "planets"]))
def test_a_run_comes_back_to_the_very_same_bits(name):
    system, dt = SYSTEMS[name]
    there_and_back(system(), dt, 2000)


BACK = """
import sys
import numpy as np
import kickdrift as kd
from kickdrift.integrators.exact.stepper import Lattice
lattice = Lattice(**np.load(sys.argv[1]))
edges = lattice.spacing * 2.0**64
x = (lattice.positions * lattice.spacing[:, None] + lattice.images * edges[:, None]).T
system = kd.System(x, box=edges, forces=[kd.LennardJones(cutoff=2.0, truncation="shift")])
sim = kd.Simulation(system, "leapfrog-exact", dt=0.004)
sim.method_state = lattice.reversed()
sim.run(2000, every=2000)
np.savez(sys.argv[2], **sim.method_state._asdict())
"""


def test_another_process_comes_back_from_the_end_alone(tmp_path):
    sim = kd.Simulation(fluid(), "leapfrog-exact", dt=0.004)
    start = sim.method_state
    sim.run(2000, every=2000)
    np.savez(tmp_path / "there.npz", **sim.method_state._asdict())
    subprocess.run([sys.executable, "-c", BACK, tmp_path / "there.npz", tmp_path / "back.npz"], check=True)
    assert Lattice(**np.load(tmp_path / "back.npz")).reversed().same(start)


def after(pieces: list[int], skin: float | None = None) -> Lattice:
    sim = kd.Simulation(fluid(truncation="switch", mixture=True), "leapfrog-exact", dt=0.004)
    if skin is not None:
        particles = sim.integration.stepper._particles
        sim.integration.stepper._particles = particles._replace(skin=skin, radius=2.0 + skin)
    for steps in pieces:
        sim.run(steps)
        if skin == 0.0:
            sim.method_state = sim.method_state  # this discards the list
    return sim.method_state


def test_bits_do_not_depend_on_pieces_or_on_the_pair_list():
    whole = after([500])
    assert after([1, 99, 400]).same(whole)
    assert after([100] * 5, skin=0.0).same(whole)
    for skin in (0.02, 0.2, 1.5):
        assert after([500], skin).same(whole)


def test_list_with_cells_finds_every_pair(monkeypatch):
    """1000 particles in 5 to 8 cells along an edge, against a single cell."""

    def run() -> Lattice:
        positions, edges = lattice("sc", 1000, 0.8)
        system = kd.System(
            positions, maxwell_boltzmann(np.ones(1000), 1.4, 1.0, 3), box=edges, forces=[kd.LennardJones(cutoff=2.5)]
        )
        sim = kd.Simulation(system, "leapfrog-exact", dt=0.005)
        sim.run(200, every=200)
        return sim.method_state

    with_cells = run()
    monkeypatch.setattr(exact_stepper, "SKIN", 3.0)
    assert run().same(with_cells)


def test_momentum_does_not_change_at_all():
    sim = kd.Simulation(fluid(truncation="switch", mixture=True), "leapfrog-exact", dt=0.004)
    before = sim.method_state.momenta.sum(axis=1)
    sim.run(2000, every=2000)
    np.testing.assert_array_equal(sim.method_state.momenta.sum(axis=1), before)


def verlet(system: kd.System, dt: float, steps: int) -> np.ndarray:
    """Positions and velocities (2, n, 3) by velocity Verlet with the forces of the oracle."""
    x, v = system.state.positions.copy(), system.state.velocities.copy()
    masses = system.coherent_masses[:, None]

    def acceleration() -> np.ndarray:
        now = kd.System(x, masses=system.state.masses, box=system.box, forces=system.forces, units=system.units,
                        species=np.array(system.species)[system.species_index])  # fmt: skip
        return pair_oracle(now)[0] / masses

    a = acceleration()
    for _ in range(steps):
        v += 0.5 * dt * a
        x += dt * v
        a = acceleration()
        v += 0.5 * dt * a
    return np.array([x, v])


@pytest.mark.parametrize("name", ["fluid", "mixture", rest("drop")])
def test_it_is_velocity_verlet_to_rounding(name):
    system, dt = SYSTEMS[name][0](), SYSTEMS[name][1]
    sim = kd.Simulation(system, "leapfrog-exact", dt=dt)
    sim.run(50)
    expected = verlet(system, dt, 50)
    np.testing.assert_allclose(sim.state.positions, expected[0], atol=1e-12)
    np.testing.assert_allclose(sim.state.velocities, expected[1], atol=1e-12)


def test_planets_move_as_by_velocity_verlet():
    sims = [kd.Simulation(planets(), method, dt=0.002) for method in ("leapfrog-exact", "velocity-verlet")]
    for sim in sims:
        sim.run(2000)
    np.testing.assert_allclose(sims[0].state.phase, sims[1].state.phase, atol=1e-11)


class Soft(NamedTuple):
    strength: float = 30.0
    sigma: float = 1.0

    def law(p, r2):
        r = math.sqrt(r2)
        overlap = 1.0 - r / p.sigma
        return 0.5 * p.strength * overlap**2, p.strength * overlap / (p.sigma * r)


@pytest.mark.long
def test_a_users_pair_law_runs():
    positions, edges = lattice("sc", 64, 1.5)
    force = pair_law(Soft)(cutoff=1.0, truncation="cut")
    system = kd.System(positions, maxwell_boltzmann(np.ones(64), 1.0, 1.0, 2), box=edges, forces=[force])
    there_and_back(system, 0.01, 500)


def test_a_lattice_at_rest_can_collapse():
    """Bodies at rest with almost no force at the start: these must not set the scale of momenta."""
    positions, edges = lattice("sc", 64, 0.8)
    positions[0] += 0.001
    system = kd.System(positions, box=edges, forces=[kd.LennardJones(cutoff=2.0)])
    sim = kd.Simulation(system, "leapfrog-exact", dt=0.004)
    start = sim.method_state
    sim.run(1500, every=1500)
    assert np.abs(sim.state.velocities).max() > 1.0
    sim.method_state = sim.method_state.reversed()
    sim.run(1500, every=1500)
    assert sim.method_state.reversed().same(start)


def test_state_is_shown_unwrapped():
    system = kd.System([[0.1, 4.9, 2.0]], [[-1.0, 1.0, 0.0]], box=(5.0, 5.0, 5.0), forces=[])
    sim = kd.Simulation(system, "leapfrog-exact", dt=0.25)
    sim.run(48)
    np.testing.assert_allclose(sim.state.positions, [[-11.9, 16.9, 2.0]], rtol=1e-14)
    np.testing.assert_array_equal(np.abs(sim.method_state.images[:, 0]), [2, 3, 0])
    sim.state = sim.state
    np.testing.assert_allclose(sim.state.positions, [[-11.9, 16.9, 2.0]], rtol=1e-14)


def test_what_it_cannot_run_is_refused_by_name():
    class Wind(NamedTuple):
        name: str = "wind"

        def check(self, system): ...

        def bind(self, system, threads=1):
            raise AssertionError

    oscillator = kd.Problem(lambda t, y: [y[1], -y[0]], [1.0, 0.0], separable=True, name="oscillator")
    with pytest.raises(InputError, match=r"leapfrog-exact: .*'oscillator' is an ODE"):
        kd.Simulation(oscillator, "leapfrog-exact", dt=0.1)
    with pytest.raises(InputError, match="compensated: leapfrog-exact does not take it"):
        kd.Simulation(fluid(), "leapfrog-exact", dt=0.1, compensated=True)
    bonded = kd.System(
        fluid().state.positions, box=fluid().box, forces=fluid().forces, topology=kd.Topology(exclusions=[(3, 5)])
    )
    with pytest.raises(InputError, match=r"leapfrog-exact: sums all pairs alike, .* as particles 3 and 5"):
        kd.Simulation(bonded, "leapfrog-exact", dt=0.1)
    with pytest.raises(InputError, match="velocity-verlet has no method state"):
        kd.Simulation(fluid(), "velocity-verlet", dt=0.1).method_state
    method = kd.Simulation(fluid(), "leapfrog-exact", dt=0.1).method

    class Windy:
        subject = kd.System([[0.0, 0.0, 0.0]], forces=[Wind()])
        name = "windy"

    with pytest.raises(InputError, match=r"leapfrog-exact: .*force 'wind' is neither"):
        method.stepper(Windy(), None)


def test_a_lattice_of_other_particles_is_refused():
    sim = kd.Simulation(fluid(), "leapfrog-exact", dt=0.004)
    own = sim.method_state
    for wrong, culprit in (
        (own._replace(positions=own.positions[:, :4]), "positions must be int64 of shape"),
        (own._replace(momenta=own.momenta * 1.0), "momenta must be int64"),
        (own._replace(momenta=own.momenta + 2**62), "within 2\\^62"),
        (own._replace(spacing=2 * own.spacing), "does not fit the system's box"),
        (own._replace(momentum=-own.momentum), "positive"),
    ):
        with pytest.raises(InputError, match=culprit):
            sim.method_state = wrong
    assert sim.method_state.same(own)


def test_leaving_the_lattice_stops_the_run():
    system = kd.System(
        [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], [[0.0, 0.0, 0.0], [0.0, 9.0, 0.0]], forces=[kd.Gravity(G=1.0)]
    )
    sim = kd.Simulation(system, "leapfrog-exact", dt=0.5)
    with pytest.raises(RunError, match=r"stopped at step .*particle 1 lies beyond the lattice along y, .*positions to"):
        sim.run(200)
    assert np.isfinite(sim.state.phase).all()
    far = system.state
    far.phase[0, 0, 1] = 1e6
    with pytest.raises(InputError, match="particle 1 is outside the range of its lattice"):
        sim.state = far


def test_a_run_that_blows_up_says_who():
    positions, edges = lattice("sc", 64, 0.8)
    velocities = maxwell_boltzmann(np.ones(64), 1.4, 1.0, 3)
    system = kd.System(positions, velocities, box=edges, forces=[kd.LennardJones(cutoff=2.0)])
    sim = kd.Simulation(system, "leapfrog-exact", dt=0.1)
    with pytest.raises(RunError, match=r"leapfrog-exact, dt = 0.1: .*particle \d+"):
        sim.run(500)


def test_strict_functions_are_strict_in_fast_callers():
    """A callee that leaves fast-math open would use its caller's flags, and lose the rounding errors that it should
    keep."""

    @jit
    def add(y, carry, dy):
        loops.add_compensated(y, carry, 1.0, dy)

    y, carry = np.ones((1, 16)), np.zeros((1, 16))
    add(y, carry, np.full((1, 16), 1e-17))
    np.testing.assert_array_equal(carry, 1e-17)
