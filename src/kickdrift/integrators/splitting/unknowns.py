"""Unknowns beside the bodies as a flow of splitting words: they advance while the bodies rest."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from kickdrift.forces.beside.unknowns_kernel import step_at_rest
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.forces.seam.kernel import OK
from kickdrift.integrators.stepping.subflow_code import BoundSubflow, subflow_body
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.options import Options


class AtRest(NamedTuple):
    """The unknowns of a run, see `forces.beside.unknowns_kernel`."""

    unknowns: Any


def bind(flow: Flow, options: Options, weights: Floats) -> BoundSubflow:
    """Bind the unknowns of a flow, which are then no longer part of its derivative."""
    return BoundSubflow(AtRest(flow.carried()))  # type: ignore[union-attr]


@subflow_body(AtRest)
def advance_unknowns(parts, t, x, v, span, step, stage):
    step_at_rest(parts.unknowns, t, x, v, span)
    return OK


class Held(BoundSubflow):
    """Unknowns that a method keeps beside its own coordinates of the bodies."""

    def hold(self, y: Floats) -> None:
        """Go on from the unknowns of y."""
        own = self.parts.unknowns
        own.held[:] = y[1, 0, own.begin :]

    def joined(self, bodies: Floats) -> Floats:
        """y of the bodies (2, 3, n) and the unknowns."""
        own = self.parts.unknowns
        y = np.zeros((2, 3, own.begin + len(own.held)))
        y[:, :, : own.begin], y[1, 0, own.begin :] = bodies, own.held
        return y


def unknowns_of(forces: BoundForces) -> Held | None:
    """The unknowns of forces that were bound to the bodies alone, ready to advance by themselves; None without any."""
    laws = (getattr(force.parts, "law", None) for force in forces.forces)
    law = next((each for each in laws if hasattr(each, "held")), None)
    if law is None:
        return None
    forces.compile()
    return Held(AtRest(law)).ready()
