"""Small systems a second, side by side in a Batch and one by one.

Planetary systems of 3 bodies (with --long also of 5 and 9), each different, make 10,000 steps each (with --long, those
of 3 bodies also 100,000). The time begins with the Systems: it includes setting up, the run with its 1000 samples, and
the reports. For MEGNO it includes 10,000 looks and the fit. Both take turns in one process on one core, after
compilation; BLAS has one thread. The figure is the median of the ratios in the same round. "stepping" is the same
without reports, with only the first and the last sample.
"""

import os
import sys
from collections.abc import Callable, Iterator
from time import process_time

import numpy as np

import kickdrift as kd
from kickdrift.analysis.chaos.megno import megno, megnos
from kickdrift.batch.batch import Batch
from kickdrift.engines import ENGINES
from kickdrift.ensemble.rows import run_columns
from kickdrift_validation.claim import Claim, at_least, main, under
from kickdrift_validation.performance.turns import Missing, Native, Runner, ratio_of, turns
from kickdrift_validation.runner import ONE_THREAD

AT_LEAST = 4.0
PAST = 1.15
REPORT, KEPT = 1.0, 0.9  # ms; share of the speed with samples and reports
GROUP = 64  # members of a Batch
SYSTEMS = {2: 4, 3: 2, 4: 2, 8: 1}  # systems in WHFast512, by their planets
ROUNDS, SECONDS = 7, 0.4
STEP = 2 * np.pi / 100  # a hundredth of the innermost body's period


def planets(seed: int, bodies: int) -> kd.System:
    """A star of mass 1 and planets of some 1e-5, well apart on nearly circular orbits; G = 1."""
    rng = np.random.default_rng(seed)
    a = 1.5 ** np.arange(bodies - 1)
    angle, e = rng.uniform(0, 2 * np.pi, bodies - 1), rng.uniform(0.0, 0.05, bodies - 1)
    x, v = np.zeros((2, bodies, 3))
    along = np.column_stack([np.cos(angle), np.sin(angle), 0.01 * rng.normal(size=bodies - 1)])
    across = np.column_stack([-np.sin(angle), np.cos(angle), 0.01 * rng.normal(size=bodies - 1)])
    x[1:], v[1:] = (a * (1 - e))[:, None] * along, np.sqrt((1 + e) / (1 - e) / a)[:, None] * across
    masses = np.concatenate([[1.0], rng.uniform(0.5e-5, 2e-5, bodies - 1)])
    return kd.System(x, v, masses, forces=[kd.Gravity()], units="nbody")


class Each(Runner):
    """A runner of members. ``go`` gets lists of ``size`` members."""

    def __init__(self, go: Callable[[list[kd.System]], object], systems: list[kd.System], size: int) -> None:
        self._go, self._systems, self.least = go, systems, float(size)
        self._size = size

    def run(self, amount: float) -> float:
        groups = max(1, round(amount / self._size))
        for k in range(groups):
            first = k * self._size % len(self._systems)
            self._go(self._systems[first : first + self._size])
        return groups * self._size


def runs(name: str, steps: int, whole: bool) -> tuple[Callable[..., object], Callable[..., object]]:
    """Two functions: runs one by one, and runs side by side."""
    every = None if whole else steps

    def alone(systems: list[kd.System]) -> None:
        for system in systems:
            sim = kd.Simulation(system, name, STEP)
            sim.run(steps, every=every)

    def together(systems: list[kd.System]) -> None:
        batch = Batch(systems, name, STEP)
        batch.run(steps, every)
        if whole:
            batch.reports()

    return alone, together


def growths(name: str, steps: int) -> tuple[Callable[..., object], Callable[..., object]]:
    """The same two functions for MEGNO."""

    def alone(systems: list[kd.System]) -> None:
        for system in systems:
            megno(system, steps * STEP, name, STEP)

    def together(systems: list[kd.System]) -> None:
        megnos(systems, steps * STEP, name, STEP)

    return alone, together


def with_reports(name: str, steps: int) -> tuple[Callable[..., object], Callable[..., object], list[float]]:
    """Two functions, bare and with reports, and a list of the reports' processor time in ms a member, one for each
    turn."""
    costs: list[float] = []

    def reported(systems: list[kd.System]) -> None:
        batch = Batch(systems, name, STEP)
        batch.run(steps)
        began = process_time()
        for report in batch.reports():
            assert report is not None
            run_columns(report)
        costs.append(1e3 * (process_time() - began) / len(systems))

    return runs(name, steps, False)[1], reported, costs


def report_claims() -> Iterator[Claim]:
    """Cost of the members' reports, and the share of the speed that remains."""
    systems = [planets(seed, 3) for seed in range(GROUP)]
    for name in ("leapfrog", "rk4", "wisdom-holman"):
        for steps in (10_000, 100_000, 1_000_000):
            bare, reported, costs = with_reports(name, steps)
            speeds = turns([Each(bare, systems, GROUP), Each(reported, systems, GROUP)], 0.1, ROUNDS)
            ratio, cost = ratio_of(speeds[:, 1], speeds[:, 0]), float(np.median(costs))
            print(f"{name}, {steps} steps: a report {cost:.2f} ms of processor time; with reports {ratio.median:.2f}")
            if steps == 10_000:
                text = f"{name}, a member's report with its drift, ms of processor time"
                yield under(text, cost, REPORT, "its samples in memory")
            if steps == 1_000_000:
                text = f"{name}, {steps} steps: members a second with samples and reports over those without"
                yield at_least(text, ratio.median, KEPT, "stepping, in turns")


