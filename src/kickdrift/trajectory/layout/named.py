"""Named parts of a run's file: forces, events, methods and defaults.

Names are looked up in registries alone, never in a module. Parameters are checked before any call uses them. So a file
is data, whoever wrote it.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import MISSING, fields
from functools import cache
from inspect import Parameter, signature
from typing import Any, get_type_hints

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, create_model
from pydantic.errors import PydanticUserError

from kickdrift.engines import engine as engine_named
from kickdrift.errors import InputError
from kickdrift.forces import force_class
from kickdrift.forces.seam.named import found_function
from kickdrift.integrators import integrator as method_named
from kickdrift.integrators.asked import known_options
from kickdrift.model.checks.limits import NEVER
from kickdrift.model.events.events import Between, CloseApproach, Collision, Crossing, Escape, Event
from kickdrift.model.run_defaults import Equilibration, RunDefaults
from kickdrift.model.stages import Stage
from kickdrift.model.units.unit_systems import UNIT_SYSTEMS
from kickdrift.systemfile.schema import checked, force_parameters
from kickdrift.systemfile.schema_base import Table
from kickdrift.text import shown

PLAIN = UNIT_SYSTEMS["lj"]  # quantities in a file are numbers, never text with a unit
EVENTS: dict[str, Any] = {event.__name__: event for event in (CloseApproach, Collision, Crossing, Escape)}


class Known(BaseModel):
    """Part of a file's JSON; unknown keys are ignored."""

    model_config = ConfigDict(extra="ignore", allow_inf_nan=False)


class Named(Known):
    """Class name and parameters of a force or an event."""

    type: str
    module: str = ""
    kind: str = ""
    source: str = ""
    parameters: dict[str, Any]


class Record(Known):
    """Record that `record_of` writes and `system_of` reads."""

    name: str
    forces: list[Named]
    events: list[Named] = []
    run: dict[str, Any]
    equilibration: dict[str, Any] | None
    invariants: dict[str, Any]
    seed: int | None
    radii: list[FiniteFloat] | None = None
    dimensions: int = 3
    topology: dict[str, Any] | None = None
    constraints: list[dict[str, Any]] = []
    virtual_sites: list[dict[str, Any]] = []
    stages: list[dict[str, Any]] = []
    ephemerides: list[str] = []
    room: int = Field(0, ge=0, lt=NEVER)
    time: FiniteFloat
    steps_done: int = Field(ge=0, lt=NEVER)


class Method(Known):
    """Description of a method in a run's file."""

    integrator: str
    options: dict[str, Any]
    threads: int = Field(ge=1)
    engine: str
    processes: int = Field(1, ge=1)


@contextmanager
def about(path: Any, what: str = "") -> Iterator[None]:
    """Put the file's name, and ``what`` part is meant, before the message of an InputError."""
    try:
        yield
    except InputError as error:
        text, start = str(error), f"{path}: "
        raise InputError(text if text.startswith(start) else f"{start}{what and what + ': '}{text}") from None


def plain(text: str) -> str:
    """A name from a file as a short piece of printable text."""
    return shown(text)[1:-1]


# --- forces ---


def force_of(given: Named) -> Any:
    """Make the force that a file describes. Raises InputError for a class that a file may not name, and for bad
    parameters."""
    cls, name = force_class(given.module, given.type), plain(given.type.rpartition(".")[2])
    if cls is None:
        raise InputError(
            f"force {name} belongs to module {plain(given.module)}, which is not loaded or does not register this "
            "force; load the module first (on the command line with --load FILE.py), or give the system"
        )
    parameters = {key: value for key, value in given.parameters.items() if value is not None or key not in _left(cls)}
    if isinstance(pairs := parameters.get("pairs"), list) and all(_is_item(each) for each in pairs):
        parameters["pairs"] = [{"species": names, **inner} for names, inner in pairs]
    try:
        return cls(**force_parameters(cls, {"type": name, **parameters}, PLAIN, f"force {name}"))
    except InputError:
        raise
    except (ArithmeticError, LookupError, NameError, PydanticUserError, TypeError, ValueError) as error:
        why = " ".join(str(error).split())
        raise InputError(f"force {name}: cannot be made from the file's parameters: {why[:200]}") from None


def _left(cls: type) -> list[str]:
    """Parameters of a class that are required or have None as their default."""
    found = signature(cls).parameters.items()
    return [key for key, each in found if each.default is None or each.default is Parameter.empty]


def _is_item(value: Any) -> bool:
    """Tell whether a value is `to_json`'s form of a dictionary's item whose key is a tuple."""
    return isinstance(value, list) and len(value) == 2 and isinstance(value[0], list) and isinstance(value[1], dict)


