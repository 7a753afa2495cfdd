"""Hard spheres that fly straight between hits, and hit at the exact times."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from kickdrift.errors import InputError
from kickdrift.integrators.method import Method

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.options import Options
    from kickdrift.integrators.stepping.stepper import Stepper
    from kickdrift.model.system import System


@dataclass(frozen=True)
class EventDriven(Method):
    """All hits of spheres with each other and with walls, in the order of their times, with straight lines between.

    The System has one `Collision` with action "bounce", and no force but reflecting walls. The time of a hit is the
    root of a quadratic equation, so the error is rounding for any step. ``dt`` is the time between two step points, at
    which the run may look. Each step predicts the next hit of each sphere from the cells around it, and a tree of
    winners finds the earliest one.
    """

    name: str
    order: int
    source: str
    use: str = ""

    family = "event-driven"
    particles_only = True
    reflects = bounces = True
    float64_because = "computes the times of hits in float64"
    moves_all_because = "lets every sphere fly from hit to hit"
    moves = "spheres"
    declared = ()

    def check(self, system: System) -> None:
        """Raise InputError unless the System has one bounce, no other event, and no force but walls."""
        from kickdrift.model.events.collision import Collision

        events = system.events
        if len(events) != 1 or not isinstance(events[0], Collision) or events[0].action != "bounce":
            found = ", ".join(event.kind for event in events) or "none"
            raise InputError(
                f"{self.name}: needs one event 'collision' with action 'bounce' and no other event; {system.name!r} "
                f"has {found}"
            )
        for force in system.forces:
            if not getattr(force, "reflects", False):
                raise InputError(
                    f"{self.name}: spheres fly straight between hits, and force {force.name!r} bends their ways; "
                    "methods with fixed steps search each step for contacts"
                )

    def stepper(self, flow: Flow, options: Options) -> Stepper:
        self.system_of(flow)
        from kickdrift.integrators.event_driven.stepper import EventDrivenStepper

        return EventDrivenStepper(flow, options)


ROWS = (
    EventDriven(
        "event-driven", 0,
        "Alder & Wainwright 1959, doi:10.1063/1.1730376; Lubachevsky 1991, doi:10.1016/0021-9991(91)90222-7",
        "hard spheres and granular gases",
    ),
)  # fmt: skip
