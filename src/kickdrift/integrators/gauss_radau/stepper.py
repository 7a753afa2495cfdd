"""Integration with gauss-radau15. The last step's polynomial is kept, so that y is known inside the step."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from kickdrift.forces.seam.kernel import OK
from kickdrift.integrators.gauss_radau import series
from kickdrift.integrators.gauss_radau.loop import gauss_radau_loop
from kickdrift.integrators.gauss_radau.step import MOST
from kickdrift.integrators.gauss_radau.tables import STAGES, tables
from kickdrift.integrators.options import Options
from kickdrift.integrators.stepping.chosen_steps import BEFORE, LAST, NEXT, TIME, ChosenSteps
from kickdrift.integrators.stepping.stepper import INNER
from kickdrift.integrators.stepping.stepping import CompiledSteps
from kickdrift.jit.lanes.memory import aligned
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow

FIRST = 0.01  # of the time in which the first acceleration moves particles by their distance, or y' the unknowns by y


@cache
def _sketch_rows() -> tuple[Floats, Floats]:
    """Weights (INNER, STAGES) of a polynomial's terms in positions and in velocities at INNER of a step."""
    numbers, parts = tables(), INNER[:, None]
    powers = parts ** np.arange(STAGES)
    return numbers.positions[-1] * powers * parts**2, numbers.velocities[-1] * powers * parts


@cache
def _shifted_back() -> Floats:
    """Matrix from the terms 1 … of a polynomial of s to those of the polynomial of s + 1 that equals it."""
    found: Floats = np.asarray(np.linalg.inv(tables().shifts[1:, 1:]), dtype=float)
    return found


def _memory(shape: tuple[int, ...]) -> tuple[Floats, Floats, Floats, Floats]:
    """Memory of the loop for y of a shape: the workspace; the trial state and its derivative, both flat and as y."""
    size = shape[1] * shape[2]
    width = series.BLOCK * -(-size // series.BLOCK)
    flat = aligned((2, (shape[0] - 1) * size + width))
    trial, derivative = (row[: shape[0] * size].reshape(shape) for row in flat)
    return aligned((series.ROWS, width)), flat, trial, derivative


class GaussRadauStepper(ChosenSteps):
    """Integration with ``eta`` the ratio of step to shortest time scale (see ``step``). A checkpoint
    holds its clock, both ends of the last step with their rounding errors, and that step's polynomial, found and
    predicted."""

    saved = (*ChosenSteps.saved, "_ends", "_polynomials")

    _aside: tuple[Floats, ...] | None = None  # y and the memory of steps that `at` takes

    def __init__(self, flow: Flow, options: Options) -> None:
        super().__init__(flow, options)
        rtol, _ = options.tolerances
        assert isinstance(rtol, float)
        self.eta = (5040.0 * rtol) ** (1.0 / 7.0)
        self._velocities = flow.not_separable is not None

    def reset(self, y: Floats, time: float, steps: int) -> None:
        self._begin(y, time, steps)
        size, self._aside = y[0].size, None
        self._work, self._flat, self._trial, self._derivative = _memory(y.shape)
        self._work[series.V, :size] = self._work[series.V_BEFORE, :size] = y[-1].reshape(-1)
        if len(y) == 2:
            self._work[series.X, :size] = self._work[series.X_BEFORE, :size] = y[0].reshape(-1)

    @property
    def _ends(self) -> Floats:
        return self._work[: series.NOW, : self.y[0].size]

    @_ends.setter
    def _ends(self, value: Floats) -> None:  # from a version with padded rows
        self._work[: series.NOW, : self.y[0].size] = value[:, : self.y[0].size]

    @property
    def _polynomials(self) -> Floats:
        return self._work[series.LAST : series.GUESS, : self.y[0].size]

    @_polynomials.setter
    def _polynomials(self, value: Floats) -> None:
        self._work[series.LAST : series.GUESS, : self.y[0].size] = value[:, : self.y[0].size]

    @property
    def compiled_steps(self) -> CompiledSteps:
        given = (
            self.y, self._trial, self._flat[0], self._derivative, self._flat[1], self._work, tables(), self._velocities,
            self.eta, self._longest, self.end, self.clip,
        )  # fmt: skip
        return gauss_radau_loop, self._flow.forces, given

    def _go(self, until: float, steps: int) -> int:
        loop, forces, given = self.compiled_steps
        return forces.call(loop, *given, self._clock, until, steps, self._cursor)

    def _first_step(self) -> float:
        """Length of a short first step; each of the next steps may be four times as long."""
        f = self._flow.derivative(self.time, self.y)
        self._extra_evaluations += 1

        def size(values: Floats) -> float:
            return float(np.sqrt(np.mean(np.square(values))))

        lengths = [size(part) / size(rate) for part, rate in zip(self.y, f, strict=True) if size(part) and size(rate)]
        if len(self.y) == 2 and size(self.y[0]) and size(f[1]):
            lengths.append(np.sqrt(size(self.y[0]) / size(f[1])))
        return FIRST * min((length for length in lengths if np.isfinite(length)), default=1.0)

    def at(self, time: float) -> Floats:
        """State at a time, by a step from the last one's start, because inside a step the polynomial has only order 8.
        The step begins with that polynomial, so it takes few iterations."""
        begin, h = self._clock[BEFORE], self._clock[LAST]
        if time == self.time or h == 0.0:
            return self.y.copy()
        if self._aside is None:
            self._aside = np.empty(self.y.shape), *_memory(self.y.shape)
        (y, work, flat, trial, derivative), length = self._aside, time - begin
        work[series.X : series.LOST_V + 1] = 0.0
        work[[series.X, series.V]] = self._work[[series.X_BEFORE, series.V_BEFORE]]
        terms = self._work[series.LAST + 1 : series.GUESS_LAST] * ((length / h) ** np.arange(1, STAGES))[:, None]
        work[series.LAST + 1 : series.GUESS_LAST] = _shifted_back() @ terms  # the loop shifts a last step's polynomial
        clock, cursor = np.zeros_like(self._clock), np.zeros_like(self._cursor)
        clock[[TIME, NEXT, LAST]] = begin, 2.0 * length, length
        given = y, trial, flat[0], derivative, flat[1], work, tables(), self._velocities, self.eta, np.inf, time, True
        if self._flow.apart().call(gauss_radau_loop, *given, clock, time, MOST, cursor) != OK:
            y[...] = np.nan
        return y.copy()

    def sketch(self) -> Floats:
        """See Stepper: by the polynomial of the last step, which has order 8."""
        h, size, (by_position, by_velocity) = self._clock[LAST], self.y[0].size, _sketch_rows()
        v, terms = self._work[series.V_BEFORE, :size], self._work[series.LAST : series.GUESS_LAST, :size]
        found = np.empty((len(INNER), *self.y.shape))
        found[:, -1] = (v + h * (by_velocity @ terms)).reshape(found[:, -1].shape)
        if len(self.y) == 2:
            x = self._work[series.X_BEFORE, :size] + h * (INNER[:, None] * v + h * (by_position @ terms))
            found[:, 0] = x.reshape(found[:, 0].shape)
        return found

    def reached(self, inside_step: bool) -> tuple[Floats, Floats]:
        row = series.X_BEFORE if len(self.y) == 2 else series.V_BEFORE
        before = self._work[row, : self.y[0].size].reshape(self.y.shape[1:])
        return (self._trial, self.y[0]) if inside_step else (self.y, before)
