"""Systems and Problems from system files. Each error is an InputError of one line: file, key, expected value."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from warnings import warn

import numpy as np

from kickdrift.disk.foreign import is_lammps_input
from kickdrift.disk.kinds import is_archive, may_be_snapshot
from kickdrift.disk.packed import is_packed, unpacked
from kickdrift.errors import InputError
from kickdrift.forces import FORCES
from kickdrift.integrators.asked import draws_noise
from kickdrift.model.box.box import Box
from kickdrift.model.bridged import bridge
from kickdrift.model.checks.arguments import other_name
from kickdrift.model.checks.values import no_overflow, whole_number
from kickdrift.model.fixed import Fixed
from kickdrift.model.orbits import G_given
from kickdrift.model.problem import Problem
from kickdrift.model.starts.builders import Structure, check_overlaps, drawn_velocities, nominal_units, read_structure
from kickdrift.model.starts.coordinates import to_barycentric
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.model.units.unit_systems import UNIT_SYSTEMS, UnitSystem, unit_system
from kickdrift.systemfile import schema
from kickdrift.systemfile.clusters import stars_of
from kickdrift.systemfile.events import events_of
from kickdrift.systemfile.files import PARAMETERS, STRUCTURES, find, parsed, plain, prefixed, toml_table
from kickdrift.systemfile.force_fields import force_field_system, refuse_files, told_system
from kickdrift.systemfile.frames import frame_system, structure_of
from kickdrift.systemfile.particles import (
    as_given,
    box_of,
    charges_of,
    constraint_of,
    edges_given,
    fixed_of,
    molecules_of,
    on_lattice,
    on_orbits,
    on_walks,
)
from kickdrift.systemfile.schema_base import ElementsTable, KingTable, PlummerTable
from kickdrift.systemfile.schema_run import equilibration_of, run_defaults, stage_of
from kickdrift.text import choices, shown, suggestion

_BESIDE_ODE = tuple(key for key in schema.OdeFileTable.model_fields if key != "ode")


def load(
    name_or_path: str | os.PathLike[str] | Mapping[str, Any],
    seed: int | None = None,
    overlaps: bool = False,
    snapshot: int | None = None,
    *,
    coordinates: str | os.PathLike[str] | None = None,
    force_field: str | Sequence[str] | None = None,
    cutoff: float | str | None = None,
    rigid: str | None = None,
) -> System | Problem:
    """Load the System of a TOML file, or of a shipped system's name (``lj-1000``); a file with [ode] gives a Problem.

    Files of atoms such as .xyz, .extxyz, .pdb and .cif are read through ASE, in metal units and without forces, also
    packed by gzip or bzip2 (.extxyz.gz). Inputs of LAMMPS are read through LAMMPS, as by ``System.from_lammps``.
    Simulationarchives of rebound are read through rebound, as by ``System.from_rebound``. Snapshots of AMUSE, NEMO and
    GADGET are read as by ``System.from_snapshot``. Files of force fields are
    read through OpenMM, as by ``System.from_openmm``: ``.prmtop`` of AMBER, ``.top`` of GROMACS and ``.psf`` of CHARMM
    with ``coordinates``, and ``.pdb`` or ``.cif`` with ``force_field``.

    Parameters
    ----------
    name_or_path : a path, one of ``shipped()``, or a dict with the tables of a system file
        In a dict, arrays and tuples are lists, and structure files are searched in the current folder.
    seed : replaces the file's ``velocities.seed``
    overlaps : whether particles may overlap, for ``Simulation.minimize``, which moves them apart
        Only system files are checked; particles of other files may always overlap.
    snapshot : of an archive of rebound or a file of AMUSE or NEMO, from 0; negative from the end; default the last
    coordinates : file of the coordinates, such as .inpcrd, .rst7, .gro, .crd or .pdb
    force_field : files of the force field: OpenMM's XML for a structure, such as ("amber14-all.xml", "tip3p.xml"),
        CHARMM's parameters for .psf, or the folder of GROMACS' force fields for .top
    cutoff : of pair forces in a periodic box, in nm or as text with a unit; default 1 nm
    rigid : "hydrogen" (default), all bonds to hydrogen and water; "water"; or "none"

    Raises
    ------
    InputError
        Names the file, the key and the expected value, or the particles that overlap.
    """
    given: dict[str, Any] = {"coordinates": coordinates, "force_field": force_field, "cutoff": cutoff, "rigid": rigid}
    if isinstance(name_or_path, Mapping):
        refuse_files("a dict", given)
        with prefixed("system: "):
            return _subject(plain(name_or_path), Path("system.toml"), "", seed, overlaps)
    path = find(name_or_path)
    if path.suffix.lower() in PARAMETERS or (force_field is not None and path.suffix.lower() in (".pdb", ".cif")):
        if seed is not None:
            _note_unused_seed()
        if snapshot is not None:
            raise InputError(f"snapshot: is for archives of rebound, and {path} is none")
        return force_field_system(path, **given)
    refuse_files(path, given)
    if is_archive(path):
        if seed is not None:
            _note_unused_seed()
        found: System = bridge("rebound", f"{path}: an archive of rebound").archived_system(path, snapshot)
        return found
    if may_be_snapshot(path) and (bridged := bridge("h5py", f"{path}: a snapshot")).is_snapshot(path):
        if seed is not None:
            _note_unused_seed()
        stored: System = bridged.system_of(path, snapshot=snapshot)
        return stored
    if snapshot is not None:
        raise InputError(f"snapshot: is for archives of rebound and snapshots, and {path} is none")
    if path.suffix.lower() in STRUCTURES:
        if seed is not None:
            _note_unused_seed()
        return structure_system(path)
    if is_packed(path) and Path(path.stem).suffix.lower() in STRUCTURES:
        with unpacked(path) as inner:
            return structure_system(inner)
    if is_lammps_input(path):
        if seed is not None:
            _note_unused_seed()
        described: System = bridge("lammps", f"{path}: an input of LAMMPS").system_of(path)
        return described
    text, data = parsed(path)
    with prefixed(f"{path}: "):
        return _subject(data, path, text, seed, overlaps)


def structure_system(path: Path) -> System:
    """Return the System of a structure file without forces, in metal units or in those of an exported run."""
    units = nominal_units(path) or "metal"
    with prefixed(f"{path}: "):
        found = read_structure(path, unit_system(units))
        if found.periodic and found.edges is None:
            raise InputError("is periodic, but has no cell")
        box = Box(found.edges, periodic=found.periodic) if found.periodic else None
        return System(
            found.positions, found.velocities, found.masses, box, units=units, species=found.species, name=path.stem,
            charges=found.charges,
        )  # fmt: skip


def loads(
    text: str, name: str = "system", seed: int | None = None, folder: str | os.PathLike[str] = "."
) -> System | Problem:
    """Build the System or Problem of a system file's text. Structure files are searched in ``folder``."""
    with prefixed(f"{name}: "):
        return _subject(toml_table(text), Path(folder) / f"{name}.toml", text, seed)


