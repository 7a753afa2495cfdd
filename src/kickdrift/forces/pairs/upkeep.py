"""Upkeep of a pair force's list, and of the parameters of each pair of species in the list's order."""

from typing import Any, NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from kickdrift.forces.lists.clusters import OUTER_BUILDS, STRIDE
from kickdrift.forces.lists.list_code import refresh
from kickdrift.forces.lists.pair_rows import slot_of
from kickdrift.forces.lists.row_lanes import RowLanes, Wide, WideSingle
from kickdrift.forces.seam.kernel import OK
from kickdrift.forces.seam.samples import SUMMED
from kickdrift.jit.compile import features, jit
from kickdrift.jit.handle import Handle
from kickdrift.jit.inner import by_type
from kickdrift.jit.lanes.memory import aligned
from kickdrift.jit.lanes.tabled import ENTRIES
from kickdrift.jit.lanes.vectors import WIDTH

MOST = 4  # species of small tables


class Tables(NamedTuple):
    """Numbers per pair of species, spread over the slots: ``table[k, species of i, slot of j]``. The rows k are the
    parameters of the law, then energy and force over r at the cutoff."""

    table: NDArray[np.float64]  # (rows, species, slots)
    pairs: NDArray[np.float64]  # (rows, species, species)
    species: NDArray[np.int64]  # (n,)
    row: NDArray[np.int64]  # (slots,) species in each slot


class SmallTables(NamedTuple):
    """Numbers per pair of two to four species, for permutations: ``table[k, MOST * species of i + species of j]``, with
    the rows of `Tables`."""

    table: NDArray[np.float64]  # (rows, ENTRIES)
    single: NDArray[np.float32]  # the same
    species: NDArray[np.int64]  # (n,)
    row: NDArray[np.int64]  # (slots,) MOST times the species in each slot
    code: NDArray[np.uint8]  # (3 slots,) species at each place
    wide: Any  # None for two species, whose numbers lie in the first eight entries; else True


def tables_of(pairs: NDArray[np.float64], species: NDArray[Any], slots: int, lanes: RowLanes) -> Any:
    """Return tables of the numbers (rows, species, species) of all pairs of species; None for one species. Small tables
    need lanes of 512 bits together."""
    rows, count, _ = pairs.shape
    if count == 1:
        return None
    species, row = species.astype(np.int64), np.zeros(slots, np.int64)
    if count > MOST or not isinstance(lanes, Wide | WideSingle) or "avx512f" not in features():
        return Tables(aligned((rows, count, slots), 1.0), np.ascontiguousarray(pairs), species, row)
    table = aligned((rows, ENTRIES), 1.0)
    table.reshape(rows, MOST, MOST)[:, :count, :count] = pairs
    code = aligned((STRIDE // WIDTH * slots,), dtype=np.uint8)
    return SmallTables(table, table.astype(np.float32), species, row, code, None if count == 2 else True)


def is_small(tables: Any) -> bool:
    """Tell of the type of tables, or of a handle of tables, whether they are small."""
    kind = tables.kind if isinstance(tables, Handle) else tables
    return isinstance(kind, types.NamedTuple) and kind.instance_class is SmallTables


def brings_terms(kind: Any) -> bool:
    """Tell whether a law's class, or that of its tables, has terms of its own; see `charges.pair_terms`."""
    kind = kind.kind if isinstance(kind, Handle) else kind
    return getattr(getattr(kind, "instance_class", None), "brings_terms", False)


@jit
def fill_tables(force):
    """Write the parameters of each pair of species to the slots of a new list; return a status."""
    force.looks[SUMMED] = 0
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


@by_type
def spread(tables, pairs):
    """After a sort, write the species, or the parameters of each pair of species, to the slots."""
    if isinstance(tables, types.NoneType):
        return lambda tables, pairs: None
    if brings_terms(tables):
        return None
    if is_small(tables):

        def spread_species(tables, pairs):
            for i in range(pairs.place.size):
                p = pairs.place[i]
                tables.row[slot_of(p)] = MOST * tables.species[i]
                tables.code[p] = tables.species[i]

        return spread_species

    def spread_tables(tables, pairs):
        for i in range(pairs.place.size):
            s, of_i = slot_of(pairs.place[i]), tables.species[i]
            tables.row[s] = of_i
            for row in range(tables.table.shape[1]):
                for k in range(tables.table.shape[0]):
                    tables.table[k, row, s] = tables.pairs[k, row, of_i]

    return spread_tables
