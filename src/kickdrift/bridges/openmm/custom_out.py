"""OpenMM's custom forces for formulas, and for bonded laws that no standard force of OpenMM has; units ``gromacs``."""

from __future__ import annotations

from itertools import product
from typing import Any

import openmm

from kickdrift.bridges.bonded_laws import LAWS
from kickdrift.errors import InputError
from kickdrift.forces import LennardJones
from kickdrift.forces.bonded.formula import ListedFormulas
from kickdrift.forces.formulas.expression import renamed
from kickdrift.forces.formulas.given import Formulas
from kickdrift.forces.pairs.formula import FormulaPair
from kickdrift.model.system import System

KINDS = {"bonds": "Bond", "angles": "Angle", "dihedrals": "Torsion", "impropers": "Torsion"}
TRUNCATIONS = ("cut", "shift", "potential-switch")
LENNARD_JONES = "4*epsilon*((sigma/r)^12-(sigma/r)^6)"


def listed(system: System, force: Any) -> Any:
    """The custom force of a formula of bonds, angles, dihedrals or impropers, or of a law in `LAWS`."""
    items, laws, which = force.items(system)
    if isinstance(force, ListedFormulas):
        assert system.topology is not None
        types = force.types
        names = [each for each in dict.fromkeys(system.topology.types(force.kind)) if types is None or each in types]
        used, energy = force.own_law.formula.parameters, _energy(force)
        given = [force.values_with((types or {}).get(name, {})) for name in names]
        rows = [{key: values[key] for key in used} for values in given]
    else:
        energy, rows = LAWS[type(force)].energy, [LAWS[type(force)].keys(law) for law in laws]
    word = KINDS[force.kind]
    made = getattr(openmm, f"Custom{word}Force")(energy)
    for key in rows[0]:
        getattr(made, f"addPer{word}Parameter")(key)
    for item, law in zip(items.tolist(), which.tolist(), strict=True):
        getattr(made, f"add{word}")(*item, list(rows[law].values()))
    return made


def _energy(force: Formulas, end: float | None = None) -> str:
    """The formula in kJ/mol, of r in nm; less its value at the distance ``end``, if one is given."""
    r = "theta" if force.variable == "theta" else "r"
    scale = "" if r == "theta" or force.length_unit == 1.0 else f"*{1.0 / force.length_unit!r}"
    main, *rest = (part for part in force.formula.split(";") if part.strip())
    names = force.own_law.formula.given
    here = {r: f"({r}{scale})"} if scale else {}
    there = {name: f"{name}_at_end" for name in names} | {r: f"({end!r}{scale})"}
    whole = renamed(main, here) if end is None else f"({renamed(main, here)})-({renamed(main, there)})"
    plain = force.energy_unit == 1.0 and end is None
    parts = [whole if plain else f"{force.energy_unit!r}*({whole})", *(renamed(part, here) for part in rest)]
    return "; ".join([*parts, *(renamed(part, there) for part in rest if end is not None)])


def in_formulas(system: System) -> System:
    """The System with formulas in place of Lennard-Jones forces that no NonbondedForce has: with tables of pairs, with
    truncation "shift", or several."""
    own = [force for force in system.forces if isinstance(force, LennardJones)]
    names = system.species

    def formula(force: Any) -> Any:
        if force not in own or not (len(own) > 1 or force.pairs or force.truncation == "shift"):
            return force
        if any(set(each) - {"epsilon", "sigma"} for each in (force.pairs or {}).values()):
            raise InputError("to_openmm: lennard-jones: OpenMM has one cutoff for all pairs of species")
        pairs = {
            (a, names[j]): {"parameters": force.pair_law(a, names[j])._asdict()}
            for i, a in enumerate(names)
            for j in range(i + 1)
        }
        end = {key: getattr(force, key) for key in ("cutoff", "truncation", "switch_start", "tail")}
        return FormulaPair(LENNARD_JONES, pairs=pairs, **end)

    return system.with_forces(*map(formula, system.forces))


def _scaled(system: System) -> list[tuple[list[int], float]]:
    """Pairs that pair forces leave out or scale, with their factors."""
    topology = system.topology
    return [] if topology is None else list(zip(*(part.tolist() for part in topology.scaled), strict=True))


def paired(system: System, force: FormulaPair, far: float) -> Any:
    """The CustomNonbondedForce of a formula of pairs. In open space, a cutoff of ``far`` or more is none."""
    ends = force.ends(system.species)
    end = next(iter(ends))
    if len(ends) > 1 or end.truncation not in TRUNCATIONS:
        raise InputError(
            f"to_openmm: {force.name}: OpenMM has one cutoff for all pairs of species, with truncation "
            f"{', '.join(TRUNCATIONS)}"
        )
    values = {(b, a): force.pair_values(a, b) for b, a in product(system.species, repeat=2)}
    text = _energy(force, end.cutoff if end.truncation == "shift" else None)
    own: dict[str, list[float]] = {}
    made = openmm.CustomNonbondedForce("")
    for key in force.own_law.formula.parameters:
        column = [each[key] for each in values.values()]
        if len(set(column)) == 1:
            text += f"; {key}={column[0]!r}"  # forces of OpenMM share global parameters
        elif key[-1] in "12" and not force.pairs:
            own[key[:-1]] = [values[name, name][key] for name in system.species]
        else:
            count = len(system.species)
            made.addTabulatedFunction(f"{key}_of", openmm.Discrete2DFunction(count, count, column))
            text += f"; {key}={key}_of(kind1, kind2)"
            own["kind"] = [float(k) for k in range(count)]
    made.setEnergyFunction(text)
    for key in own:
        made.addPerParticleParameter(key)
    for kind in system.species_index.tolist():
        made.addParticle([column[kind] for column in own.values()])
    made.setNonbondedMethod(
        made.CutoffPeriodic if system.box.periodic else made.CutoffNonPeriodic if end.cutoff < far else made.NoCutoff
    )
    made.setCutoffDistance(end.cutoff)
    if end.switch_start is not None:
        made.setUseSwitchingFunction(True)
        made.setSwitchingDistance(end.switch_start)
    made.setUseLongRangeCorrection(bool(force.tail))
    for (i, j), factor in _scaled(system):
        if factor:
            raise InputError(
                f"to_openmm: {force.name}: pair {[i, j]} is scaled, and OpenMM's custom forces leave pairs out or "
                "take them whole"
            )
        made.addExclusion(i, j)
    return made
