"""Checks of arguments: each refusal is an InputError of one line that begins with the key."""

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from numbers import Integral, Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kickdrift.errors import InputError
from kickdrift.text import shown

_KINDS = {"b": "true and false", "c": "complex numbers", "U": "text", "S": "text", "M": "dates", "m": "spans of time"}


def is_number(value: Any) -> bool:
    """Whether the value is one real number of Python or NumPy; True and False are not."""
    return isinstance(value, Real) and not isinstance(value, bool | np.bool_)


def number(value: Any) -> float:
    """Convert a number to a float: infinite for one too large, nan for anything else."""
    if not is_number(value):
        return float("nan")
    try:
        return float(value)
    except OverflowError:
        return float("inf") if value > 0 else float("-inf")


def positive(key: str, value: Any, what: str = "a positive number") -> float:
    """Return the value as a float. Raises InputError unless it is positive and finite."""
    found = number(value)
    if not (np.isfinite(found) and found > 0):
        raise InputError(f"{key} must be {what}, got {shown(value)}")
    return found


def whole_number(key: str, value: Any, least: int, most: int | None = None) -> int:
    """Return the value as an int. Raises InputError unless it is a whole number from ``least`` to ``most``."""
    if isinstance(value, Integral) and not isinstance(value, bool | np.bool_):
        found: float | int = int(value)
    else:
        found = number(value)
        found = int(found) if found.is_integer() else found
    if not (isinstance(found, int) and found >= least and (most is None or found <= most)):
        words = {0: "zero or more", 1: "one or more"}.get(least, f"{least} or more")
        words = words if most is None else f"from {least} to {most}"
        raise InputError(f"{key} must be a whole number, {words}, got {shown(value)}")
    return found


def numbers(key: str, values: ArrayLike, expected: str = "numbers") -> NDArray[np.float64]:
    """Return the values as a new array of floats of any shape. Complex numbers, text and the like are refused."""
    try:
        given = np.asarray(values)
    except (TypeError, ValueError, OverflowError, RecursionError):
        raise InputError(f"{key}: expected {expected}: got rows of different lengths in {shown(values)}") from None
    if np.ma.is_masked(values):
        raise InputError(f"{key}: expected {expected}: got an array with masked entries")
    if given.dtype.kind == "O":
        return _one_by_one(key, given, expected)
    if given.dtype.kind not in "iuf":
        what = _KINDS.get(given.dtype.kind, str(given.dtype))
        raise InputError(f"{key}: expected {expected}: got {what}: {shown(values)}")
    with np.errstate(over="ignore"):  # a long double may overflow; callers refuse an infinite value if it matters
        return np.array(given, dtype=float)


def _one_by_one(key: str, given: NDArray[Any], expected: str) -> NDArray[np.float64]:
    """Convert an array of objects, such as integers too large for NumPy, to floats."""
    found = np.empty(given.shape)
    for place, value in np.ndenumerate(given):
        if not is_number(value):
            where = "".join(f"[{k}]" for k in place)
            raise InputError(f"{key}{where}: expected {expected}: got {shown(value)}")
        found[place] = number(value)
    return found


def per_particle(key: str, values: ArrayLike, n: int, one: str, what: str, signed: bool = False) -> NDArray[np.float64]:
    """Numbers (n,), zero or more unless ``signed``, from one number for all or one for each. ``one`` and ``what`` name
    them in messages."""
    found = numbers(key, values, f"one number or {n}")
    if found.ndim > 1 or (found.ndim == 1 and len(found) != n):
        raise InputError(f"{key}: expected one number or {n}, got shape {found.shape}")
    found = np.broadcast_to(found, (n,)).copy()
    bad = np.flatnonzero(~(np.isfinite(found) & ((found >= 0) | signed)))
    if bad.size:
        least = "" if signed else ", zero or more"
        raise InputError(f"{key}: particle {bad[0]} has {one} {found[bad[0]]}; expected {what}{least}")
    return found


def listed(key: str, values: Any, what: str) -> list[Any]:
    """Return the values as a list. Raises InputError for text, a table or a value that is not iterable."""
    if isinstance(values, str | bytes | dict) or not isinstance(values, Iterable):
        raise InputError(f"{key}: expected {what}, got {shown(values)}")
    return list(values)


def path_text(key: str, path: Any) -> str:
    """Return a file's name as text. Raises InputError for a value that is not a path."""
    try:
        name = os.fsdecode(path)
    except TypeError:
        raise InputError(f"{key}: expected the path of a file, got {shown(path)}") from None
    if "\0" in name:
        raise InputError(f"{key}: expected the path of a file, got {shown(name)}")
    return name


@contextmanager
def no_overflow() -> Iterator[None]:
    """Context in which an overflow, a division by zero or a nan in NumPy raises an InputError of one line."""
    try:
        with np.errstate(over="raise", divide="raise", invalid="raise"):
            yield
    except FloatingPointError as error:
        raise InputError(f"numbers too large or too small to compute with: {error}") from None


# For results from a run's state: the run itself reports a state that is not finite.
unwarned = np.errstate(over="ignore", divide="ignore", invalid="ignore")


def check_state(state: Any, kind: Any) -> None:
    """Raise InputError unless this is a state of that kind with a finite time."""
    if not isinstance(state, kind):
        raise InputError(f"state: expected a {kind.__name__}, got {type(state).__name__}")
    if not np.isfinite(state.time) or state.steps_done < 0:
        raise InputError(
            f"state: time must be finite and steps_done zero or more, got {state.time}, {state.steps_done}"
        )
