"""System files from Systems; reading such a file gives the same bits."""

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from inspect import Parameter, signature
from typing import Any

import numpy as np

from kickdrift.disk.files import SYSTEM_FILE_BYTES
from kickdrift.errors import InputError
from kickdrift.forces import FORCES
from kickdrift.forces.pairs.law import PairForce
from kickdrift.forces.seam.named import named_function, path_of
from kickdrift.model.box.box import Box
from kickdrift.model.events.events import Between, CloseApproach, Collision, Crossing, Escape, Event
from kickdrift.model.subject import index_of
from kickdrift.model.system import System
from kickdrift.model.units.unit_systems import UNIT_SYSTEMS
from kickdrift.systemfile.events import PASSAGES
from kickdrift.systemfile.files import plain, toml_table
from kickdrift.text import shown


def to_toml(system: System) -> str:
    """See ``System.to_toml``."""
    text = toml_text(plain(tables_of(system)))
    if len(text.encode()) > SYSTEM_FILE_BYTES:
        raise InputError(
            f"to_toml: {len(system):,} particles make a text of {len(text) >> 20} MiB, and a system file has at most "
            f"{SYSTEM_FILE_BYTES >> 20} MiB"
        )
    return text


def tables_of(system: System) -> dict[str, Any]:
    """Tables of a system file of this System."""
    state, units = system.state, system.units
    if UNIT_SYSTEMS.get(units.name) != units:
        raise InputError(f"to_toml: units: a system file has no units of {units.length}, {units.time} and {units.mass}")
    species = [system.species[k] for k in system.species_index]
    one_mass = np.all(state.masses == state.masses[0])
    particles: dict[str, Any] = {"mass": state.masses[0]} if one_mass else {"masses": state.masses}
    particles["positions"] = state.positions
    particles["species"] = species[0] if len(set(species)) == 1 else species
    if system.names:
        particles["names"] = system.names
    if system.radii is not None:
        particles["radii"] = system.radii
    if system.charges is not None:
        one_charge = np.all(system.charges == system.charges[0])
        particles |= {"charge": system.charges[0]} if one_charge else {"charges": system.charges}
    title = toml_table(system.source).get("title") if system.source else None
    tables: dict[str, Any] = {"units": units.name} if title is None else {"title": title, "units": units.name}
    if state.time != 0:
        tables["time"] = state.time
    if system.dimensions != 3:
        tables["dimensions"] = system.dimensions
    tables |= {"particles": particles, "velocities": {"values": state.velocities}}
    if system.box.periodic:
        tables["box"] = _box(system.box)
    if system.topology is not None:
        tables["topology"] = system.topology.tables()
    if system.constraints is not None:
        tables["constraint"] = system.constraints.tables()
    if system.virtual_sites is not None:
        tables["virtual_site"] = system.virtual_sites.tables
    if system.fixed is not None:
        tables["fixed"] = system.fixed.tables
    tables["force"] = [_force(system, force) for force in system.forces]
    if system.events:
        tables["event"] = [_event(system, event) for event in system.events]
    if said := system.run.said():
        tables["run"] = said
    if system.equilibration is not None:
        tables["equilibrate"] = system.equilibration.said()
    if system.stages:
        tables["stage"] = [each.said() for each in system.stages]
    if system.invariants:
        tables["invariants"] = dict(system.invariants)
    return tables


def _box(box: Box) -> dict[str, Any]:
    """Table ``[box]``: lengths if the edges are perpendicular and none is zero, else the matrix."""
    upright = not box.triclinic and all(edge > 0 for edge in box.matrix.diagonal())
    edges = {"lengths": box.lengths} if upright else {"matrix": box.matrix}
    return edges if all(box.periodic_axes) else {**edges, "periodic": box.periodic_axes}


