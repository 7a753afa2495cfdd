"""Changes of a system by collisions and escapes: bodies merge, bounce or leave."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from kickdrift.errors import InputError
from kickdrift.model.events import Collision, Escape
from kickdrift.model.memory import Memory
from kickdrift.model.state import Floats
from kickdrift.model.system import System


class Change(NamedTuple):
    """Result of an event that acts on bodies."""

    system: System  # the remaining bodies
    y: Floats
    done: str  # text for the log
    gone: int | None = None  # row of a body that left
    survivor: int | None = None  # row of the body that absorbed it


def changed(event: Collision | Escape, system: System, y: Floats, bodies: tuple[int, ...]) -> Change:
    """Bounce or merge two bodies, or remove one."""
    if isinstance(event, Collision):
        i, j = bodies
        if event.action == "bounce":
            return Change(system, bounced(system.state.masses, y, i, j, event.restitution), "bounced")
        survivor, gone = (i, j) if system.state.masses[i] >= system.state.masses[j] else (j, i)
        done = f"{system.body(gone)} merged into {system.body(survivor)}"
        return Change(*merged(system, y, survivor, gone), done, gone, survivor)
    (gone,) = bodies
    return Change(*without(system, y, gone), "removed", gone)


def without(system: System, y: Floats, gone: int) -> tuple[System, Floats]:
    """Return the system and y (2, 3, n) without one body."""
    left = system.remaining(np.arange(len(system)) != gone, y, system.state.masses, system.radii)
    return left, left.state.phase.copy()


def merged(system: System, y: Floats, survivor: int, absorbed: int) -> tuple[System, Floats]:
    """Return the system and y with two bodies merged, at the survivor's index.

    Mass, momentum, centre of mass and volume are conserved. The lost energy and spin are not recorded.
    """
    masses, y = system.state.masses.copy(), y.copy()
    pair = [survivor, absorbed]
    total = masses[pair].sum()
    # The heavier body's own place and a small change: both may lie far from the origin.
    y[:, :, survivor] += masses[absorbed] / total * (y[:, :, absorbed] - y[:, :, survivor])
    masses[survivor] = total
    radii = None if system.radii is None else joined(system.radii, survivor, absorbed)
    left = system.remaining(np.arange(len(system)) != absorbed, y, masses, radii)
    return left, left.state.phase.copy()


def joined(radii: Floats, survivor: int, absorbed: int) -> Floats:
    """Copy of radii (n,) in which the survivor has taken the other body's volume. The other radius stays in the
    array."""
    radii = radii.copy()
    radii[survivor] = np.cbrt(radii[survivor] ** 3 + radii[absorbed] ** 3)
    return radii


def bounced(masses: Floats, y: Floats, i: int, j: int, restitution: float) -> Floats:
    """Copy of y (2, 3, n) after the bounce of two hard spheres.

    The normal part of their relative velocity is reversed and multiplied by ``restitution``. Momentum is conserved.
    """
    y = y.copy()
    normal = y[0, :, i] - y[0, :, j]
    normal /= np.linalg.norm(normal)
    speed = float((y[1, :, i] - y[1, :, j]) @ normal)
    impulse = -(1.0 + restitution) * speed / (masses[i] + masses[j])  # divided by m_i m_j
    y[1, :, i] += impulse * masses[j] * normal
    y[1, :, j] -= impulse * masses[i] * normal
    return y


def remaining_memory(first: Any, system: Any) -> Memory | None:
    """Remaining bodies of ``first`` in a system, and their start; None if all bodies remain."""
    if system is first:
        return None
    state = system.state
    return {"ids": state.ids, "masses": state.masses, "radii": system.radii, "phase": state.phase}


def left_of(first: System, ids: Any, masses: Floats, radii: Floats | None, phase: Floats) -> System:
    """System with these bodies of ``first``; the inverse of ``remaining_memory``."""
    state, keep = first.state, np.isin(first.state.ids, ids)
    if not np.array_equal(state.ids[keep], ids):
        raise InputError("checkpoint: holds bodies that the system has not")
    everywhere, weights, sizes = state.phase.copy(), state.masses.copy(), None
    everywhere[:, :, keep], weights[keep] = phase, masses
    if radii is not None:
        sizes = np.zeros(len(first))
        sizes[keep] = radii
    return first.remaining(keep, everywhere, weights, sizes)
