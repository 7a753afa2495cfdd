"""Quantities from text that names a unit, such as ``"3.4 angstrom"``, converted to a System's own units.

Numbers inside kickdrift are always in the System's own units. Only text is converted.
"""

import math
import re
from functools import lru_cache
from typing import Any

from kickdrift.errors import InputError
from kickdrift.model.checks.arguments import other_name
from kickdrift.model.units import constants
from kickdrift.model.units.unit_systems import DIMENSIONS, MSUN, PARSEC, powers
from kickdrift.model.units.unit_systems import UNIT_SYSTEMS as UNIT_SYSTEMS  # users import these names from here
from kickdrift.model.units.unit_systems import UnitSystem as UnitSystem
from kickdrift.model.units.unit_systems import unit_system as unit_system
from kickdrift.text import shown, suggestion

EXAMPLES = {
    "length": "3.4 angstrom",
    "inverse length": "2 angstrom^-1",
    "time": "10 fs",
    "mass": "39.948 u",
    "energy": "0.0103 eV",
    "temperature": "94.4 K",
    "velocity": "300 m/s",
    "density": "1.374 g/cm3",
    "number density": "21 nm^-3",
    "pressure": "1 bar",
    "compressibility": "4.5e-5 bar^-1",
    "frequency": "2 THz",
    "rate": "0.1 ps^-1",
    "gravitational parameter": "398600.4 km^3/s^2",
    "angle": "1.3 deg",
    "charge": "1 e",
}

# Units that a unit system has and people rarely think in, with their size in a familiar unit.
FAMILIAR = {
    "eV/angstrom^3": (constants.ELEMENTARY_CHARGE * 1e25, "bar"),
    "kcal/mol/angstrom^3": (4184.0 / constants.AVOGADRO * 1e25, "bar"),
    "kJ/mol/nm^3": (1000.0 / constants.AVOGADRO * 1e22, "bar"),
    "angstrom^2/ps": (1e-4, "cm^2/s"),
    "angstrom^2/fs": (1e-1, "cm^2/s"),
    "nm^2/ps": (1e-2, "cm^2/s"),
    "m^2/s": (1e4, "cm^2/s"),
}

_COMMON = (
    "angstrom nm pm um mm cm m km AU pc fs ps ns us ms s min hour day yr u amu Da g kg Msun "
    "eV meV keV J kJ cal kcal mol K mK bar atm Pa GPa hartree rydberg"
)

LONGEST = 200  # characters of a quantity

# A number and its unit. Possessive quantifiers (++) never try a text twice, so every text is refused fast.
_QUANTITY = re.compile(r"([+-]?(?:\d++(?:\.\d*+)?|\.\d++)(?:[eE][+-]?\d++)?)\s*+(.*+)")
# Text that pint's evaluator may see: names with small powers, products, quotients and brackets only.
_UNIT_TEXT = re.compile(r"(?:1(?=\s*/)|[(*/·\s]|(?:°?[^\W\d]++|\))(?:(?:\^|\*\*)?[+-]?\d{1,2}(?!\d))?)*+")


def quantity(value: Any, dimension: str, units: UnitSystem, key: str = "") -> float:
    """Return a number in ``units``, from a number (already in them) or from text with a unit.

    Parameters
    ----------
    value : number or text such as ``"3.4 angstrom"``, ``"1.374 g/cm3"``, ``"10 fs"``, ``"0.24 kcal/mol"``
        An energy may be a temperature, ``"120 K"``: Boltzmann's constant multiplies it. Avogadro's number divides an
        amount per mole.
    dimension : one of ``DIMENSIONS``
    key : the value's name in the file; begins the message of an error

    Raises
    ------
    InputError
        For a value that is not finite, for a missing or unknown unit, for a unit of another dimension, and for any text
        in the reduced systems (lj, nbody).
    """
    prefix = f"{key}: " if key else ""
    has_dimension = bool(powers(dimension))
    article = "an" if dimension[0] in "aeiou" else "a"
    expected = f"expected {article} {dimension}" if has_dimension else "expected a plain number"
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
    if not has_dimension:
        raise InputError(f"{prefix}{expected}, got {shown(value)}")
    if units.reduced and dimension != "angle":
        raise InputError(f"{prefix}{units.name} quantities are plain numbers, got {shown(value)}")
    match = _QUANTITY.fullmatch(value.strip()) if len(value) <= LONGEST else None
    if match is None:
        raise InputError(f"{prefix}{expected}{_example(dimension, units)}, got {shown(value)}")
    number, unit = float(match[1]), re.sub("^/", "1/", match[2])  # "5/ps" is 5 times 1/ps
    if not unit:
        raise InputError(f"{prefix}missing unit in {shown(value)}; {expected}{_example(dimension, units)}")
    result = _convert(
        number, unit, dimension, units, f"{prefix}{expected}{_example(dimension, units)}, got {shown(value)}", prefix
    )
    if not math.isfinite(result):
        raise InputError(f"{prefix}{shown(value)} is out of range")
    return result


