"""Compiled sums of Tersoff's potential: the particles of a cluster in lanes. Each step of a loop takes one bond of each
particle, or one bond and one other neighbour."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.lists.along import add_along, store_along, zeros_along
from kickdrift.forces.lists.clusters import chunk_clusters
from kickdrift.forces.lists.neighbours import ROW, neighbours_of_eight, separations
from kickdrift.forces.many_body.kernel import clear_reached, law_body, row_numbers
from kickdrift.jit.compile import as_written, never_inline
from kickdrift.jit.duals.lanes import (
    add_rows_at,
    in_double,
    in_precision_of,
    inverse_sqrt,
    lane_exp,
    lane_log,
    lane_sine_cosine,
    lane_sum,
    load,
    rows_at,
    select,
    store,
    value_of,
)
from kickdrift.jit.handle import Handle
from kickdrift.jit.inner import by_type
from kickdrift.jit.lanes.functions import splat
from kickdrift.jit.lanes.masks import any_lane
from kickdrift.jit.lanes.memory import aligned
from kickdrift.jit.lanes.single import zeros_in
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.jit.threads.chunks import chunk_task, each_chunk

NX, NY, NZ, R, INVERSE, KIND, FC, SLOPE_FC, GX, GY, GZ = (WIDTH * k for k in range(11))  # what is kept of a bond
BOND = 11 * WIDTH
COS, PLAIN, BY_ANGLE, BY_LENGTH = (WIDTH * k for k in range(4))  # what is kept of another neighbour of a bond
OTHER = 4 * WIDTH
MOST_EXPONENT = 69.0776  # LAMMPS' limit: exp of this is 1e30


class TersoffLaw(NamedTuple):
    """Parameters of each pair and triple of species, of float32 in mixed precision, and workspace."""

    by_pair: NDArray[Any]  # (species^2, 12) A, lambda1, B, lambda2, beta, n, R, D, least beta zeta, 0, 0, 0
    by_triple: NDArray[Any]  # (species^3, 8) gamma, c^2, d^2, cos_theta0, lambda3, m, R, D
    species: int
    stretched: bool  # whether some lambda3 is not zero
    ends: bool  # whether a triple's R and D are not those of its ends' bond
    bonds: NDArray[Any]  # (chunks, room * 11 * 8)
    others: NDArray[Any]  # (chunks, room * 4 * 8)
    forces: NDArray[np.float64]  # (chunks, 4 slots) from the terms of each chunk: x, y, z and 0 for each slot

    def with_room(self, slots: int, room: int, chunks: int) -> TersoffLaw:
        """Return the law with workspace for this room."""
        kind = self.by_pair.dtype
        return self._replace(
            bonds=aligned((chunks, room * BOND), None, kind),
            others=aligned((chunks, room * OTHER), None, kind),
            forces=aligned((chunks, ROW * slots)),
        )


class Form(NamedTuple):
    """Compiled parts in which the forms of Tersoff's potential differ. ``row`` is of the table of triples or pairs."""

    end: Callable[..., Any]  # (r, middle, half): the cutoff function and its slope
    angle: Callable[..., Any]  # (law, row, cosine): the factor of an angle and its slope by the cosine
    weakening: Callable[..., Any]  # (law, row, n): delta and n / delta, where b = (1 + (beta zeta)^n)^(-1 / 2 delta)
    bond: Callable[..., Any]  # (law, row, r, fc, slope): see `bond_of`


FORMS: dict[type, Form] = {}


def form_of(law: Any) -> Form:
    """The form of a law's type."""
    return FORMS[(law.kind if isinstance(law, Handle) else law).instance_class]


@by_type
def end_of(law, r, middle, half):
    """Return a bond's cutoff function and its slope."""
    end = form_of(law).end
    return lambda law, r, middle, half: end(r, middle, half)


@by_type
def angle_of(law, row, cosine):
    """Return the factor of an angle and its slope by the cosine."""
    angle = form_of(law).angle
    return lambda law, row, cosine: angle(law, row, cosine)


@by_type
def weakening_of(law, row, n):
    """Return delta of a bond, and n / delta."""
    weakening = form_of(law).weakening
    return lambda law, row, n: weakening(law, row, n)


@by_type
def bond_of(law, row, r, fc, slope_fc):
    """Return the factor of the pair's terms and its slope, and more energy of the pair with its slope."""
    bond = form_of(law).bond
    return lambda law, row, r, fc, slope_fc: bond(law, row, r, fc, slope_fc)


@law_body(TersoffLaw, ("by_pair", "by_triple"))
def tersoff(law, force, chunks):
    each_chunk(force, chunks, "chunk_tersoff")
    each_chunk(force, chunks, "collect_forces")


