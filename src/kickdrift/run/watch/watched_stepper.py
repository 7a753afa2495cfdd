"""A stepper that searches each step for events and lets these change the bodies.

It replaces the method's own stepper, which it uses through the ``Stepper`` protocol. The search covers whole steps of
the method. So neither samples nor the division of a run change the events, their times, or the run's bits. There is one
exception: if f depends on time, an adaptive run's last step before a given end time ends there, because f may have no
value beyond.

The present of an adaptive run may lie inside a step. A later event waits until the present reaches it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from kickdrift.errors import InputError, RunError
from kickdrift.forces.seam.kernel import OK
from kickdrift.integrators.stepping.stepper import Counts, Stepper
from kickdrift.model.event_log import Row, entry
from kickdrift.model.events.events import CloseApproach, Collision, Event
from kickdrift.model.memory import Memory, by_value
from kickdrift.model.patch import images_of
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.run.watch.collisions import Change, changed, energy_of_places, taken_between, taken_by_bounce
from kickdrift.run.watch.roster import Roster
from kickdrift.run.watch.search import Search
from kickdrift.run.watch.span import Act, Span, Watched
from kickdrift.run.watcher import Watcher

MOST_ACTS = 1000  # most collisions at one time: balls at rest on each other would bounce for ever


class Events(Watcher):
    """Watcher for a run with events. The stepper searches; this one only clears the reason of the last stop."""

    def __init__(self, stepper: WatchedStepper) -> None:
        self._stepper = stepper

    def begin(self) -> None:
        """Clear the reason of the last stop."""
        self._stepper.stopped = ""


class WatchedStepper:
    """Stepper that searches for events.

    Attributes
    ----------
    inner : the method's own stepper; a new one after bodies have left
    stopped : text of the event that ended the last run, or ""
    roster : all bodies of the run, those that left and those that came
    horizon : time of the last sample before the next ``advance``
    end : last time at which f may be evaluated; a step beyond is cut off there, and searched like others
    acting : whether an event may change conserved quantities
    """

    def __init__(self, run: Watched, inner: Stepper, events: Sequence[Event]) -> None:
        self._run, self.inner = run, inner
        self.roster = Roster(run.system, events)
        self.stopped = ""
        self.horizon = self.end = np.inf
        self.acting = any(getattr(event, "action", "log") not in ("log", "stop") for event in events)
        self._spent = Counts()
        self._warned: list[str] = []
        self._search = Search(run, events)

    @property
    def radii(self) -> Floats:
        """Radii (n,) of the bodies for the first event that may add some."""
        return self._search.radii(next(e for e in self._run.watched if isinstance(e, Collision) and e.adds))

    # --- the protocol of a Stepper ---

    @property
    def y(self) -> Floats:
        return self.inner.y

    @property
    def steps_done(self) -> int:
        return self.inner.steps_done

    @property
    def trouble(self) -> str:
        return self.inner.trouble

    @property
    def warnings(self) -> list[str]:
        return [*self._warned, *getattr(self.inner, "warnings", ())]

    @property
    def time(self) -> float:
        return self.inner.time

    @property
    def last_step(self) -> float:
        return self.inner.last_step

    @property
    def counts(self) -> Counts:
        return _sum(self._spent, self.inner.counts)

    def at(self, time: float) -> Floats:
        y = self._search.at(time)
        return self.inner.at(time) if y is None else y.copy()

    def reached(self, inside_step: bool) -> tuple[Floats, Floats]:
        return self.inner.reached(inside_step)

    def reset(self, y: Floats, time: float, steps: int) -> None:
        """Restart from y and forget all events. Bodies that left do not return."""
        self.inner.reset(y, time, steps)
        self.forget()

    def forget(self) -> None:
        """Forget all events."""
        self._search.begin()
        self._acts, self._last_act = 0, -np.inf
        self.stopped = ""

    def advance(self, steps: int, until: float = np.inf) -> int:
        if not steps:
            return self._prepare()
        search, last = self._search, self.inner.steps_done + steps
        status = OK
        while status == OK and not self.stopped:
            act, inner = search.act, self.inner
            if act is not None and act.time <= self.horizon:
                status = self._apply(act)
            elif act is not None or inner.steps_done >= last or inner.time >= until:
                break
            else:
                status = self._steps(last - inner.steps_done)
        self._search.log.tell(self.horizon)
        return status

    def _prepare(self) -> int:
        """Compile a step and its search."""
        status = self.inner.advance(0, self.inner.time)
        self._search.prepare(self.inner)
        return status

    # --- checkpoints ---

    def memory(self) -> Memory:
        """State of the method's stepper, of the search, and of the remaining bodies."""
        events = {
            **self.roster.memory(self._system),
            **self._search.memory(),
            "acts": self._acts,
            "last_act": self._last_act,
            "stopped": self.stopped,
            "spent": asdict(self._spent),
            "warned": self._warned,
        }
        return {**self.inner.memory(), "events": by_value(events)}

    def recall(self, memory: Memory) -> None:
        """See Stepper."""
        events = by_value(memory["events"])
        system = self.roster.recall(events)
        if system is not self._run.system:
            self.inner = self._run.stepper_for(system)
            self._search.renew_trials()
        flow: Any = self._run.flow
        if memory["y"].shape != flow.array(system.state).shape:
            raise InputError("checkpoint: y has another shape than in a run of this system")
        self.inner.recall(memory)
        self.forget()
        self._search.recall(events, self.inner)
        self._acts, self._last_act, self.stopped = events["acts"], events["last_act"], events["stopped"]
        self._spent, self._warned = Counts(**events["spent"]), events["warned"]

    # --- steps ---

    def _steps(self, most: int) -> int:
        """Take steps until one may have an event; one step, if only the search can tell."""
        inner = self.inner
        quiet = self._search.quiet_steps(inner)
        if quiet is None:
            return self._step()
        status, before, begin, loud = quiet.take(most)
        if status != OK:
            return self._mended(before.copy(), inner.time, inner.steps_done, status)
        if loud:
            self._search.scan(inner, before, begin, inner.y, inner.time)
        return status

    def _step(self) -> int:
        inner: Any = self.inner
        before, begin, done = inner.y.copy(), inner.time, inner.steps_done
        inner.end = self.end
        status = int(inner.advance(1, np.inf))
        if status == OK and inner.steps_done == done and self.end < np.inf:
            inner.clip = True
            status = int(inner.advance(1, np.inf))
            inner.clip = False
        if status != OK:
            return self._mended(before, begin, done, status)
        if inner.steps_done > done:
            self._search.scan(inner, before, begin, inner.y, inner.time)
        return status

    def _mended(self, before: Floats, begin: float, done: int, status: int) -> int:
        """Search a step that failed: it may have passed through a contact. Return OK, or the status of the step."""
        inner = self.inner
        if self._search.mends and (length := self._run.options.dt):
            end = begin + length
            inner.reset(before.copy(), end, done + 1)
            if self._search.scan(inner, before, begin, before, end, good=False):
                return OK
            inner.reset(before, begin, done)
            return inner.advance(1, np.inf)  # fails again, and knows why
        return status

    # --- actions of events ---

    @property
    def _system(self) -> System:
        return self._run.system

    def _apply(self, act: Act) -> int:
        """Apply an event at its time. With fixed steps, complete the rest of the step."""
        span, self._search.act = self._search.span, None
        assert span is not None
        event, step, adaptive = act.event, span.step, self._run.method.chooses_steps
        self._search.log.tell(act.time)
        again = act.time <= self._last_act + 8 * np.spacing(abs(act.time))
        self._acts, self._last_act = self._acts + 1 if again else 0, act.time
        if self._acts > MOST_ACTS:
            pair = " and ".join(self._system.body(i) for i in act.bodies)
            raise RunError(
                f"step {step} (t = {act.time:.9g}): more than {MOST_ACTS} collisions at one time, the last of {pair}: "
                f"bodies come to rest on each other, which bounces cannot describe; elastic_below is a speed under "
                f"which bounces are elastic"
            )
        if event.action == "stop":
            self._stop(act, span)
            return OK
        y = np.array(span.inside(act.time))
        self._search.parts = []
        try:
            self._change(act, y, step)
        except InputError as error:  # a force or the method refuses the remaining bodies
            names = " and ".join(self._system.body(i) for i in act.bodies)
            raise RunError(f"step {step} (t = {act.time:.9g}): after the {event.kind} of {names}: {error}") from error
        if adaptive or act.time >= span.t1:
            return OK
        y, begin = self.inner.y, act.time
        status, reached, cost = self._search.trials.step(y, begin, span.t1)
        self._spent = _sum(self._spent, cost)
        good = status == OK and bool(np.isfinite(reached).all())
        self.inner.reset(reached.copy(), span.t1, step)
        if not self._search.scan(self.inner, y, begin, reached, span.t1, good):
            return status
        self._run.bodies_changed()
        return OK

    def _stop(self, act: Act, span: Span) -> None:
        names = " and ".join(self._system.body(i) for i in act.bodies)
        what = {Collision.kind: "touch", CloseApproach.kind: "meet"}.get(act.event.kind, "escapes")
        row = entry(self._system, act.event.kind, act.time, span.step, act.bodies, act.distance, "stopped")
        self._search.log.add(row)
        self._search.know(act)
        if span.failed or (self._run.method.chooses_steps and act.time < span.t1):
            self.inner.reset(np.array(span.inside(act.time)), act.time, span.step)
            self._search.begin_crossings()
        self.stopped = f"{names} {what} at t = {act.time:.9g}"

    def _change(self, act: Act, y: Floats, step: int) -> None:
        """Bounce, merge or remove bodies, and restart from y."""
        system, event = self._system, act.event
        row = entry(system, event.kind, act.time, step, act.bodies, act.distance, "")
        local = event.action == "bounce" and energy_of_places(system)
        start, before = y, None if local else self._run.sample_at(y, act.time)
        change = self._changed(act, y, step)
        row["done"], y = change.done, change.y
        if change.other_bodies:
            self._follow(change)
        self._search.begin_crossings()
        self.inner.reset(y, act.time, step)
        if before is None:
            taken = taken_by_bounce(system, start, y, act.bodies)
        else:
            taken = taken_between(before, self._run.sample_at(y, act.time))
        row["energy"] = taken.energy
        images = images_of(system)
        moved = images is not None and images.moves and any(act.image)
        if event.action != "bounce" or event.restitution != 1 or moved:  # type: ignore[union-attr]
            self._run.record.take(taken)
        self._search.log.add(row)
        self._run.bodies_changed()
        if event.action != "merge":
            kept = [i for i in act.bodies if i not in change.gone]
            ids = (
                system.state.ids[kept].tolist()
                + self._system.state.ids[len(self._system) - len(change.born) :].tolist()
            )
            self._search.leave(ids, act.time, abs(self.inner.last_step))

    def _changed(self, act: Act, y: Floats, step: int) -> Change:
        """The change that an event makes. Raises RunError for a rule that fails, and for too many new bodies."""
        event = act.event
        assert not isinstance(event, CloseApproach)  # which only ends runs
        radii = self._search.radii(event) if isinstance(event, Collision) else np.zeros(0)
        try:
            images = images_of(self._system)
            offset = 0.0 if images is None else images.offset(act.image, act.time)
            change = changed(event, self._system, y, act.bodies, radii, self.roster.next, offset)
            self.roster.check_room(len(change.born))
        except RunError as error:
            names = " and ".join(self._system.body(i) for i in act.bodies)
            what = "rule for" if event.action == "rule" else "break-up of"
            raise RunError(f"step {step} (t = {act.time:.9g}): the {what} {names} {error}") from error
        return change

    def _follow(self, change: Change) -> None:
        """Go on with the bodies after a change."""
        before, now = self._system, change.system
        if len(now) < len(before):
            self._acts = 0  # mergers come to an end by themselves
        self.roster.change(before, change)
        self._search.resize(change)
        self._spent, self._warned = self.counts, self.warnings
        self.inner = self._run.stepper_for(now)
        self._search.follow(now)
        if change.sizes is not None:
            kept = np.flatnonzero(np.isin(now.state.ids, before.state.ids[list(change.sizes)])).tolist()
            self._search.part([*kept, *range(len(now) - len(change.born), len(now))])

    def going_on(self) -> list[Row]:
        """Entries for passages that have not ended."""
        return self._search.going_on()


def _sum(a: Counts, b: Counts) -> Counts:
    return Counts(a.evaluations + b.evaluations, a.rejected + b.rejected, a.jacobians + b.jacobians)
