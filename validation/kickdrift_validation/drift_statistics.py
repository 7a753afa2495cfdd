"""Does `kickdrift.statistics.drift.drift` keep its word?  Synthetic series of known slope and kind, 1000 of each class.

prints coverage of the 95 % interval, the verdicts and the share of wrong ones; with --long those of the classes too
that lie outside the promise, which are shown and not judged.

What coverage means, class by class: for AR(1) noise and for a wave under white noise, how often the interval holds the
slope put in, over draws of noise, phase and period.  For a random walk, how often it holds the mean increment, 0 or
that put in.  A wave without noise has no sampling distribution: its interval is the rounding of the fit, which must
hold 0 and may do so always.  A series called too short has no interval (infinite half-width), and no coverage is
claimed for it.
"""

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from kickdrift.statistics.drift import MIN_SAMPLES, drift
from kickdrift_validation.claim import Claim, claim, main

Series = tuple[np.ndarray, float]  # values, and the slope per sample put in
NOMINAL = (0.93, 0.97)
AT_LEAST = (0.93, 1.0)
WRONG_AT_MOST = 0.05
SERIES, SEED = 1000, 0
COEFFICIENTS = (0.0, 0.3, 0.5, 0.7, 0.8, 0.9, 0.95)
RESOLVABLE = 25.0  # effective samples, n (1 - phi) / (1 + phi), from which AR(1) noise is told from a random walk


def autoregressive(rng: np.random.Generator, n: int, coefficient: float) -> np.ndarray:
    """Stationary AR(1) with unit innovations; a random walk where ``coefficient`` is 1."""
    innovations = rng.normal(size=n)
    if coefficient < 1.0:
        innovations[0] /= np.sqrt(1.0 - coefficient**2)
    return lfilter([1.0], [1.0, -coefficient], innovations)


def stationary(rng: np.random.Generator, sigmas: tuple[float, float]) -> Series:
    """AR(1) over at least ``RESOLVABLE`` effective samples, with a slope of that many of its own standard errors."""
    coefficient = rng.choice(COEFFICIENTS)
    shortest = max(100, int(np.ceil(RESOLVABLE * (1 + coefficient) / (1 - coefficient))))
    n = int(rng.integers(shortest, 2001))
    slope = rng.uniform(*sigmas) * rng.choice([-1.0, 1.0]) * np.sqrt(12.0 / n**3) / (1.0 - coefficient)
    return autoregressive(rng, n, coefficient) + slope * np.arange(n), slope


def walk(rng: np.random.Generator, sigmas: tuple[float, float]) -> Series:
    """Random walk, its mean increment that many standard errors from 0."""
    n = int(rng.integers(100, 2001))
    slope = rng.uniform(*sigmas) * rng.choice([-1.0, 1.0]) / np.sqrt(n)
    return autoregressive(rng, n, 1.0) + slope * np.arange(n), slope


def periodic(rng: np.random.Generator, log_noise: tuple[float, float] | None, rise: float) -> Series:
    """One to three harmonics, amplitude to 1, period of 4 samples to an eighth of the series, and white noise.

    ``log_noise`` is the range of log10 of the noise; the trend rises up to ``rise`` over the series.
    """
    n = int(rng.integers(100, 2001))
    period = np.exp(rng.uniform(np.log(4.0), np.log(n / 8.0)))
    values = np.zeros(n)
    for harmonic in range(1, int(rng.integers(2, 5))):
        amplitude, phase = rng.uniform(0.1, 1.0) / harmonic, rng.uniform(0.0, 2.0 * np.pi)
        values += amplitude * np.sin(2.0 * np.pi * harmonic * np.arange(n) / period + phase)
    if log_noise is not None:
        values += 10.0 ** rng.uniform(*log_noise) * rng.normal(size=n)
    slope = rise * rng.uniform(0.5, 1.0) * rng.choice([-1.0, 1.0]) / n
    return values + slope * np.arange(n), slope


def short(rng: np.random.Generator) -> Series:
    """Under ``MIN_SAMPLES`` samples of any of the others."""
    make = rng.choice([lambda: stationary(rng, (0, 30)), lambda: walk(rng, (0, 8)), lambda: periodic(rng, (-4, -1), 1)])
    values, slope = make()
    return values[: int(rng.integers(3, MIN_SAMPLES))], slope


def long_memory(rng: np.random.Generator) -> Series:
    """AR(1) over 2 to 10 effective samples: nothing tells it from a random walk, so that only a drift counts wrong."""
    coefficient = rng.choice([0.9, 0.95, 0.98])
    n = int(rng.uniform(2.0, 10.0) * (1.0 + coefficient) / (1.0 - coefficient))
    return autoregressive(rng, max(n, MIN_SAMPLES), coefficient), 0.0


def jittered_walk(rng: np.random.Generator) -> Series:
    """A random walk read with white noise of up to twice its step."""
    values, slope = walk(rng, (0, 0))
    return values + rng.uniform(0.0, 2.0) * rng.normal(size=len(values)), slope


