"""Collisions of bodies, as plain data: the event, what becomes of the two bodies, and constants in a system's units."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar, NamedTuple

import numpy as np

from kickdrift.errors import InputError
from kickdrift.model.checks.arguments import checked_arguments, misfit
from kickdrift.model.checks.values import is_number, number, positive, whole_number
from kickdrift.model.state import Floats
from kickdrift.model.subject import Bodies, index_of
from kickdrift.model.units.quantities import quantity
from kickdrift.model.units.unit_systems import UnitSystem
from kickdrift.text import shown, suggestion

Radii = float | Sequence[float] | Mapping[str, float]
BRIDGES = "bridges"  # a restitution that depends on the speed
C_STAR, MU_BAR = 1.9, 0.36  # of planets; Leinhardt & Stewart 2012
NEW_BODIES = 100  # default limit


@checked_arguments
@dataclass(frozen=True)
class Collision:
    """Bodies that touch: their separation falls to the sum of their radii.

    A step of a method without error control in which bodies that attract each other may touch is taken in parts up to
    the contact. In other steps the moment of contact is found on the cubic through both ends, then on the method's own
    solution. The event acts at that moment, and the rest of the step is taken and searched again. So the collisions of
    a step act in the order of their times. An adaptive method begins anew from there. A method of fixed steps completes
    the step with a shorter one, so it stays on its grid. Pairs of massless bodies pass through each other. In the patch
    of a `GravitySheet`, bodies meet the images of others too; changes other than bounces put their result beside the
    first body.

    Attributes
    ----------
    radii : one for all, one for each, or {name: radius} with all other bodies as points; optional
        Lengths, zero or more; default the system's radii.
    action : str
        "merge": the heavier body absorbs the lighter one, which leaves the run. Mass, momentum and centre of mass are
        conserved, and volumes add up. "bounce": hard spheres exchange their velocities along the line of centres.
        "fragment": the scaling laws of Leinhardt & Stewart 2012, doi:10.1088/0004-637X/745/1/79. "rule": the function
        ``rule``, which is the default action if there is a rule. "stop": the run ends, at contact with an adaptive
        method, at the end of the step with fixed steps.
    restitution : float or "bridges"
        Ratio of the normal speeds after and before a bounce, from 0 to 1; 1 conserves energy. "bridges" is that of
        frosty ice, 0.32 v^-0.234 with v in cm/s and at most 1 (Bridges, Hatzes & Lin 1984, doi:10.1038/309333a0).
    elastic_below : float
        Approach speed below which a bounce is elastic; default 0. With a constant restitution below 1, crowded bodies
        otherwise come to rest on each other, and the run stops.
    fragment_mass : float
        Smallest mass of a fragment; required by "fragment".
    c_star, mu_bar : float
        Material parameters of "fragment"; default those of planets, 1.9 and 0.36. Small bodies have 5 and 0.37.
    reference_density : float
        Density rho_1 of "fragment"; default 1000 kg/m^3, required in reduced units.
    new_bodies : int
        Most bodies that "fragment" and "rule" may add in the whole run. A run's file has a row for each.
    rule : callable
        ``rule(heavier, lighter)`` gets two `Sphere` and returns a sequence of any number of them. They have the mass
        and the momentum of the two.
    loss : bool
        Whether a rule may return less mass, and other momentum. The report counts what is lost.
    """

    radii: Radii | None = None
    action: str = "merge"
    restitution: float | str = 1.0
    elastic_below: float = 0.0
    fragment_mass: float | None = None
    c_star: float = C_STAR
    mu_bar: float = MU_BAR
    reference_density: float | None = None
    new_bodies: int = NEW_BODIES
    rule: Callable[..., Any] | None = None
    loss: bool = False

    kind: ClassVar[str] = "collision"
    actions: ClassVar[tuple[str, ...]] = ("merge", "bounce", "fragment", "rule", "stop")

    def __post_init__(self) -> None:
        one_of(self.kind, "action", self.action, self.actions)
        if self.rule is not None and self.action == "merge":
            object.__setattr__(self, "action", "rule")
        self._check_restitution()
        self._check_own_keys()
        values = self.radii.items() if isinstance(self.radii, Mapping) else enumerate(_listed(self.radii))
        for key, radius in values:
            if not (math.isfinite(number(radius)) and radius >= 0):
                which = "" if is_number(self.radii) else f"[{key}]"
                raise InputError(f"{self.kind}: radii{which} must be a length, zero or more, got {shown(radius)}")

    def _check_restitution(self) -> None:
        given = self.restitution
        if given != BRIDGES and not (is_number(given) and 0 <= given <= 1):  # type: ignore[operator]
            known = "" if is_number(given) else f", or {BRIDGES!r}"
            raise InputError(f"{self.kind}: restitution must be a number from 0 to 1{known}, got {shown(given)}")
        if given != 1 and self.action != "bounce":
            raise InputError(f"{self.kind}: restitution needs action 'bounce', not {self.action!r}")
        if not (math.isfinite(number(self.elastic_below)) and self.elastic_below >= 0):
            raise InputError(
                f"{self.kind}: elastic_below must be a speed, zero or more, got {shown(self.elastic_below)}"
            )
        if self.elastic_below and self.action != "bounce":
            raise InputError(f"{self.kind}: elastic_below needs action 'bounce', not {self.action!r}")

    def _check_own_keys(self) -> None:
        """Check the keys that belong to one action."""
        plain = {"fragment_mass": None, "c_star": C_STAR, "mu_bar": MU_BAR, "reference_density": None}
        owners = {**dict.fromkeys(plain, "fragment"), "rule": "rule", "loss": "rule"}
        for key, default in {**plain, "rule": None, "loss": False}.items():
            value = getattr(self, key)
            if value != default and owners[key] != self.action:
                raise InputError(f"{self.kind}: {key} needs action {owners[key]!r}, not {self.action!r}")
            if key in plain and value is not None:
                positive(f"{self.kind}: {key}", value)
        if not isinstance(self.loss, bool):
            raise InputError(f"{self.kind}: loss must be True or False, got {shown(self.loss)}")
        whole_number(f"{self.kind}: new_bodies", self.new_bodies, 0)
        if self.action == "fragment" and self.fragment_mass is None:
            raise InputError(f"{self.kind}: fragment_mass: required by action 'fragment'")
        if self.action == "rule":
            if self.rule is None:
                raise InputError(f"{self.kind}: rule: required by action 'rule'")
            if not callable(self.rule):
                raise InputError(f"{self.kind}: rule: expected a function of two bodies, got {shown(self.rule)}")
            if takes := misfit(self.rule, "heavier", "lighter"):
                raise InputError(f"{self.kind}: rule must take (heavier, lighter); it takes {takes}")

    @property
    def adds(self) -> bool:
        """Whether a collision may add bodies, or change masses other than by a merger."""
        return self.action in ("fragment", "rule")

    def radii_in(self, system: Bodies) -> Floats:
        """Radii (n,) of a system's bodies."""
        n, given = len(system), self.radii
        if given is None:
            if system.radii is None:
                raise InputError(f"{self.kind}: radii: required, since the bodies of {system.name!r} have no radii")
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


