"""Outcomes for two bodies that touch, where the number or the masses of the bodies may change."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from kickdrift.errors import RunError
from kickdrift.model.events.collision import Collision, Sphere, material_of
from kickdrift.model.events.events import binding
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.run.watch.fragments import fragmented
from kickdrift.run.watch.scaling_laws import Material
from kickdrift.text import shown

EXACT = 1e-10  # error of mass and momentum that rounding in a user's rule may make
BY_RULE = "rule"


class Outcome(NamedTuple):
    """Bodies after a collision, and its regime. A body with the name of one of the two is that body."""

    bodies: list[Sphere]
    regime: str


def outcome(event: Collision, system: System, y: Floats, pair: tuple[int, int], radii: Floats) -> Outcome:
    """Bodies after the collision of the rows ``pair``, the heavier first, at y (2, 3, n). ``radii`` (n,) are the
    event's.

    Raises RunError for a rule that fails, or returns what no collision can."""
    heavier, lighter = (sphere_of(system, y, i, radii) for i in pair)
    if event.action == "fragment":
        material, smallest = material_in(event, system), event.fragment_mass
        assert smallest is not None
        found = fragmented(heavier, lighter, material, smallest)
        return Outcome(found.bodies, found.regime)
    return Outcome(_ruled(event, system, heavier, lighter), BY_RULE)


def sphere_of(system: System, y: Floats, i: int, radii: Floats) -> Sphere:
    """The body of a row."""
    return Sphere(float(system.state.masses[i]), y[0, :, i].copy(), y[1, :, i].copy(), float(radii[i]), system.body(i))


def material_in(event: Collision, system: System) -> Material:
    """Constants of the scaling laws in a system's units."""
    return Material(*material_of(event, system, binding(system)))


def _ruled(event: Collision, system: System, heavier: Sphere, lighter: Sphere) -> list[Sphere]:
    """Bodies that the user's rule returns, checked."""
    try:
        given = event.rule(heavier, lighter)  # type: ignore[misc]
    except Exception as error:  # whatever a user's function raises
        raise RunError(" ".join(f"raised {type(error).__name__}: {error}".split())) from error
    bodies = _listed(given)
    for k, body in enumerate(bodies):
        if problem := body.problem():
            raise RunError(f"returned body {k} with {problem}")
    made = [
        Sphere(float(b.mass), np.array(b.position, float), np.array(b.velocity, float), float(b.radius), b.name)
        for b in bodies
    ]
    _check_names(system, made, (heavier.name, lighter.name))
    if system.dimensions == 2 and any(b.velocity[2] or b.position[2] != heavier.position[2] for b in made):
        raise RunError("returned a body outside the plane of the system")
    _check_totals(event, made, (heavier, lighter))
    return made


def _listed(given: Any) -> list[Sphere]:
    bodies = list(given) if isinstance(given, Sequence) and not isinstance(given, Sphere | str) else None
    if bodies is None or not all(isinstance(body, Sphere) for body in bodies):
        raise RunError(f"returned {shown(given)}; expected a list of kd.Sphere")
    return bodies


def _check_names(system: System, bodies: list[Sphere], pair: tuple[str, str]) -> None:
    seen: set[str] = set()
    for name in (body.name for body in bodies if body.name):
        if name in seen:
            raise RunError(f"returned two bodies with the name {shown(name)}")
        if name not in pair and (name in system.names or not system.names):
            what = "the name of another body" if system.names else "a name, and the bodies of the system have no names"
            raise RunError(f"returned a body with the name {shown(name)}: that is {what}")
        seen.add(name)


def _check_totals(event: Collision, after: list[Sphere], before: tuple[Sphere, Sphere]) -> None:
    """Refuse bodies of another mass or momentum than the two had."""
    mass, was = (sum(body.mass for body in bodies) for bodies in (after, before))
    if mass > was * (1 + EXACT) or (mass < was * (1 - EXACT) and not event.loss):
        hint = "" if mass > was else "; loss = true allows less mass"
        raise RunError(f"returned the mass {mass:.9g} of {was:.9g}{hint}")
    error, scale = momentum_error(after, before)
    if error > EXACT * scale and not event.loss:
        raise RunError(f"changed the momentum by {error / scale:.2g} of the sum of m |v|")


def momentum_error(after: Sequence[Sphere], before: Sequence[Sphere]) -> tuple[float, float]:
    """Change of the momentum, and the sum of m |v|, in which rounding errors are measured."""
    zero = np.zeros(3)
    change = sum((body.momentum for body in after), zero) - sum((body.momentum for body in before), zero)
    scale = max(sum(float(np.linalg.norm(body.momentum)) for body in bodies) for bodies in (after, before))
    return float(np.linalg.norm(change)), scale or 1.0


def told(found: Outcome, before: Sequence[Sphere]) -> str:
    """Text for the log: regime, masses, and the error of the momentum."""
    masses = [f"{body.mass:.6g}" for body in found.bodies]
    each = [f"{masses.count(m)} x {m}" if masses.count(m) > 1 else m for m in dict.fromkeys(masses)]
    error, scale = momentum_error(found.bodies, before)
    left = f"mass{'es' * (len(masses) > 1)} {', '.join(each)}" if masses else "no body left"
    return f"{found.regime}: {left}; momentum error {error / scale:.1e}"
