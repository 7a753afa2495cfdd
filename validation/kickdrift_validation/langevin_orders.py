"""Strong and weak order of every Langevin word: slopes of the differences between a step and half of it.

Two runs have the same noise, one with the step dt and one with dt / 2 and noise="refine". The root mean square of the
difference of their paths at a time T goes as dt to the strong order, the difference of their means as dt to the weak
order. Both are measured from many independent copies, with one start for all: oscillators, double wells, and
Lennard-Jones dimers. Since the two runs differ little, so do the errors of the differences of their means.

Theory. One normal number for each step cannot give more than strong order 1 (Clark & Cameron 1980,
doi:10.1007/BFb0004007), and every splitting with additive noise has that order (Milstein & Tretyakov 2021,
doi:10.1007/978-3-030-82040-4). Words that read the same from both ends have weak order 2 (Leimkuhler, Matthews & Stoltz
2016, doi:10.1093/imanum/dru056). baoa is baoab begun and ended half a kick later, which changes means at a given time
by a term of order 1, and means in the long run by none. Positions of brownian hold half the noise of the last step,
sqrt(dt k_B T / (2 g m)), so their strong order is 1/2; their weak order at a given time is 1, and 2 in the long run
(Leimkuhler, Matthews & Tretyakov 2014, doi:10.1098/rspa.2014.0120).
"""

import math
from collections.abc import Callable, Iterator
from typing import ClassVar, NamedTuple

import numpy as np

import kickdrift as kd
from kickdrift.forces.seam.kernel import OK, kernel
from kickdrift_validation.claim import Claim, claim, main

STRONG = {"baoab": 1.0, "obabo": 1.0, "aboba": 1.0, "oabao": 1.0, "baoa": 1.0, "gjf": 1.0, "brownian": 0.5}
WEAK = {"baoab": 2.0, "obabo": 2.0, "aboba": 2.0, "oabao": 2.0, "baoa": 1.0, "gjf": 2.0, "brownian": 1.0}
WITHIN = 0.1
COPIES = 300_000
THEORY = "Milstein & Tretyakov 2021; Leimkuhler, Matthews & Stoltz 2016"


class Wells(NamedTuple):
    """Bound form of the double wells U = height (x^2 - 1)^2 along each axis, for unit masses."""

    height: float


@kernel(Wells)
def wells(force, t, x, v, a, sums):
    for k in range(3):
        for i in range(x.shape[1]):
            y = x[k, i] * x[k, i] - 1.0
            a[k, i] -= 4.0 * force.height * y * x[k, i]
            if sums is not None:
                sums[0] += force.height * y * y
    return OK


class DoubleWells:
    """The force of the double wells."""

    name: ClassVar[str] = "double-wells"
    external: ClassVar[bool] = True

    def check(self, system: object) -> None:
        """Nothing to check."""

    def bind(self, system: object, threads: int = 1) -> Wells:
        return Wells(0.25)


class Problem(NamedTuple):
    """Independent copies of one start.

    copies : the copies, given their number
    temperature : of the bath
    inertial : friction, length and steps of the runs, the longest step first
    overdamped : the same for brownian
    pairs : whether copies are pairs of particles
    """

    copies: Callable[[int], kd.System]
    temperature: float
    inertial: tuple[float, float, tuple[float, ...]]
    overdamped: tuple[float, float, tuple[float, ...]]
    pairs: bool = False


def _copies(force: object, start: float) -> Callable[[int], kd.System]:
    """Particles at rest near one start: at rest, since brownian takes the first velocities for noise."""

    def copies(n: int) -> kd.System:
        near = start + np.linspace(-0.1, 0.1, n)  # no two at one place
        return kd.System(np.stack([near] * 3, axis=1), np.zeros((n, 3)), forces=[force], units="lj")

    return copies


def _dimers(n: int) -> kd.System:
    """Dimers on a wide grid, stretched along x and at rest."""
    edge = math.ceil(n ** (1 / 3))
    at = 9.0 * np.indices((edge, edge, edge)).reshape(3, -1).T[:n]
    offset = np.array([0.6, 0.0, 0.0])
    x = np.concatenate([at - offset, at + offset])
    law = kd.LennardJones(cutoff=4.0, truncation="cut")
    return kd.System(x, np.zeros_like(x), box=(9.0 * edge,) * 3, forces=[law], units="lj")


