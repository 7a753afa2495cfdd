"""Points of a run, each a step and a time, in their order."""

from __future__ import annotations

import math

ROUNDING = 1e-12  # relative, for times that were converted between units


def same(point: tuple[int, float] | None, step: int, time: float) -> bool:
    """Tell whether a point is at this step and time. An adaptive run may have looks at several times inside one
    step."""
    return point is not None and point[0] == step and math.isclose(point[1], time, rel_tol=ROUNDING)


def before(time: float, other: float) -> bool:
    """Tell whether a time is earlier than another by more than rounding."""
    return time < other and not math.isclose(time, other, rel_tol=ROUNDING)


def behind(point: tuple[int, float], last: tuple[int, float]) -> bool:
    """Tell whether a (step, time) is earlier than the last one."""
    return point[0] < last[0] or (point[0] == last[0] and before(point[1], last[1]))
