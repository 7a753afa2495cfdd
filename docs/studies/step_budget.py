"""Time of each part of a Lennard-Jones step, by size: nanoseconds per particle and step.

    python -m docs.studies.step_budget [--threads 1 2] [--sizes 1000 10648] [--turns 5]
        [--precision double mixed]

The liquid is that of liquids.py. Each part of a step runs by itself, many times over, on the state of a real run. The
median turn counts; on one thread a turn is measured in processor time. Parts of a new pair list, and the change of
order for its search, count as often as the run makes and prunes its list. The last rows are the sum of the parts and
a whole step of `Simulation.run`. With ``--shuffled`` the particles have a random order in memory.

The columns "predicted", for one thread and float64, follow from the bytes and operations of a part, counted by hand,
and from the peaks of ``peaks.py``. The bytes come from the smallest cache that holds the arrays of the part. Operations
run at the peak of multiply-adds, which a kernel does not reach. Sorting, searching and pruning are not predicted: they
compare numbers.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator, Sequence
from itertools import product
from time import perf_counter, process_time
from typing import Any

import numpy as np

import kickdrift as kd
from docs.studies.peaks import caches, measure
from docs.studies.roofline import KERNELS
from kickdrift.forces.lists.clusters import N_CLUSTERS
from kickdrift.forces.lists.pairlist import prune, search
from kickdrift.forces.lists.sort import sort
from kickdrift.forces.lists.sums import collected_mean
from kickdrift.forces.pairs.sorted_steps import GIVEN, Crossing, Sweep
from kickdrift.jit.compile import jit
from kickdrift.jit.handle import handle
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.jit.threads.chunks import each_chunk
from kickdrift_validation.claim import Claim, at_most, claim, show, where
from kickdrift_validation.performance.liquids import melt

SIZES, MELT = (10**3, 22**3, 46**3, 10**6), 60
STEP, PRUNING, SEARCH = "step", "pruning", "search"
FORCES, SWEEP, CROSSING = "forces of the pairs", "kicks, drift, places, moves", "to the clusters' order and back"
# Bytes that a part loads and stores for each particle, and bytes of a particle in its arrays. A sweep loads forces,
# velocities, positions, edges and the positions of the last pruning, and stores velocities, positions and places.
BYTES = {SWEEP: (200, 152)}
MOST_SWEPT, UNEXPLAINED = 0.2, 0.2  # bounds of the claims, as shares of a whole step


@jit
def cross_part(force, x, v, a):
    crossing = handle(Crossing(force.pairs, force.chunks, force.inverse_masses, x, v, a))
    each_chunk(crossing, force.chunks, "enter_chunk")
    each_chunk(crossing, force.chunks, "leave_chunk")


@jit
def sweep_part(force, x, v, a):
    mean = collected_mean(force.mixed, force.pairs, force.chunks)
    each_chunk(handle(Sweep(force.pairs, force.chunks, GIVEN, mean, a[0, :2], 1e-30)), force.chunks, "sweep_chunk")


@jit
def forces_part(force, x, v, a):
    each_chunk(force, force.chunks, "chunk_forces")


@jit
def prune_part(force, x, v, a):
    each_chunk(force.pairs, force.chunks, "outer_move_chunk")
    prune(force.pairs, force.chunks)


@jit
def sort_part(force, x, v, a):
    sort(force.pairs, x, force.chunks)


@jit
def search_part(force, x, v, a):
    search(force.pairs, force.chunks)


PARTS: tuple[tuple[str, Any, str, int], ...] = (  # name, code, how often, times a step
    (CROSSING, cross_part, SEARCH, 1),
    (SWEEP, sweep_part, STEP, 1),
    (FORCES, forces_part, STEP, 1),
    ("list pruned", prune_part, PRUNING, 1),
    ("particles sorted", sort_part, SEARCH, 1),
    ("clusters searched", search_part, SEARCH, 1),
)


def times_over(part: Any) -> Callable[..., None]:
    """The part many times over, as compiled code."""
    from numba import njit

    @njit(error_model="numpy")
    def run(force, x, v, a, turns):
        bound = handle(force)
        for _ in range(turns):
            part(bound, x, v, a)

    return run


CODE = {name: times_over(part) for name, part, _, _ in PARTS}


def timed(run: Callable[[int], object], count: int, clock: Callable[[], float], seconds: float = 0.05) -> float:
    """Median seconds of one go."""
    run(1)
    began = perf_counter()
    run(1)
    turns = max(1, int(seconds / max(perf_counter() - began, 1e-7)))
    found = []
    for _ in range(count):
        began = clock()
        run(turns)
        found.append((clock() - began) / turns)
    return float(np.median(found))


def started(n: int, threads: int, shuffled: bool, precision: str = "double") -> kd.Simulation:
    """The liquid at work, with particles in the order of the lattice or in a random order."""
    sim = melt(n, MELT)
    order = np.random.default_rng(1).permutation(n) if shuffled else np.arange(n)
    state, system = sim.state, sim.system
    moved = kd.System(state.positions[order], state.velocities[order], box=system.box, forces=system.forces)
    other = kd.Simulation(moved, dt=sim.dt, threads=threads, precision=precision)
    other.run(MELT, every=MELT)
    return other


def budget(n: int, threads: int, shuffled: bool, count: int, precision: str) -> dict[str, float]:
    """Nanoseconds per particle and step of each part, of their sum, and of a whole step."""
    sim = started(n, threads, shuffled, precision)
    forces = sim.integration.flow.forces
    clock = process_time if threads == 1 else perf_counter
    before, begun = forces.list_builds, sim.steps_done
    steps = max(20, min(2000, 2 * 10**6 // n))
    whole = timed(lambda turns: sim.run(turns * steps, every=turns * steps), count, clock) / steps
    done = sim.steps_done - begun
    searches, prunings = ((now - then) / done for now, then in zip(forces.list_builds, before, strict=True))
    often = {STEP: 1.0, PRUNING: prunings, SEARCH: searches}
    work = forces.forces[0].parts
    x, v = (np.ascontiguousarray(part.T) for part in (sim.state.positions, sim.state.velocities))
    a = np.zeros((3, n))
    found = {
        name: 1e9
        / n
        * often[when]
        * times
        * timed(lambda turns, name=name: CODE[name](work, x, v, a, turns), count, clock)
        for name, _, when, times in PARTS
    }
    return found | {"sum": sum(found.values()), "a whole step": 1e9 / n * whole}


def predicted(n: int, peaks: dict[str, float]) -> dict[str, float]:
    """Nanoseconds per particle and step of each part on one thread, from counted bytes and operations."""
    sim = melt(n, MELT)
    pairs: Any = sim.integration.flow.forces.forces[0].pairs
    entries = float(pairs.row_start[:, int(pairs.counts[N_CLUSTERS]) * WIDTH // pairs.per_row].sum()) / n
    by_size = sorted(caches().items(), key=lambda item: item[1])
    found = {FORCES: entries * KERNELS["lj-force"].operations / peaks["fma_gflops"]}
    for name, (moved, arrays) in BYTES.items():
        source = next((cache for cache, size in by_size if size >= arrays * n), "memory")
        found[name] = moved / peaks[f"{source}_gb_per_s"]
    return found


def claims_of(found: dict[int, dict[str, float]]) -> Iterator[Claim]:
    """Judge the budgets of one thread, by size: the parts explain a step, and most of it goes to lists and forces."""
    for n, each in found.items():
        whole = each["a whole step"]
        share, swept = each["sum"] / whole, (each[SWEEP] + each[CROSSING]) / whole
        text = f"{n} particles: sum of the parts over a whole step"
        yield claim(text, share, f"1 within {UNEXPLAINED:g}", abs(share - 1) <= UNEXPLAINED, "the run itself")
        text = f"{n} particles: share of kicks, drifts and changes of order"
        yield at_most(text, swept, MOST_SWEPT, "the run itself")


def claims(sizes: Sequence[int] = SIZES[:3]) -> Iterator[Claim]:
    """Claims about steps on one thread."""
    yield from claims_of({n: budget(n, 1, False, 5) for n in sizes})


def main() -> int:
    """Measure with the given options and print a table for each number of threads."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--threads", type=int, nargs="+", default=[1])
    parser.add_argument("--sizes", type=int, nargs="+", default=SIZES)
    parser.add_argument("--shuffled", action="store_true")
    parser.add_argument("--precision", nargs="+", default=["double"], choices=["double", "mixed"])
    parser.add_argument("--turns", type=int, default=5)
    given = parser.parse_args()
    print(where(), flush=True)
    peaks, judged = measure(), list[Claim]()
    for threads, precision in product(given.threads, given.precision):
        counted = threads == 1 and precision == "double"
        found = {n: budget(n, threads, given.shuffled, given.turns, precision) for n in given.sizes}
        expected = {n: predicted(n, peaks) if counted else {} for n in given.sizes}
        print(f"{threads} threads, {precision}, ns per particle and step{', shuffled' * given.shuffled}")
        print(f"{'particles':30}" + "".join(f"{n:>10}{'predicted':>10}" for n in given.sizes))
        for name in next(iter(found.values())):
            cells = [f"{each[name]:10.2f}" + shown(expected[n].get(name)) for n, each in found.items()]
            print(f"{name:30}" + "".join(cells), flush=True)
        if counted:
            judged += claims_of(found)
    return show(judged)


def shown(number: float | None) -> str:
    return f"{'–':>10}" if number is None else f"{number:10.2f}"


if __name__ == "__main__":
    sys.exit(main())
