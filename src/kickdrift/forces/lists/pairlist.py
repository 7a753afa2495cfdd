"""The cluster pair list: pairs of particles that may be within the cutoff, arranged for SIMD.

The list has two levels. The outer list has the clusters near each cluster (see `search`). The inner list has rows
of particles or of tiles (both in `particle_rows`), and is made again from the outer list between two searches.
"""

from math import ceil, floor

from kickdrift.forces.lists.clusters import (
    BUILT,
    JUMPS_ALLOWED,
    NX,
    NY,
    OUTER_BUILDS,
    PRUNES,
    ROOM_NEEDED,
    SHIFT_BITS,
    chunk_clusters,
    copy,
)
from kickdrift.forces.lists.load import (
    PRUNED,
    SEARCHED,
    Loading,
    adopt,
    keep_lengths,
    keep_positions,
    least_factor,
    move_since,
    outer_skin_now,
)
from kickdrift.forces.lists.pair_rows import copy_to_single
from kickdrift.forces.lists.particle_rows import particle_rows, write_tiles
from kickdrift.forces.lists.row_lanes import Tiles
from kickdrift.forces.lists.sort import sort
from kickdrift.forces.lists.special_pairs import place_special
from kickdrift.forces.seam.kernel import BLOWN_UP, GROW, OK
from kickdrift.jit.compile import is_finite, jit, never_inline, plain
from kickdrift.jit.handle import handle
from kickdrift.jit.inner import by_type
from kickdrift.jit.lanes.memory import flat
from kickdrift.jit.threads.chunks import chunk_task, each_chunk


@jit
def search(pairs, chunks):
    """Make the outer list from the sorted clusters."""
    each_chunk(pairs, chunks, "search_chunk")
    needed = 0
    for made in pairs.made:
        needed = max(needed, made)
    pairs.counts[ROOM_NEEDED] = needed
    pairs.counts[OUTER_BUILDS] += 1
    keep_lengths(pairs, plain(SEARCHED))


@chunk_task
def search_chunk(pairs, c):
    """Make chunk c's share of the outer list, and count its entries even if they do not fit."""
    never_inline()
    reach2 = (pairs.cutoff + pairs.outer_skin) ** 2
    span, near, touched = pairs.near_span, pairs.near[c], pairs.touched[c]
    for cluster in range(touched.size):
        touched[cluster] = False
    begin, end = chunk_clusters(pairs, c)
    made = plain(0)
    for cluster in range(begin, end):
        touched[cluster] = True
        span[cluster, 0] = min(made, near.size)
        made = clusters_near(pairs, cluster, reach2, near, made)
        span[cluster, 1] = min(made, near.size)
        for k in range(span[cluster, 0], span[cluster, 1]):
            touched[near[k] >> SHIFT_BITS] = True
    pairs.made[c] = made
    keep_positions(pairs, c, pairs.outer_reference)


@jit
def clusters_near(pairs, cluster, reach2, near, found):
    """Append to ``near`` the later clusters whose bounding box is within reach of this cluster's box.

    Entries begin at ``found``; entries that do not fit are only counted. Return the index of the next entry."""
    for row in range(pairs.bricks.whole.shape[0]):
        found = clusters_near_in(pairs, row, cluster, reach2, near, found)
    return found


@jit
def clusters_near_in(pairs, row, cluster, reach2, near, found):
    """Append the near clusters of one row of bricks, which share a lean; see `clusters_near`."""
    nx, ny = pairs.counts[NX], pairs.counts[NY]
    home, bounds, shifts, column_clusters = pairs.home[cluster], pairs.bounds, pairs.shifts, pairs.column_clusters
    cx, cy = home // ny, home % ny
    width_x, width_y, low_x, low_y = pairs.grid
    first_y, last_y, first_z, last_z = pairs.bricks.whole[row]
    lean_x, lean_y = pairs.bricks.leans[row]
    low_x, low_y = low_x + lean_x, low_y + lean_y
    reach = reach2**0.5
    span_x, span_y = int(reach / width_x) + 1, int(reach / width_y) + 1
    x_from, x_to = cx - span_x - ceil(lean_x / width_x), cx + span_x - floor(lean_x / width_x)
    y_from, y_to = cy - span_y - ceil(lean_y / width_y), cy + span_y - floor(lean_y / width_y)
    x_to = min(x_to, 2 * nx - 1 if pairs.cell.matrix[0, 0] > 0.0 else nx - 1)
    y_from, y_to = max(y_from, first_y * ny), min(y_to, last_y * ny + ny - 1)
    for ux in range(max(x_from, cx), x_to + 1):
        shift_x = int(ux >= nx)
        gap_x = max(0.0, low_x + ux * width_x - bounds[3, cluster], bounds[0, cluster] - low_x - (ux + 1) * width_x)
        for uy in range(y_from, y_to + 1):
            if ux == cx and uy < cy:
                continue
            below, above = low_y + uy * width_y - bounds[4, cluster], bounds[1, cluster] - low_y - (uy + 1) * width_y
            gap_y = max(0.0, below, above)
            height2 = 1.000001 * reach2 - gap_x * gap_x - gap_y * gap_y  # a margin for the rounding of column edges
            if height2 < 0.0:
                continue
            lowest, highest = bounds[2, cluster] - height2**0.5, bounds[5, cluster] + height2**0.5
            shift_y = int(uy >= ny) - int(uy < 0)
            other_home = (ux - shift_x * nx) * ny + uy - shift_y * ny
            same_column = ux == cx and uy == cy
            first, last = column_clusters[other_home], column_clusters[other_home + 1]
            if first == last:
                continue
            for shift_z in range(max(first_z, 0) if same_column else first_z, last_z + 1):
                s = 9 * (shift_x + 1) + 3 * (shift_y + 1) + shift_z + 1
                if lowest > bounds[5, last - 1] + shifts[2, s] or highest < bounds[2, first] + shifts[2, s]:
                    continue
                begin = cluster + 1 if same_column and shift_z == 0 else first
                for other in range(first_above(pairs, begin, last, lowest - shifts[2, s]), last):
                    if bounds[2, other] + shifts[2, s] > highest:
                        break
                    gap2 = 0.0
                    for k in range(3):
                        before = bounds[k, cluster] - bounds[k + 3, other] - shifts[k, s]
                        after = bounds[k, other] + shifts[k, s] - bounds[k + 3, cluster]
                        gap = max(0.0, before, after)
                        gap2 += gap * gap
                    if gap2 < reach2:
                        if found < near.size:
                            near[found] = (other << SHIFT_BITS) | s
                        found += 1
    return found


