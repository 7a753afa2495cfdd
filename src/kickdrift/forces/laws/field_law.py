"""Forces on single particles from one formula: ``@field_law`` turns a law of position, velocity, mass and time into a
force.

This module does not import numba, so reading and checking a system file stays fast; ``bind`` compiles.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.laws.law import Form, force_of_law, is_result, raised_at, traits_of
from kickdrift.forces.laws.parameters import LawForce, kinds_of
from kickdrift.forces.seam.arguments import check_massive
from kickdrift.model.state import Floats
from kickdrift.text import shown

if TYPE_CHECKING:
    from kickdrift.model.subject import Subject


MOST = 6  # particles that are tried
STEPS = tuple(10.0**-k for k in range(1, 8))  # of the system's extent, for the differences
SLOPE_TOLERANCE = 1e-4
TIMES = (0.1234, 1.732, 29.7)  # after the system's own
At = Callable[[Floats, Floats, float], tuple[Any, Floats]]  # energy and force at a place, velocity and time


def try_field(force: Any, values: dict[str, Any], system: Subject) -> None:
    """Refuse a field law that does not return what it should at the states of this system's particles, or near them."""
    state, extent = system.state, extent_of(system)
    wrong = []
    for i in sorted({round(k) for k in np.linspace(0, len(system) - 1, MOST)}):
        at = _law(force, values, system, i)
        x, v, t = state.positions[i].copy(), state.velocities[i].copy(), float(state.time)
        faster = v + np.array([0.7, -1.3, 0.4]) * (float(np.abs(v).max()) or 1.0)
        check_declared(force, "force depends", partial(_force, at, x), v, faster, t)
        if system.dimensions == 2 and at(x, v, t)[1][2] != 0:
            raise InputError(f"{force.name}: the law pushes particle {i} out of the plane of two dimensions")
        rng = np.random.Generator(np.random.PCG64(i))
        shaken = x + 0.1 * extent * rng.standard_normal(3) * (np.arange(3) < system.dimensions)
        for place in (x, shaken):
            found = wrong_slope(partial(_at_rest, at, t), place, extent, system.dimensions)
            if found and not _moves_energy(at, place, v, t):
                wrong.append((i, place, *found))
    if len(wrong) > 1:  # a law may jump, or have a kink, at one place
        i, place, pushed, slope = wrong[-1]
        raise InputError(
            f"{force.name}: law must return energy and force, minus the energy's slope; for particle {i} at "
            f"{_text(place)} it returns {_text(pushed)}, and its energy's slope gives {_text(slope)}"
        )


def _force(at: At, x: Floats, v: Floats, t: float) -> Floats:
    return at(x, v, t)[1]


def _at_rest(at: At, t: float, x: Floats) -> tuple[Any, Floats]:
    return at(x, 0.0 * x, t)


def extent_of(system: Subject) -> float:
    """A length of this system: how far its particles are spread, else how far they are from the origin, else 1."""
    x = system.state.positions
    return float(np.ptp(x, axis=0).max()) or float(np.abs(x).max()) or 1.0


def wrong_slope(at: Callable[[Floats], tuple[Any, Floats]], x: Floats, extent: float, dimensions: int) -> Any:
    """Return the force and minus the slope of the energy at x, if the two differ; else None.

    The slope comes from central differences of order 4 over ever shorter steps. Two steps in turn must agree, so a
    law with a fine structure is not refused for steps that are too long."""
    before: Floats | None = None
    try:
        with np.errstate(all="ignore"):
            energy, force = at(x)
            if energy is None:
                return None
            for h in (step * extent for step in STEPS):
                slope = np.array([_slope(at, x, axis, h) if axis < dimensions else 0.0 for axis in range(3)])
                size = float(max(np.abs(force).max(), np.abs(slope).max(), 1e-8 * abs(energy) / h))
                if not np.isfinite([*slope, *force, size]).all():
                    continue
                if np.abs(force + slope).max() <= SLOPE_TOLERANCE * size:
                    return None
                if before is not None and np.abs(before - slope).max() <= 0.1 * SLOPE_TOLERANCE * size:
                    return force, -slope
                before = slope
    except Exception:  # a law need not hold near the particles; their own states are checked
        return None
    return None


def _slope(at: Callable[[Floats], tuple[Any, Floats]], x: Floats, axis: int, h: float) -> float:
    way = np.zeros(3)
    way[axis] = h
    near, far = ([float(at(x + sign * k * way)[0]) for sign in (-1, 1)] for k in (1, 2))
    return (8 * (near[1] - near[0]) - (far[1] - far[0])) / (12 * h)


