"""Particles in clusters of eight: sorted into columns over the x-y plane and by z in each column, then padded."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.lists.row_lanes import Block, RowLanes, blocks
from kickdrift.jit.compile import jit
from kickdrift.jit.lanes.memory import aligned, load, store
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.model.box.box import Box
from kickdrift.model.box.cell import SHIFTS, Bricks, Cell, bricks_of, cell_of

# slots of `ClusterList.counts`
N_CLUSTERS, NX, NY, BUILT, OUTER_BUILDS, PRUNES, ROOM_NEEDED, JUMPS_ALLOWED = range(8)

unsigned = np.uint64  # type of an index, which saves numba's check for negative indices
LANES = unsigned(WIDTH)
STRIDE = 3 * WIDTH  # distance from one cluster to the next in `x` and `force`
TABLE_STRIDE = 32  # distance from one shift to the next in a table; a power of two, from which a row follows quickly
FAR = 30.0  # distance of the padding lanes from all particles, in cutoffs; far beyond, r^-12 underflows, slowly
APART = 2.0  # distance between padding lanes, in cutoffs
STRIDE_UNKNOWN = 0.01  # first guess, in cutoffs, of the fastest particle's move between evaluations
SHIFT_BITS = 5  # bits of an entry of `near` for the 27 shifts
LOOKED_AHEAD = 2  # entries after the last that the loop reads but does not use


class ClusterList(NamedTuple):
    """Arrays of the list, all allocated once: n particles, `slots` places in clusters, `chunks` shares of the work.

    Vectors are stored by cluster as eight x, eight y, eight z, so a cluster fills three adjacent cache lines. The
    *place* of a particle is the index of its x; its y and z are WIDTH and 2 WIDTH further.
    """

    cutoff: float
    per_row: int  # particles in a row of the list, 1 or 4 (see `row_lanes`)
    block: Block  # size of an entry of a row
    inner_skin: float
    outer_skin: float
    cell: Cell
    live: NDArray[np.float64]  # (3,) edge lengths now, which a barostat changes; see `load`
    made_in: NDArray[np.float64]  # (2, 3) edge lengths at the last search and the last pruning
    bricks: Bricks
    shifts: NDArray[np.float64]  # (3, 32), using the 27 shifts of the bricks
    counts: NDArray[np.int64]
    order: NDArray[np.int64]  # (n,) particles in slot order, without padding
    first: NDArray[np.int64]  # (clusters,) index in `order` of a cluster's first particle
    column: NDArray[np.int32]  # (n,) column of each particle
    column_clusters: NDArray[np.int64]  # (columns + 1,) the first cluster of each column
    place: NDArray[np.int64]  # (n,) index of each particle in `x` and `force`
    offset: NDArray[np.float64]  # (3 slots,) whole edges subtracted from each position
    filled: NDArray[np.int64]  # (clusters,) particles in a cluster
    home: NDArray[np.int64]  # (clusters,) column of a cluster
    bounds: NDArray[np.float64]  # (6, clusters) lowest x y z, highest x y z
    grid: NDArray[np.float64]  # (4,) width of the columns along x and y, lowest corner
    built_at: NDArray[np.float64]  # (3, n) unsorted positions when the list was made, which reproduce the sort
    x: NDArray[np.float64]  # (3 slots,)
    outer_reference: NDArray[np.float64]  # (3 slots,) positions when the list was made
    inner_reference: NDArray[np.float64]
    near_span: NDArray[np.int64]  # (clusters, 2) first and last entry + 1 of a cluster
    near: NDArray[np.int32]  # (chunks, room) the outer list, entries: cluster << 5 | shift
    row_start: NDArray[np.int64]  # (chunks, slots + 1) the first entry of each row, cluster by cluster; like ``used``,
    # valid where ``touched``
    rows: NDArray[np.int32]  # (chunks, entries, 2) the inner list: the index of a block's first x in `x`, and the
    # index of the row's shifted positions in the cluster's table
    used: NDArray[np.int64]  # (chunks, clusters) bits of the shifts in a cluster's rows
    origin: NDArray[np.float64]  # (3,) the middle, the origin of positions in float32
    x_single: NDArray[np.float32]  # (3 slots,) in mixed precision, else empty
    thread_single: NDArray[np.float32]  # (threads, 6 per_row slots) reactions in mixed precision, else empty; zero
    # between evaluations if rows have tiles
    thread_force: NDArray[np.float64]  # (threads, 6 slots) forces, while a thread sums; see `sums.thread_memory`
    force: NDArray[np.float64]  # (chunks, 3 slots)
    touched: NDArray[np.bool_]  # (chunks, clusters) whether a chunk's forces may be nonzero
    made: NDArray[np.int64]  # (chunks,) number of entries that the last search found
    moves: NDArray[np.float64]  # (chunks, 2) see `note_moves`
    moving: NDArray[np.float64]  # (7 slots,) for steps in the order of the clusters, else empty; see `sorted_steps`
    code: int = 0  # address of the list's machine code
    special: Any = None  # pairs that are left out or scaled, if any; see `special_pairs`


def chunk_count(n: int) -> int:
    """Return the number of shares of the work. It depends on n alone, so threads do not change the order of sums."""
    return 1 if n < 256 else 2 if n < 4000 else 4 if n < 20_000 else 8


@jit
def table_place(per_row: int, shift: int, row: int) -> int:
    """Return the index of a row's shifted positions in its cluster's table.

    The table is (shifts, 4, 8), the last eight unused, or (shifts, 2 rows, 3, 16) with four particles in a row."""
    if per_row == 1:
        return TABLE_STRIDE * shift + row
    return 4 * STRIDE * shift + 2 * STRIDE * row


def skins(bricks: Bricks, cutoff: float, stride: float, scale: float = 0.0) -> tuple[float, float]:
    """Return the cheapest inner and outer skin, if the fastest particle moves by ``stride`` between two evaluations.

    Lengths are in cutoffs, or in the ``scale`` if that is longer. Costs are in evaluations, and u is twice the stride.
    An inner skin s adds 2.5 s to the cost of the forces, and needs a pruning every s / u evaluations, which costs 1.5:
    s = 0.77 u^(1/2). An outer skin that is wider by d raises the cost of a pruning by 1 / (1 / 2 + d), and needs a
    search every d / u evaluations, which costs 1.6: d = 0.8 u^(1/4). The costs were measured in a Lennard-Jones liquid.
    Twice or half the skins cost a few percent more.
    """
    slack = bricks.reach - cutoff  # shifts reach only to the next box
    unit = max(cutoff, scale)
    u = 2 * max(stride / unit, 0.25 * STRIDE_UNKNOWN)  # particles at rest may start to move
    inner = min(max(0.77 * u**0.5, 0.02), 0.3)
    outer = inner + min(0.8 * u**0.25, 0.5)
    return min(inner * unit, slack / 2), min(outer * unit, slack)


def empty_rows(chunks: int, room: int, per_row: int, block: Block) -> NDArray[np.int32]:
    """Return rows for ``room`` entries of the outer list in each chunk.

    At most all rows of a cluster list a near cluster, for each of its blocks. Entries are written eight at a time."""
    return np.empty((chunks, WIDTH // per_row * blocks(block) * room + WIDTH, 2), np.int32)


def cluster_list(
    n: int, box: Box, cutoff: float, lanes: RowLanes, threads: int = 0, single: bool = False
) -> ClusterList:
    """Return empty lists for n particles. ``threads`` have memory to sum forces; with ``single``, there are also the
    arrays of mixed precision."""
    cell = cell_of(box)
    bricks = bricks_of(cell)
    inner_skin, outer_skin = skins(bricks, cutoff, STRIDE_UNKNOWN * cutoff)
    chunks = chunk_count(n)
    slots = WIDTH * (n // WIDTH + n // WIDTH + 3)  # every column's last cluster may be padded
    clusters = slots // WIDTH
    shifts = aligned((3, 4 * WIDTH))
    shifts[:, :SHIFTS] = bricks.shifts
    room = 6 * n // chunks + 64
    single_slots = slots if single else 0
    return ClusterList(
        cutoff=cutoff,
        per_row=lanes.per_row,
        block=lanes.block,
        inner_skin=inner_skin,
        outer_skin=outer_skin,
        cell=cell,
        live=np.diag(cell.matrix).copy(),
        made_in=np.array([np.diag(cell.matrix)] * 2),
        bricks=bricks,
        shifts=shifts,
        counts=np.zeros(8, np.int64),
        order=np.arange(n, dtype=np.int64),
        first=np.zeros(clusters, np.int64),
        column=np.zeros(n, np.int32),
        column_clusters=np.zeros(clusters + 2, np.int64),
        place=np.zeros(n, np.int64),
        offset=aligned((3 * slots,)),
        filled=np.zeros(clusters, np.int64),
        home=np.zeros(clusters, np.int64),
        bounds=np.zeros((6, clusters)),
        grid=np.zeros(4),
        built_at=np.zeros((3, n)),
        x=aligned((3 * slots,)),
        outer_reference=aligned((3 * slots,)),
        inner_reference=aligned((3 * slots,)),
        near_span=np.zeros((clusters, 2), np.int64),
        near=np.empty((chunks, room), np.int32),
        row_start=np.zeros((chunks, slots + 1), np.int64),
        rows=empty_rows(chunks, room, lanes.per_row, lanes.block),
        used=np.zeros((chunks, clusters), np.int64),
        origin=np.zeros(3),
        x_single=aligned((3 * single_slots,), dtype=np.float32),
        thread_single=aligned((threads, 6 * lanes.per_row * single_slots), dtype=np.float32),
        thread_force=aligned((threads, 6 * slots), fill=None),
        force=aligned((chunks, 3 * slots), fill=None),
        touched=np.zeros((chunks, clusters), np.bool_),
        made=np.zeros(chunks, np.int64),
        moves=np.zeros((chunks, 2)),
        moving=aligned((0,)),
    )


@jit
def load_vector(x, cluster):
    """Return a cluster's eight x, y and z."""
    p = STRIDE * cluster
    return load(x, p), load(x, p + WIDTH), load(x, p + 2 * WIDTH)


@jit
def store_vector(x, cluster, a, b, c):
    """Write a cluster's eight x, y and z."""
    p = STRIDE * cluster
    store(x, p, a)
    store(x, p + WIDTH, b)
    store(x, p + 2 * WIDTH, c)


@jit
def copy(source, target):
    for p in range(source.size):
        target[p] = source[p]


@jit
def chunk_clusters(pairs, c):
    """Return chunk c's clusters: first, last + 1."""
    chunks, clusters = pairs.force.shape[0], pairs.counts[N_CLUSTERS]
    return c * clusters // chunks, (c + 1) * clusters // chunks
