"""Position restraints, and traps in periodic boxes: closed forms, boxes, virial, frames, and bad input."""

from __future__ import annotations

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.looks.pressure import instantaneous_pressure
from kickdrift.systemfile.reading import loads

LEANING = np.array([[5.0, 0.0, 0.0], [2.0, 5.0, 0.0], [-1.5, 2.2, 5.5]])


def cloud(forces, box=(5.0, 5.0, 5.0), n=9, **given) -> kd.System:
    rng = np.random.default_rng(4)
    x = rng.uniform(-7.0, 12.0, (n, 3))
    return kd.System(x, rng.normal(size=(n, 3)), rng.uniform(0.5, 2.0, n), box=box, forces=forces, **given)


@pytest.mark.parametrize("box", [(5.0, 6.0, 7.0), LEANING, kd.Box((5.0, 6.0, 7.0), periodic=(True, False, True))])
def test_a_trap_pulls_to_the_nearest_image_of_its_centre(box):
    system = cloud([kd.HarmonicTrap(2.0, (1.0, 2.0, 3.0))], box)
    sim = kd.Simulation(system, "velocity-verlet", 0.001)
    apart = system.box.minimum_image(system.state.positions - [1.0, 2.0, 3.0])
    np.testing.assert_allclose(sim.forces(), -2.0 * apart, atol=1e-12)
    assert sim.energy().potential == pytest.approx(float((apart**2).sum()), rel=1e-12)


def test_the_energy_of_a_trap_has_a_kink_and_no_jump_at_half_the_box():
    def energy(x: float) -> float:
        system = kd.System([[x, 0.0, 0.0]], box=(6.0, 6.0, 6.0), forces=[kd.HarmonicTrap((2.0, 1.0, 1.0))])
        return kd.Simulation(system, "velocity-verlet", 0.01).energy().potential

    assert [energy(x) for x in (3.0 - 1e-9, 3.0 + 1e-9)] == pytest.approx([9.0, 9.0], rel=1e-8)


def test_restrained_particles_oscillate_about_their_start():
    system = cloud([kd.Restraint((2.0, 8.0, 0.0))])
    sim = kd.Simulation(system, "velocity-verlet", 0.001)
    report = sim.run(20_000, every=100)
    assert report.energy.max_relative_error < 1e-5
    masses, v, time = system.state.masses[:, None], system.state.velocities, sim.time
    rate = np.sqrt([[2.0, 8.0]] / masses)
    expected = system.state.positions[:, :2] + v[:, :2] * np.sin(rate * time) / rate
    np.testing.assert_allclose(sim.state.positions[:, :2], expected, atol=2e-3)
    np.testing.assert_allclose(sim.state.positions[:, 2], (system.state.positions + v * time)[:, 2], atol=1e-9)


@pytest.mark.parametrize("box", [None, (5.0, 6.0, 7.0), LEANING])
def test_a_restraint_pulls_to_given_places(box):
    places = [(1.0, 2.0, 3.0), (-1.0, 0.0, 8.0)]
    system = cloud([kd.Restraint(3.0, [4, 1], places)], box)
    sim = kd.Simulation(system, "velocity-verlet", 0.001)
    expected = np.zeros((9, 3))
    expected[[4, 1]] = -3.0 * system.box.minimum_image(system.state.positions[[4, 1]] - np.array(places))
    np.testing.assert_allclose(sim.forces(), expected, atol=1e-12)


def in_box(scale: float, **given) -> kd.System:
    """The same fractions of a box that is so many times as long."""
    start = cloud([], LEANING)
    x, box = start.state.positions, LEANING * scale
    places = tuple(map(tuple, np.random.default_rng(5).uniform(0.0, 5.0, (9, 3))))
    return kd.System(x * scale, box=box, forces=[kd.Restraint(3.0, None, places, box=LEANING, **given)])


def test_the_virial_of_a_restraint_that_scales_is_the_slope_of_its_energy_with_the_box():
    h = 1e-4
    low, high = (kd.Simulation(in_box(1 + k * h), "velocity-verlet", 0.01).energy().potential for k in (-1, 1))
    system = in_box(1.0)
    sample = kd.Simulation(system, "velocity-verlet", 0.01).sample()
    assert 3.0 * system.volume * sample.pressure == pytest.approx(-(high - low) / (2 * h), rel=1e-7)
    tensor = instantaneous_pressure(system, system.state.positions, system.state.velocities)
    assert np.trace(tensor) / 3 == pytest.approx(sample.pressure, rel=1e-12)


def test_a_restraint_that_stays_has_no_virial_and_refuses_barostats():
    system = in_box(1.2, scales=False)
    given = {"temperature": 1.0, "tau": 0.5, "pressure": 0.1, "pressure_tau": 0.5, "compressibility": 0.1}
    with pytest.raises(InputError, match="pressure: force 'restraint' does not scale with the box: its reference pos"):
        kd.Simulation(system, "csvr", 0.001, **given)
    assert kd.Simulation(system, "velocity-verlet", 0.01).sample().pressure == 0.0


def test_the_places_follow_the_box_of_a_barostat(tmp_path):
    """The last frame of a run pulls to the same places as the run at its end."""
    x = np.random.default_rng(3).uniform(0.0, 6.0, (60, 3))
    start = kd.System(x, 0.1 * x, box=(6.0, 6.0, 6.0), forces=[kd.Restraint((20.0, 10.0, 0.0))])
    given = {"temperature": 1.0, "tau": 0.5, "pressure": 0.5, "pressure_tau": 2.0, "compressibility": 1.0}
    sim = kd.Simulation(start, "csvr", 0.005, coupling="per-axis", seed=3, **given)
    sim.run(300, every=100, output=tmp_path / "run.h5md")
    assert not np.allclose(sim.state.box.lengths, start.box.lengths, rtol=1e-3)
    frame = kd.open(tmp_path / "run.h5md")[-1].system
    np.testing.assert_allclose(kd.Simulation(frame, "velocity-verlet", 0.01).forces(), sim.forces(), atol=1e-10)
    again = loads(frame.at(frame.state.phase, 0.0).to_toml())
    assert again.forces == frame.forces


@pytest.mark.parametrize(
    ("force", "message"),
    [
        (lambda: kd.Restraint(-1.0), "restraint: stiffness must be zero or more, got -1"),
        (lambda: kd.Restraint(1.0, []), "restraint: particles: expected one or more, got none"),
        (lambda: kd.Restraint(1.0, [0, 1.5]), r"restraint: particles\[1\]: expected the id of a particle, got 1.5"),
        (lambda: kd.Restraint(1.0, [3, 3]), "restraint: particles: 3 is given twice"),
        (lambda: kd.Restraint(1.0, [3, 9]), "restraint: particles: there is no particle 9; ids are 0 to 8"),
        (lambda: kd.Restraint(1.0, [3], [(0, 0, 0), (1, 1, 1)]), "restraint: 2 positions for 1 particle"),
        (lambda: kd.Restraint(1.0, positions=[(0, 0, 0)]), "restraint: 1 positions for 9 particles"),
        (lambda: kd.Restraint((1.0, 2.0, 2.0)), "restraint: stiffness has three values, but a leaning box takes one"),
        (lambda: kd.HarmonicTrap((1.0, 2.0, 2.0)), "harmonic-trap: stiffness has three values, but a leaning box"),
    ],
)
def test_bad_input_is_refused_in_one_line(force, message):
    with pytest.raises(InputError, match=message):
        cloud([force()], LEANING)
