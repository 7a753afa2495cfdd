"""A Problem's right-hand side as a force.

The step loops call the function through a pointer. So the loops are compiled once for all problems, and each function
separately.
"""

from __future__ import annotations

import ctypes
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from kickdrift.forces.equations.check import check_compiled
from kickdrift.forces.equations.code import FAILED, PARAMETERS, TIME, code_of
from kickdrift.forces.seam.kernel import OK, RAISED, kernel

if TYPE_CHECKING:
    from kickdrift.model.problem import Function, Problem

_POINTER = ctypes.POINTER(ctypes.c_double)
_CALLBACK = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_double, _POINTER, _POINTER)


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

    ``n`` and ``outputs`` count the numbers that it takes and returns."""

    def __init__(self, function: Function, n: int, outputs: int, compiled: bool, what: str) -> None:
        self._error: BaseException | None = None
        self._function, self._n = function, n
        self._code = code_of(function, n, outputs, what, self) if compiled else None
        if self._code:
            self.address = self._code.address
        else:
            self._keep_alive, self.address = self._python(function, n, outputs)

    @property
    def error(self) -> BaseException | None:
        """Exception that the function raised; compiled code cannot say which, so that call is repeated in Python."""
        if self._code and self._code.memory[FAILED] and self._error is None:
            time, y = float(self._code.memory[TIME]), self._code.memory[PARAMETERS : PARAMETERS + self._n].copy()
            try:
                getattr(self._function, "py_func", self._function)(time, y)
            except BaseException as error:
                self._error = error
            else:
                self._error = RuntimeError(f"an exception at t = {time:.9g} in compiled code, and none in plain Python")
        return self._error

    def forget_error(self) -> None:
        """Forget an earlier exception."""
        self._error = None
        if self._code:
            self._code.memory[FAILED] = 0.0

    def _python(self, function: Function, n: int, outputs: int) -> tuple[Any, int]:
        def call(t: float, y: Any, dy: Any) -> int:
            try:
                value = function(t, np.ctypeslib.as_array(y, (n,)).copy())
                np.ctypeslib.as_array(dy, (outputs,))[:] = np.asarray(value, dtype=float).reshape(-1)
            except BaseException as error:  # an exception must not pass through compiled code
                self._error = error
                return 1
            return 0

        callback = _CALLBACK(call)
        address = ctypes.cast(callback, ctypes.c_void_p).value
        assert address is not None
        return callback, address


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
