"""Masses of bodies in a run whose bodies merge, leave or come."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from kickdrift.looks.columns import BODY_MASSES
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.trajectory.read import reader


def masses_held(run: reader.Run, frames: Sequence[int] | Any, x: Floats, v: Floats) -> Floats:
    """Masses (k, n) at frames, in order, with positions and velocities (k, n, 3), which become nan for absent bodies.

    The mass is 0 for a body that is not there. A file in which collisions may change bodies has the masses; in other
    files they follow from the positions.
    """
    first, last = int(frames[0]), int(frames[-1])
    recorded = run[first : last + 1].observables.get(BODY_MASSES)
    if recorded is None:
        return _from_positions(x, v, run.masses)
    masses = np.asarray(recorded)[np.asarray(frames) - first]
    gone = np.isnan(masses)
    x[gone] = v[gone] = np.nan
    return np.nan_to_num(masses)


def _from_positions(x: Floats, v: Floats, masses: Floats) -> Floats:
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
