"""Ring particles that bounce in a patch with shear-periodic boundaries: laws of one bounce, and a ring beside rebound.

The ring follows Wisdom & Tremaine 1988, doi:10.1086/114690: equal spheres without self-gravity, the restitution of
frosty ice (Bridges, Hatzes & Lin 1984), and a patch that repeats along x and y. Both programs start from the same
positions and velocities, and the means over replicas differ by some standard errors at most. The papers on such rings
show graphs, and no numbers could be checked against them; ring_thermal.py has a published number for another ring.
"""

import math
from typing import NamedTuple

import numpy as np

import kickdrift as kd
from kickdrift_validation.claim import Claim, claim

OMEGA = 1.3143527e-4  # 1/s, of rebound's example of a shearing sheet
RADIUS = 1.0  # m
ORBIT = 2 * math.pi / OMEGA
RUNS = "rebound: sei, shear boundaries, hard spheres"
STEPS = 2000  # of rebound in an orbit: twice as many as in its example, since it bounces at the ends of steps
ERRORS = 4.0  # standard errors


class Ring(NamedTuple):
    """Positions and velocities of particles at the start, and the side of their patch."""

    x: np.ndarray
    v: np.ndarray
    side: float


class Measures(NamedTuple):
    """Means over time of one run."""

    dispersion_x: float  # over Omega R
    dispersion_y: float
    dispersion_z: float
    filling: float  # part of the midplane inside particles
    collisions: float  # of a particle, in an orbit


def ring(n: int, depth: float, seed: int) -> Ring:
    """Particles at random places without overlap, at an optical depth n pi R^2 / (area of the patch)."""
    rng = np.random.default_rng(seed)
    side, height = math.sqrt(n * math.pi / depth) * RADIUS, 4.0 * max(1.0, depth) * RADIUS
    found = np.zeros((0, 3))
    while len(found) < n:
        place = rng.uniform(-0.5, 0.5, 3) * (side, side, 2 * height)
        apart = found - place
        apart[:, :2] -= side * np.round(apart[:, :2] / side)
        if ((apart**2).sum(axis=1) > 4.04 * RADIUS**2).all():
            found = np.vstack([found, place])
    v = rng.normal(0.0, 3.0 * OMEGA * RADIUS, (n, 3))
    v[:, 1] -= 1.5 * OMEGA * found[:, 0]
    return Ring(found, v, side)


class Mean:
    """Sums of a run's measures over samples."""

    def __init__(self, start: Ring) -> None:
        self._area, self._squares, self._filling, self._count = start.side**2, np.zeros(3), 0.0, 0

    def add(self, x: np.ndarray, v: np.ndarray) -> None:
        """Take positions and velocities (n, 3)."""
        own = v + 1.5 * OMEGA * np.outer(x[:, 0], [0.0, 1.0, 0.0])
        self._squares += own.var(axis=0)
        self._filling += float(np.clip(RADIUS**2 - x[:, 2] ** 2, 0.0, None).sum()) * math.pi / self._area
        self._count += 1

    def result(self, collisions: float) -> Measures:
        """The means, with so many collisions of a particle in an orbit."""
        return Measures(
            *(np.sqrt(self._squares / self._count) / (OMEGA * RADIUS)).tolist(), self._filling / self._count, collisions
        )


def here(start: Ring, relax: int, orbits: int) -> Measures:
    """Means of kickdrift's run after so many orbits, over so many."""
    n, mean = len(start.x), Mean(start)
    system = kd.System(
        start.x, start.v, masses=np.ones(n), radii=np.full(n, RADIUS), units="si",
        forces=[kd.Hill(OMEGA), kd.GravitySheet(OMEGA, start.side, start.side, G=0.0)],
    )  # fmt: skip
    bounce = kd.Collision(action="bounce", restitution="bridges")
    sim = kd.Simulation(system, "sei", dt=ORBIT / 200, events=[bounce])
    sim.run(200 * relax, every=200 * relax)
    report = sim.run(
        200 * orbits, every=10, observe=lambda sim: mean.add(sim.state.positions, sim.state.velocities)
    )  # fmt: skip
    bounces = sum(event["time"] > relax * ORBIT for event in report.events)
    return mean.result(2.0 * bounces / n / orbits)


