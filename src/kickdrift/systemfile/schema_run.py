"""Table ``[run]``: the length of a run, and the options that methods declare."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from itertools import pairwise
from math import isfinite
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Discriminator, Field, PositiveFloat, Tag, create_model, model_validator

from kickdrift.errors import InputError
from kickdrift.integrators import INTEGRATORS
from kickdrift.integrators.asked import known_options, meant, refuse_other_baths
from kickdrift.integrators.options import DT, OPTIONS, Option
from kickdrift.model.checks.arguments import other_name
from kickdrift.model.checks.limits import MOST_STEPS
from kickdrift.model.run_defaults import Equilibration, RunDefaults, with_ramps
from kickdrift.model.stages import Stage
from kickdrift.model.units.unit_systems import UnitSystem
from kickdrift.systemfile.files import prefixed
from kickdrift.systemfile.schema import checked
from kickdrift.systemfile.schema_base import In, Table, Temperature, Time

AnyTime = Annotated[float, BeforeValidator(In("time", "non-negative"))]
Steps = Annotated[int, Field(gt=0, le=MOST_STEPS)]


class RunTable(Table):
    """Keys of ``[run]`` that are not options; ``run_keys`` has all."""

    integrator: str | None = None
    dt: Time | None = None
    steps: Steps | None = None
    time: Time | None = None
    every: Steps | None = None
    interval: Time | None = None
    times: Annotated[list[AnyTime], Field(min_length=1)] | None = None

    @model_validator(mode="after")
    def _steps_or_time(self) -> RunTable:
        if self.steps is not None and self.time is not None:
            raise InputError("expected steps or time, got both")
        if self.every is not None and self.interval is not None:
            raise InputError("expected every or interval, got both")
        for key in ("steps", "time", "every", "interval"):
            if self.times is not None and getattr(self, key) is not None:
                raise InputError(f"expected times or {key}, got both")
        for before, after in pairwise(self.times or ()):
            if not before < after:
                raise InputError(f"times must rise, got {before:.12g} before {after:.12g}")
        return self

    @classmethod
    def hint(cls, key: str) -> str:
        """Suggest a known key; for an option, also name the methods that take it."""
        if hint := other_name("option", key):
            return hint
        found = super().hint(key)
        return meant(key) if any(f"{name!r}" in found for name in known_options()) else found


class MinimizeTable(Table):
    """Keys of ``minimize`` in ``[[stage]]``."""

    method: Literal["fire", "l-bfgs"] | None = None
    force: Annotated[float, BeforeValidator(In("force", "positive"))] | None = None
    steps: Annotated[int, Field(ge=0, le=MOST_STEPS)] | None = None
    max_displacement: Annotated[float, BeforeValidator(In("length", "positive"))] | None = None
    soft: bool | None = None


class StageTable(RunTable):
    """Keys of ``[[stage]]`` that are not options."""

    name: str
    keep: bool = True
    inherit: bool = True
    minimize: (
        Annotated[
            Annotated[bool, Tag("<true or false>")] | Annotated[MinimizeTable, Tag("<table>")],
            Discriminator(lambda value: "<table>" if isinstance(value, dict | MinimizeTable) else "<true or false>"),
        ]
        | None
    ) = None


class OdeRunTable(RunTable):
    """Table ``[run]`` of an ODE, with times without a unit."""

    dt: PositiveFloat | None = None
    time: PositiveFloat | None = None
    interval: PositiveFloat | None = None
    times: Annotated[list[Annotated[float, Field(ge=0.0, allow_inf_nan=False)]], Field(min_length=1)] | None = None


class EquilibrateTable(Table):
    """Keys of ``[equilibrate]`` that are not options."""

    temperature: Temperature | None = None
    to: Temperature | None = None
    time: Time | None = None
    steps: Steps | None = None
    interval: Annotated[int, Field(gt=0)] = 10
    integrator: str | None = None

    @model_validator(mode="after")
    def _steps_or_time(self) -> EquilibrateTable:
        if (self.steps is None) == (self.time is None):
            raise InputError(f"expected time or steps, got {'neither' if self.steps is None else 'both'}")
        return self

    @classmethod
    def hint(cls, key: str) -> str:
        """Suggest a known key; for an option, also name the methods that take it."""
        return RunTable.hint(key)


def is_run_key(name: str) -> bool:
    """Tell whether ``[run]`` has this key."""
    return name in RunTable.model_fields or name in OPTIONS or name in known_options()


def run_keys() -> list[str]:
    """All keys of ``[run]``: its own, and the options of all methods."""
    return [*RunTable.model_fields, *known_options()]


def run_defaults(given: Mapping[str, Any], units: UnitSystem | None) -> RunDefaults:
    """Checked values of ``[run]``; without ``units``, of an ODE."""
    found = RunDefaults(**checked(run_table(units is not None), _apart(given, "run"), units, "run").model_dump())
    if found.integrator in INTEGRATORS:
        refuse_other_baths(INTEGRATORS[found.integrator], found.options, "run.")
    return found


def stage_of(given: Mapping[str, Any], units: UnitSystem, path: str) -> Stage:
    """Checked values of ``[[stage]]``."""
    found = checked(stage_table(), _apart(given, path), units, path).model_dump(exclude_none=True)
    with prefixed(f"{path}: "):
        return Stage(**found)


def _apart(given: Mapping[str, Any], path: str) -> dict[str, Any]:
    """Values by key, with ramps as a start and an end."""
    with prefixed(f"{path}."):
        return with_ramps(given)


def equilibration_of(given: Mapping[str, Any], units: UnitSystem, run: RunDefaults) -> Equilibration:
    """Checked values of ``[equilibrate]``; the temperature is by default that of the heat bath of ``run``."""
    found = checked(equilibrate_table(), given, units, "equilibrate").model_dump()
    if found["temperature"] is None:
        found["temperature"] = run.options.get("temperature")
    if found["temperature"] is None:
        raise InputError("equilibrate.temperature: is missing, and [run] has no heat bath with a temperature")
    return Equilibration.of(found)


def run_table(units: bool) -> type[Table]:
    """Table ``[run]`` with the options of all methods; without ``units``, of an ODE."""
    return _options_table("run", RunTable if units else OdeRunTable, tuple(known_options().values()), units)


def stage_table() -> type[Table]:
    """Table ``[[stage]]`` with the options of all methods."""
    return _options_table("stage", StageTable, tuple(known_options().values()), True)


def equilibrate_table() -> type[Table]:
    """Table ``[equilibrate]`` with the options of all methods."""
    options = tuple(each for name, each in known_options().items() if name not in EquilibrateTable.model_fields)
    return _options_table("equilibrate", EquilibrateTable, (DT, *options), True)


@cache
def _options_table(name: str, base: type[Table], options: tuple[Option, ...], units: bool) -> type[Table]:
    """Table of the keys of ``base`` and of these options, with or without units."""
    fields: Any = {each.name: (_type(each, units) | None, None) for each in options}
    made: type[Table] = create_model(name, __base__=base, **fields)
    return made


def _type(option: Option, units: bool) -> Any:
    """Type of an option's values in a system file."""
    if option.count > 1:
        each: Any = _type(replace(option, count=1), units)
        return Annotated[list[each], Field(min_length=option.count, max_length=option.count)]
    if option.choices:
        return Literal[option.choices]
    if option.dimension and units:
        sign: Literal["positive", "any"] = "positive" if option.above == 0.0 else "any"
        return Annotated[float, BeforeValidator(In(option.dimension, sign))]
    one: Any = option.type
    if option.type in (float, int):
        bounds: dict[str, Any] = {"gt": option.above, "le": option.most}
        one = Annotated[option.type, Field(**{key: bound for key, bound in bounds.items() if isfinite(bound)})]
    if not option.several:
        return one
    several = "<one for each component of y>"
    return Annotated[
        Annotated[one, Tag("<number>")] | Annotated[list[one], Field(min_length=1), Tag(several)],
        Discriminator(lambda value: several if isinstance(value, list) else "<number>"),
    ]
