"""One of each force that ships, for scripts and tests that loop over the registry."""

from __future__ import annotations

import inspect
from typing import Any

import numpy as np

import kickdrift as kd
from kickdrift.forces.bonded_law import BondedForce


def pull(positions: np.ndarray, velocities: np.ndarray, time: float, box: Any) -> tuple[Any, float, float]:
    """A weak harmonic trap as a plain function; no pairs of particles, so no virial."""
    return -0.1 * positions, 0.05 * float(np.sum(positions**2)), 0.0


def ases_lennard_jones(**given: float) -> Any:
    """ASE's calculator, imported where it is made: ASE is no part of kickdrift."""
    from ase.calculators.lj import LennardJones

    return LennardJones(**given)


# What a force needs to be told. A number that stands neither here nor among the class's defaults is 0.1.
EXAMPLES: dict[str, dict[str, Any]] = {
    "relativity-1pn": {"c": 100.0},
    "j2": {"j2": 0.1, "radius": 0.1},
    "springs": {"pairs": [[0, 1], [5, 3]], "stiffness": 2.0, "length": 0.5},
    "harmonic-bond": {"stiffness": 2.0, "length": 0.7},
    "fene": {"length": 20.0},
    "morse-bond": {"depth": 2.0, "width": 1.5, "length": 0.9},
    "harmonic-angle": {"stiffness": 2.0, "rest": 110.0},
    "periodic-dihedral": {"barrier": 2.0, "multiplicity": 3.0, "phase": 30.0},
    "ryckaert-bellemans": {"c0": 0.3, "c1": 0.5, "c2": -0.4, "c3": 0.2, "c4": 0.6, "c5": -0.1},
    "opls-dihedral": {"v1": 0.5, "v2": -0.4, "v3": 0.2, "v4": 0.6},
    "uniform-field": {"acceleration": (0.0, 0.1, 0.0)},
    "python": {"function": pull},
    "ase": {"calculator": ases_lennard_jones, "arguments": {"rc": 1.5, "sigma": 0.9}},
    "driven-field": {"amplitude": (0.3, 0.0, 0.1), "frequency": 3.0},
}


def topology(force: Any) -> kd.Topology | None:
    """A chain of the first four particles for a bonded force; None for other forces."""
    return kd.Topology([(0, 1), (1, 2), (2, 3)], True, True) if isinstance(force, BondedForce) else None


def example(cls: Any, **given: Any) -> Any:
    """A force of this class; ``given`` are parameters, of which the class takes those that it has."""
    parameters = inspect.signature(cls).parameters
    required = [key for key, each in parameters.items() if each.default is each.empty]
    known = {key: value for key, value in given.items() if key in parameters}
    return cls(**(dict.fromkeys(required, 0.1) | EXAMPLES.get(cls.name, {}) | known))
