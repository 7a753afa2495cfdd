"""King's model of a star cluster, which ends at a tidal radius."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from kickdrift.errors import InputError
from kickdrift.model.checks.values import number
from kickdrift.model.starts.plummer import directions
from kickdrift.model.state import Floats
from kickdrift.text import shown

DEEPEST = 16.0
LEAST = 1e-6  # depth of the polytrope of index 5/2, which is the limit of W0 = 0
POINTS = 20_000  # of the table of the mass within a radius


class Profile(NamedTuple):
    """A King model in its own units: G = 1, the central potential is 1, lengths are core radii times sqrt(W0).

    Attributes
    ----------
    depth : W0
    radii : (k,) from the centre to the tidal radius
    potential : (k,) relative to the tidal radius, 1 at the centre
    masses : (k,) within each radius
    energy : potential energy, negative
    """

    depth: float
    radii: Floats
    potential: Floats
    masses: Floats
    energy: float

    @property
    def concentration(self) -> float:
        """Logarithm to base 10 of the tidal radius over the core radius."""
        return math.log10(float(self.radii[-1]) * math.sqrt(self.depth))


def density(w: Any) -> Any:
    """Density of King's model at a potential w, up to a factor: e^w erf(sqrt(w)) - sqrt(4 w / pi) (1 + 2 w / 3)."""
    from scipy.special import erf

    w = np.maximum(np.asarray(w, dtype=float), 0.0)
    small, term = np.zeros_like(w), 2.0 / math.sqrt(math.pi) * np.sqrt(w)
    for n in range(1, 30):  # the terms that the difference leaves: from n = 2 on
        term = term * (2.0 * w / (2 * n + 1))
        small = small + (term if n > 1 else 0.0)
    large = np.exp(w) * erf(np.sqrt(w)) - np.sqrt(4.0 * w / math.pi) * (1.0 + 2.0 * w / 3.0)
    return np.where(w < 1.0, small, large)


@lru_cache(maxsize=8)
def profile(W0: float) -> Profile:
    """King's model of depth W0 (King 1966, doi:10.1086/109857).

    The potential w solves (s^2 w')' = -9 s^2 density(W0 w) / density(W0). Raises InputError unless W0 is from 0 to 16.
    """
    from scipy.integrate import solve_ivp

    if not (math.isfinite(number(W0)) and 0 <= W0 <= DEEPEST):
        raise InputError(f"W0: expected a number from 0 to {DEEPEST:g}, got {shown(W0)}")
    depth = max(float(W0), LEAST)
    centre = float(density(depth))

    def slope(s: float, y: Any) -> Any:
        return [-y[1] / (s * s), 9.0 * s * s * float(density(depth * y[0])) / centre]

    def end(s: float, y: Any) -> float:
        return float(y[0])

    end.terminal = True  # type: ignore[attr-defined]
    first = 1e-3 / math.sqrt(max(depth, 1.0))
    found = solve_ivp(
        slope, (first, 1e6), [1.0 - 1.5 * first**2, 3.0 * first**3], "DOP853", rtol=1e-10, atol=1e-13, events=end,
        dense_output=True,
    )  # fmt: skip
    last = float(found.t_events[0][0])
    radii = np.geomspace(first, last, POINTS)
    w, within = found.sol(radii)
    radii, w, within = (np.concatenate([[start], row]) for start, row in ((0.0, radii), (1.0, w), (0.0, within)))
    w[-1] = 0.0
    within = np.maximum.accumulate(within)
    total = float(within[-1])
    shell = np.diff(within)
    energy = -0.5 * float(np.sum(shell * 0.5 * (w[1:] + w[:-1]))) - 0.5 * total * total / last
    return Profile(depth, radii, w, within, energy)


def draw(W0: float, count: int, rng: np.random.Generator) -> tuple[Floats, Floats, Floats]:
    """Positions and velocities (n, 3) of stars of a King model in N-body units, and the energy of each star alone."""
    model = profile(W0)
    total = float(model.masses[-1])
    u = rng.random(count)
    r = np.interp(np.cbrt(u * total), np.cbrt(model.masses), model.radii)
    w = np.interp(r, model.radii, model.potential)
    q = _speeds(rng, model.depth * w)
    x = r[:, None] * directions(rng, count)
    v = (q * np.sqrt(2.0 * w))[:, None] * directions(rng, count)
    virial = 0.5 * total * total / -model.energy  # the virial radius, which is 1 in N-body units
    return x / virial, v * math.sqrt(virial / total), (q * q - 1.0) * w * (virial / total)


def _speeds(rng: np.random.Generator, depth: Floats) -> Floats:
    """Fractions q of the escape speed, whose density is q^2 (exp(depth (1 - q^2)) - 1), by rejection."""
    low, high = np.zeros_like(depth), np.minimum(1.0, depth)
    for _ in range(60):  # the largest density is where 1 - exp(y - depth) = y, with y = depth q^2
        middle = 0.5 * (low + high)
        above = -np.expm1(middle - depth) > middle
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    y = np.where(depth > 0.0, low, 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        most = np.where(depth > 0.0, y / depth * np.expm1(depth - y), 1.0) * 1.001
    found, left = np.zeros_like(depth), np.arange(len(depth))
    while len(left):
        q, level = rng.random(len(left)), rng.random(len(left)) * most[left]
        taken = (level <= q * q * np.expm1(depth[left] * (1.0 - q * q))) | (depth[left] <= 0.0)
        found[left[taken]] = q[taken]
        left = left[~taken]
    return found
