"""What a run's report says of molecules with constraints: the largest error, and the temperatures of their motions."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from kickdrift.looks.molecules import ERROR, KINDS, TEMPERATURES, Molecules
from kickdrift.looks.record import even_looks
from kickdrift.looks.report_lines import molecule_lines
from kickdrift.model.molecules.constraints import on_manifold
from kickdrift.model.state import Floats, State
from kickdrift.statistics.blocks import Mean, block_average
from kickdrift.statistics.regression import quantile
from kickdrift.text import with_error

SURE = 0.9973  # probability that a difference of zero is within the errors, as of three standard errors
FEWEST = 25  # independent samples behind an error; fewer give one that is too small
DRIFTING = 8.0  # standard errors of the mean between two halves of a run that has not settled; 2 are the usual ones
SAMPLED = 0.25  # least variance, in that of the canonical ensemble, of a run that has sampled its fluctuations


@dataclass(frozen=True)
class MoleculeReport:
    """Constraints of a run, and the temperatures of the motions of its molecules.

    Attributes
    ----------
    constraints : how many distances are kept
    moved, lost : how far the start was projected, and the part of its kinetic energy that this took
    error : largest relative error of a distance at the samples
    temperatures, errors : means over the samples and standard errors, by kind of motion: translation, rotation,
        vibration; a kind without freedom is left out, and an error is None for a run that is too short, see `_mean`
    step_bias : what velocity Verlet's step takes from each of these temperatures, to leading order; empty for others
    verdict : on equipartition; "" with one kind of motion
    """

    constraints: int
    moved: float
    lost: float
    error: float
    temperatures: dict[str, float]
    errors: dict[str, float | None]
    verdict: str
    step_bias: dict[str, float] = field(default_factory=dict)

    def lines(self, length: str, temperature: str) -> list[tuple[str, str]]:
        """Lines for people, with the units of length and temperature."""
        return molecule_lines(asdict(self), length, temperature)


def molecule_report(system: Any, sim: Any) -> MoleculeReport | None:
    """The MoleculeReport of a System that a Simulation runs; None without constraints."""
    held = getattr(system, "constraints", None)
    if held is None:
        return None
    samples = [sample for sample in sim.record.samples if ERROR in sample.columns]
    errors = [sample.columns[ERROR] for sample in samples]
    molecules, state = Molecules(system, sim.method.drags), sim.state
    errors.append(molecules.error(state.phase))
    bias = _step_bias(system, molecules, sim, state) if sim.method.kinetic_bias else {}
    found: dict[str, Floats] = {}
    if samples:
        steps, times = np.array([s.step for s in samples]), np.array([s.time for s in samples])
        some = even_looks(steps, times) if not sim.method.chooses_steps else slice(None)
        for name in TEMPERATURES:
            if name in samples[0].columns:
                found[name.partition("_")[0]] = np.array([s.columns[name] for s in samples])[some]
    canonical = {
        kind: 2.0 * float(found[kind].mean()) ** 2 / count
        for kind, count in zip(KINDS, molecules.freedoms or (), strict=False)
        if kind in found
    }
    return MoleculeReport(
        len(held),
        held.start.moved,
        held.start.lost,
        max(errors),
        {kind: float(values.mean()) for kind, values in found.items()},
        {kind: _error(values, canonical[kind]) for kind, values in found.items()},
        _verdict(found, canonical, bias),
        bias,
    )


def _step_bias(system: Any, molecules: Molecules, sim: Any, state: State) -> dict[str, float]:
    """What the step takes from the temperature of each kind of motion at whole steps of velocity Verlet.

    The energy that it conserves has the kinetic part m v^2 / 2 + dt^2 v U'' v / 12. Its equilibrium lacks dt^2 / 6
    <F^2> / m of <m v^2>, for each degree of freedom, to leading order (Eastwood et al. 2010, doi:10.1021/ct9002916).
    Forces along rigid distances move nothing and do not count. The others are those of one moment, which serve many
    molecules."""
    a = sim.integration.flow.accelerations(state.phase, state.time)
    if a is None or molecules.freedoms is None:
        return {}
    along, _ = on_manifold(system, system.constraints, system.coherent_masses, np.array([state.phase[0], a]))
    lacking = molecules.temperatures(along) * sim.dt**2 / 6.0
    return {kind: float(each) for kind, each in zip(KINDS, lacking, strict=True) if np.isfinite(each)}


def _error(values: Floats, canonical: float) -> float | None:
    mean = _mean(values, canonical)
    return None if mean is None else float(mean.error)


def _mean(values: Floats, canonical: float) -> Mean | None:
    """Mean of a series with its error; None for a run that is too short. This has fewer than FEWEST independent
    samples, or a variance far below that of the ``canonical`` ensemble, so that slow exchange is not in its error, or
    halves that differ by far more than their errors."""
    mean, spread, half = block_average(values), float(np.var(values)), len(values) // 2
    error = float(mean.error)
    if not np.isfinite(error) or spread < max(FEWEST * error**2, SAMPLED * canonical):
        return None
    apart = abs(float(values[:half].mean() - values[half:].mean()))
    return None if apart > DRIFTING * error else mean


def _verdict(found: dict[str, Floats], canonical: dict[str, float], bias: dict[str, float]) -> str:
    """Words on equipartition, from the difference of each other motion and translation. An error from few blocks is
    itself uncertain, so the limit is that of Student's distribution."""
    if "translation" not in found or len(found) < 2:
        return ""
    said = []
    for kind, values in found.items():
        if kind == "translation":
            continue
        apart = values - found["translation"]
        if (mean := _mean(apart, canonical[kind] + canonical["translation"])) is None:
            return "too short to judge equipartition"
        error, far = float(mean.error), quantile(int(mean.blocks) - 1, SURE)
        value = float(mean.value)
        if abs(value) > far * error:
            words = "above" if value > 0 else "below"
            by_step = bias.get("translation", 0.0) - bias[kind] if kind in bias else 0.0
            more = f" (the step makes it {by_step:+.2g})" if by_step else ""
            said.append(f"{kind} is {with_error(abs(value), error)} {words} translation{more}")
    return f"no equipartition, {' and '.join(said)}" if said else "equipartition within three standard errors"