def built(
    data: dict[str, Any], name: str, seed: int | None, folder: str | os.PathLike[str], text: str = ""
) -> System | Problem:
    """Build the System or Problem of a parsed system file and its ``text``. A file without random numbers ignores
    ``seed``."""
    with prefixed(f"{name}: "):
        return _subject(data, Path(folder) / f"{name}.toml", text, seed if draws(data) else None)


def draws(data: dict[str, Any]) -> bool:
    """Tell whether a parsed system file draws random numbers: for velocities, orbits, or a cluster's stars."""
    velocities, particles = data.get("velocities"), data.get("particles")
    drawn = isinstance(velocities, dict) and "temperature" in velocities
    if isinstance(particles, dict):
        drawn = (
            drawn or "plummer" in particles or "king" in particles or ("elements" in particles and "seed" in particles)
        )
    return drawn


def _subject(data: dict[str, Any], path: Path, text: str, seed: int | None, overlaps: bool = False) -> System | Problem:
    if seed is not None:
        seed = whole_number("seed", seed, 0)
    with no_overflow():
        return _problem(data, path, text, seed) if "ode" in data else _system(data, path, text, seed, overlaps)


def _problem(data: dict[str, Any], path: Path, text: str, seed: int | None) -> Problem:
    for key in data:
        if key in schema.SystemTable.model_fields and key not in schema.OdeFileTable.model_fields:
            raise InputError(f"{key}: not allowed in an ODE file; allowed beside ode: {', '.join(_BESIDE_ODE)}")
    table: schema.OdeFileTable = schema.checked(schema.OdeFileTable, data, None)
    if seed is not None:
        _note_unused_seed()
    from kickdrift.odes import ODES

    if "problem" not in table.ode:
        raise InputError(f"ode.problem: required key is missing; expected one of {choices(ODES)}")
    name = table.ode["problem"]
    if not isinstance(name, str) or name not in ODES:
        raise InputError(
            f"ode.problem: expected one of {choices(ODES, name)}, got {shown(name)}{suggestion(name, ODES)}"
        )
    given = schema.checked(schema.ode_table(ODES[name]), table.ode, None, "ode")
    parameters = {key: value for key, value in given if key != "problem"}
    with prefixed("ode."):
        made = ODES[name](**parameters)
    return replace(
        made,
        name=path.stem,
        run=run_defaults(table.run, None),
        invariants=table.invariants,
        source=text,
        equation=name,
        parameters={key: value for key, value in parameters.items() if key not in ("y0", "t0")},
    )


