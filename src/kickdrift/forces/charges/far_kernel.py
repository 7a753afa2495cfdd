"""Ewald's far part (1921, doi:10.1002/andp.19213690304) as a direct sum over waves, and the terms of pairs left out.

Particles go in blocks. A block has tables of the powers of exp(2 pi i s) for each fractional coordinate s. A column of
waves shares the product of the first two tables, and the waves n and -n of a column share their four real products.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from kickdrift.forces.bonded.kernel import clear_along, note_along
from kickdrift.forces.charges.waves import Waves
from kickdrift.forces.lists.clusters import chunk_count
from kickdrift.forces.seam.kernel import OK, kernel
from kickdrift.jit.compile import as_written, jit, never_inline, strict
from kickdrift.jit.inner import by_type
from kickdrift.jit.lanes.functions import lane_sine_cosine, lane_sum, multiply_add, splat
from kickdrift.jit.lanes.memory import aligned, load, store
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.jit.threads.chunks import Chunks, chunk_task, each_chunk, in_chunks
from kickdrift.model.box.box import Box
from kickdrift.model.box.cell import Cell, along, cell_of, follow, leaning_image
from kickdrift.model.state import Floats

SIZE = 128  # particles in a block
COEFFICIENTS = 8  # numbers of two waves for the forces
LEANS = ((2, 1), (1, 0), (2, 0))  # an edge vector, and the axis before its own along which it leans
TINY = 1e-2  # of alpha r, below which differences of erf lose digits


class Far(NamedTuple):
    """Ewald's far part, and pairs that the near part leaves out or scales, bound to a System."""

    alpha: float  # splitting parameter; 0 without waves
    alone: float  # energy of the charges with their own clouds
    background: float  # times 1 / volume, the energy of the neutralising background
    charges: NDArray[np.float64]  # (n,) scaled by the root of Coulomb's constant
    inverse_masses: NDArray[np.float64]  # (n,)
    cell: Cell
    waves: Waves
    tilts: Floats  # (3,) see `tilts_of`
    edges: Floats  # (3, 3) edge vectors of now, see `take_edges`
    inverse: NDArray[np.float64]  # (3, 3) fractional coordinates are positions times this matrix
    amplitude: NDArray[np.float64]  # (waves, 2) 4 pi exp(-k^2 / 4 alpha^2) / (k^2 volume)
    falling: NDArray[np.float64]  # (waves, 2) 1 - k^2 / 2 alpha^2, the virial of a wave over its energy
    partial: NDArray[np.float64]  # (chunks, waves, 4) sums of the four real products
    coefficients: NDArray[np.float64]  # (waves, COEFFICIENTS)
    s: NDArray[np.float64]  # (3, blocks SIZE) fractional coordinates; later the forces
    q: NDArray[np.float64]  # (blocks SIZE,)
    tables: NDArray[np.float64]  # (chunks, room)
    pairs: NDArray[np.int64]  # (m, 2) pairs that the near part leaves out or scales
    factors: NDArray[np.float64]  # (m,)
    chunks: Chunks
    along: Any = None  # virial for a barostat, one row; see `lists.along`


