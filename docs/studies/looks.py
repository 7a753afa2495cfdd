"""Cost of default samples beside the bare loop, and speed of default runs beside rebound.

    python -m docs.studies.looks [--turns 7]

The bare loop looks only at the start and at the end. Both take turns (A B A B …) in one process, each with its own
Simulation, and are timed in processor time. A ratio is the median over the turns. No system sets ``every``. The same
runs take turns with rebound's ``steps`` or ``integrate``, whichever is faster; rebound takes no samples. The cost of a
look of nine bodies comes from 100,000 further looks in one run. The cost of a verdict is that of one verdict from 10^5
looks that show 40 waves.
"""

import argparse
import sys
from collections.abc import Callable
from time import process_time
from typing import Any, NamedTuple

import numpy as np

import kickdrift as kd
from kickdrift.statistics.drift import drift
from kickdrift_validation.claim import Claim, claim, not_run, show, where
from kickdrift_validation.performance.bodies import Bodies, Rebound, planets, stars
from kickdrift_validation.performance.turns import Missing

ITSELF = "kickdrift itself, in turns"
NEVER = 2**40  # steps between looks
LOOK, VERDICT = 3.0, 20.0  # bounds: microseconds, milliseconds


class Rival(NamedTuple):
    """rebound's integrator for a run, rebound's start, and the bound for the ratio of speeds."""

    integrator: str
    start: Callable[[], Bodies]
    least: float
    settings: dict[str, Any] = {}  # noqa: RUF012


class Case(NamedTuple):
    """A run, and the share of its bare loop's speed that the run must keep."""

    name: str
    make: Callable[[], kd.Simulation]
    length: dict[str, Any]
    least: float
    rival: Rival | None = None


def bare(name: str) -> kd.System:
    """The shipped system without the ``[run]`` of its file."""
    own = kd.load(name)
    x, v, masses = own.state.positions, own.state.velocities, own.state.masses
    return kd.System(x, v, masses=masses, box=own.box, forces=own.forces, units=own.units, name=name)


def cases() -> list[Case]:
    sun, crowd, eight, atoms = planets(), stars(1000, dt=1 / 1024), bare("figure-eight"), bare("lj-1000")
    steps = {"steps": 10**6}
    whfast = Rival("whfast", lambda: planets(0.005), 5.0, {"safe_mode": 0})
    return [
        Case(
            "Sun and 8 planets, leapfrog", lambda: kd.Simulation(sun.system, "leapfrog", 0.001), steps, 0.9,
            Rival("leapfrog", lambda: planets(0.001), 2.8),
        ),
        Case(
            "Sun and 8 planets, wisdom-holman", lambda: kd.Simulation(sun.system, "wisdom-holman", 0.005), steps, 0.9,
            whfast,
        ),
        Case(
            "Sun and 8 planets, gauss-radau15, 1000 years", lambda: kd.Simulation(sun.system, "gauss-radau15"),
            {"until": 1000.0}, 0.9, Rival("ias15", planets, 9.0),
        ),
        Case("figure-eight, rk4", lambda: kd.Simulation(eight, "rk4", 0.01), {"steps": 10**5}, 0.9),
        Case(
            "1000 stars, leapfrog-dkd", lambda: kd.Simulation(crowd.system, "leapfrog-dkd", crowd.dt), {"steps": 400},
            0.85, Rival("leapfrog", lambda: crowd, 6.0),
        ),
        Case("lj-1000, velocity-verlet", lambda: kd.Simulation(atoms, dt=0.005), {"steps": 20_000}, 0.95),
    ]  # fmt: skip


def seconds(sim: kd.Simulation, **given: Any) -> tuple[float, int]:
    """Processor time of a run, and its looks."""
    began = process_time()
    report = sim.run(**given)
    return process_time() - began, report.samples


