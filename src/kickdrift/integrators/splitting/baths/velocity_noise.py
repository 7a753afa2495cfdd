"""Baths of random velocities: friction with noise, and collisions, from noise that can be replayed.

The normal numbers of a particle are Philox at (id, stage, step) under the seed. A refined path draws them so that two
half spans together have the noise that the whole span has in the run at twice the step. With R the whole span's number,
Q a new one, and c the part of the first half's noise that is left at the end of the second, the halves have

R1 = (c R + Q) / sqrt(1 + c^2) and R2 = (R - c Q) / sqrt(1 + c^2),

which are independent standard normal numbers with (c R1 + R2) / sqrt(1 + c^2) = R. This is the bridge of an
Ornstein-Uhlenbeck process for c = exp(-friction span), and that of Brownian motion (Levy's construction) for c = 1.

The flows of friction and noise, v <- c v + sqrt(1 - c^2) sqrt(k_B T / m) R with standard normal numbers R, keep
Maxwell's distribution for every step. For a friction g and a time h they differ in c:

- O, the Ornstein-Uhlenbeck process, exact in distribution: c = exp(-g h) (Uhlenbeck & Ornstein 1930,
  doi:10.1103/PhysRev.36.823);
- G, the same by the rule of the midpoint: c = (1 - g h / 2) / (1 + g h / 2). A step of BAGAB is the method of
  Gronbech-Jensen & Farago 2013, doi:10.1080/00268976.2012.760055, with the velocity at the step's end;
- M, velocities drawn anew from Maxwell's distribution: c = 0, the limit of large friction.

Under noise="refine" the halves of O are tied by its own bridge, the halves of G and M by that of Brownian motion.

The flow D has Andersen's collisions (1980, J. Chem. Phys. 72, 2384, doi:10.1063/1.439486): in a time h each particle
gets a new velocity, Maxwell's, with probability 1 - exp(-rate h).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError
from kickdrift.forces.seam.kernel import OK
from kickdrift.integrators.options import FRICTION, NOISE, RATE, REFINE, TEMPERATURE
from kickdrift.integrators.splitting.baths.bath import Bathed, bathed, keep_fixed
from kickdrift.integrators.stepping.loops import chunk_numbers, sweeps
from kickdrift.integrators.stepping.subflow_code import BoundSubflow, subflow_body
from kickdrift.jit.compile import as_written, never_inline
from kickdrift.jit.handle import handle
from kickdrift.jit.lanes.functions import lane_sum, splat
from kickdrift.jit.lanes.masks import select
from kickdrift.jit.lanes.memory import flat, load, masked_load, masked_store
from kickdrift.jit.lanes.random import normals, uniforms
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.jit.threads.chunks import Chunks, chunk_task, each_chunk
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.options import Options


CHOICE = 1 << 12  # added to the stage for the numbers that choose the particles
BRIDGE = 1 << 13  # added to the stage for the numbers Q


class Draw(NamedTuple):
    """Place of a draw, and its shares of the numbers R and Q."""

    step: int
    stage: int
    whole: float  # share of R
    bridge: float  # share of Q; 0 draws no Q


def bridges(weights: Floats) -> NDArray[np.int64]:
    """Table (2, stages, 2) of a refined path: for even and odd steps and each stage, the stage of the whole span in the
    step of twice the length, and whether this is its second half. ``weights`` are the flow's parts of the step.

    Raises InputError for parts that differ: their halves end inside others."""
    places = np.flatnonzero(weights)
    if np.ptp(weights[places]) > 1e-14:
        raise InputError(f"{NOISE.name}: {REFINE} needs a word whose bath acts for equal parts of the step")
    table = np.zeros((2, len(weights), 2), np.int64)
    for passed in range(2 * len(places)):
        odd, k = divmod(passed, len(places))
        table[odd, places[k]] = places[passed // 2], passed % 2
    return table


@as_written
def drawn(table, left, step, stage):
    """Place of the draw of a stage; ``left`` is the c of refined paths, and ``table`` is empty for others."""
    if table.size == 0:
        return Draw(step, stage, 1.0, 0.0)
    scale = 1.0 / math.sqrt(1.0 + left * left)
    whole = table[step & 1, stage, 0]
    if table[step & 1, stage, 1]:
        return Draw(step >> 1, whole, scale, -left * scale)
    return Draw(step >> 1, whole, left * scale, scale)


@as_written
def mixed(draw, whole, bridge):
    """The number of half a span."""
    return draw.whole * whole + draw.bridge * bridge


@as_written
def changed(hit, kept, noise, normal, row, i, count):
    """Velocities ``row[i : i + count]`` after the noise. Return the change of their squares."""
    old = masked_load(row, i, count)
    new = select(hit, kept * old + noise * normal, old)
    masked_store(row, i, new, count)
    return new * new - old * old


class Shared(NamedTuple):
    """Chunks of the particles of a bath."""

    chunks: Chunks
    gains: Floats  # (chunks,) twice the energy that each chunk gained


def shared(flow: Flow) -> Shared:
    """Return the chunks of the particles of a run."""
    chunks = sweeps(len(flow.subject), flow.forces.threads)
    return Shared(chunks, np.zeros(chunks.number))


class Shaking(NamedTuple):
    """What the chunks of `shake` need."""

    parts: Any  # a handle of Friction or Collisions
    v: Any
    kept: float
    noise: float
    likely: float
    draw: Draw


@as_written
def shake(parts, v, kept, noise, likely, draw):
    """v <- kept v + noise sqrt(k_B T / m) R for velocities (3, n) of each particle, with probability ``likely``."""
    shared, heat = parts.shared, 0.0
    each_chunk(handle(Shaking(parts, v, kept, noise, likely, draw)), shared.chunks, "shake_chunk")
    for c in range(shared.chunks.number):
        heat += shared.gains[c]
    parts.bath.heat[0] += 0.5 * heat
    keep_fixed(parts.bath, v)


@chunk_task
def shake_chunk(shaking, c):
    """Shake the particles of chunk c."""
    never_inline()
    bath, shared, v, draw = shaking.parts.bath, shaking.parts.shared, shaking.v, shaking.draw
    kept, noise, likely = shaking.kept, shaking.noise, shaking.likely
    row, n, heat = flat(v), v.shape[1], splat(0.0)
    begin, end = chunk_numbers(n, c, shared.chunks.number)
    for i in range(begin, end, WIDTH):
        count = min(WIDTH, n - i)
        first, second, third, fourth = uniforms(bath.ids, i, draw.stage, draw.step, bath.seed)
        x, y, z = normals(first, second, third, fourth)
        if draw.bridge != 0.0:
            one, two, three, four = uniforms(bath.ids, i, draw.stage + BRIDGE, draw.step, bath.seed)
            p, q, r = normals(one, two, three, four)
            x, y, z = mixed(draw, x, p), mixed(draw, y, q), mixed(draw, z, r)
        if likely < 1.0:
            first, _, _, _ = uniforms(bath.ids, i, draw.stage + CHOICE, draw.step, bath.seed)
        hit, some = first < likely, noise * load(bath.spread, i)
        change = changed(hit, kept, some, x, row, i, count) + changed(hit, kept, some, y, row, n + i, count)
        if bath.axes == 3:
            change = change + changed(hit, kept, some, z, row, 2 * n + i, count)
        heat = heat + load(bath.masses, i) * change
    shared.gains[c] = lane_sum(heat)


EXACT, MIDPOINT, ANEW = 0, 1, 2  # rules for c
RULES = {"O": EXACT, "G": MIDPOINT, "M": ANEW}


class Friction(NamedTuple):
    """Numbers of the flow in compiled code."""

    bath: Bathed
    shared: Shared
    friction: float
    rule: int
    bridges: NDArray[np.int64]  # see velocity_noise; empty unless the path is refined


@as_written
def shares(rule, damping):
    """Return c and sqrt(1 - c^2) for friction times time."""
    if rule == MIDPOINT:
        return (1.0 - 0.5 * damping) / (1.0 + 0.5 * damping), math.sqrt(2.0 * damping) / (1.0 + 0.5 * damping)
    if rule == ANEW:
        return 0.0, 1.0
    return math.exp(-damping), math.sqrt(-math.expm1(-2.0 * damping))


@subflow_body(Friction)
def ornstein_uhlenbeck(parts, t, x, v, span, step, stage):
    kept, noise = shares(parts.rule, parts.friction * span)
    draw = drawn(parts.bridges, kept if parts.rule == EXACT else 1.0, step, stage)
    shake(parts, v, kept, noise, 1.0, draw)
    return OK


def bind_friction(letter: str, flow: Flow, options: Options, weights: Floats) -> BoundSubflow:
    """Return the flow of that letter for the particles of a run."""
    bath = bathed(flow, options, (TEMPERATURE, FRICTION), conserving=False)
    table = bridges(weights) if options.get(NOISE.name) == REFINE else np.zeros((2, 0, 2), np.int64)
    return BoundSubflow(Friction(bath, shared(flow), float(options.friction), RULES[letter], table))


class Collisions(NamedTuple):
    """Numbers of the flow in compiled code."""

    bath: Bathed
    shared: Shared
    rate: float


@subflow_body(Collisions)
def andersen(parts, t, x, v, span, step, stage):
    shake(parts, v, 0.0, 1.0, -math.expm1(-parts.rate * span), Draw(step, stage, 1.0, 0.0))
    return OK


def bind_collisions(flow: Flow, options: Options, weights: Floats) -> BoundSubflow:
    """Return the flow for the particles of a run."""
    bath = bathed(flow, options, (TEMPERATURE, RATE), conserving=False)
    return BoundSubflow(Collisions(bath, shared(flow), float(options.collision_rate)))
