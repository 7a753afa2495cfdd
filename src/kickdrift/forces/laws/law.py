"""Common parts of the decorators that make a force of a law: a NamedTuple class of parameters with one formula.

``pair_law``, ``field_law`` and ``body_law`` use these. A law is checked before it is compiled: its code keeps nothing
between calls, and every error is one line that quotes the law. This module does not import numba.
"""

import dataclasses
import dis
import inspect
import linecache
import re
from collections.abc import Iterator, Mapping
from types import FunctionType, ModuleType, TracebackType
from typing import Any, NamedTuple

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.seam.arguments import opposite
from kickdrift.forces.seam.named import register_force
from kickdrift.model.checks.arguments import checked_arguments, misfit
from kickdrift.model.checks.values import is_number
from kickdrift.text import clean, shown

CONTAINERS = (list, dict, set, bytearray, np.ndarray)
CHANGING = {"append", "add", "clear", "extend", "fill", "insert", "pop", "remove", "setdefault", "sort", "update"}
VARYING = {"random", "_random", "secrets", "time"}  # modules


def check_stateless(name: str, law: Any, alone: str) -> None:
    """Refuse a law whose code keeps state. The InputError names what holds the state.

    Compiled code would take such a state as a constant, or change the forces from call to call.
    """
    for what in _states(law, set()):
        raise InputError(f"{name}: law keeps state between calls: {what}; {alone}")


def _states(function: Any, seen: set[int]) -> Iterator[str]:
    """Yield descriptions of the state that a function, and each function it calls, keeps."""
    function = getattr(function, "py_func", function)  # the Python function behind a compiled one
    if not isinstance(function, FunctionType) or id(function) in seen:
        return
    seen.add(id(function))
    code = function.__code__
    inside = f" (in {function.__name__})" if len(seen) > 1 else ""
    kept = function.__kwdefaults__ or {}
    last = code.co_varnames[: code.co_argcount][-len(function.__defaults__ or ()) :]
    for key, value in [*zip(last, function.__defaults__ or (), strict=False), *kept.items()]:
        if isinstance(value, CONTAINERS):
            yield f"the default of {key} is a {type(value).__name__}{inside}"
    for each in dis.get_instructions(code):
        if each.opname in ("STORE_GLOBAL", "DELETE_GLOBAL") or (
            each.opname in ("STORE_DEREF", "DELETE_DEREF") and each.argval in code.co_freevars
        ):
            yield f"it sets {each.argval}, which belongs to other code{inside}"
    found = inspect.getclosurevars(function)
    changes = CHANGING & set(code.co_names) or any(
        each.opname in ("STORE_SUBSCR", "DELETE_SUBSCR", "STORE_ATTR") for each in dis.get_instructions(code)
    )
    for key, value in {**found.globals, **found.nonlocals}.items():
        home = _home(value)
        whole = home in VARYING or home.startswith("numpy.random")
        if whole or (home == "numpy" and "random" in code.co_names):
            yield f"it uses {key if whole else f'{key}.random'}{inside}"
        if changes and isinstance(value, CONTAINERS):
            yield f"it changes {key}{inside}"
        yield from _states(value, seen)


def _home(value: Any) -> str:
    """Return the name of a module, or of the module that defines a function or object."""
    if isinstance(value, ModuleType):
        return value.__name__
    owner = getattr(value, "__self__", value)  # a method's object
    return str(owner.__name__ if isinstance(owner, ModuleType) else type(owner).__module__)


RETURNED = "energy and force over r"  # the values that a law returns
DISTANCES = (0.35, 0.5, 0.65, 0.8, 0.95)  # of the cutoff, where a law's force is compared with its energy
STEP = 1e-3  # of a distance, for the differences; their error is about 1e-8 of Lennard-Jones' slope
SLOPE_TOLERANCE = 1e-4
_COLOUR = re.compile(r"\x1b\[[0-9;]*m")  # numba colours its messages if colorama is installed
_PLACE = re.compile(r'File "(?P<file>[^"]+)", line (?P<line>\d+)')


