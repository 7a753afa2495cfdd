"""Errors of Ewald's sum, and its parameters for a wanted error.

The formulas are those of Kolafa & Perram (1992, doi:10.1080/08927029208049126) for charges at random places: the
root-mean-square error of the forces by a cutoff in space, and by a limit of the wave numbers.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from hashlib import blake2b
from typing import NamedTuple

import numpy as np

from kickdrift.model.state import Floats

PAIR, WAVE = 6.0, 0.42  # nanoseconds of a near pair within the cutoff, and of one particle with one wave
TYPICAL = 0.5  # typical force, over that of two charges of mean square (V / n)^(1/3) apart; molten salt has 0.76
TRIED = 48  # cutoffs between the shortest and the longest
SHARE = 0.5  # of the wanted error for each of the two parts; errors of some systems are a little above the predicted
THIN, MARGIN = 1e-6, 0.05  # accuracy below which the neglected charges lie in a thin shell; see `share_of`
LEAST, MOST = 1e-13, 0.5  # limits of an accuracy
FEW, EVEN = 64, 1.25  # charges below which a density counts as even, and the most crowding that does
KEPT = 100  # crowdings of the last places; a System asks for its own many times, and a large one takes a second
_known: dict[bytes, float] = {}  # by a digest of the places


class Charged(NamedTuple):
    """What the errors depend on: number of charges, volume, the sums of squares and of fourth powers of the charges
    (energy times length, and its square), and the crowding, see `crowding_of`."""

    charges: int
    volume: float
    squares: float
    fourths: float
    crowding: float = 1.0

    @classmethod
    def of(cls, charges: Floats, volume: float, fractions: Floats) -> Charged:
        """The Charged with these charges (n,), scaled by the root of Coulomb's constant, at fractional coordinates (n,
        3)."""
        count, sums = int(np.count_nonzero(charges)), (float(charges @ charges), float((charges**4).sum()))
        return cls(max(count, 1), volume, *sums, crowding_of(fractions[charges != 0]))

    @property
    def unit(self) -> float:
        """The typical force, to which errors are relative."""
        return TYPICAL * self.squares / self.charges * (self.charges / self.volume) ** (2.0 / 3.0)

    def near_error(self, alpha: float, cutoff: float) -> float:
        """Root-mean-square error of a force by the cutoff, over the unit."""
        error = 2.0 * self.squares * math.sqrt(self.crowding / (self.charges * cutoff * self.volume))
        return error * math.exp(-((alpha * cutoff) ** 2)) / self.unit

    def far_error(self, alpha: float, waves: float) -> float:
        """Root-mean-square error of a force by the limit of wave numbers, over the unit."""
        error = 2.0 * self.squares * alpha * math.sqrt(2.0 / (waves * self.charges * self.volume))
        return error * math.exp(-((0.5 * waves / alpha) ** 2)) / self.unit


def crowding_of(fractions: Floats) -> float:
    """Mean density at the place of a charge, over that of the box, for charges at fractional coordinates (n, 3).

    A cutoff neglects more charges where more are near. The density along each axis is a sum of waves that are longer
    than two distances between charges. An even density has 1, also a crystal's or a liquid's.
    """
    if len(fractions) < FEW:
        return 1.0
    key = blake2b(fractions.tobytes()).digest()
    if key not in _known:
        if len(_known) == KEPT:
            _known.clear()
        _known[key] = _crowding(fractions)
    return _known[key]


def _crowding(fractions: Floats) -> float:
    n, found = len(fractions), 1.0
    for axis in range(3):
        for wave in range(1, math.ceil(0.5 * n ** (1.0 / 3.0) - 1e-9)):
            angles = 2.0 * math.pi * wave * fractions[:, axis]
            square = float(np.cos(angles).sum() ** 2 + np.sin(angles).sum() ** 2)
            found += 2.0 * max(square - n, 0.0) / n**2
    return found if found > EVEN else 1.0


class Split(NamedTuple):
    """Parameters of Ewald's sum: splitting parameter, cutoff, and largest wave number, or a mesh and the order of its
    splines."""

    alpha: float
    cutoff: float
    waves: float
    mesh: tuple[int, ...] = ()
    order: int = 0

    def error(self, charged: Charged) -> float:
        """Predicted error of the forces without a mesh, relative to ``charged.unit``."""
        return math.hypot(charged.near_error(self.alpha, self.cutoff), charged.far_error(self.alpha, self.waves))


def rising(function: Callable[[float], float], low: float, high: float) -> float:
    """Place at which a function that falls reaches zero, by bisection of the logarithm."""
    for _ in range(80):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if function(middle) > 0 else (low, middle)
    return high


def share_of(accuracy: float) -> float:
    """Part of a wanted error for the waves and for the near part each.

    The smaller the error, the thinner is the shell of charges beyond the cutoff that makes most of it. In a crystal the
    charges of a thin shell may have one sign. So each decade below 1e-6 takes off a twentieth, up to a half."""
    return SHARE * max(0.5, 1.0 - MARGIN * max(0.0, math.log10(THIN / accuracy)))


def split_at(charged: Charged, accuracy: float, cutoff: float, alpha: float | None, waves: float | None) -> Split:
    """The Split with this cutoff, and with the given values of the others, for a wanted error."""
    wanted = share_of(accuracy) * accuracy
    if alpha is None:
        alpha = rising(lambda a: charged.near_error(a, cutoff) - wanted, 1e-3 / cutoff, 1e2 / cutoff)
    if waves is None:
        given = alpha
        waves = rising(lambda k: charged.far_error(given, k) - wanted, 1e-2 * alpha, 1e2 * alpha)
    return Split(alpha, cutoff, waves)


def cheapest(
    charged: Charged, accuracy: float, shortest: float, longest: float, alpha: float | None, waves: float | None
) -> Split:
    """The Split with the cheapest cutoff for a wanted error. A pair force has the ``shortest`` cutoff anyway."""
    tried = np.geomspace(min(shortest, longest), longest, TRIED).tolist()
    return min((split_at(charged, accuracy, cutoff, alpha, waves) for cutoff in tried), key=partial(cost, charged))


def cost(charged: Charged, split: Split) -> float:
    """Nanoseconds of an evaluation with waves, for each charge."""
    pairs = 2.0 / 3.0 * math.pi * charged.charges / charged.volume * split.cutoff**3
    return PAIR * pairs + WAVE * charged.volume * split.waves**3 / (12.0 * math.pi**2)
