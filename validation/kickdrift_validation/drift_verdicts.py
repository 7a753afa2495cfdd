"""Is the verdict on the energy's drift right on genuine runs?  Five systems, ten methods, ten starts.

The short set has two starts of each system and method, 100 runs; the long set has ten, 500 runs. The systems: the
Kepler problem, the pendulum, Sun and Jupiter, a choreography of three bodies, and 108 Lennard-Jones particles whose
potential is cut with a force shift or a switch. Each start has its own eccentricity, amplitude, disturbance or seed,
and each run its own step, length and number of samples.

The truth is a run eight times as long. Its energy is averaged over eight windows; the first window is the run that is
judged. The energy drifts if the averages go one way from window to window. Windows after the energy has changed by
half are left out, because the motion is another one by then; with fewer than three windows the thirds of the run
itself take their place.

A secular drift that does not go on so is false. A slope has the wrong sign where the energy drifts the other way, and
either the verdict is a secular drift or the run changes the energy by more than 1 %.
"""

import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, partial
from time import perf_counter

import numpy as np

import kickdrift as kd
from kickdrift import odes
from kickdrift.model.starts.builders import lattice, maxwell_boltzmann
from kickdrift.run.report.energy import EnergyReport
from kickdrift.run.report.report import Report
from kickdrift_validation.claim import Claim, claim, main

SHORT, LONG = 2, 10  # starts
LENGTHS = 8  # of the truth, in runs
LOOKS = 40  # in each further window
LEAST_PERIODS = 25.0
CHANGED, LOST = 0.5, 0.01  # relative changes of the energy
FALSE, UNRESOLVED = 0.02, 0.05  # bounds
# Steps in the shortest period: from, to.
STEPS = {
    "symplectic-euler": (60, 300),
    "velocity-verlet": (25, 150),
    "ruth3": (20, 100),
    "forest-ruth": (25, 100),
    "pefrl": (20, 80),
    "yoshida8": (20, 40),
    "rk4": (20, 80),
    "midpoint": (80, 400),
    "euler": (1000, 5000),
    "dormand-prince45": (0, 0),  # by its tolerance
}
TOLERANCES = (1e-8, 1e-4)
PARTICLES, DENSITY, TEMPERATURE, CUTOFF = 108, 0.82, 1.3, 2.3


@dataclass(frozen=True)
class Start:
    """What is run, with its shortest period and the length that counts as one period."""

    subject: kd.System | kd.Problem
    shortest: float
    period: float
    cost: int = 1  # times that a step costs as much, so that as many times fewer are made


def generator(*key: object) -> np.random.Generator:
    """Random numbers that belong to the key."""
    return np.random.default_rng(zlib.crc32(repr(key).encode()))


@cache
def kepler_problem() -> kd.Problem:
    """Made once, so that it is compiled once."""
    return odes.kepler()


@cache
def pendulum_problem() -> kd.Problem:
    return odes.pendulum()


def kepler(rng: np.random.Generator) -> Start:
    e = rng.uniform(0.0, 0.7)
    start = np.array([1.0 - e, 0.0, 0.0, np.sqrt((1.0 + e) / (1.0 - e))])
    return Start(restarted(kepler_problem(), start), 2.0 * np.pi * (1.0 - e) ** 1.5, 2.0 * np.pi)


def pendulum(rng: np.random.Generator) -> Start:
    start = np.array([rng.uniform(0.2, 2.7), 0.0])
    period = 2.0 * np.pi * (1.0 + start[0] ** 2 / 16.0)
    return Start(restarted(pendulum_problem(), start), 2.0 * np.pi, period)


def restarted(problem: kd.Problem, y0: np.ndarray) -> kd.Problem:
    return kd.Problem(problem.f, y0, separable=True, energy=problem.energy, name=problem.name)


def sun_jupiter(rng: np.random.Generator) -> Start:
    """Its ellipse with another eccentricity, from the pericentre."""
    system = kd.load("sun-jupiter")
    e, known = rng.uniform(0.0, 0.5), 0.048498
    x, v, m = system.state.positions, system.state.velocities, system.state.masses
    closer, faster = (1.0 - e) / (1.0 - known), np.sqrt((1.0 + e) / (1.0 - e) * (1.0 - known) / (1.0 + known))
    found = kd.System(x * closer, v * faster, masses=m, forces=system.forces, units=system.units, name="sun-jupiter")
    period = 11.861292
    return Start(found, period * (1.0 - e) ** 1.5, period)


