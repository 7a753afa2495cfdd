"""Memory of the hybrid map beside its bodies."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kickdrift.forces.seam.group import ListedForce
from kickdrift.integrators.gauss_radau.series import BLOCK, ROWS
from kickdrift.integrators.gauss_radau.tables import tables
from kickdrift.integrators.trace.others import INSIDE, KICKS
from kickdrift.integrators.trace.state import COUNTS, PATH_COLUMNS, PATH_ROWS, Hybrid, Meeting
from kickdrift.integrators.wisdom_holman.bodies import Bodies
from kickdrift.jit.lanes.memory import aligned
from kickdrift.model.state import Floats


def hybrid_of(
    bodies: Bodies, reach: Floats, way: int, inner: int, others: Sequence[object] = (), moving: bool = False
) -> Hybrid:
    """The state of the hybrid map of these bodies, with ``reach`` (slots,) as in ``state``.

    ``others`` are the forces other than gravity; ``moving`` tells whether they depend on velocity.
    """
    groups = np.array([KICKS if isinstance(force, ListedForce) else INSIDE for force in others], np.int64)
    slots, massive = bodies.table.shape[1], bodies.massive
    room = massive + 1
    width = BLOCK * -(-3 * room // BLOCK) + BLOCK
    return Hybrid(
        bodies=bodies, near=np.zeros((massive, slots), np.uint8), meets=np.zeros(slots, np.int64),
        passes=np.zeros(slots, np.uint8), reach=reach, zone=aligned((massive,)),
        counts=np.zeros(COUNTS, np.int64), start=aligned((6, slots)), centre=aligned(bodies.centre.shape),
        middle=aligned((6, slots)),
        group=np.zeros(massive, np.int64), path=np.zeros((PATH_ROWS, PATH_COLUMNS)),
        kept=aligned((6, slots)),
        meeting=Meeting(
            slots=np.zeros(room, np.int64), gm=np.zeros(room), jumps=np.zeros(room, np.uint8),
            acts=np.zeros(room, np.uint8),
            size=np.zeros(5, np.int64), x=aligned((width,)), v=aligned((width,)), a=aligned((width,)),
            work=aligned((ROWS * width,)),
        ),
        tables=tables(), groups=groups, present=np.array([KICKS in groups, INSIDE in groups], np.uint8),
        span=np.zeros(2), speeds=np.zeros((3, slots + 2)), latest=np.zeros((3, slots + 1)),
        used=np.zeros((0, slots), np.uint8), moving=moving, way=way, inner=inner,
    )  # fmt: skip
