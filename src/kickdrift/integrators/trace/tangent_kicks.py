"""Kicks and jumps of the hybrid map on duals."""

from __future__ import annotations

from kickdrift.integrators.trace.state import FULL
from kickdrift.integrators.trace.tangent_attraction import pull_of
from kickdrift.integrators.trace.tangent_rows import AFTER_X, MASSES, V, X
from kickdrift.jit.compile import jit, never_inline
from kickdrift.jit.duals.dual import dual_rows
from kickdrift.jit.duals.operators import dual_vector, put_vector, vector_at


@jit
def kick_duals(hybrid, own, rows, h, heavy):
    """Kick each body by the massive bodies that are not near it, as ``loop.kick`` does."""
    never_inline()
    n, slot, used = own.slot.size, own.slot, hybrid.used
    x, v, masses = dual_rows(rows[X], n), dual_rows(rows[V], n), dual_rows(rows[MASSES], n)
    together = heavy and hybrid.way == FULL  # bodies that move together feel all attractions there
    for i in range(2, n):
        if together and own.met[i]:
            continue
        speed = vector_at(v, i)
        for j in range(1, min(i, own.massive)):
            if not used[slot[j], slot[i]]:
                pull = h * pull_of(vector_at(x, j) - vector_at(x, i))
                speed = speed + masses[0, j] * pull
                if i < own.massive:
                    put_vector(v, j, vector_at(v, j) - masses[0, i] * pull)
        put_vector(v, i, speed)


@jit
def jump_duals(hybrid, own, rows, h):
    """Move all bodies by the central body's way, except massless bodies that pass their pericentre."""
    never_inline()
    n, move, passes = own.slot.size, dual_vector((0.0, 0.0, 0.0)), hybrid.used.shape[0] - 1
    x, v, masses = dual_rows(rows[X], n), dual_rows(rows[V], n), dual_rows(rows[MASSES], n)
    for i in range(1, own.massive):
        move = move + masses[2, i] * vector_at(v, i)
    move = h * move
    for i in range(1, n):
        if not hybrid.used[passes, own.slot[i]]:
            put_vector(x, i, vector_at(x, i) + move)


@jit
def shift_duals(own, rows):
    """Move massless bodies that meet no other by half the central body's way."""
    n = own.slot.size
    x, moved = dual_rows(rows[X], n), 0.5 * vector_at(dual_rows(rows[AFTER_X], n), 0)
    for i in range(own.massive, n):
        if not own.met[i]:
            put_vector(x, i, vector_at(x, i) + moved)
