"""Accelerations of bodies that meet, on duals."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.seam.kernel import OK
from kickdrift.integrators.gauss_radau.series import BLOCK, ROWS
from kickdrift.integrators.trace.tangent_others import add_inside_duals
from kickdrift.integrators.trace.tangent_rows import MASSES
from kickdrift.jit.compile import jit, never_inline
from kickdrift.jit.duals import functions as functions  # what duals take part in
from kickdrift.jit.duals.dual import SLOT, dual, dual_rows
from kickdrift.jit.duals.operators import dual_vector, put_vector, vector_at
from kickdrift.jit.lanes.memory import aligned


class DualMeeting(NamedTuple):
    """Room for bodies that meet, with derivatives along eight columns."""

    numbers: int  # float64 numbers of a dual
    members: NDArray[np.int64]  # (room,) number of each body
    slots: NDArray[np.int64]  # (room,)
    jumps: NDArray[np.uint8]  # (room,) 1: the velocity is from the central body
    x: NDArray[np.float64]  # (width,), to second order (width / 2, 2): duals, three rows of as many as there are bodies
    v: NDArray[np.float64]
    a: NDArray[np.float64]
    lost_x: NDArray[np.float64]  # what rounding took from x
    lost_v: NDArray[np.float64]
    work: NDArray[np.float64]  # (ROWS width,) as in ``gauss_radau.series``


def dual_meeting(room: int, twice: bool) -> DualMeeting:
    """Room for so many bodies, with second derivatives if ``twice``."""
    numbers = 2 * SLOT if twice else SLOT
    width = BLOCK * -(-3 * room * numbers // BLOCK)
    x, v, a, lost_x, lost_v = (aligned((width // 2, 2) if twice else (width,)) for _ in range(5))
    whole = np.zeros(room, np.int64), np.zeros(room, np.int64), np.zeros(room, np.uint8)
    return DualMeeting(numbers, *whole, x, v, a, lost_x, lost_v, aligned((ROWS * width,)))


@jit
def pull_of(d):
    """Return d / r^3 for a dual separation d."""
    square = 1.0 / (d.value @ d.value)
    cube = square * math.sqrt(square)
    return dual(cube * d.value, cube * (d.slope - (3.0 * square * (d.slope @ d.value)) * d.value))


@jit
def attract_duals(hybrid, own, rows, n, everyone, s):
    """a <- the accelerations of ``meeting.attract`` at x, a time s after the step's start. Return a status."""
    never_inline()
    meeting, masses = own.meeting, dual_rows(rows[MASSES], own.slot.size)
    x, a, used = dual_rows(meeting.x, n), dual_rows(meeting.a, n), hybrid.used
    members, slots = meeting.members, meeting.slots
    total = dual_vector((0.0, 0.0, 0.0))
    for i in range(n):
        pull = pull_of(vector_at(x, i))
        total = total + masses[0, members[i]] * pull
        put_vector(a, i, -(masses[0, 0] * pull))
    for i in range(n):
        felt = vector_at(a, i)
        for j in range(i):
            if everyone or used[slots[j], slots[i]]:
                pull = pull_of(vector_at(x, j) - vector_at(x, i))
                felt = felt + masses[0, members[j]] * pull
                put_vector(a, j, vector_at(a, j) - masses[0, members[i]] * pull)
        put_vector(a, i, felt)
    for i in range(n):
        if meeting.jumps[i]:
            put_vector(a, i, vector_at(a, i) - total)
    if own.others.shape[0] == 0:
        return OK
    return add_inside_duals(rows, own, n, hybrid.span[0], s, hybrid.span[1])
