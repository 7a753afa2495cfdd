"""One of each force that ships, for scripts and tests that loop over the registry."""

import inspect
from typing import Any

import numpy as np

import kickdrift as kd
from kickdrift.forces import EmbeddedAtom
from kickdrift.forces.bonded.law import BondedForce
from kickdrift.model.starts.builders import lattice, maxwell_boltzmann
from kickdrift.systemfile.files import shipped


def pull(positions: np.ndarray, velocities: np.ndarray, time: float, box: Any) -> tuple[Any, float, float]:
    """A weak harmonic trap as a plain function; no pairs of particles, so no virial."""
    return -0.1 * positions, 0.05 * float(np.sum(positions**2)), 0.0


def steady(t: float, y: Any, bodies: Any) -> Any:
    """A stiffness that stays."""
    return 0.0 * y


def stiffen(t: float, y: Any, bodies: Any, a: Any) -> float:
    """A harmonic trap whose stiffness is an unknown; returns the energy."""
    energy = 0.0
    for i in range(bodies.m.size):
        for k in range(3):
            a[k, i] -= y[0] * bodies.x[k, i]
            energy += 0.5 * y[0] * bodies.m[i] * bodies.x[k, i] ** 2
    return energy


def ases_lennard_jones(**given: float) -> Any:
    """ASE's calculator, imported where it is made: ASE is no part of kickdrift."""
    from ase.calculators.lj import LennardJones

    return LennardJones(**given)


def rows(first: float, last: float, energy: Any) -> list[list[float]]:
    """A table of 241 energies."""
    return [[x, float(energy(x))] for x in np.linspace(first, last, 241).tolist()]


# What a force needs to be told. A number that stands neither here nor among the class's defaults is 0.1.
EXAMPLES: dict[str, dict[str, Any]] = {
    "eam": {"file": str(shipped()["copper-864"].with_name("Cu_zhou2004.eam.alloy")), "digest": ""},
    "stillinger-weber": {"entries": None, "file": None},
    "tersoff": {"entries": None, "file": None},
    "relativity-1pn": {"c": 100.0},
    "relativity-eih": {"c": 100.0},
    "lense-thirring": {"angular_momentum": (0.03, -0.06, 0.15), "c": 30.0},
    "relativity-2.5pn": {"c": 10.0},
    "coulomb": {"method": "damped-shifted", "cutoff": 2.0, "alpha": 0.4},
    "gravity-sheet": {"omega": 1.0, "width": 40.0, "length": 60.0},
    "j2": {"j2": 0.1, "radius": 0.1},
    "tides": {"radius": 0.2, "tau": 0.01, "rotation": "none"},
    "tides-spin": {"radius": 0.2, "inertia": 0.3, "spin": (0.3, 0.0, 1.0), "tau": 0.01},
    "beside": {"f": steady, "y0": (0.1,), "names": ("stiffness",), "acts": stiffen},
    "radiation-pressure": {"c": 30.0},
    "non-gravitational": {"a2": 0.01, "scale": 1.0},
    "migration": {"tau_a": 100.0, "tau_e": 10.0, "tau_i": 10.0, "edge": 0.5},
    "gas-drag": {"coefficient": 0.1, "scale": 1.0, "headwind": 0.05},
    "central-potential": {"acceleration": -0.1, "power": -1.0},
    "mass-change": {"rate": -0.1},
    **{key: {"cutoff": 2.0} for key in ("buckingham", "born-mayer-huggins", "morse-pair", "yukawa", "zbl")},
    "tabulated": {
        "table": rows(0.001, 3.0, lambda r: 2.0 * np.exp(-1.5 * r * r) - 0.5 * np.exp(-6.0 * (r - 1.2) ** 2))
    },
    "tabulated-bond": {"table": rows(0.0, 20.0, lambda r: (r - 0.7) ** 2 + 0.1 * np.sin(r))},
    "tabulated-angle": {"table": rows(0.0, 180.0, lambda angle: np.cos(np.radians(2.0 * angle + 30.0)))},
    "tabulated-dihedral": {"table": rows(-180.0, 180.0, lambda angle: np.cos(np.radians(3.0 * angle + 30.0)))},
    "formula-pair": {"formula": "a*exp(-b*r)-c/r^6", "parameters": {"a": 2.0, "b": 1.5, "c": 1e-3}, "cutoff": 2.0},
    "formula-bond": {"formula": "k*d^2*(1+d); d=r-r0", "parameters": {"k": 2.0, "r0": 0.7}},
    "formula-angle": {"formula": "k*(cos(theta)-c)^2", "parameters": {"k": 2.0, "c": -0.3}},
    "formula-dihedral": {"formula": "k*exp(-a*(1-cos(theta-0.3)))", "parameters": {"k": 2.0, "a": 0.7}},
    "formula-improper": {"formula": "k*sin(theta)^2", "parameters": {"k": 2.0}},
    "springs": {"pairs": [[0, 1], [5, 3]], "stiffness": 2.0, "length": 0.5},
    "harmonic-bond": {"stiffness": 2.0, "length": 0.7},
    "fene": {"length": 20.0},
    "morse-bond": {"depth": 2.0, "width": 1.5, "length": 0.9},
    "harmonic-angle": {"stiffness": 2.0, "rest": 110.0},
    "periodic-dihedral": {"barrier": 2.0, "multiplicity": 3.0, "phase": 30.0},
    "ryckaert-bellemans": {"c0": 0.3, "c1": 0.5, "c2": -0.4, "c3": 0.2, "c4": 0.6, "c5": -0.1},
    "opls-dihedral": {"v1": 0.5, "v2": -0.4, "v3": 0.2, "v4": 0.6},
    "harmonic-improper": {"stiffness": 2.0, "rest": 20.0},
    "periodic-improper": {"barrier": 2.0, "multiplicity": 2.0, "phase": 30.0},
    "cmap": {"chains": [[0, 1, 2, 3, 4]], "maps": [np.sin(np.arange(16.0)).reshape(4, 4).tolist()]},
    "listed-pairs": {"pairs": [[0, 1], [1, 2]], "epsilon": 0.7, "sigma": [0.8, 0.9], "charges": -0.2},
    "uniform-field": {"acceleration": (0.0, 0.1, 0.0)},
    "restraint": {"stiffness": 2.0, "particles": [0, 5], "positions": [(0.3, 0.2, 0.0), (-0.5, 1.0, 0.0)]},
    "galaxy": {
        "potentials": [
            "MWPotential2014",
            {"kind": "kepler", "mass": 0.3},
            {"kind": "plummer", "mass": 0.5, "b": 0.6, "strength": "1+a*sin(3*t); a=0.2"},
            {"kind": "isochrone", "mass": 0.4, "b": 0.7},
            {"kind": "hernquist", "mass": 0.6, "a": 0.8},
            {"kind": "logarithmic", "speed": 0.7, "core": 0.2, "q": 0.8, "p": 0.9, "angle": 30.0, "omega": 0.4},
            {"kind": "bar", "mass": 0.5, "a": 0.9, "b": 0.2, "c": 0.3, "angle": 20.0, "omega": -0.6},
        ],
        "centre": (0.1, -0.2, 0.0),
    },
    "harmonic-wall": {"stiffness": 2.0, "normal": (0.0, 0.0, 2.0), "point": (0.0, 0.0, -4.0), "reach": 4.5},
    "lennard-jones-wall": {"normal": (0.0, 0.0, 2.0), "point": (0.0, 0.0, -4.0), "cutoff": 6.0},
    "reflecting-wall": {"normal": (0.0, 0.0, 2.0), "point": (0.0, 0.0, -4.0)},
    "python": {"function": pull},
    "ase": {"calculator": ases_lennard_jones, "arguments": {"rc": 1.5, "sigma": 0.9}},
    "lammps": {
        "pair_style": "lj/cut 1.5",
        "pair_coeff": "* * 1.0 0.9",
        "commands": (),
        "atom_style": "atomic",
        "renewal": 0.1,
    },
    "driven-field": {"amplitude": (0.3, 0.0, 0.1), "frequency": 3.0},
}


