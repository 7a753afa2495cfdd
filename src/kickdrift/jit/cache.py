"""The cache of machine code on disk, which sees every edit.

Only drivers (the functions that Python calls) and callbacks are cached; what they call is compiled into them. Each file
holds the code of one function for the types of its arguments, and is named by a hash of all that the code comes from
(see `sources`): whatever is edited, the code of before has another name. The folder is the user's alone (see
`folders`); old code leaves it (see `pruning`).
"""

from __future__ import annotations

import re
import secrets
from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import Any

from numba import types

from kickdrift.jit import code_files
from kickdrift.jit.folders import CODE, folder, make_private, warm
from kickdrift.jit.inner import functions_in
from kickdrift.jit.numba_private import CompileResult, FunctionIdentity, rtsys, signature
from kickdrift.jit.package_files import UnknownSource
from kickdrift.jit.pruning import prune, use
from kickdrift.jit.sources import Sources

# Machine code is linked by names, in which numba tells functions apart by a count that begins at 1 in each process.
# Two functions (such as one function for two forces of equal types) that two processes compiled can have one name, and
# a process that loads both from the disk would run the first for both. Counts that begin anywhere do not meet.
FunctionIdentity._unique_ids = count(secrets.randbits(60))


class DriverCache:
    """The cache of one driver, as numba asks for it. Code is read from every place that is private, and kept in the
    one that can be written."""

    def __init__(self, py_func: Callable[..., Any]) -> None:
        self._py_func = py_func
        name = f"{py_func.__module__}.{py_func.__qualname__}".removeprefix("kickdrift.")
        self._name = re.sub(r"[^\w.]+", "", name)[-100:]  # for people who look into the folder
        self._asked: dict[Any, str] = {}  # keys, by types

    @property
    def cache_path(self) -> str:
        """Where code is kept."""
        return str(folder() or "")

    def _sources(self, args: tuple[types.Type, ...]) -> Sources:
        sources = Sources()
        sources.add_function(self._py_func)
        for kind in args:
            sources.add_type(kind)
        return sources

    def _path(self, place: Path, key: str) -> Path:
        return place / CODE / f"{self._name}.{key[:32]}{code_files.SUFFIX}"

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The code for these types; None where it is not on the disk."""
        args = _args(sig)
        try:
            sources = self._sources(args)
            key = self._asked[args] = sources.key(target_context.codegen().magic_tuple())
        except UnknownSource:
            return None
        for place in (*warm(), folder()):
            content = code_files.load(path := self._path(place, key), key) if place is not None else None
            if content is None:
                continue
            # numba loads all that compiling would need, which takes longer than all else that a small run does; our
            # own machine code needs its memory alone.
            if sources.foreign:
                target_context.refresh()
            else:
                rtsys.initialize(target_context)
            try:
                found = CompileResult._rebuild(target_context, *content)
            except ImportError:  # it refers to a module of the user's that this process cannot import
                continue
            use(path)
            return found._replace(signature=signature(found.signature.return_type, *args))
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep code, unless it may come from more than its key tells of; a disk that cannot be written is no error."""
        args, place = _args(sig), folder()
        if place is None or data.library.has_dynamic_globals:
            return
        try:
            sources = self._sources(args)
            key = sources.key(data.codegen.magic_tuple())
        except UnknownSource:
            return
        if key != self._asked.get(args) or not sources.cover(functions_in(data.library)):
            return
        path = self._path(place, key)
        try:
            make_private(path.parent)
            code_files.save(path, key, data._reduce())
        except OSError:
            return
        use(path)
        prune(path.parent)

    def enable(self) -> None: ...

    def disable(self) -> None: ...

    def flush(self) -> None: ...


class CallbackCache(DriverCache):
    """The cache of a function of plain numbers that is made around a type."""

    def __init__(self, py_func: Callable[..., Any], kind: types.Type) -> None:
        super().__init__(py_func)
        self._kind = kind

    def _sources(self, args: tuple[types.Type, ...]) -> Sources:
        sources = Sources()
        sources.add_made_around(self._py_func, self._kind)
        for each in args:
            sources.add_type(each)
        return sources


def _args(sig: Any) -> tuple[types.Type, ...]:
    return tuple(sig if isinstance(sig, tuple) else sig.args)
