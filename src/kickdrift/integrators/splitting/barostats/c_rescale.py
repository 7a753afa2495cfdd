"""Stochastic cell rescaling: a first-order barostat of the right ensemble.

Bernetti & Bussi 2020, J. Chem. Phys. 153, 114107, doi:10.1063/5.0020514. With q the square root of the volume, each
group of n edges of d obeys

dq = -(n b q / 2 d tau) (P - p - k_B T / 2 V) dt + sqrt(n k_B T b / 2 d tau) dW

for the compressibility b and the pressure p on the faces of the group, eq. 9 for n = d. The noise of q is the same at
every volume. So each action takes half the last noise and half a new one around one force. This is the limit of strong
friction of the splitting BAOAB, symmetric in time (Leimkuhler & Matthews 2013, doi:10.1093/amrx/abs010). Its variance
is exact where the force is linear, however long the time between two actions.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.seam.kernel import OK
from kickdrift.integrators.options import COMPRESSIBILITY, PRESSURE_TAU, Options
from kickdrift.integrators.splitting.barostats.piston import (
    MOST,
    STOPPED,
    TOO_FAST,
    Piston,
    add_motion_within,
    pressures,
    stretch,
    volume,
)
from kickdrift.integrators.stepping.subflow_code import PROPOSE, BoundSubflow, subflow_body
from kickdrift.jit.compile import strict
from kickdrift.jit.lanes.memory import store
from kickdrift.jit.lanes.random import normals, uniforms
from kickdrift.model.state import Floats

STAGE = 1 << 11  # of the noise: beyond those of heat baths
BEGUN = 3  # slot of the state after the last half actions of three groups


class Rescale(NamedTuple):
    """Numbers of the barostat in compiled code."""

    piston: Piston
    rate: float  # compressibility over time constant
    places: NDArray[np.int64]  # (8,) numbers of the draws
    noise: Floats  # (2, 8) normal numbers


@strict
def draw(places, noise, step, seed):
    first, second, third, fourth = uniforms(places, 0, STAGE, step, seed)
    x, y, _ = normals(first, second, third, fourth)
    store(noise[0], 0, x)
    store(noise[1], 0, y)


@strict
def half_push(parts, a, pressure, span):
    """Half the change of q that the pressure on group a causes in the time ``span``."""
    piston = parts.piston
    q, thermal = math.sqrt(volume(piston)), piston.bath.thermal
    spread = piston.sizes[a] * thermal * parts.rate / (4.0 * piston.bath.axes)
    return 0.5 * spread * span * (1.0 / q - 2.0 * q * (piston.pressure - pressure) / thermal)


@strict
def half_noise(parts, a, normal, span):
    """Half the noise of q in the time ``span``."""
    piston = parts.piston
    spread = piston.sizes[a] * piston.bath.thermal * parts.rate / (4.0 * piston.bath.axes)
    return 0.5 * math.sqrt(2.0 * spread * span) * normal


@subflow_body(Rescale)
def c_rescale(parts, t, x, v, span, step, stage):
    piston = parts.piston
    state, groups = piston.state, piston.sizes.size
    found = piston.room[4:7]
    heat = pressures(piston, v, found)
    add_motion_within(piston.molecules, piston, x, v, found)
    if stage == PROPOSE:
        draw(parts.places, parts.noise, step, piston.bath.seed)
        piston.room[0] = piston.sums[0] + heat
        factors = piston.room[1:4]
        q = math.sqrt(volume(piston))
        for a in range(groups):
            push = half_push(parts, a, found[a], span)
            if state[BEGUN] == 0.0:
                state[a] = half_noise(parts, a, parts.noise[1, a], span) + push
            new = half_noise(parts, a, parts.noise[0, a], span)
            ratio = (q + state[a] + push + new) / q
            if not (1.0 / MOST < ratio * ratio < MOST):
                piston.trouble[0], piston.trouble[1] = TOO_FAST, ratio * ratio
                return STOPPED
            q *= ratio
            state[a] = new
            factors[a] = ratio ** (2.0 / piston.sizes[a])
        return stretch(piston, x, v, factors)
    for a in range(groups):
        state[a] += half_push(parts, a, found[a], span)
    state[BEGUN] = 1.0
    piston.work[0] += piston.sums[0] + heat - piston.room[0]
    return OK


def action(piston: Piston, options: Options) -> BoundSubflow:
    """Return the barostat of a run."""
    rate = float(options[COMPRESSIBILITY.name] / options[PRESSURE_TAU.name])
    return BoundSubflow(Rescale(piston, rate, np.arange(8), np.zeros((2, 8))))
