"""Compiled form of a Box: its edge vectors and its images.

Positions are moved into the *brick* [0, ax) x [0, by) x [0, cz). The brick fills space under the lattice of any lower
triangular matrix, as the cell between the edge vectors does. So a leaning box is sorted like a rectangular one.
"""

import itertools
from math import floor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.jit.compile import inlined, jit, strict
from kickdrift.model.box.box import Box
from kickdrift.model.box.edges import SMALLER

SHIFTS = 27  # images of the brick that may touch the brick
LENGTHS = 3  # numbers of a live box that keeps its shape; with six it has tilts too, see `Cell`


class Shape(NamedTuple):
    """Arrays of a Cell whose edges are 1 long along their own axes; the edge lengths bring them to a Cell's size."""

    matrix: NDArray[np.float64]
    reduced: NDArray[np.float64]
    inverse: NDArray[np.float64]
    neighbours: NDArray[np.float64]


class Cell(NamedTuple):
    """Box in compiled code; `kickdrift.model.box.box.Images` describes the fields from ``reduced`` to ``sure2``.

    A barostat writes the edge lengths to ``live``, and `follow` brings the other arrays to these lengths. The arrays
    depend on nothing but the shape and these lengths, so the way there does not change their bits. A ``live`` with six
    numbers has the tilts too. Such a box counts as leaning, also while its tilts are zero."""

    matrix: NDArray[np.float64]  # (3, 3) edge vectors as rows; a zero row for an axis that is not periodic
    leans: bool
    edges: NDArray[np.float64]  # (3,) edge lengths of a box that does not lean, else zero
    reduced: NDArray[np.float64]  # (3, 3)
    inverse: NDArray[np.float64]  # (3, 3)
    neighbours: NDArray[np.float64]  # (26, 3) or fewer
    sure2: NDArray[np.float64]  # (1,)
    live: NDArray[np.float64]  # (3,) lengths ax, by and cz now; zero along axes that are not periodic; or (6,), with
    # the tilts cy, cx and bx
    shape: Shape


class Bricks(NamedTuple):
    """The 27 images of a brick that may hold particles within reach of the brick.

    Image (i, j, k) is shifted by i a + j b + k c, less whole edges a that bring its x for i = 0 into [-ax/2, ax/2]. So
    all images with the same j and k, a *row*, are shifted by one vector against the columns of the brick itself.
    """

    shifts: NDArray[np.float64]  # (3, 27) at index 9 (i + 1) + 3 (j + 1) + k + 1
    leans: NDArray[np.float64]  # (rows, 2) shift along x and y; all rows without a shift count as one
    whole: NDArray[np.int64]  # (rows, 4) first and last j, first and last k of each row
    reach: float  # the images cover everything within this distance; infinite in an open box
    shifts_by_edge: NDArray[np.float64]  # (3, 27) shifts over the edge lengths
    leans_by_edge: NDArray[np.float64]  # (rows, 2)


def cell_of(box: Box) -> Cell:
    """Return the Cell of a Box."""
    matrix = np.where(np.array(box.periodic_axes)[:, None], box.matrix, 0.0)
    reduced, inverse, neighbours, sure2 = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((0, 3)), np.inf
    if box.triclinic:
        images = box.images
        reduced[: len(images.reduced)], inverse[:, : len(images.reduced)] = images.reduced, images.inverse
        neighbours, sure2 = images.neighbours.copy(), images.sure2
    live = np.diag(matrix).copy()
    edges = np.where(live > 0.0, live, 1.0)
    shape = Shape(matrix / edges, reduced / edges, inverse * edges[:, None], neighbours / edges)
    of_axes = np.zeros(3) if box.triclinic else live.copy()
    return Cell(matrix, box.triclinic, of_axes, reduced, inverse, neighbours, np.array([sure2]), live, shape)


