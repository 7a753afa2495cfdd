"""The compiled sum of a pair law over the rows of a cluster list, in float64 or mixed precision.

A step of the loop is one particle against a cluster of eight or half of one, or two particles against a cluster: see
`row_lanes`. In mixed precision its lanes are float32, and forces on a particle are added up in float32 over a row and
over the reactions of a chunk; everything else (state, sums over rows and chunks, energies, pairs within a cluster) is
float64.

Functions that take ``zero``, nothing in all lanes of a step, are as wide as it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import types

from kickdrift.forces.clusters import (
    APART,
    N_CLUSTERS,
    SHIFTS,
    STRIDE,
    chunk_clusters,
    load_vector,
    store_vector,
    table_place,
)
from kickdrift.forces.row_lanes import nothing
from kickdrift.forces.truncation import truncated
from kickdrift.jit.chunks import chunk_task
from kickdrift.jit.compile import as_written, jit, never_inline
from kickdrift.jit.inner import overload
from kickdrift.jit.lanes import in_eight, lane_numbers, lane_sum, lanes_like, multiply_add, rotated, splat
from kickdrift.jit.masks import lowest_bit, select
from kickdrift.jit.memory import broadcast, entry, load, load_like, named_lanes, store, sums_of_rows
from kickdrift.jit.single import (
    halves,
    load_single,
    load_twice,
    named_lanes_single,
    store_narrow,
    two_of,
)
from kickdrift.jit.vectors import F64, WIDTH, single_type

PLACES = (
    table_place.py_func(2, 1, 0),
    table_place.py_func(2, 0, 1),
)  # from a shift, and from a row, to the next where a row is two particles


@chunk_task
def chunk_forces(force, c):
    """Forces of chunk c's pairs, into the chunk's own array."""
    never_inline()
    sum_pairs(force, None, c)


@chunk_task
def chunk_forces_and_sums(force, c):
    """The same, and the chunk's energy and virial."""
    never_inline()
    sum_pairs(force, force.sums, c)