def has_unit(text: str) -> bool:
    """Whether a text is a number and what may be a unit."""
    match = _QUANTITY.fullmatch(text.strip()) if len(text) <= LONGEST else None
    return match is not None and bool(match[2])


def time_in(value: Any, units: UnitSystem | None, key: str, dimension: str = "time") -> Any:
    """Return a time in ``units`` from a text such as "5 ps"; other values as they are. A Problem has no units.

    The text may also be of another ``dimension``."""
    if not (isinstance(value, str) and has_unit(value)):
        return value
    if units is None:
        raise InputError(f"{key}: times of a Problem are plain numbers, got {shown(value)}")
    return quantity(value, dimension, units, key)


def number_density(value: Any, units: UnitSystem, mass: float, key: str = "density") -> float:
    """Return particles per volume, from a number, or from text: a number density, or a mass density over ``mass``."""
    if not isinstance(value, str) or units.reduced:
        return quantity(value, "number density", units, key)
    try:
        return quantity(value, "number density", units, key)
    except InputError:
        return quantity(value, "density", units, key) / mass


def unit_named(text: str, units: UnitSystem | None, key: str) -> str:
    """Unit that a text names: a dimension ("length") gives its unit in ``units``, and a unit gives itself.

    "" means no unit. Raises an InputError that begins with ``key``.
    """
    dimension = text.replace("_", " ")
    if dimension in DIMENSIONS and units is not None:
        return units.unit(dimension)
    if text and not (units is not None and text in map(units.unit, DIMENSIONS)):
        _parsed(text, text, f"{key}: ")
    return text


def _example(dimension: str, units: UnitSystem) -> str:
    name = dimension.replace("_", " ")
    if not DIMENSIONS[name]:
        return ""
    if units.reduced:
        return " as a plain number"
    return f' such as "{EXAMPLES.get(name, "1 " + units.unit(name))}"'


@lru_cache(maxsize=1)
def _registry() -> Any:
    import pint  # half a second: paid only by files whose quantities carry units

    registry = pint.UnitRegistry(on_redefinition="ignore", cache_folder=None)
    registry.define(f"atomic_mass_constant = {constants.ATOMIC_MASS!r} kg = m_u")  # pint's CODATA may be another year's
    registry.define(f"solar_mass = {MSUN!r} kg = Msun")
    registry.define(f"parsec = {PARSEC!r} m = pc")  # pint's is AU / tan(1 arcsec), longer by 8e-12
    registry.define("@alias astronomical_unit = AU")
    for each in ("kcal", "kJ"):
        registry.define(f"{each}_of_one = {each} / {constants.AVOGADRO!r}")  # an energy per mole, of one particle
    return registry


def _parsed(unit: str, text: str, prefix: str) -> Any:
    """pint's unit of this name. Raises an InputError that names the unknown part of the ``text``."""
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
        if hint := other_name("unit", name):
            raise InputError(f"{prefix}unknown unit {name!r} in {shown(text)}{hint}") from None
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
        return float(given.to(_of_particles(registry, units.unit(dimension))).magnitude)
    except pint.PintError:
        raise InputError(wrong) from None
    except (OverflowError, ZeroDivisionError, ArithmeticError):
        return math.inf


def _is_pure(registry: Any, unit: Any, dimension: str) -> bool:
    """Tell whether the unit is free of units that pint takes for the number 1, such as percent, bit or rad. An angle
    must be in radians, degrees, turns, … and nothing else."""
    root = registry.get_root_units(unit)[1]
    if dimension == "angle":
        return len(unit._units) == 1 and bool(root == registry.Unit("radian"))
    return not any(registry.Unit(part).dimensionless for part in (*unit._units, *root._units))


def _of_particles(registry: Any, unit: str) -> Any:
    """pint's unit of this name, with the energy of one particle in place of an energy per mole."""
    return registry.parse_units(re.sub(r"\bk(cal|J)/mol\b", r"k\1_of_one", unit))


def _moles(dimension: str) -> int:
    """Power of the amount of substance in a quantity of this dimension: energies and masses per mole, moles per
    volume."""
    name = dimension.replace("_", " ")
    return 1 if name == "number density" else -1 if name == "mass" else -DIMENSIONS[name].get("E", 0)
