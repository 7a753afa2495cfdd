"""Contract tests over the methods: fixed particles stay, or move at their velocity, in every method or by refusal."""

from __future__ import annotations

import re

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.analysis.certify.sampled_run import sampled_run
from kickdrift.errors import InputError
from kickdrift.integrators import INTEGRATORS, integrator
from kickdrift.model.freedom import disturbing
from kickdrift.pages.particles import page_system
from tests.systems import PRESSED, assert_bits_last, liquid, needed

METHODS = [name for name, method in INTEGRATORS.items() if method.name == name]
FIXING = [name for name in METHODS if not integrator(name).moves_all_because]
STILL, MOVING, VELOCITY = [0, 5, 17], [40, 41], (0.1, 0.0, -0.2)
GROUPS = [kd.Fixed(STILL), kd.Fixed(MOVING, velocity=VELOCITY)]
TRAP = kd.HarmonicTrap(1.0)


def held(move: bool = True) -> kd.System:
    return liquid().with_fixed(*GROUPS[: 1 + move])


def dt_of(name: str) -> float | None:
    return None if integrator(name).adaptive else 0.002


@pytest.mark.parametrize("name", FIXING)
def test_fixed_particles_stay_or_move_at_their_velocity(name):
    system = held(move=not integrator(name).overdamped)
    sim = kd.Simulation(system, name, dt=dt_of(name), **needed(name))
    start = system.state.positions
    sim.run(5)
    x, far = sim.state.positions, np.outer(np.ones(2), VELOCITY) * sim.time
    np.testing.assert_array_equal(x[STILL], start[STILL])
    assert not sim.state.velocities[STILL].any()
    if not integrator(name).overdamped:
        np.testing.assert_allclose(x[MOVING] - start[MOVING], far, rtol=0, atol=1e-13)
        np.testing.assert_allclose(sim.state.velocities[MOVING], [VELOCITY] * 2, rtol=0, atol=1e-12)
    assert np.abs(x - start)[[1, 2, 3]].min() > 0


@pytest.mark.parametrize("name", sorted(set(METHODS) - set(FIXING)))
def test_methods_that_move_all_particles_say_so(name):
    system = kd.load("two-planets").with_fixed(kd.Fixed(1))
    with pytest.raises(InputError, match=f"{name}: moves fixed particles too, because it .*velocity-verlet"):
        kd.Simulation(system, name, dt=0.01)


def test_an_overdamped_method_takes_no_velocity():
    with pytest.raises(InputError, match="brownian: moves fixed particles too, because it has no velocities"):
        kd.Simulation(held(), "brownian", dt=0.002, **needed("brownian"))


@pytest.mark.parametrize("name", ["velocity-verlet", "csvr", "nose-hoover", "baoab", "respa"])
def test_threads_and_restarts_keep_the_bits(name):
    system = held()
    assert_bits_last(lambda threads: kd.Simulation(system, name, dt=0.002, threads=threads, **needed(name)), 20, 7)


def test_forces_on_fixed_particles_are_known_and_accelerate_nothing():
    sim, free = kd.Simulation(held()), kd.Simulation(liquid())
    np.testing.assert_allclose(sim.forces(), free.forces(), rtol=0, atol=1e-11)
    a = sim.accelerations()
    assert not a[STILL + MOVING].any()
    np.testing.assert_allclose(np.delete(a, STILL + MOVING, 0), np.delete(free.accelerations(), STILL + MOVING, 0))
    assert np.abs(sim.forces()[STILL]).min() > 0


def test_heat_and_freedom_are_those_of_free_particles():
    system = held()
    assert system.degrees_of_freedom == 3 * (64 - 5)
    assert disturbing(system) == ["[[fixed]]"]
    assert system.acting("works") == ["[[fixed]]"]
    assert held(move=False).acting("works") == []
    v = np.delete(system.state.velocities, STILL + MOVING, 0)
    sample = kd.Simulation(system).sample()
    assert sample.temperature == pytest.approx((v**2).sum() / system.degrees_of_freedom, rel=1e-13)
    drawn = system.with_velocities(temperature=0.7, seed=2)
    assert kd.Simulation(drawn).sample().temperature == pytest.approx(0.7, rel=1e-12)
    np.testing.assert_array_equal(drawn.state.velocities[MOVING], [VELOCITY] * 2)
    report = kd.Simulation(system, dt=0.002).run(4)
    assert report.momentum_error is None
    assert "[[fixed]]" in report.energy.verdict


@pytest.mark.parametrize("name", ["csvr", "nose-hoover", "baoab"])
def test_baths_hold_the_temperature_of_the_free_particles(name):
    """Bussi's bath has the canonical distribution at once; here the mean heat of a trap's ten free particles."""
    rng = np.random.default_rng(1)
    system = kd.System(rng.normal(size=(20, 3)), rng.normal(size=(20, 3)), forces=[TRAP]).with_fixed(
        kd.Fixed(range(10), velocity=(0.0, 0.3, 0.0))
    )
    sim = kd.Simulation(system, name, dt=0.05, **needed(name))
    sim.run(20_000, every=10)
    assert np.mean([each.temperature for each in sim.record.samples[100:]]) == pytest.approx(1.0, abs=0.03)
    assert sampled_run(sim).freedom == 30


