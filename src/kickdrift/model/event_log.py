"""Rows of the log of events: their form, and lines for a reader."""

from __future__ import annotations

from collections.abc import Sequence
from types import NoneType
from typing import Any

LINES = 20  # of events that are shown


def event_lines(events: Sequence[dict[str, Any]]) -> list[tuple[str, str]]:
    """Events for a reader: kind and what was seen of each of the first ones, then how many more there are."""
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
    """Whether a row that comes from a file is an entry of the log of events."""
    if not (isinstance(row, dict) and row.keys() == _ROW.keys()):
        return False
    return all(isinstance(row[key], kind) for key, kind in _ROW.items()) and all(
        isinstance(each, kind) for key, kind in (("bodies", str), ("ids", int)) for each in row[key]
    )
