"""What a worker does: members, each run to a row of the table. Nothing that a member does stops the others."""

from __future__ import annotations

from collections.abc import Sequence
from time import perf_counter
from typing import TYPE_CHECKING, Any

from kickdrift.ensemble.members import Member
from kickdrift.ensemble.recipe import MEGNO, Recipe
from kickdrift.errors import KickdriftError
from kickdrift.problem import Problem, ProblemState
from kickdrift.system import System

if TYPE_CHECKING:
    from kickdrift.analysis.chaos import ChaosReport

Row = dict[str, Any]
DONE, FAILED, LOST = "done", "failed", "lost"


def timed_members(recipe: Recipe, members: Sequence[Member]) -> tuple[list[Row], float]:
    """`run_members`, and how many seconds it took."""
    began = perf_counter()
    return run_members(recipe, members), perf_counter() - began


def run_members(recipe: Recipe, members: Sequence[Member]) -> list[Row]:
    """A row for each member."""
    recipe.begin()
    return [run_member(recipe, member) for member in members]


def run_member(recipe: Recipe, member: Member) -> Row:
    """A member's row: what it is, how it ended, and what was measured or, of one that failed, its last good state."""
    system = None
    try:
        system = recipe.system(member)
        measured = megno_row(_megno(system, member)) if recipe.measure == MEGNO else _run(recipe, member, system)
        return row_of(member, DONE) | measured
    except KickdriftError as error:
        return row_of(member, FAILED, str(error)) | _last(getattr(error, "state", None), system)
    except Exception as error:  # whatever a user's function raises
        return row_of(member, FAILED, " ".join(f"{type(error).__name__}: {error}".split()))


def row_of(member: Member, status: str, error: str = "") -> Row:
    """How a row begins."""
    return {
        "member": member.number, "replica": member.replica, "seed": member.seed, **member.values, "status": status,
        "error": error,
    }  # fmt: skip


def _run(recipe: Recipe, member: Member, system: System | Problem) -> Row:
    from kickdrift.run_plan import length_of
    from kickdrift.simulation import Simulation

    sim = Simulation(system)
    length = length_of(sim, system.name)
    if isinstance(system, System) and (wanted := system.equilibration):
        sim.equilibrate(wanted.temperature, wanted.time, wanted.interval)
    folder = recipe.trajectories
    report = sim.run(**length, output=folder and folder / f"member-{member.number:06d}.h5md", overwrite=True)
    measured = {} if isinstance(recipe.measure, str) else _measured(recipe.measure, sim)
    energy = report.energy
    return {
        "integrator": report.integrator,
        "dt": report.dt,
        "steps": report.steps,
        "time": report.time,
        "force_evaluations": report.force_evaluations,
        "energy_rms_relative_error": energy and energy.rms_relative_error,
        "energy_max_relative_error": energy and energy.max_relative_error,
        "energy_drift": energy and energy.drift_per_unit_time,
        "energy_drift_error": energy and energy.drift_error,
        "energy_verdict": energy.verdict if energy else "",
        "momentum_error": report.momentum_error,
        "angular_momentum_error": report.angular_momentum_error,
        "temperature": report.temperature,
        "pressure": report.pressure,
        "stopped": report.stopped,
        "warnings": "; ".join(report.warnings),
        **measured,
        "wall_seconds": report.wall_seconds,
    }


def _measured(measure: Any, sim: Any) -> Row:
    """What a user's function says of a run, as columns."""
    found = measure(sim)
    if not isinstance(found, dict):
        found = {getattr(measure, "__name__", "measure"): found}
    return {
        str(key): value.item() if hasattr(value, "item") and not value.ndim else value for key, value in found.items()
    }


def _megno(system: System | Problem, member: Member) -> ChaosReport:
    from kickdrift.analysis.chaos import megno

    run = system.run
    return megno(system, None, run.integrator, run.dt, seed=member.seed, rtol=run.rtol, atol=run.atol)


def megno_row(found: ChaosReport) -> Row:
    """What a ChaosReport says, as columns."""
    names = ("integrator", "dt", "steps", "time", "megno", "verdict", "lyapunov", "lyapunov_error", "energy_error")
    return {name: getattr(found, name) for name in names}


def _last(state: Any, system: System | Problem | None) -> Row:
    """A failed member's last good state, as columns; positions and velocities as one list each, x y z x y z …"""
    if state is None or system is None:
        return {}
    at = {"last_step": state.steps_done, "last_time": state.time}
    if isinstance(state, ProblemState):
        return at | {"last_y": state.y.tolist()}
    own = slice(len(system))  # without deviations
    return at | {
        "last_positions": state.positions[own].reshape(-1).tolist(),
        "last_velocities": state.velocities[own].reshape(-1).tolist(),
    }
