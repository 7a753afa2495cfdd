"""Programs that take turns (A B C A B C …), so that other load of the machine falls on all of them.

A program at work is a ``Runner``. Two programs are compared by the ratio of their speeds in the same round; the median
over the rounds counts.
"""

from collections.abc import Callable, Sequence
from time import perf_counter
from typing import NamedTuple

import numpy as np

import kickdrift as kd

Phase = tuple[np.ndarray, np.ndarray]  # positions and velocities, (n, 3)


class Missing(Exception):
    """A program is not installed. The text says how to install the program."""


class Runner:
    """A program at work, with its own particles.

    Attributes
    ----------
    version : version of the program
    precision : precision of forces and state
    skin : reach of its pair lists beyond the cutoff, in words; "" without pair lists
    least : smallest amount that is worth timing
    clock : wall clock; processor time suits programs of one thread in this process
    """

    version = ""
    precision = "float64"
    skin = ""
    least = 20.0
    clock: Callable[[], float] = staticmethod(perf_counter)

    def run(self, amount: float) -> float:
        """Go on by about ``amount``, and return the exact amount. The amount is in steps, or in time for methods that
        choose their steps."""
        raise NotImplementedError

    def timed(self, amount: float) -> float:
        """Go on by the amount, and return the amount a second."""
        began = self.clock()
        done = self.run(amount)
        return done / (self.clock() - began)

    def phase(self) -> Phase:
        """Positions and velocities at the same time. This call is not timed."""
        raise NotImplementedError

    def looks(self, amount: float, count: int) -> list[Phase]:
        """Return ``phase`` at ``count`` times, evenly over the next ``amount``."""
        found = []
        for _ in range(count):
            self.run(amount / count)
            found.append(self.phase())
        return found

    def at(self, time: float) -> Phase:
        """Positions and velocities at exactly this time, for methods that choose their steps."""
        raise NotImplementedError

    def close(self) -> None:
        """End processes and remove files, if any."""


class Native(Runner):
    """kickdrift. It samples the energy only at the start and at the end of a turn."""

    version = kd.__version__

    def __init__(self, sim: kd.Simulation, precision: str = "float64", least: float | None = None) -> None:
        self.sim, self.precision = sim, precision
        self.least = least or self.least

    @property
    def skin(self) -> str:  # type: ignore[override]
        """Reach of the outer list and of the list pruned from it, beyond the cutoff."""
        lists = [force.pairs for force in self.sim.integration.flow.forces.forces if hasattr(force, "pairs")]
        return "; ".join(f"{pairs.outer_skin:.3g}, pruned {pairs.inner_skin:.3g}" for pairs in lists)

    def run(self, amount: float) -> float:
        sim = self.sim
        if sim.method.chooses_steps:
            begin = sim.time
            sim.run(until=begin + amount, every=2**40)
            sim.run(1, every=2**40)  # ends at a step point, as other programs do
            return sim.time - begin
        steps = round(amount)
        sim.run(steps, every=sim.steps_done + steps)
        return steps

    def phase(self) -> Phase:
        state = self.sim.state
        return state.positions, state.velocities

    def at(self, time: float) -> Phase:
        self.sim.run(until=time, every=2**40)
        return self.phase()


class Calls(Runner):
    """A function, called again and again."""

    least = 1.0

    def __init__(self, function: Callable[[], object]) -> None:
        self.function = function

    def run(self, amount: float) -> float:
        for _ in range(round(amount)):
            self.function()
        return round(amount)


def amount_for(runner: Runner, seconds: float) -> float:
    """Amount for about this many seconds, after warming up."""
    amount = runner.least
    runner.timed(amount)  # may compile
    while (taken := amount / (speed := runner.timed(amount))) < seconds / 4:
        amount *= min(8.0, max(2.0, seconds / 3 / max(taken, 1e-9)))
    return max(runner.least, speed * seconds)


def turns(
    runners: Sequence[Runner], seconds: float, count: int, progress: Callable[[int, int], object] | None = None
) -> np.ndarray:
    """Return (count, runners) amounts a second. The runners take turns of about ``seconds`` each, after warming up."""
    amounts = [amount_for(runner, seconds) for runner in runners]
    speeds = []
    for k in range(count):
        speeds.append([runner.timed(amount) for runner, amount in zip(runners, amounts, strict=True)])
        if progress:
            progress(k + 1, count)
    return np.array(speeds)


class Ratio(NamedTuple):
    """Distribution over the rounds of a ratio of two speeds."""

    median: float
    low: float  # quartiles
    high: float
    least: float
    most: float


def ratio_of(ours: np.ndarray, theirs: np.ndarray) -> Ratio:
    """Ratio of the speeds (k,) of two programs in the same rounds."""
    least, low, median, high, most = np.quantile(ours / theirs, [0, 0.25, 0.5, 0.75, 1]).tolist()
    return Ratio(median, low, high, least, most)