def _system(data: dict[str, Any], path: Path, text: str, seed: int | None, overlaps: bool = False) -> System:
    if "units" not in data:
        if key := schema.SystemTable.unknown(data):
            raise InputError(f"{key}: {schema.SystemTable.unknown_text(key)}")
        raise InputError(f"units: required key is missing; expected one of {', '.join(UNIT_SYSTEMS)}")
    units = unit_system(data["units"])
    table: schema.SystemTable = schema.checked(schema.SystemTable, data, units)
    run = run_defaults(table.run, units)
    forces = [_force(force, units, f"force[{k}]", path.parent) for k, force in enumerate(table.force or ())]
    frame = frame_system(table, units, path.parent)
    if frame is None and (frame := told_system(table, units, path.parent)) is not None:
        forces += frame.forces
    elif table.force is None and not table.event:
        raise InputError("force: required key is missing")
    start = _start(table, units, path.parent, G_given(forces, units), seed, frame)
    velocities = start.velocities
    drawn = table.velocities is not None and table.velocities.temperature is not None
    if seed is not None and not drawn and start.seed is None and not draws_noise(run):
        _note_unused_seed()
        seed = None
    seed = start.seed if start.seed is not None else seed
    if table.velocities is not None:
        velocities = None if drawn else np.array(table.velocities.values, dtype=float)
        seed = table.velocities.seed if seed is None else seed
    virtual_sites: Any
    constraints: Any
    fixed: Any = [fixed_of(given, k) for k, given in enumerate(table.fixed)]
    topology, virtual_sites = molecules_of(table, path.parent)
    constraints = [constraint_of(given, k) for k, given in enumerate(table.constraint)]
    if frame is not None:
        seed = frame.seed if seed is None else seed
        topology = frame.topology if topology is None else topology
        constraints, virtual_sites = constraints or frame.constraints, virtual_sites or frame.virtual_sites
        fixed = fixed or frame.fixed
    fixed = fixed or ([Fixed(start.fixed)] if len(start.fixed) else None)
    stages = [stage_of(given, units, f"stage[{k}]") for k, given in enumerate(table.stage)]
    equilibration = None if table.equilibrate is None else equilibration_of(table.equilibrate, units, run)

    def system(velocities: Floats | None) -> System:
        positions = start.positions
        if start.barycentric:
            masses = np.broadcast_to(start.masses, len(positions))
            positions = to_barycentric(positions, masses)[0]
            velocities = None if velocities is None else to_barycentric(velocities, masses)[0]
        return System(
            positions,
            velocities,
            start.masses,
            box_of(table, start),
            forces,
            units,
            start.species,
            path.stem,
            run,
            equilibration,
            table.invariants,
            text,
            seed,
            start.names,
            start.radii,
            dimensions=table.dimensions,
            topology=topology,
            charges=start.charges,
            constraints=constraints,
            virtual_sites=virtual_sites,
            stages=stages,
            fixed=fixed,
        )

    made = system(velocities)
    if table.velocities is not None and table.velocities.temperature is not None and seed is not None:
        with prefixed("velocities."):
            temperature = table.velocities.temperature
            made = system(drawn_velocities(made, temperature, seed))
    if table.time is not None:
        made = made.at(made.state.phase, table.time)
    parted = overlaps or (bool(stages) and stages[0].minimize is not None)
    check_overlaps(made, near=not parted)
    object.__setattr__(made, "ephemerides", start.ephemerides)
    return made if not table.event else made.watched(events_of(made, table.event))


