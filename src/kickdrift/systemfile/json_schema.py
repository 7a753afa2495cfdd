"""The JSON schema of system files, by which editors complete keys and check values.

The schema comes from the same tables that read a file. It refuses unknown keys, missing keys and values of a wrong
type. Rules between keys, such as steps or time, need the loader. A schema also cannot tell 3.0 from 3: the loader
refuses 3.0 where it expects a whole number.
"""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable, Mapping
from typing import Any

from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema

from kickdrift.forces import FORCES
from kickdrift.forces.around import mass_change, radiation, relativity, tides
from kickdrift.forces.pairs.ends import TRUNCATIONS
from kickdrift.integrators import INTEGRATORS
from kickdrift.integrators.asked import known_options
from kickdrift.integrators.options import RAMPED
from kickdrift.model.events import collision
from kickdrift.model.molecules.topology import SIZES
from kickdrift.model.units.quantities import EXAMPLES
from kickdrift.model.units.unit_systems import UNIT_SYSTEMS, powers
from kickdrift.systemfile import events, schema, schema_base, schema_run
from kickdrift.systemfile.schema_base import In, NamedOrMore, OneOrMore, Spread

DIALECT = "http://json-schema.org/draft-07/schema#"  # the newest one that taplo and Even Better TOML know well
NAME = "system-file.schema.json"  # file beside the shipped systems
NAMED = f"#:schema ./{NAME}"  # first line of a system file that names its schema
WITH_UNIT = r"^\s*[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?\s*[^\s\d.].*$"  # a number and a unit

QUANTITY = "quantity"  # key that stands for a quantity until its definition is known

Json = dict[str, Any]
NUMBER: Json = {"type": "number"}
WHOLE: Json = {"type": "integer"}
TEXT: Json = {"type": "string"}
NAMES: Json = {"type": "array", "items": TEXT}
PARTICLES: Json = {"type": "array", "items": WHOLE}
GROUPS: Json = {"type": "array", "items": PARTICLES}  # particles of bonds, angles, …
_NAME_OR_NUMBER: Json = {"type": ["string", "integer"]}

# Values of keys whose type hints say too little, by table and key; "*" is any table.
_VALUES: dict[tuple[str, str], Json] = {
    ("*", "mixing"): {"enum": ["lorentz-berthelot"]},
    ("*", "truncation"): {"enum": list(TRUNCATIONS)},
    ("relativity-1pn", "form"): {"enum": list(relativity.FORMS)},
    ("radiation-pressure", "form"): {"enum": list(radiation.FORMS)},
    ("mass-change", "form"): {"enum": list(mass_change.FORMS)},
    ("tides", "rotation"): {"enum": list(tides.ROTATIONS)},
    ("*", "central"): _NAME_OR_NUMBER,
    ("python", "function"): TEXT,
    **{("beside", key): TEXT for key in ("f", "acts")},
    ("beside", "y0"): {"type": "array", "items": NUMBER},
    ("beside", "names"): NAMES,
    ("beside", "atol"): {"anyOf": [NUMBER, {"type": "array", "items": NUMBER}]},
    ("ase", "calculator"): TEXT,
    ("ase", "arguments"): {"type": "object"},
    ("ase", "symbols"): {"anyOf": [{"type": "object", "additionalProperties": TEXT}, NAMES]},
    ("system", "units"): {"enum": list(UNIT_SYSTEMS)},
    ("close-approach", "distance"): {"type": ["number", "string"]},  # Hill radii have no unit
    ("collision", "restitution"): {"anyOf": [NUMBER, {"const": collision.BRIDGES}]},
    **{("topology", key): GROUPS for key in ("bonds", "impropers", "exclusions")},
    **{("topology", key): {"anyOf": [GROUPS, {"type": "boolean"}]} for key in ("angles", "dihedrals")},
    ("constraint", "pairs"): GROUPS,
    **{("constraint", key): {"anyOf": [TEXT, NAMES, {"const": True}]} for key in ("bonds", "angles")},
    ("constraint", "rigid"): {"anyOf": [GROUPS, {"const": True}]},
    ("virtual_site", "particles"): {"anyOf": [WHOLE, PARTICLES]},
    ("fixed", "particles"): {"anyOf": [WHOLE, PARTICLES]},
    ("fixed", "species"): {"anyOf": [TEXT, NAMES]},
    ("virtual_site", "of"): {"anyOf": [PARTICLES, GROUPS]},
    ("virtual_site", "weights"): {"type": "array", "items": {"anyOf": [NUMBER, {"type": "array", "items": NUMBER}]}},
    **{("topology", f"{key[:-1]}_types"): {"anyOf": [TEXT, NAMES]} for key in SIZES},
}
_HELP: dict[tuple[str, str], str] = {
    ("system", "units"): "Unit system of plain numbers.",
    ("system", "title"): "Title, as lists and figures show it.",
    ("system", "dimensions"): "2 keeps all particles in the plane x-y.",
    ("system", "particles"): "Where the particles are: a lattice, positions, orbits, a cluster or a file.",
    ("system", "velocities"): "Velocities, drawn at a temperature or given.",
    ("system", "box"): "Edges of the box, and the axes along which it is periodic.",
    ("system", "topology"): "Bonds, angles, dihedrals and impropers of molecules.",
    ("system", "fixed"): "Particles that stay in place, or move at a given velocity.",
    ("system", "force"): "Forces; they add up.",
    ("system", "force_field"): "Force field of the particles' file, which OpenMM reads.",
    ("system", "event"): "Events that a run finds: collisions, close approaches, escapes and passages.",
    ("system", "run"): "Defaults of a run: integrator, step, length and options.",
    ("system", "equilibrate"): "A run at a temperature before the run itself.",
    ("system", "stage"): "The runs of a protocol, each from the end of the one before.",
    ("stage", "name"): "Name of the stage, with which the name of its file ends.",
    ("stage", "keep"): "Whether the stage has a file.",
    ("stage", "inherit"): "Whether the stage takes from [run] what it does not say itself.",
    ("stage", "minimize"): "Move the particles to a minimum of their energy in place of a run.",
    ("system", "invariants"): "What the system is known to conserve, with the source.",
    ("run", "integrator"): "Method; kickdrift list integrators explains each.",
    ("run", "steps"): "Number of steps; or give time.",
    ("run", "time"): "Length of the run; or give steps.",
    ("run", "every"): "Steps between samples; or give interval.",
    ("run", "interval"): "Time between samples; or give every.",
    ("run", "times"): "Times of samples and frames, which rise; the run ends at the last one.",
}


