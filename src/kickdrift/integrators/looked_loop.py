"""Compiled loops of looks at a run: steps, a look, steps, a look … without Python in between."""

from __future__ import annotations

import numpy as np

from kickdrift.forces.kernel import OK
from kickdrift.integrators.loops import STEP
from kickdrift.jit.by_address import status_at
from kickdrift.jit.compile import driver, strict

TAKEN, WANTED, REFUSED = range(3)  # slots of ``seen``: looks so far, looks in all, whether the last came to nothing


@strict
def clock(start, steps, dt):
    """The time after so many steps, rounded as Python rounds it."""
    return start + steps * dt


@strict
def next_look(begin, interval, end, time):
    """The next time to look at, as ``Plan.next_stop`` finds it; the end where there is none before."""
    passed = np.floor((time - begin) / interval * (1 + 1e-15))
    ahead = begin + (passed + 1) * interval
    while ahead <= time:
        passed += 1
        ahead = begin + (passed + 1) * interval
    return ahead if ahead < end - 1e-15 * abs(end) else end


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


@driver
def looked_intervals(
    forces, aside, step_loop, look, given, clock, begin, interval, end, steps, cursor, y, desk, last, rows, row, own,
    taken_at, seen,
):  # fmt: skip
    """The same for steps that differ in length: a look at the first step point from each multiple of ``interval`` after
    ``begin`` on, until the next one is the ``end``, or ``steps`` are taken; ``taken_at`` says after how many steps each
    look was. It ends without a look after a step beyond the end. ``given`` comes before (clock, time to reach, steps,
    cursor), and the first number of ``clock`` is the time."""
    while seen[TAKEN] < seen[WANTED]:
        ahead = next_look(begin, interval, end, clock[0])
        if ahead >= end:
            return OK
        status = status_at(step_loop, (forces, *given, clock, ahead, steps, cursor))
        if status != OK:
            return status
        if clock[0] < ahead or clock[0] > end:
            return OK
        status = status_at(look, (aside, clock[0], y, desk, last, rows, row + seen[TAKEN], own))
        if status != OK:
            seen[REFUSED] = 1
            return status
        taken_at[seen[TAKEN]] = cursor[STEP]
        seen[TAKEN] += 1
    return OK
