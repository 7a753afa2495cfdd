"""System files: TOML to System or Problem. Every error is an InputError of one line: file, key, what was expected."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from io import BytesIO, TextIOWrapper
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from kickdrift.disk.files import SYSTEM_FILE_BYTES, content, unfit
from kickdrift.errors import InputError
from kickdrift.forces import FORCES
from kickdrift.model.checks import no_overflow, path_text, whole_number
from kickdrift.model.problem import Problem
from kickdrift.model.run_defaults import Equilibration
from kickdrift.model.starts.builders import (
    Structure,
    check_overlaps,
    maxwell_boltzmann,
    read_structure,
)
from kickdrift.model.starts.coordinates import to_barycentric
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.model.units import UNIT_SYSTEMS, UnitSystem, shown, suggestion, unit_system
from kickdrift.systemfile.bodies import cluster, on_orbits
from kickdrift.systemfile.events import events_of
from kickdrift.systemfile.places import as_given, box_of, edges_given, on_lattice
from kickdrift.systemfile.schema import (
    ElementsTable,
    LatticeTable,
    OdeFileTable,
    PlummerTable,
    PositionsTable,
    SystemTable,
    checked,
    force_parameters,
    ode_table,
)
from kickdrift.systemfile.schema_run import run_defaults

_BESIDE_ODE = tuple(key for key in OdeFileTable.model_fields if key != "ode")


class Description(NamedTuple):
    """What a list of systems shows of one."""

    name: str
    path: Path
    title: str  # its ``title``, else the comment on its first line
    units: str


def load(name_or_path: str | os.PathLike[str], seed: int | None = None) -> System | Problem:
    """The System of a TOML file, or of the bare name of one that ships (``lj-1000``); a Problem where it has [ode].

    Parameters
    ----------
    name_or_path : a path, or one of ``shipped()``
    seed : replaces the file's ``velocities.seed``

    Raises
    ------
    InputError
        In one line: the file, the key and what was expected, or the particles that overlap.
    """
    path = find(name_or_path)
    text, data = parsed(path)
    with _named(f"{path}: "):
        return _subject(data, path, text, seed)


def loads(
    text: str, name: str = "system", seed: int | None = None, folder: str | os.PathLike[str] = "."
) -> System | Problem:
    """The System or Problem of a system file's text; structure files in it are looked for in ``folder``."""
    with _named(f"{name}: "):
        return _subject(_parsed(text), Path(folder) / f"{name}.toml", text, seed)


def built(
    data: dict[str, Any], name: str, seed: int | None, folder: str | os.PathLike[str], text: str = ""
) -> System | Problem:
    """The System or Problem of a system file's content, parsed, and its ``text``; ``seed`` is for what is drawn, if
    anything is."""
    with _named(f"{name}: "):
        return _subject(data, Path(folder) / f"{name}.toml", text, seed if draws(data) else None)


def draws(data: dict[str, Any]) -> bool:
    """Whether what a system file says, parsed, leaves anything to a seed: velocities, orbits, a cluster's stars."""
    velocities, particles = data.get("velocities"), data.get("particles")
    drawn = isinstance(velocities, dict) and "temperature" in velocities
    if isinstance(particles, dict):
        drawn = drawn or "plummer" in particles or ("elements" in particles and "seed" in particles)
    return drawn


def parsed(path: Path) -> tuple[str, dict[str, Any]]:
    """A system file's text, and what TOML makes of it; neither is checked further."""
    stored = content(path, SYSTEM_FILE_BYTES, "a system file")
    with _named(f"{path}: "):
        text = _text(stored)
        return text, _parsed(text)


def shipped() -> dict[str, Path]:
    """The system files that come with kickdrift, by name."""
    package = Path(__file__).parents[1]
    inside = package / "systems"  # in a wheel
    folder = inside if inside.is_dir() else package.parents[1] / "systems"  # in a checkout
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def describe(path: str | os.PathLike[str]) -> Description:
    """A system file's name, title and units, without checking or building it."""
    path = Path(path)
    text, data = parsed(path)
    first = text.split("\n", 1)[0]
    comment = first.lstrip("# ").strip() if first.startswith("#") else ""
    return Description(path.stem, path, str(data.get("title", comment)), str(data.get("units", "")))


def is_shipped(name_or_path: str | os.PathLike[str]) -> bool:
    """Whether it is the bare name of a system that ships; a file of that name is given as ./NAME."""
    return isinstance(name_or_path, str) and Path(name_or_path).name == name_or_path and name_or_path in shipped()


def find(name_or_path: str | os.PathLike[str]) -> Path:
    """The file that a name or path means; an InputError suggests the nearest name where there is none."""
    given = path_text("system", name_or_path)
    bare = isinstance(name_or_path, str) and Path(given).name == given and not given.endswith(".toml")
    known = shipped()
    if is_shipped(name_or_path):
        return known[given]
    path = Path(given)
    if (what := unfit(path, "a system file")) is None:
        return path
    if bare and not os.path.lexists(given):
        listed = f"{suggestion(given, known)} (shipped: {', '.join(known)})"
        raise InputError(f"{shown(given)} is neither a file nor a shipped system{listed}")
    raise InputError(f"{' '.join(given.split())}: {what}{suggestion(path.stem, known)}")


