"""Resuming a run from its file, bit for bit.

A checkpoint holds everything that determines the next step. The run continues from the last checkpoint before the
requested step. The steps in between are run again without a look, which changes no bits. The length of the run so far
does not matter.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from kickdrift.engines import NATIVE
from kickdrift.errors import InputError
from kickdrift.forces.bound.forces import most_threads
from kickdrift.integrators.options import PRESSURE, PRESSURE_EVERY, Options
from kickdrift.integrators.splitting.barostats.barostat import every_of_old
from kickdrift.jit.compile import features, processor
from kickdrift.looks.observers import Energies, Sample
from kickdrift.model.checks.limits import NEVER
from kickdrift.model.events.events import Event, checked_crossings
from kickdrift.model.problem import Problem
from kickdrift.model.stages import Stage
from kickdrift.model.system import System
from kickdrift.run.files import slopes_of
from kickdrift.run.loop import go_to
from kickdrift.run.plan.plan import Plan, check_samples, whole_number
from kickdrift.run.simulation import Simulation
from kickdrift.run.times import plan_at, times_of
from kickdrift.text import choices, counted, shown
from kickdrift.trajectory import opened
from kickdrift.trajectory.layout.checkpoints import before, same
from kickdrift.trajectory.layout.named import about, method_of, options_of
from kickdrift.trajectory.layout.names import versions
from kickdrift.trajectory.layout.problem_header import ENERGY
from kickdrift.trajectory.layout.record import changed_sources, differences, system_of
from kickdrift.trajectory.problems.reader import CHANGED as PROBLEM_CHANGED
from kickdrift.trajectory.problems.reader import ProblemRun
from kickdrift.trajectory.problems.record import another_f, changed_functions
from kickdrift.trajectory.problems.record import differences as problem_differences
from kickdrift.trajectory.read.reader import CHANGED, Run
from kickdrift.trajectory.read.recorded import Recorded

CHECKED_BYTES = 2**30  # of positions: a larger file is resumed without a look for damaged frames, which info finds
_NEW = "a new run can begin at a frame"


def subject_of(
    run: ProblemRun, problem: Problem | None, events: Iterable[Event] | None
) -> tuple[Problem, tuple[Event, ...]]:
    """Return the Problem that the file describes, or the given one if it is the same, and its events."""
    if problem is None:
        problem = run.problem()
    elif others := problem_differences(problem, run):
        raise InputError(f"{run.path}: belongs to another Problem: {', '.join(others)} differ")
    watched = checked_crossings(events or ())
    there = run.problem_record.get("events", [])
    if [event.kind for event in watched] != there:
        expected = ", ".join(there) or "no events"
        raise InputError(f"{run.path}: its run watched for {expected}; give the same, kd.resume(file, events=[…])")
    return problem, watched


def sample_of(step: int, time: float, values: Mapping[str, Any]) -> Sample:
    """Return the Sample of a Problem with these values."""
    energies = Energies(float("nan"), float("nan"), float(values.get(ENERGY, np.nan)))
    columns = {name: value for name, value in values.items() if name not in ProblemRun.own_names}
    return Sample(step, time, energies, columns=columns)


def check_f(sim: Simulation, run: ProblemRun) -> None:
    """Refuse a Problem whose f has other values than when the run began."""
    if another_f(run, slopes_of(sim.integration)):
        raise InputError(f"{run.path}: belongs to another Problem: f has other values than when the run began")


def other_y(sim: Simulation, run: ProblemRun, goal: tuple[int, float | None]) -> list[str]:
    """Return warnings: which functions have changed, and whether y differs from the file's."""
    found = [f"{name}: its source has changed since the run began" for name in changed_functions(sim.system, run)]
    samples = run.whole_samples()
    for row in np.flatnonzero(samples.steps == goal[0]):
        if same((goal[0], float(samples.times[row])), sim.steps_done, sim.time):
            apart = float(np.abs(samples.observables["y"][row] - sim.state.y).max())
            if apart:
                found.append(f"y differs by {apart:.3g} from the file's sample here: it is not the same run")
    return found


