"""Forces on all bodies at once from one function: ``@body_law``.

This module does not import numba, so reading and checking a system file stays fast; ``bind`` compiles.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.laws.central import around, check_around
from kickdrift.forces.laws.field_law import check_declared, extent_of, wrong_slope
from kickdrift.forces.laws.law import Form, force_of_law, raised_at, traits_of
from kickdrift.forces.laws.parameters import LawForce, hints_of, kinds_of
from kickdrift.model.checks.values import is_number
from kickdrift.model.state import Floats
from kickdrift.text import shown

if TYPE_CHECKING:
    from kickdrift.model.subject import Subject


MOST_TRIED, MOST_SLOPES = 100, 24  # bodies of a system whose law, or its slope, is tried: plain Python is slow
MOST_MOVED = 3  # bodies that are moved to and fro
PLACE = "law(p, x, v, m, t, a)"


def try_bodies(force: Any, p: Any, system: Subject) -> None:
    """Refuse a body law that does not return what it should at this system's state, or near it."""
    n = len(system)
    if n > MOST_TRIED:
        return
    phase, t = system.state.phase, float(system.state.time)
    x, v, masses = phase[0], phase[1], system.coherent_masses
    energy, a = _called(force, p, x, v, masses, t)
    if system.dimensions == 2 and a[2].any():
        raise InputError(f"{force.name}: the law pushes particle {_first(a[2])} out of the plane of two dimensions")
    rng = np.random.Generator(np.random.PCG64(1))
    faster = v + rng.standard_normal(v.shape) * (float(np.abs(v).max()) or 1.0)
    check_declared(force, "accelerations depend", lambda v, t: _called(force, p, x, v, masses, t)[1], v, faster, t)
    if n > MOST_SLOPES or energy is None or (force.velocity_dependent and _moves_energy(force, p, x, v, masses, t)):
        return
    _check_slope(force, p, system, t)


def _check_slope(force: Any, p: Any, system: Subject, t: float) -> None:
    x, masses = system.state.phase[0], system.coherent_masses
    still, extent, wrong = np.zeros_like(x), extent_of(system), []
    heavy = np.flatnonzero(masses > 0)
    for i in heavy[np.unique(np.linspace(0, len(heavy) - 1, MOST_MOVED).round().astype(int))] if len(heavy) else ():

        def at(y: Floats, i: int = int(i)) -> tuple[Any, Floats]:
            moved = x.copy()
            moved[:, i] = y
            energy, a = _called(force, p, moved, still, masses, t)
            return energy, masses[i] * a[:, i]

        found = wrong_slope(at, x[:, i].copy(), extent, system.dimensions)
        if found:
            wrong.append((int(i), *found))
    if wrong:
        i, push, slope = wrong[-1]
        text = [f"({', '.join(f'{value:.6g}' for value in each)})" for each in (push, slope)]
        raise InputError(
            f"{force.name}: mass times the law's acceleration must be minus the slope of its energy; for particle {i} "
            f"it is {text[0]}, and the energy's slope gives {text[1]}"
        )


def _called(force: Any, p: Any, x: Floats, v: Floats, masses: Floats, t: float) -> tuple[Any, Floats]:
    """Energy and accelerations (3, n) of the law in plain Python."""
    a = np.zeros_like(x)
    try:
        with np.errstate(all="ignore"):
            found = force.Parameters.law(p, x.copy(), v.copy(), masses.copy(), t, a)
    except Exception as error:  # whatever a user's function raises
        text = " ".join(f"{type(error).__name__}: {error}".split())
        raise InputError(f"{force.name}: {PLACE} raised {text}{raised_at(error.__traceback__)}") from None
    values = list(found) if isinstance(found, tuple) else [found]
    if found is None:
        if not force.works:
            raise InputError(
                f"{force.name}: {PLACE} must return the energy; a law without an energy says works = True in its class"
            )
        values = []
    elif len(values) > 3 or not values or not all(map(is_number, values)):
        raise InputError(
            f"{force.name}: {PLACE} must return the energy, or energy and virial, or energy, virial and pairs; "
            f"it returned {shown(found)}"
        )
    if not np.isfinite(a).all():
        raise InputError(f"{force.name}: {PLACE} gives particle {_first(~np.isfinite(a).all(axis=0))} no finite force")
    if not all(map(np.isfinite, values)):
        raise InputError(f"{force.name}: {PLACE} must return finite numbers; it returned {shown(found)}")
    return (float(values[0]) if values else None), a


def _first(wrong: Any) -> int:
    return int(np.flatnonzero(wrong)[0])


def _moves_energy(force: Any, p: Any, x: Floats, v: Floats, masses: Floats, t: float) -> bool:
    """Tell whether the energy depends on velocity; its slope along x alone is then not the force."""
    found = [_called(force, p, x, velocities, masses, t)[0] for velocities in (v + 1.0, np.zeros_like(v))]
    return bool(found[0] != found[1])


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

    def fixes_box(self, system: Subject) -> str:
        """See Grouped: a law of all bodies gets no box."""
        return "its law does not know the box"

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
