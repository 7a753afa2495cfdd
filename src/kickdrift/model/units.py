"""Unit systems. Numbers inside kickdrift are in the system's own units; conversion happens only where text comes in.

Constants are CODATA's (`kickdrift.model.constants`). The gravitational constant of ``astro`` comes from the GM of the
Sun that JPL's ephemeris DE421 was integrated with, since that product is known to twelve digits and G alone to five.
"""

from __future__ import annotations

import difflib
import math
import re
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from kickdrift.errors import InputError
from kickdrift.model import constants
from kickdrift.text import VALUE
from kickdrift.text import shown as shown

GM_SUN = 1.32712440040944e20  # m^3/s^2, DE421 (Folkner, Williams & Boggs 2009, IPN Progress Report 42-178)
AU = constants.AU  # m, exact since IAU 2012; DE421's own is 0.37 m shorter, 7.5e-12 of G
YEAR = 365.25 * constants.DAY  # s, the Julian year
MSUN = GM_SUN / constants.GRAVITY  # kg; no better known than CODATA's G, and needed only where kilograms come in

# Each dimension as a product of powers of length L, time T, mass M, energy E, temperature K and
# angle A.
DIMENSIONS: dict[str, dict[str, int]] = {
    "dimensionless": {},
    "length": {"L": 1},
    "time": {"T": 1},
    "mass": {"M": 1},
    "energy": {"E": 1},
    "temperature": {"K": 1},
    "velocity": {"L": 1, "T": -1},
    "acceleration": {"L": 1, "T": -2},
    "force": {"E": 1, "L": -1},
    "pressure": {"E": 1, "L": -3},
    "density": {"M": 1, "L": -3},
    "number density": {"L": -3},
    "frequency": {"T": -1},
    "rate": {"T": -1},
    "stiffness": {"E": 1, "L": -2},
    "momentum": {"M": 1, "L": 1, "T": -1},
    "angular momentum": {"M": 1, "L": 2, "T": -1},
    "gravitational constant": {"L": 3, "M": -1, "T": -2},
    "gravitational parameter": {"L": 3, "T": -2},
    "angle": {"A": 1},
}

_EXAMPLES = {
    "length": "3.4 angstrom",
    "time": "10 fs",
    "mass": "39.948 u",
    "energy": "0.0103 eV",
    "temperature": "94.4 K",
    "velocity": "300 m/s",
    "density": "1.374 g/cm3",
    "number density": "21 nm^-3",
    "pressure": "1 bar",
    "frequency": "2 THz",
    "rate": "0.1 ps^-1",
    "gravitational parameter": "398600.4 km^3/s^2",
    "angle": "1.3 deg",
}

_COMMON = (
    "angstrom nm pm um mm cm m km AU pc fs ps ns us ms s min hour day yr u amu Da g kg Msun "
    "eV meV keV J kJ cal kcal mol K mK bar atm Pa GPa hartree rydberg"
)

LONGEST = 200  # characters of a quantity

# A number and its unit. Possessive quantifiers (++) never try a text twice, so that no text takes long to refuse.
_QUANTITY = re.compile(r"([+-]?(?:\d++(?:\.\d*+)?|\.\d++)(?:[eE][+-]?\d++)?)\s*+(.*+)")
# What is handed to pint's evaluator: names with small powers, products, quotients and brackets, and nothing else.
_UNIT_TEXT = re.compile(r"(?:1(?=\s*/)|[(*/·\s]|(?:°?[^\W\d]++|\))(?:(?:\^|\*\*)?[+-]?\d{1,2}(?!\d))?)*+")


@dataclass(frozen=True)
class UnitSystem:
    """Names of the units, Boltzmann's constant, G and the speed of light in them (None where they are plain numbers).

    ``coherent_mass`` is the one factor that makes force = mass x acceleration true: in ``metal`` (angstrom, ps, eV, u)
    a mass in u times it is in eV ps^2 / angstrom^2; elsewhere it is 1.
    """

    name: str
    length: str
    time: str
    mass: str
    energy: str
    temperature: str
    boltzmann: float
    gravity: float | None = None
    light: float | None = None
    coherent_mass: float = 1.0

    @property
    def reduced(self) -> bool:
        """Whether quantities are plain numbers that no text with units can be converted to."""
        return self.name in ("lj", "nbody")

    def unit(self, dimension: str) -> str:
        """The unit of that dimension, as text that a person and pint can read: ``angstrom/ps``, ``eV/angstrom^3``."""
        names = {"L": self.length, "T": self.time, "M": self.mass, "E": self.energy, "K": self.temperature, "A": "deg"}
        over: list[str] = []
        under: list[str] = []
        powers = _powers(dimension)
        for symbol, power in powers.items():
            name = f"({names[symbol]})" if len(powers) > 1 and re.search(r"[ /]", names[symbol]) else names[symbol]
            (over if power > 0 else under).append(name if abs(power) == 1 else f"{name}^{abs(power)}")
        top = " ".join(over) or ("1" if under else "")
        return top if not under else f"{top}/{under[0]}" if len(under) == 1 else f"{top}/({' '.join(under)})"


