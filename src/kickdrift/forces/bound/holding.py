"""Fixed particles among the bound forces of a System: the last entry of the table takes their accelerations away."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.seam.kernel import OK, BoundForce, kernel


class Holding(NamedTuple):
    """Particles that no force accelerates, see `FixedParticles`."""

    particles: NDArray[np.int64]


@kernel(Holding)
def hold(force, t, x, v, a, sums):
    for k in range(force.particles.size):
        i = force.particles[k]
        a[0, i], a[1, i], a[2, i] = 0.0, 0.0, 0.0
    return OK


def holding(system: Any) -> tuple[BoundForce, ...]:
    """What each group of forces needs behind it to hold the fixed particles of a System; see `held_groups`."""
    return tuple(BoundForce(Holding(system.fixed.particles)) for _ in held_groups(system))


def held_groups(system: Any) -> list[int]:
    """Groups of forces in a System with fixed particles; none without them."""
    if getattr(system, "fixed", None) is None:
        return []
    return sorted({getattr(force, "group", 0) for force in system.forces})