@as_written
def sum_pairs(force, sums, c):
    pairs = force.pairs
    zero = nothing(force.lanes)
    x, reactions, table = working_arrays(zero, pairs, c)
    rows, start, used, touched, forces = (
        pairs.rows[c],
        pairs.row_start[c],
        pairs.used[c],
        pairs.touched[c],
        pairs.force[c],
    )
    for cluster in range(pairs.counts[N_CLUSTERS]):
        if touched[cluster]:
            store_vector(forces, cluster, splat(0.0), splat(0.0), splat(0.0))
            clear(reactions, cluster, zero)
    cutoff2 = force.cutoff**2
    laws = force.law, force.at_cutoff, force.truncation, force.tables
    row_sums = np.zeros(WIDTH * STRIDE)
    energy_sum, virial_sum, pair_count = splat(0.0), splat(0.0), splat(0.0)
    begin, end = chunk_clusters(pairs, c)
    rows_each = WIDTH // pairs.per_row
    for cluster in range(pairs.counts[N_CLUSTERS]):
        first = rows_each * cluster
        mine = begin <= cluster and cluster < end
        if start[first] == start[first + rows_each] and not mine:
            continue
        fill_table(table, pairs, cluster, used[cluster], zero)
        # A step is a chain of 20 operations that wait for each other. So that a processor has others to do, the loop is
        # at three steps at once: the displacements of the next but one, the forces of the next, the sums of this one.
        at, own = start[first], WIDTH * cluster
        other, place = entry(rows, at, 0), entry(rows, at, 1)
        dx, dy, dz = displacements(zero, x, table, other, place)
        r2 = dx * dx + dy * dy + dz * dz
        energy, force_over_r = pair_terms(laws, own + particle_of(zero, place), slot_of(other), r2)
        g = select(r2 < cutoff2, force_over_r, 0.0)
        next_other, next_place = entry(rows, at + 1, 0), entry(rows, at + 1, 1)
        next_dx, next_dy, next_dz = displacements(zero, x, table, next_other, next_place)
        next_r2 = next_dx * next_dx + next_dy * next_dy + next_dz * next_dz
        for row in range(rows_each):
            fx, fy, fz = zero, zero, zero
            for k in range(start[first + row], start[first + row + 1]):
                later_other, later_place = entry(rows, k + 2, 0), entry(rows, k + 2, 1)
                later_dx, later_dy, later_dz = displacements(zero, x, table, later_other, later_place)
                later_r2 = later_dx * later_dx + later_dy * later_dy + later_dz * later_dz
                i, j = own + particle_of(zero, next_place), slot_of(next_other)
                next_energy, force_over_r = pair_terms(laws, i, j, next_r2)
                next_g = select(next_r2 < cutoff2, force_over_r, 0.0)
                fx, fy, fz = multiply_add(g, dx, fx), multiply_add(g, dy, fy), multiply_add(g, dz, fz)
                react(reactions, other, -g, dx, dy, dz)
                if sums is not None:
                    inside = r2 < cutoff2
                    energy_sum = energy_sum + widened(select(inside, energy, 0.0))
                    virial_sum = virial_sum + widened(g * select(inside, r2, 0.0))
                    pair_count = pair_count + widened(select(inside, zero + 1.0, 0.0))
                other, dx, dy, dz, r2, g, energy = next_other, next_dx, next_dy, next_dz, next_r2, next_g, next_energy
                next_other, next_place, next_r2 = later_other, later_place, later_r2
                next_dx, next_dy, next_dz = later_dx, later_dy, later_dz
            keep_row(row_sums, row, fx, fy, fz)
        own_x, own_y, own_z = load_vector(forces, cluster)
        if mine:
            gx, gy, gz, energy_own, virial_own, count_own = within(laws, pairs.x, cluster, cutoff2)
            own_x, own_y, own_z = own_x + gx, own_y + gy, own_z + gz
            if sums is not None:
                energy_sum, virial_sum, pair_count = (
                    energy_sum + energy_own,
                    virial_sum + virial_own,
                    pair_count + count_own,
                )
        own_x = own_x + sums_of_rows(row_sums, 0, STRIDE)
        own_y = own_y + sums_of_rows(row_sums, WIDTH, STRIDE)
        own_z = own_z + sums_of_rows(row_sums, 2 * WIDTH, STRIDE)
        store_vector(forces, cluster, own_x, own_y, own_z)
    for cluster in range(pairs.counts[N_CLUSTERS]):
        if touched[cluster]:
            add_reactions(forces, reactions, cluster, zero)
    if sums is not None:
        sums[c, 0] = lane_sum(energy_sum)
        sums[c, 1] = lane_sum(virial_sum)
        sums[c, 2] = lane_sum(pair_count)


@as_written
def within(laws, x, cluster, cutoff2):
    """Forces on a cluster's eight by each other, with energy, virial and number of pairs: each lane meets the lanes one
    to four places on; those four on meet twice."""
    at = WIDTH * cluster
    own = load_vector(x, cluster)
    fx, fy, fz, energy, virial, count = meeting(laws, at, own, cutoff2, 1)
    sx, sy, sz = fx - rotated(fx, 7), fy - rotated(fy, 7), fz - rotated(fz, 7)
    energies, virials, counts = energy, virial, count
    fx, fy, fz, energy, virial, count = meeting(laws, at, own, cutoff2, 2)
    sx, sy, sz = sx + (fx - rotated(fx, 6)), sy + (fy - rotated(fy, 6)), sz + (fz - rotated(fz, 6))
    energies, virials, counts = energies + energy, virials + virial, counts + count
    fx, fy, fz, energy, virial, count = meeting(laws, at, own, cutoff2, 3)
    sx, sy, sz = sx + (fx - rotated(fx, 5)), sy + (fy - rotated(fy, 5)), sz + (fz - rotated(fz, 5))
    energies, virials, counts = energies + energy, virials + virial, counts + count
    fx, fy, fz, energy, virial, count = meeting(laws, at, own, cutoff2, 4)
    sx, sy, sz = sx + fx, sy + fy, sz + fz
    energies, virials, counts = energies + 0.5 * energy, virials + 0.5 * virial, counts + 0.5 * count
    return sx, sy, sz, energies, virials, counts


