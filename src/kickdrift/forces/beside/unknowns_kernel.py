"""Compiled equations of unknowns beside the bodies: rates, accelerations, and steps while the bodies rest.

The user's functions belong to the type of the parts, as those of body laws do.
"""

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.beside.columns import Bodies
from kickdrift.forces.equations.code import write
from kickdrift.forces.laws.body_kernel import BodyWork
from kickdrift.jit.compile import as_written
from kickdrift.jit.handle import Handle
from kickdrift.jit.inner import by_type


class Unknowns(NamedTuple):
    """Unknowns beside the bodies, bound to a System.

    A method may advance them by itself: it sets ``split``. If it also keeps them out of y, they are ``held``.
    """

    begin: int  # their first column of y
    sign: float  # -1 for the motion back in time, in which velocities, and so the unknowns, have the other sign
    split: NDArray[np.int64]  # (1,)
    held: NDArray[np.float64]  # (k,) as in y
    y: NDArray[np.float64]  # (k,)
    rates: NDArray[np.float64]  # (k,)
    stages: NDArray[np.float64]  # (2, k) sums of a step
    x: NDArray[np.float64]  # (3, n)
    v: NDArray[np.float64]  # (3, n)
    a: NDArray[np.float64]  # (3, n)
    masses: NDArray[np.float64]  # (n,)


def bound_unknowns(force: Any, begin: int, masses: NDArray[np.float64]) -> BodyWork:
    """Bind the equations as a law of all bodies. The unknowns' first column is ``begin``."""
    functions = (getattr(each, "py_func", each) for each in (force.f, force.acts))
    k, n = force.unknowns, len(masses)
    sizes = (k,), (k,), (k,), (2, k), (3, n), (3, n), (3, n)
    p = _kind(*functions)(begin, force.sign, np.zeros(1, np.int64), *map(np.zeros, sizes), masses)
    p.held[:] = np.multiply(force.sign, force.y0)
    return BodyWork(p, masses, None)


@cache
def _kind(f: Any, acts: Any) -> type:
    """The class of parts with these functions."""
    rates: Any = as_written(f)
    pushes: Any = None if acts is None else as_written(acts)

    @as_written
    def fill_rates(p, t):
        write(p.rates, rates(t, p.y, Bodies(p.x, p.v, p.masses)))

    def passive(p, x, v, m, t, a):
        place(p, x, v)
        if x.shape[1] > m.size and p.split[0] == 0:
            fill_rates(p, p.sign * t)
            for i in range(p.y.size):
                a[0, p.begin + i] += p.rates[i]

    add_rates = as_written(passive)

    def active(p, x, v, m, t, a):
        add_rates(p, x, v, m, t, a)
        for k in range(3):
            for i in range(m.size):
                p.a[k, i] = 0.0
        found = pushes(p.sign * t, p.y, Bodies(p.x, p.v, p.masses), p.a)
        for k in range(3):
            for i in range(m.size):
                a[k, i] += p.a[k, i]
        return found

    class Made(Unknowns):
        law = staticmethod(passive if acts is None else active)
        law_is_for = ""
        compiled_law = as_written(passive if acts is None else active)
        compiled_rates = fill_rates

    Made.__qualname__ = "beside"  # for the message of a function that does not compile
    return Made


@by_type
def fill_rates_of(p, t):
    """p.rates <- f at p.y and the bodies of p."""
    rates = (p.kind if isinstance(p, Handle) else p).instance_class.compiled_rates
    return lambda p, t: rates(p, t)


@as_written
def place(p, x, v):
    """p.y, p.x, p.v <- the unknowns and the bodies."""
    n = p.masses.size
    for i in range(p.y.size):
        p.y[i] = p.sign * (v[0, p.begin + i] if x.shape[1] > n else p.held[i])
    for k in range(3):
        for i in range(n):
            p.x[k, i], p.v[k, i] = x[k, i], p.sign * v[k, i]


@as_written
def step_at_rest(p, t, x, v, span):
    """Advance the unknowns for the time ``span`` at the fixed time t while the bodies rest: the classical Runge-Kutta
    method of order 4 (Kutta 1901)."""
    place(p, x, v)
    begun, total = p.stages[0], p.stages[1]
    size, inside = p.y.size, x.shape[1] > p.masses.size
    for i in range(size):
        begun[i], total[i] = p.sign * p.y[i], 0.0
    for stage in range(4):
        fill_rates_of(p, p.sign * t)
        weight = 1.0 if stage == 0 or stage == 3 else 2.0
        ahead = 0.5 if stage < 2 else 1.0
        for i in range(size):
            total[i] += weight * p.rates[i]
            p.y[i] = p.sign * (begun[i] + ahead * span * p.rates[i])
    for i in range(size):
        after = begun[i] + span / 6.0 * total[i]
        if inside:
            v[0, p.begin + i] = after
        else:
            p.held[i] = after
