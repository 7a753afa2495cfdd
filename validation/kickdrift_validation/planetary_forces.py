"""Forces of planetary science: accelerations beside formulas and REBOUNDx, secular rates beside closed forms.

Accelerations of five bodies are held against the textbook formulas of planetary_formulas.py in 50 digits, and against
REBOUNDx where it is installed. Secular rates come from runs of few orbits by gauss-radau15. They begin and end at the
same phase of the orbit, so that the periodic changes of the elements drop out, and the forces are weak, so that
theories of first order hold. At last, the energy of a run less the work of the force must stay.
"""

import math
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np

import kickdrift as kd
from kickdrift_validation.claim import Claim, at_most, main, not_run

FORMULA, RATE = 1e-13, 1e-3
ORBITS = 10


class Elements(NamedTuple):
    """Osculating elements of one body's orbit around another."""

    a: float
    e: float
    inclination: float
    node: float
    pericentre: float  # from the node
    longitude: float  # of the pericentre in space, node and pericentre together


def elements(state: kd.State, mu: float) -> Elements:
    """Elements of body 1 around body 0, from the eccentricity vector and the angular momentum."""
    r, v = state.positions[1] - state.positions[0], state.velocities[1] - state.velocities[0]
    h = np.cross(r, v)
    vector = np.cross(v, h) / mu - r / np.linalg.norm(r)
    node = math.atan2(h[0], -h[1]) if h[0] or h[1] else 0.0
    along = np.array([math.cos(node), math.sin(node), 0.0])
    across = np.cross(h, along) / np.linalg.norm(h)
    pericentre = math.atan2(vector @ across, vector @ along)
    a = 1.0 / (2.0 / float(np.linalg.norm(r)) - float(v @ v) / mu)
    inclination = math.atan2(math.hypot(h[0], h[1]), h[2])
    return Elements(a, float(np.linalg.norm(vector)), inclination, node, pericentre, node + pericentre)


def start(
    forces: list[Any],
    masses: tuple[float, float] = (1.0, 0.0),
    e: float = 0.0,
    inclination: float = 0.0,
    pericentre: float = 0.0,
    mu: float | None = None,
    a: float = 1.0,
    **options: Any,
) -> kd.System:
    """A body at the pericentre of its orbit with the node along x, about the centre of mass. ``mu`` is G (M + m) unless
    another force changes the attraction."""
    total = sum(masses)
    mu = total if mu is None else mu
    speed = math.sqrt(mu / a * (1.0 + e) / (1.0 - e))
    turn, lean = (math.cos(pericentre), math.sin(pericentre)), (math.cos(inclination), math.sin(inclination))
    r = a * (1.0 - e) * np.array([turn[0], turn[1] * lean[0], turn[1] * lean[1]])
    v = speed * np.array([-turn[1], turn[0] * lean[0], turn[0] * lean[1]])
    shares = np.array([[-masses[1] / total], [masses[0] / total]])
    return kd.System(shares * r, shares * v, masses, forces=[kd.Gravity(), *forces], units="nbody", **options)


def changes(system: kd.System, mu: float, period: float = 2.0 * math.pi, orbits: float = ORBITS) -> Elements:
    """Mean rates of the elements over whole orbits, per unit of time."""
    before = elements(system.state, mu)
    sim = kd.Simulation(system, "gauss-radau15")
    sim.run(until=orbits * period)
    after = elements(sim.state, mu)
    return Elements(*((late - early) / (orbits * period) for early, late in zip(before, after, strict=True)))


def rate(text: str, found: float, wanted: float, source: str, bound: float = RATE) -> Claim:
    """A claim about a rate."""
    return at_most(f"{text}: {found:.6g}, relative difference", abs(found / wanted - 1.0), bound, source)


def accelerations() -> Iterator[Claim]:
    """Every force beside its formula."""
    text = "accelerations of five bodies beside the formula, relative difference"
    if find_spec("mpmath") is None:
        yield not_run(text, f"at most {FORMULA:g}", "mpmath, 50 digits")
        return
    from kickdrift_validation import planetary_formulas

    for name, formula in planetary_formulas.FORMULAS.items():
        yield at_most(f"{name}: {text}", planetary_formulas.off(name), FORMULA, f"{formula.source}; mpmath, 50 digits")


