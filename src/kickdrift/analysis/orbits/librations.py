"""Resonant angles of mean motions that librate.

Two bodies with mean motions near p : q have the angles p lambda' - q lambda - j1 varpi' - j2 varpi - j3 Omega' - j4
Omega with j1 + j2 + j3 + j4 = p - q and j3 + j4 even (d'Alembert's rules; Murray & Dermott 1999, Solar System Dynamics,
section 6.7, doi:10.1017/CBO9781139174817). Primed quantities are those of the outer body. An angle librates if a part
of the circle stays empty while the angle crosses its centre again and again.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import product
from typing import NamedTuple

import numpy as np

from kickdrift.model.orbits import Orbits
from kickdrift.model.state import Floats
from kickdrift.statistics.quasi_periodic import frequencies

NEAR = 0.03  # largest distance of a period ratio from p / q, relative
MOST = 12  # largest p
EMPTY = math.radians(20)  # least empty part of the circle
CHANCE = 14.0  # -ln of the chance that so large a part stays empty at random
CROSSINGS = 4  # least ways from beyond half the amplitude on one side to beyond it on the other
SPARSE = 4.0  # least frames in a period of libration for the period to be known
FLAT = 1e-8  # an orbit with a smaller e has no pericentre, with a smaller sin(inc / 2) no node


class Resonance(NamedTuple):
    """A resonant angle that librates.

    ``p`` and ``q`` multiply the mean longitudes of ``outer`` and ``inner``. ``powers`` (j1, j2, j3, j4) multiply varpi
    and Omega of the outer body and of the inner body, in the order varpi', varpi, Omega', Omega. ``centre`` and
    ``amplitude`` are in radians; the amplitude is half the range of the angle. ``period`` is nan if the frames are too
    sparse.
    """

    inner: str
    outer: str
    p: int
    q: int
    powers: tuple[int, int, int, int]
    centre: float
    amplitude: float
    period: float

    @property
    def angle(self) -> str:
        """The angle in letters, such as "3 λ(Pluto) - 2 λ(Neptune) - ϖ(Pluto)"."""
        letters = (f"ϖ({self.outer})", f"ϖ({self.inner})", f"Ω({self.outer})", f"Ω({self.inner})")
        terms = [f"{_times(self.p)}λ({self.outer})", f"- {_times(self.q)}λ({self.inner})"]
        terms += [f"- {_times(j)}{name}" for j, name in zip(self.powers, letters, strict=True) if j]
        return " ".join(terms)


def _times(factor: int) -> str:
    return "" if factor == 1 else f"{factor} "


def powers(order: int) -> Iterator[tuple[int, int, int, int]]:
    """All j1 to j4 of an order that d'Alembert's rules allow; none is negative."""
    for j1, j2, j3, j4 in product(range(order + 1), repeat=4):
        if j1 + j2 + j3 + j4 == order and (j3 + j4) % 2 == 0:
            yield j1, j2, j3, j4


def librations(found: Orbits, masses: Floats, order: int) -> list[Resonance]:
    """Angles that librate in all pairs with a massive body, up to an order p - q; the smallest amplitude of each pair
    first."""
    at = found.elements
    motion = np.sqrt(found.mu / np.abs(at.a) ** 3).mean(axis=0)
    round_, level = at.e.max(axis=0) < FLAT, np.abs(np.sin(0.5 * at.inc)).max(axis=0) < FLAT
    resonances: list[Resonance] = []
    ranks = np.argsort(-motion)
    for i, j in ((i, j) for k, i in enumerate(ranks) for j in ranks[k + 1 :] if masses[i] or masses[j]):
        undefined = np.array([round_[j], round_[i], level[j], level[i]])
        kept: list[Resonance] = []
        for p, q in ratios(motion[i] / motion[j], order):
            for each in powers(p - q):
                if not np.any(undefined & (np.array(each) > 0)):
                    one = Resonance(found.names[i], found.names[j], p, q, each, math.nan, math.nan, math.nan)
                    if (swing := libration(angle_of(found, one), found.times)) is not None:
                        kept.append(one._replace(centre=swing[0], amplitude=swing[1], period=swing[2]))
        resonances += sorted(kept, key=lambda one: one.amplitude)
    return resonances


def angle_of(found: Orbits, one: Resonance) -> Floats:
    """The angle (k,) of a resonance, in radians, of any size."""
    at, j, i = found.elements, found.names.index(one.outer), found.names.index(one.inner)
    angle = np.zeros(len(found.times))
    for k, factor, of_pericentre, of_node in ((j, one.p, *one.powers[::2]), (i, -one.q, *one.powers[1::2])):
        varpi = at.Omega[:, k] + at.omega[:, k]
        angle += factor * (varpi + at.M[:, k]) - of_pericentre * varpi - of_node * at.Omega[:, k]
    return angle


def ratios(ratio: float, order: int) -> list[tuple[int, int]]:
    """Numbers p > q without a common factor, p - q up to ``order``, whose ratio is near a ratio of mean motions."""
    return [
        (p, p - k)
        for k in range(1, order + 1)
        for p in range(k + 1, MOST + 1)
        if math.gcd(p, k) == 1 and abs(ratio * (p - k) / p - 1.0) < NEAR
    ]


def libration(angle: Floats, times: Floats) -> tuple[float, float, float] | None:
    """Centre, amplitude and period of an angle (k,) in radians; None if the angle circulates or hardly moves."""
    ordered = np.sort(angle % (2.0 * math.pi))
    gaps = np.diff(ordered, append=ordered[0] + 2.0 * math.pi)
    widest = int(gaps.argmax())
    empty, others = float(gaps[widest]), np.delete(gaps, widest)
    least = 2.0 * math.pi * (math.log(len(angle)) + CHANCE) / len(angle)
    if empty < max(EMPTY, least) or others.max() > 0.5 * empty:
        return None
    centre = float(ordered[widest] + 0.5 * empty + math.pi) % (2.0 * math.pi)
    swing = (angle - centre + math.pi) % (2.0 * math.pi) - math.pi
    amplitude = math.pi - 0.5 * empty
    if np.count_nonzero(np.diff(np.sign(swing[np.abs(swing) > 0.5 * amplitude]))) < CROSSINGS:
        return None
    line = frequencies(swing - swing.mean(), times, 1).frequencies
    spacing = (times[-1] - times[0]) / (len(times) - 1)
    period = 2.0 * math.pi / abs(float(line[0])) if len(line) and line[0] else math.nan
    return centre, amplitude, period if period > SPARSE * spacing else math.nan
