"""``solve``: the solution of an ordinary differential equation, with the arguments and the result of SciPy."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from kickdrift.errors import InputError
from kickdrift.model.checks.values import is_number, number, numbers
from kickdrift.model.problem import arguments
from kickdrift.model.state import Floats
from kickdrift.run.report.report import Report
from kickdrift.text import shown


@dataclass(frozen=True, repr=False)
class Solution:
    """Solution of an initial value problem, as ``scipy.integrate.solve_ivp`` returns it, with our report.

    Attributes
    ----------
    t : (k,) times: the ends of the steps, or t_eval as far as it was reached, which may be no time at all
    y : (n, k) solution at these times
    sol : sol(t) is the solution (n,) at any time between, or (n, m) at m times; None without dense_output
    t_events : for each event the times of its zeros; None without events
    y_events : for each event the solution at its zeros, (zeros, n)
    nfev, njev, nlu : number of evaluations of f and of its Jacobian, and of LU decompositions (of SciPy's methods)
    status : 0 at the end of t_span; 1 where an event ended the run; -1 where a step failed
    message : the status in words
    success : whether the status is 0 or 1
    report : the run's `Report`: method, options, steps, cost, conservation of ``energy``, warnings. None if y has no
        components
    """

    t: Any
    y: Any
    sol: Any
    t_events: list[Any] | None
    y_events: list[Any] | None
    nfev: int
    njev: int
    nlu: int
    status: int
    message: str
    success: bool
    report: Report | None

    def __repr__(self) -> str:
        """A few lines: arrays by their shapes."""
        method = self.report.integrator if self.report else "none"
        lines = [f"Solution: {self.message}", f"method: {method}", f"status: {self.status}"]
        for key in ("t", "y"):
            value = getattr(self, key)
            lines.append(f"{key}: {len(value)} times" if key == "t" else f"{key}: {np.shape(value)}")
        if len(self.t):
            lines[-2] += f" from {self.t[0]:.9g} to {self.t[-1]:.9g}"
        if self.t_events is not None:
            lines.append(f"t_events: {', '.join(str(len(times)) for times in self.t_events)} zeros")
        lines.append(f"nfev: {self.nfev}, njev: {self.njev}, nlu: {self.nlu}")
        return "\n  ".join(lines)


def solve(
    f: Callable[..., Any],
    t_span: ArrayLike,
    y0: ArrayLike,
    method: Any = "dormand-prince45",
    t_eval: ArrayLike | None = None,
    dense_output: bool = False,
    events: Any = None,
    vectorized: bool = False,
    args: Sequence[Any] | None = None,
    *,
    rtol: Any = None,
    atol: Any = None,
    dt: float | None = None,
    first_step: float | None = None,
    max_step: float | None = None,
    jac: Any = None,
    energy: Callable[..., Any] | None = None,
    separable: bool = False,
    compiled: bool | None = None,
    **options: Any,
) -> Solution:
    """Solve y' = f(t, y, *args), y(t0) = y0. Arguments and result are those of ``scipy.integrate.solve_ivp``.

    Parameters
    ----------
    f : f(t, y, *args) -> n numbers. A plain Python function, which is compiled where numba can compile it
    t_span : (t0, t1). t1 may lie before t0, and may be infinite where an event ends the run
    y0 : (n,) real or complex numbers
    method : a name from ``kickdrift.integrators()``, a value from ``kickdrift.integrator``, a name of SciPy's ("RK45",
        "RK23", "DOP853", "Radau", "BDF", "LSODA"), or a class derived from ``scipy.integrate.OdeSolver``. SciPy's names
        and classes of explicit methods mean our steppers of the same tableau; Radau, BDF and LSODA are SciPy's steps
    t_eval : times at which to return the solution; by default the ends of the steps
    dense_output : whether to return ``sol``, the solution at all times
    events : g(t, y, *args), or several. The attributes ``terminal`` and ``direction`` of each act as in SciPy. All
        zeros in a step are found, apart from those that docs/solve.md names
    vectorized : whether f takes y as columns (n, k)
    args : further arguments of f, jac, energy and events
    rtol, atol : error allowed per step: |error| < atol + rtol |y|. One number, or one for each component. Default 1e-8
        and 1e-10, as for a Simulation
    dt : step of a method with fixed steps; the last step is shorter where t_span is no whole number of steps
    first_step, max_step : length of the first step, and of the longest
    jac : jac(t, y, *args) -> (n, n), or a constant matrix; for implicit methods
    energy : energy(t, y, *args), a quantity that the exact solution conserves. The report shows its error
    separable : y is positions and then as many velocities, and accelerations do not depend on velocities. The splitting
        methods, such as "velocity-verlet", need this
    compiled : True: f must compile. False: f runs as plain Python. By default f is compiled if it can be; otherwise it
        runs as plain Python, and ``report.warnings`` says why
    options : further options of the method

    Raises
    ------
    InputError
        For arguments that make no sense; a ValueError. What f raises is raised unchanged. A step that fails raises
        nothing: see ``Solution.status``.
    """
    from kickdrift.run.solve.methods import Asked, prepared
    from kickdrift.run.solve.walk import Zeros, walk

    began = perf_counter()
    t0, t1 = _span(t_span)
    given = arguments("args", args)
    times = None if t_eval is None else _times(t_eval, t0, t1)
    zeros = None if events is None else Zeros(events, given)
    if dt is not None and first_step is not None:
        raise InputError("first_step: is the dt of a method that chooses its steps; give dt or first_step, not both")
    if first_step is not None and not 0 < number(first_step) <= abs(t1 - t0):
        raise InputError(f"`first_step` must be positive and no longer than t_span, got {shown(first_step)}")
    if max_step is not None and not number(max_step) > 0:
        raise InputError(f"`max_step` must be positive, got {shown(max_step)}")
    longest = None if max_step is None or np.isinf(max_step) else max_step
    said = {"rtol": rtol, "atol": atol, "dt": dt if first_step is None else first_step, "max_step": longest, **options}
    made = prepared(Asked(f, t0, t1, _start(y0), given, bool(vectorized), separable, jac, compiled), method, said)
    compile_seconds, began = perf_counter() - began, perf_counter()
    found, steps = walk(made.steps, times, bool(dense_output), zeros, made.alternative), made.steps
    told = made.report(found, energy, perf_counter() - began, compile_seconds)
    return Solution(
        found.t, found.y, found.sol, found.t_events, found.y_events, steps.nfev, steps.njev, steps.nlu, found.status,
        found.message, found.status >= 0, told,
    )  # fmt: skip


def _span(t_span: Any) -> tuple[float, float]:
    """Start and end of the interval."""
    try:
        t0, t1 = t_span
    except (TypeError, ValueError):
        raise InputError(f"t_span: expected two times, got {shown(t_span)}") from None
    for key, value in (("t_span[0]", t0), ("t_span[1]", t1)):
        if not is_number(value) or np.isnan(value):
            raise InputError(f"{key}: expected a time, got {shown(value)}")
    if np.isinf(t0):
        raise InputError(f"t_span[0]: expected a finite time, got {shown(t0)}")
    return float(t0), float(t1)


def _start(y0: Any) -> Any:
    """y at the start, as a row of floats or of complex numbers."""
    complex_numbers = np.asarray(y0).dtype.kind == "c"
    start = np.array(y0, dtype=complex) if complex_numbers else numbers("y0", y0)
    if start.ndim != 1:
        raise InputError(f"`y0` must be 1-dimensional, got shape {start.shape}")
    bad = np.flatnonzero(~np.isfinite(start))
    if bad.size:
        where = f"y0[{bad[0]}] is {start[bad[0]]}"
        raise InputError(f"{where}. All components of the initial state `y0` must be finite.")
    return start


def _times(t_eval: Any, t0: float, t1: float) -> Floats:
    """The times asked for."""
    times = numbers("t_eval", t_eval)
    if times.ndim != 1:
        raise InputError(f"`t_eval` must be 1-dimensional, got shape {times.shape}")
    outside = np.flatnonzero(~((times >= min(t0, t1)) & (times <= max(t0, t1))))
    if outside.size:
        where = f"t_eval[{outside[0]}] is {times[outside[0]]}"
        raise InputError(f"{where}. Values in `t_eval` are not within `t_span`.")
    if np.any(np.diff(times) * (1.0 if t1 >= t0 else -1.0) <= 0):
        raise InputError("Values in `t_eval` are not properly sorted: they must run from t_span[0] to t_span[1]")
    return times
