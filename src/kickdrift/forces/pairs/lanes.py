"""A pair law with its parameters and truncation, evaluated in SIMD lanes.

Truncations are cut, shift, force-shift, switch and potential-switch. Each works on numbers and on SIMD lanes.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import types

from kickdrift.forces.lists.pair_rows import slot_of
from kickdrift.forces.pairs.upkeep import brings_terms, is_small
from kickdrift.jit.compile import as_written
from kickdrift.jit.duals import functions as functions  # what duals take part in
from kickdrift.jit.duals.dual import dual, dual_fields, of_lanes
from kickdrift.jit.duals.operators import dual_like
from kickdrift.jit.inner import by_type
from kickdrift.jit.lanes.functions import lanes_like
from kickdrift.jit.lanes.masks import select
from kickdrift.jit.lanes.memory import named_lanes
from kickdrift.jit.lanes.single import (
    named_lanes_single,
)
from kickdrift.jit.lanes.tabled import Places, Tabled, all_taken, placed, places_of, tabled
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


class PotentialSwitch(NamedTuple):
    """U(r) S(r), where S falls from 1 at ``start`` to 0 at the cutoff, twice continuously differentiable.

    S = (1 - u)^3 (1 + 3 u + 6 u^2) with u = (r - start) / (r_c - start) is the switching function of OpenMM, and
    GROMACS' "Potential-switch".
    """

    start: float
    inverse_width: float  # 1 / (r_c - start)

    def apply(self, at_cutoff, r2, energy, force_over_r):
        r = math.sqrt(r2)
        u = positive((r - self.start) * self.inverse_width)
        w = 1.0 - u
        w2, u2 = w * w, u * u
        s = w2 * w * (1.0 + u * (3.0 + u * 6.0))
        return energy * s, force_over_r * s + energy * (30.0 * self.inverse_width * (u2 * w2)) / r


@by_type
def positive(u):
    """Return u, or zero where u is negative."""
    if isinstance(u, Lanes):
        return lambda u: select(u > 0.0, u, 0.0)
    if of_lanes(u):
        return lambda u: np.where(u > 0.0, u, 0.0)
    return lambda u: max(u, 0.0)


@by_type
def truncated(truncation, at_cutoff, r2, energy, force_over_r):
    """Return energy and force over r of a truncated law, below its cutoff."""
    apply = as_written(truncation.instance_class.apply)
    return lambda truncation, at_cutoff, r2, energy, force_over_r: apply(
        truncation, at_cutoff, r2, energy, force_over_r
    )


class LawSlope(NamedTuple):
    """A law's parameters, and their derivatives by one number, in place of the law."""

    law: Any
    by: Any  # NamedTuple of the law's class
    cutoff2: float


@by_type
def pair_terms(laws, i, place, r2):
    """Return truncated energy and force over r of the particle in slot i with the particles whose x begin at ``place``.

    With 16 lanes, i + 1, i + 2 and i + 3 take part as well. The cutoff is not yet applied."""
    if brings_terms(laws[0]):
        return None
    if isinstance(laws[3], types.NoneType):
        return lambda laws, i, place, r2: truncated_terms(laws[0], laws[1], laws[2], r2)
    if has_registers(laws[3]):
        if r2 != laws[3].types[2][0].lanes:  # other lanes than those of the loop, or duals
            return lambda laws, i, place, r2: pair_terms(without_registers(laws), i, place, r2)

        def of_registers(laws, i, place, r2):
            _, _, truncation, (tables, law, at_cutoff) = laws
            where = places_of(tables.row, i, tables.code, place, r2)
            return truncated_terms(placed(law, where), placed(at_cutoff, where), truncation, r2)

        return of_registers
    return lambda laws, i, place, r2: terms_at(laws, where_of(laws[3], i, place, r2), r2)


@as_written
def terms_at(laws, where, r2):
    """Return what `pair_terms` does, with parameters from the tables."""
    like, like_at_cutoff, truncation, tables = laws
    parameters = parameters_of(like, tables, 0, where, r2)
    return truncated_terms(parameters, parameters_of(like_at_cutoff, tables, rows_of(like), where, r2), truncation, r2)


class InRegisters(NamedTuple):
    """Tables of a mixture, and the parameters of all its pairs of species in registers."""

    tables: Any
    law: Any
    at_cutoff: Any


