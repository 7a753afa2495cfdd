"""Events of a run's file, in the form of ``Simulation.events``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kickdrift.trajectory.layout import header
from kickdrift.trajectory.layout.contents import Contents
from kickdrift.trajectory.layout.header import EVENT_COLUMNS


def event_rows(
    contents: Contents, count: int, whole: Sequence[int], ids: NDArray[np.int64], names: Sequence[str]
) -> list[dict[str, Any]]:
    """Events in the rows ``whole`` of a file with ``count`` events. Bodies have these ids (n,) and names, if any."""
    columns = {
        name: contents.read(header.event_column(contents, name, count), slice(count)).tolist() for name in EVENT_COLUMNS
    }
    found = []
    for k in whole:
        row = {name: values[k] for name, values in columns.items()}
        there = [each for each in row["ids"] if each >= 0]
        found.append(
            {
                "kind": row["kind"].decode(errors="ignore"),
                "time": row["time"],
                "step": row["step"],
                "bodies": [body_name(each, ids, names) for each in there],
                "ids": there,
                "distance": None if np.isnan(row["distance"]) else row["distance"],
                "energy": None if np.isnan(row["energy"]) else row["energy"],
                "done": row["done"].decode(errors="ignore"),
            }
        )
    return found


def body_name(id_: int, ids: NDArray[np.int64], names: Sequence[str]) -> str:
    """Name of the body with an id, or a text for a body without a name."""
    place = np.flatnonzero(ids == id_)
    return names[int(place[0])] if names and place.size else f"particle {id_}"
