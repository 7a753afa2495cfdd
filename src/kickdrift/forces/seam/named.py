"""Forces, functions and calculators that files may name: those that this program has registered or named itself.

A file names code by its import path, such as ``ase.calculators.emt.EMT``. Nothing is imported because a file says so.
A path is found if the program has made a force of this function or class, has registered it, or has loaded its module
with ``--load``.

Only classes in the registry of forces can be made from the content of a system file or a run's file.
"""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable
from dataclasses import is_dataclass
from importlib import import_module
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any, TypeVar, overload

from kickdrift.errors import InputError
from kickdrift.text import VALUE, clean, shown, suggestion

_NAMED: dict[str, Any] = {}  # functions and classes by import path
_FUNCTIONS: dict[str, Any] = {}  # rules of collisions by import path
_MODULES: set[str] = set()  # modules that ``--load`` named
_FILES: set[str] = set()  # modules of Python files that ``--load`` named


def path_of(code: Any) -> str:
    """Import path of a function or class."""
    module, name = getattr(code, "__module__", None), getattr(code, "__qualname__", None)
    return f"{module}.{name}" if module and name else f"{type(code).__module__}.{type(code).__qualname__}"


def named(code: Callable[..., Any]) -> str:
    """Let files name this function or class, and return its import path.

    A file cannot say which call made a function inside another function, or an object, so these are not found again."""
    path = path_of(code)
    if hasattr(code, "__qualname__") and "<" not in path:
        _NAMED[path] = code
    return path


def load_module(name: str) -> None:
    """Import a module, and let files name the functions and calculators that it defines.

    Raises an InputError of one line if there is no such module, if the import fails, and for a module of Python's own,
    which has no calculators but much that runs commands and removes files."""
    if name.partition(".")[0] in sys.stdlib_module_names:
        raise InputError(f"--load {name}: a module of Python's own; give a module of calculators that you trust")
    try:
        import_module(name)
    except ModuleNotFoundError as error:
        missing = error.name or name
        raise InputError(f"--load {name}: there is no module {missing!r}{installation(missing)}") from None
    except Exception as error:
        raise InputError(f"--load {name}: {type(error).__name__}: {' '.join(str(error).split())}") from error
    _MODULES.add(name)


def named_function(function: Callable[..., Any]) -> str:
    """Let files name this function as a rule of collisions, and return its import path."""
    path = path_of(function)
    if "<" not in path:
        _FUNCTIONS[path] = function
    return path


def name_functions(module: ModuleType) -> None:
    """Let files name the functions that a loaded Python file defines, as rules of collisions."""
    _FILES.add(module.__name__)
    for value in list(vars(module).values()):
        plain = getattr(value, "py_func", value)  # of a function that numba compiles
        if isinstance(plain, FunctionType) and plain.__module__ == module.__name__:
            named_function(value)


def found_function(key: str, path: Any) -> Any:
    """The function of an import path in a file, for a rule of collisions: see `found`. Functions of a Python file that
    was given to ``--load`` are found too."""
    if not isinstance(path, str):
        return found(key, path, is_function)
    if path in _FUNCTIONS:
        return _FUNCTIONS[path]
    module, _, name = path.rpartition(".")
    if module in _FILES and path not in _NAMED:
        own = [each.rpartition(".")[2] for each in _FUNCTIONS if each.rpartition(".")[0] == module]
        raise InputError(f"{key}: {module}.py defines no function {name!r}{suggestion(name, own)}")
    return found(key, path, is_function)


def home_of(path: Any) -> str | Path | None:
    """What another process loads before a file may name this code: a Python file, or the name of a module. None for
    code that this program has not named."""
    if not isinstance(path, str) or "." not in path:
        return None
    module = path.rpartition(".")[0]
    if module in _MODULES or (path in _NAMED and "." in module):
        return module
    code = _NAMED.get(path)
    source = None if code is None else getattr(sys.modules.get(code.__module__), "__file__", None)
    return Path(source).resolve() if source else None


