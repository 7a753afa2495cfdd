"""A System of an input of LAMMPS, or of a data file with its coefficients."""

from __future__ import annotations

import math
import os
import re
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kickdrift.bridges.lammps.fixes import Asked, asked_of
from kickdrift.bridges.lammps.pairs import Charges, Types, elements_of, pairs_of
from kickdrift.bridges.lammps.reading import Read, read
from kickdrift.bridges.lammps.script import Script, data_script, script_of
from kickdrift.bridges.lammps.terms import molecules_of
from kickdrift.disk.files import opened
from kickdrift.disk.foreign import is_lammps_data, is_lammps_input
from kickdrift.errors import InputError
from kickdrift.model.box.box import Box
from kickdrift.model.molecules.constraint import Constraint
from kickdrift.model.molecules.relatives import Relatives
from kickdrift.model.molecules.topology import Topology
from kickdrift.model.run_defaults import RunDefaults
from kickdrift.model.system import System
from kickdrift.model.units.unit_systems import UNIT_SYSTEMS
from kickdrift.text import choices

UNITS = ("lj", "metal", "real")  # unit systems whose numbers LAMMPS and kickdrift share
ATOM_STYLES = ("atomic", "charge", "bond", "angle", "molecular", "full")
_HEADING = re.compile(r"units = (\w+)")
_STYLE = re.compile(r"^[ \t]*Atoms[ \t]*#[ \t]*(\w+)", re.MULTILINE)
HEAD = 2**20  # bytes of a data file in which its styles are searched
SLACK = 1e-9
NEAR_MASS = 0.1  # MASSDELTA of LAMMPS' fix shake
REST = {"zero": 0, "morse": 2}  # place of the length or angle of rest among coefficients; 1 in other styles


