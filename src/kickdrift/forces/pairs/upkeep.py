"""Upkeep of a pair force's list, and of the parameters of each pair of species in the list's order."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from kickdrift.forces.lists.clusters import OUTER_BUILDS, STRIDE, ClusterList
from kickdrift.forces.lists.list_code import refresh
from kickdrift.forces.pairs.lanes import brings_terms
from kickdrift.forces.seam.kernel import OK
from kickdrift.jit.compile import jit
from kickdrift.jit.inner import overload
from kickdrift.jit.lanes.vectors import WIDTH


class Tables(NamedTuple):
    """Numbers per pair of species, spread over the slots: ``law[k, species of i, slot of j]`` for the k-th
    parameter."""

    law: NDArray[np.float64]  # (parameters, species, slots)
    at_cutoff: NDArray[np.float64]  # (2, species, slots)
    law_pairs: NDArray[np.float64]  # (parameters, species, species)
    at_cutoff_pairs: NDArray[np.float64]  # (2, species, species)
    species: NDArray[np.int64]  # (n,)
    row: NDArray[np.int64]  # (slots,) species in each slot


@jit
def fill_tables(force):
    """Write the parameters of each pair of species to the slots of a new list; return a status."""
    spread(force.tables, force.pairs)
    return OK


@jit
def refresh_force(force, x):
    """Update the list, and what belongs to its slots, for positions x (3, n); return a status."""
    pairs = force.pairs
    builds = pairs.counts[OUTER_BUILDS]
    status = refresh(pairs, x, force.chunks)
    if status == OK and pairs.counts[OUTER_BUILDS] != builds:
        spread(force.tables, pairs)
    return status


def spread(tables: Any, pairs: ClusterList) -> None:
    """After a sort, write the parameters of each pair of species to the slots."""


@overload(spread)
def _spread(tables, pairs):
    if isinstance(tables, types.NoneType):
        return lambda tables, pairs: None
    if brings_terms(tables):
        return None

    def spread_tables(tables, pairs):
        for i in range(pairs.place.size):
            p = pairs.place[i]
            s = p // STRIDE * WIDTH + p % STRIDE
            of_i = tables.species[i]
            tables.row[s] = of_i
            for row in range(tables.law.shape[1]):
                for k in range(tables.law.shape[0]):
                    tables.law[k, row, s] = tables.law_pairs[k, row, of_i]
                for k in range(2):
                    tables.at_cutoff[k, row, s] = tables.at_cutoff_pairs[k, row, of_i]

    return spread_tables
