"""The energy error of a run as a sparkline."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from kickdrift.display.card import Spark
from kickdrift.errors import InputError
from kickdrift.statistics.drift import energy_error


def energy_spark(total: ArrayLike, kinetic: float) -> Spark | None:
    """Relative error of the energies (n,); ``kinetic`` is K(0). None for fewer than two energies, and without any."""
    energies = np.asarray(total, dtype=float)
    if len(energies) < 2:
        return None
    try:
        found = energy_error(energies, np.nan_to_num(kinetic))
    except InputError:  # energies that are not finite
        return None
    scale = {"initial energy": abs(found.initial), "kinetic energy": abs(float(kinetic))}.get(found.relative_to, 1.0)
    relative = "" if found.relative_to == "absolute" else f" of the {found.relative_to}"
    values = ((energies - found.initial) / scale).tolist()
    return Spark(values, f"energy error: RMS {found.rms_relative_error:.2g}{relative}")
