"""Stochastic cell rescaling of a box that changes its shape.

Del Tatto, Raiteri, Bernetti & Bussi 2022, Appl. Sci. 12, 1139, doi:10.3390/app12031139. In d dimensions the edges obey

dh = h ((b / d tau) (p - P + k_B T / V) dt + sqrt(2 k_B T b / d V tau) dW)

for the compressibility b, the pressure tensor p, the wanted pressure tensor P, and a matrix W of independent noise. Its
antisymmetric part turns the frame alone, so it is left out. The symmetric strain S acts by h exp(S) (see `shape`). Its
steps are those of sqrt(V) S, whose noise is the same at every volume. Half the trace is the step of sqrt(V), as in
`c_rescale`, with the term k_B T / 2 V of that variable. Half the noise and half the push come before the change.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.seam.kernel import OK
from kickdrift.integrators.options import COMPRESSIBILITY, PRESSURE_TAU, Options
from kickdrift.integrators.splitting.barostats.c_rescale import draw
from kickdrift.integrators.splitting.barostats.piston import MOST, STOPPED, TOO_FAST, volume
from kickdrift.integrators.splitting.barostats.shape import (
    BEGUN,
    FOUND,
    KEPT,
    NEW,
    STRAIN,
    TURN,
    WANTED,
    Shape,
    choose_edges,
    pressure_tensor,
    strain,
    turn_tensor,
    wanted_pressure,
)
from kickdrift.integrators.stepping.subflow_code import PROPOSE, BoundSubflow, subflow_body
from kickdrift.jit.compile import strict
from kickdrift.model.state import Floats


class RescaleShape(NamedTuple):
    """Numbers of the barostat in compiled code."""

    shape: Shape
    rate: float  # compressibility over time constant
    places: NDArray[np.int64]  # (8,) numbers of the draws
    noise: Floats  # (2, 8) normal numbers


@strict
def fill_noise(parts, row, span, target):
    """target <- half the noise of sqrt(V) S in the time ``span``."""
    bath, normal = parts.shape.piston.bath, parts.noise[row]
    size = 0.5 * math.sqrt(2.0 * bath.thermal * parts.rate * span / bath.axes)
    for i in range(3):
        for j in range(i, 3):
            there, side = j < bath.axes, 6 - i - j  # 3, 4 and 5 of yz, xz and xy
            one = normal[i] if i == j else math.sqrt(0.5) * normal[side]
            target[i, j] = target[j, i] = size * one if there else 0.0


@strict
def add_push(parts, span, target):
    """Add half the change of sqrt(V) S that the pressure causes in the time ``span``."""
    shape, piston = parts.shape, parts.shape.piston
    root, axes = math.sqrt(volume(piston)), piston.bath.axes
    wanted_pressure(shape)
    found, wanted = shape.room[FOUND], shape.room[WANTED]
    half = 0.5 * span * parts.rate / axes
    for i in range(axes):
        for j in range(axes):
            target[i, j] += half * root * (found[i, j] - wanted[i, j])
        target[i, i] += 0.5 * half * piston.bath.thermal / root


@strict
def fill_strain(shape, step):
    """Fill STRAIN with the change for a step of sqrt(V) S, whose trace changes sqrt(V) alone; return the factor of the
    volume."""
    axes, root = shape.piston.bath.axes, math.sqrt(volume(shape.piston))
    trace = 0.0
    for k in range(axes):
        trace += step[k, k]
    ratio = (root + 0.5 * trace) / root
    if not ratio > 0.0:
        return ratio
    between, each = root * math.sqrt(ratio), 2.0 * math.log(ratio) / axes
    for i in range(3):
        for j in range(3):
            shape.room[STRAIN, i, j] = step[i, j] / between
        if i < axes:
            shape.room[STRAIN, i, i] = (step[i, i] - trace / axes) / between + each
    return ratio * ratio


@subflow_body(RescaleShape)
def c_rescale_shape(parts, t, x, v, span, step, stage):
    shape, piston = parts.shape, parts.shape.piston
    state, new, whole = shape.state, shape.room[NEW], shape.room[KEPT]
    heat = pressure_tensor(shape, x, v)
    if stage == PROPOSE:
        draw(parts.places, parts.noise, step, piston.bath.seed)
        piston.room[0] = piston.sums[0] + heat
        if shape.notes[BEGUN] == 0.0:
            fill_noise(parts, 1, span, state)
            add_push(parts, span, state)
        add_push(parts, span, state)
        fill_noise(parts, 0, span, new)
        for i in range(3):
            for j in range(3):
                whole[i, j] = state[i, j] + new[i, j]
        factor = fill_strain(shape, whole)
        if not 1.0 / MOST < factor < MOST:
            piston.trouble[0], piston.trouble[1] = TOO_FAST, factor
            return STOPPED
        status = strain(shape, x, v)
        if status == OK:
            turn_tensor(shape.room[TURN], new)
            for i in range(3):
                for j in range(3):
                    state[i, j] = new[i, j]
        return status
    add_push(parts, span, state)
    shape.notes[BEGUN] = 1.0
    piston.work[0] += piston.sums[0] + heat - piston.room[0]
    return choose_edges(shape)


def action(shape: Shape, options: Options) -> BoundSubflow:
    """Return the barostat of a run."""
    rate = float(options[COMPRESSIBILITY.name] / options[PRESSURE_TAU.name])
    return BoundSubflow(RescaleShape(shape, rate, np.arange(8), np.zeros((2, 8))))
