"""Frames of a run that an export writes, each in the form that the user wants."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError
from kickdrift.model.box.box import Box
from kickdrift.model.state import Floats
from kickdrift.trajectory.read import reader
from kickdrift.trajectory.read.event_rows import body_name

BLOCK_FRAMES, BLOCK_BYTES = 32, 64 * 2**20  # frames read at once: a chunk of the file, unless frames are large


class Chosen:
    """Frames of a run to export, in order. Repeated iteration is possible.

    Attributes
    ----------
    run : Run
    frames : Frames
    first, every : int
        Number of the first frame, and the distance from one frame to the next.
    unwrapped : bool
    """

    def __init__(self, run: reader.Run, start: int | None, stop: int | None, step: int | None, unwrapped: bool) -> None:
        if step is not None and step < 1:
            raise InputError(f"step: expected a whole number of frames, 1 or more, got {step}")
        self.run, self.unwrapped = run, unwrapped
        self.first, _, self.every = slice(start, stop, step).indices(len(run))
        self.frames = run[start:stop:step]
        if not self.frames:
            which = "holds no frame" if not len(run) else f"has {len(run)} frames, none of them in start:stop"
            raise InputError(f"{run.path}: {which}")

    def __len__(self) -> int:
        return len(self.frames)

    def last(self) -> Chosen:
        """The last of these frames alone."""
        number = self.first + (len(self) - 1) * self.every
        return Chosen(self.run, number, number + 1, None, self.unwrapped)

    def __iter__(self) -> Iterator[Placed]:
        size = max(1, min(BLOCK_FRAMES // self.every, BLOCK_BYTES // (48 * len(self.run.ids))))
        for start in range(0, len(self), size):
            block = self.frames[start : start + size]
            x, v = (np.asarray(each, "f8") for each in (block.positions, block.velocities))
            for k, box in enumerate(block.boxes):
                place = x[k] if self.unwrapped else box.wrap(x[k])
                number = self.first + (start + k) * self.every
                yield Placed(number, int(block.steps[k]), float(block.times[k]), place, v[k], box, x[k])

    def who(self, frame: Placed, particle: int) -> str:
        """Text for an error about a particle: the frame, its step and the particle."""
        body = body_name(int(self.run.ids[particle]), self.run.ids, self.run.names)
        return f"frame {frame.number} (step {frame.step}): {body}"


class Placed(NamedTuple):
    """A frame in the run's units, with its particles wrapped into the box or not."""

    number: int
    step: int
    time: float
    positions: Floats
    velocities: Floats
    box: Box
    unwrapped: Floats

    @property
    def images(self) -> NDArray[np.int64]:
        """Whole edges of the box (n, 3) from each particle's place to its unwrapped position, in a periodic box. Every
        particle must be there."""
        return np.rint(self.box.fractional(self.unwrapped - self.positions)).astype(np.int64)
