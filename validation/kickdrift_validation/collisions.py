"""Do collisions book what they take, and do fragments follow Leinhardt and Stewart's laws?

24 bodies reach a heavy one at the same time and merge with it. Hard spheres in a line are Newton's cradle: spheres of
equal mass exchange their velocities. A bounce with restitution e takes (1 - e^2) mu v_n^2 / 2. The scaling laws of
Leinhardt & Stewart 2012 (ApJ 745, 79, doi:10.1088/0004-637X/745/1/79) stand beside the paper's second form, which
begins with the critical velocity (eqs. 22 and 30), in 30 digits; their geometry stands beside quadratures. 100 bodies
that fall together lose nothing that is not booked. The tree that searches many bodies finds the pairs that the search
of all pairs finds.
"""

import math
import sys
from collections.abc import Iterator
from typing import Any

import mpmath
import numpy as np

import kickdrift as kd
from kickdrift.run.watch import contacts
from kickdrift.run.watch.fragments import (
    Impact,
    Material,
    disruption_energy,
    escape_speed,
    impact_energy,
    largest_remnant,
    left_of_projectile,
    oblique_disruption_energy,
    remnants,
)
from kickdrift_validation.claim import Claim, claim, largest, main

PAPER = "Leinhardt & Stewart 2012"
G = 6.6743e-11
PLANETS, PLANETESIMALS = Material(1.9, 0.36, 1000.0, G), Material(5.0, 0.37, 1000.0, G)  # the paper's fits
EARTH = 5.972e24
DRAWN, SHORT, LONG = 200, 100, 300  # drawn impacts; bodies that collapse


def straight(x: Any, v: Any, masses: Any, radii: Any, **more: Any) -> kd.System:
    """Bodies that move straight: G is almost zero."""
    return kd.System(x, v, masses, forces=[kd.Gravity(G=1e-30)], units="nbody", radii=radii, **more)


def momentum_change(system: kd.System, sim: kd.Simulation) -> float:
    """Change of the momentum, of the sum of m |v| at the start."""
    start, now = system.state, sim.state
    scale = float(start.masses @ np.linalg.norm(start.velocities, axis=1))
    return float(np.abs(now.masses @ now.velocities - start.masses @ start.velocities).max()) / scale


def mergers() -> list[Claim]:
    """24 bodies on a sphere around a heavy one."""
    n = 24
    height, angle = (np.arange(n) + 0.5) / (n / 2) - 1, 2.4 * np.arange(n)
    ways = np.column_stack([np.sqrt(1 - height**2) * np.cos(angle), np.sqrt(1 - height**2) * np.sin(angle), height])
    masses = np.append(50.0, np.random.default_rng(24).uniform(0.5, 2.0, n))
    v = np.vstack([np.zeros(3), -ways]) + np.array([0.3, -0.2, 0.7])
    system = straight(np.vstack([np.zeros(3), 2 * ways]), v, masses, np.append(0.9, np.full(n, 0.1)))
    sim = kd.Simulation(system, dt=1.5, events=[kd.Collision()])
    report = sim.run(1)
    times = [event["time"] for event in report.events]
    source = "one step"
    changes = {
        "mass": abs(float(sim.state.masses.sum()) / math.fsum(masses) - 1),
        "momentum, of the sum of m |v|": momentum_change(system, sim),
    }
    return [
        claim("24 simultaneous mergers: bodies left", len(sim.state), "1", len(sim.state) == 1, source),
        claim("24 simultaneous mergers: in order of time", len(times), "24", times == sorted(times), source),
        *(
            claim(f"24 simultaneous mergers: change of {k}", c, "<= 1e-15", c <= 1e-15, source)
            for k, c in changes.items()
        ),
    ]


