"""Warnings about effects that the Wisdom-Holman map does not follow."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from kickdrift.model.state import Floats
from kickdrift.text import measured

if TYPE_CHECKING:
    from kickdrift.model.system import System

STEPS_PER_PERIOD = 20  # least steps in a pericentre passage (Wisdom 2015; Rein & Tamayo 2015)


def passages_and_hill(
    x: Floats, v: Floats, gm: Floats, source: Floats, central: Floats | float
) -> tuple[Floats, Floats]:
    """Durations of pericentre passages and squared Hill radii for bodies at x and v (3, …).

    A passage takes 2 pi q / v, as on a circle; it is infinite if the pericentre is past for ever. gm belongs to the
    Kepler motion, and ``source`` and ``central`` are G times the masses of the body and of the central one.
    """
    r, h2 = np.sqrt((x * x).sum(axis=0)), (np.cross(x, v, axis=0) ** 2).sum(axis=0)
    energy, outward = 0.5 * (v * v).sum(axis=0) - gm / r, (x * v).sum(axis=0)
    e = np.sqrt(np.maximum(0.0, 1.0 + 2.0 * energy * h2 / gm**2))
    q = h2 / (gm * (1.0 + e))
    passage = 2.0 * math.pi * np.sqrt(q**3 / (gm * (1.0 + e)))
    bound = energy < 0.0
    far = np.where(bound, -0.5 * gm / np.where(bound, energy, -1.0), r)
    hill = far * (source / (3.0 * central)) ** (1 / 3)
    return np.where(bound | (outward < 0.0), passage, np.inf), hill * hill


def warning_lines(
    system: System,
    dt: float,
    least: float,
    shortest: tuple[float, int] | None,
    unbound: Iterable[tuple[int, float]],
    near: Iterable[tuple[int, int, float]],
) -> list[str]:
    """Warnings about effects that the map does not follow.

    ``shortest`` is the shortest passage and its body, ``least`` the time between two kicks, ``unbound`` the first
    unbound bodies with their times, ``near`` the first near pairs with their times.
    """
    unit = measured("", system.units.symbol("time"))
    found = []
    if shortest is not None and least > shortest[0] / STEPS_PER_PERIOD:
        passage, i = shortest
        found.append(
            f"dt = {dt:g}{unit} is long: {system.body(i)} passes its pericentre as on a circle of period "
            f"{passage:.4g}{unit}, in {passage / least:.3g} kicks; {STEPS_PER_PERIOD} or more resolve it"
        )
    found += [
        f"{system.body(i)} is on a hyperbola from t = {time:.6g}{unit} on: the map is for bound orbits; "
        "use gauss-radau15"
        for i, time in unbound
    ]
    pairs: dict[tuple[int, int], float] = {}
    for i, j, time in near:
        pair = (min(i, j), max(i, j))
        pairs[pair] = min(time, pairs.get(pair, np.inf))
    for (i, j), time in pairs.items():
        found.append(
            f"{system.body(i)} and {system.body(j)} come within the Hill radius at t = {time:.6g}{unit}: the map "
            "does not follow close encounters; use gauss-radau15"
        )
    return found
