"""Motion of particles: mean squared displacement, velocity autocorrelation, and self-diffusion from either."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import fft

from kickdrift.analysis.observables.vectors import Source, Vectors, vectors_of
from kickdrift.errors import InputError
from kickdrift.looks.report_lines import mean_with_units
from kickdrift.model.state import Floats
from kickdrift.model.units.unit_systems import UnitSystem, symbol_of
from kickdrift.statistics.blocks import Mean, block_average

STRETCHES = 64  # stretches of time origins, whose means are the rows of the error's blocks
CUBE = 2.837297  # xi of Yeh & Hummer: the lattice sum of a cubic box


@dataclass(frozen=True)
class Diffusion:
    """A self-diffusion coefficient in length² per time, its standard error, and the time window of the fit.

    The error is infinite if the run is too short. ``unit`` is the unit of value and error, "" for arrays and plain
    numbers; as text, a familiar unit stands beside it. ``known_to`` is the longest time with a known error of the
    correlation function; an error is unknown for times beyond."""

    value: float
    error: float
    window: tuple[float, float]
    unit: str = ""
    known_to: float = math.nan

    def __str__(self) -> str:
        if math.isfinite(self.error):
            return mean_with_units(self.value, self.error, self.unit)
        unknown = f"error unknown: the run is too short for times up to {self.window[1]:g}"
        unknown += f"; errors end at {self.known_to:g}" if self.known_to < self.window[1] else ""
        return f"{mean_with_units(self.value, None, self.unit)}, {unknown}"

    def at_infinite_size(self, temperature: float, viscosity: float, edge: float, boltzmann: float = 1.0) -> Diffusion:
        """D + ξ k_B T / (6π η L), ξ = 2.837297: the coefficient for an infinite cubic box.

        The drag of a particle's own periodic images slows the particle (Yeh & Hummer 2004, J. Phys. Chem. B 108, 15873,
        doi:10.1021/jp0477147). ``viscosity`` is in pressure times time. ``edge`` is the box's. ``boltzmann`` is the
        unit system's constant (``run.units.boltzmann``). The error is that of D alone.
        """
        for name, value in (("temperature", temperature), ("viscosity", viscosity), ("edge", edge)):
            if not (math.isfinite(value) and value > 0):
                raise InputError(f"at_infinite_size: {name} must be positive, got {value}")
        return replace(self, value=self.value + CUBE * boltzmann * temperature / (6 * math.pi * viscosity * edge))


class _Stretches(NamedTuple):
    """Sums of a time correlation over stretches of time origins, (stretches, lags), and the number of terms in each."""

    sums: Floats
    terms: NDArray[np.int64]

    def mean(self) -> Floats:
        """Means over all time origins, (lags,)."""
        total: Floats = self.sums.sum(axis=0)
        return total / self.terms.sum(axis=0)

    def rows(self, lag: int) -> Floats:
        """Means (k, lag + 1) of the stretches in which every origin has a frame ``lag`` later."""
        whole = int(np.count_nonzero(self.terms[:, lag] == self.terms[0, 0]))
        return self.sums[:whole, : lag + 1] / self.terms[0, 0]

    def errors(self) -> Floats:
        """Standard errors (lags,); infinite for lags with too few stretches."""
        errors = np.full(self.sums.shape[1], np.inf)
        whole = np.count_nonzero(self.terms == self.terms[0, 0], axis=0)
        for count in np.unique(whole[whole > 0]):
            lags = np.flatnonzero(whole == count)
            errors[lags] = block_average(self.sums[:count, lags] / self.terms[0, 0]).error
        return errors


@dataclass(frozen=True)
class _Correlation:
    """A function of the time between two frames.

    Attributes
    ----------
    times : (lags,) 0, dt, 2 dt, …
    values : (lags,) means over particles and all time origins
    error : (lags,) standard errors, infinite where the run is too short for the lag
    frames : int
    dimensions : 3, or 2 for a run in two dimensions
    units : the run's unit system; None for arrays
    """

    times: Floats
    values: Floats
    error: Floats
    frames: int
    _stretches: _Stretches
    dimensions: int = 3
    units: UnitSystem | None = None

    def _lag(self, name: str, time: float) -> int:
        step = float(self.times[1]) if len(self.times) > 1 else math.inf
        if not 0 <= time <= self.times[-1] + 0.5 * step:
            raise InputError(f"diffusion: {name} = {time:g} is not among the times, 0 to {self.times[-1]:g}")
        return min(round(time / step), len(self.times) - 1)

    def _diffusion(self, weights: Floats, first: int) -> Diffusion:
        """D = weights · values up to the last weighted lag, from ``first`` on."""
        last = len(weights) - 1
        rows = self._stretches.rows(last) @ weights
        found = block_average(rows) if len(rows) else Mean(np.nan, np.inf, 0)  # type: ignore[arg-type]
        window = float(self.times[first]), float(self.times[last])
        unit = symbol_of(f"{self.units.length}^2/{self.units.time}") if self.units else ""
        known = np.flatnonzero(np.isfinite(self.error))
        known_to = float(self.times[known[-1]]) if len(known) else 0.0
        return Diffusion(float(weights @ self.values[: last + 1]), float(found.error), window, unit, known_to)


class MeanSquaredDisplacement(_Correlation):
    """<|r(t0 + t) - r(t0)|²> in length²; see ``mean_squared_displacement``."""

    def diffusion(self, start: float | None = None, stop: float | None = None) -> Diffusion:
        """D = slope / 6 of the least-squares line through the values from ``start`` to ``stop``; in two dimensions
        slope / 4.

        Einstein's relation (Allen & Tildesley 2017, eq. 2.117, doi:10.1093/oso/9780198803195.001.0001) needs times at
        which the displacement is linear in time. By default ``stop`` is the longest time with a known standard error,
        or the last time if there is none, and ``start`` is half of it. Look at the curve before you trust the default.
        The error is by block averages of the same slope over time origins.
        """
        if stop is None:
            known = np.flatnonzero(np.isfinite(self.error))
            stop = float(self.times[known[-1] if len(known) and known[-1] > 1 else -1])
        start = stop / 2 if start is None else start
        first, last = self._lag("start", start), self._lag("stop", stop)
        if last <= first:
            raise InputError(f"diffusion: expected two lags or more from {start:g} to {stop:g}")
        apart = self.times[first : last + 1] - self.times[first : last + 1].mean()
        weights = np.zeros(last + 1)
        weights[first:] = apart / (apart @ apart) / (2 * self.dimensions)
        return self._diffusion(weights, first)


class VelocityAutocorrelation(_Correlation):
    """<v(t0 + t) · v(t0)> in velocity²; see ``velocity_autocorrelation``."""

    @property
    def normalised(self) -> Floats:
        """Values divided by the value at 0, (lags,)."""
        return self.values / self.values[0]

    def diffusion(self, until: float) -> Diffusion:
        """D = 1/3, in two dimensions 1/2, of the integral from 0 to ``until``, by the trapezoidal rule.

        Green & Kubo (Allen & Tildesley 2017, eq. 2.116, doi:10.1093/oso/9780198803195.001.0001). The integral leaves
        out times after ``until``. Frames must be close enough for a smooth function. The error is by block averages of
        the same integral over time origins.
        """
        last = self._lag("until", until)
        if last < 1:
            raise InputError(f"diffusion: until = {until:g} is not the time of a frame")
        weights = np.full(last + 1, self.times[1] / self.dimensions)
        weights[[0, -1]] /= 2
        return self._diffusion(weights, 0)


def mean_squared_displacement(
    source: Source,
    times: ArrayLike | None = None,
    lags: int | None = None,
    *,
    of: str | None = None,
    remove_drift: bool = False,
    masses: ArrayLike | None = None,
    species: Sequence[str] | None = None,
) -> MeanSquaredDisplacement:
    """Mean squared displacement over all particles and all time origins, by fast Fourier transforms.

    Allen & Tildesley 2017, section 8.4; in O(f log f) for f frames as Kneller et al. 1995, Comput. Phys. Commun. 91,
    191, doi:10.1016/0010-4655(95)00048-K. Errors come from block averages over 64 stretches of time origins.
    Displacements over a time t are correlated for that time, so lags beyond about a tenth of the run have infinite
    errors.

    A barostat scales all positions with the box. Displacements in such a run are the sums of the displacements inside
    the box, without this scaling (von Bülow, Bullerjahn & Hummer 2020, doi:10.1063/5.0008316).

    Parameters
    ----------
    source : a run, open or by its path, or some of its frames, ``run[100::10]``; or unwrapped positions (frames, n, 3)
    times : (frames,) evenly spaced; with positions alone
    lags : number of lags; default a quarter of the frames
    of : species to average over; default all particles
    remove_drift : take displacements relative to the centre of mass of all particles
    masses, species : (n,); with positions alone

    Raises
    ------
    InputError
        For frames that are not evenly spaced.
    """
    found = vectors_of(source, "positions", times=times, masses=masses, species=species)
    return MeanSquaredDisplacement(*_correlation(found, lags, of, remove_drift, displacements=True))


def velocity_autocorrelation(
    source: Source,
    times: ArrayLike | None = None,
    lags: int | None = None,
    *,
    of: str | None = None,
    remove_drift: bool = False,
    masses: ArrayLike | None = None,
    species: Sequence[str] | None = None,
) -> VelocityAutocorrelation:
    """Velocity autocorrelation function over all particles and all time origins, by fast Fourier transforms.

    Allen & Tildesley 2017, section 8.4, doi:10.1093/oso/9780198803195.001.0001. Parameters are as in
    ``mean_squared_displacement``, with velocities (frames, n, 3) instead of positions.
    """
    found = vectors_of(source, "velocities", times=times, masses=masses, species=species)
    return VelocityAutocorrelation(*_correlation(found, lags, of, remove_drift, displacements=False))


def _correlation(
    found: Vectors, lags: int | None, of: str | None, remove_drift: bool, displacements: bool
) -> tuple[Floats, Floats, Floats, int, _Stretches, int, UnitSystem | None]:
    count = len(found)
    step = found.spacing()
    number = max(2, count // 4) if lags is None else lags
    if not 1 <= number <= count:
        raise InputError(f"lags: expected 1 to {count}, the number of frames, got {number}")
    members = np.ones(found.particles, bool) if of is None else found.species == of
    if not members.any():
        raise InputError(f"of: no species {of!r}; known are {', '.join(sorted(set(found.species)))}")
    drift = found.centre_of_mass()[:, None] if remove_drift else 0.0
    starts = np.arange(0, count, -(-count // STRETCHES))
    stops = np.append(starts[1:], count)
    sums = np.zeros((len(starts), number))
    for some, paths in found.paths():
        paths = (paths - drift)[:, members[some]].reshape(count, -1).T
        for row, (start, stop) in enumerate(zip(starts, stops, strict=True)):
            sums[row] += _stretch(paths[:, start : stop + number - 1], stop - start, number, displacements)
    later = np.arange(number)
    terms = np.clip(count - later - starts[:, None], 0, (stops - starts)[:, None]) * int(members.sum())
    stretches = _Stretches(sums, terms)
    times, about = step * later.astype(np.float64), (found.dimensions, found.units)
    return times, stretches.mean(), stretches.errors(), count, stretches, *about


def _stretch(x: Floats, origins: int, lags: int, displacements: bool) -> Floats:
    """Sums (lags,) over series x (s, f) and their first ``origins`` points of x(t) x(t + m), or of the squared
    difference, as far as there are points.

    A difference is |x(t)|² + |x(t + m)|² - 2 x(t) x(t + m). Series relative to their means lose the fewest digits.
    """
    if displacements:
        x = x - x.mean(axis=1, keepdims=True)
    have = x.shape[1]
    size = fft.next_fast_len(origins + lags, real=True)
    early, all_ = fft.rfft(x[:, :origins], size), fft.rfft(x, size)
    products = fft.irfft(np.einsum("sk,sk->k", early.conj(), all_), size)[:lags]
    if not displacements:
        return products
    squares = np.concatenate([[0.0], np.cumsum(np.einsum("sf,sf->f", x, x))])
    m = np.arange(lags)
    ends = np.clip(have - m, 0, origins)  # origins with a point m later
    both = squares[ends] + squares[np.minimum(ends + m, have)] - squares[np.minimum(m, have)]
    sums = np.where(ends > 0, both - 2 * products, 0.0)
    sums[0] = 0.0  # exact, without rounding
    return sums
