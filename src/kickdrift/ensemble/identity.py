"""Identity of an ensemble: texts that differ if its systems, its functions or their surroundings differ."""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from tokenize import TokenError
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np

from kickdrift.model.problem import Problem
from kickdrift.model.system import System


def digest(*parts: str | bytes) -> str:
    """Short digest of long texts."""
    found = hashlib.sha256()
    for part in parts:
        found.update(part.encode() if isinstance(part, str) else part)
        found.update(b"\0")
    return found.hexdigest()


def of_file(text: str, data: Mapping[str, Any], folder: Path) -> str:
    """Identity of a system file and its structure file, if any."""
    particles = data.get("particles")
    named = particles.get("file") if isinstance(particles, Mapping) else None
    path = folder / named if isinstance(named, str) else None
    return digest(text, path.read_bytes() if path and path.is_file() else b"")


def of_system(system: System | Problem) -> str:
    """Identity of a System or a Problem."""
    from kickdrift.trajectory.layout.record import record_of, run_record, to_json

    if isinstance(system, Problem):
        said = to_json([system.name, system.equation, system.parameters, run_record(system.run), system.t0])
        return digest(said, system.y0.tobytes(), of_function(system.f))
    state = system.state
    arrays = (state.phase, state.masses, state.ids, system.species_index)
    return digest(to_json(record_of(system)), *(array.tobytes() for array in arrays))


def of_function(function: Callable[..., Any]) -> str:
    """Identity of a function: its source, closure and defaults, and the functions of its module that it calls."""
    return digest(*_parts(function, set()))


def _parts(thing: Any, seen: set[int]) -> list[str]:
    if isinstance(thing, partial):
        return [*_parts(thing.func, seen), *_parts([*thing.args, *sorted(thing.keywords.items())], seen)]
    if isinstance(thing, list | tuple):
        return [part for each in thing for part in _parts(each, seen)]
    thing = getattr(thing, "py_func", thing)  # the source of a compiled function
    if isinstance(thing, np.ndarray):
        return [digest(str(thing.dtype), str(thing.shape), thing.tobytes())]
    if not isinstance(thing, FunctionType):
        shown = repr(thing)
        return [type(thing).__qualname__ if " at 0x" in shown or isinstance(thing, ModuleType) else shown]
    if id(thing) in seen:
        return [thing.__qualname__]
    seen.add(id(thing))
    found = [_source(thing), *_parts(list(thing.__defaults__ or ()), seen)]
    found += _parts(sorted((thing.__kwdefaults__ or {}).items()), seen)
    found += _parts(list(inspect.getclosurevars(thing).nonlocals.items()), seen)
    around = {name: thing.__globals__[name] for name in sorted(_names(thing.__code__)) if name in thing.__globals__}
    for name, value in around.items():
        if not isinstance(value, FunctionType) or value.__module__ == thing.__module__:
            found += [name, *_parts(value, seen)]
    return found


def _names(code: CodeType) -> set[str]:
    """Global names that code, and nested code, may use."""
    inner = [each for each in code.co_consts if isinstance(each, CodeType)]
    return set(code.co_names).union(*map(_names, inner))


def _source(function: FunctionType) -> str:
    try:
        return inspect.getsource(function)
    except (OSError, TypeError, SyntaxError, TokenError):  # no source, or the file has changed since
        return function.__qualname__ + function.__code__.co_code.hex()
