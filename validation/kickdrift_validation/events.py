"""Are events found where closed forms have them, and do collisions conserve what they must?

Pericentres of a Kepler ellipse (G (m1 + m2) = 1, semi-major axis 1, e = 0.5, from pericentre at t = 0) stand at whole
numbers of periods, 2 pi; what is found is off by the phase error of the method, which falls with the step as its order
says, and in the time of one step no interpolation adds to it. The closest point of a hyperbola with v = 1 at infinity
and impact parameter b is sqrt(1 + b^2) - 1 (Murray & Dermott 1999, Solar System Dynamics, 2.4). Mergers conserve mass,
momentum and the centre of mass. rebound (Rein & Liu 2012, doi:10.1051/0004-6361/201118085), where it is installed, runs
the same bodies with its direct collision search, which looks at the ends of steps: times differ by a step. Polynomials
with random zeros show whether every zero of an event's function is found: y' = 1, and the event is a polynomial of y,
so that the solution is exact in steps of any length.
"""

import math
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from time import perf_counter

import numpy as np

import kickdrift as kd
from kickdrift.integrators import integrator
from kickdrift_validation.claim import Claim, claim, largest, main, not_run
from kickdrift_validation.problems import kepler
from kickdrift_validation.rebounds import simulation

SHORT, LONG, ECCENTRICITY = 200, 1000, 0.5  # orbits
STEPS = {"velocity-verlet": 400, "blanes-moan4": 400, "yoshida8": 200}  # in a period
ADAPTIVE = {"dop853": 1e-13}
KEPLER = "whole numbers of periods"
ORDER = 0.1  # of the slope of the error of a pericentre's time
MERGERS = 100
REBOUND_DT, REBOUND_TIME = 1e-3, 1.5
POLYNOMIALS = 200, 1000  # of the short and of the long set
STEPPED = {"rk4": "dt", "velocity-verlet": "dt", "dormand-prince45": "max_step", "dop853": "max_step"}
SOLVED = {**STEPPED, "gauss-radau15": "max_step", "rosenbrock": "max_step", "Radau": "max_step", "LSODA": "max_step"}
SPAN = 1.1  # zeros lie between -1 and 1
EPSILON = float(np.finfo(float).eps)


def ellipse() -> kd.System:
    masses = np.array([0.75, 0.25])
    r, v = kepler(0.0, ECCENTRICITY)
    shares = np.array([-masses[1], masses[0]])[:, None]
    return kd.System(shares * r, shares * v, masses=masses, forces=[kd.Gravity()], units="nbody")


def hyperbola(b: float, distance: float) -> tuple[kd.System, float, float]:
    """Two bodies on the way in, the closest point that they will reach, and the time until then."""
    e = math.sqrt(1 + b * b)
    anomaly = -math.acosh((distance + 1) / e)  # r = e cosh F - 1 and t = e sinh F - F, with G M = 1 and a = -1
    c, s = math.cosh(anomaly), math.sinh(anomaly)
    r = np.array([e - c, b * s, 0.0])
    v = np.array([-s, b * c, 0.0]) / (e * c - 1)
    shares = np.array([-0.25, 0.75])[:, None]
    system = kd.System(shares * r, shares * v, masses=[0.75, 0.25], forces=[kd.Gravity()], units="nbody")
    return system, e - 1, anomaly - e * s


def cloud(n: int, seed: int, G: float, radius: float) -> kd.System:
    rng = np.random.default_rng(seed)
    x, v = rng.uniform(-1, 1, (n, 3)), rng.normal(size=(n, 3))
    masses = rng.uniform(0.5, 2, n)
    radii = rng.uniform(0.5 * radius, radius, n)
    return kd.System(x, v, masses, forces=[kd.Gravity(G=G)], units="nbody", radii=radii)


def apart(system: kd.System) -> bool:
    """Whether no two bodies overlap."""
    x, r = system.state.positions, system.radii
    gaps = np.linalg.norm(x[:, None] - x, axis=2) - r[:, None] - r
    return bool((gaps[np.triu_indices(len(r), 1)] > 0).all())


def pericentre_errors(name: str, orbits: int, **options: float) -> np.ndarray:
    """Errors of the times of the pericentres, in periods."""
    sim = kd.Simulation(ellipse(), name, **options, events=[kd.Crossing.pericentre(1, 0)])
    end = (orbits + 0.3) * 2 * math.pi
    if sim.method.chooses_steps:
        sim.run(until=end)
    else:
        sim.run(math.ceil(end / options["dt"]))
    times = np.array([event["time"] for event in sim.events])[:orbits] / (2 * math.pi)
    if len(times) < orbits:
        return np.full(1, np.inf)
    return times - np.arange(1, orbits + 1)


