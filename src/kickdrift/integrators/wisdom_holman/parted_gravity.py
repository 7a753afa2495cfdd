"""Gravity in two parts, as `eos` kicks by them: the pairs with the star, and the pairs of the other bodies."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from kickdrift.forces.laws.central import gravitational_constant
from kickdrift.forces.seam.kernel import OK, kernel
from kickdrift.model.state import Floats


class StarPairs(NamedTuple):
    """Gravity between the star and the other bodies."""

    gm: Floats  # (n,) G m
    star: int


class PlanetPairs(NamedTuple):
    """Gravity among the bodies other than the star."""

    gm: Floats  # (n,) G m
    star: int


class Parted:
    """One part of a force of gravity."""

    may_overlap, group = True, 0

    def __init__(self, gravity: Any, star: int, mutual: bool) -> None:
        self._gravity, self._star, self._kind = gravity, star, PlanetPairs if mutual else StarPairs
        self.name = gravity.name

    def check(self, system: Any) -> None:
        """Accept every System, since its gravity has been checked."""

    def bind(self, system: Any, threads: int = 1) -> Any:
        """Return the parts: a NamedTuple with a compiled body."""
        G = gravitational_constant(self.name, self._gravity.G, system)
        return self._kind(G * system.state.masses, self._star)


@kernel(StarPairs)
def star_pairs(force, t, x, v, a, sums):
    c, gm = force.star, force.gm
    cx, cy, cz = x[0, c], x[1, c], x[2, c]
    bx = by = bz = 0.0
    for i in range(gm.size):
        if i == c:
            continue
        dx, dy, dz = x[0, i] - cx, x[1, i] - cy, x[2, i] - cz
        r2 = dx * dx + dy * dy + dz * dz
        pull = 1.0 / (r2 * math.sqrt(r2))
        a[0, i] -= gm[c] * pull * dx
        a[1, i] -= gm[c] * pull * dy
        a[2, i] -= gm[c] * pull * dz
        bx += gm[i] * pull * dx
        by += gm[i] * pull * dy
        bz += gm[i] * pull * dz
    a[0, c] += bx
    a[1, c] += by
    a[2, c] += bz
    return OK


@kernel(PlanetPairs)
def planet_pairs(force, t, x, v, a, sums):
    c, gm = force.star, force.gm
    for i in range(gm.size):
        if i == c:
            continue
        ax = ay = az = 0.0
        for j in range(i):
            if j == c or (gm[i] == 0.0 and gm[j] == 0.0):
                continue
            dx, dy, dz = x[0, j] - x[0, i], x[1, j] - x[1, i], x[2, j] - x[2, i]
            r2 = dx * dx + dy * dy + dz * dz
            pull = 1.0 / (r2 * math.sqrt(r2))
            ax += gm[j] * pull * dx
            ay += gm[j] * pull * dy
            az += gm[j] * pull * dz
            a[0, j] -= gm[i] * pull * dx
            a[1, j] -= gm[i] * pull * dy
            a[2, j] -= gm[i] * pull * dz
        a[0, i] += ax
        a[1, i] += ay
        a[2, i] += az
    return OK
