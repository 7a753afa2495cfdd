"""What a second thread gives every force at 32,000 particles, from the chunks of steps on one thread.

    python -m docs.studies.two_threads [--only NAME …]

One thread runs all chunks and logs the time of each. ``scaling_model`` then gives them to two threads, with the delays
in docs/scaling.md. Medians of chunks hardly depend on other work, so the machine need not be idle.
"""

from __future__ import annotations

import argparse
from typing import Any

import kickdrift as kd
from docs.studies.scaling_model import Delays, log_of, predicted
from kickdrift_validation.claim import where
from kickdrift_validation.performance import published
from kickdrift_validation.performance.sizes import STARTS

DELAYS = Delays(master=110.0, awake=184.0, asleep=27_000.0, end=227.0)
SETTLE, LOGGED = 60, 60  # steps
MANY = [name for name in STARTS if name.endswith("many")]


def simulation(name: str) -> kd.Simulation:
    """Run on two threads of a row of `sizes`, or of a benchmark of LAMMPS."""
    if name in STARTS:
        start = STARTS[name]()
        return kd.Simulation(start.system, "velocity-verlet", start.dt, threads=2)
    benchmark = published.BENCHMARKS[name]
    lammps = published.Lammps(benchmark, "", (1.0, 1.0, 1.0))
    try:
        options: dict[str, Any] = dict(benchmark.options)
        return kd.Simulation(lammps.system(benchmark), dt=benchmark.dt, threads=2, **options)
    finally:
        lammps.close()


def main() -> None:
    """Measure, and print a row of the table for each system."""
    names = [*MANY, *published.BENCHMARKS]
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", nargs="+", choices=names, default=names)
    print(f"{where('numpy', 'lammps')}\n", flush=True)
    print("| system | a step, ms | serial | two threads over one |\n| --- | --- | --- | --- |", flush=True)
    for name in parser.parse_args().only:
        sim = simulation(name)
        sim.run(SETTLE, every=SETTLE)
        log = log_of(sim, LOGGED)
        share, gain = log.serial / log.whole, log.whole / predicted(log, 2, DELAYS)
        print(f"| {name.removesuffix(', many')} | {1e-6 * log.whole:.2f} | {share:.1%} | {gain:.2f} |", flush=True)


if __name__ == "__main__":
    main()
