"""A pair law with its parameters and truncation, evaluated in SIMD lanes."""

from __future__ import annotations

from typing import Any, NamedTuple

from numba import types

from kickdrift.forces.pairs.truncation import AtCutoff, truncated
from kickdrift.jit.duals.dual import dual, dual_fields, of_lanes
from kickdrift.jit.duals.operators import dual_like
from kickdrift.jit.inner import overload
from kickdrift.jit.lanes.functions import lanes_like
from kickdrift.jit.lanes.memory import named_lanes
from kickdrift.jit.lanes.single import (
    named_lanes_single,
)
from kickdrift.jit.lanes.vectors import single_type


class LawSlope(NamedTuple):
    """A law's parameters, and their derivatives by one number, in place of the law."""

    law: Any
    by: Any  # NamedTuple of the law's class
    cutoff2: float


def pair_terms(laws: tuple[Any, ...], i: int, j: int, r2: Any) -> Any:
    """Return truncated energy and force over r of particle i with the particles in the slots from j on.

    With 16 lanes, i + 1, i + 2 and i + 3 take part as well. The cutoff is not yet applied."""


@overload(pair_terms)
def _pair_terms(laws, i, j, r2):
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
