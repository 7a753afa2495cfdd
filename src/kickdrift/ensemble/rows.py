"""Rows of an ensemble's table: the columns of a member."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from kickdrift.ensemble.members import Member
from kickdrift.errors import InputError
from kickdrift.model.problem import Problem, ProblemState
from kickdrift.model.system import System

if TYPE_CHECKING:
    from pandas import DataFrame

    from kickdrift.analysis.chaos.report import ChaosReport
    from kickdrift.run.report.report import Report
else:
    DataFrame = object  # pandas is loaded by the first table

Row = dict[str, Any]
DONE, FAILED, LOST = "done", "failed", "lost"
MEMBER = "member"
STOPPED_BY = "stopped_by"
LAST = ("wall_seconds", "last_step", "last_time", "last_y", "last_positions", "last_velocities")  # columns
UNKNOWNS = 20  # most unknowns of an ODE with their own columns
COLUMNS = (MEMBER, "replica", "seed", "status", "error", *LAST)  # columns of every table


def row_of(member: Member, status: str, error: str = "", measured: Row | None = None) -> Row:
    """Row of a member; a varied key has its given value."""
    begun = {
        MEMBER: member.number, "replica": member.replica, "seed": member.seed, **member.values, "status": status,
        "error": error,
    }  # fmt: skip
    return begun | {key: value for key, value in (measured or {}).items() if key not in begun}


def run_columns(report: Report, measured: Row | None = None) -> Row:
    """A run's report, and the ``measured`` values, as columns."""
    energy = report.energy
    columns: Row = {
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
        STOPPED_BY: stopped_by(report),
        "warnings": "; ".join(report.warnings),
    }
    if report.y is not None and len(report.y) <= UNKNOWNS:
        columns |= {f"y{i}": value for i, value in enumerate(report.y)}
    for name in measured or {}:
        if name in columns or name in COLUMNS:
            raise InputError(f"measure: {name}: every run has a column of this name; choose another")
    return columns | (measured or {}) | {"wall_seconds": report.wall_seconds}


def stopped_by(report: Report) -> str:
    """Kind of the event that ended the run, such as "collision"; "" for a run that no event ended."""
    ended = [str(event["kind"]) for event in report.events if event["done"] == "stopped"]
    return ended[-1] if report.stopped and ended else ""


def megno_columns(found: ChaosReport) -> Row:
    """A ChaosReport as columns."""
    names = ("integrator", "dt", "steps", "time", "megno", "verdict", "lyapunov", "lyapunov_error", "energy_error")
    return {name: getattr(found, name) for name in names} | {"warnings": "; ".join(found.warnings)}


def last_columns(state: Any, system: System | Problem | None) -> Row:
    """Last good state of a failed member, as columns. Positions and velocities are one list each: x y z x y z …"""
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
