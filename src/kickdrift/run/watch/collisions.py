"""What collisions and escapes do to a system: bodies merge, bounce or leave; and which bodies are left."""

from __future__ import annotations

from typing import Any

import numpy as np

from kickdrift.errors import InputError
from kickdrift.model.memory import Memory
from kickdrift.model.state import Floats
from kickdrift.model.system import System


def without(system: System, y: Floats, gone: int) -> tuple[System, Floats]:
    """The system and y (2, 3, n) less one body."""
    left = system.remaining(np.arange(len(system)) != gone, y, system.state.masses, system.radii)
    return left, left.state.phase.copy()


def merged(system: System, y: Floats, survivor: int, absorbed: int) -> tuple[System, Floats]:
    """The system and y with two bodies made one, in the survivor's place.

    Mass, momentum and centre of mass are those of both, its radius that of a ball of both volumes. What energy and spin
    that takes is not kept anywhere."""
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
    """Radii (n,) where one body has taken another's volume; a copy, the absorbed body's still in it."""
    radii = radii.copy()
    radii[survivor] = np.cbrt(radii[survivor] ** 3 + radii[absorbed] ** 3)
    return radii


def bounced(masses: Floats, y: Floats, i: int, j: int, restitution: float) -> Floats:
    """y (2, 3, n) after two hard spheres met; a copy.

    The normal part of their relative velocity is turned around and multiplied by ``restitution``; momentum is
    conserved."""
    y = y.copy()
    normal = y[0, :, i] - y[0, :, j]
    normal /= np.linalg.norm(normal)
    speed = float((y[1, :, i] - y[1, :, j]) @ normal)
    impulse = -(1.0 + restitution) * speed / (masses[i] + masses[j])  # over m_i m_j
    y[1, :, i] += impulse * masses[j] * normal
    y[1, :, j] -= impulse * masses[i] * normal
    return y


def remaining_memory(first: Any, system: Any) -> Memory | None:
    """The bodies of ``first`` that are left in a system, and how they began; None where all are."""
    if system is first:
        return None
    state = system.state
    return {"ids": state.ids, "masses": state.masses, "radii": system.radii, "phase": state.phase}


def left_of(first: System, ids: Any, masses: Floats, radii: Floats | None, phase: Floats) -> System:
    """The system that those bodies of ``first`` are left of; the inverse of ``remaining_memory``."""
    state, keep = first.state, np.isin(first.state.ids, ids)
    if not np.array_equal(state.ids[keep], ids):
        raise InputError("checkpoint: holds bodies that the system has not")
    everywhere, weights, sizes = state.phase.copy(), state.masses.copy(), None
    everywhere[:, :, keep], weights[keep] = phase, masses
    if radii is not None:
        sizes = np.zeros(len(first))
        sizes[keep] = radii
    return first.remaining(keep, everywhere, weights, sizes)
