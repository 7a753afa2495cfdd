"""The flow O: the Ornstein-Uhlenbeck process of the velocities, exact in distribution, with noise that can be replayed.

v <- exp(-g h) v + sqrt(1 - exp(-2 g h)) sqrt(k_B T / m) R for a time h and friction g, R standard normal numbers
(Uhlenbeck & Ornstein 1930, doi:10.1103/PhysRev.36.823). R is Philox at (id, stage, step) under the seed.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from kickdrift.forces.kernel import OK
from kickdrift.integrators.bath import Bathed, bathed
from kickdrift.integrators.option import FRICTION, TEMPERATURE
from kickdrift.integrators.subflow_code import BoundSubflow, subflow_body
from kickdrift.jit.compile import as_written
from kickdrift.jit.lanes import lane_sum, splat
from kickdrift.jit.memory import flat, load, masked_load, masked_store
from kickdrift.jit.random import normals, uniforms
from kickdrift.jit.vectors import WIDTH

if TYPE_CHECKING:
    from kickdrift.integrators.flow import Flow
    from kickdrift.integrators.options import Options


class Friction(NamedTuple):
    """Numbers of the flow in compiled code."""

    bath: Bathed
    friction: float


@as_written
def kept(factor, noise, normal, row, i, count):
    """Velocities ``row[i : i + count]`` after the flow. Return the change of their squares."""
    old = masked_load(row, i, count)
    new = factor * old + noise * normal
    masked_store(row, i, new, count)
    return new * new - old * old


@subflow_body(Friction)
def ornstein_uhlenbeck(parts, t, x, v, span, step, stage):
    thermalise(parts.bath, parts.friction, v, span, step, stage)
    return OK


@as_written
def thermalise(bath, friction, v, span, step, stage):
    """Let the flow act on velocities (3, n) for the time ``span``."""
    factor, noise = math.exp(-friction * span), math.sqrt(-math.expm1(-2.0 * friction * span))
    row, n, heat = flat(v), v.shape[1], splat(0.0)
    for i in range(0, n, WIDTH):
        count = min(WIDTH, n - i)
        first, second, third, fourth = uniforms(bath.ids, i, stage, step, bath.seed)
        x, y, z = normals(first, second, third, fourth)
        some = noise * load(bath.spread, i)
        change = kept(factor, some, x, row, i, count) + kept(factor, some, y, row, n + i, count)
        if bath.axes == 3:
            change = change + kept(factor, some, z, row, 2 * n + i, count)
        heat = heat + load(bath.masses, i) * change
    bath.heat[0] += 0.5 * lane_sum(heat)


def bind(flow: Flow, options: Options) -> BoundSubflow:
    """Return the flow for the particles of a run."""
    bath = bathed(flow, options, (TEMPERATURE, FRICTION), conserving=False)
    return BoundSubflow(Friction(bath, float(options.friction)))
