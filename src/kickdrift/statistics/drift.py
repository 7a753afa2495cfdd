"""Drift of an invariant: the energy error, its growth in a pilot run, and the slope of a correlated series."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kickdrift.errors import InputError
from kickdrift.jit.cache.notices import compiling_for
from kickdrift.model.state import Floats
from kickdrift.statistics import regression
from kickdrift.statistics.spectral_lines import Fits, folded, spectral_lines

Array = NDArray[np.float64]
Verdict = Literal["bounded", "secular drift", "random walk", "round-off", "not resolvable"]

MIN_SAMPLES = 40  # with 36 samples, one white-noise series in twenty already counts as a random walk
MAX_SAMPLES = 1024  # longer series are averaged in bins: only the slow end of the spectrum affects the slope
CONFIDENCE = 0.95  # level of the interval
SIGNIFICANCE = (
    0.01  # level of the verdict "secular drift": stricter, so that one verdict in a hundred is wrong, not in twenty
)
RESIDUE = 1e-9  # fraction of the waves: a smaller residue is the accumulated rounding of many steps
ROUNDINGS = 100.0  # a range of at most this many roundings has the verdict "round-off"
WALKED = (
    0.1  # times the root of the steps: three standard deviations of a walk by some 3 roundings a step, over ROUNDINGS
)
LEAST_SQUARES = 1.05  # standard error of a walk's slope by least squares, over that by its increments
EPSILON = float(np.finfo(np.float64).eps)
UNKNOWN = float("nan")
# 1 % points of the Dickey-Fuller t as a + b / n, with constant and trend and with a constant only; MacKinnon (2010),
# Queen's Economics Department Working Paper 1227, table 2.
UNIT_ROOT_TREND = (-3.95877, -9.0531)
UNIT_ROOT_CONSTANT = (-3.43035, -6.5393)


@dataclass(frozen=True)
class EnergyError:
    """Distance of the total energy from its first value. Energies are in the units of the input, errors are
    dimensionless.

    ``initial`` and ``final`` are the first and last total energy.  ``rms_relative_error`` and ``max_relative_error``
    are the root mean square and the largest modulus, over all samples, of (E(t) - E(0)) / D.  ``relative_to`` names D.
    D is the "initial energy" |E(0)|, or the "kinetic energy" K(0) at the start if |E(0)| < K(0)/10, because a ratio to
    a cancelling total has no meaning. If both are zero, D = 1 ("absolute"), and errors have the units of energy.
    """

    initial: float
    final: float
    rms_relative_error: float
    max_relative_error: float
    relative_to: Literal["initial energy", "kinetic energy", "absolute"]

    def scale(self, kinetic: float) -> float:
        """D, from the kinetic energy at the start."""
        return {"initial energy": abs(self.initial), "kinetic energy": kinetic}.get(self.relative_to, 1.0)


@dataclass(frozen=True)
class Drift:
    """Linear trend of a series, its 95 % interval and the kind of motion.

    ``slope`` (value per unit time) lies within ``slope`` ± ``error``. The error is never larger than the range of the
    series over its duration; it is infinite for a single sample. ``p_value`` is the two-sided probability of a slope
    this large if there is no slope. ``correlation_time`` (unit of time) is the integrated autocorrelation time of the
    residue without trend and spectral lines: 1/2 + the sum of the autocorrelations. ``effective_samples`` is the length
    over twice this time; anticorrelated noise has more than the number of samples. They are infinite and 1 if a unit
    root is not rejected, and nan without a fitted autoregression. ``lines`` is the number of sine waves found.
    """

    slope: float
    error: float
    verdict: Verdict
    p_value: float
    correlation_time: float
    effective_samples: float
    lines: int


def energy_error(total: ArrayLike, kinetic: ArrayLike) -> EnergyError:
    """Errors of the energies ``total`` (n,) relative to the first. ``kinetic`` (n,) or a number gives K(0).

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


def rounding_of(energy: float, steps: int) -> float:
    """Size of one rounding of an energy, or of a hundredth of the random walk of many steps' roundings."""
    return EPSILON * abs(energy) * max(1.0, WALKED * float(np.sqrt(steps)))


