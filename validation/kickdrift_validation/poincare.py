"""Poincaré sections of the planar restricted three-body problem at the Jacobi constant 3.07, mass ratio 1e-3.

Murray & Dermott (1999, Solar System Dynamics, sections 9.3 and 9.4) start a particle on the line of the two masses,
without radial velocity in the turning frame. From x = 0.55 its motion is regular, near the 7:4 resonance with the
planet: its section has 3 islands, one for each unit of the resonance's order. From x = 0.56 it is chaotic.

    python -m kickdrift_validation.poincare --figures docs     (draws poincare.png)
"""

import math
from pathlib import Path

import numpy as np

import kickdrift as kd
from kickdrift_validation.claim import Claim, at_least, at_most, claim, main

RATIO, JACOBI = 1e-3, 3.07
BOOK = "Murray & Dermott 1999, sections 9.3 and 9.4"
ISLANDS = 3
DRIFT = 1e-11  # of the Jacobi constant


def start(x: float) -> kd.System:
    """Two masses on circles, and a particle on their line, at rest along it in the turning frame."""
    potential = (1 - RATIO) / abs(x + RATIO) + RATIO / abs(x - 1 + RATIO)
    speed = math.sqrt(x * x + 2 * potential - JACOBI)
    places = [[-RATIO, 0, 0], [1 - RATIO, 0, 0], [x, 0, 0]]
    velocities = [[0, -RATIO, 0], [0, 1 - RATIO, 0], [0, speed + x, 0]]
    return kd.System(places, velocities, [1 - RATIO, RATIO, 0.0], forces=[kd.Gravity()], units="nbody")


def turning(x: np.ndarray, v: np.ndarray) -> tuple[float, float, float, float]:
    """x, y and their rates in the turning frame."""
    (c, s, _), (place, speed) = x[1] - x[0], (x[2], v[2])
    along, across = place[0] * c + place[1] * s, place[1] * c - place[0] * s
    return along, across, speed[0] * c + speed[1] * s + across, speed[1] * c - speed[0] * s - along


def section(x: float, turns: int) -> kd.analysis.Section:
    """Crossings of y = 0 with rising y: x, its rate, and the Jacobi constant."""

    def seen(t: float, x: np.ndarray, v: np.ndarray) -> tuple[float, float, float]:
        a, b, u, w = turning(x, v)
        r1, r2 = math.hypot(a + RATIO, b), math.hypot(a - 1 + RATIO, b)
        return a, u, a * a + b * b + 2 * ((1 - RATIO) / r1 + RATIO / r2) - u * u - w * w

    return kd.analysis.poincare_section(
        start(x), lambda t, x, v: turning(x, v)[1], seen, until=2 * math.pi * turns, integrator="gauss-radau15",
        names=("x", "rate of x", "Jacobi constant"),
    )  # fmt: skip


def apart(points: np.ndarray, count: int) -> float:
    """Least distance of the means of every count-th point, over the widest of these groups."""
    groups = [points[k::count] for k in range(count)]
    means = [group.mean(axis=0) for group in groups]
    widest = max(np.linalg.norm(group - mean, axis=1).max() for group, mean in zip(groups, means, strict=True))
    gaps = [np.linalg.norm(a - b) for k, a in enumerate(means) for b in means[:k]]
    return float(min(gaps) / widest)


def claims(long: bool = False, figures: Path | None = None) -> list[Claim]:
    """The islands, their number, the chaotic motion beside them, and the Jacobi constant."""
    turns = 600 if long else 150
    regular, chaotic = section(0.55, turns), section(0.56, turns)
    if figures is not None:
        draw(regular, chaotic, figures / "poincare.png")
    points, others = regular.values[:, :2], chaotic.values[:, :2]
    text = f"mass ratio {RATIO:g}, Jacobi constant {JACOBI:g}, {turns} turns"
    found = [count for count in range(2, 8) if apart(points, count) > 1.0]
    drift = max(float(np.abs(each.values[:, 2] / JACOBI - 1).max()) for each in (regular, chaotic))
    return [
        claim(f"{text}, from x = 0.55: islands", found[0] if found else 0, str(ISLANDS),
              bool(found) and found[0] == ISLANDS, BOOK),
        at_least(f"{text}, from x = 0.55: distance of the islands over their size", apart(points, ISLANDS), 1.0, BOOK),
        at_most(f"{text}, from x = 0.56: the same, of every third point", apart(others, ISLANDS), 0.5, BOOK),
        at_most(f"{text}: largest relative error of the Jacobi constant at {len(points) + len(others)} crossings",
                drift, DRIFT, "the start"),
    ]  # fmt: skip


def draw(regular: kd.analysis.Section, chaotic: kd.analysis.Section, path: Path) -> None:
    """The two sections in one figure."""
    from kickdrift.plots.drawing import COLOURS, new_axes, new_figure, save_figure

    figure = new_figure(5.4, 4.0)
    axes = new_axes(figure, (1, 1, 1))
    for each, label, colour in ((chaotic, "x = 0.56", COLOURS[1]), (regular, "x = 0.55", COLOURS[0])):
        axes.plot(*each.values[:, :2].T, ".", ms=2.5, color=colour, label=label)
    axes.set_xlabel("x")
    axes.set_ylabel("rate of x")
    axes.legend(markerscale=3, frameon=False)
    save_figure(figure, path)


if __name__ == "__main__":
    main(claims, __doc__)
