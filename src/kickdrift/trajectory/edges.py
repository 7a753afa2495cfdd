"""The edges of a box as a run's file keeps them.

A box at right angles has three lengths for each frame, a box that leans its edge vectors, one a row. The edge along an
axis that is open is zero there: MDAnalysis takes any other for periodic.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError
from kickdrift.model.box import Box
from kickdrift.model.state import Floats
from kickdrift.trajectory.contents import Contents

EDGES = "particles/trajectory/box/edges/value"


def shape_of(box: Box) -> tuple[int, ...]:
    """(3,) of lengths, or (3, 3) of edge vectors: the shape of one frame's edges."""
    return (3, 3) if box.triclinic else (3,)


def stored(box: Box) -> Floats:
    """(3,) or (3, 3) a box's edges in its own unit. They are zero along axes that are open."""
    rows = np.where(np.array(box.periodic_axes)[:, None], box.matrix, 0.0)
    return rows if box.triclinic else np.diag(rows)


def restored(found: Floats, like: Box) -> Box:
    """The box with edges (3,) or (3, 3), periodic along the axes of another."""
    return Box(matrix=found if found.ndim == 2 else np.diag(found), periodic=like.periodic_axes)


def boxes(contents: Contents, first: Box, factor: float, chosen: slice) -> list[Box]:
    """The boxes of some frames, whose edges are stored times a factor; the ``first`` itself where they are its own."""
    there = contents.read(contents.series(EDGES, "f8", 0, shape_of(first)), chosen)
    found = [first] * len(there)
    for k in np.flatnonzero((there != stored(first) * factor).reshape(len(there), -1).any(axis=1)):
        try:
            found[k] = restored(there[k] / factor, first)
        except InputError as error:
            raise contents.damaged(f"{EDGES}: {error}") from None
    return found


def crossed(images: NDArray, first: Box, of_frames: list[Box]) -> Floats:
    """(f, n, 3) how far images (f, n, 3) are from the box, where most frames have the ``first`` box."""
    found = first.cartesian(images)
    for k, box in enumerate(of_frames):
        if box is not first:
            found[k] = box.cartesian(images[k])
    return found


def recorded(box: Box) -> list[float] | dict[str, Any] | None:
    """What the record says of a box: nothing, three lengths, or its matrix and the axes along which it is periodic."""
    if not box.triclinic and (box.vectors is None or all(box.periodic_axes)):
        return None if box.lengths is None else list(box.lengths)
    return {"matrix": box.matrix.tolist(), "periodic": list(box.periodic_axes)}


def box_of(contents: Contents, given: Any) -> Box:
    """The box that the record means."""
    try:
        return Box(**given) if isinstance(given, dict) else Box(None if given is None else tuple(given))
    except InputError as error:
        raise contents.damaged(f"kickdrift/system/record: {error}") from None
