"""Rows of an ensemble's table: the columns of a member."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING, Any

import numpy as np

from kickdrift.ensemble.members import Member
from kickdrift.errors import InputError
from kickdrift.integrators.options import RAMPED, TEMPERATURE, coupling_of, mean_pressure
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
ERRORS = {name: f"{name}_error" for name in ("temperature", "pressure", "volume", "density", "energy", "heat_capacity")}
THERMAL = (*ERRORS, "heat")  # columns of particles in a box or a heat bath, in the order of tables
COLUMNS = (MEMBER, "replica", "seed", "status", "error", *LAST)  # columns of every table


def row_of(member: Member, status: str, error: str = "", measured: Row | None = None) -> Row:
    """Row of a member; a varied key has its given value. The measured temperature beside a varied one is
    ``mean_temperature``, and other thermal columns alike."""
    begun = {
        MEMBER: member.number, "replica": member.replica, "seed": member.seed, **member.values, "status": status,
        "error": error,
    }  # fmt: skip
    found = {mean_of(key, begun): value for key, value in (measured or {}).items()}
    return begun | {key: value for key, value in found.items() if key not in begun}


def mean_of(name: str, given: Collection[str]) -> str:
    """Column of a measured number: a thermal number whose name is a ``given`` key's has "mean_" before it."""
    return f"mean_{name}" if name in THERMAL and name in given else name


def run_columns(report: Report, measured: Row | None = None, volume: float = np.nan) -> Row:
    """A run's report, and the ``measured`` values, as columns; ``volume`` of a box that no barostat changes. A measured
    value takes the place of a thermal column of its name, except for temperature and pressure."""
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
    thermal = thermal_columns(report, volume)
    columns = {key: value for key, value in thermal.items() if key not in (measured or {})} | columns
    return columns | (measured or {}) | {"wall_seconds": report.wall_seconds}


def thermal_columns(report: Report, volume: float) -> Row:
    """Means over a run's samples with their standard errors (see `Report.error_of`), the heat that the bath gave, and
    the heat capacity; empty for particles without pressure and heat bath, such as planets.

    ``energy`` is the total energy, ``density`` the particles per volume, or per area in two dimensions. ``volume`` is
    that of a box that keeps its size.
    """
    if report.temperature is None or (report.pressure is None and not report.about.bath):
        return {}
    series, count = report.about.series, report.particles or 0
    energies = series.total - series.taken  # the samples count the heat and the work out
    changes = series.volumes is not None
    volumes = series.volumes if series.volumes is not None else np.array([volume])
    means: dict[str, Any] = {"volume": volumes, "density": count / volumes, "energy": energies}
    found: Row = {"temperature_error": report.temperature_error, "pressure_error": report.pressure_error}
    for name, values in means.items():
        found[name] = float(values.mean())
        found[ERRORS[name]] = report.error_of(values) if changes or name == "energy" else 0.0
    return found | heat_capacity(report, energies, volumes) | {"heat": report.heat}


def heat_capacity(report: Report, energies: Any, volumes: Any) -> Row:
    """Heat capacity from fluctuations of the energy (Allen & Tildesley 2017, doi:10.1093/oso/9780198803195.001.0001,
    section 2.5), at constant volume; of the enthalpy, at constant pressure, in a box that keeps its shape. Empty
    without a heat bath at one temperature."""
    options, units = report.options, report.about.units
    asked, pressure = options.get(TEMPERATURE.name), mean_pressure(options)
    ramped = any(options.get(end) is not None for end in RAMPED.values())
    if not report.about.bath or report.about.drawn or asked is None or units is None or ramped:
        return {}
    if coupling_of(options) not in ("", "isotropic"):
        return {}
    values = energies + (pressure or 0.0) * volumes
    spread = (values - values.mean()) ** 2 / (units.boltzmann * asked**2)
    return {"heat_capacity": float(spread.mean()), "heat_capacity_error": report.error_of(spread)}


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
