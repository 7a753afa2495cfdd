"""Transits as a distant observer sees them: light from the planet and from its star takes its time."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from kickdrift.analysis.tangents.varied_run import VariedRun
from kickdrift.model.state import Floats

PASSES = 60  # most passes for a time; light needs some three
PARTS = 16  # of a run's step in one step to a neighbouring time, whose error then is some 1e-10 of a body's way


class Image(NamedTuple):
    """A body when the light leaves that the observer sees: relative to the barycentre, and along the columns."""

    left: float  # the time
    x: Floats
    v: Floats
    a: Floats
    dx: Floats  # (3, columns)
    dv: Floats


def from_barycentre(y: Floats, masses: Floats, row: int) -> Floats:
    """Both halves (2, 3) of y for a body, less those of the barycentre."""
    return np.asarray(y[:, :, row] - y[:, :, : len(masses)] @ masses / masses.sum())


def arrival(t: float, y: Floats, masses: Floats, row: int, sight: Floats, light: float) -> float:
    """When light arrives that leaves a body at a time t: later by its way from there to the barycentre's distance."""
    return t if math.isinf(light) else t - float(from_barycentre(y, masses, row)[0] @ sight) / light


class Retarded:
    """The times at which light of a run's bodies arrives, near the state y of the run at a time t.

    An observer far away in the direction ``sight``, at rest relative to the barycentre, sees each body at its own time
    of departure t, T = t - z(t) / c, with its height z towards the observer. So light from the barycentre arrives at
    the time T = t. A transit is x . w = 0 for the difference x of the images of planet and star on the sky, and its
    rate w = dx/dT. All derivatives are those of these two equations.
    """

    def __init__(self, run: VariedRun, pair: tuple[int, int], sight: Floats, light: float) -> None:
        self._run, self._pair, self._sight, self._light = run, pair, sight, light
        self._masses = run.system.state.masses
        self._of_masses = run.columns.of_masses(len(run.system))
        self._sky = np.eye(3) - np.outer(sight, sight)

    def transit(self, t: float, y: Floats, step: float) -> tuple[float, Floats, float, float]:
        """Time of arrival, its derivatives (columns,), distance and speed on the sky of the transit near the state y.
        ``step`` is the length of the run's steps there."""
        flow: Any = self._run.sim.integration.flow

        def moved(left: float) -> Floats:
            """y at a time close to t, by Runge and Kutta's method of order 4."""
            parts = max(1, math.ceil(PARTS * abs(left - t) / step))
            now, h = y, (left - t) / parts
            for k in range(parts):
                at = t + k * h
                one = flow.derivative(at, now).copy()
                two = flow.derivative(at + 0.5 * h, now + 0.5 * h * one).copy()
                three = flow.derivative(at + 0.5 * h, now + 0.5 * h * two).copy()
                now = now + h / 6.0 * (one + 2.0 * (two + three) + flow.derivative(at + h, now + h * three))
            return now

        def image(row: int, arrives: float, left: float) -> Image:
            for _ in range(PASSES):
                now = moved(left)
                x, v = self._of(now, row)
                late = (left - x @ self._sight / self._light - arrives) / (1.0 - v @ self._sight / self._light)
                if abs(late) <= 4e-16 * abs(left - t):
                    break
                left -= late
            dx, dv = self._along(now, row)
            return Image(left, x, v, self._of(flow.derivative(left, now), row)[1], dx, dv)

        arrives, last = arrival(t, y, self._masses, self._pair[0], self._sight, self._light), math.inf
        lefts = [t, t]
        for _ in range(PASSES):
            images = [image(row, arrives, left) for row, left in zip(self._pair, lefts, strict=True)]
            lefts = [each.left for each in images]
            (x, w, push), (dx, dw) = self._apart(*images)
            slope = w @ w + x @ push
            change = float(x @ w / slope)
            if abs(change) <= 4e-16 * abs(arrives) or abs(change) >= last:
                break
            arrives, last = arrives - change, abs(change)
        rates = -(w @ dx + x @ dw) / slope
        return arrives, rates, float(np.linalg.norm(x)), float(np.linalg.norm(w))

    def _of(self, y: Floats, row: int) -> Floats:
        """Both halves (2, 3) of y for a body, less the barycentre's."""
        return from_barycentre(y, self._masses, row)

    def _along(self, y: Floats, row: int) -> tuple[Floats, Floats]:
        """Derivatives (3, columns) of position and velocity relative to the barycentre."""
        phase, slopes = self._run.split(y)
        m = self._masses
        found = slopes[:, :, row] - np.einsum("hajc,j->hac", slopes, m) / m.sum()
        if self._of_masses is not None:
            from_centre = phase - (phase @ m / m.sum())[..., None]
            found = found - from_centre @ self._of_masses / m.sum()
        return found[0], found[1]

    def _apart(self, planet: Image, star: Image) -> tuple[tuple[Floats, Floats, Floats], tuple[Floats, Floats]]:
        """Differences of the images on the sky: place, rate and its rate, by the time of arrival; and derivatives of
        place and rate along the columns, at one time of arrival."""
        rows = []
        for each in (planet, star):
            q = 1.0 / (1.0 - each.v @ self._sight / self._light)  # dt/dT
            late = q * (self._sight @ each.dx) / self._light  # change of the time of departure, (columns,)
            dv = each.dv + np.outer(each.a, late)
            dq = q * q * (self._sight @ dv) / self._light
            push = q * q * (each.a + q * each.v * (each.a @ self._sight) / self._light)
            rows.append((each.x, q * each.v, push, each.dx + np.outer(each.v, late), q * dv + np.outer(each.v, dq)))
        x, w, push, dx, dw = (self._sky @ (one - other) for one, other in zip(*rows, strict=True))
        return (x, w, push), (dx, dw)
