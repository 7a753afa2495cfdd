"""The flow D: Andersen's collisions. In a time h each particle gets a new velocity with probability 1 - exp(-rate h).

Andersen 1980, J. Chem. Phys. 72, 2384, doi:10.1063/1.439486. New velocities are Maxwell's.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from kickdrift.forces.seam.kernel import OK
from kickdrift.integrators.options.option import RATE, TEMPERATURE
from kickdrift.integrators.splitting.baths.bath import Bathed, bathed
from kickdrift.integrators.splitting.baths.velocity_noise import Draw, shake
from kickdrift.integrators.stepping.subflow_code import BoundSubflow, subflow_body
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.options.options import Options


class Collisions(NamedTuple):
    """Numbers of the flow in compiled code."""

    bath: Bathed
    rate: float


@subflow_body(Collisions)
def andersen(parts, t, x, v, span, step, stage):
    shake(parts.bath, v, 0.0, 1.0, -math.expm1(-parts.rate * span), Draw(step, stage, 1.0, 0.0))
    return OK


def bind(flow: Flow, options: Options, weights: Floats) -> BoundSubflow:
    """Return the flow for the particles of a run."""
    return BoundSubflow(
        Collisions(bathed(flow, options, (TEMPERATURE, RATE), conserving=False), float(options.collision_rate))
    )
