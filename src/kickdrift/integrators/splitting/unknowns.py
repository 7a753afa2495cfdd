"""Unknowns beside the bodies as a flow of splitting words: they advance while the bodies rest."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

from kickdrift.forces.beside.unknowns_kernel import step_at_rest
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
