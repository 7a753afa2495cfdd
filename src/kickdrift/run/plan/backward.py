"""Checks of runs that go back in time."""

from __future__ import annotations

from typing import TYPE_CHECKING

from kickdrift.errors import InputError
from kickdrift.integrators.stepping.backward import mirrored

if TYPE_CHECKING:
    from kickdrift.run.plan.lengths import Planned


def check_backward(sim: Planned) -> None:
    """Refuse a run backwards in time where method, engine, events or a force cannot go back; names which."""
    run, method = sim.integration, sim.method
    if not (method.reversible or method.chooses_steps):
        raise InputError(
            f"run: {sim.integrator} is neither reversible nor adaptive, so the run cannot go back in time; "
            "velocity-verlet and dop853 can"
        )
    if run.foreign:
        raise InputError(f"run: engine {run.engine.name!r} runs forwards in time only; the native engine goes back")
    if run.events:
        raise InputError("run: events are watched forwards in time only; a run back in time takes no events")
    mirrored(run.system)
