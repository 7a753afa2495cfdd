"""Checks of a law of bonds, angles or dihedrals before it is compiled. Every error is one line."""

from __future__ import annotations

import math
from typing import Any

from kickdrift.errors import InputError
from kickdrift.forces.laws.check import raised_at
from kickdrift.model.checks.values import is_number
from kickdrift.text import shown

STEP = 1e-3  # for differences of order 4
SLOPE_TOLERANCE = 1e-6
JUMP = 1e-9  # of the largest energy between -180 and 180 degrees
PARTS = (0.45, 0.65, 0.83, 0.96, 1.07, 1.31)  # of a law's length, or of pi/2, where slope and energy are compared


def value_of(law: Any, at: float) -> tuple[float, float]:
    """Energy and slope of a law in plain Python; nan where the law raises an ArithmeticError or a ValueError.

    Raises InputError if the law raises anything else, or does not return two numbers."""
    name = type(law).__qualname__.split(".")[-2] if "." in type(law).__qualname__ else type(law).__name__
    try:
        found = law.law(at)
    except (ArithmeticError, ValueError):  # such as a division by zero, which is nan or infinite in compiled code
        return math.nan, math.nan
    except Exception as error:
        text = " ".join(f"{type(error).__name__}: {error}".split())
        raise InputError(f"{name}: law at {at:.6g} raised {text}{raised_at(error.__traceback__)}") from None
    if not isinstance(found, tuple | list) or len(found) != 2 or not all(map(is_number, found)):
        raise InputError(
            f"{name}: law at {at:.6g} must return two numbers, energy and slope; it returned {shown(found)}"
        )
    return float(found[0]), float(found[1])


def check_bonded_slope(name: str, law: Any, kind: str) -> None:
    """Refuse a law whose slope is not that of its energy at two or more places where both are finite."""
    scales = [math.pi / 2]
    if kind == "bonds":
        lengths = [v for k, v in law._asdict().items() if getattr(law, "dimensions", {}).get(k) == "length" and v > 0]
        scales = lengths or [1.0]
    wrong = [found for scale in scales for part in PARTS if (found := _wrong(law, part * scale, STEP * scale))]
    if len(wrong) > 1:
        at, given, slope = wrong[-1]
        what = "r" if kind == "bonds" else "angle"
        raise InputError(
            f"{name}: law must return the energy and its slope dU/d({what}); at {what} = {at:.6g} it returns "
            f"{given:.6g}, and the slope of its energy is {slope:.6g}"
        )


def check_closed(name: str, law: Any) -> None:
    """Refuse a law of dihedrals whose energy at -180 degrees is not that at 180 degrees, the same place."""
    first, last = (value_of(law, end)[0] for end in (-math.pi, math.pi))
    largest = max(abs(value_of(law, part * math.pi)[0]) for part in (-1.0, *PARTS[:4], 1.0))
    if abs(last - first) > JUMP * largest:
        raise InputError(
            f"{name}: the energy must be the same at -180 and 180 degrees, which are one place; "
            f"it jumps from {first:.6g} to {last:.6g}"
        )


def _wrong(law: Any, at: float, h: float) -> tuple[float, float, float] | None:
    energy, given = value_of(law, at)
    near, far = ([value_of(law, at + k * h)[0] for k in (-j, j)] for j in (1, 2))
    slope = (8 * (near[1] - near[0]) - (far[1] - far[0])) / (12 * h)
    if not all(map(math.isfinite, (energy, given, slope))):
        return None
    scale = max(abs(given), abs(slope), abs(energy) / (1000 * h), 1e-300)
    return None if abs(given - slope) <= SLOPE_TOLERANCE * scale * 10 else (at, given, slope)