def bounces() -> list[Claim]:
    """Newton's cradle, and single bounces at 45 degrees."""
    n = 8
    x = np.zeros((n, 3))
    x[:, 0] = np.append(-5.0, 1.25 * np.arange(n - 1))
    v = np.zeros((n, 3))
    v[0, 0] = 1.0
    sim = kd.Simulation(straight(x, v, 1.0, 0.5), dt=20.0, events=[kd.Collision(action="bounce")])
    sim.run(1)
    off = float(np.abs(sim.state.velocities - v[::-1]).max())
    claims = [claim("Newton's cradle of 8: error of the velocities", off, "< 1e-14", off < 1e-14, "exchanged")]
    h, worst = math.sqrt(0.5), 0.0
    for restitution in (0.0, 0.25, 0.5, 0.75, 1.0):
        pair = straight([[-2, 0, 0], [0, h, 0]], [[1.5, 0, 0], [0, 0, 0]], [1.0, 3.0], 0.5)
        sim = kd.Simulation(pair, dt=0.3, events=[kd.Collision(action="bounce", restitution=restitution)])
        (event,) = sim.run(8).events
        worst = largest(worst, abs(event["energy"] - (1 - restitution**2) * 0.75 * (1.5 * h) ** 2 / 2))
    text = "energy that bounces take: largest error, with restitutions 0 to 1"
    return [*claims, claim(text, worst, "< 1e-12", worst < 1e-12, "(1 - e^2) mu v_n^2 / 2")]


def critical_energy(one: float, other: float, material: Material) -> Any:
    """Q*_RD by the critical velocity, in mpmath: eq. 30 for equal masses, eq. 22 for others, and eq. 1."""
    c, mu, density, gravity = map(mpmath.mpf, material)
    m, p = mpmath.mpf(one), mpmath.mpf(other)
    radius = mpmath.cbrt(3 * (m + p) / (4 * mpmath.pi * density))
    equal = mpmath.sqrt(c * 32 * mpmath.pi * gravity * density / 5) * radius
    gamma = p / m
    speed = equal * ((gamma + 1) ** 2 / (4 * gamma)) ** (1 / (3 * mu))
    return m * p / (2 * (m + p) ** 2) * speed**2


def drawn() -> Iterator[tuple[Impact, Material]]:
    """Impacts of bodies from 1 km to some Earth masses, with all angles."""
    rng = np.random.default_rng(12)
    for k in range(DRAWN):
        target = 10 ** rng.uniform(13, 25.5)
        projectile = target * 10 ** rng.uniform(-2, 0)
        radii = [(3 * m / (4 * math.pi * rng.uniform(1000, 5000))) ** (1 / 3) for m in (target, projectile)]
        escape = math.sqrt(2 * G * (target + projectile) / sum(radii))
        impact = Impact(target, projectile, *radii, escape * rng.uniform(1.0, 15.0), math.sqrt(rng.uniform(0, 0.98)))
        yield impact, (PLANETS, PLANETESIMALS)[k % 2]


def laws() -> list[Claim]:
    """The formulas beside the paper's other form and beside quadratures."""
    mpmath.mp.dps = 30
    criterion, cap, swept = 0.0, 0.0, 0.0
    for impact, material in drawn():
        m, p = impact.target, impact.projectile
        exact = critical_energy(m, p, material)
        criterion = largest(criterion, float(abs(disruption_energy(m, p, material) / exact - 1)))
        r, length = mpmath.mpf(impact.projectile_radius), mpmath.mpf(impact.overlap)
        volume = mpmath.quad(lambda x, r=r: mpmath.pi * (r**2 - x**2), [r - length, r])
        cap = largest(cap, float(abs(impact.interacting / (volume / (4 * mpmath.pi * r**3 / 3)) - 1)))
        if impact.grazing and length < r:
            swept = largest(swept, _reverse_error(impact, material, r, length))
    shares = [abs(largest_remnant(q) - share) for q, share in ((0.0, 1.0), (1.0, 0.5), (1.8, 0.1))]
    tail = abs(largest_remnant(7.2) / (0.1 / 8) - 1)  # (7.2 / 1.8)^-1.5 = 1/8
    return [
        claim("Q*_RD: largest relative error", criterion, "< 1e-13", criterion < 1e-13, f"{PAPER}, eqs. 22 and 30"),
        claim("interacting mass: largest relative error", cap, "< 1e-9", cap < 1e-9, "quadrature of the cap"),
        claim(
            "projectile after a hit-and-run: largest relative error", swept, "< 1e-8", swept < 1e-8,
            "quadrature of the swept part, eqs. 46 to 48",
        ),
        claim(
            "largest remnant at Q_R / Q*_RD = 0, 1 and 1.8: largest error", largest(*shares), "< 1e-15",
            largest(*shares) < 1e-15, f"1, 1/2 and 1/10: {PAPER}, eqs. 5 and 44",
        ),
        claim("largest remnant at 7.2: relative error", tail, "< 1e-15", tail < 1e-15, f"1/80: {PAPER}, eq. 44"),
    ]  # fmt: skip


