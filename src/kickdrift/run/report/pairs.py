"""What a run says of its regularised pairs: a line in the report, and an event for each formation and break-up."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from kickdrift.integrators.options import PAIRS, REGULARISED
from kickdrift.looks.report_lines import pair_lines
from kickdrift.model.event_log import Row, entry
from kickdrift.model.system import System

FORMED, BROKEN = "pair-formed", "pair-broken"  # kinds of events


@dataclass(frozen=True)
class PairReport:
    """Regularised pairs since the start of the run, or since its state was last set.

    Attributes
    ----------
    formed, broken : how many pairs formed and broke up
    bodies : numbers of the two bodies of each pair now
    """

    formed: int
    broken: int
    bodies: list[tuple[int, int]]

    def lines(self) -> list[tuple[str, str]]:
        """Line for people."""
        return pair_lines(asdict(self))


def pair_report(sim: Any) -> PairReport | None:
    """The PairReport of a Simulation; None unless its method regularises pairs."""
    if sim.options.get(PAIRS.name) != REGULARISED:
        return None
    stepper = sim.integration.stepper
    stepper = getattr(stepper, "inner", stepper)
    return PairReport(stepper.formed, stepper.broken, stepper.pairs)


def pair_rows(system: System, stepper: Any) -> list[Row]:
    """Events of the pairs that have formed and broken up since the last call, with the elements of their orbits."""
    rows = []
    for each in stepper.changes():
        kind, orbit = FORMED if each.formed else BROKEN, f"a = {each.axis:.6g}, e = {each.eccentricity:.6f}"
        rows.append(entry(system, kind, each.time, each.step, each.bodies, each.distance, orbit))
    return rows
