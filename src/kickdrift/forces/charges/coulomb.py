"""Coulomb's law between the charges of a System."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.charges import slab
from kickdrift.forces.charges.accuracy import LEAST, MOST, Charged, Split, cheapest, cost, split_at
from kickdrift.forces.charges.mesh_choice import cheapest_mesh
from kickdrift.forces.charges.mesh_sizes import ORDERS, SMALLEST, is_smooth
from kickdrift.forces.charges.radial import (
    ALL_IMAGES,
    AUTO,
    DAMPED_SHIFTED,
    DIRECT,
    EWALD,
    METHODS,
    PME,
    REACTION_FIELD,
    STRONGEST,
    Radial,
    damped_shifted,
    ewald_near,
    reaction_field,
)
from kickdrift.forces.pairs.law import PairForce
from kickdrift.forces.seam.arguments import number, vector
from kickdrift.forces.seam.group import Grouped, refuse_massless
from kickdrift.model.checks.arguments import checked_arguments
from kickdrift.model.state import Floats
from kickdrift.text import shown

if TYPE_CHECKING:
    from kickdrift.model.box.box import Box
    from kickdrift.model.subject import Subject

KEYS: dict[str, tuple[str, ...]] = {  # of each method
    EWALD: ("accuracy", "cutoff", "alpha", "waves"),
    PME: ("accuracy", "cutoff", "alpha", "mesh", "order"),
    AUTO: ("accuracy",),
    DIRECT: (),
    REACTION_FIELD: ("cutoff", "surroundings"),
    DAMPED_SHIFTED: ("cutoff", "alpha"),
}
ESTIMATE = "Kolafa & Perram 1992, doi:10.1080/08927029208049126"
SLAB = "Yeh & Berkowitz 1999, doi:10.1063/1.479595"
SOURCES: dict[str, str] = {  # of each method
    EWALD: "Ewald 1921, doi:10.1002/andp.19213690304",
    PME: "Essmann et al. 1995, doi:10.1063/1.470117; Wang, Dommert & Holm 2010, doi:10.1063/1.3446812; "
    "Ballenegger 2011, doi:10.1063/1.3555122",
    DIRECT: "",
    REACTION_FIELD: "Tironi et al. 1995, doi:10.1063/1.469273",
    DAMPED_SHIFTED: "Fennell & Gezelter 2006, doi:10.1063/1.2206581",
}
LONGEST = 0.45  # cutoff that Ewald's sum chooses, in least heights of the box, so that a list of pairs has a skin
SINGLE = 5e-7  # least accuracy with pairs in float32, over the cube root of the number of particles: places are rounded
NEUTRAL = 1e-6  # of the largest charge: a larger sum of all charges counts as a net charge


@checked_arguments
@dataclass(frozen=True)
class Coulomb(Grouped):
    """Coulomb's law between charges: U = C q_i q_j / (dielectric r), with C from the unit system.

    The charges are the particles' own, see ``System.charges``. In the cluster list, a pair force of the System and the
    near part of this force are one sum. Pairs that a topology leaves out or scales are left out or scaled here, too.

    Methods: "ewald" (Ewald 1921, doi:10.1002/andp.19213690304) sums over all images in a box that is periodic along
    three axes, surrounded by a conductor. Errors follow Kolafa & Perram (1992, doi:10.1080/08927029208049126). A net
    charge gets a uniform background of the opposite charge. A box that is open along z is a slab in vacuum (Yeh &
    Berkowitz 1999, doi:10.1063/1.479595), whose edge z is its thickness. "pme" does the same with a mesh (Essmann et
    al. 1995, doi:10.1063/1.470117), whose errors are those of `mesh_error`. "auto" is the cheaper one of these two, by
    costs that depend on the system alone. "direct" sums over all pairs in open space.
    "reaction-field" cuts the law off, and a medium acts from beyond the cutoff (Tironi et al. 1995,
    doi:10.1063/1.469273). "damped-shifted" is the damped shifted force of Fennell & Gezelter (2006,
    doi:10.1063/1.2206581).

    Attributes
    ----------
    method : "ewald", "pme", "auto", "direct", "reaction-field" or "damped-shifted"
    accuracy : float
        Root-mean-square error of the forces by "ewald" or "pme", relative to the typical force 0.5 C q^2 / d^2. Here
        q^2 is the mean square of the charges, and d^3 = V / n.
    cutoff : float, optional
        Cutoff of the near part. "ewald" and "pme" choose the cheapest one; a pair force gives the default of other
        methods.
    alpha : float, optional
        Splitting parameter of Ewald's sum, or damping, in an inverse length. The default follows from the accuracy, and
        without damping it is 0.
    waves : float, optional
        Largest wave number of Ewald's sum, in an inverse length; the default follows from the accuracy.
    mesh : (x, y, z), optional
        Points of the mesh along each edge of the box, without prime factors above 5, the last one even; the default
        follows from the accuracy.
    order : int, optional
        Order of the splines, 4 to 8, likewise.
    surroundings : float, optional
        Relative permittivity of the medium of a reaction field; default that of a conductor.
    dielectric : float
        Relative permittivity between the charges.
    """

    method: str = EWALD
    accuracy: float = 1e-4
    cutoff: float | None = None
    alpha: float | None = None
    waves: float | None = None
    mesh: tuple[int, int, int] | None = None
    order: int | None = None
    surroundings: float | None = None
    dielectric: float = 1.0

    name: ClassVar[str] = "coulomb"
    stands_for: ClassVar[str] = "the forces between charges"
    thermal: ClassVar[bool] = True
    takes_charges: ClassVar[bool] = True
    on_sites: ClassVar[bool] = True
    dimensions: ClassVar[dict[str, str]] = {"cutoff": "length", "alpha": "inverse length", "waves": "inverse length"}

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise InputError(f"{self.name}: method {shown(self.method)} is not one of {', '.join(METHODS)}")
        for key in ("accuracy", "dielectric"):
            object.__setattr__(self, key, number(self.name, key, getattr(self, key)))
        for key in ("accuracy", "cutoff", "alpha", "waves", "mesh", "order", "surroundings"):
            if (value := getattr(self, key)) is None or (key == "accuracy" and value == Coulomb.accuracy):
                continue
            if key not in KEYS[self.method]:
                owners = " and ".join(f'"{method}"' for method in METHODS if key in KEYS[method])
                raise InputError(f'{self.name}: {key} goes with method {owners}, not "{self.method}"')
            if key not in ("mesh", "order"):
                object.__setattr__(self, key, number(self.name, key, value))
        self._check_mesh()
        if not LEAST <= self.accuracy <= MOST:
            raise InputError(f"{self.name}: accuracy must be from {LEAST:g} to {MOST:g}, got {shown(self.accuracy)}")
        for key in ("cutoff", "waves", "dielectric"):
            if (value := getattr(self, key)) is not None and value <= 0:
                raise InputError(f"{self.name}: {key} must be positive, got {shown(value)}")
        if self.alpha is not None and not (self.alpha > 0 or (self.alpha == 0 and self.method == DAMPED_SHIFTED)):
            raise InputError(f"{self.name}: alpha must be positive, got {shown(self.alpha)}")
        if self.surroundings is not None and self.surroundings < 1:
            raise InputError(f"{self.name}: surroundings must be 1 or more, got {shown(self.surroundings)}")

    def _check_mesh(self) -> None:
        """Refuse a mesh that no transform takes, and splines of another order."""
        if self.order is not None:
            object.__setattr__(self, "order", order := number(self.name, "order", self.order))
            if order not in ORDERS:
                raise InputError(f"{self.name}: order must be from 4 to 8, got {shown(self.order)}")
            object.__setattr__(self, "order", int(order))
        if self.mesh is not None:
            sizes = vector(self.name, "mesh", self.mesh)
            for axis, n in zip("xyz", sizes, strict=True):
                if not (n.is_integer() and n >= SMALLEST and is_smooth(int(n))) or (axis == "z" and n % 2):
                    even = "an even number" if axis == "z" else "a number"
                    raise InputError(
                        f"{self.name}: mesh along {axis} must be {even} of points, {SMALLEST} or more, without prime "
                        f"factors above 5, got {n:g}"
                    )
            object.__setattr__(self, "mesh", tuple(int(n) for n in sizes))

    def check(self, system: Subject) -> None:
        """Refuse a system that this force does not support."""
        if system.charges is None:
            raise InputError(f"{self.name}: the particles have no charges; give charge in [particles], or charges")
        if system.units.coulomb is None:
            raise InputError(
                f"{self.name}: units {system.units.name!r} have no Coulomb constant; lj, metal, real, gromacs and si "
                "have one"
            )
        host = self.host(system)
        if host is not None and self.group < host.group:
            raise InputError(
                f"{self.name}: group {self.group} is below group {host.group} of {host.name!r}, which takes the near "
                "part into its sum; give both one group, or coulomb the larger one"
            )
        if system.dimensions != 3:
            raise InputError(f"{self.name}: works in three dimensions, and the system has {system.dimensions}")
        if sum(isinstance(force, Coulomb) for force in system.forces) > 1:
            raise InputError(
                f"forces: {self.name} is given twice, and would count the same charges twice; give it once"
            )
        self._check_box(system)
        refuse_massless(self.name, system)
        if system.topology is not None and (far := system.topology.far_special(system.box, system.state.phase[0])):
            raise InputError(f"{self.name}: {far}")
        if self.method != DIRECT:
            split = self.split(system)
            system.box.check_cutoff(self.name, split.cutoff, system.units)
            if split.alpha * split.cutoff > STRONGEST:
                raise InputError(
                    f"{self.name}: alpha times cutoff is {split.alpha * split.cutoff:.3g}; a shorter cutoff than "
                    f"{STRONGEST / split.alpha:.4g} serves as well"
                )

    def _check_box(self, system: Subject) -> None:
        """Refuse a box that the method does not take."""
        axes = system.box.periodic_axes
        if self.method == DIRECT and any(axes):
            raise InputError(f'{self.name}: method "direct" needs open space, and the box is periodic')
        if self.method in ALL_IMAGES and slab.is_slab(system.box):
            if net := self.net_charge(system):
                raise InputError(f"{self.name}: the charges of a slab must sum to zero, and their sum is {net:.6g}")
        elif self.method in ALL_IMAGES and not all(axes):
            along = " and ".join(axis for axis, there in zip("xyz", axes, strict=True) if there)
            instead = 'and the box is open; take method = "direct"' if not along else f"and this box is along {along}"
            raise InputError(
                f'{self.name}: method "{self.method}" needs a box that is periodic along three axes, or along x and y, '
                f"{instead}"
            )

    def host(self, system: Any) -> PairForce | None:
        """The pair force that takes the near part into its sum, if there is one."""
        if self.method == DIRECT:
            return None
        return next((force for force in system.forces if isinstance(force, PairForce)), None)

    def half_height(self, system: Subject) -> float:
        """See Grouped: the cutoff of the near part."""
        return 0.0 if self.method == DIRECT else self.split(system).cutoff

    def fixes_box(self, system: Subject) -> str:
        """See Grouped: charges follow the box."""
        return ""

    def sources(self, system: Subject) -> str:
        """What this force uses for a System, as references apart by semicolons."""
        if self.method not in ALL_IMAGES:
            return SOURCES[self.method]
        used = [SOURCES[EWALD], *([SOURCES[PME]] if self.split(system).mesh else []), ESTIMATE]
        return "; ".join([*used, *([SLAB] if slab.is_slab(system.box) else [])])

    def stated_error(self) -> float:
        """See Grouped."""
        return self.accuracy if self.method in ALL_IMAGES else 0.0

    def scaled_charges(self, system: Subject) -> Floats:
        """Charges (n,) times the root of Coulomb's constant over the permittivity."""
        assert system.charges is not None
        assert system.units.coulomb is not None
        return np.asarray(system.charges * math.sqrt(system.units.coulomb / self.dielectric))

    def charged(self, system: Subject) -> Charged:
        """Numbers on which Ewald's errors depend. The volume of a slab is that of its whole box."""
        volume = float(np.linalg.det(system.box.matrix)) if slab.is_slab(system.box) else system.volume
        fractions = system.state.positions @ np.linalg.inv(system.box.matrix)  # of a slab along z, too
        return Charged.of(self.scaled_charges(system), volume, fractions)

    def space(self, system: Subject) -> Box:
        """The box of Ewald's sum: that of the System, and for a slab with vacuum along z."""
        vacuum = self.method in ALL_IMAGES and slab.is_slab(system.box)
        return slab.space_of(system.box, self.accuracy) if vacuum else system.box

    def split(self, system: Subject) -> Split:
        """Splitting parameter, cutoff and largest wave number for this System; methods other than Ewald's sum have no
        waves."""
        host = self.host(system)
        given = None if host is None else host.cutoff
        if self.method not in ALL_IMAGES:
            if (cutoff := self.cutoff or given) is None:
                raise InputError(f'{self.name}: cutoff is needed by method "{self.method}"')
            return Split(self.alpha or 0.0, cutoff, 0.0)
        charged = self.charged(system)
        least = float(system.box.heights.min())
        if charged.squares == 0:
            mesh = 3 * (SMALLEST,) if self.method == PME else ()
            return Split(1.0 / least, self.cutoff or 0.25 * least, 0.0, mesh, ORDERS[0])
        longest = LONGEST * least
        shortest = given or min(longest, (charged.volume / charged.charges) ** (1.0 / 3.0))
        found = None
        if self.method != EWALD:
            matrix = tuple(map(tuple, self.space(system).matrix.tolist()))
            values = (self.cutoff, self.alpha, self.mesh, self.order)
            found = cheapest_mesh(charged, matrix, self.accuracy, shortest, longest, *values)
        if self.method == PME:
            if found is None:
                raise InputError(
                    f"{self.name}: no mesh gives accuracy {self.accuracy:g} here with the values that are given; ask "
                    f'for less, or take method = "{EWALD}"'
                )
            return found[1]
        if self.cutoff is not None:
            return split_at(charged, self.accuracy, self.cutoff, self.alpha, self.waves)
        waves = cheapest(charged, self.accuracy, shortest, longest, self.alpha, self.waves)
        return waves if found is None or cost(charged, waves) <= found[0] else found[1]

    def held(self, system: Subject) -> Coulomb:
        """The same force with what it chooses for a System as given values, so that it chooses the same elsewhere."""
        if self.method not in ALL_IMAGES:
            return self
        split = self.split(system)
        if not (split.waves or split.mesh):
            return self
        values: dict[str, Any] = {"cutoff": split.cutoff, "alpha": split.alpha}
        if split.mesh:
            return replace(self, method=PME, **(values | {"mesh": split.mesh, "order": split.order}))
        return replace(self, method=EWALD, waves=split.waves, **values)

    def radial(self, split: Split) -> Radial:
        """The near part at this Split."""
        if self.method in ALL_IMAGES:
            return ewald_near(split.alpha, split.cutoff, self.accuracy)
        if self.method == REACTION_FIELD:
            return reaction_field(split.cutoff, self.surroundings)
        return damped_shifted(split.alpha, split.cutoff)

    def net_charge(self, system: Subject) -> float:
        """Sum of the charges; 0 if it is no more than rounding."""
        assert system.charges is not None
        net = math.fsum(system.charges)
        return net if abs(net) > NEUTRAL * float(np.abs(system.charges).max(initial=0.0)) else 0.0

    def background(self, system: Subject) -> float:
        """Energy times volume of the uniform background that neutralises a net charge in Ewald's sum."""
        net = float(self.scaled_charges(system).sum()) if self.net_charge(system) else 0.0
        return -0.5 * math.pi * (net / self.split(system).alpha) ** 2

    @property
    def has_pairs(self) -> bool:
        """See ListedForce: a sum over all pairs has no list."""
        return self.method != DIRECT

    def bind(self, system: Subject, threads: int = 1, mixed: bool = False) -> Any:
        """Bind this force to a System. Its near part is that of the pair force, if there is one; see `host`. With
        ``mixed`` its pairs are in float32."""
        from kickdrift.forces.charges.binding import bind

        self._check_precision(system, mixed)
        return bind(self, system, threads, mixed)

    def bind_host(self, host: PairForce, system: Subject, threads: int, mixed: bool) -> Any:
        """Bind a pair force with the near part of this force."""
        from kickdrift.forces.charges.binding import bind_near

        self._check_precision(system, mixed)
        return bind_near(self, host, system, threads, mixed)

    def _check_precision(self, system: Subject, mixed: bool) -> None:
        """Refuse an accuracy that pairs in float32 do not give."""
        least = SINGLE * len(system) ** (1.0 / 3.0)
        if mixed and self.method in ALL_IMAGES and self.accuracy < least:
            raise InputError(
                f"{self.name}: accuracy {self.accuracy:g} is more than pairs in float32 give to {len(system):,} "
                f'particles, {least:.1e}; take precision "double"'
            )


def coulomb_of(system: Any) -> Coulomb | None:
    """The force between the charges of a System, or None."""
    return next((force for force in getattr(system, "forces", ()) if isinstance(force, Coulomb)), None)
