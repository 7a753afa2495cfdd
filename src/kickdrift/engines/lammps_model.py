"""A System in LAMMPS' terms, and the commands that make it there."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.bridges.bonded_laws import LAWS
from kickdrift.engines.fields import PositionRestraint
from kickdrift.engines.forces import split, strange
from kickdrift.engines.job import Job
from kickdrift.engines.rigid import rigid_items
from kickdrift.engines.special import Special, special_of
from kickdrift.engines.tables import POINTS, PairTable, written
from kickdrift.forces import PeriodicDihedral, PeriodicImproper
from kickdrift.forces.external.lammps_data import DataFile
from kickdrift.model.box.box import Box
from kickdrift.model.molecules.relatives import Ids, measured
from kickdrift.model.molecules.topology import SIZES
from kickdrift.model.state import Floats
from kickdrift.model.system import System

BATH = "bath"  # name of the fix whose scalar is minus the heat so far
_NVE = "fix move all nve"
FIXES = {
    "velocity-verlet": (_NVE,),
    "baoab": (_NVE, "fix bath all langevin {thermal!r} {thermal!r} {damping!r} {seed} tally yes"),
    "csvr": (_NVE, "fix bath all temp/csvr {thermal!r} {thermal!r} {tau!r} {seed}"),
    "nose-hoover": ("fix bath all nvt temp {thermal!r} {thermal!r} {tau!r} tchain {chain}",),
}


def fixes(job: Job, seed: int) -> tuple[str, ...]:
    """Commands of the fixes for a job. Temperatures are k_B T, as LAMMPS' k_B is 1 here."""
    options = job.options
    if not job.method.bath:
        return FIXES[job.method.name]
    given = {
        "thermal": float(job.system.units.boltzmann * options.temperature),
        "damping": 1.0 / options.friction if "friction" in job.method.tunable else None,
        "tau": options.get("tau"),
        "chain": options.get("chain"),
        "seed": seed,
    }
    found = tuple(line.format(**given) for line in FIXES[job.method.name])
    plane = job.method.drags and job.system.dimensions == 2
    return (*found, "fix plane all enforce2d") if plane else found


ROOM = 1.6  # particles of one item may come this much further apart than at the start


class Bonded(NamedTuple):
    """Bonded part of a model.

    Attributes
    ----------
    commands : styles, coefficients and factors
    lists : for each kind, rows of a type and particles, both from 1
    types : number of types of each kind
    reach : distance over which processes must know each other's particles
    """

    commands: tuple[str, ...]
    lists: dict[str, NDArray[np.int64]]
    types: dict[str, int]
    reach: float


def refusal(system: System, pair_force: Any) -> str | None:
    """Reason why LAMMPS cannot run the System's topology, or None."""
    if reason := strange(system, "LAMMPS"):
        return reason
    for force in split(system)[1]:
        for law in force.items(system)[1]:
            if LAWS[type(force)].coefficients(law) is None and not _as_dihedral(force, law):
                return f"force {force.name!r}: LAMMPS has no such parameters, {law._asdict()}"
    special = special_of(system, pair_force)
    return special if isinstance(special, str) else None


def bonded_of(system: System, pair_force: Any) -> Bonded | None:
    """Bonded part of the model of a System; None without a topology."""
    topology = system.topology
    if topology is None:
        return None
    commands: list[str] = []
    lists, types, longest = {}, {}, 0.0
    for kind, size in SIZES.items():
        word = kind[:-1]
        rows, styles = [np.zeros((0, size + 1), np.int64)], list[str]()
        lines: list[tuple[str, Any]] = []
        for items, which, told in _terms(system, kind):
            rows.append(np.column_stack([len(lines) + 1 + which, items + 1]))
            styles += [style for style, _ in told]
            lines += told
        every = getattr(topology, kind)
        for still, length in rigid_items(system, kind):
            styles.append("zero")
            rows.append(np.column_stack([np.full(len(still), len(lines) + 1), still + 1]))
            lines.append(("zero", (length,)))
        free = every[~np.isin(np.arange(len(every)), _listed(every, rows))] + 1
        if kind == "bonds" and len(free):  # they count for the factors of pairs
            styles.append("zero")
            rows.append(np.column_stack([np.full(len(free), len(lines) + 1), free]))
            lines.append(("zero", ()))
        if not lines:
            continue
        hybrid = len(set(styles)) > 1
        commands.append(f"{word}_style {'hybrid ' if hybrid else ''}{' '.join(dict.fromkeys(styles))}")
        for number, (style, values) in enumerate(lines, 1):
            text = " ".join(map(repr, values or ()))
            commands.append(f"{word}_coeff {number} {f'{style} ' if hybrid else ''}{text}")
        lists[kind], types[kind] = np.concatenate(rows), len(lines)
        for force in (each for each in split(system)[1] if type(each).__name__ == "Fene"):
            longest = max(longest, *(float(law.length) for law in force.items(system)[1]))
        bonds = np.concatenate([every[:, k : k + 2] for k in range(size - 1)])
        longest = max(longest, float(measured(system.box, system.state.phase[0], bonds, "bonds").max(initial=0.0)))
    special = special_of(system, pair_force)
    assert isinstance(special, Special)
    one, other = (" ".join(map(repr, each)) for each in special)
    scaled = f"lj {one} coul {other}" if one != other else f"{'lj' if system.charges is None else 'lj/coul'} {one}"
    commands.insert(0, f"special_bonds {scaled}")
    most = max((SIZES[kind] for kind in lists), default=2)
    return Bonded(tuple(commands), lists, types, ROOM * (most - 1) * longest)


