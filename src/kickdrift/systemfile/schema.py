"""Schema of system files, one pydantic model per table. Each error is one line: the key path and the expected value."""

from __future__ import annotations

import inspect
import math
import os
from collections.abc import Callable, Sequence
from dataclasses import is_dataclass
from functools import cache
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from pydantic import (
    BaseModel,
    BeforeValidator,
    Discriminator,
    Field,
    NonNegativeInt,
    PositiveInt,
    Tag,
    ValidationError,
    ValidationInfo,
    create_model,
    model_validator,
)
from pydantic_core import ErrorDetails

from kickdrift.errors import InputError
from kickdrift.forces.bonded.law import BondedForce
from kickdrift.forces.pairs.ends import End
from kickdrift.forces.pairs.law import PairForce
from kickdrift.integrators.asked import known_options
from kickdrift.model.checks import values as checks
from kickdrift.model.run_defaults import RunDefaults
from kickdrift.model.units.unit_systems import UnitSystem
from kickdrift.systemfile import schema_base as base
from kickdrift.systemfile.schema_base import In, Table
from kickdrift.text import VALUE, clean, shown, suggestion


def mass_given(value: Any, info: ValidationInfo) -> float | dict[str, float]:
    convert = In("mass", "non-negative")
    return {k: convert(v, info) for k, v in value.items()} if isinstance(value, dict) else convert(value, info)


def charge_given(value: Any, info: ValidationInfo) -> float | dict[str, float]:
    convert = In("charge")
    return {k: convert(v, info) for k, v in value.items()} if isinstance(value, dict) else convert(value, info)


def species_given(value: Any) -> dict[str, float] | list[str]:
    """Species: one name, a list of names, or fractions that add up to one."""
    if isinstance(value, str):
        return {value: 1.0}
    if isinstance(value, list) and value and all(isinstance(name, str) for name in value):
        return value
    if isinstance(value, dict) and value:
        parts = [checks.number(part) for part in value.values()]
        if all(0 < part <= 1 for part in parts) and abs(math.fsum(parts) - 1) < 1e-9:
            return dict(zip(value, parts, strict=True))
        raise InputError(f"expected positive fractions that add up to 1, got {shown(value)}")
    raise InputError(f"expected a name, a list of names, or fractions such as {{A = 0.8, B = 0.2}}, got {shown(value)}")


def density_given(value: Any) -> Any:
    if isinstance(value, str) or (isinstance(value, int | float) and not isinstance(value, bool)):
        return value  # converted later, when the mass is known
    raise InputError(f"expected a number density or a mass density, got {shown(value)}")


Masses = Annotated[Any, BeforeValidator(mass_given)]
Charges = Annotated[Any, BeforeValidator(charge_given)]
Species = Annotated[Any, BeforeValidator(species_given)]
Density = Annotated[Any, BeforeValidator(density_given)]


class LatticeTable(Table):
    lattice: Literal[
        "sc", "bcc", "fcc", "diamond", "rock-salt", "caesium-chloride", "zincblende", "square", "hexagonal"
    ]
    count: PositiveInt
    density: Density = None
    mass: Masses = None
    charge: Charges = None
    species: Species = {"A": 1.0}
    molecule: Annotated[list[base.Vector], Field(min_length=1)] | None = None
    seed: NonNegativeInt | None = None


class WalkTable(Table):
    bond: base.Edge
    apart: base.Length = 0.0


class WalksTable(Table):
    walks: WalkTable
    density: Density = None
    mass: Masses = None
    charge: Charges = None
    species: Species = {"A": 1.0}
    seed: NonNegativeInt


class PositionsTable(Table):
    positions: Annotated[list[base.Vector], Field(min_length=1)]
    mass: Masses = None
    masses: list[base.Mass] | None = None
    charge: Charges = None
    charges: list[base.Charge] | None = None
    GM: list[base.GravitationalParameter] | None = None
    barycentric: bool = False
    species: Species = {"A": 1.0}
    names: list[str] = []
    radii: list[base.Radius] | None = None


