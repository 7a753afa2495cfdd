"""Options of integrators, each declared once: name, type, unit, default, choices, help.

Keywords of a Simulation, keys of ``[run]``, ``-o`` on the command line, run files and the documentation are all made
from these declarations. `Method.declared` says which options a method takes.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf, isfinite
from typing import Any

import numpy as np

from kickdrift.errors import InputError
from kickdrift.model.checks.values import number
from kickdrift.model.units.quantities import UnitSystem, has_unit, time_in
from kickdrift.text import shown

DOUBLE, MIXED = "double", "mixed"  # precision of pair and many-body forces
_WORDS = {float: "a number", int: "a whole number", str: "a name", bool: "true or false"}
DIMENSIONS = {
    "": "", "time": "the system's unit of time", "rate": "one over the system's unit of time",
    "temperature": "the system's unit of temperature", "pressure": "the system's unit of pressure",
    "compressibility": "one over the system's unit of pressure",
}  # fmt: skip
_SWITCH = {"true": True, "yes": True, "on": True, "false": False, "no": False, "off": False}
_TAKEN = (
    "system", "integrator", "steps", "time", "every", "interval", "threads", "engine", "engine_version", "processes",
    "hosts", "events", "options", "processor", "features", "seeds", "progress",
)  # fmt: skip


@dataclass(frozen=True)
class Option:
    """An option of an integrator.

    Attributes
    ----------
    name : the keyword
    type : float, int, str or bool
    help : one line about the effect
    default : value if none is given; None if there is no single default
    choices : allowed values; () if they cannot be listed
    dimension : "time", "rate", "temperature", "pressure" or "compressibility" for a number in the system's units, ""
        for a pure number
    above, most : a number is greater than ``above``, and at most ``most``
    several : whether a Problem may have one number for each component of y
    count : how many numbers a value has
    parts : their names in order, if they have any
    written : whether run files record the default if no value was given

    Raises
    ------
    InputError
        If name, type, choices or default do not fit.
    """

    name: str
    type: type
    help: str
    default: Any = None
    choices: tuple[Any, ...] = ()
    dimension: str = ""
    above: float = -inf
    most: float = inf
    several: bool = False
    written: bool = True
    count: int = 1
    parts: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        name = self.name
        if not (isinstance(name, str) and name.isidentifier()) or name in _TAKEN:
            raise InputError(f"option: expected a name such as friction, that means nothing else, got {shown(name)}")
        if self.type not in _WORDS:
            raise InputError(f"option {name}: type must be float, int, str or bool, got {shown(self.type)}")
        if not (isinstance(self.help, str) and self.help.strip()):
            raise InputError(f"option {name}: help must say what it does")
        if self.dimension not in DIMENSIONS:
            raise InputError(
                f"option {name}: dimension must be one of {', '.join(map(repr, DIMENSIONS))}, "
                f"got {shown(self.dimension)}"
            )
        for choice in self.choices:
            if not isinstance(choice, self.type) or (isinstance(choice, str) and choice.split() != [choice]):
                raise InputError(f"option {name}: expected {_WORDS[self.type]} among choices, got {shown(choice)}")
        if self.default is not None:
            self.checked(self.default)

    def checked(self, value: Any) -> Any:
        """Return the value as Python's own type. Raises an InputError that names the option for a value that is not
        allowed."""
        if self.choices:
            same = [k for k in self.choices if isinstance(k, str) == isinstance(value, str) and np.all(k == value)]
            if not same or np.ndim(value):
                raise InputError(f"{self.name} {shown(value)} is unknown; known are {self.known}")
            return same[0]
        if self.type is bool:
            if not isinstance(value, bool | np.bool_):
                raise InputError(f"{self.name} must be True or False, got {shown(value)}")
            return bool(value)
        if self.type is str:
            if not isinstance(value, str):
                raise InputError(f"{self.name} must be text, got {shown(value)}")
            return value
        if self.count > 1:
            self._counted(value if np.ndim(value) == 1 else (), value)
            return tuple(self._number(f"{self.name}[{k}]", each) for k, each in enumerate(value))
        if isinstance(value, tuple) and self.several:
            return tuple(self._number(f"{self.name}[{k}]", each) for k, each in enumerate(value))
        return self._number(self.name, value)

    def _counted(self, values: Sequence[Any], given: Any) -> None:
        """Raise InputError, with the text or value as given, unless there are as many numbers as the option has."""
        if len(values) != self.count:
            names = f", {', '.join(self.parts)}" if self.parts else ""
            raise InputError(f"{self.name} must be {self.count} numbers{names}, got {shown(given)}")

    def _number(self, key: str, value: Any) -> float | int:
        found = number(value)
        if not (isfinite(found) and self.above < found <= self.most) or (self.type is int and not found.is_integer()):
            raise InputError(f"{key} must be {self.expected}, got {shown(value)}")
        return int(found) if self.type is int else found

    def parsed(self, text: str) -> Any:
        """Return the value of a text on the command line. Raises InputError if the text has no allowed value.

        A number with a unit stays text, because only a System has the units for `in_units`. Several numbers have commas
        between them, and may stand in brackets as in a file."""
        if self.count > 1:
            listed = text.strip().removeprefix("[").removesuffix("]").split(",")
            parts = [part.strip().strip("\"'") for part in listed]
            self._counted(parts, text)
            return tuple(part if has_unit(part) else self._parsed(part) for part in parts)
        if self.dimension and has_unit(text):
            return text
        return self._parsed(text)

    def _parsed(self, text: str) -> Any:
        try:
            if self.type is bool:
                return _SWITCH[text.lower()]
            if self.several and "," in text:
                return tuple(self.type(part) for part in text.split(","))
            return self.type(text)
        except (KeyError, ValueError):
            many = ", or numbers with commas between them" if self.several else ""
            words = f"one of {self.known}" if self.choices else _WORDS[self.type] + many
            raise InputError(f"{self.name}: expected {words}, got {shown(text)}") from None

    def in_units(self, value: Any, units: UnitSystem | None) -> Any:
        """Return the value as a number in ``units`` if it is text with a unit, such as "300 K"; other values as they
        are. A Problem has no units. Raises InputError for a unit of another dimension, and in reduced units."""
        if self.count > 1 and isinstance(value, list | tuple):
            self._counted(value, value)
            return tuple(time_in(each, units, self.name, self.dimension) for each in value)
        return time_in(value, units, self.name, self.dimension) if self.dimension else value

    def filled(self, value: Any) -> Any:
        """Return the value, checked. For None, return the default if files record it."""
        if value is None:
            return self.default if self.written else None
        return self.checked(value)

    @property
    def known(self) -> str:
        """Choices as text."""
        return ("; " if any("," in str(choice) for choice in self.choices) else ", ").join(map(str, self.choices))

    @property
    def expected(self) -> str:
        """Allowed numbers as text."""
        whole = "whole " if self.type is int else ""
        if (self.above, self.most) == (0.0, inf):
            return f"a positive finite {self.dimension}" if self.dimension else f"a positive {whole}number"
        if self.above == -inf and self.most == inf:
            return f"a {whole}number" if whole else "a finite number"
        limits = {"above": self.above, "at most": self.most}
        words = " and ".join(f"{word} {limit:g}" for word, limit in limits.items() if isfinite(limit))
        return f"a {whole}number {words}" if whole else words

    @property
    def hint(self) -> Any:
        """Type of the option as a type hint."""
        if self.count > 1:
            return tuple[float, ...]
        return float | tuple[float, ...] if self.several else self.type

    @property
    def words(self) -> str:
        """Type of the option as text."""
        if self.count > 1:
            return f"{self.count} numbers"
        words = f"{_WORDS[self.type]}, or one for each component of y" if self.several else _WORDS[self.type]
        limits = self.type in (float, int) and (self.above > -inf or self.most < inf) and not self.choices
        if not limits or self.several:
            return words
        text = self.expected.replace(f"finite {self.dimension}", "number")
        return text if text.startswith("a ") else f"a number {text}"

    @property
    def unit(self) -> str:
        """Unit of the option as text; "" for a pure number."""
        return DIMENSIONS[self.dimension]

    @property
    def fallback(self) -> str:
        """Default of the option as text."""
        if self.default is None:
            return ""
        return str(self.default).lower() if isinstance(self.default, bool) else f"{self.default}"


def merged(declared: Sequence[Option]) -> Option:
    """One declaration that allows all values of several declarations of the same name."""
    first, named = declared[0], all(each.choices for each in declared)
    return replace(
        first,
        default=first.default if all(each.default == first.default for each in declared) else None,
        choices=tuple(dict.fromkeys(choice for each in declared for choice in each.choices)) if named else (),
        above=min(each.above for each in declared),
        most=max(each.most for each in declared),
        several=any(each.several for each in declared),
    )


DT = Option(
    "dt", float, "Step; of a method that chooses its steps the first one, and optional.", dimension="time", above=0.0
)
RTOL = Option(
    "rtol", float, "Relative error allowed per step.", 1e-8, above=0.0, several=True, written=False,
)  # fmt: skip
ATOL = Option("atol", float, "Absolute error allowed per step.", 1e-10, above=0.0, several=True, written=False)
CONTROLLER = Option(
    "controller",
    str,
    "Rule by which the errors of the last steps set the next step.",
    "pi",
    ("i", "pi", "pid"),
    written=False,
)
COMPENSATED = Option("compensated", bool, "Carry on what rounding loses of positions and velocities.", False)
ITERATION = Option(
    "iteration", str, "Way to solve for the stages; by default newton for a Problem, fixed-point for particles.",
    choices=("newton", "fixed-point"),
)  # fmt: skip
JACOBI, HELIOCENTRIC = "jacobi", "democratic-heliocentric"
COORDINATES = Option("coordinates", str, "Origins of positions and velocities.", JACOBI, (JACOBI, HELIOCENTRIC))
CORRECTOR = Option("corrector", int, "Order of the symplectic corrector; 0 for none.", 0, (0, 3, 5, 7, 11, 17))
STANDARD, LAZY, COMPOSITION, MODIFIED_KICK = "standard", "lazy", "composition", "modified-kick"
KERNEL = Option(
    "kernel", str, "Kick of a step, or what takes its place and has smaller errors.", STANDARD,
    (STANDARD, LAZY, COMPOSITION, MODIFIED_KICK), written=False,
)  # fmt: skip
ORDER = Option("order", str, "Powers of dt in the errors that are linear, quadratic, … in the planets' masses.")
HILL_RADII = Option(
    "hill_radii", float, "Distance within which two bodies move together, in the hand-over radii of either.", 3.0,
    above=0.0,
)  # fmt: skip
PERICENTRE = Option(
    "pericentre", str, "Forces under which all massive bodies move together while one passes its pericentre.", "full",
    ("full", "partial", "none"),
)  # fmt: skip
INNER = Option(
    "inner", str, "Method that follows encounters and pericentre passages.", "gauss-radau15",
    ("gauss-radau15", "bulirsch-stoer"),
)  # fmt: skip
ETA = Option(  # default as in Makino & Aarseth 1992 and most later work
    "eta", float, "Accuracy of the steps: smaller values take shorter steps.", 0.02, above=0.0, most=1.0, written=False
)
SCHEME = Option("scheme", str, "One step for all bodies, or one for each.", "shared", ("shared", "block"))
PLAIN, REGULARISED = "plain", "regularised"
PAIRS = Option(
    "pairs", str, "Close pairs in block steps: bodies like all others, or orbits of their own under tides.", PLAIN,
    (PLAIN, REGULARISED), written=False,
)  # fmt: skip
PRECISION = Option(
    "precision", str, "Pair and many-body forces: all in float64, or pairs in float32 and the rest in float64.", DOUBLE,
    (DOUBLE, MIXED), written=False,
)  # fmt: skip
MAX_STEP = Option("max_step", float, "Longest step.", dimension="time", above=0.0)
TEMPERATURE = Option("temperature", float, "Temperature of the heat bath.", dimension="temperature", above=0.0)
TEMPERATURE_TO = Option(
    "temperature_to", float, "Temperature at the end of a ramp, which is linear in time.", dimension="temperature",
    above=0.0, written=False,
)  # fmt: skip
RAMP_STEPS = Option(
    "ramp_steps", int, "Steps of a ramp of temperature or pressure; by default those of the run.", above=0.0,
    most=2.0**53, written=False,
)  # fmt: skip
FRICTION = Option(
    "friction", float, "Rate at which the heat bath damps velocities.", dimension="rate", above=0.0
)  # fmt: skip
TAU = Option("tau", float, "Time in which the heat bath relaxes the temperature.", dimension="time", above=0.0)
RATE = Option(
    "collision_rate", float, "Rate at which a particle gets a new velocity.", dimension="rate", above=0.0
)  # fmt: skip
PRESSURE = Option(
    "pressure",
    float,
    "Pressure of the box, whose edges then change; by default they do not.",
    dimension="pressure",
)
PRESSURE_TO = Option(
    "pressure_to", float, "Pressure at the end of a ramp, which is linear in time.", dimension="pressure", written=False
)
RAMPED = {TEMPERATURE.name: TEMPERATURE_TO.name, PRESSURE.name: PRESSURE_TO.name}  # options and their ends
C_RESCALE, MTK, MONTE_CARLO = "c-rescale", "mtk", "monte-carlo"
BAROSTAT = Option(
    "barostat", str, "What holds the pressure.", choices=(C_RESCALE, MTK, MONTE_CARLO), written=False
)  # fmt: skip
FULL = "full"
COUPLING = Option(
    "coupling", str, "Edges that change together: all, those along x and y, or none; or the full shape.",
    choices=("isotropic", "semi-isotropic", "per-axis", FULL), written=False,
)  # fmt: skip
PRESSURE_TAU = Option(
    "pressure_tau", float, "Time in which the barostat relaxes the volume.", dimension="time", above=0.0
)
COMPRESSIBILITY = Option(
    "compressibility", float, "Isothermal compressibility, about; sets the speed of c-rescale and the moves of "
    "monte-carlo, and not the averages.", dimension="compressibility", above=0.0,
)  # fmt: skip
PRESSURE_EVERY = Option(
    "pressure_every", int, "Steps from one action of the barostat to the next; by default a tenth of pressure_tau, at "
    "most 30, for c-rescale, 10 for monte-carlo, and 1 for mtk.", above=0.0, most=1e6, written=False,
)  # fmt: skip
STRESS = Option(
    "stress", float, "Stress beside the pressure, with coupling = full: xx, yy, zz, yz, xz, xy; positive pulls.",
    dimension="pressure", count=6, written=False, parts=("xx", "yy", "zz", "yz", "xz", "xy"),
)  # fmt: skip
BAROSTATS = {  # options that each barostat needs, and others that it takes
    C_RESCALE: ((PRESSURE_TAU.name, COMPRESSIBILITY.name), (PRESSURE_EVERY.name,)),
    MTK: ((PRESSURE_TAU.name,), (PRESSURE_EVERY.name,)),
    MONTE_CARLO: ((COMPRESSIBILITY.name,), (PRESSURE_EVERY.name,)),
}
OF_SOME = (PRESSURE_TAU, COMPRESSIBILITY, PRESSURE_EVERY)  # options that only some barostats take
APART = ("semi-isotropic", "per-axis", FULL)  # couplings that need the pressure along each axis
OF_PRESSURE = (PRESSURE, PRESSURE_TO, BAROSTAT, COUPLING, PRESSURE_TAU, COMPRESSIBILITY, PRESSURE_EVERY, STRESS)
ALLOW_GRAVITY = Option(
    "allow_gravity", bool, "Let a heat bath act under gravity, which has no equilibrium.", False, written=False
)
SUBSTEPS = Option(
    "substeps", int, "Steps of each group of forces in one step of the next slower group.", 4, above=0.0, most=1000.0
)
_MAPS = ("lf", "lf4", "lf6", "lf8", "lf4_2", "lf8_6_4", "plf7_6_4", "pmlf4", "pmlf6")
PHI0 = Option("phi0", str, "Map that splits the planets' kicks from the motion under the star.", "lf", _MAPS)
PHI1 = Option("phi1", str, "Map that splits the motion under the star into drifts and kicks.", "lf", _MAPS)
CHAIN = Option("chain", int, "Number of thermostats in the chain.", 3, above=0.0, most=20.0)
SEED = Option(
    "seed", int, "Seed of the noise; by default the seed of the starting velocities, or 0.", above=-1.0, most=2.0**53
)

REFINE = "refine"
NOISE = Option(
    "noise", str, "Noise of a run: its own, or refined from the noise of a run at twice the step.", "own",
    ("own", REFINE), written=False,
)  # fmt: skip
SPLITTING = Option(
    "splitting", str, "Splitting in which the thermostats act.", "velocity-verlet",
    ("velocity-verlet", "yoshida4", "yoshida6", "yoshida8"), written=False,
)  # fmt: skip


def worth_saying(value: Any) -> bool:
    """Tell whether an option's value is worth a word: a pressure of zero is, a seed of zero is the default."""
    return bool(value) or isinstance(value, float)


