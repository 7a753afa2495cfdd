"""Frames of a run through ASE's writers: extended XYZ and ASE's own trajectories."""

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from kickdrift.errors import InputError
from kickdrift.looks.columns import BODY_MASSES
from kickdrift.model.units.file_units import elementary_charge
from kickdrift.trajectory.export.formats import REMOVED_LEFT_OUT, Chosen, Format, Placed
from kickdrift.trajectory.read.universe import species


def write(chosen: Chosen, path: Path, format: Format, progress: Callable[[int, int], None]) -> list[str]:
    """Write the frames and return notes about what was lost."""
    try:
        from ase.io.extxyz import write_extxyz
        from ase.io.trajectory import TrajectoryWriter
    except ImportError:
        raise InputError(f"{format.suffix} needs ASE: pip install 'kickdrift[ase]'") from None
    atoms_of = AtomsOf(chosen)
    with ExitStack() as stack:
        if format.suffix == ".traj":
            put = stack.enter_context(TrajectoryWriter(str(path))).write
        else:
            file = stack.enter_context(path.open("w", encoding="utf-8"))

            def put(atoms: Any) -> None:
                atoms.arrays["velocities"] = atoms_of.velocities  # 8 decimals of a small momentum would lose digits
                if atoms_of.kinds is not None:
                    atoms.arrays["kind"] = atoms_of.kinds[atoms_of.present]  # where all symbols are X
                write_extxyz(file, [atoms])

        for done, frame in enumerate(chosen, 1):
            put(atoms_of(frame))
            progress(done, len(chosen))
    return atoms_of.notes


class AtomsOf:
    """Converter from frames to Atoms in ASE's units, as in `System.to_ase`.

    Tags are the species. Chemical symbols are the species if all are elements and units are real, else X. ``info`` has
    step, time and time_unit (the run's), species, names if there are any, ids if bodies are missing, and dimensions if
    they are two.

    Attributes
    ----------
    velocities : (n, 3) of the last frame, in ASE's units
    present : (n,) which particles the last frame has
    kinds : (n,) species of each particle, None if these are the chemical symbols
    notes : what was lost
    """

    def __init__(self, chosen: Chosen) -> None:
        from kickdrift.bridges.ase import DIMENSIONS, UNKNOWN, Scale, symbols_of

        run = chosen.run
        self.run, self.scale, self.notes = run, Scale.of(run.units), list[str]()
        if run.nominal_units:
            units = run.units
            self.notes.append(f"{units.length}, {units.mass} and {units.energy} stand as angstrom, u and eV")
        given = dict.fromkeys(run.species, UNKNOWN) if run.nominal_units else {}
        symbol, kinds = symbols_of(run.species, given), species(run)
        self.symbols = np.array([symbol[kind] for kind in kinds])
        self.kinds = np.array(kinds) if UNKNOWN in symbol.values() else None
        self.changing = BODY_MASSES in run.columns
        tables = run.system_record.get("fixed") or []
        self.still = np.array([i for each in tables if "velocity" not in each for i in each["particles"]], np.int64)
        if any("velocity" in each for each in tables):
            self.notes.append("fixed particles at a given velocity are free")
        self.plane = {DIMENSIONS: 2} if run.system_record.get("dimensions") == 2 else {}

    def __call__(self, frame: Placed) -> Any:
        from ase import Atoms
        from ase.constraints import FixAtoms

        run = self.run
        masses = self._masses(frame.number)
        there = np.isfinite(frame.positions).all(axis=1) & np.isfinite(masses)
        self.velocities = frame.velocities[there] / self.scale.velocity
        self.present = there
        atoms = Atoms(
            self.symbols[there],
            positions=frame.positions[there] / self.scale.length,
            masses=masses[there] / self.scale.mass,
            tags=run.species_index[there],
            cell=frame.box.matrix / self.scale.length,
            pbc=frame.box.periodic_axes,
        )
        atoms.set_velocities(self.velocities)
        if len(self.still):  # with events, of which bodies may leave, nothing is fixed
            atoms.set_constraint(FixAtoms(self.still))
        if run.charges is not None:
            atoms.set_initial_charges(run.charges[there] / elementary_charge(run.units))
        atoms.info = {
            "step": frame.step,
            "time": frame.time,
            "time_unit": run.units.time,
            "species": list(run.species),
            **self.plane,
        }
        if run.names:
            atoms.info["names"] = np.array(run.names)[there].tolist()
        if not there.all():
            atoms.info["ids"] = run.ids[there].tolist()
            note = f"bodies that were removed are {REMOVED_LEFT_OUT}"
            if self.changing:
                note = "bodies that are no longer there, or not yet, are left out"
            if note not in self.notes:
                self.notes.append(note)
        return atoms

    def _masses(self, frame: int) -> Any:
        """Masses (n,) at a frame; nan for a body that is not there, if collisions change the masses."""
        return self.run[frame : frame + 1].observables[BODY_MASSES][0] if self.changing else self.run.masses
