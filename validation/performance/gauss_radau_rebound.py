"""Is gauss-radau15 at least one and a half times as fast as rebound's IAS15, at the same or a smaller error?

    python validation/performance/gauss_radau_rebound.py [--turns 9] [--seconds 1.0]

The Sun with the planets and Pluto, and Hairer's outer solar system. Both programs go on from the same state with their
default settings, in turns (A B A B …) of about the same time, so that whatever else the machine does falls on both: the
figure is the median over neighbouring turns of the ratio of simulated time per second. Then both run from sixteen
starts that differ by a part in 1e15 over some thousands of steps: root mean square relative energy errors over starts
and looks, in extended precision from the states.
"""

from __future__ import annotations

import argparse
import sys
from importlib.util import find_spec
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from claim import Claim, claim, not_run, show, where
from gauss_radau import INSTALL, NAME, ias15, ours, rebounds, shifted

import kickdrift as kd

SYSTEMS = ("solar-system", "outer-solar-system")
BOUND = 1.5
STARTS, STEPS, LOOKS, MOST = 16, 4000, 8, 1.2
CLAIM = "simulated time per second over IAS15's"


class Ours:
    """kickdrift, at rest as a whole."""

    name = NAME

    def __init__(self, system: kd.System) -> None:
        self.sim = kd.Simulation(system, NAME)
        self.sim.run(10, every=2**40)

    @property
    def time(self) -> float:
        return self.sim.time

    @property
    def steps(self) -> int:
        return self.sim.steps_done

    @property
    def evaluations(self) -> float:
        """A step."""
        return self.sim.record.force_evaluations / self.sim.steps_done

    def run(self, until: float) -> None:
        self.sim.run(until=until, every=2**40)


class Rebound:
    """IAS15 from the same state."""

    name = "IAS15"

    def __init__(self, system: kd.System, G: float) -> None:
        self.sim = ias15(system, G)
        self.sim.steps(10)

    @property
    def time(self) -> float:
        return self.sim.t

    @property
    def steps(self) -> int:
        return int(self.sim.steps_done)

    evaluations = float("nan")

    def run(self, until: float) -> None:
        self.sim.integrate(until, exact_finish_time=0)


def at_rest(name: str) -> tuple[kd.System, float]:
    """The system in the frame of its barycentre, Newtonian gravity alone, and G."""
    shipped = kd.load(name)
    state, masses = shipped.state, shipped.state.masses
    gravity = next(force for force in shipped.forces if isinstance(force, kd.Gravity))
    x, v = (part - masses @ part / masses.sum() for part in (state.positions, state.velocities))
    G = gravity.G if gravity.G is not None else shipped.units.gravity
    return kd.System(x, v, masses, forces=[kd.Gravity(G=float(G))], units="nbody", name=name), float(G)


def compare(name: str, turns: int, seconds: float) -> list[Claim]:
    """One system, both programs."""
    system, G = at_rest(name)
    sides: list[Any] = [Ours(system), Rebound(system, G)]
    lengths = []
    for side in sides:  # what fits in a turn
        begin, began = side.time, perf_counter()
        while perf_counter() - began < 0.3 * seconds:
            side.run(side.time + 20 * (side.time - begin + side.time / side.steps))
        lengths.append((side.time - begin) / (perf_counter() - began) * seconds)
    speeds = []
    for _ in range(turns):
        row = []
        for side, length in zip(sides, lengths, strict=True):
            begin, began = side.time, perf_counter()
            side.run(begin + length)
            row.append((side.time - begin) / (perf_counter() - began))
        speeds.append(row)
    ratios = np.array(speeds)[:, 0] / np.array(speeds)[:, 1]
    times = STEPS * sides[0].time / sides[0].steps * np.arange(1, LOOKS + 1) / LOOKS
    rms = [
        float(np.sqrt(np.mean([run(start, times, G)[0] ** 2 for start in shifted(system, STARTS)])))
        for run in (ours, rebounds)
    ]
    print(f"{name}, {len(system)} bodies, {turns} turns of {seconds:g} s each; energy errors to t = {times[-1]:.4g}")
    for side, speed, error in zip(sides, np.median(speeds, axis=0), rms, strict=True):
        per_step = 1e6 * side.time / side.steps / speed
        count = "" if np.isnan(side.evaluations) else f", {side.evaluations:.1f} evaluations each"
        print(
            f"  {side.name:14} {speed:10.4g} time units/s, {per_step:6.2f} us a step{count}; "
            f"steps of {side.time / side.steps:.4g}, rms energy error {error:.2e}"
        )
    median = float(np.median(ratios))
    print(f"  ratio {median:.2f} (single turns {ratios.min():.2f} to {ratios.max():.2f})")
    text = f"{name}: RMS energy error of {STARTS} starts over IAS15's"
    return [
        claim(f"{name}: {CLAIM}", median, f"at least {BOUND:g}", median >= BOUND, "rebound's IAS15, default settings"),
        claim(text, rms[0] / rms[1], f"at most {MOST:g}", rms[0] <= MOST * rms[1], "the same"),
    ]


def compare_all(turns: int = 9, seconds: float = 1.0) -> list[Claim]:
    """Both systems."""
    if find_spec("rebound") is None:
        return [not_run(CLAIM, f"at least {BOUND:g}", "rebound", INSTALL)]
    print(where("rebound"))
    return [found for name in SYSTEMS for found in compare(name, turns, seconds)]


def claims() -> list[Claim]:
    """With the default options."""
    return compare_all()


def main() -> int:
    """Compare with the given options and print the claims."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--turns", type=int, default=9, help="of each")
    parser.add_argument("--seconds", type=float, default=1.0, help="length of a turn")
    given = parser.parse_args()
    return show(compare_all(given.turns, given.seconds))


if __name__ == "__main__":
    sys.exit(main())
