"""Smooth particle-mesh Ewald (Essmann et al. 1995, doi:10.1063/1.470117): Ewald's far part on a mesh.

Ions are sorted by the columns of the mesh. B-splines spread their charges over the mesh, in blocks of columns. Blocks
that touch the same points of the mesh have different colours, and one colour follows the other. So each point gets its
charges in one order, on any number of threads. Fourier transforms and the influence of the charges follow, then the
splines' slopes give the forces.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.charges.accuracy import Split
from kickdrift.forces.charges.far_kernel import add_forces, invert, leave_out
from kickdrift.forces.charges.fourier import POINT, Plan, plan_of, transform
from kickdrift.forces.charges.splines import MOST, column_order, moduli, put, weigh
from kickdrift.forces.lists.clusters import chunk_count
from kickdrift.forces.seam.kernel import FORCES, OK, BoundForce, call_force, kernel
from kickdrift.jit.compile import as_written, driver, jit, never_inline, strict
from kickdrift.jit.lanes.functions import lane_exp, lane_numbers, lane_sum, multiply_add, splat
from kickdrift.jit.lanes.gathering import transposed
from kickdrift.jit.lanes.memory import aligned, broadcast, load, store
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.jit.threads.chunks import Chunks, chunk_task, each_chunk, in_chunks
from kickdrift.model.box.box import Box
from kickdrift.model.box.cell import Cell, cell_of
from kickdrift.model.state import Floats

PAIR = 2 * WIDTH  # rows of the mesh that one transform takes: eight as real parts, eight as imaginary parts
SHARES = 16  # chunks of the planes, and of the lines across all planes
COLOUR, WANTED = range(2)  # places in `Mesh.state`


class Mesh(NamedTuple):
    """Ewald's far part on a mesh, and pairs that the near part leaves out or scales, bound to a System.

    Row (x, y) of the mesh has ``row`` numbers, the last ones a copy of the first. The spectrum of a row has ``half``
    real and ``half`` imaginary parts, and all spectra of a plane x have ``plane`` numbers."""

    alpha: float  # splitting parameter
    alone: float  # energy of the charges with their own clouds
    background: float  # times 1 / volume, the energy of the neutralising background
    charges: NDArray[np.float64]  # (n,) scaled by the root of Coulomb's constant
    inverse_masses: NDArray[np.float64]  # (n,)
    cell: Cell
    inverse: NDArray[np.float64]  # (3, 3) fractional coordinates are positions times this matrix
    pairs: NDArray[np.int64]  # (m, 2) pairs that the near part leaves out or scales
    factors: NDArray[np.float64]  # (m,)
    order: int  # of the splines
    first: Plan  # along x
    second: Plan
    third: Plan
    row: int
    half: int
    plane: int
    first_moduli: Floats  # (x,) squared moduli of the splines' transforms; 0 for a wave that is left out
    second_moduli: Floats  # (y,)
    third_moduli: Floats  # (half,)
    weights: Floats  # (half,) number of waves, of k and -k, for which a number of the spectrum stands
    mesh: Floats  # (x y row,)
    spectrum: Floats  # (x plane,)
    influence: Floats  # (y half x,) potential over density of each wave, in the order of lines along x
    made_for: Floats  # (3, 3) edge vectors at which the influence was made
    place: Floats  # (4, n + WIDTH) mesh coordinates of the ions, and their charges, in sorted order
    unsorted: Floats  # (3, n) mesh coordinates
    home: NDArray[np.int32]  # (n,) column of each ion
    ions: NDArray[np.int64]  # (n,) ions in sorted order
    column: NDArray[np.int32]  # (x y,) number of each column: columns of a block follow one another
    filled: NDArray[np.int64]  # (columns + 1,) ions in front of each column
    blocks: NDArray[np.int64]  # (blocks + 1,) the first column of each block
    colours: NDArray[np.int64]  # (colours + 1,) the first block of each colour
    s: Floats  # (3, n) forces
    own: Floats  # (threads, room)
    parts: Floats  # (SHARES, 2) energy and virial of each chunk of lines
    state: NDArray[np.int64]  # (2,)
    some: Chunks  # of the ions
    planes: Chunks
    lines: Chunks
    coloured: Chunks  # of the blocks of a colour


def bind(
    alpha: float,
    order: int,
    shape: tuple[int, ...],
    alone: float,
    background: float,
    charges: Floats,
    masses: Floats,
    box: Box,
    special: tuple[NDArray[np.int64], Floats],
    threads: int,
) -> Mesh:
    """Parts for charges and coherent masses (n,), and ``special`` pairs with their factors."""
    n, (nx, ny, nz) = len(charges), shape
    half = WIDTH * (nz // 2 // WIDTH + 1)
    row = WIDTH * -(-nz // WIDTH) + WIDTH
    plane = 2 * half * ny + WIDTH
    column, blocks, colours = column_order(nx, ny, order)
    kept = np.zeros(half)
    kept[: nz // 2] = moduli(nz, order)[: nz // 2]
    weights = np.full(half, 2.0)
    weights[0] = 1.0
    shares = min(SHARES, nx), min(SHARES, ny)
    return Mesh(
        alpha=alpha,
        alone=alone,
        background=background,
        charges=charges,
        inverse_masses=1.0 / masses,
        cell=cell_of(box),
        inverse=np.zeros((3, 3)),
        pairs=special[0],
        factors=special[1],
        order=order,
        first=plan_of(nx),
        second=plan_of(ny),
        third=plan_of(nz),
        row=row,
        half=half,
        plane=plane,
        first_moduli=moduli(nx, order),
        second_moduli=moduli(ny, order),
        third_moduli=kept,
        weights=weights,
        mesh=aligned((nx * ny * row,)),
        spectrum=aligned((nx * plane,)),
        influence=aligned((nx * ny * half,)),
        made_for=np.zeros((3, 3)),
        place=aligned((4, WIDTH * (-(-n // WIDTH) + 1))),
        unsorted=np.zeros((3, n)),
        home=np.zeros(n, np.int32),
        ions=np.zeros(n, np.int64),
        column=column,
        filled=np.zeros(nx * ny + 1, np.int64),
        blocks=blocks,
        colours=colours,
        s=np.zeros((3, n)),
        own=aligned((threads, 4 * POINT * (max(shape) + WIDTH))),
        parts=np.zeros((shares[1], 2)),
        state=np.zeros(2, np.int64),
        some=in_chunks(4 * chunk_count(n), threads),
        planes=in_chunks(shares[0], threads),
        lines=in_chunks(shares[1], threads),
        coloured=in_chunks(int(colours[1]), threads),
    )


@kernel(Mesh)
def mesh_body(force, t, x, v, a, sums):
    return add_mesh(force, x, a, sums)


@jit
def add_mesh(force, x, a, sums):
    """Add the accelerations (3, n) to a and, unless ``sums`` is None, energy and virial to sums. Return a status."""
    volume = invert(force)
    if has_changed(force):
        each_chunk(force, force.lines, "mesh_influence")
    force.state[WANTED] = 0 if sums is None else 1
    bring_positions(force, x)
    each_chunk(force, force.some, "mesh_places")
    sort_ions(force)
    for colour in range(force.colours.size - 1):
        force.state[COLOUR] = colour
        each_chunk(force, force.coloured, "mesh_spread")
    each_chunk(force, force.planes, "mesh_forward")
    each_chunk(force, force.lines, "mesh_lines")
    each_chunk(force, force.planes, "mesh_backward")
    each_chunk(force, force.some, "mesh_gather")
    add_forces(force, a)
    energy, virial = leave_out(force, x, a)
    if sums is not None:
        energy += force.alone + force.background / volume
        virial += 3.0 * force.background / volume
        for c in range(force.parts.shape[0]):
            energy += force.parts[c, 0]
            virial += force.parts[c, 1]
        sums[0] += energy
        sums[1] += virial
    return OK


@strict
def has_changed(force):
    """Tell whether the box is another one than that of the influence."""
    never_inline()
    changed = False
    for k in range(3):
        for m in range(3):
            changed = changed or force.made_for[k, m] != force.cell.matrix[k, m]
            force.made_for[k, m] = force.cell.matrix[k, m]
    return changed


@as_written
def share(count, shares, c):
    """Return the part of ``count`` things that chunk c of ``shares`` takes: first, last + 1."""
    return c * count // shares, (c + 1) * count // shares


# --- ions and the mesh ---


@strict
def bring_positions(force, x):
    """Copy positions (3, n)."""
    never_inline()
    for k in range(3):
        for i in range(x.shape[1]):
            force.unsorted[k, i] = x[k, i]


@chunk_task
def mesh_places(force, c):
    """Write the mesh coordinates and the columns of a chunk's ions, and clear a part of the mesh."""
    never_inline()
    chunks, inverse, places = force.some.number, force.inverse, force.unsorted
    begin, end = share(force.mesh.size // WIDTH, chunks, c)
    for k in range(begin, end):
        store(force.mesh, WIDTH * k, splat(0.0))
    nx, ny, nz = force.first.n, force.second.n, force.third.n
    begin, end = share(places.shape[1], chunks, c)
    for i in range(begin, end):
        x, y, z = places[0, i], places[1, i], places[2, i]
        u = x * inverse[0, 0] + y * inverse[1, 0] + z * inverse[2, 0]
        v = y * inverse[1, 1] + z * inverse[2, 1]
        w = z * inverse[2, 2]
        u, v, w = on_mesh(u, nx), on_mesh(v, ny), on_mesh(w, nz)
        places[0, i], places[1, i], places[2, i] = u, v, w
        force.home[i] = force.column[int(u) * ny + int(v)]


@as_written
def on_mesh(s, n):
    """Return a fractional coordinate as a mesh coordinate from 0 to below n; 0 if it makes no sense."""
    u = (s - math.floor(s)) * n
    return u if 0.0 <= u < n else 0.0


@strict
def sort_ions(force):
    """Sort the ions by columns."""
    never_inline()
    filled, home = force.filled, force.home
    filled[:] = 0
    for i in range(home.size):
        filled[home[i] + 1] += 1
    for k in range(1, filled.size):
        filled[k] += filled[k - 1]
    place, charges, unsorted = force.place, force.charges, force.unsorted
    for i in range(home.size):
        at = filled[home[i]]
        filled[home[i]] = at + 1
        force.ions[at] = i
        place[0, at], place[1, at], place[2, at] = unsorted[0, i], unsorted[1, i], unsorted[2, i]
        place[3, at] = charges[i]
    for k in range(filled.size - 1, 0, -1):  # the loop above has moved each start to the next one
        filled[k] = filled[k - 1]
    filled[0] = 0


@as_written
def point_before(u, n):
    """Return the first point of the mesh, of n points, that an ion at this coordinate touches."""
    return (int(u) if u >= 1.0 else n) - 1


@chunk_task
def mesh_spread(force, c, thread):
    """Spread the charges of a block of the present colour."""
    never_inline()
    block = force.colours[force.state[COLOUR]] + c
    if block >= force.colours[force.state[COLOUR] + 1]:
        return
    own, mesh, order, place = force.own[thread], force.mesh, force.order, force.place
    nx, ny, nz, row = force.first.n, force.second.n, force.third.n, force.row
    begin, end = force.filled[force.blocks[block]], force.filled[force.blocks[block + 1]]
    for first in range(begin, end, WIDTH):
        weigh(own, place, first, order)
        for lane in range(min(WIDTH, end - first)):
            i = first + lane
            x, start = point_before(place[0, i], nx), point_before(place[1, i], ny)
            z = point_before(place[2, i], nz)
            along = place[3, i] * load(own, 6 * MOST * WIDTH + WIDTH * lane)
            for j in range(order):
                of_plane, y = broadcast(own, WIDTH * j + lane, along) * along, start
                for k in range(order):
                    at = (x * ny + y) * row + z
                    weight = broadcast(own, MOST * WIDTH + WIDTH * k + lane, along)
                    store(mesh, at, multiply_add(weight, of_plane, load(mesh, at)))
                    y = y + 1 if y + 1 < ny else 0
                x = x + 1 if x + 1 < nx else 0


@chunk_task
def mesh_gather(force, c, thread):
    """Write the forces on a chunk's ions: their charges times the slope of the potential."""
    never_inline()
    own, mesh, order, place = force.own[thread], force.mesh, force.order, force.place
    nx, ny, nz, row = force.first.n, force.second.n, force.third.n, force.row
    begin, end = share(force.ions.size, force.some.number, c)
    inverse = force.inverse
    for first in range(begin, end, WIDTH):
        weigh(own, place, first, order)
        for lane in range(min(WIDTH, end - first)):
            i = first + lane
            x, start = point_before(place[0, i], nx), point_before(place[1, i], ny)
            z = point_before(place[2, i], nz)
            plain, by_x, by_y = splat(0.0), splat(0.0), splat(0.0)
            for j in range(order):
                of_line, slopes, y = splat(0.0), splat(0.0), start
                for k in range(order):
                    values = load(mesh, (x * ny + y) * row + z)
                    at = MOST * WIDTH + WIDTH * k + lane
                    of_line = multiply_add(broadcast(own, at, values), values, of_line)
                    slopes = multiply_add(broadcast(own, at + 3 * MOST * WIDTH, values), values, slopes)
                    y = y + 1 if y + 1 < ny else 0
                weight = broadcast(own, WIDTH * j + lane, plain)
                plain = multiply_add(weight, of_line, plain)
                by_y = multiply_add(weight, slopes, by_y)
                by_x = multiply_add(broadcast(own, 3 * MOST * WIDTH + WIDTH * j + lane, plain), of_line, by_x)
                x = x + 1 if x + 1 < nx else 0
            weights = load(own, 6 * MOST * WIDTH + WIDTH * lane)
            dx, dy = nx * lane_sum(weights * by_x), ny * lane_sum(weights * by_y)
            dz = nz * lane_sum(load(own, 7 * MOST * WIDTH + WIDTH * lane) * plain)
            q, ion = -place[3, i], force.ions[i]
            force.s[0, ion] = q * (inverse[0, 0] * dx)
            force.s[1, ion] = q * (inverse[1, 0] * dx + inverse[1, 1] * dy)
            force.s[2, ion] = q * (inverse[2, 0] * dx + inverse[2, 1] * dy + inverse[2, 2] * dz)


# --- transforms ---


@as_written
def eight_rows(array, at, stride, last):
    """Return eight transposed rows of eight numbers, ``stride`` apart from ``at`` on; none begins beyond ``last``."""
    return transposed(
        (
            load(array, min(at, last)),
            load(array, min(at + stride, last)),
            load(array, min(at + 2 * stride, last)),
            load(array, min(at + 3 * stride, last)),
            load(array, min(at + 4 * stride, last)),
            load(array, min(at + 5 * stride, last)),
            load(array, min(at + 6 * stride, last)),
            load(array, min(at + 7 * stride, last)),
        )
    )


@as_written
def store_rows(rows, array, at, stride, last):
    """Store eight lanes as rows, ``stride`` apart from ``at`` on; none begins beyond ``last``."""
    a, b, c, d, e, f, g, h = rows
    whole = at + 7 * stride <= last
    if at <= last:
        store(array, at, a)
    if whole or at + stride <= last:
        store(array, at + stride, b)
    if whole or at + 2 * stride <= last:
        store(array, at + 2 * stride, c)
    if whole or at + 3 * stride <= last:
        store(array, at + 3 * stride, d)
    if whole or at + 4 * stride <= last:
        store(array, at + 4 * stride, e)
    if whole or at + 5 * stride <= last:
        store(array, at + 5 * stride, f)
    if whole or at + 6 * stride <= last:
        store(array, at + 6 * stride, g)
    if whole:
        store(array, at + 7 * stride, h)


@chunk_task
def mesh_forward(force, c, thread):
    """Transform a chunk's planes along their rows and columns."""
    never_inline()
    own, mesh, spectrum = force.own[thread], force.mesh, force.spectrum
    ny, nz, row, half = force.second.n, force.third.n, force.row, force.half
    begin, end = share(force.first.n, force.planes.number, c)
    source, target = 2 * POINT * (nz + WIDTH), 3 * POINT * (nz + WIDTH)
    for x in range(begin, end):
        for y in range(ny):
            at = (x * ny + y) * row
            store(mesh, at, load(mesh, at) + load(mesh, at + nz))
        for y in range(0, ny, PAIR):
            at, last = (x * ny + y) * row, (x * ny + ny - 1) * row
            for z in range(0, nz, WIDTH):
                put(eight_rows(mesh, at + z, row, last + z), own, source + POINT * z, POINT)
                put(eight_rows(mesh, at + WIDTH * row + z, row, last + z), own, source + POINT * z + WIDTH, POINT)
            transform(force.third, own, source, POINT, WIDTH, own, target, POINT, WIDTH, own)
            part(own, target, source, nz, half)
            to, last = x * force.plane + 2 * half * y, x * force.plane + 2 * half * (ny - 1)
            for k in range(0, half, WIDTH):
                for which in range(4):  # real and imaginary parts of the first and of the other eight rows
                    side, group = which % 2, which // 2
                    from_here = (target if group else source) + POINT * k + WIDTH * side
                    store_rows(
                        eight_rows(own, from_here, POINT, from_here + 7 * POINT),
                        spectrum,
                        to + 2 * half * WIDTH * group + half * side + k,
                        2 * half,
                        last + half * side + k,
                    )
        for k in range(0, half, WIDTH):
            at = x * force.plane + k
            transform(force.second, spectrum, at, 2 * half, half, spectrum, at, 2 * half, half, own)


@as_written
def part(own, both, first, n, half):
    """Part the transform of two real lines a + i b at ``both``: write that of a to ``first``, that of b in place."""
    for k in range(n // 2 + 1):
        at, other = both + POINT * k, both + POINT * ((n - k) % n)
        a, b, c, d = load(own, at), load(own, at + WIDTH), load(own, other), load(own, other + WIDTH)
        store(own, first + POINT * k, 0.5 * (a + c))
        store(own, first + POINT * k + WIDTH, 0.5 * (b - d))
        store(own, at, 0.5 * (b + d))
        store(own, at + WIDTH, 0.5 * (c - a))
    for k in range(n // 2 + 1, half):
        for side in range(0, POINT, WIDTH):
            store(own, first + POINT * k + side, splat(0.0))
            store(own, both + POINT * k + side, splat(0.0))


@chunk_task
def mesh_lines(force, c, thread):
    """Transform a chunk's lines across the planes, multiply by the influence, sum energy and virial, and go back."""
    never_inline()
    own, spectrum, influence = force.own[thread], force.spectrum, force.influence
    nx, half = force.first.n, force.half
    line = 2 * POINT * (nx + WIDTH)
    energy, virial = splat(0.0), splat(0.0)
    begin, end = share(force.second.n, force.lines.number, c)
    for y in range(begin, end):
        for z in range(0, half, WIDTH):
            at = 2 * half * y + z
            transform(force.first, spectrum, at, force.plane, half, own, line, POINT, WIDTH, own)
            factors = (y * half + z) * nx
            if force.state[WANTED]:
                for x in range(nx):
                    re, im = load(own, line + POINT * x), load(own, line + POINT * x + WIDTH)
                    each = load(influence, factors + WIDTH * x) * load(force.weights, z) * (re * re + im * im)
                    k2 = squared_wave(force, x, y, z)
                    energy = energy + each
                    virial = multiply_add(k2, each, virial)
            for x in range(nx):
                factor, point = load(influence, factors + WIDTH * x), line + POINT * x
                store(own, point, factor * load(own, point))
                store(own, point + WIDTH, factor * load(own, point + WIDTH))
            transform(force.first, own, line + WIDTH, POINT, -WIDTH, spectrum, at + half, force.plane, -half, own)
    total = 0.5 * lane_sum(energy)
    force.parts[c, 0] = total
    force.parts[c, 1] = total - 0.25 * lane_sum(virial) / (force.alpha * force.alpha)


@as_written
def squared_wave(force, x, y, z):
    """Return k^2 of eight waves, from the third number z on."""
    inverse = force.inverse
    u = float(x if 2 * x <= force.first.n else x - force.first.n)
    v = float(y if 2 * y <= force.second.n else y - force.second.n)
    w = lane_numbers() + float(z)
    a = splat(inverse[0, 0] * u)
    b = splat(inverse[1, 0] * u + inverse[1, 1] * v)
    c = multiply_add(splat(inverse[2, 2]), w, splat(inverse[2, 0] * u + inverse[2, 1] * v))
    return (4.0 * math.pi * math.pi) * (a * a + b * b + c * c)


@chunk_task
def mesh_influence(force, c):
    """Write the influence of a chunk's lines for the box of now."""
    never_inline()
    nx, half, matrix = force.first.n, force.half, force.cell.matrix
    scale = 4.0 * math.pi / (matrix[0, 0] * matrix[1, 1] * matrix[2, 2])
    over = -0.25 / (force.alpha * force.alpha)
    begin, end = share(force.second.n, force.lines.number, c)
    for y in range(begin, end):
        for z in range(0, half, WIDTH):
            for x in range(nx):
                k2 = squared_wave(force, x, y, z)
                outer = scale * force.first_moduli[x] * force.second_moduli[y]
                at = (y * half + z) * nx + WIDTH * x
                store(force.influence, at, outer * load(force.third_moduli, z) * lane_exp(over * k2) / k2)
    if begin == 0:
        force.influence[0] = 0.0  # the wave of no wavelength


@chunk_task
def mesh_backward(force, c, thread):
    """Transform a chunk's planes back: the mesh then holds the potential."""
    never_inline()
    own, mesh, spectrum = force.own[thread], force.mesh, force.spectrum
    ny, nz, row, half = force.second.n, force.third.n, force.row, force.half
    begin, end = share(force.first.n, force.planes.number, c)
    first, second = 2 * POINT * (nz + WIDTH), 3 * POINT * (nz + WIDTH)
    for x in range(begin, end):
        for k in range(0, half, WIDTH):
            at = x * force.plane + k + half
            transform(force.second, spectrum, at, 2 * half, -half, spectrum, at, 2 * half, -half, own)
        for y in range(0, ny, PAIR):
            at, last = x * force.plane + 2 * half * y, x * force.plane + 2 * half * (ny - 1)
            for k in range(0, half, WIDTH):
                for which in range(4):
                    side, group = which % 2, which // 2
                    begins = at + 2 * half * WIDTH * group + half * side + k
                    rows = eight_rows(spectrum, begins, 2 * half, last + half * side + k)
                    put(rows, own, (second if group else first) + POINT * k + WIDTH * side, POINT)
            join(own, first, second, nz)
            transform(force.third, own, first + WIDTH, POINT, -WIDTH, own, second + WIDTH, POINT, -WIDTH, own)
            to, last = (x * ny + y) * row, (x * ny + ny - 1) * row
            for z in range(0, nz, WIDTH):
                for group in range(2):
                    from_here = second + POINT * z + WIDTH * group
                    store_rows(
                        eight_rows(own, from_here, POINT, from_here + 7 * POINT),
                        mesh,
                        to + WIDTH * row * group + z,
                        row,
                        last + z,
                    )
        for y in range(ny):
            at = (x * ny + y) * row
            store(mesh, at + nz, load(mesh, at))


@as_written
def join(own, first, second, n):
    """Join the transforms a and b of two real lines as a + i b, in the place of a."""
    for k in range(n // 2 + 1):
        at, other = first + POINT * k, second + POINT * k
        a, b, c, d = load(own, at), load(own, at + WIDTH), load(own, other), load(own, other + WIDTH)
        opposite = first + POINT * ((n - k) % n)
        store(own, opposite, a + d)
        store(own, opposite + WIDTH, c - b)
        store(own, at, a - d)
        store(own, at + WIDTH, b + c)


def mesh_forces(charges: Floats, x: Floats, box: Box, split: Split) -> Floats:
    """Far forces (n, 3) by the mesh at positions x (n, 3), without the terms of pairs left out."""
    n, none = len(charges), (np.zeros((0, 2), np.int64), np.zeros(0))
    parts = bind(split.alpha, split.order, split.mesh, 0.0, 0.0, charges, np.ones(n), box, none, threads=1)
    rows, found, bound = np.ascontiguousarray(x.T), np.zeros((3, n)), BoundForce(parts)
    _evaluate((ready := bound.ready()).address, ready.work, rows, found)
    return np.asarray(found.T)


@driver
def _evaluate(address, work, x, a):
    call_force(address, work, FORCES, 0.0, x, x, a, None)
