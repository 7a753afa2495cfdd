"""Peaks of one core of this machine: fused multiply-adds a second, and bytes a second from each cache.

    python -m docs.studies.peaks [--turns 7] [--seconds 0.05]

The script uses kickdrift's own eight-lane vectors, so kernels could reach these peaks. It runs ten independent chains
of multiply-adds, and one chain alone. The time of an operation in one chain is the latency for which a step of a few
bodies often waits. Sums over arrays show the rates of memory. The arrays fit in half of the first, second and third
cache, and one array has 256 MiB. Caches of unknown size count as 48 KiB, 2 MiB and 32 MiB. Each peak is the best turn,
in processor time. Prints JSON.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from pathlib import Path
from time import process_time

from kickdrift.analysis.compare.bench import processor
from kickdrift.jit.compile import jit
from kickdrift.jit.lanes.functions import lane_sum, multiply_add, splat
from kickdrift.jit.lanes.memory import aligned, load
from kickdrift.jit.lanes.vectors import WIDTH

CACHES = Path("/sys/devices/system/cpu/cpu0/cache")
GUESSED = {"L1": 48 << 10, "L2": 2 << 20, "L3": 32 << 20}
MEMORY = 256 << 20
CHAINS, UNROLLED = 10, 4


@jit
def many_chains(rounds, start):
    """Ten multiply-adds a round that do not wait for each other: two units with four cycles of latency need eight."""
    b, c = splat(0.999), splat(0.001)
    v0, v1, v2, v3, v4 = splat(start), splat(start + 1), splat(start + 2), splat(start + 3), splat(start + 4)
    v5, v6, v7, v8, v9 = splat(start + 5), splat(start + 6), splat(start + 7), splat(start + 8), splat(start + 9)
    for _ in range(rounds):
        v0, v1, v2 = multiply_add(v0, b, c), multiply_add(v1, b, c), multiply_add(v2, b, c)
        v3, v4, v5 = multiply_add(v3, b, c), multiply_add(v4, b, c), multiply_add(v5, b, c)
        v6, v7 = multiply_add(v6, b, c), multiply_add(v7, b, c)
        v8, v9 = multiply_add(v8, b, c), multiply_add(v9, b, c)
    return lane_sum(v0 + v1 + v2 + v3 + v4 + v5 + v6 + v7 + v8 + v9)


@jit
def one_chain(rounds, start):
    """Four multiply-adds a round, each of which takes the previous result."""
    value, b, c = splat(start), splat(0.999), splat(0.001)
    for _ in range(rounds):
        value = multiply_add(multiply_add(value, b, c), b, c)
        value = multiply_add(multiply_add(value, b, c), b, c)
    return lane_sum(value)


@jit
def read(array, rounds):
    """Sum of the array, this many times."""
    v0, v1, v2, v3 = splat(0.0), splat(0.0), splat(0.0), splat(0.0)
    v4, v5, v6, v7 = splat(0.0), splat(0.0), splat(0.0), splat(0.0)
    for _ in range(rounds):
        for i in range(0, array.size, 8 * WIDTH):
            v0, v1 = v0 + load(array, i), v1 + load(array, i + WIDTH)
            v2, v3 = v2 + load(array, i + 2 * WIDTH), v3 + load(array, i + 3 * WIDTH)
            v4, v5 = v4 + load(array, i + 4 * WIDTH), v5 + load(array, i + 5 * WIDTH)
            v6, v7 = v6 + load(array, i + 6 * WIDTH), v7 + load(array, i + 7 * WIDTH)
    return lane_sum(v0 + v1 + v2 + v3 + v4 + v5 + v6 + v7)


def per_second(work: Callable[[int], object], turns: int, seconds: float) -> float:
    """Rounds of ``work(rounds)`` a second, the best of the turns of about this length."""
    work(1)  # compiles
    rounds = 1
    while True:
        began = process_time()
        work(rounds)
        took = process_time() - began
        if took > 0.2 * seconds:
            break
        rounds *= 4
    rounds = max(1, int(rounds * seconds / took))
    best = 0.0
    for _ in range(turns):
        began = process_time()
        work(rounds)
        best = max(best, rounds / (process_time() - began))
    return best


def caches() -> dict[str, int]:
    """Sizes of the data caches in bytes, as Linux tells them."""
    found = dict(GUESSED)
    for folder in sorted(CACHES.glob("index*")):
        level, kind, size = ((folder / name).read_text().strip() for name in ("level", "type", "size"))
        if kind != "Instruction" and size.endswith("K"):
            found[f"L{level}"] = int(size[:-1]) << 10
    return found


def measure(turns: int = 7, seconds: float = 0.05) -> dict[str, float]:
    """GFLOP/s (a multiply-add counts twice), nanoseconds of one multiply-add in a chain, and GB/s from each memory."""
    peaks = {
        "fma_gflops": 1e-9 * 2 * WIDTH * CHAINS * per_second(lambda rounds: many_chains(rounds, 1.0), turns, seconds),
        "fma_latency_ns": 1e9 / (UNROLLED * per_second(lambda rounds: one_chain(rounds, 1.0), turns, seconds)),
    }
    sizes = {name: size // 2 for name, size in caches().items()} | {"memory": MEMORY}
    for name, size in sizes.items():
        array = aligned((size // 8 // (8 * WIDTH) * 8 * WIDTH,), 1.0)
        rate = per_second(lambda rounds, array=array: read(array, rounds), turns, seconds)  # type: ignore[misc]
        peaks[f"{name}_gb_per_s"] = 1e-9 * array.nbytes * rate
    return peaks


def main() -> int:
    """Measure with the given options and print JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--turns", type=int, default=7, help="turns of each measurement; the best counts")
    parser.add_argument("--seconds", type=float, default=0.05, help="length of a turn")
    given = parser.parse_args()
    print(json.dumps({"processor": processor(), **measure(given.turns, given.seconds)}, indent=2))
    return 0


if __name__ == "__main__":
    sys.exit(main())
