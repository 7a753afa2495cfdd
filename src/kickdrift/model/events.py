"""What to watch for while a run goes on: close approaches, collisions, escapes and zeros of any function. Plain data.

``Simulation(system, events=[…])`` or a system file's ``[[event]]`` takes them; ``run/watch`` finds them.
Bodies are named as in the system, or by their number, counted from 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from kickdrift.errors import InputError
from kickdrift.model.checks import is_number, number, positive
from kickdrift.model.subject import Bodies, index_of
from kickdrift.model.units import shown, suggestion

if TYPE_CHECKING:
    from kickdrift.model.state import Floats

Body = str | int
Radii = float | Sequence[float] | Mapping[str, float]
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

    def radii_in(self, system: Bodies) -> Floats:
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
