"""Multipliers of constraints in compiled code, eight molecules at a time.

*Aiming* changes the velocities so that a drift ends on the manifold: SHAKE (Ryckaert, Ciccotti & Berendsen 1977,
doi:10.1016/0021-9991(77)90098-5), by Newton's iteration for all conditions of a molecule at once (Barth et al. 1995,
doi:10.1002/jcc.540161003). The forces act along the separations before the drift. *Projecting* removes what would
change a distance: the second half of RATTLE (Andersen 1983, doi:10.1016/0021-9991(83)90014-1), a linear system.

With the separation r of a pair before the drift and s after it, the conditions are |s|^2 = d^2. A Newton step makes
them exact but for the square of the change of s, so the error that a step leaves is known without another look.
"""

from typing import Any, NamedTuple

from kickdrift.jit.compile import as_written, never_inline, strict
from kickdrift.jit.lanes.functions import lane_sum, splat
from kickdrift.jit.lanes.gathering import add_picked, picked
from kickdrift.jit.lanes.masks import all_lanes, select
from kickdrift.jit.lanes.memory import flat, load, store
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.jit.threads.chunks import chunk_task

ITERATIONS = 40  # of Newton; a water molecule at 2 fs takes three


class Moving(NamedTuple):
    """What the chunks of a solution need."""

    held: Any
    x: Any
    v: Any
    span: Any


@as_written
def across(held, values, n, axis, row):
    """Differences along an axis between the first and the second particles of a row of pairs."""
    first = picked(values, axis * n, held.one, WIDTH * row)
    return first - picked(values, axis * n, held.other, WIDTH * row)


@strict
def eliminate(matrix, right, size, band):
    """right <- solution of the banded system of each lane, without pivoting. The matrix is overwritten.

    Row k of ``matrix`` has the entries of columns k - band to k + band; both arrays are flat, with eight lanes."""
    wide = 2 * band + 1
    for k in range(size):
        last = min(k + band, size - 1)
        over = 1.0 / load(matrix, WIDTH * (wide * k + band))
        store(matrix, WIDTH * (wide * k + band), over)
        own = load(right, WIDTH * k)
        for row in range(k + 1, last + 1):
            factor = load(matrix, WIDTH * (wide * row + k - row + band)) * over
            for column in range(k + 1, last + 1):
                at = WIDTH * (wide * row + column - row + band)
                store(matrix, at, load(matrix, at) - factor * load(matrix, WIDTH * (wide * k + column - k + band)))
            store(right, WIDTH * row, load(right, WIDTH * row) - factor * own)
    for k in range(size - 1, -1, -1):
        found = load(right, WIDTH * k)
        for column in range(k + 1, min(k + band, size - 1) + 1):
            entry = load(matrix, WIDTH * (wide * k + column - k + band))
            found = found - entry * load(right, WIDTH * column)
        store(right, WIDTH * k, found * load(matrix, WIDTH * (wide * k + band)))


@as_written
def dot(first, a, second, b):
    """Product of the vectors at rows a and b."""
    found = load(first, WIDTH * a) * load(second, WIDTH * b)
    found = found + load(first, WIDTH * (a + 1)) * load(second, WIDTH * (b + 1))
    return found + load(first, WIDTH * (a + 2)) * load(second, WIDTH * (b + 2))


@as_written
def fill_matrix(matrix, coupling, now, before, size, band):
    """Matrix of the conditions: coupling times the products of separations ``now`` with those ``before``."""
    wide = 2 * band + 1
    for k in range(size):
        for column in range(max(0, k - band), min(k + band, size - 1) + 1):
            at = WIDTH * (wide * k + column - k + band)
            store(matrix, at, load(coupling, at) * dot(now, 3 * k, before, 3 * column))


@as_written
def add_impulses(held, values, n, row, before, total, size, scale):
    """values <- values + scale x inverse mass x multiplier x separation, for both particles of each pair."""
    for k in range(size):
        at, push = WIDTH * (row + k), scale * load(total, WIDTH * k)
        one, other = push * load(flat(held.over_one), at), push * load(flat(held.over_other), at)
        for axis in range(3):
            apart = load(before, WIDTH * (3 * k + axis))
            add_picked(values, axis * n, held.one, at, one * apart)
            add_picked(values, axis * n, held.other, at, splat(0.0) - other * apart)