class FileTable(Table):
    file: str
    coordinates: str | None = None  # of a file of a force field
    frame: int | None = None  # of a run's file
    charge: Charges = None
    charges: list[base.Charge] | None = None
    atom_style: Literal["atomic", "charge", "bond", "angle", "molecular", "full"] | None = None  # of LAMMPS' data files


PARTICLES = ("lattice", "walks", "positions", "elements", "plummer", "king", "file")


def _kind(data: Any) -> str | None:
    kinds = [key for key in PARTICLES if isinstance(data, dict) and key in data]
    return f"<{kinds[0]}>" if len(kinds) == 1 else None


ParticlesTable = Annotated[
    Annotated[LatticeTable, Tag("<lattice>")]
    | Annotated[WalksTable, Tag("<walks>")]
    | Annotated[PositionsTable, Tag("<positions>")]
    | Annotated[base.ElementsTable, Tag("<elements>")]
    | Annotated[base.PlummerTable, Tag("<plummer>")]
    | Annotated[base.KingTable, Tag("<king>")]
    | Annotated[FileTable, Tag("<file>")],
    Discriminator(_kind, "particles", f"expected a table with exactly one of {', '.join(PARTICLES)}"),
]


class VelocitiesTable(Table):
    temperature: base.Temperature | None = None
    seed: NonNegativeInt | None = None
    values: list[Annotated[list[base.Velocity], Field(min_length=3, max_length=3)]] | None = None

    @model_validator(mode="after")
    def _drawn_or_given(self) -> VelocitiesTable:
        self.one_of("temperature", "values")
        if (self.seed is None) != (self.temperature is None):
            raise InputError("seed and temperature need each other: velocities are drawn with a seed, such as seed = 1")
        return self


Axes = Annotated[
    Annotated[bool, Tag("<true or false>")]
    | Annotated[list[bool], Field(min_length=3, max_length=3), Tag("<one for each axis>")],
    Discriminator(lambda value: "<one for each axis>" if isinstance(value, list) else "<true or false>"),
]


class BoxTable(Table):
    periodic: Axes | None = None
    lengths: list[base.Edge] | None = None
    matrix: list[list[base.Length]] | None = None

    @model_validator(mode="after")
    def _agree(self) -> BoxTable:
        given = [key for key in ("lengths", "matrix") if getattr(self, key) is not None]
        if len(given) == 2:
            raise InputError("expected lengths or matrix, got both")
        if given and (self.periodic is False or self.periodic == [False] * 3):
            verb = "makes" if given == ["matrix"] else "make"
            raise InputError(f"{given[0]} {verb} a box periodic, but periodic = false")
        return self


class ForceFieldTable(Table):
    files: list[str] = []
    cutoff: base.Edge | None = None
    rigid: Literal["hydrogen", "water", "none"] | None = None


class SystemTable(Table):
    units: str
    title: str = ""
    dimensions: Literal[2, 3] = 3
    time: base.Start | None = None
    particles: ParticlesTable
    velocities: VelocitiesTable | None = None
    box: BoxTable = BoxTable()
    topology: base.TopologyTable | None = None
    constraint: list[base.ConstraintTable] = []
    virtual_site: list[base.VirtualSiteTable] = []
    fixed: list[base.FixedTable] = []
    force: list[dict[str, Any]] | None = None  # each is checked against the constructor of its class
    force_field: ForceFieldTable | None = None  # in place of forces, or beside them
    event: list[dict[str, Any]] = []  # each is checked against the table of its type
    run: dict[str, Any] = {}  # checked against the options of the methods
    equilibrate: dict[str, Any] | None = None  # checked as [run] is
    stage: list[dict[str, Any]] = []  # each is checked as [run] is
    invariants: dict[str, Any] = {}

    @classmethod
    def hint(cls, key: str) -> str:
        """Suggest a key; for a key of one of the tables, also name its table."""
        run = [*RunDefaults().__dict__, *known_options()]
        within = {"velocities": VelocitiesTable.model_fields, "run": run, "box": BoxTable.model_fields}
        within["topology"] = base.TopologyTable.model_fields
        found = [f"{table}.{key}" for table, keys in within.items() if key in keys]
        if found:
            return f"; did you mean {found[0]}?"
        if near := super().hint(key):
            return near
        for table, keys in within.items():
            if hint := suggestion(key, keys):
                return hint.replace("'", f"'{table}.", 1)
        return ""


