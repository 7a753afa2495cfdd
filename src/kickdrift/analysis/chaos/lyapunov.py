"""Lyapunov spectra: the rates at which volumes of deviations grow.

k deviations obey the variational equation. Now and then they are made orthonormal by a QR factorisation, and the
logarithms of R's diagonal add up. Over time, they tend to t times the k largest exponents, in descending order
(Benettin et al. 1980, doi:10.1007/BF02128236 and doi:10.1007/BF02128237; Geist, Parlitz & Lauterborn 1990,
doi:10.1143/PTP.83.875).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from kickdrift.analysis.chaos.frames import MovingFrame, checked_seed, frame_of, length_of
from kickdrift.analysis.doubts import doubts_at, plain, run_lines, warning_lines
from kickdrift.analysis.tangents.deviations import cadence
from kickdrift.display.showing import Lines, Shown, following
from kickdrift.errors import InputError, RunError
from kickdrift.integrators.asked import Integrator, unpacked
from kickdrift.jit.cache.notices import compiling_for
from kickdrift.model.checks.limits import MOST_STEPS
from kickdrift.model.problem import Problem
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.model.units.unit_systems import symbol_of

EVERY = 8  # most steps between two looks: in these, the strongest decay of a stable method leaves half of the digits
LOOKS = 100  # least number of looks, where there are enough steps
LARGEST = 1e3  # ratio of the lengths along and across that makes them orthonormal again, and growth that does so
SETTLED = 0.1  # first part of the run, in which the deviations turn to their directions
LEAST = 10  # looks


@dataclass(frozen=True, repr=False)
class LyapunovSpectrum(Shown):
    """Lyapunov exponents of a motion.

    Attributes
    ----------
    system, integrator, dt, time, time_unit, steps, seed : the run, and the seed of the first deviations; ``time_unit``
        is "" for a Problem
    exponents : (k,) per unit of time: mean rates over the last nine tenths of the run. They tend to descending order
    errors : (k,) half the difference between the results of the two halves of this part
    complete : whether these are all exponents of the motion
    times, growth : (m,) times since the start, and (m, k) the sums of logarithms at these times
    warnings : what is wrong with the trajectory, or doubtful in the forces
    """

    system: str
    integrator: str
    dt: float | None
    time: float
    time_unit: str
    steps: int
    seed: int
    exponents: Floats
    errors: Floats
    complete: bool
    times: Floats = field(repr=False)
    growth: Floats = field(repr=False)
    warnings: list[str] = field(default_factory=list)

    @property
    def sum(self) -> float:
        """Sum of these exponents. The sum of all is the mean divergence of the flow: zero for conservative forces."""
        return float(self.exponents.sum())

    @property
    def dimension(self) -> float | None:
        """Dimension of an attractor after Kaplan and Yorke (Frederickson et al. 1983,
        doi:10.1016/0022-0396(83)90011-6); None without all exponents."""
        if not self.complete:
            return None
        sums = np.cumsum(np.sort(self.exponents)[::-1])
        whole = int(np.count_nonzero(sums >= 0.0))
        if whole in (0, len(sums)):
            return float(whole)
        return whole + float(sums[whole - 1] / abs(np.sort(self.exponents)[::-1][whole]))

    def _lines(self) -> Lines:
        unit, lines = symbol_of(self.time_unit), run_lines(self)
        for k, (value, error) in enumerate(zip(self.exponents, self.errors, strict=True), 1):
            per = f" per {unit or 'unit of time'}" if k == 1 else ""
            lines.append((f"exponent {k}", f"{value:.4g} ± {error:.1g}{per}"))
        lines.append(("sum", f"{self.sum:.3g}" + ("" if self.complete else " of these exponents")))
        return lines + warning_lines(self.warnings)

    def as_json(self) -> dict[str, Any]:
        """The spectrum as one JSON object, with series of at most some 500 points."""
        return plain(self, "times", "growth") | {"sum": self.sum, "dimension": self.dimension}


def lyapunov_spectrum(
    system: System | Problem,
    time: float | str | None = None,
    integrator: str | Integrator | None = None,
    dt: float | str | None = None,
    *,
    count: int | None = None,
    seed: int = 0,
    threads: int = 1,
    progress: bool | Callable[[int, int], Any] | None = None,
    **options: Any,
) -> LyapunovSpectrum:
    """Lyapunov exponents of a System or a Problem, all of them or the largest ones.

    ``count`` deviations move with the motion, and are made orthonormal again and again (Benettin et al. 1980,
    doi:10.1007/BF02128237).

    Parameters
    ----------
    system, time, integrator, dt, options : as in `megno`
    count : number of exponents; default all: 6 for each particle, or as many as a Problem has unknowns
    seed : seed of the first deviations
    progress : True shows a bar; a function is called as ``progress(done, of)``

    Returns
    -------
    LyapunovSpectrum

    Raises
    ------
    InputError
        For arguments that make no sense, and for a force without variational equations.
    RunError
        If the run blows up.
    """
    if not isinstance(system, System | Problem):
        raise InputError(f"lyapunov_spectrum: takes a System or a Problem, got {type(system).__name__}")
    most = len(system) * (6 if isinstance(system, System) else 1)
    whole = isinstance(count, int | np.integer) and not isinstance(count, bool)
    if count is not None and not (whole and 1 <= count <= most):
        raise InputError(f"count: expected a number of exponents from 1 to {most}, got {count!r}")
    seed, number = checked_seed(seed), most if count is None else int(count)
    asked, given = unpacked(integrator, {"dt": dt, **options})
    length = length_of(system, time)
    drawn = np.random.Generator(np.random.PCG64(seed)).standard_normal((number, most))
    frame = frame_of(system, asked, given, threads, np.linalg.qr(drawn.T)[0])
    with compiling_for(frame.sim.integration.purpose), following(progress, "running") as told:
        times, growth = _followed(frame, length, told)
        doubts = doubts_at(system, frame.end)
    exponents, errors = _rates(times, growth)
    chosen = None if frame.sim.method.chooses_steps else frame.sim.dt
    unit = system.units.time if isinstance(system, System) else ""
    return LyapunovSpectrum(
        system.name, frame.sim.integrator, chosen, float(times[-1]), unit, frame.steps_done, seed, exponents, errors,
        number == most, times, growth, doubts,
    )  # fmt: skip


def _followed(frame: MovingFrame, length: float, told: Callable[[int, int], Any] | None) -> tuple[Floats, Floats]:
    """Run. Return times since the start (m,), and the sums of logarithms (m, k)."""
    steps, every = MOST_STEPS, 1
    if not frame.sim.method.chooses_steps:
        steps, _ = cadence(length, frame.sim.dt or length)
        every = max(1, min(EVERY, steps // LOOKS))
    start = frame.time
    total: Floats = np.zeros(frame.matrix().shape[1])
    times, growth = [0.0], [total]

    def visit(_: Any) -> bool:
        """Look at the deviations. Return whether they must be made orthonormal, or the time is over."""
        vectors = frame.matrix()
        if not np.isfinite(vectors).all():
            raise RunError(f"{frame.sim.integrator}: the deviations blew up before step {frame.steps_done}")
        sizes = np.abs(np.diag(np.linalg.qr(vectors, mode="r")))
        if not (sizes > 0.0).all():
            raise InputError("count: a deviation vanished, since these forces lose a trace of the start; lower it")
        times.append(frame.time - start)
        growth.append(total + np.log(sizes))
        if told and len(times) % 64 == 0:
            told(int(1000 * min(1.0, times[-1] / length)), 1000)
        low, high = min(1.0, sizes.min()), max(1.0, sizes.max(), float(np.abs(vectors).max()))
        return bool(high > LARGEST * low) or over()

    def over() -> bool:
        return frame.steps_done >= steps or (steps == MOST_STEPS and times[-1] >= length)

    while not over():
        frame.advance(steps - frame.steps_done, every=every, visit=visit)
        if not over():
            frame.straighten()
            total = growth[-1]
    return np.array(times), np.array(growth)


def _rates(times: Floats, growth: Floats) -> tuple[Floats, Floats]:
    """Mean rates over the settled part of a run, and half the difference between those of its halves."""
    if len(times) < LEAST:
        raise InputError(f"time: {len(times) - 1} looks are too few to measure growth; give a longer time")
    first = int(np.searchsorted(times, SETTLED * times[-1]))
    middle = int(np.searchsorted(times, 0.5 * (times[first] + times[-1])))

    def rate(begin: int, end: int) -> Floats:
        return np.asarray((growth[end] - growth[begin]) / (times[end] - times[begin]))

    last = len(times) - 1
    return rate(first, last), 0.5 * np.abs(rate(first, middle) - rate(middle, last))