def system_of(
    path: str | os.PathLike[str], units: str | None = None, commands: Sequence[str] = (), trusted: bool = False
) -> System:
    """Return the System; see `System.from_lammps`."""
    path = Path(path)
    with _named(path):
        script = _script(path, units, commands, trusted)
        return _system(read(script, path.resolve()), script, path.suffix[1:] if path.stem == "in" else path.stem)


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Context whose errors begin with the path."""
    try:
        yield
    except InputError as error:
        text = str(error)
        raise InputError(text if text.startswith(str(path)) else f"{path}: {text}") from None
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None


def _script(path: Path, units: str | None, commands: Sequence[str], trusted: bool) -> Script:
    """The commands of an input, or those that read a data file."""
    whole = path.resolve()
    if is_lammps_input(whole) or not is_lammps_data(whole):
        if units is not None or commands:
            raise InputError("units and commands are for data files; an input has its own")
        script = script_of(path, trusted)
        if not script.lines:
            raise InputError("has no commands that build a system; the file may be cut off")
        if not any(line.split()[0] == "units" for line in script.lines):
            raise InputError(f"states no units; begin it with units {choices(UNITS)}")
        return script
    with opened(whole) as file:
        head = file.read(HEAD).decode("utf-8", "replace")
    found = _HEADING.search(head.partition("\n")[0])
    units = units or (found[1] if found else None)
    if units is None:
        raise InputError(f"a data file states no units; give units, one of {choices(UNITS)}")
    given = list(commands)
    if not any(line.split()[:1] == ["pair_style"] for line in given):
        raise InputError(
            "a data file has no pair style; give commands, such as ['pair_style lj/cut 2.5'], or ['pair_style none']"
        )
    style = _STYLE.search(head)
    named = next((line.split()[1] for line in given if line.split()[0] == "atom_style"), style and style[1])
    if named is None:
        raise InputError("a data file without '# style' after Atoms needs a command such as 'atom_style full'")
    return data_script(whole, units, [line for line in given if line.split()[0] != "atom_style"], named)


def _system(found: Read, script: Script, name: str) -> System:
    _refuse(found)
    arrays, units = found.arrays, UNIT_SYSTEMS[found.told["units"]]
    kinds = arrays["type"].astype(np.int64)
    types = _types(found, kinds)
    box, x = _placed(found)
    charges = arrays.get("q")
    charges = charges if charges is not None and charges.any() else None
    asked = asked_of(found)
    number = {int(each): k for k, each in enumerate(arrays["id"])}
    masses = arrays["rmass"] if "rmass" in arrays else arrays["mass"][kinds]
    bonds = [(which, number[i], number[j]) for which, i, j in arrays.get("bonds", np.zeros((0, 3), int)).tolist()]
    _take_masses(asked, bonds, masses)
    molecules, ends = molecules_of(found, number, asked.rigid)
    species = [types.species[each] for each in kinds.tolist()]
    lists, bonded = molecules.lists(species)
    pairs = pairs_of(found, types, kinds, Charges(charges, box.volume), sorted({_pair(i, j) for _, i, j in bonds}))
    relatives: dict[str, Any] = {"factors": pairs.factors}
    if len(molecules.bonds.items) > len({_pair(i, j) for _, i, j in bonds}):  # springs across angles bind no relatives
        relatives = _exclusions(pairs.factors, bonds)
    topology = Topology(**lists, **relatives) if lists else None
    _say(asked)
    return System(
        x, arrays["v"], masses, box if box.periodic else None, [*pairs.forces, *ends, *bonded], units, species, name,
        RunDefaults(**asked.run, steps=script.steps),
        dimensions=int(found.told["dimensions"]), topology=topology, charges=charges,
        constraints=_constraints(found, number, asked),
    )  # fmt: skip


def _refuse(found: Read) -> None:
    """Refuse what kickdrift lacks: units, atom styles, and left out pairs."""
    if not found.all("pair_style"):
        raise InputError("has no pair_style before its first run; write 'pair_style none' for a system without one")
    units, style = found.told["units"], found.told["atom_style"]
    if units not in UNITS:
        raise InputError(f"units {units}: expected {choices(UNITS)}, whose numbers kickdrift shares")
    if style.removesuffix("/kk") not in ATOM_STYLES:
        raise InputError(f"atom_style {style}: has no counterpart in kickdrift; it has {choices(ATOM_STYLES)}")
    for words in found.all("neigh_modify"):
        if "exclude" in words:
            raise InputError(
                "neigh_modify exclude: has no counterpart in kickdrift; it leaves out pairs by bonds alone"
            )
    if found.all("delete_bonds"):
        raise InputError("delete_bonds: has no counterpart in kickdrift; leave the bonds out of the data file")
    if (run := found.last("run_style")) and run[0] != "verlet":
        raise InputError(f"run_style {run[0]}: kickdrift takes several steps by groups of forces; remove it here")


def _types(found: Read, kinds: NDArray[np.int64]) -> Types:
    """The species of each type with particles: its element or label, with its number where types share one."""
    count = max(int(kinds.max()), len(found.arrays["mass"]) - 1 if "mass" in found.arrays else 0)
    given = elements_of(found, count) or _labels(found.told["coefficients"], count)
    names = given or [str(k) for k in range(1, count + 1)]
    shared = {name for name in names if names.count(name) > 1}
    used = dict.fromkeys(kinds.tolist())  # in the order of the System's species
    return Types({k: names[k - 1] + (f"-{k}" if names[k - 1] in shared else "") for k in used}, count)


def _labels(text: str, count: int) -> list[str]:
    """Labels of the types, from LAMMPS' own data file; none if there are none."""
    begin = re.search(r"^Atom Type Labels\n\n((?:\d+ \S+\n)+)", text, re.MULTILINE)
    if begin is None:
        return []
    found = dict(line.split() for line in begin[1].splitlines())
    return [found.get(str(k), str(k)) for k in range(1, count + 1)]


