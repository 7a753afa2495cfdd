"""Leapfrog with a step for each body, for star clusters and galaxies of many bodies under the gravity tree."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from kickdrift.errors import InputError
from kickdrift.integrators.method import Method
from kickdrift.integrators.options import ETA

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.options import Options
    from kickdrift.integrators.stepping.stepper import Stepper
    from kickdrift.model.system import System


@dataclass(frozen=True)
class BlockLeapfrog(Method):
    """Kick, drift and kick of each body by a step of its own: ``dt`` or a half, a quarter, … of it.

    A body's step is at most sqrt(2 ``eta`` softening / |a|). All bodies drift by the shortest step, and those whose
    step ends there get their acceleration by the tree. A step may be halved whenever it ends, and doubled where the
    longer step would end too. After ``dt`` all bodies are at the same time, and samples are taken. The system has one
    force ``gravity-tree`` with a softening; other forces may depend on positions and time.
    """

    name: str
    order: int
    source: str
    use: str = ""

    family = "block steps"
    moves_all_because = "moves each body by a step of its own"
    float64_because = "sums gravity by a tree"
    separable = True
    particles_only = True
    moves = "bodies under gravity-tree"
    declared = (ETA,)

    def check(self, system: System) -> None:
        """Raise InputError for a System without a softened tree, and for forces that depend on velocity."""
        from kickdrift.forces.tree.force import GravityTree

        trees = [force for force in system.forces if isinstance(force, GravityTree)]
        if len(trees) != 1:
            raise InputError(
                f"{self.name}: needs one force 'gravity-tree', and {system.name!r} has {len(trees) or 'none'}; "
                "hermite4 with scheme = 'block' takes gravity"
            )
        if not trees[0].softening > 0:
            raise InputError(f"{self.name}: needs a softening of gravity-tree, which sets the steps; got none")
        for force in system.forces:
            if getattr(force, "velocity_dependent", False):
                raise InputError(f"{self.name}: force {force.name!r} depends on velocity; leapfrog takes it")

    def checked(self, given: Options, asked: Options) -> Options:
        options = super().checked(given, asked)
        return options if options.eta is not None else options.changed(eta=ETA.default)

    def stepper(self, flow: Flow, options: Options) -> Stepper:
        self.system_of(flow)
        from kickdrift.integrators.block_leapfrog.stepper import BlockStepper

        return BlockStepper(flow, options)


ROWS = (
    BlockLeapfrog(
        "leapfrog-block", 2,
        "Quinn, Katz, Stadel & Lake 1997, arXiv:astro-ph/9710043; steps: Springel 2005, "
        "doi:10.1111/j.1365-2966.2005.09655.x, eq. 34",
        "clusters and galaxies of 10,000 bodies and more, with gravity-tree",
    ),
)  # fmt: skip