def check_class(cls: Any, decorator: str, arguments: tuple[str, ...]) -> None:
    """Refuse anything but a NamedTuple class with a ``law`` of these arguments."""
    taken = f"({', '.join(arguments)})"
    if not (isinstance(cls, type) and issubclass(cls, tuple) and hasattr(cls, "_fields")):
        raise InputError(f"{decorator}: expected a NamedTuple class with law{taken}, got {shown(cls)}")
    law = getattr(cls, "law", None)
    if not inspect.isfunction(getattr(law, "py_func", law)):
        raise InputError(f"{cls.__name__}: law must be a function law{taken}, got {shown(law)}")
    if misfit(law, *arguments):
        raise InputError(f"{cls.__name__}: law must take {taken}; it takes {inspect.signature(law)}")  # type: ignore[arg-type]


def is_result(value: Any) -> bool:
    """Tell whether a law may return this value as a number. ``np.where`` returns arrays without axes."""
    return is_number(value[()] if isinstance(value, np.ndarray) and value.ndim == 0 else value)


def check_law(name: str, law: Any, r: float) -> None:
    """Refuse a law that raises at the distance r, or does not return two finite numbers."""
    at = f"law(p, r2) at the cutoff, r2 = {r * r:.6g}"
    try:
        with np.errstate(all="ignore"):
            found = law.law(r * r)
    except Exception as error:  # whatever a user's function raises
        text = " ".join(f"{type(error).__name__}: {error}".split())
        raise InputError(f"{name}: {at}, raised {text}{raised_at(error.__traceback__)}") from None
    if (
        isinstance(found, str)
        or not isinstance(found, tuple | list)
        or len(found) != 2
        or not all(map(is_result, found))
    ):
        raise InputError(f"{name}: {at}, must return two numbers, {RETURNED}; it returned {shown(found)}")
    if not np.isfinite(np.array(found, dtype=float)).all():
        raise InputError(f"{name}: {at}, must return finite numbers; it returned {shown(tuple(map(float, found)))}")


def check_slope(name: str, law: Any, cutoff: float) -> None:
    """Refuse a law whose force is not the slope of its energy, -U'(r) / r, at most of some distances to the cutoff.

    A law may jump at one distance. Distances at which the law raises, or returns no finite numbers, do not count."""
    wrong = [found for part in DISTANCES if (found := _wrong_slope(law, part * cutoff))]
    if len(wrong) > 1:
        r, given, slope = wrong[-1]
        raise InputError(
            f"{name}: law(p, r2) must return energy and force over r, -U'(r) / r; at r = {r:.6g} it returns "
            f"{given:.6g}, and its energy's slope gives {slope:.6g}"
        )


def _wrong_slope(law: Any, r: float) -> tuple[float, float, float] | None:
    """Return r, the force over r and the one from the energy's slope, if the two differ; else None."""
    h = STEP * r
    try:
        with np.errstate(all="ignore"):
            energy, force = map(float, law.law(r * r))
            near, far = ([float(law.law((r + k * h) ** 2)[0]) for k in (-j, j)] for j in (1, 2))
    except Exception:  # a law need not hold at every distance; the one at the cutoff is checked
        return None
    slope = (8 * (near[1] - near[0]) - (far[1] - far[0])) / (12 * h)  # central differences of order 4
    scale = max(abs(force), abs(slope / r), abs(energy) / (r * r))
    if not np.isfinite([energy, force, slope, scale]).all() or abs(force + slope / r) <= SLOPE_TOLERANCE * scale:
        return None
    return r, force, -slope / r


def not_compiled(cls: Any, error: Exception) -> InputError:
    """Return the error for a law or a force's parts that numba cannot compile: numba's reason and the line."""
    name = cls.__qualname__.removesuffix(".Parameters").rpartition(".")[2]
    what = f"{name}: law does not compile{getattr(cls, 'law_is_for', ' for SIMD lanes')}" if hasattr(cls, "law") else ""
    function = cls.law if what else cls.kernel_sources[0]
    what = what or f"{cls.__name__}: its kernel {function.__name__} does not compile"
    code = getattr(function, "py_func", function).__code__
    own = range(code.co_firstlineno, max((line or 0) for *_, line in code.co_lines()) + 1)
    lines = [line.strip() for line in _COLOUR.sub("", str(error)).splitlines() if line.strip()]
    for k, line in enumerate(lines):
        place = _PLACE.search(line)
        if place and int(place["line"]) in own and code.co_filename.endswith(place["file"].lstrip("./")):
            number = int(place["line"])
            where = f", line {number}: {shown(linecache.getline(code.co_filename, number).strip())}"
            return InputError(f"{what}{where}: {_reason(lines[:k])}")
    return InputError(f"{what}: {_reason(lines)}")