@jit
def first_above(pairs, begin, end, height):
    """Return the first cluster of a column, from ``begin`` to ``end``, that reaches ``height``; by bisection."""
    while begin < end:
        middle = (begin + end) // 2
        if pairs.bounds[5, middle] < height:
            begin = middle + 1
        else:
            end = middle
    return begin


OUTWORN = -1  # status of lists that must be made anew


@jit
def refresh(pairs, x, chunks):
    """Update the list for positions x (3, n); return OK, GROW (to ``counts[ROOM_NEEDED]``) or BLOWN_UP."""
    counts = pairs.counts
    adopt(pairs)
    if counts[BUILT]:
        each_chunk(handle(Loading(pairs, x)), chunks, "load_chunk")
        status = outlasts(pairs, chunks)
        if status != OUTWORN:
            return status
    each_chunk(handle(Loading(pairs, x)), chunks, "finite_chunk")
    if not all_finite(pairs):
        return BLOWN_UP
    counts[BUILT] = 0
    sort(pairs, x, chunks)
    place_special(pairs.special, pairs.place)
    search(pairs, chunks)
    if counts[ROOM_NEEDED] > pairs.near.shape[1]:
        return GROW
    each_chunk(handle(Loading(pairs, x)), chunks, "built_at_chunk")
    prune(pairs, chunks)
    counts[BUILT] = 1
    return OK


@chunk_task
def finite_chunk(loading, c):
    """Note in ``moves[c, 1]`` how many of chunk c's coordinates are not finite."""
    never_inline()
    numbers, chunks = flat(loading.x), loading.pairs.moves.shape[0]
    bad = 0
    for p in range(c * numbers.size // chunks, (c + 1) * numbers.size // chunks):
        bad += int(not is_finite(numbers[p]))
    loading.pairs.moves[c, 1] = bad


@jit
def all_finite(pairs):
    """Tell whether no chunk has found a coordinate that is not finite."""
    bad = 0.0
    for c in range(pairs.moves.shape[0]):
        bad += pairs.moves[c, 1]
    return bad == 0.0


@chunk_task
def built_at_chunk(loading, c):
    """Keep the positions of chunk c, of a search, in the order of the particles."""
    never_inline()
    given, kept, chunks = flat(loading.x), flat(loading.pairs.built_at), loading.pairs.moves.shape[0]
    begin, end = c * given.size // chunks, (c + 1) * given.size // chunks
    copy(given[begin:end], kept[begin:end])


@chunk_task
def single_chunk(pairs, c):
    """In mixed precision, copy the positions of chunk c's clusters to float32."""
    never_inline()
    begin, end = chunk_clusters(pairs, c)
    copy_to_single(pairs, begin, end)


@jit
def outlasts(pairs, chunks):
    """Prune the outer list if the noted moves of the particles need it.

    Return OK if all pairs within the cutoff are then in the inner list, OUTWORN if the lists must be made anew, or
    BLOWN_UP."""
    inner, total = move_since(pairs, pairs.inner_reference, plain(PRUNED))
    jumped = (
        inner > (pairs.cutoff + 0.5 * pairs.inner_skin) ** 2
    )  # a particle has passed the whole range of the force since the last call
    if not is_finite(total) or (jumped and not pairs.counts[JUMPS_ALLOWED]):
        return BLOWN_UP
    outer_skin = outer_skin_now(pairs)
    inner_skin = min(pairs.inner_skin, outer_skin)
    room = inner_skin - (1.0 - least_factor(pairs, plain(PRUNED))) * (pairs.cutoff + inner_skin)
    if room >= 0.0 and 4.0 * inner <= room**2:
        return OK
    each_chunk(pairs, chunks, "outer_move_chunk")
    outer, total = move_since(pairs, pairs.outer_reference, plain(SEARCHED))
    room = outer_skin - inner_skin
    room -= (1.0 - least_factor(pairs, plain(SEARCHED))) * (pairs.cutoff + outer_skin)
    if room >= 0.0 and 4.0 * outer <= room**2:
        prune(pairs, chunks)
        return OK
    return OUTWORN


@jit
def prune(pairs, chunks):
    """Prune the outer list to make the inner list."""
    if pairs.x_single.size:
        each_chunk(pairs, chunks, "single_chunk")
    each_chunk(pairs, chunks, "prune_chunk")
    pairs.counts[PRUNES] += 1
    keep_lengths(pairs, plain(PRUNED))


@chunk_task
def prune_chunk(pairs, c):
    """Make chunk c's rows of the inner list."""
    never_inline()
    make_rows(pairs.block, pairs, c)
    keep_positions(pairs, c, pairs.inner_reference)


@by_type
def make_rows(block, pairs, c):
    """Make chunk c's rows, of tiles or of particles."""
    if block.instance_class is Tiles:
        return lambda block, pairs, c: write_tiles(pairs, c)
    return lambda block, pairs, c: particle_rows(pairs, c)