def one_of(kind: str, key: str, value: Any, allowed: Sequence[str]) -> None:
    """Raise InputError unless the value is one of these names."""
    if not (isinstance(value, str) and value in allowed):
        hint = suggestion(value, allowed) if isinstance(value, str) else ""
        raise InputError(f"{kind}: {key} must be one of {', '.join(allowed)}, got {shown(value)}{hint}")


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


def check_box(kind: str, system: Bodies, radii: Floats) -> None:
    """Refuse spheres that do not fit into a periodic box, and one that could touch two images of another."""
    heights, largest = system.box.heights, float(radii.max(initial=0.0))
    if 4.0 * largest >= (least := float(heights.min())):
        i = int(radii.argmax())
        raise InputError(
            f"{kind}: {system.body(i)} has the diameter {2.0 * largest:.6g}, which must be less than half the box, "
            f"whose least height is {least:.6g}"
        )
    flat = system.dimensions == 2
    room = system.box.area if flat else system.box.volume
    filled = float((np.pi * radii**2 if flat else 4.0 / 3.0 * np.pi * radii**3).sum()) / room
    if filled >= 1.0:
        what = "area" if flat else "volume"
        raise InputError(f"{kind}: the spheres do not fit: they take {filled:.3g} times the {what} of the box")


WATER = "1000 kg/m^3"  # rho_1 of Leinhardt & Stewart 2012
SLOW = "1 cm/s"  # unit of speed of Bridges, Hatzes & Lin 1984