def _force(system: System, force: Any) -> dict[str, Any]:
    """Table ``[[force]]``: the name, and the parameters that differ from the constructor's defaults."""
    cls = type(force)
    name = getattr(cls, "name", "")
    if FORCES.get(name) is not cls or not (is_dataclass(cls) or issubclass(cls, tuple)):
        raise InputError(
            f"to_toml: a system file cannot name the force {cls.__module__}.{cls.__qualname__}; "
            "kd.register_force gives a class of forces a name"
        )
    if reason := getattr(force, "unwritable", ""):
        raise InputError(f"to_toml: {reason}")
    table: dict[str, Any] = {"type": name}
    for key, parameter in signature(cls).parameters.items():
        value = getattr(force, key)
        if callable(value):
            value = path_of(value)
        unsaid = parameter.default is not Parameter.empty and _same(value, parameter.default)
        if value is None or unsaid or (isinstance(value, dict) and not value):
            continue
        if key == "pairs" and isinstance(force, PairForce):
            value = [{"species": pair, **parameters} for pair, parameters in value.items()]
        if key == "central" and not isinstance(value, str):
            value = index_of(system, value, name)
        table[key] = value
    return table


def _collision(event: Collision) -> dict[str, Any]:
    """Keys of a collision other than its radii."""
    table: dict[str, Any] = {"action": event.action, "restitution": event.restitution}
    for each in fields(event):
        if each.name not in (*table, "radii") and (value := getattr(event, each.name)) != each.default:
            table[each.name] = value
    if event.rule is not None:
        table["rule"] = named_function(event.rule)
        if "<" in table["rule"]:
            raise InputError(
                f"to_toml: a system file cannot name the rule {table['rule']}; expected a module's function"
            )
    return table


def _same(value: Any, default: Any) -> bool:
    return type(value) is type(default) and not hasattr(value, "__array__") and bool(value == default)


def _event(system: System, event: Event) -> dict[str, Any]:
    """Table ``[[event]]``, with bodies by name, or by row."""

    def body(given: Any) -> Any:
        return given if isinstance(given, str) else index_of(system, given, event.kind)

    table: dict[str, Any] = {"type": event.kind}
    if isinstance(event, CloseApproach):
        table |= {"distance": event.distance, "hill": event.hill, "action": event.action}
        return table if event.bodies is None else {**table, "bodies": [body(each) for each in event.bodies]}
    if isinstance(event, Collision):
        table |= _collision(event)
        return table if event.radii is None else {**table, "radii": event.radii}
    if isinstance(event, Escape):
        table |= {"distance": event.distance, "action": event.action}
        return table if event.about is None else {**table, "about": body(event.about)}
    assert isinstance(event, Crossing)
    between, passage = event.function, PASSAGES.get(event.kind)
    if not (isinstance(between, Between) and passage and passage(between.body, between.about) == event):
        raise InputError(
            f"to_toml: a system file cannot say the crossing {shown(event.name)}; expected one of {', '.join(PASSAGES)}"
        )
    return table | {"body": body(between.body), "about": body(between.about)}


_BARE = re.compile(r"[A-Za-z0-9_-]+")
WIDE = 100  # longest list on one line, in characters


def toml_text(table: Mapping[str, Any]) -> str:
    """TOML text of a table of tables. In a list of tables under a top key, each table has a heading."""
    return "\n".join(_lines(table)).lstrip("\n") + "\n"


def _lines(table: Mapping[str, Any]) -> Iterator[str]:
    for key, value in table.items():
        if not _headed(value):
            yield f"{_key(key)} = {_value(value, key)}"
    for key, value in table.items():
        if _headed(value):
            for one in [value] if isinstance(value, Mapping) else value:
                yield ""
                yield f"[{_key(key)}]" if isinstance(value, Mapping) else f"[[{_key(key)}]]"
                for inner, each in one.items():
                    yield f"{_key(inner)} = {_value(each, f'{key}.{inner}')}"


def _headed(value: Any) -> bool:
    several = isinstance(value, list) and bool(value) and all(isinstance(each, Mapping) for each in value)
    return isinstance(value, Mapping) or several


def _key(key: Any) -> str:
    return key if isinstance(key, str) and _BARE.fullmatch(key) else _quoted(str(key))


def _value(value: Any, where: str) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, str):
        return _quoted(value)
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_key(key)} = {_value(each, where)}" for key, each in value.items()) + " }"
    if isinstance(value, list):
        items = [_value(each, where) for each in value]
        line = f"[{', '.join(items)}]"
        return line if len(line) <= WIDE else "[\n" + "".join(f"  {item},\n" for item in items) + "]"
    raise InputError(f"{where}: a system file cannot hold {shown(value)}")


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
