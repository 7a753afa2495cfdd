"""Compiled loops of samples of a run: steps, a sample, steps, a sample … without Python in between; and of all y."""

from __future__ import annotations

import numpy as np

from kickdrift.forces.seam.kernel import OK
from kickdrift.integrators.stepping.loops import STEP
from kickdrift.jit.by_address import status_at
from kickdrift.jit.compile import driver, strict

TAKEN, WANTED, REFUSED = range(3)  # slots of ``seen``: samples so far, samples in all, whether the last failed


@strict
def clock(start, steps, dt):
    """Return the time after a number of steps, rounded as in Python."""
    return start + steps * dt


@strict
def next_look(begin, interval, end, time):
    """Return the next time of a sample, as ``Plan.next_stop`` finds it, or the end if there is none before."""
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
    """Take ``every`` steps by ``step_loop`` and a sample by ``look`` at y with the forces ``aside``, repeatedly. Return
    a status.

    Both are addresses (``jit.by_address``), so neither is compiled into this loop. ``given`` are the arguments of the
    steps besides the forces and (first, steps, cursor). ``first`` is the number of steps done before, ``row`` the first
    sample's row, ``own`` the samples' cursor.
    """
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
    """The same for steps of different lengths.

    Samples are taken at the first step point from each multiple of ``interval`` after ``begin`` on, until the next one
    is the ``end``, or ``steps`` are taken. ``taken_at`` gets the number of steps before each sample. The loop ends
    without a sample after a step beyond the end. ``given`` precedes (clock, time to reach, steps, cursor), and the
    first number of ``clock`` is the time.
    """
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


@driver
def recorded_loop(forces, step_loop, given, clock, until, cursor, y, points):
    """Take steps of different lengths one by one until the time ``until``, or until all rows of ``points`` (steps, 1 +
    N) are filled. Each row gets the time and y after a step. Return a status.

    The other arguments are those of ``looked_intervals``. ``cursor`` counts the steps.
    """
    flat = y.reshape(-1)
    while cursor[STEP] < points.shape[0] and clock[0] < until:
        done = cursor[STEP]
        status = status_at(step_loop, (forces, *given, clock, until, done + 1, cursor))
        if status != OK or cursor[STEP] == done:
            return status
        points[done, 0] = clock[0]
        points[done, 1:] = flat
    return OK
