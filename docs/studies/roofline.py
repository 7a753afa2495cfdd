"""Speed of each kernel beside the processor's peaks, and the limit of each kernel.

    python -m docs.studies.roofline [--turns 7] [--json FILE] [--page docs/roofline.md]

Each kernel runs by itself on one core, many times, and its best turn counts. The operations of a unit of work (a pair,
a list entry of eight pairs, a body, …) are counted by hand from the formulas, see KERNELS. A multiply-add counts as
two, the estimate of 1/x or 1/sqrt(x) as one. Bytes are loads and stores, from any cache. The peaks of ``peaks.py``
then give the share of the arithmetic peak. The script does not compare a run's step with the sum of its parts, because
parts overlap.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

import kickdrift as kd
from docs.studies.peaks import measure, per_second
from kickdrift.analysis.compare.bench import processor
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.forces.bound.table import accelerate_by
from kickdrift.forces.lists.clusters import N_CLUSTERS
from kickdrift.integrators.gauss_radau.series import NODES, correct, prepare
from kickdrift.integrators.gauss_radau.tables import tables
from kickdrift.integrators.wisdom_holman.flows import drift, heliocentric_kick, jacobi_kick, jump
from kickdrift.jit.compile import jit
from kickdrift.jit.handle import handle, unowned
from kickdrift.jit.lanes.functions import lane_max, splat
from kickdrift.jit.lanes.memory import aligned, flat
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift_validation.docs_tables import deliver, outputs, table
from kickdrift_validation.exact_reversal import solar_system
from kickdrift_validation.performance.bodies import planets, stars
from kickdrift_validation.performance.liquids import CUTOFF, melt
from kickdrift_validation.wisdom_holman import MERCURY

BEGIN, END = "<!-- roofline.py writes from here -->", "<!-- to here -->"
LATENCY, FLOPS, MIXED = "chains of additions", "arithmetic", "loads beside arithmetic"
WAITING = "room for operations that wait"


class Kernel(NamedTuple):
    """Operations and bytes of a unit of work; ``limit`` names what the kernel waits for."""

    name: str
    unit: str
    operations: int
    bytes: int
    limit: str


# An inverse square root is 11: the estimate, x y, 1 - x y^2 (2), two multiply-adds of the series (4), y e, the last
# multiply-add (2). An inverse is 8: the estimate y, e = 1 - x y (2), y (1 + e) (2), e^2, the last multiply-add (2).
KERNELS = {
    # The rows' entries are those of AVX-512; other processors have them half as wide (see forces.row_lanes).
    # dx 3, r^2 5, inverse 8, its powers 3, force / r 3, the cutoff 1, on i 6, on j 6: eight times; loads x and force of
    # the cluster (384), stores its force (192), the particle's shifted place and the entry (32)
    "lj-force": Kernel("Lennard-Jones force", "entry of a row (8 pairs)", 8 * 35, 608, WAITING),
    # the same with an inverse of 5, 16 times; x of half a cluster (48), the row's place (192), forces (384), the entry
    "lj-mixed": Kernel("Lennard-Jones force, mixed precision", "tile (16 pairs)", 16 * 32, 632, WAITING),
    # dx 3, r^2 5, the comparison 1, 64 times, from x of the other (24 and as many conversions); loads x of one and the
    # other from a table, writes the rows
    "lj-prune": Kernel("Lennard-Jones, rows made", "two clusters near each other", 64 * 9 + 48, 980, MIXED),
    # not counted: mostly comparisons and whole numbers
    "lj-search": Kernel("Lennard-Jones, clusters sorted and searched", "particle", 0, 0, "comparisons, whole numbers"),
    # dx 3, r^2 with the softening 6, inverse 11, cube 2, weight 1, on i 6, weight 1, on j 6; per eight pairs of two
    # bodies the cluster's x, a and masses (448) are loaded and a (192) stored once
    "gravity-1000": Kernel("direct gravity, n = 1000", "pair", 36, 40, FLOPS),
    "gravity-4096": Kernel("direct gravity, n = 4096", "pair", 36, 40, FLOPS),
    # the same; positions and accelerations of nine bodies once for 36 pairs
    "gravity-9": Kernel("direct gravity, n = 9", "pair", 36, 18, LATENCY),
    # r 16, beta, eta, zeta 16, the guess 21, G0 … G3 39, Newton's correction 50, G at it 28, f and g 22, increments 18,
    # the test 6, compensated sums 24
    "kepler": Kernel("Kepler drift", "body", 240, 200, LATENCY),
    # pulls 144 (half of the pairs' 36 with the Hill radius, twice), places 33, the central body's pull 84, Jacobi's
    # sums 66, the kick 15
    "jacobi-kick": Kernel("Wisdom-Holman kick, Jacobi", "body", 342, 600, LATENCY),
    # pulls 144, the kick 15, the jump 21
    "heliocentric-kick": Kernel("Wisdom-Holman kick, heliocentric", "body", 180, 350, LATENCY),
    # sums of eight coefficients for values (19) and positions (21), s h (v + …) 6; the correction 24; reads twelve
    # and fourteen rows of the workspace and writes two and nine
    "radau-series": Kernel("Gauss-Radau series", "component and node", 70, 296, LATENCY),
    # seven nodes twice, 27 components each: the series (70) and 36 pairs (36); the rest of a step is not counted
    "radau-step": Kernel("Gauss-Radau step, n = 9", "node, with forces", 27 * 70 + 36 * 36, 27 * 296 + 648, LATENCY),
}  # fmt: skip


@jit
def evaluations(forces, x, a, rounds):
    """Accelerations at x, this many times."""
    bound, x, a = handle(forces), unowned(x), unowned(a)
    for _ in range(rounds):
        accelerate_by(bound, None, 0, 0.0, x, x, a, None)


@jit
def drifts(bodies, dt, rounds):
    """Kepler drifts, each from the end of the previous drift."""
    bound, status = handle(bodies), 0
    for _ in range(rounds):
        status += drift(bound, dt, 0.0)
    return status


@jit
def kicks(bodies, dt, rounds):
    """Kicks, and jumps in heliocentric coordinates."""
    bound = handle(bodies)
    for _ in range(rounds):
        if bound.jacobi:
            jacobi_kick(bound, dt, 0.0)
        else:
            heliocentric_kick(bound, dt, 0.0)
            jump(bound, dt)


@jit
def series(workspace, numbers, found, trial, offset, h, rounds):
    """Work of a node besides the forces, at one node after the other."""
    work, width, own, worst = flat(unowned(workspace)), workspace.shape[1], handle(numbers), splat(0.0)
    found, trial = unowned(found), unowned(trial)
    for k in range(rounds):
        row = k % NODES
        following = (k + 1) % NODES
        prepare(work, width, own, following, h, True)
        worst, _ = correct(work, width, found, offset, trial, own, row, following, h, True, worst)
    return lane_max(worst)


class Watch(NamedTuple):
    """Length of each measurement."""

    turns: int
    seconds: float

    def nanoseconds(self, work: Callable[[int], object]) -> float:
        """Nanoseconds of a round of ``work(rounds)``."""
        return 1e9 / per_second(work, self.turns, self.seconds)


def lennard_jones(watch: Watch) -> dict[str, float]:
    """Nanoseconds a unit, from forces of 1000 particles with the present list, a pruned list and a new list."""
    sim = melt(1000, 500)
    begin = np.array([sim.state.positions.T, sim.state.velocities.T])
    found = {}
    for key, mixed in (("lj-mixed", True), ("lj-force", False)):
        bound = BoundForces(sim.system, mixed=mixed)
        bound.derivative(0.0, begin)
        pairs: Any = bound.forces[0].pairs
        clusters = int(pairs.counts[N_CLUSTERS])
        entries = int(pairs.row_start[:, clusters * WIDTH // pairs.per_row].sum())
        force = partial(repeat, bound, [begin])
        found[key] = watch.nanoseconds(force) / entries
        print(f"  1000 particles at r_c = {CUTOFF}: {entries} entries of rows; force {found[key] * entries:.0f} ns")
    near = int(np.ptp(pairs.near_span[:clusters], axis=1).sum())
    moved = begin.copy()
    moved[0] += 0.6 * pairs.inner_skin  # moves every particle along x, y and z by more than the inner list allows

    def search(rounds: int) -> None:
        for _ in range(rounds):
            bound.forget()
            bound.derivative(0.0, begin)

    before = bound.list_builds
    pruned = watch.nanoseconds(partial(repeat, bound, [begin, moved]))
    after = bound.list_builds
    if after[0] != before[0] or after[1] == before[1]:
        raise RuntimeError(f"the list was made {after[0] - before[0]} times, pruned {after[1] - before[1]} times")
    found["lj-prune"] = (pruned - found["lj-force"] * entries) / near
    found["lj-search"] = (watch.nanoseconds(search) - pruned) / len(sim.system)
    print(f"  {near} pairs of clusters in the outer list")
    return found


def repeat(bound: BoundForces, points: list[np.ndarray], rounds: int) -> None:
    """Evaluate the forces at one point after the other, this many times."""
    for k in range(rounds):
        bound.derivative(0.0, points[k % len(points)])


def gravity(watch: Watch, count: int) -> float:
    """Nanoseconds a pair."""
    start = planets() if count == 9 else stars(count)
    x = np.ascontiguousarray(start.positions.T)
    bound, a = BoundForces(start.system), np.zeros_like(x)
    return watch.nanoseconds(lambda rounds: bound.call(evaluations, x, a, rounds)) / (count * (count - 1) / 2)


def wisdom_holman(watch: Watch) -> dict[str, float]:
    """Nanoseconds a body, with a hundred steps in Mercury's orbit."""
    dt, found = MERCURY / 100, {}
    short = 1e-9 * dt  # length of a kick, so that velocities hardly change
    for coordinates, name in (("jacobi", "jacobi-kick"), ("democratic-heliocentric", "heliocentric-kick")):
        sim = kd.Simulation(solar_system(), "wisdom-holman", dt=dt, coordinates=coordinates)
        sim.run(10)
        bodies: Any = sim.integration.stepper._bodies  # type: ignore[attr-defined]
        found["kepler"] = watch.nanoseconds(partial(drifts, bodies, dt)) / WIDTH
        found[name] = watch.nanoseconds(partial(kicks, bodies, short)) / WIDTH
    return found


