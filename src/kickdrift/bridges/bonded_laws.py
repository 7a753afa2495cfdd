"""Bonded laws in the terms of LAMMPS and OpenMM, a row for each law."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from kickdrift.forces.bonded import shipped


class Terms(NamedTuple):
    """A law for LAMMPS, a style and its coefficients, and for OpenMM, an energy of r or theta (radians)."""

    style: str
    coefficients: Callable[[Any], tuple[float | int, ...] | None]  # None for parameters that LAMMPS does not have
    energy: str
    keys: Callable[[Any], dict[str, float]]


def _periodic(p: Any) -> tuple[float | int, ...] | None:
    whole = p.multiplicity == int(p.multiplicity) and p.multiplicity >= 0
    return (1, p.barrier, int(p.multiplicity), p.phase) if whole else None


def _cvff(p: Any) -> tuple[float | int, ...] | None:
    sign = {0.0: 1, 180.0: -1}.get(p.phase)
    return (p.barrier, sign, int(p.multiplicity)) if sign and p.multiplicity in range(7) else None


def _bellemans(p: Any) -> tuple[float, ...] | None:  # in powers of cos(angle) = -cos(angle - pi)
    return (p.c0, -p.c1, p.c2, -p.c3, p.c4) if p.c5 == 0.0 else None


LAWS: dict[type, Terms] = {
    shipped.HarmonicBond: Terms(
        "harmonic", lambda p: (0.5 * p.stiffness, p.length), "0.5*k*(r-l)^2",
        lambda p: {"k": p.stiffness, "l": p.length},
    ),
    shipped.Fene: Terms(
        "fene", lambda p: (p.stiffness, p.length, p.epsilon, p.sigma),
        "-0.5*k*l^2*log(1-(r/l)^2)+step(2^(1/6)*d-r)*(4*e*((d/r)^12-(d/r)^6)+e)",
        lambda p: {"k": p.stiffness, "l": p.length, "e": p.epsilon, "d": p.sigma},
    ),
    shipped.MorseBond: Terms(
        "morse", lambda p: (p.depth, p.width, p.length), "d*(1-exp(-w*(r-l)))^2",
        lambda p: {"d": p.depth, "w": p.width, "l": p.length},
    ),
    shipped.HarmonicAngle: Terms(
        "harmonic", lambda p: (0.5 * p.stiffness, p.rest), "0.5*k*(theta-rest)^2",
        lambda p: {"k": p.stiffness, "rest": math.radians(p.rest)},
    ),
    shipped.CosineAngle: Terms("cosine", lambda p: (p.stiffness,), "k*(1+cos(theta))", lambda p: {"k": p.stiffness}),
    shipped.PeriodicDihedral: Terms(
        "fourier", _periodic, "k*(1+cos(n*theta-phase))",
        lambda p: {"k": p.barrier, "n": p.multiplicity, "phase": math.radians(p.phase)},
    ),
    shipped.RyckaertBellemans: Terms(
        "multi/harmonic", _bellemans, "c0-c1*c+c2*c^2-c3*c^3+c4*c^4-c5*c^5; c=cos(theta)", lambda p: p._asdict()
    ),
    shipped.OplsDihedral: Terms(
        "opls", lambda p: tuple(p),
        "0.5*(v1*(1+cos(theta))+v2*(1-cos(2*theta))+v3*(1+cos(3*theta))+v4*(1-cos(4*theta)))",
        lambda p: p._asdict(),
    ),
    shipped.HarmonicImproper: Terms(
        "harmonic", lambda p: (0.5 * p.stiffness, p.rest), "0.5*k*(abs(theta)-rest)^2",
        lambda p: {"k": p.stiffness, "rest": math.radians(p.rest)},
    ),
}  # fmt: skip
LAWS[shipped.PeriodicImproper] = LAWS[shipped.PeriodicDihedral]._replace(style="cvff", coefficients=_cvff)
