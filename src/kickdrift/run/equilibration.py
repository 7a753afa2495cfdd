"""Equilibration: bring a system of particles to a temperature before a run."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from kickdrift.errors import InputError, RunError
from kickdrift.integrators.options import DT, TEMPERATURE
from kickdrift.jit.cache.notices import compiling_for
from kickdrift.looks.observers import kinetic_energy
from kickdrift.model.checks.limits import steps_in
from kickdrift.model.checks.values import positive, unwarned, whole_number
from kickdrift.model.freedom import apart_of, disturbing, fixed_heat, freedom_of, whole_motion
from kickdrift.model.run_defaults import Equilibration
from kickdrift.model.state import State
from kickdrift.model.system import System
from kickdrift.model.units.quantities import time_in
from kickdrift.run.watch.watched_stepper import WatchedStepper
from kickdrift.systemfile.files import prefixed
from kickdrift.text import counted, measured

if TYPE_CHECKING:
    from kickdrift.run.advance import Integration

Progress = Callable[[int, int], Any]
NEGATIVE = re.compile(r"(steps? )-(\d+)")
STAIRS = 200  # parts of constant temperature in the ramp of a heat bath


@dataclass(frozen=True)
class Ramp:
    """Temperature over an equilibration of ``count`` steps, linear in time."""

    start: float
    end: float
    count: int

    def at(self, step: float) -> float:
        """Temperature after this number of steps."""
        return self.start + (self.end - self.start) * step / self.count

    @property
    def flat(self) -> bool:
        """Whether the temperature is constant."""
        return self.start == self.end


def equilibrate(
    sim: Any, asked: Equilibration, progress: Progress | None, other: Callable[[str, dict[str, Any]], Any]
) -> None:
    """Bring the system to a temperature; see ``Simulation.equilibrate``.

    ``other`` makes a Simulation of the same system with another method and its options, for an equilibration with a
    method of its own, and for a run whose method cannot rescale velocities."""
    ramp = _checked(sim, asked)
    if asked.integrator is not None or asked.options:
        _with_own_method(sim, asked, ramp, progress, other)
    elif not sim.method.rescalable:
        _through(sim, other("velocity-verlet", {"dt": sim.system.run.dt}), asked, progress)
    elif sim.method.bath:
        _check_bath(sim, ramp, sim.integrator)
        _through_bath(sim, ramp, progress)
    else:
        _through_rescaling(sim, ramp, asked.interval, progress)
    sim.record.equilibrated = _told(sim, asked, ramp)


def _told(sim: Any, asked: Equilibration, ramp: Ramp) -> str:
    """The equilibration as the report tells it, such as "at 1.5 ε/k_B in 400 steps by baoab"."""
    symbol = sim.system.units.symbol
    heat = measured(f"{ramp.end:g}", symbol("temperature"))
    length = counted(asked.steps, "step", ",") if asked.steps else asked.time
    if isinstance(length, int | float):
        length = measured(f"{length:g}", symbol("time"))
    by = asked.integrator or (sim.integrator if sim.method.bath else "rescaled velocities")
    return f"{'at' if ramp.flat else f'from {ramp.start:g} to'} {heat} in {length} by {by}"


def equilibrate_as_told(sim: Any, exactly: bool = False, progress: Progress | None = None) -> None:
    """Equilibrate as the system's ``[equilibrate]`` says, if there is one.

    It ends at the temperature of the run's heat bath, which may be another than the file's, unless ``exactly``. The
    run's System then has the equilibration that took place."""
    asked = sim.system.equilibration
    if asked is None:
        return
    if sim.method.bath and not exactly:
        asked = asked.ending_at(float(sim.options[TEMPERATURE.name]))
    if asked != sim.system.equilibration:
        sim.integration.system = sim.system.with_equilibration(asked)
    sim.equilibrate(**asked.said(), progress=progress)


