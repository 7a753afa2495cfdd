"""What a run that looks at its energies as often as it does by default costs over its bare loop.

    python validation/performance/looks.py [--turns 7]

The bare loop looks at the start and at the end alone. Both take turns (A B A B …) in one process, each with a
Simulation of its own, and are timed in processor time; a ratio is the median over the turns. None of the systems names
an ``every`` of its own. The cost of a look of nine bodies is that of 100,000 more of them in one run; the verdict's is
that of reading it once, from 10^5 looks that show 40 waves.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from time import process_time
from typing import Any, NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from claim import Claim, claim, show, where
from exact_reversal import solar_system

import kickdrift as kd
from kickdrift.analysis.drift import drift

ITSELF = "kickdrift itself, in turns"
NEVER = 2**40  # steps between looks
LOOK, VERDICT = 3.0, 20.0  # bounds: microseconds, milliseconds


class Case(NamedTuple):
    """A run, and the share of its bare loop's speed that it is to keep."""

    name: str
    make: Callable[[], kd.Simulation]
    length: dict[str, Any]
    least: float


def bare(name: str) -> kd.System:
    """The system that ships, without the ``[run]`` of its file."""
    own = kd.load(name)
    x, v, masses = own.state.positions, own.state.velocities, own.state.masses
    return kd.System(x, v, masses=masses, box=own.box, forces=own.forces, units=own.units, name=name)


def cases() -> list[Case]:
    """The rows of the table."""
    planets, eight, stars, atoms = solar_system(), bare("figure-eight"), bare("plummer-1000"), bare("lj-1000")
    return [
        Case("Sun and 8 planets, leapfrog", lambda: kd.Simulation(planets, "leapfrog", 0.001), {"steps": 10**6}, 0.9),
        Case(
            "Sun and 8 planets, wisdom-holman", lambda: kd.Simulation(planets, "wisdom-holman", 0.005),
            {"steps": 10**6}, 0.9,
        ),
        Case(
            "Sun and 8 planets, gauss-radau15, 1000 years", lambda: kd.Simulation(planets, "gauss-radau15"),
            {"until": 1000.0}, 0.9,
        ),
        Case("figure-eight, rk4", lambda: kd.Simulation(eight, "rk4", 0.01), {"steps": 10**5}, 0.9),
        Case("1000 stars, leapfrog-dkd", lambda: kd.Simulation(stars, "leapfrog-dkd", 1 / 1024), {"steps": 400}, 0.85),
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


def look_claim(turns: int) -> Claim:
    """Microseconds of one look of nine bodies, with all that comes with it."""
    planets, count = solar_system(), 10**5
    costs = []
    for k in range(turns + 1):
        many, few = (seconds(kd.Simulation(planets, "leapfrog", 0.001), steps=10 * count, every=n) for n in (10, NEVER))
        if k:
            costs.append(1e6 * (many[0] - few[0]) / count)
    cost = float(np.median(costs))
    return claim("one look of 9 bodies, in microseconds", cost, f"at most {LOOK}", cost <= LOOK, ITSELF)


def verdict_claim(turns: int) -> Claim:
    """Milliseconds of a verdict."""
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
    """All of them."""
    return [*ratio_claims(turns), look_claim(turns), verdict_claim(turns)]


def main() -> int:
    """Measure, print; the exit status, 1 where a bound is missed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--turns", type=int, default=7)
    given = parser.parse_args()
    print(where("numpy", "scipy"), flush=True)
    return show(claims(given.turns))


if __name__ == "__main__":
    sys.exit(main())
