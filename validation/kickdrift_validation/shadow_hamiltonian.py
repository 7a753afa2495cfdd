"""Does velocity Verlet conserve a modified Hamiltonian, and to which power of the step?

The pendulum let go at 2 rad, over 50 units of time: H oscillates by dt^2, H + dt^2 H2 by dt^4 and
H + dt^2 H2 + dt^4 H4 by dt^6 (Hairer, Lubich & Wanner 2006, IX.3; Skeel & Hardy 2001, 10.1137/S1064827599350204).
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import kickdrift as kd
from kickdrift.analysis.shadow import Potential, modified_hamiltonian
from kickdrift.model.state import Floats
from kickdrift.odes import pendulum
from kickdrift.plots.drawing import COLOURS, checked_target, new_axes, new_figure, save_figure
from kickdrift_validation.claim import Claim, claim, main

STEPS = (0.4, 0.2, 0.1, 0.05, 0.025)
LENGTH = 50.0
WITHIN = 0.15  # of the slope


def pendulum_potential(omega: float = 1.0) -> Potential:
    """V(q) = -omega^2 cos q and its first four derivatives, as in ``odes.pendulum``."""
    w = omega * omega
    return (
        lambda q: -w * np.cos(q),
        lambda q: w * np.sin(q),
        lambda q: w * np.cos(q),
        lambda q: -w * np.sin(q),
        lambda q: -w * np.cos(q),
    )


@dataclass(frozen=True)
class ShadowRun:
    """H and its modifications along a run of velocity Verlet.

    Attributes
    ----------
    dt : the step
    times : (k,)
    values : by order, 0, 2 and 4: difference from the value at the start, (k,)
    """

    dt: float
    times: Floats
    values: dict[int, Floats]

    def oscillation(self, order: int) -> float:
        """Half the range from the lowest to the highest value."""
        return float(np.ptp(self.values[order])) / 2


def shadow_run(problem: kd.Problem, potential: Potential, dt: float, length: float) -> ShadowRun:
    """Run velocity Verlet on a separable Problem of one degree of freedom. Record H, and H to second and to fourth
    order, at every step."""
    seen: list[tuple[float, float, float]] = []
    sim = kd.Simulation(problem, "velocity-verlet", dt=dt, compensated=True)  # plain sums would round by more than dt^6
    sim.run(round(length / dt), every=1, observe=lambda sim: seen.append((sim.time, *sim.state.y)))
    times, q, p = np.array(seen).T
    values = {order: modified_hamiltonian(q, p, dt, potential, order) for order in (0, 2, 4)}
    return ShadowRun(dt, times, {order: value - value[0] for order, value in values.items()})


def plot_shadow(
    run: ShadowRun, runs: Sequence[ShadowRun], output: str | os.PathLike[str], *, overwrite: bool = False
) -> Path:
    """Draw H and its modifications against time for one run, and their oscillations against the step for several runs.

    Return the figure's path."""
    target = checked_target(output, overwrite)
    names = {0: "H", 2: "H + dt² H$_2$", 4: "H + dt² H$_2$ + dt⁴ H$_4$"}
    figure = new_figure(11.2, 4.8)
    left, right = new_axes(figure, (1, 2, 1)), new_axes(figure, (1, 2, 2))
    for (order, name), colour in zip(names.items(), (COLOURS[1], COLOURS[5], COLOURS[0]), strict=True):
        left.plot(run.times, run.values[order], color=colour, linewidth=1.4, label=name)
        steps = [each.dt for each in runs]
        right.plot(
            steps, [each.oscillation(order) for each in runs], color=colour, marker="o", markersize=4, label=name
        )
    left.set_xlabel("time")
    left.set_ylabel("difference from the start")
    left.set_title(f"Velocity Verlet, dt = {run.dt:g}")
    left.legend(loc="best", fontsize=8, frameon=True, framealpha=0.9)
    right.set_xscale("log")
    right.set_yscale("log")
    right.set_xlabel("dt")
    right.xaxis.set_minor_formatter("")
    right.set_ylabel("oscillation")
    right.set_title("Slopes 2, 4 and 6")
    return save_figure(figure, target)


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
