"""What a run says of itself: how well it conserved what it should, and what it cost."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from kickdrift.analysis.drift import drift, energy_error

if TYPE_CHECKING:
    from kickdrift.simulation import Simulation


@dataclass(frozen=True)
class EnergyReport:
    """How the total energy behaved; the definitions and their sources are in ``analysis.drift``.

    Attributes
    ----------
    initial, final : total energy, in the system's unit
    rms_relative_error, max_relative_error : of E(t) - E(0), over the samples, divided by what ``relative_to`` names
    relative_to : "initial energy" |E(0)|, or "kinetic energy" where |E(0)| is under a tenth of it, or "absolute"
    drift_per_unit_time : slope of the relative error per unit of time, by regression that knows of autocorrelation
    drift_error : half-width of the slope's 95 % interval
    verdict : "bounded", "secular drift", "random walk" or "not resolvable"
    """

    initial: float
    final: float
    rms_relative_error: float
    max_relative_error: float
    relative_to: str
    drift_per_unit_time: float
    drift_error: float
    verdict: str


@dataclass(frozen=True)
class Report:
    """A run's summary; ``as_json()`` is what ``--json`` writes.

    ``momentum_error`` is the largest |P(t) - P(0)| over the samples divided by the sum of m |v| at the start;
    ``angular_momentum_error`` likewise with m |x × v|, None in a periodic box, where it is not conserved.
    ``temperature`` and ``pressure`` are means over the samples, in the system's units, None where they mean nothing.
    ``ns_per_pair`` is the wall time per force evaluation and pair within range.
    """

    system: str
    engine: str
    integrator: str
    particles: int
    units: str
    dt: float
    steps: int
    time: float
    seed: int | None
    threads: int
    samples: int
    force_evaluations: int
    wall_seconds: float
    compile_seconds: float
    steps_per_second: float
    ns_per_pair: float | None
    energy: EnergyReport
    momentum_error: float
    angular_momentum_error: float | None
    temperature: float | None
    pressure: float | None

    def as_json(self) -> dict[str, Any]:
        """Plain numbers, texts and Nones; what is infinite or not a number is None."""
        return _plain(asdict(self))


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(inner) for key, inner in value.items()}
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value


def report(sim: Simulation) -> Report:
    """The summary of a Simulation's run so far."""
    record, system = sim.record, sim.system
    samples = record.samples
    total = np.array([sample.energies.total for sample in samples])
    error = energy_error(total, samples[0].energies.kinetic)
    scale = {"initial energy": abs(error.initial), "kinetic energy": samples[0].energies.kinetic}.get(
        error.relative_to, 1.0
    )
    even = record.even()
    trend = drift([s.time for s in even], [(s.energies.total - error.initial) / scale for s in even])
    momentum = max(float(np.linalg.norm(s.momentum - samples[0].momentum)) for s in samples)
    angular = max(float(np.linalg.norm(s.angular_momentum - samples[0].angular_momentum)) for s in samples)
    pairs = float(np.mean([s.pairs for s in samples]))
    work = record.force_evaluations * pairs
    return Report(
        system=system.name,
        engine="native",
        integrator=sim.integrator,
        particles=len(system),
        units=system.units.name,
        dt=sim.dt,
        steps=record.steps,
        time=record.steps * sim.dt,
        seed=system.seed,
        threads=sim.threads,
        samples=len(samples),
        force_evaluations=record.force_evaluations,
        wall_seconds=record.wall_seconds,
        compile_seconds=record.compile_seconds,
        steps_per_second=record.steps / record.wall_seconds if record.wall_seconds else 0.0,
        ns_per_pair=1e9 * record.wall_seconds / work if work else None,
        energy=EnergyReport(
            **asdict(error), drift_per_unit_time=trend.slope, drift_error=trend.error, verdict=trend.verdict
        ),
        momentum_error=momentum / record.momentum_scale if record.momentum_scale else momentum,
        angular_momentum_error=None
        if system.box.periodic
        else angular / record.angular_momentum_scale
        if record.angular_momentum_scale
        else angular,
        temperature=_mean([s.temperature for s in samples]),
        pressure=_mean([s.pressure for s in samples]),
    )


def _mean(values: list[float]) -> float | None:
    mean = float(np.mean(values))
    return mean if np.isfinite(mean) else None