def test_the_minimum_is_that_of_the_free_particles():
    system = held()
    found = kd.Simulation(system).minimize()
    assert found.converged
    np.testing.assert_array_equal(found.system.state.positions[STILL], system.state.positions[STILL])
    forces = kd.Simulation(found.system).forces()
    assert np.abs(np.delete(forces, STILL + MOVING, 0)).max() < 1e-6 < 1e-2 < np.abs(forces[STILL]).max()


def test_equilibration_leaves_fixed_particles_in_place():
    sim = kd.Simulation(held(), dt=0.002)
    sim.equilibrate(0.8, steps=40, interval=10)
    assert sim.sample().temperature == pytest.approx(0.8, abs=0.2)
    np.testing.assert_array_equal(sim.state.velocities[MOVING], [VELOCITY] * 2)


def test_files_keep_fixed_particles(tmp_path):
    system = held()
    (tmp_path / "a.toml").write_text(system.to_toml())
    run = tmp_path / "run.h5md"
    kd.Simulation(system, dt=0.002).run(4, every=2, output=run)
    frame = tmp_path / "frame.toml"
    frame.write_text('units = "lj"\n[particles]\nfile = "run.h5md"\n[[force]]\ntype = "lennard-jones"\ncutoff = 2.0\n')
    with kd.open(run) as opened:
        assert ("fixed", "5 particles") in opened._lines()
        again = [kd.load(tmp_path / "a.toml"), opened.system(), opened[-1].system, kd.load(frame)]
    for each in again:
        np.testing.assert_array_equal(each.fixed.particles, sorted(STILL + MOVING))
        np.testing.assert_array_equal(each.fixed.velocities, system.fixed.velocities)
    whole = kd.Simulation(system, dt=0.002)
    whole.run(8)
    kd.resume(run).run(4)
    assert kd.open(run)[-1].positions.tobytes() == whole.state.positions.tobytes()


def test_species_and_units():
    system = kd.System(
        np.eye(3) * 5.0, species=["W", "A", "W"], forces=[], units="metal",
        fixed=[kd.Fixed(species="W", velocity=("1 angstrom/ps", 0, 0))],
    )  # fmt: skip
    assert system.fixed.particles.tolist() == [0, 2]
    np.testing.assert_array_equal(system.state.velocities[[0, 2]], [[1.0, 0.0, 0.0]] * 2)


WATER = [kd.Constraint(pairs=[[0, 1]])]


@pytest.mark.parametrize(
    ("given", "line"),
    [
        ({}, "fixed: expected particles or species, got neither"),
        ({"particles": [0], "species": "A"}, "fixed: expected particles or species, got particles and species"),
        ({"particles": []}, "fixed: particles: expected the numbers of particles"),
        ({"particles": [0.5]}, "fixed: particles: expected the numbers of particles"),
        ({"particles": [64]}, "fixed[0]: there is no particle 64; particles are 0 to 63"),
        ({"particles": [3, 3]}, "fixed: particle 3 is given twice"),
        ({"species": "B"}, "fixed[0]: no species 'B'"),
        ({"species": 3}, "fixed: species: expected a species"),
        ({"particles": 1, "velocity": 3.0}, "fixed: velocity: expected three numbers"),
        ({"particles": 1, "velocity": (1, 2)}, "fixed: velocity: expected three finite numbers"),
        ({"particles": 1, "velocity": (1, 2, np.inf)}, "fixed: velocity: expected three finite numbers"),
        ({"particles": 1, "velocity": (1, 2, "3 kg")}, "fixed[0]: velocity: "),
    ],
)
def test_bad_groups_end_in_one_line(given, line):
    with pytest.raises(InputError, match=f"^{re.escape(line)}"):
        liquid().with_fixed(kd.Fixed(**given))


def test_further_groups_add_to_those_before():
    system = liquid().with_fixed(GROUPS[0]).with_fixed(GROUPS[1])
    assert str(system.fixed) == str(held().fixed) == "5 particles, 2 at a given velocity"
    np.testing.assert_array_equal(system.fixed.velocities, held().fixed.velocities)
    assert system.with_fixed().fixed is None
    with pytest.raises(InputError, match="particle 40 is given twice"):
        system.with_fixed(kd.Fixed(40))
    report = kd.Simulation(system, "velocity-verlet", dt=0.002).run(2)
    assert ("fixed", "5 particles, 2 at a given velocity") in report._lines()


