"""A pair law with its parameters and truncation, evaluated in SIMD lanes.

Truncations are cut, shift, force-shift and switch. Each works on numbers and on SIMD lanes.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import types

from kickdrift.jit.compile import as_written
from kickdrift.jit.duals import functions as functions  # what duals take part in
from kickdrift.jit.duals.dual import dual, dual_fields, of_lanes
from kickdrift.jit.duals.operators import dual_like
from kickdrift.jit.handle import Handle
from kickdrift.jit.inner import overload
from kickdrift.jit.lanes.functions import lanes_like
from kickdrift.jit.lanes.masks import select
from kickdrift.jit.lanes.memory import named_lanes
from kickdrift.jit.lanes.single import (
    named_lanes_single,
)
from kickdrift.jit.lanes.vectors import Lanes, single_type


class AtCutoff(NamedTuple):
    """Energy and force over r of a pair at the cutoff."""

    energy: float
    force_over_r: float


class Cut(NamedTuple):
    """U(r) unchanged: the energy jumps at the cutoff, so no method conserves it."""

    def apply(self, at_cutoff, r2, energy, force_over_r):
        return energy, force_over_r


class Shift(NamedTuple):
    """U(r) - U(r_c): the energy is continuous, the force jumps at the cutoff."""

    def apply(self, at_cutoff, r2, energy, force_over_r):
        return energy - at_cutoff.energy, force_over_r


class ForceShift(NamedTuple):
    """U(r) - U(r_c) + (r - r_c) F(r_c): energy and force are continuous (Toxvaerd & Dyre 2011,
    doi:10.1063/1.3558787)."""

    cutoff: float

    def apply(self, at_cutoff, r2, energy, force_over_r):
        force_at_cutoff = at_cutoff.force_over_r * self.cutoff
        r = math.sqrt(r2)
        shifted = energy - at_cutoff.energy + (r - self.cutoff) * force_at_cutoff
        return shifted, force_over_r - force_at_cutoff / r


class Switch(NamedTuple):
    """U(r) S(r), where S falls from 1 at ``start`` to 0 at the cutoff, four times continuously differentiable.

    S = (1 - u)^5 (1 + 5 u + 15 u^2 + 35 u^3 + 70 u^4) is the smooth step of degree nine (Ebert et al., Texturing and
    Modeling, 2003, ch. 2, generalised). Its argument u = (r^2 - start^2) / (r_c^2 - start^2) needs no square root, and
    this form has no cancellation at the cutoff. The degree is high because a potential with k continuous derivatives
    limits a method to order k.
    """

    start2: float
    inverse_width: float  # 1 / (r_c^2 - start^2)

    def apply(self, at_cutoff, r2, energy, force_over_r):
        u = positive((r2 - self.start2) * self.inverse_width)  # above 1 only beyond the cutoff, where lanes are masked
        w = 1.0 - u
        w2, uw = w * w, u * w
        s = w2 * w2 * w * (1.0 + u * (5.0 + u * (15.0 + u * (35.0 + u * 70.0))))
        # F / r = -(1/r) d(U S)/dr = F_U S / r - U dS/du du/dr / r, with du/dr / r = 2 / (r_c^2 - start^2)
        uw2 = uw * uw
        slope = 1260.0 * self.inverse_width * (uw2 * uw2)
        return energy * s, force_over_r * s + energy * slope


def positive(u: Any) -> Any:
    """Return u, or zero where u is negative."""


@overload(positive)
def _positive(u):
    if isinstance(u, Lanes):
        return lambda u: select(u > 0.0, u, 0.0)
    if of_lanes(u):
        return lambda u: np.where(u > 0.0, u, 0.0)
    return lambda u: max(u, 0.0)


def truncated(truncation: Any, at_cutoff: Any, r2: Any, energy: Any, force_over_r: Any) -> Any:
    """Return energy and force over r of a truncated law, below its cutoff."""


@overload(truncated)
def _truncated(truncation, at_cutoff, r2, energy, force_over_r):
    apply = as_written(truncation.instance_class.apply)
    return lambda truncation, at_cutoff, r2, energy, force_over_r: apply(
        truncation, at_cutoff, r2, energy, force_over_r
    )


class LawSlope(NamedTuple):
    """A law's parameters, and their derivatives by one number, in place of the law."""

    law: Any
    by: Any  # NamedTuple of the law's class
    cutoff2: float


