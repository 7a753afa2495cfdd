"""Steppers: integrations in progress, with the same methods for every integrator.

A stepper has ``y`` and ``time``, its last step point; ``last_step``, the length of the step to this point (0 before an
adaptive method's first); ``steps_done``, the step points passed since the start; and ``counts``. ``advance`` takes
steps. ``at`` returns y between the last two step points without changing anything. ``memory`` holds the state that
determines the next step's bits. ``recall`` puts a new stepper, for example in another process, into that state.

Some steppers have ``sketch``: states (INNER, *y.shape) inside the last step, roughly and without evaluating f.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from kickdrift.model.memory import Memory
from kickdrift.model.state import Floats

INNER = np.array([0.11, 0.37, 0.62, 0.93])  # parts of a step, without symmetry: few oscillations look constant there
STOPPED = 3  # besides the forces' OK, GROW and BLOWN_UP: the method itself cannot continue, for the reason ``trouble``


@dataclass
class Counts:
    """Cost of an integration so far."""

    evaluations: int = 0
    rejected: int = 0
    jacobians: int = 0

    def __sub__(self, before: Counts) -> Counts:
        rejected, jacobians = self.rejected - before.rejected, self.jacobians - before.jacobians
        return Counts(self.evaluations - before.evaluations, rejected, jacobians)


class Stepper(Protocol):
    """Integration in progress.

    Steppers with steps of different lengths also have ``end``: they evaluate f at no later time. ``advance`` then stops
    before the first step beyond the end. With ``clip`` that step is cut off at ``end`` instead.
    """

    y: Floats
    steps_done: int
    trouble: str

    @property
    def time(self) -> float:
        """Time of the last step point."""

    @property
    def last_step(self) -> float:
        """Length of the step to the last step point; 0 if there was none."""

    @property
    def counts(self) -> Counts:
        """Cost since the stepper was made."""

    def reset(self, y: Floats, time: float, steps: int) -> None:
        """Start anew at y."""

    def advance(self, steps: int, until: float) -> int:
        """Take this many steps, or fewer if a step point reaches ``until``. Return a status."""

    def at(self, time: float) -> Floats:
        """Copy of y at a time between the last two step points."""

    def reached(self, inside_step: bool) -> tuple[Floats, Floats]:
        """After a blow-up inside a step or in the last one: the y reached, and the positions before."""

    def memory(self) -> Memory:
        """Copies of the state, at the last step point, that determines the next step's bits."""

    def recall(self, memory: Memory) -> None:
        """Restore the state of a stepper of the same method, options and bodies from its memory."""
