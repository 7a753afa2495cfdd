"""The record of a System in a run's file, and the System made from the record alone."""

from __future__ import annotations

import hashlib
import inspect
import json
from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces import home
from kickdrift.forces.external.calculator import OBJECT
from kickdrift.forces.pairs.law import PairForce
from kickdrift.forces.seam.named import path_of
from kickdrift.integrators.options import OPTIONS
from kickdrift.model.changing import empty_rows, with_empty_rows
from kickdrift.model.events.events import Event
from kickdrift.model.molecules.constraint import Constraint
from kickdrift.model.molecules.topology import Topology
from kickdrift.model.molecules.virtual_sites import VirtualSite
from kickdrift.model.run_defaults import RunDefaults
from kickdrift.model.state import State
from kickdrift.model.system import System
from kickdrift.systemfile.schema import checked
from kickdrift.trajectory.layout.edges import recorded
from kickdrift.trajectory.layout.named import Record, about, equilibration_of, event_of, force_of, run_of, stage_of

if TYPE_CHECKING:
    from kickdrift.trajectory.layout.run_parts import RunFile


def to_json(value: Any) -> str:
    return json.dumps(_plain(value))


def _plain(value: Any) -> Any:
    """Dataclasses, named tuples and arrays as dictionaries, lists, numbers and text.

    A dictionary with keys other than text becomes a list of [key, value].
    """
    if isinstance(value, tuple) and hasattr(value, "_asdict"):
        return _plain(value._asdict())
    if is_dataclass(value) and not isinstance(value, type):
        return {each.name: _plain(getattr(value, each.name)) for each in fields(value)}
    if isinstance(value, Mapping):
        if all(isinstance(key, str) for key in value):
            return {key: _plain(item) for key, item in value.items()}
        return [[_plain(key), _plain(item)] for key, item in value.items()]
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, (list, tuple, set, frozenset)):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        return value.item()
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    return path_of(value) if callable(value) else str(value)


def record_of(system: System) -> dict[str, Any]:
    """Record of a System without its state, masses, charges, ids and species, which the file has as arrays."""
    return {
        "name": system.name,
        "units": system.units.name,
        "particles": len(system),
        "box": recorded(system.box),
        **({"dimensions": system.dimensions} if system.dimensions != 3 else {}),  # a key that older files do not have
        **({"topology": system.topology.tables()} if system.topology is not None else {}),  # likewise
        **({"constraints": system.constraints.tables()} if system.constraints is not None else {}),  # likewise
        **({"virtual_sites": system.virtual_sites.tables} if system.virtual_sites is not None else {}),  # likewise
        **({"ephemerides": system.ephemerides} if system.ephemerides else {}),  # likewise
        **({"room": room} if (room := empty_rows(system)) else {}),  # likewise
        "species": system.species,
        "names": system.names,
        "radii": system.radii,
        "events": [{"kind": event.kind, **_described(event)} for event in system.events],
        "forces": [_described(force) for force in system.forces],
        "run": run_record(system.run),
        "equilibration": system.equilibration and system.equilibration.said(),
        **({"stages": [each.said() for each in system.stages]} if system.stages else {}),  # likewise
        "invariants": system.invariants,
        "seed": system.seed,
        "time": system.state.time,
        "steps_done": system.state.steps_done,
    }


def run_record(run: RunDefaults) -> dict[str, Any]:
    """Values of ``[run]`` by key; None for a key that was not set."""
    own = {each.name: getattr(run, each.name) for each in fields(run) if each.name != "options"}
    return {**own, **dict.fromkeys(OPTIONS), **run.options}


def _described(thing: Any) -> dict[str, Any]:
    found = {"type": type(thing).__qualname__, "module": home(type(thing).__module__), "parameters": thing}
    return found | ({"source": source} if (source := _source_hash(thing)) else {})


def _source_hash(thing: Any) -> str:
    """SHA-256 of the functions in a user's class; "" for kickdrift's own classes, and if Python has no source."""
    cls = getattr(type(thing), "Parameters", type(thing))
    own = [each for each in vars(cls).values() if inspect.isfunction(each) and each.__module__ == cls.__module__]
    if cls.__module__.startswith("kickdrift."):
        return ""
    try:
        sources = [inspect.getsource(each) for each in [*own, *getattr(cls, "kernel_sources", ())]]
    except (OSError, TypeError):
        return ""
    return hashlib.sha256("".join(sources).encode()).hexdigest() if sources else ""


def changed_sources(system: System, run: RunFile) -> list[str]:
    """User's forces whose source has changed since the run began."""
    then = [force.source for force in checked_record(run).forces]
    pairs = zip(system.forces, then, strict=True)
    return [type(force).__name__ for force, source in pairs if source != _source_hash(force)]


def checked_record(run: RunFile) -> Record:
    """Record of the file's system, checked. Raises InputError if kickdrift does not write such a record."""
    with about(run.path, "damaged: kickdrift/system/record"):
        record: Record = checked(Record, run.system_record, None)
        return record


