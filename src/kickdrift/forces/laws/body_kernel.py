"""Compiled body laws: one call for all bodies, on one thread."""

from typing import Any, NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from kickdrift.forces.laws.central import column, pull, room, vector
from kickdrift.forces.seam.kernel import OK, kernel
from kickdrift.jit.compile import as_written, inlined, never_inline
from kickdrift.jit.duals.dual import DUAL
from kickdrift.jit.duals.operators import dual_vector, dual_zeros, vector_at
from kickdrift.jit.handle import Handle
from kickdrift.jit.inner import by_type, overload
from kickdrift.jit.lanes import law_operators as law_operators  # teaches numba vectors' products
from kickdrift.jit.lanes.memory import flat
from kickdrift.jit.lanes.vector3 import numbers3, vector3
from kickdrift.jit.numba_private import TypingError


class BodyWork(NamedTuple):
    """A body law bound to a System."""

    law: Any  # what the law gets as p
    masses: NDArray[np.float64]  # (n,) coherent
    fast: float | None  # None for a law that is compiled as written


def bound_body(cls: Any, p: Any, masses: NDArray[np.float64]) -> BodyWork:
    """Bind the law of ``cls`` to what the law gets as ``p``."""
    kind, fast = type(p), bool(getattr(cls, "fastmath", False))
    if "compiled_law" not in vars(kind):
        kind.law, kind.law_is_for = cls.law, ""
        kind.compiled_law = (inlined if fast else as_written)(cls.law)
        if hasattr(cls, "pull"):
            kind.pull = cls.pull
            kind.compiled_pull = (inlined if fast else as_written)(cls.pull)
    return BodyWork(p, masses, 1.0 if fast else None)


@kernel(BodyWork)
def body_forces(force, t, x, v, a, sums):
    never_inline()
    found = law_of_bodies(force.law, x, v, force.masses, t, a)
    if sums is not None:
        add_found(found, sums)
    return OK


@by_type
def law_of_bodies(p, x, v, m, t, a):
    """Add the law's accelerations to ``a``; return what the law returns."""
    law = (p.kind if isinstance(p, Handle) else p).instance_class.compiled_law
    return lambda p, x, v, m, t, a: law(p, x, v, m, t, a)


@overload(pull)
def _pull(p, i, d, u, t):
    law = (p.kind if isinstance(p, Handle) else p).instance_class.compiled_pull
    return lambda p, i, d, u, t: law(p, i, d, u, t)


@overload(column)
def _column(array, i):
    if array.dtype == DUAL:
        return lambda array, i: vector_at(array, i)
    return lambda array, i: numbers3(flat(array), i, array.shape[1])


@overload(room)
def _room(array):
    if array.dtype == DUAL:
        return lambda array: dual_zeros(array.shape[1])
    return lambda array: np.zeros(array.shape)


@overload(vector)
def _vector(numbers):
    if DUAL in tuple(numbers):
        return lambda numbers: dual_vector(numbers)
    return lambda numbers: vector3(numbers[0], numbers[1], numbers[2])


@by_type
def add_found(found, sums):
    """Add an energy; energy and virial; or energy, virial and pairs. None adds nothing."""

    def none(found, sums):
        return None

    def one(found, sums):
        sums[0] += found

    def two(found, sums):
        sums[0] += found[0]
        sums[1] += found[1]

    def three(found, sums):
        sums[0] += found[0]
        sums[1] += found[1]
        sums[2] += found[2]

    if isinstance(found, types.NoneType):
        return none
    if isinstance(found, types.Number):
        return one
    if isinstance(found, types.BaseTuple) and len(found) in (2, 3):
        return two if len(found) == 2 else three
    raise TypingError("law must return the energy, or energy and virial, or energy, virial and pairs")
