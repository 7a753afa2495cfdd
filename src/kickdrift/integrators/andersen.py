"""The flow D: Andersen's collisions. In a time h each particle gets a new velocity with probability 1 - exp(-rate h).

Andersen 1980, J. Chem. Phys. 72, 2384, doi:10.1063/1.439486. New velocities are Maxwell's.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from kickdrift.forces.kernel import OK
from kickdrift.integrators.bath import Bathed, bathed
from kickdrift.integrators.option import RATE, TEMPERATURE
from kickdrift.integrators.subflow_code import BoundSubflow, subflow_body
from kickdrift.jit.compile import as_written
from kickdrift.jit.lanes import lane_sum, splat
from kickdrift.jit.masks import select
from kickdrift.jit.memory import flat, load, masked_load, masked_store
from kickdrift.jit.random import normals, uniforms
from kickdrift.jit.vectors import WIDTH

if TYPE_CHECKING:
    from kickdrift.integrators.flow import Flow
    from kickdrift.integrators.options import Options

CHOICE = 1 << 12  # added to the stage for the numbers that choose the particles


class Collisions(NamedTuple):
    """Numbers of the flow in compiled code."""

    bath: Bathed
    rate: float


@as_written
def replaced(hit, noise, normal, row, i, count):
    """Velocities ``row[i : i + count]`` after the collisions. Return the change of their squares."""
    old = masked_load(row, i, count)
    new = select(hit, noise * normal, old)
    masked_store(row, i, new, count)
    return new * new - old * old


@as_written
def collide(bath, rate, v, span, step, stage):
    """Give new velocities to the particles that collide in the time ``span``."""
    likely = -math.expm1(-rate * span)
    row, n, heat = flat(v), v.shape[1], splat(0.0)
    for i in range(0, n, WIDTH):
        count = min(WIDTH, n - i)
        chance = uniforms(bath.ids, i, stage + CHOICE, step, bath.seed)
        first, second, third, fourth = uniforms(bath.ids, i, stage, step, bath.seed)
        x, y, z = normals(first, second, third, fourth)
        hit, spread = chance[0] < likely, load(bath.spread, i)
        change = replaced(hit, spread, x, row, i, count) + replaced(hit, spread, y, row, n + i, count)
        if bath.axes == 3:
            change = change + replaced(hit, spread, z, row, 2 * n + i, count)
        heat = heat + load(bath.masses, i) * change
    bath.heat[0] += 0.5 * lane_sum(heat)


@subflow_body(Collisions)
def andersen(parts, t, x, v, span, step, stage):
    collide(parts.bath, parts.rate, v, span, step, stage)
    return OK


def bind(flow: Flow, options: Options) -> BoundSubflow:
    """Return the flow for the particles of a run."""
    return BoundSubflow(
        Collisions(bathed(flow, options, (TEMPERATURE, RATE), conserving=False), float(options.collision_rate))
    )
