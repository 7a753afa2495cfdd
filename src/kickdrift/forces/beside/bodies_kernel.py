"""The compiled force on bodies alone, whose System also has unknowns beside them."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.seam.kernel import kernel, run_body


class OnBodies(NamedTuple):
    """A force on the first n columns."""

    force: Any  # bound to the bodies
    phase: NDArray[np.float64]  # (2, 3, n) positions and velocities of the bodies
    a: NDArray[np.float64]  # (3, n) accelerations of the bodies


@kernel(OnBodies)
def on_bodies(force, t, x, v, a, sums):
    phase, own = force.phase, force.a
    n = own.shape[1]
    for k in range(3):
        for i in range(n):
            phase[0, k, i], phase[1, k, i], own[k, i] = x[k, i], v[k, i], 0.0
    status = run_body(force.force, t, phase[0], phase[1], own, sums)
    for k in range(3):
        for i in range(n):
            a[k, i] += own[k, i]
    return status