@contextmanager
def _named(prefix: str) -> Iterator[None]:
    """Put the file or key that an InputError is about before its message."""
    try:
        yield
    except InputError as error:
        raise InputError(prefix + str(error)) from None


def _text(stored: bytes) -> str:
    try:
        return TextIOWrapper(BytesIO(stored), encoding="utf-8-sig").read()
    except UnicodeDecodeError:
        raise InputError("not a text file in UTF-8") from None


def _parsed(text: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"not valid TOML: {' '.join(str(error).split())}") from None
    except RecursionError:
        raise InputError("not valid TOML: nested too deeply") from None
    except ValueError as error:  # an integer of thousands of digits
        raise InputError(f"not valid TOML: {' '.join(str(error).split(';')[0].split())}") from None


def _subject(data: dict[str, Any], path: Path, text: str, seed: int | None) -> System | Problem:
    if seed is not None:
        seed = whole_number("seed", seed, 0)
    with no_overflow():
        return _problem(data, path, text, seed) if "ode" in data else _system(data, path, text, seed)


def _problem(data: dict[str, Any], path: Path, text: str, seed: int | None) -> Problem:
    for key in data:
        if key in SystemTable.model_fields and key not in OdeFileTable.model_fields:
            raise InputError(f"{key}: not allowed in an ODE file; allowed beside ode: {', '.join(_BESIDE_ODE)}")
    table: OdeFileTable = checked(OdeFileTable, data, None)
    if seed is not None:
        raise InputError("seed: an ode draws no velocities; expected a system with velocities.temperature")
    from kickdrift.odes import ODES

    if "problem" not in table.ode:
        raise InputError(f"ode.problem: required key is missing; expected one of {', '.join(ODES)}")
    name = table.ode["problem"]
    if not isinstance(name, str) or name not in ODES:
        raise InputError(f"ode.problem: expected one of {', '.join(ODES)}, got {shown(name)}{suggestion(name, ODES)}")
    given = checked(ode_table(ODES[name]), table.ode, None, "ode")
    parameters = {key: value for key, value in given if key != "problem"}
    with _named("ode."):
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


def _system(data: dict[str, Any], path: Path, text: str, seed: int | None) -> System:
    if "units" not in data:
        raise InputError(f"units: required key is missing; expected one of {', '.join(UNIT_SYSTEMS)}")
    units = unit_system(data["units"])
    table: SystemTable = checked(SystemTable, data, units)
    run = run_defaults(table.run, units)
    forces = [_force(force, units, f"force[{k}]") for k, force in enumerate(table.force)]
    gravity = next((force.G for force in forces if getattr(force, "G", None) is not None), units.gravity)
    start = _start(table, units, path.parent, gravity, seed)
    velocities = start.velocities
    drawn = table.velocities is not None and table.velocities.temperature is not None
    if seed is not None and not drawn and start.seed is None:
        raise InputError("seed: this system draws no velocities; expected velocities.temperature")
    seed = start.seed if start.seed is not None else seed
    if table.velocities is not None:
        velocities = None if drawn else np.array(table.velocities.values, dtype=float)
        seed = table.velocities.seed if seed is None else seed
    equilibration = Equilibration(**table.equilibrate.model_dump()) if table.equilibrate else None

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
        )

    made = system(velocities)
    if table.velocities is not None and table.velocities.temperature is not None and seed is not None:
        with _named("velocities."):
            temperature = table.velocities.temperature
            drawn_at = maxwell_boltzmann(made.coherent_masses, temperature, units.boltzmann, seed, table.dimensions)
            made = system(drawn_at)
    check_overlaps(made)
    return made if not table.event else made.watched(events_of(made, table.event))


def _force(given: dict[str, Any], units: UnitSystem, path: str) -> Any:
    if "type" not in given:
        raise InputError(f"{path}.type: required key is missing; expected one of {', '.join(FORCES)}")
    name = given["type"]
    if not isinstance(name, str) or name not in FORCES:
        hint = suggestion(name, FORCES) or "; a force of your own comes with --load FILE.py"
        raise InputError(f"{path}.type: expected one of {', '.join(FORCES)}, got {shown(name)}{hint}")
    cls: Any = FORCES[name]
    parameters = force_parameters(cls, given, units, path)
    with _named(f"{path}: "):
        return cls(**parameters)


def _start(table: SystemTable, units: UnitSystem, folder: Path, gravity: float | None, seed: int | None) -> Structure:
    particles, box = table.particles, edges_given(table)
    with _named("particles."):
        if isinstance(particles, LatticeTable):
            return on_lattice(particles, table, box, units)
        if isinstance(particles, PositionsTable):
            return as_given(particles, units, gravity)
        if isinstance(particles, ElementsTable | PlummerTable):
            if table.velocities is not None:
                raise InputError("elements and plummer already set velocities; expected no [velocities]")
            return (
                on_orbits(particles, gravity, seed)
                if isinstance(particles, ElementsTable)
                else cluster(particles, units, seed)
            )
        if "\0" in particles.file:
            raise InputError(f"file: expected the name of a file, got {shown(particles.file)}")
        with _named("file: "):
            return read_structure(folder / particles.file, units)
