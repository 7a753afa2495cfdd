"""Pilot runs: a solution at evenly spaced times, its cost, a time limit, and resonance of multiple time steps."""

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from time import perf_counter
from typing import Any

import numpy as np

from kickdrift.errors import InputError, RunError
from kickdrift.integrators.asked import Integrator
from kickdrift.integrators.flows.particle_flow import ParticleFlow
from kickdrift.integrators.step_choice.step_length import MOST, fastest
from kickdrift.model.problem import Problem, ProblemState
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.run.simulation import Simulation
from kickdrift.statistics.drift import EnergyError, energy_error
from kickdrift.text import measured

SHORT = 0.1  # seconds; a shorter run is timed three times more, a longer one once
LONG = 3.0  # seconds; a longer run is not timed again, since its looks take little of its time
NEVER = 2**40  # steps between looks, for looks at both ends alone

Subject = System | Problem


class OutOfTime(Exception):
    """Error of a run that took longer than its limit.

    It holds the reached ``time`` with ``y`` there, and the evaluations and seconds so far."""

    def __init__(self, time: float, y: Floats, evaluations: int, seconds: float) -> None:
        super().__init__(f"stopped after {seconds:.2g} s, at t = {time:.4g}")
        self.time, self.y, self.evaluations, self.seconds = time, y, evaluations, seconds


@dataclass(frozen=True)
class Track:
    """Solution and cost of one run.

    Attributes
    ----------
    times : (S + 1,) evenly spaced from the start
    y : (S + 1, N) all unknowns at these times: for particles, positions and then velocities
    energies : (S + 1,) energy at these times; nan for a Problem without energy
    kinetic : kinetic energy at the start, 0 for a Problem
    steps, rejected, evaluations : cost of the run
    seconds : time without compiling
    """

    times: Floats
    y: Floats
    energies: Floats
    kinetic: float
    steps: int
    rejected: int
    evaluations: int
    seconds: float

    @property
    def energy(self) -> EnergyError | None:
        """Energy error relative to the first value, defined as in a run's report."""
        return None if np.isnan(self.energies).any() else energy_error(self.energies, self.kinetic)


def vector(state: Any) -> Floats:
    """All unknowns (N,) of a State or ProblemState; a copy."""
    return (state.y if isinstance(state, ProblemState) else state.phase).reshape(-1).copy()


def state_at(start: Any, y: Floats, time: float) -> Any:
    """State or ProblemState with the unknowns (N,) at a time, and no steps done."""
    if isinstance(start, ProblemState):
        return ProblemState(y.copy(), time)
    return replace(start, phase=y.reshape(start.phase.shape).copy(), time=time, steps_done=0)


def follow(
    subject: Subject,
    start: Any,
    which: str | Integrator,
    length: float,
    samples: int,
    *,
    steps: int | None = None,
    rtol: float | None = None,
    atol: float | None = None,
    threads: int = 1,
    limit: float = np.inf,
) -> Track:
    """Run from ``start`` for ``length``, in ``steps`` fixed steps (a multiple of ``samples``) or to the tolerances.

    Raises RunError if the run blows up, and OutOfTime after ``limit`` seconds.
    """
    dt = length / steps if steps else None
    sim = Simulation(subject, which, dt=dt, threads=threads, rtol=rtol, atol=atol, precision="double")
    sim.state = start
    y = np.full((samples + 1, vector(start).size), np.nan)
    energies = np.full(samples + 1, np.nan)
    began: list[float] = []

    def look(sim: Simulation) -> None:
        began.append(perf_counter())
        k = round((sim.time - start.time) / length * samples)
        y[k], energies[k] = vector(sim.state), sim.record.samples[-1].energies.total

    def progress(done: int, of: int) -> None:
        if perf_counter() - began[0] > limit:
            raise OutOfTime(
                sim.time - start.time, vector(sim.state), sim.record.force_evaluations, sim.record.wall_seconds
            )

    _guarded(lambda: _run(sim, start.time + length, steps, samples, look, progress))
    kinetic = sim.record.samples[0].energies.kinetic
    record = sim.record
    seconds = record.wall_seconds
    if seconds < LONG and seconds < limit:
        seconds = _timed(sim, start, length, steps)
    times = start.time + length * np.arange(samples + 1) / samples
    return Track(
        times,
        y,
        energies,
        0.0 if np.isnan(kinetic) else kinetic,
        record.steps,
        record.rejected_steps,
        record.force_evaluations,
        seconds,
    )


def warm_up(subject: Subject, start: Any, which: str | Integrator, step: float, threads: int) -> None:
    """Compile all code for a run. ``step`` is short, but long for a stiff problem's start; whether the step succeeds
    does not matter."""
    sim = Simulation(subject, which, dt=step, threads=threads, precision="double")
    sim.state = start
    with suppress(RunError):
        if sim.method.chooses_steps:
            _guarded(lambda: _run(sim, start.time + step, None, 1, _no_look, None))
        else:
            _guarded(lambda: sim.run(1, every=1))


def _timed(sim: Simulation, start: Any, length: float, steps: int | None) -> float:
    """Seconds of the same run without looks in between; the median of three for a short run."""
    seconds: list[float] = []
    while not seconds or (len(seconds) < 3 and seconds[0] < SHORT):
        sim.state = start
        fixed = steps is not None and not sim.method.chooses_steps
        end = {"steps": steps} if fixed else {"until": start.time + length}
        _guarded(partial(sim.run, **end, every=steps if fixed else NEVER))
        seconds.append(sim.record.wall_seconds)
    return float(np.median(seconds))


def _run(sim: Simulation, until: float, steps: int | None, samples: int, look: Any, progress: Any) -> None:
    if steps and not sim.method.chooses_steps:
        sim.run(steps, every=steps // samples, observe=look, progress=progress)
    else:
        sim.run(until=until, interval=(until - sim.time) / samples, observe=look, progress=progress)


def _no_look(sim: Simulation) -> None:
    """Do nothing at a look."""


def _guarded(run: Callable[[], Any]) -> None:
    """Call a run. Errors from an energy function far off the solution count as a blow-up."""
    try:
        with np.errstate(all="ignore"):
            run()
    except InputError:
        raise
    except (ArithmeticError, ValueError) as error:
        raise RunError(f"blew up: {type(error).__name__}: {error}") from error


def resonance(subject: Subject, start: Any) -> list[str]:
    """Note on the longest step of the slow forces, [] without an oscillation or for more than ``MOST`` particles.

    Kicks of slow forces that come twice or more often in a period of the fastest oscillation pump energy into it
    (Biesiadecki & Skeel 1993, J. Comput. Phys. 109, 318, doi:10.1006/jcph.1993.1220)."""
    if not isinstance(subject, System) or len(subject) > MOST:
        return []
    omega = fastest(ParticleFlow(subject, 1, True), start.time, start.phase)
    if not omega > 0:
        return []
    period, unit = 2 * math.pi / omega, measured("", subject.units.symbol("time"))
    return [
        f"resonance: the fastest oscillation has a period of {period:.3g}{unit}, and slow forces resonate with it from "
        f"dt = {period / 2:.3g}{unit} on"
    ]
