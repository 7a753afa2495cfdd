"""Forces and accelerations of the particles at the current time of a run."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from kickdrift.errors import InputError, RunError
from kickdrift.model.state import Floats, read_only

if TYPE_CHECKING:
    from kickdrift.run.advance import Integration


def accelerations_at(run: Integration) -> Floats:
    """Accelerations of the particles now, (n, 3), in the system's units; a read-only copy."""
    return read_only(_accelerations(run, "accelerations").T.copy())


def forces_at(run: Integration) -> Floats:
    """Forces on the particles now, (n, 3), in the system's energy unit per length; a read-only copy."""
    flow: Any = run.flow
    return read_only((_accelerations(run, "forces") * flow.subject.coherent_masses).T.copy())


def _accelerations(run: Integration, key: str) -> Any:
    """Accelerations now, (3, n); ``key`` names the quantity in errors."""
    flow: Any = run.flow
    if not flow.of_particles:
        raise InputError(f"{key}: a Problem has no {key}")
    found = flow.accelerations(run.y, run.time)
    if found is None:
        raise RunError(f"step {run.steps_done}: the forces at these positions are not finite")
    return found