def harmonics() -> Iterator[Claim]:
    e, tilt, radius, j = 0.2, 0.7, 0.3, 1e-5
    p, s2 = 1.0 - e * e, math.sin(tilt) ** 2
    found = changes(start([kd.Oblateness(j, radius)], e=e, inclination=tilt), 1.0)
    unit, source = j * (radius / p) ** 2, "Murray & Dermott 1999, section 6.11"
    yield rate("j2: rate of the node", found.node, -1.5 * unit * math.cos(tilt), source)
    yield rate("j2: rate of the pericentre", found.pericentre, 0.75 * unit * (4.0 - 5.0 * s2), source)
    # At 45 degrees from the node, the terms with twice the argument of pericentre vanish.
    found = changes(start([kd.Oblateness(0.0, radius, j4=j)], e=e, inclination=tilt, pericentre=math.pi / 4), 1.0)
    unit, source = j * (radius / p) ** 4, "Brouwer 1959; Vallado 2013, section 9.6"
    node = 15.0 / 32.0 * unit * math.cos(tilt) * (8.0 + 12.0 * e * e - (14.0 + 21.0 * e * e) * s2)
    bracket = 64.0 + 72.0 * e * e - (248.0 + 252.0 * e * e) * s2 + (196.0 + 189.0 * e * e) * s2 * s2
    yield rate("j4: rate of the node", found.node, node, source)
    yield rate("j4: rate of the pericentre", found.pericentre, -15.0 / 128.0 * unit * bracket, source)


def relativity() -> Iterator[Claim]:
    from kickdrift.model.units.unit_systems import unit_system

    units = unit_system("astro")
    gm, c = float(units.gravity or 0.0), float(units.light or 0.0)
    a, e = 0.38709893, 0.20563069
    period = 2.0 * math.pi * math.sqrt(a**3 / gm)
    for force in (kd.PostNewtonian(), kd.EinsteinInfeldHoffmann()):
        made = start([], e=e, mu=gm, a=a)
        system = kd.System(
            made.state.positions, made.state.velocities, [1.0, 0.0], forces=[kd.Gravity(), force], units="astro"
        )
        found = math.degrees(changes(system, gm, period, 20).longitude) * 3600 * 100
        wanted = math.degrees(6 * math.pi * gm / (c * c * a * (1 - e * e)) / period) * 3600 * 100
        yield rate(f"{force.name}: Mercury's perihelion, arcseconds a century", found, wanted, "6 pi G M / (c^2 p)")
    c, masses = 1e4, (0.6, 0.4)
    found = changes(start([kd.EinsteinInfeldHoffmann(c=c)], masses, e=0.3), 1.0).longitude
    yield rate("relativity-eih: pericentre of two stars", found, 3.0 / (c * c * (1 - 0.09)), "Robertson 1938")
    spin, tilt, e = 0.3, 0.7, 0.2
    found = changes(start([kd.LenseThirring((0, 0, spin), c=1e3)], e=e, inclination=tilt), 1.0).node
    yield rate("lense-thirring: rate of the node", found, 2e-6 * spin * (1 - e * e) ** -1.5, "Lense & Thirring 1918")
    masses, e, c = (0.6, 0.4), 0.3, 20.0
    system = start([kd.RadiationReaction(c=c)], masses, e=e)
    shift = changes(system, 1.0)
    unit = masses[0] * masses[1] / c**5
    wanted = -12.8 * unit / (1 - e * e) ** 3.5 * (1 + 73 / 24 * e**2 + 37 / 96 * e**4)
    yield rate("relativity-2.5pn: rate of the semi-major axis", shift.a, wanted, "Peters 1964, eq. 5.6")
    wanted = -304 / 15 * unit * e / (1 - e * e) ** 2.5 * (1 + 121 / 304 * e**2)
    yield rate("relativity-2.5pn: rate of the eccentricity", shift.e, wanted, "Peters 1964, eq. 5.7")


def radiation() -> Iterator[Claim]:
    beta, c, e = 0.2, 1e6, 0.3
    mu = 1.0 - beta
    period = 2.0 * math.pi / math.sqrt(mu)
    found = changes(start([kd.RadiationPressure([0.0, beta], c=c)], e=e, mu=mu), mu, period)
    unit, source = beta / c, "Wyatt & Whipple 1950"
    yield rate("radiation-pressure: a", found.a, -unit * (2 + 3 * e * e) * (1 - e * e) ** -1.5, source)
    yield rate("radiation-pressure: e", found.e, -2.5 * unit * e * (1 - e * e) ** -0.5, source)
    found = changes(start([kd.NonGravitational([0.0, 1e-7], 2.0)], e=e), 1.0)
    yield rate("non-gravitational: a", found.a, 8e-7 / (1 - e * e), "Farnocchia et al. 2013")


