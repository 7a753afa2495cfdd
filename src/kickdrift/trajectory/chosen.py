"""Frames of a run that are to be exported, each as it was asked for."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from kickdrift.errors import InputError
from kickdrift.model.box import Box
from kickdrift.model.state import Floats
from kickdrift.trajectory import reader
from kickdrift.trajectory.event_rows import body_name

BLOCK_FRAMES, BLOCK_BYTES = 32, 64 * 2**20  # read at once: the frames of a chunk, unless they are large


class Chosen:
    """The frames of a run that are to be exported, in order; can be gone through more than once.

    Attributes
    ----------
    run : Run
    frames : Frames
    first, every : int
        The number of the first frame, and from one to the next.
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

    def __iter__(self) -> Iterator[Placed]:
        size = max(1, min(BLOCK_FRAMES // self.every, BLOCK_BYTES // (48 * len(self.run.ids))))
        for start in range(0, len(self), size):
            block = self.frames[start : start + size]
            x, v = (np.asarray(each, "f8") for each in (block.positions, block.velocities))
            for k, box in enumerate(block.boxes):
                place = x[k] if self.unwrapped else box.wrap(x[k])
                number = self.first + (start + k) * self.every
                yield Placed(number, int(block.steps[k]), float(block.times[k]), place, v[k], box)

    def who(self, frame: Placed, particle: int) -> str:
        """Of a particle that an error is about: the frame, its step, and which one it is."""
        body = body_name(int(self.run.ids[particle]), self.run.ids, self.run.names)
        return f"frame {frame.number} (step {frame.step}): {body}"


class Placed(NamedTuple):
    """A frame in the run's units, its particles inside the box or not, as was asked for."""

    number: int
    step: int
    time: float
    positions: Floats
    velocities: Floats
    box: Box
