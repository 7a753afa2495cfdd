"""A run's file in the formats of other programs, through the writers of MDAnalysis and ASE."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

import numpy as np

from kickdrift.errors import InputError
from kickdrift.outputs import checked_target, written_whole
from kickdrift.state import Floats
from kickdrift.trajectory import reader
from kickdrift.trajectory.formats import FORMATS, losses
from kickdrift.trajectory.layout import TRAJECTORY, FileUnits
from kickdrift.trajectory.universe import spacing

BLOCK_FRAMES, BLOCK_BYTES = 32, 64 * 2**20  # read at once: the frames of a chunk, unless they are large
_WRITERS = {"MDAnalysis": "to_mdanalysis", "ASE": "to_ase"}


class Exported(NamedTuple):
    """What came of an export; ``losses`` is one line, ``notes`` are what this very run had to give up besides."""

    path: Path
    frames: int
    particles: int
    losses: str
    notes: tuple[str, ...]


class Stored(NamedTuple):
    """A frame as the file has it, in angstrom and ps, which in nominal units stand for the run's own."""

    number: int
    step: int
    time: float
    positions: Floats
    velocities: Floats


class Frames:
    """The frames of a run that were chosen, in order; can be gone through more than once.

    Attributes
    ----------
    run : Run
    indices : range
    dt, even : time between frames in ps, the mean where it is not even
    edges : (3,) of the box in angstrom, or None
    unwrapped : bool
    """

    def __init__(self, run: reader.Run, start: int | None, stop: int | None, step: int | None, unwrapped: bool) -> None:
        if step is not None and step < 1:
            raise InputError(f"step: expected a whole number of frames, 1 or more, got {step}")
        self.run, self.unwrapped = run, unwrapped
        self.indices = range(*slice(start, stop, step).indices(len(run)))
        if not self.indices:
            which = "holds no frame" if not len(run) else f"has {len(run)} frames, none of them in start:stop"
            raise InputError(f"{run.path}: {which}")
        self.units = FileUnits.of(run.units)
        self.dt, self.even = spacing(run, self.indices)
        self.edges = None if run.box.lengths is None else np.array(run.box.lengths) * self.units.length

    def __len__(self) -> int:
        return len(self.indices)

    def __iter__(self) -> Iterator[Stored]:
        run, file = self.run, self.run._file[TRAJECTORY]
        block = max(1, min(BLOCK_FRAMES // self.indices.step, BLOCK_BYTES // (48 * len(run.ids))))
        for first in range(0, len(self), block):
            part = self.indices[first : first + block]
            rows = slice(part.start, part[-1] + 1, part.step)
            x, v = (np.asarray(file[name]["value"][rows], "f8") for name in ("position", "velocity"))
            for k, index in enumerate(part):
                time = float(run.times[index]) * self.units.time
                yield Stored(index, int(run.steps[index]), time, self._placed(x[k]), v[k])

    def _placed(self, positions: Floats) -> Floats:
        if self.unwrapped or self.edges is None:
            return positions
        return type(self.run.box)(tuple(self.edges)).wrap(positions)

    def who(self, frame: Stored, particle: int) -> str:
        """Of a particle that an error is about: the frame, its step, and which one it is."""
        body = self.run._body(int(self.run.ids[particle]))
        return f"frame {frame.number} (step {frame.step}): {body}"


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

    Lengths are in angstrom and times in ps (in ASE's formats: its own units, with times in ps); a run in nominal units
    keeps its numbers. XTC is read back: no position is off by more than 1e-4 in nominal units, or 0.01 angstrom.

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
    target = checked_target(output, "the name of an export", FORMATS, overwrite)
    format = FORMATS[target.suffix.lower()]
    write = import_module(f"kickdrift.trajectory.{_WRITERS[format.package]}").write
    with reader.open(path) as run, written_whole(target, overwrite=overwrite) as part:
        frames = Frames(run, start, stop, step, unwrapped)
        notes = write(frames, part, format, progress or (lambda done, of: None))
        if run.nominal_units:
            notes = [f"{run.units.length} and {run.units.time} stand as angstrom and ps", *notes]
        if run.box.periodic and not unwrapped:
            notes = ["positions are inside the box", *notes]
        return Exported(target, len(frames), len(run.ids), losses(format, run.nominal_units), tuple(notes))
