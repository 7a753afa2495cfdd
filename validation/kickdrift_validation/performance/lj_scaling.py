"""What a Lennard-Jones step costs in large systems, mixtures and other truncations, with two threads, and in memory.

    python -m kickdrift_validation.performance.lj_scaling [--threads 2] [--turns 7] [--seconds 0.7]

The liquid is that of melt.py. Sizes are cubes of whole numbers near 1000, 10,000 and 100,000. Whatever is compared
takes turns (A B A B …) in one process; a figure is the median of the ratios of neighbouring turns.

Memory is the peak resident size of a child process that has built the system and run it, less that of one with fewer
particles, over the difference in particles: what one more particle costs, with all lists and all copies.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

import numpy as np

import kickdrift as kd
from kickdrift.model.starts.builders import mixture
from kickdrift_validation.claim import Claim, claim, not_run, show, where
from kickdrift_validation.performance.melt import CUTOFF, again, melt
from kickdrift_validation.performance.turns import Native, turns

SMALL, MIDDLE, LARGE, MILLION = 10**3, 22**3, 46**3, 10**6
MELT = 500  # steps, long enough for the lattice to go
COST, SPEED, MEMORY = 1.5, 0.75, 2000.0  # bounds: relative cost, relative speed, bytes
MEMORY_OF_MILLION = 1000.0  # bound: bytes a particle
ITSELF = "kickdrift itself, in turns"


def size_claims(count: int, seconds: float) -> list[Claim]:
    """Cost per particle and step of larger systems over that of 1000 particles."""
    small = melt(SMALL, MELT)
    rows = []
    for n in (MIDDLE, LARGE):
        large = melt(n, MELT)
        lists, steps = large.integration.flow.forces.list_builds, large.steps_done
        costs = 1e9 / (turns([Native(small), Native(large)], seconds, count) * (SMALL, n))
        ratio = float(np.median(costs[:, 1] / costs[:, 0]))
        every = [
            (large.steps_done - steps) / max(now - before, 1)
            for before, now in zip(lists, large.integration.flow.forces.list_builds, strict=True)
        ]
        print(
            f"  {n:6} particles: {np.median(costs[:, 1]):6.1f} ns per particle and step, at {SMALL} "
            f"{np.median(costs[:, 0]):6.1f}; T* = {large.sample().temperature:.3f}, pair list made every "
            f"{every[0]:.1f} steps, pruned every {every[1]:.1f}"
        )
        text = f"cost per particle and step at {n} particles over that at {SMALL}"
        rows.append(claim(text, ratio, f"at most {COST}", ratio <= COST, ITSELF))
    return rows


def variant_claims(count: int, seconds: float) -> list[Claim]:
    """Speed of a binary mixture and of other truncations over that of one species, cut and shifted; 1000 particles."""
    plain = melt(SMALL, MELT)
    species = {"A": {"epsilon": 1.0, "sigma": 1.0}, "B": {"epsilon": 0.8, "sigma": 0.95}}
    names = mixture({"A": 0.8, "B": 0.2}, SMALL, seed=1)

    def variant(truncation: str, mixed: bool) -> kd.Simulation:
        force = kd.LennardJones(cutoff=CUTOFF, truncation=truncation, species=species if mixed else None)
        return again(plain, forces=[force], species=names if mixed else None)

    rows = []
    for name, truncation, mixed, claimed in (
        ("binary mixture, shift", "shift", True, True),
        ("one species, switch", "switch", False, True),
        ("one species, force-shift", "force-shift", False, False),
        ("binary mixture, switch", "switch", True, False),
    ):
        speeds = turns([Native(plain), Native(variant(truncation, mixed))], seconds, count)
        ratios = speeds[:, 1] / speeds[:, 0]
        ratio = float(np.median(ratios))
        print(
            f"  {name:24} {np.median(speeds[:, 1]):7.1f} steps/s, one species, shift {np.median(speeds[:, 0]):7.1f}: "
            f"{ratio:.3f} ({ratios.min():.3f} to {ratios.max():.3f})"
        )
        if claimed:
            text = f"speed of {name}, over that of one species, shift"
            rows.append(claim(text, ratio, f"at least {SPEED}", ratio >= SPEED, ITSELF))
    return rows


def show_threads(threads: int, count: int, seconds: float) -> None:
    """Speed of many threads over that of one; printed, nothing is claimed."""
    from numba import config

    if not 1 < threads <= config.NUMBA_NUM_THREADS:
        print(f"  {threads} threads: not run, there are {config.NUMBA_NUM_THREADS} here")
        return
    for n in (SMALL, MIDDLE, LARGE):
        one = melt(n, MELT)
        speeds = turns([Native(one), Native(again(one, threads))], seconds, count)
        ratio = np.median(speeds[:, 1] / speeds[:, 0])
        print(f"  {n:6} particles: {threads} threads are {ratio:.2f} times as fast as one")


def memory_claims() -> list[Claim]:
    """Peak memory per particle, as a slope."""
    sizes = SMALL, MIDDLE, LARGE, MILLION  # the first compiles: what that leaves on the heap would be reused unseen
    reference, peaks = "resident size of child processes", []
    wanted = [
        (MIDDLE, LARGE, "peak memory per particle, bytes", MEMORY),
        (LARGE, MILLION, f"peak memory per particle up to {MILLION} particles, bytes", MEMORY_OF_MILLION),
    ]
    if not Path("/proc/self/clear_refs").exists():
        return [not_run(text, f"under {most:g}", reference, "a Linux kernel") for _, _, text, most in wanted]
    for n in sizes:
        child = [sys.executable, "-m", "kickdrift_validation.performance.lj_scaling", "--peak-memory-of", str(n)]
        peaks.append(int(subprocess.run(child, check=True, stdout=subprocess.PIPE, text=True).stdout))
    print(", ".join(f"{n} particles: {peak / 1e6:.1f} MB" for n, peak in zip(sizes[1:], peaks[1:], strict=True)))
    rows = []
    for few, many, text, most in wanted:
        slope = (peaks[sizes.index(many)] - peaks[sizes.index(few)]) / (many - few)
        rows.append(claim(text, slope, f"under {most:g}", slope < most, reference))
    return rows


def peak_memory(particles: int) -> int:
    """Bytes of this process at most, while it builds and runs a system; loading the compiled code is not counted."""
    melt(SMALL, 100)
    Path("/proc/self/clear_refs").write_text("5")  # start the high-water mark anew, see proc(5)
    melt(particles, min(100, 2 * 10**7 // particles))
    status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
    return int(status["VmHWM"].split()[0]) * 1024


def study(threads: int = 2, count: int = 7, seconds: float = 0.7) -> list[Claim]:
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
    parser.add_argument("--turns", type=int, default=7, help="of each")
    parser.add_argument("--seconds", type=float, default=0.7, help="length of a turn")
    parser.add_argument("--peak-memory-of", type=int, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.peak_memory_of:
        print(peak_memory(given.peak_memory_of))
        return 0
    return show(study(given.threads, given.turns, given.seconds))


if __name__ == "__main__":
    sys.exit(main())