class OdeFileTable(Table):
    title: str = ""
    ode: dict[str, Any]  # checked against the factory that ``problem`` names
    run: dict[str, Any] = {}
    invariants: dict[str, Any] = {}


@cache
def ode_table(factory: Callable[..., Any]) -> type[Table]:
    """Table [ode] of a factory of Problems, with the factory's parameters."""
    hints = get_type_hints(factory)
    fields: dict[str, Any] = {"problem": (str, ...)}
    for key, parameter in inspect.signature(factory).parameters.items():
        fields[key] = (list[float] if key == "y0" else hints[key], parameter.default)
    return create_model(factory.__name__, __base__=Table, **fields)


def shaped(hint: Any, number: Any) -> Any:
    """Type for a table from a parameter's type hint: each float in it becomes a checked ``number``, a tuple a list of
    that length, a dict a table."""
    kinds = [kind for kind in get_args(hint) if kind is not NoneType and get_origin(kind) is not os.PathLike]
    if hint is float:
        return number
    if get_origin(hint) is tuple and Ellipsis not in kinds:
        length = len(kinds)
        return Annotated[list[shaped(kinds[0], number)], Field(min_length=length, max_length=length)]  # type: ignore[misc]
    if get_origin(hint) is Sequence:
        return list[shaped(kinds[0], number)]  # type: ignore[misc]
    if get_origin(hint) is dict:
        return dict[str, shaped(kinds[1], number)]  # type: ignore[misc]
    if get_origin(hint) in (Union, UnionType):
        if len(kinds) == 1:
            return shaped(kinds[0], number)
        by_form = {_form_of(kind): kind for kind in kinds}
        if len(by_form) == len(kinds):  # tags, so that an error names the kind that the user gave
            tagged = [Annotated[shaped(kind, number), Tag(form)] for form, kind in by_form.items()]
            return Annotated[Union[tuple(tagged)], Discriminator(lambda given: _form(tuple(by_form), given))]  # noqa: UP007
        return Union[tuple(kinds)]  # noqa: UP007
    return hint


def _form_of(hint: Any) -> str:
    """Form of values with this type hint: one value, a list, a list of lists, or a table."""
    if get_origin(hint) not in (tuple, Sequence):
        return "<table>" if get_origin(hint) is dict else "<one>"
    return "<lists>" if get_origin(get_args(hint)[0]) in (tuple, Sequence) else "<list>"


def _form(forms: tuple[str, ...], given: Any) -> str:
    """Form of a value, or the first of these forms."""
    found = "<table>" if isinstance(given, dict) else "<one>"
    if isinstance(given, list):
        found = "<lists>" if given and isinstance(given[0], list) and "<lists>" in forms else "<list>"
    return found if found in forms else forms[0]