def pericentres(orbits: int) -> list[Claim]:
    claims = []
    for name, steps in STEPS.items():
        began = perf_counter()
        dt = 2 * math.pi / (steps + 0.37)  # step points fall elsewhere in every orbit
        errors = pericentre_errors(name, orbits, dt=dt)
        halved = pericentre_errors(name, 20, dt=dt / 2)
        slope = float(np.log2(np.abs(errors[:20]).max() / np.abs(halved).max()))
        order = integrator(name).order
        print(
            f"{name}: {steps} steps a period, {orbits} pericentres, largest error {np.abs(errors).max():.2e} periods "
            f"({np.abs(errors[0]):.1e} at the first one), {perf_counter() - began:.1f} s",
            file=sys.stderr,
        )
        claims.append(
            claim(f"{name}: slope of the error of a pericentre's time", slope, f"{order} ± {ORDER}",
                  abs(slope - order) < ORDER, KEPLER)
        )  # fmt: skip
        # Phase errors of a symplectic method grow as t: each pericentre is late by as much as the one before.
        steady = float(np.abs(errors - errors[0] * np.arange(1, len(errors) + 1)).max() / np.abs(errors).max())
        claims.append(
            claim(f"{name}: departure from equal delays, of the last one", steady, "< 0.1", steady < 0.1, KEPLER)
        )
    for name, rtol in ADAPTIVE.items():
        errors = pericentre_errors(name, orbits // 10, rtol=rtol, atol=rtol)
        worst = float(np.abs(errors).max())
        text = f"{name}, rtol {rtol:g}: largest error of {orbits // 10} pericentres / periods"
        claims.append(claim(text, worst, "< 1e-8", worst < 1e-8, KEPLER))
    return claims


def flybys() -> list[Claim]:
    claims = []
    for b in (0.1, 1.0, 5.0):
        system, closest, when = hyperbola(b, 50.0)
        watched = [kd.CloseApproach(2 * closest)]
        sim = kd.Simulation(system, "dop853", rtol=1e-13, atol=1e-13, events=watched)
        sim.run(until=2 * when)
        (event,) = sim.events
        error = largest(abs(event["distance"] / closest - 1), abs(event["time"] / when - 1))
        text = f"closest point of a hyperbola, b = {b:g}: relative error of distance and time"
        claims.append(claim(text, error, "< 1e-9", error < 1e-9, "sqrt(1 + b^2) - 1"))
    system = kd.System(
        [[-1e4, 0, 0], [1e4, 1e-3, 0]], [[1e4, 0, 0], [-1e4, 0, 0]], forces=[kd.Gravity(G=1e-12)], units="nbody"
    )
    (event,) = kd.Simulation(system, dt=3.0, events=[kd.CloseApproach(0.01)]).run(1).events
    error = abs(event["distance"] / 1e-3 - 1)
    text = "a flyby that takes 1e-7 of a step: relative error of the distance"
    claims.append(claim(text, error, "< 1e-6", error < 1e-6, "a straight line"))
    return claims


def mergers() -> list[Claim]:
    system = cloud(300, 7, 1e-4, 0.07)
    masses, x, v = system.state.masses, system.state.positions, system.state.velocities
    sim = kd.Simulation(system, dt=0.01, events=[kd.Collision()])
    while len(sim.events) < MERGERS and sim.time < 20:
        sim.run(10)
    left = sim.state
    scale = float(masses @ np.linalg.norm(v, axis=1))
    changes = {
        "mass": abs(left.masses.sum() / masses.sum() - 1),
        "momentum, of the sum of m |v|": np.abs(left.masses @ left.velocities - masses @ v).max() / scale,
        "volume": abs((sim.system.radii**3).sum() / (system.radii**3).sum() - 1),
    }
    bound = 100 * EPSILON
    source = f"{len(sim.events)} mergers of {len(system)} bodies"
    claims = [claim(f"change of {key}", float(c), f"< {bound:.1e}", c < bound, source) for key, c in changes.items()]
    centre = masses @ x + (masses @ v) * sim.time
    moved = float(np.abs(left.masses @ left.positions - centre).max() / (masses @ np.linalg.norm(x, axis=1)))
    claims.append(claim("the centre of mass leaves its straight line by", moved, "< 1e-13", moved < 1e-13, source))
    error = sim.report().energy.max_relative_error
    text = "energy error where what mergers took is booked"
    claims.append(claim(text, error, "< 1e-4", error < 1e-4, f"{sim.report().energy_taken:.3g} taken"))
    return claims


def against_rebound() -> list[Claim]:
    text = "same bodies as rebound's direct search"
    if find_spec("rebound") is None:
        return [not_run(text, "as many are left, as near as a step", "rebound")]
    import rebound

    claims = []
    for action, resolve in (("merge", "merge"), ("bounce", "hardsphere")):
        # Of bodies that overlap at the start and go apart, ours merge and rebound's do not.
        system = next(each for seed in range(11, 1000) if apart(each := cloud(24, seed, 1e-3, 0.12)))
        if action == "bounce":
            system = kd.System(
                [[-1, 0, 0], [1, 0.04, 0.02]], [[1, 0, 0], [-1, 0, 0]], [2, 1], forces=[kd.Gravity(G=1e-3)],
                units="nbody", radii=[0.06, 0.05],
            )  # fmt: skip
        theirs = simulation(system, "leapfrog", REBOUND_DT, 1e-3)
        theirs.collision, theirs.collision_resolve = "direct", resolve
        theirs.integrate(REBOUND_TIME, exact_finish_time=0)
        ours = kd.Simulation(system, "leapfrog-dkd", REBOUND_DT, events=[kd.Collision(action=action)])
        ours.run(until=REBOUND_TIME)
        order = np.argsort([p.m for p in theirs.particles])
        masses = np.array([p.m for p in theirs.particles])[order]
        x = np.array([[p.x, p.y, p.z] for p in theirs.particles])[order]
        own = np.argsort(ours.state.masses)
        same = len(masses) == len(own) and np.allclose(masses, ours.state.masses[own], rtol=1e-13)
        source = f"rebound {rebound.__version__}, {resolve}, {len(ours.events)} collisions"
        claims.append(claim(f"{action}: {text} are left", len(own), f"{len(masses)}", same, source))
        off = float(np.abs(x - ours.state.positions[own]).max()) if same else math.inf
        bound = 20 * REBOUND_DT  # of a step's way and the turn of the line of centres that it makes
        claims.append(claim(f"{action}: largest difference of a position", off, f"< {bound:g}", off < bound, source))
    return claims


def random_zeros(rng: np.random.Generator) -> np.ndarray:
    """Three to nine zeros between -1 and 1, not nearer than 1e-4."""
    while True:
        zeros = np.sort(rng.uniform(-1, 1, int(rng.integers(3, 10))))
        if np.diff(zeros).min() > 1e-4:
            return zeros


def solved_zeros(zeros: np.ndarray, method: str, longest: float, way: float) -> np.ndarray:
    """Times at which kd.solve finds the zeros of a polynomial, in the order found."""
    options = {SOLVED[method]: longest, "separable": method == "velocity-verlet"}
    slope, start = [way], [-SPAN]
    if options["separable"]:  # y is the position, and the velocity stays as it is
        slope, start = [0.0, 0.0], [-SPAN, way]
    f = _line if options["separable"] else _grown
    found = kd.solve(
        f, (-way * SPAN, way * SPAN), start, method, args=(np.array(slope),), **options,
        events=lambda t, y, slope: float(np.prod(way * y[0] - zeros)),
    )  # fmt: skip
    return found.t_events[0]


def _grown(t, y, slope):
    return slope


def _line(t, y, slope):
    return np.array([y[1], 0.0])


def watched_zeros(zeros: np.ndarray, method: str, longest: float) -> np.ndarray:
    """Times at which a `Crossing` finds the zeros of a polynomial of a free body's position."""
    system = kd.System([[-SPAN, 0, 0]], [[1.0, 0, 0]], forces=[kd.Gravity()], units="nbody")
    watched = [kd.Crossing(lambda t, x, v: float(np.prod(x[0, 0] - zeros)), "zero")]
    sim = kd.Simulation(system, method, **{STEPPED[method]: longest}, events=watched)
    if sim.method.chooses_steps:
        sim.run(until=2 * SPAN)
    else:
        sim.run(math.ceil(2 * SPAN / longest))
    times = np.array([event["time"] for event in sim.events]) - SPAN
    return times[times < SPAN]


def polynomial_errors(count: int, seed: int) -> tuple[int, float]:
    """Number of random polynomials of which kickdrift finds another number of zeros; the largest error of a time, as a
    part of the longest step that is allowed."""
    rng, missed, worst = np.random.default_rng(seed), 0, 0.0
    for k in range(count):
        zeros, longest = random_zeros(rng), min(10 ** rng.uniform(-1.7, 0.5), 2 * SPAN)
        if k % 3:
            way = float(rng.choice([-1.0, 1.0]))
            found = np.sort(solved_zeros(zeros, str(rng.choice(list(SOLVED))), longest, way))
        else:
            found = watched_zeros(zeros, str(rng.choice(list(STEPPED))), longest)
        if len(found) != len(zeros):
            missed += 1
        else:
            worst = max(worst, float(np.abs(found - zeros).max()) / longest)
    return missed, worst


def polynomials(count: int) -> list[Claim]:
    missed, worst = polynomial_errors(count, 37)
    text, source = f"of {count} polynomials of degree 3 to 9", "their zeros"
    return [
        claim(f"{text}, zeros missed or found twice in", missed, "0", missed == 0, source),
        claim(f"{text}, largest error of a zero / step", worst, "< 1e-12", worst < 1e-12, source),
    ]


def claims(long: bool = False) -> Iterator[Claim]:
    yield from pericentres(LONG if long else SHORT)
    yield from flybys()
    yield from mergers()
    yield from polynomials(POLYNOMIALS[long])
    yield from against_rebound()


if __name__ == "__main__":
    main(claims, __doc__)
