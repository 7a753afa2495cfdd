"""A graphics processor of NVIDIA, by kernels that numba-cuda compiles: the same laws, for many more particles.

The session imports the kernels, and nothing else imports them, so that no other run loads numba's CUDA target. Users
see ``refusal`` and ``session`` (see ``Engine``).
"""

from __future__ import annotations

from typing import Any

from kickdrift.engines.job import RESCALING, Job
from kickdrift.forces import Gravity
from kickdrift.forces.pairs.law import PairForce
from kickdrift.forces.pairs.tabulated import Tabulated
from kickdrift.integrators.options import MIXED

TAKES = "the device takes one pair law or gravity, alone"


def refusal(job: Job) -> str | None:
    """See Engine."""
    system = job.system
    if system.topology is not None:
        return "topology: the device has no bonds and leaves out no pairs"
    if len(system.forces) != 1 or not isinstance(system.forces[0], PairForce | Gravity):
        names = " and ".join(repr(force.name) for force in system.forces)
        given = f"force{'s' * (len(system.forces) > 1)} {names}" if names else f"{system.name!r} has no force"
        return f"{given}: {TAKES}"
    if isinstance(system.forces[0], Tabulated):
        return f"force {system.forces[0].name!r}: the device takes a formula; a table lies in the processor's memory"
    further = getattr(job.method, "further", "")
    if further and further in RESCALING and not any(system.box.periodic_axes):
        return f"integrator {job.named!r}: on the device, it needs a box that is periodic along an axis"
    if system.box.triclinic:
        return "box: it leans, and the device has boxes with perpendicular edges"
    if job.options.precision == MIXED and isinstance(system.forces[0], PairForce) and not all(system.box.periodic_axes):
        return "precision: on the device, mixed needs a box that is periodic along each axis"
    if job.options.precision == MIXED and system.units.name == "si":
        return "units 'si': float32 has no sixth powers of metres so small; use metal, with angstroms"
    return None


def session(job: Job) -> Any:
    """See Engine."""
    from kickdrift.engines.cuda.steps import CudaSession

    return CudaSession(job)
