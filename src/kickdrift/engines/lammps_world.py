"""LAMMPS in one process, alone or as one of several that act together: its library, a model in its terms, its commands.

Particles are passed wrapped into the box, with their counts of box crossings.
"""

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.bridges.lammps_data import DataFile
from kickdrift.engines.fields import PositionRestraint
from kickdrift.engines.forces import LAWS, split, strange
from kickdrift.engines.job import Job
from kickdrift.engines.tables import POINTS, PairTable, written
from kickdrift.forces.external.lammps_library import lammps_class
from kickdrift.model.box.box import Box
from kickdrift.model.molecules.relatives import measured
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


def refusal(system: System) -> str | None:
    """Reason why LAMMPS cannot run the System's topology, or None."""
    if reason := strange(system, "LAMMPS"):
        return reason
    if system.topology is not None and len(system.topology.exclusions):
        return "exclusions: LAMMPS leaves out only particles up to three bonds apart (topology.factors)"
    for force in split(system)[1]:
        for law in force.items(system)[1]:
            if LAWS[type(force)].coefficients(law) is None:
                return f"force {force.name!r}: LAMMPS has no such parameters, {law._asdict()}"
    return None


def bonded_of(system: System) -> Bonded | None:
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
        for force in (each for each in split(system)[1] if each.kind == kind):
            items, laws, which = force.items(system)
            terms = LAWS[type(force)]
            styles.append(terms.style)
            rows.append(np.column_stack([len(lines) + 1 + which, items + 1]))
            lines += [(terms.style, terms.coefficients(law)) for law in laws]
        every = getattr(topology, kind)
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
    factors = " ".join(map(repr, topology.factors or (1.0, 1.0, 1.0)))
    commands.insert(0, f"special_bonds {'lj' if system.charges is None else 'lj/coul'} {factors}")
    most = max((SIZES[kind] for kind in lists), default=2)
    return Bonded(tuple(commands), lists, types, ROOM * (most - 1) * longest)


def _listed(every: NDArray[np.int64], rows: Sequence[NDArray[np.int64]]) -> NDArray[np.int64]:
    """Numbers of the items that some force has."""
    number = {tuple(item): k for k, item in enumerate((every + 1).tolist())}
    return np.array([number[tuple(row[1:])] for part in rows for row in part.tolist()], np.int64)


def read_particles(lmp: Any, model: Any, edges: Sequence[float], x: Floats, v: Floats) -> None:
    """Make the box, the particles and their lists in LAMMPS, through a data file in a temporary folder."""
    bonded = model.bonded
    data = DataFile(
        "kickdrift", np.reshape(edges, (3, 2)), model.box.tilts, model.masses, (), np.arange(1, len(x) + 1),
        model.types, np.ones(len(x), np.int64), x, v, bonded.lists, bonded.types, {},
        charges=model.ewald and model.ewald.charges,
    )  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "start.data"
        with path.open("w", encoding="ascii") as file:
            file.writelines(data.lines())
        lmp.command(f"read_data {path}")


HIGHEST = 7  # order of LAMMPS' pppm
AT_ONCE = 100_000  # particles in one Python list
SKIN = 0.3  # in sigma, LAMMPS' own default: reach of its lists beyond the cutoff, without effect on the forces
MANY_BODY_SKIN = 1.0  # in angstroms, likewise


class Ewald(NamedTuple):
    """Charges (n,) whose products are energies times lengths, and the parameters of Ewald's sum or of a mesh."""

    charges: Floats
    cutoff: float
    alpha: float
    waves: tuple[int, ...]  # most along each axis, or the points of the mesh
    order: int = 0  # of a mesh


class Model(NamedTuple):
    """Simulated model, in LAMMPS' terms.

    Attributes
    ----------
    types : (n,) int32, from 1; particles of one type share mass and parameters
    masses : by type
    pairs : (type, type, epsilon, sigma, cutoff) for each pair of types; empty for a many-body force and charges alone
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
    """

    box: Box
    types: NDArray[np.int32]
    masses: tuple[float, ...]
    pairs: tuple[tuple[int, int, float, float, float], ...]
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

    @property
    def longest(self) -> float:
        """Largest sigma; of charges alone, a third of the cutoff."""
        return max((sigma for *_, sigma, _ in self.pairs), default=self.cutoff / 3.0)