@chunk_task
def chunk_tersoff(force, c):
    """Sum the forces of the bonds that begin at chunk c's particles."""
    never_inline()
    rows, law, pairs = force.rows, force.law, force.pairs
    forces, bonds, places = law.forces[c], law.bonds[c], rows.places[c]
    clear_reached(force, forces, c, ROW)
    energy, virial, pair_count = splat(0.0), splat(0.0), splat(0.0)
    by_axis = zeros_along(force.along, force.sums)
    begin, end = chunk_clusters(pairs, c)
    for cluster in range(begin, end):
        most = neighbours_of_eight(rows, c, cluster, force.cutoff**2)
        count = load(rows.counts[c], 0)
        pair_count = pair_count + count
        own = find_bonds(force, bonds, places, count, most)
        for j in range(most):
            zeta = sum_others(law, own, bonds, law.others[c], j, most)
            energy = energy + in_double(share_forces(law, own, bonds, law.others[c], j, most, zeta))
        fx, fy, fz = splat(0.0), splat(0.0), splat(0.0)
        for j in range(most):
            at = j * BOND
            gx, gy, gz = load(bonds, at + GX), load(bonds, at + GY), load(bonds, at + GZ)
            nx, ny, nz = load(bonds, at + NX), load(bonds, at + NY), load(bonds, at + NZ)
            virial = virial - in_double(load(bonds, at + R) * (gx * nx + gy * ny + gz * nz))
            gx, gy, gz = in_double(gx), in_double(gy), in_double(gz)
            r = -in_double(load(bonds, at + R))
            by_axis = add_along(by_axis, r * gx, r * gy, r * gz, in_double(nx), in_double(ny), in_double(nz))
            fx, fy, fz = fx + gx, fy + gy, fz + gz
            add_rows_at(forces, places, WIDTH * (j + 1), (-gx, -gy, -gz, 0.0 * gx))
        add_rows_at(forces, places, 0, (fx, fy, fz, 0.0 * fx))
    force.sums[c, 0] = lane_sum(energy)
    force.sums[c, 1] = lane_sum(virial)
    store_along(by_axis, force.along, c)
    force.sums[c, 2] = 0.5 * lane_sum(pair_count)


@as_written
def find_bonds(force, bonds, places, count, most):
    """Write each bond's direction, length and smooth cutoff, which is zero where there is no bond. Return the species
    at the centres."""
    rows, table = force.rows, force.law.by_pair
    x, y, z, own = rows_at(rows.at, places, 0)
    own = in_precision_of(table, value_of(own))
    zero = zeros_in(table)
    for j in range(most):
        here = count > float(j)
        dx, dy, dz, kind = separations(rows, rows.at, places, WIDTH * (j + 1), x, y, z)
        kind = in_precision_of(table, value_of(kind))
        r2 = in_precision_of(table, select(here, dx * dx + dy * dy + dz * dz, 4.0 * force.cutoff**2))
        inverse = inverse_sqrt(r2)
        r = r2 * inverse
        _, _, middle, half = row_numbers(table, kind + own * float(force.law.species), 4)
        fc, slope = end_of(force.law, r, middle, half)
        at = j * BOND
        store(bonds, at + NX, in_precision_of(table, -dx) * inverse)
        store(bonds, at + NY, in_precision_of(table, -dy) * inverse)
        store(bonds, at + NZ, in_precision_of(table, -dz) * inverse)
        store(bonds, at + R, r)
        store(bonds, at + INVERSE, inverse)
        store(bonds, at + KIND, kind)
        store(bonds, at + FC, fc)
        store(bonds, at + SLOPE_FC, slope)
        store(bonds, at + GX, zero)
        store(bonds, at + GY, zero)
        store(bonds, at + GZ, zero)
    return own


@as_written
def smooth_end(r, middle, half):
    """Return the cutoff function and its slope: 1 before middle - half, 0 after middle + half."""
    away = (r - middle) / half
    outer, inner = away >= 1.0, away > -1.0
    fc, slope = 0.0 * r + 1.0, 0.0 * r
    if any_lane(inner):
        sine, cosine = lane_sine_cosine(0.5 * math.pi * select(inner & ~outer, away, 1.0))
        fc = select(inner, 0.5 - 0.5 * sine, 1.0)
        slope = select(inner, -0.25 * math.pi / half * cosine, 0.0)
    return select(outer, 0.0 * fc, fc), select(outer, 0.0 * slope, slope)


@as_written
def angle_of_1988(law, row, cosine):
    """See `Form`."""
    gamma, c2, d2, cos_theta0 = row_numbers(law.by_triple, row, 0)
    away = cos_theta0 - cosine
    share = 1.0 / (d2 + away * away)
    angle = gamma * (1.0 + c2 / d2 * away * away * share)  # without the difference of two large numbers
    return angle, -2.0 * gamma * c2 * away * share * share


@as_written
def weakening_of_1988(law, row, n):
    """See `Form`."""
    return n, 1.0


@as_written
def bond_of_1988(law, row, r, fc, slope_fc):
    """See `Form`."""
    return fc, slope_fc, 0.0, 0.0


FORMS[TersoffLaw] = Form(smooth_end, angle_of_1988, weakening_of_1988, bond_of_1988)


