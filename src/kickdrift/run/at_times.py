"""States of a system at given times, in any order, before and after the present."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from kickdrift.errors import InputError
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.run.simulation import Simulation


def begun_from(
    given: System | Simulation, integrator: Any, options: dict[str, Any]
) -> tuple[System, Any, dict[str, Any]]:
    """A System at its present state, a method, and those of its options that are not None. The method defaults to that
    of a Simulation; None leaves it to the system file."""
    asked = {key: value for key, value in options.items() if value is not None}
    system = given.integration.system if isinstance(given, Simulation) else given
    if not isinstance(system, System):
        raise InputError(f"expected a System or a Simulation of bodies, got {type(given).__name__}")
    if isinstance(given, Simulation):
        system = system.at(given.state.phase, given.time)
        if integrator is None:
            own = {"dt": given.dt, **{key: given.options.get(key) for key in given.method.tunable}}
            return system, given.integrator, {key: value for key, value in own.items() if value is not None} | asked
    return system, integrator, asked


def states_at(system: System, times: Floats, integrator: Any, options: dict[str, Any]) -> Floats:
    """Positions and velocities (k, 2, 3, n) at each of the times, by runs from the System's state. Events are not
    watched."""
    found = np.empty((len(times), *system.state.phase.shape))
    early = times < system.state.time
    for rows in (np.flatnonzero(early), np.flatnonzero(~early)):
        if rows.size:
            rising, places = np.unique(times[rows], return_inverse=True)
            order = -1 if early[rows[0]] else 1
            looks: list[Floats] = []
            sim = Simulation(system.watched(()), integrator, **options)
            sim.run(times=rising[::order], observe=partial(_keep, looks))
            found[rows] = np.array(looks[-len(rising) :][::order])[places]
    return found


def _keep(looks: list[Floats], sim: Simulation) -> None:
    looks.append(sim.state.phase.copy())
