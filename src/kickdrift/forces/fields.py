"""Fields: what acts on particles one by one (trap, uniform and driven field, drag), and springs between named pairs.

This module knows no numba, so that a system file can be read and checked without paying for it; ``bind`` compiles.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from kickdrift.errors import InputError
from kickdrift.model.checks import number as real
from kickdrift.text import shown

if TYPE_CHECKING:
    from kickdrift.model.system import System

Vector = tuple[float, float, float]


class Field:
    """What the forces of this module share.

    Attributes
    ----------
    may_overlap : bool
        Particles may begin at the same place as far as this force is concerned.
    external : bool
        It does not conserve momentum.
    """

    may_overlap: ClassVar[bool] = True
    external: ClassVar[bool] = True
    name: ClassVar[str]

    def check(self, system: System) -> None:
        """Refuse a system that this force cannot run on."""

    def bind(self, system: System, threads: int = 1) -> Any:
        """The parts of this force for a System: a NamedTuple with a compiled body."""
        from kickdrift.forces.fields_kernel import bind

        return bind(self, system)


@dataclass(frozen=True)
class HarmonicTrap(Field):
    """U = k |x - c|^2 / 2 for each particle.

    Attributes
    ----------
    stiffness : float, or three of them
        Energy per length squared, zero or more; three numbers are those along x, y and z.
    centre : (x, y, z)
        Default the origin. A periodic box is refused: the trap is not periodic.
    """

    stiffness: float | Vector
    centre: Vector = (0.0, 0.0, 0.0)

    name: ClassVar[str] = "harmonic-trap"
    dimensions: ClassVar[dict[str, str]] = {"stiffness": "stiffness", "centre": "length"}

    def __post_init__(self) -> None:
        one = _is_number(self.stiffness)
        three = vector(self.name, "stiffness", (self.stiffness,) * 3 if one else self.stiffness)
        if min(three) < 0:
            raise InputError(f"{self.name}: stiffness must be zero or more, got {shown(self.stiffness)}")
        object.__setattr__(self, "stiffness", three[0] if one else three)
        object.__setattr__(self, "centre", vector(self.name, "centre", self.centre))

    def check(self, system: System) -> None:
        """Refuse a periodic box, and particles without mass, which the trap would move infinitely fast."""
        if system.box.periodic:
            raise InputError(f"{self.name}: a trap needs open space, and the box is periodic")
        _check_masses(self.name, system, range(len(system)))


@dataclass(frozen=True)
class UniformField(Field):
    """The same acceleration g for every particle, massless ones too: U = -m g . x.

    In a periodic box x is the unwrapped position, so that the energy is conserved while particles fall through; it has
    no meaning beyond one run, and the total momentum grows without end.

    Attributes
    ----------
    acceleration : (x, y, z)
    """

    acceleration: Vector

    name: ClassVar[str] = "uniform-field"
    dimensions: ClassVar[dict[str, str]] = {"acceleration": "acceleration"}

    def __post_init__(self) -> None:
        object.__setattr__(self, "acceleration", vector(self.name, "acceleration", self.acceleration))


@dataclass(frozen=True)
class DrivenField(Field):
    """The acceleration a cos(2 pi f t + phase) for every particle, with t the time of the run.

    The potential energy is that of the moment, U = -m a . x cos(2 pi f t + phase) with x unwrapped: the field does
    work, so the total energy is not conserved.

    Attributes
    ----------
    amplitude : (x, y, z)
        An acceleration.
    frequency : float
        In cycles per time, zero or more: the period is 1 / frequency.
    phase : float
        In radians.
    """

    amplitude: Vector
    frequency: float
    phase: float = 0.0

    name: ClassVar[str] = "driven-field"
    dimensions: ClassVar[dict[str, str]] = {"amplitude": "acceleration", "frequency": "frequency"}

    @property
    def works(self) -> bool:
        """Whether it drives anything: energy is not conserved then."""
        return any(self.amplitude)

    def __post_init__(self) -> None:
        object.__setattr__(self, "amplitude", vector(self.name, "amplitude", self.amplitude))
        for key in ("frequency", "phase"):
            object.__setattr__(self, key, number(self.name, key, getattr(self, key)))
        if self.frequency < 0:
            raise InputError(f"{self.name}: frequency must be zero or more, got {self.frequency}")


@dataclass(frozen=True)
class LinearDrag(Field):
    """The acceleration -rate v, whatever the mass (Stokes' drag with rate = friction / mass).

    It has no potential energy and the total energy falls; a method that takes forces for functions of positions alone
    cannot run it.

    Attributes
    ----------
    rate : float
        Per time, zero or more: a free particle slows down as exp(-rate t).
    """

    rate: float

    name: ClassVar[str] = "linear-drag"
    dimensions: ClassVar[dict[str, str]] = {"rate": "rate"}

    @property
    def velocity_dependent(self) -> bool:
        """Whether it is there at all: a splitting method refuses it then."""
        return self.rate != 0.0

    @property
    def works(self) -> bool:
        """Likewise: energy is not conserved then."""
        return self.rate != 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "rate", number(self.name, "rate", self.rate))
        if self.rate < 0:
            raise InputError(f"{self.name}: rate must be zero or more, got {self.rate}")


@dataclass(frozen=True)
class Springs(Field):
    """U = k (r - l)^2 / 2 for each named pair of particles, r their distance between nearest images.

    Attributes
    ----------
    pairs : ((i, j), …)
        Ids of particles, counted from 0; no pair twice, in either order.
    stiffness : float, or one for each pair
        Energy per length squared, positive.
    length : float, or one for each pair
        At rest, zero or more and under half the shortest edge of a periodic box, beyond which images would take turns;
        default 0. Where both ends come to the same place the force of a spring with a length has no direction: it is
        zero there, and a system that begins so is refused.
    """

    pairs: Sequence[tuple[int, int]]
    stiffness: float | Sequence[float]
    length: float | Sequence[float] = 0.0

    name: ClassVar[str] = "springs"
    external: ClassVar[bool] = False
    joins: ClassVar[bool] = True  # its bodies may not merge, nor leave alone
    dimensions: ClassVar[dict[str, str]] = {"stiffness": "stiffness", "length": "length"}

    def __post_init__(self) -> None:
        pairs = tuple(_pair(k, pair) for k, pair in enumerate(_items(self.name, "pairs", self.pairs)))
        if not pairs:
            raise InputError(f"{self.name}: expected one pair or more, got none")
        seen: set[tuple[int, int]] = set()
        for i, j in pairs:
            if i == j:
                raise InputError(f"{self.name}: pair {[i, j]} joins a particle to itself")
            if (min(i, j), max(i, j)) in seen:
                raise InputError(f"{self.name}: pair {[i, j]} is given twice")
            seen.add((min(i, j), max(i, j)))
        object.__setattr__(self, "pairs", pairs)
        for key, least in (("stiffness", "positive"), ("length", "zero or more")):
            given = getattr(self, key)
            one = _is_number(given)
            values = tuple(number(self.name, key, v) for v in ([given] if one else _items(self.name, key, given)))
            if not one and len(values) != len(pairs):
                raise InputError(f"{self.name}: {key}: expected one number or {len(pairs)}, got {len(values)}")
            for value in values:
                if value < 0 or (value == 0 and least == "positive"):
                    raise InputError(f"{self.name}: {key} must be {least}, got {value}")
            object.__setattr__(self, key, values[0] if one else values)

    def __str__(self) -> str:
        count = len(self.pairs)
        described = [f"1 pair {list(self.pairs[0])}" if count == 1 else f"{count} pairs"]
        for key in ("stiffness", "length"):
            values = np.unique(getattr(self, key))
            described.append(f"{key}={values[0]}" if len(values) == 1 else f"{key}={values[0]} to {values[-1]}")
        return f"Springs({', '.join(described)})"

    def check(self, system: System) -> None:
        """Refuse pairs of particles that are not there, have no mass or begin at the same place."""
        n, ids = len(system), np.array(self.pairs)
        for i, j in ids[(ids >= n).any(axis=1)]:
            raise InputError(
                f"{self.name}: pair {[int(i), int(j)]}: there is no particle {max(i, j)}; ids are 0 to {n - 1}"
            )
        _check_masses(self.name, system, ids.flat)
        lengths = np.broadcast_to(np.array(self.length), len(ids))
        if system.box.lengths is not None and lengths.max() >= 0.5 * min(system.box.lengths):
            raise InputError(
                f"{self.name}: length {lengths.max():.6g} is not under half the shortest box edge, "
                f"{0.5 * min(system.box.lengths):.6g}"
            )
        x = system.state.positions
        apart = system.box.minimum_image(x[ids[:, 0]] - x[ids[:, 1]])
        for k in np.flatnonzero((lengths > 0) & ~apart.any(axis=1)):
            raise InputError(
                f"{self.name}: particles {ids[k, 0]} and {ids[k, 1]} are at the same place, where their spring "
                f"of length {lengths[k]:.6g} has no direction"
            )


# --- what users give, checked ---


def _is_number(value: Any) -> bool:
    return np.ndim(value) == 0 if isinstance(value, np.ndarray) else not isinstance(value, Iterable)


def number(name: str, key: str, value: Any) -> float:
    """The value as a finite float; an InputError that names the force and the key."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    found = real(value)
    if not math.isfinite(found):
        raise InputError(f"{name}: {key}: expected a finite number, got {shown(value)}")
    return found


def _items(name: str, key: str, values: Any) -> list[Any]:
    if isinstance(values, str) or not isinstance(values, Iterable):
        raise InputError(f"{name}: {key}: expected a list, got {shown(values)}")
    return list(values)


def vector(name: str, key: str, values: Any) -> Vector:
    """Three finite floats, likewise."""
    given = [] if isinstance(values, str) or not isinstance(values, Iterable) else list(values)
    if len(given) != 3:
        raise InputError(f"{name}: {key}: expected three numbers, got {shown(values)}")
    x, y, z = (number(name, key, value) for value in given)
    return x, y, z


def _pair(number: int, values: Any) -> tuple[int, int]:
    given = [] if isinstance(values, str) or not isinstance(values, Iterable) else list(values)
    whole = all(isinstance(i, int | np.integer) and not isinstance(i, bool) and i >= 0 for i in given)
    if len(given) != 2 or not whole:
        raise InputError(f"springs: pairs[{number}]: expected the ids of two particles, got {shown(values)}")
    return int(given[0]), int(given[1])


def _check_masses(name: str, system: System, ids: Iterable[int]) -> None:
    for i in ids:
        if system.state.masses[i] == 0:
            raise InputError(f"{name}: particle {i} has no mass, and this force would move it infinitely fast")
