"""The barostat of Martyna, Tobias & Klein for a box that changes its shape.

Martyna, Tobias & Klein 1994, J. Chem. Phys. 101, 4177, doi:10.1063/1.467468; Martyna et al. 1996,
doi:10.1080/00268979600100761; Yu et al. 2010, Chem. Phys. 370, 294, doi:10.1016/j.chemphys.2010.02.014. For a symmetric
strain rate u (see `shape`), edge vectors h' = h u, and f degrees of freedom in d dimensions

x' = v + x u,   v' = F / m - v u - (tr u / f) v,   W u' = V (p - P) + 2 K / f

with the mass W = (f + d) k_B T tau^2 / d of each of the d (d + 1) / 2 parts. Conserved is the energy of the particles,
P V + H, W tr(u^2) / 2 and the energy of both chains. The flows are in the order of `mtk`, and each is exact.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from kickdrift.forces.seam.kernel import OK
from kickdrift.integrators.options import PRESSURE_TAU
from kickdrift.integrators.splitting.barostats.mtk import PUSH, STRETCH, THERMOSTAT, Turns, freedom_of, turn
from kickdrift.integrators.splitting.barostats.piston import slow_centres, volume
from kickdrift.integrators.splitting.barostats.shape import (
    BEGUN,
    FOUND,
    START,
    STRAIN,
    TURN,
    WANTED,
    Shape,
    box_energy,
    choose_edges,
    pressure_tensor,
    strain,
    turn_tensor,
    wanted_pressure,
)
from kickdrift.integrators.splitting.baths.nose_hoover import STEPS, Chain, chain_energy, chain_step
from kickdrift.integrators.stepping.subflow_code import BoundSubflow, subflow_body
from kickdrift.jit.compile import strict

if TYPE_CHECKING:
    from kickdrift.integrators.options import Options


class ShapePush(NamedTuple):
    """The force on the box."""

    shape: Shape
    mass: float
    turns: Turns


class ShapeStretch(NamedTuple):
    """The motion of the box with its particles."""

    shape: Shape


class ShapeChain(NamedTuple):
    """The thermostats of the box."""

    shape: Shape
    mass: float
    chain: Chain


@subflow_body(ShapePush)
def shape_push(parts, t, x, v, span, step, stage):
    shape, piston, steps = parts.shape, parts.shape.piston, turn(parts.turns, step, stage)
    if steps == 0.0:
        return OK
    axes, v_now = piston.bath.axes, volume(piston)
    per_freedom = 2.0 * pressure_tensor(shape, x, v) / freedom_of(piston)
    wanted_pressure(shape)
    found, wanted = shape.room[FOUND], shape.room[WANTED]
    for i in range(axes):
        for j in range(axes):
            push = v_now * (found[i, j] - wanted[i, j]) + (per_freedom if i == j else 0.0)
            shape.state[i, j] += steps * span * push / parts.mass
    return OK


@subflow_body(ShapeStretch)
def shape_stretch(parts, t, x, v, span, step, stage):
    shape, piston, trace = parts.shape, parts.shape.piston, 0.0
    for i in range(3):
        trace += shape.state[i, i]
        for j in range(3):
            shape.room[STRAIN, i, j] = span * shape.state[i, j]
    status = strain(shape, x, v)
    if status == OK:
        turn_tensor(shape.room[TURN], shape.state)
        status = choose_edges(shape)
        slow_centres(piston.molecules, piston, v, math.exp(-span * trace / freedom_of(piston)))
    return status


@strict
def shape_kinetic(shape, mass):
    """Kinetic energy of the box."""
    total = 0.0
    for i in range(3):
        for j in range(3):
            total += 0.5 * mass * shape.state[i, j] * shape.state[i, j]
    return total


@subflow_body(ShapeChain)
def shape_chain(parts, t, x, v, span, step, stage):
    shape, chain, factor = parts.shape, parts.chain, 1.0
    energy = shape_kinetic(shape, parts.mass)
    for k in range(chain.steps.size):
        factor *= chain_step(chain, energy * factor * factor, chain.steps[k] * span)
    for i in range(3):
        for j in range(3):
            shape.state[i, j] *= factor
    if shape.notes[BEGUN] == 0.0:
        shape.notes[BEGUN], shape.notes[START] = 1.0, box_energy(shape)
    box = box_energy(shape) + shape_kinetic(shape, parts.mass) + chain_energy(chain)
    shape.piston.work[0] = shape.notes[START] - box
    return OK


def flows(shape: Shape, options: Options, turns: Turns) -> dict[str, BoundSubflow]:
    """Return the flows of the box in a run, by letter; the box is at rest at the start."""
    bath, tau = shape.piston.bath, float(options[PRESSURE_TAU.name])
    mass = (freedom_of.py_func(shape.piston) + bath.axes) / bath.axes * bath.thermal * tau**2
    count = bath.axes * (bath.axes + 1) // 2
    of_chain = np.full(int(options["chain"]), bath.thermal * tau**2)
    of_chain[0] *= count
    own = bath._replace(freedom=float(count), heat=np.zeros(1))
    chain = Chain(own, of_chain, np.array(STEPS), np.zeros((2, len(of_chain))))
    return {
        STRETCH: BoundSubflow(ShapeStretch(shape)),
        PUSH: BoundSubflow(ShapePush(shape, mass, turns)),
        THERMOSTAT: BoundSubflow(ShapeChain(shape, mass, chain)),
    }
