"""Refuse laws with state: a law is a formula, so its code may keep nothing between calls."""

from __future__ import annotations

import dis
import inspect
from collections.abc import Iterator
from types import FunctionType, ModuleType
from typing import Any

import numpy as np

from kickdrift.errors import InputError

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
