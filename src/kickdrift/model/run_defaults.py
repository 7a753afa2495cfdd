"""Defaults of a run that a system file gives: its tables ``[run]`` and ``[equilibrate]``."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, Protocol, runtime_checkable

from kickdrift.errors import InputError
from kickdrift.model.units.quantities import UnitSystem, time_in
from kickdrift.text import shown

# A key of ``[run]``, and the keys that it replaces.
REPLACED = (
    ("steps", "time", "times"), ("time", "steps", "times"), ("every", "interval", "times"),
    ("interval", "every", "times"), ("times", "steps", "time", "every", "interval"),
    ("temperature", "temperature_to"), ("pressure", "pressure_to"),
)  # fmt: skip


def with_ramps(given: Mapping[str, Any]) -> dict[str, Any]:
    """Values of ``[run]`` by key, in which a ramp {"from": 300, "to": 2500} of a key is a start and an end, as
    ``temperature`` and ``temperature_to``. With "steps" in the ramp, it is that long."""
    found: dict[str, Any] = {}
    for key, value in given.items():
        if not (isinstance(value, Mapping) and {"from", "to"} & set(value)):
            found[key] = value
            continue
        if not {"from", "to"} <= set(value) <= {"from", "to", "steps"}:
            raise InputError(
                f"{key}: a ramp is {{from = 300, to = 2500}}, and steps if it is shorter, got {shown(value)}"
            )
        found |= {key: value["from"], f"{key}_to": value["to"]}
        if "steps" in value:
            found["ramp_steps"] = value["steps"]
    return found


@runtime_checkable
class NamedWithOptions(Protocol):
    """An integrator's name and options, as one value has them; see ``kickdrift.integrator``."""

    @property
    def name(self) -> str: ...

    @property
    def options(self) -> Mapping[str, Any]: ...


@dataclass(frozen=True, init=False)
class RunDefaults:
    """Values of a system file's ``[run]``. Flags and ``Simulation(…)`` override them.

    Attributes
    ----------
    integrator, dt, steps, time, times, every, interval : as in ``[run]``; None for a missing key
    options : the integrator's options in ``[run]``, by name
    """

    integrator: str | None = None
    dt: float | None = None
    steps: int | None = None
    time: float | None = None
    every: int | None = None
    interval: float | None = None
    times: tuple[float, ...] | None = None
    options: Mapping[str, Any] = field(default_factory=dict)

    def __init__(
        self,
        integrator: str | None = None,
        dt: float | None = None,
        steps: int | None = None,
        time: float | None = None,
        every: int | None = None,
        interval: float | None = None,
        times: Iterable[float] | None = None,
        **options: Any,
    ) -> None:
        own = {
            "integrator": integrator, "dt": dt, "steps": steps, "time": time, "every": every, "interval": interval,
            "times": None if times is None else tuple(times),
        }  # fmt: skip
        given = {key: value for key, value in with_ramps(options).items() if value is not None}
        for key, value in (own | {"options": given}).items():
            object.__setattr__(self, key, value)

    def __hash__(self) -> int:
        return hash(
            (
                self.integrator,
                self.dt,
                self.steps,
                self.time,
                self.every,
                self.interval,
                self.times,
                frozenset(self.options),
            )
        )

    def in_units(self, units: UnitSystem) -> RunDefaults:
        """Return the defaults with times that are text, such as dt = "2 fs", as numbers in ``units``."""
        alone = {key: time_in(getattr(self, key), units, key) for key in ("dt", "time", "interval")}
        row = self.times and tuple(time_in(value, units, f"times[{k}]") for k, value in enumerate(self.times))
        return RunDefaults(**self.said() | alone | {"times": row})

    def said(self) -> dict[str, Any]:
        """Values by key, including the options. As arguments they make an equal RunDefaults."""
        own = {key: value for key, value in vars(self).items() if key != "options" and value is not None}
        return own | dict(self.options)

    def changed(self, **defaults: Any) -> RunDefaults:
        """Return a copy with these values. Steps, time and times replace each other, and so do every and interval, and
        times replace these too.

        An integrator with options as one value gives its name and its options; an option beside the value replaces the
        value's own.
        """
        named = set(defaults)
        for one, *others in REPLACED:
            if one in named:
                defaults = dict.fromkeys(others) | defaults
        which = defaults.get("integrator")
        if isinstance(which, NamedWithOptions):
            given = {key: value for key, value in defaults.items() if value is not None}
            defaults |= {**which.options, **given, "integrator": which.name}
        return RunDefaults(**self.said() | defaults)


@dataclass(frozen=True)
class Equilibration:
    """Values of a system file's ``[equilibrate]``: a run at a temperature, before conservation is measured.

    Attributes
    ----------
    temperature : at the start, and to the end without ``to``
    time, steps : length; one of the two
    interval : steps between two rescalings of the velocities, without a heat bath
    to : temperature at the end of a ramp that is linear in time; None for a constant temperature
    integrator : method with a heat bath for the equilibration alone; None for the method of the run
    options : its options, by name
    """

    temperature: float
    time: float | None = None
    interval: int = 10
    to: float | None = None
    steps: int | None = None
    integrator: str | None = None
    options: Mapping[str, Any] = field(default_factory=dict, hash=False)

    def said(self) -> dict[str, Any]:
        """Values by key, including the options: arguments of ``Simulation.equilibrate``."""
        own = {key: value for key, value in vars(self).items() if key != "options" and value is not None}
        return own | dict(self.options)

    def ending_at(self, temperature: float) -> Equilibration:
        """The same equilibration with another temperature at its end."""
        return replace(self, temperature=temperature) if self.to is None else replace(self, to=temperature)

    @classmethod
    def of(cls, said: Mapping[str, Any]) -> Equilibration:
        """Return the Equilibration with these values by key."""
        own = {each.name for each in fields(cls)} - {"options"}
        options = {key: value for key, value in said.items() if key not in own and value is not None}
        return cls(**{key: value for key, value in said.items() if key in own}, options=options)
