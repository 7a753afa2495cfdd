"""Frames of a run as a Simulationarchive of rebound."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from kickdrift.model.bridged import bridge
from kickdrift.trajectory.export.formats import REMOVED_LEFT_OUT, Chosen, Format
from kickdrift.trajectory.read.reader import masses_held


def write(chosen: Chosen, path: Path, format: Format, progress: Callable[[int, int], None]) -> list[str]:
    """Write a snapshot for each frame and return notes about what was lost."""
    bridge("rebound", format.suffix)
    from kickdrift.bridges.rebound import Archive

    run = chosen.run
    archive = Archive(path, run.system())
    for done, frame in enumerate(chosen, 1):
        x, v = frame.positions.copy()[None], frame.velocities.copy()[None]
        masses = masses_held(run, [frame.number], x, v)[0]
        if np.isnan(x).any() and (note := f"bodies that were removed are {REMOVED_LEFT_OUT}") not in archive.notes:
            archive.notes.append(note)
        archive.append(x[0], v[0], masses, frame.time, frame.step)
        progress(done, len(chosen))
    archive.check()
    return archive.notes
