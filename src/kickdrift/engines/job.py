"""Request of a Simulation to an engine."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from kickdrift.integrators.method import Method
    from kickdrift.integrators.options import Options
    from kickdrift.model.system import System


@dataclass(frozen=True)
class Job:
    """Request of a Simulation to an engine. ``named`` is the requested name of the method; ``hosts`` are the machines
    of the processes by name, with the number of processes that each takes."""

    system: System
    method: Method
    named: str
    options: Options
    threads: int = 1
    processes: int = 1
    hosts: Mapping[str, int] | None = None
