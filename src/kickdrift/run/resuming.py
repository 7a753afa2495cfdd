"""A run taken up again from its file, to the very bits that it would have had.

A checkpoint holds all that the next step depends on, so the run goes on from the last one before the step wanted; what
lies between is run again without a look, which changes no bits and takes no longer however long the run has been.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from kickdrift.engines import NATIVE
from kickdrift.errors import InputError
from kickdrift.forces.bound import most_threads
from kickdrift.jit.compile import features, processor
from kickdrift.looks.observers import Sample
from kickdrift.model.limits import NEVER
from kickdrift.model.system import System
from kickdrift.run.loop import go_to
from kickdrift.run.plan import Plan, check_samples, whole_number
from kickdrift.run.simulation import Simulation
from kickdrift.text import counted, shown
from kickdrift.trajectory import reader
from kickdrift.trajectory.layout import versions
from kickdrift.trajectory.named import about, method_of, options_of
from kickdrift.trajectory.reader import CHANGED, Run
from kickdrift.trajectory.record import changed_sources, differences, system_of
from kickdrift.trajectory.rows import before, same

if TYPE_CHECKING:
    from kickdrift.model.events import Event

_NEW = "a new run can begin at a frame"


def resume(
    path: str | os.PathLike[str],
    *,
    step: int | None = None,
    system: System | None = None,
    events: Iterable[Event] | None = None,
    threads: int | None = None,
) -> Simulation:
    """The Simulation of a run's file, where the file ends or at a ``step`` before.

    It goes on to the same bits as the run that was not interrupted; that is promised for one version of kickdrift,
    numba and llvmlite on one kind of processor, and the report warns where these differ. At the file's end it goes on
    into the file: ``resume(path).run()`` finishes what the run was asked for, ``run(1000)`` takes 1000 steps more. From
    a step before the end, any ``output`` is a new file.

    Parameters
    ----------
    path : of a file that `Simulation.run` wrote, also of a run that was killed
    step : a step from the file's first to its last, frame or not; default its end
    system : that of the run, where its forces are of a class that is not registered; another one is an InputError
    events : those of the run, where they have functions of the user's own
    threads : default those of the run, or as many as there are; the bits do not depend on it

    Raises
    ------
    InputError
        Where there is no such file or step, or the file holds too little, and says what is missing.
    """
    if step is not None and (isinstance(step, bool) or not isinstance(step, int | np.integer)):
        raise InputError(f"step: expected a whole number, got {step!r}")
    if not isinstance(system, System | None):
        raise InputError(f"system: expected a System, got {shown(system)}")
    with reader.open(path) as run:
        sim = _simulation(run, system, events, threads)
        end = step is None
        goal = _goal(run, step, run.last_point)
        damaged = _restore(sim, run, goal)
        go_to(sim.integration, *goal, end=Plan.of(run.plan).end_time if run.plan else np.inf)
        at, when = goal
        if when is not None and not same((at, when), sim.steps_done, sim.time):
            raise InputError(f"{run.path}: damaged: its last sample is of step {at} and time {when:g}, and no step is")
        damaged += _samples(sim, run, goal)
        sim.record.warnings += [*damaged, *_warnings(sim, run, goal)]
        if end:
            path = os.path.realpath(path)
            sim.continue_in(path, run.run_id, run.every, Plan.of(run.plan) if run.plan else None)
    return sim


def continued(sim: Simulation, steps: int | None, time: float | None) -> Plan:
    """The plan of a resumed run with another end: so many steps, or so much time, since its step 0."""
    plan = sim.plan
    assert plan is not None
    begin = sim.record.samples[0].time if sim.record.samples else sim.time
    if sim.dt is not None and not sim.method.chooses_steps:
        begin = sim.time - sim.steps_done * sim.dt
    if time is not None and not np.isfinite(time):
        raise InputError(f"time must be a finite time, got {time!r}")
    if time is not None and sim.method.chooses_steps:
        if plan.interval:
            check_samples((begin + time - sim.time) / plan.interval, "interval")
        if begin + time < sim.time:
            raise InputError(f"{sim.output}: has come further than a time of {time:g}, to {sim.time - begin:.12g}")
        return replace(plan, end_step=NEVER, end_time=begin + time)
    if time is not None:
        if begin + time < sim.time - 1e-6 * (sim.dt or 0.0):
            raise InputError(f"{sim.output}: has come further than a time of {time:g}, to {sim.time - begin:.12g}")
        steps = sim.steps_done + sim.steps_to(until=begin + time)
    if steps is None:
        return plan
    steps = whole_number("steps", steps, 0)
    if steps < sim.steps_done:
        raise InputError(f"{sim.output}: has come further than step {steps}, to step {sim.steps_done}")
    if plan.every:
        check_samples((steps - sim.steps_done) / plan.every, "every")
    return replace(plan, end_step=steps, end_time=np.inf)


def _simulation(run: Run, system: System | None, events: Iterable[Event] | None, threads: int | None) -> Simulation:
    """As the file describes it, at its start."""
    if not run.checkpoints or not run.checkpoints.rows:
        raise InputError(
            f"{run.path}: holds no checkpoint (kickdrift/checkpoints), which is what a run is taken up again from; "
            f"{_NEW}"
        )
    if not run.unchanged:
        raise InputError(f"{run.path}: {CHANGED}, so that it cannot go on")
    if system is None:
        system = system_of(run, events=events)
    else:
        system = system if events is None else system.watched(events)
        if others := [key for key in differences(system, run) if key != "events" or events is None]:
            raise InputError(f"{run.path}: is the run of another system: {', '.join(others)} differ")
    with about(run.path):
        method = method_of(run.method)
        return Simulation(
            system, method.integrator, threads=threads or min(method.threads, most_threads()), engine=method.engine,
            processes=min(method.processes, os.cpu_count() or 1), **options_of(method.options),
        )  # fmt: skip


def _goal(run: Run, step: int | None, last: tuple[int, float] | None) -> tuple[int, float | None]:
    """The step to go to, and the time inside it where that lies before its end."""
    if step is None:
        assert run.checkpoints is not None
        return last or (int(run.checkpoints.steps[0]), None)
    first = int(run.checkpoints.steps[0]) if run.checkpoints else 0
    end = last[0] if last else first
    if not first <= step <= end:
        raise InputError(f"{run.path}: step {step} is not in it; it goes from step {first} to {end}")
    return step, None


def _restore(sim: Simulation, run: Run, goal: tuple[int, float | None]) -> list[str]:
    """Put the Simulation to the last whole checkpoint that does not lie behind the goal; what is damaged, in words."""
    table = run.checkpoints
    assert table is not None
    step, time = goal
    reached = [
        row for row, point in enumerate(zip(table.steps, table.times, strict=True)) if not _behind(*point, step, time)
    ]
    found = []
    for row in reversed(reached):
        try:
            checkpoint = table[row]
        except InputError as error:
            found.append(f"{str(error).removeprefix(f'{run.path}: ')}; an earlier one takes its place")
            continue
        try:
            sim.restore(checkpoint)
        except InputError as error:
            raise InputError(f"{run.path}: {error}") from None
        return found
    raise InputError(f"{run.path}: damaged: no checkpoint up to step {step} is whole; {_NEW}")


def _behind(at: int, when: float, step: int, time: float | None) -> bool:
    """Whether a point of the run lies behind the one to go to."""
    return at > step or (at == step and time is not None and before(time, when))


def _samples(sim: Simulation, run: Run, goal: tuple[int, float | None]) -> list[str]:
    """The record of the run so far: the file's whole samples. What is damaged, in words."""
    step, time = goal
    found, kept = run.whole_samples(), run.kept
    for k, (at, when) in enumerate(zip(found.steps, found.times, strict=True)):
        if found.rows[k] >= kept.samples or _behind(at, when, step, time):
            break
        values = {name: values[k] for name, values in found.observables.items()}
        try:
            sim.record.looks.add(Sample.of(int(at), float(when), values))
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"{run.path}: damaged: its samples are not those of a run: {error}") from None
    lines = []
    if kept != run.committed:
        lines.append(f"the file's end is damaged: what follows step {step} is computed again")
    if lost := kept.samples - int(np.count_nonzero(found.rows < kept.samples)):
        lines.append(f"{counted(lost, 'sample')} of the file damaged, and left out of the report")
    return lines


