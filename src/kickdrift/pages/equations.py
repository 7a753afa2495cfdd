"""Pages of equations: fixed-step methods side by side, on three Problems and on a user's own."""

from typing import Any

from kickdrift.errors import InputError
from kickdrift.integrators import INTEGRATORS
from kickdrift.integrators.flows.problem_flow import ProblemFlow
from kickdrift.integrators.options import Options
from kickdrift.integrators.runge_kutta.method import Tableau
from kickdrift.integrators.splitting.method import Splitting
from kickdrift.integrators.splitting.stormer import Stormer
from kickdrift.model.problem import Problem
from kickdrift.odes import ODES
from kickdrift.pages.module import Module
from kickdrift.text import shown

STEP = 0.1
COMPARED = ("harmonic-oscillator", "pendulum", "kepler")
MOST = 100  # unknowns of a page
TIME, STEPS = 10.0, 1000  # of a Problem without its own: the length of the run, and its number of steps


def fixed_step_methods() -> dict[str, Any]:
    """Methods of fixed steps for Problems, by name, without heat baths."""
    kinds = (Splitting, Stormer, Tableau)
    return {
        method.name: method
        for method in INTEGRATORS.values()
        if type(method) in kinds and not method.adaptive and not method.bath
    }


def compared(module: Module) -> dict[str, Any]:
    """Every fixed-step method on three Problems; names are "problem method"."""
    found = {}
    for name in COMPARED:
        problem = ODES[name]()
        for method in fixed_step_methods().values():
            found[f"{name} {method.name}"] = _compared_run(module, problem, method)
    return found


def _compared_run(module: Module, problem: Problem, method: Any) -> dict[str, Any]:
    about = {"order": method.order, "symplectic": method.symplectic}
    return module.runs(*stepper_of(problem, method)) | about


def own_runs(problem: Problem, module: Module) -> dict[str, Any]:
    """Every fixed-step method that can run a user's Problem; names are "problem method"."""
    return {f"problem {method.name}": _compared_run(module, problem, method) for method in _methods_for(problem)}


def _methods_for(problem: Problem) -> list[Any]:
    return [each for each in fixed_step_methods().values() if problem.separable or not each.separable]


def checked_problem(name: str, problem: Problem) -> Problem:
    """The Problem. Raises InputError for what a page cannot hold, with its reason."""
    if len(problem) > MOST:
        raise InputError(f"page {shown(name)}: has {len(problem):,} unknowns; a page holds {MOST}")
    if not problem.compiled:
        raise InputError(f"page {shown(name)}: has compiled=False; a page holds compiled functions alone")
    return problem


def shown_problem(problem: Problem) -> dict[str, Any]:
    """What the page of a user's Problem knows beside the runs: its name, its unknowns, its length and its step."""
    time = problem.run.time or (problem.run.steps or STEPS) * (problem.run.dt or 0.0) or TIME
    return {
        "own": {
            "name": problem.name, "unknowns": len(problem), "time": time, "dt": problem.run.dt or time / STEPS,
            "t0": problem.t0,
        },
    }  # fmt: skip


def stepper_of(problem: Problem, method: Any, dt: float = STEP) -> tuple[Problem, Any]:
    """The Problem, and the method's stepper at its start."""
    flow = ProblemFlow(problem, 1, method.trial_steps)
    stepper = method.stepper(flow, Options(dt=dt))
    stepper.reset(flow.array(problem.state), problem.t0, 0)
    return problem, stepper