def _checked(sim: Any, asked: Equilibration) -> Ramp:
    """Refuse arguments that make no sense; return the temperature over the steps. The number of steps is of no use for
    an adaptive method."""
    if not isinstance(sim.system, System):
        raise InputError("equilibrate: a Problem has no temperature")
    start = _temperature(sim, "equilibrate: temperature", asked.temperature)
    end = start if asked.to is None else _temperature(sim, "equilibrate: to", asked.to)
    whole_number("equilibrate: interval", asked.interval, 1)
    if (asked.time is None) == (asked.steps is None):
        raise InputError(f"equilibrate: give time or steps{', not both' if asked.steps is not None else ''}")
    count = 1
    if asked.steps is not None:
        count = whole_number("equilibrate: steps", asked.steps, 1)
    else:
        time = time_in(asked.time, sim.system.units, "equilibrate: time")
        positive("equilibrate: time", time, "positive")
        dt = DT.in_units(asked.options.get("dt"), sim.system.units) or sim.dt
        count = max(1, round(steps_in("equilibrate: time", time, dt))) if isinstance(dt, float) else count
    if freedom_of(sim.system) == 0:
        alone = np.count_nonzero(sim.system.state.masses) < 2
        why = "a system of one particle has" if alone else "no degree of freedom is left, so the system has"
        raise InputError(f"equilibrate: {why} no temperature")
    if sim.running:
        raise InputError("equilibrate: the Simulation is already running")
    return Ramp(start, end, count)


def _temperature(sim: Any, key: str, value: Any) -> float:
    """A positive temperature in the system's unit, from a number or a text with a unit."""
    return positive(key, time_in(value, sim.system.units, key, TEMPERATURE.dimension), "positive")


def _check_bath(sim: Any, ramp: Ramp, by: str) -> None:
    """Refuse an equilibration ``by`` a method that ends at another temperature than the run's own heat bath has."""
    own = sim.integration.options[TEMPERATURE.name]
    if own == ramp.end:
        return
    if by == sim.integrator:
        raise InputError(
            f"equilibrate: temperature = {ramp.end:g} is not the heat bath's temperature = {own:g}; "
            f"{sim.method.name} equilibrates in its own bath, so give the same temperature, or a ramp with to = {own:g}"
        )
    raise InputError(
        f"equilibrate: two heat baths: {by} ends at {ramp.end:g}, and the run's {sim.integrator} is at {own:g}; "
        f"end at the run's temperature, for example with to = {own:g}"
    )


def _with_own_method(
    sim: Any,
    asked: Equilibration,
    ramp: Ramp,
    progress: Progress | None,
    other: Callable[[str, dict[str, Any]], Any],
) -> None:
    """Equilibrate with a method or options of the equilibration alone. The run's own options stay where it is the same
    method."""
    name, options = asked.integrator or sim.integrator, dict(asked.options)
    if asked.integrator is None:
        options = {key: value for key, value in sim.integration.options.items() if value is not None} | options
    if sim.method.bath:
        _check_bath(sim, ramp, name)
    dt = sim.system.run.dt if sim.dt is None else sim.dt
    with prefixed("equilibrate: "):
        made = other(name, {"dt": dt, **options, TEMPERATURE.name: ramp.end})
    if not made.method.bath:  # not reached: the method has refused a temperature
        raise InputError(f"equilibrate: {name} has no heat bath; leave integrator out to rescale velocities")
    _through(sim, made, asked, progress)


def _through(sim: Any, made: Any, asked: Equilibration, progress: Progress | None) -> None:
    """Equilibrate in another Simulation, and go on from its state. A total momentum that a heat bath has left goes,
    where the run would conserve it: the run counts its degrees of freedom without that momentum."""
    made.state, made.followers = sim.state, sim.followers
    made.equilibrate(asked.temperature, asked.time, asked.interval, progress, to=asked.to, steps=asked.steps)
    state = made.state
    if made.method.drags and not sim.method.drags and not disturbing(sim.system):
        state.phase[1] -= (state.phase[1] @ state.masses / state.masses.sum())[:, None]
    _move(sim, state)
    said = sim.integration.record.warnings
    if made.engine != sim.engine:
        said.append(f"equilibrate: {sim.engine} has no {made.integrator}, so kickdrift itself has equilibrated")
    said += [f"equilibrate: {line}" for line in getattr(made.integration.stepper, "warnings", ())]


