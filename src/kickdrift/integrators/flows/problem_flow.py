"""Flow of a Problem: the view that integrators have of it."""

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.forces.equations.equation import check_right_hand_side, right_hand_side
from kickdrift.forces.seam.kernel import OK
from kickdrift.integrators.flows.jacobian import difference_jacobian
from kickdrift.looks.observers import Energies, Looks, Sample
from kickdrift.looks.record import Record
from kickdrift.model.checks.values import check_state
from kickdrift.model.problem import Problem, ProblemState
from kickdrift.model.state import Floats


class ProblemFlow:
    """Solution of a Problem."""

    clocked = True  # see ParticleFlow
    of_particles = False

    def __init__(self, problem: Problem, threads: int, jumps: bool) -> None:
        self.subject = problem
        self.name = problem.name
        self.halves = 2 if problem.separable else 1
        known = "right_hand_side" in vars(problem)
        self._callback = right_hand_side(problem).callback
        if known:  # names outside f may have changed since compilation
            check_right_hand_side(problem, right_hand_side(problem))
        self.forces = BoundForces(EquationAsForce(problem), threads)
        self.not_separable = None if problem.separable else "the problem is not declared separable=True"

    def state(self, y: Floats, time: float, steps: int) -> ProblemState:
        """Copy of y as a ProblemState."""
        return ProblemState(y.reshape(-1).copy(), time, steps)

    def array(self, state: ProblemState) -> Floats:
        """Checked copy of a ProblemState as y."""
        check_state(state, ProblemState)
        y = np.array(state.y, dtype=float)
        if y.shape != self.subject.y0.shape:
            raise InputError(f"state: expected y of shape {self.subject.y0.shape}, got {y.shape}")
        if not np.isfinite(y).all():
            raise InputError("state: y must be finite")
        return y.reshape((self.halves, 1, -1))

    @property
    def raised(self) -> BaseException | None:
        """Error raised by Python code in f."""
        return self._callback.error

    def begin(self, record: Record, y: Floats) -> None:
        """Do nothing: only the samples are compared."""
        record.begun = True

    def look(self, looks: Looks, y: Floats, time: float, step: int, last: Floats, fresh: bool = False) -> int:
        """Fill the table's next row with a sample of y, and ``last`` with y. Return a status."""
        looks.fill(self.sample(y, time, step))
        last[...] = y
        return OK

    def looking(self, fresh: bool) -> None:
        """Return None: each sample calls Python."""

    def look_cost(self, fresh: bool) -> float:
        """Return 0: a sample evaluates no right-hand side."""
        return 0.0

    def sample(self, y: Floats, time: float, steps: int, fresh: bool = False) -> Sample:
        """Sample of the problem's conserved quantity at y."""
        energy = self.subject.energy
        try:
            value = float(energy(time, y.reshape(-1).copy())) if energy else float("nan")
        except Exception as error:  # whatever a user's function raises
            line = " ".join(f"{type(error).__name__}: {error}".split())
            raise InputError(f"step {steps} (t = {time:.6g}): energy raised {line}") from error
        return Sample(steps, time, Energies(float("nan"), float("nan"), value))

    def forget_errors(self) -> None:
        """Forget earlier errors of f, which do not concern the coming steps."""
        self._callback.forget_error()

    def prepare(self, y: Floats, time: float) -> None:
        """Do nothing: the right-hand side is compiled already."""

    def derivative(self, time: float, y: Floats) -> Floats:
        """f(t, y)."""
        return self.forces.derivative(time, y)

    def apart(self) -> BoundForces:
        """Forces for other y than the run's: a Problem's have no lists."""
        return self.forces

    @property
    def analytic(self) -> bool:
        """Tell whether the problem gives its Jacobian."""
        return self.subject.jacobian is not None

    def jacobian(self, time: float, y: Floats) -> Floats:
        """Jacobian (n, n) df_i / dy_j, analytic if the problem gives it."""
        if self.subject.jacobian is None:
            return difference_jacobian(self.derivative, time, y)
        value = np.asarray(self.subject.jacobian(time, y.reshape(-1).copy()), dtype=float)
        return value.reshape(len(self.subject), -1)

    def explain(self, y: Floats, before: Floats, good: Floats, step: int, time: float, good_step: int) -> str:
        """One line about a blow-up, or about an error of f."""
        if (error := self.raised) is not None:
            return " ".join(f"step {step} (t = {time:.6g}): f raised {type(error).__name__}: {error}".split())
        flat = y.reshape(-1)
        bad = np.flatnonzero(~np.isfinite(flat))
        worst = int(bad[0]) if bad.size else int(np.argmax(np.abs(flat)))
        what = f"y[{worst}] is {flat[worst]:.3g}"
        return f"blew up at step {step} (t = {time:.6g}): {what}; the last good point is step {good_step}"

    def meeting(self, y: Floats, time: float) -> str:
        """Return no text."""
        return ""


class EquationAsForce:
    """A Problem under its right-hand side as the only force."""

    def __init__(self, problem: Problem) -> None:
        self.name = problem.name
        self.forces = (right_hand_side(problem),)
        self.separable = problem.separable
        self._problem = problem

    def __len__(self) -> int:
        return len(self._problem)