def _reverse_error(impact: Impact, material: Material, r: Any, length: Any) -> float:
    """Relative error of what is left of a projectile that a part of the target strikes."""
    big = mpmath.mpf(impact.target_radius)
    area = mpmath.quad(lambda x: 2 * mpmath.sqrt(r**2 - x**2), [r - length, r])
    path = 2 * mpmath.sqrt(big**2 - (big - length / 2) ** 2)
    mass = min(area * path * impact.target / (4 * mpmath.pi * big**3 / 3), mpmath.mpf(impact.target))
    p = mpmath.mpf(impact.projectile)
    energy = mass * p / (2 * (mass + p) ** 2) * mpmath.mpf(impact.speed) ** 2
    ratio = energy / critical_energy(impact.projectile, float(mass), material)
    share = 1 - ratio / 2 if ratio < 1.8 else (ratio / mpmath.mpf("1.8")) ** mpmath.mpf(-1.5) / 10
    return float(abs(left_of_projectile(impact, material) / min(share * (p + mass), p) - 1))


def regimes() -> list[Claim]:
    """Speeds at which the regime changes, by bisection, beside those that solve the paper's criteria."""
    edges: dict[str, float] = {"merging": 0.0, "erosion": 0.0, "super-catastrophic disruption": 0.0}
    for impact, material in drawn():
        critical = oblique_disruption_energy(impact, material)
        share = impact.projectile * impact.target / impact.total**2

        def speed_of(ratio: float, critical: float = critical, share: float = share) -> float:
            return math.sqrt(2 * ratio * critical / share)

        expected = {
            "merging": escape_speed(impact, material),
            "erosion": speed_of(2 - 2 * impact.target / impact.total),  # M_lr = M_target in eq. 5
            "super-catastrophic disruption": speed_of(1.8),
        }
        if expected["merging"] < expected["erosion"] < expected["super-catastrophic disruption"]:
            for k, (name, speed) in enumerate(expected.items()):
                edges[name] = largest(edges[name], abs(_edge(impact, material, k) / speed - 1))
    return [
        claim(f"lowest speed of {name}: largest relative error", off, "< 1e-12", off < 1e-12, PAPER)
        if name != "merging"
        else claim("highest speed of a merger: largest relative error", off, "< 1e-12", off < 1e-12, PAPER)
        for name, off in edges.items()
    ]


def _edge(impact: Impact, material: Material, number: int) -> float:
    """The speed at which the regime leaves the first ``number`` + 1 stages, by bisection."""
    stage = {"perfect merging": 0, "partial accretion": 1, "graze-and-merge": 1, "hit-and-run": 1, "erosion": 2}
    low, high = 1e-3 * impact.speed, 1e4 * impact.speed
    for _ in range(120):
        middle = math.sqrt(low * high)
        at = stage.get(remnants(impact._replace(speed=middle), material).regime, 3)
        low, high = (middle, high) if at <= number else (low, middle)
    return high


def example() -> list[Claim]:
    """Two Earths head-on at their critical velocity leave half of their mass in one body."""
    radius = (3 * EARTH / (4 * math.pi * 3000)) ** (1 / 3)
    energy = disruption_energy(EARTH, EARTH, PLANETS)
    speed = math.sqrt(8 * energy)
    found = remnants(Impact(EARTH, EARTH, radius, radius, speed, 0.0), PLANETS)
    # V* over the escape speed of the total mass at 1000 kg/m^3, by eq. 30: sqrt(12 c* / 5).
    escape = math.sqrt(8 * math.pi * G * 1000 / 3) * (2 * EARTH * 3 / (4 * math.pi * 1000)) ** (1 / 3)
    off = largest(
        abs(found.largest / (2 * EARTH) - 0.5),
        abs(speed / escape / math.sqrt(12 * 1.9 / 5) - 1),
        abs(impact_energy(EARTH, EARTH, speed) / energy - 1),
    )
    text = f"two Earths head-on at V* = {speed / 1000:.1f} km/s: largest error of M_lr / M, V* / V_esc and Q_R"
    return [claim(text, off, "< 1e-14", off < 1e-14, "1/2, sqrt(12 c* / 5) and Q*_RD")]