def brings_terms(kind: Any) -> bool:
    """Tell whether a law's class, or that of its tables, has terms of its own; see `charges.pair_terms`."""
    kind = kind.kind if isinstance(kind, Handle) else kind
    return getattr(getattr(kind, "instance_class", None), "brings_terms", False)


def pair_terms(laws: tuple[Any, ...], i: int, j: int, r2: Any) -> Any:
    """Return truncated energy and force over r of particle i with the particles in the slots from j on.

    With 16 lanes, i + 1, i + 2 and i + 3 take part as well. The cutoff is not yet applied."""


@overload(pair_terms)
def _pair_terms(laws, i, j, r2):
    if brings_terms(laws[0]):
        return None
    if isinstance(laws[3], types.NoneType):
        return lambda laws, i, j, r2: truncated_terms(laws[0], laws[1], laws[2], r2)

    def many_species(laws, i, j, r2):
        like, like_at_cutoff, truncation, tables = laws
        rows = species_of(tables.row, i, r2)
        parameters = parameters_of(like, tables.law, rows, j, r2)
        at_cutoff = parameters_of(like_at_cutoff, tables.at_cutoff, rows, j, r2)
        return truncated_terms(parameters, at_cutoff, truncation, r2)

    return many_species


def truncated_terms(parameters: Any, at_cutoff: Any, truncation: Any, r2: Any) -> Any:
    """Return truncated energy and force over r at squared distances, which may be duals of lanes. For a `LawSlope`
    return their derivatives by its number."""


@overload(truncated_terms)
def _truncated_terms(parameters, at_cutoff, truncation, r2):
    of_slope = parameters.instance_class is LawSlope
    law = (parameters.types[0] if of_slope else parameters).instance_class.compiled_law
    like_r2 = dual_like if of_slope or of_lanes(r2) else lanes_like

    def terms(parameters, at_cutoff, truncation, r2):
        energy, force_over_r = law(parameters, r2)
        return truncated(truncation, at_cutoff, r2, like_r2(energy, r2), like_r2(force_over_r, r2))

    def slopes(parameters, at_cutoff, truncation, r2):
        p = dual_fields(parameters.law, parameters.by, r2)
        square, end = dual_like(r2, r2), dual_like(parameters.cutoff2, r2)
        energy, force_over_r = law(p, end)
        at_end = AtCutoff(like_r2(energy, r2), like_r2(force_over_r, r2))
        energy, force_over_r = law(p, square)
        energy, force_over_r = truncated(truncation, at_end, square, like_r2(energy, r2), like_r2(force_over_r, r2))
        return energy.slope, force_over_r.slope

    return slopes if of_slope else terms


def pair_slopes(laws: tuple[Any, ...], i: int, j: int, r2: Any) -> tuple[Any, Any]:
    """Return the truncated force over r of the pairs of `pair_terms`, and twice its derivative by the squared
    distance."""
    raise NotImplementedError("for compiled code")


@overload(pair_slopes)
def _pair_slopes(laws, i, j, r2):
    def slopes(laws, i, j, r2):
        _, force_over_r = pair_terms(laws, i, j, dual(r2, lanes_like(2.0, r2)))
        return force_over_r.value, force_over_r.slope

    return slopes


def species_of(species: Any, i: int, r2: Any) -> Any:
    """Return the species in the slot i, or with 16 lanes the four species from i on."""
    raise NotImplementedError("for compiled code")


@overload(species_of)
def _species_of(species, i, r2):
    if r2 == single_type:
        return lambda species, i, r2: (species[i], species[i + 1], species[i + 2], species[i + 3])
    return lambda species, i, r2: species[i]


def parameters_of(like: Any, table: Any, rows: Any, j: int, r2: Any) -> Any:
    """Return parameters, in the form of ``like``, of the species ``rows`` with the slots from j on."""


@overload(parameters_of)
def _parameters_of(like, table, rows, j, r2):
    if r2 == single_type:
        return lambda like, table, rows, j, r2: named_lanes_single(like, table, rows, j)
    if of_lanes(r2):
        return lambda like, table, rows, j, r2: named_lanes(like, table, rows, j, r2.value)
    if like.instance_class is LawSlope:
        count = len(like.types[0])

        def of_slope(like, table, rows, j, r2):
            law, by = named_lanes(like.law, table, rows, j, r2), named_lanes(like.by, table[count:], rows, j, r2)
            return LawSlope(law, by, like.cutoff2)

        return of_slope
    return lambda like, table, rows, j, r2: named_lanes(like, table, rows, j, r2)
