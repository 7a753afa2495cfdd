"""Neighbours of particles, on the device.

A list has groups of four neighbours, which one load reads. Threads that share a particle take its groups in turn, and
the groups that a warp reads at once are beside each other.

The search has one thread for each particle. The particles of a warp are in one line of cells, or in a few, so that the
warp looks at the same candidates. Each thread reads one of them. Those within reach of the box around the warp's
particles go to shared memory, relative to the middle of this box and in float32. Then each thread tests 128 of them,
and its hits are the bits of four words. The reach is longer by what float32 rounds, so that no neighbour is lost.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numba import config, cuda

from kickdrift.engines.cuda.cells import FINE, Grid
from kickdrift.engines.cuda.launches import THREADS
from kickdrift.engines.cuda.law_code import Code, on_device
from kickdrift.engines.cuda.motion import MOST
from kickdrift.engines.cuda.places import ROUNDED, Places
from kickdrift.engines.cuda.words import WARP, least, loaded, store, together, told, votes

FOUR = np.uint32(4)
WORD = 32  # candidates whose hits are bits of one word
BATCH = 4 * WORD  # candidates that a thread tests before it writes neighbours
SPANNED = 64  # cells of a line at most, along which the particles of a warp search at once

if config.ENABLE_CUDASIM:

    def shared_numbers(size: int, kind: Any) -> Any:
        """Function that returns an array in shared memory."""
        return lambda: cuda.shared.array(size, kind)

else:
    from kickdrift.engines.cuda.words import shared_numbers


def list_shape(n: int, room: int, lanes: int) -> tuple[int, int]:
    """Shape of a list of n particles with ``room`` neighbours each, which ``lanes`` threads share."""
    groups = -(-room // (4 * lanes)) + 1  # and one that is loaded but not used
    return -(-n * lanes // WARP), 4 * WARP * groups


def room_of(near: Any, lanes: int) -> Any:
    """Neighbours that fit for each particle."""
    return (near.shape[1] // (4 * WARP) - 1) * 4 * lanes


@lru_cache(maxsize=8)
def group_of(lanes: int) -> Code:
    """Device function of a row, a particle and a number that returns the group's neighbours of this number."""
    each, apart = np.uint32(WARP // lanes), np.uint32(lanes)

    def group(near, i, number):
        warp = np.uint32(i // each)
        place = np.uint32((number // apart) * np.uint32(WARP) + (i - warp * each) * apart + number % apart)
        return loaded(near[warp], place)

    return on_device(group)


def beside_of(count: int, periodic: bool) -> Code:
    """Device function of a line's number along an axis and of 0, 1 or 2 that returns the number of a line beside it,
    or one out of range where there is none."""

    def beside(c, d):
        k = np.int32(np.int32(c) + d - 1) if count > 2 else np.int32(d)
        if periodic and k < 0:
            k = np.int32(count - 1)
        if periodic and k >= count:
            k = np.int32(0)
        return k

    return on_device(beside)


def folding_of(grid: Grid) -> tuple[tuple[Code, Code, Code], int]:
    """Device functions that bring a displacement along each axis to the nearest image, where the particles of a warp
    and their neighbours may lie further apart than half of the box; and how many cells of a line these particles span
    at most."""
    (na, nb, nc), _, inverse, periodic = grid
    longest = nc // 2 - FINE - 2
    folded = []
    for count, each, wraps, few in zip(grid.counts, inverse, periodic, (na < 5, nb < 5, longest < FINE), strict=True):
        folded.append(fold_of(count / each) if wraps and few else on_device(lambda d: d))
    return tuple(folded), min(longest, SPANNED) if periodic[2] and longest >= FINE else SPANNED  # type: ignore[return-value]


def fold_of(edge: float) -> Code:
    """Device function that brings a displacement to the nearest image."""
    length, inverse, whole = np.float32(edge), np.float32(1.0 / edge), np.float32(1.5 * 2.0**23)
    return on_device(lambda d: d - length * (np.float32(d * inverse + whole) - whole))


@lru_cache(maxsize=8)
def sifting_of(grid: Grid, lanes: int) -> Code:
    """Device function that tests up to 128 candidates in shared memory, and writes those within reach, four at a time.
    It returns how many neighbours are found, and the last four of them."""
    (fold_a, fold_b, fold_c), _ = folding_of(grid)
    put, word = put_of(lanes), np.uint32(WORD)

    def part(count, before):
        """Candidates of a word, after those of the words before."""
        return np.uint32(min(count - before, word) if count > before else 0)

    part = on_device(part)

    def near_to(x, y, z, limit, spots, place):
        px, py, pz, _ = loaded(spots, place)
        dx, dy, dz = fold_a(x - px), fold_b(y - py), fold_c(z - pz)
        return np.uint32(dx * dx + dy * dy + dz * dz < limit)

    near_to = on_device(near_to, ROUNDED)

    def tested(own, spots, base, count):
        """Which of up to 32 candidates are within reach, as bits."""
        x, y, z, limit = own
        hits, bit = np.uint32(0), np.uint32(0)
        while bit < count:
            k = np.uint32(base + bit)
            four = near_to(x, y, z, limit, spots, k) | (near_to(x, y, z, limit, spots, np.uint32(k + 1)) << 1)
            four |= near_to(x, y, z, limit, spots, np.uint32(k + 2)) << 2
            four |= near_to(x, y, z, limit, spots, np.uint32(k + 3)) << 3
            hits = np.uint32(hits | np.uint32(np.uint32(four) << bit))
            bit = np.uint32(bit + FOUR)
        return np.uint32(hits & (np.uint32(0xFFFFFFFF) >> np.uint32(WORD - count)) if count > 0 else 0)

    tested = on_device(tested, ROUNDED)

    def sift(i, mine, own, spots, names, base, count, row, at, room, found, last):
        n0, n1, n2, n3 = last
        h0 = tested(own, spots, base, np.uint32(min(count, word)))
        h1 = tested(own, spots, np.uint32(base + word), part(count, word))
        h2 = tested(own, spots, np.uint32(base + word + word), part(count, np.uint32(word + word)))
        h3 = tested(own, spots, np.uint32(base + word + word + word), part(count, np.uint32(word + word + word)))
        while mine and (h0 | h1 | h2 | h3) != 0:
            if h0 != 0:
                name = names[np.uint32(base + np.uint32(cuda.ffs(h0)) - np.uint32(1))]
                h0 = np.uint32(h0 & (h0 - np.uint32(1)))
                if name != i:
                    n0, n1, n2, n3, found = n1, n2, n3, name, np.uint32(found + 1)
                    if found % FOUR == 0 and found <= room:
                        put(row, at, found, n0, n1, n2, n3)
            if h0 == 0:
                h0, h1, h2, h3, base = h1, h2, h3, np.uint32(0), np.uint32(base + word)
        return found, (n0, n1, n2, n3)

    return on_device(sift, ROUNDED)


def put_of(lanes: int) -> Code:
    """Device function that writes the last four of a number of neighbours to a row."""
    shared, warp = np.uint32(lanes), np.uint32(WARP)

    def put(row, at, number, n0, n1, n2, n3):
        group = np.uint32((number >> np.uint32(2)) - np.uint32(1))
        store(row, np.uint32((group // shared) * warp + at + group % shared), n0, n1, n2, n3)

    return on_device(put)


@lru_cache(maxsize=8)
def search_of(grid: Grid, places: Places, reach: float, lanes: int) -> Code:
    """Kernel that writes the neighbours of each particle within ``reach``, their numbers, and the largest as a mark."""
    (na, nb, nc), _, _, (pa, pb, pc) = grid
    read, apart = places.read, places.apart
    square, rounded, far = np.float32(reach**2), np.float32(reach * 2.0**-18), np.float32(3e38)
    radius, half, none = np.float32(reach), np.float32(0.5), np.float32(0.0)
    (fold_a, fold_b, fold_c), spanned = folding_of(grid)
    beside_a, beside_b = beside_of(na, pa), beside_of(nb, pb)
    each, shared, length, lines = np.uint32(WARP // lanes), np.uint32(lanes), np.uint32(nc), np.uint32(nb)
    warp, batch, staged = np.uint32(WARP), np.uint32(BATCH), np.uint32(BATCH + WARP)
    places_here = (BATCH + WARP) * (THREADS // WARP)
    spots_of = shared_numbers(4 * places_here, np.float32)

    def from_origin(place, origin):
        dx, dy, dz = apart(place, origin)
        return np.float32(dx), np.float32(dy), np.float32(dz)

    def middle(d, mine):
        low, high = least(d if mine else far), -least(-d if mine else far)
        return half * (low + high), half * (high - low)

    def beyond(d, size):
        return max(abs(d) - size, none)

    from_origin, middle, beyond = on_device(from_origin, ROUNDED), on_device(middle), on_device(beyond)
    sift, put, fitting = sifting_of(grid, lanes), put_of(lanes), on_device(room_of)

    @cuda.jit(fastmath=ROUNDED)
    def search(placed, homes, starts, near, counts, marks):
        spots, names = spots_of(), cuda.shared.array(places_here, np.uint32)
        t = np.uint32(cuda.threadIdx.x)
        lane, base = np.uint32(t % warp), np.uint32(np.uint32(t // warp) * staged)
        before = np.uint32((np.uint32(1) << lane) - np.uint32(1))  # threads of the warp before this one
        place = lane
        while place < staged:  # a thread also tests up to three places without a candidate
            store(spots, np.uint32(base + place), none, none, none, none)
            place = np.uint32(place + warp)
        i = np.uint32(cuda.grid(1))
        inside = i < counts.size
        i = i if inside else np.uint32(0)
        here, cell = read(placed, i), np.uint32(homes[i])
        line = np.uint32(cell // length)
        c = np.int32(cell - line * length)
        row, at = near[np.uint32(i // each)], np.uint32((i % each) * shared)
        room, found = np.uint32(fitting(near, lanes)), np.uint32(0)
        last = (np.uint32(0), np.uint32(0), np.uint32(0), np.uint32(0))
        rest = votes(inside)
        while rest != 0:  # particles of one line that have not yet searched
            first = np.int32(cuda.ffs(rest) - 1)
            common, low = np.uint32(told(np.int32(line), first)), np.int32(told(c, first))
            mine = inside and line == common and low <= c and c <= low + spanned
            members = votes(mine)
            rest = np.uint32(rest & ~members)
            low, high = np.int32(low - FINE), np.int32(told(c, np.int32(31 - cuda.clz(members))) + FINE)
            if pc and high - low >= nc - 1:
                low, high = np.int32(0), np.int32(nc - 1)
            if not pc:
                low, high = np.int32(max(low, 0)), np.int32(min(high, nc - 1))
            origin = read(placed, np.uint32(told(np.int32(i), first)))
            x, y, z = from_origin(here, origin)
            (cx, hx), (cy, hy), (cz, hz) = middle(x, mine), middle(y, mine), middle(z, mine)
            limit = square + rounded * (hx + hy + hz + radius)
            own = (x - cx, y - cy, z - cz, limit)
            count = np.uint32(0)
            a = np.uint32(common // lines)
            b = np.uint32(common - a * lines)
            for da in range(min(na, 3)):
                ka = beside_a(a, da)
                if ka < 0 or ka >= na:
                    continue
                for db in range(min(nb, 3)):
                    kb = beside_b(b, db)
                    if kb < 0 or kb >= nb:
                        continue
                    start, now = np.int32(np.int32(ka * nb + kb) * nc), low
                    while now <= high:  # a run of cells that ends at the end of the line or goes around the box
                        begin = np.int32(now + nc) if now < 0 else np.int32(now - nc) if now >= nc else now
                        run = np.int32(min(high - now + 1, nc - begin))
                        now = np.int32(now + run)
                        j = np.uint32(starts[np.uint32(start + begin)])
                        end = np.uint32(starts[np.uint32(start + begin + run)])
                        while j < end:
                            k = np.uint32(j + lane)
                            valid = k < end
                            px, py, pz = from_origin(read(placed, k if valid else j), origin)
                            px, py, pz = px - cx, py - cy, pz - cz
                            qx, qy, qz = beyond(fold_a(px), hx), beyond(fold_b(py), hy), beyond(fold_c(pz), hz)
                            taken = valid and qx * qx + qy * qy + qz * qz < limit
                            hits = votes(taken)
                            if taken:
                                place = np.uint32(base + count + np.uint32(cuda.popc(hits & before)))
                                store(spots, place, px, py, pz, none)
                                names[place] = k
                            count = np.uint32(count + np.uint32(cuda.popc(hits)))
                            j = np.uint32(j + warp)
                            if count >= batch:
                                together()
                                found, last = sift(i, mine, own, spots, names, base, batch, row, at, room, found, last)
                                together()
                                count = np.uint32(count - batch)
                                if lane < count:  # the rest goes to the front
                                    k = np.uint32(base + batch + lane)
                                    px, py, pz, _ = loaded(spots, k)
                                    store(spots, np.uint32(base + lane), px, py, pz, none)
                                    names[np.uint32(base + lane)] = names[k]
                                together()
            if count != 0:
                together()
                found, last = sift(i, mine, own, spots, names, base, count, row, at, room, found, last)
                together()
        if inside:
            number, (n0, n1, n2, n3) = found, last
            while found % FOUR != 0:
                n0, n1, n2, n3, found = n1, n2, n3, np.uint32(0), np.uint32(found + 1)
            if found > number and found <= room:
                put(row, at, found, n0, n1, n2, n3)
            counts[i] = min(number, room)
            found = number
        many = -least(-np.float32(found if inside else 0))
        if lane == 0 and many > marks[MOST]:
            cuda.atomic.max(marks, MOST, np.float64(many))

    return search
