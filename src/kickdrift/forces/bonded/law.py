"""Forces between listed particles from one formula: ``@bond_law``, ``@angle_law``, ``@dihedral_law`` and so on.

This module does not import numba, so reading and checking a system file stays fast; ``bind`` compiles.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.laws.law import Form, force_of_law, is_result, raised_at
from kickdrift.forces.seam.arguments import check_massive, number
from kickdrift.forces.seam.group import Grouped, brief
from kickdrift.model.molecules.relatives import LONGEST, MEASURED, measured
from kickdrift.model.state import Floats
from kickdrift.text import shown, suggestion

if TYPE_CHECKING:
    from kickdrift.model.subject import Subject


STEP = 1e-3  # for differences of order 4
SLOPE_TOLERANCE = 1e-6
JUMP = 1e-9  # of the largest energy between -180 and 180 degrees
PARTS = (0.45, 0.65, 0.83, 0.96, 1.07, 1.31)  # of a law's length, or of pi/2, where slope and energy are compared


def value_of(law: Any, at: float) -> tuple[float, float]:
    """Energy and slope of a law in plain Python; nan where the law raises an ArithmeticError or a ValueError.

    Raises InputError if the law raises anything else, or does not return two numbers."""
    name = type(law).__qualname__.split(".")[-2] if "." in type(law).__qualname__ else type(law).__name__
    try:
        found = getattr(law, "plain", law.law)(at)
    except (ArithmeticError, ValueError):  # such as a division by zero, which is nan or infinite in compiled code
        return math.nan, math.nan
    except Exception as error:
        text = " ".join(f"{type(error).__name__}: {error}".split())
        raise InputError(f"{name}: law at {at:.6g} raised {text}{raised_at(error.__traceback__)}") from None
    if not isinstance(found, tuple | list) or len(found) != 2 or not all(map(is_result, found)):
        raise InputError(
            f"{name}: law at {at:.6g} must return two numbers, energy and slope; it returned {shown(found)}"
        )
    return float(found[0]), float(found[1])


def check_bonded_slope(name: str, law: Any, kind: str) -> None:
    """Refuse a law whose slope is not that of its energy at two or more places where both are finite."""
    scales = [math.pi / 2]
    if kind == "bonds":
        lengths = [v for k, v in law._asdict().items() if getattr(law, "dimensions", {}).get(k) == "length" and v > 0]
        scales = lengths or [1.0]
    wrong = [found for scale in scales for part in PARTS if (found := _wrong(law, part * scale, STEP * scale))]
    if len(wrong) > 1:
        at, given, slope = wrong[-1]
        what = "r" if kind == "bonds" else "angle"
        raise InputError(
            f"{name}: law must return the energy and its slope dU/d({what}); at {what} = {at:.6g} it returns "
            f"{given:.6g}, and the slope of its energy is {slope:.6g}"
        )


def check_closed(name: str, law: Any) -> None:
    """Refuse a law of dihedrals whose energy at -180 degrees is not that at 180 degrees, the same place."""
    first, last = (value_of(law, end)[0] for end in (-math.pi, math.pi))
    largest = max(abs(value_of(law, part * math.pi)[0]) for part in (-1.0, *PARTS[:4], 1.0))
    if abs(last - first) > JUMP * largest:
        raise InputError(
            f"{name}: the energy must be the same at -180 and 180 degrees, which are one place; "
            f"it jumps from {first:.6g} to {last:.6g}"
        )


def _wrong(law: Any, at: float, h: float) -> tuple[float, float, float] | None:
    energy, given = value_of(law, at)
    near, far = ([value_of(law, at + k * h)[0] for k in (-j, j)] for j in (1, 2))
    slope = (8 * (near[1] - near[0]) - (far[1] - far[0])) / (12 * h)
    if not all(map(math.isfinite, (energy, given, slope))):
        return None
    scale = max(abs(given), abs(slope), abs(energy) / (1000 * h), 1e-300)
    return None if abs(given - slope) <= SLOPE_TOLERANCE * scale * 10 else (at, given, slope)


TURN = math.pi / 180.0  # angles in system files are in degrees, in laws in radians


@dataclasses.dataclass(frozen=True, kw_only=True)
class BondedForce(Grouped):
    """Parameters of every force on listed particles, besides those of its law.

    Attributes
    ----------
    types : {name: {parameter: value}}, optional
        The types of bonds (or angles and so on) on which the force acts, with the parameters that differ from the
        force's own. Default: all types, with the force's own parameters.
    """

    types: Mapping[str, Mapping[str, float]] | None = None

    Parameters: ClassVar[Any]  # the law's NamedTuple class
    law_keys: ClassVar[tuple[str, ...]]  # what a table of ``types`` may say of the law
    name: ClassVar[str]
    kind: ClassVar[str]  # a key of MEASURED
    limited: ClassVar[bool] = True
    dimensions: ClassVar[dict[str, str]]
    may_overlap: ClassVar[bool] = True
    on_sites: ClassVar[bool] = True
    external: ClassVar[bool] = False
    joins: ClassVar[bool] = True  # joined bodies may neither merge nor leave

    def __post_init__(self) -> None:
        for key in self.law_keys:
            object.__setattr__(self, key, self._checked(key, getattr(self, key), ""))
        if self.types is not None:
            if not isinstance(self.types, Mapping) or not self.types:
                raise InputError(f"{self.name}: types: expected a table of types, got {shown(self.types)}")
            for name, values in self.types.items():
                if not isinstance(values, Mapping):
                    raise InputError(f"{self.name}: types.{name}: expected a table, got {shown(values)}")
                for key, value in values.items():
                    if key not in self.law_keys:
                        hint = suggestion(key, self.law_keys)
                        raise InputError(f"{self.name}: types.{name}: unknown parameter {shown(key)}{hint}")
                    self._checked(key, value, f" of type {name}")
        for where, law in self._laws_given():
            if problem := getattr(law, "problem", ""):
                raise InputError(f"{self.name}{where}: {problem}")
            self._check_given(where, law)

    def _check_given(self, where: str, law: Any) -> None:
        """Refuse a law whose slope is not that of its energy, or that jumps at 180 degrees."""
        check_bonded_slope(f"{self.name}{where}", law, self.kind)
        if self.kind == "dihedrals":  # stiff impropers never come near 180 degrees
            check_closed(f"{self.name}{where}", law)

    def _checked(self, key: str, value: Any, where: str) -> float:
        found = number(self.name, key + where, value)
        if self.dimensions.get(key) == "length" and found < 0:
            raise InputError(f"{self.name}: {key}{where} must be a length, zero or more, got {shown(value)}")
        return found

    def __str__(self) -> str:
        return brief(self, "types")

    @property
    def stands_for(self) -> str:  # type: ignore[override]
        """What the force models: its law. Terms of dihedrals and impropers are the parts of a series."""
        return self.name if self.kind in ("bonds", "angles") else ""

    def acting_on(self, system: Subject) -> dict[Any, str] | None:
        """The listed items."""
        rows = self.items(system)[0].tolist()
        return {tuple(row): f"{self.kind[:-1]} {'-'.join(map(str, row))}" for row in rows}

    @property
    def law(self) -> Any:
        """The force's own parameters."""
        return self.Parameters(*(getattr(self, key) for key in self.Parameters._fields))

    def law_of(self, type: str) -> Any:
        """Parameters of the law for a type; None if the force does not act on this type."""
        if self.types is None:
            return self.law
        return self.law_with(f" of type {type}", self.types[type]) if type in self.types else None

    def law_with(self, where: str, values: Mapping[str, Any]) -> Any:
        """Parameters of the law with these values in place of the force's own; ``where`` says whose they are."""
        return self.law._replace(**values)

    def _laws_given(self) -> Iterator[tuple[str, Any]]:
        if self.types is None:
            yield "", self.law
        for name in self.types or ():
            yield f": type {name}", self.law_of(name)

    def items(self, system: Subject) -> tuple[np.ndarray, list[Any], np.ndarray]:
        """The listed particles (m, 2 to 4) on which the force acts, the laws of its types, and the law of each (m,)."""
        topology = system.topology
        every = (
            np.zeros((0, MEASURED[self.kind].particles), np.int64) if topology is None else getattr(topology, self.kind)
        )
        types = () if topology is None else topology.types(self.kind)
        names = list(dict.fromkeys(types))
        laws = [(name, law) for name in names if (law := self.law_of(name)) is not None]
        place = {name: k for k, (name, _) in enumerate(laws)}
        which = np.fromiter((place.get(name, -1) for name in types), np.int64, len(types))
        return every[which >= 0], [law for _, law in laws], which[which >= 0]

    def check(self, system: Subject) -> None:
        """Refuse a system without such a list, particles without mass, and places where the law has no value."""
        items, *_ = self.items(system)
        if not len(items):
            topology = system.topology
            if topology is None or not len(getattr(topology, self.kind)):
                raise InputError(f"{self.name}: the system lists no {self.kind}; [topology] lists them")
        for name in self.types or ():
            assert system.topology is not None
            known = dict.fromkeys(system.topology.types(self.kind))
            if name not in known:
                hint = suggestion(name, known)
                listed = ", ".join(known)
                raise InputError(
                    f"{self.name}: types: the system has no {self.kind} of type {name}{hint}; its types are {listed}"
                )
        check_massive(self.name, system, np.unique(items))
        if wrong := self.trouble(system, system.state.phase[0]):
            raise InputError(f"{self.name}: {wrong}")

    def trouble(self, system: Subject, x: Floats) -> str:
        """Description of the first listed item at positions x (3, n) at which the law has no value; "" if none."""
        items, laws, which = self.items(system)
        found = measured(system.box, x, items, self.kind)
        if self.kind == "bonds":
            named, height = system.box.narrowest
            long = np.flatnonzero(~(found < LONGEST * height))
            if long.size:
                k = int(long[0])
                return (
                    f"bond {k} of particles {_and(items[k])} is {found[k]:.6g} long; it must be under {LONGEST} of "
                    f"the {named}, {LONGEST * height:.6g}, so that its nearest image is certain"
                )
        for k, (value, law) in enumerate(zip(found.tolist(), which.tolist(), strict=True)):
            energy, slope = value_of(laws[law], value)
            if not (math.isfinite(energy) and math.isfinite(slope)):
                where = f"{value:.6g}" if self.kind == "bonds" else f"{value / TURN:.6g} degrees"
                word = "length" if self.kind == "bonds" else "angle"
                numbers = ", ".join(f"{key} = {number:g}" for key, number in laws[law]._asdict().items())
                at = getattr(laws[law], "said", numbers)
                return (
                    f"{self.kind[:-1]} {k} of particles {_and(items[k])} has the {word} {where}, where the law has no "
                    f"finite energy and slope ({at})"
                )
        return ""

    def fixes_box(self, system: Subject) -> str:
        """See Grouped: bonds, angles and dihedrals scale with the box."""
        return ""

    def bind(self, system: Subject, threads: int = 1) -> Any:
        """Bind this force to a System: a NamedTuple with a compiled body."""
        from kickdrift.forces.bonded.kernel import bind

        return bind(self, system)


