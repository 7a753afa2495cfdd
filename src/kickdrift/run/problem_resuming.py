"""Parts for resuming a Problem's run: the Problem, its samples, and warnings where it is another one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from kickdrift.errors import InputError
from kickdrift.looks.observers import Energies, Sample
from kickdrift.model.events.events import checked_crossings
from kickdrift.model.problem import Problem
from kickdrift.run.files.problem import slopes_of
from kickdrift.trajectory.layout.points import same
from kickdrift.trajectory.layout.problem_header import ENERGY
from kickdrift.trajectory.problems.reader import ProblemRun
from kickdrift.trajectory.problems.record import another_f, changed_functions, differences

if TYPE_CHECKING:
    from kickdrift.model.events.events import Event
    from kickdrift.run.simulation import Simulation


def subject_of(
    run: ProblemRun, problem: Problem | None, events: Iterable[Event] | None
) -> tuple[Problem, tuple[Event, ...]]:
    """Return the Problem that the file describes, or the given one if it is the same, and its events."""
    if problem is None:
        problem = run.problem()
    elif others := differences(problem, run):
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