class Together(Runner):
    """Steps of eight systems of ``count`` planets in a Batch."""

    version, least = kd.__version__, 2000.0

    def __init__(self, count: int) -> None:
        self._batch = Batch([planets(seed, count + 1) for seed in range(8)], "wisdom-holman", STEP)

    def run(self, amount: float) -> float:
        self._batch.run(round(amount), every=round(amount))
        return 8.0 * round(amount)


def one_by_one(count: int) -> Native:
    """Steps of one system of ``count`` planets."""
    return Native(kd.Simulation(planets(0, count + 1), "wisdom-holman", STEP), least=20_000.0)


class Whfast512Together(Runner):
    """Steps of as many systems of ``count`` planets as rebound's WHFast512 takes side by side."""

    least = 2000.0

    def __init__(self, count: int) -> None:
        try:
            import rebound
        except ImportError:
            raise Missing(ENGINES["rebound"].install) from None
        if not rebound.avx512_available:
            raise Missing("needs a processor with AVX-512")
        self.version, systems = rebound.__version__, SYSTEMS[count]
        self._systems, self._sim = systems, rebound.Simulation()
        sim = self._sim
        sim.integrator, sim.dt = "whfast512", STEP
        sim.integrator.N_systems = systems
        for seed in range(systems):
            state = planets(seed, count + 1).state
            for m, x, v in zip(state.masses, state.positions, state.velocities, strict=True):
                sim.add(m=float(m), x=x[0], y=x[1], z=x[2], vx=v[0], vy=v[1], vz=v[2])

    def run(self, amount: float) -> float:
        steps = round(amount)
        self._sim.integrator.concatenate_steps = steps  # in one call, else each costs a conversion
        self._sim.integrate(self._sim.t + 0.5 * steps * STEP, exact_finish_time=0)
        self._sim.synchronize()
        return float(self._systems * steps)


def whfast512_claims() -> Iterator[Claim]:
    """Steps of systems of a few planets, over WHFast512's."""
    for count, systems in SYSTEMS.items():
        try:
            theirs = Whfast512Together(count)
        except Missing:
            return
        speeds = turns([theirs, Together(count)], 0.1, 3 * ROUNDS)
        ratio = ratio_of(speeds[:, 1], speeds[:, 0])
        print(f"{count} planets: {ratio.median:.2f} ({ratio.low:.2f} to {ratio.high:.2f}) of WHFast512's steps")
        text = f"systems of {count} planets, wisdom-holman in a Batch: steps over those of {systems} in WHFast512"
        yield at_least(text, ratio.median, PAST, f"rebound {theirs.version}")


def claims(long: bool = False) -> Iterator[Claim]:
    """Claims for each method by the numbers of bodies and steps, then for the reports."""
    cases = [("leapfrog", "run"), ("rk4", "run"), ("wisdom-holman", "run"), ("leapfrog", "megno"), ("rk4", "megno")]
    cases += [(name, "stepping") for name in ("leapfrog", "rk4", "wisdom-holman")]
    print(f"{'bodies':>6} {'steps':>7}  {'what':24} {'one by one':>12} {'in a Batch':>12}  members/s; ratio, quartiles")
    for bodies, steps in ((3, 10_000), (5, 10_000), (9, 10_000), (3, 100_000)) if long else ((3, 10_000),):
        systems = [planets(seed, bodies) for seed in range(GROUP)]
        for name, kind in cases:
            pair = growths(name, steps) if kind == "megno" else runs(name, steps, kind == "run")
            speeds = turns([Each(pair[0], systems, 1), Each(pair[1], systems, GROUP)], SECONDS, ROUNDS)
            ratio = ratio_of(speeds[:, 1], speeds[:, 0])
            slow, fast = np.median(speeds, axis=0)
            what = f"{name}, {kind}"
            print(
                f"{bodies:6} {steps:7}  {what:24} {slow:12.4g} {fast:12.4g}  {ratio.median:.1f} "
                f"({ratio.low:.1f} to {ratio.high:.1f})",
                flush=True,
            )
            if bodies == 3:
                text = f"{what}, {bodies} bodies, {steps} steps: members a second over one by one"
                yield at_least(text, ratio.median, AT_LEAST, "one by one")
    yield from report_claims()
    yield from whfast512_claims()


if __name__ == "__main__":
    if not os.environ.items() >= ONE_THREAD.items():  # NumPy reads these variables at its import
        os.execve(sys.executable, [sys.executable, *sys.argv], {**os.environ, **ONE_THREAD})
    main(claims, __doc__)
