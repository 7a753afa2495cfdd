"""Check that events can be watched for in a System or Problem."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from kickdrift.errors import InputError
from kickdrift.model.capacity import check_room
from kickdrift.model.events import Between, CloseApproach, Collision, Crossing, Escape, Event, binding, index_of
from kickdrift.text import shown

if TYPE_CHECKING:
    from kickdrift.model.problem import Problem
    from kickdrift.model.system import System

PAIR_BYTES = 200  # memory of a watched pair of bodies


def checked_events(subject: System | Problem, events: Iterable[Event]) -> tuple[Event, ...]:
    """Return the events as a tuple. An InputError refuses those that a run of this subject cannot watch for."""
    from kickdrift.model.system import System

    try:
        found = tuple(events)
    except TypeError:
        raise InputError(f"events: expected a list of events, got {shown(events)}") from None
    for event in found:
        if not isinstance(event, CloseApproach | Collision | Escape | Crossing):
            raise InputError(f"events: expected CloseApproach, Collision, Escape or Crossing, got {shown(event)}")
        if not isinstance(subject, System):
            if not (isinstance(event, Crossing) and callable(event.function)):
                raise InputError(f"{event.kind}: needs particles; for a Problem use a Crossing of a function of y")
            continue
        if subject.box.periodic:
            raise InputError(f"{event.kind}: events need open space, and the box is periodic")
        if isinstance(event, CloseApproach | Collision):
            check_room(event.kind, len(subject) * (len(subject) - 1) // 2, "pairs of bodies", PAIR_BYTES)
        if isinstance(event, CloseApproach):
            bodies = [index_of(subject, body, f"{event.kind}: bodies") for body in event.bodies or ()]
            if len(set(bodies)) < len(bodies):
                raise InputError(f"{event.kind}: bodies: a body is named twice in {shown(event.bodies)}")
        elif isinstance(event, Collision):
            event.radii_in(subject)
        elif isinstance(event, Escape):
            if event.about is not None:
                index_of(subject, event.about, f"{event.kind}: about")
            if binding(subject) is None:
                raise InputError(f"{event.kind}: only gravity binds bodies, and {subject.name!r} has none")
        elif isinstance(event.function, Between):
            pair = [index_of(subject, body, event.name) for body in (event.function.body, event.function.about)]
            if pair[0] == pair[1]:
                raise InputError(f"{event.name}: expected two bodies, got {shown(event.function.body)} twice")
        if getattr(event, "action", "") in ("merge", "remove") and subject.acting("joins"):
            raise InputError(f"{event.kind}: action {event.action!r} cannot act on bodies joined by springs")  # type: ignore[union-attr]
    return found
