"""Many-body forces in LAMMPS and ASE: the text of a file of parameters, which both programs read."""

from __future__ import annotations

from typing import Any

from kickdrift.engines.bonded import split
from kickdrift.forces.many_body.base import ManyBodyForce, TabledForce
from kickdrift.forces.many_body.embedded_atom import EmbeddedAtom
from kickdrift.forces.many_body.entries import FORMS, potential_file
from kickdrift.forces.many_body.stillinger_weber import StillingerWeber
from kickdrift.forces.many_body.tersoff import Tersoff
from kickdrift.model.system import System

STYLES: dict[type, str] = {StillingerWeber: "sw", Tersoff: "tersoff"}


def many_body(system: System, molecules: bool = False) -> bool:
    """Tell whether the system's only force is one of kickdrift's many-body forces.

    With ``molecules``, bonded forces may come beside it."""
    forces = split(system)[0] if molecules else system.forces
    return len(forces) == 1 and type(forces[0]) in (EmbeddedAtom, *STYLES)


def style_of(force: ManyBodyForce) -> str:
    """LAMMPS' pair style."""
    if isinstance(force, EmbeddedAtom):
        return "eam/alloy" if force.file.endswith(FORMS[0]) else "eam/fs"
    return STYLES[type(force)]


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