UNIT_SYSTEMS: dict[str, UnitSystem] = {
    "lj": UnitSystem("lj", "sigma", "tau", "m", "epsilon", "epsilon/k_B", 1.0),
    "metal": UnitSystem(
        "metal",
        "angstrom",
        "ps",
        "u",
        "eV",
        "K",
        boltzmann=constants.BOLTZMANN / constants.ELEMENTARY_CHARGE,
        light=constants.LIGHT * 1e-12 / 1e-10,
        coherent_mass=constants.ATOMIC_MASS * (1e-10 / 1e-12) ** 2 / constants.ELEMENTARY_CHARGE,
    ),
    "si": UnitSystem(
        "si", "m", "s", "kg", "J", "K", boltzmann=constants.BOLTZMANN, gravity=constants.GRAVITY, light=constants.LIGHT
    ),
    "astro": UnitSystem(
        "astro",
        "AU",
        "yr",
        "Msun",
        "Msun AU^2/yr^2",
        "K",
        boltzmann=constants.BOLTZMANN * YEAR**2 / (MSUN * AU**2),
        gravity=GM_SUN * YEAR**2 / AU**3,
        light=constants.LIGHT * YEAR / AU,
    ),
    "nbody": UnitSystem("nbody", "length", "time", "mass", "energy", "energy/k_B", 1.0, gravity=1.0),
}


def unit_system(name: str) -> UnitSystem:
    """The unit system of that name; an unknown one is an InputError that lists the names."""
    try:
        return UNIT_SYSTEMS[name]
    except (KeyError, TypeError):
        raise InputError(
            f"units: expected one of {', '.join(UNIT_SYSTEMS)}, got {shown(name)}{suggestion(name, UNIT_SYSTEMS)}"
        ) from None


def suggestion(word: object, known: Any) -> str:
    """``; did you mean 'x'?`` where a known word is near, else nothing."""
    if len(str(word)) > VALUE:
        return ""
    near = difflib.get_close_matches(str(word).lower(), {str(k).lower(): k for k in known}, n=1, cutoff=0.6)
    return f"; did you mean {next(str(k) for k in known if str(k).lower() == near[0])!r}?" if near else ""


def quantity(value: Any, dimension: str, units: UnitSystem, key: str = "") -> float:
    """A number in ``units``, from a number (already in them) or from text that carries its unit.

    Parameters
    ----------
    value : number or text such as ``"3.4 angstrom"``, ``"1.374 g/cm3"``, ``"10 fs"``, ``"0.24 kcal/mol"``
        An energy may be given as a temperature, which Boltzmann's constant multiplies: ``"120 K"``. An amount per mole
        is divided by Avogadro's number.
    dimension : one of ``DIMENSIONS``
    key : what the value is called in the file; begins the message of an error

    Raises
    ------
    InputError
        For a value that is not finite, has no unit, an unknown one or one of another dimension, and for any text in the
        reduced systems (lj, nbody).
    """
    prefix = f"{key}: " if key else ""
    powers = _powers(dimension)
    article = "an" if dimension[0] in "aeiou" else "a"
    expected = f"expected {article} {dimension}" if powers else "expected a plain number"
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise InputError(f"{prefix}{expected}{_example(dimension, units)}, got {shown(value)}")
    if not isinstance(value, str):
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            raise InputError(f"{prefix}expected a finite number, got {shown(value)}")
        return number
    if not powers:
        raise InputError(f"{prefix}{expected}, got {shown(value)}")
    if units.reduced and dimension != "angle":
        raise InputError(f"{prefix}{units.name} quantities are plain numbers, got {shown(value)}")
    match = _QUANTITY.fullmatch(value.strip()) if len(value) <= LONGEST else None
    if match is None:
        raise InputError(f"{prefix}{expected}{_example(dimension, units)}, got {shown(value)}")
    number, unit = float(match[1]), match[2]
    if not unit:
        raise InputError(f"{prefix}missing unit in {shown(value)}; {expected}{_example(dimension, units)}")
    result = _convert(
        number, unit, dimension, units, f"{prefix}{expected}{_example(dimension, units)}, got {shown(value)}", prefix
    )
    if not math.isfinite(result):
        raise InputError(f"{prefix}{shown(value)} is out of range")
    return result


