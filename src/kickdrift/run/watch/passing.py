"""Least distances of pairs that attract each other so much in a step that the step's own end tells little of them.

Such a passage is followed by gauss-radau15, beside the run and from the step in which it begins, until the pair is far
again. The run itself goes on by its own steps.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kickdrift.errors import RunError
from kickdrift.model.memory import Memory
from kickdrift.model.state import Floats
from kickdrift.run.watch.distances import Approaches
from kickdrift.run.watch.span import Part
from kickdrift.run.watch.trials import Trials, Watched


class Passing:
    """Passages beside a run."""

    def __init__(self, run: Watched, approaches: Sequence[Approaches]) -> None:
        self._approaches = approaches
        logs = any(each.event.action == "log" for each in approaches)  # a stop needs no least distance
        self._on = logs and not run.method.adaptive
        self.forget()

    def forget(self) -> None:
        """Forget the passage under way."""
        self._y: Floats | None = None
        self._time = -np.inf

    def parts(self, trials: Trials, found_in: list[Part]) -> list[Part]:
        """The parts in which a step is searched for passages: those of the step, or those of the motion beside it."""
        if not self._on:
            return found_in
        y, begin, end = found_in[0].y0, found_in[0].t0, found_in[-1].t1
        beside = self._y is not None and self._time == begin  # until the pair has left in the run too
        here, y = y, self._y if beside and self._y is not None else y
        for each in self._approaches:
            if each.bends(y, end - begin) or (beside and each.bends(here, end - begin, inside=True)):
                break
        else:
            self._y = None
            return found_in
        try:
            parts = trials.parts(y, begin, end)
        except RunError:
            self.forget()
            return found_in
        self._y, self._time = parts[-1].y1, end
        return parts

    @property
    def states(self) -> list[Floats]:
        """State of the bodies beside the run, if there is a passage."""
        return [] if self._y is None else [self._y]

    def memory(self) -> Memory:
        """State of the bodies beside the run, and its time."""
        return {"y": self._y, "time": self._time}

    def recall(self, memory: Memory) -> None:
        """Restore this state."""
        self._y, self._time = memory["y"], memory["time"]
