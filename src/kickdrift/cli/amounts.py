"""Amounts on the command line: whole numbers such as 1e6, and times with or without a unit such as "5 ps"."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import typer

from kickdrift.model.limits import whole_text
from kickdrift.model.system import System
from kickdrift.model.units import has_unit, time_in
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


def length(text: str) -> Any:
    """Read a time: a number in the system's unit, or a text with a unit, which ``in_units`` converts."""
    try:
        return float(text)
    except ValueError:
        if not has_unit(text):
            raise typer.BadParameter(f"{shown(text)} is not a time such as 10, or '10 fs'.") from None
        return text


def in_units(value: Any, subject: Any, flag: str) -> float | None:
    """A time in the units of a System, from a number or a text; an InputError names the flag."""
    found: float | None = time_in(value, subject.units if isinstance(subject, System) else None, flag)
    return found
