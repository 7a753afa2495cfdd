"""The seam between a Simulation and another program.

A program supplies a ``Session``: particles that it moves, and looks at. ``EngineFlow`` and ``EngineStepper`` make of it
what a Simulation talks to, so that run loop, cadence, Ctrl-C, observers, report and file are the same for all engines.

Numbers go over as they stand in the system's own units, with the masses that make force = mass x acceleration true in
them: no formula of the programs used here has a constant with a unit, so nothing is converted, and nothing rounded.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from kickdrift.errors import InputError, KickdriftError, RunError
from kickdrift.forces.bound import Measured
from kickdrift.forces.kernel import OK
from kickdrift.integrators.flow import ParticleFlow
from kickdrift.integrators.stepping import STOPPED, Counts
from kickdrift.looks.observers import take_sample
from kickdrift.looks.table import Looks
from kickdrift.model.memory import Memory, by_value
from kickdrift.model.starts.builders import check_overlaps
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.engines import Engine
    from kickdrift.integrators.method import Method
    from kickdrift.integrators.options import Options
    from kickdrift.model.system import System


@dataclass(frozen=True)
class Job:
    """What a Simulation asks of an engine; ``named`` is the method's name as it was asked for."""

    system: System
    method: Method
    named: str
    options: Options
    threads: int = 1
    processes: int = 1


class Trouble(Exception):
    """A program cannot go on, for the reason that it gives; its session is over."""


class Session:
    """A program at work; it raises Trouble.

    A session of a method that chooses its steps has ``time`` of its last step point, ``last_step``, ``hint`` for the
    next, and ``at`` and ``measure`` inside the last step. Others may ignore these, and ``until``.
    """

    time: float = 0.0
    last_step: float = 0.0
    hint: float = 0.0  # how long the next step is to be; 0 where the program decides

    def __init__(self, job: Job) -> None:
        self.job = job

    def reset(self, phase: Floats, time: float) -> None:
        """Begin anew at positions and velocities ``phase`` (2, 3, n)."""
        raise NotImplementedError

    def advance(self, steps: int, until: float) -> int:
        """Take so many steps, fewer where a step point reaches ``until``; how many."""
        raise NotImplementedError

    def phase(self) -> Floats:
        """(2, 3, n) positions, unwrapped, and velocities; a copy."""
        raise NotImplementedError

    def finite(self) -> bool:
        """Whether positions and velocities are numbers."""
        return bool(np.isfinite(self.phase()).all())

    def at(self, time: float) -> Floats:
        """The phase at a time inside the last step; a copy."""
        return self.phase()

    def measure(self, time: float) -> Measured | None:
        """What the program's own code gives of accelerations, potential energy and virial; None where these are no
        numbers."""
        raise NotImplementedError

    def close(self) -> None:
        """End the program; ``reset`` begins another."""


class EngineFlow(ParticleFlow):
    """A System's particles on another program; what looks at them asks the program."""

    def __init__(self, system: System) -> None:
        check_overlaps(system)
        self.subject = system
        self.name = system.name
        self.halves = 2
        self.not_separable = None
        self._ends = np.empty((2, 3, len(system)))
        self.stepper: EngineStepper  # at work for it

    def look(self, looks: Looks, y: Floats, time: float, step: int, last: Floats, fresh: bool = False) -> int:
        """See ParticleFlow; energies are the program's own."""
        looks.fill(take_sample(self.subject, self.stepper, step, time, y))
        last[...] = y
        return OK

    def looking(self, fresh: bool) -> None:
        """None: each look asks the program."""

    def accelerations(self, y: Floats, time: float) -> Floats | None:
        """(3, n) that the program gives, None where they are not finite."""
        measured = self.stepper.measure(time, y)
        return None if measured is None else measured.accelerations

    def prepare(self, y: Floats, time: float) -> None:
        """Have the program at work."""
        self.stepper.measure(time, y)

    def meeting(self, y: Floats) -> str:
        """Nothing: where the particles stood when the program stopped is not known."""
        return ""

    def derivative(self, time: float, y: Floats) -> Floats:
        """Nothing that another program could be asked for away from its own state."""
        raise InputError(f"{self.name}: runs on another engine, which gives forces only at its present state")


