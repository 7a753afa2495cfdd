"""The tree's forces against the direct sum, and its time and memory against the number of particles.

``accuracy`` claims that 99 % of the particles have |a - a_direct| / |a_direct| within it. The direct sum is NumPy's,
for a random sample of the particles. Shapes: a Plummer sphere; a uniform cube; two Plummer spheres a thousand scale
lengths apart; a disc a hundred times thinner than wide.

Momentum: the sum of all forces over the sum of their sizes, as the two forces of a pair are not exactly opposite.
Energy: a Plummer sphere of 4096 stars over crossing times, beside the same run with the direct sum.

The long set adds time, memory and rebound's tree. Time is the processor's, on one thread: the least of some
evaluations. rebound's opening angle is one at which its root mean square error is no smaller than ours. Its particles
come in Morton's order, which more than doubles its speed. Memory is the peak of a process of its own for 10^6
particles, and for 10^7 (half an hour of one core, all in all).
"""

import subprocess
import sys
from collections.abc import Callable, Iterator
from ctypes import byref
from math import inf, log
from time import process_time

import numpy as np

import kickdrift as kd
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.model.starts.plummer import plummer as plummer_stars
from kickdrift_validation.claim import Claim, at_most, claim, largest, main, not_run
from kickdrift_validation.performance.bodies import morton_order

SHORT, LONG = (10**4, 10**5), (10**4, 10**5, 10**6)
ACCURACIES = (1e-2, 1e-3, 1e-4)
SAMPLE = 1000
SHARE = 0.99  # of the particles that are within the accuracy
GROWTH = 1.5  # of the time over n log n, from the smallest to the largest n
MEMORY = {10**6: 1.0, 10**7: 10.0}  # GB
REBOUND_ANGLE, REBOUND_RATIO = 0.5, 5.0  # its opening angle, and how many times as fast ours is to be
CROSSING = 2 * 2**0.5  # the crossing time of a Plummer sphere with energy -1/4
STARS, SOFTENING, STEP = 4096, 0.05, 1 / 64
ENERGY = 1e-4  # how much larger the tree's error of the energy may be than the direct sum's
DIRECT = "direct sum in NumPy"


def plummer(n: int, rng: np.random.Generator) -> np.ndarray:
    """A Plummer sphere of scale length 1 (Aarseth, Hénon & Wielen 1974, A&A 37, 183)."""
    direction = rng.normal(size=(n, 3))
    r = 1.0 / np.sqrt(rng.uniform(size=n) ** (-2 / 3) - 1.0)
    return (r / np.linalg.norm(direction, axis=1))[:, None] * direction


