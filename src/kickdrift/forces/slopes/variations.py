"""Forces with their variations: deviation vectors move as additional particles.

A *varied* System has n (1 + k) particles: the n particles of the System, then k massless deviations of particle 0, k of
particle 1, and so on. The accelerations of the deviations follow the variational equations, a' = (da/dx) dx + (da/dv)
dv + (da/dm) dm. Any integrator of y' = f(t, y) moves both; its step for the deviations is the derivative of its step
for the particles.

Deviations of order 2 are second derivatives along two deviations of order 1. They obey the same equation, and the
second derivative of the force along these two is added.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.beside.columns import COLUMNS
from kickdrift.forces.charges.coulomb import Coulomb
from kickdrift.forces.external.calculator import CalculatorForce
from kickdrift.forces.external.lammps import LammpsForce
from kickdrift.forces.gravity.direct import Gravity
from kickdrift.forces.pairs.law import PairForce
from kickdrift.forces.seam.group import ListedForce
from kickdrift.forces.tree.force import GravityTree

if TYPE_CHECKING:
    from kickdrift.forces.slopes.pushes import PairPush, Push
    from kickdrift.model.state import Floats
    from kickdrift.model.system import System

SERIAL = 64  # from more bodies on, a single deviation takes its slopes on all threads


class Varied:
    """A force of a System, for its particles and their deviations.

    Gravity has its variation in closed form. Laws of fields, bodies and bonds have exact slopes by duals. Other
    forces, and laws whose code takes no duals, use central differences along the deviation, with a relative error of
    some 1e-10; after the first evaluation ``differs`` tells which. Forces on a neighbour list are `VariedPairs`.
    Gravity by a tree is refused. ``masses`` (n, k) are the slopes of the masses along the deviations, for gravity and
    forces on a list. ``first`` is the number of deviations of order 1 among the k; gravity alone has those of order 2.
    """

    may_overlap: ClassVar[bool] = True  # a deviation is not a position

    def __init__(
        self, force: Any, system: System, masses: Floats | None = None, along: int = 1, first: int | None = None
    ) -> None:
        if system.tied_by:
            raise InputError(f"{system.tied_by}: motion under {system.tied_by} has no variational equations yet")
        if isinstance(force, GravityTree):  # its tree makes the sums jump
            raise InputError(f"force {force.name!r}: has no variational equations; 'gravity' has them")
        if isinstance(
            force, CalculatorForce | LammpsForce
        ):  # its memory does so too, and rounding may be that of float32
            raise InputError(f"force {force.name!r}: has no variational equations; gravity, fields and functions do")
        if isinstance(force, Coulomb):  # as yet
            raise InputError(f"force {force.name!r}: has no variational equations; pair forces without charges do")
        if (kind := COLUMNS.get(force.name)) is not None:
            hint = "; 'tides' has them" if kind.moments else ""
            raise InputError(f"force {force.name!r}: {kind.key} that evolve have no variational equations{hint}")
        self.force, self.system, self.name = force, system, force.name
        self._masses, self._along, self._first = masses, along, along if first is None else first
        if self._first < along and not isinstance(force, Gravity):
            raise InputError(
                f"force {force.name!r}: has no variational equations of second order; gravity alone has them"
            )
        self._found: Any = None
        for trait in ("external", "works", "velocity_dependent", "reflects"):
            setattr(self, trait, getattr(force, trait, False))

    @property
    def differs(self) -> bool:
        """Whether the slopes came from central differences."""
        from kickdrift.forces.slopes.variations_kernel import DIFFERENCES

        return self._found is not None and bool(self._found[0] == DIFFERENCES)

    def check(self, system: System) -> None:
        """Accept every System, since it has already been checked."""

    def bind(self, system: System, threads: int = 1) -> Any:
        """Return the parts: a NamedTuple with a compiled body."""
        from kickdrift.forces.slopes.variations_kernel import bind_directions, bind_variations

        alone = self._along == 1 and self._masses is None and len(self.system) > SERIAL
        if isinstance(self.force, Gravity) and not alone:
            return bind_directions(self.force, self.system, threads, self._masses, self._along, self._first)
        parts: Any = bind_variations(self.force, self.system, threads, isinstance(self.force, Gravity))
        self._found = getattr(parts, "found", None)
        return parts


class VariedPairs(Varied, ListedForce):
    """A force on a neighbour list, for the particles of a System and their deviations, on one list.

    Pair laws with their truncations, and many-body forces, have exact slopes by duals."""

    differs = False

    def bind(self, system: System, threads: int = 1, mixed: bool = False) -> Any:
        """Return the bound force, a `beside_pairs.BesidePairs`."""
        from kickdrift.forces.many_body import slopes as many_body_slopes
        from kickdrift.forces.pairs import beside_pairs
        from kickdrift.forces.pairs import slopes as pair_slopes

        if mixed:
            raise InputError("precision: variational equations need double")
        own = self.force.bind(self.system, threads)
        by_masses = beside_pairs.slopes_by_masses(self.system.state.masses, self._masses)
        if isinstance(self.force, PairForce):
            return pair_slopes.bind(own, by_masses, self._along)
        return many_body_slopes.bind(own, by_masses)


def varied_force(
    force: Any, system: System, masses: Floats | None = None, along: int = 1, first: int | None = None
) -> Varied:
    """The force of a System, for its particles and deviations. Raises InputError for a force without variational
    equations."""
    return (VariedPairs if isinstance(force, ListedForce) else Varied)(force, system, masses, along, first)


def check_mapped(force: Any, system: System, name: str, twice: bool = False) -> None:
    """Refuse a force that the tangent map of a method does not take, to second order if ``twice``."""
    if isinstance(force, ListedForce):
        raise InputError(
            f"force {force.name!r}: the tangent map of {name} takes no forces on a list of neighbours; "
            "velocity-verlet and gauss-radau15 do"
        )
    Varied(force, system, along=1 + twice, first=1)  # refuses a force without slopes


def particles_in(system: Any) -> int:
    """Number of particles of a System, without deviations."""
    return next((len(force.system) for force in system.forces if isinstance(force, Varied)), len(system))


def unvaried(force: Any) -> Any:
    """The force of a System without deviations, for that of a varied one; any other force unchanged."""
    return force.force if isinstance(force, Varied) else force


def varied(
    system: System,
    deviations: Floats,
    masses: Floats | None = None,
    pushes: Iterable[Push | PairPush] = (),
    first: int | None = None,
) -> System:
    """Return the System with deviations (2, 3, n k) of positions and velocities as additional particles: k of particle
    0, then k of particle 1, and so on. ``masses`` (n, k) are the slopes of the masses along them, for gravity;
    ``pushes`` add what other numbers do. The first ``first`` of the k are of order 1, default all; the others are
    of order 2, as `variations_kernel.GravityAlong` orders them."""
    from kickdrift.model.starts.builders import check_overlaps
    from kickdrift.model.system import System

    check_overlaps(system)
    along = deviations.shape[2] // len(system)
    x, v = np.concatenate([system.state.phase, deviations], axis=2)
    own = system.state.masses
    names = [system.body(i) for i in range(len(system))]
    each = range(1, along + 1)
    more = [f"the deviation of {name}" if along == 1 else f"deviation {k} of {name}" for name in names for k in each]
    made = System(
        x.T, v.T, np.concatenate([own, np.zeros(deviations.shape[2])]), system.box,
        [*(varied_force(force, system, masses, along, first) for force in system.forces), *pushes], system.units,
        name=system.name, run=system.run, names=[*names, *more],
    )  # fmt: skip
    return made.at(made.state.phase, system.state.time)
