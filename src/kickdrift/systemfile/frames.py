"""Particles of a system file from a frame of a run's file."""

from pathlib import Path

from kickdrift.display.showing import above
from kickdrift.errors import InputError
from kickdrift.model.starts.builders import Structure
from kickdrift.model.system import System
from kickdrift.model.units.unit_systems import UnitSystem
from kickdrift.systemfile.files import prefixed
from kickdrift.systemfile.particles import charges_of
from kickdrift.systemfile.schema import FileTable, SystemTable

SUFFIX = ".h5md"  # of runs of particles
_OTHERS = (".h5", ".csv", ".parquet")  # of runs of Problems, and of ensembles


def frame_system(table: SystemTable, units: UnitSystem, folder: Path) -> System | None:
    """System at the frame that ``[particles]`` names, without forces and events; None for other particles."""
    particles = table.particles
    if not isinstance(particles, FileTable) or "\0" in particles.file:
        return None
    path = folder / particles.file
    if path.suffix.lower() != SUFFIX:
        if path.suffix.lower() in _OTHERS:
            raise InputError(f"particles.file: {path} has no frames of particles; a run of particles ends in {SUFFIX}")
        if particles.frame is not None:
            raise InputError(f"particles.frame: is for the file of a run ({SUFFIX}), and {path} is none")
        return None
    if particles.atom_style is not None:
        raise InputError(f"particles.atom_style: is for data files of LAMMPS, and {path} is none")
    with prefixed("particles.file: "):
        found: System = above("System of a frame")(path, particles.frame)
    if found.units != units:
        raise InputError(f'units: the run of {path} is in units = "{found.units.name}", got "{units.name}"')
    if found.dimensions != table.dimensions:
        raise InputError(
            f"dimensions: the run of {path} has {found.dimensions} dimensions; expected dimensions = {found.dimensions}"
        )
    return found


def structure_of(frame: System, particles: FileTable, boxed: bool) -> Structure:
    """Particles of a frame. Its box is left out if the system file has edges of its own (``boxed``)."""
    state, box = frame.state, frame.box
    species = [frame.species[k] for k in frame.species_index]
    given = charges_of(particles, species)
    return Structure(
        state.positions,
        state.masses,
        species,
        box.matrix if box.periodic and not boxed else None,
        box.periodic_axes if box.periodic else False,
        state.velocities,
        frame.names,
        None if frame.radii is None else frame.radii.tolist(),
        frame.charges if given is None else given,
    )