def meeting(laws: Any, at: int, own: Any, cutoff2: float, places: int) -> Any:
    """Forces on each of the eight in slots from ``at`` on by the one that many places on; energy, virial, number."""
    raise NotImplementedError("for compiled code")


@overload(meeting, prefer_literal=True)
def _meeting(laws, at, own, cutoff2, places):
    if not isinstance(places, types.IntegerLiteral):
        return None

    def meets(laws, at, own, cutoff2, places):
        x, y, z = own
        dx, dy, dz = x - rotated(x, places), y - rotated(y, places), z - rotated(z, places)
        r2 = dx * dx + dy * dy + dz * dz
        inside = r2 < cutoff2
        energy, force_over_r = terms_within(laws, at, places, r2)
        g = select(inside, force_over_r, 0.0)
        energy, count = select(inside, energy, 0.0), select(inside, splat(1.0), 0.0)
        return g * dx, g * dy, g * dz, energy, g * select(inside, r2, 0.0), count

    return meets


def working_arrays(zero: Any, pairs: Any, c: int) -> Any:
    """Positions, reactions of chunk c, and an empty table, in the precision of the pairs."""
    raise NotImplementedError("for compiled code")


@overload(working_arrays)
def _working_arrays(zero, pairs, c):
    if zero.vector.element == F64:
        return lambda zero, pairs, c: (pairs.x, pairs.force[c], np.empty(SHIFTS * STRIDE))
    size = SHIFTS * (PLACES[0] if zero == single_type else STRIDE)
    return lambda zero, pairs, c: (pairs.x_single, pairs.force_single[c], np.empty(size, np.float32))


def particle_of(zero: Any, place: int) -> int:
    """Which of its cluster's particles a row is of, or begins with, by its place in the table."""
    raise NotImplementedError("for compiled code")


