"""Find the particle that made a run blow up."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.model.system import System
from kickdrift.text import measured

FAR = 1e11  # times the size of the system; farther out, rounding (2e-16 relative) hides a particle's origin
MOST = 10_000  # most particles in a search for the nearest pair


def explain(system: System, phase: Floats, before: Floats, good: Floats, step: int, time: float, good_step: int) -> str:
    """Describe in one line the step, the particle, its nearest neighbour and the last good frame.

    ``phase`` (2, 3, n) holds the last positions and velocities, ``good`` those of the last good frame. ``before``
    (3, n) holds the positions one step before ``phase``: since then, the particle has flown away from its neighbour.
    """
    finite = np.isfinite(phase).all(axis=(0, 1))
    if finite.all():
        speeds = np.linalg.norm(phase[1], axis=0)
        particle = int(np.argmax(speeds))
        speed = measured(f"{speeds[particle]:.3g}", system.units.symbol("velocity"))
        what = f"{system.body(particle)} moves at {speed}"
    else:
        particle = int(np.flatnonzero(~finite)[0])
        what = f"{system.body(particle)} has no finite position or velocity"
    if stretched := _out_of_range(system, phase, before):
        return f"blew up at step {step} (t = {time:.6g}): {stretched}; the last good frame is step {good_step}"
    known = finite.all() and np.abs(phase[0]).max() < FAR * np.abs(good[0]).max()
    here, when = (before, "the step before") if known else (good[0], f"at step {good_step}")
    distances = np.linalg.norm(system.box.minimum_image((here - here[:, [particle]]).T), axis=1)
    distances[particle] = np.inf
    neighbour = ""
    if len(distances) > 1:
        other = int(np.argmin(distances))
        apart = measured(f"{distances[other]:.4g}", system.units.symbol("length"))
        which = system.names[other] if system.names else system.state.ids[other]
        neighbour = f", its nearest neighbour was {which} at {apart} {when}"
    return f"blew up at step {step} (t = {time:.6g}): {what}{neighbour}; the last good frame is step {good_step}"


def _out_of_range(system: System, phase: Floats, before: Floats) -> str:
    """Describe a bond, angle or dihedral that has left the range of its law at the last finite positions."""
    x = next((x for x in (phase[0], before) if np.isfinite(x).all()), None)
    for force in system.forces:
        if x is not None and hasattr(force, "trouble") and (found := force.trouble(system, x)):
            return f"{force.name}: {found}"
    return ""


def nearest_pair(system: System, x: Floats) -> str:
    """Describe the nearest pair of particles at x (3, n), at least one of them with mass.

    The text is "" if there is no such pair, or too many particles to search."""
    massive = np.flatnonzero(system.state.masses)
    if not 2 <= len(system) <= MOST or not massive.size or not np.isfinite(x).all():
        return ""
    best, pair = np.inf, (0, 0)
    for i in massive:
        distances = np.linalg.norm(system.box.minimum_image((x - x[:, [i]]).T), axis=1)
        distances[i] = np.inf
        if distances.min() < best:
            best, pair = float(distances.min()), (int(i), int(np.argmin(distances)))
    first, second = (system.body(k) for k in sorted(pair))
    return f"; {first} and {second} are nearest, {measured(f'{best:.3g}', system.units.symbol('length'))} apart"
