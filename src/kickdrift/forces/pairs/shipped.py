"""Pair laws that ship beside Lennard-Jones, each one formula. Parameters are those of LAMMPS' styles of the same name.

A law's ``reach`` is its default cutoff: a number, or a property of its parameters; 0 where no cutoff is natural.
Parameters in ``shared`` are the same for two species that mix. Users had laws of these names before kickdrift did, so
a user's law of such a name stands for it; see `register_force`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from kickdrift.forces.pairs.law import pair_law

WELL = 2.0 ** (1.0 / 6.0)  # place of the minimum of Lennard-Jones, in sigma
# Coefficients of the universal screening function; Ziegler, Biersack and Littmark 1985.
C1, C2, C3, C4 = 0.02817, 0.28022, 0.50986, 0.18175
D1, D2, D3, D4 = 0.20162, 0.40290, 0.94229, 3.19980


@pair_law
class Buckingham(NamedTuple):
    """U(r) = A exp(-r/rho) - C/r^6; Buckingham, Proc. R. Soc. Lond. A 168, 264 (1938), doi:10.1098/rspa.1938.0173.

    It falls to minus infinity at r = 0, so particles must not come closer than its maximum."""

    A: float = 1.0
    rho: float = 1.0
    C: float = 0.0

    dimensions = {"A": "energy", "rho": "length", "C": "energy length^6"}  # type: ignore[misc]  # noqa: RUF012

    def law(p, r2):
        r = math.sqrt(r2)
        repulsion = p.A * math.exp(-r / p.rho)
        attraction = p.C / r2**3
        return repulsion - attraction, repulsion / (p.rho * r) - 6.0 * attraction / r2


@pair_law
class BornMayerHuggins(NamedTuple):
    """U(r) = A exp((sigma - r)/rho) - C/r^6 + D/r^8, for ions beside charges; Tosi & Fumi, J. Phys. Chem. Solids 25, 45
    (1964), doi:10.1016/0022-3697(64)90160-X, whose D has the other sign."""

    A: float = 1.0
    rho: float = 1.0
    sigma: float = 1.0
    C: float = 0.0
    D: float = 0.0

    dimensions = {  # type: ignore[misc]  # noqa: RUF012
        "A": "energy", "rho": "length", "sigma": "length", "C": "energy length^6", "D": "energy length^8",
    }  # fmt: skip
    reach = 0.0  # type: ignore[misc]

    def law(p, r2):
        r = math.sqrt(r2)
        repulsion = p.A * math.exp((p.sigma - r) / p.rho)
        inverse = 1.0 / r2
        six, eight = p.C * inverse**3, p.D * inverse**4
        return repulsion - six + eight, repulsion / (p.rho * r) + (8.0 * eight - 6.0 * six) * inverse


@pair_law
class MorsePair(NamedTuple):
    """U(r) = depth (exp(-2 width (r - length)) - 2 exp(-width (r - length))); Morse, Phys. Rev. 34, 57 (1929),
    doi:10.1103/PhysRev.34.57."""

    depth: float = 1.0
    width: float = 1.0
    length: float = 1.0

    dimensions = {"depth": "energy", "width": "inverse length", "length": "length"}  # type: ignore[misc]  # noqa: RUF012

    def law(p, r2):
        r = math.sqrt(r2)
        e = math.exp(-p.width * (r - p.length))
        return p.depth * (e * e - 2.0 * e), 2.0 * p.depth * p.width * (e * e - e) / r


@pair_law
class Yukawa(NamedTuple):
    """U(r) = A exp(-kappa r) / r, of screened charges; Yukawa, Proc. Phys.-Math. Soc. Jpn. 17, 48 (1935)."""

    A: float = 1.0
    kappa: float = 1.0

    dimensions = {"A": "energy length", "kappa": "inverse length"}  # type: ignore[misc]  # noqa: RUF012

    def law(p, r2):
        r = math.sqrt(r2)
        energy = p.A * math.exp(-p.kappa * r) / r
        return energy, energy * (p.kappa + 1.0 / r) / r


@pair_law
class Mie(NamedTuple):
    """U(r) = c epsilon ((sigma/r)^n - (sigma/r)^m) with c = n/(n - m) (n/m)^(m/(n - m)), so that the well has the depth
    epsilon; n and m are any powers. Mie, Ann. Phys. 316, 657 (1903), doi:10.1002/andp.19033160802."""

    epsilon: float = 1.0
    sigma: float = 1.0
    n: float = 12.0
    m: float = 6.0

    dimensions = {"epsilon": "energy", "sigma": "length"}  # type: ignore[misc]  # noqa: RUF012
    shared = ("n", "m")  # type: ignore[misc]

    @property
    def problem(p):
        good = p.n > 0.0 and p.m > 0.0 and p.n != p.m
        return "" if good else f"n and m must be two different positive powers, got n = {p.n:g} and m = {p.m:g}"

    def law(p, r2):
        c = p.epsilon * p.n / (p.n - p.m) * (p.n / p.m) ** (p.m / (p.n - p.m))
        ratio = p.sigma * p.sigma / r2
        repulsion, attraction = c * ratio ** (0.5 * p.n), c * ratio ** (0.5 * p.m)
        return repulsion - attraction, (p.n * repulsion - p.m * attraction) / r2


@pair_law
class SoftPair(NamedTuple):
    """U(r) = A (1 + cos(pi r / sigma)) below sigma, zero beyond; it pushes overlapping particles apart."""

    A: float = 1.0
    sigma: float = 1.0

    dimensions = {"A": "energy", "sigma": "length"}  # type: ignore[misc]  # noqa: RUF012

    @property
    def reach(p):
        return p.sigma

    def law(p, r2):
        r = math.sqrt(r2)
        x = math.pi * min(r / p.sigma, 1.0)
        energy, force_over_r = p.A * (1.0 + math.cos(x)), p.A * math.pi * math.sin(x) / (p.sigma * r)
        return np.where(r < p.sigma, energy, 0.0), np.where(r < p.sigma, force_over_r, 0.0)


@pair_law
class WeeksChandlerAndersen(NamedTuple):
    """The repulsion of Lennard-Jones: U(r) + epsilon below the minimum at 2^(1/6) sigma, zero beyond; Weeks, Chandler &
    Andersen, J. Chem. Phys. 54, 5237 (1971), doi:10.1063/1.1674820. Each pair of species ends at its own minimum."""

    epsilon: float = 1.0
    sigma: float = 1.0

    dimensions = {"epsilon": "energy", "sigma": "length"}  # type: ignore[misc]  # noqa: RUF012

    @property
    def reach(p):
        return WELL * p.sigma

    def law(p, r2):
        inverse = 1.0 / r2
        ratio6 = (p.sigma * p.sigma * inverse) ** 3
        energy = 4.0 * p.epsilon * (ratio6 * ratio6 - ratio6) + p.epsilon
        force_over_r = 24.0 * p.epsilon * (2.0 * ratio6 * ratio6 - ratio6) * inverse
        return np.where(ratio6 > 0.5, energy, 0.0), np.where(ratio6 > 0.5, force_over_r, 0.0)


@pair_law
class GaussianCore(NamedTuple):
    """U(r) = epsilon exp(-r^2/sigma^2); Stillinger, J. Chem. Phys. 65, 3968 (1976), doi:10.1063/1.432891."""

    epsilon: float = 1.0
    sigma: float = 1.0

    dimensions = {"epsilon": "energy", "sigma": "length"}  # type: ignore[misc]  # noqa: RUF012

    def law(p, r2):
        inverse = 1.0 / (p.sigma * p.sigma)
        energy = p.epsilon * math.exp(-r2 * inverse)
        return energy, 2.0 * energy * inverse


@pair_law
class Zbl(NamedTuple):
    """U(r) = strength / r times the universal screening function of r / length: two nuclei at short distances; Ziegler,
    Biersack & Littmark, The Stopping and Range of Ions in Matter (1985).

    For atomic numbers Z and Z', strength is Z Z' e^2/(4 pi epsilon_0), and e^2/(4 pi epsilon_0) is 14.3996 eV angstrom;
    length is 0.46850 angstrom / (Z^0.23 + Z'^0.23)."""

    strength: float = 1.0
    length: float = 1.0

    dimensions = {"strength": "energy length", "length": "length"}  # type: ignore[misc]  # noqa: RUF012

    def law(p, r2):
        r = math.sqrt(r2)
        x = r / p.length
        e1, e2 = C1 * math.exp(-D1 * x), C2 * math.exp(-D2 * x)
        e3, e4 = C3 * math.exp(-D3 * x), C4 * math.exp(-D4 * x)
        energy = p.strength * (e1 + e2 + e3 + e4) / r
        slope = p.strength * (D1 * e1 + D2 * e2 + D3 * e3 + D4 * e4) / (p.length * r)
        return energy, (energy / r + slope) / r
