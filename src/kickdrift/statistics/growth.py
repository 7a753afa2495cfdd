"""Growth of an error with time, measured in a pilot run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kickdrift.model.state import Floats
from kickdrift.statistics.drift import drift, rounding_of

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
