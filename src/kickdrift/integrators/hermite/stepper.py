"""Integration with hermite4: gravity with its time derivative, and the compiled loop: predict, evaluate, correct."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from kickdrift.forces.bound.table import EVALUATIONS, SLOTS
from kickdrift.forces.gravity.slope import Sources, acceleration_and_slope, sources_of
from kickdrift.forces.seam.kernel import BLOWN_UP, OK
from kickdrift.integrators.options import Options
from kickdrift.integrators.stepping.loops import STEP
from kickdrift.integrators.stepping.stepper import STOPPED, Counts
from kickdrift.integrators.stepping.stepping import Resumable
from kickdrift.jit.compile import driver, is_finite, jit, never_inline
from kickdrift.jit.handle import handle
from kickdrift.jit.threads.chunks import Chunks, chunk_task, each_chunk, in_chunks, team_of
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.model.system import System


# Rows of a body's Taylor series at its own time.
X, V, A, JERK, SNAP, CRACKLE = range(6)
# Slots of the clock: time of the start; time since then of the last step point and of the one before; the next shared
# step; the given length of all steps, else 0; the steps taken since the start.
START, NOW, BEFORE, NEXT, FIXED, TAKEN = range(6)

TASKS = 64  # parts of the work on moving bodies
WORTH_THREADS = 20_000  # pairs; with fewer, waking threads takes longer than the sum
MOST = 2.0  # largest growth of a shared step


class Bodies(NamedTuple):
    """Bodies under gravity, each with its own time."""

    sources: Sources  # at predicted positions, with predicted velocities
    size: float  # the largest coordinate at the start
    series: NDArray[np.float64]  # (6, 3, n) x, v and four more derivatives at each body's own time
    times: NDArray[np.float64]  # (n,) each body's own, since the start
    steps: NDArray[np.float64]  # (n,) each body's own
    due: NDArray[np.int64]  # (n,) begins with the bodies that the present step moves
    moved: NDArray[np.int64]  # (1,) their number
    chunks: Chunks


@chunk_task
def accelerations_and_jerks(bodies, task):
    """Compute acceleration and jerk of every TASKS-th moving body."""
    never_inline()
    for k in range(task, bodies.moved[0], TASKS):
        acceleration_and_slope(bodies.sources, bodies.due[k])


@jit
def predict(bodies, time):
    """Put all bodies where their series lead, up to the jerk."""
    n, series, times, sources = bodies.times.size, bodies.series, bodies.times, bodies.sources
    for k in range(3):
        for i in range(n):
            s = time - times[i]
            a, jerk = series[A, k, i], series[JERK, k, i]
            sources.x[k, i] = series[X, k, i] + s * (series[V, k, i] + s / 2 * (a + s / 3 * jerk))
            sources.u[k, i] = series[V, k, i] + s * (a + s / 2 * jerk)


@jit
def attract(bodies, cursor):
    """Compute acceleration and jerk of the moving bodies, from where all are."""
    count = bodies.moved[0]
    if count * bodies.times.size < WORTH_THREADS:
        each_chunk(bodies, Chunks(TASKS, 0), "accelerations_and_jerks")
    else:
        each_chunk(bodies, bodies.chunks, "accelerations_and_jerks")
    cursor[EVALUATIONS] += count


@jit
def are_finite(bodies):
    """Tell whether accelerations and jerks of the moving bodies are finite."""
    sources, total = bodies.sources, 0.0
    for k in range(bodies.moved[0]):
        i = bodies.due[k]
        for axis in range(3):
            total += sources.a[axis, i] + sources.slope[axis, i]
    return is_finite(total)


@jit
def evaluate(bodies, time, cursor):
    """Compute acceleration and jerk of the moving bodies, at predicted positions of all. Return a status."""
    predict(bodies, time)
    attract(bodies, cursor)
    return OK if are_finite(bodies) else BLOWN_UP


@jit
def correct(bodies, i, h):
    """Compute the end of body i's step, and the derivatives there (Makino & Aarseth 1992, eqs. 5 to 8).

    The acceleration within the step is the cubic through both ends' acceleration and jerk, and the path is its
    integral. So ``series`` at the step's end describes the whole step.
    """
    series, sources = bodies.series, bodies.sources
    for k in range(3):
        before, after = series[A, k, i], sources.a[k, i]
        jerk, jerk_after = series[JERK, k, i], sources.slope[k, i]
        snap = (6.0 * (after - before) - h * (4.0 * jerk + 2.0 * jerk_after)) / (h * h)
        crackle = (12.0 * (before - after) + 6.0 * h * (jerk + jerk_after)) / (h * h * h)
        series[X, k, i] = sources.x[k, i] + h**4 * (snap / 24.0 + h * crackle / 120.0)
        series[V, k, i] = sources.u[k, i] + h**3 * (snap / 6.0 + h * crackle / 24.0)
        series[A, k, i], series[JERK, k, i] = after, jerk_after
        series[SNAP, k, i], series[CRACKLE, k, i] = snap + h * crackle, crackle


@jit
def length(series, row, i):
    """Length of one derivative of body i."""
    return math.sqrt(series[row, 0, i] ** 2 + series[row, 1, i] ** 2 + series[row, 2, i] ** 2)


@jit
def wanted(bodies, i, h, eta):
    """Return Aarseth's step after a step h: sqrt(eta (|a| |a''| + |a'|^2) / (|a'| |a'''| + |a''|^2)) (Aarseth 1985, in
    Brackbill & Cohen, Multiple Time Scales; Makino & Aarseth 1992, eq. 7).

    The step is infinite if rounding hides the body's displacement by its acceleration, as at a centre of symmetry:
    there the derivatives are noise.
    """
    series = bodies.series
    a, jerk, snap = length(series, A, i), length(series, JERK, i), length(series, SNAP, i)
    crackle = length(series, CRACKLE, i)
    below = jerk * crackle + snap * snap
    if below == 0.0 or h * h * a <= 2.0**-52 * bodies.size:
        return np.inf
    return math.sqrt(eta * (a * snap + jerk * jerk) / below)


@jit
def block_step(time, h, want):
    """Return the next step of a body at ``time`` with steps h, all powers of two.

    The step is halved until it is at most the wanted one. It is doubled if that is wanted and ``time`` is a multiple of
    it, so that bodies stay in step (McMillan 1986, in Hut & McMillan, The Use of Supercomputers in Stellar Dynamics,
    doi:10.1007/BFb0116406; Makino 1991, doi:10.1093/pasj/43.6.859).
    """
    while h > want:
        h *= 0.5
    parts = time / (2.0 * h)
    return 2.0 * h if want >= 2.0 * h and parts == math.floor(parts) else h


@jit
def next_end(bodies):
    """The next end of any body's step."""
    end = np.inf
    for i in range(bodies.times.size):
        end = min(end, bodies.times[i] + bodies.steps[i])
    return end


