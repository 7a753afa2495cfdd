"""Unit systems. Numbers inside kickdrift are in the system's own units; conversion happens only where text comes in."""

from __future__ import annotations

from dataclasses import dataclass

from kickdrift.errors import InputError


@dataclass(frozen=True)
class UnitSystem:
    """Names of the units, Boltzmann's constant and G in them.

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
    coherent_mass: float = 1.0


UNIT_SYSTEMS: dict[str, UnitSystem] = {
    "lj": UnitSystem("lj", "sigma", "tau", "m", "epsilon", "epsilon/k_B", 1.0),
    "nbody": UnitSystem("nbody", "length", "time", "mass", "energy", "energy/k_B", 1.0, gravity=1.0),
}


def unit_system(name: str) -> UnitSystem:
    """The unit system of that name; an unknown one is an InputError that lists the names."""
    try:
        return UNIT_SYSTEMS[name]
    except KeyError:
        raise InputError(f"units: {name!r} is not one of {', '.join(UNIT_SYSTEMS)}") from None
