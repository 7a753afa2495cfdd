"""Volume, density and edges of a run's box over time, where a barostat changes the box."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from kickdrift.looks.record import even_stretch
from kickdrift.model.box.box import Box
from kickdrift.model.state import Floats
from kickdrift.statistics.blocks import block_average
from kickdrift.trajectory.layout.run_parts import RunRecord
from kickdrift.trajectory.read.recorded import Samples

VOLUME = "volume"  # a column of the samples of a run with a barostat


class Boxed(RunRecord, Protocol):
    """A run's file with its boxes; see ``Run``."""

    def whole_samples(self) -> Samples:
        """Samples that are not damaged."""

    def whole_boxes(self) -> tuple[NDArray[np.int64], Floats, list[Box]]:
        """Steps, times and boxes of the frames that are not damaged."""


class Room(NamedTuple):
    """The box of each whole frame.

    Attributes
    ----------
    steps, times : (f,) of the frames
    lengths : (f, 3) diagonals of the edge vectors: the edge lengths of a rectangular box
    volume : (f,) volumes, in two dimensions areas
    density : (f,) particles per volume or area
    """

    steps: NDArray[np.int64]
    times: Floats
    lengths: Floats
    volume: Floats
    density: Floats


def room_of(run: Boxed) -> Room | None:
    """The box over time; None if all frames have the box of the run's System, or if the box has no volume."""
    steps, times, boxes = run.whole_boxes()
    plane = run.system_record.get("dimensions") == 2
    if not run.box_varies or not boxes:
        return None
    volume = np.array([box.area if plane else box.volume for box in boxes])
    if not np.isfinite(volume).all():
        return None
    lengths = np.array([np.diag(box.matrix) for box in boxes])
    return Room(steps, times, lengths, volume, len(run.ids) / volume)


def means_of(run: Boxed) -> dict[str, dict[str, float | None]]:
    """Mean volume and density with standard errors (None if the run is too short): over the samples if these have the
    volume, else over the frames. Empty for a box that is fixed or open."""
    room, samples = room_of(run), run.whole_samples()
    if VOLUME in samples.observables:
        steps, volume = samples.steps, samples.observables[VOLUME]
    elif room is not None:
        steps, volume = room.steps, room.volume
    else:
        return {}
    return {"volume": _mean(steps, volume), "density": _mean(steps, len(run.ids) / volume)}


def _mean(steps: NDArray[np.int64], values: Floats) -> dict[str, float | None]:
    error = float(block_average(values[even_stretch(steps)]).error)
    return {"mean": float(values.mean()), "error": error if np.isfinite(error) else None}
