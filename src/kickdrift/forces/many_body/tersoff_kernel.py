"""Compiled sums of Tersoff's potential: for each particle, its bonds in lanes, and for each bond the other neighbours
in lanes."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.lists.along import add_along, store_along, zeros_along
from kickdrift.forces.lists.clusters import STRIDE, chunk_clusters
from kickdrift.forces.lists.neighbours import ROW, block_of_neighbours
from kickdrift.forces.many_body.kernel import clear, collect, law_body, react, row_numbers
from kickdrift.jit.compile import as_written, never_inline
from kickdrift.jit.duals.lanes import (
    inverse_sqrt,
    lane_exp,
    lane_log,
    lane_sine_cosine,
    lane_sum,
    load,
    select,
    store,
    value_of,
)
from kickdrift.jit.lanes.functions import lane_numbers, splat
from kickdrift.jit.lanes.gathering import place_at
from kickdrift.jit.lanes.masks import any_lane, lowest_bit, mask_bits
from kickdrift.jit.lanes.memory import aligned
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.jit.threads.chunks import chunk_task, each_chunk

PAIR = 12  # columns of `by_pair`
TRIPLE = 8  # columns of `by_triple`
NX, NY, NZ, R, INVERSE, KIND, FC, SLOPE_FC, ATTRACTION, ALONG, ZETA, WEIGHT, GX, GY, GZ = range(15)  # rows of a bond
BOND = 15
COS, PLAIN, BY_ANGLE, BY_LENGTH, BY_BOND = range(5)  # rows of a bond's other neighbours
OTHER = 5
MOST_EXPONENT = 69.0776  # LAMMPS' limit: exp of this is 1e30


class TersoffLaw(NamedTuple):
    """Parameters of each pair and triple of species, and workspace."""

    by_pair: NDArray[
        np.float64
    ]  # (species, species, 12) A, lambda1, B, lambda2, beta, n, R, D, least beta zeta, 0, 0, 0
    by_triple: NDArray[np.float64]  # (species, species, species, 8) gamma, c^2, d^2, cos_theta0, lambda3, m - 1, 0, 0
    bonds: NDArray[np.float64]  # (chunks, room * 15)
    others: NDArray[np.float64]  # (chunks, room * room * 5)
    bonded: NDArray[np.int32]  # (chunks, room) slots
    reactions: NDArray[np.float64]  # (chunks, 24)

    def with_room(self, slots: int, room: int, chunks: int) -> TersoffLaw:
        """Return the law with workspace for this room."""
        return self._replace(
            bonds=aligned((chunks, (room + WIDTH) * BOND), fill=None),
            others=aligned((chunks, room * (room + WIDTH) * OTHER), fill=None),
            bonded=np.zeros((chunks, room), np.int32),
            reactions=aligned((chunks, 3 * WIDTH)),
        )


@law_body(TersoffLaw)
def tersoff(law, force, chunks):
    each_chunk(force, chunks, "chunk_tersoff")
    collect(force.pairs, chunks)


@as_written
def pair_numbers(law, own, kind, column):
    """Return four parameters of pairs with neighbours of these species."""
    species = law.by_pair.shape[0]
    return row_numbers(law.by_pair, species, kind + own * species, PAIR, column)


@as_written
def triple_numbers(law, own, bonded, kind, column):
    """Return four parameters of triples with a bond to one species and other neighbours of these species."""
    species = law.by_pair.shape[0]
    return row_numbers(law.by_triple, species, kind + (own * species + bonded) * species, TRIPLE, column)


@chunk_task
def chunk_tersoff(force, c):
    """Sum the forces of the bonds that begin at chunk c's particles."""
    never_inline()
    rows, law, pairs = force.rows, force.law, force.pairs
    clear(pairs, c)
    forces, bonds, bonded = pairs.force[c], law.bonds[c], law.bonded[c]
    energy, virial, pair_count = splat(0.0), splat(0.0), 0
    by_axis = zeros_along(force.along, force.sums)
    begin, end = chunk_clusters(pairs, c)
    for cluster in range(begin, end):
        for slot in range(WIDTH * cluster, WIDTH * cluster + pairs.filled[cluster]):
            own = value_of(rows.at[ROW * slot + 3])
            count = find_bonds(rows, slot, force.cutoff**2, bonds, bonded)
            pair_count += count
            weigh_pairs(law, own, bonds, count)
            sum_others(law, own, bonds, law.others[c], count)
            energy = energy + weigh_bonds(law, own, bonds, count)
            share_forces(bonds, law.others[c], count)
            fx, fy, fz = splat(0.0), splat(0.0), splat(0.0)
            for first in range(0, count, WIDTH):
                at = first * BOND
                gx, gy, gz = load(bonds, at + GX * WIDTH), load(bonds, at + GY * WIDTH), load(bonds, at + GZ * WIDTH)
                nx, ny, nz = load(bonds, at + NX * WIDTH), load(bonds, at + NY * WIDTH), load(bonds, at + NZ * WIDTH)
                fx, fy, fz = fx + gx, fy + gy, fz + gz
                virial = virial - load(bonds, at + R * WIDTH) * (gx * nx + gy * ny + gz * nz)
                r = -load(bonds, at + R * WIDTH)
                by_axis = add_along(by_axis, r * gx * nx, r * gy * ny, r * gz * nz)
                here = mask_bits(lane_numbers() < float(count - first))
                react(forces, law.reactions[c], bonded, first, here, gx, gy, gz)
            p = STRIDE * cluster + slot % WIDTH
            forces[p] += lane_sum(fx)
            forces[p + WIDTH] += lane_sum(fy)
            forces[p + 2 * WIDTH] += lane_sum(fz)
    force.sums[c, 0] = lane_sum(energy)
    force.sums[c, 1] = lane_sum(virial)
    store_along(by_axis, force.along, c)
    force.sums[c, 2] = 0.5 * pair_count


