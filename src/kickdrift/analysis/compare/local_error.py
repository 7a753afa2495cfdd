"""Error of one step, and the slope of an error against the step."""

from __future__ import annotations

from collections.abc import Sequence
from math import log
from typing import Any

import numpy as np

from kickdrift.analysis.compare.pilot import Subject, state_at, vector
from kickdrift.analysis.compare.reference import (
    EPSILON,
    TIGHT,
    Reference,
    compared,
    distance,
    natural_scale,
    tolerances,
)
from kickdrift.errors import InputError, RunError
from kickdrift.integrators.asked import Integrator, method_of
from kickdrift.integrators.runge_kutta.scipy_methods import SciPyMethod
from kickdrift.run.simulation import Simulation

ANY = 1e3  # rtol and atol that make an adaptive method accept any step
ROUNDING = 50 * EPSILON  # smaller local errors are only rounding
LARGE = 0.1  # larger errors do not follow the order yet
FITTED = 4  # finest points in the fit
FLAT = 0.7  # part of the slopes before; a smaller slope shows rounding


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
        """Error after one step of that length. None if the step blows up, without points, and for methods whose first
        steps differ."""
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
        self._reference.run(until=sim.time, every=2**40)  # an adaptive method need not take dt as its first step
        difference = vector(sim.state) - vector(self._reference.state)
        return float(distance(compared(self.subject, difference), self._scale))


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
