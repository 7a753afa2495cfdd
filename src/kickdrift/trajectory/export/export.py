"""Export of a run's file to formats of other programs, through MDAnalysis, ASE, rebound and writers of our own."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from kickdrift.disk import kinds
from kickdrift.disk.outputs import checked_target, written_whole
from kickdrift.display.showing import following
from kickdrift.forces.around.spins import SPINS
from kickdrift.forces.beside.unknowns import names_in
from kickdrift.trajectory.export import to_ase, to_lammps, to_mdanalysis, to_rebound
from kickdrift.trajectory.export.formats import FORMATS, Chosen, Format, losses
from kickdrift.trajectory.read import reader
from kickdrift.trajectory.read.universe import topology_of

_WRITERS = {
    "MDAnalysis": to_mdanalysis.write,
    "ASE": to_ase.write,
    "rebound": to_rebound.write,
    ".data": to_lammps.write,
}


def _inside(joined: bool, format: Format) -> str:
    """Note on positions inside the box, with what becomes of molecules."""
    if not joined:
        return "positions are inside the box"
    if format.single:
        return "positions are inside the box, with image flags that make molecules whole"
    return "positions are inside the box, so molecules that cross a face are cut; --unwrapped keeps them whole"


class Exported(NamedTuple):
    """Result of an export. ``losses`` is one line; ``notes`` say what was lost from this run in particular."""

    path: Path
    frames: int
    particles: int
    losses: str
    notes: tuple[str, ...]


def export(
    path: str | os.PathLike[str],
    output: str | os.PathLike[str],
    *,
    unwrapped: bool = False,
    start: int | None = None,
    stop: int | None = None,
    step: int | None = None,
    overwrite: bool = False,
    progress: bool | Callable[[int, int], Any] | None = None,
) -> Exported:
    """Write frames of a run's file in another format, which the suffix names: .dcd, .xtc, .trr, .xyz, .pdb, …, .data.

    Through MDAnalysis lengths are in angstrom and times in ps; if the file's units are nominal, numbers are the run's.
    Through ASE numbers are in ASE's units, as in `System.to_ase`, and times in the run's. An XTC file is read back to
    check that no position is off by more than 1e-4 in nominal units, or 0.01 angstrom. A data file of LAMMPS (.data)
    holds the last of the chosen frames, with the run's numbers and its topology. A .bin file is an
    archive of rebound with a snapshot for each frame, in the run's units.

    Parameters
    ----------
    path : a run's file
    output : the new file; it is written whole or not at all
    unwrapped : positions as the run has them; else inside the box, as most programs want them
    start, stop, step : the chosen frames, as in a slice
    overwrite : replace a file of that name
    progress : True shows a bar; a function is called with the frames done and their number

    Raises
    ------
    InputError
        The format cannot hold the run (the error names the frame and the particle), MDAnalysis, ASE or rebound is
        missing, or a name is wrong. Then no new file is left.
    """
    kind = kinds.export(Path(output).suffix, tuple(FORMATS))
    target = checked_target(output, kind, overwrite, [path])
    format = FORMATS[target.suffix.lower()]
    with (
        reader.open(path) as run,
        following(progress, "exporting") as told,
        written_whole(target, kind, overwrite=overwrite) as part,
    ):
        frames = Chosen(run, start, stop, step, unwrapped)
        if format.single:
            frames = frames.last()
        write = _WRITERS[format.suffix if format.suffix in _WRITERS else format.package]
        notes = write(frames, part, format, told or (lambda done, of: None))
        if SPINS in run.columns:
            notes = [*notes, "spins are lost"]
        if names := names_in(run.system_record):
            notes = [*notes, f"unknowns are lost: {', '.join(names)}"]
        if run.box.periodic and not unwrapped:
            notes = [_inside(topology_of(run) is not None, format), *notes]
        if unwrapped and run.box_varies:
            notes = ["unwrapped positions scale with the box; take displacements from the run's file", *notes]
        return Exported(target, len(frames), len(run.ids), losses(format, run.nominal_units), tuple(notes))
