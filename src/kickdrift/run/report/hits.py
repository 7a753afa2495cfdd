"""What a run's report says of the hits of hard spheres."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from kickdrift.text import counted


@dataclass(frozen=True)
class HitReport:
    """Hits since the start of the run, or since its state was last set.

    Attributes
    ----------
    spheres, walls : hits of two spheres, and of a sphere and a wall
    rate : hits of two spheres in a unit of time; None before the first step
    """

    spheres: int
    walls: int
    rate: float | None

    def lines(self, time: str) -> list[tuple[str, str]]:
        """Line for people, with the unit of time."""
        rate = "" if self.rate is None else f", {self.rate:.6g} per {time or 'time'}"
        walls = f"; {self.walls:,} off walls" if self.walls else ""
        return [("hits", f"{counted(self.spheres, 'hit', ',')} of two spheres{rate}{walls}")]


def hit_report(sim: Any) -> HitReport | None:
    """The HitReport of a Simulation; None unless its method finds hits itself."""
    if not sim.method.bounces:
        return None
    hits = sim.integration.stepper.hits
    return HitReport(hits.spheres, hits.walls, hits.spheres / hits.span if hits.span > 0.0 else None)