def model_style(model: Model) -> str:
    """LAMMPS' atom style."""
    if model.bonded:
        return "full" if model.ewald else "molecular"
    return "charge" if model.ewald else "atomic"


class World:
    """LAMMPS instance. ``flags`` are command-line flags and choose the style of its force."""

    def __init__(self, flags: Sequence[str] = ("-sf", "opt")) -> None:
        self.lmp = lammps_class()(cmdargs=["-log", "none", "-screen", "none", "-nocite", *flags])

    @property
    def rank(self) -> int:
        return int(self.lmp.extract_setting("world_rank"))

    def reset(self, model: Model, x: Floats, v: Floats) -> None:
        """Start anew with particles at x (n, 3), inside the box, with velocities v (n, 3)."""
        self.model = model
        if self.lmp.get_natoms():
            self.lmp.command("clear")
        skin = MANY_BODY_SKIN if model.many_body else SKIN * model.longest
        box, axes = model.box, np.array(model.box.periodic_axes)
        thin = ~axes & (np.ptp(x, axis=0) < model.cutoff)  # LAMMPS needs room for a cell of its list
        margin = np.where(thin, model.cutoff, skin)
        low = np.where(axes, 0.0, x.min(axis=0) - margin)
        high = np.where(axes, np.diag(box.matrix), x.max(axis=0) + margin)
        boundary = np.where(axes, "p", np.where(thin, "m", "s"))
        if model.dimensions == 2:  # LAMMPS wants a thin box around z = 0 that is periodic along z
            low[2], high[2], boundary[2] = -0.5, 0.5, "p"
        edges = np.column_stack([low, high]).ravel().tolist()
        shape = " ".join(["prism" if box.tilts else "block", *map(repr, [*edges, *box.tilts])])
        yes = {True: "yes", False: "no"}
        self._commands(
            "units lj",  # no constants: the numbers are in any coherent system of units
            f"dimension {model.dimensions}",
            f"atom_style {model_style(model)}",
            f"boundary {' '.join(boundary)}",
            *(["atom_modify map array"] if model.ewald or model.held else []),  # by which numbers find their particles
        )
        if model.bonded:
            self._commands(*(line for line in model.bonded.commands if "_coeff" not in line))
            read_particles(self.lmp, model, edges, x, v)
            reach = max(model.bonded.reach, model.cutoff + skin)
            self._commands(
                f"comm_modify cutoff {reach!r}", *(line for line in model.bonded.commands if "_coeff" in line)
            )
        else:
            self._commands(f"region box {shape} units box", f"create_box {len(model.masses)} box")
        if model.many_body:
            self._many_body(*model.many_body)
        elif model.tables:
            self._tables(model.tables)
        else:
            style = f"lj/{'smooth/linear' if model.linear else 'cut'} {model.cutoff!r}"
            if model.ewald:
                style = f"lj/cut/coul/long {model.cutoff!r} {model.ewald.cutoff!r}"
            if not model.pairs:
                style = f"coul/long {model.cutoff!r}"
            self._commands(
                f"pair_style {style}",
                f"pair_modify shift {yes[model.shifted]} tail {yes[model.tail]}",
                *("pair_coeff " + " ".join(map(repr, pair)) for pair in model.pairs),
                *([] if model.pairs else ["pair_coeff * *"]),
            )
        if model.ewald:
            most, order = " ".join(map(str, model.ewald.waves)), min(model.ewald.order, HIGHEST)
            self._commands(
                "pair_modify table 0",
                f"kspace_style {'pppm' if order else 'ewald'} 1e-6",  # the next line replaces what LAMMPS would choose
                f"kspace_modify gewald {model.ewald.alpha!r} "
                + (f"mesh {most} order {order}" if order else f"kmax/ewald {most}"),
            )
        self._commands(
            *(f"mass {kind} {mass!r}" for kind, mass in enumerate(model.masses, 1)),  # after eam, which sets masses
            f"neighbor {skin!r} bin",
            "neigh_modify every 1 delay 0 check yes one 20000 page 400000",  # no pair is missed
            *model.fixes,
            f"timestep {model.dt!r}",
            "compute pull all pressure NULL virial",
            "thermo 1000000000",  # only at the end of each run
            "thermo_modify norm no lost error",
        )
        n = len(x)
        for at in range(0, 0 if model.bonded else n, AT_ONCE):
            part = slice(at, min(n, at + AT_ONCE))
            self.lmp.create_atoms(
                part.stop - at, list(range(at + 1, part.stop + 1)), model.types[part].tolist(),
                x[part].ravel().tolist(), v[part].ravel().tolist(),
            )  # fmt: skip
        if (made := int(self.lmp.get_natoms())) != n:
            raise RuntimeError(f"LAMMPS accepted {made} of {n} particles")
        if model.ewald:
            self.lmp.scatter_atoms("q", 1, 1, np.ctypeslib.as_ctypes(np.ascontiguousarray(model.ewald.charges)))
        self._commands(*(line for wall in model.walls for line in wall))
        self._hold(model)
        self.lmp.command("run 0 post no")

    def _hold(self, model: Model) -> None:
        """Make the springs of restraints, which begin at the positions of the particles at that time."""
        for k, (ids, stiffness, axes, places) in enumerate(model.held):
            start = self._gathered("x")
            there = start.copy()
            row = ids - 1
            there[row] = start[row] - model.box.minimum_image(start[row] - places)
            for at in range(0, len(ids), 1000):
                self.lmp.command(f"group held{k} id {' '.join(map(str, ids[at : at + 1000].tolist()))}")
            self.lmp.scatter_atoms("x", 1, 3, np.ctypeslib.as_ctypes(np.ascontiguousarray(there)))
            self._commands(f"fix held{k} held{k} spring/self {stiffness!r} {axes}", f"fix_modify held{k} energy yes")
            self.lmp.scatter_atoms("x", 1, 3, np.ctypeslib.as_ctypes(np.ascontiguousarray(start)))

    def _commands(self, *lines: str) -> None:
        for line in lines:
            self.lmp.command(line)

    def _many_body(self, style: str, text: str, species: Sequence[str]) -> None:
        """Give LAMMPS a many-body force, whose parameters it reads from a file."""
        self.lmp.command(f"pair_style {style}")
        with tempfile.TemporaryDirectory(prefix="kickdrift-lammps-") as folder:
            file = Path(folder) / "potential"
            file.write_text(text, encoding="utf-8")
            elements = "" if style == "eam" else " ".join(species)  # a file of one element names none
            self.lmp.command(f"pair_coeff * * {str(file)!r} {elements}")

    def _tables(self, tables: Sequence[PairTable]) -> None:
        """Give LAMMPS pair forces as tables, which it reads from files."""
        self.lmp.command(f"pair_style table spline {POINTS}")
        with tempfile.TemporaryDirectory(prefix="kickdrift-lammps-") as folder:
            for table in tables:
                file = Path(folder) / "table"
                written(table, file)
                self.lmp.command(f"pair_coeff {table.types[0]} {table.types[1]} {str(file)!r} pair")

    def run(self, steps: int) -> None:
        """Take steps without a new set-up, so that the lists do not depend on the division of a run."""
        self.lmp.command(f"run {steps} pre no post no")

    def kinetic_energy(self) -> float:
        """Kinetic energy of all particles. LAMMPS itself stops at NaN positions."""
        return float(self.lmp.get_thermo("ke"))

    def heat(self) -> float:
        """Energy that the heat bath has given."""
        return -float(self.lmp.extract_fix(BATH, 0, 0))

    def images(self) -> NDArray[np.int32]:
        """Counts of box crossings (n, 3), modulo 1024."""
        return self._gathered("image", integer=True)

    def state(self) -> tuple[Floats, Floats, NDArray[np.int32]]:
        """Positions inside the box (n, 3), velocities, and ``images``."""
        return self._gathered("x"), self._gathered("v"), self.images()

    def measure(self) -> tuple[Floats, float, float]:
        """Forces (n, 3), potential energy, and virial."""
        energy, pressure = (self.lmp.extract_compute(name, 0, 0) for name in ("thermo_pe", "pull"))
        virial = self.model.dimensions * float(pressure) * float(self.lmp.get_thermo("vol"))
        return self._gathered("f"), float(energy), virial

    def _gathered(self, name: str, integer: bool = False) -> Any:
        """Values of all particles in the order of their ids, on each process."""
        data = self.lmp.gather_atoms(name, 0 if integer else 1, 3)
        return np.ctypeslib.as_array(data).reshape(-1, 3).copy()

    def close(self) -> None:
        """Close this instance. MPI continues in the process."""
        self.lmp.close()
