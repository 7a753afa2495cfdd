"""Tests of canonical ensembles, made by the package physical_validation.

Merz & Shirts 2018, PLoS ONE 13, e0202764, doi:10.1371/journal.pone.0202764; Shirts 2013, J. Chem. Theory Comput. 9,
909, doi:10.1021/ct300688p. The package is imported at the first test.
"""

import logging
import math
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
from scipy.special import expit

from kickdrift.errors import InputError
from kickdrift.model.state import Floats
from kickdrift.statistics.blocks import block_average

FEWEST = 100  # independent samples: with fewer, bootstrapped errors are too small
LEFT = 1.05  # inefficiency that a thinned series may still have
STARTS = 50  # starting points that are tried for the end of the equilibration
REPETITIONS = 1000  # of the bootstrap: its errors are then good to 2 %
PRESSURE = 1 / 6.022140857e-2  # cancels physical_validation's factor from bar nm^3 to kJ/mol


class Deviation(NamedTuple):
    """A measured number beside the expected one; ``errors`` is their difference in standard errors."""

    measured: float
    expected: float
    errors: float
    samples: int

    @property
    def p_value(self) -> float:
        """Probability of a deviation at least as large, on either side."""
        return math.erfc(abs(self.errors) / math.sqrt(2.0))


class Point(NamedTuple):
    """Numbers that describe where a run stands: its temperature, and its pressure if its volume changes."""

    temperature: float
    pressure: float | None
    boltzmann: float
    particles: int
    volume: float


def packages() -> tuple[Any, Any]:
    """Import physical_validation and pymbar. Raises an InputError that says how to install them."""
    logging.getLogger("pymbar").setLevel(logging.ERROR)  # pymbar recommends JAX at each import
    try:
        import physical_validation
        from pymbar import timeseries
    except ImportError:
        raise InputError("ensemble checks need physical_validation: pip install 'kickdrift[certify]'") from None
    return physical_validation, timeseries


