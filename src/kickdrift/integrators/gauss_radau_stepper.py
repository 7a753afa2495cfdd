"""gauss-radau15 under way. The last step's polynomial is kept, so that y can be had inside it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kickdrift.forces.evaluate import EVALUATIONS, SLOTS
from kickdrift.forces.simd import WIDTH, aligned
from kickdrift.integrators.gauss_radau import STAGES, tables
from kickdrift.integrators.gauss_radau_loop import (
    BEFORE,
    CONVERGED,
    GUESS_LAST,
    LAST,
    MOST,
    NEXT,
    ROWS,
    STEP_LAST,
    TIME,
    V_BEFORE,
    X_BEFORE,
    V,
    X,
    gauss_radau_loop,
)
from kickdrift.integrators.loops import REJECTED, STEP
from kickdrift.integrators.stepping import STOPPED, Counts, Options
from kickdrift.state import Floats

if TYPE_CHECKING:
    from kickdrift.flow import Flow

FIRST = 0.01  # of the time in which the first acceleration moves particles by their distance, or y' the unknowns by y


class GaussRadauStepper:
    """An integration with ``eta`` the length of steps over the shortest time scale (see ``gauss_radau_step``)."""

    def __init__(self, flow: Flow, options: Options) -> None:
        self.rtol, _ = options.tolerances
        self.eta = (5040.0 * self.rtol) ** (1.0 / 7.0)
        self._flow, self._first = flow, options.dt
        self._velocities = flow.not_separable is not None
        self._cursor = np.zeros(SLOTS, np.int64)
        self._extra_evaluations = 0
        self.trouble = ""

    def reset(self, y: Floats, time: float, steps: int) -> None:
        self.y, self.steps_done = y, steps
        halves, size = y.shape[0], y[0].size
        width = WIDTH * -(-size // WIDTH)
        self._work = aligned((ROWS, width))
        self._work[V, :size] = self._work[V_BEFORE, :size] = y[-1].reshape(-1)
        if halves == 2:
            self._work[X, :size] = self._work[X_BEFORE, :size] = y[0].reshape(-1)
        self._flat = aligned((2, (halves - 1) * size + width))  # the trial state and its derivative
        self._trial, self._derivative = (row[: y.size].reshape(y.shape) for row in self._flat)
        self._clock = np.zeros(7)
        self._clock[[TIME, BEFORE]] = time
        self._cursor[STEP:REJECTED] = 0
        self._flow.forces.forget()

    @property
    def time(self) -> float:
        return float(self._clock[TIME])

    @property
    def last_step(self) -> float:
        """How long the step that led here was; 0 before the first."""
        return float(self._clock[STEP_LAST])

    @property
    def counts(self) -> Counts:
        return Counts(int(self._cursor[EVALUATIONS]) + self._extra_evaluations, int(self._cursor[REJECTED]))

    def advance(self, steps: int, until: float = np.inf) -> int:
        if self._clock[NEXT] == 0.0 and steps:
            self._clock[NEXT] = self._first or self._first_step()
        self._cursor[STEP] = 0
        status = self._flow.forces.call(
            gauss_radau_loop, self.y, self._trial, self._flat[0], self._derivative, self._flat[1], self._work,
            tables(), self._velocities, self.eta, self._clock, until, steps, self._cursor,
        )  # fmt: skip
        self.steps_done += int(self._cursor[STEP])
        if status == STOPPED:
            self.trouble = (
                f"the step fell to {self._clock[NEXT]:.3g}, which t = {self.time:.9g} can no longer tell from 0"
            )
        return status

    def _first_step(self) -> float:
        """Short enough; the next ones are up to four times as long each."""
        f = self._flow.derivative(self.time, self.y)
        self._extra_evaluations += 1

        def size(values: Floats) -> float:
            return float(np.sqrt(np.mean(np.square(values))))

        lengths = [size(part) / size(rate) for part, rate in zip(self.y, f, strict=True) if size(part) and size(rate)]
        if len(self.y) == 2 and size(self.y[0]) and size(f[1]):
            lengths.append(np.sqrt(size(self.y[0]) / size(f[1])))
        return FIRST * min((length for length in lengths if np.isfinite(length)), default=1.0)

    def at(self, time: float) -> Floats:
        """By a step of its own from the last one's start, for inside a step the polynomial has order 8 alone. It begins
        with that polynomial, and so takes few iterations."""
        begin, h = self._clock[BEFORE], self._clock[STEP_LAST]
        if time == self.time or h == 0.0:
            return self.y.copy()
        length, numbers = time - begin, tables()
        terms = self._work[LAST:GUESS_LAST, : self.y[0].size] * (length / h) ** np.arange(STAGES)[:, None]
        size, residual = np.abs(terms[0]).max(), np.inf
        for _ in range(MOST):
            for node in range(STAGES - 1):
                there = self._integrated(terms, length, node)
                found = self._flow.derivative(begin + numbers.nodes[node + 1] * length, there)[-1].reshape(-1)
                missed = found - numbers.values[node] @ terms
                terms += numbers.corrections[node][:, None] * missed
            largest = np.abs(missed).max()
            if not CONVERGED * size < largest < residual:
                break
            residual = largest
        return self._integrated(terms, length, -1)

    def _integrated(self, terms: Floats, length: float, node: int) -> Floats:
        """y at a node of a step of that length from the last one's start."""
        numbers, size = tables(), self.y[0].size
        sh = length * (numbers.nodes[node + 1] if node >= 0 else 1.0)
        v = self._work[V_BEFORE, :size]
        found = [v + sh * (numbers.velocities[node] @ terms)]
        if len(self.y) == 2:
            found.insert(0, self._work[X_BEFORE, :size] + sh * (v + sh * (numbers.positions[node] @ terms)))
        return np.array(found).reshape(self.y.shape)

    def reached(self, inside_step: bool) -> tuple[Floats, Floats]:
        before = self._work[X_BEFORE if len(self.y) == 2 else V_BEFORE, : self.y[0].size].reshape(self.y.shape[1:])
        return (self._trial, self.y[0]) if inside_step else (self.y, before)
