"""Searches for transits: in the steps of a method that knows the state inside them, and between the steps of a map."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np

from kickdrift.analysis.tangents.columns import Columns
from kickdrift.analysis.tangents.map_run import MapRun
from kickdrift.analysis.tangents.varied_run import DEFAULT, VariedRun
from kickdrift.errors import InputError
from kickdrift.model.checks.limits import MOST_STEPS
from kickdrift.model.state import Floats

TURN = 0.5  # radians that the planet may move between two looks for a transit
WIDEST = 1.0  # radians that it may move in a step of a map
MOST = 60  # attempts to find a time: bisection alone needs some 50
Found = list[tuple[float, Floats, float, float]]  # times, their derivatives (columns,), distances and speeds


def angle(a: Floats, b: Floats) -> float:
    """Angle between two vectors."""
    return math.atan2(float(np.linalg.norm(np.cross(a, b))), float(a @ b))


class Search:
    """Search of a run's steps for transits."""

    def __init__(
        self, run: VariedRun, pair: tuple[int, int], sight: Floats, end: float, within: float, told: Any
    ) -> None:
        self._run, self._pair, self._end, self._within, self._told = run, pair, end, within, told
        self._sky, self._sight = np.eye(3) - np.outer(sight, sight), sight
        self._found: Found = []
        self._last: tuple[float, Floats] = run.time, self._stepper.y.copy()
        self._begin = run.time

    @property
    def _stepper(self) -> Any:
        return self._run.sim.integration.stepper

    def found(self) -> Found:
        """The transits until the end."""
        self._run.advance(MOST_STEPS, self._visit, 1)
        return self._found

    def _relative(self, y: Floats) -> Floats:
        """Relative position and velocity (2, 3)."""
        one, other = self._pair
        return np.asarray(y[:, :, one] - y[:, :, other])

    def _rate(self, y: Floats) -> float:
        """Half the rate of the squared distance on the sky."""
        x, u = self._relative(y)
        return float(x @ self._sky @ u)

    def _visit(self) -> bool:
        """Look for transits in the last step. Return whether the time is over."""
        stepper, (t0, y0) = self._stepper, self._last
        t1, y1 = stepper.time, stepper.y.copy()
        turned = angle(self._relative(y0)[0], self._relative(y1)[0])
        inside = np.linspace(t0, t1, 1 + max(1, math.ceil(turned / TURN)))
        looks = [(t0, y0), *((float(t), stepper.at(float(t))) for t in inside[1:-1]), (t1, y1)]
        for (begin, before), (end, after) in pairwise(looks):
            if self._rate(before) < 0.0 <= self._rate(after) and self._relative(after)[0] @ self._sight > 0.0:
                self._add(*self._refined(begin, end))
        self._last = t1, y1
        if self._told:
            self._told(int(1000 * min(1.0, (t1 - self._begin) / (self._end - self._begin))), 1000)
        return bool(t1 >= self._end)

    def _refined(self, low: float, high: float) -> tuple[float, Floats, float]:
        """The time between two times, the state y there, and the slope of the rate."""
        t = 0.5 * (low + high)
        for _ in range(MOST):
            y = self._stepper.at(t)
            rate, slope = self._rate(y), self._slope(t, y)
            low, high = (t, high) if rate < 0.0 else (low, t)
            step = -rate / slope if slope > 0.0 else math.inf
            after = t + step if low <= t + step <= high else 0.5 * (low + high)
            if abs(after - t) <= 4e-16 * max(abs(t), high - low):
                break
            t = after
        return t, y, slope

    def _slope(self, t: float, y: Floats) -> float:
        flow: Any = self._run.sim.integration.flow
        (x, u), push = self._relative(y), flow.derivative(t, y)[1]
        one, other = self._pair
        return float(u @ self._sky @ u + x @ self._sky @ (push[:, one] - push[:, other]))

    def _add(self, t: float, y: Floats, slope: float) -> None:
        (x, u), (_, slopes) = self._relative(y), self._run.split(y)
        distance, speed = (float(np.linalg.norm(self._sky @ each)) for each in (x, u))
        if t > self._end or distance > self._within:
            return
        one, other = self._pair
        dx, du = slopes[:, :, one] - slopes[:, :, other]
        self._found.append((t, -(u @ self._sky @ dx + x @ self._sky @ du) / slope, distance, speed))


def found_by_map(
    run: MapRun, columns: Columns, pair: tuple[int, int], sight: Floats, end: float, within: float, told: Any
) -> Found:
    """The transits of a run by a map. From the step point before a transit, the motion and its derivatives go on by
    gauss-radau15 up to the transit: a map has no states inside its steps."""
    found: Found = []
    sky, begin = np.eye(3) - np.outer(sight, sight), run.time
    phase, slopes = run.now()
    while run.time < end:
        start, before, rates = run.time, phase, slopes
        run.advance(1)
        phase, slopes = run.now()
        (x0, u0), (x1, u1) = (y[:, :, pair[0]] - y[:, :, pair[1]] for y in (before, phase))
        turned = angle(x0, x1)
        if turned > WIDEST:
            raise InputError(
                f"dt: {run.system.body(pair[0])} turns by {turned:.2g} radians in a step of {run.sim.integrator}; "
                f"transits need steps that turn it by at most {WIDEST:g}"
            )
        if x0 @ sky @ u0 < 0.0 <= x1 @ sky @ u1 and x1 @ sight > 0.0:
            onward = VariedRun(run.system.at(before, start), columns, DEFAULT, run.sim.threads, {}, begun=rates)
            found += Search(onward, pair, sight, min(end, run.time + 0.5 * run.dt), within, None).found()[:1]
        if told:
            told(int(1000 * min(1.0, (run.time - begin) / (end - begin))), 1000)
    return found