def tides() -> Iterator[Claim]:
    """Hut's rates of a and e for tides on one body, and the apsidal motion of a tide without a lag."""
    k, radius, lag, spin, e, masses = 0.3, 0.05, 0.2, 0.5, 0.3, (0.9, 0.1)
    e2 = e * e
    f1 = 1 + 31 / 2 * e2 + 255 / 8 * e2**2 + 185 / 16 * e2**3 + 25 / 64 * e2**4
    f2 = 1 + 15 / 2 * e2 + 45 / 8 * e2**2 + 5 / 16 * e2**3
    f3 = 1 + 15 / 4 * e2 + 15 / 8 * e2**2 + 5 / 64 * e2**3
    f4 = 1 + 3 / 2 * e2 + 1 / 8 * e2**2
    f5 = 1 + 3 * e2 + 3 / 8 * e2**2
    for what, body in (("the central body", 0), ("the other body", 1)):
        own, other = masses[body], masses[1 - body]
        q, drag = other / own, k * own * lag / radius**3  # k / T
        turning = spin if body == 0 else f2 / (f5 * (1 - e2) ** 1.5)
        given = [[value if i == body else 0.0 for i in range(2)] for value in (k, lag)]
        force = kd.Tides(
            given[0], radius, given[1], [(0, 0, spin if body == 0 else 0.0), (0, 0, 0)],
            rotation=None if body == 0 else "pseudo-synchronous",
        )  # fmt: skip
        found = changes(start([force], masses, e=e), 1.0)
        rest = 1 - e2
        wanted = -6 * drag * q * (1 + q) * radius**8 * rest**-7.5 * (f1 - rest**1.5 * f2 * turning)
        yield rate(f"tides on {what}: a", found.a, wanted, "Hut 1981, eq. 9")
        wanted = -27 * drag * q * (1 + q) * radius**8 * e * rest**-6.5 * (f3 - 11 / 18 * rest**1.5 * f4 * turning)
        yield rate(f"tides on {what}: e", found.e, wanted, "Hut 1981, eq. 10")
    found = changes(start([kd.Tides([k, 0.0], radius)], masses, e=e), 1.0)
    wanted = 7.5 * k * masses[1] / masses[0] * radius**5 * (1 + 1.5 * e2 + e2 * e2 / 8) / (1 - e2) ** 5
    yield rate("tides without a lag: pericentre", found.longitude, wanted, "Sterne 1939")


def discs() -> Iterator[Claim]:
    tau, source = 1000.0, "Papaloizou & Larwood 2000: exp(-t / tau)"
    for key, options, what in (
        ("a", {}, "semi-major axis"),
        ("e", {"e": 1e-3}, "eccentricity"),
        ("inclination", {"inclination": 1e-3}, "inclination"),
    ):
        system = start([kd.Migration(**{f"tau_{key[0]}": [0.0, tau]})], **options)
        sim = kd.Simulation(system, "gauss-radau15")
        sim.run(until=tau)
        before, after = (getattr(elements(state, 1.0), key) for state in (system.state, sim.state))
        yield rate(f"migration: e-folding time of the {what}", tau / math.log(before / after), tau, source)
    edge, width = 0.8, 0.05
    system = start([kd.Migration([0.0, 200.0], edge=edge, width=width)])
    sim = kd.Simulation(system, "gauss-radau15")
    sim.run(until=300.0)
    trap = edge * (1 + width) - 4 * width * edge / (2 * math.pi) * math.acos(4.5 / 5.5)
    yield rate(
        "migration: semi-major axis where the inner edge stops a planet", elements(sim.state, 1.0).a, trap,
        "zero of the trap of Pichierri et al. 2018",
    )  # fmt: skip
    strength, headwind = 1e-2, 0.02
    found = changes(start([kd.GasDrag([0.0, strength], 1.0, headwind=headwind)]), 1.0).a
    yield rate("gas-drag: a of a circle", found, -2 * strength * headwind**2, "Adachi et al. 1976", 1e-3)