def number_density(value: Any, units: UnitSystem, mass: float, key: str = "density") -> float:
    """Particles per volume, from a number (already that) or text: a number density, or a mass density over ``mass``."""
    if not isinstance(value, str) or units.reduced:
        return quantity(value, "number density", units, key)
    try:
        return quantity(value, "number density", units, key)
    except InputError:
        return quantity(value, "density", units, key) / mass


def unit_named(text: str, units: UnitSystem | None, key: str) -> str:
    """The unit that a text names: that of a dimension ("length") in ``units``, or the text, where it is a unit.

    "" is no unit. An InputError begins with ``key``."""
    dimension = text.replace("_", " ")
    if dimension in DIMENSIONS and units is not None:
        return units.unit(dimension)
    if text and not (units is not None and text in map(units.unit, DIMENSIONS)):
        _parsed(text, text, f"{key}: ")
    return text


def _powers(dimension: str) -> dict[str, int]:
    try:
        return DIMENSIONS[dimension.replace("_", " ")]
    except KeyError:
        raise ValueError(f"dimension {dimension!r} is not one of {', '.join(DIMENSIONS)}") from None


def _example(dimension: str, units: UnitSystem) -> str:
    name = dimension.replace("_", " ")
    if not DIMENSIONS[name]:
        return ""
    if units.reduced:
        return " as a plain number"
    return f' such as "{_EXAMPLES.get(name, "1 " + units.unit(name))}"'


@lru_cache(maxsize=1)
def _registry() -> Any:
    import pint  # half a second: paid only by files whose quantities carry units

    registry = pint.UnitRegistry(on_redefinition="ignore", cache_folder=None)
    registry.define(f"atomic_mass_constant = {constants.ATOMIC_MASS!r} kg = m_u")  # pint's CODATA may be another year's
    registry.define(f"solar_mass = {MSUN!r} kg = Msun")
    registry.define("@alias astronomical_unit = AU")
    return registry


def _parsed(unit: str, text: str, prefix: str) -> Any:
    """pint's unit of that name; an InputError names what is not known in the ``text``."""
    import pint

    registry = _registry()
    if not _UNIT_TEXT.fullmatch(unit):
        raise InputError(f"{prefix}cannot read the unit {shown(unit)}")
    spelled = re.sub(r"(?<=[^\W\d])([+-]?\d)", r"**\1", unit)  # cm3, s-1 -> cm**3, s**-1
    try:
        return registry.parse_units(spelled)
    except pint.UndefinedUnitError as error:
        names = error.unit_names
        name = names if isinstance(names, str) else next(iter(names))
        raise InputError(f"{prefix}unknown unit {name!r}{suggestion(name, _COMMON.split())} in {shown(text)}") from None
    except Exception:  # pint's parser raises whatever Python's tokenizer and evaluator raise
        raise InputError(f"{prefix}cannot read the unit {shown(unit)}") from None


def _convert(number: float, unit: str, dimension: str, units: UnitSystem, wrong: str, prefix: str) -> float:
    import pint

    registry, parsed = _registry(), _parsed(unit, f"{number:g} {unit}", prefix)
    given = registry.Quantity(number, parsed)
    try:
        if not _is_pure(registry, parsed, dimension):
            hint = "; a frequency counts cycles, not angles" if dimension == "frequency" else ""
            raise InputError(wrong + hint)
        if dimension == "energy" and given.dimensionality == {"[temperature]": 1}:
            return float(given.to("kelvin").magnitude) * units.boltzmann
        moles = given.dimensionality.get("[substance]", 0)
        if moles:
            if moles != _moles(dimension):
                raise InputError(wrong)
            given = given * registry.avogadro_constant**moles
        return float(given.to(units.unit(dimension)).magnitude)
    except pint.PintError:
        raise InputError(wrong) from None
    except (OverflowError, ZeroDivisionError, ArithmeticError):
        return math.inf


def _is_pure(registry: Any, unit: Any, dimension: str) -> bool:
    """Whether no unit hides in this one that pint takes for the number 1, such as percent, bit or rad; an angle must be
    radians (degrees, turns, …) and nothing else."""
    root = registry.get_root_units(unit)[1]
    if dimension == "angle":
        return len(unit._units) == 1 and bool(root == registry.Unit("radian"))
    return not any(registry.Unit(part).dimensionless for part in (*unit._units, *root._units))


def _moles(dimension: str) -> int:
    """The power of an amount of substance that a quantity of this dimension may have: energies and masses per mole, and
    moles per volume."""
    name = dimension.replace("_", " ")
    return 1 if name == "number density" else -1 if name == "mass" or "E" in DIMENSIONS[name] else 0