@as_written
def find_bonds(rows, slot, cutoff2, bonds, bonded):
    """Write the neighbours within the cutoff side by side, and return their number.

    The lanes after the last hold a neighbour far beyond all cutoffs."""
    made = 0
    for first in range(0, rows.lengths[slot], WIDTH):
        dx, dy, dz, r2, beyond, kind = block_of_neighbours(rows, slot, first, cutoff2)
        bits = mask_bits(beyond) ^ 255
        if bits == 0:
            continue
        inverse = inverse_sqrt(select(beyond, splat(cutoff2), r2))
        r = r2 * inverse
        nx, ny, nz = -dx * inverse, -dy * inverse, -dz * inverse
        at = rows.near.shape[1] * BOND  # beyond the last bond: room for the eight neighbours before the choice
        store(bonds, at, nx)
        store(bonds, at + WIDTH, ny)
        store(bonds, at + 2 * WIDTH, nz)
        store(bonds, at + 3 * WIDTH, r)
        store(bonds, at + 4 * WIDTH, inverse)
        store(bonds, at + 5 * WIDTH, kind)
        while bits:
            k = lowest_bit(bits)
            bits &= bits - 1
            to = made // WIDTH * (WIDTH * BOND) + made % WIDTH
            for row in range(6):
                bonds[to + row * WIDTH] = bonds[at + row * WIDTH + k]
            bonded[made] = place_at(rows.near, slot * rows.near.shape[1] + first + k)
            made += 1
    for k in range(made, -(-made // WIDTH) * WIDTH):
        to = k // WIDTH * (WIDTH * BOND) + k % WIDTH
        for row in range(6):
            bonds[to + row * WIDTH] = 0.0
        bonds[to + R * WIDTH], bonds[to + INVERSE * WIDTH] = 1e3, 1e-3
    return made


@as_written
def weigh_pairs(law, own, bonds, count):
    """For each bond write the smooth cutoff with its slope, and the repulsion and the attraction with their slopes."""
    for first in range(0, count, WIDTH):
        at = first * BOND
        r, kind = load(bonds, at + R * WIDTH), load(bonds, at + KIND * WIDTH)
        big, lambda1, small, lambda2 = pair_numbers(law, own, kind, 0)
        _, _, middle, half = pair_numbers(law, own, kind, 4)
        fc, slope = splat(1.0), splat(0.0)
        away = (r - middle) / half
        inner = away > -1.0
        if any_lane(inner):
            outer = away >= 1.0
            sine, cosine = lane_sine_cosine(0.5 * math.pi * select(inner, select(outer, splat(1.0), away), -1.0))
            fc = select(outer, splat(0.0), 0.5 - 0.5 * sine)
            fc = select(inner, fc, 1.0)
            slope = select(outer, splat(0.0), -0.25 * math.pi / half * cosine)
            slope = select(inner, slope, 0.0)
        repulsion, attraction = big * lane_exp(-lambda1 * r), -small * lane_exp(-lambda2 * r)
        store(bonds, at + FC * WIDTH, fc)
        store(bonds, at + SLOPE_FC * WIDTH, slope)
        store(bonds, at + ATTRACTION * WIDTH, attraction)
        store(bonds, at + ALONG * WIDTH, repulsion)
        store(bonds, at + GX * WIDTH, splat(0.0))
        store(bonds, at + GY * WIDTH, splat(0.0))
        store(bonds, at + GZ * WIDTH, splat(0.0))


@as_written
def sum_others(law, own, bonds, others, count):
    """For each bond, sum zeta over the other neighbours, and keep the terms with their slopes."""
    blocks = -(-count // WIDTH)
    for j in range(count):
        to = j // WIDTH * (WIDTH * BOND) + j % WIDTH
        nx, ny, nz = bonds[to + NX * WIDTH], bonds[to + NY * WIDTH], bonds[to + NZ * WIDTH]
        r, bonded = bonds[to + R * WIDTH], bonds[to + KIND * WIDTH]
        zeta = splat(0.0)
        for block in range(blocks):
            at = block * WIDTH * BOND
            kx, ky, kz = load(bonds, at + NX * WIDTH), load(bonds, at + NY * WIDTH), load(bonds, at + NZ * WIDTH)
            kind = load(bonds, at + KIND * WIDTH)
            gamma, c2, d2, cos_theta0 = triple_numbers(law, own, bonded, kind, 0)
            lambda3, power, _, _ = triple_numbers(law, own, bonded, kind, 4)
            number = lane_numbers() + float(block * WIDTH)
            mine = (number == float(j)) | (number >= float(count))
            cosine = kx * nx + ky * ny + kz * nz
            away = cos_theta0 - cosine
            share = 1.0 / (d2 + away * away)
            angle = gamma * (1.0 + c2 / d2 - c2 * share)
            slope_angle = -2.0 * gamma * c2 * away * share * share
            stretch = lambda3 * (r - load(bonds, at + R * WIDTH))
            cubed = power > 1.0
            exponent = select(cubed, stretch * stretch * stretch, stretch)
            slope_exponent = lambda3 * select(cubed, 3.0 * stretch * stretch, 1.0 + 0.0 * stretch)
            exponent = select(exponent > MOST_EXPONENT, splat(MOST_EXPONENT), exponent)
            growth = select(mine, splat(0.0), lane_exp(exponent))
            fc, slope_fc = load(bonds, at + FC * WIDTH), load(bonds, at + SLOPE_FC * WIDTH)
            term = fc * angle * growth
            zeta = zeta + term
            keep = (j * blocks + block) * WIDTH * OTHER
            store(others, keep + COS * WIDTH, cosine)
            store(others, keep + PLAIN * WIDTH, term * slope_exponent)
            store(others, keep + BY_ANGLE * WIDTH, fc * slope_angle * growth)
            store(others, keep + BY_LENGTH * WIDTH, slope_fc * angle * growth - term * slope_exponent)
        bonds[to + ZETA * WIDTH] = lane_sum(zeta)


@as_written
def weigh_bonds(law, own, bonds, count):
    """Write each bond's force along the bond at constant zeta, and the energy's slope in zeta. Return the energy."""
    energy = splat(0.0)
    for first in range(0, count, WIDTH):
        at = first * BOND
        kind = load(bonds, at + KIND * WIDTH)
        here = lane_numbers() < float(count - first)
        _, lambda1, _, lambda2 = pair_numbers(law, own, kind, 0)
        beta, n, _, _ = pair_numbers(law, own, kind, 4)
        least, _, _, _ = pair_numbers(law, own, kind, 8)
        fc, slope_fc = load(bonds, at + FC * WIDTH), load(bonds, at + SLOPE_FC * WIDTH)
        attraction, repulsion = load(bonds, at + ATTRACTION * WIDTH), load(bonds, at + ALONG * WIDTH)
        zeta = select(here, load(bonds, at + ZETA * WIDTH), 0.0)
        x = beta * zeta
        free = x < least  # too little zeta to change the bond
        zeta = select(free, splat(1.0), zeta)
        grown = n * lane_log(select(free, splat(1.0), x))
        power = lane_exp(select(grown > 300.0, splat(300.0), grown))
        log_sum = select(grown > 40.0, grown, lane_log(1.0 + power))
        order = select(free, splat(1.0), lane_exp(-0.5 / n * log_sum))
        slope_order = select(free, splat(0.0), -0.5 * order * (power / (1.0 + power)) / zeta)
        both = repulsion + order * attraction
        energy = energy + select(here, 0.5 * fc * both, 0.0)
        along = 0.5 * (slope_fc * both - fc * (lambda1 * repulsion + lambda2 * order * attraction))
        store(bonds, at + ALONG * WIDTH, select(here, along, 0.0))
        store(bonds, at + WEIGHT * WIDTH, select(here, 0.5 * fc * attraction * slope_order, 0.0))
    return energy


@as_written
def share_forces(bonds, others, count):
    """Sum the gradient of the energy in each bond's vector."""
    blocks = -(-count // WIDTH)
    for j in range(count):
        to = j // WIDTH * (WIDTH * BOND) + j % WIDTH
        nx, ny, nz = bonds[to + NX * WIDTH], bonds[to + NY * WIDTH], bonds[to + NZ * WIDTH]
        inverse, w = bonds[to + INVERSE * WIDTH], bonds[to + WEIGHT * WIDTH]
        if w == 0.0:
            along = bonds[to + ALONG * WIDTH]
            bonds[to + GX * WIDTH] += along * nx
            bonds[to + GY * WIDTH] += along * ny
            bonds[to + GZ * WIDTH] += along * nz
            continue
        plain, turned = splat(0.0), splat(0.0)
        ax, ay, az = splat(0.0), splat(0.0), splat(0.0)
        for block in range(blocks):
            at, keep = block * WIDTH * BOND, (j * blocks + block) * WIDTH * OTHER
            kx, ky, kz = load(bonds, at + NX * WIDTH), load(bonds, at + NY * WIDTH), load(bonds, at + NZ * WIDTH)
            cosine, by_angle = load(others, keep + COS * WIDTH), load(others, keep + BY_ANGLE * WIDTH)
            plain = plain + load(others, keep + PLAIN * WIDTH)
            turned = turned + by_angle * cosine
            ax, ay, az = ax + by_angle * kx, ay + by_angle * ky, az + by_angle * kz
            across = w * by_angle * load(bonds, at + INVERSE * WIDTH)
            outward = w * load(others, keep + BY_LENGTH * WIDTH) - across * cosine
            store(bonds, at + GX * WIDTH, load(bonds, at + GX * WIDTH) + (across * nx + outward * kx))
            store(bonds, at + GY * WIDTH, load(bonds, at + GY * WIDTH) + (across * ny + outward * ky))
            store(bonds, at + GZ * WIDTH, load(bonds, at + GZ * WIDTH) + (across * nz + outward * kz))
        outward = bonds[to + ALONG * WIDTH] + w * (lane_sum(plain) - lane_sum(turned) * inverse)
        bonds[to + GX * WIDTH] += outward * nx + w * inverse * lane_sum(ax)
        bonds[to + GY * WIDTH] += outward * ny + w * inverse * lane_sum(ay)
        bonds[to + GZ * WIDTH] += outward * nz + w * inverse * lane_sum(az)
