"""Multipliers of constraints in compiled code, eight molecules at a time.

*Aiming* changes the velocities so that a drift ends on the manifold: SHAKE (Ryckaert, Ciccotti & Berendsen 1977,
doi:10.1016/0021-9991(77)90098-5), by Newton's iteration for all conditions of a molecule at once (Barth et al. 1995,
doi:10.1002/jcc.540161003). The forces act along the separations before the drift. *Projecting* removes what would
change a distance: the second half of RATTLE (Andersen 1983, doi:10.1016/0021-9991(83)90014-1), a linear system.

Triangles, such as water, are most of what runs: their particles are loaded once, as whole vectors where those of eight
molecules follow one another, and all else stays in registers.

With the separation r of a pair before the drift and s after it, the conditions are |s|^2 = d^2. A Newton step makes
them exact but for the square of the change of s, so the error that a step leaves is known without another look.
"""

from typing import Any, NamedTuple

from kickdrift.integrators.splitting.constraints.blocks import OTHER
from kickdrift.jit.compile import as_written, never_inline, strict
from kickdrift.jit.lanes.functions import lane_sum, splat
from kickdrift.jit.lanes.gathering import add_picked, picked, store_thirds, thirds
from kickdrift.jit.lanes.masks import all_lanes, select
from kickdrift.jit.lanes.memory import flat, load, store
from kickdrift.jit.lanes.vector3 import dot as product
from kickdrift.jit.lanes.vector3 import vector3
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
def corners(held, values, n, b):
    """Vectors of the values at the corners of a block's triangles."""
    at, row = held.triangles[b], WIDTH * held.first[b]
    if at >= 0:
        x, y, z = thirds(values, at), thirds(values, n + at), thirds(values, 2 * n + at)
        return vector3(x[0], y[0], z[0]), vector3(x[1], y[1], z[1]), vector3(x[2], y[2], z[2])
    next_row = row + WIDTH
    return corner(values, n, held.one, row), corner(values, n, held.other, row), corner(values, n, held.other, next_row)


@as_written
def corner(values, n, places, at):
    """Vector of the values at eight particles."""
    return vector3(picked(values, 0, places, at), picked(values, n, places, at), picked(values, 2 * n, places, at))


@as_written
def sides(held, values, n, b):
    """Vectors between the corners, a - b, a - c and b - c."""
    first, second, third = corners(held, values, n, b)
    return first - second, first - third, second - third


@as_written
def shares_of(held, b):
    """Inverse masses of the corners of block b, also of copies."""
    coupling, at = flat(held.coupling), WIDTH * held.entry[b]
    return load(coupling, at + 3 * WIDTH), splat(0.0) - load(coupling, at + 4 * WIDTH), load(coupling, at + 8 * WIDTH)


@as_written
def multipliers(shares, now, before, right):
    """Solution of the three conditions of triangles, whose matrix is coupling times ``now`` times ``before``."""
    (a, b, c), (s0, s1, s2), (r0, r1, r2), (h0, h1, h2) = shares, now, before, right
    over = 1.0 / ((a + b) * product(s0, r0))
    m01, m02 = a * product(s0, r1), splat(0.0) - b * product(s0, r2)
    first, second = a * product(s1, r0) * over, splat(0.0) - b * product(s2, r0) * over
    m11, m12 = (a + c) * product(s1, r1) - first * m01, c * product(s1, r2) - first * m02
    m21, m22 = c * product(s2, r1) - second * m01, (b + c) * product(s2, r2) - second * m02
    h1, h2 = h1 - first * h0, h2 - second * h0
    next_over = 1.0 / m11
    third = m21 * next_over
    k2 = (h2 - third * h1) / (m22 - third * m12)
    k1 = (h1 - m12 * k2) * next_over
    return (h0 - m01 * k1 - m02 * k2) * over, k1, k2


@as_written
def pushes(shares, k, before):
    """Changes of the corners by multipliers."""
    p0, p1, p2 = k[0] * before[0], k[1] * before[1], k[2] * before[2]
    return shares[0] * (p0 + p1), shares[1] * (p2 - p0), -(shares[2] * (p1 + p2))


