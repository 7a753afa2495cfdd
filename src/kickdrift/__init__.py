"""kickdrift: molecular dynamics and N-body simulation in which the integrator is a swappable, measured choice.

The names below are all that is public; each is imported when it is first used, so that ``import kickdrift`` is quick.
"""

from __future__ import annotations

from importlib import import_module
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

# Not lazy: loading the rooms of those names later would put the modules in the functions' places.
from kickdrift.engines import engines
from kickdrift.integrators import integrators

if TYPE_CHECKING:
    from kickdrift import analysis
    from kickdrift.analysis.chaos import ChaosReport, megno
    from kickdrift.ensemble import Ensemble
    from kickdrift.errors import InputError, KickdriftError, RunError
    from kickdrift.forces import (
        DrivenField,
        Gravity,
        HarmonicTrap,
        LennardJones,
        LinearDrag,
        Springs,
        UniformField,
    )
    from kickdrift.forces.pair_law import pair_law
    from kickdrift.forces.registration import register_force
    from kickdrift.integrators.custom import accelerations
    from kickdrift.integrators.registration import register_splitting, register_step, register_tableau
    from kickdrift.looks.observers import Energies
    from kickdrift.model.box import Box
    from kickdrift.model.events import CloseApproach, Collision, Crossing, Escape
    from kickdrift.model.problem import Problem
    from kickdrift.model.state import State
    from kickdrift.model.system import System
    from kickdrift.run.report import Report
    from kickdrift.run.resuming import resume
    from kickdrift.run.simulation import Simulation
    from kickdrift.systemfile.reading import load
    from kickdrift.trajectory.export import export
    from kickdrift.trajectory.options import FileOptions
    from kickdrift.trajectory.reader import open

__version__ = version("kickdrift")

_HOMES = {
    "accelerations": "integrators.custom",
    "Box": "model.box",
    "ChaosReport": "analysis.chaos",
    "CloseApproach": "model.events",
    "Collision": "model.events",
    "Crossing": "model.events",
    "DrivenField": "forces",
    "Energies": "looks.observers",
    "Ensemble": "ensemble",
    "Escape": "model.events",
    "FileOptions": "trajectory.options",
    "Gravity": "forces",
    "GravityTree": "forces",
    "HarmonicTrap": "forces",
    "InputError": "errors",
    "KickdriftError": "errors",
    "LennardJones": "forces",
    "Problem": "model.problem",
    "LinearDrag": "forces",
    "Oblateness": "forces",
    "PostNewtonian": "forces",
    "Report": "run.report",
    "RunError": "errors",
    "Simulation": "run.simulation",
    "Springs": "forces",
    "State": "model.state",
    "System": "model.system",
    "UniformField": "forces",
    "export": "trajectory.export",
    "load": "systemfile.reading",
    "megno": "analysis.chaos",
    "open": "trajectory.reader",
    "pair_law": "forces.pair_law",
    "register_force": "forces.registration",
    "register_splitting": "integrators.registration",
    "register_step": "integrators.registration",
    "register_tableau": "integrators.registration",
    "resume": "run.resuming",
}

__all__ = [
    "Box",
    "ChaosReport",
    "CloseApproach",
    "Collision",
    "Crossing",
    "DrivenField",
    "Energies",
    "Ensemble",
    "Escape",
    "FileOptions",
    "Gravity",
    "GravityTree",
    "HarmonicTrap",
    "InputError",
    "KickdriftError",
    "LennardJones",
    "LinearDrag",
    "Oblateness",
    "PostNewtonian",
    "Problem",
    "Report",
    "RunError",
    "Simulation",
    "Springs",
    "State",
    "System",
    "UniformField",
    "accelerations",
    "analysis",
    "engines",
    "export",
    "integrators",
    "load",
    "megno",
    "open",
    "pair_law",
    "register_force",
    "register_splitting",
    "register_step",
    "register_tableau",
    "resume",
]


def __getattr__(name: str) -> Any:
    if name == "analysis":
        return import_module("kickdrift.analysis")
    if name not in _HOMES:
        raise AttributeError(f"module 'kickdrift' has no attribute {name!r}")
    value = getattr(import_module(f"kickdrift.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*globals(), *_HOMES, "analysis"]
