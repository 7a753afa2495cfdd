"""Bodies of the Wisdom-Holman map as compiled code has them, and sums over their lanes.

Bodies around the central one are in lanes, massive ones first. The massive and the massless are each padded to a
multiple of eight with massless bodies on distant circles, which feel nothing.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.jit.compile import inlined
from kickdrift.jit.lanes.functions import exclusive_scan, minus, plus
from kickdrift.jit.lanes.memory import load, store
from kickdrift.jit.lanes.vector3 import vector3
from kickdrift.model.state import Floats

# Rows of ``table``: GM of the Kepler motion; G m; the body's share m_i / M_i of the mass up to it; 1 / (G M_(i-1)), for
# the mass inside; the others' share of that mass, 1 - m_0 / M_(i-1) (in heliocentric coordinates m_i / m_0); 1 for a
# body, 0 for padding; Hill radius squared.
GM, SOURCE, SHARE, INSIDE, OTHERS, LIVE, HILL = range(7)
ROWS = 7
# Rows of ``work``: positions from the central body; their offset from Jacobi's; the acceleration by the other bodies;
# the acceleration by the central one per G m_0; the terms of both for the sums; the last three are increments solved
# one by one.
PLACE, OFFSET, MUTUAL, STAR, WAY = 0, 3, 6, 9, 12
WORK = 22  # also room for the constants of ``eight``
# Rows of ``first``: times when a body was first unbound and first near another, and which other (a slot).
UNBOUND, NEAR, WHICH = range(3)


class Bodies(NamedTuple):
    """Central body and the bodies around it.

    ``orbit`` holds three rows of positions and three of velocities. They are Jacobi's (each body from the centre of
    mass of the central one and the massive ones before it), or democratic heliocentric (positions from the central
    body, velocities from the centre of mass).
    """

    orbit: NDArray[np.float64]  # (6, slots)
    carry: NDArray[np.float64]  # (6, slots), carries of compensated sums; (6, 0) for plain sums
    centre: NDArray[np.float64]  # (5, 8) position and velocity of the centre of mass, their rounding errors; work
    table: NDArray[np.float64]  # (ROWS, slots)
    inside: NDArray[np.int64]  # (slots,) number of massive bodies before a massless one
    first: NDArray[np.float64]  # (3, slots)
    work: NDArray[np.float64]  # (WORK, slots)
    massive: int  # slots of bodies with mass
    jacobi: bool
    order: NDArray[np.int64]  # (slots,) particle in each slot; -1 for padding
    central: int  # particle of the central body
    gm: float  # G m of the central body
    shares: NDArray[np.float64]  # (n,) masses of all particles over their sum
    x: NDArray[np.float64]  # (2, 3, n) positions for forces other than gravity, and velocities, always 0
    a: NDArray[np.float64]  # (3, n) accelerations by these forces
    kernel: Any = None  # what a kernel of higher order needs; see ``kernels``
    beside: Any = None  # (2,) addresses of the code that advances unknowns beside the bodies, and of its parts, if any


def fill_table(table: Floats, central: Any, source: Any, before: Any, jacobi: bool) -> None:
    """Fill in the rows GM to OTHERS, from G m of the central body and of the others, and G times the mass of the other
    bodies listed before each."""
    table[SOURCE] = source
    table[INSIDE] = 1.0 / (central + before)
    table[GM] = central + before + source
    table[SHARE] = source / table[GM]
    table[OTHERS] = before * table[INSIDE]
    if not jacobi:
        table[GM], table[OTHERS] = central, source / central


@inlined
def add_lanes(bodies, p, change):
    """Add change to eight numbers of ``orbit``, compensated if ``carry`` has room (see ``loops.add_compensated``)."""
    orbit, carry = bodies.orbit, bodies.carry
    before = load(orbit, p)
    if carry.size:
        increment = plus(load(carry, p), change)
        after = plus(before, increment)
        store(orbit, p, after)
        store(carry, p, plus(increment, minus(before, after)))
    else:
        store(orbit, p, before + change)


@inlined
def add_vectors(bodies, row, b, change):
    """Add change to eight vectors likewise, in three rows from ``row`` on."""
    n = bodies.orbit.shape[1]
    p = row * n + b
    add_lanes(bodies, p, change.x)
    add_lanes(bodies, p + n, change.y)
    add_lanes(bodies, p + 2 * n, change.z)


@inlined
def exclusive_scan3(vector):
    """Apply ``exclusive_scan`` to each component."""
    return vector3(exclusive_scan(vector.x), exclusive_scan(vector.y), exclusive_scan(vector.z))


@inlined
def add_centre(centre, row, change):
    """Compensated centre[row] += change."""
    position, lost = centre[row], centre[row + 2]
    before = load(position, 0)
    increment = plus(load(lost, 0), change)
    after = plus(before, increment)
    store(position, 0, after)
    store(lost, 0, plus(increment, minus(before, after)))
