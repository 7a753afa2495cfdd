"""Forces on single particles from one formula: ``@field_law`` turns a law of position, velocity, mass and time into a
force.

This module does not import numba, so reading and checking a system file stays fast; ``bind`` compiles.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from kickdrift.forces.laws.field_check import try_field
from kickdrift.forces.laws.force import LawForce
from kickdrift.forces.laws.law import Form, force_of_law, traits_of
from kickdrift.forces.laws.parameters import kinds_of
from kickdrift.forces.seam.arguments import check_massive

if TYPE_CHECKING:
    from kickdrift.model.subject import Subject

FIELD_LAW = Form(
    "field_law", ("p", "x", "v", "m", "t"), "a particle's energy and force must depend on p, x, v, m and t alone"
)


@dataclass(frozen=True, kw_only=True)
class FieldForce(LawForce):
    """Base class of the forces that ``field_law`` makes: they act on every particle by itself."""

    external: ClassVar[bool] = True  # changes the total momentum
    may_overlap: ClassVar[bool] = True  # allows particles to begin at the same place
    alike: ClassVar[bool] = False  # accelerates all particles alike, so that their relative motion stays
    per_mass: ClassVar[bool] = False

    def check(self, system: Subject) -> None:
        """Refuse a system that this force does not support, and a law that does not hold for its particles."""
        values = self.values(system)
        if not self.per_mass:
            check_massive(self.name, system, range(len(system)))
        super().check(system)
        if not type(self).__module__.startswith("kickdrift."):
            try_field(self, values, system)

    def bind(self, system: Subject, threads: int = 1) -> Any:
        """Bind this force to a System: a NamedTuple with a compiled body."""
        from kickdrift.forces.laws.field_kernel import bound_field

        return bound_field(self, self.values(system), system)


def field_law(cls: type) -> Any:
    """Make a force of a NamedTuple class whose ``law(p, x, v, m, t)`` returns energy and force of one particle.

    The class's fields are the law's parameters, annotated as ``float`` or ``tuple[float, float, float]``. The force
    takes for each of them one value, a list with a value for each particle, or a mapping with a value for each species.
    ``law`` gets the particle's own values as ``p``, its position ``x`` and velocity ``v``, its mass ``m`` and the time
    ``t``. It returns the potential energy, or None, and the force, a vector or three numbers.

    ``law`` is compiled for SIMD lanes. Vectors have ``+ -``, ``d @ e``, ``np.cross``, ``d[0]``, and products and
    quotients with numbers. Numbers have ``+ - * / **`` with a whole power, ``math.sqrt``, ``exp``, ``log``, ``sin`` and
    ``cos``, ``abs``, ``max``, ``min``, and ``np.where`` with a comparison in place of ``if``.

    The class may say more:

    ``dimensions``
        The kind of each parameter ("length", "energy", …) for system files with units.
    ``velocity_dependent``, ``time_dependent`` : bool
        Must be True for a law whose force depends on velocity or time.
    ``works`` : bool
        Whether the total energy is not conserved; must be True for a law that returns None for the energy. Default True
        for a law that depends on time.
    ``per_mass`` : bool
        The law returns energy and force per mass, so it moves massless particles too.
    ``alike`` : bool
        Whether all particles get the same acceleration. The motion of the centre of mass is then no heat.
    ``clock(p, t)``
        What ``law`` gets in place of ``t``, such as a cosine of the time; computed once for all particles.
    ``varies`` : names
        The parameters that may have a value for each particle or species; default all.
    ``check(p)``, ``check_system(p, system)``
        Raise ValueError for parameters, or for a system, that make no sense.
    ``reversed(p)``
        The parameters of the motion backwards in time; a law of velocity or time needs this for runs back in time.
    ``odd_in_time`` : names
        Parameters that change sign in the motion backwards in time, in place of ``reversed``; () if none does.

    In a periodic box x is the unwrapped position. A law must not keep state between calls. The force is registered
    under the class's name in lower case, with hyphens, as ``pair_law`` does.

    Raises
    ------
    InputError
        If the class is no NamedTuple with such a law, if the code of the law shows that the law keeps state, or if the
        name belongs to a force that ships.
    """
    varies = getattr(cls, "varies", None)
    kinds = kinds_of(cls, FIELD_LAW, lambda key: int(varies is None or key in varies))
    cls.kernel_sources = tuple(vars(cls)[key] for key in ("clock",) if key in vars(cls))  # type: ignore[attr-defined]
    hints = {key: kind.hint for key, kind in kinds.items()}
    return force_of_law(cls, FieldForce, FIELD_LAW, hints, {}, kinds=kinds, **traits_of(cls, ("per_mass", "alike")))