@cache
def force_table(cls: type) -> type[Table]:
    """Table of a force: the parameters of its constructor, with units from its ``dimensions``."""
    dimensions: dict[str, str] = getattr(cls, "dimensions", {})
    made_of_fields = is_dataclass(cls) or issubclass(cls, tuple)
    hints = get_type_hints(cls if made_of_fields else vars(cls)["__init__"])
    law = getattr(cls, "law_keys", getattr(getattr(cls, "Parameters", None), "_fields", tuple(dimensions)))
    plain = Annotated[float, BeforeValidator(In("dimensionless"))]
    number: dict[str, Any] = dict.fromkeys(law, plain)
    number |= {key: Annotated[float, BeforeValidator(In(kind))] for key, kind in dimensions.items()}
    given: dict[str, Any] = {key: (shaped(hints.get(key, float), number[key]), None) for key in law}
    if issubclass(cls, PairForce):
        given |= {key: (number.get(key, str), None) for key in End._fields}
    one: Any = create_model("one", __base__=Table, **given)
    names: Any = (Annotated[list[str], Field(min_length=2, max_length=2)], ...)
    fields: dict[str, Any] = {"type": (str, ...)}
    for key, parameter in inspect.signature(cls).parameters.items():
        if key == "species":
            kind: Any = dict[str, one]
        elif key == "types" and issubclass(cls, BondedForce):
            kind = dict[str, one]
        elif key == "pairs" and issubclass(cls, PairForce):
            pair: Any = create_model("pair", __base__=one, species=names)
            kind = list[pair]
        else:
            kind = shaped(hints.get(key, float if key in number else Any), number.get(key, plain))
        fields[key] = (kind, ... if parameter.default is inspect.Parameter.empty else parameter.default)
    return create_model(cls.__name__, __base__=Table, **fields)


def force_parameters(cls: type, given: dict[str, Any], units: UnitSystem, path: str) -> dict[str, Any]:
    """Arguments for a force's constructor from its table, checked without a call to the class."""
    parameters = checked(force_table(cls), given, units, path).model_dump(exclude_unset=True)
    parameters.pop("type", None)
    if "pairs" in parameters and issubclass(cls, PairForce):
        pairs: dict[tuple[str, ...], Any] = {}
        for k, pair in enumerate(parameters["pairs"]):
            names = tuple(pair.pop("species"))
            if names in pairs or names[::-1] in pairs:
                raise InputError(f"{path}.pairs[{k}].species: the pair {'-'.join(names)} is given twice")
            pairs[names] = pair
        parameters["pairs"] = pairs
    return parameters


def checked(model: type[BaseModel], data: Any, units: UnitSystem | None, path: str = "") -> Any:
    """Values of the table ``model`` from ``data``, in ``units``. Raises an InputError of one line that starts with the
    key path."""
    try:
        return model.model_validate(data, context={"units": units})
    except ValidationError as error:
        raise InputError(_line(error.errors(include_url=False)[0], path)) from None


_WORDS = {
    "a valid integer": "a whole number",
    "a valid string": "text in quotes",
    "a valid boolean": "true or false",
    "a valid list": "a list",
    "a valid dictionary": "a table",
    "expected greater": "expected a number greater",
    "expected less": "expected a number less",
}


def _line(error: ErrorDetails, path: str) -> str:
    kind, context = error["type"], error.get("ctx", {})
    for part in (*error["loc"], *([context["key"]] if kind == "unknown_key" else [])):
        if isinstance(part, int):
            path += f"[{part}]"
        elif not (key := str(part)).startswith("<"):  # the tag of a union is not a key of the file
            path += f".{clean(key, VALUE)}" if path else clean(key, VALUE)
    if kind == "value_error":
        text = str(context["error"])
    elif kind == "missing":
        text = "required key is missing"
    elif kind in ("too_short", "too_long"):
        wanted = context.get("min_length", context.get("max_length"))
        text = f"expected {wanted}{' or more' if wanted == 1 else ''} items, got {context['actual_length']}"
    elif kind in ("unknown_key", "table", "particles"):
        text = error["msg"]
    else:
        words = error["msg"].replace("Input should be", "expected")
        for pydantics, ours in _WORDS.items():
            words = words.replace(pydantics, ours)
        text = f"{words}{f' of tables [[{path}]]' if path in ('force', 'event') else ''}, got {shown(error['input'])}"
    return " ".join(f"{path}: {text}".split())
