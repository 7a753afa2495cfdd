"""Ladder of one method: runs at steps or tolerances from coarse to fine; and the error of one step."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf, log
from time import perf_counter
from typing import Any

import numpy as np

from kickdrift.analysis.compare import reference
from kickdrift.analysis.compare.pilot import SHORT, OutOfTime, Subject, follow, state_at, vector, warm_up
from kickdrift.errors import InputError, RunError
from kickdrift.integrators.asked import Integrator, method_of
from kickdrift.integrators.runge_kutta.scipy_methods import SciPyMethod
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.run.simulation import Simulation
from kickdrift.statistics.drift import Growth, energy_growth, position_growth

ANY = 1e3  # rtol and atol that make an adaptive method accept any step
ROUNDING = 50 * reference.EPSILON  # smaller local errors are only rounding
LARGE = 0.1  # larger errors do not follow the order yet
FITTED = 4  # finest points in the fit
FLAT = 0.7  # part of the slopes before; a smaller slope shows rounding
COARSEST = 1 / 32  # part of these evaluations, at the bottom of a ladder of steps
RUNGS = 16  # most runs in a ladder
RTOLS = tuple(10.0**-k for k in range(2, 14))
BELIEVED = 3.0  # smallest ratio of a believed error to the reference's own error
LOCAL_SECONDS = 3.0  # most time for a method's errors of one step; where forces jump, tight runs take tiny steps
PARTS = 4  # steps of a reference of fixed steps in the step whose error it measures
LOCAL_POINTS = 4  # points of a Problem; particles use the start alone; stiff problems, which show no order, use none
USELESS = 1.0  # relative error of a run that missed the solution


class LocalErrors:
    """Errors of one step from a few points of a solution: root mean square over the points."""

    def __init__(
        self,
        subject: Subject,
        start: Any,
        plan: reference.Reference,
        length: float,
        points: int,
        name: str,
        threads: int,
    ) -> None:
        self.subject, self.threads, self.floor, self._left = subject, threads, ROUNDING, inf
        self.starts = [start][:points]
        if plan.y is not None:
            samples = len(plan.y) - 1
            chosen = [round(samples * k / points) for k in range(1, points)]
            self.starts += [state_at(start, plan.y[k], start.time + length * k / samples) for k in chosen]
            self._scale = plan.scale
        else:
            self._scale = reference.natural_scale(subject, vector(start)[None])
        self._name = name
        if name != reference.HELD:
            tight = reference.tolerances(subject, start, reference.TIGHT[name][0][0], name)
            self._reference = Simulation(subject, name, threads=threads, precision="double", **tight)

    def begin(self, seconds: float) -> None:
        """Let the errors of the next method take so many seconds."""
        self._left = seconds

    def of(self, which: str | Integrator, step: float) -> float | None:
        """Error after one step of that length. None if the step blows up, without points, without time, and for methods
        whose first steps differ."""
        method = method_of(which)
        if isinstance(method, SciPyMethod) or not self.starts or self._left < 0:
            return None
        given: dict[str, Any] = {key: ANY for key in ("rtol", "atol") if key in method.tunable}
        try:
            with np.errstate(all="ignore"):
                sim = Simulation(self.subject, which, dt=step, threads=self.threads, precision="double", **given)
                if self._name == reference.HELD:  # its steps divide this one
                    self._reference = Simulation(
                        self.subject, self._name, dt=step / PARTS, threads=self.threads, precision="double"
                    )
                errors = [self._one(sim, start) for start in self.starts]
        except (RunError, ArithmeticError, InputError, OutOfTime):
            return None
        found = float(np.sqrt(np.mean(np.square(errors))))
        return found if np.isfinite(found) else None

    def _one(self, sim: Simulation, start: Any) -> float:
        sim.state = start
        sim.run(1, every=1)
        self._reference.state = start
        began = perf_counter()

        def progress(done: int, of: int) -> None:
            if perf_counter() - began > self._left:
                raise OutOfTime(self._reference.time - start.time, vector(start), 0, perf_counter() - began)

        try:
            self._reference.run(until=sim.time, every=2**40, progress=progress)  # its steps differ
        finally:
            self._left -= perf_counter() - began
        difference = vector(sim.state) - vector(self._reference.state)
        return float(reference.distance(reference.compared(self.subject, difference), self._scale))


def slope(steps: Sequence[float], errors: Sequence[float | None], floor: float) -> float | None:
    """Slope of log error against log step. The fit takes the finest four points above the floor, up to where rounding
    slows the fall of the error. None with fewer than three points."""
    points = [(h, e) for h, e in zip(steps, errors, strict=True) if e is not None and floor < e < LARGE]
    if len(points) < 3:
        return None
    h, e = np.log(np.array(sorted(points, reverse=True))).T
    apart = np.maximum(-np.diff(h), 1e-12)
    slopes = -np.diff(e) / apart
    end = len(h)
    for k in range(2, len(slopes)):
        if slopes[k] < FLAT * slopes[k - 2 : k].min():
            end = k + 1
            break
    h, e = h[:end][-FITTED:], e[:end][-FITTED:]
    return float(np.polyfit(h, e, 1)[0]) if h[0] - h[-1] > log(1.5) else None


@dataclass(frozen=True)
class Row:
    """Result of one run.

    Attributes
    ----------
    method : the method's name, with ``-o KEY=VALUE`` for its options
    dt, rtol, atol : the step, or the tolerances of an adaptive method
    step : dt, or the mean step of an adaptive method
    steps, rejected, evaluations, seconds : cost of the run
    error : largest over the samples (positions), or root mean square (energy); None if the run failed
    energy_error : root mean square relative energy error; None without an energy
    local_error : error of one step of length ``step``; None if not measured
    growth : growth of the error with time, for times after the pilot
    believed : whether the error is clearly above the reference's own
    failure : why there is no error
    """

    method: str
    dt: float | None
    rtol: float | None
    atol: float | None
    step: float
    steps: int = 0
    rejected: int = 0
    evaluations: int = 0
    seconds: float = 0.0
    error: float | None = None
    energy_error: float | None = None
    local_error: float | None = None
    growth: Growth | None = None
    believed: bool = False
    failure: str | None = None

    @property
    def useless(self) -> bool:
        """Whether the run failed or missed the solution."""
        return self.error is None or self.error > USELESS

    def as_json(self) -> dict[str, Any]:
        """The row as plain numbers."""
        return {**vars(self), "growth": vars(self.growth) if self.growth else None}


class Bench:
    """Ladders of one subject."""

    def __init__(
        self, subject: Subject, start: Any, plan: reference.Reference, length: float, samples: int, evaluations: float,
        accuracy: float | None, threads: int, share: float, stiff: bool,
    ) -> None:  # fmt: skip
        self.subject, self.start, self.plan = subject, start, plan
        self.length, self.samples, self.evaluations = length, samples, evaluations
        self.threads, self.share = threads, share
        self.enough = max(0.1 * (accuracy or 0.0), plan.error)
        points = 0 if stiff else LOCAL_POINTS if plan.y is not None and not isinstance(subject, System) else 1
        self._local = LocalErrors(
            subject, start, plan, length, points, reference.reference_method(subject, stiff), threads
        )
        self._finest: Floats | None = None  # solution for the count of oscillations

    def ladder(self, which: Integrator, progress: Callable[[int], Any]) -> list[Row]:
        """Rows from coarse to fine. Among useless rows, only the finest is kept."""
        method = which.method
        rows: list[Row] = []
        left, seconds, below = self.share, 0.0, 0
        self._local.begin(LOCAL_SECONDS)
        warm_up(self.subject, self.start, which, 1e-3 * self.length / max(self.evaluations, 1.0), self.threads)
        for rung, knob in enumerate(self._knobs(method)):
            if seconds > left or below == 2:
                break
            row = self._row(which, knob, left)
            left -= (2 if row.seconds > SHORT else 4) * row.seconds  # the timed repetitions count too
            seconds = 2 * row.seconds
            if rows and rows[-1].useless and row.useless:
                rows.pop()
            rows.append(row)
            below += row.error is not None and row.error < self.enough
            progress(round(100 * (rung + 1) / RUNGS))
        progress(100)
        return rows

    def _knobs(self, method: Any) -> list[dict[str, Any]]:
        if method.adaptive:
            return [reference.tolerances(self.subject, self.start, rtol, method.name) for rtol in RTOLS]
        per_step = method.evaluations or 10  # 10 for an implicit method's iterations
        coarsest = max(1, round(COARSEST * self.evaluations / per_step / self.samples))
        return [{"steps": self.samples * coarsest * 2**rung} for rung in range(RUNGS)]

    def _row(self, which: Integrator, knob: dict[str, Any], limit: float) -> Row:
        dt = self.length / knob["steps"] if "steps" in knob else None
        of = {"method": str(which), "dt": dt, "rtol": knob.get("rtol"), "atol": knob.get("atol")}
        try:
            track = follow(
                self.subject, self.start, which, self.length, self.samples, **knob, threads=self.threads, limit=limit
            )
        except RunError as failed:
            return Row(**of, step=dt or np.nan, failure=f"blew up: {failed}")  # type: ignore[arg-type]
        except OutOfTime as end:
            return Row(**of, step=dt or np.nan, seconds=end.seconds, failure=str(end))  # type: ignore[arg-type]
        errors = self.plan.error_of(track, self.subject)
        chosen = which.method.chooses_steps
        step = self.length / max(track.steps, 1) if dt is None or chosen else dt
        rms = track.energy.rms_relative_error if track.energy else None
        energy = self.plan.measure == "energy"
        error = (rms if rms is not None else np.nan) if energy else float(np.max(errors))
        if not np.isfinite(error):
            return Row(**of, step=step, failure="the error is not finite")  # type: ignore[arg-type]
        believed = error > BELIEVED * self.plan.error
        if self.plan.measure == "energy":
            growth = energy_growth(track.times, track.energies, reference.relative_energy(track))
        else:
            growth = position_growth(track.times, errors)
        if error < USELESS:
            self._finest = track.y
        return Row(
            **of,  # type: ignore[arg-type]
            step=step,
            steps=track.steps,
            rejected=track.rejected,
            evaluations=track.evaluations,
            seconds=track.seconds,
            error=error,
            energy_error=rms,
            local_error=self._local.of(which, step),
            growth=growth,
            believed=believed,
        )

    def slopes(self, rows: list[Row], floor: float) -> tuple[float | None, float | None]:
        """Slopes of the global and of the local error against the step."""
        steps = [row.step for row in rows]
        return (
            slope(steps, [row.error for row in rows], BELIEVED * floor),
            slope(steps, [row.local_error for row in rows], self._local.floor),
        )

    def cycles(self) -> float:
        """Number of cycles of the solution: half the crossings of the mean, in the unknown with most crossings. The
        number of samples limits the count."""
        y = self._finest if self.plan.y is None else self.plan.y
        if y is None or y.shape[1] > 600:
            return float(self.samples)  # many particles: between two samples, each has one more collision
        centred = y - y.mean(axis=0)
        return float(0.5 * np.abs(np.diff(np.sign(centred), axis=0) > 0).sum(axis=0).max())
