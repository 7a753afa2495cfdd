"""Bodies that leave a collision with fragmentation: masses by the scaling laws, places on a ring outside the contact.

The debris makes fragments of equal mass, none below the smallest mass. The fragments stand evenly on a ring in the
plane of the collision, around the remnants, and move outwards (Chambers 2013, doi:10.1016/j.icarus.2013.02.015).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from kickdrift.model.events.collision import Sphere
from kickdrift.model.state import Floats
from kickdrift.run.watch.scaling_laws import GRAZING_MERGER, HIT_AND_RUN, MERGING, Impact, Material, Remnants, remnants

ROOM = 1.1  # distances on the ring, over those of spheres that touch
LAUNCH = 1.05  # speed of the fragments over their escape speed


class Fragmented(NamedTuple):
    """Regime of a collision and its bodies. A body without a name is a fragment."""

    regime: str
    bodies: list[Sphere]


def fragmented(heavier: Sphere, lighter: Sphere, material: Material, smallest: float) -> Fragmented:
    """Bodies after the collision of two spheres. Mass, momentum, centre of mass and volume are conserved."""
    impact = impact_of(heavier, lighter)
    found = remnants(impact, material)
    largest, second, debris = _shares(found, impact, smallest)
    count = int(debris / smallest * (1.0 + 1e-12)) if debris > 0.0 else 0
    core = _running(heavier, lighter, second, material.G) if found.regime == HIT_AND_RUN else []
    if not core:
        if not count:
            return Fragmented(found.regime, [together(heavier, lighter)])
        core = [_about(heavier, lighter, largest, impact.total)]
    parent = lighter.radius**3 / lighter.mass if found.regime == HIT_AND_RUN else _cubes(heavier, lighter)
    radius = float(np.cbrt(debris / max(count, 1) * parent))
    return Fragmented(found.regime, _placed(heavier, lighter, core, count, debris, radius, material.G))


def apart(heavier: Sphere, lighter: Sphere) -> tuple[Floats, Floats]:
    """Position and velocity (3,) of the lighter body relative to the heavier one."""
    return lighter.position - heavier.position, lighter.velocity - heavier.velocity


def impact_of(heavier: Sphere, lighter: Sphere) -> Impact:
    """The impact of two spheres where they are."""
    x, v = apart(heavier, lighter)
    speed, distance = float(np.linalg.norm(v)), float(np.linalg.norm(x))
    normal = float(x @ v) / (speed * distance) if speed and distance else 1.0
    sine = math.sqrt(max(0.0, 1.0 - normal**2))
    return Impact(heavier.mass, lighter.mass, heavier.radius, lighter.radius, speed, sine)


def together(heavier: Sphere, lighter: Sphere) -> Sphere:
    """Both bodies in one, with their mass, momentum, centre of mass and volume."""
    total = heavier.mass + lighter.mass
    return _about(heavier, lighter, total, total)


def _about(heavier: Sphere, lighter: Sphere, mass: float, total: float) -> Sphere:
    """A body at the centre of mass, with the mean density of both."""
    share = lighter.mass / total
    x = heavier.position + share * (lighter.position - heavier.position)
    v = heavier.velocity + share * (lighter.velocity - heavier.velocity)
    radius = np.cbrt((heavier.radius**3 + lighter.radius**3) * (mass / total))
    return Sphere(mass, x, v, float(radius), heavier.name)


def _cubes(heavier: Sphere, lighter: Sphere) -> float:
    """Cube of the radius over the mass, of both bodies together."""
    return (heavier.radius**3 + lighter.radius**3) / (heavier.mass + lighter.mass)


def _shares(found: Remnants, impact: Impact, smallest: float) -> tuple[float, float, float]:
    """Masses of the largest body, of what is left of the projectile, and of the debris."""
    if found.regime in (MERGING, GRAZING_MERGER):
        return impact.total, 0.0, 0.0
    if found.regime == HIT_AND_RUN:
        debris = impact.projectile - found.second
        if debris < smallest:
            return impact.target, impact.projectile, 0.0
        second = found.second if found.second >= smallest else 0.0
        return impact.target, second, impact.projectile - second
    largest = max(found.largest, smallest)
    debris = impact.total - largest
    return (largest, 0.0, debris) if debris >= smallest else (impact.total, 0.0, 0.0)


def _running(heavier: Sphere, lighter: Sphere, second: float, G: float) -> list[Sphere]:
    """The two bodies after a hit-and-run: the normal part of their relative velocity is gone, and the rest is at least
    the escape speed (Kokubo & Genda 2010, doi:10.1088/2041-8205/714/1/L21)."""
    if not second:
        return [heavier]
    x, v = apart(heavier, lighter)
    total = heavier.mass + lighter.mass
    normal = x / np.linalg.norm(x)
    along = v - (v @ normal) * normal
    speed, before = float(np.linalg.norm(along)), float(np.linalg.norm(v))
    escape = math.sqrt(2.0 * G * total / (heavier.radius + lighter.radius))
    after = min(before, max(speed, escape)) / speed * along
    radius = lighter.radius if second == lighter.mass else float(lighter.radius * np.cbrt(second / lighter.mass))
    centre = heavier.velocity + lighter.mass / total * v
    return [
        heavier._replace(velocity=centre - lighter.mass / total * after),
        lighter._replace(mass=second, radius=radius, velocity=centre + heavier.mass / total * after),
    ]


def _placed(
    heavier: Sphere, lighter: Sphere, core: list[Sphere], count: int, debris: float, radius: float, G: float
) -> list[Sphere]:
    """The core with ``count`` fragments around its centre of mass, all moved so that the centre of mass and the
    momentum are those of the two bodies."""
    whole = together(heavier, lighter)
    inner = sum(body.mass for body in core)
    x = sum((body.mass * body.position for body in core), np.zeros(3)) / inner
    v = sum((body.momentum for body in core), np.zeros(3)) / inner
    reach = max(float(np.linalg.norm(body.position - x)) + body.radius for body in core)
    ring = ROOM * max(reach + radius, radius / math.sin(math.pi / count) if count > 1 else 0.0)
    speed = LAUNCH * math.sqrt(2.0 * G * whole.mass / ring)
    outwards = _directions(heavier, lighter, count)
    bodies = [*core]
    if count:
        mass = debris / count
        speed = min(speed, _most(heavier, lighter, core, outwards, mass))
        bodies += [Sphere(mass, x + ring * u, v + speed * u, radius) for u in outwards]
    return _centred(bodies, whole)


def _most(heavier: Sphere, lighter: Sphere, core: list[Sphere], outwards: Floats, mass: float) -> float:
    """Largest speed of the fragments that adds no kinetic energy to that before the collision."""
    v = lighter.velocity - heavier.velocity
    before = 0.5 * heavier.mass * lighter.mass / (heavier.mass + lighter.mass) * float(v @ v)
    inner, centre = sum(body.mass for body in core), sum((body.momentum for body in core), np.zeros(3))
    own = [body.velocity - centre / inner for body in core]
    kept = 0.5 * sum(body.mass * float(u @ u) for body, u in zip(core, own, strict=True))
    count = len(outwards)
    recoil = (mass * np.linalg.norm(outwards.sum(axis=0))) ** 2 / (inner + count * mass)
    return math.sqrt(2.0 * max(0.0, before - kept) / (count * mass - float(recoil)))


def _directions(heavier: Sphere, lighter: Sphere, count: int) -> Floats:
    """Unit vectors (count, 3), evenly in the plane of the collision, none along the line of centres unless there is
    only one."""
    x, v = apart(heavier, lighter)
    first = x / np.linalg.norm(x)
    second = v - (v @ first) * first
    if np.linalg.norm(second) <= 1e-9 * np.linalg.norm(v):  # head-on: any plane
        second = np.cross((0.0, 0.0, 1.0) if abs(first[2]) < 0.9 else (1.0, 0.0, 0.0), first)
    second /= np.linalg.norm(second)
    angles = 2.0 * math.pi * (np.arange(count) + 0.5) / max(count, 1)
    return np.outer(np.cos(angles), first) + np.outer(np.sin(angles), second)


def _centred(bodies: list[Sphere], whole: Sphere) -> list[Sphere]:
    """The bodies, moved so that their centre of mass and its velocity are those of ``whole``."""
    for _ in range(2):  # the second time removes the rounding of the first
        total = math.fsum(body.mass for body in bodies)
        x = sum((body.mass / total * (body.position - whole.position) for body in bodies), np.zeros(3))
        v = sum((body.mass / total * (body.velocity - whole.velocity) for body in bodies), np.zeros(3))
        bodies = [body._replace(position=body.position - x, velocity=body.velocity - v) for body in bodies]
    return bodies
