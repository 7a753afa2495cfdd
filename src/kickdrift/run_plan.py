"""How far one call of ``Simulation.run`` goes, and where it stops to look."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from kickdrift.simulation import Simulation

NEVER = 2**62


@dataclass(frozen=True)
class Plan:
    """Go on to step ``end_step`` or time ``end_time``, whichever comes first, and look every so many steps or so much
    time.

    Looks ``interval`` apart are at these very times where ``exact``, else at the first step point from there on.
    """

    begin_step: int
    begin_time: float
    end_step: int = NEVER
    end_time: float = np.inf
    every: int = 0
    interval: float = 0.0
    exact: bool = False

    def over(self, sim: Simulation) -> bool:
        """Whether the run has come to its end."""
        return sim.steps_done >= self.end_step or sim.time >= self.end_time

    def next_stop(self, sim: Simulation) -> tuple[int, float]:
        """The next step number and time to stop at, whichever comes first."""
        step, time = self.end_step, self.end_time
        if self.every:
            step = min(step, (sim.steps_done // self.every + 1) * self.every)
        if self.interval:
            passed = np.floor((sim.time - self.begin_time) / self.interval * (1 + 1e-15))
            ahead = self.begin_time + (passed + 1) * self.interval
            while ahead <= sim.time:
                passed += 1
                ahead = self.begin_time + (passed + 1) * self.interval
            if ahead < self.end_time * (1 - 1e-15):
                time = ahead
        return step, time

    def present(self, step_point: float, stop_time: float) -> float | None:
        """The time to look at, where that lies before the step point reached; None for the step point itself."""
        present = stop_time if self.exact else self.end_time
        return present if step_point > present else None

    def progress(self, sim: Simulation) -> tuple[int, int]:
        """Done, and of how much."""
        if self.end_step < NEVER:
            return sim.steps_done - self.begin_step, self.end_step - self.begin_step
        done = (sim.time - self.begin_time) / (self.end_time - self.begin_time)
        return min(1000, int(1000 * done)), 1000
