"""The error of one step, and the slope of an error against the step."""

from __future__ import annotations

from collections.abc import Sequence
from math import log
from typing import Any

import numpy as np

from kickdrift.analysis.pilot import Subject, state_at, vector
from kickdrift.analysis.reference import EPSILON, TIGHT, Reference, compared, distance, natural_scale, tolerances
from kickdrift.errors import InputError, RunError
from kickdrift.integrators.asked import Integrator, method_of
from kickdrift.integrators.scipy_methods import SciPyMethod
from kickdrift.run.simulation import Simulation

ANY = 1e3  # rtol and atol of an adaptive method whose one step is measured, whatever it thinks of it
ROUNDING = 50 * EPSILON  # local errors below it are no more than that
LARGE = 0.1  # errors above it are not yet ruled by the order
FITTED = 4  # of the finest points
FLAT = 0.7  # of the slopes before: below, rounding rules


class LocalErrors:
    """Errors of one step from a few points of a solution: root mean square over the points."""

    def __init__(
        self, subject: Subject, start: Any, plan: Reference, length: float, points: int, name: str, threads: int
    ) -> None:
        self.subject, self.threads, self.floor = subject, threads, ROUNDING
        self.starts = [start][:points]
        if plan.y is not None:
            samples = len(plan.y) - 1
            chosen = [round(samples * k / points) for k in range(1, points)]
            self.starts += [state_at(start, plan.y[k], start.time + length * k / samples) for k in chosen]
            self._scale = plan.scale
        else:
            self._scale = natural_scale(subject, vector(start)[None])
        self._reference = Simulation(
            subject, name, threads=threads, precision="double", **tolerances(subject, start, TIGHT[name][0][0], name)
        )

    def of(self, which: str | Integrator, step: float) -> float | None:
        """After one step of that length; None where it blows up, without points, and for methods that begin
        with steps of their own."""
        method = method_of(which)
        if isinstance(method, SciPyMethod) or not self.starts:
            return None
        given: dict[str, Any] = {key: ANY for key in ("rtol", "atol") if key in method.tunable}
        try:
            with np.errstate(all="ignore"):
                sim = Simulation(self.subject, which, dt=step, threads=self.threads, precision="double", **given)
                errors = [self._one(sim, start) for start in self.starts]
        except (RunError, ArithmeticError, InputError):
            return None
        found = float(np.sqrt(np.mean(np.square(errors))))
        return found if np.isfinite(found) else None

    def _one(self, sim: Simulation, start: Any) -> float:
        sim.state = start
        sim.run(1, every=1)
        self._reference.state = start
        self._reference.run(until=sim.time, every=2**40)  # a method that chooses its steps need not take dt
        difference = vector(sim.state) - vector(self._reference.state)
        return float(distance(compared(self.subject, difference), self._scale))


def slope(steps: Sequence[float], errors: Sequence[float | None], floor: float) -> float | None:
    """Of log error against log step, by the finest four points above the floor and before rounding shows: where errors
    stop falling as they did. None with fewer than three."""
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
