"""The methods of ``kickdrift.solve``: our steppers and SciPy's solvers, each with its options, f, and report."""

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple
from warnings import warn

import numpy as np
from scipy import integrate, sparse

from kickdrift.engines import NATIVE
from kickdrift.engines import engine as engine_named
from kickdrift.engines.job import Job
from kickdrift.errors import InputError
from kickdrift.forces.equations.code import CompileError
from kickdrift.integrators import integrator as method_named
from kickdrift.integrators.asked import settled, unpacked
from kickdrift.integrators.flows.flow import flow_of
from kickdrift.integrators.flows.problem_flow import ProblemFlow
from kickdrift.integrators.method import Method
from kickdrift.integrators.options import ATOL, RTOL, Options
from kickdrift.integrators.runge_kutta.scipy_methods import SciPyMethod
from kickdrift.integrators.stepping.step_control import LEAST_RTOL
from kickdrift.looks.observers import Energies, Sample
from kickdrift.looks.record import STEPPING, Record
from kickdrift.model.problem import Partial, Problem, ProblemState
from kickdrift.model.run_defaults import RunDefaults
from kickdrift.run.advance import Integration
from kickdrift.run.report.report import Report, report
from kickdrift.run.solve.steps import NoSteps, OwnSteps, Shape
from kickdrift.run.solve.walk import Walk
from kickdrift.text import shown

NAMES = {  # SciPy's names, and ours
    "RK23": "bogacki-shampine23",
    "RK45": "dormand-prince45",
    "DOP853": "dop853",
    "Radau": "radau",
    "BDF": "bdf",
    "LSODA": "lsoda",
}
SAMPLES = 1000  # most samples of the energy
SCIPYS_OWN = ("jac_sparsity", "lband", "uband", "min_step")  # options of SciPy's solvers alone
LEAST_ATOL = float(np.finfo(float).tiny)


class Asked(NamedTuple):
    """The problem as the user gave it."""

    f: Callable[..., Any]
    t0: float
    t1: float
    y0: Any
    args: tuple[Any, ...]
    vectorized: bool
    separable: bool
    jac: Any
    compiled: bool | None

    def problem(self, shape: Shape, partial: Partial, compiled: bool, jacobian: Any = None) -> Problem:
        """The problem for compiled loops: real numbers, and time that grows."""
        start, name = shape.row(self.y0), getattr(self.f, "__name__", "f")
        return Problem(
            partial, start, jacobian, t0=shape.way * self.t0, separable=self.separable, compiled=compiled, name=name
        )

    def compiled_or_not(self, made: Callable[[bool], Any]) -> tuple[Any, list[str]]:
        """The result of ``made(compiled)``, and a warning where f does not compile."""
        if self.compiled is not None:
            return made(bool(self.compiled)), []
        try:
            return made(True), []
        except CompileError as error:
            line = str(error).replace("; compiled=False runs it as plain Python, slowly", "")
            return made(False), [f"runs as plain Python, slowly: {line}"]


@dataclass
class _Run:
    """Attributes that the report of a solution needs; see ``run.report.Reported``."""

    system: Any
    integrator: str
    method: Method
    options: Options
    record: Record
    state: ProblemState
    stopped: str = ""
    events: Sequence[dict[str, Any]] = ()
    engine: str = NATIVE
    engine_version: str | None = engine_named(NATIVE).version
    threads: int = 1
    processes: int = 1

    @property
    def dt(self) -> float | None:
        return self.options.dt

    def going_on(self) -> list[dict[str, Any]]:
        return []


