"""Integration of hard spheres: positions and velocities at step points, and totals of the hits."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from kickdrift.integrators.event_driven.loop import (
    HITS,
    PUSHED,
    TAKEN,
    TURNED,
    VIRIAL,
    WALL_HITS,
    desk_of,
    hits_loop,
)
from kickdrift.integrators.event_driven.spheres import spheres_of
from kickdrift.integrators.stepping.stepper import STOPPED
from kickdrift.integrators.stepping.stepping import FixedStepper
from kickdrift.looks.observers import NOTHING, Hits, Taken
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.options import Options


class EventDrivenStepper(FixedStepper):
    """Steps from hit to hit. Only the totals of the hits are carried from step to step."""

    saved: ClassVar[tuple[str, ...]] = ("_start", "_cursor", "_totals", "_from")
    steady = False  # a look takes the pressure since the look before, so each look is alone

    def __init__(self, flow: Flow, options: Options) -> None:
        system: Any = flow.subject
        spheres = spheres_of(system.events[0], system)
        desk = desk_of(spheres)
        flow.count_hits()  # type: ignore[union-attr]
        self._totals, self._losing = desk.totals, bool(system.forces) or spheres.restitution != (1.0, 0.0, 0.0)
        super().__init__(flow, hits_loop, (spheres, desk), lambda shape: np.zeros((0, *shape[1:])), options, kept=False)

    def reset(self, y: Floats, time: float, steps: int) -> None:
        """See Stepper."""
        super().reset(y, time, steps)
        self._totals[:], self._from = 0.0, steps
        self.trouble = ""

    def advance(self, steps: int, until: float = np.inf) -> int:
        """See Stepper."""
        status = super().advance(steps, until)
        if status == STOPPED:
            self.trouble = (
                "too many hits at one time: spheres come to rest on each other, or walls squeeze them, which bounces "
                "cannot describe; elastic_below is a speed under which bounces are elastic"
            )
        return status

    @property
    def hits(self) -> Hits:
        """The hits since the start."""
        totals = self._totals
        return Hits(
            self.time,
            (self.steps_done - self._from) * self.dt,
            int(totals[HITS]),
            int(totals[WALL_HITS]),
            float(totals[VIRIAL]),
        )

    @property
    def taken(self) -> Taken:
        """What hits have taken since the start."""
        if not self._losing:
            return NOTHING
        totals = self._totals
        return Taken(float(totals[TAKEN]), totals[PUSHED:TURNED].copy(), totals[TURNED:].copy())
