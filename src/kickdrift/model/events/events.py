"""Events that a run can watch for, as plain data: close approaches, collisions, escapes and zeros of any function.

``Simulation(system, events=[…])`` and a system file's ``[[event]]`` take events, and `kickdrift.run.watch` finds them.
A body is given by its name in the system or by its number, counted from 0.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from kickdrift.errors import InputError
from kickdrift.model.body_checks import check_name
from kickdrift.model.checks.arguments import checked_arguments, misfit
from kickdrift.model.checks.limits import check_particles, check_room
from kickdrift.model.checks.values import is_number, positive
from kickdrift.model.events.collision import Collision, check_action, check_box, one_of
from kickdrift.model.patch import check_patch, patch_of
from kickdrift.model.subject import Bodies, Subject, index_of
from kickdrift.text import shown

Body = str | int
NAME_BYTES = 64  # size of an event's name in a run's file


@checked_arguments
@dataclass(frozen=True)
class CloseApproach:
    """Pairs of bodies that come nearer than a distance: one entry for each passage, with its closest point.

    A passage begins with the step in which the separation falls below the distance. It ends, and is logged, with the
    step in which the separation exceeds the distance. The report shows a passage that the end of the run cuts short.

    Attributes
    ----------
    distance : float
        A length; with ``hill`` a number of mutual Hill radii ((m_i + m_j) / (3 M))^(1/3) (r_i + r_j) / 2 (Chambers,
        Wetherill & Boss 1996, doi:10.1006/icar.1996.0019, eq. 1). M is the heaviest body, which is then in no pair, and
        r are the present distances from M in place of semi-major axes.
    bodies : names or numbers, optional
        One body: its pairs with all others. Several: the pairs among them. Default: all pairs.
    action : str
        "log", or "stop": the run ends with the step in which a passage begins.
    """

    distance: float
    bodies: Sequence[Body] | None = None
    hill: bool = False
    action: str = "log"

    kind: ClassVar[str] = "close-approach"
    actions: ClassVar[tuple[str, ...]] = ("log", "stop")

    def __post_init__(self) -> None:
        _positive(self.kind, "distance", self.distance)
        one_of(self.kind, "action", self.action, self.actions)
        if self.bodies is not None:
            object.__setattr__(self, "bodies", _several(self.kind, self.bodies))


@checked_arguments
@dataclass(frozen=True)
class Escape:
    """A body beyond a distance from the centre of mass of the others, or from a body, and unbound.

    Unbound means a positive energy relative to all others together. The ends of steps are checked, and each body
    escapes once. A body heavier than all others together never escapes: the others do.

    Attributes
    ----------
    distance : float
        A length.
    about : name or number, optional
        Origin of the distance; default the centre of mass of all others.
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
        one_of(self.kind, "action", self.action, self.actions)


@dataclass(frozen=True)
class Between:
    """Scalar of one body relative to another, as the function of a `Crossing`.

    "approach" is r . v, which changes sign at pericentre and apocentre. "height" is z, which changes sign at the nodes.
    """

    quantity: str
    body: Body
    about: Body

    def __post_init__(self) -> None:
        one_of("crossing", "quantity", self.quantity, ("approach", "height"))


@checked_arguments
@dataclass(frozen=True)
class Crossing:
    """Zeros of g(t, x, v), with x and v (n, 3) of the present particles in their order; of a Problem's g(t, y, *args).

    g is evaluated at the ends of steps, and inside steps for a quick test of hidden zeros. Where the test cannot
    exclude them, polynomials in t isolate each zero of the solution inside the step. Brent's method (1973) finds its
    time. The page on `kickdrift.solve` says what can still be missed, such as two zeros nearer than 1e-7 of the step. A
    zero at the very start is not found. For the test, particles move along cubics that fit their positions and
    velocities at both ends of the step.

    Attributes
    ----------
    function : callable, or a `Between`, as in `pericentre`
    name : str
        Name in the log.
    direction : int
        1: g rises through zero; -1: it falls; 0: both.
    tolerance : float
        Error of the time, as a part of the step.
    seen : callable, optional
        ``seen(t, x, v)``, or ``seen(t, y)`` for a Problem, is called at each zero with the state there.
    """

    function: Callable[..., Any] | Between
    name: str
    direction: int = 0
    tolerance: float = 1e-13
    seen: Callable[..., Any] | None = None

    def __post_init__(self) -> None:
        if isinstance(self.name, str) and self.name:
            check_name("crossing: name", self.name)
        if not (isinstance(self.name, str) and 0 < len(self.name.encode()) <= NAME_BYTES):
            raise InputError(f"crossing: name must be text of 1 to {NAME_BYTES} bytes, got {shown(self.name)}")
        if not (callable(self.function) or isinstance(self.function, Between)):
            raise InputError(f"crossing {self.name!r}: function must be callable, got {shown(self.function)}")
        if not (self.seen is None or callable(self.seen)):
            raise InputError(f"crossing {self.name!r}: seen must be callable, got {shown(self.seen)}")
        if self.direction not in (-1, 0, 1):
            raise InputError(f"crossing {self.name!r}: direction must be -1, 0 or 1, got {shown(self.direction)}")
        if not (is_number(self.tolerance) and 0 < self.tolerance < 1):
            raise InputError(f"crossing {self.name!r}: tolerance must lie between 0 and 1, got {shown(self.tolerance)}")

    @property
    def kind(self) -> str:
        return self.name

    @classmethod
    def pericentre(cls, body: Body, about: Body) -> Crossing:
        """Minimum of the distance between two bodies."""
        return cls(Between("approach", body, about), "pericentre", 1)

    @classmethod
    def apocentre(cls, body: Body, about: Body) -> Crossing:
        """Maximum of the distance between two bodies."""
        return cls(Between("approach", body, about), "apocentre", -1)

    @classmethod
    def ascending_node(cls, body: Body, about: Body) -> Crossing:
        """Passage of a body, with rising z, through the plane of constant z of another."""
        return cls(Between("height", body, about), "ascending-node", 1)

    @classmethod
    def descending_node(cls, body: Body, about: Body) -> Crossing:
        """Passage of a body, with falling z, through the plane of constant z of another."""
        return cls(Between("height", body, about), "descending-node", -1)


Event = CloseApproach | Collision | Escape | Crossing


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


PAIR_BYTES = 200  # memory of a watched pair of bodies


def binding(system: Subject) -> Any:
    """Force that can bind bodies, with its G and softening: any kind of gravity, or None."""
    return next((force for force in system.forces if hasattr(force, "G") and hasattr(force, "softening")), None)


def checked_events(system: Bodies, events: Iterable[Event]) -> tuple[Event, ...]:
    """Return the events as a tuple. Raises InputError for events that a run of this System cannot detect."""
    found = _listed(events)
    for event in found:
        _check_kind(event)
        if system.box.periodic and not isinstance(event, Collision):
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
            check_box(event.kind, system, radii)
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
            beside = any(getattr(force, "unknowns", 0) for force in getattr(system, "forces", ()))
            _check_signature(event, ("t", "x", "v", "y") if beside else ("t", "x", "v"))
        joins = [*system.acting("joins"), *(["bonds"] if system.topology is not None else [])]
        changes = getattr(event, "action", "") in ("merge", "remove", "fragment", "rule")
        if changes and system.charges is not None:
            raise InputError(f"{event.kind}: action {event.action!r} cannot act on charged particles")  # type: ignore[union-attr]
        if system.held_by:
            raise InputError(
                f"{event.kind}: events search the motion of free particles, and {system.name!r} has {system.held_by}"
            )
        if changes and joins:
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
