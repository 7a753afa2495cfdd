"""Registry of forces by the name in system files: kickdrift's own and the user's.

Only classes in this registry can be made from the content of a system file or a run's file.
"""

from __future__ import annotations

import inspect
from dataclasses import is_dataclass
from typing import Any, TypeVar, overload

from kickdrift.errors import InputError
from kickdrift.forces.seam.named import is_calculator, named
from kickdrift.text import shown

Class = TypeVar("Class", bound=type)
FORCES: dict[str, Any] = {}  # by name
REGISTERED: dict[tuple[str, str], type] = {}  # the user's classes, by module and qualified name


@overload
def register_force(cls: Class, *, overwrite: bool = False) -> Class: ...
@overload
def register_force(cls: None = None, *, overwrite: bool = False) -> Any: ...
def register_force(cls: Any = None, *, overwrite: bool = False) -> Any:
    """Class decorator: system files and run files may name this class of force. The decorator also takes plain
    functions and ASE calculators, which a file may then name in ``type = "python"`` and ``type = "ase"``.

    A system file uses the ``name`` that the class itself defines, with ``--load FILE.py`` on the command line. A class
    with an inherited name serves run files only. ``kickdrift list forces`` shows the force. ``resume`` makes the force
    again with the file's parameters.

    ``pair_law`` registers its classes. Other classes, such as a subclass of `HarmonicTrap`, need this decorator. A
    class of the same module and name replaces the old one. With ``overwrite``, any class replaces a user's class of the
    same force name. A class made inside a function is not registered: a file cannot say which call made it.

    Raises
    ------
    InputError
        If this is not a class of forces, or not a dataclass or NamedTuple, whose fields a file stores. If the name
        belongs to another force.
    """
    if cls is None:
        return lambda cls: register_force(cls, overwrite=overwrite)
    if inspect.isfunction(cls) or is_calculator(cls):
        named(cls)
        return cls
    whole = isinstance(cls, type) and all(hasattr(cls, part) for part in ("name", "check", "bind"))
    if not whole or not (is_dataclass(cls) or hasattr(cls, "_fields")):
        raise InputError(f"register_force: expected a dataclass with name, check and bind, got {shown(cls)}")
    if "<locals>" not in cls.__qualname__:
        if "name" in vars(cls):
            _name(cls, overwrite)
        REGISTERED[cls.__module__, cls.__qualname__] = cls
    return cls


def _name(cls: Any, overwrite: bool) -> None:
    """Register the class's name for system files."""
    name = cls.name
    if not (isinstance(name, str) and name and name == name.strip()):
        raise InputError(f"register_force: a force's name must be a word, got {shown(name)}")
    known = FORCES.get(name)
    if known is not None and _where(known) != _where(cls):
        own = known.__module__.startswith("kickdrift.")
        if own or not overwrite:
            hint = "" if own else "; overwrite=True replaces it"
            raise InputError(f"force {name!r} exists already: {known.__qualname__} of {known.__module__}{hint}")
    FORCES[name] = cls


def _where(cls: Any) -> tuple[str, str]:
    return cls.__module__, cls.__qualname__


def registered(module: str, name: str) -> Any:
    """Class of that module and qualified name; None if no such class is registered."""
    return REGISTERED.get((module, name))
