"""Integration with an implicit Runge-Kutta method: the iteration for the stages, and the step from them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from kickdrift.forces.seam.kernel import OK
from kickdrift.integrators.flows.particle_flow import ParticleFlow
from kickdrift.integrators.options.options import Options
from kickdrift.integrators.stepping.step_control import EPSILON
from kickdrift.integrators.stepping.stepper import STOPPED
from kickdrift.integrators.stepping.stepping import Retimed
from kickdrift.integrators.stepping.stepwise import PythonStepper, check_unknowns, factored
from kickdrift.model.memory import Memory
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow

ROUNDED = 1e-10  # a stalled increment below this fraction of y is rounding; above, the iteration diverges
LEFT = 1e-3 * EPSILON  # allowed error over y: its sign is the same in each step, and 0.1 of rounding showed as a drift
MOST = {"newton": 50, "fixed-point": 100}  # iterations
SLOW = 10  # from this many iterations on, a new Jacobian pays

Correction = Callable[[Floats, Floats], Floats]  # from the stages and their residual


class StageEquations(Protocol):
    """Numbers of an implicit Runge-Kutta method, as its steps use them; see ``ImplicitTableau``."""

    @property
    def name(self) -> str: ...

    @property
    def b(self) -> tuple[float, ...]: ...

    @property
    def c(self) -> tuple[float, ...]: ...

    @property
    def matrix(self) -> Floats: ...

    @property
    def increment(self) -> Floats: ...

    @property
    def extrapolation(self) -> Floats: ...


class ImplicitStepper(Retimed, PythonStepper):
    """Steps of one length. With Z_i = Y_i - y the stages solve Z = dt (a x I) F(Z).

    Newton's matrix I - dt a x J is kept from step to step while it converges quickly. The stages are kept for the next
    guess. So a run cut in pieces gives the same bits, and a run that starts anew at a step point agrees to rounding. A
    checkpoint holds the stages, the carries of compensated sums, and the place of J instead of the matrix.
    """

    saved = (*PythonStepper.saved, "_start", "_carry", "_stages", "_matrix_at")

    def __init__(self, flow: Flow, tableau: StageEquations, options: Options) -> None:
        super().__init__(flow)
        assert options.dt is not None
        self._tableau, self.dt, self._compensated = tableau, options.dt, options.compensated
        self.iteration = options.iteration or ("fixed-point" if isinstance(flow, ParticleFlow) else "newton")
        if self.iteration == "newton":
            check_unknowns(tableau.name, flow, '; iteration="fixed-point" needs none')

    def _forget(self) -> None:
        self._start = self.time - self.steps_done * self.dt
        self._carry = np.zeros_like(self.y)
        self._stages: Floats | None = None
        self._solve: Callable[[Floats], Floats] | None = None
        self._matrix_at: Any = None  # the time and the y of its Jacobian

    def recall(self, memory: Memory) -> None:
        """See Stepper."""
        super().recall(memory)
        if self._matrix_at:
            cost = replace(self._counts)
            self._solve = self._newton_matrix(*self._matrix_at)
            self._counts = cost

    def _step(self) -> int:
        z = self._find_stages()
        if z is None:
            return self._give_up()
        self._before[...] = self.y
        increment = np.tensordot(self._tableau.increment, z, 1)
        if self._compensated:  # like loops.add_compensated
            increment += self._carry
            self.y += increment
            self._carry = increment + (self._before - self.y)
        else:
            self.y += increment
        self._stages, self.last_step = z, self.dt
        self.time = self._start + (self.steps_done + 1) * self.dt
        return OK

    def _give_up(self) -> int:
        for c in self._tableau.c:
            f = self._f(self.time + c * self.dt, self.y)
            if not np.isfinite(f).all():  # not the iteration's fault
                return self._blow_up(f)
        other = ', or iteration="newton"' if self.iteration == "fixed-point" else ""
        self.trouble = (
            f"the {self.iteration} iteration for the stages does not converge with dt = {self.dt:g}; take a smaller "
            f"dt{other}"
        )
        return STOPPED

    # --- the stages ---

    def _find_stages(self) -> Floats | None:
        """Stages Z (s, *y.shape); None if no iteration converges."""
        nothing = np.zeros((len(self._tableau.b), *self.y.shape))
        guess = nothing if self._stages is None else np.tensordot(self._tableau.extrapolation, self._stages, 1)
        if self.iteration == "fixed-point":
            return self._iterate(guess, lambda z, residual: residual, memory=2)[0]
        if self._solve is not None:
            z, count = self._iterate(guess, self._simplified)
            if z is not None:
                if count > SLOW:
                    self._solve = self._matrix_at = None
                return z
        self._solve = self._newton_matrix(self.time, self.y)
        z, count = self._iterate(guess, self._simplified)
        if z is None:
            z, count = self._iterate(nothing, self._newton, patient=True)
        if count > SLOW:
            self._solve = self._matrix_at = None
        return z

    def _iterate(
        self, z: Floats, correct: Correction, memory: int = 1, patient: bool = False
    ) -> tuple[Floats | None, int]:
        """Correct z until only rounding is left. Return z, or None if that fails, and the number of iterations.

        The increments shrink at a rate. z is final once the remaining increments are below rounding, or stop shrinking
        while tiny (Hairer & Wanner 1996, IV.8; Hairer, Lubich & Wanner 2006, VIII.6). ``memory`` is the number of
        iterations for the rate: 2 if positions feel a force one iteration after the velocities. With ``patient``,
        increments may grow meanwhile.
        """
        h, c = self.dt, self._tableau.c
        sizes: list[float] = []
        for count in range(1, MOST[self.iteration] + 1):
            f = np.array([self._f(self.time + ci * h, self.y + zi) for ci, zi in zip(c, z, strict=True)])
            change = correct(z, h * np.tensordot(self._tableau.matrix, f, 1) - z)
            z = z + change
            size = self._relative(change, z)
            if size == 0.0:
                return z, count
            if not np.isfinite(size):
                return None, count
            if count > memory:
                rate = (size / sizes[-memory]) ** (1.0 / memory)
                if rate >= 1.0 and size <= ROUNDED:
                    return z, count
                if rate >= 1.0 and not patient:
                    return None, count
                if rate < 1.0 and size * rate <= LEFT * (1.0 - rate):
                    return z, count
            sizes.append(size)
        return None, MOST[self.iteration]

    def _relative(self, change: Floats, z: Floats) -> float:
        """Largest change over the largest position or velocity, each in its own unit."""
        axes = tuple(range(1, self.y.ndim))
        scale = np.abs(self.y).max(axis=axes) + np.abs(z).max(axis=(0, *(k + 1 for k in axes)))
        largest = np.abs(change).max(axis=(0, *(k + 1 for k in axes)))
        return float(np.where(scale > 0.0, largest / np.where(scale > 0.0, scale, 1.0), largest).max())

    def _simplified(self, z: Floats, residual: Floats) -> Floats:
        assert self._solve is not None
        return self._solve(residual.reshape(-1)).reshape(z.shape)

    def _newton(self, z: Floats, residual: Floats) -> Floats:
        """Compute the matrix anew, from the mean of the stages."""
        c = float(np.mean(self._tableau.c))
        self._solve = self._newton_matrix(self.time + c * self.dt, self.y + z.mean(axis=0))
        return self._simplified(z, residual)

    def _newton_matrix(self, time: float, y: Floats) -> Callable[[Floats], Floats]:
        self._matrix_at = [time, y.copy()]
        matrix = np.asarray(-np.kron(self.dt * self._tableau.matrix, self._jacobian(time, y)), dtype=float)
        np.einsum("ii->i", matrix)[...] += 1.0
        return factored(matrix)
