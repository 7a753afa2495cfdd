"""The flow C: canonical sampling through velocity rescaling. All velocities get one factor, whose noise is exact.
The motion of the whole stays, see ``model.freedom``.

Bussi, Donadio & Parrinello 2007, J. Chem. Phys. 126, 014101, doi:10.1063/1.2408420, eq. A7. With K the kinetic energy
of f degrees of freedom and c = exp(-h / tau), the new one is

K' = c K + (1 - c) (k_B T / 2) (R_1^2 + ... + R_f^2) + 2 R_1 sqrt(c (1 - c) K k_B T / 2).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.seam.kernel import OK
from kickdrift.integrators.options import TAU, TEMPERATURE
from kickdrift.integrators.splitting.baths.bath import Bathed, bathed, heat_left, heat_now, rescale
from kickdrift.integrators.stepping.subflow_code import BoundSubflow, subflow_body
from kickdrift.jit.compile import strict
from kickdrift.jit.lanes.memory import store
from kickdrift.jit.lanes.random import normals, uniforms
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.options import Options


class Rescaling(NamedTuple):
    """Numbers of the flow in compiled code."""

    bath: Bathed
    tau: float
    places: NDArray[np.int64]  # (8,) in place of ids, the numbers of the draws
    room: Floats  # (3, 8) two normal numbers and a uniform one for each draw


@strict
def draw(places, room, stage, step, seed):
    """Fill ``room`` with eight draws."""
    first, second, third, fourth = uniforms(places, 0, stage, step, seed)
    x, y, _ = normals(first, second, third, fourth)
    store(room[0], 0, x)
    store(room[1], 0, y)
    store(room[2], 0, third)


@strict
def gamma_variate(shape, places, room, stage, step, seed):
    """Gamma-distributed number of shape >= 1 (Marsaglia & Tsang 2000, doi:10.1145/358407.358414); ``room`` is filled.

    A draw is accepted with probability above 0.95. Eight draws are made at a time."""
    d = shape - 1.0 / 3.0
    c = 1.0 / math.sqrt(9.0 * d)
    more = 0
    while True:
        for k in range(WIDTH):
            z, u = room[0, k], room[2, k]
            w = (1.0 + c * z) ** 3
            if w > 0.0 and math.log(u) < 0.5 * z * z + d - d * w + d * math.log(w):
                return d * w
        more += 1
        draw(places, room, stage + (more << 12), step, seed)


@strict
def factor_of(energy, bath, tau, places, room, span, step, stage):
    """Factor of the velocities after the time ``span``, at the kinetic ``energy``."""
    draw(places, room, stage, step, bath.seed)
    first, c = room[1, 0], math.exp(-span / tau)
    squares = first * first
    if bath.freedom > 2.5:
        squares += 2.0 * gamma_variate(0.5 * (bath.freedom - 1.0), places, room, stage, step, bath.seed)
    elif bath.freedom > 1.5:
        squares += room[1, 1] ** 2
    per = (1.0 - c) * 0.5 * bath.thermal / energy
    squared = c + per * squares + 2.0 * first * math.sqrt(c * per)
    root = math.sqrt(max(squared, 0.0))
    return root if first + math.sqrt(c / per) >= 0.0 else -root


@subflow_body(Rescaling)
def csvr(parts, t, x, v, span, step, stage):
    bath = parts.bath
    before = heat_now(bath, x, v)
    if before > 0.0:
        factor = factor_of(before, bath, parts.tau, parts.places, parts.room, span, step, stage)
        rescale(bath, x, v, factor)
        bath.heat[0] += heat_left(bath, x, v) - before
    return OK


def bind(flow: Flow, options: Options, weights: Floats) -> BoundSubflow:
    """Return the flow for the particles of a run."""
    bath = bathed(flow, options, (TEMPERATURE, TAU), conserving=True)
    return BoundSubflow(Rescaling(bath, float(options.tau), np.arange(WIDTH), np.zeros((3, WIDTH))))
