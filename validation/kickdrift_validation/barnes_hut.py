"""The tree's forces against the direct sum, and its time and memory against the number of particles.

    python -m kickdrift_validation.barnes_hut [--long]

``accuracy`` claims that 99 % of the particles have |a - a_direct| / |a_direct| within it. The direct sum is NumPy's,
for a random sample of the particles. Shapes: a Plummer sphere; a uniform cube; two Plummer spheres a thousand scale
lengths apart; a disc a hundred times thinner than wide.

Time is the processor's, on one thread: the least of some evaluations. Memory is the peak of the process.
"""

from __future__ import annotations

import resource
import sys
from collections.abc import Callable
from math import log
from time import process_time

import numpy as np

import kickdrift as kd
from kickdrift.forces.bound import BoundForces
from kickdrift_validation.claim import Claim, claim, largest, main

SHORT, LONG = (10**4, 10**5), (10**4, 10**5, 10**6)
ACCURACIES = (1e-2, 1e-3, 1e-4)
SAMPLE = 1000
SHARE = 0.99  # of the particles that are within the accuracy
GROWTH = 1.5  # of the time over n log n, from the smallest to the largest n
MEMORY = 4.0  # GB
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
            rows.append(claim(text, value, "at most 1", value <= 1.0, DIRECT))
    print()
    return [*rows, *growth_claims(seconds, sizes), *memory_claims(sizes)] if long else rows


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


def memory_claims(sizes: tuple[int, ...]) -> list[Claim]:
    """Peak memory of this process, which held NumPy's arrays too."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1.0 if sys.platform == "darwin" else 1024.0) / 1e9
    text = f"peak memory with {sizes[-1]} particles, GB"
    return [claim(text, peak, f"at most {MEMORY:g}", peak <= MEMORY, "the system's account of the process")]


if __name__ == "__main__":
    sys.exit(main(claims, __doc__))
