"""Memory of the hybrid map's derivatives: rows of duals for all bodies, and room for the bodies that meet."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.integrators.gauss_radau import series
from kickdrift.jit.duals.dual import SLOT
from kickdrift.jit.lanes.memory import aligned

# Rows of a block: positions, velocities, masses; both before the drift; both after a passage of massive bodies;
# positions, velocities and accelerations in the system's order for other forces; velocities before a kick by forces of
# velocity; what rounding took from positions and velocities in a passage of massive bodies, for the next step of the
# passage. Row MASSES holds G m of the bodies, G m of the central one for the Kepler motions, and m / m_0. The central
# body's places in the rows hold the centre of mass; in AFTER_X, the way of the others by the central body's motion in a
# passage.
X, V, MASSES, MIDDLE_X, MIDDLE_V, AFTER_X, AFTER_V, OWN_X, OWN_V, OWN_A, BEFORE_V, LOST_X, LOST_V = range(13)
ROWS = 13


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
    width = series.BLOCK * -(-3 * room * numbers // series.BLOCK)
    x, v, a, lost_x, lost_v = (aligned((width // 2, 2) if twice else (width,)) for _ in range(5))
    whole = np.zeros(room, np.int64), np.zeros(room, np.int64), np.zeros(room, np.uint8)
    return DualMeeting(numbers, *whole, x, v, a, lost_x, lost_v, aligned((series.ROWS * width,)))
