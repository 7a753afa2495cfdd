"""Energy and momenta that an event takes out of a run."""

from __future__ import annotations

import numpy as np

from kickdrift.forces.fields.shipped import Hill
from kickdrift.looks.observers import Sample, Taken, angular_momentum, kinetic_energy
from kickdrift.model.state import Floats
from kickdrift.model.system import System


def taken_between(before: Sample, after: Sample) -> Taken:
    """The difference of two samples, just before and just after an event."""
    return Taken(
        before.energies.total - after.energies.total,
        _lost(before.momentum, after.momentum),
        _lost(before.angular_momentum, after.angular_momentum),
    )


def energy_of_places(system: System) -> bool:
    """Tell whether the potential energy is known to depend on positions and time alone. A bounce then changes nothing
    but the velocities of two bodies, and needs no forces."""
    return all(not getattr(force, "velocity_dependent", False) or isinstance(force, Hill) for force in system.forces)


def taken_by_bounce(system: System, before: Floats, after: Floats, bodies: tuple[int, ...]) -> Taken:
    """Losses of the two bodies of a bounce, whose velocities alone differ between two states (2, 3, n)."""
    rows = list(bodies)
    m, x = system.coherent_masses[rows], before[0][:, rows]
    v, u = before[1][:, rows], after[1][:, rows]
    return Taken(kinetic_energy(m, v) - kinetic_energy(m, u), (v - u) @ m, angular_momentum(m, x, v - u))


def _lost(before: Floats | None, after: Floats | None) -> Floats | float:
    return np.zeros(3) if before is None or after is None else before - after
