"""The steps of the pair sum, for each width of lanes, and the ends of its rows.

The argument ``zero`` holds zeros in all lanes of a step; its type selects the functions' number of lanes.

Rows of particles are short, and a processor cannot predict where each of many rows ends: it lost a sixth of the time of
the sum in large systems. With AVX-512 in float64, one loop therefore goes through all rows of a cluster, without a
branch at their ends. After each entry it stores the row's forces so far. Elsewhere each row has a loop of its own: rows
of tiles are longer, and with narrower vectors the stores take longer than the branches.

The sum asks for cache lines before it needs them. It goes through the clusters in the order of memory, and each cluster
meets those of the columns around its own. In a large system the meeting places form several streams, one for each slab
of columns within reach: each moves on by one cluster when the sum does. The processor does not see these streams, since
the sum jumps from one to the next.
"""

from typing import NamedTuple

import numpy as np
from numba import types

from kickdrift.forces.lists.clusters import (
    APART,
    N_CLUSTERS,
    NX,
    NY,
    SHIFTS,
    STRIDE,
    TABLE_STRIDE,
    load_vector,
    store_vector,
    table_place,
)
from kickdrift.forces.lists.row_lanes import Wide
from kickdrift.forces.lists.sums import force_memory, thread_memory
from kickdrift.jit.compile import as_written, jit
from kickdrift.jit.inner import by_type
from kickdrift.jit.lanes.functions import in_eight, lane_numbers, multiply_add
from kickdrift.jit.lanes.masks import less_than_next, lowest_bit, select
from kickdrift.jit.lanes.memory import (
    broadcast,
    fetch_to_read,
    fetch_to_write,
    line_aligned,
    load,
    load_like,
    store,
    sums_of_rows,
    zero_unless_same,
)
from kickdrift.jit.lanes.single import (
    four_of,
    halves,
    load_four_times,
    load_single,
    store_narrow,
    sums_in_quarters,
    sums_of_quarters,
)
from kickdrift.jit.lanes.vectors import F64, WIDTH, lanes_type, single_type

ROW = 4  # particles in a row of tiles
PLACES = (
    table_place.py_func(ROW, 1, 0),
    table_place.py_func(ROW, 0, 1),
)  # distances in the table between shifts and between rows, for rows of four particles


@by_type
def working_arrays(zero, pairs, chunks, c, thread):
    """Return positions, forces and reactions of chunk c, an empty table and room for a cluster's row forces, in the
    precision of the pairs; the forces are float64, and so are row forces unless rows have tiles."""
    if zero.vector.element == F64:

        def double(zero, pairs, chunks, c, thread):
            forces = force_memory(pairs, chunks, c, thread)
            return pairs.x, forces, forces, np.empty(SHIFTS * TABLE_STRIDE), np.zeros(WIDTH * STRIDE)

        def on_lines(zero, pairs, chunks, c, thread):
            forces = force_memory(pairs, chunks, c, thread)
            table = line_aligned(np.empty(SHIFTS * TABLE_STRIDE + WIDTH))
            return pairs.x, forces, forces, table, line_aligned(np.zeros(WIDTH * STRIDE + WIDTH))

        return on_lines if zero == lanes_type else double

    def tiles(zero, pairs, chunks, c, thread):
        forces = force_memory(pairs, chunks, c, thread)
        reactions = thread_memory(pairs.thread_single, pairs, c, thread)
        row_sums = line_aligned(np.empty(4 * STRIDE + 2 * WIDTH, np.float32))
        return pairs.x_single, forces, reactions, tile_table(), row_sums

    def single(zero, pairs, chunks, c, thread):
        forces = force_memory(pairs, chunks, c, thread)
        reactions = thread_memory(pairs.thread_single, pairs, c, thread)
        table = np.empty(SHIFTS * TABLE_STRIDE, np.float32)
        return pairs.x_single, forces, reactions, table, np.zeros(WIDTH * STRIDE)

    return tiles if zero == single_type else single


@as_written
def tile_table():
    """Return an empty table for rows of tiles, on a boundary of cache lines."""
    return line_aligned(np.empty(SHIFTS * PLACES[0] + 2 * WIDTH, np.float32))


@jit
def copy_to_single(pairs, begin, end):
    """In mixed precision, copy the positions of these clusters, relative to the origin, to float32."""
    if pairs.x_single.size == 0:
        return
    for cluster in range(begin, end):
        for k in range(3):
            p = STRIDE * cluster + WIDTH * k
            store_narrow(pairs.x_single, p, load(pairs.x, p) - pairs.origin[k])