def resume(
    path: str | os.PathLike[str],
    *,
    step: int | None = None,
    system: System | None = None,
    problem: Problem | None = None,
    events: Iterable[Event] | None = None,
    threads: int | None = None,
    hosts: str | os.PathLike[str] | None = None,
) -> Simulation:
    """Return the Simulation of a run's file, at the file's end or at an earlier ``step``.

    The resumed run has the same bits as an uninterrupted run. This holds for one version of kickdrift, numba and
    llvmlite on one kind of processor; the report warns where these differ. From the file's end the run continues in the
    same file: ``resume(path).run()`` completes the original plan, ``run(1000)`` takes 1000 steps more. From an earlier
    step, any ``output`` is a new file.

    Parameters
    ----------
    path : path of a file that `Simulation.run` wrote, also for a run that was killed
    step : a step from the file's first to its last, with or without a frame; default the file's end
    system : the run's system, if a force's class is not registered; a different system raises InputError
    problem : the run's Problem, if it is made of functions of the user; another Problem raises InputError
    events : the run's events, if they have functions of the user
    threads : default the run's number, or as many as the machine has; the bits do not depend on it
    hosts : file that lists machines for the run's processes, as in `Simulation`

    Raises
    ------
    InputError
        If the file or the step does not exist, or the file lacks something that the message names.
    """
    if step is not None and (isinstance(step, bool) or not isinstance(step, int | np.integer)):
        raise InputError(f"step: expected a whole number, got {step!r}")
    if not isinstance(system, System | None):
        raise InputError(f"system: expected a System, got {shown(system)}")
    if not isinstance(problem, Problem | None):
        raise InputError(f"problem: expected a Problem, got {shown(problem)}")
    with _opened(path) as run:
        of_particles = isinstance(run, Run)
        if (problem if of_particles else system) is not None:
            kinds = ("System", "Problem") if of_particles else ("Problem", "System")
            raise InputError(f"{run.path}: is the run of a {kinds[0]}, not of a {kinds[1]}")
        _check_resumable(run)
        if isinstance(run, Run):
            sim = _simulation(run, _system(run, system, events), None, threads, hosts)
        else:
            sim = _simulation(run, *subject_of(run, problem, events), threads, hosts)
            check_f(sim, run)
        end = step is None
        goal = _goal(run, step, run.last_point)
        damaged = _restore(sim, run, goal)
        go_to(sim.integration, *goal, end=_end(run, sim))
        at, when = goal
        if when is not None and not same((at, when), sim.steps_done, sim.time):
            raise InputError(f"{run.path}: damaged: no step matches its last sample, step {at} at time {when:g}")
        damaged += _samples(sim, run, goal)
        sim.record.warnings += [*damaged, *_warnings(sim, run, goal)]
        if end:
            path = os.path.realpath(path)
            sim.continue_in(path, run.run_id, run.every, Plan.of(run.plan) if run.plan else None)
    return sim


def _end(run: Run | ProblemRun, sim: Simulation) -> float:
    """Return the time beyond which f is not evaluated: the end of the file's plan, in the direction of the run."""
    backward = sim.integration.backward
    end = Plan.of(run.plan).end_time if run.plan and Plan.of(run.plan).backward == backward else np.inf
    return -np.inf if backward and end == np.inf else end


def continued(
    sim: Simulation, steps: int | None, time: float | None, times: Sequence[float | str] | None = None
) -> Plan:
    """Return the plan of a resumed run with another end, ``steps`` or ``time`` counted from step 0, or with other
    ``times``."""
    plan = sim.plan
    assert plan is not None
    if times is not None:
        return plan_at(sim, times_of(sim, times))
    if plan.times and (steps, time) != (None, None):
        raise InputError(f"{sim.output}: the run looks at given times; give other --times to extend the run")
    begin = sim.record.samples[0].time if sim.record.samples else sim.time
    if sim.dt is not None and not sim.method.chooses_steps:
        begin = sim.time - sim.steps_done * sim.dt
    if time is not None and not np.isfinite(time):
        raise InputError(f"time must be finite, got {time!r}")
    if time is not None and plan.backward:
        raise InputError(f"{sim.output}: the run goes back in time; give --steps")
    if time is not None and sim.method.chooses_steps:
        if plan.interval:
            check_samples((begin + time - sim.time) / plan.interval, "interval")
        if begin + time < sim.time:
            raise InputError(f"{sim.output}: is already past a time of {time:g}, at {sim.time - begin:.12g}")
        return replace(plan, end_step=NEVER, end_time=begin + time)
    if time is not None:
        if begin + time < sim.time - 1e-6 * (sim.dt or 0.0):
            raise InputError(f"{sim.output}: is already past a time of {time:g}, at {sim.time - begin:.12g}")
        steps = sim.steps_done + sim.steps_to(until=begin + time)
    if steps is None:
        return plan
    steps = whole_number("steps", steps, 0)
    if steps < sim.steps_done:
        raise InputError(f"{sim.output}: is already past step {steps}, at step {sim.steps_done}")
    if plan.every:
        check_samples((steps - sim.steps_done) / plan.every, "every")
    return replace(plan, end_step=steps, end_time=-np.inf if plan.backward else np.inf)