def json_schema() -> Json:
    """The JSON schema of system files, with the forces, methods and options that are registered now."""
    method = {"anyOf": [{"enum": sorted(INTEGRATORS)}, TEXT]}  # text: a method of the user's own
    run, ode_run = (_table(schema_run.run_table(units), "run", integrator=method) for units in (True, False))
    tables = {
        "force": {"oneOf": [_by_type(schema.force_table(cls), name, cls) for name, cls in FORCES.items()]},
        "event": {"oneOf": [_by_type(model, name) for name, model in events.TABLES.items()]},
        "run": run,
        "stage": _table(schema_run.stage_table(), "stage", integrator=method),
        "equilibrate": _table(schema_run.equilibrate_table(), "equilibrate", integrator=method),
        "topology": _table(schema_base.TopologyTable, "topology"),
        "constraint": _table(schema_base.ConstraintTable, "constraint"),
        "virtual_site": _table(schema_base.VirtualSiteTable, "virtual_site"),
        "fixed": _table(schema_base.FixedTable, "fixed"),
        "ode": {"oneOf": [_by_type(schema.ode_table(make), name, make, "problem") for name, make in _odes()]},
        "ode-run": ode_run,
    }
    system = _table(
        schema.SystemTable,
        "system",
        force={"type": "array", "items": _reference("force")},
        event={"type": "array", "items": _reference("event")},
        **{
            key: {"type": "array", "items": _reference(key)} for key in ("constraint", "virtual_site", "fixed", "stage")
        },
        **{key: _reference(key) for key in ("run", "equilibrate", "topology")},
    )
    parameters = {"properties": {"particles": {"required": ["coordinates"]}}}  # a file of a force field has its forces
    system["anyOf"] = [*({"required": [key]} for key in ("force", "force_field", "event")), parameters]
    ode = _table(schema.OdeFileTable, "system", ode=_reference("ode"), run=_reference("ode-run"))
    quantities: dict[str, Json] = {}
    tables = _shared({"particle-system": system, "ode-system": ode, **tables}, quantities)
    return {
        "$schema": DIALECT,
        "title": "kickdrift system file",
        "description": "What is simulated, and the defaults of a run.",
        "type": "object",
        "oneOf": [_reference("particle-system"), _reference("ode-system")],
        "definitions": {**tables, **dict(sorted(quantities.items()))},
    }


def json_schema_text() -> str:
    return json.dumps(json_schema(), indent=1, ensure_ascii=False) + "\n"


def _odes() -> Any:
    from kickdrift.odes import ODES

    return ODES.items()


def _reference(table: str) -> Json:
    return {"$ref": f"#/definitions/{table}"}


def _beside(given: Json, **more: Any) -> Json:
    """The schema with more keys; keys beside a reference count for nothing, so that the reference goes one deeper."""
    return ({"allOf": [given]} if "$ref" in given and more else given) | more


def _by_type(model: type[BaseModel], name: str, source: Any = None, key: str = "type") -> Json:
    """Schema of a table that is chosen by a name: the type of a force or an event, or the problem of an ODE."""
    found = _table(model, name, **{key: {"const": name}})
    text = inspect.getdoc(source or model) or ""
    found["description"] = " ".join(text.split("\n\n")[0].split())
    return found


