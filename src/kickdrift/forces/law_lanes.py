"""A pair law with its parameters and truncation, evaluated in SIMD lanes."""

from __future__ import annotations

from typing import Any

from numba import types

from kickdrift.forces.truncation import truncated
from kickdrift.jit.dual import dual, of_lanes
from kickdrift.jit.dual_operators import dual_like
from kickdrift.jit.inner import overload
from kickdrift.jit.lanes import lanes_like
from kickdrift.jit.memory import named_lanes
from kickdrift.jit.single import (
    named_lanes_single,
)
from kickdrift.jit.vectors import single_type


def pair_terms(laws: tuple[Any, ...], i: int, j: int, r2: Any) -> Any:
    """Return truncated energy and force over r of particle i with the particles in the slots from j on.

    With 16 lanes, i + 1 takes part as well. The cutoff is not yet applied."""


@overload(pair_terms)
def _pair_terms(laws, i, j, r2):
    law, like_r2 = laws[0].instance_class.compiled_law, dual_like if of_lanes(r2) else lanes_like
    if isinstance(laws[3], types.NoneType):

        def one_species(laws, i, j, r2):
            parameters, at_cutoff, truncation, _ = laws
            energy, force_over_r = law(parameters, r2)
            return truncated(truncation, at_cutoff, r2, like_r2(energy, r2), like_r2(force_over_r, r2))

        return one_species
    single = r2 == single_type

    def many_species(laws, i, j, r2):
        like, like_at_cutoff, truncation, tables = laws
        row, next_row = tables.row[i], tables.row[i + single]
        energy, force_over_r = law(parameters_of(like, tables.law, row, next_row, j, r2), r2)
        at_cutoff = parameters_of(like_at_cutoff, tables.at_cutoff, row, next_row, j, r2)
        return truncated(truncation, at_cutoff, r2, like_r2(energy, r2), like_r2(force_over_r, r2))

    return many_species


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


def parameters_of(like: Any, table: Any, row: int, next_row: int, j: int, r2: Any) -> Any:
    """Return parameters, in the form of ``like``, of species ``row`` (and ``next_row``) with the slots from j on."""


@overload(parameters_of)
def _parameters_of(like, table, row, next_row, j, r2):
    if r2 == single_type:
        return lambda like, table, row, next_row, j, r2: named_lanes_single(like, table, row, next_row, j)
    if of_lanes(r2):
        return lambda like, table, row, next_row, j, r2: named_lanes(like, table, row, j, r2.value)
    return lambda like, table, row, next_row, j, r2: named_lanes(like, table, row, j, r2)
