"""Masses of bodies that merged during a run."""

from __future__ import annotations

import numpy as np

from kickdrift.model.state import Floats


def held(x: Floats, v: Floats, masses: Floats) -> Floats:
    """Masses (k, n) at each frame. In a file, an absorbed body has its survivor's position; here x and v of absorbed
    and removed bodies become nan."""
    there = np.isfinite(x[:, :, 0])
    found = np.where(there, masses, 0.0)
    last = len(x) - 1 - np.argmax(there[::-1], axis=0)
    phase = np.concatenate([x, v], axis=2)
    _, which, sizes = np.unique(phase[last, np.arange(len(masses))], axis=0, return_inverse=True, return_counts=True)
    for group in np.flatnonzero(sizes > 1):
        members = np.flatnonzero(which.ravel() == group)
        members = members[np.argsort(-masses[members], kind="stable")]
        for rank, body in enumerate(members):
            for heavier in members[:rank]:
                absorbed = np.all(phase[:, body] == phase[:, heavier], axis=1) & (found[:, heavier] > 0)
                found[absorbed, heavier] += found[absorbed, body]
                found[absorbed, body] = 0.0
                x[absorbed, body] = v[absorbed, body] = np.nan
    return found
