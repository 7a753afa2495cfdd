"""Amounts on the command line: whole numbers such as 1e6, and times with or without a unit such as "5 ps"."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import typer

from kickdrift.model.checks.limits import whole_text
from kickdrift.model.system import System
from kickdrift.model.units.quantities import has_unit, time_in
from kickdrift.text import shown


def whole(least: int) -> Callable[[str], int]:
    """Return the reader of a whole number, ``least`` or more: 1000000, 1e6 or 1_000_000."""

    def read(text: str) -> int:
        found: float | None = whole_text(text)
        if found is None:
            try:
                found = float(text)
            except ValueError:
                found = math.nan
        if not (isinstance(found, int) or found.is_integer()) or found < least:
            raise typer.BadParameter(f"{shown(text)} is not a whole number, {least} or more.")
        return int(found)

    return read


def amount(expected: str) -> Callable[[str], Any]:
    """Return the reader of a number in the system's unit, or of a text with a unit. ``expected`` gives examples."""

    def read(text: str) -> Any:
        try:
            return float(text)
        except ValueError:
            if not has_unit(text):
                raise typer.BadParameter(f"{shown(text)} is not {expected}.") from None
            return text

    return read


def row(text: str) -> list[Any]:
    """Read times with commas between them, or START:STOP:COUNT for evenly spaced times."""
    start, *rest = text.split(":")
    if not rest:
        return [length(part.strip()) for part in text.split(",")]
    try:
        stop, count = rest
        return [float(value) for value in np.linspace(float(start), float(stop), whole(1)(count))]
    except (ValueError, OverflowError, MemoryError, typer.BadParameter):
        raise typer.BadParameter(f"{shown(text)} is neither times such as 1,2.5,4 nor START:STOP:COUNT.") from None


length = amount("a time such as 10, or '10 fs'")  # a text with a unit is for ``in_units``


def in_units(value: Any, subject: Any, flag: str) -> float | None:
    """A time in the units of a System, from a number or a text; an InputError names the flag."""
    found: float | None = time_in(value, subject.units if isinstance(subject, System) else None, flag)
    return found
