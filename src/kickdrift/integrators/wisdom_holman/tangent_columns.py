"""Derivatives of a state in blocks of duals, for tangent maps: on their way in and out, and pushed by other forces.

To first order a block has eight columns. To second order it has one column and eight others, the second derivatives by
the one and each of the eight, and the first derivatives. Memory with a last axis of two numbers holds these.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.seam.kernel import FORCES, OK, call_force
from kickdrift.forces.slopes.dual_slopes import NO_DUALS, call_slopes
from kickdrift.jit.compile import jit, never_inline
from kickdrift.jit.duals.dual import DUAL, SLOT, dual, dual_rows
from kickdrift.jit.duals.operators import vector_at
from kickdrift.jit.inner import by_type, overload
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


NO_SLOPES = 101  # status: a force without a formula on duals


def to_first_order(function: Callable[..., Any]) -> Callable[..., Any]:
    """Limit a function that evaluates forces other than gravity and returns a status. These forces have no second
    derivatives. If the first argument, ``rows``, has the shape (rows, numbers, 2), the status is NO_DUALS, and the
    function is not compiled."""

    def stub(*given: Any) -> Any: ...

    def code(*given):
        return (lambda *given: function(*given)) if given[0].ndim == 2 else (lambda *given: NO_DUALS)

    overload(stub)(code)
    return stub


@jit
def feel(a, x, v, n, t, others, pushes, block):
    """a <- the accelerations by other forces at x and v, three rows of a block. Return a status."""
    never_inline()
    a[:] = 0.0
    for k in range(others.shape[0]):
        status = call_slopes(others[k, 0], others[k, 1], n, t, x, v, a)
        if status != OK:
            return NO_SLOPES if status == NO_DUALS else status
    return add_pushes(a, dual_rows(x, n), dual_rows(v, n), n, t, pushes, block) if pushes.shape[0] > 0 else OK


@jit
def add_pushes(numbers, own_x, own_v, n, t, pushes, block):
    """Add to the slopes of a block what masses and parameters do in other forces. Return a status.

    ``pushes`` (k, 3) are the column, and the addresses of a `pushes_kernel.PushKernel` and its parts. ``numbers`` hold
    the duals of the accelerations at ``own_x`` and ``own_v``."""
    never_inline()
    phase, a = np.zeros((2, 3, 2 * n)), np.empty((3, 2 * n))
    for i in range(n):
        place, speed = vector_at(own_x, i).value, vector_at(own_v, i).value
        phase[0, 0, i], phase[0, 1, i], phase[0, 2, i] = place.x, place.y, place.z
        phase[1, 0, i], phase[1, 1, i], phase[1, 2, i] = speed.x, speed.y, speed.z
    for row in range(pushes.shape[0]):
        if pushes[row, 0] // WIDTH != block:
            continue
        a[:, :] = 0.0
        status = call_force(pushes[row, 1], pushes[row, 2], FORCES, t, phase[0], phase[1], a, None)
        if status != OK:
            return status
        for k in range(3):
            for i in range(n):
                numbers[(k * n + i) * SLOT + 1 + pushes[row, 0] % WIDTH] += a[k, n + i]
    return OK
