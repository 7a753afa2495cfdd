"""The forces of the user's own: only classes that stand here can be made from what a run's file says."""

from __future__ import annotations

from dataclasses import is_dataclass
from typing import Any, TypeVar

from kickdrift.errors import InputError

Class = TypeVar("Class", bound=type)
REGISTERED: dict[tuple[str, str], type] = {}  # by module and qualified name


def register_force(cls: Class) -> Class:
    """Class decorator: a run's file may name this class of force, and `resume` makes one with the file's parameters.

    ``pair_law`` registers what it makes. Other classes, such as a subclass of `HarmonicTrap`, need this line. A class
    of the same module and name takes the old one's place. A class that is made inside a function is left out: a file
    cannot say which call made the class.

    Raises
    ------
    InputError
        Where this is no class of forces, or not a dataclass or NamedTuple: a file keeps the fields of these.
    """
    whole = isinstance(cls, type) and all(hasattr(cls, part) for part in ("name", "check", "bind"))
    if not whole or not (is_dataclass(cls) or hasattr(cls, "_fields")):
        raise InputError(f"register_force: expected a dataclass with name, check and bind, got {cls!r}")
    if "<locals>" not in cls.__qualname__:
        REGISTERED[cls.__module__, cls.__qualname__] = cls
    return cls


def registered(module: str, name: str) -> Any:
    """The class of that module and qualified name; None where no such class was registered."""
    return REGISTERED.get((module, name))
