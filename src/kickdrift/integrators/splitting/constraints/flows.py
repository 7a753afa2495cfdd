"""Constraints in splitting words: the flows that keep velocities and drifts on their manifold, and where they act.

Each drift becomes a step along the manifold (geodesic integration: RATTLE without forces). First the velocities are
*aimed*, so that the drift ends on the manifold. After it they are *projected* on the tangent space, at the latest where
a flow or the end of the step needs them there. Kicks need no projection of their own, because a part of the velocity
along the gradients changes neither the next drift nor the next projection. A bath that draws velocities is projected at
once, and the energy counts as heat (g-BAOAB of Leimkuhler & Matthews 2016, Proc. R. Soc. A 472, 20160138,
doi:10.1098/rspa.2016.0138). Baths that scale velocities keep them tangent.

A step along the manifold is symmetric and of order 2. So a word keeps its order if that is 2 at most, or if the word is
a row of symmetric steps with one drift each.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from kickdrift.forces.seam.kernel import OK
from kickdrift.integrators.splitting.constraints.blocks import Held, held
from kickdrift.integrators.splitting.constraints.solver import Moving
from kickdrift.integrators.splitting.subflows import DRIFT, FLOWS, KICK
from kickdrift.integrators.stepping.stepper import STOPPED
from kickdrift.integrators.stepping.subflow_code import BoundSubflow, subflow_body
from kickdrift.jit.handle import handle
from kickdrift.jit.threads.chunks import each_chunk
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow

AIM, PROJECT, TEMPER = "a", "p", "h"  # letters: before a drift, of velocities, of a bath's velocities


class Aim(NamedTuple):
    """Numbers of the flow before a drift."""

    held: Held


class Projection(NamedTuple):
    """Numbers of a projection. ``heat`` (1,) gets the energy of a bath's velocities."""

    held: Held
    heat: Floats


@subflow_body(Aim)
def aim(parts, t, x, v, span, step, stage):
    each_chunk(handle(Moving(parts.held, x, v, span)), parts.held.chunks, "aim_chunk")
    for b in range(parts.held.failed.size):
        if parts.held.failed[b]:
            return STOPPED
    return OK


@subflow_body(Projection)
def project(parts, t, x, v, span, step, stage):
    each_chunk(handle(Moving(parts.held, x, v, span)), parts.held.chunks, "project_chunk")
    for b in range(parts.held.gained.size):
        parts.heat[0] += parts.held.gained[b]
    return OK


class Manifold:
    """The constraints of one run.

    Attributes
    ----------
    flows : flows that they add to the word of the method, in the order of ``letters``
    """

    letters = (AIM, PROJECT, TEMPER)

    def __init__(self, flow: Flow, heat: Floats) -> None:
        system: Any = flow.subject
        self._held = held(system.constraints, system.coherent_masses, flow.forces.threads)
        parts = Aim(self._held), Projection(self._held, np.zeros(1)), Projection(self._held, heat)
        self.flows = [BoundSubflow(each).ready() for each in parts]

    @property
    def trouble(self) -> str:
        """Why a solution stopped; "" if none did."""
        if not (failed := np.flatnonzero(self._held.failed)).size:
            return ""
        row = self._held.first[failed[0]]
        i, j = int(self._held.one[row, 0]), int(self._held.other[row, 0])
        return (
            f"the constraints near the one of particles {i} and {j} have no solution, because a molecule turned too "
            "far in one step; take a shorter dt"
        )


def on_manifold(
    letters: Sequence[str], weights: Sequence[float], passing: Sequence[str] = ()
) -> tuple[tuple[str, ...], tuple[float, ...]]:
    """Letters and weights of a word with the flows of constraints. The flows ``passing`` change neither the shape of
    molecules nor the motion within them, so velocities need no projection before or after these."""
    found: list[tuple[str, float]] = []
    tangent, last = True, 1.0
    for letter, weight in zip(letters, weights, strict=True):
        if not weight:
            continue
        if letter in passing:
            found.append((letter, weight))
            continue
        if letter == DRIFT:
            found.append((AIM, weight))
        elif letter[0] != KICK and not tangent:
            found.append((PROJECT, last))
            tangent = True
        found.append((letter, weight))
        if letter[0] in (DRIFT, KICK):
            tangent = False
        elif FLOWS[letter].drags:
            found.append((TEMPER, weight))
        last = weight
    if not tangent:
        found.append((PROJECT, last))
    return tuple(letter for letter, _ in found), tuple(weight for _, weight in found)
