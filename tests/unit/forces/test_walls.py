"""Walls: soft walls conserve energy; bounces off hard walls are exact, in their order, and go back."""

from __future__ import annotations

import math

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.integrators import INTEGRATORS
from kickdrift_validation.walls import bounced, folded, room, wedge

UP = (0.0, 0.0, 1.0)


def gas(forces, n=12, box=None, seed=2) -> kd.System:
    rng = np.random.default_rng(seed)
    x = rng.uniform(0.5, 3.5, (n, 3))
    return kd.System(x, rng.normal(size=(n, 3)), rng.uniform(0.5, 2.0, n), box=box, forces=forces)


@pytest.mark.parametrize("name", ["velocity-verlet", "leapfrog-dkd", "forest-ruth", "yoshida4", "respa"])
@pytest.mark.parametrize("dt", [0.01, 7.0])
def test_free_particles_between_mirrors_are_where_straight_lines_fold(name, dt):
    """Also where a drift crosses several walls, and back in time inside a step, as methods of order 4 go."""
    system = gas(room())
    sim = kd.Simulation(system, name, dt)
    sim.run(30)
    straight = system.state.positions + sim.time * system.state.velocities
    np.testing.assert_allclose(sim.state.positions, folded(straight), atol=1e-10)
    speeds = [np.linalg.norm(state.velocities, axis=1) for state in (system.state, sim.state)]
    np.testing.assert_allclose(speeds[1], speeds[0], rtol=1e-13)


def test_bounces_in_a_wedge_come_in_the_order_of_the_way():
    """Between mirrors at 50 degrees a billiard is no map of one mirror after the other; against bounces one by one."""
    system, normals = wedge()
    x, v, bounces = bounced(system, normals, 5.0)
    sim = kd.Simulation(system, "velocity-verlet", 5.0)
    sim.run(1)
    assert bounces >= 5
    np.testing.assert_allclose(sim.state.positions, x, atol=1e-12)
    np.testing.assert_allclose(sim.state.velocities, v, atol=1e-12)


def test_a_liquid_between_hard_walls_stays_inside_and_goes_back():
    x = np.stack(np.meshgrid(*[[0.7, 2.0, 3.3]] * 3), -1).reshape(-1, 3)
    v = np.random.default_rng(7).normal(size=x.shape)
    system = kd.System(x, v, forces=[kd.LennardJones(cutoff=2.5, truncation="switch"), *room()])
    sim = kd.Simulation(system, "velocity-verlet", 0.002)
    report = sim.run(1000, every=50)
    assert [line for line in report.warnings if "so that the energy walks at random" in line]
    assert (sim.state.positions > 0).all()
    assert (sim.state.positions < 4).all()
    short = kd.Simulation(system, "velocity-verlet", 0.002)
    short.run(500)
    assert np.abs(short.state.velocities - v).max() > 1.0
    state = short.state
    back = kd.Simulation(system.at(np.array([state.phase[0], -state.phase[1]]), 0.0), "velocity-verlet", 0.002)
    back.run(500)
    np.testing.assert_allclose(back.state.positions, x, atol=1e-9)
    np.testing.assert_allclose(back.state.velocities, -v, atol=1e-9)


@pytest.mark.parametrize(
    "wall", [kd.HarmonicWall(30.0, (1.0, 2.0, 3.0)), kd.LennardJonesWall((1.0, 2.0, 3.0), 0.4 ** (1 / 6), sigma=1.0)]
)
def test_a_soft_wall_turns_particles_round_and_keeps_energy(wall):
    system = gas([wall, kd.UniformField((-0.3, -0.6, -0.9))])
    sim = kd.Simulation(system, "velocity-verlet", 0.001)
    report = sim.run(20_000, every=100)
    assert report.energy.max_relative_error < 1e-4
    normal = np.array([1.0, 2.0, 3.0]) / math.sqrt(14.0)
    assert (sim.state.positions @ normal > -1.5).all()


def test_temperatures_count_all_motion_between_walls():
    sim = kd.Simulation(gas([kd.LennardJones(), *room()]), "velocity-verlet", 0.01)
    kinetic = sim.energy().kinetic
    assert sim.sample().temperature == pytest.approx(kinetic / (1.5 * 12), rel=1e-12)


@pytest.mark.parametrize("name", ["stormer-verlet", "rk4", "gauss-radau15", "leapfrog-adaptive", "dop853"])
def test_methods_without_a_drift_refuse_hard_walls(name):
    step = {"dt": 0.01} if INTEGRATORS[name].needs_dt else {}
    with pytest.raises(InputError, match=f"{name}: integrates a force, and 'reflecting-wall' has none"):
        kd.Simulation(gas([kd.ReflectingWall(UP)]), name, **step)


def test_minimization_refuses_hard_walls():
    with pytest.raises(InputError, match="minimize: force 'reflecting-wall' has no energy; a harmonic-wall has one"):
        kd.Simulation(gas([kd.ReflectingWall(UP)]), "velocity-verlet", 0.01).minimize()


@pytest.mark.parametrize(
    ("wall", "box", "message"),
    [
        (kd.ReflectingWall(UP, (0.0, 0.0, 3.0)), None, "reflecting-wall: particle [0-9]+ is [0-9.]+ behind the wall"),
        (kd.LennardJonesWall(UP, 2.5, (0.0, 0.0, 3.0)), None, "lennard-jones-wall: particle [0-9]+ is [0-9.]+ behind"),
        (kd.HarmonicWall(1.0, UP, (0.0, 0.0, 4.0)), None, "harmonic-wall: 12 of 12 particles are behind the wall"),
        (kd.ReflectingWall(UP), (9.0, 9.0, 9.0), "reflecting-wall: a wall needs an open side, but the box is periodic"),
    ],
)
def test_a_wall_in_a_wrong_place_is_refused(wall, box, message):
    with pytest.raises(InputError, match=message):
        gas([wall], box=box)


def test_a_state_behind_a_hard_wall_is_refused():
    sim = kd.Simulation(gas([kd.ReflectingWall(UP)]), "velocity-verlet", 0.01)
    x = sim.state.positions.copy()
    x[3, 2] = -0.5
    with pytest.raises(InputError, match=r"reflecting-wall: particle 3 is 0\.5 behind the wall"):
        sim.state = gas([]).remade(positions=x).state
    sim.state = sim.state


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: kd.ReflectingWall((0, 0, 0)), "reflecting-wall: normal must not be zero"),
        (lambda: kd.HarmonicWall(-1.0, UP), "harmonic-wall: stiffness must be zero or more, got -1"),
        (lambda: kd.HarmonicWall(1.0, UP, reach=-1.0), "harmonic-wall: reach must be zero or more, got -1"),
        (lambda: kd.LennardJonesWall(UP, 0.0), "lennard-jones-wall: cutoff must be positive, got 0"),
    ],
)
def test_a_wall_that_makes_no_sense_is_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()
