"""Ramps: a temperature or a pressure that changes linearly in time over the steps of a run.

A ramp is a stair of many short parts, each at the value of its middle. The part of a step follows from the number of
the step, so the bits of a run do not depend on how the run is cut, and a resumed run has the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from kickdrift.errors import InputError
from kickdrift.integrators.options import RAMP_STEPS, RAMPED, Options

STAIRS = 500  # most parts of a ramp


@dataclass(frozen=True)
class Ramp:
    """Values that change over the steps 0 to ``steps`` of a run, and stay from then on.

    Attributes
    ----------
    ends : the values at both ends, by name of the option
    steps : length of the ramp; None as long as it is unknown
    """

    ends: dict[str, tuple[float, float]]
    steps: int | None

    @classmethod
    def of(cls, options: Options) -> Ramp | None:
        """The ramp of a run with these options; None without one. Raises InputError for an end without a start."""
        ends = {}
        for name, to in RAMPED.items():
            if (end := options.get(to)) is not None:
                if (start := options.get(name)) is None:
                    raise InputError(f"{to}: is the end of a ramp, which needs {name} at its start")
                ends[name] = (start, end)
        if not ends and options.get(RAMP_STEPS.name) is not None:
            raise InputError(f"{RAMP_STEPS.name}: is the length of a ramp; give {' or '.join(RAMPED.values())} too")
        return cls(ends, options.get(RAMP_STEPS.name)) if ends else None

    def begin(self, stepper: Any, steps: int) -> int:
        """Give a stepper the values of its next step. Return how many of the next ``steps`` steps have these values.

        Steps before 0 are those of an equilibration, which has its own temperature."""
        done = stepper.steps_done
        if done < 0:
            return steps
        count = self.steps
        if count is None:
            raise InputError(
                f"{RAMP_STEPS.name} is needed: a ramp is as long as the run, and advance() does not know that length"
            )
        if done >= count:
            stepper.go_to({name: end for name, (_, end) in self.ends.items()})
            return steps
        stairs = min(STAIRS, count)
        part = ((done + 1) * stairs - 1) // count
        first, last = count * part // stairs, count * (part + 1) // stairs
        middle = 0.5 * (first + last) / count
        stepper.go_to({name: start + (end - start) * middle for name, (start, end) in self.ends.items()})
        return min(steps, last - done)
