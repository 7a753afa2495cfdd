"""Constraints in the order of compiled code: blocks of up to eight molecules, one in each lane.

The molecules of a block have equally many constraints. These are ordered so that conditions with a particle in common
stand near each other (Cuthill & McKee 1969, doi:10.1145/800195.805928, in reverse). So the matrix of a molecule's
conditions has a narrow band, one beside the diagonal for a chain. A block of fewer molecules fills its lanes with
copies of the last one, which move nothing.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.jit.threads.chunks import Chunks, in_chunks
from kickdrift.model.molecules.constraints import Constraints
from kickdrift.model.state import Floats

OWN = 8  # rows of a constraint in the room besides its band: separations before and after, residual and sum
WORTH_CHUNKS = 64  # blocks
APART, OTHER = -1, -2


class Held(NamedTuple):
    """Constraints of one run in compiled code. A row has eight lanes."""

    first: NDArray[np.int64]  # (blocks + 1,) constraints before each block
    band: NDArray[np.int64]  # (blocks,) entries of the matrix on each side of the diagonal
    triangles: NDArray[np.int64]  # (blocks,) for triangles with the sides ab, ac and bc, the first of 24 particles that
    # follow one another, or `APART`; `OTHER` for all else
    entry: NDArray[np.int64]  # (blocks + 1,) rows of `coupling` before each block
    one: NDArray[np.int64]  # (rows, 8) first particle of each pair
    other: NDArray[np.int64]  # (rows, 8) second particle
    squares: Floats  # (rows, 8) squared distances
    over_one: Floats  # (rows, 8) inverse masses; zero for copies
    over_other: Floats  # (rows, 8)
    coupling: Floats  # (entries, 8) inverse masses of the particles that two constraints share, with their sign
    tolerance: float
    chunks: Chunks
    room: Floats  # (threads, numbers)
    gained: Floats  # (blocks,) energy of the last projection
    failed: NDArray[np.int64]  # (blocks,) 1 where the last solution failed


def held(constraints: Constraints, masses: Floats, threads: int) -> Held:
    """Constraints in the form for compiled code; ``masses`` (n,)."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import reverse_cuthill_mckee

    c, (i, j) = len(constraints), constraints.pairs.T
    rows = np.arange(c)
    ends = csr_array((np.repeat([1.0, -1.0], c), (np.tile(rows, 2), np.concatenate([i, j]))), shape=(c, len(masses)))
    over = np.divide(1.0, masses, out=np.zeros_like(masses), where=masses > 0)
    joined = abs(ends) @ abs(ends).T
    coupling = (ends.multiply(over[None, :]) @ ends.T).tocsr()
    order = reverse_cuthill_mckee(joined.tocsr(), symmetric_mode=True)
    of = constraints.molecule[i]
    order = order[np.argsort(of[order], kind="stable")]  # molecule by molecule
    place = np.empty(c, np.int64)
    place[order] = rows
    pairs = joined.tocoo()
    width = np.zeros(int(of.max()) + 1, np.int64)
    np.maximum.at(width, of[pairs.row], np.abs(place[pairs.row] - place[pairs.col]))
    names, begin, count = np.unique(of[order], return_index=True, return_counts=True)
    three = _ordered_triangles(order, begin, count, constraints.pairs)
    blocks: list[tuple[int, int, NDArray[np.int64]]] = []  # constraints, band, (8, constraints) numbers of these
    copies: list[int] = []
    triangles: list[int] = []
    for size, band, form in np.unique(kinds := np.column_stack([count, width[names], three]), axis=0).tolist():
        alike = begin[(kinds == (size, band, form)).all(axis=1)]
        for some in np.split(alike, range(WIDTH, len(alike), WIDTH)):
            copies.append(WIDTH - len(some))
            some = np.append(some, np.full(copies[-1], some[-1]))
            triangles.append(_first_of(constraints.pairs[order[some[:, None] + np.arange(2)]]) if form else OTHER)
            blocks.append((size, band, order[some[:, None] + np.arange(size)]))
    chosen = np.ascontiguousarray(np.concatenate([lanes.T for *_, lanes in blocks]))
    lanes = np.arange(WIDTH)
    real = np.concatenate([np.tile(lanes < WIDTH - n, (size, 1)) for (size, *_), n in zip(blocks, copies, strict=True)])
    entries = [(2 * band + 1) * size for size, band, _ in blocks]
    most = max(size * (OWN + 2 * band + 1) for size, band, _ in blocks)
    return Held(
        np.concatenate([[0], np.cumsum([size for size, *_ in blocks])]).astype(np.int64),
        np.array([band for _, band, _ in blocks], np.int64),
        np.array(triangles),
        np.concatenate([[0], np.cumsum(entries)]).astype(np.int64),
        i[chosen],
        j[chosen],
        constraints.lengths[chosen] ** 2,
        over[i[chosen]] * real,
        over[j[chosen]] * real,
        np.concatenate([_banded(coupling, lanes, band) for _, band, lanes in blocks]),
        constraints.tolerance,
        in_chunks(8 if len(blocks) >= WORTH_CHUNKS else 1, threads),
        np.zeros((threads, most * WIDTH)),
        np.zeros(len(blocks)),
        np.zeros(len(blocks), np.int64),
    )


def _first_of(sides: NDArray[np.int64]) -> int:
    """The first particle of eight triangles, by their sides ab and ac (8, 2, 2), if all follow one another, else
    `APART`."""
    corners = np.column_stack([sides[:, 0], sides[:, 1, 1]]).ravel()
    return int(corners[0]) if (np.diff(corners) == 1).all() else APART


def _ordered_triangles(
    order: NDArray[np.int64], begin: NDArray[np.int64], count: NDArray[np.int64], pairs: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Whether each molecule is a triangle with the sides ab, ac and bc; ``order`` is changed to have them so."""
    found = count == 3
    places = begin[found][:, None] + np.arange(3)
    numbers = order[places]
    first, second = pairs[numbers].transpose(2, 0, 1)  # (2, molecules, 3)
    numbers = np.take_along_axis(numbers, np.lexsort((second, first), axis=1), axis=1)
    first, second = pairs[numbers].transpose(2, 0, 1)
    closed = (first[:, 0] == first[:, 1]) & (second[:, 0] == first[:, 2]) & (second[:, 1] == second[:, 2])
    order[places[closed]] = numbers[closed]
    found[found] = closed
    return found


def _banded(coupling: Any, lanes: NDArray[np.int64], band: int) -> Floats:
    """Rows (constraints x (2 band + 1), 8) of a block's coupling, diagonal by diagonal in each constraint."""
    size = lanes.shape[1]
    found = np.zeros((size, 2 * band + 1, WIDTH))
    for beside in range(-band, band + 1):
        k = np.arange(max(0, -beside), min(size, size - beside))
        if len(k):
            values = coupling[lanes[:, k].ravel(), lanes[:, k + beside].ravel()]
            found[k, beside + band] = np.asarray(values).reshape(WIDTH, len(k)).T
    return found.reshape(-1, WIDTH)
