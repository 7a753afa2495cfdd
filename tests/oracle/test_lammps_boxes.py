"""Lennard-Jones particles in leaning boxes and in two dimensions, against LAMMPS: one state, and 20 steps later."""

from __future__ import annotations

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.forces.external.lammps_library import lammps_class
from kickdrift.systemfile.reading import loads

LIQUID = """
units = "lj"
velocities = {temperature = 1.0, seed = 3}
force = [{type = "lennard-jones", cutoff = 2.5, truncation = "shift"}]
"""
CASES = {
    "plane": 'dimensions = 2\nbox.periodic = true\nparticles = {lattice = "hexagonal", count = 480, density = 0.7}',
    "leaning plane": """dimensions = 2
        box.matrix = [[20.0, 0], [-10.0, 22.0]]
        particles = {lattice = "square", count = 400}""",
    "leaning box": """
        box.matrix = [[10.5, 0, 0], [5.25, 10, 0], [-5.0, 4.9, 10.3]]
        particles = {lattice = "fcc", count = 864}""",
}
DT, STEPS = 0.002, 20


def lammps_run(system):
    """Energy per particle, pressure and temperature at the start, and positions after the steps."""
    (ax, _, _), (bx, by, _), (cx, cy, cz) = system.box.matrix.tolist()
    plane, n = system.dimensions == 2, len(system)
    low, high = (-0.5, 0.5) if plane else (0.0, cz)
    world = lammps_class()(cmdargs=["-screen", "none", "-log", "none"])
    try:
        for line in (
            "units lj", f"dimension {system.dimensions}", "boundary p p p", "atom_style atomic",
            "atom_modify map array",
            f"region box prism 0 {ax!r} 0 {by!r} {low!r} {high!r} {bx!r} {cx!r} {cy!r}", "create_box 1 box", "mass 1 1",
            "pair_style lj/cut 2.5", "pair_coeff 1 1 1 1", "pair_modify shift yes", f"timestep {DT}",
            "fix move all nve", "neighbor 0.3 bin", "neigh_modify delay 0 every 1 check yes",
            "thermo_style custom pe press temp",
        ):  # fmt: skip
            world.command(line)
        x, v = system.box.wrap(system.state.positions), np.array(system.state.velocities)
        world.create_atoms(n, list(range(1, n + 1)), [1] * n, x.ravel().tolist(), v.ravel().tolist())
        world.command("run 0")
        first = [world.get_thermo(key) for key in ("pe", "press", "temp")]
        world.command(f"run {STEPS}")
        return first, np.array(world.gather_atoms("x", 1, 3)).reshape(-1, 3)
    finally:
        world.close()


@pytest.mark.parametrize("name", CASES)
def test_lammps_has_the_same_energy_pressure_and_trajectory(name):
    try:
        lammps_class()
    except ImportError as error:
        pytest.skip(str(error))
    start = loads(f"{LIQUID}\n{CASES[name]}")
    melting = kd.Simulation(start, "velocity-verlet", DT)
    melting.run(steps=500, every=500)
    system = start.at(melting.state.phase, 0.0)
    sim = kd.Simulation(system, "velocity-verlet", DT)
    sample = sim.sample()
    (energy, pressure, temperature), theirs = lammps_run(system)
    assert sample.energies.potential / len(system) == pytest.approx(energy, rel=1e-12)
    assert sample.pressure == pytest.approx(pressure, rel=1e-11)
    assert sample.temperature == pytest.approx(temperature, rel=1e-12)
    sim.run(steps=STEPS, every=STEPS)
    assert np.abs(system.box.minimum_image(theirs - sim.state.positions)).max() < 1e-12
