"""Newtonian gravity by a tree, for many particles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from kickdrift.errors import InputError
from kickdrift.forces.central import check_masses, check_open, check_positive, gravitational_constant
from kickdrift.forces.fields import number

if TYPE_CHECKING:
    from kickdrift.model.system import System


@dataclass(frozen=True)
class GravityTree:
    """Newtonian gravity of many particles to a chosen accuracy, in a time that grows as n log n.

    Far particles pull in groups, by their mass and quadrupole moment (Barnes & Hut 1986, doi:10.1038/324446a0).

    A group of particles pulls as a whole where a bound on what its quadrupole leaves out (Salmon & Warren 1994,
    doi:10.1006/jcph.1994.1050) is under a share of the acceleration there, which is estimated first, so the positions
    alone decide and a run can be cut anywhere. The errors of many groups cancel in part; the share is set, by
    measurement, so that ``accuracy`` holds for 99 % of the particles (kickdrift_validation.barnes_hut: Plummer spheres,
    uniform cubes, far clusters, a disc).

    The forces of two particles on each other are not quite opposite, so the total momentum is conserved to the accuracy
    alone; and they jump a little where a group begins to count as one, which an adaptive method with tolerances far
    under the accuracy takes for structure. Below some thousand particles ``gravity`` is quicker, and exact.

    Attributes
    ----------
    accuracy : float
        Relative error |a - a_exact| / |a_exact| that 99 % of the particles stay within; between 0 and 1.
    softening : float
        A length; default 0. Massless particles feel the others and do not pull.
    G : float, optional
        In the system's units; default the unit system's own.
    """

    accuracy: float = 1e-3
    softening: float = 0.0
    G: float | None = None

    name: ClassVar[str] = "gravity-tree"
    by_mass: ClassVar[bool] = True
    dimensions: ClassVar[dict[str, str]] = {"G": "gravitational constant", "softening": "length"}

    def __post_init__(self) -> None:
        for key in ("accuracy", "softening"):
            object.__setattr__(self, key, number(self.name, key, getattr(self, key)))
        check_positive(self.name, G=self.G)
        if not 0 < self.accuracy < 1:
            raise InputError(f"{self.name}: accuracy must be between 0 and 1, got {self.accuracy}")
        if self.softening < 0:
            raise InputError(f"{self.name}: softening must be a length, zero or more, got {self.softening}")

    def check(self, system: System) -> None:
        """Refuse a system that this force cannot run on."""
        check_open(self.name, system)
        gravitational_constant(self.name, self.G, system)
        check_masses(self.name, system)

    @property
    def may_overlap(self) -> bool:
        """Whether particles may begin at the same place as far as this force is concerned."""
        return self.softening > 0

    def bind(self, system: System, threads: int = 1) -> Any:
        """The parts of this force for a System: a NamedTuple with a compiled body."""
        from kickdrift.forces.tree_kernel import bind

        return bind(self, system, threads)
