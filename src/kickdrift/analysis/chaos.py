"""Is a motion chaotic?  MEGNO and the largest Lyapunov exponent, from a deviation vector that rides along.

With d(t) the length of a solution of the variational equations, the Mean Exponential Growth of Nearby Orbits is

    Y(t) = 2 / t  integral of s (d'/d) ds from 0 to t,

and its running mean <Y> goes to 2 for a quasi-periodic motion and as lambda t / 2 for a chaotic one, lambda the largest
Lyapunov exponent (Cincotta & Simo 2000, doi:10.1051/aas:2000108; Cincotta, Giordano & Simo 2003,
doi:10.1016/S0167-2789(03)00103-9).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from kickdrift.errors import InputError, RunError
from kickdrift.forces.variations import varied
from kickdrift.integrators import INTEGRATORS
from kickdrift.integrators import integrator as method_named
from kickdrift.integrators.asked import Integrator, unpacked
from kickdrift.looks.observers import Energies
from kickdrift.model.limits import MOST_STEPS, steps_in
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.run.simulation import Simulation

if TYPE_CHECKING:
    from kickdrift.model.problem import Problem

Verdict = Literal["regular", "chaotic", "undecided"]

REGULAR = 0.1  # |<Y> - 2| below which a motion is called regular
CHAOTIC = 4.0  # <Y> above which it is called chaotic
DEFAULT = "dop853"  # where the system file names no integrator, or one that carries no variations
LOOKS = 10_000  # at the deviation in a run of fixed steps
KEPT = 500  # of them, in a report's JSON
SETTLED = 0.2  # of the run that the fit of the Lyapunov exponent leaves out (Cincotta & Simo 2000, section 3)
LARGEST = 2.0**200  # times which a deviation may grow or shrink before it is scaled back


@dataclass(frozen=True)
class ChaosReport:
    """What the deviation's growth says.

    Attributes
    ----------
    system, integrator, dt, time, time_unit, steps, seed : what was run, and the seed of the first deviation
    megno : the running mean <Y> at the end
    verdict : "regular" where |megno - 2| < 0.1, "chaotic" where it is above 4, "undecided" between
    lyapunov : the largest Lyapunov exponent, per the system's unit of time: twice the slope of <Y> over the last four
        fifths of the run (Cincotta & Simo 2000). Of a regular motion it is a small number of either sign.
    lyapunov_error : half the difference between the slopes of the two halves of that
    energy_error : relative, at the end
    times, means, growth : (k,) times since the start, <Y> at them, and ln d(t) / d(0)
    """

    system: str
    integrator: str
    dt: float | None
    time: float
    time_unit: str
    steps: int
    seed: int
    megno: float
    verdict: Verdict
    lyapunov: float
    lyapunov_error: float
    energy_error: float
    times: Floats = field(repr=False)
    means: Floats = field(repr=False)
    growth: Floats = field(repr=False)

    def as_json(self) -> dict[str, Any]:
        """As one JSON object; the series thinned to some 500 points."""
        every = -(-len(self.times) // KEPT)
        series = ("times", "means", "growth")
        return {
            name: value[::-every][::-1].tolist() if name in series else value
            for name, value in ((f.name, getattr(self, f.name)) for f in fields(self))
        }


def megno(
    system: System | Problem,
    time: float | None = None,
    integrator: str | Integrator | None = None,
    dt: float | None = None,
    *,
    seed: int = 0,
    threads: int = 1,
    progress: Callable[[int, int], Any] | None = None,
    **options: Any,
) -> ChaosReport:
    """Run a System with a deviation vector, and say whether the motion is chaotic.

    Parameters
    ----------
    system : gravity and fields; not pair forces on a neighbour list
    time : how long; default the system file's. A regular motion shows after some hundred of its longest periods, a
        chaotic one after some tens of Lyapunov times: one that is longer than the run looks regular
    integrator, dt, options : as in a Simulation; default the system file's integrator where it carries variations, else
        dop853. Particles under fixed steps move as without their deviations, to the last bit
    seed : of the first deviation, a random direction in phase space with positions in units of their scatter
    progress : called as ``progress(done, of)``

    Raises InputError for what makes no sense, RunError where the run blows up.
    """
    if not isinstance(system, System):
        raise InputError(f"megno: takes a System of particles, got {type(system).__name__}")
    seed = _checked_seed(seed)
    asked, given = unpacked(integrator, {"dt": dt, **options})
    n, name, length = len(system), carrier(system, asked), length_of(system, time)
    sim = Simulation(varied(system, np.zeros_like(system.state.phase)), name, threads=threads, **given)
    state = sim.state
    try:
        accelerations = sim.accelerations()[:n].T
    except RunError:  # not finite, which the run says more of
        accelerations = np.zeros((3, 1))
    scale = scale_of(state.phase[:, :, :n], accelerations)
    state.phase[:, :, n:] = first_deviation(n, seed) * scale
    sim.state = state
    begin = sim.energy()
    times, growth = _growth(sim, length, scale, progress)
    end = sim.energy()
    chosen = None if sim.method.chooses_steps else sim.dt
    return _report(system, sim.integrator, chosen, sim.steps_done, seed, (begin, end.total), times, growth)


def megnos(
    systems: Sequence[System],
    time: float | Sequence[float] | None = None,
    integrator: str | Integrator | None = None,
    dt: float | Sequence[float] | None = None,
    *,
    seeds: int | Sequence[int] = 0,
    **options: Any,
) -> list[ChaosReport | None]:
    """``megno`` of many small systems of as many bodies, side by side as in a `kickdrift.batch.Batch`.

    Parameters
    ----------
    systems : what a Batch takes
    time, integrator, dt, seeds, options : as in ``megno``, of all or one for each; the number of steps must be the same
        for all. Methods: splittings and Runge-Kutta of fixed steps

    Returns what ``megno`` finds of each, up to round-off; None of one that blows up or whose deviation vanishes, which
    ``megno`` alone says more of. Each report holds three series of up to some 10,000 looks. Raises InputError for what
    makes no sense, naming the system.
    """
    from kickdrift.analysis.chaos_lanes import growths

    systems = tuple(systems)
    count = len(systems)
    asked, options = unpacked(integrator, {"dt": dt, **options})
    dt = options.pop("dt", None)
    names = {carrier(system, asked) if isinstance(system, System) else "" for system in systems}
    if len(names) > 1:
        raise InputError(
            f"integrator: a batch needs one integrator for all systems; theirs are {', '.join(sorted(names))}"
        )
    drawn = [_checked_seed(seed) for seed in _each("seeds", seeds, count)]
    lengths = [length_of(*pair) for pair in zip(systems, _each("time", time, count), strict=True)]
    found = growths(systems, lengths, min(names, default=asked), dt, drawn, options)
    reports: list[ChaosReport | None] = []
    for k, (system, seed) in enumerate(zip(systems, drawn, strict=True)):
        begin, end, growth = found.begin[k], float(found.end[k]), found.growth[k]
        sound = np.isfinite(growth).all() and np.isfinite([*begin, end]).all()
        step, times = float(found.dt[k]), found.times[k]
        reports.append(
            _report(system, found.integrator, step, found.steps, seed, (Energies(*begin), end), times, growth)
            if sound
            else None
        )
    return reports


def _each(key: str, value: Any, count: int) -> list[Any]:
    """One for each system."""
    values = [value] * count if value is None or np.ndim(value) == 0 else list(value)
    if len(values) != count:
        raise InputError(f"{key}: expected one or {count}, one for each system, got {len(values)}")
    return values


def _report(
    system: System,
    integrator: str,
    dt: float | None,
    steps: int,
    seed: int,
    energies: tuple[Energies, float],
    times: Floats,
    growth: Floats,
) -> ChaosReport:
    """What the growth of a deviation says."""
    means = mean_megno(times, growth)
    slope, error = _slope(times, means)
    found, (begin, end) = float(means[-1]), energies
    return ChaosReport(
        system=system.name,
        integrator=integrator,
        dt=dt,
        time=float(times[-1]),
        time_unit=system.units.time,
        steps=steps,
        seed=seed,
        megno=found,
        verdict=verdict(found),
        lyapunov=2.0 * slope,
        lyapunov_error=2.0 * error,
        energy_error=abs(end - begin.total) / (abs(begin.total) or abs(begin.kinetic) or 1.0),
        times=times,
        means=means,
        growth=growth,
    )


def _checked_seed(seed: Any) -> int:
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise InputError(f"seed: expected a whole number, zero or more, got {seed!r}")
    return int(seed)


def length_of(system: System, time: float | None) -> float:
    """How long to run."""
    length = system.run.time if time is None else time
    if time is None and length is None and system.run.steps and system.run.dt:
        length = system.run.steps * system.run.dt
    if length is None:
        raise InputError(f"time: system {system.name!r} has no time in [run]; give a time")
    if not (isinstance(length, (int, float, np.number)) and math.isfinite(length) and length > 0):
        raise InputError(f"time must be a positive finite time, got {length!r}")
    return float(length)


def verdict(megno: float) -> Verdict:
    """What a mean MEGNO says."""
    if abs(megno - 2.0) < REGULAR:
        return "regular"
    return "chaotic" if megno > CHAOTIC else "undecided"


def mean_megno(times: Floats, growth: Floats) -> Floats:
    """<Y> at each of the times, the first of them 0, from ln d: both integrals by the trapezoidal rule, the first over
    ln d, which makes it MEGNO's sum for maps (Cincotta, Giordano & Simo 2003, section 4.1) where times are far
    apart."""
    middles, lengths = 0.5 * (times[1:] + times[:-1]), np.diff(times)
    y = np.concatenate([[0.0], 2.0 * np.cumsum(middles * np.diff(growth)) / times[1:]])
    total = np.cumsum(0.5 * (y[1:] + y[:-1]) * lengths)
    return np.concatenate([[0.0], total / times[1:]])


def carrier(system: System, integrator: str | None) -> str:
    """The integrator to run with."""
    if integrator is not None:
        if not method_named(integrator).carries:
            raise InputError(f"integrator: {integrator} carries no variations; {DEFAULT} does, and yoshida6")
        return integrator
    named = INTEGRATORS.get(system.run.integrator or "")
    return named.name if named is not None and named.carries else DEFAULT


def scale_of(phase: Floats, accelerations: Floats) -> Floats:
    """(…, 2, 1, 1) of particles at phase (…, 2, 3, n): the scatter of positions about their mean, and a speed: that of
    the particles together with what the forces lend in that distance. They make a deviation's length the same in any
    units."""
    scatter = _rms(phase - phase.mean(axis=-1, keepdims=True))
    distance = _or(_or(scatter[..., 0], _rms(phase[..., 0, :, :])), 1.0)
    speed = _or(np.sqrt(scatter[..., 1] ** 2 + distance * _rms(accelerations)), 1.0)
    return np.stack([distance, speed], axis=-1)[..., None, None]


def _or(value: Floats, other: Floats | float) -> Floats:
    return np.where(value == 0.0, other, value)


def _rms(vectors: Floats) -> Floats:
    """Of the lengths of vectors (…, 3, n)."""
    return np.sqrt((vectors**2).sum(axis=-2).mean(axis=-1))


def first_deviation(n: int, seed: int) -> Floats:
    """(2, 3, n), of length 1."""
    drawn = np.random.Generator(np.random.PCG64(seed)).standard_normal((2, 3, n))
    return drawn / np.linalg.norm(drawn)


def cadence(length: float, dt: float) -> tuple[int, int]:
    """How many steps to take, and how many from look to look."""
    steps = max(1, round(steps_in("time", length, dt)))
    return steps, max(1, steps // LOOKS)


def _growth(
    sim: Simulation, length: float, scale: Floats, progress: Callable[[int, int], Any] | None
) -> tuple[Floats, Floats]:
    """Run a varied System for a time: times since the start, and ln of the deviation's length at them."""
    start = sim.time
    n = len(sim.system) // 2
    steps, every = (MOST_STEPS, 1) if sim.method.chooses_steps else cadence(length, sim.dt or length)
    times, growth, scaled, exponent = [0.0], [0.0], 0.0, 0

    def visit(sim: Simulation) -> bool:
        """Note the deviation's length; whether the time is over, or the deviation is to be scaled back."""
        nonlocal scaled, exponent
        size = float(np.linalg.norm(sim.integration.y[:, :, n:] / scale))
        if not size > 0.0:
            raise InputError("megno: the deviation vanished: these forces lose every trace of the start")
        times.append(sim.time - start)
        growth.append(math.log(size) + scaled)
        exponent = 0 if 1.0 / LARGEST < size < LARGEST else round(math.log2(size))
        scaled += exponent * math.log(2.0)
        if progress and len(times) % 64 == 0:
            progress(int(1000 * min(1.0, times[-1] / length)), 1000)
        return exponent != 0 or over()

    def over() -> bool:
        return sim.steps_done >= steps or (steps == MOST_STEPS and times[-1] >= length)

    while not over():
        sim.advance(steps - sim.steps_done, every=every, visit=visit)
        if exponent:
            state = sim.state
            state.phase[:, :, n:] *= 2.0**-exponent  # a power of two: no digit changes
            sim.state, exponent = state, 0
    return np.array(times), np.array(growth)


def _slope(times: Floats, means: Floats) -> tuple[float, float]:
    """Of <Y> over the settled part of the run, and half the difference between its halves'."""
    settled = times >= SETTLED * times[-1]
    t, y = times[settled], means[settled]
    if len(t) < 6:
        raise InputError(f"time: {len(times) - 1} steps are too few to measure growth; give a longer time")
    half = len(t) // 2
    whole, early, late = (_line(t[part], y[part]) for part in (slice(None), slice(half), slice(half, None)))
    return whole, abs(late - early) / 2


def _line(t: Floats, y: Floats) -> float:
    """The slope of the straight line of least squares."""
    t = t - t.mean()
    return float(t @ (y - y.mean()) / (t @ t))