def _opened(path: str | os.PathLike[str]) -> Run | ProblemRun:
    """Return the run's file, open for reading; an InputError for a table."""
    run = opened.open(path)
    if not isinstance(run, Recorded):
        raise InputError(f"{run.path}: is a table, which holds no checkpoint; a Problem's run in a .h5 file can resume")
    return run  # type: ignore[return-value]


def _check_resumable(run: Run | ProblemRun) -> None:
    """Refuse a file without a checkpoint, or one that was changed."""
    if not run.checkpoints or not run.checkpoints.rows:
        raise InputError(
            f"{run.path}: holds no checkpoint (kickdrift/checkpoints), so the run cannot be resumed; {_NEW}"
        )
    if not run.unchanged:
        changed = CHANGED if isinstance(run, Run) else PROBLEM_CHANGED
        raise InputError(f"{run.path}: {changed}; the run cannot be resumed")


def _system(run: Run, system: System | None, events: Iterable[Event] | None) -> System:
    """Return the System that the file describes, or the given one if it is the same."""
    if system is None:
        return system_of(run, events=events)
    system = system if events is None else system.watched(events)
    if others := [key for key in differences(system, run) if key != "events" or events is None]:
        raise InputError(f"{run.path}: belongs to another system: {', '.join(others)} differ")
    return system


def _simulation(
    run: Run | ProblemRun,
    subject: System | Problem,
    events: Iterable[Event] | None,
    threads: int | None,
    hosts: str | os.PathLike[str] | None,
) -> Simulation:
    """Return the Simulation that the file describes, at the run's start."""
    with about(run.path):
        method = method_of(run.method)
        sim = Simulation(
            subject, method.integrator, threads=threads or min(method.threads, most_threads()), engine=method.engine,
            processes=method.processes if hosts else min(method.processes, os.cpu_count() or 1), hosts=hosts,
            events=events, **_options(run, options_of(method.options)),
        )  # fmt: skip
    return staged(sim, subject.stages) if isinstance(subject, System) and subject.stages else sim


def _options(run: Run | ProblemRun, given: dict[str, Any]) -> dict[str, Any]:
    """Options of the run; ``pressure_every`` is that of its checkpoints, which may be older than the default of now."""
    table = run.checkpoints
    if given.get(PRESSURE.name) is None or given.get(PRESSURE_EVERY.name) is not None or table is None:
        return given
    for row in range(table.rows):
        try:
            memory = table[row]["stepper"]["barostat"]
        except (InputError, LookupError, TypeError):  # damaged; `_restore` says so
            continue
        every = every_of_old(Options(**given), memory)
        return given if every is None else given | {PRESSURE_EVERY.name: every}
    return given


def staged(sim: Simulation, stages: Iterable[Stage]) -> Simulation:
    """Make a Simulation the first of these stages. Its file has them, so that `run_stages` goes on from there."""
    sim.integration.system = sim.system.with_stages(*stages)
    return sim


def _goal(run: Run | ProblemRun, step: int | None, last: tuple[int, float] | None) -> tuple[int, float | None]:
    """Return the step to resume at, and the time inside that step if it lies before the step's end."""
    if step is None:
        assert run.checkpoints is not None
        return last or (int(run.checkpoints.steps[0]), None)
    first = int(run.checkpoints.steps[0]) if run.checkpoints else 0
    end = last[0] if last else first
    if not first <= step <= end:
        raise InputError(f"{run.path}: has no step {step}; its steps are {first} to {end}")
    return step, None


