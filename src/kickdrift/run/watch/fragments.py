"""Collision of two gravity-dominated bodies with fragmentation: masses by scaling laws, places on a ring.

The scaling laws are those of Leinhardt & Stewart 2012. Equation numbers are those of ApJ 745, 79,
doi:10.1088/0004-637X/745/1/79, as the programs Swiftest and collresolve give them. The heavier body is the target.
Lengths, masses and speeds are in any units in which G holds.

The debris makes fragments of equal mass, none below the smallest mass. The fragments stand evenly on a ring in the
plane of the collision, around the remnants, and move outwards (Chambers 2013, doi:10.1016/j.icarus.2013.02.015).
"""

import math
from typing import NamedTuple

import numpy as np

from kickdrift.model.events.collision import Sphere
from kickdrift.model.state import Floats

MERGING, GRAZING_MERGER, HIT_AND_RUN = "perfect merging", "graze-and-merge", "hit-and-run"
ACCRETION, EROSION, DISRUPTION = "partial accretion", "erosion", "super-catastrophic disruption"
SUPER = 1.8  # Q_R / Q*_RD from which a disruption is super-catastrophic
ETA = -1.5  # exponent of the largest remnant there
ROOM = 1.1  # distances on the ring, over those of spheres that touch
LAUNCH = 1.05  # speed of the fragments over their escape speed


class Material(NamedTuple):
    """Constants of the laws: c*, mu-bar, the density rho_1, and G."""

    c_star: float
    mu_bar: float
    density: float
    G: float


class Impact(NamedTuple):
    """Two bodies at contact. ``sine`` is the impact parameter b: the sine of the angle between the line of centres and
    the relative velocity."""

    target: float  # masses
    projectile: float
    target_radius: float
    projectile_radius: float
    speed: float
    sine: float

    @property
    def total(self) -> float:
        """Mass of both."""
        return self.target + self.projectile

    @property
    def grazing(self) -> bool:
        """Whether the centre of the projectile passes beside the target: b > R / (R + r)."""
        return self.sine > self.target_radius / (self.target_radius + self.projectile_radius)

    @property
    def overlap(self) -> float:
        """Length of the projectile that meets the target, at most its diameter."""
        reach = self.target_radius + self.projectile_radius
        return min((1.0 - self.sine) * reach, 2.0 * self.projectile_radius)

    @property
    def interacting(self) -> float:
        """Fraction alpha of the projectile's mass that meets the target."""
        length, r = self.overlap, self.projectile_radius
        return length**2 * (3.0 * r - length) / (4.0 * r**3)


class Remnants(NamedTuple):
    """Regime and masses of the largest bodies. ``second`` is what is left of the projectile after a hit-and-run."""

    regime: str
    largest: float
    second: float = 0.0


def impact_energy(one: float, other: float, speed: float) -> float:
    """Q_R: kinetic energy about the centre of mass, over the total mass; eq. 1."""
    return 0.5 * one * other / (one + other) ** 2 * speed**2


def disruption_energy(one: float, other: float, material: Material) -> float:
    """Q*_RD of a head-on collision: the Q_R that disperses half of the total mass.

    Bodies of equal mass need c* (4/5) pi rho_1 G R_C1^2 (eq. 28), with R_C1 the radius of the total mass at the density
    rho_1. Others need ((gamma + 1)^2 / (4 gamma))^(2 / (3 mu-bar) - 1) times that (eq. 23), with gamma the ratio of the
    masses."""
    radius = ((one + other) * 3.0 / (4.0 * math.pi * material.density)) ** (1.0 / 3.0)
    equal = material.c_star * 0.8 * math.pi * material.density * material.G * radius**2
    gamma = other / one
    return float(equal * ((gamma + 1.0) ** 2 / (4.0 * gamma)) ** (2.0 / (3.0 * material.mu_bar) - 1.0))


def oblique_disruption_energy(impact: Impact, material: Material) -> float:
    """Q'*_RD at an angle: (mu / mu_alpha)^(2 - 3 mu-bar / 2) times the head-on value; eq. 15.

    The reduced mass mu_alpha has the interacting mass alpha M_p in the projectile's place; eq. 12."""
    alpha = impact.interacting
    ratio = (alpha * impact.projectile + impact.target) / (alpha * impact.total)
    head_on = disruption_energy(impact.target, impact.projectile, material)
    return float(head_on * ratio ** (2.0 - 1.5 * material.mu_bar))


