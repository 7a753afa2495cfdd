"""A stepper under watch: steps are taken one by one, each is searched for events, and some of these change the bodies.

It stands where a run has the method's own stepper and uses nothing of that but the ``Stepper`` protocol. What
is searched is always a whole step of the method, whatever a run looks at in between, so that neither looks nor the
pieces that a run is cut into change what is found, when, or the run's bits. One exception: where f depends on time and
the method chooses its steps, the last step of a run until some time ends there, because f may have no value beyond.
What is found beyond the present of an
adaptive run, which may lie inside a step, waits until the present has come there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from kickdrift.errors import InputError, RunError
from kickdrift.forces.kernel import OK
from kickdrift.integrators.stepper import Counts
from kickdrift.model.events import CloseApproach, Collision, Crossing, Escape, Event
from kickdrift.model.memory import Memory, by_value
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.run.watch.collisions import bounced, joined, left_of, merged, remaining_memory, without
from kickdrift.run.watch.log import Log
from kickdrift.run.watch.trials import Trials, Watched
from kickdrift.run.watch.watcher import Watcher
from kickdrift.run.watch.watches import Act, Approaches, Contacts, Crossings, Escapes, Row, Span, entry

if TYPE_CHECKING:
    from kickdrift.integrators.stepper import Stepper

MOST_ACTS = 1000  # at one time: balls that come to rest on each other bounce for ever
NEVER_BACK = -1  # where a body that was absorbed has its survivor


class Events(Watcher):
    """Begins a run anew where an event ended the last one; the stepper does the rest of the search."""

    def __init__(self, stepper: WatchedStepper) -> None:
        self._stepper = stepper

    def begin(self) -> None:
        """No event has ended the run."""
        self._stepper.stopped = ""


class WatchedStepper:
    """A stepper that looks for events.

    Attributes
    ----------
    inner : the method's own stepper; another one once bodies have left
    stopped : the event that ended the last run, in words; "" where none did
    absorbed : of each body that left, by id, the id of the one that took it up, or ``NEVER_BACK``
    horizon : no look at the run before its next ``advance`` is later than this
    end : f is evaluated at no later time: the step that would lead beyond it is cut off there, and searched like others
    first : the system with all its bodies, those that have left too
    acting : whether any of the events may change what is conserved
    """

    def __init__(self, run: Watched, inner: Stepper, events: Sequence[Event]) -> None:
        self._run, self.inner = run, inner
        self.first = run.system  # with all its bodies
        self.stopped = ""
        self.horizon = self.end = np.inf
        self.absorbed: dict[int, int] = {}
        self.acting = any(getattr(event, "action", "log") in ("merge", "bounce", "remove") for event in events)
        self._spent = Counts()
        self._warned: list[str] = []
        self._log = Log(run)
        subject: Any = run.system
        self._approaches = [Approaches(e, subject) for e in events if isinstance(e, CloseApproach)]
        self._contacts = [Contacts(e, subject) for e in events if isinstance(e, Collision)]
        self._escapes = [Escapes(e, subject) for e in events if isinstance(e, Escape)]
        self._crossings = Crossings([e for e in events if isinstance(e, Crossing)], subject)
        self._watches: list[Any] = [*self._approaches, *self._contacts, *self._escapes, self._crossings]
        self._lookers: list[Any] = [*self._approaches, *([self._crossings] if len(self._crossings) else [])]
        self._trials = Trials(run)

    # --- what a Simulation asks of a stepper ---

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
        return self.inner.at(time)

    def reached(self, inside_step: bool) -> tuple[Floats, Floats]:
        return self.inner.reached(inside_step)

    def reset(self, y: Floats, time: float, steps: int) -> None:
        """Begin anew at y, with nothing seen so far; bodies that left stay away."""
        self.inner.reset(y, time, steps)
        self.forget()

    def forget(self) -> None:
        """Forget what was seen so far."""
        self._log.forget()
        self._act: Act | None = None
        self._span: Span | None = None
        self._acts, self._last_act = 0, -np.inf
        self.stopped = ""
        for watch in self._watches:
            watch.begin(self._run.system)

    def advance(self, steps: int, until: float = np.inf) -> int:
        if not steps:
            return self._prepare()
        last = self.steps_done + steps
        status = OK
        while status == OK and not self.stopped:
            if self._act is not None and self._act.time <= self.horizon:
                status = self._apply(self._act)
            elif self._act is not None or self.steps_done >= last or self.time >= until:
                break
            else:
                status = self._step()
        self._log.tell(self.horizon)
        return status

    def _prepare(self) -> int:
        """Compile what a step and its search need."""
        status = self.inner.advance(0, self.inner.time)
        y, t = self.inner.y, self.inner.time
        for watch in self._watches:
            if watch is not self._crossings:
                known = watch.memory()
                watch.scan(y, t, y, t, self.steps_done)
                watch.recall(known)
        return status

    # --- checkpoints ---

    def memory(self) -> Memory:
        """The method's own, and beside it what is under way: passages and contacts, what waits for the present to come
        there, and the bodies that are left, where some have gone."""
        act, span = self._act, self._span
        events = {
            "bodies": remaining_memory(self.first, self._system),
            "watches": [watch.memory() for watch in self._watches],
            "waiting": self._log.memory(),
            "act": act and {**act._asdict(), "event": self._acting.index(act.event)},
            "span": act and span and {key: getattr(span, key) for key in ("y0", "t0", "y1", "t1", "step")},
            "acts": self._acts,
            "last_act": self._last_act,
            "stopped": self.stopped,
            "absorbed": [[gone, survivor] for gone, survivor in self.absorbed.items()],
            "spent": asdict(self._spent),
            "warned": self._warned,
        }
        return {**self.inner.memory(), "events": by_value(events)}

    def recall(self, memory: Memory) -> None:
        """See Stepper."""
        events = by_value(memory["events"])
        system = self.first if events["bodies"] is None else left_of(self.first, **events["bodies"])
        if system is not self._run.system:
            self.inner = self._run.stepper_for(system)
            self._trials = Trials(self._run)
        flow: Any = self._run.flow
        if memory["y"].shape != flow.array(system.state).shape:
            raise InputError("checkpoint: y has another shape than in a run of this system")
        self.inner.recall(memory)
        self.forget()
        for watch, known in zip(self._watches, events["watches"], strict=True):
            watch.recall(known)
        self._log.recall(events["waiting"])
        if (act := events["act"]) is not None:
            event, span = self._acting[act["event"]], events["span"]
            self._act = Act(event, act["time"], tuple(act["bodies"]), act["distance"])
            self._span = replace(self._span_of(*(span[key] for key in ("y0", "t0", "y1", "t1"))), step=span["step"])
        self._acts, self._last_act, self.stopped = events["acts"], events["last_act"], events["stopped"]
        self.absorbed = dict(events["absorbed"])
        self._spent, self._warned = Counts(**events["spent"]), events["warned"]

    @property
    def _acting(self) -> list[Any]:
        watches: list[Any] = [*self._contacts, *self._escapes]
        return [watch.event for watch in watches]

    # --- the search ---

    def _step(self) -> int:
        inner = self.inner
        before, begin, done = inner.y.copy(), inner.time, inner.steps_done
        status = self._one_step()
        if status == OK and inner.steps_done > done:
            self._search(before, begin, inner.y, inner.time)
        return status

    def _one_step(self) -> int:
        inner: Any = self.inner
        done, inner.end = inner.steps_done, self.end
        status = inner.advance(1, np.inf)
        if status == OK and inner.steps_done == done and self.end < np.inf:
            inner.clip = True
            status = inner.advance(1, np.inf)
            inner.clip = False
        return int(status)

    def _search(self, y0: Floats, t0: float, y1: Floats, t1: float) -> None:
        """Log what happened in a span, up to the first event that changes the bodies, and keep that one."""
        step, whole = self.inner.steps_done, None
        for watch in self._contacts:
            if watch.scan(y0, t0, y1, t1, step):
                whole = whole or self._span_of(y0, t0, y1, t1)
        if whole is not None:
            acts = [act for watch in self._contacts if (act := watch.first(whole)) is not None]
            if acts:
                self._act, self._span = min(acts, key=lambda act: act.time), whole
                if self._act.event.action != "stop" or self._run.method.chooses_steps:
                    y1, t1 = np.array(whole.inside(self._act.time)), self._act.time
        hits = [watch for watch in self._lookers if watch.scan(y0, t0, y1, t1, step)]
        gone = [each for each in self._escapes if each.scan(y0, t0, y1, t1, step)] if self._act is None else []
        if hits or gone:
            span = replace(whole, y1=y1, t1=t1) if whole else self._span_of(y0, t0, y1, t1)
            found = [row for watch in hits for row in watch.look(span)]
            for escapes in gone:
                found += self._escaped(escapes, span)
            self._log.wait(found)

    def _span_of(self, y0: Floats, t0: float, y1: Floats, t1: float) -> Span:
        step = self.steps_done
        if self._run.method.chooses_steps:
            return Span(y0, t0, y1, t1, step, self.inner.at)
        return Span(y0, t0, y1, t1, step, lambda time: self._trials.at(y0, t0, time, step))

    def _escaped(self, watch: Escapes, span: Span) -> list[tuple[float, Row]]:
        """Log those that only are to be logged, and keep the first of the others."""
        found = []
        for act in watch.gone(span):
            if watch.event.action == "log":
                row = entry(self._system, Escape.kind, span.t1, span.step, act.bodies, act.distance, "logged")
                found.append((span.t1, row))
                watch.know(act.bodies[0])
            elif self._act is None:
                self._act, self._span = act, span
        return found

    # --- what events do ---

    @property
    def _system(self) -> System:
        return self._run.system

    def _apply(self, act: Act) -> int:
        """Let an event act, at its time; one of fixed steps then makes up the rest of the step."""
        span, self._act = self._span, None
        assert span is not None
        event, step, adaptive = act.event, span.step, self._run.method.chooses_steps
        self._log.tell(act.time)
        again = act.time <= self._last_act + 8 * np.spacing(abs(act.time))
        self._acts, self._last_act = self._acts + 1 if again else 0, act.time
        if self._acts > MOST_ACTS:
            pair = " and ".join(self._system.body(i) for i in act.bodies)
            raise RunError(
                f"step {step} (t = {act.time:.9g}): more than {MOST_ACTS} collisions at one time, the last of {pair}: "
                f"bodies come to rest on each other, which bounces cannot say"
            )
        if event.action == "stop":
            self._stop(act, span)
            return OK
        y = np.array(span.inside(act.time))
        try:
            self._change(act, y, step)
        except InputError as error:  # a force or the method does not take what is left
            names = " and ".join(self._system.body(i) for i in act.bodies)
            raise RunError(f"step {step} (t = {act.time:.9g}): after the {event.kind} of {names}: {error}") from error
        if adaptive or act.time >= span.t1:
            return OK
        y, begin = self.inner.y, act.time
        status, reached, cost = self._trials.step(y, begin, span.t1)
        self._spent = _sum(self._spent, cost)
        if status != OK or not np.isfinite(reached).all():
            return status
        self.inner.reset(reached.copy(), span.t1, step)
        self._run.bodies_changed()
        self._search(y, begin, reached, span.t1)
        return OK

    def _stop(self, act: Act, span: Span) -> None:
        names = " and ".join(self._system.body(i) for i in act.bodies)
        what = "touch" if isinstance(act.event, Collision) else "escapes"
        row = entry(self._system, act.event.kind, act.time, span.step, act.bodies, act.distance, "stopped")
        self._log.add(row)
        if isinstance(act.event, Collision):
            for contacts in self._contacts:
                contacts.touch(act.bodies)
        else:
            for escapes in self._escapes:
                escapes.know(act.bodies[0])
        if self._run.method.chooses_steps and act.time < span.t1:
            self.inner.reset(np.array(span.inside(act.time)), act.time, span.step)
            self._crossings.begin(self._run.system)
        self.stopped = f"{names} {what} at t = {act.time:.9g}"

    def _change(self, act: Act, y: Floats, step: int) -> None:
        """Bounce, merge or remove, and begin anew from there."""
        system, event, bodies = self._system, act.event, act.bodies
        row = entry(system, event.kind, act.time, step, bodies, act.distance, "")
        before = self._run.sample_at(y, act.time)
        if event.action == "bounce":
            assert isinstance(event, Collision)
            left, y = system, bounced(system.state.masses, y, bodies[0], bodies[1], event.restitution)
            row["done"] = "bounced"
        elif event.action == "merge":
            i, j = bodies
            survivor, gone = (i, j) if system.state.masses[i] >= system.state.masses[j] else (j, i)
            row["done"] = f"{system.body(gone)} merged into {system.body(survivor)}"
            left, y = merged(system, y, survivor, gone)
            for contacts in self._contacts:
                contacts.radii = joined(contacts.radii, survivor, gone)
            self._leave(system, gone, int(system.state.ids[survivor]))
        else:
            (gone,) = bodies
            row["done"] = "removed"
            left, y = without(system, y, gone)
            self._leave(system, gone, NEVER_BACK)
        if left is not system:
            self._spent, self._warned = self.counts, self.warnings
            self.inner = self._run.stepper_for(left)
            self._trials = Trials(self._run)
            for watch in self._watches:
                watch.follow(left)
        self._crossings.begin(left)  # speeds have jumped, which is no crossing
        self.inner.reset(y, act.time, step)
        after = self._run.sample_at(y, act.time)
        row["energy"] = before.energies.total - after.energies.total
        if event.action != "bounce" or event.restitution != 1:  # type: ignore[union-attr]
            self._run.record.take(before, after)
        self._log.add(row)
        self._run.bodies_changed()

    def _leave(self, system: System, gone: int, survivor: int) -> None:
        self.absorbed[int(system.state.ids[gone])] = survivor
        for contacts in self._contacts:
            contacts.radii = np.delete(contacts.radii, gone)

    def going_on(self) -> list[Row]:
        """Passages that have begun and not ended at the present."""
        rows = self._log.waiting_rows + [row for watch in self._approaches for row in watch.going_on()]
        return [{**row, "done": "going on"} for row in rows if row["time"] <= self._run.time]


def _sum(a: Counts, b: Counts) -> Counts:
    return Counts(a.evaluations + b.evaluations, a.rejected + b.rejected, a.jacobians + b.jacobians)