def collapse(n: int) -> list[Claim]:
    """Bodies at rest in a sphere fall together, break up and merge."""
    rng = np.random.default_rng(100)
    x = rng.normal(size=(n, 3))
    x *= (rng.uniform(size=n) ** (1 / 3) / np.linalg.norm(x, axis=1))[:, None]
    v = 0.4 * rng.normal(size=(n, 3))
    system = kd.System(
        x, v, rng.uniform(0.5, 1.5, n) / n, forces=[kd.Gravity()], units="nbody", radii=0.03,
        names=[f"b{i}" for i in range(n)],
        events=[kd.Collision(action="fragment", fragment_mass=0.1 / n, reference_density=50.0, new_bodies=5000)],
    )  # fmt: skip
    sim = kd.Simulation(system, "gauss-radau15", rtol=1e-9)
    report = sim.run(until=1.2, interval=0.02)
    done = [event["done"].partition(":")[0] for event in report.events]
    regimes = ", ".join(f"{done.count(each)} {each}" for each in dict.fromkeys(done))
    print(f"{n} bodies collapse: {len(done)} collisions ({regimes}), {len(sim.state)} bodies left", file=sys.stderr)
    masses, energy = system.state.masses, report.energy
    assert energy is not None
    changes = {
        "mass": (abs(float(sim.state.masses.sum() / masses.sum()) - 1), 1e-14),
        "volume": (abs(float((sim.system.radii**3).sum() / (system.radii**3).sum()) - 1), 1e-13),
        "momentum, of the sum of m |v|": (report.momentum_error, 1e-14),
        "angular momentum with spins": (report.angular_momentum_error, 1e-13),
        "energy with what collisions took": (energy.max_relative_error, 1e-11),
    }
    source = f"{len(done)} collisions, energy taken {report.energy_taken:.3g} of {abs(energy.initial):.3g}"
    names = {name for name in sim.system.names if "fragment" in name}
    return [
        *(
            claim(f"{n} bodies collapse: change of {key}", float(c), f"< {b:g}", float(c) < b, source)  # type: ignore[arg-type]
            for key, (c, b) in changes.items()
        ),
        claim(f"{n} bodies collapse: fragments among those left", len(names), "> 0", len(names) > 0, source),
    ]


def search() -> list[Claim]:
    """The same run by the tree and by all pairs."""
    rng = np.random.default_rng(7)
    n = 400
    system = kd.System(
        rng.uniform(-1, 1, (n, 3)), rng.normal(size=(n, 3)), rng.uniform(0.5, 2, n) / n, forces=[kd.Gravity()],
        units="nbody", radii=0.05 * rng.uniform(size=n) ** 3,
    )  # fmt: skip
    ends, events, most = [], [], contacts.ALL_PAIRS
    try:
        for each in (most, n):
            contacts.ALL_PAIRS = each
            sim = kd.Simulation(system, dt=0.01, events=[kd.Collision(action="merge")])
            events.append(sim.run(30).events)
            ends.append(sim.state.phase.tobytes())
    finally:
        contacts.ALL_PAIRS = most
    same = ends[0] == ends[1] and events[0] == events[1]
    text = f"{n} bodies searched by the tree: collisions, with the bits of the search of all pairs"
    return [claim(text, len(events[0]), f"{len(events[1])}, the same bits", same and len(events[0]) > 0, "all pairs")]


def claims(long: bool = False) -> Iterator[Claim]:
    yield from mergers()
    yield from bounces()
    yield from laws()
    yield from regimes()
    yield from example()
    yield from collapse(LONG if long else SHORT)
    yield from search()


if __name__ == "__main__":
    main(claims, __doc__)
