"""Flows of friction and noise: v <- c v + sqrt(1 - c^2) sqrt(k_B T / m) R, R standard normal numbers.

Each keeps Maxwell's distribution for every step. For a friction g and a time h they differ in c:

- O, the Ornstein-Uhlenbeck process, exact in distribution: c = exp(-g h) (Uhlenbeck & Ornstein 1930,
  doi:10.1103/PhysRev.36.823);
- G, the same by the rule of the midpoint: c = (1 - g h / 2) / (1 + g h / 2). A step of BAGAB is the method of
  Gronbech-Jensen & Farago 2013, doi:10.1080/00268976.2012.760055, with the velocity at the step's end;
- M, velocities drawn anew from Maxwell's distribution: c = 0, the limit of large friction.

Under noise="refine" the halves of O are tied by its own bridge, the halves of G and M by that of Brownian motion.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.seam.kernel import OK
from kickdrift.integrators.options.option import FRICTION, NOISE, REFINE, TEMPERATURE
from kickdrift.integrators.splitting.baths.bath import Bathed, bathed
from kickdrift.integrators.splitting.baths.velocity_noise import bridges, drawn, shake
from kickdrift.integrators.stepping.subflow_code import BoundSubflow, subflow_body
from kickdrift.jit.compile import as_written
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.options.options import Options

EXACT, MIDPOINT, ANEW = 0, 1, 2  # rules for c
RULES = {"O": EXACT, "G": MIDPOINT, "M": ANEW}


class Friction(NamedTuple):
    """Numbers of the flow in compiled code."""

    bath: Bathed
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
    shake(parts.bath, v, kept, noise, 1.0, draw)
    return OK


def bind(letter: str, flow: Flow, options: Options, weights: Floats) -> BoundSubflow:
    """Return the flow of that letter for the particles of a run."""
    bath = bathed(flow, options, (TEMPERATURE, FRICTION), conserving=False)
    table = bridges(weights) if options.get(NOISE.name) == REFINE else np.zeros((2, 0, 2), np.int64)
    return BoundSubflow(Friction(bath, float(options.friction), RULES[letter], table))
