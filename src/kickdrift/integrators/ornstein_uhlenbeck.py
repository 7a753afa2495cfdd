"""The flow O: the Ornstein-Uhlenbeck process of the velocities, exact in distribution, with noise that can be replayed.

v <- exp(-g h) v + sqrt(1 - exp(-2 g h)) sqrt(k_B T / m) R for a time h and friction g, R standard normal numbers
(Uhlenbeck & Ornstein 1930, doi:10.1103/PhysRev.36.823). R is Philox at (id, stage, step) under the seed.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError
from kickdrift.forces.kernel import OK
from kickdrift.integrators.option import FRICTION, SEED, TEMPERATURE
from kickdrift.integrators.subflow_code import BoundSubflow, subflow_body
from kickdrift.jit.compile import as_written
from kickdrift.jit.lanes import lane_sum, splat
from kickdrift.jit.memory import flat, load, load_first, store_first
from kickdrift.jit.random import normals, uniforms
from kickdrift.jit.vectors import WIDTH
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.integrators.flow import Flow
    from kickdrift.integrators.options import Options


class Bath(NamedTuple):
    """Numbers of the flow in compiled code. Arrays of particles are filled up with zeros to a multiple of eight."""

    friction: float
    seed: int
    flat: bool  # whether z is left alone
    ids: NDArray[np.int64]
    masses: Floats  # in the unit that makes force = mass x acceleration
    spread: Floats  # sqrt(k_B T / m), 0 without mass
    heat: Floats  # (1,) kinetic energy that the bath has given so far


@as_written
def kept(factor, noise, normal, row, i, count):
    """Velocities ``row[i : i + count]`` after the flow, and the change of their squares."""
    old = load_first(row, i, count)
    new = factor * old + noise * normal
    store_first(row, i, new, count)
    return new * new - old * old


@as_written
def thermalise(parts, v, span, step, stage):
    """Let the flow act on velocities (3, n) for the time ``span``."""
    factor = math.exp(-parts.friction * span)
    noise = math.sqrt(-math.expm1(-2.0 * parts.friction * span))
    row, n, heat = flat(v), v.shape[1], splat(0.0)
    for i in range(0, n, WIDTH):
        count = min(WIDTH, n - i)
        first, second, third, fourth = uniforms(parts.ids, i, stage, step, parts.seed)
        x, y, z = normals(first, second, third, fourth)
        scale = noise * load(parts.spread, i)
        change = kept(factor, scale, x, row, i, count) + kept(factor, scale, y, row, n + i, count)
        if not parts.flat:
            change = change + kept(factor, scale, z, row, 2 * n + i, count)
        heat = heat + load(parts.masses, i) * change
    parts.heat[0] += 0.5 * lane_sum(heat)


@subflow_body(Bath)
def ornstein_uhlenbeck(parts, t, x, v, span, step, stage):
    thermalise(parts, v, span, step, stage)
    return OK


def bind(flow: Flow, options: Options) -> BoundSubflow:
    """Return the flow for the particles of a run."""
    system = flow.subject
    for option in (TEMPERATURE, FRICTION):
        if options[option.name] is None:
            raise InputError(f"{option.name} is needed: a heat bath has no default {option.name}")
    masses = system.coherent_masses
    if not np.all(masses > 0):
        raise InputError(f"a heat bath needs masses, and {system.body(int(np.argmin(masses)))} has none")
    spread = np.sqrt(system.units.boltzmann * options[TEMPERATURE.name] / masses)
    seed = options[SEED.name]
    if seed is None:
        seed = system.seed or 0
    return BoundSubflow(
        Bath(
            float(options[FRICTION.name]), int(seed), system.dimensions == 2, filled(system.state.ids), filled(masses),
            filled(spread), np.zeros(1),
        )
    )  # fmt: skip


def filled(values: NDArray) -> NDArray:
    """A copy with zeros at the end, of a multiple of eight in all."""
    return np.concatenate([values, np.zeros(-len(values) % WIDTH, values.dtype)])
