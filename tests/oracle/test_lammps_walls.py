"""Walls and position restraints beside Lennard-Jones particles between open sides, against LAMMPS: energy, forces, and
positions 20 steps later."""

from __future__ import annotations

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.forces.external.lammps_library import lammps_class
from kickdrift.model.starts.builders import lattice

DT, STEPS, EDGE, LOW, HIGH = 0.004, 20, 8.0, 0.4, 7.7
UP, DOWN = (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)
FLOOR, CEILING = (0.0, 0.0, LOW), (0.0, 0.0, HIGH)
CASES = {
    "wall/lj93": (
        [kd.LennardJonesWall(UP, 2.5, FLOOR, 90.0, 0.2), kd.LennardJonesWall(DOWN, 0.25, CEILING, 50.0, 0.3)],
        [f"fix low all wall/lj93 zlo {LOW} 90.0 0.2 2.5", f"fix high all wall/lj93 zhi {HIGH} 50.0 0.3 0.25"],
    ),
    "wall/harmonic": (
        [kd.HarmonicWall(400.0, UP, FLOOR, 1.5), kd.HarmonicWall(500.0, DOWN, CEILING, 1.0)],
        [f"fix low all wall/harmonic zlo {LOW} 200.0 0.0 1.5", f"fix high all wall/harmonic zhi {HIGH} 250.0 0.0 1.0"],
    ),
    "wall/reflect": (
        [kd.ReflectingWall(UP, FLOOR), kd.ReflectingWall(DOWN, CEILING)],
        [f"fix low all wall/reflect zlo {LOW} zhi {HIGH}"],
    ),
    "spring/self": (
        [kd.Restraint(20.0, range(40)), kd.Restraint((0.0, 0.0, 30.0), range(40, 90))],
        ["group one id 1:40", "group two id 41:90", "fix low one spring/self 20.0", "fix high two spring/self 30.0 z"],
    ),
}  # fmt: skip


def start(walls: list) -> kd.System:
    x, _ = lattice("sc", 343, 343 / EDGE**3)
    v = np.random.default_rng(6).normal(0.0, 2.0, x.shape)
    box = kd.Box(lengths=(EDGE, EDGE, EDGE), periodic=(True, True, False))
    return kd.System(x, v, box=box, forces=[kd.LennardJones(cutoff=2.5, truncation="shift"), *walls])


def lammps_run(system: kd.System, fixes: list[str]) -> tuple[float, np.ndarray, np.ndarray]:
    """Potential energy and forces at the start, and positions after the steps."""
    n, world = len(system), lammps_class()(cmdargs=["-screen", "none", "-log", "none"])
    modified = [line.split()[1] for line in fixes if line.startswith("fix") and "reflect" not in line]
    try:
        for line in (
            "units lj", "boundary p p f", "atom_style atomic", "atom_modify map array",
            f"region box block 0 {EDGE} 0 {EDGE} -20 30", "create_box 1 box", "mass 1 1",
            "pair_style lj/cut 2.5", "pair_coeff 1 1 1 1", "pair_modify shift yes", f"timestep {DT}",
            "neighbor 0.3 bin", "neigh_modify delay 0 every 1 check yes", "thermo_style custom pe",
            "thermo_modify lost error",
        ):  # fmt: skip
            world.command(line)
        x, v = system.box.wrap(system.state.positions), np.array(system.state.velocities)
        world.create_atoms(n, list(range(1, n + 1)), [1] * n, x.ravel().tolist(), v.ravel().tolist())
        for line in ("fix move all nve", *fixes, *(f"fix_modify {name} energy yes" for name in modified), "run 0"):
            world.command(line)
        energy = n * world.get_thermo("pe")
        forces = np.array(world.gather_atoms("f", 1, 3)).reshape(-1, 3)
        world.command(f"run {STEPS}")
        return energy, forces, np.array(world.gather_atoms("x", 1, 3)).reshape(-1, 3)
    finally:
        world.close()


@pytest.mark.parametrize("name", CASES)
def test_lammps_has_the_same_energy_forces_and_trajectory(name):
    try:
        lammps_class()
    except ImportError as error:
        pytest.skip(str(error))
    walls, fixes = CASES[name]
    system = start(walls)
    sim = kd.Simulation(system, "velocity-verlet", DT)
    energy, forces, theirs = lammps_run(system, fixes)
    assert sim.energy().potential == pytest.approx(energy, rel=1e-12)
    np.testing.assert_allclose(sim.forces(), forces, rtol=0, atol=1e-11 * np.abs(forces).max())
    alone = kd.Simulation(system.with_forces(system.forces[0]), "velocity-verlet", DT)
    sim.run(steps=STEPS)
    alone.run(steps=STEPS)
    apart = system.box.minimum_image(theirs - sim.state.positions)
    assert np.abs(apart).max() < 1e-11
    assert np.abs(alone.state.positions - sim.state.positions).max() > 0.01  # walls and restraints acted