def _restore(sim: Simulation, run: Run | ProblemRun, goal: tuple[int, float | None]) -> list[str]:
    """Restore the last whole checkpoint not after the goal; return a warning for each damaged one."""
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
            found.append(f"{str(error).removeprefix(f'{run.path}: ')}; an earlier checkpoint is used")
            continue
        try:
            sim.restore(checkpoint)
        except InputError as error:
            raise InputError(f"{run.path}: {error}") from None
        return found
    raise InputError(f"{run.path}: damaged: no intact checkpoint up to step {step}; {_NEW}")


def _behind(at: int, when: float, step: int, time: float | None) -> bool:
    """Tell whether a point of the run is later than the goal."""
    return at > step or (at == step and time is not None and before(time, when))


def _samples(sim: Simulation, run: Run | ProblemRun, goal: tuple[int, float | None]) -> list[str]:
    """Fill the record with the file's whole samples, and return warnings about damaged ones."""
    step, time = goal
    found, kept = run.whole_samples(), run.kept
    for k, (at, when) in enumerate(zip(found.steps, found.times, strict=True)):
        if found.rows[k] >= kept.samples or _behind(at, when, step, time):
            break
        values = {name: values[k] for name, values in found.observables.items()}
        try:
            make = Sample.of if isinstance(run, Run) else sample_of
            sim.record.looks.add(make(int(at), float(when), values))
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"{run.path}: damaged: its samples do not fit a run: {error}") from None
    lines = [] if isinstance(run, ProblemRun) else _damaged_frames(run, kept.frames)
    if kept != run.committed:
        lines.append(f"the file's end is damaged; the run is computed again from step {step}")
    if lost := kept.samples - int(np.count_nonzero(found.rows < kept.samples)):
        lines.append(f"{counted(lost, 'damaged sample')} of the file left out of the report")
    return lines


def _damaged_frames(run: Run, kept: int) -> list[str]:
    """A warning of damaged frames before a number of frames, which a resumed run leaves as they are."""
    if 24 * len(run.ids) * len(run) > CHECKED_BYTES:
        return []
    found = [k for k in run.damaged_frames() if k < kept]
    return [f"the file stays damaged: {choices(f'frame {k}' for k in found)}"] if found else []


def _warnings(sim: Simulation, run: Run | ProblemRun, goal: tuple[int, float | None]) -> list[str]:
    """Return warnings: why the bits may differ from the original run's, and where they do differ."""
    if sim.engine != NATIVE:
        then, here = run.method.get("engine_version"), sim.engine_version
        other = "" if then == here else f", and its version was {then} and is now {here}"
        return [f"bits may differ: {sim.engine} restarts from positions and velocities{other}"]
    now = versions() | {"processor": processor()}
    then = run.versions | {"processor": run.method.get("processor", "unknown")}
    changed = [
        f"{key} was {then.get(key)}, now {now[key]}"
        for key in ("kickdrift", "numba", "llvmlite", "processor")
        if then.get(key) != now[key]
    ]
    if "features" in run.method:  # older files lack the features
        changed += _changed_features(set(run.method["features"]), set(features()))
    found = [f"bits may differ: {'; '.join(changed)}"] if changed else []
    return found + (_other_particles(sim, run, goal) if isinstance(run, Run) else other_y(sim, run, goal))


def _other_particles(sim: Simulation, run: Run, goal: tuple[int, float | None]) -> list[str]:
    """Return warnings: which forces have changed, and whether positions differ from the file's."""
    found = [f"{name}: its source has changed since the run began" for name in changed_sources(sim.system, run)]
    there = np.flatnonzero(run.all_steps == goal[0])
    frame = int(there[-1]) if there.size else len(run)
    if frame < run.kept.frames and same((goal[0], run.all_times[frame]), sim.steps_done, sim.time):
        state = sim.state
        if np.array_equal(state.ids, run.ids) and run.exact:
            apart = float(np.abs(run[frame].positions - state.positions).max())
            if apart:
                found.append(f"positions differ by {apart:.3g} from the file's frame here: it is not the same run")
            if run[frame].box != state.box:
                box = run[frame].box.described(run.units.symbol("length"))
                found.append(f"the box differs from the file's frame here, {box}: it is not the same run")
    return found


def _changed_features(then: set[str], now: set[str]) -> list[str]:
    """Describe the processor features that only one of the two compilations used."""
    lost, new = ", ".join(sorted(then - now)), ", ".join(sorted(now - then))
    found = [f"the file's run used {lost}, this one does not"] if lost else []
    return found + ([f"this run uses {new}, the file's did not"] if new else [])