def _warnings(sim: Simulation, run: Run, goal: tuple[int, float | None]) -> list[str]:
    """Why the bits may not be the same, and where they are not."""
    if sim.engine != NATIVE:
        then, here = run.method.get("engine_version"), sim.engine_version
        other = "" if then == here else f", and {then} then is {here} now"
        return [f"the same bits are not promised: {sim.engine} begins anew from positions and velocities{other}"]
    now = versions() | {"processor": processor()}
    then = run.versions | {"processor": run.method.get("processor", "unknown")}
    changed = [
        f"{key} {then.get(key)} then, {now[key]} now"
        for key in ("kickdrift", "numba", "llvmlite", "processor")
        if then.get(key) != now[key]
    ]
    if "features" in run.method:  # older files name the processor alone
        changed += _changed_features(set(run.method["features"]), set(features()))
    found = [f"the same bits are not promised: {'; '.join(changed)}"] if changed else []
    found += [f"{name}: its source has changed since the run began" for name in changed_sources(sim.system, run)]
    there = np.flatnonzero(run.all_steps == goal[0])
    frame = int(there[-1]) if there.size else len(run)
    if frame < run.kept.frames and same((goal[0], run.all_times[frame]), sim.steps_done, sim.time):
        state = sim.state
        if np.array_equal(state.ids, run.ids) and run.exact:
            apart = float(np.abs(run[frame].positions - state.positions).max())
            if apart:
                found.append(f"the run goes on {apart:.3g} away from the file's frame there: it is not the same run")
    return found


def _changed_features(then: set[str], now: set[str]) -> list[str]:
    """The processor features that code was compiled for at only one of the two times, in words."""
    lost, new = ", ".join(sorted(then - now)), ", ".join(sorted(now - then))
    found = [f"compiled for {lost} then, not now"] if lost else []
    return found + ([f"compiled for {new} now, not then"] if new else [])
