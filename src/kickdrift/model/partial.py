"""A user's function f(t, y, *args) as a function of t and y alone."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from kickdrift.errors import InputError
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
