"""Cuts of the tree's largest nodes by all chunks of the work together.

A large node is cut like a small one: in the middle of the longest edge of its box, at the nearest whole number of
clusters. The particles of the first part are those with (coordinate, place in the node) below a key. Each chunk looks
at its share of the node: the box, the numbers next to the middle, the count below the key. Then it moves its share to
the places that the counts of all chunks give. So the order does not depend on the number of threads.
"""

import math

import numpy as np

from kickdrift.jit.compile import inlined, jit, never_inline
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.jit.threads.chunks import chunk_task, each_chunk

NEXT = WIDTH + 1  # numbers kept on each side of the middle: the cut is at most a cluster away
NODE, AXIS, MIDDLE, KEY, KEY_PLACE = range(5)  # slots of `cut`: what is cut, and where
# Columns of a chunk's row of `shares`: box; counts below the middle or the key, and the place of the next of each side;
# the largest below the middle and the smallest above, as pairs of number and place.
LOW, HIGH, COUNT, TO_FIRST, TO_SECOND, BELOW = 0, 3, 6, 7, 8, 9
ABOVE = BELOW + 2 * NEXT
SHARE_COLUMNS = ABOVE + 2 * NEXT


@jit
def cut_together(force, node):
    """Cut a node's particles, with all chunks."""
    span, cut, shares = force.span, force.cut, force.shares
    first, last = span[node, 0], span[node, 1]
    begin, size = WIDTH * first, min(WIDTH * last, force.rows.shape[0]) - WIDTH * first
    cut[NODE] = node
    each_chunk(force, force.chunks, "share_boxes")
    longest, axis, middle = -1.0, 0, 0.0
    for k in range(3):
        low, high = shares[:, LOW + k].min(), shares[:, HIGH + k].max()
        if high - low > longest:
            longest, axis, middle = high - low, k, low + 0.5 * (high - low)
    if longest == 0.0:  # all in one place
        at = first + (last - first) // 2
    else:
        cut[AXIS], cut[MIDDLE] = axis, middle
        each_chunk(force, force.chunks, "share_middles")
        below = int(shares[:, COUNT].sum())
        at = min(max(first + (below + WIDTH // 2) // WIDTH, first + 1), last - 1)
        set_key(cut, shares, below - WIDTH * (at - first))
        each_chunk(force, force.chunks, "share_counts")
        to_first, to_second = begin, WIDTH * at
        for c in range(shares.shape[0]):
            shares[c, TO_FIRST], shares[c, TO_SECOND] = to_first, to_second
            to_first += int(shares[c, COUNT])
            to_second += int(share_begin(size, shares.shape[0], c + 1) - share_begin(size, shares.shape[0], c))
            to_second -= int(shares[c, COUNT])
        each_chunk(force, force.chunks, "share_moves")
        each_chunk(force, force.chunks, "share_copies")
    divide(span, node, at)


@jit
def divide(span, node, cut):
    """Note the parts of a node that is cut before this cluster."""
    first, last = span[node, 0], span[node, 1]
    one, other = node + 1, node + 2 * (cut - first)
    span[one, 0], span[one, 1], span[other, 0], span[other, 1] = first, cut, cut, last


@jit
def set_key(cut, shares, surplus):
    """Set the key of the first particle of the second part: so many fewer than are below the middle come before it."""
    cut[KEY], cut[KEY_PLACE] = cut[MIDDLE], -1.0
    best = np.empty(2 * NEXT)
    if surplus > 0:
        clear(best, -math.inf)
        for c in range(shares.shape[0]):
            for k in range(NEXT):
                keep(best, 0, shares[c, BELOW + 2 * k], shares[c, BELOW + 2 * k + 1], 1.0)
        cut[KEY], cut[KEY_PLACE] = best[2 * surplus - 2], best[2 * surplus - 1]
    elif surplus < 0:
        clear(best, math.inf)
        for c in range(shares.shape[0]):
            for k in range(NEXT):
                keep(best, 0, shares[c, ABOVE + 2 * k], shares[c, ABOVE + 2 * k + 1], -1.0)
        cut[KEY], cut[KEY_PLACE] = best[-2 * surplus], best[-2 * surplus + 1]


@jit
def clear(best, number):
    """Begin a list of pairs."""
    for k in range(NEXT):
        best[2 * k], best[2 * k + 1] = number, -1.0


@jit
def keep(best, start, number, place, sign):
    """Insert a pair into a list of NEXT pairs, the largest first, or the smallest with sign -1, if it belongs there."""
    k = NEXT - 1
    if not comes_before(number, place, best[start + 2 * k], best[start + 2 * k + 1], sign):
        return
    while k > 0 and comes_before(number, place, best[start + 2 * k - 2], best[start + 2 * k - 1], sign):
        best[start + 2 * k], best[start + 2 * k + 1] = best[start + 2 * k - 2], best[start + 2 * k - 1]
        k -= 1
    best[start + 2 * k], best[start + 2 * k + 1] = number, place


@jit
def comes_before(number, place, other, other_place, sign):
    """Compare pairs: the larger comes first, or the smaller with sign -1."""
    return sign * number > sign * other or (number == other and sign * place > sign * other_place)


@jit
def share_begin(size, chunks, c):
    """First of a chunk's share of so many particles."""
    return size * c // chunks


@jit
def share_of(force, c):
    """Begin and end of a chunk's share of the node's rows."""
    node, chunks = int(force.cut[NODE]), force.shares.shape[0]
    begin = WIDTH * force.span[node, 0]
    size = min(WIDTH * force.span[node, 1], force.rows.shape[0]) - begin
    return begin + share_begin(size, chunks, c), begin + share_begin(size, chunks, c + 1)


@chunk_task
def share_boxes(force, c):
    """Find the box of a share."""
    never_inline()
    begin, end = share_of(force, c)
    share, rows = force.shares[c], force.rows
    for k in range(3):
        low, high = math.inf, -math.inf
        for i in range(begin, end):
            low, high = min(low, rows[i, k]), max(high, rows[i, k])
        share[LOW + k], share[HIGH + k] = low, high


@chunk_task
def share_middles(force, c):
    """Count the particles below the middle, and find those next to the middle on both sides."""
    never_inline()
    begin, end = share_of(force, c)
    share, rows, axis, middle = force.shares[c], force.rows, int(force.cut[AXIS]), force.cut[MIDDLE]
    clear(share[BELOW:ABOVE], -math.inf)
    clear(share[ABOVE:], math.inf)
    below = 0
    for i in range(begin, end):
        x = rows[i, axis]
        if x < middle:
            below += 1
            if x >= share[BELOW + 2 * NEXT - 2]:
                keep(share, BELOW, x, float(i), 1.0)
        elif x <= share[ABOVE + 2 * NEXT - 2]:
            keep(share, ABOVE, x, float(i), -1.0)
    share[COUNT] = below


@inlined
def is_below(x, i, key, place):
    """Tell whether a particle belongs to the first part."""
    return x < key or (x == key and i < place)


@chunk_task
def share_counts(force, c):
    """Count the particles of the first part."""
    never_inline()
    begin, end = share_of(force, c)
    rows, axis, key, place, below = force.rows, int(force.cut[AXIS]), force.cut[KEY], int(force.cut[KEY_PLACE]), 0
    for i in range(begin, end):
        below += is_below(rows[i, axis], i, key, place)
    force.shares[c, COUNT] = below


@chunk_task
def share_moves(force, c):
    """Write the particles of a share to their new places in ``spare``."""
    never_inline()
    begin, end = share_of(force, c)
    rows, spare, axis = force.rows, force.spare, int(force.cut[AXIS])
    key, place = force.cut[KEY], int(force.cut[KEY_PLACE])
    one, other = int(force.shares[c, TO_FIRST]), int(force.shares[c, TO_SECOND])
    for i in range(begin, end):
        below = is_below(rows[i, axis], i, key, place)
        to = one if below else other
        one, other = one + below, other + (not below)
        for k in range(4):
            spare[to, k] = rows[i, k]


@chunk_task
def share_copies(force, c):
    """Copy a share of the node back from ``spare``."""
    never_inline()
    begin, end = share_of(force, c)
    for i in range(begin, end):
        for k in range(4):
            force.rows[i, k] = force.spare[i, k]
