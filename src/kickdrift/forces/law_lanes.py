"""A pair law with its parameters and truncation, evaluated in SIMD lanes."""

from __future__ import annotations

from typing import Any

from numba import types

from kickdrift.forces.truncation import truncated
from kickdrift.jit.inner import overload
from kickdrift.jit.lanes import lanes_like
from kickdrift.jit.memory import named_lanes
from kickdrift.jit.single import (
    named_lanes_single,
)
from kickdrift.jit.vectors import single_type


def pair_terms(laws: tuple[Any, ...], i: int, j: int, r2: Any) -> Any:
    """Return truncated energy and force over r of particle i with the particles in the slots from j on.

    With 16 lanes, i + 1, i + 2 and i + 3 take part as well. The cutoff is not yet applied."""


@overload(pair_terms)
def _pair_terms(laws, i, j, r2):
    law = laws[0].instance_class.compiled_law
    if isinstance(laws[3], types.NoneType):

        def one_species(laws, i, j, r2):
            parameters, at_cutoff, truncation, _ = laws
            energy, force_over_r = law(parameters, r2)
            return truncated(truncation, at_cutoff, r2, lanes_like(energy, r2), lanes_like(force_over_r, r2))

        return one_species

    def many_species(laws, i, j, r2):
        like, like_at_cutoff, truncation, tables = laws
        energy, force_over_r = law(parameters_of(like, tables.law, tables.row, i, j, r2), r2)
        at_cutoff = parameters_of(like_at_cutoff, tables.at_cutoff, tables.row, i, j, r2)
        return truncated(truncation, at_cutoff, r2, lanes_like(energy, r2), lanes_like(force_over_r, r2))

    return many_species


def parameters_of(like: Any, table: Any, species: Any, i: int, j: int, r2: Any) -> Any:
    """Return parameters, in the form of ``like``, of the slot i, or four from i on, with the slots from j on."""


@overload(parameters_of)
def _parameters_of(like, table, species, i, j, r2):
    def four(like, table, species, i, j, r2):
        rows = species[i], species[i + 1], species[i + 2], species[i + 3]
        return named_lanes_single(like, table, rows, j)

    def one(like, table, species, i, j, r2):
        return named_lanes(like, table, species[i], j, r2)

    return four if r2 == single_type else one
