"""Interface between a Simulation and another program.

A program supplies a ``Session``: particles that it moves and measures. ``EngineFlow`` and ``EngineStepper`` adapt it to
a Simulation. So run loop, samples, Ctrl-C, observers, report and file are the same for all engines.

Numbers are passed in the system's own units, with masses that make force = mass x acceleration true. The programs'
formulas have no constant with a unit, so nothing is converted and nothing rounded.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Protocol

import numpy as np

from kickdrift.engines.job import EngineBath, Job
from kickdrift.errors import InputError, KickdriftError, RunError
from kickdrift.forces.bound.forces import Measured
from kickdrift.forces.seam.kernel import OK
from kickdrift.integrators.flows.flow import Flow
from kickdrift.integrators.flows.particle_flow import ParticleStates
from kickdrift.integrators.options import FRICTION, RATE, SEED, TAU, TEMPERATURE
from kickdrift.integrators.splitting.baths.bath import bath_warnings, bathed
from kickdrift.integrators.stepping.stepper import STOPPED, Counts
from kickdrift.looks.observers import Looks, take_sample
from kickdrift.model.freedom import DRIFT, whole_motion
from kickdrift.model.memory import Memory, by_value
from kickdrift.model.state import Floats
from kickdrift.model.system import System

SEEDS = 899_999_999  # largest seed; LAMMPS takes no larger one


class Trouble(Exception):
    """A program cannot continue, for the given reason; its session is over."""


class Session:
    """A running program; it raises Trouble.

    For a method that chooses its steps, a session has the ``time`` of its last step point, ``last_step``, ``hint`` for
    the next step, and ``at`` and ``measure`` inside the last step. Others may ignore these, and ``until``.
    """

    time: float = 0.0
    last_step: float = 0.0
    hint: float = 0.0  # length of the next step; 0 leaves it to the program
    seed: int = 1  # of the noise of a heat bath, 1 to SEEDS; set before ``reset``
    steps_before: int = 0  # steps of the run before ``reset``; set before it

    def __init__(self, job: Job) -> None:
        self.job = job

    def reset(self, phase: Floats, time: float) -> None:
        """Start anew at positions and velocities ``phase`` (2, 3, n). In two dimensions z is zero."""
        raise NotImplementedError

    def advance(self, steps: int, until: float) -> int:
        """Take this many steps, or fewer if a step point reaches ``until``. Return their number."""
        raise NotImplementedError

    def phase(self) -> Floats:
        """Copy of unwrapped positions and velocities (2, 3, n)."""
        raise NotImplementedError

    def finite(self) -> bool:
        """Tell whether positions and velocities are finite."""
        return bool(np.isfinite(self.phase()).all())

    def at(self, time: float) -> Floats:
        """Copy of the phase at a time inside the last step."""
        return self.phase()

    def measure(self, time: float) -> Measured | None:
        """Accelerations, potential energy and virial from the program's own code; None if they are not finite."""
        raise NotImplementedError

    @property
    def heat(self) -> float:
        """Energy that the heat bath has given since ``reset``, from a program that tells it."""
        raise NotImplementedError

    def close(self) -> None:
        """End the program; ``reset`` starts another."""


class Program(Protocol):
    """Another program, as a run needs it; see ``Engine``."""

    @property
    def name(self) -> str: ...

    @property
    def warnings(self) -> list[str]: ...

    @property
    def baths(self) -> Mapping[str, EngineBath]: ...

    def remarks(self, job: Job) -> list[str]:
        """How the program's forces differ from those of the job, a line each."""

    def session(self, job: Job) -> Session:
        """Start the program."""


class EngineFlow(ParticleStates):
    """A System's particles in another program. Samples come from the program."""

    drags: bool = False  # whether the method changes the total momentum

    def __init__(self, system: System) -> None:
        super().__init__(system)
        self.stepper: EngineStepper  # the stepper in use

    def look(self, looks: Looks, y: Floats, time: float, step: int, last: Floats, fresh: bool = False) -> int:
        """Sample in ParticleFlow's way, with the program's own energies."""
        looks.fill(take_sample(self.subject, self.stepper, step, time, y, self.drags))
        last[...] = y
        return OK

    def looking(self, fresh: bool) -> None:
        """Return None: each sample asks the program."""

    def accelerations(self, y: Floats, time: float) -> Floats | None:
        """Accelerations (3, n) from the program; None if they are not finite."""
        measured = self.stepper.measure(time, y)
        return None if measured is None else measured.accelerations

    def prepare(self, y: Floats, time: float) -> None:
        """Start the program."""
        self.stepper.measure(time, y)

    def meeting(self, y: Floats, time: float) -> str:
        """Return no text: the particles' places when the program stopped are not known."""
        return ""


RunFlow = Flow | EngineFlow  # what a run advances


