"""Whole numbers that threads share, by their addresses; the C library's locks; and a clock, for compiled code."""

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from kickdrift.jit.numba_private import cgutils

_WHOLE, _INT = ir.IntType(64), ir.IntType(32)
_ORDER = "seq_cst"  # of all operations: simple, and on x86 only stores cost more
_BYTES = 8
_MONOTONIC = 1  # a clock of Linux that never goes back
_SECOND = 1_000_000_000
_PAUSES = {"x86_64": ("llvm.x86.sse2.pause", ()), "aarch64": ("llvm.aarch64.isb", (15,))}  # LLVM's names and numbers


def _pointer(builder: Any, place: ir.Value) -> ir.Value:
    return builder.inttoptr(place, _WHOLE.as_pointer())


@intrinsic
def read(typingctx, place):
    """Return the number at an address, as the last of all threads' writes left it."""

    def codegen(context, builder, sig, args):
        return builder.load_atomic(_pointer(builder, args[0]), _ORDER, _BYTES)

    return types.int64(types.intp), codegen


@intrinsic
def write(typingctx, place, number):
    """Write the number at an address, for all threads."""

    def codegen(context, builder, sig, args):
        builder.store_atomic(args[1], _pointer(builder, args[0]), _ORDER, _BYTES)
        return context.get_dummy_value()

    return types.void(types.intp, types.int64), codegen


@intrinsic
def add(typingctx, place, number):
    """Add to the number at an address; return the sum."""

    def codegen(context, builder, sig, args):
        before = builder.atomic_rmw("add", _pointer(builder, args[0]), args[1], _ORDER)
        return builder.add(before, args[1])

    return types.int64(types.intp, types.int64), codegen


@intrinsic
def replace(typingctx, place, expected, number):
    """Write the number at an address if the address holds the expected one; tell whether."""

    def codegen(context, builder, sig, args):
        done = builder.cmpxchg(_pointer(builder, args[0]), args[1], args[2], _ORDER, _ORDER)
        return builder.extract_value(done, 1)

    return types.boolean(types.intp, types.int64, types.int64), codegen


def _from_c(name: str, count: int) -> Any:
    """A function of the C library that takes addresses and returns an int."""
    kind = ir.FunctionType(_INT, [_WHOLE] * count)

    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> ir.Value:
        function = cgutils.get_or_insert_function(builder.module, kind, name)
        return builder.call(function, args)

    return types.int32(*[types.intp] * count), codegen


@intrinsic
def lock(typingctx, mutex):
    """Wait for a mutex of the C library, and take it."""
    return _from_c("pthread_mutex_lock", 1)


@intrinsic
def unlock(typingctx, mutex):
    """Release a mutex."""
    return _from_c("pthread_mutex_unlock", 1)


@intrinsic
def sleep(typingctx, condition, mutex):
    """Release the mutex, sleep until another thread wakes this one (or for no reason), and take the mutex."""
    return _from_c("pthread_cond_wait", 2)


@intrinsic
def wake(typingctx, condition):
    """Wake a thread that sleeps on the condition, if any."""
    return _from_c("pthread_cond_signal", 1)


@intrinsic
def core(typingctx):
    """Return the number of the core that runs this thread now."""

    def codegen(context, builder, sig, args):
        function = cgutils.get_or_insert_function(builder.module, ir.FunctionType(_INT, []), "sched_getcpu")
        return builder.sext(builder.call(function, []), _WHOLE)

    return types.int64(), codegen


@intrinsic
def nanoseconds(typingctx):
    """Return the time of a clock that never goes back."""

    def codegen(context, builder, sig, args):
        spec = cgutils.alloca_once(builder, ir.ArrayType(_WHOLE, 2))
        kind = ir.FunctionType(_INT, [_INT, spec.type])
        clock = cgutils.get_or_insert_function(builder.module, kind, "clock_gettime")
        builder.call(clock, [_INT(_MONOTONIC), spec])
        seconds, rest = (builder.extract_value(builder.load(spec), k) for k in range(2))
        return builder.add(builder.mul(seconds, _WHOLE(_SECOND)), rest)

    return types.int64(), codegen


@intrinsic
def pause(typingctx):
    """Tell the processor that this thread waits in a loop, which saves power and the work of a sibling thread."""

    def codegen(context, builder, sig, args):
        processor = str(builder.module.triple).partition("-")[0]
        if processor in _PAUSES:
            name, numbers = _PAUSES[processor]
            kind = ir.FunctionType(ir.VoidType(), [_INT] * len(numbers))
            builder.call(cgutils.get_or_insert_function(builder.module, kind, name), [_INT(k) for k in numbers])
        return context.get_dummy_value()

    return types.void(), codegen
