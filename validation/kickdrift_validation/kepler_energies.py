"""The energy of a planet on a circular orbit over 1000 periods or 10,000, for five methods at the same step.

G M = 1, semi-major axis 1, dt = 0.01: a period is 628 steps. Forward Euler spirals out, RK4 in, each as the leading
power of dt in its energy error says, which is worked out here in rational numbers from the tableau; what a symplectic
method gets wrong stays as it is (Hairer, Lubich & Wanner 2006, IX.8, doi:10.1007/3-540-30666-8), but for rounding.
"""

import math
from fractions import Fraction
from pathlib import Path
from time import perf_counter
from typing import NamedTuple

import numpy as np

import kickdrift as kd
from kickdrift.integrators import integrator
from kickdrift.integrators.runge_kutta.method import Tableau
from kickdrift.odes import kepler
from kickdrift.plots.drawing import COLOURS, INK, new_axes, new_figure, save_figure
from kickdrift_validation.claim import Claim, at_most, claim, main

SHORT, LONG, DT = 1000, 10_000, 0.01
EVERY = 389  # steps between samples, the golden section of a period: they come at ever other places of the orbit
COMPENSATED = ", compensated"  # summation
METHODS = {
    "euler": "forward Euler",
    "symplectic-euler": "symplectic Euler",
    "velocity-verlet": "leapfrog",
    "rk4": "RK4",
    "yoshida6": "Yoshida 6",
    "yoshida6" + COMPENSATED: "Yoshida 6, compensated",
}
BOUNDED = 1.1  # largest error in the last tenth over that in the first
LAW = 1e-3  # how far RK4 may be from the leading term of its error; the next one is dt^2 of it
CIRCLE = 0.02  # how far forward Euler may be from a spiral that is a circle at any time; it grows eccentric slowly
WALKS = 3.0  # standard deviations of a random walk
TERMS = 8  # of the power series in dt
EPSILON = float(np.finfo(float).eps)
HAIRER = "Hairer, Lubich & Wanner 2006, IX.8"


class Energies(NamedTuple):
    """(k,) periods since the start, and the error of the energy over its size at the start."""

    periods: np.ndarray
    error: np.ndarray

    @property
    def largest(self) -> float:
        return float(np.abs(self.error).max())

    @property
    def growth(self) -> float:
        """The largest error in the last tenth of the run over that in the first."""
        parts = np.array_split(np.abs(self.error[1:]), 10)
        return float(parts[-1].max() / parts[0].max())

    @property
    def slope(self) -> float:
        """Slope of a line through the start, per period."""
        return float(self.periods @ self.error / (self.periods @ self.periods))

    @property
    def curvature(self) -> float:
        """How far the error leaves that line, at most, over where the line ends."""
        return float(np.abs(self.error - self.slope * self.periods).max() / abs(self.slope * self.periods[-1]))


def run(problem: kd.Problem, name: str, periods: float) -> Energies:
    """The energies of a run with a method of METHODS."""
    method = name.removesuffix(COMPENSATED)
    sim = kd.Simulation(problem, method, dt=DT, compensated=name != method)
    sim.run(round(periods * 2 * math.pi / DT), every=EVERY)
    total = np.array([sample.energies.total for sample in sim.record.samples])
    times = np.array([sample.time for sample in sim.record.samples])
    return Energies(times / (2 * math.pi), (total - total[0]) / abs(total[0]))


# --- the leading term, in rational numbers ---

Series = list[Fraction]  # coefficients of 1, dt, dt^2, …


def product(p: Series, q: Series) -> Series:
    return [sum((p[i] * q[n - i] for i in range(n + 1)), Fraction(0)) for n in range(TERMS)]


def power(p: Series, exponent: Fraction) -> Series:
    """p^exponent for a p that begins with 1, from q' p = exponent p' q."""
    q = [Fraction(1)]
    for n in range(1, TERMS):
        q.append(sum((exponent * k - (n - k)) * p[k] * q[n - k] for k in range(1, n + 1)) / n)
    return q


def slopes(y: list[Series]) -> list[Series]:
    r2 = [a + b for a, b in zip(product(y[0], y[0]), product(y[1], y[1]), strict=True)]
    pull = power(r2, Fraction(-3, 2))
    return [y[2], y[3], *([-c for c in product(x, pull)] for x in y[:2])]


def energy_of_a_step(tableau: Tableau) -> Series:
    """What one step from the circular orbit adds to the energy, as a power series in dt."""
    start = [[Fraction(value), *[Fraction(0)] * (TERMS - 1)] for value in (1, 0, 0, 1)]
    k: list[list[Series]] = []
    for row in ((), *tableau.a, tableau.b):
        weights = [Fraction(w).limit_denominator(1000) for w in row]
        y = [
            [start[i][0], *(sum((w * kj[i][n] for w, kj in zip(weights, k, strict=True)), Fraction(0))
                            for n in range(TERMS - 1))]
            for i in range(4)
        ]  # fmt: skip
        k.append(slopes(y))
    squares = [product(component, component) for component in y]
    r = power([a + b for a, b in zip(*squares[:2], strict=True)], Fraction(-1, 2))
    gained = [(a + b) / 2 - c for a, b, c in zip(*squares[2:], r, strict=True)]
    return [gained[0] + Fraction(1, 2), *gained[1:]]


def leading(method: str) -> tuple[int, Fraction]:
    """The first power of dt in the energy that a step adds, and its coefficient."""
    tableau = integrator(method)
    assert isinstance(tableau, Tableau)
    series = energy_of_a_step(tableau)
    exponent = next(n for n, c in enumerate(series) if c)
    return exponent, series[exponent]


