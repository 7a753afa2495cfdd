"""Sums of a pair law over lists of neighbours: each pair twice, and no two threads write to one place.

One or more threads share a particle. A thread loads four neighbours at once, and the numbers of the next four before it
computes these. Forces, energies and virials are sums of whole numbers of 64 bits. So their bits do
not depend on the order of neighbours, and the sum of all forces is zero.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numba import cuda

from kickdrift.engines.cuda.law_code import Code, on_device
from kickdrift.engines.cuda.motion import TOO_LARGE
from kickdrift.engines.cuda.places import Places
from kickdrift.engines.cuda.search import group_of
from kickdrift.engines.cuda.words import ALL, WARP, loaded

LARGEST = 2.0**62


class Law(NamedTuple):
    """A pair law for kernels: ``terms`` returns energy and force over r, see `law_code`."""

    terms: Code
    species: int
    cutoff: float
    force_grain: float
    energy_grain: float


def across_of(lanes: int) -> Code:
    """Device function that adds a whole number over the threads of one particle."""
    if lanes == 1:
        return on_device(lambda number: number)

    def across(number):
        step = lanes // 2
        while step > 0:
            number += cuda.shfl_xor_sync(ALL, number, step)
            step //= 2
        return number

    return on_device(across)


def row_of(species: int) -> Code:
    """Device function of two positions that returns the table's row of their species."""
    many = np.uint32(species)
    if species == 1:
        return on_device(lambda p, q: np.uint32(0))
    return on_device(lambda p, q: np.uint32(np.uint32(p[3]) * many + np.uint32(q[3])))


@lru_cache(maxsize=8)
def forces_of(law: Law, places: Places, lanes: int) -> Code:
    """Kernel that writes the accelerations (3, n) of all particles."""
    read, apart, terms, across, row_for = places.read, places.apart, law.terms, across_of(lanes), row_of(law.species)
    number: Any = np.float32 if places.single else np.float64
    cutoff2, grain, none = number(law.cutoff**2), number(law.force_grain), number(0.0)
    inverse_grain, largest = 1.0 / law.force_grain, LARGEST / law.cutoff
    each, shared = np.uint32(WARP // lanes), np.uint32(lanes)

    def add(own, place, counted, table, fx, fy, fz, total):
        dx, dy, dz = apart(own, place)
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < cutoff2 and counted:
            g = terms(r2, table, row_for(own, place))[1] * grain
            total += abs(g)
            fx += np.int64(g * dx)
            fy += np.int64(g * dy)
            fz += np.int64(g * dz)
        return fx, fy, fz, total

    add = on_device(add, places.rounding)

    @cuda.jit(fastmath=places.rounding)
    def forces(placed, near, counts, inverse_masses, table, a, marks):
        t = np.uint32(cuda.grid(1))
        i, lane, at = np.uint32(t // shared), np.uint32(t % shared), np.uint32(t % np.uint32(WARP))
        inside = i < counts.size
        i = i if inside else np.uint32(0)
        own = read(placed, i)
        fx, fy, fz, total = np.int64(0), np.int64(0), np.int64(0), none
        row, k, end = near[np.uint32(i // each)], np.uint32(4 * lane), np.uint32(counts[i] if inside else 0)
        j0, j1, j2, j3 = loaded(row, at)
        while k < end:
            p0, p1, p2, p3 = read(placed, j0), read(placed, j1), read(placed, j2), read(placed, j3)
            at = np.uint32(at + WARP)
            j0, j1, j2, j3 = loaded(row, at)
            fx, fy, fz, total = add(own, p0, True, table, fx, fy, fz, total)
            fx, fy, fz, total = add(own, p1, np.uint32(k + 1) < end, table, fx, fy, fz, total)
            fx, fy, fz, total = add(own, p2, np.uint32(k + 2) < end, table, fx, fy, fz, total)
            fx, fy, fz, total = add(own, p3, np.uint32(k + 3) < end, table, fx, fy, fz, total)
            k = np.uint32(k + 4 * lanes)
        if not total < largest:
            marks[TOO_LARGE] = 1.0
        fx, fy, fz = across(fx), across(fy), across(fz)
        if inside and lane == 0:
            unit = inverse_grain * inverse_masses[i]
            a[0, i], a[1, i], a[2, i] = fx * unit, fy * unit, fz * unit

    return forces


@lru_cache(maxsize=8)
def measure_of(law: Law, places: Places, lanes: int) -> Code:
    """Kernel that writes rows (5, n) in the order of ``ids``: accelerations, and each particle's energy and virial."""
    read, apart, terms, group, row_for = places.read, places.apart, law.terms, group_of(lanes), row_of(law.species)
    cutoff2, largest = law.cutoff**2, LARGEST / law.cutoff
    grain, energy_grain = law.force_grain, law.energy_grain

    @cuda.jit
    def measure(placed, near, counts, inverse_masses, table, ids, rows, marks):
        i = cuda.grid(1)
        if i < counts.size:
            own = read(placed, i)
            fx, fy, fz, total = np.int64(0), np.int64(0), np.int64(0), 0.0
            energies, virials = np.int64(0), np.int64(0)
            for k in range(counts[i]):
                other = read(placed, group(near, i, np.uint32(k // 4))[k % 4])
                dx, dy, dz = apart(own, other)
                r2 = dx * dx + dy * dy + dz * dz
                if r2 < cutoff2:
                    energy, force_over_r = terms(r2, table, row_for(own, other))
                    g = force_over_r * grain
                    total += abs(g)
                    fx += np.int64(g * dx)
                    fy += np.int64(g * dy)
                    fz += np.int64(g * dz)
                    energies += np.int64(energy * energy_grain)
                    virials += np.int64(force_over_r * r2 * energy_grain)
            if not total < largest:
                marks[TOO_LARGE] = 1.0
            unit, to = inverse_masses[i] / grain, ids[i]
            rows[0, to], rows[1, to], rows[2, to] = fx * unit, fy * unit, fz * unit
            rows[3, to], rows[4, to] = 0.5 * energies / energy_grain, 0.5 * virials / energy_grain

    return measure
