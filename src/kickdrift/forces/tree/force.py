"""Newtonian gravity by a tree, for many particles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from kickdrift.errors import InputError
from kickdrift.forces.laws.central import check_masses, check_open, check_positive, gravitational_constant
from kickdrift.forces.seam.arguments import number
from kickdrift.forces.seam.group import Grouped
from kickdrift.model.checks.arguments import checked_arguments

if TYPE_CHECKING:
    from kickdrift.model.subject import Subject


@checked_arguments
@dataclass(frozen=True)
class GravityTree(Grouped):
    """Newtonian gravity of many particles to a chosen accuracy, in a time that grows as n log n.

    Far particles attract as groups, by their mass and quadrupole moment (Barnes & Hut 1986, doi:10.1038/324446a0).

    A group of particles counts as a whole if the error bound of its quadrupole (Salmon & Warren 1994,
    doi:10.1006/jcph.1994.1050) is below a share of the local acceleration. That acceleration is estimated first, so
    only the positions decide, and a run may be stopped and resumed anywhere. The errors of many groups partly cancel.
    The share is measured, so that ``accuracy`` holds for 99 % of the particles (kickdrift_validation.barnes_hut:
    Plummer spheres, uniform cubes, far clusters, a disc).

    The two forces of a pair are not exactly opposite, so the total momentum is conserved only to the accuracy. The
    forces jump slightly when a group begins to count as a whole. An adaptive method with tolerances far below the
    accuracy reacts to these jumps. Below some thousand particles ``gravity`` is faster, and exact.

    Attributes
    ----------
    accuracy : float
        Largest relative error |a - a_exact| / |a_exact| of 99 % of the particles; between 0 and 1.
    softening : float
        A length; default 0. Massless particles feel the others and attract nothing.
    G : float, optional
        In the system's units; default the unit system's own.
    """

    accuracy: float = 1e-3
    softening: float = 0.0
    G: float | None = None

    name: ClassVar[str] = "gravity-tree"
    stands_for: ClassVar[str] = "gravity of all pairs"
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

    def check(self, system: Subject) -> None:
        """Raise InputError for a system that this force cannot run."""
        check_open(self.name, system)
        gravitational_constant(self.name, self.G, system)
        check_masses(self.name, system)

    @property
    def may_overlap(self) -> bool:
        """Tell whether this force allows particles at the same place at the start."""
        return self.softening > 0

    def stated_error(self) -> float:
        """See Grouped."""
        return self.accuracy

    def bind(self, system: Subject, threads: int = 1) -> Any:
        """Bind this force to a System: a NamedTuple with a compiled body."""
        from kickdrift.forces.tree.kernel import bind

        gm = gravitational_constant(self.name, self.G, system) * system.state.masses
        return bind(gm, system.coherent_masses, self.softening, self.accuracy, threads)
