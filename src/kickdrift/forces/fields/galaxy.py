"""Potentials of galaxies: sums of closed forms around a centre, which may turn and change with time.

This module does not import numba, so reading and checking a system file stays fast; ``bind`` compiles.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.fields.shipped import Field
from kickdrift.forces.formulas.expression import formula_of, value_of
from kickdrift.forces.laws.central import gravitational_constant
from kickdrift.forces.seam.arguments import Vector, check_place_in_plane, number, vector
from kickdrift.model.bridged import bridge
from kickdrift.model.checks.arguments import checked_arguments
from kickdrift.model.units.quantities import quantity
from kickdrift.text import choices, shown, suggestion

if TYPE_CHECKING:
    from kickdrift.model.subject import Subject
    from kickdrift.model.units.unit_systems import UnitSystem

POSITIVE, NOT_NEGATIVE, ANY = "positive", "zero or more", ""
TURNS = {"angle": (ANY, 0.0), "omega": (ANY, 0.0)}


class Kind(NamedTuple):
    """A kind of potential: its parameters with what each must be and its default, and why its mass is infinite."""

    takes: Mapping[str, tuple[str, float | None]]
    infinite: str = ""


MASS, LENGTH = (POSITIVE, None), (POSITIVE, None)
KINDS: dict[str, Kind] = {
    "kepler": Kind({"mass": MASS}),
    "plummer": Kind({"mass": MASS, "b": LENGTH}),
    "isochrone": Kind({"mass": MASS, "b": LENGTH}),
    "hernquist": Kind({"mass": MASS, "a": LENGTH}),
    "nfw": Kind({"mass": MASS, "a": LENGTH}, "grows as log(r)"),
    "miyamoto-nagai": Kind({"mass": MASS, "a": (NOT_NEGATIVE, None), "b": LENGTH}),
    "power-law": Kind({"mass": MASS, "alpha": (NOT_NEGATIVE, None), "cutoff": LENGTH}),
    "logarithmic": Kind(
        {"speed": MASS, "core": (NOT_NEGATIVE, 0.0), "q": (POSITIVE, 1.0), "p": (POSITIVE, 1.0), **TURNS}, "grows as r"
    ),
    "bar": Kind({"mass": MASS, "a": LENGTH, "b": (NOT_NEGATIVE, None), "c": LENGTH, **TURNS}),
}
CODES = {kind: code for code, kind in enumerate(KINDS)}
COMMON = ("kind", "strength")
MILKY_WAY = "MWPotential2014"
PARTS = {"power-law": 0.05, "miyamoto-nagai": 0.6, "nfw": 0.35}  # of the centre's pull on the Sun's circle
# A strength is a program for a stack of numbers: a constant, the time, an operation on the last one or two or three.
OPERATIONS = (
    "number", "t", "neg", "Add", "Sub", "Mult", "Div", "Pow", "sqrt", "exp", "log", "sin", "cos", "tan", "sec", "csc",
    "cot", "sinh", "cosh", "tanh", "square", "cube", "recip", "abs", "step", "min", "max", "select",
)  # fmt: skip


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
        object.__setattr__(self, "potentials", tuple(_part(f"{self.name}: potentials[{k}]", each)
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
            total += part["mass"] * _strength(part, system.state.time)
        return total

    def check(self, system: Subject) -> None:
        """Refuse a periodic box, units without G, a centre out of a plane, and a strength without a value."""
        if system.box.periodic:
            raise InputError(f"{self.name}: needs open space, but the box is periodic; a galaxy has no images")
        gravitational_constant(self.name, self.G, system)
        check_place_in_plane(self.name, "centre", self.centre, system)
        for k, part in enumerate(self.potentials):
            if isinstance(part, dict) and not math.isfinite(_strength(part, system.state.time)):
                raise InputError(
                    f"{self.name}: potentials[{k}].strength: {shown(part['strength'])} has no finite value at "
                    f"t = {system.state.time:g}"
                )

    def bind(self, system: Subject, threads: int = 1) -> Any:
        """See Field."""
        from kickdrift.forces.fields.galaxy_kernel import bind

        parts = self.parts(system)
        gravity = gravitational_constant(self.name, self.G, system)
        programs = [_program(part["strength"]) if "strength" in part else [] for part in parts]
        return bind([_row(part, gravity) for part in parts], programs, self.centre, system)


def _part(where: str, given: Any) -> Any:
    """A checked part: a table of numbers, or the name MWPotential2014."""
    if isinstance(given, str):
        if given != MILKY_WAY:
            known = (MILKY_WAY, *KINDS)
            hint = suggestion(given, known)
            if given in KINDS:
                hint = f'; a kind needs its parameters: {{ kind = "{given}", {_keys(given)} }}'
            raise InputError(f"{where}: expected {MILKY_WAY!r} or a table, got {shown(given)}{hint}")
        return given
    if not isinstance(given, Mapping):
        raise InputError(f"{where}: expected a table with a kind, got {shown(given)}")
    kind = given.get("kind")
    if kind not in KINDS:
        raise InputError(f"{where}.kind: expected one of {choices(KINDS, kind)}, got {shown(kind)}")
    takes, found = KINDS[kind].takes, {"kind": kind}
    for key in given:
        if key not in takes and key not in COMMON:
            hint = suggestion(str(key), takes) or f"; {kind} has {', '.join(takes)} and strength"
            raise InputError(f"{where}: {kind} has no {shown(key)}{hint}")
    for key, (sign, default) in takes.items():
        if key not in given:
            if default is None:
                more = "; without a cutoff its mass is infinite" if key == "cutoff" else ""
                raise InputError(f"{where}.{key}: required key is missing for {kind}{more}")
            continue
        value = number(where, key, given[key])
        if (sign == POSITIVE and not value > 0) or (sign == NOT_NEGATIVE and value < 0):
            raise InputError(f"{where}.{key}: must be {sign}, got {shown(given[key])}")
        found[key] = value
    if kind == "power-law" and found["alpha"] >= 3:
        raise InputError(f"{where}.alpha: must be less than 3, where the mass at the centre is infinite")
    if "strength" in given:
        found["strength"] = given["strength"]
        try:
            _program(given["strength"])
        except InputError as error:
            raise InputError(f"{where}.strength: {error}") from None
    return found


def _keys(kind: str) -> str:
    return ", ".join(f"{key} = …" for key, (_, default) in KINDS[kind].takes.items() if default is None)


def milky_way() -> list[dict[str, Any]]:
    """Parts of MWPotential2014 in the units G = 1, ro = 1 and vo = 1 (Bovy 2015, table 1)."""
    from scipy.special import gammainc

    cutoff, a, b, halo = 1.9 / 8.0, 3.0 / 8.0, 0.28 / 8.0, 2.0
    inside = {
        "power-law": gammainc(0.6, cutoff**-2.0),
        "miyamoto-nagai": (1.0 + (a + b) ** 2) ** -1.5,
        "nfw": math.log1p(1.0 / halo) - 1.0 / (1.0 + halo),
    }
    shapes = {
        "power-law": {"alpha": 1.8, "cutoff": cutoff}, "miyamoto-nagai": {"a": a, "b": b}, "nfw": {"a": halo}
    }  # fmt: skip
    return [{"kind": kind, "mass": share / float(inside[kind]), **shapes[kind]} for kind, share in PARTS.items()]


def _row(part: Mapping[str, Any], gravity: float) -> list[float]:
    """Numbers of a part for the compiled code: kind, G M, four parameters, angle and its rate, two constants."""
    kind = part["kind"]
    scale = part["speed"] ** 2 if kind == "logarithmic" else gravity * part["mass"]
    shape = [part[key] for key in KINDS[kind].takes if key not in ("mass", "speed", "angle", "omega")]
    more = [0.0, 0.0]
    if kind == "power-law":
        more = [1.0 / math.gamma(1.5 - 0.5 * part["alpha"]), _constant(1.0 - 0.5 * part["alpha"])]
    turn = [math.radians(part.get("angle", 0.0)), part.get("omega", 0.0)]
    return [float(CODES[kind]), scale, *shape, *[0.0] * (4 - len(shape)), *turn, *more]


def _constant(a: float) -> float:
    """(Gamma(1 + a) - 1) / a, from its series near a = 0."""
    if abs(a) < 1e-4:
        euler = float(np.euler_gamma)
        return -euler + a * (0.5 * euler**2 + math.pi**2 / 12.0) - 0.9074790760808863 * a * a
    return (math.gamma(1.0 + a) - 1.0) / a


def _strength(part: Mapping[str, Any], time: float) -> float:
    """The strength of a part at a time; nan if it has no value."""
    if "strength" not in part:
        return 1.0
    formula = formula_of(part["strength"], "t")
    try:
        return float(value_of(formula.tree, {"t": float(time)}, formula.given))
    except (ArithmeticError, ValueError):
        return math.nan


def _program(text: Any) -> list[tuple[int, float]]:
    """A formula of t as operations on a stack, each with its number. Raises InputError."""
    import ast

    if not isinstance(text, str):
        raise InputError(f"expected a formula of the time t as text, got {shown(text)}")
    formula = formula_of(text, "t")
    if formula.parameters:
        raise InputError(f"the formula has the name {shown(formula.parameters[0])}; it may have t, the time, alone")
    made: list[tuple[int, float]] = []

    def add(node: ast.expr) -> None:
        if isinstance(node, ast.Constant):
            made.append((OPERATIONS.index("number"), float(node.value)))  # type: ignore[arg-type]
        elif isinstance(node, ast.Name):
            name = node.id[2:]
            if name == "t":
                made.append((OPERATIONS.index("t"), 0.0))
            else:
                add(formula.given[name])
        elif isinstance(node, ast.UnaryOp):
            add(node.operand)
            made.append((OPERATIONS.index("neg"), 0.0))
        elif isinstance(node, ast.BinOp):
            add(node.left)
            add(node.right)
            made.append((OPERATIONS.index(type(node.op).__name__), 0.0))
        else:
            assert isinstance(node, ast.Call)
            assert isinstance(node.func, ast.Name)
            for each in node.args:
                add(each)
            made.append((OPERATIONS.index(node.func.id[2:]), 0.0))

    add(formula.tree)
    return made
