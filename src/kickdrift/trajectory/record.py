"""A System as a run's file keeps it, and back: what the file alone needs to run it again."""

from __future__ import annotations

import hashlib
import inspect
import json
import sys
from collections.abc import Iterable, Mapping
from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from kickdrift.errors import InputError
from kickdrift.events import Between, CloseApproach, Collision, Crossing, Escape, Event
from kickdrift.forces import FORCES
from kickdrift.system import Equilibration, RunDefaults, System

if TYPE_CHECKING:
    from kickdrift.trajectory.reader import Run

_EVENTS: dict[str, Any] = {event.__name__: event for event in (CloseApproach, Collision, Crossing, Escape)}


def to_json(value: Any) -> str:
    return json.dumps(_plain(value))


def _plain(value: Any) -> Any:
    """Dataclasses, named tuples and arrays as dictionaries, lists, numbers and text.

    A dictionary whose keys are not text becomes a list of [key, value].
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
    return f"{value.__module__}.{value.__qualname__}" if callable(value) else str(value)


def record_of(system: System) -> dict[str, Any]:
    """All of a System but its state, masses, ids and species, which the file has as arrays."""
    return {
        "name": system.name,
        "units": system.units.name,
        "particles": len(system),
        "box": system.box.lengths,
        "species": system.species,
        "names": system.names,
        "radii": system.radii,
        "events": [{"kind": event.kind, **_described(event)} for event in system.events],
        "forces": [_described(force) for force in system.forces],
        "run": system.run,
        "equilibration": system.equilibration,
        "invariants": system.invariants,
        "seed": system.seed,
        "time": system.state.time,
        "steps_done": system.state.steps_done,
    }


def _described(thing: Any) -> dict[str, Any]:
    found = {"type": type(thing).__name__, "module": type(thing).__module__, "parameters": thing}
    return found | ({"source": source} if (source := _source_hash(thing)) else {})


def _source_hash(thing: Any) -> str:
    """SHA-256 of the functions that a class of the user's own is made of; "" of kickdrift's, and where Python has no
    source."""
    cls = getattr(type(thing), "Parameters", type(thing))
    own = [each for each in vars(cls).values() if inspect.isfunction(each) and each.__module__ == cls.__module__]
    if cls.__module__.startswith("kickdrift."):
        return ""
    try:
        sources = [inspect.getsource(each) for each in [*own, *getattr(cls, "kernel_sources", ())]]
    except (OSError, TypeError):
        return ""
    return hashlib.sha256("".join(sources).encode()).hexdigest() if sources else ""


def changed_sources(system: System, run: Run) -> list[str]:
    """The forces of the user's own whose source is not what it was when the run began."""
    then = [force.get("source", "") for force in run.system_record["forces"]]
    pairs = zip(system.forces, then, strict=True)
    return [type(force).__name__ for force, source in pairs if source != _source_hash(force)]


def system_of(
    run: Run, frame: int | None = None, *, forces: Iterable[Any] | None = None, events: Iterable[Event] | None = None
) -> System:
    """The System that a run was given, or the same at one of the run's frames, at that frame's time.

    Forces that the file names by a class of the user's own are found where that class's module has been imported. An
    InputError says what cannot be had from the file, and which frame has bodies that have merged or left. ``forces``
    and ``events`` take the place of the file's.
    """
    record = run.system_record
    start = run.initial_phase
    species = [run.species[k] for k in run.species_index]
    known = {each.name for each in fields(RunDefaults)}
    system = System(
        start[0].T,
        start[1].T,
        run.masses,
        run.box,
        [_force(given, str(run.path)) for given in record["forces"]] if forces is None else forces,
        run.units,
        species,
        record["name"],
        RunDefaults(**{key: value for key, value in record["run"].items() if key in known}),
        Equilibration(**record["equilibration"]) if record["equilibration"] else None,
        record["invariants"],
        run.system_source,
        record["seed"],
        run.names,
        record.get("radii"),
        [_event(given, str(run.path)) for given in record.get("events", ())] if events is None else events,
    )
    if frame is None:
        return system.at(start, record["time"], record["steps_done"], run.ids)
    shown = run[frame]
    gone = [event for event in run.events if event["time"] <= shown.time and _changed(event)]
    if gone:
        raise InputError(
            f"{run.path}: frame {shown.index}: {gone[0]['kind']} of {' and '.join(gone[0]['bodies'])} at t = "
            f"{gone[0]['time']:g} has changed the bodies before it; resume the run from there instead"
        )
    return system.at(np.array([shown.positions.T, shown.velocities.T]), shown.time, 0, run.ids)


def _changed(event: Mapping[str, Any]) -> bool:
    return any(word in event["done"] for word in ("merged into", "removed"))


def _force(given: Mapping[str, Any], path: str) -> Any:
    name, module = given["type"], given["module"]
    own = {(cls.__name__, cls.__module__): cls for cls in FORCES.values()}
    cls = own.get((name, module)) or getattr(sys.modules.get(module), name, None)
    if cls is None:
        raise InputError(
            f"{path}: force {name} is of module {module}, which is not loaded; import it first (on the command line "
            "by --load FILE.py), or give the system"
        )
    parameters = dict(given["parameters"])
    for key, value in parameters.items():
        if isinstance(value, list) and value and all(_is_item(each) for each in value):
            parameters[key] = {tuple(pair): inner for pair, inner in value}
    return cls(**parameters)


def _is_item(value: Any) -> bool:
    """Whether it is what `to_json` makes of a dictionary's item whose key is a tuple."""
    return isinstance(value, list) and len(value) == 2 and isinstance(value[0], list) and isinstance(value[1], dict)


def _event(given: Mapping[str, Any], path: str) -> Event:
    parameters = dict(given["parameters"])
    function = parameters.get("function")
    if isinstance(function, str):
        raise InputError(f"{path}: event {given['kind']!r} has a function of the user's own; give the events again")
    if function is not None:
        parameters["function"] = Between(**function)
    return _EVENTS[given["type"]](**parameters)


def differences(system: System, run: Run) -> list[str]:
    """What differs between a System and the one that a run was given; empty where the run is this System's."""
    here, there = json.loads(to_json(record_of(system))), dict(run.system_record)
    skipped = {"name", "invariants", "run", "equilibration", "seed"}  # which do not change what the forces do
    for record in (here, there):
        record["forces"] = [{k: v for k, v in force.items() if k != "source"} for force in record["forces"]]
    found = [key for key in here if key not in skipped and here[key] != there.get(key)]
    state, species = system.state, [run.species[k] for k in run.species_index]
    arrays = {
        "positions": (state.phase[0], run.initial_phase[0]),
        "velocities": (state.phase[1], run.initial_phase[1]),
        "masses": (state.masses, run.masses),
        "ids": (state.ids, run.ids),
        "species of particles": ([system.species[k] for k in system.species_index], species),
    }
    found += [key for key, (one, other) in arrays.items() if not np.array_equal(one, other)]
    return found if system.units == run.units else [*found, "constants of the units"]
