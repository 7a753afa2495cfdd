"""OpenMM's objects of a System, in units ``gromacs``: the way out; `kickdrift.bridges.openmm.system` is the way in."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import openmm
import openmm.app as app
from openmm import unit

from kickdrift.bridges.bonded_laws import LAWS
from kickdrift.bridges.openmm.custom_out import TRUNCATIONS, in_formulas, listed, paired
from kickdrift.bridges.openmm.files import Parts
from kickdrift.bridges.openmm.nonbonded import FAR, METHODS
from kickdrift.errors import InputError
from kickdrift.forces import (
    Cmap,
    Coulomb,
    HarmonicAngle,
    HarmonicBond,
    LennardJones,
    ListedPairs,
    PeriodicDihedral,
    PeriodicImproper,
    RyckaertBellemans,
)
from kickdrift.forces.bonded.law import BondedForce
from kickdrift.forces.charges.coulomb import coulomb_of
from kickdrift.forces.formulas.given import Formulas
from kickdrift.forces.pairs.ends import WITH_TAIL
from kickdrift.forces.pairs.formula import FormulaPair
from kickdrift.model.molecules.relatives import molecules_of
from kickdrift.model.molecules.virtual_sites import VirtualSite
from kickdrift.model.system import System
from kickdrift.systemfile.converting import MOLECULAR
from kickdrift.text import choices

CONDUCTOR = 1e15  # relative permittivity that stands for a conductor
SYMBOL = re.compile(r"[A-Z][a-z]?(?![a-z])")

Adder = Callable[[Any, list[int], Any], object]
BONDED: dict[type, tuple[str, Adder]] = {  # OpenMM's force of a law, and how a term is added to it
    HarmonicBond: ("HarmonicBondForce", lambda made, item, p: made.addBond(*item, p.length, p.stiffness)),
    HarmonicAngle: ("HarmonicAngleForce", lambda made, item, p: made.addAngle(*item, np.radians(p.rest), p.stiffness)),
    RyckaertBellemans: ("RBTorsionForce", lambda made, item, p: made.addTorsion(*item, *p)),
}
BONDED |= dict.fromkeys(
    (PeriodicDihedral, PeriodicImproper),
    (
        "PeriodicTorsionForce",
        lambda made, item, p: made.addTorsion(*item, int(p.multiplicity), np.radians(p.phase), p.barrier),
    ),
)


def parts_of(system: System) -> Parts:
    """Return OpenMM's objects; see `System.to_openmm`."""
    if system.units.name not in MOLECULAR:
        raise InputError(f"to_openmm: units {system.units.name!r}: expected {choices(MOLECULAR)}")
    system = in_formulas(system.in_units("gromacs"))
    _refuse(system)
    made = openmm.System()
    masses = system.state.masses if system.fixed is None else system.fixed.free(system.state.masses)
    for mass in masses.tolist():  # OpenMM leaves particles without mass in place
        made.addParticle(mass)
    topology = _topology(system)
    if system.box.periodic:
        rows = [openmm.Vec3(*row) for row in system.box.matrix.tolist()]
        made.setDefaultPeriodicBoxVectors(*rows)
        topology.setPeriodicBoxVectors([row * unit.nanometer for row in rows])
    if any(isinstance(force, LennardJones | Coulomb | ListedPairs) for force in system.forces):
        made.addForce(_nonbonded(system))
    bonded: dict[str, Any] = {}
    for force in system.forces:
        if isinstance(force, FormulaPair):
            made.addForce(paired(system, force, FAR))
        elif isinstance(force, BondedForce):
            items, laws, which = force.items(system)
            if type(force) not in BONDED or not all(map(_is_periodic, laws)):
                bonded[f"{force.name} {len(bonded)}"] = listed(system, force)
                continue
            name, add = BONDED[type(force)]
            target = bonded.setdefault(name, getattr(openmm, name)())
            for item, law in zip(items.tolist(), which.tolist(), strict=True):
                add(target, item, laws[law])
        if isinstance(force, Cmap):
            bonded.setdefault(f"{force.name} {len(bonded)}", _cmap(force))
    for force in bonded.values():
        force.setUsesPeriodicBoundaryConditions(system.box.periodic)
        made.addForce(force)
    if system.constraints is not None:
        for (i, j), length in zip(system.constraints.pairs.tolist(), system.constraints.lengths.tolist(), strict=True):
            made.addConstraint(i, j, length)
    for particle, site in _sites(system):
        made.setVirtualSite(particle, site)
    return Parts(made, topology, system.state.positions, system.state.velocities)