@overload(particle_of)
def _particle_of(zero, place):
    if zero == single_type:
        per_shift, per_row = PLACES
        return lambda zero, place: 2 * (place % per_shift // per_row)
    return lambda zero, place: place % STRIDE


@as_written
def slot_of(other):
    """The slot of the particle whose x stands at ``other``."""
    return other // STRIDE * WIDTH + other % STRIDE


def fill_table(table: Any, pairs: Any, cluster: int, used: int, zero: Any) -> None:
    """A cluster's positions less each shift that is used. Looking them up costs less than subtracting in each step."""


@overload(fill_table)
def _fill_table(table, pairs, cluster, used, zero):
    def double(table, pairs, cluster, used, zero):
        shifts = pairs.shifts
        x, y, z = load_vector(pairs.x, cluster)
        while used:
            s = lowest_bit(used)
            used &= used - 1
            store_vector(table, s, x - shifts[0, s], y - shifts[1, s], z - shifts[2, s])

    def single(table, pairs, cluster, used, zero):
        shifts, origin = pairs.shifts, pairs.origin
        x, y, z = load_vector(pairs.x, cluster)
        while used:
            s = lowest_bit(used)
            used &= used - 1
            store_narrow(table, STRIDE * s, x - (shifts[0, s] + origin[0]))
            store_narrow(table, STRIDE * s + WIDTH, y - (shifts[1, s] + origin[1]))
            store_narrow(table, STRIDE * s + 2 * WIDTH, z - (shifts[2, s] + origin[2]))

    def twos(table, pairs, cluster, used, zero):
        shifts, origin = pairs.shifts, pairs.origin
        x, y, z = load_vector(pairs.x, cluster)
        # a row's second place may be empty: further away than all other empty ones, whatever the shift
        aside = 10 * APART * pairs.cutoff + 3 * pairs.cell.matrix[0, 0]
        x = select(lane_numbers() < float(pairs.filled[cluster]), x, x + aside)
        while used:
            s = lowest_bit(used)
            used &= used - 1
            store_twos(table, 8 * STRIDE * s, x - (shifts[0, s] + origin[0]))
            store_twos(table, 8 * STRIDE * s + 2 * WIDTH, y - (shifts[1, s] + origin[1]))
            store_twos(table, 8 * STRIDE * s + 4 * WIDTH, z - (shifts[2, s] + origin[2]))

    return double if zero.vector.element == F64 else twos if zero == single_type else single


@as_written
def store_twos(table, at, value):
    """Store lanes 0 and 1 eight times each in float32, then 2 and 3 a row further on, and so on."""
    store(table, at, two_of(value, 0))
    store(table, at + 2 * STRIDE, two_of(value, 1))
    store(table, at + 4 * STRIDE, two_of(value, 2))
    store(table, at + 6 * STRIDE, two_of(value, 3))


def displacements(zero: Any, x: Any, table: Any, other: int, place: int) -> Any:
    """From the neighbours whose x begin at ``other`` to the row at ``place``."""


@overload(displacements)
def _displacements(zero, x, table, other, place):
    def one(zero, x, table, other, place):
        dx = broadcast(table, place, zero) - load_like(x, other, zero)
        dy = broadcast(table, place + WIDTH, zero) - load_like(x, other + WIDTH, zero)
        return dx, dy, broadcast(table, place + 2 * WIDTH, zero) - load_like(x, other + 2 * WIDTH, zero)

    def two(zero, x, table, other, place):
        dx = load_single(table, place) - load_twice(x, other)
        dy = load_single(table, place + 2 * WIDTH) - load_twice(x, other + WIDTH)
        return dx, dy, load_single(table, place + 4 * WIDTH) - load_twice(x, other + 2 * WIDTH)

    return two if zero == single_type else one


def react(reactions: Any, other: int, g: Any, dx: Any, dy: Any, dz: Any) -> None:
    """Add g times the displacements to what the neighbours whose x begin at ``other`` feel."""


@overload(react)
def _react(reactions, other, g, dx, dy, dz):
    per_row = 2 if g == single_type else 1

    def add(reactions, other, g, dx, dy, dz):
        x, y, z = per_row * other, per_row * (other + WIDTH), per_row * (other + 2 * WIDTH)
        hx, hy, hz = load_like(reactions, x, g), load_like(reactions, y, g), load_like(reactions, z, g)
        store(reactions, x, multiply_add(g, dx, hx))
        store(reactions, y, multiply_add(g, dy, hy))
        store(reactions, z, multiply_add(g, dz, hz))

    return add


def keep_row(row_sums: Any, row: int, fx: Any, fy: Any, fz: Any) -> None:
    """Keep the forces on a row's particles, lanes not yet added up."""


@overload(keep_row)
def _keep_row(row_sums, row, fx, fy, fz):
    def one(row_sums, row, fx, fy, fz):
        store_vector(row_sums, row, widened(fx), widened(fy), widened(fz))

    def two(row_sums, row, fx, fy, fz):
        (x, x2), (y, y2), (z, z2) = halves(fx), halves(fy), halves(fz)
        store_vector(row_sums, 2 * row, x, y, z)
        store_vector(row_sums, 2 * row + 1, x2, y2, z2)

    return two if fx == single_type else one


def widened(value: Any) -> Any:
    """Lanes in float64, eight in all: 16 are added up in pairs, and four have four zeros beside them."""


@overload(widened)
def _widened(value):
    def two(value):
        low, high = halves(value)
        return low + high

    return two if value == single_type else (lambda value: in_eight(value))


def clear(reactions: Any, cluster: int, zero: Any) -> None:
    """No reactions yet on a cluster, where they are not its forces themselves."""


@overload(clear)
def _clear(reactions, cluster, zero):
    per_row = 2 if zero == single_type else 1

    def single(reactions, cluster, zero):
        for k in range(3):
            store(reactions, per_row * (STRIDE * cluster + WIDTH * k), zero)

    return single if reactions.dtype == types.float32 else (lambda reactions, cluster, zero: None)


def add_reactions(forces: Any, reactions: Any, cluster: int, zero: Any) -> None:
    """Add the reactions on a cluster to its forces, where they are not the same."""


@overload(add_reactions)
def _add_reactions(forces, reactions, cluster, zero):
    per_row = 2 if zero == single_type else 1

    def single(forces, reactions, cluster, zero):
        for k in range(3):
            p = STRIDE * cluster + WIDTH * k
            store(forces, p, load(forces, p) + widened(load_like(reactions, per_row * p, zero)))

    return single if reactions.dtype == types.float32 else (lambda forces, reactions, cluster, zero: None)


@jit
def narrow(pairs):
    """Copy the positions, less the origin, to float32."""
    for cluster in range(pairs.counts[N_CLUSTERS]):
        for k in range(3):
            p = STRIDE * cluster + WIDTH * k
            store_narrow(pairs.x_single, p, load(pairs.x, p) - pairs.origin[k])


def pair_terms(laws: tuple[Any, ...], i: int, j: int, r2: Any) -> Any:
    """Energy and force over r of particle i (in 16 lanes i and i + 1) with those in the slots from j on, truncated; the
    cutoff is not yet applied."""


@overload(pair_terms)
def _pair_terms(laws, i, j, r2):
    law = laws[0].instance_class.compiled_law
    if isinstance(laws[3], types.NoneType):

        def one_species(laws, i, j, r2):
            parameters, at_cutoff, truncation, _ = laws
            energy, force_over_r = law(parameters, r2)
            return truncated(truncation, at_cutoff, r2, lanes_like(energy, r2), lanes_like(force_over_r, r2))

        return one_species
    single = r2 == single_type

    def many_species(laws, i, j, r2):
        like, like_at_cutoff, truncation, tables = laws
        row, next_row = tables.row[i], tables.row[i + single]
        energy, force_over_r = law(named(like, tables.law, row, next_row, j, r2), r2)
        at_cutoff = named(like_at_cutoff, tables.at_cutoff, row, next_row, j, r2)
        return truncated(truncation, at_cutoff, r2, lanes_like(energy, r2), lanes_like(force_over_r, r2))

    return many_species


def named(like: Any, table: Any, row: int, next_row: int, j: int, r2: Any) -> Any:
    """The parameters like ``like`` of the species ``row`` (and ``next_row``) with those in the slots from j on."""


@overload(named)
def _named(like, table, row, next_row, j, r2):
    if r2 == single_type:
        return lambda like, table, row, next_row, j, r2: named_lanes_single(like, table, row, next_row, j)
    return lambda like, table, row, next_row, j, r2: named_lanes(like, table, row, j, r2)


def terms_within(laws: tuple[Any, ...], at: int, places: int, r2: Any) -> Any:
    """Energy and force over r of each of the eight in slots from ``at`` on with the one that many places on."""


@overload(terms_within)
def _terms_within(laws, at, places, r2):
    if isinstance(laws[3], types.NoneType):
        return lambda laws, at, places, r2: pair_terms(laws, at, at, r2)
    law = laws[0].instance_class.compiled_law

    def many_species(laws, at, places, r2):
        like, like_at_cutoff, truncation, tables = laws
        own = np.empty((tables.law.shape[0], 1, WIDTH))
        own_at_cutoff = np.empty((2, 1, WIDTH))
        for lane in range(WIDTH):
            row, other = tables.row[at + lane], at + (lane + places) % WIDTH
            for k in range(own.shape[0]):
                own[k, 0, lane] = tables.law[k, row, other]
            for k in range(2):
                own_at_cutoff[k, 0, lane] = tables.at_cutoff[k, row, other]
        energy, force_over_r = law(named_lanes(like, own, 0, 0, r2), r2)
        at_cutoff = named_lanes(like_at_cutoff, own_at_cutoff, 0, 0, r2)
        return truncated(truncation, at_cutoff, r2, lanes_like(energy, r2), lanes_like(force_over_r, r2))

    return many_species
