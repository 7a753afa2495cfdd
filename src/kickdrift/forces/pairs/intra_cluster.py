"""Pairs within a cluster of eight: lanes against rotated lanes, or tiles of four against four."""

import numpy as np
from numba import types

from kickdrift.forces.lists.along import add_along
from kickdrift.forces.lists.clusters import SHIFTS, STRIDE, load_vector, table_place
from kickdrift.forces.lists.pair_rows import displacements
from kickdrift.forces.lists.special_pairs import is_inside
from kickdrift.forces.pairs.lanes import has_registers, pair_terms, terms_at, without_registers
from kickdrift.forces.pairs.upkeep import Tables, brings_terms, is_small
from kickdrift.jit.compile import as_written
from kickdrift.jit.inner import by_type
from kickdrift.jit.lanes.functions import multiply_add, rotated, splat
from kickdrift.jit.lanes.masks import select
from kickdrift.jit.lanes.single import off_diagonal
from kickdrift.jit.lanes.tabled import places_within
from kickdrift.jit.lanes.vectors import WIDTH, single_type

UNSHIFTED = SHIFTS // 2


@by_type
def own_pairs(zero, laws, pairs, cluster, cutoff2, along):
    """Return the forces among a cluster's eight particles, with energy, virial and number of pairs, and the virial
    ``along`` each axis with that of these pairs (see `add_along`).

    Rows of tiles have these forces already; the sums are in float64."""
    if zero == single_type:

        def sums_alone(zero, laws, pairs, cluster, cutoff2, along):
            found = intra_cluster(laws, pairs.x, cluster, cutoff2, along)
            nothing = splat(0.0)
            return nothing, nothing, nothing, found[3], found[4], found[5], found[6]

        return sums_alone
    return lambda zero, laws, pairs, cluster, cutoff2, along: intra_cluster(laws, pairs.x, cluster, cutoff2, along)


@by_type
def row_start(zero, laws, pairs, table, cluster, row, cutoff2):
    """Return the forces that a row's sums begin with, not yet summed over lanes. ``zero`` and ``table`` are as in
    `pair_rows`. A row of tiles begins with the forces of its cluster on it."""
    if zero != single_type:
        return lambda zero, laws, pairs, table, cluster, row, cutoff2: (zero, zero, zero)

    def tiles(zero, laws, pairs, table, cluster, row, cutoff2):
        fx, fy, fz = zero, zero, zero
        if is_inside(pairs.special, cluster):
            return fx, fy, fz
        for block in range(2):
            other = STRIDE * cluster + WIDTH // 2 * block
            dx, dy, dz = displacements(zero, pairs.x_single, table, other, table_place(WIDTH // 2, UNSHIFTED, row))
            r2 = dx * dx + dy * dy + dz * dz
            if block == row:
                r2 = off_diagonal(r2, 4.0 * cutoff2)
            _, force_over_r = pair_terms(laws, WIDTH * cluster + WIDTH // 2 * row, other, r2)
            g = select(r2 < cutoff2, force_over_r, 0.0)
            fx, fy, fz = multiply_add(g, dx, fx), multiply_add(g, dy, fy), multiply_add(g, dz, fz)
        return fx, fy, fz

    return tiles


@as_written
def intra_cluster(laws, x, cluster, cutoff2, along):
    """Return the forces among a cluster's eight particles, with energy, virial and number of pairs, and the virial
    ``along`` each axis with that of these pairs (see `add_along`).

    Each lane meets the lanes one to four places on. Lanes four places apart meet twice."""
    at = WIDTH * cluster
    own = load_vector(x, cluster)
    fx, fy, fz, energy, virial, count, along = pairs_apart(laws, at, own, cutoff2, 1, along, 1.0)
    sx, sy, sz = fx - rotated(fx, 7), fy - rotated(fy, 7), fz - rotated(fz, 7)
    energies, virials, counts = energy, virial, count
    fx, fy, fz, energy, virial, count, along = pairs_apart(laws, at, own, cutoff2, 2, along, 1.0)
    sx, sy, sz = sx + (fx - rotated(fx, 6)), sy + (fy - rotated(fy, 6)), sz + (fz - rotated(fz, 6))
    energies, virials, counts = energies + energy, virials + virial, counts + count
    fx, fy, fz, energy, virial, count, along = pairs_apart(laws, at, own, cutoff2, 3, along, 1.0)
    sx, sy, sz = sx + (fx - rotated(fx, 5)), sy + (fy - rotated(fy, 5)), sz + (fz - rotated(fz, 5))
    energies, virials, counts = energies + energy, virials + virial, counts + count
    fx, fy, fz, energy, virial, count, along = pairs_apart(laws, at, own, cutoff2, 4, along, 0.5)
    sx, sy, sz = sx + fx, sy + fy, sz + fz
    energies, virials, counts = energies + 0.5 * energy, virials + 0.5 * virial, counts + 0.5 * count
    return sx, sy, sz, energies, virials, counts, along


@by_type(prefer_literal=True)
def pairs_apart(laws, at, own, cutoff2, places, along, part):
    """Return the forces on the eight particles from slot ``at`` on by the particles ``places`` further on, with energy,
    virial, number of pairs, and ``along`` with ``part`` of the virial along each axis."""
    if not isinstance(places, types.IntegerLiteral):
        return None

    def meets(laws, at, own, cutoff2, places, along, part):
        x, y, z = own
        dx, dy, dz = x - rotated(x, places), y - rotated(y, places), z - rotated(z, places)
        r2 = dx * dx + dy * dy + dz * dz
        inside = r2 < cutoff2
        energy, force_over_r = terms_within(laws, at, places, r2)
        g = select(inside, force_over_r, 0.0)
        energy, count = select(inside, energy, 0.0), select(inside, splat(1.0), 0.0)
        along = add_along(along, part * g * dx, part * g * dy, part * g * dz, dx, dy, dz)
        return g * dx, g * dy, g * dz, energy, g * select(inside, r2, 0.0), count, along

    return meets


@by_type(prefer_literal=True)
def terms_within(laws, at, places, r2):
    """Return energy and force over r of the eight particles from slot ``at`` on with the particles ``places`` further
    on."""
    if brings_terms(laws[0]):
        return None
    if isinstance(laws[3], types.NoneType):
        return lambda laws, at, places, r2: pair_terms(laws, at, at, r2)
    if has_registers(laws[3]):
        return lambda laws, at, places, r2: terms_within(without_registers(laws), at, places, r2)
    if is_small(laws[3]):

        def permuted(laws, at, places, r2):
            tables = laws[3]
            return terms_at(laws, places_within(tables.row, at, tables.code, STRIDE // WIDTH * at, places), r2)

        return permuted

    def many_species(laws, at, places, r2):
        like, like_at_cutoff, truncation, tables = laws
        own = np.empty((tables.table.shape[0], 1, WIDTH))
        for lane in range(WIDTH):
            row, other = tables.row[at + lane], at + (lane + places) % WIDTH
            for k in range(own.shape[0]):
                own[k, 0, lane] = tables.table[k, row, other]
        spread = Tables(own, tables.pairs, tables.species, tables.row)
        return terms_at((like, like_at_cutoff, truncation, spread), (0, 0), r2)

    return many_species
