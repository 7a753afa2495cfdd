"""Limits on the number of steps in a run."""

from __future__ import annotations

import math
from typing import Any

from kickdrift.errors import InputError
from kickdrift.model.checks import values as checks

MOST_STEPS = 10**15  # a year of the fastest steps; floats are exact for nine times as many
NEVER = 2**62  # number of steps in a run without an end
MOST_DIGITS = 4000  # longest text for int(); Python's own limit is 4300


def whole_number(key: str, value: Any, least: int, most: int = MOST_STEPS) -> int:
    """Return the value as an int. Raises InputError unless it is a whole number from ``least`` to ``most``."""
    found = checks.whole_number(f"run: {key}", value, least)
    if found > most:
        raise InputError(f"run: {key} must be at most {most:,}, got {amount(checks.number(found))}")
    return found


def whole_text(text: str) -> int | None:
    """Whole number from a text of plain digits; None for other texts."""
    return int(text) if text.isascii() and text.isdigit() and len(text) <= MOST_DIGITS else None


def steps_in(key: str, length: float, dt: float) -> float:
    """Number of steps ``dt`` in a length of time, as a float. Raises InputError if there are too many for any run."""
    steps = float(length) / float(dt)
    if not steps <= MOST_STEPS:
        raise InputError(f"{key} {length:.12g} takes {amount(steps)} steps of {dt:g}; a run has at most {MOST_STEPS:,}")
    return steps


def amount(number: float) -> str:
    """A number for a message: in full if it is short, else in three digits."""
    if math.isinf(number):
        return "more than 1e308"
    return f"{number:,.0f}" if abs(number) < 1e15 and float(number).is_integer() else f"{number:.3g}"