class EngineStepper:
    """Integration by another program.

    The program gets a new state at the next request. A checkpoint holds positions, velocities and, for an adaptive
    method, the length of the next step. The program may have more state (the order of its particles, half a step, a
    polynomial), so a resumed run may have other bits.
    """

    _known: Floats | None  # y, if requested since the last step
    _drift: Floats | None  # (3, 1) velocity of the frame in which the program runs since the time `_shifted`

    def __init__(self, flow: EngineFlow, engine: Program, job: Job) -> None:
        self._job, self._dt = job, 0.0 if job.method.chooses_steps else (job.options.dt or 0.0)
        self._engine = engine
        with self._one_line():
            self._session = engine.session(job)
        self.warnings, self._bath = list(engine.warnings), engine.baths.get(job.method.name)
        self.warnings += engine.remarks(job)
        if self._bath:
            self.warnings += filter(None, [self._bath.remark, *bath_warnings(self._dt, job.options)])
        self._evaluations, self._given = 0, 0.0
        flow.stepper = self

    # --- present state ---

    @property
    def y(self) -> Floats:
        if self._known is None:
            try:
                with self._one_line():
                    self._known = self._last = self._raised(self._session.phase(), self.time)
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
        """Force evaluations, if each step has the same number."""
        return Counts(self._evaluations)

    @property
    def heat(self) -> float | None:
        """Energy that the heat bath has given since the state was set; None if the program does not tell it."""
        if not (self._bath and self._bath.tells):
            return None
        return self._given + (0.0 if self._waiting else self._session.heat)

    def reset(self, y: Floats, time: float, steps: int) -> None:
        self._given = 0.0
        self._known = y
        self._last = y
        self._z = float(y[0, 2, 0]) if self._job.system.dimensions == 2 else 0.0  # of the plane; the program has zero
        self.trouble = ""
        self.steps_done = steps
        self._begin = time - steps * self._dt
        self._waiting, self._drift, self._shifted = True, None, time
        self._session.hint = 0.0

    # --- running ---

    @contextmanager
    def _one_line(self) -> Iterator[None]:
        """Turn an error of an untested version into an InputError that says so."""
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
        """The session, set to y."""
        if self._waiting:
            phase = self.y.copy()
            phase[0, 2] -= self._z
            if self._bath:
                self._session.seed, self._session.steps_before = self._seed(), self.steps_done
                self._drift, self._shifted = self._drift_of(phase), self.time
                phase[1] -= 0.0 if self._drift is None else self._drift
            with self._one_line():
                self._session.reset(phase, self.time)
            self._waiting = False
        return self._session

    def _seed(self) -> int:
        """Seed of the program's noise from here on: a function of the run's seed and of the steps done."""
        own = self._job.options.get(SEED.name)
        own = (self._job.system.seed or 0) if own is None else own
        words = np.random.SeedSequence([own, abs(self.steps_done), int(self.steps_done < 0)])
        return 1 + int(words.generate_state(1)[0]) % SEEDS

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
            return self._raised(self._told().at(time), time)

    def _drift_of(self, phase: Floats) -> Floats | None:
        """Velocity (3, 1) of the centre of mass, where the bath conserves it. Programs take it for heat or remove it,
        so they get the particles in its frame."""
        system = self._job.system
        if self._job.method.drags or system.acting("external"):
            return None
        motion = whole_motion(system.coherent_masses, phase[0], phase[1], DRIFT)
        return None if motion is None else motion[:, :1]

    def _raised(self, phase: Floats, time: float) -> Floats:
        """The program's phase at a time, in the frame and the plane of the System."""
        if self._z:
            phase[0, 2] += self._z
        if self._drift is not None:
            phase[0] += self._drift * (time - self._shifted)
            phase[1] += self._drift
        return phase

    def measure(self, time: float, phase: Floats) -> Measured | None:
        """Measurement at ``time``, at present or inside the last step; None if it is not finite."""
        try:
            with self._one_line():
                return self._told().measure(time)
        except Trouble as trouble:
            raise self._stopped(trouble) from None

    def _stopped(self, trouble: Trouble) -> RunError:
        """RunError of a program that ended during a measurement."""
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
            "hint": hint, "evaluations": self._evaluations, "heat": self.heat or 0.0,
        }  # fmt: skip

    def recall(self, memory: Memory) -> None:
        """See Stepper."""
        self.reset(np.array(memory["y"]), memory["time"], memory["steps_done"])
        if self._dt:
            self._begin = memory["begin"]
        self._session.hint, self._evaluations = memory["hint"], memory["evaluations"]
        self._given = memory.get("heat", 0.0)


def begin(engine: Program, job: Job) -> tuple[EngineFlow, Any]:
    """The flow and the stepper of a System on another program."""
    flow = EngineFlow(job.system)
    flow.drags = job.method.drags
    if job.method.bath:
        needed = [option for option in (TEMPERATURE, FRICTION, TAU, RATE) if option in job.method.declared]
        bathed(flow, job.options, needed, conserving=not job.method.drags)  # type: ignore[arg-type]
    return flow, EngineStepper(flow, engine, job)
