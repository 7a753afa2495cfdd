"""Unit systems: the names of their units, and the physical constants in these units.

Constants are CODATA's (`kickdrift.model.units.constants`). The gravitational constant of ``astro``, ``stellar`` and
``galactic`` comes from the GM of the Sun in JPL's ephemeris DE421: the product is known to twelve digits, G alone to
five.
"""

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass

from kickdrift.errors import InputError
from kickdrift.model.checks.arguments import other_name
from kickdrift.model.units import constants
from kickdrift.text import shown, suggestion

GM_SUN = 1.32712440040944e20  # m^3/s^2, DE421 (Folkner, Williams & Boggs 2009, IPN Progress Report 42-178)
AU = constants.AU  # m, exact since IAU 2012; DE421's own is 0.37 m shorter, 7.5e-12 of G
YEAR = 365.25 * constants.DAY  # s, the Julian year
PARSEC = AU * 648_000.0 / math.pi  # m (IAU 2015, resolution B2)
MSUN = GM_SUN / constants.GRAVITY  # kg; no better known than CODATA's G, and needed only for input in kilograms

GREEK = {"sigma": "σ", "tau": "τ", "epsilon": "ε"}
NAMELESS = {"length", "time", "mass", "energy", "charge"}  # names of units that only repeat the dimension

# Each dimension as a product of powers of length L, time T, mass M, energy E, temperature K and angle A.
DIMENSIONS: dict[str, dict[str, int]] = {
    "dimensionless": {},
    "length": {"L": 1},
    "inverse length": {"L": -1},
    "time": {"T": 1},
    "mass": {"M": 1},
    "energy": {"E": 1},
    "temperature": {"K": 1},
    "velocity": {"L": 1, "T": -1},
    "acceleration": {"L": 1, "T": -2},
    "force": {"E": 1, "L": -1},
    "power": {"E": 1, "T": -1},
    "pressure": {"E": 1, "L": -3},
    "volume": {"L": 3},
    "compressibility": {"E": -1, "L": 3},
    "density": {"M": 1, "L": -3},
    "number density": {"L": -3},
    "frequency": {"T": -1},
    "rate": {"T": -1},
    "stiffness": {"E": 1, "L": -2},
    "energy length": {"E": 1, "L": 1},
    "energy length^6": {"E": 1, "L": 6},
    "energy length^8": {"E": 1, "L": 8},
    "momentum": {"M": 1, "L": 1, "T": -1},
    "angular momentum": {"M": 1, "L": 2, "T": -1},
    "gravitational constant": {"L": 3, "M": -1, "T": -2},
    "gravitational parameter": {"L": 3, "T": -2},
    "angle": {"A": 1},
    "charge": {"Q": 1},
}


@dataclass(frozen=True)
class UnitSystem:
    """Names of the units, and Boltzmann's constant, G and the speed of light in them.

    G and the speed of light are None in systems without them. A mass times ``coherent_mass`` is force over
    acceleration: in ``metal`` (angstrom, ps, eV, u) the factor converts u to eV ps^2 / angstrom^2. It is 1 in ``lj``,
    ``si``, ``astro``, ``stellar``, ``galactic`` and ``nbody``, and 1.00000000105 in ``gromacs``, where N_A u is not
    quite 1 g/mol.

    The unit of charge and Coulomb's constant follow from the name; see ``CHARGES``.
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
        """Whether quantities are plain numbers, without units that text could name."""
        return self.name in ("lj", "nbody")

    @property
    def charge(self) -> str:
        """Name of the unit of charge; "charge" in systems without a name for it."""
        return CHARGES[self.name][0] if self.name in CHARGES else "charge"

    @property
    def coulomb(self) -> float | None:
        """Coulomb's constant: the energy of two unit charges at unit distance in vacuum; None in systems without
        charges."""
        return CHARGES[self.name][1] if self.name in CHARGES else None

    def unit(self, dimension: str) -> str:
        """Unit of a dimension, as text for people and for pint: ``angstrom/ps``, ``eV/angstrom^3``."""
        names = {"L": self.length, "T": self.time, "M": self.mass, "E": self.energy, "K": self.temperature, "A": "deg"}
        names["Q"] = self.charge
        over: list[str] = []
        under: list[str] = []
        found = powers(dimension)
        for symbol, power in found.items():
            name = f"({names[symbol]})" if len(found) > 1 and re.search(r"[ /]", names[symbol]) else names[symbol]
            (over if power > 0 else under).append(name if abs(power) == 1 else f"{name}^{abs(power)}")
        top = " ".join(over) or ("1" if under else "")
        return top if not under else f"{top}/{under[0]}" if len(under) == 1 else f"{top}/({' '.join(under)})"

    def symbol(self, dimension: str) -> str:
        """Symbol of a dimension's unit: ``σ/τ`` in lj, ``AU/yr`` in astro, "" in nbody."""
        return symbol_of(self.unit(dimension))

    def described(self, dimensions: Iterable[str]) -> str:
        """Units of these dimensions as text: "length σ, time τ"."""
        named = [f"{dimension} {symbol}" for dimension in dimensions if (symbol := self.symbol(dimension))]
        return ", ".join(named) or "plain numbers" + (f", G = {self.gravity:g}" if self.gravity else "")


