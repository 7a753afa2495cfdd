"""The interface between methods and forces: a table of bound forces, which every step loop takes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from kickdrift.forces.equations.equation import EquationKernel
from kickdrift.forces.gravity.few_bodies import MOST_IN_REGISTERS, FewBodies, few_bodies
from kickdrift.forces.gravity.kernel import GravityKernel
from kickdrift.forces.seam.kernel import FORCES, FORCES_AND_SUMS, OK, BoundForce, call_force
from kickdrift.jit.inner import overload
from kickdrift.jit.lanes.memory import flat

NOBODY = FewBodies(0.0, 0, np.zeros(MOST_IN_REGISTERS), np.zeros(MOST_IN_REGISTERS))


class Forces(NamedTuple):
    """All forces of a System, or a Problem's function, for compiled code; always of the same type."""

    table: NDArray[np.int64]  # (forces, 2) addresses of machine code and of parts; zeros mean gravity among few bodies
    equation: int  # address of a Problem's function; 0 for particles
    few: FewBodies


def table_of(forces: Sequence[BoundForce]) -> Forces:
    """Return the table of these compiled forces. The table is valid as long as the forces exist."""
    rows = np.array([(force.address, force.work) for force in forces], np.int64).reshape(-1, 2)
    few = few_of(forces)
    equations = [force.parts.address for force in forces if isinstance(force.parts, EquationKernel)]
    return Forces(rows, equations[0] if equations else 0, few.parts.few_bodies if few else NOBODY)


def few_of(forces: Sequence[BoundForce]) -> BoundForce | None:
    """Return gravity among a few bodies, if any: loops hold such bodies in registers, without machine code of the
    force."""
    return next((each for each in forces if isinstance(each.parts, GravityKernel) and each.parts.is_few), None)


def accelerate(forces: Any, t: float, x: Any, v: Any, a: Any, sums: Any) -> int:
    """Add the accelerations of all forces to ``a``; return OK or the status of the first force that fails.

    Unless ``sums`` is None, also add energy, virial and pairs to ``sums``."""
    raise NotImplementedError("for compiled code")


@overload(accelerate, forceinline=True)
def _accelerate(forces, t, x, v, a, sums):
    return lambda forces, t, x, v, a, sums: accelerate_by(forces, None, 0, t, x, v, a, sums)


def accelerate_by(forces: Any, groups: Any, group: int, t: float, x: Any, v: Any, a: Any, sums: Any) -> int:
    """Like ``accelerate``, by the forces of one group. ``groups`` holds the group of each force; None for all forces"""
    raise NotImplementedError("for compiled code")


@overload(accelerate_by, forceinline=True)
def _accelerate_by(forces, groups, group, t, x, v, a, sums):
    what = FORCES if isinstance(sums, types.NoneType) else FORCES_AND_SUMS
    chosen = not isinstance(groups, types.NoneType)

    def each(forces, groups, group, t, x, v, a, sums):
        table = forces.table
        for k in range(table.shape[0]):
            if chosen and groups[k] != group:
                continue
            if table[k, 0] == 0:
                few_bodies(forces.few, flat(x), flat(a), sums)
            else:
                status = call_force(table[k, 0], table[k, 1], what, t, x, v, a, sums)
                if status != OK:
                    return status
        return OK

    return each
