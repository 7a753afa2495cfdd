"""Bonds, angles, dihedrals, impropers and scaled pairs as OpenMM's custom forces, with the scale s of the virial.

OpenMM's nearest images are those of kickdrift. Only bonds change with the size of a system, so only their energies
depend on s.
"""

from __future__ import annotations

from typing import Any

from kickdrift.engines.bonded import LAWS, split
from kickdrift.model.system import System

SCALED_PAIR = "scale*step(cutoff-r)*(4*e*((l/(s*r))^12 - (l/(s*r))^6)"


def exclude(force: Any, system: System) -> None:
    """Leave all special pairs out of a CustomNonbondedForce."""
    if system.topology is not None:
        for i, j in system.topology.scaled.pairs.tolist():
            force.addExclusion(i, j)


def added_forces(system: System, pair_force: Any) -> list[Any]:
    """Bonded forces, and the scaled pairs of the pair force."""
    made = [_bonded(system, force) for force in split(system)[1]]
    if system.topology is not None and (system.topology.scaled.factors > 0).any():
        made.append(_scaled_pairs(system, pair_force))
    return made


def _bonded(system: System, force: Any) -> Any:
    import openmm

    terms, kind = LAWS[type(force)], force.kind
    items, laws, which = force.items(system)
    parameters = [terms.keys(law) for law in laws]
    energy, add = terms.energy, {"bonds": "addBond", "angles": "addAngle"}.get(kind, "addTorsion")
    if kind == "bonds":
        made = openmm.CustomBondForce(energy.replace("exp(", "EXP(").replace("r", "(s*r)").replace("EXP(", "exp("))
        made.addGlobalParameter("s", 1.0)
        made.addEnergyParameterDerivative("s")
    else:
        made = openmm.CustomAngleForce(energy) if kind == "angles" else openmm.CustomTorsionForce(energy)
    for key in parameters[0]:
        getattr(made, f"addPer{add[3:]}Parameter")(key)
    for item, law in zip(items.tolist(), which.tolist(), strict=True):
        getattr(made, add)(*item, list(parameters[law].values()))
    made.setUsesPeriodicBoundaryConditions(system.box.periodic)
    return made


def _scaled_pairs(system: System, force: Any) -> Any:
    import openmm

    assert system.topology is not None
    shift = " - 4*e*((l/cutoff)^12 - (l/cutoff)^6))" if force.truncation == "shift" else ")"
    made = openmm.CustomBondForce(SCALED_PAIR + shift)
    made.addGlobalParameter("s", 1.0)
    made.addEnergyParameterDerivative("s")
    made.addGlobalParameter("cutoff", float(force.cutoff))
    for key in ("scale", "e", "l"):
        made.addPerBondParameter(key)
    kinds = system.species_index
    for (i, j), factor in zip(*(part.tolist() for part in system.topology.scaled), strict=True):
        if factor > 0:
            law = force.pair_law(system.species[kinds[i]], system.species[kinds[j]])
            made.addBond(i, j, [factor, float(law.epsilon), float(law.sigma)])
    made.setUsesPeriodicBoundaryConditions(system.box.periodic)
    return made
