"""Errors of mixed precision: forces, energy over 20,000 steps, and momentum.

The liquid has 1000 particles (in the long set also 46^3), rho* = 0.8442, and a smooth cutoff at 2.5 sigma. It reaches
T* = 1.44 in 10 units of time. Velocity Verlet at dt* = 0.005 then runs once in float64 and once with
``precision="mixed"``. For the pairs, positions are rounded to float32 within the box, so the error of the forces grows
with the edge of the box. Both reports compute the energy in float64.
"""

import numpy as np

import kickdrift as kd
from kickdrift.forces.bound.forces import BoundForces
from kickdrift_validation.claim import Claim, claim, main
from kickdrift_validation.nve_drift import DT, liquid

STEPS, SAMPLES = 20_000, 500
SMALL, LARGE = 1000, 46**3
FORCE_ERROR = 1e-5  # bound: share of a typical force, for an edge of ten sigma
REFERENCE = "float64, from the same start"


def study(particles: int, steps: int) -> list[Claim]:
    sim = liquid(1, "switch", particles)
    state, edge = sim.state, sim.system.box.lengths[0]
    phase = np.array(state.phase)
    double, mixed = (BoundForces(sim.system, mixed=mixed).measure(0.0, phase) for mixed in (False, True))
    off, typical = mixed.accelerations - double.accelerations, np.sqrt((double.accelerations**2).mean())
    error = float(np.sqrt((off**2).mean()) / typical)
    energy = abs(mixed.potential - double.potential) / abs(double.potential)
    print(
        f"{particles} particles, edge {edge:.2f}: forces {error:.1e} of their root mean square off, {error / edge:.1e}"
    )
    print(f"  per sigma of the edge; the largest {np.abs(off).max() / typical:.1e}; the energy {energy:.1e}")
    reports = []
    for precision in ("double", "mixed"):
        run = kd.Simulation(sim.system, dt=DT, precision=precision)
        run.state = state
        report = run.run(steps, every=max(1, steps // SAMPLES))
        reports.append(report)
        drift = f"{report.energy.drift_per_unit_time:+.1e} ± {report.energy.drift_error:.1e} per unit of time"
        rms, verdict = report.energy.rms_relative_error, report.energy.verdict
        print(f"  {precision:6}: energy error {rms:.2e} RMS over {steps} steps, {drift}: {verdict}", flush=True)
    ratio = reports[1].energy.rms_relative_error / reports[0].energy.rms_relative_error
    bound = FORCE_ERROR * edge / 10
    name = f"mixed precision, {particles} particles"
    return [
        claim(f"{name}: RMS error of forces", error, f"at most {bound:.1e}", error <= bound, REFERENCE),
        claim(f"{name}: RMS energy error over float64's", ratio, "at most 1.5", ratio <= 1.5, REFERENCE),
        claim(
            f"{name}: verdict on the energy", reports[1].energy.verdict, "no secular drift",
            reports[1].energy.verdict != "secular drift", f"kickdrift.statistics.drift, {steps} steps",
        ),
        claim(
            f"{name}: momentum error", reports[1].momentum_error, "under 1e-12", reports[1].momentum_error < 1e-12,
            "conservation",
        ),
    ]  # fmt: skip


def claims(long: bool = False) -> list[Claim]:
    """The small liquid; in the long set also the large liquid."""
    found = study(SMALL, STEPS)
    return found + study(LARGE, STEPS // 10) if long else found


if __name__ == "__main__":
    main(claims, __doc__)