@as_written
def push_corners(held, v, n, b, k, before):
    """Add what multipliers do to the velocities of the corners."""
    over_one, over_other, at, row = flat(held.over_one), flat(held.over_other), held.triangles[b], WIDTH * held.first[b]
    shares = load(over_one, row), load(over_other, row), load(over_other, row + WIDTH)
    first, second, third = pushes(shares, k, before)
    if at >= 0:
        old_first, old_second, old_third = corners(held, v, n, b)
        first, second, third = old_first + first, old_second + second, old_third + third
        store_thirds(v, at, first.x, second.x, third.x)
        store_thirds(v, n + at, first.y, second.y, third.y)
        store_thirds(v, 2 * n + at, first.z, second.z, third.z)
    else:
        add_corner(v, n, held.one, row, first)
        add_corner(v, n, held.other, row, second)
        add_corner(v, n, held.other, row + WIDTH, third)


@as_written
def add_corner(values, n, places, at, vector):
    add_picked(values, 0, places, at, vector.x)
    add_picked(values, n, places, at, vector.y)
    add_picked(values, 2 * n, places, at, vector.z)


@strict
def aim_triangles(held, x, v, n, span, b):
    """Aim the velocities of a block of triangles; return whether the iteration converged."""
    row, shares, squares = held.first[b], shares_of(held, b), flat(held.squares)
    q0, q1, q2 = load(squares, WIDTH * row), load(squares, WIDTH * (row + 1)), load(squares, WIDTH * (row + 2))
    before, (u0, u1, u2) = sides(held, x, n, b), sides(held, v, n, b)
    s0, s1, s2 = before[0] + span * u0, before[1] + span * u1, before[2] + span * u2
    t0, t1, t2, most = splat(0.0), splat(0.0), splat(0.0), 2.0 * held.tolerance
    good = False
    for _ in range(ITERATIONS):
        right = 0.5 * (q0 - product(s0, s0)), 0.5 * (q1 - product(s1, s1)), 0.5 * (q2 - product(s2, s2))
        k = multipliers(shares, (s0, s1, s2), before, right)
        first, second, third = pushes(shares, k, before)
        d0, d1, d2 = first - second, first - third, second - third
        s0, s1, s2 = s0 + d0, s1 + d1, s2 + d2
        t0, t1, t2 = t0 + k[0], t1 + k[1], t2 + k[2]
        good = all_lanes(product(d0, d0) <= most * q0) and all_lanes(product(d1, d1) <= most * q1)
        good = good and all_lanes(product(d2, d2) <= most * q2)
        if good:
            break
    scale = 1.0 / span
    push_corners(held, v, n, b, (scale * t0, scale * t1, scale * t2), before)
    return good


@strict
def project_triangles(held, x, v, n, b):
    """Project the velocities of a block of triangles; return the energy that they gain."""
    row = held.first[b]
    before, (u0, u1, u2) = sides(held, x, n, b), sides(held, v, n, b)
    rates = product(before[0], u0), product(before[1], u1), product(before[2], u2)
    k = multipliers(shares_of(held, b), before, before, rates)
    gained = k[0] * rates[0] + k[1] * rates[1] + k[2] * rates[2]  # of the opposite multipliers
    push_corners(held, v, n, b, (splat(0.0) - k[0], splat(0.0) - k[1], splat(0.0) - k[2]), before)
    return -0.5 * lane_sum(select(load(flat(held.over_one), WIDTH * row) > 0.0, gained, 0.0))


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
        if held.triangles[b] != OTHER:
            good = aim_triangles(held, flat(given.x), flat(given.v), n, given.span, b)
        else:
            good = aim_block(held, flat(given.x), flat(given.v), n, given.span, b, held.room[thread])
        held.failed[b] = 0 if good else 1


@chunk_task
def project_chunk(given, c, thread):
    never_inline()
    held, n = given.held, given.x.shape[1]
    begin, end = blocks_of(held, c)
    for b in range(begin, end):
        if held.triangles[b] != OTHER:
            held.gained[b] = project_triangles(held, flat(given.x), flat(given.v), n, b)
        else:
            held.gained[b] = project_block(held, flat(given.x), flat(given.v), n, b, held.room[thread])
