"""A step of one system of a batch alone, by the code of ``loop``, where its bodies meet."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.integrators.trace.state import PAIRS, PASSAGES, READY, Hybrid
from kickdrift.integrators.wisdom_holman.batch_loop import MUTUAL as OF_LANES
from kickdrift.integrators.wisdom_holman.bodies import GM, LIVE, MUTUAL, OTHERS, SOURCE
from kickdrift.jit.compile import jit

FAR = 4.0  # empty slots circle this many times as far out as the farthest body, as in ``WisdomHolmanStepper``


class Alone(NamedTuple):
    """Room for a system that takes a step alone, as ``loop`` has it."""

    hybrid: Hybrid
    slots: NDArray[np.int64]  # (n,) arguments of ``wisdom_holman.places.leave``, whose result is not used
    listed: NDArray[np.int64]  # (n,)
    masses: NDArray[np.float64]  # (3, n)
    y: NDArray[np.float64]  # (2, 3, n)


@jit
def enter_alone(own, alone, k):
    """Put the bodies of lane k, at the step's start, into the slots of a system alone."""
    room = alone.hybrid
    orbit, table, slots, start = room.bodies.orbit, room.bodies.table, own.slots, own.start
    room.counts[READY] = 0
    central, farthest = own.orbits.central[k], 0.0
    for i in range(slots.shape[0]):
        d2 = 0.0
        for axis in range(3):
            d2 += start[0, axis, i, k] ** 2
        farthest = max(farthest, d2)
    farthest = FAR * np.sqrt(farthest)
    for s in range(orbit.shape[1]):
        table[LIVE, s], table[SOURCE, s], table[OTHERS, s], table[GM, s], room.reach[s] = 0.0, 0.0, 0.0, central, 0.0
        for row in range(6):
            orbit[row, s] = 0.0
        orbit[0, s] = farthest * (1.0 + s)
        orbit[4, s] = np.sqrt(central / orbit[0, s])
    for i in range(slots.shape[0]):
        s = slots[i, k]
        table[LIVE, s], table[SOURCE, s] = 1.0, own.orbits.table[SOURCE, i, k]
        table[OTHERS, s], room.reach[s] = own.orbits.table[OTHERS, i, k], own.reach[i, k]
        for half in range(2):
            for axis in range(3):
                orbit[3 * half + axis, s] = start[half, axis, i, k]


@jit
def leave_alone(own, alone, k, fine):
    """Put the bodies back into lane k, with their accelerations; numbers that are not finite after a failure. Return 1
    if the system has a near pair or a passage now, else 0."""
    room = alone.hybrid
    orbit, work, slots, mutual = room.bodies.orbit, room.bodies.work, own.slots, own.orbits.work[OF_LANES]
    for i in range(slots.shape[0]):
        s = slots[i, k]
        for axis in range(3):
            mutual[axis, i, k] = work[MUTUAL + axis, s]
            for half in range(2):
                own.orbits.orbit[half, axis, i, k] = orbit[3 * half + axis, s] if fine else np.nan
    return 1 if room.counts[PAIRS] + room.counts[PASSAGES] > 0 else 0
