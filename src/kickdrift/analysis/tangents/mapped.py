"""Methods whose tangent map serves, and the runs by these maps."""

from __future__ import annotations

from typing import Any

from kickdrift.analysis.tangents.columns import Columns
from kickdrift.analysis.tangents.map_run import MapRun
from kickdrift.analysis.tangents.tangent_run import TangentRun
from kickdrift.analysis.tangents.trace_tangent_run import TraceTangentRun
from kickdrift.forces.gravity.direct import Gravity
from kickdrift.integrators.trace.method import Trace
from kickdrift.integrators.wisdom_holman.method import WisdomHolman
from kickdrift.model.system import System


def has_map(method: Any) -> bool:
    """Whether derivatives move by this method's tangent map."""
    return isinstance(method, WisdomHolman | Trace)


def serves(method: Any, system: System, columns: Columns, given: dict[str, Any]) -> bool:
    """Whether the tangent map of a system file's own method gives these columns."""
    alone = all(isinstance(force, Gravity) for force in system.forces)
    has_step = given.get("dt") is not None or system.run.dt is not None
    if isinstance(method, Trace):
        of_masses = columns.of_masses(len(system))
        light = of_masses is not None and of_masses[system.state.masses == 0.0].any()
        alone = alone and not light
    return alone and has_step


def map_run(
    system: System,
    columns: Columns | None,
    method: Any,
    threads: int,
    options: dict[str, Any],
    twice: bool = False,
) -> MapRun:
    """A System with derivatives under a method that has a tangent map, with second ones if ``twice``. Without columns
    the caller gives the deviations to ``start``."""
    kind = TraceTangentRun if isinstance(method, Trace) else TangentRun
    return kind(system, columns, method.name, threads, options, twice)