def _and(particles: np.ndarray) -> str:
    *first, last = map(str, particles.tolist())
    return f"{', '.join(first)} and {last}"


def _form(kind: str) -> Form:
    arguments = MEASURED[kind].arguments
    alone = f"its energy and slope must depend on {' and '.join(arguments)} alone"
    return Form(f"{kind[:-1]}_law", arguments, alone)


def _force(cls: type, kind: str) -> Any:
    return force_of_law(cls, BondedForce, _form(kind), {}, {}, kind=kind)


def bond_law(cls: type) -> Any:
    """Make a force on bonds of a NamedTuple class whose ``law(p, r)`` returns the energy U and its slope dU/dr.

    The force acts on the bonds of the System's ``Topology``. The class's fields are the law's parameters; the force has
    them and those of ``BondedForce``. ``law`` gets the parameters p and the distance r, or an angle in radians for
    `angle_law` and `dihedral_law`. It may use functions of ``math``. Where a law has no value, it returns nan: a
    system that begins there is refused, and a run that comes there stops and names the bond. The force is registered
    under the class's name in lower case, with hyphens, as by `pair_law`.

    Raises
    ------
    InputError
        If the law's code keeps state, if the slope is not that of the energy, or if the name belongs to a force that
        ships.
    """
    return _force(cls, "bonds")


def angle_law(cls: type) -> Any:
    """Make a force on angles of a NamedTuple class whose ``law(p, angle)`` returns U and dU/d(angle).

    The angle is in radians, from 0 to pi, pi for three particles in a line. All else is as for `bond_law`.
    """
    return _force(cls, "angles")


def dihedral_law(cls: type) -> Any:
    """Make a force on dihedrals of a NamedTuple class whose ``law(p, angle)`` returns U and dU/d(angle).

    The angle is in radians, from -pi to pi: 0 for a planar chain whose ends are on the same side (cis), pi on opposite
    sides (trans); IUPAC's sign. All else is as for `bond_law`.
    """
    return _force(cls, "dihedrals")


def improper_law(cls: type) -> Any:
    """Make a force on impropers of a NamedTuple class whose ``law(p, angle)`` returns U and dU/d(angle).

    The angle is in radians, from -pi to pi, between the plane of the first three particles and the plane of the last
    three, as for `dihedral_law`: 0 or pi for four particles in a plane. All else is as for `bond_law`.
    """
    return _force(cls, "impropers")
