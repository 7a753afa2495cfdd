"""Shared parts of the implicit steppers: steps taken one by one in Python, around the flow's compiled derivative.

LAPACK's linear algebra takes most of their time, so the loop around it may stay readable.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from scipy.linalg import LinAlgWarning, lu_factor, lu_solve

from kickdrift.errors import InputError, RunError
from kickdrift.forces.seam.kernel import BLOWN_UP, OK
from kickdrift.integrators.flows.jacobian import NEWTON_UNKNOWNS
from kickdrift.integrators.stepping.stepper import Counts
from kickdrift.integrators.stepping.stepping import Resumable
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow


class PythonStepper(Resumable):
    """Steps taken one by one. A method supplies ``_step`` and the state that it forgets at a new start.

    A checkpoint holds the start of the last step, the cost of the run, and the method's additions.
    """

    saved: ClassVar[tuple[str, ...]] = (
        "_counts.evaluations", "_counts.rejected", "_counts.jacobians", "last_step", "_before",
    )  # fmt: skip

    def __init__(self, flow: Flow) -> None:
        self._flow = flow
        self._counts = Counts()
        self.trouble = ""

    def reset(self, y: Floats, time: float, steps: int) -> None:
        self.y, self.time, self.steps_done = y, time, steps
        self.last_step = 0.0
        self._before, self._reached = y.copy(), y
        self._flow.forces.forget()
        self._forget()

    def _forget(self) -> None:
        """Drop the state kept from step to step."""
        raise NotImplementedError

    def _step(self) -> int:
        """Take a step with ``y`` and ``time``. Return a status."""
        raise NotImplementedError

    def _fits(self) -> bool:
        """Tell whether the next step can be tried without f beyond ``end``. Costs and changes nothing."""
        return True

    @property
    def counts(self) -> Counts:
        return replace(self._counts)

    def advance(self, steps: int, until: float = np.inf) -> int:
        if steps == 0:
            self._flow.derivative(self.time, self.y)  # compiles the code of a step, and leaves the run's lists alone
        with np.errstate(all="ignore"):  # a trial that overflows has failed
            for _ in range(steps):
                if self.time >= until or not (self.clip or self.end == np.inf or self._fits()):
                    break
                status = self._step()
                if status != OK:
                    return status
                self.steps_done += 1
        return OK

    def at(self, time: float) -> Floats:
        return self.y.copy()

    def reached(self, inside_step: bool) -> tuple[Floats, Floats]:
        return (self._reached, self.y[0]) if inside_step else (self.y, self._before[0])

    def _f(self, time: float, y: Floats) -> Floats:
        """Return f(t, y), through the run's own pair lists: samples must not change its bits."""
        self._counts.evaluations += 1
        return self._flow.forces.derivative(time, y)

    def _jacobian(self, time: float, y: Floats) -> Floats:
        """Jacobian (N, N) of the flattened y, which depends only on y: the problem's own, else differences."""
        self._counts.jacobians += 1
        self._counts.evaluations += 0 if self._flow.analytic else 2 * y.size
        try:
            return self._flow.jacobian(time, y)
        except (ArithmeticError, LookupError, TypeError, ValueError) as error:
            what = " ".join(str(error).split())
            raise RunError(
                f"step {self.steps_done + 1} (t = {time:.6g}): the Jacobian raised {type(error).__name__}: {what}"
            ) from error

    def _blow_up(self, f: Floats) -> int:
        """Set y after f at the last step point is not finite."""
        self._reached = self.y + f
        return BLOWN_UP


def check_unknowns(name: str, flow: Flow, hint: str = "") -> None:
    """Raise InputError for a Jacobian that is too large."""
    unknowns = flow.array(flow.subject.state).size  # type: ignore[arg-type]
    if unknowns > NEWTON_UNKNOWNS:
        raise InputError(f"{name}: needs the Jacobian of {unknowns} unknowns; the limit is {NEWTON_UNKNOWNS}{hint}")


def factored(matrix: Floats) -> Callable[[Floats], Any]:
    """Solver of linear systems with this matrix. For a singular one, the solution is infinite or NaN."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LinAlgWarning)
        factors = lu_factor(matrix, overwrite_a=True, check_finite=False)
    return lambda right: lu_solve(factors, right, check_finite=False)
