"""The slope of a pair law by one of its parameters, on a cluster list, added to one column of deviations.

The law's own formula on duals gives the slope, so it is exact. The pair loop runs with the slope in the law's place.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.pairs.beside_pairs import BesidePairs, accelerations_of_own
from kickdrift.forces.pairs.binding import pair_numbers
from kickdrift.forces.pairs.kernel import PairKernel
from kickdrift.forces.pairs.lanes import LawSlope
from kickdrift.forces.pairs.law import PairForce
from kickdrift.forces.pairs.upkeep import tables_of
from kickdrift.forces.seam.kernel import OK
from kickdrift.jit.compile import jit
from kickdrift.model.state import Floats
from kickdrift.model.system import System

STEP = 2.0**-10  # of the parameter's size, for the parameters of mixed pairs; exact where they are linear in it


class PairPush(NamedTuple):
    """The slope of a pair law, and its column."""

    force: Any  # PairWork
    address: int  # of the machine code of this force
    work: int
    phase: NDArray[np.float64]  # (2, 3, n)
    a: NDArray[np.float64]  # (3, n)
    column: int
    size: float  # change of the parameter that the column stands for


class PairPushKernel(BesidePairs):
    """A bound slope of a pair force: ``parts`` is a PairPush."""


def bind(force: PairForce, key: str, system: System, threads: int, column: int, size: float) -> PairPushKernel:
    """Bind the slope of a pair force by its parameter ``key``."""
    n, bound, by = len(system), force.bind(system, threads), _by(force, key, system)
    work = bound.parts
    law = LawSlope(work.law, type(work.law)(*(float(each) for each in by[:, 0, 0])), work.cutoff**2)
    numbers = pair_numbers(force, system.species)
    numbers = np.insert(numbers, [len(work.law)], by, axis=0)
    tables = tables_of(numbers, system.species_index, work.pairs.x.size // 3, work.lanes)
    own = PairKernel(work._replace(law=law, tables=tables, tail=(0.0, 0.0)))
    return PairPushKernel(PairPush(own.parts, 0, 0, np.zeros((2, 3, n)), np.zeros((3, n)), column, size), own)


def _by(force: PairForce, key: str, system: System) -> Floats:
    """Derivatives (parameters, species, species) of the parameters of each pair of species by the parameter ``key``."""
    value, names = float(getattr(force, key)), system.species
    step = float(2.0 ** np.round(np.log2(STEP * (abs(value) or 1.0))))

    def at(k: int) -> Floats:
        moved: Any = replace(force, **{key: value + k * step})  # type: ignore[arg-type]
        return np.array([[moved.pair_law(a, b) for b in names] for a in names], dtype=float).transpose(2, 0, 1)

    return np.asarray((8.0 * (at(1) - at(-1)) - (at(2) - at(-2))) / (12.0 * step))


@jit
def add_push(force, wanted, t, x, v, a, sums):
    """Add the slope to the accelerations of the column. Return a status."""
    status = accelerations_of_own(force, False, t, x, v, sums)
    if status == OK:
        n = force.a.shape[1]
        directions = x.shape[1] // n - 1
        for k in range(3):
            for i in range(n):
                a[k, n + i * directions + force.column] += force.size * force.a[k, i]
    return status


PairPushKernel.add = add_push