def _note_unused_seed() -> None:
    warn("seed: this system draws nothing at random, so the seed has no effect", stacklevel=5)


SHORT = 5  # letters: a shorter word is near to many


def _force(given: dict[str, Any], units: UnitSystem, path: str, folder: Path) -> Any:
    if "type" not in given:
        raise InputError(f"{path}.type: required key is missing; expected one of {choices(FORCES)}")
    name = given["type"]
    if not isinstance(name, str) or name not in FORCES:
        near, own = suggestion(name, FORCES), "; a force of your own comes with --load FILE.py"
        hint = other_name("force", name) or (near if near and len(str(name)) > SHORT else own + near)
        raise InputError(f"{path}.type: expected one of {choices(FORCES, name)}, got {shown(name)}{hint}")
    cls: Any = FORCES[name]
    parameters = schema.force_parameters(cls, given, units, path)
    tables = (parameters.get(key) for key in ("species", "pairs", "types"))
    inner = [each for table in tables if isinstance(table, dict) for each in table.values() if isinstance(each, dict)]
    for each in (parameters, *inner):
        if isinstance(each.get("file"), str):
            each["file"] = str(folder / each["file"])
    with prefixed(f"{path}: "):
        return cls(**parameters)


def _start(
    table: schema.SystemTable,
    units: UnitSystem,
    folder: Path,
    gravity: float | None,
    seed: int | None,
    frame: System | None,
) -> Structure:
    particles, box = table.particles, edges_given(table)
    with prefixed("particles."):
        if isinstance(particles, schema.LatticeTable):
            return on_lattice(particles, table, box, units)
        if isinstance(particles, schema.WalksTable):
            return on_walks(particles, table, box, units)
        if isinstance(particles, schema.PositionsTable):
            return as_given(particles, units, gravity)
        if isinstance(particles, ElementsTable | PlummerTable | KingTable):
            if table.velocities is not None:
                raise InputError("elements, plummer and king already set velocities; expected no [velocities]")
            return (
                on_orbits(particles, gravity, seed, units=units, folder=folder)
                if isinstance(particles, ElementsTable)
                else stars_of(particles, units, gravity, seed)
            )
        if frame is not None:
            return structure_of(frame, particles, box is not None)
        if "\0" in particles.file:
            raise InputError(f"file: expected the name of a file, got {shown(particles.file)}")
        with prefixed("file: "):
            path, periodic = folder / particles.file, table.box.periodic
            found = read_structure(path, units, periodic, box is not None, particles.atom_style)
        charges = charges_of(particles, found.species)
        return found if charges is None else found._replace(charges=charges)
