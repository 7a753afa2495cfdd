"""LAMMPS: its pair laws, eam, sw or tersoff with fix nve and heat baths, in this process or several started by mpiexec.

LAMMPS' units "lj" have no constants, so they hold the system's own numbers in any units, with coherent masses (see
``session``). LAMMPS tallies energy and virial at the end of each ``run`` command.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kickdrift.bridges.lammps.laws import STYLE_OF, STYLES, range_of
from kickdrift.engines.fields import IN_LAMMPS, lammps_fixes, lammps_refusal, virial_of, without
from kickdrift.engines.forces import (
    beside_charges,
    many_body,
    one_pair_law,
    small_units,
    style_of,
    text_of,
    truncation_of,
)
from kickdrift.engines.job import Job
from kickdrift.engines.lammps_model import Ewald, Model, bonded_of, fixes
from kickdrift.engines.lammps_model import refusal as bonded_refusal
from kickdrift.engines.lammps_world import World
from kickdrift.engines.session import Session, Trouble
from kickdrift.engines.tables import ERROR, POINTS, table_of
from kickdrift.errors import InputError
from kickdrift.forces import LennardJones, ListedPairs, WeeksChandlerAndersen, Yukawa
from kickdrift.forces.bound.forces import Measured
from kickdrift.forces.charges.coulomb import coulomb_of
from kickdrift.forces.charges.radial import ALL_IMAGES
from kickdrift.forces.charges.waves import waves_of
from kickdrift.forces.many_body.tersoff import Tersoff
from kickdrift.forces.pairs.ends import TRUNCATIONS as ENDS
from kickdrift.forces.pairs.tabulated import Tabulated
from kickdrift.model.state import Floats
from kickdrift.model.system import System

TAKEN = (*STYLE_OF, Tabulated)
LAWS = ", ".join(law.name for law in TAKEN)
TAKES = (
    f"LAMMPS takes one force of {LAWS}, eam, stillinger-weber and tersoff, and bonded forces beside it; coulomb alone "
    "or beside lennard-jones, buckingham or born-mayer-huggins; position restraints and walls"
)
LINEAR, TABLED = "force-shift", "switch"
TRUNCATIONS = ("cut", "shift", LINEAR, TABLED)
OF_OTHERS = ("cut", "shift")  # truncations of laws other than Lennard-Jones
MOST_TYPES = 100  # particles of one species may differ in mass, and LAMMPS stores all pairs of types
IMAGES = 1024  # LAMMPS counts box crossings in ten bits
MOST_BLIND = 10**6  # steps without reading these counts
APART = (*IN_LAMMPS, ListedPairs)  # forces beside the pair force and the bonded ones


def refusal(job: Job) -> str | None:
    """See Engine."""
    return refused(job.system)


def refused(whole: System) -> str | None:
    """Reason why LAMMPS has no such forces, or None."""
    system = without(whole, APART)
    if not many_body(system, molecules=True) and (
        reason := one_pair_law(system, _truncations(system), TAKES, molecules=True, charges=ALL_IMAGES, laws=TAKEN)
        or small_units(system)
    ):
        return reason
    if any(isinstance(force, Tersoff) and force.form == ".tersoff.zbl" for force in system.forces):
        return "tersoff: LAMMPS has tersoff/zbl in units metal alone; kd.LammpsForce runs it"
    if coulomb_of(system) is not None and not all(system.box.periodic_axes):
        return "coulomb: slabs are not possible"
    force = beside_charges(system)
    if reason := bonded_refusal(whole, force) or lammps_refusal(whole) or _refused_law(system, force):
        return reason
    if system.dimensions == 2 and force.tail:
        return "tail: LAMMPS has no tail correction in two dimensions"
    if (count := len(_kinds(system, system.state.masses)[0])) > MOST_TYPES:
        return f"masses: {count} types of particles that differ in mass or species, and {MOST_TYPES} is the most"
    return None


def _truncations(system: System) -> tuple[str, ...]:
    """Truncations that LAMMPS has for the System's pair force: all, if it is a table."""
    return ENDS if type(beside_charges(system)) is Tabulated else TRUNCATIONS


