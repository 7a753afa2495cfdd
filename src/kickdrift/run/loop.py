"""The loop of one run: steps and looks by a plan, with watchers; and runs without looks."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from time import perf_counter
from typing import Any

import numpy as np

from kickdrift.errors import InputError
from kickdrift.jit.cache.notices import compiling_for
from kickdrift.looks.record import LOOKS, STEPPING
from kickdrift.run.advance import Integration
from kickdrift.run.looks import Sampler
from kickdrift.run.plan.lengths import CLOSE
from kickdrift.run.plan.plan import Plan
from kickdrift.run.report.report import Report, seconds_of
from kickdrift.run.times import go_to_next
from kickdrift.run.watcher import Watcher
from kickdrift.run.watchers.file import File
from kickdrift.text import shown

Progress = Callable[[int, int], Any]


def run_through(
    run: Integration,
    sampler: Sampler,
    plan: Plan,
    watchers: Sequence[Watcher],
    alone: bool,
    report: Callable[[], Report],
    progress: Progress | None,
) -> Report:
    """Run to the end of the plan, or until Ctrl-C, which raises KeyboardInterrupt after all watchers are closed.

    ``alone`` says that only the record needs the looks during the run. ``report`` makes the report."""
    begun: list[Watcher] = []
    run.ended = ""
    with run.busy() as interrupted, compiling_for(run.purpose):
        try:
            for watcher in watchers:
                _timed(run, watcher, watcher.begin)
                begun.append(watcher)
            _go(run, sampler, plan, watchers, alone, interrupted, progress)
            for watcher in watchers:
                watcher.end()
            found = report()
        except BaseException:
            for watcher in reversed(begun):
                watcher.close(None)
            raise
        for watcher in reversed(begun):
            _timed(run, watcher, partial(watcher.close, found))
    if interrupted():
        raise KeyboardInterrupt
    return replace(found, seconds=seconds_of(run.record))


def _timed(run: Integration, watcher: Watcher, act: Callable[[], None]) -> None:
    """Let a watcher act, and count the time as its part of the work."""
    with run.record.spending(watcher.part):
        act()


def _go(
    run: Integration,
    sampler: Sampler,
    plan: Plan,
    watchers: Sequence[Watcher],
    alone: bool,
    interrupted: Callable[[], bool],
    progress: Progress | None,
) -> None:
    def look(again: bool = True) -> None:
        with run.record.spending(LOOKS):
            sampler.look(again)
        for watcher in watchers:
            _timed(run, watcher, watcher.look)

    def look_or_pause(looked: bool) -> None:
        if looked:
            look()
        else:
            for watcher in watchers:
                _timed(run, watcher, watcher.pause)

    look(again=False)
    file = next((watcher for watcher in watchers[1:2] if isinstance(watcher, File) and watcher.takes_series), None)
    file = file if len(watchers) == 2 else None
    began, spent_before = perf_counter(), run.record.wall_seconds
    looked = True
    while not (plan.over(run) or interrupted() or run.ended or (run.events and run.events.stopped)):
        if plan.times:
            stepped = perf_counter()
            looked = go_to_next(run, plan)
            run.record.spend(STEPPING, perf_counter() - stepped)
            run.record.wall_seconds = spent_before + perf_counter() - began
            look_or_pause(looked)
        elif plan.only_shortened(run):
            run.look_ahead(plan.end_time, counted=True)
            look()
            looked = True
        elif alone and (count := sampler.alone(plan, run.chunk)):
            sampler.series(plan, count)
            run.record.wall_seconds = spent_before + perf_counter() - began
            looked = run.at is None and run.record.looks.at(run.steps_done, run.time)
        elif file and (count := sampler.block(plan)):
            sampler.series_for(file, plan, count)
            run.record.wall_seconds = spent_before + perf_counter() - began
            looked = True
        else:
            stop, stop_time = plan.next_stop(run)
            stepped = perf_counter()
            steps = min(run.chunk, stop - run.stepper.steps_done)
            held = run.advance(steps, stop_time, plan.horizon(stop_time), plan.end_time)
            if held:
                run.look_ahead(plan.horizon(stop_time), counted=plan.horizon(stop_time) == plan.end_time)
            else:
                run.at = plan.present(run.stepper.time, stop_time)
            run.record.spend(STEPPING, perf_counter() - stepped)
            run.record.wall_seconds = spent_before + perf_counter() - began
            at_stop = run.steps_done == stop and not (plan.only_shortened(run) and run.steps_done % plan.every)
            looked = held or at_stop or plan.reached(run.stepper.time, stop_time)
            look_or_pause(looked)
        if progress:
            progress(*plan.progress(run))
    if not looked:
        look()


def go_on(
    run: Integration, steps: int, every: int | None = None, visit: Callable[[Any], Any] | None = None, sim: Any = None
) -> None:
    """Take ``steps`` steps without a look, or fewer if an event ends the run.

    ``visit(sim)`` is called after each ``every`` steps and at the end. If it returns a true value, the steps end."""
    if not (visit is None or callable(visit)):
        raise InputError(f"advance: visit must be a function, got {shown(visit)}")
    run.turn(backward=False)
    run.prepare()
    last = run.steps_done + steps
    stop = last if every is None or visit is None else min(last, run.steps_done + every)
    if run.events:
        run.events.stopped = ""
    with run.busy() as interrupted:
        while run.steps_done < last and not (interrupted() or (run.events and run.events.stopped)):
            run.advance(min(run.chunk, stop - run.stepper.steps_done))
            if visit is not None and run.steps_done >= stop:
                if visit(sim):
                    break
                stop = min(last, stop + (every or steps))
    if interrupted():
        raise KeyboardInterrupt


def go_to(run: Integration, step: int, time: float | None = None, end: float = np.inf) -> None:
    """Run to a step without a look, also through events that end a run.

    An adaptive method runs to a ``time`` inside its last step. ``end`` is the planned end of the run."""
    run.prepare()
    far = -np.inf if run.backward else np.inf
    horizon, held = (far if time is None else time), False
    short = _shortened_step(run, step, time)
    step -= short
    with run.busy() as interrupted:
        while run.steps_done < step and not (held or interrupted()):
            if run.events:
                run.events.stopped = ""
            held = run.advance(min(run.chunk, step - run.stepper.steps_done), horizon=horizon, end=end)
            if _behind(run, horizon, run.stepper.time - run.stepper.last_step, 1e-9 * abs(horizon)):
                raise InputError(f"step {step}: is not at time {horizon:g}; step {run.steps_done} reaches that time")
    if interrupted():
        raise KeyboardInterrupt
    if time is not None and short and run.at is None:
        run.look_ahead(time)
    elif time is not None and (held or _behind(run, time, run.stepper.time)):
        run.at = time
    run.keep()


def _behind(run: Integration, time: float, other: float, margin: float = 0.0) -> bool:
    """Whether another time lies beyond a time, in the direction of the run, by more than a margin."""
    return other < time - margin if run.backward else other > time + margin


def _shortened_step(run: Integration, step: int, time: float | None) -> bool:
    """Whether a time lies inside a fixed step: a run ended there with a shortened step."""
    if time is None or run.dt is None or run.method.chooses_steps:
        return False
    dt = -run.dt if run.backward else run.dt
    whole = run.stepper.time + (step - run.stepper.steps_done) * dt
    return _behind(run, time, whole, CLOSE * run.dt)
