"""The registry of forces, by the name that system files use; it holds kickdrift's own and the user's.

Only classes that stand here can be made from what a system file or a run's file says.
"""

from __future__ import annotations

from dataclasses import is_dataclass
from typing import Any, TypeVar, overload

from kickdrift.errors import InputError
from kickdrift.text import shown

Class = TypeVar("Class", bound=type)
FORCES: dict[str, Any] = {}  # by name
REGISTERED: dict[tuple[str, str], type] = {}  # the user's, by module and qualified name


@overload
def register_force(cls: Class, *, overwrite: bool = False) -> Class: ...
@overload
def register_force(cls: None = None, *, overwrite: bool = False) -> Any: ...
def register_force(cls: Any = None, *, overwrite: bool = False) -> Any:
    """Class decorator: system files may name this class of force, and so may a run's file.

    A system file uses the ``name`` that the class itself defines, with ``--load FILE.py`` on the command line; a class
    that inherits its name is for a run's file alone. ``kickdrift list forces`` shows the force. ``resume`` makes the
    force again with the file's parameters.

    ``pair_law`` registers what it makes. Other classes, such as a subclass of `HarmonicTrap`, need this line. A class
    of the same module and name takes the old one's place, and with ``overwrite`` so does any class for a name of the
    user's. A class that is made inside a function is left out: a file cannot say which call made the class.

    Raises
    ------
    InputError
        Where this is no class of forces, or not a dataclass or NamedTuple: a file keeps the fields of these. Where the
        name belongs to another force.
    """
    if cls is None:
        return lambda cls: register_force(cls, overwrite=overwrite)
    whole = isinstance(cls, type) and all(hasattr(cls, part) for part in ("name", "check", "bind"))
    if not whole or not (is_dataclass(cls) or hasattr(cls, "_fields")):
        raise InputError(f"register_force: expected a dataclass with name, check and bind, got {shown(cls)}")
    if "<locals>" not in cls.__qualname__:
        if "name" in vars(cls):
            _name(cls, overwrite)
        REGISTERED[cls.__module__, cls.__qualname__] = cls
    return cls


def _name(cls: Any, overwrite: bool) -> None:
    """Have system files find the class by its name."""
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
    """The class of that module and qualified name; None where no such class was registered."""
    return REGISTERED.get((module, name))