def _is_periodic(law: Any) -> bool:
    """Whether OpenMM has the multiplicity of a law, if it has one: a positive whole number."""
    multiplicity = getattr(law, "multiplicity", 1)
    return bool(multiplicity >= 1 and multiplicity == int(multiplicity))


def _refuse(system: System) -> None:
    """Refuse what these forces of OpenMM do not have."""
    if system.dimensions != 3 or (system.box.periodic and not all(system.box.periodic_axes)):
        raise InputError("to_openmm: OpenMM's boxes are periodic along three axes, or open")
    if system.fixed is not None and system.fixed.move:
        raise InputError("to_openmm: OpenMM keeps fixed particles at rest, and those of this system move")
    for force in system.forces:
        if type(force) not in (*BONDED, *LAWS, Cmap, LennardJones, Coulomb, ListedPairs) and not isinstance(
            force, Formulas
        ):
            raise InputError(f"to_openmm: force {force.name!r} has no counterpart in OpenMM")
    lennard_jones: list[Any] = [force for force in system.forces if isinstance(force, LennardJones)]
    for pair in lennard_jones:
        if pair.truncation not in WITH_TAIL:
            known = choices(TRUNCATIONS)
            raise InputError(f"to_openmm: lennard-jones: OpenMM has no truncation {pair.truncation!r}; it has {known}")
        if len(pair.ends(system.species)) > 1:
            raise InputError("to_openmm: lennard-jones: OpenMM has one cutoff for all pairs of species")
    for force in system.forces:
        if isinstance(force, Coulomb) and (force.dielectric != 1.0 or force.method == "damped-shifted"):
            raise InputError(f"to_openmm: coulomb: OpenMM has no method {force.method!r} with this dielectric")
        if isinstance(force, Coulomb) and force.method == "reaction-field" and system.topology is not None:
            pairs, factors = system.topology.scaled
            for i, j in pairs[factors != 0].tolist():
                raise InputError(
                    f"to_openmm: coulomb: pair {[i, j]} is scaled in a reaction field; OpenMM leaves the field out of "
                    "such pairs, with other energies"
                )


def _sites(system: System) -> Iterator[tuple[int, Any]]:
    """Yield the particle of each virtual site, and OpenMM's site."""
    for table in () if system.virtual_sites is None else system.virtual_sites.tables:
        given = VirtualSite(**table)
        for particle, of, weights, normal in zip(
            given.particles.tolist(), given.of.tolist(), given.weights.tolist(), given.normal.tolist(), strict=True
        ):
            if len(of) == 2:
                yield particle, openmm.TwoParticleAverageSite(*of, *weights)
            elif normal:
                yield particle, openmm.OutOfPlaneSite(*of, *weights[1:], normal)
            else:
                yield particle, openmm.ThreeParticleAverageSite(*of, *weights)


def _refuse_far(system: System, pair: Any) -> None:
    """Refuse scaled pairs that the cutoff or a switch reaches, because OpenMM computes such pairs as if there were
    none."""
    assert system.topology is not None
    pairs, factors = system.topology.scaled
    pairs = pairs[factors != 0]
    end = pair.cutoff if pair.switch_start is None else pair.switch_start
    apart = np.sqrt((system.box.minimum_image(np.diff(system.state.positions[pairs], axis=1)[:, 0]) ** 2).sum(axis=1))
    for k in np.flatnonzero(apart > end)[:1]:
        raise InputError(
            f"to_openmm: lennard-jones: the scaled pair {pairs[k].tolist()} is {apart[k]:.4g} nm apart, beyond "
            f"{end:.4g} nm, and OpenMM has no cutoff for such pairs"
        )


def _cmap(force: Cmap) -> Any:
    made = openmm.CMAPTorsionForce()
    for rows in force.maps:
        made.addMap(len(rows), np.transpose(rows).ravel().tolist())
    for particles, k in zip(
        force.particles.tolist(), np.broadcast_to(force.map, len(force.chains)).tolist(), strict=True
    ):
        made.addTorsion(k, *particles)
    return made


