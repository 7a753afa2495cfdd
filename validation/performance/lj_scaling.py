"""What a Lennard-Jones step costs in large systems, mixtures and other truncations, with two threads, and in memory.

    python validation/performance/lj_scaling.py [--threads 2] [--turns 5] [--seconds 1.0]

The melt is that of lj_lammps.py. Sizes are cubes of whole numbers near 1000, 10,000 and 100,000. Whatever is compared
takes turns (A B C A B C …) in one process; a figure is the median of the ratios of neighbouring turns.

Memory is the peak resident size of a child process that has built the system and run it, less that of one with fewer
particles, over the difference in particles: what one more particle costs, with all lists and all copies.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from claims import Claim, claim, not_run, show, where
from melt import CUTOFF, again, melt, run, turns

import kickdrift as kd
from kickdrift.builders import mixture

SMALL, MIDDLE, LARGE = 10**3, 22**3, 46**3
MELT = 500  # steps, long enough for the lattice to go
COST, SPEED, MEMORY = 1.5, 0.75, 2000.0  # bounds: relative cost, relative speed, bytes


def size_claims(count: int, seconds: float) -> list[Claim]:
    """Cost per particle and step of larger systems over that of 1000 particles."""
    sims = {n: melt(n, MELT) for n in (SMALL, MIDDLE, LARGE)}
    before = {n: sim._forces.list_builds for n, sim in sims.items()}
    first = {n: sim.steps_done for n, sim in sims.items()}
    costs = 1e9 / (turns(list(sims.values()), seconds, count) * list(sims))
    rows = []
    for k, (n, sim) in enumerate(sims.items()):
        ratio = float(np.median(costs[:, k] / costs[:, 0]))
        builds, prunes = (
            (sim.steps_done - first[n]) / max(after - past, 1)
            for past, after in zip(before[n], sim._forces.list_builds, strict=True)
        )
        print(
            f"  {n:6} particles: {np.median(costs[:, k]):6.1f} ns per particle and step ({costs[:, k].min():.1f} to "
            f"{costs[:, k].max():.1f}), {ratio:.2f} of that at {SMALL}; T* = {sim.sample().temperature:.3f}, pair list "
            f"made every {builds:.1f} steps, pruned every {prunes:.1f}"
        )
        if n != SMALL:
            text = f"cost per particle and step at {n} particles over that at {SMALL}"
            rows.append(claim(text, ratio, f"at most {COST}", ratio <= COST, "kickdrift itself, alternating"))
    return rows


def variant_claims(count: int, seconds: float) -> list[Claim]:
    """Speed of a binary mixture and of other truncations over that of one species, cut and shifted; 1000 particles."""
    plain = melt(SMALL, MELT)
    species = {"A": {"epsilon": 1.0, "sigma": 1.0}, "B": {"epsilon": 0.8, "sigma": 0.95}}
    names = mixture({"A": 0.8, "B": 0.2}, SMALL, seed=1)
    sims = {
        "one species, shift": plain,
        "binary mixture, shift": again(
            plain, forces=[kd.LennardJones(cutoff=CUTOFF, truncation="shift", species=species)], species=names
        ),
        "one species, switch": again(plain, forces=[kd.LennardJones(cutoff=CUTOFF, truncation="switch")]),
        "one species, force-shift": again(plain, forces=[kd.LennardJones(cutoff=CUTOFF, truncation="force-shift")]),
        "binary mixture, switch": again(
            plain, forces=[kd.LennardJones(cutoff=CUTOFF, truncation="switch", species=species)], species=names
        ),
    }
    speeds = turns(list(sims.values()), seconds, count)
    rows = []
    for k, name in enumerate(sims):
        ratio = float(np.median(speeds[:, k] / speeds[:, 0]))
        print(f"  {name:24} {np.median(speeds[:, k]):8.1f} steps/s, {ratio:.2f} of the first")
        if name in ("binary mixture, shift", "one species, switch"):
            text = f"speed of {name}, over that of one species, shift"
            rows.append(claim(text, ratio, f"at least {SPEED}", ratio >= SPEED, "kickdrift itself, alternating"))
    return rows


def show_threads(threads: int, count: int, seconds: float) -> None:
    """Speed of many threads over that of one; printed, nothing is claimed."""
    from numba import config

    if not 1 < threads <= config.NUMBA_NUM_THREADS:
        print(f"  {threads} threads: not run, there are {config.NUMBA_NUM_THREADS} here")
        return
    for n in (SMALL, MIDDLE, LARGE):
        one = melt(n, MELT)
        speeds = turns([one, again(one, threads)], seconds, count)
        print(f"  {n:6} particles: {threads} threads are {np.median(speeds[:, 1] / speeds[:, 0]):.2f} times as fast as one")


def memory_claims() -> list[Claim]:
    """Peak memory per particle, as a slope."""
    text, bound, reference = "peak memory per particle, bytes", f"under {MEMORY:g}", "resident size of child processes"
    if not Path("/proc/self/clear_refs").exists():
        return [not_run(text, bound, reference, "a Linux kernel")]
    peaks = []
    for n in (MIDDLE, LARGE):
        child = [sys.executable, __file__, "--peak-memory-of", str(n)]
        peaks.append(int(subprocess.run(child, check=True, capture_output=True, text=True).stdout))
        print(f"  {n:6} particles: peak resident size {peaks[-1] / 1e6:.1f} MB")
    slope = (peaks[1] - peaks[0]) / (LARGE - MIDDLE)
    return [claim(text, slope, bound, slope < MEMORY, reference)]


def peak_memory(particles: int) -> int:
    """Bytes of this process at most, while it builds and runs a system; what compiling took is not counted."""
    melt(SMALL, 100)
    Path("/proc/self/clear_refs").write_text("5")  # start the high-water mark anew, see proc(5)
    melt(particles, 100)
    status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
    return int(status["VmHWM"].split()[0]) * 1024


def study(threads: int = 2, count: int = 5, seconds: float = 1.0) -> list[Claim]:
    """Everything, printed as it comes."""
    print(where())
    print("memory")
    rows = memory_claims()
    print(f"truncations and mixtures, {SMALL} particles")
    rows += variant_claims(count, seconds)
    print("sizes")
    rows += size_claims(count, seconds)
    print("threads")
    show_threads(threads, count, seconds)
    return rows


def claims() -> list[Claim]:
    """Cost with size, speed of the variants, memory."""
    return study()


def main() -> int:
    """Measure with the given options and print the claims."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--threads", type=int, default=2, help="to compare with one")
    parser.add_argument("--turns", type=int, default=5, help="of each")
    parser.add_argument("--seconds", type=float, default=1.0, help="length of a turn")
    parser.add_argument("--peak-memory-of", type=int, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.peak_memory_of:
        print(peak_memory(given.peak_memory_of))
        return 0
    return show(study(given.threads, given.turns, given.seconds))


if __name__ == "__main__":
    sys.exit(main())
