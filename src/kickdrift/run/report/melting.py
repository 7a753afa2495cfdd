"""Signs that a run starts from a lattice and leaves it: the run is not in equilibrium then."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.text import measured

LEAST_LOOKS = 10
CHANGE = 0.05  # of the temperature; a smaller change leaves averages as they are
FLUCTUATIONS = 4.0  # standard deviations of the temperature in the second half
PROBES = 8  # particles whose nearest neighbours are measured
LINDEMANN = 0.3  # distances of neighbours that a particle is off its site; crystals melt near 0.1 to 0.15
EVEN = 1e-3  # spread of the nearest distances on a lattice, of their mean


class Now(Protocol):
    """A run with its present state."""

    @property
    def state(self) -> Any: ...


def melting(system: System, temperatures: Floats | None, run: Now, bath: bool = False) -> list[str]:
    """Return a warning if the temperature shows that the lattice of the start melts during the run. A ``bath`` changes
    the temperature by itself."""
    change = temperature_change(temperatures)
    if change is None or not has_melted(system, run.state.positions):
        return []
    first, later = change
    mean = measured(f"{later:.4g}", system.units.symbol("temperature"))
    sign = f"the lattice is melting: the temperature {'falls' if later < first else 'rises'} from {first:.4g} to {mean}"
    if bath:
        sign = f"the run starts from a lattice, which it leaves while the bath brings {first:.4g} to {mean}"
    return [
        f"{sign} (mean of the second half), so the run is not in equilibrium; equilibrate first, with [equilibrate] in "
        "the system file or with sim.equilibrate"
    ]


def temperature_change(temperatures: Floats | None) -> tuple[float, float] | None:
    """Return the first temperature and the mean of the second half, if they differ by more than fluctuations."""
    if temperatures is None or len(temperatures) < LEAST_LOOKS or not np.isfinite(temperatures).all():
        return None
    later = temperatures[len(temperatures) // 2 :]
    first, mean = float(temperatures[0]), float(later.mean())
    change = abs(mean - first)
    return (first, mean) if change > CHANGE * mean and change > FLUCTUATIONS * float(later.std()) else None


def lattice_spacing(system: System) -> float | None:
    """Return the distance of nearest neighbours at the start if some particles, evenly chosen, all have the same."""
    positions, count = system.state.positions, len(system)
    if count <= PROBES:
        return None
    nearest = []
    for i in np.linspace(0, count - 1, PROBES).astype(int):
        apart = system.box.minimum_image(positions - positions[i])
        distances = np.einsum("ij,ij->i", apart, apart)
        distances[i] = np.inf
        nearest.append(np.sqrt(distances.min()))
    return float(np.mean(nearest)) if np.ptp(nearest) <= EVEN * np.mean(nearest) else None


def has_melted(system: System, positions: Floats) -> bool:
    """Tell whether the run starts from a lattice, and the particles, now at ``positions`` (n, 3), unwrapped, are off
    their sites by more than a crystal's particles (Lindemann 1910, Phys. Z. 11, 609)."""
    start, spacing = system.state.positions, lattice_spacing(system)
    if spacing is None or positions.shape != start.shape:
        return False
    moved = positions - start
    moved = moved - moved.mean(axis=0)
    return float(np.sqrt(np.einsum("ij,ij->i", moved, moved).mean())) > LINDEMANN * spacing