def mean_pressure(options: Mapping[str, Any]) -> Any:
    """Mean pressure that a run with these options is to have, with that of its wanted stress; None without any."""
    pressure, stress = options.get(PRESSURE.name), options.get(STRESS.name)
    return pressure if pressure is None or stress is None else pressure - sum(stress[:3]) / 3.0


def coupling_of(options: Mapping[str, Any]) -> str:
    """The edges of the box that change together in a run with these options; "" if the box keeps its size."""
    if options.get(PRESSURE.name) is None:
        return ""
    return options.get(COUPLING.name) or "isotropic"


# In the order of run files.
OPTIONS: dict[str, Option] = {
    each.name: each
    for each in (
        RTOL, ATOL, CONTROLLER, COMPENSATED, ITERATION, COORDINATES, CORRECTOR, ORDER, ETA, SCHEME, PRECISION, MAX_STEP,
        HILL_RADII, PERICENTRE, INNER,
    )
}  # fmt: skip


def own_options(options: Sequence[Any]) -> tuple[Option, ...]:
    """Check a user's declarations: each is an Option with a new name, or has the type that the name has elsewhere."""
    names: set[str] = set()
    for each in options:
        if not isinstance(each, Option):
            raise InputError(f"options: expected kd.Option(name, type, help), got {shown(each)}")
        known = OPTIONS.get(each.name)
        if known and (known.type, known.dimension) != (each.type, each.dimension):
            raise InputError(f"option {each.name}: is {known.words} of other methods; give yours another name")
        if each.name in names or each.name in ("dt", PRECISION.name):
            raise InputError(f"option {each.name}: is declared already")
        names.add(each.name)
    return tuple(options)


