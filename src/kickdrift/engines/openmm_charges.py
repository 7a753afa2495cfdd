"""Coulomb's law in OpenMM's terms: OpenMM's own Ewald sum, or a custom force of pairs.

Charges are scaled so that OpenMM's Coulomb constant gives the system's energies. OpenMM chooses the waves of its sum
from a tolerance, which is set so that its splitting parameter is the system's.
"""

import math
from functools import cache
from typing import Any

import numpy as np

from kickdrift.forces.charges.coulomb import Coulomb
from kickdrift.forces.charges.radial import ALL_IMAGES, DIRECT, REACTION_FIELD
from kickdrift.model.state import Floats
from kickdrift.model.system import System

METHODS = (*ALL_IMAGES, DIRECT, REACTION_FIELD)  # which OpenMM has; its Ewald sum serves for a mesh, too
GROUP = 1  # of OpenMM's Ewald sum
PAIR = "q1*q2*(1/(s*r) + medium*(s*r)^2 - end)"  # s is the scale parameter of the virial


def charged_forces(system: System, force: Coulomb) -> list[Any]:
    """OpenMM's forces for Coulomb's law. Those of pairs still need their scale parameter `s`, see `scaled`."""
    return [_ewald(system, force)] if force.method in ALL_IMAGES else _of_pairs(system, force)


def _ewald(system: System, force: Coulomb) -> Any:
    import openmm

    split = force.split(system)
    made = openmm.NonbondedForce()
    made.setNonbondedMethod(made.Ewald)
    made.setCutoffDistance(split.cutoff)
    made.setEwaldErrorTolerance(0.5 * math.exp(-((split.alpha * split.cutoff) ** 2)))
    charges = force.scaled_charges(system) / math.sqrt(openmm_constant())
    for charge in charges.tolist():
        made.addParticle(charge, 1.0, 0.0)
    if system.topology is not None:
        for (i, j), factor in zip(*(part.tolist() for part in system.topology.scaled), strict=True):
            made.addException(i, j, factor * charges[i] * charges[j], 1.0, 0.0)
    made.setExceptionsUsePeriodicBoundaryConditions(True)
    made.setForceGroup(GROUP)
    return made


def _of_pairs(system: System, force: Coulomb) -> list[Any]:
    """All pairs in open space, or the pairs within the cutoff of a reaction field."""
    import openmm

    charges, cutoff = force.scaled_charges(system), force.split(system).cutoff if force.method != DIRECT else 0.0
    medium, end = _field(force, cutoff)
    made = openmm.CustomNonbondedForce(PAIR)
    made.addPerParticleParameter("q")
    for charge in charges.tolist():
        made.addParticle([charge])
    if cutoff:
        made.setCutoffDistance(cutoff)
        made.setNonbondedMethod(made.CutoffPeriodic if system.box.periodic else made.CutoffNonPeriodic)
    found = [made]
    if system.topology is not None and (system.topology.scaled.factors > 0).any():
        within = f"step({cutoff!r}-r)*" if cutoff else ""
        bonds = openmm.CustomBondForce(within + PAIR.replace("q1*q2", "qq"))
        bonds.addPerBondParameter("qq")
        for (i, j), factor in zip(*(part.tolist() for part in system.topology.scaled), strict=True):
            bonds.addBond(i, j, [factor * charges[i] * charges[j]])
        bonds.setUsesPeriodicBoundaryConditions(system.box.periodic)
        found.append(bonds)
    for each in found:
        each.addGlobalParameter("medium", medium)
        each.addGlobalParameter("end", end)
    return found


def _field(force: Coulomb, cutoff: float) -> tuple[float, float]:
    """Coefficients of a reaction field: of r^2, and the constant that makes the energy zero at the cutoff."""
    if force.method == DIRECT:
        return 0.0, 0.0
    part = 0.5 if force.surroundings is None else (force.surroundings - 1.0) / (2.0 * force.surroundings + 1.0)
    return part / cutoff**3, (1.0 + part) / cutoff


@cache
def openmm_constant() -> float:
    """OpenMM's Coulomb constant: the energy of two unit charges at unit distance."""
    import openmm

    made, pair = openmm.System(), openmm.NonbondedForce()
    for _ in range(2):
        made.addParticle(1.0)
        pair.addParticle(1.0, 1.0, 0.0)
    made.addForce(pair)
    context = openmm.Context(made, openmm.VerletIntegrator(1.0), openmm.Platform.getPlatformByName("Reference"))
    x: Floats = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    context.setPositions(x)
    energy = context.getState(energy=True).getPotentialEnergy()
    return float(energy.value_in_unit(energy.unit))
