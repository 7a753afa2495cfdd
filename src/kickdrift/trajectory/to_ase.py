"""Frames of a run through ASE's writers: extended XYZ and ASE's own trajectories."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from kickdrift.errors import InputError
from kickdrift.state import Floats
from kickdrift.trajectory.export import Frames, Stored
from kickdrift.trajectory.formats import Format
from kickdrift.trajectory.universe import atomic_masses, chemical_symbols


def write(frames: Frames, path: Path, format: Format, progress: Callable[[int, int], None]) -> list[str]:
    """Write the frames; returns what had to be given up."""
    try:
        from ase.io.extxyz import write_extxyz
        from ase.io.trajectory import TrajectoryWriter
    except ImportError:
        raise InputError(f"{format.suffix} needs ASE: pip install kickdrift[ase]") from None
    atoms_of = AtomsOf(frames)
    with ExitStack() as stack:
        if format.suffix == ".traj":
            put = stack.enter_context(TrajectoryWriter(str(path))).write
        else:
            file = stack.enter_context(path.open("w", encoding="utf-8"))

            def put(atoms: Any) -> None:
                atoms.arrays["velocities"] = atoms_of.velocities  # momenta alone would lose those of small masses
                write_extxyz(file, [atoms])

        for done, frame in enumerate(frames, 1):
            put(atoms_of(frame))
            progress(done, len(frames))
    return ["bodies that were removed are left out from then on"] if atoms_of.gone else []


class AtomsOf:
    """Makes Atoms of frames, in ASE's units (angstrom, eV, u, and the time that follows from them).

    Nominal units keep their numbers, which makes their energies, masses and times agree as ASE's do. Species are the
    tags, and chemical symbols where each is one, else X. ``info`` has step, time (in ps, or the run's unit), time_unit,
    species, names where there are any, and the ids where bodies are missing.

    Attributes
    ----------
    velocities : (n, 3) of the last frame, in angstrom/ps or the run's units
    gone : whether bodies were missing in any frame
    """

    def __init__(self, frames: Frames) -> None:
        from ase.data import atomic_numbers

        self.frames, self.gone = frames, False
        run = frames.run
        self.symbols = np.array(chemical_symbols(run, atomic_numbers) or ["X"] * len(run.ids))
        self.masses = atomic_masses(run)

    def __call__(self, frame: Stored) -> Any:
        from ase import Atoms, units

        run, edges = self.frames.run, self.frames.edges
        there = np.isfinite(frame.positions).all(axis=1)
        self.velocities: Floats = frame.velocities[there]
        atoms = Atoms(
            self.symbols[there],
            positions=frame.positions[there],
            masses=self.masses[there],
            tags=run.species_index[there],
            cell=edges,
            pbc=edges is not None,
        )
        atoms.set_velocities(self.velocities / (1.0 if self.frames.units.nominal else 1000 * units.fs))
        time_unit = run.units.time if self.frames.units.nominal else "ps"
        atoms.info = {"step": frame.step, "time": frame.time, "time_unit": time_unit, "species": list(run.species)}
        if run.names:
            atoms.info["names"] = np.array(run.names)[there].tolist()
        if not there.all():
            atoms.info["ids"] = run.ids[there].tolist()
            self.gone = True
        return atoms