def _as_dihedral(force: Any, law: Any) -> tuple[float | int, ...] | None:
    """Coefficients of a periodic improper as a dihedral, for phases that LAMMPS' impropers lack."""
    return LAWS[PeriodicDihedral].coefficients(law) if type(force) is PeriodicImproper else None


def _terms(system: System, kind: str) -> Iterator[tuple[Ids, Ids, list[tuple[str, Any]]]]:
    """Yield, for each force that LAMMPS has among this kind, its items (m, 2 to 4), the law of each (m,), and style and
    coefficients of the laws."""
    for force in split(system)[1]:
        items, laws, which = force.items(system)
        style, coefficients = LAWS[type(force)].style, [LAWS[type(force)].coefficients(law) for law in laws]
        own = np.array([each is not None for each in coefficients], bool)
        if force.kind == "impropers" and kind == "dihedrals":
            own = ~own
            style, coefficients = LAWS[PeriodicDihedral].style, [_as_dihedral(force, law) for law in laws]
        elif force.kind != kind:
            continue
        if own.any():
            place = np.cumsum(own) - 1
            kept = own[which]
            told = [(style, each) for each, mine in zip(coefficients, own, strict=True) if mine]
            yield items[kept], place[which[kept]], told


def _listed(every: NDArray[np.int64], rows: Sequence[NDArray[np.int64]]) -> NDArray[np.int64]:
    """Numbers of the items that some force has."""
    number = {tuple(item): k for k, item in enumerate((every + 1).tolist())}
    found = (number.get(tuple(row[1:])) for part in rows for row in part.tolist())  # a rigid angle may be in no list
    return np.array([k for k in found if k is not None], np.int64)


HIGHEST = 7  # order of LAMMPS' pppm
PLAIN = "lj/cut"
SKIN = 0.3  # in sigma, LAMMPS' own default: reach of its lists beyond the cutoff, without effect on the forces
MANY_BODY_SKIN = 1.0  # in angstroms, likewise


class Ewald(NamedTuple):
    """Charges (n,) whose products are energies times lengths, and the parameters of Ewald's sum or of a mesh."""

    charges: Floats
    cutoff: float
    alpha: float
    waves: tuple[int, ...]  # most along each axis, or the points of the mesh
    order: int = 0  # of a mesh
    accuracy: float = 1e-6  # in LAMMPS' measure


class Model(NamedTuple):
    """Simulated model, in LAMMPS' terms.

    Attributes
    ----------
    types : (n,) int32, from 1; particles of one type share mass and parameters
    masses : by type
    pairs : (type, type, coefficients, cutoff) for each pair of types; empty for a many-body force and charges alone
    shifted, tail : options of pair_modify
    dimensions : 2 or 3
    fixes : commands of the fixes that take a step
    bonded : bonds, angles and dihedrals, if any
    ewald : charges, if any
    walls : commands of each wall
    held : position restraints
    tables : energies and forces of each pair of types, in place of a law
    linear : whether the energy is less its tangent at the cutoff, which makes the force zero there
    many_body : of a many-body force, the pair style, the text of its file, and the species of each type
    law : pair style of ``pairs``, such as "lj/cut"
    own : commands of another pair style, in place of all these
    """

    box: Box
    types: NDArray[np.int32]
    masses: tuple[float, ...]
    pairs: tuple[tuple[float, ...], ...]
    cutoff: float
    shifted: bool
    tail: bool
    dt: float
    dimensions: int = 3
    fixes: tuple[str, ...] = FIXES["velocity-verlet"]
    bonded: Bonded | None = None
    many_body: tuple[str, str, tuple[str, ...]] | None = None
    ewald: Ewald | None = None
    walls: tuple[tuple[str, ...], ...] = ()
    held: tuple[PositionRestraint, ...] = ()
    linear: bool = False
    tables: tuple[PairTable, ...] = ()
    law: str = PLAIN
    own: tuple[str, ...] = ()

    @property
    def longest(self) -> float:
        """Largest sigma; of charges alone and of other laws, a third of the cutoff."""
        sigmas = [pair[3] for pair in self.pairs] if self.law == PLAIN else []
        return max(sigmas, default=self.cutoff / 3.0)

    @property
    def skin(self) -> float:
        """Reach of LAMMPS' lists beyond the cutoff."""
        return MANY_BODY_SKIN if self.many_body else SKIN * self.longest


