"""What to watch for while a run goes on: close approaches, collisions, escapes and zeros of any function. Plain data.

``Simulation(system, events=[…])`` or a system file's ``[[event]]`` takes them; ``watching`` in this room finds them.
Bodies are named as in the system, or by their number, counted from 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import NoneType
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from kickdrift.errors import InputError
from kickdrift.model.capacity import check_room
from kickdrift.model.checks import is_number, number, positive
from kickdrift.text import shown, suggestion

if TYPE_CHECKING:
    from kickdrift.model.problem import Problem
    from kickdrift.model.state import Floats
    from kickdrift.model.system import System

Body = str | int
Radii = float | Sequence[float] | Mapping[str, float]
LINES = 20  # of events that are shown
PAIR_BYTES = 200  # of a pair of bodies that is watched
NAME_BYTES = 64  # of an event's name in a run's file


@dataclass(frozen=True)
class CloseApproach:
    """Pairs of bodies that come nearer than a distance: one entry for each passage, with its closest point.

    A passage lasts from the step in which the separation falls below the distance to the one in which it exceeds it;
    it is logged then. One that goes on when the run ends stands in the report, as what it was so far.

    Attributes
    ----------
    distance : float
        A length; with ``hill`` a number of mutual Hill radii ((m_i + m_j) / (3 M))^(1/3) (r_i + r_j) / 2 (Chambers,
        Wetherill & Boss 1996, doi:10.1006/icar.1996.0019, eq. 1), M the heaviest body, which is then in no pair, and r
        the present distances from it in place of semi-major axes.
    bodies : names or numbers, optional
        One: its pairs with every other; several: the pairs among them. Default all pairs.
    """

    distance: float
    bodies: Sequence[Body] | None = None
    hill: bool = False

    kind: ClassVar[str] = "close-approach"

    def __post_init__(self) -> None:
        _positive(self.kind, "distance", self.distance)
        if self.bodies is not None:
            object.__setattr__(self, "bodies", _several(self.kind, self.bodies))


@dataclass(frozen=True)
class Collision:
    """Bodies that touch: their separation falls to the sum of their radii.

    The moment of contact is found on the cubic through both ends of a step, and then on the method's own solution. The
    event is applied at that moment: an adaptive method begins anew from there, one of fixed steps makes up the rest of
    the step with a shorter one, so that it stays on its grid. Pairs of massless bodies pass through each other.

    Attributes
    ----------
    radii : one for all, one for each, or {name: radius}, those not named being points; optional
        Lengths, zero or more; default the system's radii.
    action : str
        "merge": the lighter body is absorbed: mass, momentum and centre of mass are conserved, volumes add up, and the
        lighter one leaves the run. "bounce": hard spheres; the velocities along the line of centres are exchanged.
        "stop": the run ends: an adaptive one at contact, one of fixed steps at the end of the step.
    restitution : float
        Of a bounce, from 0 to 1: the ratio of normal speeds after and before; 1 conserves energy.
    """

    radii: Radii | None = None
    action: str = "merge"
    restitution: float = 1.0

    kind: ClassVar[str] = "collision"
    actions: ClassVar[tuple[str, ...]] = ("merge", "bounce", "stop")

    def __post_init__(self) -> None:
        _one_of(self.kind, "action", self.action, self.actions)
        if not (is_number(self.restitution) and 0 <= self.restitution <= 1):
            raise InputError(f"{self.kind}: restitution must be a number from 0 to 1, got {shown(self.restitution)}")
        if self.restitution != 1 and self.action != "bounce":
            raise InputError(f"{self.kind}: restitution needs action 'bounce', not {self.action!r}")
        values = self.radii.items() if isinstance(self.radii, Mapping) else enumerate(_listed(self.radii))
        for key, radius in values:
            if not (math.isfinite(number(radius)) and radius >= 0):
                which = "" if is_number(self.radii) else f"[{key}]"
                raise InputError(f"{self.kind}: radii{which} must be a length, zero or more, got {shown(radius)}")

    def radii_in(self, system: System) -> Floats:
        """(n,) the radii of a system's bodies."""
        n, given = len(system), self.radii
        if given is None:
            if system.radii is None:
                raise InputError(f"{self.kind}: radii: required, since the bodies of {system.name!r} have none")
            return np.array(system.radii)
        if isinstance(given, Mapping):
            radii = np.zeros(n)
            for name, radius in given.items():
                radii[index_of(system, name, f"{self.kind}: radii")] = radius
            return radii
        if is_number(given):
            return np.full(n, float(given))  # type: ignore[arg-type]
        if len(given) != n:  # type: ignore[arg-type]
            raise InputError(f"{self.kind}: radii: expected one number or {n}, got {len(given)}")  # type: ignore[arg-type]
        return np.array(given, dtype=float)


