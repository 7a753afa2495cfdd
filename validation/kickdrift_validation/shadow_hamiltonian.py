"""Does velocity Verlet conserve a modified Hamiltonian, and to which power of the step?

The pendulum let go at 2 rad, over 50 units of time: H oscillates by dt^2, H + dt^2 H2 by dt^4 and
H + dt^2 H2 + dt^4 H4 by dt^6 (Hairer, Lubich & Wanner 2006, IX.3; Skeel & Hardy 2001, 10.1137/S1064827599350204).
"""

from pathlib import Path

import numpy as np

from kickdrift.analysis.shadow import pendulum_potential, shadow_run
from kickdrift.odes import pendulum
from kickdrift.plots.results import plot_shadow
from kickdrift_validation.claim import Claim, claim, main

STEPS = (0.4, 0.2, 0.1, 0.05, 0.025)
LENGTH = 50.0
WITHIN = 0.15  # of the slope


def claims(long: bool = False, figures: Path | None = None) -> list[Claim]:
    """The three slopes, and how much flatter the shadow is at dt = 0.1."""
    problem = pendulum()
    found = [shadow_run(problem, pendulum_potential(), dt, LENGTH) for dt in STEPS]
    if figures:
        drawn = next(run for run in found if run.dt == 0.2)
        plot_shadow(drawn, found, str(figures / "shadow_hamiltonian.png"), overwrite=True)
    print(f"pendulum, 2 rad, {LENGTH:g} units of time")
    print(f"{'dt':>6} {'H':>10} {'order 2':>10} {'order 4':>10}")
    for run in found:
        print(f"{run.dt:6g} " + " ".join(f"{run.oscillation(order):10.2e}" for order in (0, 2, 4)))
    rows = []
    for order in (0, 2, 4):
        sizes = [run.oscillation(order) for run in found]
        slope = float(np.polyfit(np.log([run.dt for run in found[1:]]), np.log(sizes[1:]), 1)[0])
        expected = order + 2
        text = f"slope of the oscillation of H{f' to order {order}' if order else ''}"
        rows.append(claim(text, slope, f"{expected} ± {WITHIN}", abs(slope - expected) <= WITHIN, "Hairer et al. IX.3"))
    run = next(run for run in found if run.dt == 0.1)
    ratio = run.oscillation(0) / run.oscillation(4)
    rows.append(claim("H over shadow, dt = 0.1", ratio, "over 1000", ratio > 1000, "the same"))
    return rows


if __name__ == "__main__":
    main(claims, __doc__)