class EngineStepper:
    """An integration by another program.

    It is told of a new state when it is next asked for something. A checkpoint holds positions and velocities, and how
    long the next step is to be where the method chooses that; the program may know more (such as the order of its
    particles, half a step or a polynomial), so that a run that is taken up again need not have the same bits.
    """

    _known: Floats | None  # y, where it was asked for since the last step

    def __init__(self, flow: EngineFlow, engine: Engine, job: Job) -> None:
        self._job, self._dt = job, 0.0 if job.method.chooses_steps else (job.options.dt or 0.0)
        self._engine = engine
        with self._one_line():
            self._session: Session = engine.module.session(job)
        self.warnings = engine.warnings
        self._evaluations = 0
        flow.stepper = self

    # --- what it stands at ---

    @property
    def y(self) -> Floats:
        if self._known is None:
            try:
                with self._one_line():
                    self._known = self._last = self._session.phase()
            except Trouble as trouble:
                raise self._stopped(trouble) from None
        return self._known

    @property
    def time(self) -> float:
        if not self._dt:
            return self._begin if self._waiting else self._session.time
        return self._begin + self.steps_done * self._dt

    @property
    def last_step(self) -> float:
        return self._dt or (0.0 if self._waiting else self._session.last_step)

    @property
    def counts(self) -> Counts:
        """Evaluations of the force where the method has as many at each step."""
        return Counts(self._evaluations)

    def reset(self, y: Floats, time: float, steps: int) -> None:
        self._known = y
        self._last = y
        self.trouble = ""
        self.steps_done = steps
        self._begin = time - steps * self._dt
        self._waiting = True
        self._session.hint = 0.0

    # --- at work ---

    @contextmanager
    def _one_line(self) -> Iterator[None]:
        """Inside, what a version that was not tested stumbles over is an InputError that says so."""
        try:
            yield
        except (Trouble, KickdriftError):
            raise
        except Exception as error:
            if not (untested := self._engine.warnings):
                raise
            text = " ".join(f"{type(error).__name__}: {error}".split())
            raise InputError(f"engine {self._engine.name!r}: {untested[0]}: {text}") from error

    def _told(self) -> Session:
        """The session, at y."""
        if self._waiting:
            with self._one_line():
                self._session.reset(self.y.copy(), self.time)
            self._waiting = False
        return self._session

    def advance(self, steps: int, until: float = np.inf) -> int:
        if not steps:
            return OK
        try:
            session = self._told()
            with self._one_line():
                taken = session.advance(steps, until)
                if not session.finite():
                    raise Trouble("positions or velocities are no longer finite")
        except Trouble as trouble:
            self.trouble, self._known = str(trouble), self._last
            return STOPPED
        self.steps_done += taken
        self._evaluations += taken * self._job.method.evaluations
        self._known = None
        return OK

    def at(self, time: float) -> Floats:
        if time == self.time:
            return self.y.copy()
        with self._one_line():
            return self._told().at(time)

    def measure(self, time: float, phase: Floats) -> Measured | None:
        """What the program gives at ``time``, which is the present or inside the last step; None where that makes no
        sense."""
        try:
            with self._one_line():
                return self._told().measure(time)
        except Trouble as trouble:
            raise self._stopped(trouble) from None

    def _stopped(self, trouble: Trouble) -> RunError:
        """The program ended while it was looked at."""
        self.trouble, self._known = str(trouble), self._last
        return RunError(f"step {self.steps_done}: {trouble}")

    def reached(self, inside_step: bool) -> tuple[Floats, Floats]:
        return self.y, self.y[0]

    # --- checkpoints ---

    def memory(self) -> Memory:
        """See Stepper."""
        hint = 0.0 if self._waiting else self._session.hint
        return {
            "y": by_value(self.y), "time": self.time, "begin": self._begin, "steps_done": self.steps_done,
            "hint": hint, "evaluations": self._evaluations,
        }  # fmt: skip

    def recall(self, memory: Memory) -> None:
        """See Stepper."""
        self.reset(np.array(memory["y"]), memory["time"], memory["steps_done"])
        if self._dt:
            self._begin = memory["begin"]
        self._session.hint, self._evaluations = memory["hint"], memory["evaluations"]


def begin(engine: Engine, job: Job) -> tuple[EngineFlow, Any]:
    """The flow and the stepper of a System on another program."""
    flow = EngineFlow(job.system)
    return flow, EngineStepper(flow, engine, job)
