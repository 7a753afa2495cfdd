"""State of the hybrid map: the Wisdom-Holman bodies, which of them meet, and room for the bodies that meet.

The bodies are those of ``wisdom_holman.bodies`` in democratic heliocentric coordinates: positions from the central
body, velocities from the centre of mass. A slot is a place in their lanes.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.integrators.gauss_radau.tables import Tables
from kickdrift.integrators.wisdom_holman.bodies import Bodies
from kickdrift.jit.compile import inlined

# Entries of ``counts``: pairs and passages that the last search added; all near pairs; all passages; massive bodies in
# passage; 1 if flags and accelerations belong to the present state; steps done twice; points in ``path``.
NEW, PAIRS, PASSAGES, HEAVY, READY, TWICE, POINTS = range(7)
COUNTS = 7
# Ways of a pericentre passage.
NONE, PARTIAL, FULL = range(3)
GAUSS_RADAU, BULIRSCH_STOER = range(2)
KICKS, INSIDE = range(2)  # groups of the other forces
# Entries of ``size``: number of bodies; 1 if all pairs attract each other here; evaluations in this step; first body
# whose path is noted; last row of the table of extrapolation in the latest step, see ``extrapolation``.
NUMBER, ALL, FOUND, FIRST_NOTED, TABLE_ROW = range(5)
# Columns of ``path``: time since the step's start; slot, or -1 - slot of a copy; position from the central body;
# velocity; number of the bodies that meet, whose rows follow one another; TABLE_ROW.
PATH_COLUMNS = 10
PATH_ROWS = 4096  # of most runs; further points are not noted


class Meeting(NamedTuple):
    """Bodies that meet. The arrays have room for all massive bodies and one massless body."""

    slots: NDArray[np.int64]  # (room,) slot of each
    gm: NDArray[np.float64]  # (room,)
    jumps: NDArray[np.uint8]  # (room,) 1: the velocity is from the central body, which moves
    acts: NDArray[np.uint8]  # (room,) 1: the body feels the other forces here
    size: NDArray[np.int64]  # (5,) see NUMBER to TABLE_ROW
    x: NDArray[np.float64]  # (width,) positions from the central body, three rows of as many as there are bodies
    v: NDArray[np.float64]  # (width,)
    a: NDArray[np.float64]  # (width,)
    work: NDArray[np.float64]  # room of the method


class Hybrid(NamedTuple):
    """All that a step needs."""

    bodies: Bodies
    near: NDArray[np.uint8]  # (massive, slots) 1: this pair is near, and its attraction is no kick
    meets: NDArray[np.int64]  # (slots,) number of massive bodies that are near
    passes: NDArray[np.uint8]  # (slots,) 1: the body passes its pericentre
    reach: NDArray[np.float64]  # (slots,) squared hand-over radius over squared distance from the central body
    zone: NDArray[np.float64]  # (massive,) squared hand-over radii at present
    counts: NDArray[np.int64]  # (COUNTS,)
    start: NDArray[np.float64]  # (6, slots) orbits at the step's start
    centre: NDArray[np.float64]  # (5, 8) the centre of mass there
    middle: NDArray[np.float64]  # (6, slots) orbits before the drift
    group: NDArray[np.int64]  # (massive,) number of the group of massive bodies that meet
    path: NDArray[np.float64]  # (rows, PATH_COLUMNS) points of the last step
    kept: NDArray[np.float64]  # (6, slots) values that a change of all lanes must not touch
    meeting: Meeting
    tables: Tables
    groups: NDArray[np.int64]  # (other forces,) KICKS or INSIDE, see ``others``
    present: NDArray[np.uint8]  # (2,) 1: there are other forces of this group
    span: NDArray[np.float64]  # (2,) time at the step's start, and its length
    speeds: NDArray[np.float64]  # (3, slots + 2) velocities before a kick; then the centre of mass's, and its carry
    latest: NDArray[np.float64]  # (3, slots + 1) velocities after the last iteration of a kick
    used: NDArray[np.uint8]  # (massive + 1, slots) ``near`` and ``passes`` of the last step; (0, slots) if not wanted
    moving: bool  # other forces depend on velocity
    way: int  # NONE, PARTIAL or FULL
    inner: int  # GAUSS_RADAU or BULIRSCH_STOER


def hermite(f, x0, v0, x1, v1):
    """Places and velocities at a fraction f of Hermite's cubic between two ends, with velocities per step."""
    b, a = 3.0 * (x1 - x0) - 2.0 * v0 - v1, 2.0 * (x0 - x1) + v0 + v1
    return x0 + f * (v0 + f * (b + f * a)), v0 + f * (2.0 * b + 3.0 * f * a)


compiled_hermite = inlined(hermite)  # of numbers, or of vectors of duals