def slow_wave(rng: np.random.Generator) -> Series:
    """Half a cycle to two cycles in the whole series, under noise of 0.0001 to 0.1 of the amplitude."""
    n = int(rng.integers(100, 2001))
    phases = rng.uniform(0.5, 2.0) * 2.0 * np.pi * np.arange(n) / n + rng.uniform(0.0, 2.0 * np.pi)
    return np.sin(phases) + 10.0 ** rng.uniform(-4.0, -1.0) * rng.normal(size=n), 0.0


@dataclass(frozen=True)
class Class:
    """A kind of series, the verdicts that are right for it and the coverage asked (None: no interval is claimed)."""

    name: str
    make: Callable[[np.random.Generator], Series]
    right: tuple[str, ...]
    coverage: tuple[float, float] | None = NOMINAL
    judged: bool = True


CLASSES = (
    Class("AR(1), no slope", lambda rng: stationary(rng, (0, 0)), ("bounded",)),
    Class("AR(1), slope of 8 to 30 sigma", lambda rng: stationary(rng, (8, 30)), ("secular drift",)),
    Class("AR(1), slope under 0.5 sigma", lambda rng: stationary(rng, (0, 0.5)), ("bounded", "not resolvable")),
    Class("random walk", lambda rng: walk(rng, (0, 0)), ("random walk",)),
    Class("random walk, slope of 8 to 30 sigma", lambda rng: walk(rng, (8, 30)), ("secular drift",)),
    Class("periodic", lambda rng: periodic(rng, (-4, -1), 0), ("bounded",)),
    Class("periodic, slope", lambda rng: periodic(rng, (-4, -1), 1), ("secular drift",)),
    Class("periodic, no noise", lambda rng: periodic(rng, None, 0), ("bounded",), AT_LEAST),
    Class("too short", short, ("not resolvable",), None),
    # Beyond what the verdicts promise: shown, so that nobody has to guess.
    Class("AR(1), 2-10 effective samples", long_memory, ("not resolvable", "random walk", "bounded"), AT_LEAST, False),
    Class("random walk under white noise", jittered_walk, ("random walk",), NOMINAL, False),
    Class("wave of 0.5 to 2 cycles", slow_wave, ("not resolvable",), None, False),
)


@dataclass(frozen=True)
class Outcome:
    """Share of intervals that hold the truth, and how often each verdict was given."""

    kind: Class
    coverage: float
    verdicts: Counter[str]

    @property
    def wrong(self) -> float:
        return 1.0 - sum(self.verdicts[verdict] for verdict in self.kind.right) / self.verdicts.total()

    @property
    def covered(self) -> bool:
        return self.kind.coverage is None or self.kind.coverage[0] <= self.coverage <= self.kind.coverage[1]


def study(kind: Class, series: int, seed: int) -> Outcome:
    """``series`` draws of one class, reproducible from ``seed``."""
    rng = np.random.default_rng([seed, *kind.name.encode()])
    verdicts: Counter[str] = Counter()
    covered = 0
    for _ in range(series):
        values, slope = kind.make(rng)
        step = rng.uniform(0.001, 1.0)
        result = drift(step * np.arange(len(values)), values)
        verdicts[result.verdict] += 1
        covered += abs(result.slope - slope / step) <= result.error
    return Outcome(kind, covered / series, verdicts)


def judged(outcome: Outcome) -> Iterator[Claim]:
    name, asked = f"drift, {outcome.kind.name}", outcome.kind.coverage
    reference = f"{outcome.verdicts.total()} synthetic series of known slope"
    if asked is not None:
        text, bound = f"{name}: coverage of the 95 % interval", f"{asked[0]:.2f} to {asked[1]:.2f}"
        yield claim(text, outcome.coverage, bound, outcome.covered, reference)
    text, holds = f"{name}: wrong verdicts", outcome.wrong <= WRONG_AT_MOST
    yield claim(text, outcome.wrong, f"at most {WRONG_AT_MOST}", holds, reference)


def claims(long: bool = False) -> Iterator[Claim]:
    """Two or one of each class that is judged; a line is printed for each."""
    print(f"{'class':36} {'coverage':>8} {'wrong':>6}  verdicts ({SERIES} series, seed {SEED})")
    for kind in CLASSES:
        if not (kind.judged or long):
            continue
        outcome = study(kind, SERIES, SEED)
        counts = ", ".join(f"{verdict} {count}" for verdict, count in outcome.verdicts.most_common())
        coverage = "-" if kind.coverage is None else f"{outcome.coverage:.3f}"
        note = "" if kind.judged else "  (outside the promise, not judged)"
        print(f"{kind.name:36} {coverage:>8} {outcome.wrong:6.3f}  {counts}{note}", flush=True)
        if kind.judged:
            yield from judged(outcome)


if __name__ == "__main__":
    main(claims, __doc__)