def _refused_law(system: System, force: Any) -> str | None:
    """Reason why LAMMPS has not this law with these truncations and charges, or None."""
    cut = truncation_of(force, system)
    charged = coulomb_of(system) is not None
    if charged and type(force) is Tabulated:
        return f"force {force.name!r}: LAMMPS gets no tables beside charges"
    if charged and cut in (LINEAR, TABLED):
        return f"truncation {cut!r}: LAMMPS has it for Lennard-Jones without charges"
    if type(force) not in STYLE_OF or type(force) is LennardJones:
        return None
    if cut not in OF_OTHERS:
        return f"truncation {cut!r}: LAMMPS has it for Lennard-Jones alone"
    if charged and not STYLES[STYLE_OF[type(force)]].long:
        return f"force {force.name!r}: LAMMPS has no such law beside charges"
    if force.tail and not STYLES[STYLE_OF[type(force)]].mixes:
        return f"tail: LAMMPS has none for {force.name}"
    laws = {(a, b): force.pair_law(a, b) for a in system.species for b in system.species}
    if any(force.pair_end(*named).cutoff < range_of(force, law) < math.inf for named, law in laws.items()):
        return f"force {force.name!r}: a cutoff below the range of the law has no counterpart in LAMMPS"
    if len({getattr(law, "kappa", 0.0) for law in laws.values()}) > 1:
        return f"force {force.name!r}: LAMMPS has one kappa for all pairs of species"
    return None


def _kinds(system: System, masses: Floats) -> tuple[np.ndarray, np.ndarray]:
    """Species and mass of each kind of particles (kinds, 2), and the kind of each particle (n,)."""
    both = np.column_stack([system.species_index, masses])
    kinds, which = np.unique(both, axis=0, return_inverse=True)
    return kinds, which.reshape(-1)


def remarks(job: Job) -> list[str]:
    """How LAMMPS' forces differ from those asked for."""
    system = without(job.system, APART)
    force = beside_charges(system)
    if type(force) is Tabulated:
        return [f"LAMMPS takes the force from tables of {POINTS:,} points, joined by cubics"]
    if truncation_of(force, system) != TABLED:
        return []
    return [
        f"LAMMPS takes truncation {TABLED!r} from tables of {POINTS:,} points, with relative errors up to {ERROR:g}"
    ]


def ewald_of(system: System) -> Ewald | None:
    """Ewald's sum, or that by a mesh, in LAMMPS' terms; None without one."""
    if (force := coulomb_of(system)) is None:
        return None
    split = force.split(system)
    mesh = split.mesh or waves_of(system.box, split.waves).most
    return Ewald(force.scaled_charges(system), split.cutoff, split.alpha, mesh, split.order)


def model_of(job: Job, seed: int) -> Model:
    """Model for LAMMPS. ``seed`` is that of a heat bath."""
    assert job.options.dt is not None
    return modelled(job.system, job.system.coherent_masses, job.options.dt, fixes(job, seed))


def modelled(whole: System, masses: Floats, dt: float, stepping: tuple[str, ...]) -> Model:
    """Model of a System whose particles have these masses (n,), with the commands of the fixes that take a step."""
    system = without(whole, APART)
    force, ewald = beside_charges(system), ewald_of(system)
    cut: Any = force or ewald
    kinds, which = _kinds(system, masses)
    species = [system.species[int(k)] for k in kinds[:, 0]]
    given: dict[str, Any] = {"pairs": (), "shifted": False, "tail": False}
    if many_body(system, molecules=True):
        given |= {"many_body": (style_of(force), text_of(force), force.named(species))}
    elif force is not None:
        given |= _pairs(system, force, species)
    walls, held = lammps_fixes(whole)
    return Model(
        box=system.box, types=(which + 1).astype(np.int32), masses=tuple(kinds[:, 1].tolist()),
        ewald=ewald, cutoff=float(cut.cutoff), dt=dt, fixes=stepping, bonded=bonded_of(whole, force),
        walls=walls, held=held, **given,
    )  # fmt: skip


def _pairs(system: System, force: Any, species: list[str]) -> dict[str, Any]:
    """Values of a Model for a pair force between types of these species."""
    laws = [
        (i + 1, j + 1, force.pair_law(*named), force.pair_end(*named))
        for i in range(len(species))
        for j in range(i, len(species))
        for named in [(species[i], species[j])]
    ]
    if type(force) is Tabulated:
        return {
            "pairs": (), "shifted": False, "tail": False, "dimensions": system.dimensions,
            "tables": tuple(table_of(law, (i, j), end) for i, j, law, end in laws),
        }  # fmt: skip
    style, truncation = STYLE_OF[type(force)], truncation_of(force, system)
    coefficients = STYLES[style].coefficients
    given: dict[str, Any] = {
        "law": style,
        "pairs": tuple(
            (i, j, *map(float, coefficients(p)), min(float(end.cutoff), range_of(force, p))) for i, j, p, end in laws
        ),
        "shifted": truncation == "shift" or type(force) is WeeksChandlerAndersen, "linear": truncation == LINEAR,
        "tail": force.tail, "dimensions": system.dimensions,
    }  # fmt: skip
    if isinstance(force, Yukawa):
        given["law"] = f"{style} {float(laws[0][2].kappa)!r}"
    if truncation == TABLED:
        given["tables"] = tuple(table_of(law, (i, j), end) for i, j, law, end in laws)
    return given


