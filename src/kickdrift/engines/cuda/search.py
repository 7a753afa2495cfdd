"""Neighbours of particles, on the device.

A list has groups of four neighbours, which one load reads. Threads that share a particle take its groups in turn, and
the groups that a warp reads at once are beside each other.

The search has one thread for each particle. The particles of a warp are in one line of cells, or in a few, so that the
warp looks at the same candidates: 32 at a time, whose hits are the bits of a word.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numba import cuda

from kickdrift.engines.cuda.cells import FINE, Grid
from kickdrift.engines.cuda.law_code import Code, on_device
from kickdrift.engines.cuda.places import Places
from kickdrift.engines.cuda.words import WARP, loaded, store, told, votes

FOUR = np.uint32(4)


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


@lru_cache(maxsize=8)
def search_of(grid: Grid, places: Places, reach: float, lanes: int) -> Code:
    """Kernel that writes the neighbours of each particle within ``reach``, their numbers, and the largest number. It
    reads up to three places after the last particle."""
    (na, nb, nc), _, _, (pa, pb, pc) = grid
    read, apart = places.read, places.apart
    square = np.float32(reach**2 * 1.00001) if places.single else np.float64(reach**2)
    beside_a, beside_b = beside_of(na, pa), beside_of(nb, pb)
    each, shared, length, lines = np.uint32(WARP // lanes), np.uint32(lanes), np.uint32(nc), np.uint32(nb)

    def near_to(own, place):
        dx, dy, dz = apart(own, place)
        return np.uint32(dx * dx + dy * dy + dz * dz < square)

    def put(row, at, number, a, b, c, d):
        group = np.uint32((number >> np.uint32(2)) - np.uint32(1))
        place = np.uint32((group // shared) * np.uint32(WARP) + at + group % shared)
        store(row, place, a, b, c, d)

    near_to, put, fitting = on_device(near_to), on_device(put), on_device(room_of)

    @cuda.jit(fastmath=places.rounding)
    def search(placed, homes, starts, near, counts, most):
        i = np.uint32(cuda.grid(1))
        inside = i < counts.size
        i = i if inside else np.uint32(0)
        own, cell = read(placed, i), np.uint32(homes[i])
        line = np.uint32(cell // length)
        c = np.int32(cell - line * length)
        row, at = near[np.uint32(i // each)], np.uint32((i % each) * shared)
        room = np.uint32(fitting(near, lanes))
        found, w, x, y, z = np.uint32(0), np.uint32(0), np.uint32(0), np.uint32(0), np.uint32(0)
        rest = votes(inside)
        while rest != 0:  # a line whose particles have not yet searched
            first = np.int32(cuda.ffs(rest) - 1)
            common, low = np.uint32(told(np.int32(line), first)), np.int32(told(c, first) - FINE)
            mine = inside and line == common
            members = votes(mine)
            rest = np.uint32(rest & ~members)
            high = np.int32(told(c, np.int32(31 - cuda.clz(members))) + FINE)
            if pc and high - low >= nc - 1:
                low, high = np.int32(0), np.int32(nc - 1)
            if not pc:
                low, high = np.int32(max(low, 0)), np.int32(min(high, nc - 1))
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
                    base, now = np.int32(np.int32(ka * nb + kb) * nc), low
                    while now <= high:  # a run of cells that ends at the end of the line or goes around the box
                        begin = np.int32(now + nc) if now < 0 else np.int32(now - nc) if now >= nc else now
                        run = np.int32(min(high - now + 1, nc - begin))
                        now = np.int32(now + run)
                        j = np.uint32(starts[np.uint32(base + begin)])
                        end = np.uint32(starts[np.uint32(base + begin + run)])
                        while j < end:
                            hits, bit = np.uint32(0), np.uint32(0)
                            left = np.uint32(min(end - j, np.uint32(32)))
                            while bit < left:
                                k = np.uint32(j + bit)
                                p0, p1 = read(placed, k), read(placed, np.uint32(k + 1))
                                p2, p3 = read(placed, np.uint32(k + 2)), read(placed, np.uint32(k + 3))
                                four = near_to(own, p0) | (near_to(own, p1) << 1)
                                four |= (near_to(own, p2) << 2) | (near_to(own, p3) << 3)
                                hits = np.uint32(hits | np.uint32(np.uint32(four) << bit))
                                bit = np.uint32(bit + FOUR)
                            hits = np.uint32(hits & (np.uint32(0xFFFFFFFF) >> np.uint32(32 - left)))
                            itself = np.int64(i) - np.int64(j)
                            if 0 <= itself < 32:
                                hits = np.uint32(hits & ~np.uint32(np.uint32(1) << np.uint32(itself)))
                            hits = hits if mine else np.uint32(0)
                            while hits != 0:
                                w, x, y, z = x, y, z, np.uint32(j + np.uint32(cuda.ffs(hits)) - np.uint32(1))
                                hits = np.uint32(hits & (hits - np.uint32(1)))
                                found = np.uint32(found + 1)
                                if found % FOUR == 0 and found <= room:
                                    put(row, at, found, w, x, y, z)
                            j = np.uint32(j + np.uint32(32))
        if inside:
            number = found
            while found % FOUR != 0:
                w, x, y, z = x, y, z, np.uint32(0)
                found = np.uint32(found + 1)
            if found > number and found <= room:
                put(row, at, found, w, x, y, z)
            counts[i] = min(number, room)
            if number > most[0]:
                cuda.atomic.max(most, 0, np.int32(number))

    return search
