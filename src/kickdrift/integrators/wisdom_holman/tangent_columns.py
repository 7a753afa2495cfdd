"""Derivatives of a state in blocks of duals, for tangent maps: on their way in and out.

To first order a block has eight columns. To second order it has one column and eight others, the second derivatives by
the one and each of the eight, and the first derivatives. Memory with a last axis of two numbers holds these.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.jit.compile import jit
from kickdrift.jit.duals.dual import DUAL, SLOT, dual
from kickdrift.jit.inner import by_type
from kickdrift.jit.lanes.memory import flat, masked_load, masked_store
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.model.state import Floats


class Derived(NamedTuple):
    """Numbers with their derivatives by c columns."""

    values: NDArray[np.float64]  # (numbers,)
    slopes: NDArray[np.float64]  # (numbers, c)
    second: NDArray[np.float64]  # (numbers, c, c); without numbers to first order


class Blocks(NamedTuple):
    """Rows of duals, for each block of columns."""

    rows: NDArray[np.float64]  # (blocks, rows, numbers), to second order (blocks, rows, numbers, 2)
    columns: NDArray[np.int64]  # (blocks, 2) the one column, and the first of the eight; to first order the eight alone


def derived(values: Floats, slopes: Floats, second: Floats | None) -> Derived:
    """Numbers of any shape, with first derivatives (…, c), and second ones (…, c, c) or None."""
    count = slopes.shape[-1]
    twice = np.zeros((0, 0, 0)) if second is None else second.reshape(-1, count, count)
    return Derived(*(np.ascontiguousarray(each) for each in (values.ravel(), slopes.reshape(-1, count), twice)))


def derived_room(shape: tuple[int, ...], columns: int, twice: bool) -> Derived:
    """Room for numbers of this shape and their derivatives."""
    second = np.zeros((*shape, columns, columns)) if twice else None
    return derived(np.zeros(shape), np.zeros((*shape, columns)), second)


def blocks_of(columns: int, rows: int, n: int, twice: bool) -> Blocks:
    """Blocks for so many columns, with rows of n vectors."""
    firsts = [range(one, columns, WIDTH) for one in range(columns if twice else 1)]
    places = [(one, first) for one, each in enumerate(firsts) for first in each]
    shape = (len(places), rows, 3 * n * SLOT)
    return Blocks(np.zeros((*shape, 2) if twice else shape), np.array(places, np.int64).reshape(-1, 2))


def second_of(found: Derived, shape: tuple[int, ...]) -> Floats:
    """All second derivatives (*shape, c, c), from those by each column and the columns from this one on."""
    twice = np.triu(found.second)
    whole = twice + np.triu(twice, 1).swapaxes(1, 2)
    return whole.reshape(*shape, *whole.shape[1:])


@jit
def eight(numbers, row, first):
    """Up to eight numbers of a row of an array (rows, columns), from column ``first`` on."""
    columns = numbers.shape[1]
    return masked_load(flat(numbers), row * columns + first, min(WIDTH, columns - first))


@jit
def put_eight(numbers, row, first, lanes):
    """Write up to eight numbers to a row of an array (rows, columns), from column ``first`` on."""
    columns = numbers.shape[1]
    masked_store(flat(numbers), row * columns + first, lanes, min(WIDTH, columns - first))


@by_type
def enter_number(x, k, i, of, row, columns):
    """x[k, i] <- number ``row`` of ``Derived``, with derivatives by the columns of a block."""

    def once(x, k, i, of, row, columns):
        x[k, i] = dual(of.values[row], eight(of.slopes, row, columns[1]))

    def twice(x, k, i, of, row, columns):
        one, first = columns[0], columns[1]
        along = dual(of.slopes[row, one], eight(of.second[row], one, first))
        x[k, i] = dual(dual(of.values[row], eight(of.slopes, row, first)), along)

    return once if x.dtype == DUAL else twice


@by_type
def leave_number(of, row, number, columns):
    """Number ``row`` of ``Derived`` <- a dual, with derivatives by the columns of a block."""

    def once(of, row, number, columns):
        of.values[row] = number.value
        put_eight(of.slopes, row, columns[1], number.slope)

    def twice(of, row, number, columns):
        one, first = columns[0], columns[1]
        of.values[row] = number.value.value
        put_eight(of.second[row], one, first, number.slope.slope)
        if one == 0:
            put_eight(of.slopes, row, first, number.value.slope)

    return once if number == DUAL else twice


@jit
def enter_masses(masses, of, columns):
    """masses[0] <- G times the masses."""
    for i in range(masses.shape[1]):
        enter_number(masses, 0, i, of, i, columns)


@jit
def enter_phase(x, half, of, columns):
    """x (3, n) <- positions (``half`` 0) or velocities (1) of a phase (2, 3, n)."""
    n = x.shape[1]
    for k in range(3):
        for i in range(n):
            enter_number(x, k, i, of, (half * 3 + k) * n + i, columns)
