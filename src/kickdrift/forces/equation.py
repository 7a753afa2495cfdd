"""A Problem's right-hand side as a force.

The step loops call the function through a pointer. So the loops are compiled once for all problems, and each function
separately.
"""

from __future__ import annotations

import ctypes
import re
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from llvmlite import ir
from numba import carray, cfunc, njit, types
from numba.extending import intrinsic
from numpy.typing import NDArray

from kickdrift.errors import InputError
from kickdrift.forces.compiled_check import check_compiled
from kickdrift.forces.kernel import OK, RAISED, kernel
from kickdrift.jit.inner import overload
from kickdrift.jit.numba_private import NumbaError

if TYPE_CHECKING:
    from kickdrift.model.problem import Function, Problem

_POINTER = ctypes.POINTER(ctypes.c_double)
_CALLBACK = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_double, _POINTER, _POINTER)
_SIGNATURE = types.int64(types.float64, types.CPointer(types.float64), types.CPointer(types.float64))


class EquationKernel(NamedTuple):
    """A bound right-hand side: it gives y' of a first-order ODE, or the accelerations of a separable ODE."""

    address: int
    separable: bool
    y: NDArray[np.float64]  # (n,) positions, then velocities
    dy: NDArray[np.float64]


@intrinsic
def call_at(typingctx, address, t, y, dy):
    """Call the machine code at an address with t and the data of y and dy; return its status."""

    def codegen(context, builder, sig, args):
        double = ir.DoubleType()
        kind = ir.FunctionType(ir.IntType(64), [double, double.as_pointer(), double.as_pointer()])
        data = [context.make_array(sig.args[k])(context, builder, args[k]).data for k in (2, 3)]
        return builder.call(builder.inttoptr(args[0], kind.as_pointer()), [args[1], *data])

    return types.int64(address, t, y, dy), codegen


@kernel(EquationKernel, rows=1)
def add_right_hand_side(force, t, x, v, a, sums):
    m, y, dy = x.shape[1], force.y, force.dy
    for i in range(m):
        y[i] = x[0, i]
    if force.separable:
        for i in range(m):
            y[m + i] = v[0, i]
    if call_at(force.address, t, y, dy) != 0:
        return RAISED
    first = m if force.separable else 0
    for i in range(m):
        a[0, i] += dy[first + i]
    return OK


class Callback:
    """A function f(t, y) as machine code at ``address``.

    ``n`` is the number of its inputs, ``outputs`` that of its results. ``error`` holds an exception that Python code
    raised inside the function."""

    def __init__(self, function: Function, n: int, outputs: int, compiled: bool, what: str) -> None:
        self.error: BaseException | None = None
        made = _machine_code(function, n, outputs, what) if compiled else self._python(function, n, outputs)
        self._keep_alive, self.address = made

    def _python(self, function: Function, n: int, outputs: int) -> tuple[Any, int]:
        def call(t: float, y: Any, dy: Any) -> int:
            try:
                value = function(t, np.ctypeslib.as_array(y, (n,)).copy())
                np.ctypeslib.as_array(dy, (outputs,))[:] = np.asarray(value, dtype=float).reshape(-1)
            except BaseException as error:  # an exception must not pass through compiled code
                self.error = error
                return 1
            return 0

        callback = _CALLBACK(call)
        address = ctypes.cast(callback, ctypes.c_void_p).value
        assert address is not None
        return callback, address


def _machine_code(function: Any, n: int, outputs: int, what: str) -> tuple[Any, int]:
    inner = function if hasattr(function, "py_func") else njit(function, error_model="numpy")

    def call(t, y, dy):
        write(carray(dy, (outputs,)), inner(t, carray(y, (n,))))
        return 0

    try:
        code = cfunc(_SIGNATURE, error_model="numpy")(call)
    except NumbaError as error:
        line = _culprit(str(error))
        raise InputError(f"{what} does not compile: {line}; compiled=False runs it as plain Python, slowly") from None
    return code, code.address


def _culprit(message: str) -> str:
    """Return numba's line about what it cannot compile, and where."""
    plain = re.sub(r"\x1b\[[0-9;]*m", "", message)  # numba colours its messages if colorama is installed
    lines = [line.strip() for line in plain.splitlines() if line.strip()]
    telling = [line for line in lines if not line.startswith(("Failed in", "During:", "-", "The error", "["))]
    where = [line for line in lines if line.startswith("File ") and "equation.py" not in line]
    return " ".join([*telling[:1], *where[:1]])


def write(out: Any, values: Any) -> None:
    """out <- the values that a user's function returned (array, list or tuple)."""


@overload(write)
def _write(out, values):
    if isinstance(values, types.BaseTuple) and not isinstance(values, types.UniTuple):
        lines = [f"    out[{k}] = values[{k}]" for k in range(len(values))]
        scope: dict[str, Any] = {}
        exec("\n".join(["def each(out, values):", *lines]), scope)
        return scope["each"]
    if isinstance(values, types.Array) and values.ndim == 2:

        def rows(out, values):
            for i in range(values.shape[0]):
                for j in range(values.shape[1]):
                    out[i * values.shape[1] + j] = values[i, j]

        return rows

    if isinstance(getattr(values, "dtype", None), types.List):

        def nested(out, values):
            for i in range(len(values)):
                for j in range(len(values[i])):
                    out[i * len(values[i]) + j] = values[i][j]

        return nested

    def items(out, values):
        for i in range(len(values)):
            out[i] = values[i]

    return items


class Unknowns(Protocol):
    """Unknowns of a right-hand side."""

    separable: bool  # whether y holds positions and then velocities

    def __len__(self) -> int: ...


class RightHandSide:
    """A Problem's f as a force, which binds like the forces of a System."""

    def __init__(self, problem: Problem) -> None:
        n = len(problem)
        self.callback = Callback(problem.f, n, n, problem.compiled, f"{problem.name}: f")

    def bind(self, problem: Unknowns, threads: int = 1) -> EquationKernel:
        """Return the parts: a NamedTuple with a compiled body."""
        n = len(problem)
        return EquationKernel(self.callback.address, problem.separable, np.zeros(n), np.zeros(n))


def right_hand_side(problem: Problem) -> RightHandSide:
    """Return a Problem's f for compiled loops, compiled once and stored with the Problem."""
    kept = vars(problem)
    if "right_hand_side" not in kept:
        made = RightHandSide(problem)
        check_right_hand_side(problem, made)
        kept["right_hand_side"] = made
    found: RightHandSide = kept["right_hand_side"]
    return found


def check_right_hand_side(problem: Problem, made: RightHandSide) -> None:
    """Refuse a compiled f whose values differ from plain Python's."""
    if problem.compiled:
        check_compiled(problem, made.callback.address)