PROBLEMS = {
    "harmonic wells": Problem(
        _copies(kd.HarmonicTrap(1.0), 1.0), 1.0,
        (1.0, 1.6, (0.4, 0.32, 0.2, 0.16)), (1.0, 0.8, (0.1, 0.05, 0.025, 0.0125)),
    ),
    "double wells": Problem(
        _copies(DoubleWells(), 0.5), 0.5,
        (1.0, 0.96, (0.24, 0.16, 0.12, 0.08)), (1.0, 0.8, (0.1, 0.05, 0.025, 0.0125)),
    ),
    "Lennard-Jones dimers": Problem(
        _dimers, 0.1, (2.0, 0.24, (0.03, 0.024, 0.016, 0.012)), (50.0, 0.4, (0.04, 0.02, 0.01, 0.005)), pairs=True,
    ),
}  # fmt: skip


def paths(problem: Problem, name: str, dt: float, copies: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities (copies, 2 components) at the end of the runs with dt and with dt / 2."""
    system = problem.copies(copies)
    friction, time, _ = problem.overdamped if name == "brownian" else problem.inertial
    options = {"temperature": problem.temperature, "friction": friction, "seed": seed}
    steps, found = round(time / dt), []
    for parts, noise in ((1, "own"), (2, "refine")):
        sim = kd.Simulation(system, name, dt / parts, noise=noise, **options)
        sim.advance(parts * steps)
        x, v = sim.state.positions, sim.state.velocities
        if problem.pairs:  # the distance vector of each pair along x, and its velocity
            x, v = (x[copies:] - x[:copies])[:, :1], (v[copies:] - v[:copies])[:, :1]
        found.append(np.stack([x.ravel(), v.ravel()]))
    return found[0], found[1]


def means(state: np.ndarray, inertial: bool) -> np.ndarray:
    """What the weak error is measured by: x, x^2, and with velocities v, v^2 and x v."""
    x, v = state
    return np.stack([x, x * x, v, v * v, x * v] if inertial else [x, x * x])


class Orders(NamedTuple):
    """Measured slopes with their standard errors."""

    strong: float
    strong_error: float
    weak: float
    weak_error: float


def orders(problem: Problem, name: str, copies: int, seed: int = 1) -> Orders:
    """Slopes of the strong and of the weak difference against the step."""
    inertial = name != "brownian"
    dts = (problem.inertial if inertial else problem.overdamped)[2]
    strong, weak, weak_errors = [], [], []
    for k, dt in enumerate(dts):
        coarse, fine = paths(problem, name, dt, copies, seed + k)
        apart = ((coarse - fine) ** 2)[: 1 + inertial].sum(axis=0)
        strong.append((0.5 * math.log(apart.mean()), 0.5 * apart.std() / apart.mean() / math.sqrt(apart.size)))
        change = means(coarse, inertial) - means(fine, inertial)
        mean, error = change.mean(axis=1), change.std(axis=1) / math.sqrt(change.shape[1])
        size = math.sqrt(max(float((mean**2 - error**2).sum()), 1e-300))
        weak.append(math.log(size))
        weak_errors.append(math.sqrt(float((mean**2 * error**2).sum())) / size**2)
    return Orders(*_line(dts, *map(np.array, zip(*strong, strict=True))), *_line(dts, weak, weak_errors))


def _line(dts: tuple[float, ...], values: np.ndarray, errors: np.ndarray) -> tuple[float, float]:
    """Slope of logarithms against that of the step, and its standard error from the errors of the values."""
    x, w = np.log(dts), 1.0 / np.asarray(errors) ** 2
    centred = x - (w * x).sum() / w.sum()
    spread = (w * centred**2).sum()
    return float((w * centred * np.asarray(values)).sum() / spread), float(1.0 / math.sqrt(spread))


def claims(long: bool = False) -> Iterator[Claim]:
    """The two slopes of every word on every potential."""
    for title, problem in PROBLEMS.items():
        copies = COPIES // (2 if problem.pairs else 1) * (4 if long else 1)
        for name in STRONG:
            found = orders(problem, name, copies)
            print(f"  {title}: {name}: strong {found.strong:.3f} ± {found.strong_error:.3f}, "
                  f"weak {found.weak:.3f} ± {found.weak_error:.3f}", flush=True)  # fmt: skip
            for kind, value, error, wanted in (
                ("strong", found.strong, found.strong_error, STRONG[name]),
                ("weak", found.weak, found.weak_error, WEAK[name]),
            ):
                yield claim(
                    f"{name}, {title}: {kind} order", f"{value:.3f} ± {error:.3f}", f"within {WITHIN} of {wanted:g}",
                    abs(value - wanted) <= WITHIN, THEORY,
                )  # fmt: skip


if __name__ == "__main__":
    main(claims, __doc__)
