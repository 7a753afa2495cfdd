"""Check that a run of a System or a Problem can watch for events."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from kickdrift.errors import InputError
from kickdrift.model.checks.arguments import misfit
from kickdrift.model.checks.capacity import check_particles, check_room
from kickdrift.model.events.events import Between, CloseApproach, Collision, Crossing, Escape, Event
from kickdrift.model.events.scaling import check_action
from kickdrift.model.patch import check_patch, patch_of
from kickdrift.model.subject import Bodies, Subject, index_of
from kickdrift.text import shown

PAIR_BYTES = 200  # memory of a watched pair of bodies


def binding(system: Subject) -> Any:
    """Force that can bind bodies, with its G and softening: any kind of gravity, or None."""
    return next((force for force in system.forces if hasattr(force, "G") and hasattr(force, "softening")), None)


def checked_events(system: Bodies, events: Iterable[Event]) -> tuple[Event, ...]:
    """Return the events as a tuple. Raises InputError for events that a run of this System cannot detect."""
    found = _listed(events)
    for event in found:
        _check_kind(event)
        if system.box.periodic:
            raise InputError(f"{event.kind}: events need open space, but the box is periodic")
        if isinstance(event, CloseApproach | Escape) and patch_of(system) is not None:
            raise InputError(f"{event.kind}: does not see the images of a shear-periodic patch; a collision does")
        if isinstance(event, CloseApproach):
            check_room(event.kind, len(system) * (len(system) - 1) // 2, "pairs of bodies", PAIR_BYTES)
            bodies = [index_of(system, body, f"{event.kind}: bodies") for body in event.bodies or ()]
            if len(set(bodies)) < len(bodies):
                raise InputError(f"{event.kind}: bodies: a body is named twice in {shown(event.bodies)}")
        elif isinstance(event, Collision):
            radii, patch = event.radii_in(system), patch_of(system)
            if patch is not None:
                check_patch(event.kind, patch, radii)
            if event.adds:
                check_particles(f"{event.kind}: new_bodies", event.new_bodies, "bodies")
            check_action(event, system, binding(system))
        elif isinstance(event, Escape):
            if event.about is not None:
                index_of(system, event.about, f"{event.kind}: about")
            if binding(system) is None:
                raise InputError(f"{event.kind}: only gravity binds bodies, but {system.name!r} has no gravity")
        elif isinstance(event.function, Between):
            pair = [index_of(system, body, event.name) for body in (event.function.body, event.function.about)]
            if pair[0] == pair[1]:
                raise InputError(f"{event.name}: expected two bodies, got {shown(event.function.body)} twice")
        elif isinstance(event, Crossing):
            _check_signature(event, ("t", "x", "v"))
        joins = [*system.acting("joins"), *(["bonds"] if system.topology is not None else [])]
        if getattr(event, "action", "") in ("merge", "remove", "fragment", "rule") and joins:
            names = ", ".join(dict.fromkeys(joins))
            raise InputError(f"{event.kind}: action {event.action!r} cannot act on bodies joined by {names}")  # type: ignore[union-attr]
    return found


def checked_crossings(events: Iterable[Event], arguments: int = 0) -> tuple[Event, ...]:
    """Return the events as a tuple. An InputError refuses all but crossings of a function of t, y and so many further
    ``arguments``."""
    found = _listed(events)
    for event in found:
        _check_kind(event)
        if not (isinstance(event, Crossing) and callable(event.function)):
            raise InputError(f"{event.kind}: needs particles; for a Problem use a Crossing with a function of y")
        _check_signature(event, ("t", "y", *(f"args[{k}]" for k in range(arguments))))
    return found


def _check_signature(event: Crossing, names: tuple[str, ...]) -> None:
    """Refuse a function that cannot be called with these arguments."""
    if takes := misfit(event.function, *names):
        raise InputError(f"crossing {event.name!r}: function must take ({', '.join(names)}); it takes {takes}")


def _listed(events: Iterable[Event]) -> tuple[Event, ...]:
    try:
        return tuple(events)
    except TypeError:
        raise InputError(f"events: expected a list of events, got {shown(events)}") from None


def _check_kind(event: Event) -> None:
    if not isinstance(event, CloseApproach | Collision | Escape | Crossing):
        raise InputError(f"events: expected CloseApproach, Collision, Escape or Crossing, got {shown(event)}")