def largest_remnant(ratio: float) -> float:
    """Mass of the largest remnant over the total mass, from Q_R / Q*_RD.

    The universal law 1/2 - (ratio - 1) / 2 (eq. 5) holds up to 1.8, and 0.1 (ratio / 1.8)^-1.5 beyond (eq. 44)."""
    return 1.0 - 0.5 * ratio if ratio < SUPER else 0.1 * (ratio / SUPER) ** ETA


def escape_speed(impact: Impact, material: Material) -> float:
    """Speed below which the bodies merge: the escape speed from the surface of the target with the interacting mass,
    at the mean density of both bodies."""
    mass = impact.target + impact.interacting * impact.projectile
    cubes = impact.target_radius**3 + impact.projectile_radius**3
    radius = (cubes * mass / impact.total) ** (1.0 / 3.0)
    return math.sqrt(2.0 * material.G * mass / radius)


def hit_and_run_speed(impact: Impact, material: Material) -> float:
    """Speed below which two bodies that graze each other lose so much of it that they merge.

    Over the escape speed of both at contact this is 2.43 g^2 h + 1.86 h - 0.0408 g^2 + 1.08, with h = (1 - sine)^(5/2)
    and g the difference of the masses over their sum (Kokubo & Genda 2010; Genda, Kokubo & Ida 2012,
    doi:10.1088/0004-637X/744/2/137)."""
    escape = math.sqrt(2.0 * material.G * impact.total / (impact.target_radius + impact.projectile_radius))
    unlike, open_angle = ((impact.target - impact.projectile) / impact.total) ** 2, (1.0 - impact.sine) ** 2.5
    return escape * (2.43 * unlike * open_angle + 1.86 * open_angle - 0.0408 * unlike + 1.08)


def left_of_projectile(impact: Impact, material: Material) -> float:
    """Mass of what is left of the projectile after a hit-and-run: the reverse impact.

    The part of the target that the projectile sweeps is a cylinder (eqs. 46 to 48). This part strikes the projectile
    head-on."""
    big, r, length = impact.target_radius, impact.projectile_radius, impact.overlap
    phi = 2.0 * math.acos((length - r) / r)
    area = r**2 * (math.pi - 0.5 * (phi - math.sin(phi)))
    path = 2.0 * math.sqrt(big**2 - (big - 0.5 * length) ** 2)
    density = impact.target / (4.0 / 3.0 * math.pi * big**3)
    swept = min(area * path * density, impact.target)
    if not swept > 0.0:
        return impact.projectile
    energy = impact_energy(impact.projectile, swept, impact.speed)
    ratio = energy / disruption_energy(impact.projectile, swept, material)
    return min(largest_remnant(ratio) * (impact.projectile + swept), impact.projectile)


def remnants(impact: Impact, material: Material) -> Remnants:
    """Regime of an impact, and the masses of its largest bodies.

    Bodies slower than `escape_speed` merge. A grazing impact that does not erode the target is a hit-and-run, or below
    `hit_and_run_speed` a graze-and-merge. All others leave one largest remnant: more than the target (partial
    accretion), less (erosion), or less than a tenth of the total mass (super-catastrophic disruption)."""
    if impact.projectile == 0.0 or impact.speed <= escape_speed(impact, material):
        return Remnants(MERGING, impact.total)
    if impact.interacting == 0.0:
        return Remnants(HIT_AND_RUN, impact.target, impact.projectile)
    energy = impact_energy(impact.target, impact.projectile, impact.speed)
    ratio = energy / oblique_disruption_energy(impact, material)
    largest = largest_remnant(ratio) * impact.total
    if largest >= impact.target:
        if impact.grazing and impact.speed <= hit_and_run_speed(impact, material):
            return Remnants(GRAZING_MERGER, impact.total)
        if impact.grazing:
            return Remnants(HIT_AND_RUN, impact.target, left_of_projectile(impact, material))
        return Remnants(ACCRETION, largest)
    return Remnants(EROSION if ratio < SUPER else DISRUPTION, largest)


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
