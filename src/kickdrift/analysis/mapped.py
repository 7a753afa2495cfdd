"""Methods whose tangent map serves, and the runs by these maps."""

from __future__ import annotations

from typing import Any

from kickdrift.analysis.columns import Columns
from kickdrift.analysis.map_run import MapRun
from kickdrift.analysis.tangent_run import TangentRun
from kickdrift.analysis.trace_tangent_run import TraceTangentRun
from kickdrift.integrators.trace import Trace
from kickdrift.integrators.wisdom_holman import WisdomHolman
from kickdrift.model.system import System


def has_map(method: Any) -> bool:
    """Whether derivatives move by this method's tangent map."""
    return isinstance(method, WisdomHolman | Trace)


def map_run(
    system: System, columns: Columns | None, method: Any, threads: int, options: dict[str, Any]
) -> MapRun:
    """A System with derivatives under a method that has a tangent map. Without columns the caller gives the deviations
    to ``start``."""
    kind = TraceTangentRun if isinstance(method, Trace) else TangentRun
    return kind(system, columns, method.name, threads, options)
