"""Entries in the log of events: make, check and print them."""

from __future__ import annotations

from collections.abc import Sequence
from types import NoneType
from typing import Any

Row = dict[str, Any]  # entry in the log

LINES = 20  # events to print


def event_lines(events: Sequence[dict[str, Any]]) -> list[tuple[str, str]]:
    """Kind and details of the first events as text, then the number of further ones."""
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
    """Whether a row from a file is an entry in the log of events."""
    if not (isinstance(row, dict) and row.keys() == _ROW.keys()):
        return False
    return all(isinstance(row[key], kind) for key, kind in _ROW.items()) and all(
        isinstance(each, kind) for key, kind in (("bodies", str), ("ids", int)) for each in row[key]
    )