_IN_VACUUM = 1.0 / (4.0 * math.pi * constants.VACUUM_PERMITTIVITY)  # N m^2/C^2
_BETWEEN_E = _IN_VACUUM * constants.ELEMENTARY_CHARGE**2  # J m: Coulomb's constant between elementary charges
_KCAL, _KJ = 4184.0 / constants.AVOGADRO, 1000.0 / constants.AVOGADRO  # J, of one particle; the thermochemical calorie
# Unit of charge and Coulomb's constant. In lj and nbody, two unit charges at distance r have the energy 1 / r.
CHARGES: dict[str, tuple[str, float | None]] = {
    "lj": ("charge", 1.0),
    "metal": ("e", _IN_VACUUM * constants.ELEMENTARY_CHARGE / 1e-10),  # eV angstrom
    "real": ("e", _BETWEEN_E / _KCAL / 1e-10),  # kcal/mol angstrom
    "gromacs": ("e", _BETWEEN_E / _KJ / 1e-9),  # kJ/mol nm
    "si": ("C", _IN_VACUUM),
    "astro": ("C", None),
    "stellar": ("C", None),
    "galactic": ("C", None),
    "nbody": ("charge", 1.0),
}

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
    "real": UnitSystem(
        "real",
        "angstrom",
        "fs",
        "u",
        "kcal/mol",
        "K",
        boltzmann=constants.BOLTZMANN / _KCAL,
        light=constants.LIGHT * 1e-15 / 1e-10,
        coherent_mass=constants.ATOMIC_MASS * (1e-10 / 1e-15) ** 2 / _KCAL,
    ),
    "gromacs": UnitSystem(
        "gromacs",
        "nm",
        "ps",
        "u",
        "kJ/mol",
        "K",
        boltzmann=constants.BOLTZMANN / _KJ,
        light=constants.LIGHT * 1e-12 / 1e-9,
        coherent_mass=constants.ATOMIC_MASS * (1e-9 / 1e-12) ** 2 / _KJ,
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
    **{
        name: UnitSystem(
            name,
            length,
            "Myr",
            "Msun",
            f"Msun {length}^2/Myr^2",
            "K",
            boltzmann=constants.BOLTZMANN * (1e6 * YEAR) ** 2 / (MSUN * metres**2),
            gravity=GM_SUN * (1e6 * YEAR) ** 2 / metres**3,
            light=constants.LIGHT * 1e6 * YEAR / metres,
        )
        for name, length, metres in (("stellar", "pc", PARSEC), ("galactic", "kpc", 1e3 * PARSEC))
    },
    "nbody": UnitSystem("nbody", "length", "time", "mass", "energy", "energy/k_B", 1.0, gravity=1.0),
}


def symbol_of(unit: str) -> str:
    """Symbol of a unit: a Greek letter for lj's units, "" for a unit without a name of its own."""
    words = set(re.findall(r"\w+", unit))
    return "" if words & NAMELESS else re.sub(r"\b(?:sigma|tau|epsilon)\b", lambda word: GREEK[word[0]], unit)


def unit_system(name: str) -> UnitSystem:
    """Unit system of this name. Raises an InputError that lists the known names for an unknown one."""
    try:
        return UNIT_SYSTEMS[name]
    except (KeyError, TypeError):
        hint = other_name("units", name) or suggestion(name, UNIT_SYSTEMS)
        raise InputError(f"units: expected one of {', '.join(UNIT_SYSTEMS)}, got {shown(name)}{hint}") from None


def powers(dimension: str) -> dict[str, int]:
    """Powers of the base dimensions; ``DIMENSIONS`` has the names."""
    try:
        return DIMENSIONS[dimension.replace("_", " ")]
    except KeyError:
        raise ValueError(f"dimension {dimension!r} is not one of {', '.join(DIMENSIONS)}") from None