def drift(times: ArrayLike, values: ArrayLike, rounding: float | None = None) -> Drift:
    """Slope of ``values`` (n,) over the evenly spaced ``times`` (n,), with an interval that accounts for correlation.

    ``rounding`` is the size of one rounding of the values (``rounding_of``), by default of the largest value.

    1. "round-off" if the whole range is at most 100 roundings. "not resolvable" under 40 samples.
    2. "secular drift" if the series moves one way: the means of 16 blocks only rise or only fall, except for 5 %, and
       this motion is most of the range. For a bent motion no wave is fitted: a bend is no wave. The slope is then from
       least squares. Its interval comes from the spread of the slow increments (``walk_trend``), so a bend widens the
       interval. For a straight motion, slope and interval come from 3 to 6.
    3. Spectral lines, found by Fisher's test on the prewhitened periodogram, join the regression: a periodic error is
       a wave, not noise that averages out. With a wave slower than 3 cycles, slope and interval are as in 2:
       "secular drift" if p < 0.01, else "not resolvable".
    4. An autoregression with constant and trend, its order by BIC, gives the Dickey-Fuller t of a unit root.
    5. Unit root rejected at 1 %: generalised least squares, whitened by the autoregression after removal of its O(1/n)
       bias. The interval is Student's, with the degrees of freedom of the uncertain noise level at zero frequency
       (Satterthwaite). The verdict is "bounded" unless 7 finds a drift.
    6. Not rejected: the same for the mean of the increments. The verdict is "random walk" unless 7 finds a drift: over
       this length the spread may grow as sqrt(t). A stationary series shorter than some 25 times twice its correlation
       time also ends here. Increments that wander themselves end as in 3.
    7. "secular drift" if p < 0.01 here and in a second test, where a walk below the noise may cause the slope
       (``mixed_trend``): cut-off forces add such a walk to the energy of a liquid, and no unit-root test sees a
       small walk. If the second test fails, its interval counts, and "random walk" if the walk is more likely.
    8. No "secular drift" below 100 roundings, or below the amplitude of a harmonic that sampling may have folded to
       the frequency zero (``folded``): "bounded".

    A series of trend and lines to within rounding gets the rounding as its ``error``. If trend and residue over the
    whole length stay under 1e-9 of the lines, the series is "bounded", with slope and error as found. More than 1024
    samples are averaged in equal bins; the first few samples that fill no bin are dropped.

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
    if n == 1:
        return Drift(0.0, float("inf"), "not resolvable", 1.0, UNKNOWN, UNKNOWN, 0)
    lowest, highest = float(series.min()), float(series.max())
    if lowest == highest:
        return Drift(0.0, 0.0, "bounded", 1.0, UNKNOWN, UNKNOWN, 0)

    mean = float(series.mean())
    scale = max(highest - mean, mean - lowest)
    own = EPSILON * max(highest, -lowest)
    width = -(-n // MAX_SAMPLES)
    count = n // width
    y = (series - mean) / scale
    if width > 1:
        y = y[n - width * count :].reshape(count, width).mean(axis=1)
    with compiling_for("the report"):
        found = _judged(y, own / scale, (own if rounding is None else rounding) / scale)
    step *= width
    widest = (highest - lowest) / abs(float(clock[-1] - clock[0]))
    return replace(
        found,
        slope=found.slope * scale / step,
        error=min(found.error * scale / abs(step), widest),
        correlation_time=found.correlation_time * abs(step),
    )


def _judged(y: Array, own_rounding: float, rounding: float) -> Drift:
    """Drift per sample of ``y``, whose largest modulus is 1. ``own_rounding`` is the rounding of the input numbers."""
    count = len(y)
    waves, slow = Fits(y).line(), False
    straight = waves.slope
    tiny = float(np.ptp(y)) <= ROUNDINGS * rounding
    if count < MIN_SAMPLES:
        return _unfitted(
            straight, regression.Trend(0.0, float("inf"), 1.0), "round-off" if tiny else "not resolvable", count
        )
    by_walk = regression.walk_trend(y)
    if tiny:
        return _unfitted(straight, by_walk, "round-off", count)
    floor = 4.0 * own_rounding
    one_way = regression.goes_one_way(y)
    bent = one_way and regression.is_bent(y)
    if not bent:
        blurred = max(floor, 2.0 * EPSILON * count)  # a wave is only as exact as its phase
        waves, slow = spectral_lines(y, blurred)
        floor = blurred if len(waves) else floor
    lines, rest, line = len(waves), waves.rest, waves.slope
    residue = max(float(rest.max()), -float(rest.min()))
    if residue <= floor:
        drifts = abs(line) * count > max(2.0 * floor, ROUNDINGS * rounding)
        return Drift(
            line, 2.0 * floor / count, "secular drift" if drifts else "bounded", 1.0 - drifts, UNKNOWN, UNKNOWN, lines
        )
    if bent or slow:
        drifts = one_way or by_walk.p_value < SIGNIFICANCE
        return _unfitted(straight, by_walk, "secular drift" if drifts else "not resolvable", count, lines)

    fit = regression.trend_regression(y, waves)
    verdict: Verdict = "bounded"
    time, effective = 0.5 * fit.inefficiency, count / fit.inefficiency
    flat = rest + waves.constant + line * (np.arange(count) - 0.5 * (count - 1))
    if fit.unit_root_t > UNIT_ROOT_TREND[0] + UNIT_ROOT_TREND[1] / count:
        time, effective, verdict = float("inf"), 1.0, "random walk"
        fit = regression.mean_regression(np.diff(flat))
        if fit.unit_root_t >= UNIT_ROOT_CONSTANT[0] + UNIT_ROOT_CONSTANT[1] / count:
            drifts = one_way or by_walk.p_value < SIGNIFICANCE
            found = _unfitted(straight, by_walk, "secular drift" if drifts else "not resolvable", count, lines)
            return replace(found, correlation_time=time, effective_samples=effective)
    slope, p_value = fit.value, 2.0 * regression.student(fit.freedom, -abs(fit.value) / fit.deviation)
    half_width = fit.deviation * regression.quantile(fit.freedom, CONFIDENCE)
    if one_way:
        verdict = "secular drift"
    elif p_value < SIGNIFICANCE:
        mixed = regression.mixed_trend(flat, SIGNIFICANCE)
        unseen = folded(waves)
        if mixed.p_value >= SIGNIFICANCE:
            p_value, half_width = mixed.p_value, max(half_width, mixed.half_width / count)
            verdict = "random walk" if mixed.walk > 0.5 else verdict
        elif abs(slope) * count < unseen:
            p_value, half_width = 1.0, max(half_width, unseen / count)
        elif abs(slope) * count > ROUNDINGS * rounding:
            verdict = "secular drift"
    left = max(residue, abs(line) * count)
    if lines and left <= max(RESIDUE, ROUNDINGS * rounding):
        verdict = "bounded"
    return Drift(slope, half_width, verdict, p_value, time, effective, lines)


def _unfitted(straight: float, by_walk: regression.Trend, verdict: Verdict, count: int, lines: int = 0) -> Drift:
    """Slope of least squares with the interval of ``walk_trend``, slightly widened by the slope's own variance."""
    half_width = LEAST_SQUARES * by_walk.half_width / count
    if verdict == "not resolvable":
        half_width = float("inf")
    return Drift(straight, half_width, verdict, by_walk.p_value, UNKNOWN, UNKNOWN, lines)