def there(start: Ring, relax: int, orbits: int) -> Measures:
    import rebound

    n, mean = len(start.x), Mean(start)
    sim = rebound.Simulation()
    sim.G, sim.OMEGA, sim.integrator, sim.dt = 0.0, OMEGA, "sei", ORBIT / STEPS
    sim.root_size = start.side
    sim.boundary, sim.gravity, sim.collision, sim.collision_resolve = "shear", "none", "direct", "hardsphere"
    sim.N_ghost_x = sim.N_ghost_y = sim.rand_seed = 1  # the order of collisions in a step is random
    sim.coefficient_of_restitution = lambda _, speed: min(1.0, 0.32 * max(abs(speed) * 100, 1e-9) ** -0.234)
    for x, v in zip(start.x, start.v, strict=True):
        sim.add(m=1.0, r=RADIUS, x=x[0], y=x[1], z=x[2], vx=v[0], vy=v[1], vz=v[2])
    sim.steps(STEPS * relax)
    before = sim.collisions_log_n
    for _ in range(20 * orbits):
        sim.steps(STEPS // 20)
        mean.add(np.array([p.xyz for p in sim.particles]), np.array([p.vxyz for p in sim.particles]))
    return mean.result(2.0 * (sim.collisions_log_n - before) / n / orbits)


def beside_rebound(n: int, depth: float, replicas: int, relax: int, orbits: int) -> list[Claim]:
    """Means of the two programs over replicas, for particles at an optical depth."""
    starts = [ring(n, depth, seed) for seed in range(replicas)]
    ours, theirs = (np.array([run(start, relax, orbits) for start in starts]) for run in (here, there))
    rows, names = [], ("c_x / (Omega R)", "c_y / (Omega R)", "c_z / (Omega R)", "filling factor of the midplane",
                       "collisions of a particle in an orbit")  # fmt: skip
    for k, name in enumerate(names):
        (a, b), (u, w) = zip(*((each[:, k].mean(), each[:, k].std(ddof=1)) for each in (ours, theirs)), strict=True)
        error = math.sqrt((u**2 + w**2) / replicas)
        text = (
            f"ring at depth {depth:g}, {n} particles, {replicas} replicas, {orbits} orbits: {name} {a:.4g} here and "
            f"{b:.4g} there; difference in standard errors of {error:.2g}"
        )
        off = abs(a - b) / error
        rows.append(claim(text, float(off), f"at most {ERRORS:g}", off <= ERRORS, RUNS))
    return rows


def flight(x: np.ndarray, v: np.ndarray, time: float) -> tuple[np.ndarray, np.ndarray]:
    """Hill's motion in closed form with Omega = 1: positions and velocities (..., 3) after a time."""
    c, s = math.cos(time), math.sin(time)
    centre = 4 * x[..., 0] + 2 * v[..., 1]
    apart = (x[..., 0] - centre) * c + v[..., 0] * s
    speed = v[..., 0] * c - (x[..., 0] - centre) * s
    along = x[..., 1] - 2 * v[..., 0] - 1.5 * centre * time + 2 * speed
    upright, rise = x[..., 2] * c + v[..., 2] * s, v[..., 2] * c - x[..., 2] * s
    return (
        np.stack([centre + apart, along, upright], axis=-1),
        np.stack([speed, -1.5 * centre - 2 * apart, rise], axis=-1),
    )


def one_bounce() -> list[Claim]:
    """Two bodies that meet across the outer boundary, in another row of images, beside a closed form."""
    width, length, restitution, masses = 10.0, 14.0, 0.6, np.array([2.0, 3.0])
    shear, when = np.array([0.0, -1.5 * width, 0.0]), 0.5
    way = np.array([0.8, 0.5, 0.33]) / np.linalg.norm([0.8, 0.5, 0.33])
    met = np.array([[4.7, 6.0, 0.1], [4.7, 6.0, 0.1] + 0.9 * way - (width, length, 0.0) - shear * when])
    speeds = np.array([[0.5, -6.9, 0.2], [-0.6, -7.5, 0.1] - shear])
    x, v = flight(met, speeds, -when)
    forces = [kd.Hill(1.0), kd.GravitySheet(1.0, width, length, G=0.0)]
    system = kd.System(x, v, masses=masses, radii=[0.5, 0.4], forces=forces, units="nbody")
    sim = kd.Simulation(system, "sei", dt=0.01, events=[kd.Collision(action="bounce", restitution=restitution)])
    report = sim.run(150, every=150)
    (event,) = report.events
    time = event["time"]
    (x_i, x_j), (v_i, v_j) = flight(x, v, time)
    rows = round((x_i - x_j - shear * time)[1] / length)
    normal = x_i - x_j - (width, rows * length, 0.0) - shear * time
    touch = abs(float(np.linalg.norm(normal)) - 0.9)
    normal /= np.linalg.norm(normal)
    approach = float((v_i - v_j - shear) @ normal)
    impulse = -(1 + restitution) * approach * masses[0] * masses[1] / masses.sum() * normal
    after = np.array([v_i + impulse / masses[0], v_j - impulse / masses[1]])
    there, _ = flight(np.array([x_i, x_j]), after, 1.5 - time)
    off = float(np.abs(sim.state.positions - there).max())
    lost = 0.5 * masses[0] * masses[1] / masses.sum() * (1 - restitution**2) * approach**2
    energy = abs(event["energy"] - (lost - float(impulse @ shear))) / lost
    return [
        claim("bounce across the boundary: distance of the centres less the radii", touch, "at most 1e-12",
              touch <= 1e-12, "closed form"),
        claim("positions some time after the bounce", off, "at most 1e-12", off <= 1e-12, "closed form"),
        claim("energy in the log: loss of the normal motion, less the work of the shear; relative error", energy,
              "at most 1e-11", energy <= 1e-11, "closed form"),
    ]  # fmt: skip


def centre_of_mass(orbits: int = 4) -> Claim:
    """Bounces keep the momentum, so the centre of mass of a whole ring goes on along its epicycle."""
    start = ring(40, 0.5, 1)
    masses, x, v = np.linspace(1.0, 2.0, 40), start.x / RADIUS, start.v / (OMEGA * RADIUS)
    forces = [kd.Hill(1.0), kd.GravitySheet(1.0, start.side, start.side, G=0.0)]
    system = kd.System(x, v, masses=masses, radii=np.ones(40), forces=forces, units="nbody")
    sim = kd.Simulation(system, "sei", dt=0.03, events=[kd.Collision(action="bounce", restitution=0.9)])
    steps = round(2 * math.pi * orbits / 0.03)
    report = sim.run(steps, every=steps)
    share = masses / masses.sum()
    there, _ = flight(share @ x, share @ v, steps * 0.03)
    off = float(np.abs(share @ sim.state.positions - there).max())
    return claim(f"centre of mass of a ring after {len(report.events)} bounces in {orbits} orbits, beside its epicycle",
                 off, "at most 1e-10", off <= 1e-10, "closed form")  # fmt: skip
