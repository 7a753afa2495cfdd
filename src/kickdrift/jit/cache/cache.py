"""Cache of machine code on disk. Every edit of a source changes the key.

Only drivers (functions that Python calls) and callbacks are cached; the functions that they call are compiled into
them. Each file holds the code of one function for the types of its arguments. A hash of all sources of the code (see
`described`) names the file, so an edit of any source gives another name. The folder is private to the user (see
`folders`), and old code is removed (see `code_files`).
"""

import re
import secrets
from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import Any

from numba import types

from kickdrift.jit.cache import code_files
from kickdrift.jit.cache.code_files import prune, use
from kickdrift.jit.cache.described import Sources
from kickdrift.jit.cache.folders import CODE, folder, make_private, warm
from kickdrift.jit.cache.notices import announce
from kickdrift.jit.cache.package_files import UnknownSource
from kickdrift.jit.inner import functions_in
from kickdrift.jit.numba_private import CompileResult, FunctionIdentity, rtsys, signature

# numba links machine code by names and tells functions apart by a count that begins at 1 in each process. So two
# functions from two processes can have one name (such as one function for two forces of equal types). A process that
# loads both from disk would run the first for both. Counts with random starts do not collide.
FunctionIdentity._unique_ids = count(secrets.randbits(60))


PRUNED_EVERY = 20  # saves of a process; looking at all files takes longer than a save
_saved = count()


class DriverCache:
    """Cache of one driver, with the methods that numba calls. Reads code from every private place, and writes to the
    one writable place."""

    def __init__(self, py_func: Callable[..., Any]) -> None:
        self._py_func = py_func
        name = f"{py_func.__module__}.{py_func.__qualname__}".removeprefix("kickdrift.")
        self._name = re.sub(r"[^\w.]+", "", name)[-100:]  # for people who look into the folder
        self._asked: dict[Any, str] = {}  # keys by types

    @property
    def cache_path(self) -> str:
        """Folder of the code."""
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
        """Code for these types, or None if it is not on disk and must be compiled now."""
        args = _args(sig)
        try:
            sources = self._sources(args)
            key = self._asked[args] = sources.key(target_context.codegen().magic_tuple())
        except UnknownSource:
            announce(kept=False)
            return None
        for place in (*warm(), folder()):
            content = code_files.load(path := self._path(place, key), key) if place is not None else None
            if content is None:
                continue
            # numba loads everything that compiling would need, which takes longer than the rest of a small run. Our
            # machine code needs only its memory.
            if sources.foreign:
                target_context.refresh()
            else:
                rtsys.initialize(target_context)
            try:
                found = CompileResult._rebuild(target_context, *content)
            except ImportError:  # the code refers to a user's module that this process cannot import
                continue
            use(path)
            return found._replace(signature=signature(found.signature.return_type, *args))
        announce(kept=folder() is not None)
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Save code, unless the key does not cover all its sources. A read-only disk is no error."""
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
        if next(_saved) % PRUNED_EVERY == 0:
            prune(path.parent)

    def enable(self) -> None: ...

    def disable(self) -> None: ...

    def flush(self) -> None: ...


class CallbackCache(DriverCache):
    """Cache of a function of plain numbers, compiled for one type."""

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
