"""Which particle a run that blew up should be blamed on."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kickdrift.state import Floats

if TYPE_CHECKING:
    from kickdrift.system import System


def explain(system: System, phase: Floats, good: Floats, step: int, time: float, good_step: int) -> str:
    """One line: the step, the particle, its nearest neighbour and the last good frame. Phases are (2, 3, n)."""
    finite = np.isfinite(phase).all(axis=(0, 1))
    if finite.all():
        particle = int(np.argmax((phase[1] ** 2).sum(axis=0)))
        speed = float(np.linalg.norm(phase[1][:, particle]))
        what = f"particle {particle} moves at {speed:.3g} {system.units.unit('velocity')}"
        here = phase[0]
    else:
        particle = int(np.flatnonzero(~finite)[0])
        what = f"particle {particle} has no finite position or velocity"
        here = good[0]
    separations = system.box.minimum_image((here - here[:, [particle]]).T)
    distances = np.linalg.norm(separations, axis=1)
    distances[particle] = np.inf
    distances[~np.isfinite(distances)] = np.inf
    neighbour = ""
    if len(distances) > 1 and np.isfinite(distances.min()):
        other = int(np.argmin(distances))
        when = "" if finite.all() else f" at step {good_step}"
        neighbour = f", its nearest neighbour is {other} at {distances[other]:.4g} {system.units.unit('length')}{when}"
    return f"blew up at step {step} (t = {time:.6g}): {what}{neighbour}; the last good frame is step {good_step}"
