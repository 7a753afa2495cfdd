"""What reports made from a trajectory say alike: what ran, and when the trajectory is no good."""

from dataclasses import fields
from typing import Any

import numpy as np

from kickdrift.display.showing import Lines
from kickdrift.integrators.flows.flow import flow_of
from kickdrift.looks.doubts import digits_doubt, light_doubt, of_samples
from kickdrift.looks.observers import Energies
from kickdrift.model.body_checks import doubtful_forces
from kickdrift.model.problem import Problem
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.model.units.unit_systems import symbol_of
from kickdrift.text import measured

KEPT = 500  # most samples in a report's JSON


def trajectory_doubts(system: System | Problem, ends: tuple[Energies, Energies], phase: Floats | None) -> list[str]:
    """Warnings of a trajectory by its energies at start and end, and by its phase (2, 3, n) at the end, if known."""
    total, kinetic = [each.total for each in ends], [each.kinetic for each in ends]
    if not isinstance(system, System):
        return list(filter(None, [of_samples(total, kinetic)]))
    found = [] if system.acting("works") else [of_samples(total, kinetic)]
    if phase is not None:
        found += [digits_doubt(system, phase[0]), light_doubt(system, phase[1])]
    return list(filter(None, found))


def doubts_at(system: System | Problem, end: Any) -> list[str]:
    """Warnings of the forces, and of a trajectory that goes from the system's own state to the state ``end``."""
    flow: Any = flow_of(system, 1, jumps=True)
    first, last = (flow.sample(flow.array(state), state.time, 0).energies for state in (system.state, end))
    found = trajectory_doubts(system, (first, last), end.phase if isinstance(system, System) else None)
    return found + (doubtful_forces(system) if isinstance(system, System) else [])


def warning_lines(warnings: list[str]) -> Lines:
    """The lines of a report with these warnings."""
    return [("warning", line) for line in warnings]


def run_lines(found: Any) -> Lines:
    """The lines of a report that say what ran: ``found`` has system, integrator, dt, time, time_unit and steps."""
    unit = symbol_of(found.time_unit)
    step = "" if found.dt is None else f", dt = {measured(f'{found.dt:g}', unit)}"
    return [
        ("system", found.system),
        ("integrator", found.integrator + step),
        ("length", f"{found.steps:,} steps, {measured(f'{found.time:g}', unit)}"),
    ]


def plain(found: Any, *series: str) -> dict[str, Any]:
    """The fields of a report for JSON; these ``series`` over ``found.times`` have at most some 500 points."""
    every = -(-len(found.times) // KEPT)
    kept = {each.name: getattr(found, each.name) for each in fields(found)}
    kept |= {name: kept[name][::-every][::-1] for name in series}
    return {key: value.tolist() if isinstance(value, np.ndarray) else value for key, value in kept.items()}
