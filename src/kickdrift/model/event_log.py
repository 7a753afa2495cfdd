"""Entries in the log of events: make, check and print them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from types import NoneType
from typing import TYPE_CHECKING, Any

from kickdrift.model.system import System

if TYPE_CHECKING:
    from kickdrift.model.problem import Problem

Row = dict[str, Any]  # entry in the log
LINES = 20  # events to print


def event_lines(events: Sequence[dict[str, Any]]) -> list[tuple[str, str]]:
    """Kind and details of the first events as text, then the number of the others."""
    rows = []
    for event in events[:LINES]:
        about = [f"t = {event['time']:.9g}"]
        about += [" – ".join(event["bodies"])] if event["bodies"] else []
        about += [f"distance {event['distance']:.6g}"] if event["distance"] is not None else []
        about += [event["done"]] if event["done"] not in ("logged", "passed") else []
        rows.append((event["kind"], ", ".join(about)))
    if len(events) > LINES:
        rows.append(("", f"and {len(events) - LINES:,} more events"))
    return rows


_NUMBER = (int, float)
_ROW: dict[str, Any] = {
    "kind": str, "time": _NUMBER, "step": int, "bodies": list, "ids": list, "distance": (*_NUMBER, NoneType),
    "energy": (*_NUMBER, NoneType), "done": str,
}  # fmt: skip


def is_row(row: Any) -> bool:
    """Tell whether a row from a file is an entry in the log of events."""
    if not (isinstance(row, dict) and row.keys() == _ROW.keys()):
        return False
    return all(isinstance(row[key], kind) for key, kind in _ROW.items()) and all(
        isinstance(each, kind) for key, kind in (("bodies", str), ("ids", int)) for each in row[key]
    )


def entry(
    system: System | Problem, kind: str, time: float, step: int, bodies: Sequence[int], distance: float, done: str
) -> Row:
    """Entry in the log; ``bodies`` are rows of the system."""
    ids = [int(system.state.ids[i]) for i in bodies] if isinstance(system, System) else []
    names = [system.body(i) for i in bodies] if isinstance(system, System) else []
    return {
        "kind": kind,
        "time": float(time),
        "step": int(step),
        "bodies": names,
        "ids": ids,
        "distance": float(distance) if math.isfinite(distance) else None,
        "energy": None,
        "done": done,
    }