@by_type
def particle_of(zero, place):
    """Return the index in its cluster of a row's (first) particle, from the row's place in the table."""
    if zero == single_type:
        per_shift, per_row = PLACES
        return lambda zero, place: ROW * (place % per_shift // per_row)
    return lambda zero, place: place & (WIDTH - 1)


@as_written
def slot_of(other):
    """Return the slot of the particle whose x is at ``other``."""
    return other // STRIDE * WIDTH + other % STRIDE


@by_type(forceinline=True)
def fill_table(table, pairs, cluster, used, zero):
    """Fill the table with a cluster's positions minus each shift in use; a look-up is cheaper than a subtraction in
    each step."""

    def double(table, pairs, cluster, used, zero):
        shifts = pairs.shifts
        x, y, z = load_vector(pairs.x, cluster)
        while used:
            s = lowest_bit(used)
            used &= used - 1
            store(table, TABLE_STRIDE * s, x - shifts[0, s])
            store(table, TABLE_STRIDE * s + WIDTH, y - shifts[1, s])
            store(table, TABLE_STRIDE * s + 2 * WIDTH, z - shifts[2, s])

    def single(table, pairs, cluster, used, zero):
        shifts, origin = pairs.shifts, pairs.origin
        x, y, z = load_vector(pairs.x, cluster)
        while used:
            s = lowest_bit(used)
            used &= used - 1
            store_narrow(table, TABLE_STRIDE * s, x - (shifts[0, s] + origin[0]))
            store_narrow(table, TABLE_STRIDE * s + WIDTH, y - (shifts[1, s] + origin[1]))
            store_narrow(table, TABLE_STRIDE * s + 2 * WIDTH, z - (shifts[2, s] + origin[2]))

    def fours(table, pairs, cluster, used, zero):
        shifts, origin = pairs.shifts, pairs.origin
        x, y, z = load_vector(pairs.x, cluster)
        # an empty place of a row is further away than all other empty places, for every shift
        aside = 10 * APART * pairs.cutoff + 3 * pairs.cell.matrix[0, 0]
        x = select(lane_numbers() < float(pairs.filled[cluster]), x, x + aside)
        while used:
            s = lowest_bit(used)
            used &= used - 1
            store_fours(table, 4 * STRIDE * s, x - (shifts[0, s] + origin[0]))
            store_fours(table, 4 * STRIDE * s + 2 * WIDTH, y - (shifts[1, s] + origin[1]))
            store_fours(table, 4 * STRIDE * s + 4 * WIDTH, z - (shifts[2, s] + origin[2]))

    return double if zero.vector.element == F64 else fours if zero == single_type else single


@as_written
def store_fours(table, at, value):
    """Store lanes 0 to 3 four times each in float32, then lanes 4 to 7 in the next row."""
    store(table, at, four_of(value, 0))
    store(table, at + 2 * STRIDE, four_of(value, 1))


@by_type
def displacements(zero, x, table, other, place):
    """Return the displacements from the neighbours whose x begin at ``other`` to the row at ``place``."""

    def one(zero, x, table, other, place):
        dx = broadcast(table, place, zero) - load_like(x, other, zero)
        dy = broadcast(table, place + WIDTH, zero) - load_like(x, other + WIDTH, zero)
        return dx, dy, broadcast(table, place + 2 * WIDTH, zero) - load_like(x, other + 2 * WIDTH, zero)

    def four(zero, x, table, other, place):
        dx = load_single(table, place) - load_four_times(x, other)
        dy = load_single(table, place + 2 * WIDTH) - load_four_times(x, other + WIDTH)
        return dx, dy, load_single(table, place + 4 * WIDTH) - load_four_times(x, other + 2 * WIDTH)

    return four if zero == single_type else one


@by_type
def subtract_reactions(reactions, other, g, dx, dy, dz):
    """Add g times the displacements to the reactions on the neighbours whose x begin at ``other``."""
    per_row = ROW if g == single_type else 1

    def add(reactions, other, g, dx, dy, dz):
        x, y, z = per_row * other, per_row * (other + WIDTH), per_row * (other + 2 * WIDTH)
        hx, hy, hz = load_like(reactions, x, g), load_like(reactions, y, g), load_like(reactions, z, g)
        store(reactions, x, multiply_add(g, dx, hx))
        store(reactions, y, multiply_add(g, dy, hy))
        store(reactions, z, multiply_add(g, dz, hz))

    return add


@by_type
def in_float64(value):
    """Return eight lanes of float64: 16 lanes are summed in pairs, four lanes are padded with four zeros."""

    def two(value):
        low, high = halves(value)
        return low + high

    return two if value == single_type else (lambda value: in_eight(value))


@by_type
def clear(reactions, cluster, zero):
    """Set the reactions on a cluster to zero, unless they are already, or the forces themselves hold them."""

    def single(reactions, cluster, zero):
        for k in range(3):
            store(reactions, STRIDE * cluster + WIDTH * k, zero)

    if reactions.dtype != types.float32 or zero == single_type:
        return lambda reactions, cluster, zero: None
    return single


@by_type
def add_reactions(forces, reactions, cluster, zero):
    """Add the reactions on a cluster to its forces, unless the forces themselves hold them.

    The reactions of tiles then become zero for the next evaluation: they are three times as large as the forces, and
    now in the cache."""

    def single(forces, reactions, cluster, zero):
        for k in range(3):
            p = STRIDE * cluster + WIDTH * k
            store(forces, p, load(forces, p) + in_float64(load_like(reactions, p, zero)))

    def tiles(forces, reactions, cluster, zero):
        for k in range(3):
            p = STRIDE * cluster + WIDTH * k
            both = load_single(reactions, ROW * p), load_single(reactions, ROW * p + 2 * WIDTH)
            store(forces, p, load(forces, p) + sums_of_quarters(both[0], both[1]))
            store(reactions, ROW * p, zero)
            store(reactions, ROW * p + 2 * WIDTH, zero)

    if reactions.dtype != types.float32:
        return lambda forces, reactions, cluster, zero: None
    return tiles if zero == single_type else single


@by_type
def rows_in_one_loop(lanes):
    """Return the number of rows that one loop goes through, all of a cluster, or None if each row has a loop."""
    return (lambda lanes: WIDTH) if lanes.instance_class is Wide else (lambda lanes: None)


@as_written
def row_of(place):
    """Return the number of a particle's row in its cluster, from the row's place in the table."""
    return place & (WIDTH - 1)


@as_written
def of_row(sums, place, before):
    """Return the sums of a row's forces up to its entry at ``place``: zeros where the entry ``before`` was another
    row's."""
    x, y, z = sums
    change = row_of(place ^ before)
    return zero_unless_same(x, change), zero_unless_same(y, change), zero_unless_same(z, change)


@by_type
def store_row_force(row_sums, row, fx, fy, fz):
    """Store the forces on a row's particles, with the lanes not yet summed."""

    def one(row_sums, row, fx, fy, fz):
        store_vector(row_sums, row, in_float64(fx), in_float64(fy), in_float64(fz))

    def four(row_sums, row, fx, fy, fz):
        at = 2 * STRIDE * row
        store(row_sums, at, fx)
        store(row_sums, at + 2 * WIDTH, fy)
        store(row_sums, at + 4 * WIDTH, fz)

    return four if fx == single_type else one


@by_type
def row_forces(row_sums, axis, start, first, zero):
    """Return one component of the forces on a cluster's particles, eight of float64, from what its rows have stored.

    The rows begin at ``start[first]``, ``start[first + 1]`` …"""

    def four(row_sums, axis, start, first, zero):
        at = 2 * WIDTH * axis
        return sums_in_quarters(load_single(row_sums, at), load_single(row_sums, at + 2 * STRIDE))

    def one(row_sums, axis, start, first, zero):
        return particle_forces(row_sums, axis, start, first)

    return four if zero == single_type else one


@as_written
def particle_forces(row_sums, axis, start, first):
    """Return `row_forces` for rows of particles. Rows without entries may have stored nothing."""
    return select(less_than_next(start, first), sums_of_rows(row_sums, WIDTH * axis, STRIDE), 0.0)


FEW = 2000  # clusters whose positions and forces the second cache holds
MOST = 4  # slabs on each side
SPARE = 4  # clusters that the streams are ahead of the sum: the time that memory takes to answer


class Streams(NamedTuple):
    """Where the streams are, in clusters."""

    apart: int  # distance from one to the next
    ahead: int  # how far the middle one is ahead of the sum
    sides: int  # number on each side of the middle one; -1 if there are none


@as_written
def streams(pairs):
    """Return the streams of the pair sum."""
    clusters, reach = pairs.counts[N_CLUSTERS], pairs.cutoff + pairs.inner_skin
    apart = clusters // pairs.counts[NX]
    rows = int(reach / pairs.grid[1]) + 1
    sides = -1 if clusters < FEW else min(int(reach / pairs.grid[0]) + 1, MOST)
    ahead = rows * (apart // pairs.counts[NY]) + rows + SPARE
    return Streams(apart, ahead, sides)


@as_written
def fetch_streams(found, pairs, x, reactions, cluster, zero):
    """Ask for the positions and reactions of the clusters at the front of all streams."""
    for side in range(-found.sides, found.sides + 1):
        front = cluster + side * found.apart + found.ahead
        if front >= 0 and front < pairs.counts[N_CLUSTERS]:
            fetch_to_read(x, STRIDE * front, STRIDE)
            fetch_reactions(reactions, front, zero)


@by_type
def fetch_reactions(reactions, cluster, zero):
    """Ask for the reactions on a cluster, which are four for each particle if rows have tiles."""
    size = ROW * STRIDE if zero == single_type else STRIDE
    return lambda reactions, cluster, zero: fetch_to_write(reactions, size * cluster, size)