def _nonbonded(system: System) -> Any:
    """The NonbondedForce of the Lennard-Jones force, the charges and the listed pairs."""
    pair: Any = next((force for force in system.forces if isinstance(force, LennardJones)), None)
    coulomb = coulomb_of(system)
    made = openmm.NonbondedForce()
    charges = np.zeros(len(system)) if coulomb is None or system.charges is None else system.charges
    laws = [(1.0, 0.0)] * len(system.species)
    if pair is not None:
        laws = [(law.sigma, law.epsilon) for law in (pair.pair_law(name, name) for name in system.species)]
    for charge, kind in zip(charges.tolist(), system.species_index.tolist(), strict=True):
        made.addParticle(charge, *laws[kind])
    _set_method(made, system, pair, coulomb)
    made.setUseDispersionCorrection(bool(pair is not None and pair.tail))
    if pair is not None and pair.switch_start is not None:
        made.setUseSwitchingFunction(True)
        made.setSwitchingDistance(pair.switch_start)
    terms: dict[tuple[int, int], tuple[float, float, float]] = {}
    if system.topology is not None:
        if pair is not None:
            _refuse_far(system, pair)
        kinds = system.species_index
        for (i, j), factor in zip(*(part.tolist() for part in system.topology.scaled), strict=True):
            (first, one), (second, other) = laws[kinds[i]], laws[kinds[j]]
            depth = factor * float(np.sqrt(one * other))
            terms[i, j] = factor * float(charges[i] * charges[j]), 0.5 * (first + second), depth
    for force in system.forces:
        if isinstance(force, ListedPairs):
            values = (np.broadcast_to(given, len(force.pairs)).tolist() for given in
                      (force.charges, force.sigma, force.epsilon))  # fmt: skip
            for (i, j), charge, sigma, well in zip(force.pairs, *values, strict=True):
                key = min(i, j), max(i, j)
                alone = pair is None and coulomb is None and key not in terms
                if not alone and (key not in terms or terms[key][0] or terms[key][2]):
                    raise InputError(
                        f"to_openmm: listed-pairs: pair {[i, j]} is not left out of the other pair forces, and OpenMM "
                        "has one term for each pair"
                    )
                terms[key] = charge, sigma, well
    for (i, j), term in terms.items():
        made.addException(i, j, *term)
    made.setExceptionsUsePeriodicBoundaryConditions(system.box.periodic)
    return made


def _set_method(made: Any, system: System, pair: Any, coulomb: Any) -> None:
    """Choose the method of a NonbondedForce, with its cutoff and accuracy."""
    ends = set() if pair is None else {float(pair.cutoff)}
    method = "NoCutoff"
    if coulomb is None and pair is not None:
        method = "CutoffPeriodic" if system.box.periodic else "CutoffNonPeriodic" if pair.cutoff < FAR else "NoCutoff"
    elif coulomb is not None and coulomb.method != "direct":
        split = coulomb.split(system)
        ends.add(float(split.cutoff))
        if coulomb.method == "reaction-field":
            method = "CutoffPeriodic" if system.box.periodic else "CutoffNonPeriodic"
            made.setReactionFieldDielectric(coulomb.surroundings or CONDUCTOR)
        else:
            method = "PME" if split.mesh else "Ewald"
            made.setEwaldErrorTolerance(coulomb.accuracy)
            if coulomb.alpha and coulomb.mesh:
                made.setPMEParameters(coulomb.alpha, *coulomb.mesh)
    if method != "NoCutoff" and len(ends) > 1:
        raise InputError(f"to_openmm: cutoffs {' and '.join(f'{end:g}' for end in sorted(ends))}: OpenMM has one")
    if method == "NoCutoff" and pair is not None and pair.cutoff < FAR:
        raise InputError("to_openmm: lennard-jones has a cutoff and coulomb none; OpenMM has one cutoff for both")
    made.setNonbondedMethod(METHODS.index(method))
    if method != "NoCutoff":
        made.setCutoffDistance(ends.pop())


def _topology(system: System) -> Any:
    """OpenMM's Topology: a residue for neighbouring particles of a molecule, elements by the species, and the bonds."""
    made = app.Topology()
    chain = made.addChain()
    bonds = np.zeros((0, 2), np.int64) if system.topology is None else system.topology.bonds
    residue, last = None, -1
    atoms = []
    for molecule, kind in zip(molecules_of(bonds, len(system)).tolist(), system.species_index.tolist(), strict=True):
        if molecule != last:
            residue, last = made.addResidue("MOL", chain), molecule
        name = system.species[kind]
        atoms.append(made.addAtom(name, element_of(name), residue))
    for i, j in bonds.tolist():
        made.addBond(atoms[i], atoms[j])
    return made


def element_of(species: str) -> Any:
    """The element whose symbol begins a species such as "C1"; None if there is none."""
    found = SYMBOL.match(species)
    try:
        return app.Element.getBySymbol(found[0]) if found else None
    except KeyError:
        return None
