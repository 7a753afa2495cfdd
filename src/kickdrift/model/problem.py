"""A Problem: a first-order system of ordinary differential equations, and a user's f(t, y, *args) as f(t, y)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from copy import copy
from dataclasses import dataclass, field, replace
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from kickdrift.errors import InputError
from kickdrift.model.checks.arguments import checked_arguments, misfit
from kickdrift.model.checks.values import numbers
from kickdrift.model.described import ShownProblem
from kickdrift.model.run_defaults import RunDefaults
from kickdrift.model.state import Floats, read_only
from kickdrift.text import shown


class ArgumentsError(InputError, TypeError):
    """Further arguments that are no sequence; also a TypeError, which SciPy raises here."""


def arguments(key: str, args: Any) -> tuple[Any, ...]:
    """Further arguments as a tuple; none for None. Raises ArgumentsError if they are no sequence."""
    if args is None:
        return ()
    if not isinstance(args, Iterable):
        raise ArgumentsError(
            f"{key}: Supplied 'args' cannot be unpacked. Please supply `args` as a tuple (e.g. `args=({shown(args)},)`)"
        )
    return tuple(args)


@dataclass(frozen=True, eq=False)
class Partial:
    """A function with its further arguments, as a function of t and y.

    The further settings are those of ``kickdrift.solve``.

    Attributes
    ----------
    function : function(t, y, *args)
    args : further arguments, the same in each call
    flat : whether to return one row of floats, whatever the shape of the function's value
    backward : whether t is minus the function's time, so that the value changes its sign
    paired : whether y holds the real and the imaginary part of each number that the function takes
    column : whether the function takes y as a column (n, 1)
    turned : whether the second half of y are velocities, which change their sign when time runs backward
    """

    function: Callable[..., Any]
    args: tuple[Any, ...] = ()
    flat: bool = False
    backward: bool = False
    paired: bool = False
    column: bool = False
    turned: bool = False

    def __post_init__(self) -> None:
        if isinstance(inner := self.function, Partial) and not inner.flat:
            object.__setattr__(self, "function", inner.function)
            object.__setattr__(self, "args", (*inner.args, *self.args))

    def __call__(self, t: float, y: Any) -> Any:
        """Value of the function."""
        way = -1.0 if self.backward else 1.0
        y = self._turned(y) if self.turned else y
        y = y.view(complex) if self.paired else y
        value = self.function(way * t, y.reshape((-1, 1)) if self.column else y, *self.args)
        if not self.flat:
            return value
        row = way * np.asarray(value, dtype=complex if self.paired else float).reshape(-1)
        row = row.view(float) if self.paired else row
        return self._turned(row) if self.turned else row

    @staticmethod
    def _turned(y: Any) -> Any:
        half = len(y) // 2
        return np.concatenate([y[:half], -y[half:]])

    @property
    def py_func(self) -> Partial:
        """The same in plain Python, if numba has compiled the function."""
        return replace(self, function=getattr(self.function, "py_func", self.function))


def with_args(function: Any, args: tuple[Any, ...]) -> Any:
    """The function of t and y; the function itself without further arguments, or for None.

    A Partial of the same arguments stays as it is, so that a Problem can be made again from its own parts."""
    if not args or function is None or (isinstance(function, Partial) and function.args is args):
        return function
    return Partial(function, args)


Function = Callable[..., Any]


@dataclass(frozen=True)
class ProblemState:
    """A solution at one time: ``y`` (n,), ``time`` and the steps taken since the start."""

    y: Floats
    time: float = 0.0
    steps_done: int = 0

    def __len__(self) -> int:
        return len(self.y)


@checked_arguments
@dataclass(frozen=True, eq=False, repr=False)
class Problem(ShownProblem):
    """y' = f(t, y, *args), y(t0) = y0.

    Parameters
    ----------
    f : f(t, y, *args) -> n numbers (array, list or tuple), as SciPy takes it; a plain Python function, to be compiled
    y0 : (n,)
    jacobian : jacobian(t, y, *args) -> (n, n), df_i / dy_j; finite differences stand in where it is not given
    args : further arguments of f, jacobian, energy, and the functions of `Crossing` events. Compiled code takes numbers
        and arrays of numbers as parameters, so that other values need no compilation; all else is constant in the code.
        The attributes f, jacobian and energy are functions of t and y alone
    t0 : time at the start
    separable : y is n/2 positions followed by their n/2 velocities, and the accelerations depend on positions and time
        alone; needed by the splitting methods
    energy : energy(t, y, *args), a quantity that the exact solution conserves, to be watched
    exact : exact(t) -> (n,), the solution in closed form
    compiled : False runs f as plain Python, slowly. Compiled code uses 64-bit integers, keeps a list of integers as
        integers, and fixes the values of names outside f when f is compiled. Before a run, compiled values are
        therefore compared with plain Python's, at the start and at states around it
    name, run, invariants, source : as in a System
    equation, parameters : name in ``kickdrift.odes.ODES`` from a system file, and the parameters of its factory

    Raises
    ------
    InputError
        If y0 or the values of f are not n finite numbers.
    """

    f: Function
    y0: Floats
    jacobian: Function | None = None
    t0: float = 0.0
    separable: bool = False
    energy: Function | None = None
    exact: Callable[[float], Any] | None = None
    compiled: bool = True
    name: str = "problem"
    args: tuple[Any, ...] = ()
    run: RunDefaults = field(default_factory=RunDefaults)
    invariants: Mapping[str, Any] = field(default_factory=dict)
    source: str = ""
    equation: str = ""
    parameters: Mapping[str, Any] = field(default_factory=dict)

    def __init__(
        self,
        f: Function,
        y0: ArrayLike,
        jacobian: Function | None = None,
        *,
        args: Iterable[Any] = (),
        t0: float = 0.0,
        separable: bool = False,
        energy: Function | None = None,
        exact: Callable[[float], Any] | None = None,
        compiled: bool = True,
        name: str = "problem",
        run: RunDefaults | None = None,
        invariants: Mapping[str, Any] | None = None,
        source: str = "",
        equation: str = "",
        parameters: Mapping[str, Any] | None = None,
    ) -> None:
        put = object.__setattr__
        start = finite_numbers(f"{name}: y0", y0)
        if start.ndim != 1 or not start.size:
            got = f"{y0!r}; write [{y0!r}]" if not start.ndim else f"shape {start.shape}"
            raise InputError(f"{name}: y0 must be one row of numbers, got {got}")
        if separable and start.size % 2:
            raise InputError(f"{name}: separable means positions, then as many velocities; y0 has {start.size} numbers")
        for key, function in (("f", f), ("jacobian", jacobian), ("energy", energy), ("exact", exact)):
            if not (callable(function) or (function is None and key != "f")):
                raise InputError(f"{name}: {key} must be a function, got {function!r}")
        if not (isinstance(t0, Real) and np.isfinite(t0)):
            raise InputError(f"{name}: t0 must be a finite number, got {t0!r}")
        args = arguments(name, args)
        f, jacobian, energy = (with_args(function, args) for function in (f, jacobian, energy))
        for key, value in (
            ("f", f), ("y0", read_only(start)), ("jacobian", jacobian), ("t0", float(t0)), ("separable", separable),
            ("energy", energy), ("exact", exact), ("compiled", compiled), ("name", name), ("args", args),
            ("run", run or RunDefaults()), ("invariants", dict(invariants or {})), ("source", source),
            ("equation", equation), ("parameters", dict(parameters or {})),
        ):  # fmt: skip
            put(self, key, value)
        n = len(start)
        slope = self._checked("f", f, (n,))
        if jacobian is not None:
            self._checked("jacobian", jacobian, (n, n))
        if separable:
            self._check_separable(slope)
        if exact is not None:
            self._checked("exact", lambda t, y: exact(t), (n,))
        if energy is not None:
            self._checked("energy", energy, ())

    def __getstate__(self) -> dict[str, Any]:
        """Return all but the machine code, so that another process can load the problem."""
        return {key: value for key, value in vars(self).items() if key != "right_hand_side"}

    def with_run(self, **defaults: Any) -> Problem:
        """Return the same problem with changed `RunDefaults`, as ``System.with_run`` does."""
        made = copy(self)
        object.__setattr__(made, "run", self.run.changed(**defaults))
        return made

    def _check_separable(self, slope: Floats) -> None:
        half = len(self) // 2
        if not np.array_equal(slope[:half], self.y0[half:]):
            raise InputError(f"{self.name}: separable means that the first half of f is the second half of y")
        faster = self.y0.copy()
        faster[half:] += 1.0 + np.abs(faster[half:])
        if not np.array_equal(np.asarray(self.f(self.t0, faster), dtype=float)[half:], slope[half:]):
            raise InputError(
                f"{self.name}: separable means accelerations from positions and time alone, but f depends on velocities"
            )

    def __len__(self) -> int:
        return len(self.y0)

    @property
    def state(self) -> ProblemState:
        """State at the start."""
        return ProblemState(self.y0, self.t0)

    def _checked(self, key: str, function: Function, shape: tuple[int, ...]) -> Floats:
        """Values of the function at the start, checked."""
        given = self.y0.copy()
        if takes := misfit(getattr(function, "function", function), self.t0, given, *getattr(function, "args", ())):
            raise InputError(f"{self.name}: {key} must take (t, y{', *args' * bool(self.args)}); it takes {takes}")
        try:
            value = function(self.t0, given)
        except Exception as error:  # a user's function may raise anything
            line = " ".join(f"{type(error).__name__}: {error}".split())
            raise InputError(f"{self.name}: {key}(t0, y0) raised {line}") from error
        if not np.array_equal(given, self.y0):
            raise InputError(f"{self.name}: {key} changes its argument y; work on a copy")
        found = finite_numbers(f"{self.name}: {key}(t0, y0)", value)
        if found.shape != shape:
            raise InputError(f"{self.name}: {key} must return shape {shape}, like y0, got {found.shape}")
        return found


def finite_numbers(key: str, values: ArrayLike) -> Floats:
    """Return the values as an array. Raises an InputError that begins with ``key`` unless they are finite numbers."""
    array = numbers(key, values)
    if not np.isfinite(array).all():
        bad = np.argwhere(~np.isfinite(array))[0]
        raise InputError(f"{key}[{', '.join(map(str, bad))}] is {array[tuple(bad)]}; expected finite numbers")
    return array