def _table(model: type[BaseModel], name: str, **values: Json) -> Json:
    """Schema of a table; ``values`` are schemas of keys that replace those of the table."""
    inner = f"#/definitions/{name}/definitions/{{model}}"
    found = _spread_out(model.model_json_schema(schema_generator=_Generator, ref_template=inner))
    options = known_options() if issubclass(model, schema_run.RunTable | schema_run.EquilibrateTable) else {}
    ramped = RAMPED if issubclass(model, schema_run.RunTable) else {}
    for key, given in found["properties"].items():
        if key in ramped:
            ends = {"type": "object", "properties": {"from": given, "to": given, "steps": WHOLE}}
            ramp = ends | {"required": ["from", "to"], "additionalProperties": False}
            given = found["properties"][key] = {"anyOf": [given, ramp]}
        replaced = values.get(key) or _VALUES.get((name, key)) or _VALUES.get(("*", key))
        if replaced is not None:
            given = found["properties"][key] = dict(replaced)
        if help_ := _HELP.get((name, key)) or (key in options and options[key].help):
            found["properties"][key] = _beside(given, description=help_)
    return {"type": "object", **found}


def _spread_out(found: Json) -> Json:
    """The schema with each ``$ref`` replaced by its definition, so that it can stand inside another one."""
    definitions = found.pop("$defs", {})

    def without_references(each: Any) -> Any:
        if isinstance(each, list):
            return [without_references(item) for item in each]
        if not isinstance(each, dict):
            return each
        if "$ref" in each:
            return without_references(definitions[each["$ref"].rsplit("/", 1)[1]])
        return {key: without_references(item) for key, item in each.items()}

    made: Json = without_references(found)
    return made


class _Generator(GenerateJsonSchema):
    """Writer of the schema of a table: numbers with units as numbers or text, and no titles, nulls and defaults."""

    def function_before_schema(self, schema: Any) -> Json:
        """Schema of a value that one of kickdrift's validators reads."""
        function: Any = schema["function"]["function"]
        if isinstance(function, In):
            return _quantity(function)
        if isinstance(function, OneOrMore):
            one = _quantity(function.one)
            alone = TEXT if isinstance(function, NamedOrMore) else one
            return {"anyOf": [alone, {"type": "array", "items": one}]}
        if (special := _SPECIAL.get(function)) is not None:
            return special
        return super().function_before_schema(schema)

    def nullable_schema(self, schema: Any) -> Json:
        """Schema of a value that may be absent: TOML has no null."""
        return self.generate_inner(schema["schema"])

    def default_schema(self, schema: Any) -> Json:
        """Schema of a value with a default, which is not shown."""
        return self.generate_inner(schema["schema"])

    def field_title_should_be_set(self, schema: Any) -> bool:
        """Leave out titles, which only repeat the keys."""
        return False

    def model_schema(self, schema: Any) -> Json:
        """Schema of a table, without title and docstring."""
        found = super().model_schema(schema)
        return {key: each for key, each in found.items() if key not in ("title", "description")}


def _quantity(check: In) -> Json:
    """Schema of a number in the file's units, or of text with a unit."""
    one: Json = {QUANTITY: f"{check.sign} {check.dimension}"}
    if isinstance(check, Spread):
        return {"anyOf": [one, {"type": "array", "items": one, "minItems": 2, "maxItems": 2}]}
    return one


def _shared(each: Any, quantities: dict[str, Json]) -> Any:
    """The schema with a reference for each quantity; each definition is added to ``quantities``."""
    if isinstance(each, list):
        return [_shared(item, quantities) for item in each]
    if not isinstance(each, dict):
        return each
    if QUANTITY not in each:
        return {key: _shared(item, quantities) for key, item in each.items()}
    sign, dimension = each[QUANTITY].split(" ", 1)
    name = (dimension if sign == "any" else f"{sign} {dimension}").replace(" ", "-")
    number = NUMBER | {"any": {}, "positive": {"exclusiveMinimum": 0}, "non-negative": {"minimum": 0}}[sign]
    if powers(dimension):
        example = f", or text with a unit, such as {text!r}" if (text := EXAMPLES.get(dimension)) else ""
        about = f"{dimension[0].upper()}{dimension[1:]}: a number in the file's units{example}."
        number = {"description": about, "anyOf": [number, {"type": "string", "pattern": WITH_UNIT}]}
    quantities[name] = number
    rest = {key: item for key, item in each.items() if key != QUANTITY}
    return _beside(_reference(name), **rest)


def _by_name(value: Mapping[str, Any]) -> Json:
    return {"type": "object", "additionalProperties": dict(value)}


_MASS, _RADIUS = _quantity(In("mass", "non-negative")), _quantity(In("length", "non-negative"))
_CHARGE = _quantity(In("charge"))
_SPECIAL: dict[Callable[..., Any], Json] = {
    schema.mass_given: {"anyOf": [_MASS, _by_name(_MASS)]},
    schema.charge_given: {"anyOf": [_CHARGE, _by_name(_CHARGE)]},
    schema.species_given: {"anyOf": [TEXT, NAMES, _by_name(NUMBER)]},
    schema.density_given: _quantity(In("number density")),
    events.radii_given: {"anyOf": [_RADIUS, {"type": "array", "items": _RADIUS}, _by_name(_RADIUS)]},
}
