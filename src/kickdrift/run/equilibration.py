"""Bringing a system of particles to a temperature before what it conserves is measured."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from kickdrift.engines import NATIVE
from kickdrift.errors import InputError
from kickdrift.looks.observers import kinetic_energy
from kickdrift.model.checks import positive, unwarned, whole_number
from kickdrift.model.limits import steps_in
from kickdrift.model.state import State
from kickdrift.model.system import System

if TYPE_CHECKING:
    from kickdrift.run.simulation import Simulation


def equilibrate(
    sim: Simulation, temperature: float, time: float, interval: int, progress: Callable[[int, int], Any] | None
) -> None:
    """See ``Simulation.equilibrate``."""
    if not isinstance(sim.system, System):
        raise InputError("equilibrate: a Problem has no temperature")
    temperature = positive("equilibrate: temperature", temperature, "positive")
    time = positive("equilibrate: time", time, "positive")
    interval = whole_number("equilibrate: interval", interval, 1)
    if sim.system.degrees_of_freedom == 0:
        raise InputError("equilibrate: a system of one particle has no temperature")
    if sim.running:
        raise InputError("equilibrate: the Simulation runs already")
    if not sim.method.rescalable:
        from kickdrift.run.simulation import Simulation

        other = Simulation(
            sim.system, "velocity-verlet", sim.system.run.dt, sim.threads, engine=sim.engine, processes=sim.processes
        )
        other.equilibrate(temperature, time, interval, progress)
        sim.state = other.state
        return
    assert sim.dt is not None
    masses = sim.system.coherent_masses
    wanted = 0.5 * sim.system.degrees_of_freedom * sim.system.units.boltzmann * temperature
    count = max(1, round(steps_in("equilibrate: time", time, sim.dt)))
    sim._prepare()
    compile_seconds = sim.record.compile_seconds
    _restart(sim)
    potentials: list[float] = []
    with sim._busy() as interrupted:
        while sim.steps_done < count and not interrupted():
            _rescale(sim, masses, wanted)
            sim._advance(min(interval, count - sim.steps_done))
            if 2 * sim.steps_done >= count:
                potentials.append(sim.energy().potential)
            if progress:
                progress(sim.steps_done, count)
    if interrupted():
        raise KeyboardInterrupt
    _rescale(sim, masses, max(wanted + float(np.mean(potentials)) - potentials[-1], 0.5 * wanted))
    _restart(sim)
    sim.record.compile_seconds = compile_seconds


def _restart(sim: Simulation) -> None:
    """Call the present step 0."""
    now = sim.state
    sim.state = State(now.phase, now.masses, now.ids, now.box)


@unwarned
def _rescale(sim: Simulation, masses: Any, kinetic: float) -> None:
    stepper = sim._stepper
    velocities = stepper.y[1]
    now = kinetic_energy(masses, velocities)
    if now == 0:
        raise InputError(
            "equilibrate: all velocities are zero, so none can be rescaled; give [velocities] a temperature"
        )
    velocities *= np.sqrt(kinetic / now)
    if sim.engine != NATIVE:
        stepper.reset(stepper.y, stepper.time, stepper.steps_done)  # which tells the program
