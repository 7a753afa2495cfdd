"""Integration with a solver of SciPy."""

from __future__ import annotations

import warnings
from dataclasses import replace
from operator import attrgetter
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy import integrate
from scipy.linalg import LinAlgError

from kickdrift.errors import InputError
from kickdrift.forces.seam.kernel import BLOWN_UP, OK
from kickdrift.integrators.options import Options
from kickdrift.integrators.stepping.step_control import EPSILON, first_step, tolerances_of
from kickdrift.integrators.stepping.stepper import STOPPED, Counts
from kickdrift.integrators.stepping.stepwise import PythonStepper, check_unknowns
from kickdrift.model.memory import Memory, by_value, put_back
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.flows.jacobian import Derivative


# State that a solver keeps from step to step, without its settings (SciPy 1.17).
AT_POINT = ("t", "y", "t_old", "status", "nfev", "njev", "nlu")
MATRIX = ("h_abs", "h_abs_old", "error_norm_old", "jac_factor", "J")
RETAKEN = 10_000  # most steps for a sample inside a step; a solution that went astray may ask for any number
OF_LSODA = "_lsoda_solver._integrator"
NEXT_OF_LSODA = 11  # index in its rwork of the next step to try (HCUR)
FIRST_ORDER = {"BDF": 1, "Radau": 3, "LSODA": 1}  # order in the error of a first step
SOLVER_STATE = {
    "BDF": (*AT_POINT, *MATRIX, "LU", "D", "order", "n_equal_steps"),
    "Radau": (*AT_POINT, *MATRIX, "LU_real", "LU_complex", "current_jac", "f", "Z", "y_old"),
    "LSODA": (
        *AT_POINT, "_lsoda_solver.t", "_lsoda_solver._y",
        *(f"{OF_LSODA}.{key}" for key in ("rwork", "iwork", "state_doubles", "state_ints", "istate", "success")),
    ),
}  # fmt: skip


class Places(NamedTuple):
    """Places of LSODA's whole numbers: equal in every run of a system, orders, or matrix rows."""

    same: list[int]
    few: list[int] | slice


LSODA_INTS = Places([*range(1, 7), 13, 30, 31, 32, 33, 44, 46, 47], [14, 16, 26, 27, 28, 29, 34, 38, 45])
LSODA_WORK = Places([16, 17], slice(20, None))
LSODA_ORDERS = 13  # highest order and one more
LSODA_SIZE = 18  # index in state_ints: used numbers of its table of differences


