"""Planets that meet: a time-reversible hybrid of the Wisdom-Holman map and a method of high order."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.beside.columns import further
from kickdrift.integrators.method import OWN_FORCES, Method
from kickdrift.integrators.options import HILL_RADII, INNER, PERICENTRE, Option
from kickdrift.integrators.wisdom_holman.method import one_gravity

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.options import Options
    from kickdrift.integrators.stepping.batch_loops import LaneStepper, Members
    from kickdrift.integrators.stepping.stepper import Stepper
    from kickdrift.model.system import System

WAYS = ("none", "partial", "full")  # in the order of trace_state
METHODS = ("gauss-radau15", "bulirsch-stoer")


@dataclass(frozen=True)
class Trace(Method):
    """The Wisdom-Holman map in democratic heliocentric coordinates, with a method of high order for close encounters
    and pericentre passages inside the step.

    Two bodies meet if their distance is below ``hill_radii`` times r (m / (3 m_0))^(1/3), now or within half a step.
    They move together for the whole step, and their attraction is no kick.

    A body passes its pericentre if its Kepler motion changes in less time than a step. All massive bodies then move
    together. With ``pericentre`` "full" they feel all their attractions. With "partial" they feel those of the central
    body and of near bodies, and the others are kicks.

    A massless body moves with copies of the bodies that it meets, and changes none of them. If the end of a step shows
    a further encounter, the step is done again with that encounter. This makes the map reversible.

    Forces other than gravity act inside encounters and passages on the bodies that move together. All other bodies feel
    these forces as kicks.
    """

    name: str
    order: int
    source: str
    use: str = ""

    family = "Kepler splitting"
    moves_all_because = "moves bodies along orbits around a central one"
    reversible = True
    particles_only = True
    batched = stops_in_lanes = True
    evaluations = 0
    float64_because = OWN_FORCES
    declared: ClassVar[tuple[Option, ...]] = (HILL_RADII, PERICENTRE, INNER)

    def check(self, system: System) -> None:
        """Raise InputError for a System without a central body, without gravity, with softened gravity, or with
        unknowns beside the bodies, such as spins."""
        one_gravity(self.name, system)
        for force, kind in further(system):
            raise InputError(
                f"{self.name}: moves bodies, and force {force.name!r} also "
                + ("turns their spins" if kind.moments else f"changes {kind.key}")
                + "; gauss-radau15 takes both"
                + (", and force 'tides' leaves the spins as they are" if kind.moments else "")
            )
        if not np.any(system.state.masses > 0.0):
            raise InputError(f"{self.name}: needs a central body, but no particle has mass")

    def stepper(self, flow: Flow, options: Options) -> Stepper:
        self.system_of(flow)
        if flow.not_separable and options.inner != METHODS[0]:
            raise InputError(
                f"inner: {options.inner} needs accelerations that depend on positions and time alone, and "
                f"{flow.not_separable}; take {METHODS[0]}"
            )
        from kickdrift.integrators.trace.stepper import TraceStepper

        return TraceStepper(flow, WAYS.index(options.pericentre), METHODS.index(options.inner), options)

    def in_lanes(self, members: Members, options: Options) -> LaneStepper:
        from kickdrift.integrators.trace.batch import TraceLanes

        return TraceLanes(members, WAYS.index(options.pericentre), METHODS.index(options.inner), options)


ROWS = (
    Trace(
        "trace", 2,
        "Lu, Hernandez & Rein 2024, doi:10.1093/mnras/stae1982; Hernandez & Dehnen 2023, MNRAS 522, 4639",
        "planets that meet, pericentre passages, scattering",
    ),
)  # fmt: skip
