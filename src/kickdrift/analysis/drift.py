"""Does an invariant drift?  Size of the energy error, and the slope of a correlated series with an honest interval."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kickdrift.errors import InputError

Array = NDArray[np.float64]
Verdict = Literal["bounded", "secular drift", "random walk", "not resolvable"]

MIN_SAMPLES = 40  # with 36, one white-noise series in twenty already passes for a random walk
MAX_SAMPLES = 2000  # longer series are averaged in bins: only the slow end of the spectrum bears on the slope
CONFIDENCE = 0.95  # of the interval
SIGNIFICANCE = 0.01  # of the verdict "secular drift", stricter so that one verdict in a hundred is wrong, not in twenty
MAX_LINES = 40
MIN_CYCLES = 3.0  # a slower wave cannot be told from a trend
LINE_SIGNIFICANCE = 1e-4
RESIDUE = 1e-9  # of the waves: what they leave below that is the rounding of many steps, whatever way it walks
# 1 % points of the Dickey-Fuller t as a + b / n, with constant and trend and with a constant only; MacKinnon (2010),
# Queen's Economics Department Working Paper 1227, table 2.
UNIT_ROOT_TREND = (-3.95877, -9.0531)
UNIT_ROOT_CONSTANT = (-3.43035, -6.5393)


@dataclass(frozen=True)
class EnergyError:
    """How far the total energy left its first value; energies in the units given, errors dimensionless.

    ``initial`` and ``final`` are the first and last total energy.  ``rms_relative_error`` and ``max_relative_error``
    are the root mean square and the largest modulus, over all samples, of (E(t) - E(0)) / D.  ``relative_to`` names D:
    "initial energy", |E(0)|; "initial kinetic energy" K(0) is called "kinetic energy" and taken where |E(0)| < K(0)/10,
    because a total that cancels makes a ratio of no meaning; "absolute", D = 1, where both are zero (the errors then
    have the units of energy).
    """

    initial: float
    final: float
    rms_relative_error: float
    max_relative_error: float
    relative_to: Literal["initial energy", "kinetic energy", "absolute"]


@dataclass(frozen=True)
class Drift:
    """Linear trend of a series, its 95 % interval and what kind of motion the series shows.

    ``slope`` (value per unit time) lies within ``slope`` ± ``error``; ``error`` is infinite where nothing can be said.
    ``p_value`` is the two-sided probability of a slope this large when there is none.
    ``correlation_time`` (unit of time) is the integrated autocorrelation time, 1/2 + the sum of the autocorrelations,
    of what trend and spectral lines leave; ``effective_samples`` is the length over twice that (more than the samples
    for noise that undoes itself).  They are infinite and 1 where a unit root is not rejected, nan where nothing
    is left to estimate them from.  ``lines`` counts the sine waves found.
    """

    slope: float
    error: float
    verdict: Verdict
    p_value: float
    correlation_time: float
    effective_samples: float
    lines: int


def energy_error(total: ArrayLike, kinetic: ArrayLike) -> EnergyError:
    """Errors of the energies ``total`` (n,) relative to the first; ``kinetic`` (n,) or a number gives K(0).

    Raises InputError for an empty series, a wrong shape or a value that is not finite.
    """
    energy = _finite("total", total)
    initial, initial_kinetic = float(energy[0]), float(_finite("kinetic", np.atleast_1d(kinetic))[0])
    scale, relative_to = abs(initial), "initial energy"
    if scale < 0.1 * abs(initial_kinetic):
        scale, relative_to = abs(initial_kinetic), "kinetic energy"
    elif scale == 0.0:
        scale, relative_to = 1.0, "absolute"
    error = np.abs(energy - initial) / scale
    largest = float(error.max())
    # Squares of errors near 1e-170 would underflow; the ratio to the largest does not.
    rms = largest * float(np.sqrt(np.mean((error / largest) ** 2))) if largest > 0.0 else 0.0
    return EnergyError(initial, float(energy[-1]), rms, largest, relative_to)  # type: ignore[arg-type]


def drift(times: ArrayLike, values: ArrayLike) -> Drift:
    """Slope of ``values`` (n,) over the evenly spaced ``times`` (n,), with an interval that knows about correlation.

    1. Spectral lines, found by Fisher's test on the prewhitened periodogram, join the regression: a periodic error is
       a wave of its own, not noise that averages out.
    2. An autoregression with constant and trend, its order by BIC, gives the Dickey-Fuller t of a unit root.
    3. Unit root rejected at 1 %: generalised least squares, whitened by the autoregression, whose O(1/n) bias is taken
       out.  The interval is Student's, with the degrees of freedom that the uncertain noise level at zero frequency
       leaves (Satterthwaite).  "secular drift" if p < 0.01, else "bounded": stationary or periodic, no slope seen.
    4. Not rejected: the same for the mean of the increments.  "secular drift" if p < 0.01, else "random walk": over
       this length the series cannot be told from one whose spread grows as sqrt(t).  A stationary series shorter than
       some 25 times twice its correlation time also ends here: no test tells the two apart.
    5. "not resolvable": under 40 samples, a wave or a bend slower than 3 cycles in the whole series (``error`` infinite
       in both), or increments that wander themselves (``error`` as in 4).

    A series that is trend and lines to within rounding gets the rounding as its ``error``. One whose trend and residue
    over its whole length stay under 1e-9 of its lines is "bounded", with slope and error as found.  Over 2000 samples
    are averaged in equal bins; the first few that fill none are dropped.

    Raises InputError for unequal lengths, values that are not finite and times that are not evenly spaced.

    Sources: Fisher 1929 (10.1098/rspa.1929.0151); Said & Dickey 1984 (10.1093/biomet/71.3.599); bias of the
    autoregression, -(1 + 3r)/n with a constant, Kendall 1954 (10.1093/biomet/41.3-4.403), -(2 + 4r)/n with a trend, van
    Giersbergen 2005 (Economics Letters 89, 75); one trend inference for both kinds of noise, Perron & Yabu 2009
    (10.1016/j.jeconom.2009.03.011).
    """
    series, clock = _finite("values", values), _finite("times", times)
    n = len(series)
    if len(clock) != n:
        raise InputError(f"drift: {len(clock)} times but {n} values")
    step = float(clock[-1] - clock[0]) / max(n - 1, 1)
    if n > 1 and (step == 0.0 or np.abs(clock - clock[0] - step * np.arange(n)).max() > 0.05 * abs(step)):
        raise InputError("drift: times must be evenly spaced and not all equal; resample the series first")
    unknown = float("nan")
    if n > 1 and np.ptp(series) == 0.0:
        return Drift(0.0, 0.0, "bounded", 1.0, unknown, unknown, 0)
    if n < MIN_SAMPLES:
        slope = float(series[-1] - series[0]) / (n - 1) / step if n > 1 else 0.0
        return Drift(slope, float("inf"), "not resolvable", 1.0, unknown, unknown, 0)

    mean = series.mean()
    scale = float(np.abs(series - mean).max())
    width = -(-n // MAX_SAMPLES)
    count = n // width
    y = ((series - mean) / scale)[n - width * count :].reshape(count, width).mean(axis=1)
    step *= width
    unit = scale / step
    trend = np.column_stack((np.ones(count), np.arange(count) - 0.5 * (count - 1)))
    epsilon = float(np.finfo(np.float64).eps)
    rounding = 4.0 * epsilon * float(np.abs(series).max()) / scale
    blurred = max(rounding, 2.0 * epsilon * count)  # a wave is only as exact as its phase
    waves, slow = _lines(y, trend, blurred)
    lines = waves.shape[1] // 2
    floor = blurred if lines else rounding
    design = np.column_stack((trend, waves))
    coefficients, rest, _ = _least_squares(design, y)
    slope = float(coefficients[1]) * unit
    if np.abs(rest).max() <= floor:
        error = 2.0 * floor / count * abs(unit)
        exact: Verdict = "secular drift" if abs(slope) > error else "bounded"
        return Drift(slope, error, exact, 0.0 if abs(slope) > error else 1.0, unknown, unknown, lines)
    if slow:
        return Drift(slope, float("inf"), "not resolvable", 1.0, unknown, unknown, lines)

    from scipy.special import stdtr, stdtrit  # Student's t and its inverse; scipy.stats takes a second to import

    fit = _regression(y, design, 2)
    verdict: Verdict = "bounded"
    time, effective = 0.5 * abs(step) * fit.inefficiency, count / fit.inefficiency
    if fit.unit_root_t > UNIT_ROOT_TREND[0] + UNIT_ROOT_TREND[1] / count:
        time, effective = float("inf"), 1.0
        fit = _regression(np.diff(y - waves @ coefficients[2:]), np.ones((count - 1, 1)), 1)
        settled = fit.unit_root_t < UNIT_ROOT_CONSTANT[0] + UNIT_ROOT_CONSTANT[1] / count
        verdict = "random walk" if settled else "not resolvable"
    p_value = float(2.0 * stdtr(fit.freedom, -abs(fit.value) / fit.deviation))
    if p_value < SIGNIFICANCE and verdict != "not resolvable":
        verdict = "secular drift"
    if lines and max(float(np.abs(rest).max()), abs(float(coefficients[1])) * count) <= RESIDUE:
        verdict = "bounded"
    half_width = fit.deviation * float(stdtrit(fit.freedom, 0.5 + 0.5 * CONFIDENCE))
    return Drift(fit.value * unit, half_width * abs(unit), verdict, p_value, time, effective, lines)


@dataclass(frozen=True)
class _Fit:
    """One coefficient of a regression with autoregressive noise."""

    value: float
    deviation: float
    freedom: float
    unit_root_t: float
    inefficiency: float  # spectral density at zero frequency over variance: samples per independent sample


def _regression(y: Array, design: Array, deterministic: int) -> _Fit:
    """Generalised least squares of ``y`` on ``design`` with autoregressive noise, about column ``deterministic`` - 1.

    ``deterministic`` is how many leading columns the autoregression keeps (1: constant, 2: and trend).  It is
    du(i) = those + g u(i-1) + sum d(j) du(i-j) for the least-squares residuals u; g = 0 is a unit root.
    """
    n, target = len(y), deterministic - 1
    rest = _least_squares(design, y)[1]
    # Schwert 1989 (10.1080/07350015.1989.10509723), fewer in a short series.
    longest = min(int(12.0 * (n / 100.0) ** 0.25), n // 12)
    steps = np.diff(rest)

    def regressors(lags: int) -> tuple[Array, Array]:
        lagged = [steps[lags - j : len(steps) - j] for j in range(1, lags + 1)]
        return np.column_stack((design[lags + 1 :, :deterministic], rest[lags:-1], *lagged)), steps[lags:]

    # Columns are nested, so that one QR gives the residual of every order.
    matrix, right = regressors(longest)
    projections = (np.linalg.qr(matrix)[0].T @ right) ** 2
    squares = (right @ right - np.cumsum(projections)[deterministic:]) / (right @ right)
    criterion = len(right) * np.log(np.maximum(squares, 1e-30)) + np.log(len(right)) * np.arange(longest + 1)
    lags = int(np.argmin(criterion))
    solution, _, deviations = _least_squares(*regressors(lags))
    root, differences = solution[deterministic], solution[deterministic + 1 :]
    unit_root_t = float(root / deviations[deterministic])

    # Near g = 0 the estimate of g is too negative by (2k + 2) / n, k deterministic columns; with var g = -2 g / n there
    # that is a fraction (k + 1) / t^2 of g.  Written so, it vanishes where the root is well known, at any order.
    root *= max(1.0 - (deterministic + 1.0) / unit_root_t**2, 0.1)
    whitener = np.convolve([1.0, -1.0], np.concatenate(([1.0], -differences)))
    whitener[1] -= root

    def whiten(column: Array) -> Array:
        return np.convolve(column, whitener)[len(whitener) - 1 : len(column)]

    white = np.column_stack([whiten(column) for column in design.T])
    solution, noise, deviations = _least_squares(white, whiten(y), lags + 1)
    left = len(white) - white.shape[1] - lags - 1
    # log S(0) = log variance - 2 log |A(1)|: relative variances 2 / left and 4 / t^2, matched to chi^2's 2 / freedom.
    freedom = 1.0 / (1.0 / left + 2.0 / unit_root_t**2)
    inefficiency = float(noise @ noise / left / root**2 / np.var(y - design @ solution))
    return _Fit(float(solution[target]), float(deviations[target]), freedom, unit_root_t, inefficiency)


def _least_squares(matrix: Array, right: Array, used: int = 0) -> tuple[Array, Array, Array]:
    """Coefficients, residuals and standard errors; ``used`` degrees of freedom are gone besides the columns."""
    solution, inverse, norms = _normal_equations(matrix, right)
    rest = right - matrix @ (solution / norms)
    solution += inverse @ (matrix.T @ rest / norms)  # one refinement makes up for the squared condition
    rest = right - matrix @ (solution / norms)
    variance = rest @ rest / max(len(right) - len(norms) - used, 1)
    return solution / norms, rest, np.sqrt(variance * np.diag(inverse)) / norms


def _normal_equations(matrix: Array, right: Array) -> tuple[Array, Array, Array]:
    """Their solution, of columns over their norms, the inverse of their matrix, and the norms."""
    gram = matrix.T @ matrix
    norms: Array = np.sqrt(np.diag(gram))
    norms[norms == 0.0] = 1.0
    inverse: Array = _inverse(gram / np.outer(norms, norms))
    return inverse @ (matrix.T @ right / norms), inverse, norms


def _inverse(gram: Array) -> Array:
    """Of a symmetric matrix without negative eigenvalues; of those that rounding hides, nothing."""
    try:
        inverse = np.asarray(np.linalg.inv(gram), np.float64)
    except np.linalg.LinAlgError:
        inverse = np.full_like(gram, np.inf)
    if np.abs(gram).sum(axis=0).max() * np.abs(inverse).sum(axis=0).max() < 1e10:  # seven times as fast as below
        return inverse
    values, vectors = np.linalg.eigh(gram)
    return np.asarray((vectors / np.where(values > 1e-12 * values[-1], values, np.inf)) @ vectors.T)


def _lines(y: Array, trend: Array, floor: float) -> tuple[Array, bool]:
    """Cosine and sine columns (n, 2 L) of the significant spectral lines of ``y``, and whether a slow wave is left.

    Each pass whitens a red residual to first order, so that its slow end is no line, and tapers it, so that a slow wave
    does not leak into one; then all frequencies move together by Gauss-Newton.  Waves of under ``MIN_CYCLES`` cycles
    stay in, because trend and wave would share the blame arbitrarily.  ``floor`` is where rounding begins.
    """
    n, index = len(y), trend[:, 1]
    waves = np.empty((n, 0))
    frequencies = np.empty(0)
    for _ in range(MAX_LINES):
        rest = _least_squares(np.column_stack((trend, waves)), y)[1]
        if np.abs(rest).max() <= floor:
            break
        redness = max(float(rest[1:] @ rest[:-1]) / float(rest @ rest), 0.0)
        white = rest[1:] - redness * rest[:-1]
        power = np.abs(np.fft.rfft(white * np.hanning(n - 1))) ** 2
        power[0] = 0.0
        bins = (n - 1) / (2.0 * np.pi)
        for known in frequencies * bins:  # what is left within a resolution element of a line is no other line
            power[max(int(known), 0) : int(known) + 2] = 0.0
        slow, first = False, power.max()
        found: list[float] = []
        while len(frequencies) + len(found) < min(MAX_LINES, n // 20):
            peak, m = int(np.argmax(power)), int(np.count_nonzero(power))
            # Beside a line not yet refined, what the taper's side lobes (-31 dB) leave is no line of its own.
            if power[peak] <= 1e-3 * first or m * (1.0 - power[peak] / power.sum()) ** (m - 1) > LINE_SIGNIFICANCE:
                break
            slow = slow or peak < MIN_CYCLES
            if peak >= MIN_CYCLES:
                found.append(peak / bins)
            power[max(peak - 2, 0) : peak + 3] = 0.0
        if not found:
            return waves, slow
        frequencies = np.append(frequencies, found)
        for _ in range(4):
            waves = _waves(index, frequencies)
            amplitudes, _, norms = _normal_equations(np.column_stack((trend, waves)), y)
            a, b = (amplitudes / norms)[2::2], (amplitudes / norms)[3::2]
            slopes = index[:, None] * (b * waves[:, 0::2] - a * waves[:, 1::2])
            change, _, norms = _normal_equations(np.column_stack((trend, waves, slopes)), y)
            frequencies = frequencies + np.clip((change / norms)[-len(frequencies) :], -1.0 / n, 1.0 / n)
        waves = _waves(index, frequencies)
    return waves, False


def _waves(index: Array, frequencies: Array) -> Array:
    """Columns cos(w i), sin(w i), pair by pair; ``index`` goes up by one. Each is a product of two turns, by a whole
    number of strides and by what is left: of so many cosines and sines, few need to be worked out."""
    stride = math.isqrt(len(index)) + 1
    turns = np.exp(1j * np.multiply.outer(index[::stride], frequencies))[:, None] * np.exp(
        1j * np.multiply.outer(np.arange(stride), frequencies)
    )
    turns = turns.reshape(-1, len(frequencies))[: len(index)]
    return np.ascontiguousarray(turns).view(np.float64)


def _finite(name: str, values: ArrayLike) -> Array:
    """``values`` as a one-dimensional array of finite numbers, or an InputError."""
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 1 or len(array) == 0:
        raise InputError(f"{name}: expected a non-empty one-dimensional series, got shape {array.shape}")
    bad = np.flatnonzero(~np.isfinite(array))
    if len(bad):
        raise InputError(f"{name}: sample {bad[0]} is not finite")
    return array
