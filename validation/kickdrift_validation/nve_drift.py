"""Does a Lennard-Jones liquid at constant energy keep it, over 20,000 steps and three starts, or 100,000 and ten?

1000 particles, rho* = 0.8442, cut at 2.5 sigma smoothly, simple cubic start, brought to T* = 1.44 in 10 units of time,
then velocity Verlet at dt* = 0.005 without any thermostat. The verdict on the energy error is that of
`kickdrift.statistics.drift`, whose own error rate drift_statistics.py measures: at most one wrong verdict in twenty.
"""

from time import perf_counter

import numpy as np

import kickdrift as kd
from kickdrift.model.starts.builders import lattice, maxwell_boltzmann
from kickdrift_validation.claim import Claim, claim, largest, main

PARTICLES, DENSITY, CUTOFF, DT = 1000, 0.8442, 2.5, 0.005
TEMPERATURE, EQUILIBRATION_TIME = 1.44, 10.0
SHORT, LONG, SAMPLES = (20_000, 3), (100_000, 10), 1000  # steps, seeds
DRIFTS, MOMENTUM = 0.1, 1e-12  # bounds: share of secular drifts, momentum error


def liquid(seed: int, truncation: str, particles: int = PARTICLES) -> kd.Simulation:
    """The liquid at its temperature."""
    positions, edges = lattice("sc", particles, DENSITY)
    velocities = maxwell_boltzmann(np.ones(particles), TEMPERATURE, 1.0, seed)
    force = kd.LennardJones(cutoff=CUTOFF, truncation=truncation)
    system = kd.System(positions, velocities, box=edges, forces=[force], seed=seed)
    sim = kd.Simulation(system, integrator="velocity-verlet", dt=DT)
    sim.equilibrate(TEMPERATURE, EQUILIBRATION_TIME)
    return sim


def study(steps: int, seeds: int, truncation: str) -> list[Claim]:
    """Run every seed, print a line for each, and judge them together."""
    print(f"{PARTICLES} particles, {truncation}, dt* = {DT}, {steps} steps")
    print(f"{'seed':>4} {'T*':>6} {'rms error':>10} {'drift per time':>15} {'95 %':>9} {'momentum':>9}  verdict")
    began = perf_counter()
    drifting, momentum = 0, 0.0
    for seed in range(1, seeds + 1):
        report = liquid(seed, truncation).run(steps, every=max(1, steps // SAMPLES))
        energy = report.energy
        print(
            f"{seed:4} {report.temperature:6.3f} {energy.rms_relative_error:10.2e} "
            f"{energy.drift_per_unit_time:+15.2e} {energy.drift_error:9.1e} {report.momentum_error:9.1e}  "
            f"{energy.verdict}",
            flush=True,
        )
        drifting += energy.verdict == "secular drift"
        momentum = largest(momentum, report.momentum_error)
    print(f"{perf_counter() - began:.0f} s")
    reference = f"conservation, {seeds} seeds of {steps} steps, {truncation}"
    at_most = int(DRIFTS * seeds)
    return [
        claim("runs with a secular energy drift", drifting, f"at most {at_most}", drifting <= at_most, reference),
        claim("largest momentum error", momentum, f"under {MOMENTUM:g}", momentum < MOMENTUM, reference),
    ]


def claims(long: bool = False) -> list[Claim]:
    """Claims on the switch, and in the long set on the force shift too."""
    if not long:
        return study(*SHORT, "switch")
    return [row for truncation in ("switch", "force-shift") for row in study(*LONG, truncation)]


if __name__ == "__main__":
    main(claims, __doc__)