def lengths_and_tilts(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """The numbers (6,) of edge vectors (3, 3) in the order of a live box: ax, by, cz, cy, cx, bx."""
    return matrix[[0, 1, 2, 2, 2, 1], [0, 1, 2, 1, 0, 0]]


def live_cell(cell: Cell, lengths: NDArray[np.float64]) -> Cell:
    """Return the Cell with its edge lengths, or lengths and tilts, in this memory. Its arrays are those that `follow`
    gives."""
    made = cell._replace(live=lengths)
    if len(lengths) > LENGTHS:
        images = 3 ** int(np.count_nonzero(lengths[:LENGTHS])) - 1
        made = made._replace(leans=True, edges=np.zeros(3), neighbours=np.zeros((images, 3)))
    resize.py_func(made)
    return made


@strict
def follow(cell):
    """Bring a Cell to the edges of now; tell whether these have changed."""
    changed = differs(cell)
    if changed:
        resize(cell)
    return changed


@strict
def differs(cell):
    """Tell whether the live edges are others than those of the Cell's arrays."""
    live, matrix = cell.live, cell.matrix
    found = live[0] != matrix[0, 0] or live[1] != matrix[1, 1] or live[2] != matrix[2, 2]
    if live.size > LENGTHS:
        found = found or live[3] != matrix[2, 1] or live[4] != matrix[2, 0] or live[5] != matrix[1, 0]
    return found


@strict
def put_edges(live, matrix):
    """matrix (3, 3) <- the edge vectors of a live box (6,)."""
    matrix[0, 0], matrix[1, 1], matrix[2, 2] = live[0], live[1], live[2]
    matrix[2, 1], matrix[2, 0], matrix[1, 0] = live[3], live[4], live[5]
    matrix[0, 1] = matrix[0, 2] = matrix[1, 2] = 0.0


@strict
def resize(cell):
    """Set the arrays of a Cell from its shape and the edge lengths of now, or from live lengths and tilts."""
    if cell.live.size > LENGTHS:
        put_edges(cell.live, cell.matrix)
        reduce_edges(cell.matrix, cell.reduced, cell.inverse, cell.neighbours)
        put_sure2(cell)
        return
    shape = cell.shape
    for k in range(3):
        edge = cell.live[k]
        for m in range(3):
            cell.matrix[m, k] = shape.matrix[m, k] * edge
            cell.reduced[m, k] = shape.reduced[m, k] * edge
            cell.inverse[k, m] = shape.inverse[k, m] / edge if edge > 0.0 else shape.inverse[k, m]
        for m in range(cell.neighbours.shape[0]):
            cell.neighbours[m, k] = shape.neighbours[m, k] * edge
        if not cell.leans:
            cell.edges[k] = edge
    put_sure2(cell)


@strict
def put_sure2(cell):
    """Set the square of a separation below which no image is nearer."""
    sure2 = np.inf
    for m in range(cell.neighbours.shape[0]):
        step = cell.neighbours[m]
        sure2 = min(sure2, 0.25 * (step[0] * step[0] + step[1] * step[1] + step[2] * step[2]))
    cell.sure2[0] = sure2


@strict
def reduce_edges(matrix, reduced, inverse, neighbours):
    """Set the Minkowski-reduced vectors of the lattice with the rows of ``matrix``, their inverse, and the sums of -1,
    0 and 1 times each vector.

    Each vector is shortened by sums of -1, 0 and 1 times the others until none becomes shorter, which are Minkowski's
    conditions in up to four dimensions. See `kickdrift.model.box.edges.shortest` for what they give."""
    reduced[:] = matrix
    axes = 3 if matrix[2, 2] > 0.0 else 2
    shorter = True
    while shorter:
        shorter = False
        for k in range(axes):
            m, n = (k + 1) % axes, (k + 2) % axes
            least = SMALLER * (reduced[k, 0] ** 2 + reduced[k, 1] ** 2 + reduced[k, 2] ** 2)
            best_i, best_j = 0.0, 0.0
            for s in range(9):
                i, j = s // 3 - 1.0, (s % 3 - 1.0 if axes == 3 else 0.0)
                x = reduced[k, 0] + i * reduced[m, 0] + j * reduced[n, 0]
                y = reduced[k, 1] + i * reduced[m, 1] + j * reduced[n, 1]
                z = reduced[k, 2] + i * reduced[m, 2] + j * reduced[n, 2]
                square = x * x + y * y + z * z
                if square < least:
                    least, best_i, best_j = square, i, j
            if best_i != 0.0 or best_j != 0.0:
                shorter = True
                for c in range(3):
                    reduced[k, c] += best_i * reduced[m, c] + best_j * reduced[n, c]
    a, b, c = reduced[0], reduced[1], reduced[2]
    cx, cy, cz = (c[0], c[1], c[2]) if axes == 3 else (0.0, 0.0, 1.0)
    volume = a[0] * (b[1] * cz - b[2] * cy) + a[1] * (b[2] * cx - b[0] * cz) + a[2] * (b[0] * cy - b[1] * cx)
    inverse[0, 0], inverse[1, 0] = (b[1] * cz - b[2] * cy) / volume, (b[2] * cx - b[0] * cz) / volume
    inverse[2, 0] = (b[0] * cy - b[1] * cx) / volume
    inverse[0, 1], inverse[1, 1] = (cy * a[2] - cz * a[1]) / volume, (cz * a[0] - cx * a[2]) / volume
    inverse[2, 1] = (cx * a[1] - cy * a[0]) / volume
    if axes == 3:
        inverse[0, 2], inverse[1, 2] = (a[1] * b[2] - a[2] * b[1]) / volume, (a[2] * b[0] - a[0] * b[2]) / volume
        inverse[2, 2] = (a[0] * b[1] - a[1] * b[0]) / volume
    row, middle = 0, neighbours.shape[0] // 2
    for s in range(neighbours.shape[0] + 1):
        if s == middle:
            continue
        p, q, r = (s // 9 - 1.0, s // 3 % 3 - 1.0, s % 3 - 1.0) if axes == 3 else (s // 3 - 1.0, s % 3 - 1.0, 0.0)
        for m in range(3):
            neighbours[row, m] = p * reduced[0, m] + q * reduced[1, m] + r * reduced[2, m]
        row += 1


@strict
def least_height(matrix):
    """Least distance between opposite faces of a box with these edge vectors; infinite in open space."""
    a, b, c = matrix[0], matrix[1], matrix[2]
    ax = a[0] if a[0] > 0.0 else 1.0
    by = b[1] if b[1] > 0.0 else 1.0
    cz = c[2] if c[2] > 0.0 else 1.0
    u, v, w = -b[0] / (ax * by), (b[0] * c[1] - c[0] * by) / (ax * by * cz), -c[1] / (by * cz)
    least = ax / np.sqrt(1.0 + (ax * u) ** 2 + (ax * v) ** 2) if a[0] > 0.0 else np.inf
    least = min(least, by / np.sqrt(1.0 + (by * w) ** 2)) if b[1] > 0.0 else least
    return min(least, cz) if c[2] > 0.0 else least


def bricks_of(cell: Cell) -> Bricks:
    """Return the Bricks of a Cell."""
    a, b, c = cell.matrix
    shifts, leans, whole = np.zeros((3, SHIFTS)), [], []
    most = [int(edge > 0) for edge in np.diag(cell.matrix)]
    for i, j, k in itertools.product((-1, 0, 1), repeat=3):
        lean = j * b + k * c
        if a[0]:
            lean = lean - np.rint(lean[0] / a[0]) * a
        shifts[:, 9 * (i + 1) + 3 * (j + 1) + k + 1] = lean + i * a
        if i == 0 and cell.leans and abs(j) <= most[1] and abs(k) <= most[2]:
            leans.append([lean[0], k * c[1]])
            whole.append([j, j, k, k])
    if not cell.leans:
        leans, whole = [[0.0, 0.0]], [[-most[1], most[1], -most[2], most[2]]]
    along = np.array(leans)
    room = np.diag(cell.matrix) - [*np.abs(along).max(axis=0), 0.0]
    reach = float(min((room[k] for k in range(3) if most[k]), default=np.inf))
    edges = np.where(np.diag(cell.matrix) > 0.0, np.diag(cell.matrix), 1.0)
    return Bricks(shifts, along, np.array(whole, np.int64), reach, shifts / edges[:, None], along / edges[:2])


class MinimumImage(NamedTuple):
    """Numbers that give distances between nearest images of particles inside a box; see `squared_distances`."""

    matrix: NDArray[np.float64]  # (3, 3) as of a Cell
    inverse: NDArray[np.float64]  # (3,) 1 over its diagonal, 0 for an axis that is not periodic
    edges: NDArray[np.float64]  # (3,) the edge lengths of a box that does not lean, else infinite
    leans: bool
    axis: int  # the last periodic axis: places along this axis repeat after ``period``, however the box leans
    period: float


def minimum_image_of(box: Box) -> MinimumImage:
    """The MinimumImage of a Box that is periodic along one axis or more."""
    cell, axis = cell_of(box), int(np.flatnonzero(box.periodic_axes)[-1])
    diagonal = np.diag(cell.matrix)
    inverse = np.divide(1.0, diagonal, out=np.zeros(3), where=diagonal > 0)
    edges = np.where(cell.edges > 0, cell.edges, np.inf)
    return MinimumImage(cell.matrix, inverse, edges, cell.leans, axis, float(diagonal[axis]))


@inlined
def squared_distances(image, x, i, begin, end, row):
    """row[j] <- squared distance between particles i and j at x (3, n), inside the box, for begin <= j < end.

    The distance is between nearest images where this is within half the least height; elsewhere that or more.
    """
    if image.leans:
        for j in range(begin, end):
            dx, dy, dz = x[0, i] - x[0, j], x[1, i] - x[1, j], x[2, i] - x[2, j]
            row[j] = square_by_edges(image.matrix, image.inverse, dx, dy, dz)
    else:
        for j in range(begin, end):
            squared = 0.0
            for k in range(3):
                d = abs(x[k, i] - x[k, j])
                d = min(d, image.edges[k] - d)
                squared += d * d
            row[j] = squared


@inlined
def along(edge, d):
    """Component d of a separation between nearest images in a box that does not lean; the axis is open if edge is 0."""
    return d - edge * floor(d / edge + 0.5) if edge > 0.0 else d


@inlined
def square_by_edges(matrix, inverse, dx, dy, dz):
    """Square of a separation after removing whole edges, from the last to the first. This is the nearest image's square
    if it is within half the least height, else an upper bound. ``inverse`` (3,) is 1 over the diagonal, 0 for an axis
    that is not periodic."""
    count = floor(dz * inverse[2] + 0.5) * 1.0
    dx, dy, dz = dx - count * matrix[2, 0], dy - count * matrix[2, 1], dz - count * matrix[2, 2]
    count = floor(dy * inverse[1] + 0.5) * 1.0
    dx, dy = dx - count * matrix[1, 0], dy - count * matrix[1, 1]
    dx -= floor(dx * inverse[0] + 0.5) * matrix[0, 0]
    return dx * dx + dy * dy + dz * dz


@jit
def nearest_image(cell, d):
    """Replace a separation d (3,) by that between nearest images."""
    if cell.leans:
        leaning_image(cell, d)
    else:
        for k in range(3):
            d[k] = along(cell.edges[k], d[k])


@jit
def leaning_image(cell, d):
    """Replace a separation d (3,) in a leaning box by that between nearest images. Whole edges are removed first; if
    another image may be nearer, the shortest lattice vectors follow."""
    matrix, steps = cell.matrix, cell.neighbours
    for k in range(2, -1, -1):
        if matrix[k, k] > 0.0:
            take_off(d, matrix, k, floor(d[k] / matrix[k, k] + 0.5))
    if d[0] * d[0] + d[1] * d[1] + d[2] * d[2] <= cell.sure2[0]:
        return
    whole = np.empty(3)
    for k in range(3):
        whole[k] = floor(d[0] * cell.inverse[0, k] + d[1] * cell.inverse[1, k] + d[2] * cell.inverse[2, k] + 0.5)
    for k in range(3):
        take_off(d, cell.reduced, k, whole[k])
    best, least = -1, d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
    for k in range(steps.shape[0]):
        u, v, w = d[0] + steps[k, 0], d[1] + steps[k, 1], d[2] + steps[k, 2]
        if u * u + v * v + w * w < least:
            best, least = k, u * u + v * v + w * w
    if best >= 0:
        take_off(d, steps, best, -1.0)


@jit
def take_off(d, rows, k, count):
    """Subtract ``count`` times row k from d (3,)."""
    for m in range(3):
        d[m] -= count * rows[k, m]


@strict
def into_brick(matrix, k, x, offset):
    """Add to ``offset`` (3, n) the whole edges k between positions x (3, n) and the brick along coordinate k. Take the
    edges from the last to the first."""
    edge = matrix[k, k]
    for i in range(x.shape[1]):
        count = floor((x[k, i] - offset[k, i]) / edge)
        offset[k, i] += count * edge
        for m in range(k):
            if matrix[k, m] != 0.0:
                offset[m, i] += count * matrix[k, m]
