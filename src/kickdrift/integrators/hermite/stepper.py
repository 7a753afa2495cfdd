"""Integration with hermite4."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial import cKDTree

from kickdrift.forces.bound.table import EVALUATIONS, SLOTS
from kickdrift.forces.gravity.slope import sources_of
from kickdrift.forces.seam.kernel import OK
from kickdrift.integrators.hermite.loop import (
    BEFORE,
    CRACKLE,
    FIXED,
    JERK,
    NEXT,
    NOW,
    START,
    TASKS,
    A,
    Bodies,
    V,
    X,
    hermite_loop,
    hermite_start,
)
from kickdrift.integrators.options.options import Options
from kickdrift.integrators.stepping.loops import STEP
from kickdrift.integrators.stepping.stepper import STOPPED, Counts
from kickdrift.integrators.stepping.stepping import Resumable
from kickdrift.jit.threads.chunks import in_chunks
from kickdrift.jit.threads.team import team_of
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.model.system import System

FACTORIALS = np.array([1.0, 1.0, 2.0, 6.0, 24.0, 120.0])


class HermiteStepper(Resumable):
    """Hermite integration: every body has a Taylor series of five terms, at a time of its own.

    The series is valid to the method's order over the body's last and next step. ``y`` evaluates all series at the last
    step point, and ``at`` evaluates them at another time. Neither changes the series, so samples change no bits. A
    checkpoint holds the series, times and steps of all bodies, and the clock.
    """

    saved = ("_cursor", "_clock", "_begun", "_size", "_bodies.series", "_bodies.times", "_bodies.steps")
    _lists = None

    def __init__(self, flow: Any, options: Options) -> None:
        system: System = flow.subject
        self._flow, self._eta = flow, options.eta or 1.0
        self._individual, self._fixed = options.scheme == "block", options.dt or 0.0
        (force,) = system.forces
        n = len(system)
        self._bodies = Bodies(
            sources=sources_of(force, system),
            size=0.0,
            series=np.zeros((6, 3, n)),
            times=np.zeros(n),
            steps=np.zeros(n),
            due=np.zeros(n, np.int64),
            moved=np.zeros(1, np.int64),
            chunks=in_chunks(TASKS, flow.forces.threads),
        )
        self._cursor = np.zeros(SLOTS, np.int64)
        self._clock = np.zeros(6)
        self.trouble = ""

    def reset(self, y: Floats, time: float, steps: int) -> None:
        self.y, self.steps_done = y.copy(), steps
        bodies = self._bodies
        bodies.series[:] = 0.0
        bodies.series[: V + 1] = y
        bodies.times[:] = 0.0
        self._size = float(np.abs(y[0]).max())
        self._clock[:] = 0.0
        self._clock[START], self._clock[FIXED] = time, self._fixed
        self._begun = False

    @property
    def _size(self) -> float:
        """Largest coordinate at the start."""
        return self._bodies.size

    @_size.setter
    def _size(self, size: float) -> None:
        self._bodies = self._bodies._replace(size=size)

    @property
    def time(self) -> float:
        return float(self._clock[START] + self._clock[NOW])

    @property
    def last_step(self) -> float:
        return float(self._clock[NOW] - self._clock[BEFORE])

    @property
    def counts(self) -> Counts:
        """A step of some bodies counts as their fraction of an evaluation."""
        return Counts(-(-int(self._cursor[EVALUATIONS]) // len(self._bodies.times)))

    def advance(self, steps: int, until: float = np.inf) -> int:
        if not self._begun:
            status = self._call(hermite_start, self._bodies, self._cursor)
            if status != OK:
                return status
            self._clock[NEXT] = self._first_step()
            self._bodies.steps[:] = self._clock[NEXT]
            self._begun = True
        status = self._call(
            hermite_loop, self._bodies, self._eta, self._individual, self._clock, until, steps, self._cursor
        )
        if self._cursor[STEP]:
            self.steps_done += int(self._cursor[STEP])
            self.y = self._series_at(self._clock[NOW])
            self._cursor[STEP] = 0
        if status == STOPPED:
            body = int(self._bodies.due[0])
            least = self._bodies.steps[body] if self._individual else self._clock[NEXT]
            self.trouble = (
                f"the step fell to {least:.3g}, too short to change t = {self.time:.9g}; use a softening for "
                f"bodies that meet"
            )
        return status

    def _call(self, compiled: Any, *args: Any) -> int:
        if self._flow.forces.threads > 1:
            team_of(self._flow.forces.threads).start()
        return compiled(*args)

    def _first_step(self) -> float:
        """Length of the first step, shared by all, so that the second step knows snap and crackle of each body.

        It is eta |a| / |a'| (Makino & Aarseth 1992, eq. 9), or eta sqrt(distance / |a|) to the nearest source if that
        is less, since a start at rest has no jerk. Without acceleration it is eta (distance / |a'|)^(1/3), and without
        jerk 1.
        """
        if self._fixed:
            return self._fixed
        bodies = self._bodies
        x = bodies.series[X].T
        a, jerk = (np.linalg.norm(bodies.series[row], axis=0) for row in (A, JERK))
        if not (a.any() or jerk.any()):
            return 1.0
        sources = np.flatnonzero(bodies.sources.gm[: len(x)] > 0.0)
        near, which = cKDTree(x[sources]).query(x, k=2)
        own = sources[np.minimum(which[:, 0], len(sources) - 1)] == np.arange(len(x))
        distance = np.sqrt(np.where(own, near[:, 1], near[:, 0]) ** 2 + bodies.sources.softening2)
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = np.where(a > 0.0, np.minimum(a / jerk, np.sqrt(distance / a)), np.cbrt(distance / jerk))
        first = self._eta * float(np.nanmin(scale))
        return 2.0 ** np.floor(np.log2(first)) if self._individual else first

    def _series_at(self, since: float) -> Floats:
        """State at a time since the start."""
        s = since - self._bodies.times
        y = np.zeros((2, *self._bodies.series.shape[1:]))
        for row in range(CRACKLE, -1, -1):  # Horner's rule, from the highest power
            y[0] = y[0] * s + self._bodies.series[row] / FACTORIALS[row]
            if row >= V:
                y[1] = y[1] * s + self._bodies.series[row] / FACTORIALS[row - 1]
        return y

    def at(self, time: float) -> Floats:
        return self.y.copy() if time == self.time else self._series_at(time - self._clock[START])

    def reached(self, inside_step: bool) -> tuple[Floats, Floats]:
        bodies, n = self._bodies, len(self._bodies.times)
        there = np.array([bodies.sources.x[:, :n], bodies.sources.u[:, :n]]) if inside_step else self.y
        return there, self.y[0]