def bind(
    alpha: float,
    waves: Waves,
    alone: float,
    background: float,
    charges: Floats,
    masses: Floats,
    box: Box,
    special: tuple[NDArray[np.int64], Floats],
    threads: int,
) -> Far:
    """Parts for charges and coherent masses (n,), and ``special`` pairs with their factors."""
    n, count = len(charges), len(waves.kept)
    blocks, chunks = -(-n // SIZE), min(chunk_count(n), -(-n // SIZE))
    room = 2 * SIZE * (sum(waves.most) + 3 + 1) + 3 * SIZE
    q = aligned((blocks * SIZE,))
    q[:n] = charges
    return Far(
        alpha=alpha,
        alone=alone,
        background=background,
        charges=charges,
        inverse_masses=1.0 / masses,
        cell=cell_of(box),
        waves=waves,
        tilts=tilts_of(box),
        edges=np.zeros((3, 3)),
        inverse=np.zeros((3, 3)),
        amplitude=np.zeros((count, 2)),
        falling=np.zeros((count, 2)),
        partial=np.zeros((chunks, count, 4)),
        coefficients=np.zeros((count, COEFFICIENTS)),
        s=aligned((3, blocks * SIZE)),
        q=q,
        tables=aligned((chunks, room), fill=None),
        pairs=special[0],
        factors=special[1],
        chunks=in_chunks(chunks, threads),
    )


@kernel(Far)
def far_body(force, t, x, v, a, sums):
    return add_far(force, x, a, sums)


@jit
def add_far(force, x, a, sums):
    """Add the accelerations (3, n) to a and, unless ``sums`` is None, energy and virial to sums. Return a status."""
    energy, virial = force.alone, 0.0
    if sums is not None:
        clear_along(force.along)
    if force.alpha > 0.0:
        volume = measure_box(force)
        energy += force.background / volume
        virial += 3.0 * force.background / volume
        if force.waves.kept.shape[0] > 0:
            into_fractions(force, x)
            each_chunk(force, force.chunks, "chunk_waves")
            found = collect_densities(force)
            energy += found[0]
            virial += found[1]
            if sums is not None:
                note_waves(force.along, force)
            each_chunk(force, force.chunks, "chunk_far_forces")
            add_forces(force, a)
        if sums is None:
            found = leave_out(force, x, a, None)
        else:
            note_even(force.along, force.background / volume)
            found = leave_out(force, x, a, force.along)
        energy += found[0]
        virial += found[1]
    if sums is not None:
        sums[0] += energy
        sums[1] += virial
    return OK


def tilts_of(box: Box) -> Floats:
    """Tilts (3,) cy / by, bx / ax and cx / ax of a box, each over the edge that can change it by 1; zero along open
    axes."""
    matrix, edges = box.matrix, np.diag(box.matrix)
    return np.array([matrix[row, k] / edges[k] if edges[k] > 0.0 else 0.0 for row, k in LEANS])


@strict
def take_edges(matrix, tilts, edges):
    """edges <- edge vectors of the lattice of ``matrix`` that lean most nearly by ``tilts``, those of the first box.

    So waves and meshes keep their numbers when a barostat takes other edges of the same lattice."""
    never_inline()
    edges[:] = matrix
    for place in range(3):
        row, k = LEANS[place]
        count = math.floor(edges[row, k] / edges[k, k] - tilts[place] + 0.5)
        if count != 0:
            for m in range(k + 1):
                edges[row, m] -= count * edges[k, m]


@jit
def invert(force):
    """Write edge vectors of the box of now and their inverse. Return the volume."""
    never_inline()
    follow(force.cell)
    take_edges(force.cell.matrix, force.tilts, force.edges)
    matrix, inverse = force.edges, force.inverse
    for k in range(3):
        inverse[k, k] = 1.0 / matrix[k, k]
    inverse[1, 0] = -matrix[1, 0] * inverse[0, 0] * inverse[1, 1]
    inverse[2, 1] = -matrix[2, 1] * inverse[1, 1] * inverse[2, 2]
    inverse[2, 0] = -(matrix[2, 0] * inverse[0, 0] + matrix[2, 1] * inverse[1, 0]) * inverse[2, 2]
    return matrix[0, 0] * matrix[1, 1] * matrix[2, 2]


@jit
def measure_box(force):
    """Write the inverse of the edge vectors, and amplitudes of the waves, for the box of now. Return its volume."""
    never_inline()
    volume, inverse = invert(force), force.inverse
    waves, amplitude, falling = force.waves, force.amplitude, force.falling
    over = 0.25 / force.alpha**2
    for c in range(waves.columns.shape[0]):
        for k in range(waves.first[c], waves.first[c + 1]):
            for side in range(2):
                n = float((k - waves.first[c]) * (1 - 2 * side))
                k2 = 0.0
                for m in range(3):
                    each = inverse[m, 0] * waves.columns[c, 0] + inverse[m, 1] * waves.columns[c, 1] + inverse[m, 2] * n
                    k2 += (2.0 * math.pi * each) ** 2
                amplitude[k, side], falling[k, side] = 0.0, 0.0
                if waves.kept[k, side] > 0.0:
                    amplitude[k, side] = 4.0 * math.pi * math.exp(-k2 * over) / (k2 * volume)
                    falling[k, side] = 1.0 - 2.0 * over * k2
    return volume


@jit
def into_fractions(force, x):
    """Write the fractional coordinates of positions x (3, n), from -1/2 to 1/2."""
    never_inline()
    inverse, s = force.inverse, force.s
    for i in range(x.shape[1]):
        for k in range(3):
            each = x[0, i] * inverse[0, k] + x[1, i] * inverse[1, k] + x[2, i] * inverse[2, k]
            s[k, i] = each - math.floor(each + 0.5)


@as_written
def fill_tables(force, own, block):
    """Write the powers of exp(2 pi i s) of a block's particles to ``own``: for each axis real and imaginary parts."""
    at = 0
    for axis in range(3):
        row, most = force.s[axis], force.waves.most[axis]
        for p in range(0, SIZE, WIDTH):
            half_sine, half_cosine = lane_sine_cosine(math.pi * load(row, SIZE * block + p))
            c = half_cosine * half_cosine - half_sine * half_sine
            d = 2.0 * half_cosine * half_sine
            a, b = splat(1.0), splat(0.0)
            for power in range(most + 1):
                place = at + 2 * SIZE * power + p
                store(own, place, a)
                store(own, place + SIZE, b)
                a, b = a * c - b * d, a * d + b * c
        at += 2 * SIZE * (most + 1)
    return at


@as_written
def fill_column(force, own, block, c, end):
    """Write q exp(2 pi i (u s + w s')) of column c = (u, w), for a block's particles, from ``end`` on. Return where the
    table of the third axis begins."""
    most, u, w = force.waves.most, force.waves.columns[c, 0], force.waves.columns[c, 1]
    second = 2 * SIZE * (most[0] + 1)
    third = second + 2 * SIZE * (most[1] + 1)
    at, beside, sign = 2 * SIZE * u, second + 2 * SIZE * abs(w), -1.0 if w < 0 else 1.0
    for p in range(0, SIZE, WIDTH):
        a, b = load(own, at + p), load(own, at + SIZE + p)
        c, d = load(own, beside + p), sign * load(own, beside + SIZE + p)
        q = load(force.q, SIZE * block + p)
        store(own, end + p, q * (a * c - b * d))
        store(own, end + SIZE + p, q * (a * d + b * c))
    return third


@as_written
def blocks_of(force, c):
    """Return the blocks of chunk c: first, last + 1."""
    count, chunks = force.q.size // SIZE, force.partial.shape[0]
    return c * count // chunks, (c + 1) * count // chunks


@chunk_task
def chunk_waves(force, chunk):
    """Sum the four real products of each column and power of the third axis over the particles of a chunk."""
    never_inline()
    own, partial, waves = force.tables[chunk], force.partial[chunk], force.waves
    partial[:] = 0.0
    begin, end = blocks_of(force, chunk)
    for block in range(begin, end):
        free = fill_tables(force, own, block)
        for c in range(waves.columns.shape[0]):
            third = fill_column(force, own, block, c, free)
            for k in range(waves.first[c], waves.first[c + 1]):
                at = third + 2 * SIZE * (k - waves.first[c])
                ac, bd, ad, bc = splat(0.0), splat(0.0), splat(0.0), splat(0.0)
                for p in range(0, SIZE, WIDTH):
                    re, im = load(own, free + p), load(own, free + SIZE + p)
                    cosine, sine = load(own, at + p), load(own, at + SIZE + p)
                    ac, bd = multiply_add(re, cosine, ac), multiply_add(im, sine, bd)
                    ad, bc = multiply_add(re, sine, ad), multiply_add(im, cosine, bc)
                partial[k, 0] += lane_sum(ac)
                partial[k, 1] += lane_sum(bd)
                partial[k, 2] += lane_sum(ad)
                partial[k, 3] += lane_sum(bc)


@jit
def collect_densities(force):
    """Sum the chunks, write the coefficients of the forces, and return energy and virial."""
    never_inline()
    energy, virial, waves = 0.0, 0.0, force.waves
    for c in range(waves.columns.shape[0]):
        for k in range(waves.first[c], waves.first[c + 1]):
            ac, bd, ad, bc = 0.0, 0.0, 0.0, 0.0
            for chunk in range(force.partial.shape[0]):
                ac += force.partial[chunk, k, 0]
                bd += force.partial[chunk, k, 1]
                ad += force.partial[chunk, k, 2]
                bc += force.partial[chunk, k, 3]
            up, down = force.amplitude[k, 0], force.amplitude[k, 1]
            up_re, up_im, down_re, down_im = ac - bd, bc + ad, ac + bd, bc - ad
            first = up * (up_re * up_re + up_im * up_im)
            second = down * (down_re * down_re + down_im * down_im)
            energy += first + second
            virial += first * force.falling[k, 0] + second * force.falling[k, 1]
            even_re, odd_re = up * up_re + down * down_re, up * up_re - down * down_re
            even_im, odd_im = up * up_im + down * down_im, up * up_im - down * down_im
            n = float(k - waves.first[c])
            row = force.coefficients[k]
            row[0], row[1], row[2], row[3] = even_re, odd_im, odd_re, -even_im
            row[4], row[5], row[6], row[7] = n * odd_re, n * even_im, n * even_re, -n * odd_im
    return energy, virial


@by_type
def note_even(virials, each):
    """Add a virial that is the same along each axis, if it is asked."""
    if isinstance(virials, types.NoneType):
        return lambda virials, each: None

    def note(virials, each):
        note_along(virials, 0, -each, (1.0, 0.0, 0.0))
        note_along(virials, 1, -each, (0.0, 1.0, 0.0))
        note_along(virials, 2, -each, (0.0, 0.0, 1.0))

    return note


@by_type
def note_waves(virials, force):
    """Add the virial of the waves along each axis, if it is asked. Their densities are in the coefficients of the
    forces (Heyes 1994, doi:10.1103/PhysRevB.49.755)."""
    if isinstance(virials, types.NoneType):
        return lambda virials, force: None

    def note(virials, force):
        never_inline()
        waves, inverse, total, wave = force.waves, force.inverse, 0.0, np.empty(3)
        for c in range(waves.columns.shape[0]):
            for k in range(waves.first[c], waves.first[c + 1]):
                row = force.coefficients[k]
                for side in range(2):
                    amplitude, sign = force.amplitude[k, side], 1.0 - 2.0 * side
                    if amplitude == 0.0:
                        continue
                    re, im = 0.5 * (row[0] + sign * row[2]), 0.5 * (row[1] - sign * row[3])
                    energy, k2 = (re * re + im * im) / amplitude, 0.0
                    n = sign * (k - waves.first[c])
                    for m in range(3):
                        each = inverse[m, 0] * waves.columns[c, 0] + inverse[m, 1] * waves.columns[c, 1]
                        wave[m] = 2.0 * math.pi * (each + inverse[m, 2] * n)
                        k2 += wave[m] * wave[m]
                    pull = energy * (2.0 / k2 + 0.5 / (force.alpha * force.alpha))
                    for m in range(3):
                        note_along(virials, m, pull * wave[m], wave)
                    total += energy
        note_even(virials, total)

    return note


@chunk_task
def chunk_far_forces(force, chunk):
    """Write the forces on the particles of a chunk in the place of their fractional coordinates."""
    never_inline()
    own, waves, rows = force.tables[chunk], force.waves, force.coefficients
    begin, end = blocks_of(force, chunk)
    inverse = force.inverse
    for block in range(begin, end):
        free = fill_tables(force, own, block)
        total = free + 2 * SIZE
        for p in range(0, 3 * SIZE, WIDTH):
            store(own, total + p, splat(0.0))
        for c in range(waves.columns.shape[0]):
            third = fill_column(force, own, block, c, free)
            along_first, along_second = float(waves.columns[c, 0]), float(waves.columns[c, 1])
            for p in range(0, SIZE, 2 * WIDTH):
                r0, i0, r1, i1 = splat(0.0), splat(0.0), splat(0.0), splat(0.0)
                r2, i2, r3, i3 = splat(0.0), splat(0.0), splat(0.0), splat(0.0)
                for k in range(waves.first[c], waves.first[c + 1]):
                    at = third + 2 * SIZE * (k - waves.first[c]) + p
                    c0, d0 = load(own, at), load(own, at + SIZE)
                    c1, d1 = load(own, at + WIDTH), load(own, at + SIZE + WIDTH)
                    u, w = splat(rows[k, 0]), splat(rows[k, 1])
                    i0, i1 = multiply_add(u, c0, multiply_add(w, d0, i0)), multiply_add(u, c1, multiply_add(w, d1, i1))
                    u, w = splat(rows[k, 2]), splat(rows[k, 3])
                    r0, r1 = multiply_add(u, d0, multiply_add(w, c0, r0)), multiply_add(u, d1, multiply_add(w, c1, r1))
                    u, w = splat(rows[k, 4]), splat(rows[k, 5])
                    i2, i3 = multiply_add(u, c0, multiply_add(w, d0, i2)), multiply_add(u, c1, multiply_add(w, d1, i3))
                    u, w = splat(rows[k, 6]), splat(rows[k, 7])
                    r2, r3 = multiply_add(u, d0, multiply_add(w, c0, r2)), multiply_add(u, d1, multiply_add(w, c1, r3))
                push(own, free + p, total + p, along_first, along_second, r0, i0, r2, i2)
                push(own, free + p + WIDTH, total + p + WIDTH, along_first, along_second, r1, i1, r3, i3)
        for p in range(0, SIZE, WIDTH):
            f, g, h = load(own, total + p), load(own, total + SIZE + p), load(own, total + 2 * SIZE + p)
            for k in range(3):
                each = inverse[k, 0] * f + inverse[k, 1] * g + inverse[k, 2] * h
                store(force.s[k], SIZE * block + p, (4.0 * math.pi) * each)


@as_written
def push(own, at, total, along_first, along_second, re, im, re_n, im_n):
    """Add a column's forces on eight particles, along the edges of the reciprocal lattice."""
    a, b = load(own, at), load(own, at + SIZE)
    plain = multiply_add(b, im, a * re)
    store(own, total, load(own, total) + along_first * plain)
    store(own, total + SIZE, load(own, total + SIZE) + along_second * plain)
    store(own, total + 2 * SIZE, load(own, total + 2 * SIZE) + multiply_add(b, im_n, a * re_n))


@jit
def add_forces(force, a):
    """Add the accelerations that the forces give."""
    never_inline()
    for k in range(3):
        for i in range(a.shape[1]):
            a[k, i] += force.s[k, i] * force.inverse_masses[i]


@jit
def leave_out(force, x, a, virials):
    """Take the far part of pairs that are left out or scaled from the accelerations. Add their virial along each axis
    to ``virials``, if it is asked. Return energy and virial."""
    never_inline()
    energy, virial, d = 0.0, 0.0, np.empty(3)
    for e in range(force.pairs.shape[0]):
        i, j = force.pairs[e, 0], force.pairs[e, 1]
        for k in range(3):
            d[k] = x[k, i] - x[k, j]
        if force.cell.leans:
            leaning_image(force.cell, d)
        else:
            for k in range(3):
                d[k] = along(force.cell.edges[k], d[k])
        r2 = d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
        u, g = cloud_terms(force.alpha, r2)
        product = (force.factors[e] - 1.0) * force.charges[i] * force.charges[j]
        energy += product * u
        virial += product * g * r2
        for k in range(3):
            a[k, i] += product * g * d[k] * force.inverse_masses[i]
            a[k, j] -= product * g * d[k] * force.inverse_masses[j]
            note_along(virials, k, -product * g * d[k], d)
    return energy, virial


@jit
def cloud_terms(alpha, r2):
    """Return erf(alpha r) / r and its force over r at a squared distance, which may be zero for a finite alpha."""
    if alpha == math.inf:
        return 1.0 / math.sqrt(r2), 1.0 / (r2 * math.sqrt(r2))
    z = alpha * math.sqrt(r2)
    if z < TINY:
        first = 2.0 * alpha / math.sqrt(math.pi)
        square = z * z
        return first * (1.0 - square / 3.0 + square * square / 10.0), first * alpha**2 * (
            2.0 / 3.0 - 0.4 * square + square * square / 7.0
        )
    u = math.erf(z) * alpha / z
    return u, (u - 2.0 * alpha / math.sqrt(math.pi) * math.exp(-z * z)) / r2
