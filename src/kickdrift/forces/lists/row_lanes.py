"""Width of the steps of the pair loop, chosen by the processor features that numba compiles for.

AVX-512 has vectors of 512 bits and 32 registers. A step is then one particle against a cluster of eight in float64, and
a tile in mixed precision: half a cluster, four particles, against half a cluster. AVX2, SSE2 and NEON have shorter
vectors; AVX2 and SSE2 have only 16 registers. There, steps of the same width would need several operations each and
would not fit the registers. So a step is one particle against half a cluster in float64, which also skips halves out of
reach, and one particle against a cluster in mixed precision.

The choice is a type, one of the classes below. The loop is compiled and the list's rows are made for this type.
"""

from typing import Any, NamedTuple

from numba.extending import intrinsic

from kickdrift.jit.compile import features
from kickdrift.jit.inner import overload
from kickdrift.jit.lanes.vectors import constant, half_single_type, half_type, lanes_type, single_type


class Whole(NamedTuple):
    """An entry of a row is a cluster."""


class Halves(NamedTuple):
    """An entry of a row is half a cluster."""


class Tiles(NamedTuple):
    """An entry of a row is half a cluster, and so is the row; see `particle_rows`."""


Block = Whole | Halves | Tiles


class Wide(NamedTuple):
    """8 lanes of float64: a particle against a cluster."""

    per_row: int = 1  # particles in a row of the list
    block: Block = Whole()  # size of an entry of a row


class WideSingle(NamedTuple):
    """16 lanes of float32: four particles against half a cluster."""

    per_row: int = 4
    block: Block = Tiles()


class Narrow(NamedTuple):
    """4 lanes of float64: a particle against half a cluster."""

    per_row: int = 1
    block: Block = Halves()


class NarrowSingle(NamedTuple):
    """8 lanes of float32: a particle against a cluster."""

    per_row: int = 1
    block: Block = Whole()


RowLanes = Wide | WideSingle | Narrow | NarrowSingle
LANES = {Wide: lanes_type, WideSingle: single_type, Narrow: half_type, NarrowSingle: half_single_type}


def row_lanes(mixed: bool) -> RowLanes:
    """Return the lanes of a step on the processor that numba compiles for, in float64 or mixed precision."""
    if "avx512f" in features():
        return WideSingle() if mixed else Wide()
    return NarrowSingle() if mixed else Narrow()


def blocks(block: Any) -> int:
    """Return how many entries of a row a cluster makes: 1 or 2, a constant in compiled code."""
    return 1 if isinstance(block, Whole) else 2


@overload(blocks)
def _blocks(block):
    return (lambda block: 1) if block.instance_class is Whole else (lambda block: 2)


@intrinsic
def nothing(typingctx, row_lanes):
    """Return zeros in all lanes of a step; the type sets the width of functions that take the zeros."""
    kind = LANES[row_lanes.instance_class]

    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return constant(0.0, kind.vector)

    return kind(row_lanes), codegen
