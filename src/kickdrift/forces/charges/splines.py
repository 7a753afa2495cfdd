"""B-splines that spread charges over a mesh, and the order of the mesh's columns (Essmann et al. 1995)."""

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.charges.mesh_sizes import IMAGES
from kickdrift.jit.compile import as_written
from kickdrift.jit.lanes.functions import splat
from kickdrift.jit.lanes.gathering import lane_floor, transposed
from kickdrift.jit.lanes.memory import load, store
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.model.state import Floats

MOST = 8  # largest order
BLOCKS = 8  # most blocks along an axis


def moduli(n: int, order: int) -> Floats:
    """Factors (n,) by which the influence of a wave corrects splines of this order; 0 for the wave of shortest
    length."""
    own, squares = spline_waves(np.asarray(np.fft.fftfreq(n), np.float64), order)
    found = own**2 / squares**2
    if n % 2 == 0:
        found[n // 2] = 0.0
    return np.asarray(found)


def spline_waves(u: Floats, order: int) -> tuple[Floats, Floats]:
    """Transform of a spline at u wave lengths for each distance of the mesh, and the sum of squares over all images."""
    images = np.arange(-IMAGES, IMAGES + 1)[:, None]
    return np.sinc(u) ** order, (np.sinc(u + images) ** (2 * order)).sum(axis=0)


def column_order(nx: int, ny: int, order: int) -> tuple[NDArray[np.int32], NDArray[np.int64], NDArray[np.int64]]:
    """Number (nx ny,) of each column, the first column of each block, and the first block of each colour.

    Blocks of one colour are so far apart that no ions of two blocks touch the same point of the mesh."""
    bounds = [_bounds(n, order) for n in (nx, ny)]
    counts = [len(each) - 1 for each in bounds]
    coloured: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for i in range(counts[0]):
        for k in range(counts[1]):
            coloured.setdefault((i % 2, k % 2), []).append((i, k))
    number, blocks, colours = np.zeros((nx, ny), np.int32), [0], [0]
    for colour in sorted(coloured):
        for i, k in coloured[colour]:
            some = number[bounds[0][i] : bounds[0][i + 1], bounds[1][k] : bounds[1][k + 1]]
            some[...] = blocks[-1] + np.arange(some.size).reshape(some.shape)
            blocks.append(blocks[-1] + some.size)
        colours.append(colours[-1] + len(coloured[colour]))
    return number.ravel(), np.array(blocks, np.int64), np.array(colours, np.int64)


def _bounds(n: int, order: int) -> list[int]:
    """Bounds of blocks of n points: one block, or an even number of blocks of order - 1 points or more."""
    count = min(n // (order - 1) // 2 * 2, BLOCKS) or 1
    return [k * n // count for k in range(count + 1)]


@as_written
def weigh(own, place, first, order):
    """Write the splines of eight ions at mesh coordinates ``place[:3, first:]`` to ``own``.

    Eight lanes for each point of the mesh, MOST points for each of six groups: weights along x, y and z, then their
    slopes. Two groups follow with eight points along z for each ion, weights and slopes."""
    for axis in range(3):
        at, slope = MOST * WIDTH * axis, MOST * WIDTH * (axis + 3)
        g = load(place[axis], first)
        f = g - lane_floor(g)
        for k in range(2, MOST):
            store(own, at + WIDTH * k, splat(0.0))
            store(own, slope + WIDTH * k, splat(0.0))
        store(own, at, 1.0 - f)
        store(own, at + WIDTH, f)
        for k in range(3, order + 1):
            if k == order:
                store(own, slope, splat(0.0) - load(own, at))
                for j in range(1, k):
                    store(own, slope + WIDTH * j, load(own, at + WIDTH * (j - 1)) - load(own, at + WIDTH * j))
            over = 1.0 / (k - 1)
            store(own, at + WIDTH * (k - 1), over * f * load(own, at + WIDTH * (k - 2)))
            for j in range(k - 2, 0, -1):
                lower, upper = load(own, at + WIDTH * (j - 1)), load(own, at + WIDTH * j)
                far = float(k - 1 - j)
                store(own, at + WIDTH * j, over * ((f + far) * lower + ((k - far) - f) * upper))
            store(own, at, over * (1.0 - f) * load(own, at))
    for group in range(2):
        at, to = MOST * WIDTH * (2 + 3 * group), MOST * WIDTH * (6 + group)
        rows = transposed(
            (
                load(own, at),
                load(own, at + WIDTH),
                load(own, at + 2 * WIDTH),
                load(own, at + 3 * WIDTH),
                load(own, at + 4 * WIDTH),
                load(own, at + 5 * WIDTH),
                load(own, at + 6 * WIDTH),
                load(own, at + 7 * WIDTH),
            )
        )
        put(rows, own, to, WIDTH)


@as_written
def put(rows, own, at, stride):
    """Store eight lanes, ``stride`` apart from ``at`` on."""
    a, b, c, d, e, f, g, h = rows
    store(own, at, a)
    store(own, at + stride, b)
    store(own, at + 2 * stride, c)
    store(own, at + 3 * stride, d)
    store(own, at + 4 * stride, e)
    store(own, at + 5 * stride, f)
    store(own, at + 6 * stride, g)
    store(own, at + 7 * stride, h)