def gauss_radau(watch: Watch) -> dict[str, float]:
    """Nanoseconds a component and node, and nanoseconds a node with its forces."""
    sim = kd.Simulation(planets().system, "gauss-radau15")
    sim.run(200, every=2**40)
    stepper: Any = sim.integration.stepper
    work = stepper._work
    size, components = stepper._flat.shape[1] - work.shape[1], stepper.y[0].size
    own, (found, trial) = aligned(work.shape), aligned(stepper._flat.shape)  # zeros stay zeros, and take the same time
    alone = watch.nanoseconds(lambda rounds: series(own, tables(), found, trial, size, 0.0, rounds))
    count = sim.record.force_evaluations, sim.steps_done
    nodes = count[0] / count[1] - 1  # without the node at the step's start
    step = watch.nanoseconds(lambda rounds: sim.run(1000 * rounds, every=2**40)) / 1000
    print(f"  Gauss-Radau step of the Sun and planets: {step:.0f} ns, {nodes:.2f} nodes corrected")
    return {"radau-series": alone / components, "radau-step": step / nodes}


def study(turns: int = 7, seconds: float = 0.1) -> dict[str, Any]:
    """Peaks, and nanoseconds a unit of each kernel."""
    watch = Watch(turns, seconds)
    times = lennard_jones(watch)
    times |= {f"gravity-{count}": gravity(watch, count) for count in (1000, 4096, 9)}
    times |= wisdom_holman(watch) | gauss_radau(watch)
    return {"processor": processor(), "peaks": measure(turns, seconds), "nanoseconds": times}