def model_style(model: Model) -> str:
    """LAMMPS' atom style."""
    if model.bonded:
        return "full" if model.ewald else "molecular"
    return "charge" if model.ewald else "atomic"


class Space(NamedTuple):
    """LAMMPS' box: lowest and highest place along each axis (3, 2), and the letters of its boundaries."""

    edges: Floats
    boundary: str

    @classmethod
    def of(cls, model: Model, x: Floats) -> "Space":
        """The box for particles at x (n, 3), inside the System's box."""
        axes = np.array(model.box.periodic_axes)
        thin = ~axes & (np.ptp(x, axis=0) < model.cutoff)  # LAMMPS needs room for a cell of its list
        margin = np.where(thin, model.cutoff, model.skin)
        low = np.where(axes, 0.0, x.min(axis=0) - margin)
        high = np.where(axes, np.diag(model.box.matrix), x.max(axis=0) + margin)
        boundary = np.where(axes, "p", np.where(thin, "m", "s"))
        if model.dimensions == 2:  # LAMMPS wants a thin box around z = 0 that is periodic along z
            low[2], high[2], boundary[2] = -0.5, 0.5, "p"
        return cls(np.column_stack([low, high]), " ".join(boundary))


def data_of(model: Model, edges: Floats, x: Floats, v: Floats, **more: Any) -> DataFile:
    """LAMMPS' data file of particles at x (n, 3) with velocities v (n, 3), and of their lists."""
    given: dict[str, Any] = {"heading": "kickdrift", "labels": (), "molecules": np.ones(len(x), np.int64)} | more
    bonded = model.bonded or Bonded((), {}, {}, 0.0)
    return DataFile(
        bounds=edges, tilts=model.box.tilts, masses=model.masses, ids=np.arange(1, len(x) + 1),
        types=model.types.astype(np.int64),
        positions=x, velocities=v, lists=bonded.lists, counts=bonded.types, names={},
        charges=model.ewald and model.ewald.charges, **given,
    )  # fmt: skip


def acting(model: Model, place: Path, said: Callable[[Path], str]) -> list[str]:
    """Commands of the forces without those along bonds. The names of files of potentials and tables begin with
    ``place``; ``said`` is the name by which commands call such a file."""
    if model.own:
        return list(model.own)
    if model.many_body:
        style, text, species = model.many_body
        file = place.with_name(f"{place.name}.{style.replace('/', '.')}")
        file.write_text(text, encoding="utf-8")
        elements = "" if style == "eam" else " ".join(species)  # a file of one element names none
        return [f"pair_style {style}", f"pair_coeff * * {said(file)} {elements}"]
    if model.tables:
        commands = [f"pair_style table spline {POINTS}"]
        for table in model.tables:
            file = place.with_name(f"{place.name}.table.{table.types[0]}.{table.types[1]}")
            written(table, file)
            commands.append(f"pair_coeff {table.types[0]} {table.types[1]} {said(file)} pair")
        return commands
    style = f"{'lj/smooth/linear' if model.linear else model.law} {model.cutoff!r}"
    if model.ewald:
        style = f"{model.law}/coul/long {model.cutoff!r} {model.ewald.cutoff!r}"
    if not model.pairs:
        style = f"coul/long {model.cutoff!r}"
    yes = {True: "yes", False: "no"}
    commands = [
        f"pair_style {style}",
        f"pair_modify shift {yes[model.shifted]} tail {yes[model.tail]}",
        *("pair_coeff " + " ".join(map(repr, pair)) for pair in model.pairs),
        *([] if model.pairs else ["pair_coeff * *"]),
    ]
    if model.ewald:
        most, order = " ".join(map(str, model.ewald.waves)), min(model.ewald.order, HIGHEST)
        commands += [
            "pair_modify table 0",
            f"kspace_style {'pppm' if order else 'ewald'} {model.ewald.accuracy!r}",  # the next line chooses for LAMMPS
            f"kspace_modify gewald {model.ewald.alpha!r} "
            + (f"mesh {most} order {order}" if order else f"kmax/ewald {most}"),
        ]
    return commands


def bonded_commands(model: Model, read: str) -> list[str]:
    """Commands of the lists and their forces, around the one that reads the data file."""
    commands: Sequence[str] = model.bonded.commands if model.bonded else ()
    reach = max(model.bonded.reach if model.bonded else 0.0, model.cutoff + model.skin)
    return [
        *(line for line in commands if "_coeff" not in line),
        read,
        f"comm_modify cutoff {reach!r}",
        *(line for line in commands if "_coeff" in line),
    ]