def _reason(lines: list[str]) -> str:
    """Return numba's reason, after the last stage that failed."""
    failed = [k for k, line in enumerate(lines) if line.startswith("Failed in")]
    rest = [line for line in lines[failed[-1] + 1 if failed else 0 :] if not line.startswith("During:")]
    call = next((line.removeprefix(">>> ") for line in rest if line.startswith(">>> ")), "")
    return clean(f"{rest[0] if rest else 'numba gives no reason'} {call}".strip(), 200)


def raised_at(traceback: TracebackType | None) -> str:
    """Return the line of the law that raised."""
    place = ""
    while traceback is not None:
        code, number = traceback.tb_frame.f_code, traceback.tb_lineno
        if code.co_name == "law" or place:
            place = f", in line {number}: {shown(linecache.getline(code.co_filename, number).strip())}"
        traceback = traceback.tb_next
    return place


TRAITS = (
    "velocity_dependent", "time_dependent", "works", "external", "may_overlap", "joins", "by_mass", "below_light",
    "stands_for",
)  # fmt: skip


def traits_of(cls: Any, more: tuple[str, ...] = ()) -> dict[str, Any]:
    """What a law's class says about the force, for the namespace of the force's class: its traits, as values or as
    properties of the parameters, and ``reversed``."""
    found: dict[str, Any] = {}
    for trait in (*TRAITS, *more):
        if trait in vars(cls):
            value = vars(cls)[trait]
            found[trait] = _of_law(trait) if isinstance(value, property) else value
    if "works" not in found and found.get("time_dependent"):
        found["works"] = found["time_dependent"]
    if "reversed" in vars(cls):
        found["reversed"] = lambda force: force.with_law(force.law.reversed())
    elif "odd_in_time" in vars(cls):
        found["reversed"] = lambda force: force.with_law(mirrored(force.law))
    return found


def mirrored(law: Any) -> Any:
    """The parameters of the motion back in time: those that the law's class names in ``odd_in_time`` change sign."""
    return law._replace(**{key: opposite(getattr(law, key)) for key in law.odd_in_time})


def _of_law(trait: str) -> property:
    return property(lambda force: getattr(force.law, trait), doc=f"What the law says for its parameters: {trait}.")


class Form(NamedTuple):
    """Form of one kind of law.

    Attributes
    ----------
    decorator : the decorator's name, for messages
    arguments : names of the law's arguments
    alone : what the law's values may depend on, for the message about laws that keep state
    """

    decorator: str
    arguments: tuple[str, ...]
    alone: str


def force_of_law(
    cls: Any, base: type, form: Form, hints: Mapping[str, Any], dimensions: Mapping[str, str], **namespace: Any
) -> Any:
    """Make a registered class of forces from a NamedTuple class with a ``law``.

    The force is a frozen dataclass under ``base``. Its fields are the law's parameters, and its class attribute
    ``Parameters`` is the NamedTuple class. The force's ``name`` is the class's name in lower case, with hyphens.

    Parameters
    ----------
    cls : NamedTuple class with a function ``law``
    base : dataclass whose fields the force has as well
    form : the kind of law
    hints : types of the parameters, by name, as system files check them; default float
    dimensions : kinds of the base's quantities, beside the law's own ``dimensions``
    namespace : more attributes of the class

    Raises
    ------
    InputError
        If this is not a NamedTuple class with such a law, if the law keeps state, or if its name is taken.
    """
    check_class(cls, form.decorator, form.arguments)
    check_stateless(cls.__name__, cls.law, form.alone)
    defaults: dict[str, Any] = cls._field_defaults
    force: Any = checked_arguments(
        dataclasses.make_dataclass(
            cls.__name__,
            [
                (key, hints.get(key, float), *([dataclasses.field(default=defaults[key])] if key in defaults else []))
                for key in cls._fields
            ],
            bases=(base,),
            frozen=True,
            namespace={
                "__doc__": cls.__doc__,
                "name": vars(cls).get("name", re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "-", cls.__name__).lower()),
                "dimensions": {**dimensions, **getattr(cls, "dimensions", {})},
                "law_keys": cls._fields,
                **namespace,
            },
        )
    )
    force.__module__ = cls.__module__
    force.__qualname__ = cls.__qualname__
    cls.__qualname__ = f"{cls.__qualname__}.Parameters"  # pickle finds the class at its new place
    force.Parameters = cls
    return register_force(force, overwrite=True)
