"""Edges of a box in a run's file.

A rectangular box has three lengths in each frame, a leaning box its edge vectors, one a row. So has a box that changes
its shape during the run, also while it is rectangular. The edge along an open
axis is zero in the file, because MDAnalysis takes any other edge as periodic.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError
from kickdrift.model.box.box import Box
from kickdrift.model.state import Floats
from kickdrift.trajectory.layout.contents import Contents

EDGES = "particles/trajectory/box/edges/value"


def shape_of(box: Box, free: bool = False) -> tuple[int, ...]:
    """Shape of one frame's edges: (3,) for lengths, or (3, 3) for edge vectors, as of a box that is ``free`` to change
    its shape."""
    return (3, 3) if free or box.triclinic else (3,)


def shape_in(contents: Contents, box: Box) -> tuple[int, ...]:
    """Shape of one frame's edges in a file, for a run that begins in this box."""
    return shape_of(box, getattr(contents.anything(EDGES), "ndim", 0) == 3)


def stored(box: Box, free: bool = False) -> Floats:
    """Edges of a box in its own unit, in the shape of `shape_of`, zero along open axes."""
    rows = np.where(np.array(box.periodic_axes)[:, None], box.matrix, 0.0)
    return rows if free or box.triclinic else np.diag(rows)


def restored(found: Floats, like: Box) -> Box:
    """Box with edges (3,) or (3, 3), periodic along the same axes as ``like``."""
    return Box(matrix=found if found.ndim == 2 else np.diag(found), periodic=like.periodic_axes)


def boxes(
    contents: Contents, first: Box, factor: float, chosen: slice, whole: NDArray[np.bool_] | None = None
) -> list[Box]:
    """Boxes of some frames; the file stores edges times ``factor``. A frame with the ``first`` box's edges gets that
    very object, and so do frames that the mask ``whole`` (frames,) leaves out."""
    shape = shape_in(contents, first)
    there = contents.read(contents.series(EDGES, "f8", 0, shape), chosen)
    found = [first] * len(there)
    other = (there != stored(first, len(shape) == 2) * factor).any(axis=tuple(range(1, there.ndim)))
    for k in np.flatnonzero(other if whole is None else other & whole):
        try:
            found[k] = restored(there[k] / factor, first)
        except InputError as error:
            raise contents.damaged(f"{EDGES}: {error}") from None
    return found


def crossed(images: NDArray, first: Box, of_frames: list[Box]) -> Floats:
    """Displacements (f, n, 3) from the box that belong to images (f, n, 3). Most frames have the ``first`` box."""
    found = first.cartesian(images)
    for k, box in enumerate(of_frames):
        if box is not first:
            found[k] = box.cartesian(images[k])
    return found


def recorded(box: Box) -> list[float] | dict[str, Any] | None:
    """Value of a box in the record: None, three lengths, or the matrix and the periodic axes."""
    if not box.triclinic and (box.vectors is None or all(box.periodic_axes)):
        return None if box.lengths is None else list(box.lengths)
    return {"matrix": box.matrix.tolist(), "periodic": list(box.periodic_axes)}


def box_of(contents: Contents, given: Any) -> Box:
    """Box from its value in the record."""
    try:
        return Box(**given) if isinstance(given, dict) else Box(None if given is None else tuple(given))
    except InputError as error:
        raise contents.damaged(f"kickdrift/system/record: {error}") from None
