"""Forces on all bodies at once from one function: ``@body_law``.

This module does not import numba, so reading and checking a system file stays fast; ``bind`` compiles.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from kickdrift.forces.laws.around import around
from kickdrift.forces.laws.body_check import try_bodies
from kickdrift.forces.laws.central import check_around
from kickdrift.forces.laws.force import LawForce
from kickdrift.forces.laws.law import Form, force_of_law, traits_of
from kickdrift.forces.laws.parameters import hints_of, kinds_of

if TYPE_CHECKING:
    from kickdrift.model.subject import Subject

BODY_LAW = Form(
    "body_law", ("p", "x", "v", "m", "t", "a"), "accelerations and energy must depend on p, x, v, m and t alone"
)


@dataclass(frozen=True, kw_only=True)
class BodyForce(LawForce):
    """Base class of the forces that ``body_law`` makes: one function adds the accelerations of all bodies."""

    external: ClassVar[bool] = False

    def check(self, system: Subject) -> None:
        """Refuse a system that this force does not support, and a law that does not hold for its particles."""
        if self.Parameters.law is around and "central" in self.Parameters._fields:
            check_around(self.name, self.law, system)
        super().check(system)
        p = self.bound_law(system)
        if not type(self).__module__.startswith("kickdrift."):
            try_bodies(self, p, system)

    def bound_law(self, system: Subject) -> Any:
        """What the law gets as ``p`` for this system."""
        values = {key: _spread(value, self.kinds[key].over, len(system)) for key, value in self.values(system).items()}
        p = self.law._replace(**values)
        return p.bound(system) if hasattr(p, "bound") else p

    def bind(self, system: Subject, threads: int = 1) -> Any:
        """Bind this force to a System: a NamedTuple with a compiled body."""
        from kickdrift.forces.laws.body_kernel import bound_body

        return bound_body(self.Parameters, self.bound_law(system), system.coherent_masses)


def _spread(value: Any, over: int, n: int) -> Any:
    """A parameter that may vary as an array (n,), (3, n) or (n, n); another one as the number or three numbers."""
    if not over:
        return value
    if over == 2:
        return np.ascontiguousarray(np.broadcast_to(np.asarray(value, dtype=float), (n, n)))
    if isinstance(value, tuple):
        return np.repeat(np.array(value, dtype=float)[:, None], n, axis=1)
    found = np.asarray(value, dtype=float)
    return np.ascontiguousarray(found.T) if found.ndim == 2 else np.broadcast_to(found, (n,)).copy()


def body_law(cls: type) -> Any:
    """Make a force of a NamedTuple class whose ``law(p, x, v, m, t, a)`` acts on all bodies at once.

    ``law`` gets positions ``x`` and velocities ``v`` as arrays (3, n), masses ``m`` (n,) and the time ``t``. It adds
    the accelerations to the array ``a`` (3, n), and returns the potential energy. It may return energy and virial, the
    sum of r . F, for the pressure; energy, virial and the number of pairs; or None, if there is no energy. Each law
    adds to what other forces have put into ``a``.

    The class's fields are the law's parameters, annotated as ``float``, ``int`` or ``tuple[float, float, float]``.
    ``law`` is compiled by numba, so it may use loops, ``if``, NumPy and ``math``; it runs on one thread.

    The class may say what ``field_law`` describes (``dimensions``, ``velocity_dependent``, ``time_dependent``,
    ``works``, ``check``, ``check_system``, ``reversed``), and more:

    ``varies``, ``pairs`` : names
        Parameters with a value for each particle, which ``law`` gets as an array (n,), or (3, n) for vectors; and for
        each pair, as an array (n, n). The user gives one value, values for each, or a mapping by species.
    ``bound(p, system)``
        Returns the NamedTuple that ``law`` gets as ``p`` in place of the parameters, with numbers and arrays. Here
        ``p`` has the parameters, those of each particle as arrays.
    ``external`` : bool
        Whether the law changes the total momentum; default False.
    ``fastmath`` : bool
        Lets the compiler reorder sums and fuse products. A sample that asks for the energy may then change the last bit
        of the accelerations.

    The force is registered under the class's name in lower case, with hyphens, as ``pair_law`` does.

    Raises
    ------
    InputError
        If the class is no NamedTuple with such a law, if the code of the law shows that the law keeps state, or if the
        name belongs to a force that ships.
    """
    many = getattr(cls, "varies", ()), getattr(cls, "pairs", ())
    kinds = kinds_of(cls, BODY_LAW, lambda key: int(key in many[0]) or 2 * int(key in many[1]))
    hints = hints_of(cls, BODY_LAW) | {key: kind.hint for key, kind in kinds.items()}
    return force_of_law(cls, BodyForce, BODY_LAW, hints, {}, kinds=kinds, **traits_of(cls))
