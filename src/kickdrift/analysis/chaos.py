"""Is a motion chaotic?  MEGNO and the largest Lyapunov exponent, from a deviation vector that rides along.

With d(t) the length of a solution of the variational equations, the Mean Exponential Growth of Nearby Orbits is

    Y(t) = 2 / t  integral of s (d'/d) ds from 0 to t,

and its running mean <Y> goes to 2 for a quasi-periodic motion and as lambda t / 2 for a chaotic one, lambda the largest
Lyapunov exponent (Cincotta & Simo 2000, doi:10.1051/aas:2000108; Cincotta, Giordano & Simo 2003,
doi:10.1016/S0167-2789(03)00103-9).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.variations import varied
from kickdrift.integrators import INTEGRATORS
from kickdrift.integrators import integrator as method_named
from kickdrift.simulation import Simulation
from kickdrift.state import Floats
from kickdrift.system import System

if TYPE_CHECKING:
    from kickdrift.problem import Problem

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
    integrator: str | None = None,
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
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise InputError(f"seed: expected a whole number, zero or more, got {seed!r}")
    name = _carrier(system, integrator)
    length = system.run.time if time is None else time
    if time is None and length is None and system.run.steps and system.run.dt:
        length = system.run.steps * system.run.dt
    if length is None:
        raise InputError(f"time: system {system.name!r} names none in [run]; give how long to run")
    if not (isinstance(length, (int, float, np.number)) and math.isfinite(length) and length > 0):
        raise InputError(f"time must be a positive finite time, got {length!r}")
    sim = Simulation(varied(system, np.zeros_like(system.state.phase)), name, dt, threads, **options)
    scale = _scale(sim, len(system))
    state = sim.state
    state.phase[:, :, len(system) :] = _first_deviation(len(system), int(seed)) * scale
    sim.state = state
    begin = sim.energy()
    times, growth = _growth(sim, float(length), scale, progress)
    end = sim.energy()
    means = mean_megno(times, growth)
    slope, error = _slope(times, means)
    found = float(means[-1])
    return ChaosReport(
        system=system.name,
        integrator=sim.integrator,
        dt=None if sim.method.chooses_steps else sim.dt,
        time=float(times[-1]),
        time_unit=system.units.time,
        steps=sim.steps_done,
        seed=int(seed),
        megno=found,
        verdict=verdict(found),
        lyapunov=2.0 * slope,
        lyapunov_error=2.0 * error,
        energy_error=abs(end.total - begin.total) / (abs(begin.total) or abs(begin.kinetic) or 1.0),
        times=times,
        means=means,
        growth=growth,
    )


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


def _carrier(system: System, integrator: str | None) -> str:
    """The integrator to run with."""
    if integrator is not None:
        if not method_named(integrator).carries:
            raise InputError(f"integrator: {integrator} carries no variations; {DEFAULT} does, and yoshida6")
        return integrator
    named = INTEGRATORS.get(system.run.integrator or "")
    return named.name if named is not None and named.carries else DEFAULT


def _scale(sim: Simulation, n: int) -> Floats:
    """(2, 1, 1): the scatter of positions about their mean, and a speed: that of the particles together with what the
    forces lend in that distance. They make a deviation's length the same in any units."""
    phase = sim.state.phase[:, :, :n]
    x, v = (row - row.mean(axis=1, keepdims=True) for row in phase)
    accelerations = sim._flow.accelerations(sim.state.phase, sim.time)  # type: ignore[union-attr]
    pull = 0.0 if accelerations is None else _rms(accelerations[:, :n])
    distance = _rms(x) or _rms(phase[0]) or 1.0
    speed = math.sqrt(_rms(v) ** 2 + distance * pull) or 1.0
    return np.array([distance, speed]).reshape(2, 1, 1)


def _rms(vectors: Floats) -> float:
    return float(np.sqrt((vectors**2).sum(axis=0).mean()))


def _first_deviation(n: int, seed: int) -> Floats:
    """(2, 3, n), of length 1."""
    drawn = np.random.Generator(np.random.PCG64(seed)).standard_normal((2, 3, n))
    return drawn / np.linalg.norm(drawn)


def _growth(
    sim: Simulation, length: float, scale: Floats, progress: Callable[[int, int], Any] | None
) -> tuple[Floats, Floats]:
    """Run a varied System for a time: times since the start, and ln of the deviation's length at them."""
    stepper, start = sim._stepper, sim.time
    n = len(sim.system) // 2
    steps = None if sim.method.chooses_steps else max(1, round(length / (sim.dt or length)))
    every = 1 if steps is None else max(1, steps // LOOKS)
    times, growth, scaled = [0.0], [0.0], 0.0
    sim._prepare()
    with sim._busy() as interrupted:
        while not interrupted():
            left = 1 if steps is None else steps - sim.steps_done
            if left == 0 or (steps is None and times[-1] >= length):
                break
            sim._advance(min(every, left))
            deviation = stepper.y[:, :, n:]
            size = float(np.linalg.norm(deviation / scale))
            if not size > 0.0:
                raise InputError("megno: the deviation vanished: these forces lose every trace of the start")
            times.append(sim.time - start)
            growth.append(math.log(size) + scaled)
            if not 1.0 / LARGEST < size < LARGEST:
                exponent = round(math.log2(size))
                scaled += exponent * math.log(2.0)
                y = stepper.y.copy()
                y[:, :, n:] *= 2.0**-exponent  # a power of two: no digit changes
                stepper.reset(y, sim.time, sim.steps_done)
            if progress and len(times) % 64 == 0:
                progress(int(1000 * min(1.0, times[-1] / length)), 1000)
    if interrupted():
        raise KeyboardInterrupt
    return np.array(times), np.array(growth)


def _slope(times: Floats, means: Floats) -> tuple[float, float]:
    """Of <Y> over the settled part of the run, and half the difference between its halves'."""
    settled = times >= SETTLED * times[-1]
    t, y = times[settled], means[settled]
    if len(t) < 6:
        raise InputError(f"time: {len(times) - 1} steps are too few to tell growth by; give a longer time")
    half = len(t) // 2
    whole, early, late = (np.polyfit(t[part], y[part], 1)[0] for part in (slice(None), slice(half), slice(half, None)))
    return float(whole), float(abs(late - early) / 2)