def has_registers(tables: Any) -> bool:
    """Tell of the type of a mixture's tables whether their numbers are in registers."""
    return isinstance(tables, types.NamedTuple) and tables.instance_class is InRegisters


@by_type
def in_registers(laws, zero):
    """Return the laws with the tables of a mixture in registers, if they fit, for a loop with the lanes of ``zero``."""
    if not is_small(laws[3]) or _slope(laws[0]):
        return lambda laws, zero: laws

    def held(laws, zero):
        like, like_at_cutoff, truncation, tables = laws
        where = places_of(tables.row, 0, tables.code, 0, zero)
        law = parameters_of(like, tables, 0, where, zero)
        at_cutoff = parameters_of(like_at_cutoff, tables, rows_of(like), where, zero)
        return like, like_at_cutoff, truncation, InRegisters(tables, law, at_cutoff)

    return held


@as_written
def without_registers(laws):
    """Return the laws with the tables of a mixture in memory."""
    return laws[0], laws[1], laws[2], laws[3].tables


def _slope(like: Any) -> bool:
    """Tell of the type of a law whether it is a `LawSlope`."""
    return bool(like.instance_class is LawSlope)


@by_type
def rows_of(like):
    """Number of a law's rows in the tables."""
    rows = 2 * len(like.types[0]) if _slope(like) else len(like)
    return lambda like: rows


@by_type
def truncated_terms(parameters, at_cutoff, truncation, r2):
    """Return truncated energy and force over r at squared distances, which may be duals of lanes. For a `LawSlope`
    return their derivatives by its number."""
    of_slope = _slope(parameters)
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


@by_type
def pair_slopes(laws, i, place, r2):
    """Return the truncated force over r of the pairs of `pair_terms`, and twice its derivative by the squared
    distance."""

    def slopes(laws, i, place, r2):
        _, force_over_r = pair_terms(laws, i, place, dual(r2, lanes_like(2.0, r2)))
        return force_over_r.value, force_over_r.slope

    return slopes


@by_type
def where_of(tables, i, place, r2):
    """Return where the parameters of the pairs of `pair_terms` are in the tables: places in small tables, else the
    species of i, or with 16 lanes the species of the four slots from i on, and the slot of the others."""
    if is_small(tables):
        if of_lanes(r2):
            return lambda tables, i, place, r2: places_of(tables.row, i, tables.code, place, r2.value)
        return lambda tables, i, place, r2: places_of(tables.row, i, tables.code, place, r2)
    if r2 == single_type:

        def of_four(tables, i, place, r2):
            row = tables.row
            return (row[i], row[i + 1], row[i + 2], row[i + 3]), slot_of(place)

        return of_four
    return lambda tables, i, place, r2: (tables.row[i], slot_of(place))


@by_type
def parameters_of(like, tables, first, where, r2):
    """Return parameters, in the form of ``like``, from the rows of the tables from ``first`` on; see `where_of`."""
    if _slope(like):
        count = len(like.types[0])

        def of_slope(like, tables, first, where, r2):
            law = lanes_of(parameters_of(like.law, tables, first, where, r2))
            by = lanes_of(parameters_of(like.by, tables, first + count, where, r2))
            return LawSlope(law, by, like.cutoff2)

        return of_slope
    if isinstance(where, Places):
        if r2 == single_type:
            return lambda like, tables, first, where, r2: tabled(like, tables.single, first, where, tables.wide)
        if of_lanes(r2):
            return lambda like, tables, first, where, r2: lanes_of(
                tabled(like, tables.table, first, where, tables.wide)
            )
        return lambda like, tables, first, where, r2: tabled(like, tables.table, first, where, tables.wide)
    if r2 == single_type:
        return lambda like, tables, first, where, r2: named_lanes_single(like, tables.table[first:], *where)
    if of_lanes(r2):
        return lambda like, tables, first, where, r2: named_lanes(like, tables.table[first:], *where, r2.value)
    return lambda like, tables, first, where, r2: named_lanes(like, tables.table[first:], *where, r2)


@by_type
def lanes_of(parameters):
    """Return parameters as lanes."""
    if isinstance(parameters[0], Tabled):
        return lambda parameters: all_taken(parameters)
    return lambda parameters: parameters