@jit
def choose_due(bodies, end, individual):
    """Let the step to ``end`` move all bodies, or with ``individual`` those whose steps end there. Return the shortest
    of their steps."""
    count, shortest, times, own = 0, np.inf, bodies.times, bodies.steps
    for i in range(times.size):
        if not individual or times[i] + own[i] == end:
            bodies.due[count] = i
            count += 1
            shortest = min(shortest, end - times[i])
    bodies.moved[0] = count
    return shortest


@jit
def rounding(time):
    """The longest step that is too short to change a time."""
    here = abs(time)
    return 10.0 * (np.nextafter(here, np.inf) - here)


@driver
def hermite_start(bodies, cursor):
    """Compute the series of all bodies at the start, up to acceleration and jerk. Return a status."""
    bound = handle(bodies)
    n = bound.times.size
    bound.moved[0] = n
    for i in range(n):
        bound.due[i] = i
    status = evaluate(bound, 0.0, cursor)
    bound.series[A], bound.series[JERK] = bound.sources.a, bound.sources.slope
    return status


@driver
def hermite_loop(bodies, eta, individual, clock, until, steps, cursor):
    """Move to step points until the clock has reached ``until``, or ``steps`` of them. Return a status, STOPPED if a
    step fails. With ``individual``, a step point is the next end of any body's step, else the common end of all."""
    bound = handle(bodies)
    times, own = bound.times, bound.steps
    while cursor[STEP] < steps and clock[START] + clock[NOW] < until:
        time = clock[NOW]
        if individual:
            end = next_end(bound)
        elif clock[FIXED] > 0.0:
            end = (clock[TAKEN] + 1.0) * clock[FIXED]
        else:
            end = time + clock[NEXT]
        if not choose_due(bound, end, individual) > rounding(clock[START] + time):
            return STOPPED
        status = evaluate(bound, end, cursor)
        if status != OK:
            return status
        least = MOST * (end - time)
        for k in range(bound.moved[0]):
            i = bound.due[k]
            h = end - times[i]
            correct(bound, i, h)
            times[i] = end
            want = wanted(bound, i, h, eta)
            least = min(least, want)
            if individual:
                own[i] = block_step(end, h, want)
        clock[NEXT] = least
        clock[BEFORE], clock[NOW] = time, end
        clock[TAKEN] += 1.0
        cursor[STEP] += 1
    return OK


FACTORIALS = np.array([1.0, 1.0, 2.0, 6.0, 24.0, 120.0])


class HermiteStepper(Resumable):
    """Hermite integration: every body has a Taylor series of five terms, at a time of its own.

    The series is valid to the method's order over the body's last and next step. ``y`` evaluates all series at the last
    step point, and ``at`` evaluates them at another time. Neither changes the series, so samples change no bits. A
    checkpoint holds the series, times and steps of all bodies, and the clock.
    """

    saved: ClassVar[tuple[str, ...]] = (
        "_cursor",
        "_clock",
        "_begun",
        "_size",
        "_bodies.series",
        "_bodies.times",
        "_bodies.steps",
    )
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
            status = self._begin()
            if status != OK:
                return status
            self._first_steps()
            self._begun = True
        status = self._loop(steps, until)
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

    def _begin(self) -> int:
        """Compute the series at the start. Return a status."""
        return self._call(hermite_start, self._bodies, self._cursor)

    def _first_steps(self) -> None:
        """Choose the first step of each body."""
        self._clock[NEXT] = self._first_step()
        self._bodies.steps[:] = self._clock[NEXT]

    def _loop(self, steps: int, until: float) -> int:
        """Take steps. Return a status."""
        return self._call(
            hermite_loop, self._bodies, self._eta, self._individual, self._clock, until, steps, self._cursor
        )

    def _call(self, compiled: Any, *args: Any) -> int:
        if self._flow.forces.threads > 1:
            team_of(self._flow.forces.threads).start()
        return int(compiled(*args))

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
