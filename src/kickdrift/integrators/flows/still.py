"""Energy, pressure and forces of a System where its particles are now, without a run."""

import numpy as np

from kickdrift.errors import RunError
from kickdrift.forces.bound.forces import check_threads
from kickdrift.integrators.flows.flow import flow_of
from kickdrift.jit.cache.notices import compiling_for
from kickdrift.looks.observers import Sample
from kickdrift.model.state import Floats, read_only
from kickdrift.model.system import System


def still_sample(system: System, threads: int = 1) -> Sample:
    """The sample with which a run from here begins. Raises RunError if forces or energy are not finite."""
    with compiling_for(f"the forces of {system.name}"):
        flow = flow_of(system, check_threads(threads), jumps=True)
        return flow.sample(flow.array(system.state), system.state.time, 0)  # type: ignore[arg-type]


def still_forces(system: System, threads: int = 1) -> Floats:
    """Forces (n, 3) on the particles, also on fixed ones; a read-only array. Raises RunError if they are not finite."""
    with compiling_for(f"the forces of {system.name}"):
        flow = flow_of(system, check_threads(threads), jumps=True)
        found = flow.felt(flow.array(system.state), system.state.time)  # type: ignore[union-attr, arg-type]
    if found is None:
        raise RunError("the forces at these positions are not finite")
    return read_only(np.ascontiguousarray((found * system.coherent_masses).T))
