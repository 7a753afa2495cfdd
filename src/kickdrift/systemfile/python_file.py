"""Systems and Problems from a Python file that the user names, and Problems from plain functions.

Such a file is a program: it runs with all the user's rights. So only a command whose argument names the file runs it.
"""

import inspect
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from kickdrift.errors import InputError
from kickdrift.integrators.own.registration import executed
from kickdrift.model.checks.values import numbers
from kickdrift.model.problem import Problem
from kickdrift.model.system import System
from kickdrift.systemfile.files import prefixed
from kickdrift.systemfile.reading import load, refuse_files
from kickdrift.text import choices, shown

BESIDE = ("t_span", "jacobian", "energy", "exact", "args", "separable", "name")  # names that a file may define
NAMED = ("system", "problem")


def load_or_run(
    name_or_path: str | os.PathLike[str], seed: int | None = None, overlaps: bool = False, **files: Any
) -> System | Problem:
    """The System or Problem of a system file, of a shipped system's name, or of a Python file, which is run. ``files``
    go with files of force fields, see `load`."""
    if not os.fspath(name_or_path).endswith(".py"):
        return load(name_or_path, seed, overlaps, **files)
    if seed is not None:
        raise InputError(f"seed: {os.fspath(name_or_path)} makes its own random numbers; expected a system file")
    refuse_files(name_or_path, files)
    return from_python(Path(name_or_path))


def from_python(path: Path) -> System | Problem:
    """Run a Python file and return the System or Problem that it defines.

    The file defines ``system`` or ``problem``, or another name for its only System or Problem, or ``f`` and ``y0`` with
    any of the names in BESIDE. An InputError of one line if it defines none of these."""
    found = vars(executed(path))
    with prefixed(f"{path}: "):
        for name in NAMED:
            if isinstance(found.get(name), System | Problem):
                return found[name]
        made = {key: value for key, value in found.items() if isinstance(value, System | Problem)}
        if len(made) == 1:
            return next(iter(made.values()))
        if made:
            raise InputError(f"defines {choices(made)}; name one of them system or problem")
        if not callable(found.get("f")) or "y0" not in found:
            raise InputError("expected a function f and y0, or a System or Problem named system or problem")
        given = {key: found[key] for key in BESIDE if key in found}
        return problem_of(found["f"], found["y0"], **{"name": path.stem, **given})


def problem_of(f: Callable[..., Any], y0: ArrayLike | None, t_span: Any = None, **more: Any) -> Problem:
    """The Problem y' = f(t, y), y(t_span[0]) = y0, whose run goes to t_span[1].

    ``more`` are further arguments of a Problem. An InputError for arguments that make no sense."""
    if y0 is None:
        raise InputError(f"y0: is needed beside the function {getattr(f, '__name__', shown(f))}")
    known = inspect.signature(Problem).parameters
    for key in more:
        if key not in known:
            raise InputError(f"{key}: a Problem takes no such argument")
    more.setdefault("name", getattr(f, "__name__", "problem").strip("<>"))
    if t_span is None:
        return Problem(f, y0, **more)
    begin, end = _span(t_span)
    return Problem(f, y0, t0=begin, **more).with_run(time=end - begin)


def _span(t_span: Any) -> tuple[float, float]:
    found = numbers("t_span", t_span)
    if found.shape != (2,) or not np.isfinite(found).all() or not found[1] > found[0]:
        raise InputError(f"t_span: expected two times, the second one later, got {shown(t_span)}")
    return float(found[0]), float(found[1])


def refuse_beside(given: Mapping[str, Any], subject: Any) -> None:
    """Refuse arguments of a plain function that are given with a System, a Problem or a file."""
    for key, value in given.items():
        if value is not None:
            raise InputError(f"{key}: only a plain function takes it, and this is a {type(subject).__name__}")