@dataclass(frozen=True)
class Escape:
    """A body further than a distance from the centre of mass of the others, or from a body, and unbound: its energy
    relative to the others together is positive. Seen at the ends of steps, once for each body. A body heavier than all
    others together never escapes: they do.

    Attributes
    ----------
    distance : float
        A length.
    about : name or number, optional
        What the distance is measured from; default the centre of mass of all others.
    action : str
        "log", "remove" (the body leaves the run) or "stop".
    """

    distance: float
    about: Body | None = None
    action: str = "log"

    kind: ClassVar[str] = "escape"
    actions: ClassVar[tuple[str, ...]] = ("log", "remove", "stop")

    def __post_init__(self) -> None:
        _positive(self.kind, "distance", self.distance)
        _one_of(self.kind, "action", self.action, self.actions)


@dataclass(frozen=True)
class Between:
    """A scalar of one body relative to another, as the function of a `Crossing`: "approach" is r . v, which changes
    sign at pericentre and apocentre, "height" is z, which does at the nodes on the plane z = 0."""

    quantity: str
    body: Body
    about: Body

    def __post_init__(self) -> None:
        _one_of("crossing", "quantity", self.quantity, ("approach", "height"))


@dataclass(frozen=True)
class Crossing:
    """Zeros of g(t, x, v), x and v (n, 3), of the present particles in their order; for a Problem of g(t, y).

    g is evaluated at the ends of steps; where its sign has changed, the zero is found by Brent's method (1973) on the
    solution inside the step. Two zeros in one step go unseen, and so does one at the very start.

    Attributes
    ----------
    function : callable, or what `pericentre` and the others make
    name : str
        What the log calls it.
    direction : int
        1: g rises through zero; -1: it falls; 0: both.
    tolerance : float
        Of the time, as a part of the step.
    """

    function: Callable[..., Any] | Between
    name: str
    direction: int = 0
    tolerance: float = 1e-13

    def __post_init__(self) -> None:
        if not (isinstance(self.name, str) and 0 < len(self.name.encode()) <= NAME_BYTES):
            raise InputError(f"crossing: name must be text of 1 to {NAME_BYTES} bytes, got {shown(self.name)}")
        if not (callable(self.function) or isinstance(self.function, Between)):
            raise InputError(f"crossing {self.name!r}: function must be callable, got {shown(self.function)}")
        if self.direction not in (-1, 0, 1):
            raise InputError(f"crossing {self.name!r}: direction must be -1, 0 or 1, got {shown(self.direction)}")
        if not (is_number(self.tolerance) and 0 < self.tolerance < 1):
            raise InputError(f"crossing {self.name!r}: tolerance must lie between 0 and 1, got {shown(self.tolerance)}")

    @property
    def kind(self) -> str:
        return self.name

    @classmethod
    def pericentre(cls, body: Body, about: Body) -> Crossing:
        """The distance between two bodies passes a minimum."""
        return cls(Between("approach", body, about), "pericentre", 1)

    @classmethod
    def apocentre(cls, body: Body, about: Body) -> Crossing:
        """The distance between two bodies passes a maximum."""
        return cls(Between("approach", body, about), "apocentre", -1)

    @classmethod
    def ascending_node(cls, body: Body, about: Body) -> Crossing:
        """A body rises through the plane of constant z that goes through another."""
        return cls(Between("height", body, about), "ascending-node", 1)

    @classmethod
    def descending_node(cls, body: Body, about: Body) -> Crossing:
        """A body sinks through the plane of constant z that goes through another."""
        return cls(Between("height", body, about), "descending-node", -1)