def ratio_claims(turns: int) -> list[Claim]:
    """Default runs over bare loops."""
    rows = []
    for case in cases():
        short: dict[str, Any] = {key: 10 if key == "steps" else 1.0 for key in case.length}
        case.make().run(**short)  # compiles
        case.make().run(**short, every=NEVER)
        ratios, looks = [], 0
        for _ in range(turns):
            without, _ = seconds(case.make(), **case.length, every=NEVER)
            with_looks, looks = seconds(case.make(), **case.length)
            ratios.append(without / with_looks)
        low, ratio, high = np.quantile(ratios, [0.25, 0.5, 0.75]).tolist()
        print(f"  {case.name}: {looks} looks, bare loop {1e3 * without:.0f} ms, ratio {low:.3f} to {high:.3f}")
        text = f"speed of a default run over that of its bare loop: {case.name}"
        rows.append(claim(text, ratio, f"at least {case.least}", ratio >= case.least, ITSELF))
    return rows


def rebounds(rival: Rival, length: dict[str, Any]) -> float:
    """Processor time of the same run by rebound, by the faster of its two calls."""
    spent = []
    for way in ("integrate", "steps") if "steps" in length else ("integrate",):
        runner = Rebound(rival.start(), rival.integrator, **rival.settings)
        sim = runner.sim
        end = length["until"] if "until" in length else length["steps"] * sim.dt
        began = process_time()
        if way == "steps":
            runner.run(length["steps"])
        else:
            sim.integrate(end, exact_finish_time=0)
            sim.synchronize()
        spent.append(process_time() - began)
    return min(spent)


def rebound_claims(turns: int) -> list[Claim]:
    """Default runs beside rebound's runs."""
    rows = []
    for case in cases():
        if (rival := case.rival) is None:
            continue
        text, bound = (
            f"speed of a default run over rebound's {rival.integrator}: {case.name}",
            f"at least {rival.least}",
        )
        try:
            version = Rebound(rival.start(), rival.integrator).version
        except Missing as missing:
            rows.append(not_run(text, bound, "rebound", str(missing)))
            continue
        ratios = []
        for _ in range(turns):
            ours, _ = seconds(case.make(), **case.length)
            ratios.append(rebounds(rival, case.length) / ours)
        low, ratio, high = np.quantile(ratios, [0.25, 0.5, 0.75]).tolist()
        print(f"  {case.name}: {1e3 * ours:.0f} ms, over rebound {low:.3g} to {high:.3g}", flush=True)
        rows.append(claim(text, ratio, bound, ratio >= rival.least, f"rebound {version}"))
    return rows


def look_claim(turns: int) -> Claim:
    """Microseconds of one look of nine bodies, all parts included."""
    nine, count = planets().system, 10**5
    costs = []
    for k in range(turns + 1):
        many, few = (seconds(kd.Simulation(nine, "leapfrog", 0.001), steps=10 * count, every=n) for n in (10, NEVER))
        if k:
            costs.append(1e6 * (many[0] - few[0]) / count)
    cost = float(np.median(costs))
    return claim("one look of 9 bodies, in microseconds", cost, f"at most {LOOK}", cost <= LOOK, ITSELF)


def verdict_claim(turns: int) -> Claim:
    times = np.arange(10.0**5)
    values = 1e-6 * np.random.default_rng(1).normal(size=len(times))
    for k in range(40):
        values += np.cos(2.0 * np.pi * 3.51 * (k + 4.37) * times / len(times) + k)
    spent = []
    for k in range(turns + 1):
        began = process_time()
        found = drift(times, values)
        if k:
            spent.append(1e3 * (process_time() - began))
    assert found.lines == 40
    cost = float(np.median(spent))
    text = "the verdict on the drift over 100,000 looks with 40 waves, in milliseconds"
    return claim(text, cost, f"under {VERDICT}", cost < VERDICT, ITSELF)


def claims(turns: int = 7) -> list[Claim]:
    return [*ratio_claims(turns), *rebound_claims(turns), look_claim(turns), verdict_claim(turns)]


def main() -> int:
    """Measure and print. The exit status is 1 where a bound is missed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--turns", type=int, default=7)
    given = parser.parse_args()
    print(where("numpy", "scipy"), flush=True)
    return show(claims(given.turns))


if __name__ == "__main__":
    sys.exit(main())
