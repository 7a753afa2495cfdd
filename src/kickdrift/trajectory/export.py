"""A run's file in the formats of other programs, through the writers of MDAnalysis and ASE."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

import numpy as np

from kickdrift.disk import kinds
from kickdrift.disk.outputs import checked_target, written_whole
from kickdrift.errors import InputError
from kickdrift.model.box import Box
from kickdrift.model.state import Floats
from kickdrift.trajectory import reader
from kickdrift.trajectory.event_rows import body_name
from kickdrift.trajectory.formats import FORMATS, losses

BLOCK_FRAMES, BLOCK_BYTES = 32, 64 * 2**20  # read at once: the frames of a chunk, unless they are large
_WRITERS = {"MDAnalysis": "to_mdanalysis", "ASE": "to_ase"}


class Exported(NamedTuple):
    """What came of an export; ``losses`` is one line, ``notes`` are what this very run had to give up besides."""

    path: Path
    frames: int
    particles: int
    losses: str
    notes: tuple[str, ...]


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


def export(
    path: str | os.PathLike[str],
    output: str | os.PathLike[str],
    *,
    unwrapped: bool = False,
    start: int | None = None,
    stop: int | None = None,
    step: int | None = None,
    overwrite: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Exported:
    """Write frames of a run's file in another format, which the suffix names: .dcd, .xtc, .trr, .xyz, .pdb, .extxyz, …

    Through MDAnalysis lengths are in angstrom and times in ps, and where the file's units are nominal, numbers are the
    run's; through ASE they are in ASE's units, as `System.to_ase` has them, with times in the run's. XTC is read back:
    no position is off by more than 1e-4 in nominal units, or 0.01 angstrom.

    Parameters
    ----------
    path : a run's file
    output : the new file; it is written whole or not at all
    unwrapped : positions as the run has them; else inside the box, as most programs want them
    start, stop, step : of the frames, as in a slice
    overwrite : replace a file of that name
    progress : called with the frames done and their number

    Raises
    ------
    InputError
        Where the format cannot hold the run (it names the frame and the particle), MDAnalysis or ASE is missing, or a
        name is wrong. There is no new file then.
    """
    kind = kinds.export(Path(output).suffix, tuple(FORMATS))
    target = checked_target(output, kind, overwrite, [path])
    format = FORMATS[target.suffix.lower()]
    write = import_module(f"kickdrift.trajectory.{_WRITERS[format.package]}").write
    with reader.open(path) as run, written_whole(target, kind, overwrite=overwrite) as part:
        frames = Chosen(run, start, stop, step, unwrapped)
        notes = write(frames, part, format, progress or (lambda done, of: None))
        if run.box.periodic and not unwrapped:
            notes = ["positions are inside the box", *notes]
        return Exported(target, len(frames), len(run.ids), losses(format, run.nominal_units), tuple(notes))
