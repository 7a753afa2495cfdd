"""States inside a step of the hybrid map, where bodies that meet move on paths of their own."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kickdrift.model.state import Floats


def points_inside(
    rows: Floats, order: NDArray[np.int64], central: int, before: Floats, after: Floats, begin: float, h: float
) -> list[tuple[float, Floats]]:
    """Times and states (2, 3, n) between the ends of a step, at each time of ``rows`` (see ``state``).

    The central body moves on a straight line. A body without rows follows Hermite's cubic between the ends of the step.
    A body with rows follows cubics between its points. These paths are shifted so that they begin and end at the ends
    of the step. The map shifts all bodies that meet by the same way, so the distances between them stay.
    """
    rows = rows[rows[:, 1] >= 0.0]  # no copies
    times = np.unique(rows[:, 0])
    times = times[(times > 0.0) & (times < h)]
    if not len(times):
        return []
    s = (times / h)[:, None, None]
    found = np.empty((len(times), 2, *before.shape[1:]))
    found[:, 0], found[:, 1] = cubics(s, before, after, h)
    line = before[0, :, central] + s[:, 0] * (after[0, :, central] - before[0, :, central])
    found[:, 0, :, central] = line
    found[:, 1, :, central] = (after[0, :, central] - before[0, :, central]) / h
    for slot in np.unique(rows[:, 1].astype(np.int64)):
        own, body = rows[rows[:, 1] == slot], order[slot]
        own = own[np.argsort(own[:, 0], kind="stable")]
        first, last = before[0, :, body] - own[0, 2:5], after[0, :, body] - own[-1, 2:5]
        place = np.clip(np.searchsorted(own[:, 0], times, side="right") - 1, 0, len(own) - 2)
        left, right = own[place], own[place + 1]
        length = (right[:, 0] - left[:, 0])[:, None]
        part = (times[:, None] - left[:, :1]) / length
        start, end = (np.array([each[:, 2:5], each[:, 5:8]]) for each in (left, right))
        x, v = cubics(part, start, end, length)
        found[:, 0, :, body] = x + first + s[:, 0] * (last - first)
        found[:, 1, :, body] = v + (last - first) / h
    return [(begin + float(time), np.ascontiguousarray(y)) for time, y in zip(times, found, strict=True)]


def cubics(s: Floats, start: Floats, end: Floats, h: Floats | float) -> tuple[Floats, Floats]:
    """Positions and velocities at fractions s of Hermite's cubic between two states (2, ...), a time h apart."""
    x0, v0, x1, v1 = start[0], h * start[1], end[0], h * end[1]
    b, a = 3.0 * (x1 - x0) - 2.0 * v0 - v1, 2.0 * (x0 - x1) + v0 + v1
    return x0 + s * (v0 + s * (b + s * a)), (v0 + s * (2.0 * b + 3.0 * s * a)) / h
