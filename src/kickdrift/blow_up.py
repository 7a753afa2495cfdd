"""Which particle a run that blew up should be blamed on."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kickdrift.state import Floats

if TYPE_CHECKING:
    from kickdrift.system import System

FAR = 1e11  # times the size of the system: from beyond, rounding (2e-16 of it) hides where a particle came from


def explain(system: System, phase: Floats, before: Floats, good: Floats, step: int, time: float, good_step: int) -> str:
    """One line: the step, the particle, its nearest neighbour and the last good frame.

    ``phase`` (2, 3, n) is what the particles had reached, ``good`` that of the last good frame. ``before`` (3, n) is
    where they stood a step before ``phase``: what is to blame has flown away since.
    """
    finite = np.isfinite(phase).all(axis=(0, 1))
    if finite.all():
        speeds = np.linalg.norm(phase[1], axis=0)
        particle = int(np.argmax(speeds))
        what = f"{system.body(particle)} moves at {speeds[particle]:.3g} {system.units.unit('velocity')}"
    else:
        particle = int(np.flatnonzero(~finite)[0])
        what = f"{system.body(particle)} has no finite position or velocity"
    known = finite.all() and np.abs(phase[0]).max() < FAR * np.abs(good[0]).max()
    here, when = (before, "the step before") if known else (good[0], f"at step {good_step}")
    distances = np.linalg.norm(system.box.minimum_image((here - here[:, [particle]]).T), axis=1)
    distances[particle] = np.inf
    neighbour = ""
    if len(distances) > 1:
        other = int(np.argmin(distances))
        length = system.units.unit("length")
        which = system.names[other] if system.names else other
        neighbour = f", its nearest neighbour was {which} at {distances[other]:.4g} {length} {when}"
    return f"blew up at step {step} (t = {time:.6g}): {what}{neighbour}; the last good frame is step {good_step}"