def equilibrated(series: Floats) -> int:
    """Number of samples at the front that belong to the equilibration (Chodera 2016, doi:10.1021/acs.jctc.5b00784)."""
    _, timeseries = packages()
    if np.ptp(series) == 0:
        return 0
    return int(timeseries.detect_equilibration(series, nskip=max(1, len(series) // STARTS))[0])


def inefficiency(series: Floats) -> float:
    """Number of correlated samples that count as one: the larger of pymbar's estimate and that of block averages."""
    _, timeseries = packages()
    if np.ptp(series) == 0:
        return float(len(series))
    with quietly():
        summed = float(timeseries.statistical_inefficiency(series))
    blocks = float(block_average(series).error) ** 2 * len(series) / float(series.var())
    return min(max(summed, blocks, 1.0), float(len(series)))


def enough(count: float, total: int, name: str) -> int:
    """The number of independent samples. Raises InputError if there are too few."""
    if count < FEWEST:
        raise InputError(
            f"{name}: {int(count)} independent samples of {total}; the tests need {FEWEST}. "
            f"Run about {math.ceil(1.2 * FEWEST / max(count, 1.0))} times as long, "
            "or sample more often if neighbouring samples are independent"
        )
    return int(count)


def independent(series: Floats, name: str) -> Floats:
    """Samples of a series that are far enough apart to be independent.

    A correlation that falls by a factor r from sample to sample has the inefficiency g = (1 + r) / (1 - r). Samples s
    apart have r^s in place of r. The spacing s leaves an inefficiency of 1.05. (A spacing of g, as in
    physical_validation, leaves 1.3: errors would be too small by 14 %.)

    Raises InputError if too few samples remain."""
    g = inefficiency(series)
    ratio, wanted = (g - 1) / (g + 1), (LEFT - 1) / (LEFT + 1)
    spacing = math.log(wanted) / math.log(ratio) if ratio > wanted else 1.0
    chosen: Floats = series[np.arange(0, len(series), spacing).astype(int)]
    enough(len(chosen), len(series), name)
    return chosen


def mean_temperature(kinetic: Floats, freedom: float, point: Point, name: str) -> Deviation:
    """Temperature from the mean of correlated kinetic energies, beside the expected temperature.

    physical_validation has no test of an axis. Raises InputError for too few independent samples."""
    return mean_of(kinetic * (2 / (freedom * point.boltzmann)), point.temperature, name)


def mean_of(series: Floats, expected: float, name: str) -> Deviation:
    """Mean of correlated samples beside the expected mean. Raises InputError for too few independent samples."""
    g = inefficiency(series)
    count = enough(len(series) / g, len(series), name)
    found, error = float(series.mean()), float(series.std()) * math.sqrt(g / len(series))
    return Deviation(found, expected, (found - expected) / error, count)


def mean_and_width(kinetic: Floats, freedom: float, point: Point) -> tuple[Deviation, Deviation]:
    """Temperatures from the mean and from the width of independent kinetic energies, beside the expected one."""
    validation, _ = packages()
    with quietly():
        errors = validation.kinetic_energy.distribution(
            _data(point, freedom, kinetic_energy=kinetic), strict=False, verbosity=0, bs_repetitions=REPETITIONS,
            bootstrap_seed=0, data_is_uncorrelated=True,
        )  # fmt: skip
    found = (
        2 * kinetic.mean() / (freedom * point.boltzmann),
        math.sqrt(2 / freedom) * kinetic.std() / point.boltzmann,
    )
    both = [
        Deviation(float(each), point.temperature, math.copysign(float(error), each - point.temperature), len(kinetic))
        for each, error in zip(found, errors, strict=True)
    ]
    return both[0], both[1]


def distribution(kinetic: Floats, freedom: float, point: Point) -> float:
    """P-value of independent kinetic energies against Maxwell and Boltzmann's law (Kolmogorov-Smirnov)."""
    validation, _ = packages()
    with quietly():
        data = _data(point, freedom, kinetic_energy=kinetic)
        return float(validation.kinetic_energy.distribution(data, strict=True, verbosity=0, data_is_uncorrelated=True))


def ratio(one: Floats, two: Floats, points: tuple[Point, Point]) -> Deviation:
    """Slope of ln(P_2 / P_1) over the potential energy, or over the volume at two pressures, beside the exact slope.

    ``one`` and ``two`` are independent samples: energies at two temperatures of constant volume; enthalpies U + P V at
    two temperatures of one pressure; volumes at two pressures of one temperature.

    Raises InputError if the samples of the two runs do not overlap."""
    first, second = points
    thermal = [point.boltzmann * point.temperature for point in points]
    if first.temperature != second.temperature:
        expected = 1 / thermal[0] - 1 / thermal[1]
    else:
        expected = ((first.pressure or 0.0) - (second.pressure or 0.0)) / thermal[0]
    low, high = max(one.min(), two.min()), min(one.max(), two.max())
    inside = [each[(each >= low) & (each <= high)] for each in (one, two)]
    if min(map(len, inside)) < FEWEST // 2:
        hot = first.temperature != second.temperature
        wanted = 2 * thermal[0] / float(one.std()) * (first.temperature if hot else 1.0)
        what = "temperatures" if hot else "pressures"
        raise InputError(f"the two runs hardly overlap: choose {what} that differ by about {wanted:.2g}")
    validation, _ = packages()
    pressed = first.pressure is not None and first.temperature == second.temperature
    with quietly():
        data = [
            _data(point, 3.0 * point.particles, **({"volume": each} if pressed else {"potential_energy": each}))
            for point, each in zip(_free(points) if not pressed else points, (one, two), strict=True)
        ]
        errors = validation.ensemble.check(*data, verbosity=0, data_is_uncorrelated=True)
    slope = _slope(*inside)
    return Deviation(slope, expected, math.copysign(float(errors[0]), slope - expected), min(len(one), len(two)))


def _free(points: tuple[Point, Point]) -> list[Point]:
    """The points without pressures: enthalpies at one pressure are distributed as energies at constant volume."""
    return [point._replace(pressure=None) for point in points]


def _slope(one: Floats, two: Floats) -> float:
    """Most likely slope of ln(P_2 / P_1): logistic regression by Newton's method (Shirts 2013, eq. 8)."""
    middle = np.concatenate([one, two]).mean()
    x = np.concatenate([one, two]) - middle
    of_two = np.concatenate([np.zeros(len(one)), np.ones(len(two))])
    design = np.column_stack([np.ones_like(x), x])
    found = np.zeros(2)
    for _ in range(50):
        likely = expit(design @ found)
        change = np.linalg.solve((design.T * (likely * (1 - likely))) @ design, design.T @ (of_two - likely))
        found += change
        if abs(change[1]) <= 1e-9 * abs(found[1]):
            break
    return float(found[1])


def _data(point: Point, freedom: float, **observables: Floats) -> Any:
    """A SimulationData of physical_validation, in the run's own units."""
    data = packages()[0].data
    ensemble = "NVT" if point.pressure is None else "NPT"
    units = data.UnitData(
        kb=point.boltzmann, energy_conversion=1.0, length_conversion=1.0, volume_conversion=1.0,
        temperature_conversion=1.0, pressure_conversion=PRESSURE, time_conversion=1.0,
    )  # fmt: skip
    return data.SimulationData(
        units=units,
        ensemble=data.EnsembleData(
            ensemble, natoms=point.particles, volume=point.volume, temperature=point.temperature,
            pressure=point.pressure,
        ),
        system=data.SystemData(
            natoms=point.particles, nconstraints=3 * point.particles - freedom, ndof_reduction_tra=0,
            ndof_reduction_rot=0,
        ),
        observables=data.ObservableData(**observables),
    )  # fmt: skip


@contextmanager
def quietly() -> Iterator[None]:
    """Keep the warnings of other packages to themselves, and NumPy's global random numbers as they were."""
    state: Any = np.random.get_state()  # noqa: NPY002 - physical_validation seeds the global generator
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            yield
    finally:
        np.random.set_state(state)  # noqa: NPY002