class LammpsSession(Session):
    """LAMMPS in this process or in several processes. Counts the particles' box crossings."""

    def __init__(self, job: Job) -> None:
        super().__init__(job)
        self._model = model_of(job, self.seed)
        coulomb = coulomb_of(job.system)  # LAMMPS leaves the neutralising background out of its virial
        self._background = 3.0 * coulomb.background(job.system) / job.system.volume if coulomb else 0.0
        self._world: Any = None

    def reset(self, phase: Floats, time: float) -> None:
        box, x = self.job.system.box, phase[0].T
        wrapped = box.wrap(x)
        self._crossed = np.round(box.fractional(x - wrapped))
        self._seen = np.zeros(x.shape, np.int32)
        self._model = self._model._replace(fixes=fixes(self.job, self.seed))
        self._ask("reset", self._model, wrapped, np.ascontiguousarray(phase[1].T))
        self._kinetic = self._ask("kinetic_energy")
        self._count(self._seen)

    def _begun(self) -> Any:
        """Start LAMMPS with the requested number of processes."""
        if self.job.processes == 1 and not self.job.hosts:
            return World()
        from kickdrift.engines.lammps_processes import Processes

        return Processes(self.job.processes, self.job.hosts)

    def _ask(self, what: str, *arguments: Any) -> Any:
        """Return LAMMPS' answer. Raises Trouble if LAMMPS has stopped; the next ``reset`` then starts it again."""
        try:
            self._world = self._world or self._begun()
            return getattr(self._world, what)(*arguments)
        except ImportError as error:
            raise InputError(f"engine 'lammps': {error}") from None
        except InputError:  # from the hosts file
            self.close()
            raise
        except Exception as error:  # from LAMMPS or its processes
            self.close()
            text = " ".join(str(error).split()).removeprefix("ERROR: ")
            raise Trouble(f"LAMMPS: {text.split(' For more information')[0]}") from None
        except BaseException:  # a second Ctrl-C
            self.close()
            raise

    def advance(self, steps: int, until: float) -> int:
        left = steps
        while left:
            part = min(left, self._blind_steps)
            self._ask("run", part)
            left -= part
            self._blind_steps -= part
            self._kinetic = self._ask("kinetic_energy")
            if not self.finite():
                return steps - left
            if not self._blind_steps:
                self._count(self._ask("images"))
        return steps

    def finite(self) -> bool:
        return math.isfinite(self._kinetic)

    def _count(self, images: NDArray[np.int32]) -> None:
        """Add the box crossings, and return the number of steps until the next count.

        A particle with all kinetic energy in the lightest mass would be the fastest. In that many steps, even twice its
        speed does not bring a particle halfway around LAMMPS' counter."""
        crossed = images - self._seen
        self._crossed += (crossed + IMAGES // 2) % IMAGES - IMAGES // 2
        self._seen = images
        if not self._model.box.periodic or not self._kinetic:
            self._blind_steps = MOST_BLIND
            return
        fastest = 2.0 * math.sqrt(2.0 * self._kinetic / min(self._model.masses))
        way = IMAGES // 2 * float(self._model.box.heights.min())
        self._blind_steps = max(1, int(min(way / (fastest * self._model.dt), MOST_BLIND)))

    def phase(self) -> Floats:
        x, v, images = self._ask("state")
        self._count(images)
        return np.array([(x + self._model.box.cartesian(self._crossed)).T, v.T])

    def measure(self, time: float) -> Measured | None:
        forces, energy, virial = self._ask("measure")
        if not np.isfinite(forces).all() or not np.isfinite(energy):
            return None
        virial += virial_of(self.job.system, self._ask("state")[0]) if self._model.held else 0.0
        virial = virial + self._background if self._model.box.periodic else np.nan
        return Measured(np.ascontiguousarray(forces.T) / self.job.system.coherent_masses, energy, virial, None)

    @property
    def heat(self) -> float:
        return float(self._ask("heat"))

    def close(self) -> None:
        if self._world is not None:
            self._world.close()
            self._world = None


session = LammpsSession  # see Engine