@as_written
def sum_others(law, own, bonds, others, j, most):
    """Return zeta of the bond j, summed over the other neighbours, and keep the terms with their slopes."""
    species, to = float(law.species), j * BOND
    nx, ny, nz = load(bonds, to + NX), load(bonds, to + NY), load(bonds, to + NZ)
    r, bonded = load(bonds, to + R), value_of(load(bonds, to + KIND))
    zeta = zeros_in(law.by_pair)
    for k in range(most):
        if k == j:
            continue
        at, keep = k * BOND, k * OTHER
        kx, ky, kz = load(bonds, at + NX), load(bonds, at + NY), load(bonds, at + NZ)
        row = (own * species + bonded) * species + value_of(load(bonds, at + KIND))
        cosine = kx * nx + ky * ny + kz * nz
        angle, slope_angle = angle_of(law, row, cosine)
        fc, slope_fc = load(bonds, at + FC), load(bonds, at + SLOPE_FC)
        if law.ends:
            _, _, middle, half = row_numbers(law.by_triple, row, 4)
            fc, slope_fc = end_of(law, load(bonds, at + R), middle, half)
        if law.stretched:
            lambda3, power, _, _ = row_numbers(law.by_triple, row, 4)
            stretch = lambda3 * (r - load(bonds, at + R))
            cubed = power > 1.0
            exponent = select(cubed, stretch * stretch * stretch, stretch)
            slope_exponent = lambda3 * select(cubed, 3.0 * stretch * stretch, 1.0)
            growth = lane_exp(select(~(exponent > MOST_EXPONENT), exponent, MOST_EXPONENT))
            angle, slope_angle = angle * growth, slope_angle * growth
            plain = fc * angle * slope_exponent
            store(others, keep + PLAIN, plain)
            store(others, keep + BY_LENGTH, slope_fc * angle - plain)
        else:
            store(others, keep + PLAIN, zeros_in(others))
            store(others, keep + BY_LENGTH, slope_fc * angle)
        zeta = zeta + fc * angle
        store(others, keep + COS, cosine)
        store(others, keep + BY_ANGLE, fc * slope_angle)
    return zeta


@as_written
def share_forces(law, own, bonds, others, j, most, zeta):
    """Add the gradient of the bond j's energy in each bond's vector. Return the energy."""
    to, row = j * BOND, own * float(law.species) + value_of(load(bonds, j * BOND + KIND))
    big, lambda1, small, lambda2 = row_numbers(law.by_pair, row, 0)
    beta, n, _, _ = row_numbers(law.by_pair, row, 4)
    least, _, _, _ = row_numbers(law.by_pair, row, 8)
    r = load(bonds, to + R)
    delta, ratio = weakening_of(law, row, n)
    fc, slope_fc, more, slope_more = bond_of(law, row, r, load(bonds, to + FC), load(bonds, to + SLOPE_FC))
    repulsion, attraction = big * lane_exp(-lambda1 * r), -small * lane_exp(-lambda2 * r)
    x = beta * zeta
    tied = ~(x < least)  # else zeta is too little to change the bond
    grown = n * lane_log(select(tied, x, 1.0))
    power = lane_exp(select(~(grown > 80.0), grown, 80.0))
    log_sum = select(grown > 40.0, grown, lane_log(1.0 + power))
    order = select(tied, lane_exp(-0.5 / delta * log_sum), 1.0)
    slope_order = select(tied, -0.5 * ratio * order * (power / (1.0 + power)) / select(tied, zeta, 1.0), 0.0)
    both = repulsion + order * attraction
    outward = 0.5 * (slope_fc * both - fc * (lambda1 * repulsion + lambda2 * order * attraction) + slope_more)
    w = 0.5 * fc * attraction * slope_order
    nx, ny, nz = load(bonds, to + NX), load(bonds, to + NY), load(bonds, to + NZ)
    inverse = w * load(bonds, to + INVERSE)
    ax, ay, az = zeros_in(others), zeros_in(others), zeros_in(others)
    for k in range(most):
        if k == j:
            continue
        at, keep = k * BOND, k * OTHER
        kx, ky, kz = load(bonds, at + NX), load(bonds, at + NY), load(bonds, at + NZ)
        cosine, by_angle = load(others, keep + COS), load(others, keep + BY_ANGLE)
        outward = outward + w * load(others, keep + PLAIN) - inverse * by_angle * cosine
        ax, ay, az = ax + by_angle * kx, ay + by_angle * ky, az + by_angle * kz
        across = w * by_angle * load(bonds, at + INVERSE)
        further = w * load(others, keep + BY_LENGTH) - across * cosine
        store(bonds, at + GX, load(bonds, at + GX) + (across * nx + further * kx))
        store(bonds, at + GY, load(bonds, at + GY) + (across * ny + further * ky))
        store(bonds, at + GZ, load(bonds, at + GZ) + (across * nz + further * kz))
    store(bonds, to + GX, load(bonds, to + GX) + (outward * nx + inverse * ax))
    store(bonds, to + GY, load(bonds, to + GY) + (outward * ny + inverse * ay))
    store(bonds, to + GZ, load(bonds, to + GZ) + (outward * nz + inverse * az))
    return 0.5 * (fc * both + more)