def cube(n: int, rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(size=(n, 3))


def two_clusters(n: int, rng: np.random.Generator) -> np.ndarray:
    return plummer(n, rng) + np.where(np.arange(n) < n // 2, 0.0, 1000.0)[:, None] * np.array([1.0, 0.0, 0.0])


def disc(n: int, rng: np.random.Generator) -> np.ndarray:
    r, angle = np.sqrt(rng.uniform(0.01, 1.0, n)), rng.uniform(0, 2 * np.pi, n)
    return np.stack([r * np.cos(angle), r * np.sin(angle), 0.01 * rng.normal(size=n)], axis=1)


SHAPES: dict[str, Callable[[int, np.random.Generator], np.ndarray]] = {
    "Plummer sphere": plummer,
    "uniform cube": cube,
    "two far clusters": two_clusters,
    "thin disc": disc,
}


def direct_sum(x: np.ndarray, masses: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """(3, k) accelerations of the chosen particles, G = 1."""
    a = np.empty((3, len(chosen)))
    for k, i in enumerate(chosen):
        d = x - x[i]
        r2 = np.einsum("ij,ij->i", d, d)
        r2[i] = 1.0
        a[:, k] = (masses / (r2 * np.sqrt(r2))) @ d
    return a


def evaluated(x: np.ndarray, masses: np.ndarray, force: object, repeats: int) -> tuple[np.ndarray, float]:
    """(3, n) accelerations, and the least time of an evaluation."""
    system = kd.System(x, masses=masses, forces=[force], units="nbody")
    bound, times = BoundForces(system), []
    for _ in range(repeats):
        began = process_time()
        derivative = bound.derivative(0.0, system.state.phase)
        times.append(process_time() - began)
    return derivative[1], min(times)


def claims(long: bool = False) -> list[Claim]:
    """Print the tables, and judge; time and memory in the long set only."""
    sizes = LONG if long else SHORT
    print("errors over the accuracy asked; processor time of one evaluation, one thread\n")
    print("| shape            |       n | accuracy | mean  | 50 %  | 99 %  | largest |  seconds |")
    print("| ---              |     --- | ---      | ---   | ---   | ---   | ---     |      --- |")
    rng, rows, seconds = np.random.default_rng(1), [], {}
    evaluated(cube(100, rng), np.ones(100), kd.GravityTree(), 1)  # compiles
    for name, shape in SHAPES.items():
        worst = dict.fromkeys(ACCURACIES, 0.0)
        for n in sizes:
            x, masses = shape(n, rng), np.full(n, 1.0 / n)
            chosen = np.sort(rng.choice(n, min(SAMPLE, n), replace=False))
            exact = direct_sum(x, masses, chosen)
            for accuracy in ACCURACIES:
                a, seconds[name, n, accuracy] = evaluated(x, masses, kd.GravityTree(accuracy), 3 if n < 10**6 else 1)
                errors = np.linalg.norm(a[:, chosen] - exact, axis=0) / np.linalg.norm(exact, axis=0) / accuracy
                worst[accuracy] = largest(worst[accuracy], float(np.quantile(errors, SHARE)))
                middle, tail = np.quantile(errors, [0.5, SHARE])
                print(
                    f"| {name:16} | {n:7} | {accuracy:8g} | {errors.mean():5.3f} | {middle:5.3f} | {tail:5.3f} | "
                    f"{errors.max():7.3f} | {seconds[name, n, accuracy]:8.3f} |",
                    flush=True,
                )
        for accuracy, value in worst.items():
            text = f"{name}: 99 % of the errors at accuracy {accuracy:g} are under this much of it"
            rows.append(at_most(text, value, 1.0, DIRECT))
    print()
    rows += energy_claims(10 if long else 2)
    return [*rows, *growth_claims(seconds, sizes), *rebound_claims(sizes[-1]), *memory_claims()] if long else rows


def energy_claims(crossings: int) -> list[Claim]:
    """A Plummer sphere by the tree and by the direct sum."""
    x, v, masses = plummer_stars(STARS, seed=1)
    errors, rows = [], []
    for force in (kd.GravityTree(softening=SOFTENING), kd.Gravity(softening=SOFTENING)):
        system = kd.System(x, v, masses, forces=[force], units="nbody")
        sim = kd.Simulation(system, "leapfrog", dt=STEP)
        begin = sim.energy().total
        sim.run(round(crossings * CROSSING / STEP))
        errors.append(abs(sim.energy().total / begin - 1.0))
        a = sim.accelerations()
        imbalance = float(np.linalg.norm(a.sum(axis=0)) / np.linalg.norm(a, axis=1).sum())
        if not rows:
            text = f"{STARS} stars: sum of the forces over the sum of their sizes, accuracy 0.001"
            rows.append(claim(text, imbalance, "at most 1e-4", imbalance <= 1e-4, "the sum of opposite forces is 0"))
    text = f"{STARS} stars over {crossings} crossing times: relative energy error, accuracy 0.001"
    bound = errors[1] + ENERGY
    beside = f"the same run with the direct sum: {errors[1]:.1e}"
    return [*rows, claim(text, errors[0], f"at most {bound:.1e}", errors[0] <= bound, beside)]


def rebound_claims(n: int) -> list[Claim]:
    """rebound's tree on a Plummer sphere: one evaluation of all forces, at the same error."""
    rng = np.random.default_rng(2)
    x, masses = plummer(n, rng), np.full(n, 1.0 / n)
    x = x[morton_order(x)]
    chosen = np.sort(rng.choice(n, SAMPLE, replace=False))
    exact = direct_sum(x, masses, chosen)
    a, seconds = evaluated(x, masses, kd.GravityTree(1e-2), 2)
    try:
        theirs, taken = by_rebound(x, masses, chosen)
    except ImportError:
        bound = f"at least {REBOUND_RATIO:g}"
        return [not_run(f"{n} stars: speed over rebound's tree", bound, "rebound", "pip install rebound")]
    ours, other = (
        float(np.sqrt(np.mean(((each - exact) ** 2).sum(axis=0) / (exact**2).sum(axis=0))))
        for each in (a[:, chosen], theirs)
    )
    value = taken / seconds
    text = f"{n} stars, one thread: speed over rebound's tree; rms errors {ours:.1e} and {other:.1e}"
    met = value >= REBOUND_RATIO and ours <= other
    return [claim(text, value, f"at least {REBOUND_RATIO:g}", met, f"rebound, opening angle {REBOUND_ANGLE}")]


def by_rebound(x: np.ndarray, masses: np.ndarray, chosen: np.ndarray) -> tuple[np.ndarray, float]:
    """(3, k) accelerations of the chosen particles by rebound's tree, and its time."""
    import rebound

    sim = rebound.Simulation()
    sim.root_size, sim.gravity, sim.opening_angle2 = 3.0 * float(np.abs(x).max()), "tree", REBOUND_ANGLE**2
    body = rebound.Particle()
    for m, place in zip(masses, x, strict=True):
        body.m, (body.x, body.y, body.z) = m, place
        sim.add(body)
    began = process_time()
    rebound.clibrebound.reb_simulation_update_acceleration(byref(sim))
    taken = process_time() - began
    bodies = sim.particles
    return np.array([[bodies[int(i)].ax, bodies[int(i)].ay, bodies[int(i)].az] for i in chosen]).T, taken


def growth_claims(seconds: dict[tuple[str, int, float], float], sizes: tuple[int, ...]) -> list[Claim]:
    """Time over n log n of the largest system against that of the smallest; of all but the disc, which is a plane to
    10^4 particles and has depth to 10^6."""
    rows = []
    low, high = sizes[0], sizes[-1]
    for name in list(SHAPES)[:-1]:
        t = [seconds[name, n, 1e-3] for n in (low, high)]
        slope = log(t[1] / t[0]) / log(high / low)
        value = t[1] / (high * log(high)) / (t[0] / (low * log(low)))
        text = f"{name}: time over n log n at {high} over that at {low}, accuracy 0.001; t ~ n^{slope:.3f}"
        law = log(high * log(high) / (low * log(low))) / log(high / low)
        rows.append(claim(text, value, f"at most {GROWTH}", value <= GROWTH, f"n log n is n^{law:.3f} here"))
    return rows


RUN = """
import resource, sys
import numpy as np
import kickdrift as kd
from kickdrift_validation.barnes_hut import plummer
n = int(sys.argv[1])
x = plummer(n, np.random.default_rng(1))
system = kd.System(x, masses=1 / n, forces=[kd.GravityTree(1e-2, 0.01)], units="nbody")
kd.Simulation(system, "leapfrog", dt=1e-3).run(2)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


def memory_claims() -> Iterator[Claim]:
    """Peak memory of two steps and their report, in processes of their own."""
    for n, most in {1000: inf, **MEMORY}.items():  # the first compiles, which takes memory too
        ran = subprocess.run([sys.executable, "-c", RUN, str(n)], capture_output=True, text=True, check=True)
        peak = int(ran.stdout) * (1.0 if sys.platform == "darwin" else 1024.0) / 1e9
        if n not in MEMORY:
            continue
        text = f"{n} stars, two steps with a report: peak memory, GB"
        yield at_most(text, peak, most, "the system's account of the process")


if __name__ == "__main__":
    main(claims, __doc__)