def check_action(event: Collision, system: Bodies, gravity: Any) -> None:
    """Raise InputError if the system lacks what the event's action needs. ``gravity`` is the force that
    binds bodies, or None."""
    if event.restitution == BRIDGES and system.units.reduced:
        raise InputError(f"{event.kind}: restitution {BRIDGES!r} needs units with metres; {system.units.name} has none")
    if event.action != "fragment":
        return
    material_of(event, system, gravity)
    bare = np.flatnonzero((event.radii_in(system) == 0) & (system.state.masses > 0))
    if bare.size:
        raise InputError(
            f"{event.kind}: radii: action 'fragment' needs a radius for every body with mass, and "
            f"{system.body(int(bare[0]))} has none"
        )


def material_of(event: Collision, system: Bodies, gravity: Any) -> tuple[float, float, float, float]:
    """c*, mu-bar, rho_1 and G in the system's units."""
    if gravity is None:
        raise InputError(f"{event.kind}: action 'fragment' needs gravity, but {system.name!r} has none")
    density = event.reference_density
    if density is None:
        if system.units.reduced:
            raise InputError(
                f"{event.kind}: reference_density: required in {system.units.name} units: {WATER} in the system's units"
            )
        density = quantity(WATER, "density", system.units)
    G = system.units.gravity if gravity.G is None else gravity.G
    return event.c_star, event.mu_bar, float(density), float(G)  # type: ignore[arg-type]


def restitution_of(event: Collision, system: Bodies) -> tuple[float, float, float]:
    """Restitution of an event, as `ratio` takes it."""
    if event.restitution == BRIDGES:
        return 1.0, float(event.elastic_below), _slow(system.units)
    return float(event.restitution), float(event.elastic_below), 0.0


def ratio(restitution, speed):
    """Ratio of the normal speeds after and before a hit. Compiled code takes the same function.

    ``restitution`` holds a constant, the speed below which hits are elastic, and the unit of speed of frosty ice, or
    zero for the constant."""
    constant, elastic_below, slow = restitution
    if speed < elastic_below:
        return 1.0
    if slow == 0.0:
        return constant
    if not speed > 0.0:
        return 1.0
    return min(1.0, 0.32 * (speed / slow) ** -0.234)


@lru_cache
def _slow(units: UnitSystem) -> float:
    return quantity(SLOW, "velocity", units)


class Sphere(NamedTuple):
    """A body before or after a collision, in the system's units.

    Attributes
    ----------
    mass : float
    position, velocity : (3,)
    radius : float
    name : str
        The body's name, or "particle 5" in a system without names. A rule that returns a body under the name of one of
        the two keeps that body and its id. A body without a name is new, and gets a name from the heavier body.
    """

    mass: float
    position: Floats
    velocity: Floats
    radius: float
    name: str = ""

    @property
    def momentum(self) -> Floats:
        """Mass times velocity, (3,)."""
        return self.mass * np.asarray(self.velocity)

    def problem(self) -> str:
        """The fault in the values, as text; "" if nothing is."""
        for key, value in (("mass", self.mass), ("radius", self.radius)):
            if not (is_number(value) and 0 <= value < np.inf):
                return f"{key} {shown(value)}; expected a number, zero or more"
        for key, vector in (("position", self.position), ("velocity", self.velocity)):
            if not _is_vector(vector):
                return f"{key} {shown(vector)}; expected three finite numbers"
        return "" if isinstance(self.name, str) else f"name {shown(self.name)}; expected text"


def _is_vector(value: Any) -> bool:
    try:
        found = np.asarray(value, float)
    except (TypeError, ValueError):
        return False
    return found.shape == (3,) and bool(np.isfinite(found).all())
