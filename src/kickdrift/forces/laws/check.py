"""Checks of a user's pair law before it is compiled. Every error is one line that quotes the law."""

from __future__ import annotations

import inspect
import linecache
import re
from types import TracebackType
from typing import Any

import numpy as np

from kickdrift.errors import InputError
from kickdrift.model.checks.arguments import misfit
from kickdrift.model.checks.values import is_number
from kickdrift.text import clean, shown

PAIR = "energy and force over r"  # the values that a law returns
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
        or not all(map(is_number, found))
    ):
        raise InputError(f"{name}: {at}, must return two numbers, {PAIR}; it returned {shown(found)}")
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
