"""Drift of the total energy over the samples of a run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kickdrift.looks.record import Stretch, even_looks
from kickdrift.model.checks.values import unwarned
from kickdrift.model.state import Floats
from kickdrift.statistics.drift import ROUNDINGS, Drift, EnergyError, drift, rounding_of


@unwarned
def energy_trend(
    steps: NDArray[np.int64],
    times: Floats,
    total: Floats,
    kinetic: float,
    even: bool,
    error: EnergyError,
    looks: Stretch | None = None,
) -> Drift:
    """Drift of the relative energy error.

    Parameters
    ----------
    steps, times, total : (k,) of the samples
    kinetic : the first sample's kinetic energy; nan if there is none
    even : whether steps are equally long. Otherwise the errors are interpolated to evenly spaced times.
    error : the ``energy_error`` of ``total``
    looks : the `even_looks`, if they are known

    Raises
    ------
    InputError
        For values that are not finite.
    """
    first = 0.0 if np.isnan(kinetic) else kinetic
    scale = {"initial energy": abs(error.initial), "kinetic energy": kinetic}.get(error.relative_to, 1.0)
    at, errors = times, (total - error.initial) / scale
    if even:
        chosen = even_looks(steps, times) if looks is None else looks
        at, errors = at[chosen], errors[chosen]
    if at[-1] < at[0]:  # back in time
        at, errors = at[::-1], errors[::-1]
    if not even and len(at) > 2:  # the step points of an adaptive run are only about evenly spaced
        grid = np.linspace(at[0], at[-1], len(at))
        at, errors = grid, np.interp(grid, at, errors)
    rounding = rounding_of(max(abs(error.initial), first), int(steps[-1] - steps[0])) / scale
    trend = drift(at, errors, rounding)
    over_run = abs(trend.slope * (times[-1] - times[0]))
    tiny = trend.verdict == "secular drift" and over_run <= ROUNDINGS * rounding
    return replace(trend, verdict="round-off") if tiny else trend
