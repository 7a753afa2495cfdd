"""The cache of machine code on disk, which sees every edit.

Only drivers (the functions that Python calls) and callbacks are cached; what they call is compiled into them. numba's
own index notices changes in the driver's file alone, so ours is a folder named by a hash of all the sources that it is
compiled from. A driver that was compiled around a class from outside the package (a user's force) gets a folder of its
own, named by that class's source too: it never shares an index with the package.
"""

from __future__ import annotations

import hashlib
import inspect
import secrets
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from numba import types

from kickdrift.jit.code_files import CodeFiles, at_leisure
from kickdrift.jit.folders import CODE, folder, make_private, warm
from kickdrift.jit.numba_private import (
    CacheLocator,
    CompileResultCacheImpl,
    FunctionCache,
    FunctionIdentity,
    rtsys,
    signature,
)

# Machine code is linked by names, in which numba tells functions apart by a count that begins at 1 in each process.
# Two functions (such as one function for two forces of equal types) that two processes compiled can have one name, and
# a process that loads both from the disk would run the first for both. Counts that begin anywhere do not meet.
FunctionIdentity._unique_ids = count(secrets.randbits(60))


@cache
def sources_hash() -> str:
    """A short hash of every source file that compiled code comes from."""
    digest = hashlib.sha256()
    package = Path(__file__).parents[1]
    folders = [path for name in ("jit", "forces", "integrators") for path in package.glob(f"{name}/*.py")]
    for path in sorted([*folders, package / "events/encounters.py"]):
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]


def foreign_classes(kind: Any) -> Iterator[type]:
    """The NamedTuple classes from outside the package that stand in a numba type."""
    if isinstance(kind, types.BaseNamedTuple) and not kind.instance_class.__module__.startswith("kickdrift."):
        yield kind.instance_class
    if isinstance(kind, types.BaseTuple):
        for part in kind:
            yield from foreign_classes(part)


def _described(value: Any, seen: set[int]) -> str:
    """A value that compiled code uses, as text that is the same in every process and changes with every edit."""
    function = getattr(value, "py_func", value)
    if inspect.isfunction(function):
        if id(function) in seen:
            return function.__qualname__
        seen.add(id(function))
        names = inspect.getclosurevars(function)
        used = sorted({**names.globals, **names.nonlocals}.items())
        return _code(function.__code__) + "".join(f"{key}={_described(what, seen)};" for key, what in used)
    if isinstance(value, np.ndarray):
        return f"{value.dtype}{value.shape}{hashlib.sha256(value.tobytes()).hexdigest()}"
    if inspect.ismodule(value):
        return value.__name__
    return repr(value)


def _code(code: Any) -> str:
    constants = [_code(c) if inspect.iscode(c) else repr(c) for c in code.co_consts]
    return f"{code.co_code.hex()}{code.co_names}{code.co_varnames}{code.co_freevars}{constants}"


def fingerprint(cls: type) -> str:
    """A user's class as text: its name and module, its methods and its kernel, and all that they call and close
    over."""
    bodies = [value for value in vars(cls).values() if inspect.isfunction(value) and value.__module__ == cls.__module__]
    bodies += list(getattr(cls, "kernel_sources", ()))
    seen: set[int] = set()
    return f"{cls.__module__}.{cls.__qualname__}" + "".join(_described(body, seen) for body in bodies)


class _Locator(CacheLocator):
    """Where one driver's machine code lies."""

    def __init__(self, py_func: Callable[..., Any], path: Path) -> None:
        self._path = path
        self._disambiguator = str(py_func.__code__.co_firstlineno)
        self._py_file = py_func.__code__.co_filename  # for numba's warnings

    def get_cache_path(self) -> str:
        return str(self._path)

    def ensure_cache_path(self) -> None:
        make_private(self._path)

    def get_source_stamp(self) -> str:
        return self._path.name

    def get_disambiguator(self) -> str:
        return self._disambiguator


class _CacheImpl(CompileResultCacheImpl):
    def __init__(self, py_func: Callable[..., Any], path: Path) -> None:
        self._lineno = py_func.__code__.co_firstlineno
        self._locator = _Locator(py_func, path)
        self._filename_base = self.get_filename_base(f"{py_func.__module__}.{py_func.__qualname__}", "")


class _FolderCache(FunctionCache):
    """numba's cache of one function, in a folder of our choosing."""

    def __init__(self, py_func: Callable[..., Any], path: Path, foreign: bool) -> None:
        self._impl_class = lambda function: _CacheImpl(function, path)
        self._foreign = foreign
        super().__init__(py_func)
        self._cache_file = CodeFiles(self._cache_path, self._impl.filename_base, self._impl.locator.get_source_stamp())

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        if self._foreign:
            return super().load_overload(sig, target_context)
        # numba loads all that compiling would need, which takes longer than all else that a small run does; our own
        # machine code needs its memory alone.
        rtsys.initialize(target_context)
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        return str(sig), codegen.magic_tuple()  # by name: a class of the user's script is a new object in each process


class DriverCache:
    """The cache of one driver: a folder for the package, and one more for each user's class. Code is read from every
    place that is private, and kept in the one that can be written."""

    def __init__(self, py_func: Callable[..., Any]) -> None:
        self._py_func = py_func
        self._folders: dict[Path, _FolderCache] = {}

    @property
    def cache_path(self) -> str:
        return str(folder() or "")

    def _folder(self, sig: Any) -> tuple[str, bool]:
        """The name of the folder, and whether a user's class is in its code."""
        args = sig if isinstance(sig, tuple) else sig.args
        foreign = sorted({fingerprint(cls) for kind in args for cls in foreign_classes(kind)})
        return self._named(*foreign)

    def _named(self, *foreign: str, kind: str = "") -> tuple[str, bool]:
        return hashlib.sha256("".join([sources_hash(), *foreign, kind]).encode()).hexdigest()[:16], bool(foreign)

    def _caches(self, sig: Any, places: Iterable[Path | None]) -> Iterator[_FolderCache]:
        name, foreign = self._folder(sig)
        for path in (place / CODE / name for place in places if place is not None):
            if path not in self._folders:
                self._folders[path] = _FolderCache(self._py_func, path, foreign)
            yield self._folders[path]

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        for each in self._caches(sig, (*warm(), folder())):
            try:
                found = each.load_overload(sig, target_context)
            except ImportError:  # it refers to a module of the user's that this process cannot import
                found = None
            if found is not None:
                args = sig if isinstance(sig, tuple) else sig.args
                return found._replace(signature=signature(found.signature.return_type, *args))
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        with at_leisure():
            for each in self._caches(sig, [folder()]):
                each.save_overload(sig, data)

    def enable(self) -> None: ...

    def disable(self) -> None: ...

    def flush(self) -> None: ...


class CallbackCache(DriverCache):
    """The cache of a function of plain numbers that is made around a type: a folder for each type."""

    def __init__(self, py_func: Callable[..., Any], kind: types.Type) -> None:
        super().__init__(py_func)
        self._kind = kind

    def _folder(self, sig: Any) -> tuple[str, bool]:
        return self._named(*sorted({fingerprint(cls) for cls in foreign_classes(self._kind)}), kind=str(self._kind))
