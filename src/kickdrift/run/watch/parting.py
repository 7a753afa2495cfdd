"""Steps in parts that end before bodies touch, or shortly after, so that nothing is read from beyond a contact."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.seam.kernel import OK
from kickdrift.model.memory import Memory
from kickdrift.model.state import Floats
from kickdrift.run.watch.contacts import ALL_PAIRS, Contacts
from kickdrift.run.watch.span import Act, Part, Span, Trials, Watched, evaluated

NONE = np.zeros(0, np.bool_)
FEW = 1e-9  # of a step: a shorter rest is no part of its own


class Parted(NamedTuple):
    """A step in parts, up to its end or to the first contact."""

    parts: list[Part]
    act: Act | None
    span: Span | None  # from the act to the step's end


class Parting:
    """Steps in parts, where pairs of bodies that attract each other may touch.

    The step itself is taken first, and stands if nothing touches. Else the step is taken again in parts: those of few
    bodies by gauss-radau15, those of many by the run's own method."""

    def __init__(self, run: Watched, contacts: Sequence[Contacts]) -> None:
        self._contacts = contacts
        self.on = bool(contacts) and not run.method.adaptive
        for each in contacts if self.on else ():
            each.evaluated = evaluated(run.method)
        self._ends = all(each.event.action == "stop" for each in contacts)  # no step has to go on from a contact
        self.forget()

    def forget(self) -> None:
        """Forget which bodies come from a contact."""
        self._ids: list[int] = []
        self._until = -np.inf

    def note(self, ids: Sequence[int], time: float, length: float) -> None:
        """Note the ids of bodies that leave a contact at a time. ``length`` is that of a step."""
        if time >= self._until:
            self._ids = []
        self._ids = sorted({*self._ids, *ids})
        self._until = time + 2.0 * length

    def watches(self, time: float) -> bool:
        """Whether bodies come from a contact a short time ago, so that every step must be searched."""
        return time < self._until

    def _fresh(self, contacts: Contacts, time: float) -> np.ndarray:
        """Tell for each body (n,) whether it comes from a contact a short time ago; (0,) if there was none."""
        return np.isin(contacts.ids, self._ids) if time < self._until else NONE

    def clear(self, y0: Floats, t0: float, y1: Floats, t1: float) -> bool:
        """Tell whether a fast test clears a step of contacts."""
        if t0 < self._until:
            return False
        return all(each.all_far(y0, y1, t1 - t0) for each in self._contacts)

    def step(self, trials: Trials, whole: list[Part], step: int, good: bool) -> Parted | None:
        """Search a step, taken as these parts, for contacts. Return the step in other parts; None if the step stands.

        ``good`` is False if the step failed; its end is then not used."""
        begin, end = whole[0], whole[-1]
        span = Part(begin.y0, begin.t0, end.y1 if good else begin.y0, end.t1)
        near = [each for each in self._contacts if each.suspects(span, step, self._fresh(each, span.t0))]
        if not near:
            return None
        known = [each.marks for each in self._contacts]
        found = self._in_parts(trials, near, span, step, good)
        if found is None or found.act is not None:
            return found
        marks = [each.marks for each in self._contacts]
        self._mark(known)
        if good and (self._ends or not (self._touches(whole, step) or self._soon(near, found))):
            self._mark(known)
            return None
        self._mark(marks)
        return found

    def _touches(self, whole: list[Part], step: int) -> bool:
        """Tell whether bodies touch in the step as it was taken at first."""
        return any(each.scan(whole, step) > 0 for each in self._contacts)

    def _mark(self, marks: Sequence[Any]) -> None:
        for each, mark in zip(self._contacts, marks, strict=True):
            each.marks = mark

    def _in_parts(self, trials: Trials, near: list[Contacts], whole: Part, step: int, good: bool) -> Parted | None:
        """The step in parts, up to the first contact; None if a part fails."""
        parts: list[Part] = []
        y, t, end = whole.y0, whole.t0, whole.t1
        motion = (trials.exact if y.shape[-1] <= ALL_PAIRS else trials.own)(y, t)
        while t < end:
            least = min(each.room(y, t, end - t, self._fresh(each, t), motion) for each in near)
            until = t + least if least < (1.0 - FEW) * (end - t) else end
            status, reached, until = motion.step(until)
            if status != OK or not (until > t and np.isfinite(reached).all()):
                return None
            part = Part(y, t, reached, until)
            span = Span(*part, step, motion.at, costly=True)
            acts = [act for each in self._contacts if each.scan([part], step) and (act := each.first(span))]
            if acts:
                act = min(acts, key=lambda act: act.time)
                there = np.array(span.inside(act.time))
                rest = Span(
                    there, act.time, reached if until == end else whole.y1, end, step, span.inside, failed=not good
                )
                return Parted([*parts, Part(y, t, there, act.time)], act, rest)
            parts.append(part)
            y, t = reached, until
        return Parted(parts, None, None)

    def _soon(self, near: list[Contacts], found: Parted) -> bool:
        """Tell whether bodies touch so soon after the end that a whole step would spoil their velocities."""
        y, t, length = found.parts[-1].y1, found.parts[-1].t1, found.parts[-1].t1 - found.parts[0].t0
        return any(each.soon(y, t, length, self._fresh(each, t)) for each in near)

    # --- checkpoints ---

    def memory(self) -> Memory:
        """Ids of bodies that come from a contact, and until when they count as such."""
        return {"ids": self._ids, "until": self._until}

    def recall(self, memory: Memory) -> None:
        """Restore this state."""
        ids, until = memory["ids"], memory["until"]
        if not (isinstance(until, float) and all(isinstance(each, int) for each in ids)):
            raise InputError("checkpoint: the bodies that come from a contact are invalid")
        self._ids, self._until = list(ids), until