def test_what_fixed_particles_do_not_go_with():
    system = held()
    with pytest.raises(InputError, match="a constraint holds it"):
        liquid().remade(constraints=WATER, fixed=[kd.Fixed(1)])
    with pytest.raises(InputError, match="pressure: a barostat moves all particles with the box"):
        kd.Simulation(system, "csvr", dt=0.002, temperature=1.0, tau=0.5, **PRESSED)
    with pytest.raises(InputError, match="fixed particles: only a native run keeps them"):
        kd.Simulation(system, dt=0.002, engine="lammps")
    with pytest.raises(InputError, match=r"a heat bath needs a particle that is not fixed"):
        kd.Simulation(liquid().with_fixed(kd.Fixed(range(64))), "csvr", dt=0.002, temperature=1.0, tau=0.5)
    wall = kd.ReflectingWall(normal=(0, 0, 1), point=(0, 0, -9))
    walled = kd.System(np.eye(3), forces=[wall], fixed=[kd.Fixed(0, velocity=(0, 0, -1))])
    with pytest.raises(InputError, match="would turn fixed particles that move"):
        kd.Simulation(walled, dt=0.002).run(1)
    with pytest.raises(InputError, match="two-dimensional"):
        kd.System([[0.0, 0.0], [1.0, 1.0]], dimensions=2, fixed=[kd.Fixed(0, velocity=(0, 0, 1))])


def growth(t, y, bodies):
    return np.array([bodies.x[0, 0] + 1.0])


@pytest.mark.parametrize("name", ["velocity-verlet", "gauss-radau15"])
def test_bodies_stay_beside_unknowns(name):
    bodies = kd.load("two-planets")
    system = bodies.with_forces(*bodies.forces, kd.Beside(growth, [0.0])).with_fixed(kd.Fixed([0, 1]))
    sim = kd.Simulation(system, name, dt=dt_of(name) and 0.01)
    sim.run(5)
    np.testing.assert_array_equal(sim.state.positions[:2], system.state.positions[:2])
    assert np.abs(sim.state.positions - system.state.positions)[2].max() > 0 < sim.state.unknowns[0]


def test_other_units_and_other_programs_do_not_free_fixed_particles(tmp_path):
    x = [[0.0, 0, 0], [4.0, 0, 0]]
    law = kd.LennardJones(epsilon=0.01, sigma=3.4, cutoff=10.0, truncation="cut")
    system = kd.System(x, masses=40.0, box=(30,) * 3, units="metal", forces=[law], fixed=[kd.Fixed(0)])
    moving = system.with_fixed(kd.Fixed(1, velocity=("1 angstrom/ps", 0, 0)))
    changed = moving.in_units("gromacs").fixed
    assert changed.particles.tolist() == [0, 1]
    np.testing.assert_allclose(changed.velocities[:, 1], [0.1, 0.0, 0.0])
    assert not changed.velocities[:, 0].any()
    with pytest.raises(InputError, match="to_lammps: fixed particles"):
        system.to_lammps(tmp_path / "in.lammps")
    two = kd.System(np.eye(3), forces=[kd.Gravity(1.0)], fixed=[kd.Fixed(0, velocity=(0, 0, 1))])
    with pytest.raises(InputError, match="rotated: fixed particles that move"):
        two.rotated(np.eye(3))
    with pytest.raises(InputError, match="barycentric: would move fixed particles"):
        two.with_body("far", position=[9.0, 0, 0], mass=1.0, barycentric=True)
    pytest.importorskip("rebound")
    with pytest.raises(InputError, match="to_rebound: rebound moves all bodies"):
        two.to_rebound()


def test_openmm_leaves_fixed_particles_in_place():
    pytest.importorskip("openmm")
    law = kd.LennardJones(epsilon=1.0, sigma=0.34, cutoff=1.0, truncation="cut")
    system = kd.System([[0.0, 0, 0], [0.4, 0, 0]], masses=40.0, box=(3,) * 3, units="gromacs", forces=[law])
    made = system.with_fixed(kd.Fixed(0)).to_openmm()[0]
    assert [made.getParticleMass(i)._value for i in range(2)] == [0.0, 40.0]
    with pytest.raises(InputError, match="to_openmm: OpenMM keeps fixed particles at rest"):
        system.with_fixed(kd.Fixed(0, velocity=(1, 0, 0))).to_openmm()


def test_a_page_refuses_fixed_particles(tmp_path):
    path = tmp_path / "held.toml"
    path.write_text(held().with_run(integrator="velocity-verlet", dt=0.002).to_toml())
    with pytest.raises(InputError, match="has fixed particles, which a page cannot hold"):
        page_system(str(path))


def test_water_between_fixed_walls_keeps_both():
    """Constraints and fixed particles side by side: each is kept, and temperatures of motions leave walls out."""
    system = liquid().remade(constraints=[kd.Constraint(pairs=[[1, 2], [3, 4]])], fixed=[kd.Fixed(STILL)])
    sim = kd.Simulation(system, "csvr", dt=0.002, **needed("csvr"))
    sim.run(20, every=5)
    np.testing.assert_array_equal(sim.state.positions[STILL], system.state.positions[STILL])
    assert sim.report().molecules.error < 1e-12
    assert system.degrees_of_freedom == 3 * 61 - 2