# --- events, defaults, method ---


def event_of(given: Named) -> Event:
    """Make the event that a file describes."""
    name = plain(given.kind or given.type)
    cls = EVENTS.get(given.type)
    if cls is None:
        raise InputError(f"event {name}: expected one of {', '.join(EVENTS)}, got {plain(given.type)}")
    parameters = dict(given.parameters)
    function = parameters.pop("function", None)
    if cls is Crossing:
        if not isinstance(function, Mapping):
            raise InputError(f"event {name!r} has a function of the user; give the events again")
        function = Between(**_checked(Between, dict(function), f"event {name}.function"))
    rule = parameters.pop("rule", None)
    found = _checked(cls, parameters, f"event {name}")
    if rule is not None:
        try:
            found["rule"] = found_function(f"event {name}: rule", rule)
        except InputError:
            raise InputError(
                f"event {name}: rule {shown(rule)} is a function of the user; load its module first (on the command "
                "line with --load FILE.py), or give the events again"
            ) from None
    return cls(**found) if cls is not Crossing else cls(function=function, **found)


def equilibration_of(given: Mapping[str, Any]) -> Equilibration:
    """Make the Equilibration that a file describes."""
    hints = get_type_hints(Equilibration)
    own = {key: hints[key] for key in _fields(Equilibration) if key != "options"}
    types = {"dt": float} | _option_types() | own
    known = {key: value for key, value in given.items() if key in types and value is not None}
    return Equilibration.of(_filled(_optional("Equilibration", types), known, "equilibrate"))


def run_of(given: Mapping[str, Any]) -> RunDefaults:
    """Make the RunDefaults that a file describes. Unknown options are ignored."""
    hints = get_type_hints(RunDefaults)
    types = {key: hints[key] for key in _fields(RunDefaults) if key != "options"} | _option_types()
    known = {key: value for key, value in given.items() if key in types}
    return RunDefaults(**_filled(_optional("RunDefaults", types), known, "run"))


def stage_of(given: Mapping[str, Any]) -> Stage:
    """Make the Stage that a file describes."""
    hints = get_type_hints(RunDefaults)
    types = {key: hints[key] for key in _fields(RunDefaults) if key != "options"} | _option_types()
    types |= {"name": str, "keep": bool, "minimize": bool | dict[str, Any]}
    return Stage(**_filled(_optional("Stage", types), dict(given), "stage"))


def options_of(given: Mapping[str, Any]) -> dict[str, Any]:
    """Options of a method that a file describes. An option that this version does not know must be unset."""
    types = {"dt": float} | _option_types()
    for key, value in given.items():
        if key not in types and value not in (None, False):
            raise InputError(f"method: option {plain(key)} is unknown to this version of kickdrift")
    known = {key: value for key, value in given.items() if key in types}
    return _filled(_optional("Options", types), known, "method")


def method_of(given: Any) -> Method:
    """Description of a method in a file, with registered names only."""
    method: Method = checked(Method, {"engine": "native"} | given if isinstance(given, dict) else given, None, "method")
    method_named(method.integrator)
    engine_named(method.engine)
    return method


def _checked(cls: type, given: dict[str, Any], what: str) -> dict[str, Any]:
    """Arguments of a dataclass, checked. Raises InputError for unknown names and for values of a wrong type."""
    return _filled(_table(cls), given, what)


def _filled(table: type[Table], given: dict[str, Any], what: str) -> dict[str, Any]:
    """Values of a table, checked."""
    found = checked(table, given, None, what)
    return {key: getattr(found, key) for key in found.model_fields_set}


def _option_types() -> dict[str, Any]:
    """Types of all options that some method takes."""
    return {name: each.hint for name, each in known_options().items()}


def _optional(name: str, types: Mapping[str, Any]) -> type[Table]:
    """Table with optional keys of these types."""
    return create_model(name, __base__=Lenient, **{key: (kind | None, None) for key, kind in types.items()})  # type: ignore[call-overload]


def _fields(cls: type) -> dict[str, Any]:
    return {each.name: each for each in fields(cls)}


@cache
def _table(cls: type) -> type[Table]:
    """Table for the arguments of a dataclass. An event's functions are found elsewhere."""
    hints = get_type_hints(cls)
    own: dict[str, Any] = {
        key: (hints[key], ... if each.default is MISSING else each.default)
        for key, each in _fields(cls).items()
        if key not in ("function", "rule")
    }
    return create_model(cls.__name__, __base__=Lenient, **own)


class Lenient(Table):
    """A table that accepts whole numbers as floats and the reverse, as programs write them."""

    model_config = ConfigDict(extra="forbid", strict=False, allow_inf_nan=False)
