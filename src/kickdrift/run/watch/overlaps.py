"""Pairs of bodies whose paths in a step may meet: a tree of boxes, for systems of many bodies.

Each body has a box around its cubic curve (see `encounters`), widened by its radius. A curve lies inside the box of its
four Bézier points, so that two bodies can touch only if their boxes overlap. The bodies are sorted along a
space-filling curve, and a binary tree of boxes stands over groups of them (Lauterbach et al. 2009,
doi:10.1111/j.1467-8659.2009.01377.x). The search takes some n log n tests for short steps, instead of n^2 / 2. The
hull of the relative curve then rules out further pairs, as in the search of all pairs.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from kickdrift.jit.compile import driver
from kickdrift.model.state import Floats
from kickdrift.run.watch.courses import may_meet
from kickdrift.run.watch.encounters import hull_bound

GROUP = 8  # bodies under a lowest box
LEVELS = 10  # bits of each coordinate along the space-filling curve
MARGIN = 1e-12  # of the coordinates, for rounding

_NUMBERS = np.arange(2**LEVELS)
_SPREAD = np.sum([(_NUMBERS >> bit & 1) << 3 * bit for bit in range(LEVELS)], axis=0)  # every third bit


def overlapping(
    y0: Floats,
    y1: Floats,
    h: float,
    radii: Floats,
    massive: NDArray[np.bool_],
    gm: Floats | None = None,
    ahead: float = 0.0,
) -> NDArray[np.int64]:
    """Pairs (2, P) of rows i < j that may touch in a step, in order of i and j. Two massless bodies are no pair.

    With G times the masses, ``gm`` (n,), also pairs that may meet in the time ``ahead``; see `courses`."""
    low, high = boxes(y0, y1, h, radii, gm, ahead)
    gm = np.zeros(0) if gm is None else gm
    order = np.argsort(_codes(0.5 * (low + high)), kind="stable")
    low, high = np.ascontiguousarray(low[:, order]), np.ascontiguousarray(high[:, order])
    groups = 1
    while groups * GROUP < len(order):
        groups *= 2
    tree, pairs = np.empty((2 * groups, 2, 3)), np.empty((2, 4 * len(order)), np.int64)
    count = overlaps(y0, y1, h, radii, massive, gm, ahead, order, low, high, tree, pairs)
    if count > pairs.shape[1]:
        pairs = np.empty((2, count), np.int64)
        overlaps(y0, y1, h, radii, massive, gm, ahead, order, low, high, tree, pairs)
    found = pairs[:, :count]
    return np.ascontiguousarray(found[:, np.lexsort((found[1], found[0]))])


def boxes(
    y0: Floats, y1: Floats, h: float, radii: Floats, gm: Floats | None = None, ahead: float = 0.0
) -> tuple[Floats, Floats]:
    """Lowest and highest corners (3, n) of the boxes around the paths of all bodies."""
    low, high = np.empty(y0[0].shape), np.empty(y0[0].shape)
    fill_boxes(y0, y1, h, radii, np.zeros(0) if gm is None else gm, ahead, low, high)
    return low, high


@driver
def fill_boxes(y0, y1, h, radii, gm, ahead, low, high):
    """Fill low, high (3, n) with corners of boxes around the cubics of a step, and around the straight ways in the time
    ``ahead``, as much wider as a body's attraction may draw others."""
    for i in range(radii.size):
        wide = radii[i] + (np.cbrt(gm[i] * ahead * ahead) if gm.size > 0 else 0.0)
        for k in range(3):
            x0, x1 = y0[0, k, i], y1[0, k, i]
            inner0, inner1, way = x0 + h / 3.0 * y0[1, k, i], x1 - h / 3.0 * y1[1, k, i], x0 + ahead * y0[1, k, i]
            least, most = min(min(x0, x1), min(inner0, inner1)), max(max(x0, x1), max(inner0, inner1))
            least, most = min(least, way), max(most, way)
            margin = wide + MARGIN * max(abs(least), abs(most))
            low[k, i], high[k, i] = least - margin, most + margin


def _codes(centres: Floats) -> NDArray[Any]:
    """Places (n,) along Morton's curve: the bits of three whole numbers in turn."""
    with np.errstate(invalid="ignore"):
        low = centres.min(axis=1)
        size = float((centres.max(axis=1) - low).max()) or 1.0
        steps = np.nan_to_num((centres - low[:, None]) * ((2**LEVELS - 1) / size)).astype(np.int64)
    spread = _SPREAD[steps]
    return spread[0] | spread[1] << 1 | spread[2] << 2


@driver
def overlaps(y0, y1, h, radii, massive, gm, ahead, order, low, high, tree, pairs):
    """Fill ``pairs`` (2, room) with rows that may touch; return how many there are, also beyond the room.

    ``low`` and ``high`` (3, n) are in the ``order`` (n,) of the tree. ``tree`` (2 groups, 2, 3) is overwritten: its
    node k has the nodes 2 k and 2 k + 1 below."""
    n, groups = low.shape[1], tree.shape[0] // 2
    for g in range(groups):
        for k in range(3):
            small, large = np.inf, -np.inf
            for i in range(g * GROUP, min((g + 1) * GROUP, n)):
                small, large = min(small, low[k, i]), max(large, high[k, i])
            tree[groups + g, 0, k], tree[groups + g, 1, k] = small, large
    for node in range(groups - 1, 0, -1):
        for k in range(3):
            tree[node, 0, k] = min(tree[2 * node, 0, k], tree[2 * node + 1, 0, k])
            tree[node, 1, k] = max(tree[2 * node, 1, k], tree[2 * node + 1, 1, k])
    stack = np.empty(128, np.int64)
    count = 0
    for i in range(n):
        stack[0] = 1
        top = 1
        while top > 0:
            top -= 1
            node = stack[top]
            last = node  # the last group below this node
            while last < groups:
                last = 2 * last + 1
            if (last - groups + 1) * GROUP <= i + 1:
                continue  # all earlier bodies, which have found this one
            apart = False
            for k in range(3):
                apart |= tree[node, 0, k] > high[k, i] or tree[node, 1, k] < low[k, i]
            if apart:
                continue
            if node < groups:
                stack[top], stack[top + 1] = 2 * node + 1, 2 * node
                top += 2
                continue
            for j in range(max((node - groups) * GROUP, i + 1), min((node - groups + 1) * GROUP, n)):
                apart = False
                for k in range(3):
                    apart |= low[k, j] > high[k, i] or high[k, j] < low[k, i]
                p, q = min(order[i], order[j]), max(order[i], order[j])
                reach = radii[p] + radii[q]
                if apart or reach == 0.0 or not (massive[p] or massive[q]):
                    continue
                if hull_bound(y0, y1, h, p, q) > reach and not (
                    gm.size > 0 and may_meet(y0, p, q, reach, gm[p] + gm[q], ahead)
                ):
                    continue
                if count < pairs.shape[1]:
                    pairs[0, count], pairs[1, count] = p, q
                count += 1
    return count
