"""Potentials of galaxies: sums of closed forms around a centre, which may turn and change with time.

This module does not import numba, so reading and checking a system file stays fast; ``bind`` compiles.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar

from kickdrift.errors import InputError
from kickdrift.forces.fields.galaxy_parts import KINDS, checked_part, milky_way, program_of, row_of, strength_at
from kickdrift.forces.fields.shipped import Field
from kickdrift.forces.laws.central import gravitational_constant
from kickdrift.forces.seam.arguments import Vector, check_place_in_plane, number, vector
from kickdrift.model.bridged import bridge
from kickdrift.model.checks.arguments import checked_arguments
from kickdrift.model.units.quantities import quantity
from kickdrift.text import shown

if TYPE_CHECKING:
    from kickdrift.model.subject import Subject
    from kickdrift.model.units.unit_systems import UnitSystem


@checked_arguments
@dataclass(frozen=True)
class Galaxy(Field):
    """Potential of a galaxy: a sum of parts around a centre. All bodies feel it, massless ones too.

    With r the distance from the centre and R the distance from the z axis, the parts have these energies per mass:

    - ``kepler``: -G mass / r.
    - ``plummer``: -G mass / sqrt(r^2 + b^2) (Plummer 1911, doi:10.1093/mnras/71.5.460).
    - ``isochrone``: -G mass / (b + sqrt(r^2 + b^2)) (Henon 1959, Annales d'Astrophysique 22, 126).
    - ``hernquist``: -G mass / (r + a) (Hernquist 1990, doi:10.1086/168845).
    - ``nfw``: -G mass ln(1 + r/a) / r, where mass is 4 pi rho a^3 (Navarro, Frenk & White 1996, doi:10.1086/177173).
    - ``miyamoto-nagai``: -G mass / sqrt(R^2 + (a + sqrt(z^2 + b^2))^2) (Miyamoto & Nagai 1975, PASJ 27, 533).
    - ``power-law``: density as r^-alpha exp(-(r/cutoff)^2), with the total mass; alpha is less than 3.
    - ``logarithmic``: speed^2 ln(x^2 + y^2/p^2 + z^2/q^2 + core^2) / 2 (Binney & Tremaine 2008, section 2.3.2).
    - ``bar``: a homogeneous needle from -a to a along x, softened by b and c (Long & Murali 1992, doi:10.1086/171764).

    Attributes
    ----------
    potentials : ({kind: …, parameter: …}, …)
        The parts, each a table with its ``kind`` and parameters; one table alone; or ``"MWPotential2014"``, the Milky
        Way of Bovy 2015 (doi:10.1088/0067-0049/216/2/29), alone or among the parts. ``bar`` and ``logarithmic`` take
        ``angle`` (degrees from x towards y at t = 0) and ``omega`` (radians per time), by which they turn around z.
        Every part takes ``strength``, a formula of the time ``t`` such as "1 + 0.1*sin(0.02*t)". It multiplies the
        part's energy. Formulas have the notation of ``formula-bond``.
    centre : (x, y, z)
        Default the origin.
    G : float, optional
        Default the unit system's own.
    ro, vo : float, optional
        Distance of the Sun from the centre and speed of the circular orbit there, for MWPotential2014. Default 8 kpc
        and 220 km/s, and 1 in N-body units.
    """

    potentials: Any
    centre: Vector = (0.0, 0.0, 0.0)
    G: float | None = None
    ro: float | None = None
    vo: float | None = None

    name: ClassVar[str] = "galaxy"
    stands_for: ClassVar[str] = ""
    dimensions: ClassVar[dict[str, str]] = {
        "mass": "mass", "a": "length", "b": "length", "c": "length", "core": "length", "cutoff": "length",
        "speed": "velocity", "angle": "angle", "omega": "rate", "centre": "length", "ro": "length", "vo": "velocity",
        "G": "gravitational constant",
    }  # fmt: skip
    law_keys: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self) -> None:
        given = self.potentials
        given = [given] if isinstance(given, str | Mapping) else given
        if not isinstance(given, list | tuple) or not given:
            raise InputError(f"{self.name}: potentials: expected one or more tables of potentials, got {shown(given)}")
        object.__setattr__(self, "potentials", tuple(checked_part(f"{self.name}: potentials[{k}]", each)
                                                     for k, each in enumerate(given)))  # fmt: skip
        object.__setattr__(self, "centre", vector(self.name, "centre", self.centre))
        for key in ("G", "ro", "vo"):
            if (value := getattr(self, key)) is not None and not number(self.name, key, value) > 0:
                raise InputError(f"{self.name}: {key} must be positive, got {shown(value)}")

    def __str__(self) -> str:
        return f"Galaxy({', '.join(each if isinstance(each, str) else each['kind'] for each in self.potentials)})"

    @property
    def _tables(self) -> Iterator[dict[str, Any]]:
        return (each for each in self.potentials if not isinstance(each, str))

    @property
    def time_dependent(self) -> bool:
        """Whether a part turns or changes."""
        return any("strength" in each or each.get("omega", 0.0) != 0.0 for each in self._tables)

    @property
    def works(self) -> bool:
        """Whether the energy changes, because a part turns or changes."""
        return self.time_dependent

    def reversed(self) -> Galaxy:
        """The galaxy of the motion backwards in time."""

        def back(part: Any) -> Any:
            if isinstance(part, str):
                return part
            made = part | ({"omega": -part["omega"]} if "omega" in part else {})
            return made | ({"strength": re.sub(r"\bt\b", "(0-t)", part["strength"])} if "strength" in part else {})

        return replace(self, potentials=tuple(map(back, self.potentials)))

    def parts(self, system: Subject) -> list[dict[str, Any]]:
        """Tables of all parts in a System's units, with defaults, and those of MWPotential2014 one by one."""
        found: list[dict[str, Any]] = []
        for each in self.potentials:
            found += self._milky_way(system) if isinstance(each, str) else [each]
        return [{key: default for key, (_, default) in KINDS[part["kind"]].takes.items()} | part for part in found]

    def _milky_way(self, system: Subject) -> list[dict[str, Any]]:
        units, sun = system.units, {}
        for key, text in (("ro", "8 kpc"), ("vo", "220 km/s")):
            given = getattr(self, key)
            default = 1.0 if units.reduced else quantity(text, self.dimensions[key], units)
            sun[key] = default if given is None else float(given)
        mass = sun["ro"] * sun["vo"] ** 2 / gravitational_constant(self.name, self.G, system)
        return [
            each | {key: value * (mass if key == "mass" else sun["ro"])
                    for key, value in each.items() if key not in ("kind", "alpha")}
            for each in milky_way()
        ]  # fmt: skip

    @classmethod
    def from_galpy(
        cls, potential: Any, units: str | UnitSystem = "galactic", ro: float | None = None, vo: float | None = None
    ) -> Galaxy:
        """The force of a potential of galpy, or of a list or sum of them.

        Parameters
        ----------
        potential : one of galpy's Kepler, Plummer, Isochrone, Hernquist, NFW, MiyamotoNagai,
            PowerSphericalPotentialwCutoff, LogarithmicHalo and SoftenedNeedleBar potentials, or several
        units : unit system of the force
        ro, vo : kpc and km/s of galpy's natural units; default the potential's own

        Raises
        ------
        InputError
            For another class of galpy, by name.
        """
        made: Galaxy = bridge("galpy", "Galaxy.from_galpy").galaxy_of(potential, units, ro, vo)
        return made

    @classmethod
    def from_gala(cls, potential: Any, units: str | UnitSystem = "galactic") -> Galaxy:
        """The force of a potential of gala, or of a sum of them, around one origin.

        Parameters
        ----------
        potential : one of gala's Kepler, Plummer, Isochrone, Hernquist, spherical NFW, MiyamotoNagai, PowerLawCutoff,
            Logarithmic and LongMuraliBar potentials, or a CompositePotential
        units : unit system of the force; "nbody" for a potential in gala's dimensionless units

        Raises
        ------
        InputError
            For another class of gala, by name, and for potentials with rotations or several origins.
        """
        made: Galaxy = bridge("gala", "Galaxy.from_gala").galaxy_of(potential, units)
        return made

    def mass(self, system: Subject) -> float:
        """Total mass of all parts in a System's units. Raises an InputError for a part whose mass is infinite."""
        total = 0.0
        for part in self.parts(system):
            if why := KINDS[part["kind"]].infinite:
                raise InputError(f"{self.name}: {part['kind']} has an infinite mass, which {why}; give it no such part")
            total += part["mass"] * strength_at(part, system.state.time)
        return total

    def check(self, system: Subject) -> None:
        """Refuse a periodic box, units without G, a centre out of a plane, and a strength without a value."""
        if system.box.periodic:
            raise InputError(f"{self.name}: needs open space, but the box is periodic; a galaxy has no images")
        gravitational_constant(self.name, self.G, system)
        check_place_in_plane(self.name, "centre", self.centre, system)
        for k, part in enumerate(self.potentials):
            if isinstance(part, dict) and not math.isfinite(strength_at(part, system.state.time)):
                raise InputError(
                    f"{self.name}: potentials[{k}].strength: {shown(part['strength'])} has no finite value at "
                    f"t = {system.state.time:g}"
                )

    def bind(self, system: Subject, threads: int = 1) -> Any:
        """See Field."""
        from kickdrift.forces.fields.galaxy_kernel import bind

        parts = self.parts(system)
        gravity = gravitational_constant(self.name, self.G, system)
        programs = [program_of(part["strength"]) if "strength" in part else [] for part in parts]
        return bind([row_of(part, gravity) for part in parts], programs, self.centre, system)
