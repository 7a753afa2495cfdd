"""Does velocity Verlet conserve a modified Hamiltonian, and to which power of the step?

The pendulum let go at 2 rad, over 50 units of time: H oscillates by dt^2, H + dt^2 H2 by dt^4 and
H + dt^2 H2 + dt^4 H4 by dt^6 (Hairer, Lubich & Wanner 2006, IX.3; Skeel & Hardy 2001, 10.1137/S1064827599350204).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from kickdrift.errors import InputError
from kickdrift.model.problem import Problem
from kickdrift.model.state import Floats
from kickdrift.odes import pendulum
from kickdrift.plots import drawing as draw
from kickdrift.run.simulation import Simulation
from kickdrift_validation.claim import Claim, claim, main

STEPS = (0.4, 0.2, 0.1, 0.05, 0.025)
LENGTH = 50.0
WITHIN = 0.15  # of the slope

Potential = Sequence[Callable[[Any], Any]]


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


def modified_hamiltonian(q: Any, p: Any, dt: float, potential: Potential, order: int = 4) -> Any:
    """H + dt^2 H2 + dt^4 H4 of velocity Verlet (kick, drift, kick) for H = p^2 / 2 + V(q), one degree of freedom.

        H2 = p^2 V'' / 12 - V'^2 / 24
        H4 = -p^4 V'''' / 720 + p^2 V' V''' / 120 + p^2 V''^2 / 60 - V'^2 V'' / 240

    The method is exp(dt B / 2) exp(dt A) exp(dt B / 2), with the flows A of p^2 / 2 and B of V. The symmetric formula
    of Baker, Campbell and Hausdorff gives its logarithm as nested commutators, which are Poisson brackets of the two:
    third-degree brackets in dt^2, fifth-degree brackets in dt^4. Since the kinetic energy is quadratic, four terms
    remain in dt^4. The result oscillates by dt^6, while H oscillates by dt^2.

    Parameters
    ----------
    q, p : numbers or arrays, the position and the velocity of a unit mass
    dt : the step
    potential : V and its derivatives, four for ``order`` 4 and two for 2
    order : 0 (H itself), 2 or 4

    Source: Hairer, Lubich & Wanner 2006, IX.3 and III.4, doi:10.1007/3-540-30666-8; Skeel & Hardy 2001,
    doi:10.1137/S1064827599350204.
    """
    if order not in (0, 2, 4):
        raise InputError(f"order of the modified Hamiltonian: expected 0, 2 or 4, got {order!r}")
    if len(potential) < order + 1:
        raise InputError(f"potential: order {order} needs V and {order} derivatives, got {len(potential)} functions")
    v = [derivative(q) for derivative in potential[: order + 1]]
    total = 0.5 * p**2 + v[0]
    if order >= 2:
        total = total + dt**2 * (p**2 * v[2] / 12 - v[1] ** 2 / 24)
    if order >= 4:
        total = total + dt**4 * (
            -(p**4) * v[4] / 720 + p**2 * v[1] * v[3] / 120 + p**2 * v[2] ** 2 / 60 - v[1] ** 2 * v[2] / 240
        )
    return total


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


def shadow_run(problem: Problem, potential: Potential, dt: float, length: float) -> ShadowRun:
    """Run velocity Verlet on a separable Problem of one degree of freedom. Record H, and H to second and to fourth
    order, at every step."""
    if not (problem.separable and len(problem) == 2):
        raise InputError(
            f"{problem.name}: the modified Hamiltonian needs a separable problem with one degree of freedom"
        )
    seen: list[tuple[float, float, float]] = []
    sim = Simulation(problem, "velocity-verlet", dt=dt, compensated=True)  # plain sums would round by more than dt^6
    sim.run(round(length / dt), every=1, observe=lambda sim: seen.append((sim.time, *sim.state.y)))
    times, q, p = np.array(seen).T
    values = {order: modified_hamiltonian(q, p, dt, potential, order) for order in (0, 2, 4)}
    return ShadowRun(dt, times, {order: value - value[0] for order, value in values.items()})


def plot_shadow(run: ShadowRun, runs: Sequence[ShadowRun], output: Path, *, overwrite: bool = False) -> Path:
    """Draw H and its modifications against time for one run, and their oscillations against the step for several runs.

    Return the figure's path."""
    target = draw.checked_target(output, overwrite)
    names = {0: "H", 2: "H + dt² H$_2$", 4: "H + dt² H$_2$ + dt⁴ H$_4$"}
    figure = draw.new_figure(11.2, 4.8)
    left, right = draw.new_axes(figure, (1, 2, 1)), draw.new_axes(figure, (1, 2, 2))
    for (order, name), colour in zip(names.items(), (draw.COLOURS[1], draw.COLOURS[5], draw.COLOURS[0]), strict=True):
        left.plot(run.times, run.values[order], color=colour, linewidth=1.4, label=name)
        steps = [each.dt for each in runs]
        right.plot(
            steps, [each.oscillation(order) for each in runs], color=colour, marker="o", markersize=4, label=name
        )
    left.set(xlabel="time", ylabel="difference from the start", title=f"Velocity Verlet, dt = {run.dt:g}")
    left.legend(loc="best", fontsize=8, frameon=True, framealpha=0.9)
    right.set(xscale="log", yscale="log", xlabel="dt")
    right.xaxis.set_minor_formatter("")
    right.set(ylabel="oscillation", title="Slopes 2, 4 and 6")
    return draw.save_figure(figure, target)


def claims(long: bool = False, figures: Path | None = None) -> list[Claim]:
    """The three slopes, and how much flatter the shadow is at dt = 0.1."""
    problem = pendulum()
    found = [shadow_run(problem, pendulum_potential(), dt, LENGTH) for dt in STEPS]
    if figures:
        drawn = next(run for run in found if run.dt == 0.2)
        plot_shadow(drawn, found, figures / "shadow_hamiltonian.png", overwrite=True)
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
