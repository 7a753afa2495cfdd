"""Formats to which a run can be exported, what each format keeps, and the frames in the form that the user wants.

The table serves the program and its page.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError
from kickdrift.model.box.box import Box
from kickdrift.model.state import Floats
from kickdrift.trajectory.read import reader
from kickdrift.trajectory.read.recorded import body_name

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


class Format(NamedTuple):
    """A format and the form in which it keeps each quantity; an empty text says that the quantity is lost."""

    suffix: str
    used_by: str
    package: str
    positions: str
    velocities: str = ""
    box: str = ""
    times: str = ""
    steps: str = ""
    masses: str = ""
    charges: str = ""
    names: str = ""
    bonds: str = ""
    nominal_positions: str = ""  # if different for nominal units
    removed: str = ""  # bodies that were removed during the run; an empty text refuses such a run
    single: bool = False  # whether a file holds one frame


KEPT = ("positions", "velocities", "box", "times", "steps", "masses", "charges", "names", "bonds")
LOST_BY_ALL = "forces, constraints, observables, events and restarts"
REMOVED_NAN = "as NaN"
REMOVED_LEFT_OUT = "left out from then on"

FORMATS: dict[str, Format] = {
    format.suffix: format
    for format in (
        Format(".dcd", "CHARMM, NAMD, LAMMPS, VMD", "MDAnalysis", positions="float32", box="float32",
            times="one spacing, float32", steps="one spacing", removed=REMOVED_NAN),
        Format(".xtc", "GROMACS, VMD", "MDAnalysis", positions="multiples of 0.01 angstrom",
            nominal_positions="multiples of 0.0001", box="float32", times="float32", steps="int32"),
        Format(".trr", "GROMACS, VMD", "MDAnalysis", positions="float32", velocities="float32", box="float32",
            times="float32", steps="int32", removed=REMOVED_NAN),
        Format(".xyz", "almost everything", "MDAnalysis", positions="float32, 8 decimals", times="in the comment line",
            steps="in the comment line", names="without spaces", removed=REMOVED_NAN),
        Format(".pdb", "viewers", "MDAnalysis", positions="3 decimals", box="3 decimals", names="first 4 letters",
            bonds="CONECT records"),
        Format(".extxyz", "ASE, OVITO", "ASE", positions="8 decimals", velocities="8 decimals", box="float64",
            times="float64", steps="int64", masses="8 decimals", charges="8 decimals",
            names="in the comment line", removed=REMOVED_LEFT_OUT),
        Format(".traj", "ASE", "ASE", positions="float64", velocities="float64, of bodies with a mass", box="float64",
            times="float64", steps="int64", masses="float64", charges="float64", names="in info",
            removed=REMOVED_LEFT_OUT),
        Format(".data", "LAMMPS, MDAnalysis, ASE, OVITO, kickdrift", "kickdrift", positions="float64, one frame",
            velocities="float64", box="float64", times="in the first line", steps="in the first line",
            masses="float64", charges="float64", names="species in comments", bonds="all lists with types",
            removed=REMOVED_LEFT_OUT, single=True),
        Format(".bin", "rebound, as a Simulationarchive", "rebound", positions="float64", velocities="float64",
            times="float64", steps="int64", masses="float64", names="each body's", removed=REMOVED_LEFT_OUT),
    )
}  # fmt: skip


def losses(format: Format, nominal: bool) -> str:
    """One line that says what an export keeps and what it loses; ``nominal`` says which units the run has."""
    ways = {what: getattr(format, what) for what in KEPT}
    if nominal and format.nominal_positions:
        ways["positions"] = format.nominal_positions
    kept = [f"{what} ({how})" for what, how in ways.items() if how]
    lost = [what for what, how in ways.items() if not how]
    return f"{format.suffix} keeps {', '.join(kept)}; loses {', '.join([*lost, LOST_BY_ALL])}"


def table() -> list[list[str]]:
    """The formats as rows of text: a heading, then a row for each format. An empty cell means that the quantity is
    lost."""
    rows = [["", "through", "read by", *KEPT, "removed bodies"]]
    for format in FORMATS.values():
        kept = [getattr(format, what) for what in KEPT]
        if format.nominal_positions:
            kept[0] += f"; {format.nominal_positions} in nominal units"
        rows.append([format.suffix, format.package, format.used_by, *kept, format.removed or "refused"])
    return rows