def rows(found: dict[str, Any]) -> list[list[str]]:
    """Rows of the table of kernels."""
    peak = found["peaks"]["fma_gflops"]
    listed = []
    for key, kernel in KERNELS.items():
        time = found["nanoseconds"][key]
        rate = kernel.operations / time
        counted = kernel.operations > 0
        listed.append(
            [
                kernel.name,
                kernel.unit,
                str(kernel.operations) if counted else "–",
                str(kernel.bytes) if counted else "–",
                f"{time:.3g}",
                f"{rate:.1f}" if counted else "–",
                f"{kernel.bytes / time:.0f}" if counted else "–",
                f"{100 * rate / peak:.0f} %" if counted else "–",
                kernel.limit,
            ]
        )
    return listed


def tables_of(found: dict[str, Any]) -> str:
    peaks = found["peaks"]
    heading = ["kernel", "unit", "operations", "bytes", "ns", "GFLOP/s", "GB/s", "of the peak", "it waits for"]
    caches = [key for key in peaks if key.endswith("_gb_per_s")]
    names = ["multiply-adds, GFLOP/s", "one after the other, ns each", *(f"{c[:-9]}, GB/s" for c in caches)]
    values = [f"{peaks['fma_gflops']:.1f}", f"{peaks['fma_latency_ns']:.2f}", *(f"{peaks[c]:.0f}" for c in caches)]
    return f"{found['processor']}, one core:\n\n{table(names, [values])}\n\n{table(heading, rows(found))}"


def main() -> int:
    """Measure with the given options and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--turns", type=int, default=7, help="turns of each measurement; the best counts")
    parser.add_argument("--seconds", type=float, default=0.1, help="length of a turn")
    outputs(parser)
    given = parser.parse_args()
    found = study(given.turns, given.seconds)
    deliver(given, found, tables_of(found), BEGIN, END)
    return 0


if __name__ == "__main__":
    sys.exit(main())
