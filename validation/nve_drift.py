"""Does a Lennard-Jones liquid at constant energy keep it, over 100,000 steps and ten starts?

    python validation/nve_drift.py [--steps 100000] [--seeds 10] [--truncation switch|force-shift] [--processes 2]

1000 particles, rho* = 0.8442, cut at 2.5 sigma smoothly, simple cubic start, brought to T* = 1.44 in 10 units of time,
then velocity Verlet at dt* = 0.005 without any thermostat. The verdict on the energy error is that of
`kickdrift.analysis.drift`, whose own error rate drift_statistics.py measures: at most one wrong verdict in twenty.
"""

from __future__ import annotations

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from time import perf_counter

import numpy as np
from claim import Claim, claim, show, where

import kickdrift as kd
from kickdrift.builders import lattice, maxwell_boltzmann
from kickdrift.report import Report

PARTICLES, DENSITY, CUTOFF, DT = 1000, 0.8442, 2.5, 0.005
TEMPERATURE, EQUILIBRATION_TIME = 1.44, 10.0
STEPS, SEEDS, SAMPLES = 100_000, 10, 1000
DRIFTS, MOMENTUM = 0.1, 1e-12  # bounds: share of secular drifts, momentum error


def one(seed: int, steps: int, truncation: str) -> Report:
    """The report of one run."""
    positions, edges = lattice("sc", PARTICLES, DENSITY)
    velocities = maxwell_boltzmann(np.ones(PARTICLES), TEMPERATURE, 1.0, seed)
    force = kd.LennardJones(cutoff=CUTOFF, truncation=truncation)
    system = kd.System(positions, velocities, box=edges, forces=[force], seed=seed)
    sim = kd.Simulation(system, integrator="velocity-verlet", dt=DT)
    sim.equilibrate(TEMPERATURE, EQUILIBRATION_TIME)
    return sim.run(steps, every=max(1, steps // SAMPLES))


def study(
    steps: int = STEPS, seeds: int = SEEDS, truncation: str = "switch", processes: int = 2, first: int = 1
) -> list[Claim]:
    """Run every seed, print a line for each, and judge them together."""
    print(f"{PARTICLES} particles, {truncation}, dt* = {DT}, {steps} steps; {where()}")
    print(f"{'seed':>4} {'T*':>6} {'rms error':>10} {'drift per time':>15} {'95 %':>9} {'momentum':>9}  verdict")
    began = perf_counter()
    work = partial(one, steps=steps, truncation=truncation)
    drifting, momentum = 0, 0.0
    # Processes of their own, since a seed has no use for a second thread; spawned, since threads do not survive a fork.
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        numbers = range(first, first + seeds)
        for seed, report in zip(numbers, pool.map(work, numbers), strict=True):
            energy = report.energy
            print(
                f"{seed:4} {report.temperature:6.3f} {energy.rms_relative_error:10.2e} "
                f"{energy.drift_per_unit_time:+15.2e} {energy.drift_error:9.1e} {report.momentum_error:9.1e}  "
                f"{energy.verdict}",
                flush=True,
            )
            drifting += energy.verdict == "secular drift"
            momentum = max(momentum, report.momentum_error)
    print(f"{perf_counter() - began:.0f} s")
    reference = f"conservation, {seeds} seeds of {steps} steps, {truncation}"
    at_most = max(1, int(DRIFTS * seeds))
    return [
        claim("runs with a secular energy drift", drifting, f"at most {at_most}", drifting <= at_most, reference),
        claim("largest momentum error", momentum, f"under {MOMENTUM:g}", momentum < MOMENTUM, reference),
    ]


def claims() -> list[Claim]:
    """The full study, with the switch."""
    return study()


def main() -> int:
    """Run with the given options and print the claims."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=STEPS)
    parser.add_argument("--seeds", type=int, default=SEEDS)
    parser.add_argument("--first", type=int, default=1, help="seed")
    parser.add_argument("--truncation", choices=("switch", "force-shift"), default="switch")
    parser.add_argument("--processes", type=int, default=2)
    given = parser.parse_args()
    return show(study(given.steps, given.seeds, given.truncation, given.processes, given.first))


if __name__ == "__main__":
    sys.exit(main())
