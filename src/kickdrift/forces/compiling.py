"""How kickdrift compiles: numba's flags in one place, and a cache on disk that sees every edit.

Only drivers (the functions that Python calls) are cached; what they call is compiled into them. numba's own index
notices changes in the driver's file alone, so ours is a folder named by a hash of all the sources that it is compiled
from. A driver that was compiled around a class from outside the package (a user's force) gets a folder of its own,
named by that class's source too: it never shares an index with the package.
"""

from __future__ import annotations

import gc
import hashlib
import inspect
import secrets
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import cache
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from numba import types
from numba.core.bytecode import FunctionIdentity
from numba.core.caching import CompileResultCacheImpl, FunctionCache, _CacheLocator
from numba.core.ccallback import CFunc
from numba.core.registry import CPUDispatcher, cpu_target
from numba.core.runtime import rtsys
from numba.core.typing.templates import signature
from numba.extending import intrinsic

from kickdrift.cache import CODE, folder, make_private, warm
from kickdrift.code_files import CodeFiles, at_leisure
from kickdrift.forces.inner import OPTIONS, inner

# Machine code is linked by names, in which numba tells functions apart by a count that begins at 1 in each process.
# Two functions (such as one function for two forces of equal types) that two processes compiled can have one name, and
# a process that loads both from the disk would run the first for both. Counts that begin anywhere do not meet.
FunctionIdentity._unique_ids = count(secrets.randbits(60))

FAST_MATH = {"reassoc", "nsz", "arcp", "contract"}  # never nnan or ninf: blow-ups are found by their NaN

# What is not said a compiled function takes over from its caller: hence each False below.
jit = inner(fastmath=FAST_MATH, forceinline=False)
# The same, always made part of the caller: handing over its arrays takes longer than a step of a few bodies.
inlined = inner(fastmath=FAST_MATH, forceinline=True)
# Always made part of the caller, sums in the order as written.
in_order = inner(fastmath={"nsz", "contract"}, forceinline=True)
# Operation by operation as written, for what reassociation would undo.
strict = inner(fastmath=False, forceinline=False)
# The same, always made part of the caller: for all that forces on threads run. Where LLVM may choose which products to
# fuse with sums, two copies of one formula can differ in the last bit; `simd.multiply_add` says where fusing pays.
as_written = inner(fastmath=False, forceinline=True)


def processor() -> str:
    """The kind of processor that code is compiled for, in LLVM's words; the same bits are promised on one kind."""
    return str(cpu_target.target_context.codegen().magic_tuple()[1])


@cache
def features() -> tuple[str, ...]:
    """The processor features that code is compiled for ("avx2", "fma" …), sorted, in LLVM's words.

    numba's settings (``NUMBA_CPU_NAME``, ``NUMBA_CPU_FEATURES``, ``NUMBA_ENABLE_AVX``) go before the machine's own.
    """
    named = cpu_target.target_context.codegen().magic_tuple()[2].split(",")
    return tuple(sorted(name.removeprefix("+") for name in named if name.startswith("+")))


@intrinsic
def never_inline(typingctx):
    """Called in a function's body: keep it one piece of machine code wherever it is called from, so that it rounds
    alike."""

    def codegen(context, builder, sig, args):
        builder.function.attributes.discard("alwaysinline")  # which it may have taken over from its caller
        builder.function.attributes.add("noinline")
        return context.get_dummy_value()

    return types.void(), codegen


@cache
def sources_hash() -> str:
    """A short hash of every source file that compiled code comes from."""
    digest = hashlib.sha256()
    package = Path(__file__).parents[1]
    folders = [*package.glob("forces/*.py"), *package.glob("integrators/*.py")]
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


class _Locator(_CacheLocator):
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


class _DriverCache:
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


class _CallbackCache(_DriverCache):
    """The cache of a function of plain numbers that is made around a type: a folder for each type."""

    def __init__(self, py_func: Callable[..., Any], kind: types.Type) -> None:
        super().__init__(py_func)
        self._kind = kind

    def _folder(self, sig: Any) -> tuple[str, bool]:
        return self._named(*sorted({fingerprint(cls) for cls in foreign_classes(self._kind)}), kind=str(self._kind))


def callback(function: Callable[..., Any], of: Any, kind: types.Type) -> Any:
    """Compile a function with the signature ``of`` plain numbers and pointers, which code that knows its ``address``
    calls; ``kind`` is the type that it is made around, and its machine code is kept on disk for each."""
    made: Any = CFunc(function, (of.args, of.return_type), {}, OPTIONS | {"fastmath": FAST_MATH})
    made._cache = _CallbackCache(function, kind)
    with no_collection():
        made.compile()
    return made


class _Driver(CPUDispatcher):
    """A compiled function that Python calls."""

    def compile(self, sig: Any) -> Any:
        with no_collection():
            return super().compile(sig)


@contextmanager
def no_collection() -> Iterator[None]:
    """Inside, Python looks for no garbage: of the many objects that numba makes there is none, and looking through them
    again and again took a tenth of the time to compile."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def driver(function: Callable[..., Any]) -> Any:
    """Compile a function that Python calls, with its machine code kept on disk."""
    dispatcher = _Driver(function, targetoptions=OPTIONS | {"fastmath": FAST_MATH, "nogil": True})
    dispatcher._cache = _DriverCache(function)
    return dispatcher
