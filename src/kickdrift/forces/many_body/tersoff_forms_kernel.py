"""Compiled parts of Tersoff's other forms: `mod` of Kumagai et al., the same with a constant, and the one with ZBL."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.many_body.kernel import law_body, row_numbers
from kickdrift.forces.many_body.tersoff_kernel import (
    FORMS,
    MOST_EXPONENT,
    Form,
    TersoffLaw,
    angle_of_1988,
    smooth_end,
    tersoff,
    weakening_of_1988,
)
from kickdrift.jit.compile import as_written
from kickdrift.jit.duals.lanes import lane_exp, lane_sine_cosine, select
from kickdrift.jit.lanes.masks import any_lane

PHI = (
    (0.1818, 3.2),
    (0.5099, 0.9423),
    (0.2802, 0.4029),
    (0.02817, 0.2016),
)  # as LAMMPS has it


class TersoffModLaw(NamedTuple):
    """As `TersoffLaw`, with other numbers at some places."""

    by_pair: NDArray[Any]  # (species^2, 12) A, lambda1, B, lambda2, beta, n, R, D, least beta zeta, nu, c0, 0
    by_triple: NDArray[Any]  # (species^3, 12) c1, c2, c3, c4, lambda3, m, R, D, c5, cos_theta0, 0, 0
    species: int
    stretched: bool
    ends: bool
    bonds: NDArray[Any]
    others: NDArray[Any]
    forces: NDArray[np.float64]

    with_room = TersoffLaw.with_room  # type: ignore[misc]


class TersoffZblLaw(NamedTuple):
    """As `TersoffLaw`, with four more numbers of each pair."""

    by_pair: NDArray[Any]  # (species^2, 16) as in `TersoffLaw`; ZBL's strength and length; zbl_cutoff, zbl_scale
    by_triple: NDArray[Any]
    species: int
    stretched: bool
    ends: bool
    bonds: NDArray[Any]
    others: NDArray[Any]
    forces: NDArray[np.float64]

    with_room = TersoffLaw.with_room  # type: ignore[misc]


@as_written
def smoother_end(r, middle, half):
    """Return the cutoff function of `mod` and its slope: 1 before middle - half, 0 after middle + half. The function is
    1/2 - 9/16 sin x - 1/16 sin 3x."""
    away = (r - middle) / half
    outer, inner = away >= 1.0, away > -1.0
    fc, slope = 0.0 * r + 1.0, 0.0 * r
    if any_lane(inner):
        sine, cosine = lane_sine_cosine(0.5 * math.pi * select(inner & ~outer, away, 1.0))
        fc = select(inner, 0.5 - 0.75 * sine + 0.25 * sine * sine * sine, 1.0)
        slope = select(inner, -0.375 * math.pi / half * cosine * cosine * cosine, 0.0)
    return select(outer, 0.0 * fc, fc), select(outer, 0.0 * slope, slope)


@as_written
def angle_of_mod(law, row, cosine):
    """Return the factor of an angle, c1 + c2 u / (c3 + u) (1 + c4 exp(-c5 u)) with u = (cos_theta0 - cos)^2, and its
    slope by the cosine."""
    c1, c2, c3, c4 = row_numbers(law.by_triple, row, 0)
    c5, cos_theta0, _, _ = row_numbers(law.by_triple, row, 8)
    away = cos_theta0 - cosine
    u = away * away
    share = 1.0 / (c3 + u)
    fading = c4 * lane_exp(-c5 * u)
    whole = c2 * u * share
    slope = c2 * c3 * share * share * (1.0 + fading) - whole * c5 * fading
    return c1 + whole * (1.0 + fading), -2.0 * away * slope


@as_written
def weakening_of_mod(law, row, n):
    """See `Form`."""
    _, nu, _, _ = row_numbers(law.by_pair, row, 8)
    return nu, n / nu


@as_written
def bond_of_mod(law, row, r, fc, slope_fc):
    """See `Form`: a constant within the cutoff."""
    _, _, c0, _ = row_numbers(law.by_pair, row, 8)
    return fc, slope_fc, c0 * fc, c0 * slope_fc


@as_written
def bond_of_zbl(law, row, r, fc, slope_fc):
    """See `Form`: Fermi's function takes Tersoff's terms away near the nucleus, and brings ZBL's repulsion in."""
    _, _, middle, half = row_numbers(law.by_pair, row, 4)
    strength, length, place, steep = row_numbers(law.by_pair, row, 12)
    exponent = -steep * (r - place)
    e = lane_exp(select(~(exponent > MOST_EXPONENT), exponent, MOST_EXPONENT))
    far = 1.0 / (1.0 + e)
    near = e * far
    slope_far = steep * far * near
    x = r / length
    energy, slope = 0.0 * r, 0.0 * r
    for share, decay in PHI:
        term = share * lane_exp(-decay * x)
        energy, slope = energy + term, slope - decay * term
    energy, slope = strength * energy / r, strength * (slope / length - energy / r) / r
    here = r < middle + half
    energy, slope = select(here, energy, 0.0), select(here, slope, 0.0)
    return (
        fc * far, slope_fc * far + fc * slope_far, near * energy, near * slope - slope_far * energy,
    )  # fmt: skip


FORMS[TersoffModLaw] = Form(smoother_end, angle_of_mod, weakening_of_mod, bond_of_mod)
FORMS[TersoffZblLaw] = Form(smooth_end, angle_of_1988, weakening_of_1988, bond_of_zbl)
law_body(TersoffModLaw, ("by_pair", "by_triple"))(tersoff)
law_body(TersoffZblLaw, ("by_pair", "by_triple"))(tersoff)