class SciPyStepper(PythonStepper):
    """Integration with a ``scipy.integrate.OdeSolver`` without an end time, so that its steps depend on none.

    The length of the first step is computed here: SciPy's LSODA derives it from the end, and fails where f is zero at
    the start. The solver holds all state from step to step; a new one at a step point takes other steps. A checkpoint
    holds this state by value, including the factors of its matrices and LSODA's working memory.
    """

    saved = (*PythonStepper.saved, "_jacobians_before")

    def __init__(self, flow: Flow, name: str, solver: str, options: Options) -> None:
        super().__init__(flow)
        self.rtol, self.atol = tolerances_of(flow, options)
        check_unknowns(name, flow)
        self._name, self._solver_class = name, solver
        self._first, self._longest = options.dt, options.longest
        self._analytic = flow.analytic
        self._jacobians_before = 0

    def _forget(self) -> None:
        self._jacobians_before = self.counts.jacobians
        self._solver: Any = None
        self._bad: Floats | None = None  # value of f that was not finite

    @property
    def counts(self) -> Counts:
        counts = super().counts
        if not self._analytic:  # the solver's differences of f, which counts itself
            solver = getattr(self, "_solver", None)
            counts.jacobians = self._jacobians_before + (int(solver.njev) if solver else 0)
        return counts

    def _right_hand_side(self, time: float, y: Floats) -> Floats:
        if self.end < time <= self.end + 4 * np.spacing(abs(self.end)):
            time = self.end  # t + c h may round beyond the end
        f = self._f(time, y.reshape(self.y.shape))
        self._bad = None if np.isfinite(f).all() else y.reshape(self.y.shape) + f
        return f.reshape(-1)

    def _begin(self, time: float, y: Floats, first: float | None) -> Any:
        return self._solver_of(self._right_hand_side, self._jacobian, time, y, np.inf, first)

    def _first_step(self, derivative: Derivative) -> float | None:
        f = derivative(self.time, self.y)
        if self._first or not np.isfinite(f).all():
            return self._first or 1e-6  # the step itself will report the problem
        order, limits = FIRST_ORDER[self._solver_class], (self.end, self.clip)
        return first_step(derivative, self.time, self.y, f, order, self.rtol, self.atol, *limits)

    def _fits(self) -> bool:
        solver, least = self._solver, 10.0 * np.spacing(abs(self.time))
        if solver is None:
            h = self._first_step(self._flow.derivative)
        elif self._solver_class == "LSODA":
            h = float(attrgetter(OF_LSODA)(solver).rwork[NEXT_OF_LSODA]) * (1.0 + 4.0 * EPSILON)
        else:
            h = max(float(solver.h_abs), least)
        return h is not None and self.time + min(h, self._longest) <= self.end

    def _bound(self) -> None:
        """Pass the end of the steps to the solver."""
        solver, end = self._solver, self.end if self.clip else np.inf
        solver.t_bound, solver.status = end, "running"
        if self._solver_class == "LSODA":
            attrgetter(OF_LSODA)(solver).rwork[0] = end

    def _solver_of(
        self, f: Derivative, jacobian: Derivative, time: float, y: Floats, end: float, first: float | None
    ) -> Any:
        def jac(time: float, y: Floats) -> Floats:
            return jacobian(time, y.reshape(self.y.shape))

        alike, least = bool(np.ptp(self.rtol) == 0.0), float(self.rtol.min())
        one = alike or self._solver_class != "LSODA"
        solver = getattr(integrate, self._solver_class)(
            f, time, y.reshape(-1).copy(), end, first_step=first, max_step=self._longest,
            rtol=least if one else self.rtol, atol=self.atol, jac=jac if self._analytic else None,
        )  # fmt: skip
        if not alike:
            solver.rtol = self.rtol  # BDF and Radau use one number for their Newton iterations, the smallest
        return solver

    def memory(self) -> Memory:
        """See Stepper."""
        saved = SOLVER_STATE[self._solver_class]
        solver = None if self._solver is None else {key: by_value(attrgetter(key)(self._solver)) for key in saved}
        if solver and "D" in solver:
            solver["D"] = solver["D"][: solver["order"] + 2]  # BDF fills the further rows before reading them
        return {**super().memory(), "solver": solver}

    def recall(self, memory: Memory) -> None:
        """See Stepper."""
        super().recall(memory)
        if memory["solver"] is None:
            return
        cost = replace(self._counts)
        self._solver = solver = self._begin(self.time, self.y, 1.0)
        known = self._checked(memory["solver"])
        for key, value in known.items():
            if key == "D":
                solver.D[: len(value)] = value
            else:
                put_back(solver, key, value)
        if self._solver_class == "Radau":
            solver.sol = solver._compute_dense_output()
        if self._solver_class == "LSODA":
            attrgetter(OF_LSODA)(solver).call_args[3] = 2  # it is initialised
        self._counts = cost
        if self._lists:
            self._lists.recall(memory["forces"])  # the initialisation used them

    def _checked(self, memory: Memory) -> Memory:
        """Checked state of this solver. LAPACK and LSODA check no bounds, so invalid indices raise InputError."""
        known = {key: memory[key] for key in SOLVER_STATE[self._solver_class]}
        n, fits = self.y.size, True
        for key in [key for key in known if key.startswith("LU")]:
            if known[key] is not None:
                factors, pivots = known[key]
                fits &= factors.shape == (n, n) and factors.dtype.kind in "fc" and pivots.shape == (n,)
                fits &= pivots.dtype.kind == "i" and bool(np.all((pivots >= 0) & (pivots < n)))
        if self._solver_class == "LSODA":
            fresh = self._solver_of(lambda t, y: 0.0 * y, lambda t, y: np.zeros((n, n)), 0.0, self.y, np.inf, 1.0)
            fresh.step()
            fits &= 0 <= int(known[f"{OF_LSODA}.state_ints"][LSODA_SIZE]) <= LSODA_ORDERS * n
            for key, places, most in (("state_ints", LSODA_INTS, LSODA_ORDERS), ("iwork", LSODA_WORK, n)):
                given, own = known[f"{OF_LSODA}.{key}"], getattr(attrgetter(OF_LSODA)(fresh), key)
                fits &= given.shape == own.shape and given.dtype == own.dtype
                fits &= bool(np.array_equal(given[places.same], np.asarray(own)[places.same]))
                fits &= bool(np.all((given[places.few] >= 0) & (given[places.few] <= most)))
        if not fits:
            raise InputError(f"checkpoint: the state that {self._name} stored belongs to another system")
        return known

    def _step(self) -> int:
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            try:
                if self._solver is None:
                    first = min(self._first_step(self._f) or np.inf, self._longest, self.end - self.time)
                    self._solver = self._begin(self.time, self.y, first)
                self._bound()
                message = self._solver.step()
                failed = self._solver.status == "failed" or not np.isfinite(self._solver.y).all()
            except (ValueError, RuntimeError, LinAlgError) as error:  # for matrices and states that are not finite
                message, failed = str(error), True
        if failed:
            if self._bad is not None:
                self._reached = self._bad
                return BLOWN_UP
            reasons = [str(warning.message) for warning in said] or [message or "the solution is not finite"]
            self.trouble = f"SciPy's {self._solver_class} stopped: {' '.join(reasons[-1].split())}"
            return STOPPED
        self._before, self.y = self.y, self._solver.y.reshape(self.y.shape).copy()
        self.last_step, self.time = float(self._solver.t - self.time), float(self._solver.t)
        return OK

    def at(self, time: float) -> Floats:
        """State at a time, by discarded steps from the last step point that end there. Inside a long step of a stiff
        problem SciPy's interpolants are off by a thousand tolerances."""
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