def takes_batches(calculator: Any) -> bool:
    """Whether a calculator takes several Atoms at once."""
    return callable(getattr(calculator, "calculate_batch", None))


def installation(module: str) -> str:
    """The package to install for a missing module of ASE; else ""."""
    return "; ASE: pip install 'kickdrift[ase]'" if module.split(".")[0] == "ase" and "ase" not in sys.modules else ""


def is_function(code: Any) -> bool:
    """Whether this is a plain function, or one that numba compiles."""
    return isinstance(getattr(code, "py_func", code), FunctionType)


def is_calculator(code: Any) -> bool:
    """Whether this is a class of calculators, by the attributes of ASE's Calculator. Calls nothing."""
    return isinstance(code, type) and hasattr(code, "implemented_properties") and hasattr(code, "calculate")


def found(key: str, path: Any, fits: Callable[[Any], bool]) -> Any:
    """The function or class of an import path in a file.

    Raises an InputError that begins with ``key`` for a path that this program has not named, and for one that does not
    exist. In a module that ``--load`` named, the file chooses the name, so only what ``fits`` is found."""
    if not isinstance(path, str) or not all(part.isidentifier() for part in path.split(".")) or "." not in path:
        raise InputError(f"{key}: expected an import path such as ase.calculators.emt.EMT, got {shown(path)}")
    if path in _NAMED:
        return _NAMED[path]
    module, _, name = path.rpartition(".")
    if module not in _MODULES:
        raise InputError(
            f"{key}: {clean(path, VALUE)} is code, and a file runs no code by itself; kickdrift --load MODULE COMMAND "
            "(or --load FILE.py) allows it for a module that you trust, in Python kd.register_force or a system given "
            "to kd.resume"
        )
    there = vars(sys.modules[module])
    own = [each for each, value in there.items() if fits(value) and path_of(value) == f"{module}.{each}"]
    if name not in own:
        what = "calculator " if fits is is_calculator else "function " if fits is is_function else ""
        raise InputError(f"{key}: module {module} defines no {what}{clean(name, VALUE)}{suggestion(name, own)}")
    return there[name]


Class = TypeVar("Class", bound=type)
FORCES: dict[str, Any] = {}  # by name
GIVES_WAY = "kickdrift.forces.pairs.shipped"  # its names are free for users
REGISTERED: dict[tuple[str, str], type] = {}  # the user's classes, by module and qualified name


@overload
def register_force(cls: Class, *, overwrite: bool = False) -> Class: ...
@overload
def register_force(cls: None = None, *, overwrite: bool = False) -> Any: ...
def register_force(cls: Any = None, *, overwrite: bool = False) -> Any:
    """Class decorator: system files and run files may name this class of force. Also for plain functions and ASE
    calculators: a file may then name them in ``type = "python"`` and ``type = "ase"``.

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
        belongs to another force. Names of shipped pair laws besides Lennard-Jones are free: your class stands for the
        name in this process.
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
    """Register the class's name for system files. Pair laws that ship by name give way to a user's law, because users
    had laws of these names before."""
    name = cls.name
    if not (isinstance(name, str) and name and name == name.strip()):
        raise InputError(f"register_force: a force's name must be a word, got {shown(name)}")
    known = FORCES.get(name)
    if known is not None and _where(known) != _where(cls):
        own = known.__module__.startswith("kickdrift.") and known.__module__ != GIVES_WAY
        if own or not overwrite:
            hint = "" if own else "; overwrite=True replaces it"
            raise InputError(f"force {name!r} exists already: {known.__qualname__} of {known.__module__}{hint}")
    FORCES[name] = cls


def _where(cls: Any) -> tuple[str, str]:
    return cls.__module__, cls.__qualname__


def registered(module: str, name: str) -> Any:
    """Class of that module and qualified name; None if no such class is registered."""
    return REGISTERED.get((module, name))
