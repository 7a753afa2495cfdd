"""How wide the steps of the pair loop are: decided here, by the features that numba compiles for.

AVX-512 has vectors of 512 bits and 32 registers for them: a step is then a particle against a cluster of eight in
float64, and two particles against a cluster in mixed precision. AVX2, SSE2 and NEON have shorter vectors, and AVX2 and
SSE2 16 registers: steps as wide would need several operations for one, and would not fit the registers. There a step is
a particle against half a cluster in float64, which also leaves out halves that are out of reach, and a particle against
a cluster in mixed precision.

The choice is a type, one of the classes here: the loop is compiled for it, and the list's rows are made for it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from numba.extending import intrinsic

from kickdrift.jit.compile import features
from kickdrift.jit.inner import overload
from kickdrift.jit.vectors import constant, half_single_type, half_type, lanes_type, single_type


class Whole(NamedTuple):
    """An entry of a row is a cluster."""


class Halves(NamedTuple):
    """An entry of a row is half a cluster."""


class Wide(NamedTuple):
    """8 lanes of float64: a particle against a cluster."""

    per_row: int = 1  # particles to a row of the list
    block: Whole | Halves = Whole()  # what an entry of a row is


class WideSingle(NamedTuple):
    """16 lanes of float32: two particles against a cluster."""

    per_row: int = 2
    block: Whole | Halves = Whole()


class Narrow(NamedTuple):
    """4 lanes of float64: a particle against half a cluster."""

    per_row: int = 1
    block: Whole | Halves = Halves()


class NarrowSingle(NamedTuple):
    """8 lanes of float32: a particle against a cluster."""

    per_row: int = 1
    block: Whole | Halves = Whole()


RowLanes = Wide | WideSingle | Narrow | NarrowSingle
LANES = {Wide: lanes_type, WideSingle: single_type, Narrow: half_type, NarrowSingle: half_single_type}


def row_lanes(mixed: bool) -> RowLanes:
    """The lanes of a step on the processor that code is compiled for, in float64 or mixed precision."""
    if "avx512f" in features():
        return WideSingle() if mixed else Wide()
    return NarrowSingle() if mixed else Narrow()


def blocks(block: Any) -> int:
    """How many entries of a row a cluster makes: 1 or 2, a constant in compiled code."""
    return 2 if isinstance(block, Halves) else 1


@overload(blocks)
def _blocks(block):
    return (lambda block: 2) if block.instance_class is Halves else (lambda block: 1)


@intrinsic
def nothing(typingctx, row_lanes):
    """Zero in all lanes of a step; where other functions take it, its type says how wide they work."""
    kind = LANES[row_lanes.instance_class]

    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return constant(0.0, kind.vector)

    return kind(row_lanes), codegen