@dataclass
class Prepared:
    """Steps ready to be taken.

    Attributes
    ----------
    steps : `OwnSteps`, `NoSteps`, or a solver of SciPy
    alternative : whether SciPy's interpolants of two steps meet in another way, see ``scipy.integrate.OdeSolution``
    """

    asked: Asked
    steps: Any
    name: str
    method: Method
    options: Options
    problem: Problem | None
    warnings: list[str]
    alternative: bool = False

    def report(self, found: Walk, energy: Any, wall: float, compiling: float) -> Report | None:
        """Report of the solution found; None for a y without components."""
        if self.problem is None:
            return None
        asked, steps = self.asked, self.steps
        warnings = [*self.warnings, *filter(None, [getattr(steps, "warning", None)])]
        record = Record(
            begun=True, steps=getattr(steps, "steps_done", found.steps), force_evaluations=steps.nfev,
            jacobian_evaluations=steps.njev, wall_seconds=wall, compile_seconds=compiling, warnings=warnings,
            spent={STEPPING: wall},
        )  # fmt: skip
        if isinstance(steps, OwnSteps):
            record.rejected_steps = steps.counts.rejected
        end, y = found.end
        stride = max(1, -(-len(found.t) // SAMPLES))
        between = [(found.t[k], found.y[:, k]) for k in range(0, len(found.t), stride)] if energy else []
        points = [(asked.t0, asked.y0), *(point for point in between if point[0] not in (asked.t0, end)), (end, y)]
        for k, (t, solution) in enumerate(points):
            value = float(energy(t, solution, *asked.args)) if energy else float("nan")
            time = abs(t - asked.t0)
            record.looks.add(Sample(k, time, Energies(float("nan"), float("nan"), value)))
        told = _Run(
            self.problem, self.name, self.method, self.options, record, self.problem.state,
            f"a terminal event at t = {end:.9g}" if found.status == 1 else "",
        )  # fmt: skip
        real = not np.iscomplexobj(y)
        return replace(report(told), time=abs(end - asked.t0), y=y.tolist() if real else None)


def prepared(asked: Asked, method: Any, said: Mapping[str, Any]) -> Prepared:
    """Steps of a method, with the options that were ``said``. Raises what f raises at the start."""
    which, given = _named(method, said)
    given["rtol"] = _allowed_rtol(given["rtol"])
    if not callable(asked.f):
        raise InputError(f"f: expected a function f(t, y), got {shown(asked.f)}")
    if asked.y0.size:
        y = asked.y0.copy()
        asked.f(asked.t0, y[:, None] if asked.vectorized else y, *asked.args)
    if inspect.isclass(which):
        return _of_scipy(asked, SciPyMethod(which.__name__, which.__name__, 0, ""), which, given)
    row = method_named(which)
    if isinstance(row, SciPyMethod):
        for option, value in ((RTOL, "rtol"), (ATOL, "atol")):
            given[value] = option.default if given[value] is None else given[value]
        return _of_scipy(asked, row, getattr(integrate, row.solver), given)
    return _own(asked, which, row, given)


def _named(method: Any, said: Mapping[str, Any]) -> tuple[Any, dict[str, Any]]:
    """The name of a method of ours, or a class of solvers; and all options."""
    if inspect.isclass(method):
        names = [name for name in NAMES if getattr(integrate, name) is method]
        if not names and not issubclass(method, integrate.OdeSolver):
            raise InputError(f"method: expected a name or a class derived from OdeSolver, got {shown(method.__name__)}")
        return (NAMES[names[0]] if names else method), dict(said)
    name, given = unpacked(method, said)
    return NAMES.get(name, name) if isinstance(name, str) else name, given


def _allowed_rtol(rtol: Any) -> Any:
    """rtol, not below the rounding of a step; SciPy's warning where it was."""
    if rtol is None or not np.any(np.asarray(rtol) < LEAST_RTOL):
        return rtol
    warn(f"At least one element of `rtol` is too small. Setting `rtol = np.maximum(rtol, {LEAST_RTOL})`.", stacklevel=4)
    return np.maximum(rtol, LEAST_RTOL)


# --- our own methods ---


def _own(asked: Asked, name: str, row: Method, given: dict[str, Any]) -> Prepared:
    unused = [key for key in SCIPYS_OWN if given.pop(key, None) is not None]
    if unused:
        warn(f"The following arguments have no effect for a chosen solver: {', '.join(unused)}.", stacklevel=4)
    backward = asked.t1 < asked.t0
    shape = Shape(asked.y0, backward, asked.separable)
    options = settled(row, given | {"atol": _positive_atol(given["atol"])}, RunDefaults())
    if row.needs_dt and options.dt is None:
        raise InputError(f"dt is needed: {name} takes fixed steps")
    if asked.y0.size == 0:
        return Prepared(asked, NoSteps(asked.t0, asked.y0, asked.t1), name, row, options, None, [])
    partial = Partial(
        asked.f, asked.args, True, backward, shape.paired, asked.vectorized, backward and asked.separable
    )  # fmt: skip

    def made(compiled: bool) -> Integration:
        problem = asked.problem(shape, partial, compiled, None if shape.paired else _jacobian(asked, shape))
        job = Job(problem, row, name, _for_parts(options) if shape.paired else options)  # type: ignore[arg-type]
        return Integration(job, engine_named(NATIVE), ())

    run, warnings = asked.compiled_or_not(made)
    steps = OwnSteps(run, shape, asked.t0, asked.t1)
    return Prepared(asked, steps, name, row, options, run.system, warnings)


def _positive_atol(atol: Any) -> Any:
    """atol, which SciPy allows to be 0."""
    return atol if atol is None else np.where(np.asarray(atol) == 0.0, LEAST_ATOL, atol)


def _for_parts(options: Options) -> Options:
    """Tolerances for the parts of complex numbers: each so small that both together keep to what was said.

    SciPy measures |error| of a complex number, over atol + rtol |y|. The sum of squares of both parts' errors, each
    over a tolerance that is smaller by sqrt(2), is never less."""
    rtol, atol = (np.asarray(value) / np.sqrt(2.0) for value in options.tolerances)
    found = [np.repeat(each, 2) if each.ndim else each for each in (np.maximum(rtol, LEAST_RTOL), atol)]
    return options.changed(rtol=found[0], atol=found[1])


def _jacobian(asked: Asked, shape: Shape) -> Any:
    """The Jacobian of the problem for compiled loops, from the user's."""
    jac = asked.jac
    if jac is None:
        return None

    def dense(t: float, y: Any) -> Any:
        found = jac(shape.way * t, shape.back(y), *asked.args) if callable(jac) else jac
        found = found.toarray() if sparse.issparse(found) else np.asarray(found, dtype=float)
        return shape.way * shape.signs[:, None] * found.reshape((len(y), -1)) * shape.signs

    return dense


# --- SciPy's solvers ---


def _of_scipy(asked: Asked, row: SciPyMethod, solver: Any, given: dict[str, Any]) -> Prepared:
    options = {"first_step": given.pop("dt"), **given}
    known = Options(dt=options["first_step"], rtol=given["rtol"], atol=given["atol"])
    if asked.y0.size == 0:
        return Prepared(asked, NoSteps(asked.t0, asked.y0, asked.t1), row.name, row, known, None, [])
    shape = Shape(asked.y0, False, False)
    partial = Partial(asked.f, asked.args, flat=True, paired=shape.paired, column=asked.vectorized)
    asked = asked._replace(separable=False)

    def made(compiled: bool) -> tuple[Problem, Any]:
        problem = asked.problem(shape, partial, compiled)
        if not compiled:
            return problem, lambda t, y: asked.f(t, y, *asked.args)
        flow = flow_of(problem, 1, jumps=True)
        assert isinstance(flow, ProblemFlow)
        return problem, lambda t, y: _value(flow, t, y)

    (problem, f), warnings = asked.compiled_or_not(made)
    if (jac := asked.jac) is not None:
        options["jac"] = (lambda t, y: jac(t, y, *asked.args)) if callable(jac) else jac
    options = {key: value for key, value in options.items() if value is not None}
    columns = asked.vectorized and not problem.compiled
    steps = solver(f, asked.t0, asked.y0, asked.t1, vectorized=columns, **options)
    alternative = solver in (integrate.BDF, integrate.LSODA)
    return Prepared(asked, steps, row.name, row, known, problem, warnings, alternative)


def _value(flow: ProblemFlow, t: float, y: Any) -> Any:
    """f(t, y) from compiled code, for one of SciPy's solvers. Raises what f raises."""
    flow.forget_errors()
    found = flow.derivative(t, np.ascontiguousarray(y).view(float).reshape((1, 1, -1))).reshape(-1)
    if (raised := flow.raised) is not None:
        raise raised
    return found.view(y.dtype) if np.iscomplexobj(y) else found
