"""What a run's report says of molecules with constraints: the largest error, and the temperatures of their motions."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from kickdrift.looks.molecules import ERROR, TEMPERATURES, Molecules
from kickdrift.looks.record import even_looks
from kickdrift.model.state import Floats
from kickdrift.statistics.blocks import block_average
from kickdrift.text import counted, measured, with_error

FAR = 3.0  # standard errors
FEWEST = 10  # samples that are judged


@dataclass(frozen=True)
class MoleculeReport:
    """Constraints of a run, and the temperatures of the motions of its molecules.

    Attributes
    ----------
    constraints : how many distances are kept
    moved, lost : how far the start was projected, and the part of its kinetic energy that this took
    error : largest relative error of a distance at the samples
    temperatures, errors : means over the samples and standard errors, by kind of motion: translation, rotation,
        vibration; a kind without freedom is left out, and an error is None if the run is too short
    verdict : on equipartition; "" with one kind of motion
    """

    constraints: int
    moved: float
    lost: float
    error: float
    temperatures: dict[str, float]
    errors: dict[str, float | None]
    verdict: str

    def lines(self, length: str, temperature: str) -> list[tuple[str, str]]:
        """Lines for people, with the units of length and temperature."""
        said = f"{counted(self.constraints, 'rigid distance', ',')}, largest relative error {self.error:.1e}"
        lines = [("constraints", said)]
        if self.moved or self.lost:
            lines.append(
                (
                    "start",
                    f"projected on the constraints: positions by up to {measured(f'{self.moved:.3g}', length)}, "
                    f"velocities by {self.lost:.2g} of the kinetic energy",
                )
            )
        if self.temperatures:
            parts = [
                f"{measured(with_error(mean, error) if error else f'{mean:.5g}', temperature)} of {kind}"
                for kind, mean in self.temperatures.items()
                for error in (self.errors[kind],)
            ]
            lines.append(("molecules", ", ".join(parts) + (f": {self.verdict}" if self.verdict else "")))
        return lines


def molecule_report(system: Any, sim: Any) -> MoleculeReport | None:
    """The MoleculeReport of a System that a Simulation runs; None without constraints."""
    held = getattr(system, "constraints", None)
    if held is None:
        return None
    samples = [sample for sample in sim.record.samples if ERROR in sample.columns]
    errors = [sample.columns[ERROR] for sample in samples]
    errors.append(Molecules(system, sim.method.drags).error(sim.state.phase))
    found: dict[str, Floats] = {}
    if samples:
        steps, times = np.array([s.step for s in samples]), np.array([s.time for s in samples])
        some = even_looks(steps, times) if not sim.method.chooses_steps else slice(None)
        for name in TEMPERATURES:
            if name in samples[0].columns:
                found[name.partition("_")[0]] = np.array([s.columns[name] for s in samples])[some]
    return MoleculeReport(
        len(held),
        held.start.moved,
        held.start.lost,
        max(errors),
        {kind: float(values.mean()) for kind, values in found.items()},
        {kind: _error(values) for kind, values in found.items()},
        _verdict(found),
    )


def _error(values: Floats) -> float | None:
    if len(values) < FEWEST:
        return None
    error = float(block_average(values).error)
    return error if np.isfinite(error) else None


def _verdict(found: dict[str, Floats]) -> str:
    """Words on equipartition, from the difference of each other motion and translation."""
    if "translation" not in found or len(found) < 2:
        return ""
    said = []
    for kind, values in found.items():
        if kind == "translation":
            continue
        apart = values - found["translation"]
        if (error := _error(apart)) is None:
            return "too short to judge equipartition"
        mean = float(apart.mean())
        if abs(mean) > FAR * error:
            words = "above" if mean > 0 else "below"
            said.append(f"{kind} is {with_error(abs(mean), error)} {words} translation")
    return f"no equipartition, {' and '.join(said)}" if said else "equipartition within three standard errors"
