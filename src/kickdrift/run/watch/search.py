"""Search of a run's steps for events, up to the first event that changes the bodies."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np

from kickdrift.errors import InputError
from kickdrift.integrators.stepping.stepper import Stepper
from kickdrift.model.event_log import Row, entry, is_row
from kickdrift.model.events.events import CloseApproach, Collision, Crossing, Escape, Event
from kickdrift.model.memory import Memory
from kickdrift.model.patch import HERE
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.run.watch.collisions import Change
from kickdrift.run.watch.crossings import Crossings
from kickdrift.run.watch.distances import Approaches, Escapes, Passing
from kickdrift.run.watch.parting import Parting
from kickdrift.run.watch.patch_contacts import contacts_of
from kickdrift.run.watch.quiet import QuietSteps, limits_of
from kickdrift.run.watch.span import Act, Part, Span, Trials, Watched, parts, separation

ROUNDING = 1e-12  # of a distance between bodies that touch


class Log:
    """Entries for the record of a run.

    The present of an adaptive run may lie inside a step, but the search covers whole steps. A later event waits until
    the present reaches it.
    """

    def __init__(self, run: Watched) -> None:
        self._run = run
        self._waiting: list[tuple[float, Row]] = []

    def add(self, row: Row) -> None:
        """Write an entry into the record."""
        self._run.record.events.append(row)

    def wait(self, found: list[tuple[float, Row]]) -> None:
        """Keep entries until the present reaches their times."""
        self._waiting += sorted(found, key=lambda pair: pair[0])

    def tell(self, until: float) -> None:
        """Write the entries up to this time."""
        late = []
        for due, row in self._waiting:
            if due <= until:
                self.add(row)
            else:
                late.append((due, row))
        self._waiting = late

    def forget(self) -> None:
        self._waiting = []

    @property
    def waiting_rows(self) -> list[Row]:
        return [row for _, row in self._waiting]

    def memory(self) -> list[list[Any]]:
        return [[due, row] for due, row in self._waiting]

    def recall(self, memory: Any) -> None:
        """Restore waiting entries. Raises InputError for anything else."""
        self._waiting = [(due, row) for due, row in memory]
        if not all(isinstance(due, int | float) and is_row(row) for due, row in self._waiting):
            raise InputError("checkpoint: its waiting events are invalid")


class Search:
    """Search for the events of a run, with one object for each event.

    Attributes
    ----------
    log : entries for the run's record
    trials : shorter steps, for positions inside a step
    parts : those of the last step, if it was taken in parts and times inside it count
    act, span : the first event that changes the bodies, and its step; None if there is none
    """

    def __init__(self, run: Watched, events: Sequence[Event]) -> None:
        self._run, subject = run, run.system
        self.log, self.trials = Log(run), Trials(run)
        self.act: Act | None = None
        self.parts: list[Part] = []
        self.span: Span | None = None
        self._approaches = [Approaches(e, subject) for e in events if isinstance(e, CloseApproach)]
        self._quiet: tuple[Stepper, QuietSteps | None] | None = None
        self._contacts = [contacts_of(e, subject) for e in events if isinstance(e, Collision)]
        self._parting = Parting(run, self._contacts)
        self._passing = Passing(run, self._approaches)
        self._escapes = [Escapes(e, subject) for e in events if isinstance(e, Escape)]
        self._crossings = Crossings([e for e in events if isinstance(e, Crossing)], subject)
        self._bodily: list[Any] = [*self._approaches, *self._contacts, *self._escapes]
        self._watches: list[Any] = [*self._bodily, self._crossings]
        self._lookers: list[Any] = [*self._approaches, *([self._crossings] if len(self._crossings) else [])]

    def begin(self) -> None:
        """Forget all that was found so far."""
        self.log.forget()
        self.act = self.span = self._quiet = None
        self.parts = []
        self._parting.forget()
        self._passing.forget()
        for watch in self._watches:
            watch.begin(self._run.system)

    def begin_crossings(self) -> None:
        """Read the signs of crossings again, because a jump of the state is no crossing."""
        self._crossings.begin(self._run.system)

    def prepare(self, inner: Stepper) -> None:
        y, t = inner.y, inner.time
        for watch in self._bodily:
            known = watch.memory()
            watch.scan([Part(y, t, y, t)], inner.steps_done)
            watch.recall(known)
        if self._parting.on:
            self._parting.clear(y, t, y, t)
        self._passing.parts(self.trials, [Part(y, t, y, t)])

    # --- bodies that change ---

    def renew_trials(self) -> None:
        """Try steps with the run's present bodies."""
        self.trials = Trials(self._run)

    def resize(self, change: Change) -> None:
        """Give the bodies after a change their radii."""
        for contacts in self._contacts:
            contacts.radii = change.radii(contacts.radii)

    def radii(self, event: Collision) -> Floats:
        """Radii (n,) of the bodies for an event."""
        return next(contacts.radii for contacts in self._contacts if contacts.event is event)

    def part(self, rows: Sequence[int]) -> None:
        """Let the bodies in these rows move apart: those that touch do not collide again before."""
        y = self._run.system.state.phase
        for contacts in self._contacts:
            for i, j in combinations(sorted(rows), 2):
                if separation(y, i, j) <= (contacts.radii[i] + contacts.radii[j]) * (1 + ROUNDING):
                    contacts.touch((i, j))

    def follow(self, system: System) -> None:
        """Go on with the bodies of a system."""
        self.renew_trials()
        self._passing.forget()
        self._quiet = None
        for watch in self._watches:
            watch.follow(system)

    def leave(self, ids: Sequence[int], time: float, length: float) -> None:
        """Note the bodies that leave a contact; ``length`` is that of a step."""
        self._parting.note(ids, time, length)

    def know(self, act: Act) -> None:
        """Report this contact, or this escape, only once."""
        if isinstance(act.event, Collision):
            for contacts in self._contacts:
                contacts.touch(act.bodies, act.image)
        elif isinstance(act.event, Escape):
            for escapes in self._escapes:
                escapes.know(act.bodies[0])

    # --- steps ---

    def quiet_steps(self, inner: Stepper) -> QuietSteps | None:
        """Steps until one may have an event; None if only the search can tell, as while a passage goes on."""
        if len(self._crossings) or not hasattr(type(inner), "noted"):
            return None
        if self._parting.watches(inner.time):
            return None
        if any(each.watches_all for each in self._contacts) or any(each.under_way for each in self._approaches):
            return None
        if self._quiet is None or self._quiet[0] is not inner:
            limits = limits_of(self._contacts, self._approaches, self._escapes)
            self._quiet = inner, limits and QuietSteps(inner, limits)
        return self._quiet[1]

    @property
    def mends(self) -> bool:
        """Whether a step that failed may have a contact as its cause."""
        return self._parting.on

    def scan(self, inner: Stepper, y0: Floats, t0: float, y1: Floats, t1: float, good: bool = True) -> bool:
        """Log the events of a span up to the first that changes the bodies, and store that event in ``act``.

        Return whether all is well. ``good`` is False if the step failed: a contact inside the step may be the cause."""
        if not (good or self._parting.on):
            return False
        step, whole = inner.steps_done, None
        found_in, self.parts = parts(y0, t0, y1, t1, inner) if good else [Part(y0, t0, y1, t1)], []
        self._crossings.stepper = inner
        if not self._bodily:
            if self._crossings.scan(found_in, step):
                self.log.wait(self._crossings.look(self._span_of(inner, y0, t0, y1, t1)))
            return True
        parted, contacts = None, self._contacts
        if good and self._parting.on and len(found_in) == 1 and self._parting.clear(y0, t0, y1, t1):
            if not (self._lookers or self._escapes):
                return True
            contacts = []
        elif self._parting.on:
            good = good and bool(np.isfinite(y1).all())
            parted = self._parting.step(self.trials, found_in, step, good)
            contacts = [] if parted is not None else contacts
            if parted is None and not good:
                return False
        if parted is not None:
            found_in, self.act, self.span = parted.parts, parted.act, parted.span
            self.parts = found_in if self._run.method.chooses_steps else []
            _, _, y1, t1 = found_in[-1]
            if self.act is None:
                inner.reset(y1.copy(), t1, step)
        for watch in contacts:
            if watch.scan(found_in, step):
                whole = whole or self._span_of(inner, y0, t0, y1, t1)
        if whole is not None:
            acts = [act for watch in contacts if (act := watch.first(whole)) is not None]
            if acts:
                self.act, self.span = min(acts, key=lambda act: act.time), whole
                if self.act.event.action != "stop" or self._run.method.chooses_steps:
                    y1, t1 = np.array(whole.inside(self.act.time)), self.act.time
                    found_in = [Part(y0, t0, y1, t1)]
        passed = self._passing.parts(self.trials, found_in)
        hits = [watch for watch in self._approaches if watch.scan(passed, step)]
        hits += [watch for watch in self._lookers[len(self._approaches) :] if watch.scan(found_in, step)]
        met = [act for watch in self._approaches if (act := watch.begun(t1)) is not None]
        gone = [each for each in self._escapes if each.scan(found_in, step)] if self.act is None else []
        if hits or gone:
            span = replace(whole, y1=y1, t1=t1) if whole else self._span_of(inner, y0, t0, y1, t1)
            found = [row for watch in hits for row in watch.look(span)]
            for escapes in gone:
                found += self._escaped(escapes, span)
            self.log.wait(found)
        if met and self.act is None:
            self.act, self.span = met[0], self._span_of(inner, y0, t0, y1, t1)
        return True

    def at(self, time: float) -> Floats | None:
        """y at a time inside the last step, if the step was taken in parts."""
        for y0, t0, y1, t1 in self.parts:
            if t0 <= time <= t1:
                return y0 if time == t0 else y1 if time == t1 else self.trials.between(y0, t0, time)
        return None

    def _span_of(self, inner: Stepper, y0: Floats, t0: float, y1: Floats, t1: float) -> Span:
        step = inner.steps_done
        if self._run.method.chooses_steps and not self.parts:
            return Span(y0, t0, y1, t1, step, inner.at)
        return Span(y0, t0, y1, t1, step, lambda time: self.trials.at(y0, t0, time, step))

    def _escaped(self, watch: Escapes, span: Span) -> list[tuple[float, Row]]:
        """Entries for escapes that are only logged. The first of the others becomes ``act``."""
        found = []
        for act in watch.gone(span):
            if watch.event.action == "log":
                row = entry(self._run.system, Escape.kind, span.t1, span.step, act.bodies, act.distance, "logged")
                found.append((span.t1, row))
                watch.know(act.bodies[0])
            elif self.act is None:
                self.act, self.span = act, span
        return found

    def going_on(self) -> list[Row]:
        """Entries for passages that have not ended."""
        rows = self.log.waiting_rows + [row for watch in self._approaches for row in watch.going_on()]
        return [{**row, "done": "going on"} for row in rows if row["time"] <= self._run.time]

    # --- checkpoints ---

    @property
    def _acting(self) -> list[Any]:
        watches: list[Any] = [*self._contacts, *self._escapes, *self._approaches]
        return [watch.event for watch in watches]

    def memory(self) -> Memory:
        """State of the search: passages and contacts, entries that wait for their time, and the act with its span."""
        act, span = self.act, self.span
        return {
            "watches": [watch.memory() for watch in self._watches],
            "waiting": self.log.memory(),
            "parting": self._parting.memory(),
            "passing": self._passing.memory(),
            "parts": [part._asdict() for part in self.parts],
            "act": act and {**act._asdict(), "event": self._acting.index(act.event)},
            "span": act and span and {key: getattr(span, key) for key in ("y0", "t0", "y1", "t1", "step")},
        }

    def recall(self, memory: Memory, inner: Stepper) -> None:
        """Restore this state."""
        self._quiet = None
        for watch, known in zip(self._watches, memory["watches"], strict=True):
            watch.recall(known)
        self.log.recall(memory["waiting"])
        if "parting" in memory:  # since version 0.3
            self._parting.recall(memory["parting"])
            self._passing.recall(memory["passing"])
            self.parts = [Part(**part) for part in memory["parts"]]
            states = [state for part in self.parts for state in (part.y0, part.y1)]
            if any(np.shape(state) != inner.y.shape for state in [*states, *self._passing.states]):
                raise InputError("checkpoint: the states inside a step have another shape than the bodies")
        if (act := memory["act"]) is not None:
            event, span = self._acting[act["event"]], memory["span"]
            self.act = Act(event, act["time"], tuple(act["bodies"]), act["distance"], tuple(act.get("image", HERE)))
            ends = (span[key] for key in ("y0", "t0", "y1", "t1"))
            self.span = replace(self._span_of(inner, *ends), step=span["step"])
