"""Ions and the mesh of particle-mesh Ewald: B-splines spread charges over the mesh, and their slopes give the forces.

Ions are sorted by the columns of the mesh. They spread their charges in blocks of columns. Blocks that touch the same
points of the mesh have different colours, and one colour follows the other. So each point gets its charges in one
order, on any number of threads.
"""

from __future__ import annotations

import math

from kickdrift.forces.charges.splines import MOST, weigh
from kickdrift.jit.compile import as_written, never_inline, strict
from kickdrift.jit.lanes.functions import lane_sum, multiply_add, splat
from kickdrift.jit.lanes.memory import broadcast, load, store
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.jit.threads.chunks import chunk_task

COLOUR, WANTED = range(2)  # places in `Mesh.state`


@as_written
def share(count, shares, c):
    """Return the part of ``count`` things that chunk c of ``shares`` takes: first, last + 1."""
    return c * count // shares, (c + 1) * count // shares


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