def backgrounds() -> Iterator[Claim]:
    """An isothermal sphere of circular speed 1: its potential, and its friction on a satellite."""
    sphere, light = kd.CentralPotential(-1.0, -1.0, central=0), 1e-4
    x, v = np.array([[0.0, 0, 0], [1, 0, 0]]), np.array([[0.0, 0, 0], [0, 1.0, 0]])
    masses, log = [1e9, light], 3.0
    density = 0.5 / (2.0 * math.pi)  # sigma^2 / (2 pi G r^2) with sigma^2 = v^2 / 2
    friction = kd.DynamicalFriction(density, math.sqrt(0.5), log, slope=2.0)
    sim = kd.Simulation(kd.System(x, v, masses, forces=[sphere, friction], units="nbody"), "gauss-radau15")
    until = 40.0 * math.pi
    sim.run(until=until)
    r = float(np.linalg.norm(sim.state.positions[1] - sim.state.positions[0]))
    source = "Binney & Tremaine 2008, section 8.1: r dr/dt = -0.428 G m log / v"
    factor = math.erf(1.0) - 2.0 / math.sqrt(math.pi) * math.exp(-1.0)
    yield rate("dynamical-friction: decay of r^2", (r * r - 1.0) / until, -2.0 * factor * light * log, source)
    for power in (-1.0, -1.5, 1.0):
        force = kd.CentralPotential(-1.0, power)
        sim = kd.Simulation(
            kd.System(x, v * (1 + 1e-5), [1e9, 1e-9], forces=[force], units="nbody"), "gauss-radau15"
        )  # fmt: skip
        epicycle = math.sqrt(3.0 + power)
        turns = 20
        sim.run(until=turns * 2.0 * math.pi / epicycle)
        d, u = (each[1] - each[0] for each in (sim.state.positions, sim.state.velocities))
        outward, guide = float(d @ u / np.linalg.norm(d)), float(np.cross(d, u)[2]) ** (2.0 / (3.0 + power))
        phase = math.atan2(outward / epicycle, guide - float(np.linalg.norm(d)))
        found = epicycle * (1.0 + phase / (turns * 2.0 * math.pi))
        text = f"central-potential: epicyclic over orbital frequency at power {power:g}"
        yield rate(text, found, epicycle, "sqrt(3 + power); Binney & Tremaine 2008, section 3.2")
    loss = -1e-5
    system = start([kd.MassChange([loss, 0.0])])
    sim = kd.Simulation(system, "gauss-radau15")
    sim.run(until=2000.0 * math.pi)
    mass = math.exp(loss * sim.time)
    yield rate("mass-change: a of a circle", elements(sim.state, mass).a, 1.0 / mass, "Jeans 1924: a M is constant")


def energies() -> Iterator[Claim]:
    """The energy of a run, less the work of the force, stays."""
    masses, e = (0.9, 0.1), 0.3
    for force in (
        kd.Tides(0.3, 0.1, 0.01, (0, 0, 0.5)),
        kd.RadiationReaction(c=20.0),
        kd.RadiationPressure([0.0, 1e-3], c=20.0),
        kd.NonGravitational([0.0, 1e-5], 1.0),
        kd.Migration(1e4, 1e3),
        kd.GasDrag([0.0, 1e-3], 1.0, headwind=0.3),
        kd.DynamicalFriction(1e-4, 0.7, 3.0),
        kd.MassChange(-1e-5),
    ):
        report = kd.Simulation(start([force], masses, e=e), "gauss-radau15").run(until=60.0, interval=0.02)
        assert report.energy is not None
        change = (report.energy.final - report.energy.initial) / report.energy.initial
        off, bound = report.energy.max_relative_error, 1e-11
        text = f"{force.name}: energy less work, {abs(change):.2g} of the energy taken or given; largest relative error"
        yield at_most(text, off, bound, "conservation of energy")


PARTS: tuple[Callable[[], Iterator[Claim]], ...] = (
    accelerations, harmonics, relativity, radiation, tides, discs, backgrounds, energies,
)  # fmt: skip


def claims(long: bool = False) -> Iterator[Claim]:
    for part in PARTS:
        yield from part()


if __name__ == "__main__":
    main(claims, __doc__)