@strict
def aim_block(held, x, v, n, span, b, room):
    """Aim the velocities of block b; return whether the iteration converged."""
    row, size, band = held.first[b], held.first[b + 1] - held.first[b], held.band[b]
    wide = 2 * band + 1
    coupling = flat(held.coupling)[WIDTH * held.entry[b] : WIDTH * held.entry[b + 1]]
    squares = flat(held.squares)[WIDTH * row : WIDTH * (row + size)]
    before, now = room[: WIDTH * 3 * size], room[WIDTH * 3 * size : WIDTH * 6 * size]
    change, total = room[WIDTH * 6 * size : WIDTH * 7 * size], room[WIDTH * 7 * size : WIDTH * 8 * size]
    matrix = room[WIDTH * 8 * size : WIDTH * (8 + wide) * size]
    for k in range(size):
        for axis in range(3):
            apart = across(held, x, n, axis, row + k)
            store(before, WIDTH * (3 * k + axis), apart)
            store(now, WIDTH * (3 * k + axis), apart + span * across(held, v, n, axis, row + k))
        store(total, WIDTH * k, splat(0.0))
    good = False
    for _ in range(ITERATIONS):
        for k in range(size):
            store(change, WIDTH * k, 0.5 * (load(squares, WIDTH * k) - dot(now, 3 * k, now, 3 * k)))
        fill_matrix(matrix, coupling, now, before, size, band)
        eliminate(matrix, change, size, band)
        good = True
        for k in range(size):
            x0, x1, x2 = splat(0.0), splat(0.0), splat(0.0)
            for column in range(max(0, k - band), min(k + band, size - 1) + 1):
                push = load(coupling, WIDTH * (wide * k + column - k + band)) * load(change, WIDTH * column)
                x0 = x0 + push * load(before, WIDTH * 3 * column)
                x1 = x1 + push * load(before, WIDTH * (3 * column + 1))
                x2 = x2 + push * load(before, WIDTH * (3 * column + 2))
            store(now, WIDTH * 3 * k, load(now, WIDTH * 3 * k) + x0)
            store(now, WIDTH * (3 * k + 1), load(now, WIDTH * (3 * k + 1)) + x1)
            store(now, WIDTH * (3 * k + 2), load(now, WIDTH * (3 * k + 2)) + x2)
            left = x0 * x0 + x1 * x1 + x2 * x2
            good = good and all_lanes(left <= (2.0 * held.tolerance) * load(squares, WIDTH * k))
            store(total, WIDTH * k, load(total, WIDTH * k) + load(change, WIDTH * k))
        if good:
            break
    add_impulses(held, v, n, row, before, total, size, 1.0 / span)
    return good


@strict
def project_block(held, x, v, n, b, room):
    """Project the velocities of block b; return the energy that they gain, which is negative."""
    row, size, band = held.first[b], held.first[b + 1] - held.first[b], held.band[b]
    coupling = flat(held.coupling)[WIDTH * held.entry[b] : WIDTH * held.entry[b + 1]]
    before = room[: WIDTH * 3 * size]
    change, rates = room[WIDTH * 6 * size : WIDTH * 7 * size], room[WIDTH * 7 * size : WIDTH * 8 * size]
    matrix = room[WIDTH * 8 * size : WIDTH * (9 + 2 * band) * size]
    for k in range(size):
        rate = splat(0.0)
        for axis in range(3):
            apart = across(held, x, n, axis, row + k)
            store(before, WIDTH * (3 * k + axis), apart)
            rate = rate + apart * across(held, v, n, axis, row + k)
        store(change, WIDTH * k, splat(0.0) - rate)
        store(rates, WIDTH * k, rate)
    fill_matrix(matrix, coupling, before, before, size, band)
    eliminate(matrix, change, size, band)
    gained = 0.0
    for k in range(size):
        some = load(change, WIDTH * k) * load(rates, WIDTH * k)
        gained += 0.5 * lane_sum(select(load(flat(held.over_one), WIDTH * (row + k)) > 0.0, some, 0.0))
    add_impulses(held, v, n, row, before, change, size, 1.0)
    return gained


@as_written
def blocks_of(held, c):
    """First and last block of chunk c, plus one."""
    blocks = held.band.size
    return c * blocks // held.chunks.number, (c + 1) * blocks // held.chunks.number


@chunk_task
def aim_chunk(given, c, thread):
    never_inline()
    held, n = given.held, given.x.shape[1]
    begin, end = blocks_of(held, c)
    for b in range(begin, end):
        good = aim_block(held, flat(given.x), flat(given.v), n, given.span, b, held.room[thread])
        held.failed[b] = 0 if good else 1


@chunk_task
def project_chunk(given, c, thread):
    never_inline()
    held, n = given.held, given.x.shape[1]
    begin, end = blocks_of(held, c)
    for b in range(begin, end):
        held.gained[b] = project_block(held, flat(given.x), flat(given.v), n, b, held.room[thread])
