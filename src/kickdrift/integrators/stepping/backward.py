"""Integration backwards in time: the same methods on the mirrored motion.

With s = -t, the motion (x, v) at t becomes (x, -v) at s. Its forces are the same if they depend on positions alone. So
a step forwards of the mirrored motion is a step backwards of the motion, for every method and with the method's own
code. A solution y of y' = f(t, y) becomes the solution of y' = -f(-s, y).
"""

from collections.abc import Callable
from copy import copy
from typing import Any

import numpy as np

from kickdrift.errors import InputError
from kickdrift.integrators.flows.particle_flow import clocked
from kickdrift.integrators.stepping.stepper import Counts
from kickdrift.model.memory import Memory
from kickdrift.model.problem import Partial, Problem
from kickdrift.model.state import Floats, read_only
from kickdrift.model.system import System


def mirrored(subject: Any) -> Any:
    """Return the System or the Problem of the mirrored motion; an InputError names a force that has no mirror image."""
    if isinstance(subject, Problem):
        return _mirrored_problem(subject)
    system: System = subject
    return system.under([_mirrored_force(force) for force in system.forces])


def _mirrored_force(force: Any) -> Any:
    """The force of the mirrored motion: what the force itself gives as ``reversed()``, or the same force."""
    if callable(getattr(force, "reversed", None)):
        return force.reversed()
    for trait, on in (("velocity", getattr(force, "velocity_dependent", False)), ("time", clocked(force))):
        if on:
            name = getattr(force, "name", type(force).__name__)
            raise InputError(
                f"run: force {name!r} may depend on {trait} and has no reversed(), so the run cannot go back in time"
            )
    return force


def _mirrored_problem(problem: Problem) -> Problem:
    """The Problem y' = -f(-s, y); of positions and velocities, with velocities of the other sign."""
    made, put, turned = copy(problem), object.__setattr__, problem.separable
    vars(made).pop("right_hand_side", None)
    put(made, "f", Partial(problem.f, flat=True, backward=True, turned=turned))
    put(made, "t0", -problem.t0)
    half, y0 = len(problem) // 2, problem.y0
    put(made, "y0", read_only(np.concatenate([y0[:half], -y0[half:]]) if turned else y0))
    if (jacobian := problem.jacobian) is not None:
        sign = 1.0 if turned else -1.0  # accelerations do not depend on velocities
        put(made, "jacobian", lambda s, y: sign * np.asarray(jacobian(-s, y), dtype=float))
    return made


class BackwardStepper:
    """A stepper of the mirrored motion as a stepper of the motion: times fall, and velocities have their own sign.

    Parameters
    ----------
    inner : stepper of the mirrored subject
    flow : flow of the mirrored subject
    """

    fresh = steady = False

    def __init__(self, inner: Any, flow: Any) -> None:
        self.inner, self.flow = inner, flow

    def _mirrored(self, y: Floats) -> Floats:
        """A copy of y with velocities of the other sign."""
        y = y.copy()
        if self.flow.halves == 2:
            np.negative(y[1], out=y[1])
        return y

    @property
    def y(self) -> Floats:
        """A copy of the present y."""
        return self._mirrored(self.inner.y)

    @property
    def steps_done(self) -> int:
        """See Stepper."""
        return int(self.inner.steps_done)

    @property
    def trouble(self) -> str:
        """See Stepper."""
        return str(self.inner.trouble)

    @property
    def warnings(self) -> list[str]:
        """Warnings of the method."""
        return list(getattr(self.inner, "warnings", ()))

    @property
    def time(self) -> float:
        """See Stepper."""
        return 0.0 - float(self.inner.time)

    @property
    def last_step(self) -> float:
        """Length of the last step, which is negative."""
        return 0.0 - float(self.inner.last_step)

    @property
    def counts(self) -> Counts:
        """See Stepper."""
        found: Counts = self.inner.counts
        return found

    @property
    def end(self) -> float:
        """The earliest time at which f is evaluated."""
        return -float(self.inner.end)

    @end.setter
    def end(self, time: float) -> None:
        self.inner.end = _ahead(time)

    def reset(self, y: Floats, time: float, steps: int) -> None:
        """See Stepper."""
        self.inner.reset(self._mirrored(y), 0.0 - time, steps)

    def advance(self, steps: int, until: float = -np.inf) -> int:
        """See Stepper."""
        return int(self.inner.advance(steps, _ahead(until)))

    def at(self, time: float) -> Floats:
        """See Stepper."""
        return self._mirrored(self.inner.at(0.0 - time))

    def ahead(self, time: float, over: Callable[[], bool] = bool) -> tuple[int, Floats, Counts]:
        """See Resumable."""
        status, y, cost = self.inner.ahead(0.0 - time, over)
        return status, self._mirrored(y), cost

    def reached(self, inside_step: bool) -> tuple[Floats, Floats]:
        """See Stepper."""
        y, before = self.inner.reached(inside_step)
        return self._mirrored(y), before

    def changes(self) -> list[Any]:
        """Changes of regularised pairs since the last call, if the method has such pairs."""
        found = self.inner.changes() if hasattr(self.inner, "changes") else []
        return [each._replace(time=0.0 - each.time) for each in found]

    def memory(self) -> Memory:
        """See Stepper: the memory of the mirrored motion."""
        found: Memory = self.inner.memory()
        return found

    def recall(self, memory: Memory) -> None:
        """See Stepper."""
        self.inner.recall(memory)

    @property
    def method_state(self) -> Any:
        """State of a method that moves more than positions and velocities, with the motion's own velocities."""
        found = self.inner.method_state.reversed()
        return found._replace(time=self.time)

    @method_state.setter
    def method_state(self, value: Any) -> None:
        self.inner.method_state = value.reversed()._replace(time=0.0 - value.time)

    def __getattr__(self, name: str) -> Any:
        if name == "method_state":  # of a method that has none
            raise AttributeError(name)
        return getattr(self.inner, name)


def _ahead(time: float) -> float:
    """A time as the mirrored motion has it; without a limit, no limit."""
    return 0.0 - time if np.isfinite(time) else np.inf
