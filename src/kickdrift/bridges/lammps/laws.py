"""Pair styles of LAMMPS whose formulas are kickdrift's pair laws, a row each, for the way in and the way out.

LAMMPS' zbl is not among them, because it adds a polynomial that ends the law smoothly.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from kickdrift.forces import (
    BornMayerHuggins,
    Buckingham,
    GaussianCore,
    LennardJones,
    Mie,
    MorsePair,
    SoftPair,
    WeeksChandlerAndersen,
    Yukawa,
)
from kickdrift.forces.pairs.shipped import WELL

LENNARD_JONES = "lj/cut"
WELL_OF = "4*epsilon*((sigma/r)^12-(sigma/r)^6)"
SWITCHED = {  # formulas of Lennard-Jones that ends smoothly, by pair style
    "lj/charmm/coul/long": (  # Brooks et al. 1983, doi:10.1002/jcc.540040211, eq. 13
        f"well*select(step(r-inner), (b-x)^2*(b+2*x-3*a)/(b-a)^3, 1); x=r*r; a=inner^2; b=outer^2; well={WELL_OF}"
    ),
    "lj/gromacs": (  # van der Spoel et al., GROMACS' reference manual, shifted interactions
        f"{WELL_OF}+c0+select(step(d), d^3*(c3+c4*d), 0); d=r-inner; w=outer-inner; c3=(w*u2-3*u1)/(3*w^2); "
        "c4=(2*u1-w*u2)/(4*w^3); c0=w*u1/2-u0-w^2*u2/12; u0=4*epsilon*(t*t-t); u1=24*epsilon*(t-2*t*t)/outer; "
        "u2=4*epsilon*(156*t*t-42*t)/outer^2; t=(sigma/outer)^6"
    ),
}  # fmt: skip


class PairStyle(NamedTuple):
    """A pair style with the formula of a law.

    Attributes
    ----------
    force : kickdrift's force
    coefficients : LAMMPS' coefficients from the law's parameters, without the cutoff
    parameters : the law's parameters from coefficients, the cutoff, and the style's own arguments
    mixes : whether the style takes and mixes epsilon and sigma, which LAMMPS then tells with all digits
    long : whether the style exists with /coul/long
    """

    force: Any
    coefficients: Callable[[Any], tuple[float, ...]]
    parameters: Callable[[Sequence[float], float, Sequence[float]], dict[str, float]]
    mixes: bool = False
    long: bool = False


def _alike(force: Any, **more: bool) -> PairStyle:
    """Row of a style whose coefficients are the law's parameters in their order."""
    names = force.Parameters._fields
    return PairStyle(force, tuple, lambda values, cutoff, own: dict(zip(names, values, strict=True)), **more)


STYLES: dict[str, PairStyle] = {
    LENNARD_JONES: _alike(LennardJones, mixes=True, long=True),
    "mie/cut": _alike(Mie, mixes=True),
    "buck": _alike(Buckingham, long=True),
    "born": _alike(BornMayerHuggins, long=True),
    "morse": _alike(MorsePair),
    "yukawa": PairStyle(
        Yukawa, lambda p: (p.A,), lambda values, cutoff, own: {"A": values[0], "kappa": own[0]}
    ),
    "gauss": PairStyle(
        GaussianCore, lambda p: (-p.epsilon, p.sigma**-2),
        lambda values, cutoff, own: {"epsilon": -values[0], "sigma": 1.0 / math.sqrt(values[1])},
    ),
    "soft": PairStyle(SoftPair, lambda p: (p.A,), lambda values, cutoff, own: {"A": values[0], "sigma": cutoff}),
}  # fmt: skip
STYLE_OF: Mapping[Any, str] = {row.force: style for style, row in STYLES.items()} | {
    WeeksChandlerAndersen: LENNARD_JONES  # shifted, and cut at its minimum
}


RANGES: Mapping[Any, Callable[[Any], float]] = {  # where laws end by themselves
    SoftPair: lambda p: float(p.sigma),
    WeeksChandlerAndersen: lambda p: WELL * float(p.sigma),
}


def range_of(force: Any, law: Any) -> float:
    """Distance at which a law of this force ends by itself; infinite for one that does not."""
    return RANGES[type(force)](law) if type(force) in RANGES else math.inf