Event = CloseApproach | Collision | Escape | Crossing


def index_of(system: System, body: Body, key: str) -> int:
    """The row of a body, by name or by id; an InputError that begins with ``key`` where there is none."""
    if isinstance(body, str) and body in system.names:
        return system.names.index(body)
    if isinstance(body, int | np.integer) and not isinstance(body, bool):
        found = np.flatnonzero(system.state.ids == body)
        if found.size:
            return int(found[0])
    if not system.names:
        raise InputError(f"{key}: there is no particle {shown(body)}; expected a number from 0 to {len(system) - 1}")
    known = ", ".join(system.names[:12]) + (", …" if len(system) > 12 else "")
    hint = suggestion(body, system.names) if isinstance(body, str) else ""
    raise InputError(f"{key}: there is no body {shown(body)}{hint} (known: {known})")


def binding(system: System) -> Any:
    """The force that binds bodies, with its G and softening: gravity of whatever kind; None where there is none."""
    return next((force for force in system.forces if hasattr(force, "G") and hasattr(force, "softening")), None)


def checked_events(subject: System | Problem, events: Iterable[Event]) -> tuple[Event, ...]:
    """The events, where they can be watched for in that subject; else an InputError."""
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


def event_lines(events: Sequence[dict[str, Any]]) -> list[tuple[str, str]]:
    """Events for a reader: kind and what was seen of each of the first ones, then how many more there are."""
    rows = []
    for event in events[:LINES]:
        about = [f"t = {event['time']:.9g}"]
        about += [" – ".join(event["bodies"])] if event["bodies"] else []
        about += [f"distance {event['distance']:.6g}"] if event["distance"] is not None else []
        about += [event["done"]] if event["done"] not in ("logged", "passed") else []
        rows.append((event["kind"], ", ".join(about)))
    if len(events) > LINES:
        rows.append(("", f"and {len(events) - LINES:,} more events"))
    return rows


_NUMBER = (int, float)
_ROW: dict[str, Any] = {
    "kind": str, "time": _NUMBER, "step": int, "bodies": list, "ids": list, "distance": (*_NUMBER, NoneType),
    "energy": (*_NUMBER, NoneType), "done": str,
}  # fmt: skip


def is_row(row: Any) -> bool:
    """Whether a row that comes from a file is an entry of the log of events."""
    if not (isinstance(row, dict) and row.keys() == _ROW.keys()):
        return False
    return all(isinstance(row[key], kind) for key, kind in _ROW.items()) and all(
        isinstance(each, kind) for key, kind in (("bodies", str), ("ids", int)) for each in row[key]
    )


def _listed(radii: Any) -> Sequence[Any]:
    if radii is None:
        return []
    if is_number(radii):
        return [radii]
    if isinstance(radii, str):
        raise InputError(f"collision: radii must be lengths, got {shown(radii)}")
    try:
        return list(radii)
    except TypeError:
        raise InputError(f"collision: radii must be lengths, got {shown(radii)}") from None


def _several(kind: str, bodies: Any) -> tuple[Body, ...]:
    if isinstance(bodies, str | int):
        return (bodies,)
    try:
        found = tuple(bodies)
    except TypeError:
        found = ()
    if not found:
        raise InputError(f"{kind}: bodies: expected one or more, got {shown(bodies)}")
    return found


def _positive(kind: str, key: str, value: Any) -> None:
    positive(f"{kind}: {key}", value)


def _one_of(kind: str, key: str, value: Any, allowed: Sequence[str]) -> None:
    if not (isinstance(value, str) and value in allowed):
        hint = suggestion(value, allowed) if isinstance(value, str) else ""
        raise InputError(f"{kind}: {key} must be one of {', '.join(allowed)}, got {shown(value)}{hint}")