def system_of(
    run: RunFile,
    frame: int | None = None,
    *,
    forces: Iterable[Any] | None = None,
    events: Iterable[Event] | None = None,
) -> System:
    """System that a run began with, or the System at one of the run's frames and its time.

    A user's force is found if its class is registered (see ``register_force``); a file cannot name other parts of a
    module. Raises an InputError that says what the file does not hold, or which frame has bodies that have merged or
    left. ``forces`` and ``events`` replace those of the file.
    """
    record = checked_record(run)
    start = run.initial_phase[:, :, : len(run.ids) - record.room]
    n = start.shape[2]
    with about(run.path):
        system = System(
            start[0].T,
            start[1].T,
            run.masses[:n],
            run.box if frame is None else run[frame].box,
            [_acting(force_of(given), run) for given in record.forces] if forces is None else forces,
            run.units,
            [run.species[k] for k in run.species_index[:n]],
            record.name,
            run_of(record.run),
            equilibration_of(record.equilibration) if record.equilibration else None,
            record.invariants,
            run.system_source,
            record.seed,
            run.names[:n],
            None if record.radii is None else record.radii[:n],
            [event_of(given) for given in record.events] if events is None else events,
            record.dimensions,
            None if record.topology is None else Topology(**record.topology),
            None if run.charges is None else run.charges[:n],
            [Constraint(**given) for given in record.constraints],
            [VirtualSite(**given) for given in record.virtual_sites],
            [stage_of(given) for given in record.stages],
        )
    object.__setattr__(system, "ephemerides", tuple(record.ephemerides))
    if frame is None:
        return system.at(start, record.time, record.steps_done, run.ids[:n])
    shown = run[frame]
    gone = [event for event in run.events if event["time"] <= shown.time and _changed(event)]
    if gone:
        raise InputError(
            f"{run.path}: frame {shown.index}: {gone[0]['kind']} of {' and '.join(gone[0]['bodies'])} at t = "
            f"{gone[0]['time']:g} has changed the bodies before it; resume the run from there instead"
        )
    phase = np.array([shown.positions[:n].T, shown.velocities[:n].T])
    return system.anew(State(phase, system.state.masses, run.ids[:n], shown.box, shown.time))


def _acting(force: Any, run: RunFile) -> Any:
    """A force without species that no particle has. Version 0.2.0 wrote such names, with a warning."""
    return force.among(run.species) if isinstance(force, PairForce) else force


def _changed(event: Mapping[str, Any]) -> bool:
    return any(word in event["done"] for word in ("merged into", "removed", "; momentum error"))


def _compared(force: Mapping[str, Any]) -> dict[str, Any]:
    """Parts of a force's record that must be equal in two runs. Files of version 0.1.0 have no qualified names, and
    files of version 0.2.0 name kickdrift's own modules."""
    type_name, module = force["type"].rpartition(".")[2], home(str(force.get("module")))
    return {"type": type_name, "module": module, "parameters": force.get("parameters")}


def differences(system: System, run: RunFile) -> list[str]:
    """Differences between a System and the System that a run began with; empty if they are the same."""
    system = with_empty_rows(system, checked_record(run).room)
    here, there = json.loads(to_json(record_of(system))), dict(run.system_record)
    # keys that do not change the forces
    skipped = {"name", "invariants", "run", "equilibration", "stages", "seed", "ephemerides"}
    for record in (here, there):
        record["forces"] = [_compared(force) for force in record["forces"]]
    for one, other in zip(here["forces"], there["forces"], strict=False):
        if (other["parameters"] or {}).get("arguments") == OBJECT:  # files of version 0.2.0 say no more
            one["parameters"]["arguments"] = OBJECT
    keys = [
        *here,
        *(
            key
            for key in ("constraints", "virtual_sites", "topology", "dimensions")
            if key in there and key not in here
        ),
    ]
    found = [key for key in keys if key not in skipped and here.get(key) != there.get(key)]
    state, species = system.state, [run.species[k] for k in run.species_index]
    arrays = {
        "positions": (state.phase[0], run.initial_phase[0]),
        "velocities": (state.phase[1], run.initial_phase[1]),
        "masses": (state.masses, run.masses),
        "ids": (state.ids, run.ids),
        **({} if system.charges is run.charges is None else {"charges": (system.charges, run.charges)}),
        "species of particles": ([system.species[k] for k in system.species_index], species),
    }
    found += [key for key, (one, other) in arrays.items() if not _same(one, other)]
    return found if system.units == run.units else [*found, "constants of the units"]


def _same(one: Any, other: Any) -> bool:
    """Whether two arrays, or two lists of names, are equal; a body that does not exist yet has nan in both."""
    if one is None or other is None:
        return one is other
    return np.array_equal(one, other, equal_nan=np.asarray(one).dtype.kind == "f")
