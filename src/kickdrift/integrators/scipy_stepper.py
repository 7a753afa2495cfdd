"""A solver of SciPy's under way."""

from __future__ import annotations

import warnings
from dataclasses import replace
from operator import attrgetter
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import integrate
from scipy.linalg import LinAlgError

from kickdrift.forces.kernel import BLOWN_UP, OK
from kickdrift.integrators.step_control import check_tolerances
from kickdrift.integrators.stepping import STOPPED, Counts, Options
from kickdrift.integrators.stepwise import PythonStepper, check_unknowns
from kickdrift.memory import Memory, by_value, put_back
from kickdrift.state import Floats

if TYPE_CHECKING:
    from kickdrift.flow import Derivative, Flow
    from kickdrift.integrators.scipy_methods import SciPyMethod


# What a solver keeps from step to step, its settings left out (SciPy 1.17).
POINT = ("t", "y", "t_old", "status", "nfev", "njev", "nlu")
MATRIX = ("h_abs", "h_abs_old", "error_norm_old", "jac_factor", "J")
RETAKEN = 10_000  # steps for a look inside a step, at most; a solution that went astray may ask for any number
OF_LSODA = "_lsoda_solver._integrator"
SOLVER_KEEPS = {
    "BDF": (*POINT, *MATRIX, "LU", "D", "order", "n_equal_steps"),
    "Radau": (*POINT, *MATRIX, "LU_real", "LU_complex", "current_jac", "f", "Z", "y_old"),
    "LSODA": (
        *POINT, "_lsoda_solver.t", "_lsoda_solver._y",
        *(f"{OF_LSODA}.{key}" for key in ("rwork", "iwork", "state_doubles", "state_ints", "istate", "success")),
    ),
}  # fmt: skip


class SciPyStepper(PythonStepper):
    """One of ``scipy.integrate.OdeSolver``, with no end to reach, so that its steps depend on none.

    All that it keeps from step to step is inside the solver; one that begins anew at a step point takes other steps. A
    checkpoint holds what is in there, by value, the factors of its matrices and LSODA's working memory included.
    """

    keeps = (*PythonStepper.keeps, "_jacobians_before")

    def __init__(self, flow: Flow, method: SciPyMethod, options: Options) -> None:
        super().__init__(flow)
        self.rtol, self.atol = options.tolerances
        check_tolerances(self.rtol, self.atol)
        check_unknowns(method.name, flow)
        self._method, self._first = method, options.dt
        self._analytic = flow.analytic
        self._jacobians_before = 0

    def _forget(self) -> None:
        self._jacobians_before = self.counts.jacobians
        self._solver: Any = None
        self._bad: Floats | None = None  # where f was no number

    @property
    def counts(self) -> Counts:
        counts = super().counts
        if not self._analytic:  # the solver takes differences of f, which counts itself
            solver = getattr(self, "_solver", None)
            counts.jacobians = self._jacobians_before + (int(solver.njev) if solver else 0)
        return counts

    def _right_hand_side(self, time: float, y: Floats) -> Floats:
        f = self._f(time, y.reshape(self.y.shape))
        self._bad = None if np.isfinite(f).all() else y.reshape(self.y.shape) + f
        return f.reshape(-1)

    def _begin(self, time: float, y: Floats, first: float | None) -> Any:
        return self._solver_of(self._right_hand_side, self._jacobian, time, y, np.inf, first)

    def _solver_of(
        self, f: Derivative, jacobian: Derivative, time: float, y: Floats, end: float, first: float | None
    ) -> Any:
        def jac(time: float, y: Floats) -> Floats:
            return jacobian(time, y.reshape(self.y.shape))

        return getattr(integrate, self._method.solver)(
            f, time, y.reshape(-1).copy(), end, first_step=first, rtol=self.rtol, atol=self.atol,
            jac=jac if self._analytic else None,
        )  # fmt: skip

    def memory(self) -> Memory:
        """See Stepper."""
        keeps = SOLVER_KEEPS[self._method.solver]
        solver = None if self._solver is None else {key: by_value(attrgetter(key)(self._solver)) for key in keeps}
        if solver and "D" in solver:
            solver["D"] = solver["D"][: solver["order"] + 2]  # BDF fills the further rows before it reads them
        return {**super().memory(), "solver": solver}

    def recall(self, memory: Memory) -> None:
        """See Stepper."""
        super().recall(memory)
        if memory["solver"] is None:
            return
        cost = replace(self._counts)
        self._solver = solver = self._begin(self.time, self.y, 1.0)
        for key, value in memory["solver"].items():
            if key == "D":
                solver.D[: len(value)] = value
            else:
                put_back(solver, key, value)
        if self._method.solver == "Radau":
            solver.sol = solver._compute_dense_output()
        if self._method.solver == "LSODA":
            attrgetter(OF_LSODA)(solver).call_args[3] = 2  # it has begun
        self._counts = cost
        if self._lists:
            self._lists.recall(memory["forces"])  # beginning has used them

    def _step(self) -> int:
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            try:
                self._solver = self._solver or self._begin(self.time, self.y, self._first)
                message = self._solver.step()
                failed = self._solver.status == "failed" or not np.isfinite(self._solver.y).all()
            except (ValueError, RuntimeError, LinAlgError) as error:  # of matrices and states that are no numbers
                message, failed = str(error), True
        if failed:
            if self._bad is not None:
                self._reached = self._bad
                return BLOWN_UP
            reasons = [str(warning.message) for warning in said] or [message or "the solution is no number"]
            self.trouble = f"SciPy's {self._method.solver} gave up: {' '.join(reasons[-1].split())}"
            return STOPPED
        self._before, self.y = self.y, self._solver.y.reshape(self.y.shape).copy()
        self.last_step, self.time = float(self._solver.t - self.time), float(self._solver.t)
        return OK

    def at(self, time: float) -> Floats:
        """By steps from the last step point that end there, thrown away: inside a long step of a stiff problem SciPy's
        interpolants are off by a thousand tolerances."""
        if time == self.time or self._solver is None:
            return self.y.copy()
        shape, derivative = self.y.shape, self._flow.derivative
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            solver = self._solver_of(
                lambda time, y: derivative(time, y.reshape(shape)).reshape(-1), self._flow.jacobian,
                self.time - self.last_step, self._before, time, None,
            )  # fmt: skip
            for _ in range(RETAKEN):
                if solver.status == "running":
                    solver.step()
        found = solver.y if solver.status == "finished" else self._solver.dense_output()(time)
        return found.reshape(shape).copy()
