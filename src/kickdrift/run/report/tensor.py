"""What a run's report says of the components of the pressure, where a barostat changes the shape of the box."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from kickdrift.integrators.options import PRESSURE, STRESS
from kickdrift.looks.record import even_looks
from kickdrift.looks.report_lines import tensor_lines
from kickdrift.looks.tensor import NAMES, TENSOR
from kickdrift.run.report.warnings import verdict
from kickdrift.statistics.blocks import block_average


@dataclass(frozen=True)
class TensorReport:
    """Components of the pressure, in the order xx, yy, zz, yz, xz, xy; two dimensions have xx, yy and xy.

    Attributes
    ----------
    names : of the components
    asked : pressure less the wanted stress
    means, errors : over the samples, with standard errors; an error is None if the run is too short
    verdicts : of each mean, in words
    """

    names: tuple[str, ...]
    asked: tuple[float, ...]
    means: tuple[float, ...]
    errors: tuple[float | None, ...]
    verdicts: tuple[str, ...]

    def lines(self, unit: str) -> list[tuple[str, str]]:
        """Lines for people, with the unit of pressure."""
        return tensor_lines(asdict(self), unit)


def tensor_report(system: Any, sim: Any) -> TensorReport | None:
    """The TensorReport of a Simulation; None unless its samples have the components of the pressure."""
    samples = [sample for sample in sim.record.samples if TENSOR in sample.columns]
    if not samples:
        return None
    steps, times = np.array([each.step for each in samples]), np.array([each.time for each in samples])
    values = np.array([each.columns[TENSOR] for each in samples])[even_looks(steps, times)].T
    stress = np.array(sim.options.get(STRESS.name) or (0.0,) * len(NAMES))
    asked = np.where(np.arange(len(NAMES)) < 3, sim.options[PRESSURE.name], 0.0) - stress
    some = [k for k in range(len(NAMES)) if system.dimensions == 3 or k in (0, 1, 5)]
    found = [block_average(values[k]) for k in some]
    errors = tuple(float(each.error) if np.isfinite(each.error) else None for each in found)
    means = tuple(float(values[k].mean()) for k in some)
    return TensorReport(
        tuple(NAMES[k] for k in some),
        tuple(float(asked[k]) for k in some),
        means,
        errors,
        tuple(verdict(mean, error, asked[k]) for mean, error, k in zip(means, errors, some, strict=True)),
    )
