"""Monte Carlo moves of a box that changes its shape.

A move strains the box by a symmetric S (see `shape`): in half of the moves by its trace, which is the move of
`monte_carlo`, in the others by the five parts without trace (two in a plane), which are normal numbers. No direction is
favoured, and S is as likely as -S, so each move is as likely as its reverse. It is accepted with the probability

min(1, exp(-(dU + P dV + dH) / k_B T + (f / d + 1) ln(V' / V))).

Velocities stay: their distribution depends neither on the shape nor on the frame. Molecules with constraints turn with
the frame, and so does the motion within them; f / d is their number.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.integrators.options import COMPRESSIBILITY, Options
from kickdrift.integrators.splitting.barostats import c_rescale
from kickdrift.integrators.splitting.barostats.monte_carlo import ACCEPTED, TRIED, WIDEST, draw, keep
from kickdrift.integrators.splitting.barostats.piston import volume
from kickdrift.integrators.splitting.barostats.shape import (
    LARGEST,
    STRAIN,
    TURN,
    Shape,
    box_energy,
    choose_edges,
    norm,
    strain,
    turn_motion,
)
from kickdrift.integrators.stepping.subflow_code import PROPOSE, TAKEN_BACK, BoundSubflow, subflow_body
from kickdrift.model.state import Floats

OF_SHAPE = 0.5  # standard deviation of each part without trace over the thermal spread of ln V


class ShapeMoves(NamedTuple):
    """Numbers of the barostat in compiled code."""

    shape: Shape
    most: float  # largest change of the logarithm of the volume
    places: NDArray[np.int64]  # (8,) numbers of the draws of even numbers
    further: NDArray[np.int64]  # (8,) numbers of the draws of normal numbers
    noise: Floats  # (3, 8) numbers between 0 and 1
    normals: Floats  # (2, 8)
    before: Floats  # (3, n) positions before a move
    lengths: Floats  # (6,) edges before a move
    sums: Floats  # (3,) the piston's sums before a move


@subflow_body(ShapeMoves)
def monte_carlo_shape(parts, t, x, v, span, step, stage):
    shape, piston = parts.shape, parts.shape.piston
    axes, s, seed = piston.bath.axes, shape.room[STRAIN], piston.bath.seed
    draw(parts.places, parts.noise, step, seed)
    of_volume = parts.noise[0, 0] < 0.5
    change = parts.most * (2.0 * parts.noise[1, 0] - 1.0) if of_volume else 0.0
    if stage == PROPOSE:
        keep(x, parts.before)
        for k in range(6):
            parts.lengths[k] = piston.lengths[k]
        for k in range(3):
            parts.sums[k] = piston.sums[k]
        piston.room[0], piston.room[1] = volume(piston), box_energy(shape)
        c_rescale.draw(parts.further, parts.normals, step, seed)
        size, trace = OF_SHAPE * parts.most / WIDEST, 0.0
        for k in range(axes):
            trace += parts.normals[0, k]
        for i in range(3):
            for j in range(i, 3):
                one = parts.normals[0, i] - trace / axes if i == j else math.sqrt(0.5) * parts.normals[0, 6 - i - j]
                s[i, j] = s[j, i] = 0.0 if of_volume or j >= axes else size * one
            if of_volume and i < axes:
                s[i, i] = change / axes
        if norm(s) > LARGEST:  # far out in the tail: no move
            for i in range(3):
                for j in range(3):
                    s[i, j] = 0.0
        return strain(shape, x, None)
    state = piston.state
    got, particles = piston.sums[0] - parts.sums[0], piston.centres
    cost = (got + box_energy(shape) - piston.room[1]) / piston.bath.thermal
    cost -= (particles + 1.0) * math.log(volume(piston) / piston.room[0])
    state[TRIED] += 1.0
    if math.log(parts.noise[2, 0]) < -cost:
        state[ACCEPTED] += 1.0
        piston.work[0] += got
        turn_motion(piston.molecules, piston, v, shape.room[TURN])
        return choose_edges(shape)
    keep(parts.before, x)
    for k in range(6):
        piston.lengths[k] = parts.lengths[k]
    for k in range(3):
        piston.sums[k] = parts.sums[k]
    return TAKEN_BACK


def action(shape: Shape, options: Options, particles: int) -> BoundSubflow:
    """Return the barostat of a run; the changes of volume are those of `monte_carlo`."""
    piston = shape.piston
    start = volume.py_func(piston)
    most = WIDEST * math.sqrt(piston.bath.thermal * options[COMPRESSIBILITY.name] / start)
    return BoundSubflow(
        ShapeMoves(
            shape, most, np.arange(8), np.arange(8) + 8, np.zeros((3, 8)), np.zeros((2, 8)), np.zeros((3, particles)),
            np.zeros(6), np.zeros(3),
        )
    )  # fmt: skip
