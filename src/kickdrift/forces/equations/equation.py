"""A Problem's right-hand side as a force.

The step loops call the function through a pointer. So the loops are compiled once for all problems, and each function
separately.

A Problem's compiled f is checked against the values of plain Python. numba counts whole numbers in 64 bits, keeps a
list of whole numbers without fractions, and fixes the values of outer names when it compiles. A run with such an f
would be silently wrong.
"""

import ctypes
import warnings
from collections.abc import Iterator
from typing import Any, NamedTuple, Protocol

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from kickdrift.forces.equations.code import FAILED, PARAMETERS, TIME, CompileError, code_of
from kickdrift.forces.seam.kernel import OK, RAISED, kernel
from kickdrift.model.problem import Function, Problem
from kickdrift.model.state import Floats

_POINTER = ctypes.POINTER(ctypes.c_double)
_FUNCTION = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_double, _POINTER, _POINTER)
EPSILON = float(np.finfo(float).eps)
APART = 1e-11  # allowed relative difference of a component, from rounding and mathematical libraries
OF_LARGEST = 16 * EPSILON  # allowed difference, relative to the largest component
NOISE = 1e3  # factor on the change that rounding errors of t and y make
WHY = (
    "compiled code has 64-bit whole numbers, keeps lists of whole numbers whole (write 0.0 for 0), and keeps "
    "the values that names outside f had when it was compiled"
)
SHIFTS = (0.37, 1e-3, 1e-7)  # relative distances of test states; smaller ones if f is undefined


def check_compiled(problem: Problem, address: int) -> None:
    """Compare f at the start and at two states around the start; a CompileError shows both values if they differ."""
    function = getattr(problem.f, "py_func", problem.f)
    compiled = _FUNCTION(address)
    for time, y in _states(problem, function):
        plain = _plain(function, time, y)
        if plain is None:
            continue
        found = np.zeros_like(y)
        given = y.copy()
        compiled(time, given.ctypes.data_as(_POINTER), found.ctypes.data_as(_POINTER))
        wrong = np.flatnonzero(~(np.abs(found - plain) <= _allowed(function, time, y, plain)))
        if wrong.size:
            k = int(wrong[0])
            raise CompileError(
                f"{problem.name}: f(t, y)[{k}] at t = {time:.9g} is {plain[k]:.9g} in plain Python and {found[k]:.9g} "
                f"compiled: {WHY}; compiled=False runs f as plain Python, slowly"
            )


def _states(problem: Problem, function: Any) -> Iterator[tuple[float, Floats]]:
    """Yield the start and a state without round numbers on either side of the start, as far out as f is defined."""
    yield problem.t0, problem.y0.copy()
    rng = np.random.Generator(np.random.PCG64(7))
    sizes = np.abs(problem.y0)
    least = float(sizes[sizes > 0].min(initial=1.0))
    for sign in (1.0, -1.0):
        ways = rng.uniform(0.3, 1.0, len(problem)) * np.where(rng.random(len(problem)) < 0.5, -1.0, 1.0)
        for shift in SHIFTS:
            # a zero component increases, since it may be a concentration
            y = problem.y0 + shift * np.where(sizes > 0, sign * ways * problem.y0, np.abs(ways) * least)
            time = problem.t0 + shift * (1.0 if sign > 0 else 2.0)
            if _plain(function, time, y) is not None:
                yield time, y
                break


def _plain(function: Any, time: float, y: Floats) -> Floats | None:
    """Return f in plain Python; None if f raises or is not finite."""
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        try:
            value = np.asarray(function(float(time), y.copy()), dtype=float).reshape(-1)
        except Exception:  # any exception of a user's function; the run reports it
            return None
    return value if value.shape == y.shape and np.isfinite(value).all() else None


def _allowed(function: Any, time: float, y: Floats, value: Floats) -> Floats:
    """Return the allowed difference of compiled values.

    Where terms cancel, rounding alone makes relative differences of any size."""
    rng = np.random.Generator(np.random.PCG64(8))
    noise = np.zeros_like(y)
    for _ in range(2):
        nearby = _plain(function, time * (1.0 + 4 * EPSILON), y * (1.0 + rng.uniform(-4, 4, len(y)) * EPSILON))
        if nearby is not None:
            noise = np.maximum(noise, np.abs(nearby - value))
    return APART * np.abs(value) + OF_LARGEST * np.abs(value).max() + NOISE * noise


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