def _through_rescaling(sim: Any, ramp: Ramp, interval: int, progress: Progress | None) -> None:
    masses, count = sim.system.coherent_masses, ramp.count
    per_degree = 0.5 * freedom_of(sim.system) * sim.system.units.boltzmann
    sim.integration.prepare()
    compile_seconds = sim.integration.record.compile_seconds
    _restart(sim)
    potentials: list[float] = []
    while sim.steps_done < count:
        _rescale(sim, masses, per_degree * ramp.at(sim.steps_done))
        sim.advance(min(interval, count - sim.steps_done))
        if ramp.flat and 2 * sim.steps_done >= count:
            potentials.append(sim.energy().potential)
        _tell(sim, progress, sim.steps_done, count)
    wanted = per_degree * ramp.end
    more = float(np.mean(potentials)) - potentials[-1] if potentials else 0.0
    _rescale(sim, masses, max(wanted + more, 0.5 * wanted))
    _restart(sim)
    sim.integration.record.compile_seconds = compile_seconds


def _through_bath(sim: Any, ramp: Ramp, progress: Progress | None) -> None:
    """Run the steps in the heat bath of the method. They count from -count, so their noise is not the run's."""
    count, run = ramp.count, sim.integration
    run.prepare()
    compile_seconds = run.record.compile_seconds
    _restart(sim)
    own = run.stepper
    own.reset(own.y, 0.0, -count)
    stair = 0
    while sim.steps_done < 0:
        ahead = max(1, count // 100)
        if not ramp.flat:
            stairs = min(STAIRS, count)
            while count * stair // stairs <= count + sim.steps_done:
                stair += 1
            first, last = count * (stair - 1) // stairs, count * stair // stairs
            _heat_to(run, ramp.at(0.5 * (first + last)))
            ahead = last - first
        with _steps_from(count):
            sim.advance(min(ahead, -sim.steps_done))
        _tell(sim, progress, count + sim.steps_done, count)
    if not ramp.flat:
        _heat_to(run, ramp.end)
    _restart(sim)
    run.record.compile_seconds = compile_seconds


@contextmanager
def _steps_from(count: int) -> Iterator[None]:
    """Context in which errors count steps from the start of an equilibration, which takes them from -count to 0."""
    try:
        yield
    except RunError as error:
        told = NEGATIVE.sub(lambda found: f"{found[1]}{count - int(found[2])} of the equilibration", str(error))
        error.args = (told, *error.args[1:])
        raise


def _tell(sim: Any, progress: Progress | None, done: int, of: int) -> None:
    """Show how far the equilibration is."""
    for each in sim.followers:
        each.settle(sim, done, of)
    if progress:
        progress(done, of)


def _heat_to(run: Integration, temperature: float) -> None:
    """Set the heat bath to another temperature."""
    if run.foreign:
        raise InputError(
            f"equilibrate: a ramp of temperature needs kickdrift's own heat baths, not {run.engine.name}'s"
        )
    stepper: Any = run.stepper
    stepper.go_to({TEMPERATURE.name: temperature})


def _move(sim: Any, state: State) -> None:
    """Go on from a state, which a barostat of the equilibration may have left in another box."""
    run = sim.integration
    if not run.box_varies and state.box != sim.system.box:
        system = sim.system.at(state.phase, 0.0, box=state.box)
        for force in system.forces:
            force.check(system)
        with compiling_for(run.purpose):
            stepper = run.stepper_for(system)
        run.stepper = stepper
        if run.events:
            run.stepper = run.events = WatchedStepper(run, stepper, run.watched)
    sim.state = state


def _restart(sim: Any) -> None:
    """Make the current state step 0."""
    now = sim.state
    sim.state = State(now.phase, now.masses, now.ids, now.box)


@unwarned
def _rescale(sim: Any, masses: Any, kinetic: float) -> None:
    x, v = sim.integration.stepper.y
    motion = whole_motion(masses, x, v, apart_of(sim.system))
    now = kinetic_energy(masses, v if motion is None else v - motion) - fixed_heat(sim.system)
    if now == 0:
        raise InputError(
            "equilibrate: all velocities are zero, so none can be rescaled; give [velocities] a temperature"
        )
    sim.integration.rescale_velocities(np.sqrt(kinetic / now), motion)
