"""Pairs of bodies that move as one in block steps: their orbits, their neighbours, and the log of their changes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.integrators.wisdom_holman.method import SABA

# The orbit of a pair (McLachlan 1995, order (8, 4)) in equal parts of the eccentric anomaly.
PARTS = 8
DRIFTS, KICKS = (np.array(SABA["8,4"].weights[first::2]) for first in range(2))

# The strength of a pair's neighbours is the sum of 2 m / M (apocentre / distance)^3: their largest tide over the pair's
# own attraction.
FORMS, BREAKS = 1e-3, 1e-2
FELT = 1e-8  # tide of one neighbour, or of the pair on it, with which the two feel one another's bodies
NEAR = 128  # most neighbours that a pair feels
SEARCHES = 8.0  # steps of a body from one search for its partner to the next
SINGLE = -1

COUNT, FORMED, BROKEN, LOGGED = range(4)  # slots of the tally
TIME, STEP, KIND, ONE, OTHER, DISTANCE, AXIS, ECCENTRICITY, COLUMNS = range(9)  # columns of the log, and their number
FORM, BREAK = 0.0, 1.0  # kinds of changes


class Pairs(NamedTuple):
    """Close pairs among ``n`` bodies; rows with P are for the pairs, of which ``tally`` has the number.

    The first body's slot in `Bodies` holds the pair's mass and the motion of its centre of mass. The second's has no
    mass, and no step ends there.
    """

    gm: NDArray[np.float64]  # (n,) G m of each body
    partner: NDArray[np.int64]  # (n,) the other body of the pair, or SINGLE
    bodies: NDArray[np.int64]  # (2, P) the first body, which has the lower number, and the second
    orbit: NDArray[np.float64]  # (6, P) place and velocity of the second from the first, at the first slot's time
    now: NDArray[np.float64]  # (6, P) the same at another time
    near: NDArray[np.int64]  # (P, NEAR) bodies that feel both bodies of the pair
    nears: NDArray[np.int64]  # (P,) their number
    strength: NDArray[np.float64]  # (P,) of all neighbours together
    moves: NDArray[np.int64]  # (n,) whether the present step moves the body
    tally: NDArray[np.int64]  # (4,)
    log: NDArray[np.float64]  # (rows, COLUMNS) changes
    drifts: NDArray[np.float64]
    kicks: NDArray[np.float64]


def pairs_among(gm: NDArray[np.float64]) -> Pairs:
    """Room for the pairs of bodies with these G m, none of them formed."""
    n = len(gm)
    most = max(1, n // 2)
    return Pairs(
        gm=gm.copy(),
        partner=np.full(n, SINGLE),
        bodies=np.zeros((2, most), np.int64),
        orbit=np.zeros((6, most)),
        now=np.zeros((6, most)),
        near=np.zeros((most, NEAR), np.int64),
        nears=np.zeros(most, np.int64),
        strength=np.zeros(most),
        moves=np.zeros(n, np.int64),
        tally=np.zeros(4, np.int64),
        log=np.zeros((n + 64, COLUMNS)),
        drifts=DRIFTS,
        kicks=KICKS,
    )
