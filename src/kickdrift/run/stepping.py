"""The flow of a run's system and the stepper of its method, in this program or in another one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from kickdrift.engines.job import Job
from kickdrift.engines.session import RunFlow, begin
from kickdrift.errors import InputError
from kickdrift.integrators.flows.flow import flow_of
from kickdrift.integrators.flows.particle_flow import ParticleFlow
from kickdrift.integrators.options import MIXED, coupling_of

if TYPE_CHECKING:
    from kickdrift.engines import Engine


def stepping(engine: Engine, job: Job) -> tuple[RunFlow, Any]:
    """A flow of the job's system, and the stepper of its method.

    Raises InputError if the method needs separable accelerations and the system has others."""
    if engine.foreign:
        return begin(engine, job)
    method, options = job.method, job.options
    mixed = options.precision == MIXED
    flow = flow_of(job.system, job.threads, jumps=method.trial_steps, mixed=mixed, coupling=coupling_of(options))
    if method.separable and flow.not_separable:
        raise InputError(
            f"{job.named}: needs accelerations that depend on positions and time alone, and {flow.not_separable}; "
            "Runge-Kutta methods do not"
        )
    if method.bath and isinstance(flow, ParticleFlow):
        flow.count_bath(method.drags)
    return flow, method.stepper(flow, options)
