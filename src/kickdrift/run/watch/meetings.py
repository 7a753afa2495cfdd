"""Pairs that may meet in a step: the compiled questions of the search, answered from the state at the step's start."""

from __future__ import annotations

import numpy as np

from kickdrift.jit.compile import driver
from kickdrift.run.watch.courses import (
    AHEAD,
    ARC,
    HIT,
    LEAST,
    NEAR,
    bends,
    course,
    course_back,
    distance,
    is_far,
    is_strong,
    is_suspect,
    leaves,
    may_meet,
    speed2,
)  # fmt: skip
from kickdrift.run.watch.encounters import hull_bound

TURNS = 1e-3  # G M h^2 over the cube of a distance: with less, a step resolves the attraction
SAFE = 0.95  # of the time to a contact: a part of a step that ends before
RESOLVED = 0.1  # longest part, over the time scale of the pair's attraction at its end
SHORTEST = 2.0**-12  # shortest part, of the rest of a step


@driver
def all_far(y0, y1, h, pairs, touching, limits):
    """Tell whether no pair may touch in a step from y0 to y1 or soon after, and none is known to touch; loosely.

    ``limits`` (2, P) are their distances at contact, and G times their masses."""
    for p in range(pairs.shape[1]):
        i, j, reach, pair = pairs[0, p], pairs[1, p], limits[0, p], limits[1, p]
        if touching[p]:
            return False
        if is_far(y0, y1, h, i, j, NEAR * reach, pair, AHEAD * h) or reach == 0.0:
            continue
        if not hull_bound(y0, y1, h, i, j) > NEAR * reach or may_meet(y0, i, j, reach, pair, AHEAD * h):
            return False
    return True


@driver
def suspects(y0, y1, h, pairs, touching, radii, gm, sources, softening2, fresh, ahead, behind, rows):
    """rows (P + 1,) <- numbers of the ``pairs`` that may touch in a step from y0 to y1, or soon after. Return how many.

    The last row is the number of pairs that are known to touch, or near each other on the cubic without coming deep
    into each other. ``gm`` (n,) is G times the masses; ``sources`` (n,) are those of tides, or (0,). ``fresh`` (n,) or
    (0,) bodies come from a contact."""
    found, back, count, others = np.empty(3), np.empty((2, 3, 2)), 0, 0
    for p in range(pairs.shape[1]):
        i, j = pairs[0, p], pairs[1, p]
        reach, pair = radii[i] + radii[j], gm[i] + gm[j]
        others += touching[p]
        if reach == 0.0 or (fresh.size == 0 and is_far(y0, y1, h, i, j, NEAR * reach, pair, AHEAD * h)):
            continue
        near = hull_bound(y0, y1, h, i, j) <= NEAR * reach
        if not is_strong(y0, h, i, j, reach, pair):
            others += near
            continue
        near = near or is_suspect(y0, h, i, j, reach, sources, softening2, pair, ahead, found)
        if not near and fresh.size > 0 and fresh[i] and fresh[j]:
            near = leaves(y0, h, i, j, reach, softening2, pair, behind, found, back)
        if near:
            rows[count] = p
            count += 1
    rows[rows.size - 1] = others
    return count


@driver
def any_bends(y, h, pairs, limits, heaviest, gm, softening2, inside):
    """Tell whether one of the ``pairs`` passes within its limit in a step or soon after, unbound, and so near that a
    step does not resolve the attraction. Limits are those of `encounters.passages`. With ``inside``, also if an
    unbound pair is within its limit."""
    found = np.empty(3)
    for p in range(pairs.shape[1]):
        i, j = pairs[0, p], pairs[1, p]
        d2, w2, pair = 0.0, 0.0, gm[i] + gm[j]
        for k in range(3):
            d2 += (y[0, k, i] - y[0, k, j]) ** 2
            w2 += (y[1, k, i] - y[1, k, j]) ** 2
        limit = limits[p]
        if heaviest >= 0:
            limit *= 0.5 * (distance(y, i, heaviest) + distance(y, j, heaviest))
        way = AHEAD * h
        if d2 > 2.0 * (limit * limit + way * way * w2) or not w2 * w2 * d2 > 4.0 * pair * pair > 0.0:
            continue
        if inside and d2 < limit * limit:
            return True
        course(y, i, j, 0.0, gm, softening2, pair, h, AHEAD * h, found)
        if found[LEAST] < limit and pair * h * h > TURNS * found[LEAST] ** 3:
            return True
    return False


@driver
def soon(y, h, pairs, radii, gm, sources, softening2, fresh, ahead, behind):
    """Tell whether one of the ``pairs`` touches so soon after y, or left a contact so shortly before, that a step of
    length h spoils its velocity."""
    found, back = np.empty(3), np.empty((2, 3, 2))
    for p in range(pairs.shape[1]):
        i, j = pairs[0, p], pairs[1, p]
        reach, pair = radii[i] + radii[j], gm[i] + gm[j]
        if (
            fresh.size > 0
            and fresh[i]
            and fresh[j]
            and leaves(y, h, i, j, reach, softening2, pair, behind, found, back)
        ):
            return True
        course(y, i, j, reach, sources, softening2, pair, h, (AHEAD - 1.0) * h, found)
        if found[HIT] <= (ahead - 1.0) * h:
            return True
        if found[HIT] < np.inf and bends(distance(y, i, j), pair, h, speed2(y, i, j)):
            return True
    return False


@driver
def room(y, left, pairs, radii, gm, sources, softening2, fresh, ahead, behind, fine):
    """Return the longest part of a step that ends before the ``pairs`` touch, or shortly after they touch.

    A method evaluates forces at times between -``behind`` and ``ahead`` of its step. Pairs of ``fresh`` bodies (n,)
    come from a contact, so their way back is no way for a step either. With ``fine``, parts are short where the pairs'
    attraction changes fast."""
    found, back, longest = np.empty(3), np.empty((2, 3, 2)), left
    for p in range(pairs.shape[1]):
        i, j = pairs[0, p], pairs[1, p]
        reach, pair = radii[i] + radii[j], gm[i] + gm[j]
        w, d = np.sqrt(speed2(y, i, j) + 2.0 * pair / reach), distance(y, i, j)
        for way in range(2):
            if way == 0:
                course(y, i, j, reach, sources, softening2, pair, left, AHEAD * left, found)
                part = ahead
            else:
                if not (fine and fresh.size > 0 and fresh[i] and fresh[j]):
                    continue
                course_back(y, i, j, reach, softening2, pair, left, found, back)
                part = behind
            if found[HIT] == np.inf:
                continue
            if part > 0.0:
                longest = min(longest, max(SAFE * found[HIT] / part, ARC * reach / w))
            if not fine:
                continue
            s = longest
            for _ in range(100):
                end = max(reach, d - w * s) if way == 0 else d
                if s <= RESOLVED * np.sqrt(end * end * end / pair):
                    break
                s *= 0.8
            longest = min(longest, s)
    return max(longest, left * SHORTEST)