def _law(force: Any, values: dict[str, Any], system: Subject, i: int) -> At:
    """The law of particle i in plain Python, with its values checked."""
    p = force.Parameters(**{key: _one(value, i) for key, value in values.items()})
    mass, place = float(system.coherent_masses[i]), f"law(p, x, v, m, t) for particle {i}"

    def at(x: Floats, v: Floats, t: float) -> tuple[Any, Floats]:
        try:
            with np.errstate(all="ignore"):
                found = p.law(x.copy(), v.copy(), mass, p.clock(t) if hasattr(p, "clock") else t)
        except Exception as error:  # whatever a user's function raises
            text = " ".join(f"{type(error).__name__}: {error}".split())
            raise InputError(f"{force.name}: {place} raised {text}{raised_at(error.__traceback__)}") from None
        energy, push = _values(force, found, place)
        if (energy is not None and not np.isfinite(energy)) or not np.isfinite(push).all():
            raise InputError(f"{force.name}: {place} must return finite numbers; it returned {shown(found)}")
        return energy, push

    return at


def _one(value: Any, i: int) -> Any:
    if isinstance(value, np.ndarray):
        return value[i].copy() if value.ndim > 1 else float(value[i])
    return np.array(value) if isinstance(value, tuple) else float(value)


def _values(force: Any, found: Any, place: str) -> tuple[Any, Floats]:
    wanted = f"{force.name}: {place} must return two values, energy and force"
    if not isinstance(found, tuple | list) or len(found) != 2:
        raise InputError(f"{wanted}; it returned {shown(found)}")
    energy, push = found
    if energy is None and not force.works:
        raise InputError(f"{wanted}; a law without an energy says works = True in its class")
    if energy is not None and not is_result(energy):
        raise InputError(f"{wanted}; the energy it returned is {shown(energy)}")
    numbers = list(push) if isinstance(push, tuple | list | np.ndarray) else []
    if len(numbers) != 3 or not all(map(is_result, numbers)):
        raise InputError(f"{wanted} of three components; the force it returned is {shown(push)}")
    return energy if energy is None else float(energy), np.array(numbers, dtype=float)


def check_declared(
    force: Any, what: str, push: Callable[[Floats, float], Floats], v: Floats, faster: Floats, t: float
) -> None:
    """Refuse a law whose ``push(v, t)`` depends on velocity or time, and which does not say so."""
    before = push(v, t)
    states = [("velocity", "velocity_dependent", faster, t)]
    states += [("time", "time_dependent", v, t + later) for later in TIMES]
    for name, trait, other_v, other_t in states:
        if getattr(force, trait):
            continue
        try:
            after = push(other_v, other_t)
        except InputError:
            continue
        if not np.array_equal(after, before):
            raise InputError(
                f"{force.name}: the law's {what} on {name}; say {trait} = True in its class, so that methods that need "
                "another kind of force refuse it"
            )


def _moves_energy(at: At, x: Floats, v: Floats, t: float) -> bool:
    """Tell whether the energy depends on velocity; its slope along x alone is then not the force."""
    faster = v + 1.0
    try:
        return bool(at(x, faster, t)[0] != at(x, 0.0 * v, t)[0])
    except InputError:
        return False


def _text(values: Floats) -> str:
    return f"({', '.join(f'{value:.6g}' for value in values)})"


FIELD_LAW = Form(
    "field_law", ("p", "x", "v", "m", "t"), "a particle's energy and force must depend on p, x, v, m and t alone"
)


@dataclass(frozen=True, kw_only=True)
class FieldForce(LawForce):
    """Base class of the forces that ``field_law`` makes: they act on every particle by itself."""

    external: ClassVar[bool] = True  # changes the total momentum
    may_overlap: ClassVar[bool] = True  # allows particles to begin at the same place
    alike: ClassVar[bool] = False  # accelerates all particles alike, so that their relative motion stays
    nearest: ClassVar[str] = ""  # the parameter to whose nearest image in a periodic box the law's position goes
    per_mass: ClassVar[bool] = False
    reflects: ClassVar[bool] = False  # mirrors particles, in place of a force

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
    quotients with numbers. Numbers have ``+ - * / **``, ``math.sqrt``, ``exp``, ``log``, ``sin`` and
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
    ``nearest`` : name
        A parameter with a place, such as a centre. In a periodic box the law gets x as the image nearest to this place.
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

    In a periodic box x is the unwrapped position, unless the class says ``nearest``. A law must not keep state between
    calls. The force is registered under the class's name in lower case, with hyphens, as ``pair_law`` does.

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
    traits = traits_of(cls, ("per_mass", "alike", "nearest", "reflects"))
    return force_of_law(cls, FieldForce, FIELD_LAW, hints, {}, kinds=kinds, **traits)