def study(periods: float, figures: Path | None = None) -> list[Claim]:
    """Run every method, print a line for each, draw them, and judge."""
    problem = kepler(eccentricity=0.0)
    print(f"circular orbit, dt = {DT:g}, {periods:g} periods of {2 * math.pi / DT:.1f} steps\n")
    print(f"| {'method':21} | error at the end | largest   | last tenth / first | slope per period | seconds |")
    print(f"| {'---':21} | ---              | ---       | ---                | ---              | ---     |")
    found = {}
    for name in METHODS:
        began = perf_counter()
        found[name] = e = run(problem, name, periods)
        print(
            f"| {name:21} | {e.error[-1]:+16.3e} | {e.largest:9.3e} | {e.growth:18.4f} | {e.slope:+16.3e} | "
            f"{perf_counter() - began:7.1f} |",
            flush=True,
        )
    print()
    if figures:
        draw(found, figures / "kepler_energies.png")
    return judged(found, periods)


def euler_law(periods: np.ndarray | float) -> np.ndarray | float:
    """The energy error of forward Euler, an orbit that stays circular and gains c dt a^-4 a time: E = -1 / 2a, so
    a^3 = 1 + 6 c dt t."""
    exponent, c = leading("euler")
    assert exponent == 2
    return 1.0 - (1.0 + 6.0 * float(c) * DT * 2 * math.pi * periods) ** (-1 / 3)


def rk4_slope() -> float:
    """The energy error of RK4 per period: 2 pi / dt steps, over |E| = 1/2."""
    exponent, c = leading("rk4")
    return float(2 * c) * 2 * math.pi * DT ** (exponent - 1)


def judged(found: dict[str, Energies], periods: float) -> list[Claim]:
    rows = []
    for name in ("symplectic-euler", "velocity-verlet"):
        text = f"{name}: largest energy error of the last tenth over that of the first"
        rows.append(at_most(text, found[name].growth, BOUNDED, HAIRER))
    roundings = periods * 2 * math.pi / DT * integrator("yoshida6").evaluations
    walk = WALKS * EPSILON * math.sqrt(roundings)
    for name, share, what in (
        ("yoshida6", 1.0, "3 eps sqrt(n), a random walk of the roundings of x and v"),
        ("yoshida6" + COMPENSATED, DT, "dt of that: of what is added to x and v"),
    ):
        largest, bound = found[name].largest, share * walk
        text = f"{name}: largest relative energy error"
        rows.append(claim(text, largest, f"at most {bound:.2g}", largest <= bound, f"{what}, n = {roundings:.3g}"))
    rk4, slope = found["rk4"], rk4_slope()
    off = abs(rk4.slope / slope - 1)
    exponent, c = leading("rk4")
    reference = f"{slope:.4e} = 4 pi c dt^{exponent - 1}, c = {c} of the tableau, exact"
    rows.append(at_most(f"rk4: slope {rk4.slope:.4e} per period, off by", off, LAW, reference))
    rows.append(at_most("rk4: farthest from that straight line, over its end", rk4.curvature, LAW, "linear growth"))
    axis, law = (1.0 / (1.0 - float(error)) for error in (found["euler"].error[-1], euler_law(periods)))
    reference = f"{law:.4g} = (1 + 6 dt t)^(1/3), its leading term on a circle"
    rows.append(at_most(f"euler: the orbit's axis grew to {axis:.4g}, off by", abs(axis / law - 1), CIRCLE, reference))
    return rows


def draw(found: dict[str, Energies], target: Path) -> Path:
    """The largest error so far against time, both on logarithmic axes, and the two laws."""
    figure = new_figure(9.0, 5.8)
    axes = new_axes(figure, (1, 1, 1))
    colours = dict(zip(METHODS, (COLOURS[1], COLOURS[5], COLOURS[0], COLOURS[3], COLOURS[2], COLOURS[2]), strict=True))
    for name, e in found.items():
        periods, errors = e.periods[1:], np.maximum.accumulate(np.abs(e.error[1:]))
        periods, errors = periods[errors > 0.0], errors[errors > 0.0]
        style = (0, (5, 2)) if name.endswith(COMPENSATED) else "-"
        axes.plot(periods, errors, color=colours[name], linewidth=1.8, linestyle=style)
        axes.annotate(
            METHODS[name], (periods[-1], errors[-1]), (6, 0), textcoords="offset points", va="center", fontsize=9.5,
            color=colours[name],
        )  # fmt: skip
    t = found["rk4"].periods[1:]
    for law in (abs(rk4_slope()) * t, euler_law(t)):
        axes.plot(t, law, color=INK, linewidth=0.9, linestyle=(0, (1, 2)), zorder=4)
    axes.plot([], [], color=INK, linewidth=0.9, linestyle=(0, (1, 2)), label="leading term of the method, no fit")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlim(t[0], t[-1])
    axes.set_yticks([10.0**k for k in range(-16, 1, 2)])
    axes.set_xlabel("orbital periods")
    axes.set_ylabel("relative energy error |ΔE / E$_0$|, largest so far")
    axes.set_title(
        f"Kepler's problem, G M = a = 1, e = 0, dt = {DT:g}: {2 * math.pi / DT:.0f} steps a period", color=INK
    )
    axes.legend(loc="lower right", fontsize=8, frameon=False)
    return save_figure(figure, target)


def claims(long: bool = False, figures: Path | None = None) -> list[Claim]:
    """Claims on all periods if ``long``, else on a tenth of them."""
    return study(LONG if long else SHORT, figures)


if __name__ == "__main__":
    main(claims, __doc__)
