"""Integrators with options as one value, and checks of options by name and as text."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from typing import Any, NamedTuple

from kickdrift.errors import InputError
from kickdrift.integrators import INTEGRATORS
from kickdrift.integrators import integrator as method_named
from kickdrift.integrators.method import Method
from kickdrift.integrators.options import (
    BAROSTAT,
    BAROSTATS,
    DT,
    OF_SOME,
    OPTIONS,
    PRECISION,
    SEED,
    TEMPERATURE,
    Option,
    Options,
    merged,
)
from kickdrift.integrators.splitting.subflows import FLOWS
from kickdrift.model.checks.arguments import other_name
from kickdrift.model.run_defaults import RunDefaults, with_ramps
from kickdrift.model.units.quantities import UNIT_SYSTEMS, UnitSystem
from kickdrift.text import VALUE, clean, shown

FEW = 4  # most methods that a message names


@dataclass(frozen=True)
class Integrator:
    """An integrator with options, usable in place of an integrator's name; see ``kickdrift.integrator``.

    Attributes
    ----------
    name : name or alias of the method
    options : the given options, by name
    """

    name: str
    options: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "options", dict(self.options))
        settled(self.method, self.options, RunDefaults(), UNIT_SYSTEMS["si"])  # any units tell whether a text fits

    def __hash__(self) -> int:
        return hash((self.name, Options(**self.options)))

    def __repr__(self) -> str:
        given = [f"{key}={value!r}" for key, value in self.options.items()]
        return f"integrator({', '.join([repr(self.name), *given])})"

    def __str__(self) -> str:
        """The integrator as command-line text: the name, and ``-o KEY=VALUE`` for each option."""
        return " ".join([self.name, *(f"-o {key}={as_text(value)}" for key, value in self.options.items())])

    @property
    def method(self) -> Method:
        """Row of the registry."""
        return method_named(self.name)

    @property
    def stability(self) -> dict[str, float]:
        """The longest stable step, from the coefficients; infinite without a bound.

        A splitting has "omega dt" on an oscillator, and "omega^2 dt / friction" without inertia. A one-step method has
        "real lambda dt" and "imaginary lambda dt" on y' = lambda y. An InputError for a method without a stability
        function."""
        from kickdrift.integrators.splitting.method import Splitting
        from kickdrift.integrators.step_choice import stability

        method = self.method
        if method.overdamped and isinstance(method, Splitting):
            return {"omega^2 dt / friction": 0.5 * stability.stability_interval(method) ** 2}
        if isinstance(method, Splitting):
            return {"omega dt": stability.stability_interval(method)}
        real, imaginary = stability.real_interval(method), stability.imaginary_interval(method)
        return {"real lambda dt": real, "imaginary lambda dt": imaginary}


def integrator(name: str, **options: Any) -> Integrator:
    """An integrator with options, as one value: ``kd.integrator("wisdom-holman", corrector=17)``.

    The value may stand wherever an integrator's name may. Options given to a Simulation override the value's options,
    which override those of a system file.

    Parameters
    ----------
    name : name of the integrator, see ``kickdrift.integrators()``
    options : dt, and the options that the method takes; ``kickdrift list integrators NAME`` explains them

    Raises
    ------
    InputError
        For an unknown name, and for options that the method does not take.
    """
    return Integrator(name, options)


def from_text(text: str) -> tuple[str, dict[str, Any]]:
    """The name and the options that the text of an Integrator has, such as "wisdom-holman -o corrector=17"."""
    name, *pairs = text.split(" -o ")
    return name, parsed(pairs, {})


def method_of(which: str | Integrator) -> Method:
    """Method with this name, or of this value."""
    return which.method if isinstance(which, Integrator) else method_named(which)


def unpacked(which: Any, given: Mapping[str, Any]) -> tuple[Any, dict[str, Any]]:
    """Name of the integrator, and all options: those of a value, overridden by ``given``."""
    if not isinstance(which, Integrator):
        return which, dict(given)
    return which.name, {**given, **which.options, **{k: value for k, value in given.items() if value is not None}}


class _Declared(NamedTuple):
    """What all methods declare, for the rows of the registries at one time."""

    rows: tuple[Any, ...]  # of methods and flows
    options: dict[str, Option]
    takers: dict[str, list[str]]


_declared = _Declared((), {}, {})


def _all_declared() -> _Declared:
    """What all methods declare, found anew after a registration."""
    global _declared
    rows = (*INTEGRATORS.values(), *FLOWS.values())
    if list(map(id, rows)) != list(map(id, _declared.rows)):
        found: dict[str, dict[str, Option]] = {name: {} for name in OPTIONS}
        for method in INTEGRATORS.values():
            for each in (*method.declared, PRECISION):
                found.setdefault(each.name, {})[method.name] = each
        options = {name: merged([*by.values()]) for name, by in found.items() if by}
        _declared = _Declared(rows, options, {name: [*by] for name, by in found.items()})
    return _declared


def known_options() -> dict[str, Option]:
    """Every option that some method takes, except dt, by name, with all values that any method allows."""
    return dict(_all_declared().options)


def takers(name: str) -> list[str]:
    """Methods that take an option."""
    return list(_all_declared().takers.get(name, ()))


def takers_text(name: str) -> str:
    """Methods that take an option, as text."""
    found = takers(name)
    if len(found) == len(set(map(id, INTEGRATORS.values()))):
        return "every integrator takes"
    if len(found) > FEW:
        return f"{', '.join(found[: FEW - 1])} and {len(found) - FEW + 1} others take"
    return f"{' and '.join([', '.join(found[:-1]), found[-1]] if found[1:] else found)} take{'' if found[1:] else 's'}"


def meant(name: object) -> str:
    """Text ``; did you mean 'corrector', which wisdom-holman takes?`` if an option's name is near, else "".

    An option of another program, such as timestep, has the text of `other_name`."""
    if hint := other_name("option", name):
        return hint
    near = get_close_matches(str(name)[:VALUE].lower(), [*known_options()], 1, 0.6)
    return f"; did you mean {near[0]!r}, which {takers_text(near[0])}?" if near else ""


def refuse_unknown(names: Iterable[str], method: Method | None = None) -> None:
    """Raise InputError if a name is not an option of any method."""
    unknown = [name for name in names if name != DT.name and name not in OPTIONS]
    known = known_options() if unknown else {}
    for name in unknown:
        if name not in known:
            hint = meant(name)
            takes = f"{method.name} takes {', '.join((DT.name, *method.tunable))}" if method else ""
            between = " " if hint.endswith("?") else "; "
            raise InputError(
                f"{clean(str(name), VALUE)}: no integrator takes such an option{hint}{between + takes if takes else ''}"
            )


def in_units(asked: Mapping[str, Any], options: Iterable[Option], units: UnitSystem | None) -> dict[str, Any]:
    """The options asked for, with texts such as "2 fs" or "300 K" as numbers in ``units``; a Problem has no units."""
    known = {each.name: each for each in options}
    return {key: known[key].in_units(value, units) if key in known else value for key, value in asked.items()}


def settled(method: Method, asked: Mapping[str, Any], run: RunDefaults, units: UnitSystem | None = None) -> Options:
    """Options of a run: values ``asked`` for in arguments, then values of the system, then defaults. Texts with a unit
    become numbers in ``units``. Another barostat takes from the system only the options that it knows.

    Raises InputError for an option that no method takes, for an argument that this method does not take, and for a
    value that an option cannot have."""
    asked = with_ramps(asked)
    refuse_unknown([*asked, *run.options], method)
    said = in_units({key: value for key, value in asked.items() if value is not None}, method.options, units)
    refuse_other_baths(method, said)
    of_run = {key: value for key, value in run.options.items() if key not in other_barostats(said)}
    given = in_units({"dt": run.dt, **of_run}, method.options, units)
    return method.checked(Options(**given | said), Options(**said))


def other_barostats(asked: Mapping[str, Any]) -> list[str]:
    """Options that the barostat asked for does not take, and other barostats do."""
    takes = BAROSTATS.get(str(asked.get(BAROSTAT.name)))
    return [] if takes is None else [each.name for each in OF_SOME if each.name not in (*takes[0], *takes[1])]


def refuse_other_baths(method: Method, given: Iterable[str], prefix: str = "") -> None:
    """Raise InputError for an option that only other heat baths take."""
    for name in given:
        if name in (DT.name, PRECISION.name, *method.tunable):
            continue
        those = [method_named(each) for each in takers(name)]
        if those and all(each.bath for each in those) and not (name == TEMPERATURE.name and not method.bath):
            why = "and a run has one heat bath" if method.bath else f"and {method.name} has no heat bath"
            takes = ", ".join((DT.name, *method.tunable))
            raise InputError(
                f"{prefix}{name}: {method.name} does not take it; it takes {takes}; {takers_text(name)} {name}, {why}"
            )


def draws_noise(run: RunDefaults) -> bool:
    """Tell whether the integrator of ``[run]`` draws random numbers with a seed that is not given there."""
    method = INTEGRATORS.get(run.integrator) if isinstance(run.integrator, str) else None
    return method is not None and SEED.name in method.tunable and SEED.name not in run.options


def parsed(pairs: Iterable[str], flags: Mapping[str, Any]) -> dict[str, Any]:
    """Options from a command line: texts ``KEY=VALUE``, and flags by name, None for a flag that was not given."""
    found = {key: value for key, value in flags.items() if value is not None}
    known = {DT.name: DT, **known_options()}
    for text in pairs:
        key, equals, value = (part.strip() for part in text.partition("="))
        if not (equals and key and value):
            raise InputError(f"-o: expected KEY=VALUE, such as corrector=17, got {shown(text)}")
        refuse_unknown([key])
        if key in found:
            raise InputError(f"-o {key}: is given twice")
        found[key] = known[key].parsed(value)
    return found


def as_text(value: Any) -> str:
    """A value as command-line text."""
    if isinstance(value, bool):
        return str(value).lower()
    return ",".join(map(str, value)) if isinstance(value, tuple | list) else str(value)