def topology(force: Any) -> kd.Topology | None:
    """A chain of the first four particles for a bonded force; None for other forces."""
    return kd.Topology([(0, 1), (1, 2), (2, 3)], True, True, [(1, 0, 2, 3)]) if isinstance(force, BondedForce) else None


def charges(force: Any, count: int) -> np.ndarray | None:
    """Charges of so many particles for Coulomb's law, whose sum is not zero; None for other forces."""
    return np.where(np.arange(count) % 2, 0.4, -0.3) if isinstance(force, kd.Coulomb) else None


def changed(key: str, value: float) -> dict[str, Any]:
    """A table with another value of a law's parameter; a formula's parameters are in a table of their own."""
    return {key: {"a": value} if key == "parameters" else value}


def example(cls: Any, **given: Any) -> Any:
    """A force of this class; ``given`` are parameters, of which the class takes those that it has."""
    parameters = inspect.signature(cls).parameters
    required = [key for key, each in parameters.items() if each.default is each.empty]
    known = {key: value for key, value in given.items() if key in parameters}
    return cls(**(dict.fromkeys(required, 0.1) | EXAMPLES.get(cls.name, {}) | known))


def crystal(force: Any, few: bool = False, shaken: float = 0.05, seed: int = 5) -> kd.System:
    """A shaken crystal at 600 K under a many-body force: 256 copper atoms or 512 silicon atoms in a periodic box, or a
    ``few`` in open space."""
    metal = isinstance(force, EmbeddedAtom)
    kind, sites, edge, mass = ("fcc", 4, 3.615, 63.546) if metal else ("diamond", 8, 5.431, 28.0855)
    count = sites * (2 if few else 4) ** 3
    x, edges = lattice(kind, count, sites / edge**3)
    x = x + np.random.default_rng(seed).uniform(-shaken, shaken, x.shape)
    box, species = None if few else edges, [force.known[0]] * count
    system = kd.System(x, masses=mass, box=box, forces=[force], units="metal", species=species)
    v = maxwell_boltzmann(system.coherent_masses, 600.0, system.units.boltzmann, seed)
    return kd.System(x, v, mass, box, [force], "metal", species=species)
