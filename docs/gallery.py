"""Draw docs/periodic-orbits.png: periodic orbits that gauss-radau15 closes with its default settings.

    python docs/gallery.py [--output docs/periodic-orbits.png] [--overwrite]

Prints for each how far the bodies are from where they began after one period: the starting values are published to
five digits (those of Suvakov & Dmitrasinovic), fourteen (the figure of eight) or more.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np

import kickdrift as kd
from kickdrift.plots.drawing import COLOURS, INK, checked_target, new_axes, new_figure, save_figure

POINTS = 2000  # of a line
# Starts of three equal masses at (-1, 0), (1, 0) and (0, 0), G = 1: velocity (p, q) of the first two, -2 (p, q) of the
# third; period. M. Suvakov & V. Dmitrasinovic, Phys. Rev. Lett. 110, 114301 (2013), doi:10.1103/PhysRevLett.110.114301
THREE_BODIES = {
    "butterfly I": (0.30689, 0.12551, 6.2356),
    "moth I": (0.46444, 0.39606, 14.8939),
    "yin-yang I": (0.51394, 0.30474, 17.3284),
    "goggles": (0.08330, 0.12789, 10.4668),
    "dragonfly": (0.08058, 0.58884, 21.2710),
}
PYTHAGOREAN_UNTIL = 62.0  # not periodic: by then the lightest body has left


class Panel(NamedTuple):
    """One orbit: (k, n, 3) positions, and how far the bodies end from where they began."""

    title: str
    paths: np.ndarray
    closure: float | None
    fixed: tuple[tuple[float, float, str], ...] = ()


def three_bodies(p: float, q: float) -> kd.System:
    """Suvakov & Dmitrasinovic's start."""
    v = np.array([p, q, 0.0])
    return kd.System([[-1.0, 0, 0], [1.0, 0, 0], [0, 0, 0]], [v, v, -2 * v], forces=[kd.Gravity()], units="nbody")


def of_system(title: str, system: kd.System, until: float, periodic: bool = True) -> Panel:
    """A run with gauss-radau15 at its default settings."""
    sim = kd.Simulation(system, "gauss-radau15")
    found: list[np.ndarray] = []
    sim.run(until=until, interval=until / POINTS, observe=lambda s: found.append(s.state.positions))
    start, end = system.state.positions, sim.state.positions
    return Panel(title, np.array(found), float(np.abs(end - start).max()) if periodic else None)


def arenstorf() -> Panel:
    """The restricted problem, in the axes that turn with Earth and Moon."""
    problem = kd.load("ode-arenstorf")
    period = problem.run.time
    sim = kd.Simulation(problem, "dop853", rtol=1e-13, atol=1e-13)
    found: list[np.ndarray] = []
    sim.run(until=period, interval=period / POINTS, observe=lambda s: found.append(s.state.y.copy()))
    paths = np.array(found)[:, None, :2]
    mu = problem.parameters["mu"]
    closure = float(np.abs(sim.state.y[:2] - np.array(problem.y0)[:2]).max())
    return Panel("Arenstorf, dop853", paths, closure, ((-mu, 0.0, "Earth"), (1 - mu, 0.0, "Moon")))


def panels() -> list[Panel]:
    """All orbits of the gallery."""
    kepler, eight, burrau = (kd.load(name) for name in ("kepler-e09", "figure-eight", "pythagorean"))
    return [
        of_system("Kepler, e = 0.9", kepler, kepler.invariants["period"]),
        of_system("figure of eight", eight, eight.invariants["period"]),
        arenstorf(),
        *(of_system(name, three_bodies(p, q), period) for name, (p, q, period) in THREE_BODIES.items()),
        of_system("Pythagorean, not periodic", burrau, PYTHAGOREAN_UNTIL, periodic=False),
    ]


def draw(found: list[Panel], target: Path) -> Path:
    """Three panels a row, each to scale."""
    figure = new_figure(8.2, 8.6)
    for k, panel in enumerate(found):
        axes = new_axes(figure, (3, 3, k + 1))
        for i in range(panel.paths.shape[1]):
            x, y = panel.paths[:, i, 0], panel.paths[:, i, 1]
            axes.plot(x, y, color=COLOURS[i], linewidth=0.9)
            axes.plot(x[:1], y[:1], "o", color=COLOURS[i], markersize=4)
        for x0, y0, name in panel.fixed:
            axes.plot([x0], [y0], "*", color=INK, markersize=7)
            axes.annotate(name, (x0, y0), (-8, 6), textcoords="offset points", fontsize=7.5, color=INK)
        low, high = panel.paths.min(axis=(0, 1))[:2], panel.paths.max(axis=(0, 1))[:2]
        middle, half = (low + high) / 2, 0.55 * float((high - low).max())
        axes.set_xlim(middle[0] - half, middle[0] + half)
        axes.set_ylim(middle[1] - half, middle[1] + half)
        axes.set_aspect("equal")
        axes.set_title(panel.title, fontsize=10.5, color=INK)
        axes.tick_params(labelsize=7)
    return save_figure(figure, target)


def main() -> int:
    """Draw the gallery and print how well each orbit closes."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "periodic-orbits.png")
    parser.add_argument("--overwrite", action="store_true")
    given = parser.parse_args()
    target = checked_target(given.output, given.overwrite)
    found = panels()
    for panel in found:
        print(f"{panel.title:27} {'' if panel.closure is None else f'closes to {panel.closure:.2g}'}")
    print(draw(found, target))
    return 0


if __name__ == "__main__":
    sys.exit(main())