def figure_eight(rng: np.random.Generator) -> Start:
    """Disturbed in its plane, which it bears."""
    system = kd.load("figure-eight")
    x, v, m = system.state.positions, system.state.velocities, system.state.masses
    x = x + np.array([1.0, 1.0, 0.0]) * rng.normal(0.0, 1e-3, x.shape)
    found = kd.System(x, v, masses=m, forces=system.forces, units=system.units, name="figure-eight")
    return Start(found, 2.1, 6.3259)


def liquid(rng: np.random.Generator) -> Start:
    """Melted; a "period" is a vibration of a particle among its neighbours."""
    positions, edges = lattice("fcc", PARTICLES, DENSITY)
    seed = int(rng.integers(1, 10**6))
    velocities = maxwell_boltzmann(np.ones(PARTICLES), 2.0 * TEMPERATURE, 1.0, seed)
    force = kd.LennardJones(cutoff=CUTOFF, truncation=str(rng.choice(["force-shift", "switch"])))
    system = kd.System(positions, velocities, box=edges, forces=[force], seed=seed, name="liquid")
    sim = kd.Simulation(system, integrator="velocity-verlet", dt=0.004)
    sim.equilibrate(TEMPERATURE, 6.0)
    x, v = sim.state.wrapped(), sim.state.velocities
    return Start(kd.System(x, v, box=edges, forces=[force], seed=seed, name="liquid"), 0.2, 0.1, cost=2)


SYSTEMS: dict[str, Callable[[np.random.Generator], Start]] = {
    "kepler": kepler,
    "pendulum": pendulum,
    "sun-jupiter": sun_jupiter,
    "figure-eight": figure_eight,
    "liquid": liquid,
}