def _placed(found: Read) -> tuple[Box, NDArray[np.float64]]:
    """The box with its corner at the origin, and the particles' places across all images."""
    told, x = found.told, found.arrays["x"]
    low, high = np.array(told["boxlo"]), np.array(told["boxhi"])
    matrix = np.diag(high - low)
    matrix[1, 0], matrix[2, 0], matrix[2, 1] = (told[key] for key in ("xy", "xz", "yz"))
    periodic = [bool(each) for each in told["periodicity"]]
    if int(told["dimensions"]) == 2:
        periodic[2] = False
        matrix[2, :2] = 0.0
        low[2] = 0.0
    if not any(periodic):
        return Box(None), x - low
    packed = found.arrays["image"].astype(np.int64)
    bits = 10 if found.arrays["image"].dtype.itemsize == 4 else 21
    half = 1 << (bits - 1)
    images = np.column_stack([(packed >> (k * bits)) % (1 << bits) - half for k in range(3)])
    images[:, ~np.array(periodic)] = 0
    unwrapped = x - low + images @ matrix
    if np.tril(matrix, -1).any():
        box, turn = Box.from_vectors(matrix, periodic)
        assert np.allclose(turn, np.eye(3), atol=SLACK)  # LAMMPS' edges are in this form
        return box, unwrapped
    return Box(matrix=matrix, periodic=periodic), unwrapped


def _take_masses(asked: Asked, bonds: list[tuple[int, int, int]], masses: NDArray[np.float64]) -> None:
    """Add the types of bonds to a particle of a mass that a fix names to those that are rigid."""
    for mass in asked.masses:
        near = np.abs(masses - mass) <= NEAR_MASS
        light = {which for which, i, j in bonds if near[i] or near[j]}
        for which, i, j in bonds:
            if which in light and not (near[i] or near[j]):
                raise InputError(
                    f"fix shake: m {mass:g}: bonds of type {which} join particles with and without this mass, and "
                    "kickdrift takes rigid bonds by types"
                )
        asked.rigid["bonds"].update(light)


def _exclusions(factors: Any, bonds: list[tuple[int, int, int]]) -> dict[str, Any]:
    """The relatives by bonds as pairs that the topology leaves out."""
    out: list[list[int]] = []
    every = Relatives.of(np.array([(i, j) for _, i, j in bonds]))
    for factor, relatives in zip(factors or (1.0, 1.0, 1.0), every, strict=True):
        if factor not in (0.0, 1.0):
            raise InputError(
                f"special_bonds: the factor {factor:g} beside angle_style charmm with Urey-Bradley terms has no "
                "counterpart in kickdrift, which then leaves pairs out or takes them whole"
            )
        out += [] if factor else relatives.tolist()
    return {"exclusions": out}


def _constraints(found: Read, number: dict[int, int], asked: Asked) -> list[Constraint] | None:
    """Rigid bonds with the lengths of their types, and rigid angles by the distance of their ends."""
    if not asked.rigid["bonds"]:
        return None
    lengths = {
        row.types[0]: row.numbers()[REST.get(row.style, 1)]
        for row in found.rows("Bond")
        if row.types[0] in asked.rigid["bonds"]
    }
    rests = {
        row.types[0]: row.numbers()[REST.get(row.style, 1)]
        for row in found.rows("Angle")
        if row.types[0] in asked.rigid["angles"]
    }
    pairs: dict[tuple[int, int], float] = {}
    for which, *ids in found.arrays["bonds"].tolist():
        if which in asked.rigid["bonds"]:
            pairs[_pair(*(number[each] for each in ids))] = lengths[which]
    for which, *ids in found.arrays["angles"].tolist() if asked.rigid["angles"] else ():
        i, middle, k = (number[each] for each in ids)
        sides = [pairs[pair] for pair in (_pair(i, middle), _pair(middle, k)) if pair in pairs]
        if which in asked.rigid["angles"] and len(sides) == 2:
            a, b = sides
            pairs[_pair(i, k)] = math.sqrt(a * a + b * b - 2.0 * a * b * math.cos(math.radians(rests[which])))
    return [Constraint(pairs=list(pairs), distance=list(pairs.values()))]


def _pair(i: int, j: int) -> tuple[int, int]:
    return min(i, j), max(i, j)


def _say(asked: Asked) -> None:
    if asked.left:
        warnings.warn(f"left out: {', '.join(asked.left)}", UserWarning, stacklevel=4)