Tolerance = float | tuple[float, ...]  # one number, or one for each component of y


class Options(Mapping[str, Any]):
    """Values of dt and of options by name, each an attribute too; None for a value that was not given.

    Use ``options.dt`` or ``options["rtol"]``. All options of the table are included, and those of a user's method that
    have values. Tolerances in a list or an array become tuples. Options can be compared and can be dictionary keys.
    """

    _values: dict[str, Any]

    def __init__(self, dt: float | None = None, **values: Any) -> None:
        found = {"dt": dt, **{name: False if each.type is bool else None for name, each in OPTIONS.items()}}
        found |= {key: _row(key, value) for key, value in values.items() if value is not None}
        object.__setattr__(self, "_values", found)

    def __getitem__(self, key: str) -> Any:
        return self._values[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or name not in self._values:
            raise AttributeError(f"Options have no {name!r}")
        return self._values[name]

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError("Options are read-only; ``changed`` makes others")

    def __hash__(self) -> int:
        return hash(frozenset(self._values.items()))

    def __repr__(self) -> str:
        said = [f"{key}={value!r}" for key, value in self.items() if value is not None and value is not False]
        return f"Options({', '.join(said)})"

    def __reduce__(self) -> Any:
        return _made, (dict(self),)

    def changed(self, **values: Any) -> Options:
        """Return a copy with these values."""
        return Options(**{**self, **values})

    def extras(self, tunable: Collection[str]) -> dict[str, Any]:
        """Values for a run's file besides dt, for a method with these options."""
        said = {key: value for key, value in self.items() if key != "dt" and worth_saying(value)}
        tolerances = zip(("rtol", "atol"), self.tolerances, strict=True)
        return said | {key: value for key, value in tolerances if key in tunable}

    @property
    def tolerances(self) -> tuple[Tolerance, Tolerance]:
        """rtol and atol, with defaults for values that were not given."""
        rtol, atol = self._values[RTOL.name], self._values[ATOL.name]
        return (RTOL.default if rtol is None else rtol), (ATOL.default if atol is None else atol)

    @property
    def longest(self) -> float:
        """Longest allowed step."""
        longest = self._values["max_step"]
        return np.inf if longest is None else longest


def _made(values: dict[str, Any]) -> Options:
    return Options(**values)


def _row(key: str, value: Any) -> Any:
    """Convert a list or an array to a tuple of Python's numbers, for an option with several numbers, and an array of no
    dimension to its number."""
    if key in OPTIONS and not OPTIONS[key].several:
        return value
    found = value.tolist() if isinstance(value, np.ndarray) else value
    return tuple(found) if isinstance(found, list) else found