@dataclass(frozen=True)
class Found:
    """A run, what was said of it and the averages of its energy error in the windows of the long run."""

    name: str
    report: Report
    times: np.ndarray
    totals: np.ndarray
    windows: tuple[float, ...]

    @property
    def energy(self) -> EnergyReport:
        assert self.report.energy is not None
        return self.report.energy

    @property
    def goes_on(self) -> int:
        """1 or -1 where the energy drifts up or down, 0 where it does not."""
        ways = {int(way) for way in np.sign(np.diff(self.windows))}
        return ways.pop() if len(ways) == 1 else 0

    @property
    def lost(self) -> float:
        """Relative change of the energy from the first tenth of the run to the last."""
        tenth = max(len(self.totals) // 10, 1)
        return float(self.totals[-tenth:].mean() - self.totals[:tenth].mean()) / scale_of(self.energy, self.totals)

    @property
    def false(self) -> bool:
        return self.energy.verdict == "secular drift" and self.goes_on != np.sign(self.energy.drift_per_unit_time)

    @property
    def wrong_sign(self) -> bool:
        told = self.energy.verdict == "secular drift" or abs(self.lost) > LOST
        return bool(told and self.goes_on * self.energy.drift_per_unit_time < 0)

    @property
    def unresolved(self) -> bool:
        return abs(self.lost) > LOST and self.energy.verdict == "not resolvable"

    @property
    def too_wide(self) -> bool:
        widest = np.ptp(self.totals) / scale_of(self.energy, self.totals) / (self.times[-1] - self.times[0])
        return bool(self.energy.drift_error > widest * (1 + 1e-9))


def scale_of(energy: EnergyReport, totals: np.ndarray) -> float:
    """What the errors in the report are divided by."""
    largest = float(np.abs(totals - totals[0]).max())
    return largest / energy.max_relative_error if energy.max_relative_error > 0 else 1.0


def run(name: str, method: str, k: int) -> Found:
    """The run, and eight times it."""
    start = started(name, k)
    rng = generator(name, method, k)
    samples = int(rng.integers(300, 1001))
    if method == "dormand-prince45":
        rtol = np.exp(rng.uniform(*np.log(TOLERANCES)))
        sim = kd.Simulation(start.subject, method, rtol=rtol, atol=rtol)
        length = start.period * LEAST_PERIODS * rng.uniform(1.0, 3.0)
        first = partial(sim.run, until=length, interval=length / samples)
        rest = partial(sim.run, until=LENGTHS * length, interval=length / LOOKS)
    else:
        dt = start.shortest / np.exp(rng.uniform(*np.log(STEPS[method])))
        sim = kd.Simulation(start.subject, method, dt=dt)
        least = int(np.ceil(LEAST_PERIODS * start.period / dt / samples))
        every = max(int(rng.choice([2, 5, 10])) // start.cost, least)
        length = samples * every * dt
        first = partial(sim.run, samples * every, every=every)
        rest = partial(sim.run, (LENGTHS - 1) * samples * every, every=max(every, samples * every // LOOKS))
    try:
        first()
        report, series = sim.report(), sim.record.series()
        rest()
    except kd.RunError:  # blown up: the samples so far
        report, series = (sim.report(), sim.record.series()) if len(sim.record.samples) <= samples else (report, series)
    everything = sim.record.series()
    assert report.energy is not None
    errors = (everything.total - everything.total[0]) / scale_of(report.energy, series.total)
    return Found(f"{name} {method} {k}", report, series.times, series.total, windows(everything.times, errors, length))


@cache
def started(name: str, k: int) -> Start:
    return SYSTEMS[name](generator(name, k))


def windows(times: np.ndarray, errors: np.ndarray, length: float) -> tuple[float, ...]:
    """Averages of the errors over one length after the other, up to a change by half; else over thirds of the first."""
    since = (times - times[0]) / length
    last = int(np.argmax(np.abs(errors) > CHANGED)) if (np.abs(errors) > CHANGED).any() else len(errors)
    found = []
    for window in range(LENGTHS):
        inside = (since > window - 1e-9) & (since <= window + 1 + 1e-9)
        if np.flatnonzero(inside).size < LOOKS // 2 or np.flatnonzero(inside)[-1] >= last:
            break
        found.append(float(errors[inside].mean()))
    if len(found) >= 3:
        return tuple(found)
    return tuple(float(part.mean()) for part in np.array_split(errors[since <= 1 + 1e-9], 3))


def judged(found: list[Found]) -> Iterator[Claim]:
    runs = f"{len(found)} runs, each beside one {LENGTHS} times as long"
    wrong = [each.name for each in found if each.wrong_sign]
    yield claim("slopes with the wrong sign", len(wrong), "none", not wrong, runs)
    still = [each for each in found if not each.goes_on]
    false = sum(each.false for each in found) / max(len(found), 1)
    yield claim(
        "false secular drifts, share", false, f"under {FALSE}", false < FALSE, f"{runs}; {len(still)} do not drift"
    )
    lossy = [each for each in found if abs(each.lost) > LOST]
    share = sum(each.unresolved for each in lossy) / max(len(lossy), 1)
    text = "runs that change the energy by over 1 % and are not resolvable, share"
    yield claim(text, share, f"under {UNRESOLVED}", share < UNRESOLVED, f"{len(lossy)} such runs")
    wide = sum(each.too_wide for each in found)
    yield claim("intervals wider than the range over the time", wide, "none", wide == 0, runs)


def claims(long: bool = False) -> Iterator[Claim]:
    """Two starts, or ten; prints a table of verdicts and every run that goes against the claims."""
    found: list[Found] = []
    for name in SYSTEMS:
        began = perf_counter()
        for method in STEPS:
            own = [run(name, method, k) for k in range(LONG if long else SHORT)]
            counts = ", ".join(f"{v} {c}" for v, c in Counter(each.energy.verdict for each in own).most_common())
            print(f"{name:14} {method:18} {counts}", flush=True)
            found += own
            for each in own:
                if each.false or each.wrong_sign or each.unresolved or each.too_wide:
                    print(f"  against: {each.name}: lost {each.lost:.1e}, said {each.energy.verdict}, {each.energy}")
        print(f"{name}: {perf_counter() - began:.0f} s", flush=True)
    yield from judged(found)


if __name__ == "__main__":
    main(claims, __doc__)
