"""Checks of the factories' arguments."""

from __future__ import annotations

from collections.abc import Sequence

from kickdrift.errors import InputError
from kickdrift.model.problem import finite_numbers
from kickdrift.model.state import Floats

Numbers = Sequence[float]


def start_values(y0: Numbers, count: int) -> Floats:
    """Return y0 as an array of ``count`` numbers."""
    start = finite_numbers("y0", y0)
    if start.shape != (count,):
        got = len(start) if start.ndim == 1 else f"shape {start.shape}"
        raise InputError(f"y0: expected {count} number{'s' if count > 1 else ''}, got {got}")
    return start


def positive(key: str, value: float) -> float:
    """Return the value if it is positive, else raise InputError."""
    if not value > 0:
        raise InputError(f"{key}: expected a positive number, got {value!r}")
    return value
