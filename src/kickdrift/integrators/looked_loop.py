"""The compiled loop of looks at a run of fixed steps: steps, a look, steps, a look … without Python in between."""

from __future__ import annotations

from kickdrift.forces.kernel import OK
from kickdrift.integrators.loops import STEP
from kickdrift.jit.by_address import status_at
from kickdrift.jit.compile import driver, strict

TAKEN, WANTED, REFUSED = range(3)  # slots of ``seen``: looks so far, looks in all, whether the last came to nothing


@strict
def clock(start, steps, dt):
    """The time after so many steps, rounded as Python rounds it."""
    return start + steps * dt


@driver
def looked_loop(
    forces, aside, step_loop, look, given, first, every, cursor, start, dt, y, desk, last, rows, row, own, seen
):
    """``every`` steps by ``step_loop`` and a ``look`` at y with the forces ``aside``, again and again; a status. Both
    are addresses (``jit.by_address``): neither is compiled into this loop. ``given`` is what the steps take beside the
    forces and (first, steps, cursor), ``first`` the steps done before, ``row`` the first look's row, ``own`` the looks'
    cursor."""
    while seen[TAKEN] < seen[WANTED]:
        done = first + seen[TAKEN] * every
        status = status_at(step_loop, (forces, *given, done, every, cursor))
        if status != OK:
            return status
        cursor[STEP] = 0
        at = clock(start, done + every, dt)
        status = status_at(look, (aside, at, y, desk, last, rows, row + seen[TAKEN], own))
        if status != OK:
            seen[REFUSED] = 1
            return status
        seen[TAKEN] += 1
    return OK
