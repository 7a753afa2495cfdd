"""Particles of leapfrog-exact in whole numbers, and the search for their pair list.

Positions wrap around at 2^64, the box edge, so the difference of two positions belongs to their nearest images.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.seam.kernel import GROW, OK
from kickdrift.jit.compile import strict

REACH = 2  # cells to search on each side; cells are at least 1 / REACH of the list's radius wide

# slots of `Particles.counts`
BUILT, BUILDS, ROOM_NEEDED, CULPRIT, AXIS, WHAT = range(6)
POSITION, MOMENTUM = 1, 2  # values of WHAT left the lattice


class Particles(NamedTuple):
    """Lattice and its pair list."""

    periodic: bool
    spacing: NDArray[np.float64]  # (3,)
    x: NDArray[np.int64]  # (3, n)
    images: NDArray[np.int64]  # (3, n)
    p: NDArray[np.int64]  # (3, n)
    kick: NDArray[np.int64]  # (3, n) half a step's
    drift: NDArray[np.float64]  # (3, n) a step's, in steps of spacing per step of momentum
    radius: float  # radius of the list; 0 without a list
    skin: float
    reference: NDArray[np.int64]  # (3, n) positions at the last search
    span: NDArray[np.int64]  # (n, 2) first and last partner + 1 of a particle
    partners: NDArray[np.int32]  # (room,)
    counts: NDArray[np.int64]


# --- whole numbers ---


@strict
def whole(value):
    """Nearest whole number, halves to even: an odd function."""
    return np.int64(np.rint(value))


@strict
def wrapped_sum(a, b):
    """Return a + b modulo 2^64. Unsigned, since LLVM may assume that signed numbers do not overflow."""
    return np.int64(np.uint64(a) + np.uint64(b))


@strict
def difference(a, b):
    """Return a - b modulo 2^64."""
    return np.int64(np.uint64(a) - np.uint64(b))


# --- the pair list: each pair within `radius` once ---


@strict
def refresh(particles):
    """Search for the pairs again if a particle has moved by half the skin. Return a status."""
    counts = particles.counts
    if particles.radius == 0.0 or (counts[BUILT] and not moved(particles)):
        return OK
    counts[BUILT] = 0
    found = search(particles)
    counts[ROOM_NEEDED] = found
    if found > particles.partners.size:
        return GROW
    counts[BUILT] = 1
    counts[BUILDS] += 1
    return OK


@strict
def moved(particles):
    x, reference = particles.x, particles.reference
    ux, uy, uz = particles.spacing
    limit = (0.499 * particles.skin) ** 2
    for i in range(x.shape[1]):
        dx = ux * np.float64(difference(x[0, i], reference[0, i]))
        dy = uy * np.float64(difference(x[1, i], reference[1, i]))
        dz = uz * np.float64(difference(x[2, i], reference[2, i]))
        if dx * dx + dy * dy + dz * dz > limit:
            return True
    return False


@strict
def sort_into_cells(particles, cells):
    """Sort particles into cells: cells <- their number along each axis. Return the start of each cell, and the
    particles by cell."""
    x, n = particles.x, particles.x.shape[1]
    low, width = np.zeros(3), np.zeros(3)
    most = int((8.0 * n) ** (1.0 / 3.0)) + 1
    for k in range(3):
        low[k], high = -(2.0**63), 2.0**63
        if not particles.periodic:
            low[k] = high = np.float64(x[k, 0])
            for i in range(n):
                low[k], high = min(low[k], np.float64(x[k, i])), max(high, np.float64(x[k, i]))
        extent = max(high - low[k], 1.0)
        cells[k] = int(max(1.0, min(float(most), extent * particles.spacing[k] * REACH / particles.radius)))
        width[k] = extent / cells[k]
    cell = np.zeros(n, np.int64)
    begin = np.zeros(cells[0] * cells[1] * cells[2] + 1, np.int64)
    for i in range(n):
        for k in range(3):
            c = int((np.float64(x[k, i]) - low[k]) / width[k])
            cell[i] = cell[i] * cells[k] + min(max(c, 0), cells[k] - 1)
        begin[cell[i] + 1] += 1
    for c in range(begin.size - 1):
        begin[c + 1] += begin[c]
    order, fill = np.zeros(n, np.int64), begin[:-1].copy()
    for i in range(n):
        order[fill[cell[i]]] = i
        fill[cell[i]] += 1
    return begin, order


@strict
def search(particles):
    """Fill the list as far as there is room, and return the number of pairs found. The positions become the
    reference."""
    x, n, reference = particles.x, particles.x.shape[1], particles.reference
    for k in range(3):
        for i in range(n):
            reference[k, i] = x[k, i]
    cells = np.zeros(3, np.int64)
    begin, order = sort_into_cells(particles, cells)
    near = np.empty(n, np.int64)  # possible partners of a cell's particles, its own first
    found = 0
    for cell in range(begin.size - 1):
        own = begin[cell + 1] - begin[cell]
        if own:
            count = gather(particles, cells, cell, begin, order, near)
            for q in range(own):
                found = add_partners(particles, near, q, count, found)
    return found


@strict
def gather(particles, cells, cell, begin, order, near):
    """near <- the particles of a cell and of the later cells within reach. Return their number."""
    low, high = np.zeros(3, np.int64), np.zeros(3, np.int64)
    here = (cell // (cells[1] * cells[2]), cell // cells[2] % cells[1], cell % cells[2])
    for k in range(3):
        low[k], high[k] = here[k] - REACH, here[k] + REACH + 1
        if not particles.periodic:
            low[k], high[k] = max(low[k], 0), min(high[k], cells[k])
        elif cells[k] <= 2 * REACH:
            low[k], high[k] = 0, cells[k]
    count = 0
    for q in range(begin[cell], begin[cell + 1]):
        near[count] = order[q]
        count += 1
    for a in range(low[0], high[0]):
        for b in range(low[1], high[1]):
            for c in range(low[2], high[2]):
                other = (a % cells[0] * cells[1] + b % cells[1]) * cells[2] + c % cells[2]
                if other > cell:
                    for q in range(begin[other], begin[other + 1]):
                        near[count] = order[q]
                        count += 1
    return count


@strict
def add_partners(particles, near, q, count, found):
    """List particle near[q] with the later ones within the radius. Return the number of pairs found so far."""
    x, partners, i = particles.x, particles.partners, near[q]
    ux, uy, uz = particles.spacing
    radius2, room = particles.radius**2, partners.size
    particles.span[i, 0] = found
    for k in range(q + 1, count):
        j = near[k]
        dx = ux * np.float64(difference(x[0, i], x[0, j]))
        dy = uy * np.float64(difference(x[1, i], x[1, j]))
        dz = uz * np.float64(difference(x[2, i], x[2, j]))
        if dx * dx + dy * dy + dz * dz < radius2:
            if found < room:
                partners[found] = j
            found += 1
    particles.span[i, 1] = found
    return found