def _finite(name: str, values: ArrayLike) -> Array:
    """Return ``values`` as a one-dimensional array of finite numbers, or raise InputError."""
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 1 or len(array) == 0:
        raise InputError(f"{name}: expected a non-empty one-dimensional series, got shape {array.shape}")
    if not np.isfinite(array).all():
        raise InputError(f"{name}: sample {int(np.flatnonzero(~np.isfinite(array))[0])} is not finite")
    return array


WINDOWS, LEAST_WINDOWS = 8, 7
FIRST = 2  # windows left out, so that the slow beginning of an error does not hide its later growth
LEAST_SAMPLES = 4  # per window
SURE = 2.0  # standard errors


@dataclass(frozen=True)
class Growth:
    """Behaviour of an error after the pilot.

    Attributes
    ----------
    exponent, exponent_error : p of error ~ t^p for positions and its standard error, fitted to the largest errors in
        the last six of eight windows of the pilot
    drift : bound on the drift of the relative energy error per unit of time: slope plus half-width of its 95 % interval
    verdict : of the energy's drift, "bounded", "secular drift", "random walk", "round-off" or "not
        resolvable"
    """

    exponent: float | None = None
    exponent_error: float | None = None
    drift: float | None = None
    verdict: str | None = None

    def factor(self, error: float, ratio: float, length: float) -> float | None:
        """Bound on the growth of the error in a run of this ``length``, ``ratio`` times the pilot's; None if the pilot
        cannot tell."""
        if ratio <= 1.0:
            return 1.0
        if self.drift is not None:
            if self.verdict == "not resolvable" or not np.isfinite(self.drift):
                return None
            wander = np.sqrt(ratio) if self.verdict in ("random walk", "round-off") else 1.0
            return float(np.hypot(wander, self.drift * length / np.sqrt(3.0) / error))
        if self.exponent is None or self.exponent_error is None:
            return None
        return float(ratio ** max(0.0, self.exponent + SURE * self.exponent_error))


def position_growth(times: Floats, errors: Floats) -> Growth:
    """Exponent from the largest error in each window; none if there are too few samples or no errors."""
    t, e = times[1:] - times[0], errors[1:]
    count = min(WINDOWS, len(t) // LEAST_SAMPLES)
    if count < LEAST_WINDOWS:
        return Growth()
    parts = np.array_split(np.arange(len(t)), count)[FIRST:]
    peaks = [part[np.argmax(e[part])] for part in parts]
    largest = e[peaks]
    if not (largest > 0).all():
        return Growth()
    matrix = np.vander(np.log(t[peaks]), 2)
    found, residual, *_ = np.linalg.lstsq(matrix, np.log(largest), rcond=None)
    variance = float(residual[0]) / (len(parts) - 2) if len(residual) else 0.0
    error = np.sqrt(variance * np.linalg.inv(matrix.T @ matrix)[0, 0])
    return Growth(float(found[0]), float(error))


def energy_growth(times: Floats, energies: Floats, errors: Floats) -> Growth:
    """Drift of the energy, by the regression that accounts for autocorrelation (``statistics.drift``)."""
    largest = float(np.abs(energies - energies[0]).max())
    scale = largest / float(errors.max()) if largest > 0 else 1.0
    trend = drift(times, (energies - energies[0]) / scale, rounding_of(energies[0], len(times)) / scale)
    return Growth(drift=abs(trend.slope) + trend.error, verdict=trend.verdict)
