"""Equilibration: bring a system of particles to a temperature before a run."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from kickdrift.errors import InputError
from kickdrift.looks.observers import kinetic_energy
from kickdrift.model.checks import positive, unwarned, whole_number
from kickdrift.model.limits import steps_in
from kickdrift.model.state import State
from kickdrift.model.system import System
from kickdrift.model.units import time_in

if TYPE_CHECKING:
    from kickdrift.integrators.method import Method
    from kickdrift.looks.observers import Energies
    from kickdrift.run.advance import Integration

Progress = Callable[[int, int], Any]


class Heated(Protocol):
    """Attributes of a Simulation that equilibration needs."""

    state: Any
    method: Method
    dt: float | None
    integration: Integration

    @property
    def system(self) -> Any: ...

    @property
    def running(self) -> bool: ...

    @property
    def steps_done(self) -> int: ...

    def energy(self) -> Energies: ...

    def advance(self, steps: int) -> None: ...

    def equilibrate(
        self, temperature: float, time: float | str, interval: int = 10, progress: Progress | None = None
    ) -> None: ...


def equilibrate(
    sim: Heated,
    temperature: float,
    time: float | str,
    interval: int,
    progress: Progress | None,
    with_verlet: Callable[[], Heated],
) -> None:
    """Bring the system to a temperature; see ``Simulation.equilibrate``.

    ``with_verlet`` makes a velocity Verlet Simulation. This replaces a Simulation whose method cannot rescale
    velocities."""
    if not isinstance(sim.system, System):
        raise InputError("equilibrate: a Problem has no temperature")
    temperature = positive("equilibrate: temperature", temperature, "positive")
    time = positive("equilibrate: time", time_in(time, sim.system.units, "equilibrate: time"), "positive")
    interval = whole_number("equilibrate: interval", interval, 1)
    if sim.system.degrees_of_freedom == 0:
        raise InputError("equilibrate: a system of one particle has no temperature")
    if sim.running:
        raise InputError("equilibrate: the Simulation is already running")
    if not sim.method.rescalable:
        other = with_verlet()
        other.equilibrate(temperature, time, interval, progress)
        sim.state = other.state
        return
    assert sim.dt is not None
    count = max(1, round(steps_in("equilibrate: time", time, sim.dt)))
    if sim.method.bath:
        _through_bath(sim, temperature, count, progress)
        return
    masses = sim.system.coherent_masses
    wanted = 0.5 * sim.system.degrees_of_freedom * sim.system.units.boltzmann * temperature
    sim.integration.prepare()
    compile_seconds = sim.integration.record.compile_seconds
    _restart(sim)
    potentials: list[float] = []
    while sim.steps_done < count:
        _rescale(sim, masses, wanted)
        sim.advance(min(interval, count - sim.steps_done))
        if 2 * sim.steps_done >= count:
            potentials.append(sim.energy().potential)
        if progress:
            progress(sim.steps_done, count)
    _rescale(sim, masses, max(wanted + float(np.mean(potentials)) - potentials[-1], 0.5 * wanted))
    _restart(sim)
    sim.integration.record.compile_seconds = compile_seconds


def _through_bath(sim: Heated, temperature: float, count: int, progress: Progress | None) -> None:
    """Run ``count`` steps in the heat bath of the method. They count from -count, so their noise is not the run's."""
    if (own := sim.integration.options.temperature) != temperature:
        raise InputError(
            f"equilibrate: temperature = {temperature:g} is not the heat bath's temperature = {own:g}; "
            f"{sim.method.name} equilibrates in its own bath, so give the same temperature"
        )
    sim.integration.prepare()
    compile_seconds = sim.integration.record.compile_seconds
    _restart(sim)
    stepper = sim.integration.stepper
    stepper.reset(stepper.y, 0.0, -count)
    while sim.steps_done < 0:
        sim.advance(min(max(1, count // 100), -sim.steps_done))
        if progress:
            progress(count + sim.steps_done, count)
    _restart(sim)
    sim.integration.record.compile_seconds = compile_seconds


def _restart(sim: Heated) -> None:
    """Make the current state step 0."""
    now = sim.state
    sim.state = State(now.phase, now.masses, now.ids, now.box)


@unwarned
def _rescale(sim: Heated, masses: Any, kinetic: float) -> None:
    now = kinetic_energy(masses, sim.integration.stepper.y[1])
    if now == 0:
        raise InputError(
            "equilibrate: all velocities are zero, so none can be rescaled; give [velocities] a temperature"
        )
    sim.integration.rescale_velocities(np.sqrt(kinetic / now))
