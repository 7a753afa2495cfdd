"""Compilation: numba's flags in one place, and drivers, the functions that Python calls."""

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from math import inf
from typing import Any

from numba import types
from numba.extending import intrinsic

from kickdrift.jit.cache.cache import DriverCache
from kickdrift.jit.cache.notices import machine_code
from kickdrift.jit.inner import OPTIONS, inner
from kickdrift.jit.numba_private import CPUContext, CPUDispatcher, cpu_target

FAST_MATH = {"reassoc", "nsz", "arcp", "contract"}  # never nnan or ninf: blow-ups are found by their NaN
# A compiled function inherits unset options from its caller, hence each False below.
jit = inner(fastmath=FAST_MATH, forceinline=False)
# The same, always inlined: passing its arrays would take longer than a step of a few bodies.
inlined = inner(fastmath=FAST_MATH, forceinline=True)
# Always inlined, with sums in the order as written.
in_order = inner(fastmath={"nsz", "contract"}, forceinline=True)
# Operation by operation as written, for code that reassociation would break.
strict = inner(fastmath=False, forceinline=False)
# The same, always inlined: for everything that forces on threads run. If LLVM chooses which products to fuse with sums,
# two copies of one formula can differ in the last bit. `lanes.multiply_add` marks the products worth fusing.
as_written = inner(fastmath=False, forceinline=True)


def _internal_functions(context: Any) -> dict[Any, Any]:
    """Compile numba's internal functions, such as ``x**2``, with the fast-math flags of this context.

    numba keeps one copy of each for all flags, with the flags of its first caller. Then the bits of a power would
    depend on the code that was compiled earlier or found in the cache.
    """
    flags = context.fastmath.flags if context.fastmath else ()
    found: dict[Any, Any] = context.internal_functions.setdefault(frozenset(flags), {})
    return found


def _begin_internal_functions(context: Any, _: Any) -> None:
    context.internal_functions = {}


CPUContext.cached_internal_func = property(_internal_functions, _begin_internal_functions)
_begin_internal_functions(cpu_target.target_context, {})


def processor() -> str:
    """Kind of processor in LLVM's words. The same bits are promised on one kind."""
    return str(cpu_target.target_context.codegen().magic_tuple()[1])


@cache
def features() -> tuple[str, ...]:
    """Processor features of compiled code ("avx2", "fma" …), sorted, in LLVM's words.

    numba's settings (``NUMBA_CPU_NAME``, ``NUMBA_CPU_FEATURES``, ``NUMBA_ENABLE_AVX``) override the machine's own.
    """
    named = cpu_target.target_context.codegen().magic_tuple()[2].split(",")
    return tuple(sorted(name.removeprefix("+") for name in named if name.startswith("+")))


@inlined
def is_finite(number):
    """Tell whether a number is neither infinite nor NaN. np.isfinite tests number - number == 0, and reassociation can
    make this 0 for a sum."""
    return -inf < number and number < inf


@intrinsic
def never_inline(typingctx):
    """Keep the function one piece of machine code for all callers, so that it rounds alike. Call this in its body."""

    def codegen(context, builder, sig, args):
        builder.function.attributes.discard("alwaysinline")  # which it may inherit from its caller
        builder.function.attributes.add("noinline")
        return context.get_dummy_value()

    return types.void(), codegen


@intrinsic
def plain(typingctx, number):
    """Return a whole number. numba compiles a function again for each constant that a call has as an argument, and for
    a constant that a loop changes later. It knows only the type of the number that this function returns."""

    def codegen(context, builder, sig, args):
        return args[0]

    return types.intp(types.intp), codegen


class _Driver(CPUDispatcher):
    """Compiled function that Python calls."""

    def compile(self, sig: Any) -> Any:
        with no_collection(), machine_code.made():
            return super().compile(sig)


@contextmanager
def no_collection() -> Iterator[None]:
    """Suspend garbage collection. None of numba's many objects is garbage, and scanning them took a tenth of the
    compilation time."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def driver(function: Callable[..., Any]) -> Any:
    """Compile a function that Python calls, and keep its machine code on disk."""
    dispatcher = _Driver(function, targetoptions=OPTIONS | {"fastmath": FAST_MATH, "nogil": True})
    dispatcher._cache = DriverCache(function)
    return dispatcher
