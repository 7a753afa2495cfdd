"""Forces in the terms of other programs: which ones they take, and files of parameters."""

from collections.abc import Collection
from typing import Any

from kickdrift.bridges.bonded_laws import LAWS
from kickdrift.forces.bonded.law import BondedForce
from kickdrift.forces.charges.coulomb import Coulomb, coulomb_of
from kickdrift.forces.many_body.base import ManyBodyForce, TabledForce
from kickdrift.forces.many_body.embedded_atom import EmbeddedAtom
from kickdrift.forces.many_body.entries import potential_file
from kickdrift.forces.many_body.stillinger_weber import StillingerWeber
from kickdrift.forces.many_body.tersoff import Tersoff
from kickdrift.forces.pairs.lennard_jones import LennardJones
from kickdrift.model.system import System


def split(system: System) -> tuple[list[Any], list[BondedForce]]:
    """The System's forces that are not bonded, and its bonded forces."""
    bonded = [force for force in system.forces if isinstance(force, BondedForce)]
    return [force for force in system.forces if not isinstance(force, BondedForce)], bonded


def beside_charges(system: System) -> Any:
    """The System's force that is neither bonded nor between charges, or None."""
    return next((force for force in split(system)[0] if not isinstance(force, Coulomb)), None)


def strange(system: System, program: str) -> str | None:
    """Reason why a program has no such bonded forces, or None."""
    for force in split(system)[1]:
        if type(force) not in LAWS:
            return f"force {force.name!r}: {program} gets only the laws of bonds that ship"
    return None


def one_pair_law(
    system: System,
    truncations: Collection[str],
    takes: str,
    molecules: bool = False,
    charges: Collection[str] = (),
    laws: Collection[Any] = (LennardJones,),
) -> str | None:
    """Reason why the System's forces are not one of these pair ``laws`` with one of these truncations, or None.

    ``takes`` says which forces the program takes. With ``molecules``, bonded forces and exclusions may come beside the
    pair force. ``charges`` are methods of Coulomb's law, which may come beside the pair force or stand alone."""
    if not molecules and system.topology is not None and len(system.topology.scaled.pairs):
        return "topology: pairs that are left out or scaled are not possible"
    forces = split(system)[0] if molecules else list(system.forces)
    if charges and (coulomb := coulomb_of(system)) is not None:
        if coulomb.method not in charges:
            return f"coulomb: method {coulomb.method!r}: possible are {' and '.join(repr(each) for each in charges)}"
        forces = [force for force in forces if force is not coulomb]
        if not forces:
            return None
    if len(forces) != 1 or type(forces[0]) not in laws:
        names = " and ".join(repr(force.name) for force in system.forces)
        given = f"force{'s' * (len(system.forces) > 1)} {names}" if names else f"{system.name!r} has no force"
        return f"{given}: {takes}"
    pair_force: Any = forces[0]
    used = sorted({end.truncation for end in pair_force.ends(system.species)})
    for truncation in used:
        if truncation not in truncations:
            return f"truncation {truncation!r}: possible are {' and '.join(repr(each) for each in truncations)}"
    if len(used) > 1:
        return f"truncations {' and '.join(map(repr, used))}: only one for all pairs of species is possible"
    return None


def truncation_of(force: Any, system: System) -> str:
    """Truncation of all pairs of species, after ``one_pair_law``; "" for other forces."""
    return str(next(iter(force.ends(system.species))).truncation) if hasattr(force, "ends") else ""


def small_units(system: System) -> str | None:
    """Reason why lengths would be too small for a program with absolute tolerances, or None."""
    if system.units.name == "si":
        return "units 'si': the program's tolerances are absolute, and too long for metres; use metal, with angstroms"
    return None


STYLES = {
    ".sw": "sw",
    ".tersoff": "tersoff",
    ".tersoff.mod": "tersoff/mod",
    ".tersoff.modc": "tersoff/mod/c",
    ".tersoff.zbl": "tersoff/zbl",
}  # LAMMPS' styles by the form of the parameters


def many_body(system: System, molecules: bool = False) -> bool:
    """Tell whether the system's only force is one of kickdrift's many-body forces.

    With ``molecules``, bonded forces may come beside it."""
    forces = split(system)[0] if molecules else system.forces
    return len(forces) == 1 and type(forces[0]) in (EmbeddedAtom, StillingerWeber, Tersoff)


def style_of(force: ManyBodyForce) -> str:
    """LAMMPS' pair style."""
    if isinstance(force, EmbeddedAtom):
        return force.style
    assert isinstance(force, TabledForce)
    return STYLES[force.form]


def text_of(force: Any) -> str:
    """Text of a file of the force's parameters, without LAMMPS' note of units in its first line."""
    if isinstance(force, EmbeddedAtom):
        first, rest = potential_file(force.name, force.file).decode("utf-8", "replace").split("\n", 1)
        return f"written by kickdrift\n{rest}" if first else rest
    assert isinstance(force, TabledForce)
    lines = (
        " ".join([*triple.split("-"), *(repr(numbers[key]) for key in force.keys)])
        for triple, numbers in force.table.items()
    )
    return "\n".join(["# written by kickdrift", *lines, ""])
