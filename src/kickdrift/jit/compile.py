"""How kickdrift compiles: numba's flags in one place, and the functions that Python calls."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from math import inf
from typing import Any

from numba import types
from numba.extending import intrinsic

from kickdrift.jit.cache import DriverCache
from kickdrift.jit.inner import OPTIONS, inner
from kickdrift.jit.numba_private import CPUContext, CPUDispatcher, cpu_target

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
# fuse with sums, two copies of one formula can differ in the last bit; `lanes.multiply_add` says where fusing pays.
as_written = inner(fastmath=False, forceinline=True)


def _internal_functions(context: Any) -> dict[Any, Any]:
    """The functions that numba compiles by itself, such as ``x**2``, with the fast-math flags of this context.

    numba keeps one copy of each for all flags, those of the function that needed it first. Then the bits of a power
    would depend on what else was compiled before, or was found in the cache.
    """
    flags = context.fastmath.flags if context.fastmath else ()
    found: dict[Any, Any] = context.internal_functions.setdefault(frozenset(flags), {})
    return found


def _begin_internal_functions(context: Any, _: Any) -> None:
    context.internal_functions = {}


CPUContext.cached_internal_func = property(_internal_functions, _begin_internal_functions)
_begin_internal_functions(cpu_target.target_context, {})


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


@inlined
def is_finite(number):
    """Whether it is neither infinite nor NaN. np.isfinite asks whether number - number is 0, and reassociation may make
    that 0 for a sum."""
    return -inf < number and number < inf


@intrinsic
def never_inline(typingctx):
    """Called in a function's body: keep it one piece of machine code wherever it is called from, so that it rounds
    alike."""

    def codegen(context, builder, sig, args):
        builder.function.attributes.discard("alwaysinline")  # which it may have taken over from its caller
        builder.function.attributes.add("noinline")
        return context.get_dummy_value()

    return types.void(), codegen


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
    dispatcher._cache = DriverCache(function)
    return dispatcher
