"""Steps without events in compiled code, for methods that know which bodies met inside a step.

A step is quiet if no watched pair comes within its limit on the cubic between the step's ends. Where both bodies met in
the step, the cubics run between the noted points. The search has nothing to do in a quiet step, so that Python sees the
other steps only.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.seam.kernel import OK
from kickdrift.integrators.stepping.loops import STEP
from kickdrift.jit.compile import driver, jit
from kickdrift.jit.handle import address_of, status_at
from kickdrift.model.state import Floats
from kickdrift.run.watch.courses import AHEAD, is_far, may_touch
from kickdrift.run.watch.encounters import POINTS, cubic, hull_bound, separation2, turning_points

if TYPE_CHECKING:
    from kickdrift.run.watch.contacts import Contacts
    from kickdrift.run.watch.distances import Approaches, Escapes

TIME, SLOT, COUNT = 0, 1, 8  # columns of the noted points: see `integrators.trace.state`
ROOM = 1.1  # factor of a limit that changes within the step
MARGIN = 64  # rows of points that may be missing
TAKEN, LOUD = range(2)  # slots of ``seen``: steps taken, and whether the last one is not quiet


class Limits(NamedTuple):
    """Distances within which something may happen."""

    pairs: NDArray[np.int64]  # (2, P)
    contacts: int  # the first of these pairs may touch; all others may only come near
    reaches: Floats  # (P,) lengths, or fractions of the mean distance from the body ``about``
    about: NDArray[np.int64]  # (P,) -1 for a length
    far: float  # a body farther from the origin of an escape is not quiet
    origin: int  # the body at that origin; -1 for the others' centre of mass
    shares: Floats  # (n,) masses over their sum
    gm: Floats  # (n,) G times the masses
    softening2: float


_NOTHING: Any = np.zeros((2, 0), np.int64), np.zeros(0), np.zeros(0, np.int64)


def limits_of(contacts: list[Contacts], approaches: list[Approaches], escapes: list[Escapes]) -> Limits | None:
    """Limits of these watches; None with two kinds of escapes."""
    if len(escapes) > 1:
        return None
    rows: list[Any] = [_NOTHING, *(each.limits for each in contacts), *(each.limits for each in approaches)]
    pairs, reaches, about = (np.concatenate([row[k] for row in rows], axis=-1) for k in range(3))
    touching = sum(each.limits[1].size for each in contacts)
    gm, softening2 = (contacts[0].gm, contacts[0].softening2) if contacts else (np.zeros(0), 0.0)
    far, origin, shares = escapes[0].limit if escapes else (np.inf, -1, np.ones(1))
    return Limits(np.ascontiguousarray(pairs), touching, reaches, about, far, origin, shares, gm, softening2)


@jit
def nearest(y0, y1, h, i, j, reach, c, points):
    """Smallest distance on the cubic between two states; a lower bound of it if that is above ``reach``."""
    least = hull_bound(y0, y1, h, i, j)
    if least > reach:
        return least
    cubic(y0, y1, h, i, j, c)
    least = np.inf
    for k in range(turning_points(c, points)):
        least = min(least, separation2(c, points[k]))
    return np.sqrt(least)


@jit
def row_of(path, first, slot):
    """Row of the body in this slot, or of its copy, in the points from ``first`` on; -1 if the body is not there."""
    for row in range(first, first + int(path[first, COUNT])):
        if slot >= 0 and (path[row, SLOT] == slot or -1 - path[row, SLOT] == slot):
            return row
    return -1


@jit
def put(path, row, y, body):
    """y[:, :, body] <- position and velocity from the central body, which are 0 for that body itself."""
    for half in range(2):
        for k in range(3):
            y[half, k, body] = path[row, SLOT + 1 + 3 * half + k] if row >= 0 else 0.0


@jit
def nearest_on_path(path, count, one, other, reach, ya, yb, c, points):
    """Lower bound of the distance of the bodies in two slots where they met; infinite if they did not."""
    least, first = np.inf, 0
    while first < count:
        after = first + int(path[first, COUNT])
        if after < count and path[after, TIME] > path[first, TIME]:
            i, j = row_of(path, first, one), row_of(path, first, other)
            if (i >= 0 or one < 0) and (j >= 0 or other < 0):
                put(path, i, ya, 0)
                put(path, j, ya, 1)
                put(path, i if i < 0 else i + after - first, yb, 0)
                put(path, j if j < 0 else j + after - first, yb, 1)
                h = path[after, TIME] - path[first, TIME]
                least = min(least, nearest(ya, yb, h, 0, 1, reach, c, points))
        first = after
    return least


@jit
def is_quiet(before, y, h, noted, limits, ya, yb, c, points):
    """Tell whether a step from ``before`` to y is quiet for the watched distances."""
    count, path, slots = noted
    pairs, touching, reaches, about, far, origin, shares, gm, softening2 = limits
    found = np.empty(3)
    if count[0] + MARGIN > path.shape[0]:
        return False
    for p in range(reaches.size):
        i, j, reach = pairs[0, p], pairs[1, p], reaches[p]
        if about[p] >= 0:
            sizes = 0.0
            for body in (i, j):
                d2 = 0.0
                for k in range(3):
                    d2 += (y[0, k, body] - y[0, k, about[p]]) ** 2
                sizes += np.sqrt(d2)
            reach *= 0.5 * sizes * ROOM
        least = np.inf
        if count[0] > 0:
            least = nearest_on_path(path, count[0], slots[i], slots[j], reach, ya, yb, c, points)
        pull = gm[i] + gm[j] if p < touching else 0.0
        if least == np.inf and is_far(before, y, h, i, j, reach, pull, AHEAD * h if p < touching else 0.0):
            continue
        if least == np.inf:
            least = nearest(before, y, h, i, j, reach, c, points)
        if not least > reach:
            return False
        if p < touching and may_touch(before, h, i, j, reach, gm, gm, softening2, found):
            return False
    return far == np.inf or all_inside(y, far, origin, shares)


@jit
def all_inside(y, far, origin, shares):
    """Tell whether all bodies but a heaviest one are within the distance ``far`` of the origin."""
    for i in range(shares.size):
        d2 = 0.0
        for k in range(3):
            centre = 0.0
            if origin >= 0:
                centre = y[0, k, origin]
            elif shares[i] < 1.0:
                for j in range(shares.size):
                    if j != i:
                        centre += shares[j] / (1.0 - shares[i]) * y[0, k, j]
            d2 += (y[0, k, i] - centre) ** 2
        if not d2 < far * far and shares[i] <= 0.5:
            return False
    return True


@driver
def quiet_loop(forces, steps_at, given, noted, before, y, dt, limits, first, most, cursor, seen):
    """Take up to ``most`` steps of the loop at an address, until one is not quiet. Return a status.

    ``before`` gets the state at the last step's start. ``noted`` has the points of bodies that met in a step.
    """
    seen[LOUD], ya, yb, c, points = 0, np.zeros((2, 3, 2)), np.zeros((2, 3, 2)), np.empty((4, 3)), np.empty(POINTS)
    while seen[TAKEN] < most and seen[LOUD] == 0:
        before[...] = y
        status = status_at(steps_at, (forces, *given, first + seen[TAKEN], 1, cursor))
        if status != OK:
            return status
        cursor[STEP] = 0
        seen[TAKEN] += 1
        if not is_quiet(before, y, dt, noted, limits, ya, yb, c, points):
            seen[LOUD] = 1
    return OK


class QuietSteps:
    """Steps of a stepper until one is not quiet."""

    def __init__(self, inner: Any, limits: Limits) -> None:
        loop, forces, given = inner.compiled_steps
        self._inner, self._limits = inner, limits
        self._steps_at = address_of(loop, forces.table, *given, inner.steps_done, 1, inner._cursor)
        self._noted = inner.noted
        self._before, self._seen = np.empty(inner.y.shape), np.zeros(2, np.int64)

    def take(self, most: int) -> tuple[int, Floats, float, bool]:
        """Take up to ``most`` steps. Return a status, the state and the time at the start of the last step, and whether
        that step is not quiet."""
        inner, before, seen = self._inner, self._before, self._seen
        _, forces, given = inner.compiled_steps
        seen[TAKEN] = 0
        status = forces.call(
            quiet_loop, self._steps_at, given, self._noted, before, inner.y, inner.dt, tuple(self._limits),
            inner.steps_done, most, inner._cursor, seen,
        )  # fmt: skip
        if not seen[TAKEN]:
            return status, before, inner.time, False
        inner.steps_done += int(seen[TAKEN]) - 1
        time = inner.time
        inner.steps_done += 1
        return status, before, time, bool(seen[LOUD])
