"""LAMMPS at work: an instance that computes forces at positions which kickdrift's steps give."""

from __future__ import annotations

import re
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.external.kernel import FORCES_ONLY
from kickdrift.forces.external.lammps_data import DataFile
from kickdrift.forces.external.lammps_library import lammps_class
from kickdrift.forces.external.renewed import RenewedHost
from kickdrift.model.molecules.relatives import molecules_of
from kickdrift.model.molecules.topology import SIZES
from kickdrift.model.state import Floats
from kickdrift.model.subject import Subject
from kickdrift.text import choices, suggestion

QUIET = ["-log", "none", "-screen", "none", "-nocite"]
VOIGT = [0, 1, 2, 5, 4, 3]  # LAMMPS: xx, yy, zz, xy, xz, yz
VIRIAL, ENERGY, AHEAD = "kickdrift_virial", "kickdrift_energy", "kickdrift_ahead"
NEVER = 1e15  # steps; LAMMPS sums energy and virial at steps of its thermodynamic output alone
MOST_IMAGES = 1e6  # that LAMMPS may keep beyond the particles and the images in the boxes beside theirs
MOST_PAIRS = 3e8  # in its lists of neighbours
FEW = 2000  # neighbours of a particle for which LAMMPS has room by itself
LABEL = re.compile(r"[A-Za-z][\w+.-]*")  # a name of a type that no pattern of LAMMPS could mean


class Library:
    """LAMMPS' library, closed when nothing uses it.

    Attributes
    ----------
    moved : whether a box has changed since the first
    sums : whether LAMMPS sums energy and virial at the next step
    always : whether it must, because its forces would have other bits
    """

    def __init__(self) -> None:
        self.lmp = lammps_class()(cmdargs=QUIET)
        self.moved = self.always = False
        self.sums = True

    def command(self, line: str) -> None:
        """Give a command. Raises InputError with LAMMPS' own words."""
        try:
            self.lmp.command(line)
        except Exception as error:
            what = " ".join(str(error).split()).partition("(src/")[0].strip().removeprefix("ERROR: ")
            what = what.partition(" For more information see ")[0]
            raise InputError(f"lammps: LAMMPS refuses {line!r}: {what}{self._styles(line)}") from None

    def _styles(self, line: str) -> str:
        """Name the nearest style that this LAMMPS has, if the line names one that is missing; else ""."""
        first, *words = line.split()
        kind = first.removesuffix("_style")
        if kind == first or not words or words[0] in (known := self.lmp.available_styles(kind)):
            return ""
        return f"{suggestion(words[0], known)}; this LAMMPS has {choices(known, words[0])}"

    def step(self, sums: bool) -> None:
        """Compute forces at the positions of now, with energy and virial if ``sums``."""
        if sums != self.sums:
            self.lmp.set_internal_variable(AHEAD, 1.0 if sums else NEVER)
            self.sums = sums
        self.command("run 1 pre no post no")

    def __del__(self) -> None:
        if lmp := getattr(self, "lmp", None):
            lmp.close()


def leans(matrix: Any) -> bool:
    """Whether a box has tilts. LAMMPS rounds positions in such a box, and only there."""
    return bool(np.tril(matrix, -1).any())


class Kept:
    """An instance of LAMMPS for a host, made when it is first needed. A host that ends leaves its instance to the next
    one of the same particles, unless the box has changed."""

    _spare: tuple[Any, Library] | None = None

    def __init__(self, key: Any, lines: list[str], data: DataFile, box: Any) -> None:
        self.key, self._lines, self._data, self._box = key, lines, data, box
        self._library: Library | None = None

    @property
    def library(self) -> Library:
        """The instance."""
        if self._library is None:
            spare, Kept._spare = Kept._spare, None
            if spare is not None and spare[0] == self.key:
                self._library = spare[1]
            else:
                del spare  # closed before another one opens
                self._library = self._made()
        return self._library

    def _made(self) -> Library:
        """A new instance with the particles, that has computed forces with and without sums."""
        try:
            found = Library()
        except ImportError as error:
            raise InputError(f"lammps: {error}") from None
        with tempfile.TemporaryDirectory(prefix="kickdrift-lammps-") as folder:
            path = Path(folder)
            with (path / "data").open("w", encoding="utf-8") as file:
                file.writelines(self._data.lines())
            for line in self._lines:
                found.command(f'read_data "{path / "data"}"' if line == "read_data" else line)
            if found.lmp.get_natoms() != len(self._data.ids):
                raise InputError(f"lammps: LAMMPS took {found.lmp.get_natoms():g} of {len(self._data.ids)} particles")
            self._check_reach(found, path)
        found.command("run 0 post no")
        forces = []
        for sums in (False, True):
            found.step(sums)
            forces.append(found.lmp.numpy.extract_atom("f")[: len(self._data.ids)].copy())
        found.always = forces[0].tobytes() != forces[1].tobytes()
        return found

    def _check_reach(self, library: Library, folder: Path) -> None:
        """Refuse a cutoff for which LAMMPS would fill the memory with images of particles, or with pairs."""
        library.command(f'write_coeff "{folder / "coefficients"}"')  # lets the styles compute their cutoffs
        library.command(f'info comm out overwrite "{folder / "info"}"')
        found = re.search(r"Communication cutoff = (\S+)", (folder / "info").read_text(encoding="utf-8"))
        reach, n = float(found[1]) if found else 0.0, len(self._data.ids)
        images = n * float(np.prod(1.0 + 2.0 * reach / self._box.heights))
        dense = n / float(np.prod(np.ptp(self._data.bounds, axis=1)))
        near = min(images, 4.0 / 3.0 * np.pi * reach**3 * dense)
        if not (images <= MOST_IMAGES + 27.0 * n and 0.5 * n * near <= MOST_PAIRS):
            raise InputError(
                f"lammps: the cutoff with its skin is {reach:g}, for which LAMMPS would keep {images:.1e} images of "
                f"particles and {0.5 * n * near:.1e} pairs; shorten it"
            )
        if near > 0.5 * FEW:
            library.command(f"neigh_modify one {int(2.0 * near) + FEW} page {20 * (int(2.0 * near) + FEW)}")

    def leave(self) -> None:
        """Leave the instance to the next host."""
        library, self._library = self._library, None
        if library is not None and not library.moved:
            Kept._spare = self.key, library

    __del__ = leave


class LammpsHost(RenewedHost):
    """Atoms of LAMMPS. They lie in the box, so they are shifted by whole edges from the particles.

    LAMMPS moves its arrays and counts a volume only where it begins anew, so what it shares is kept until then."""

    def __init__(self, kept: Kept, *given: Any, **more: Any) -> None:
        super().__init__(kept, *given, **more)
        self._instance = kept
        self._shift = np.zeros_like(self.parts.positions)
        self._leans = leans(self.box.matrix)  # LAMMPS' box, which never becomes rectangular again

    def open(self) -> None:
        """Let LAMMPS make the particles and read the commands, for the next host. Raises InputError with what it
        refuses."""
        _ = self._instance.library
        self._instance.leave()

    def _find_atoms(self) -> None:
        """Find LAMMPS' arrays, and the places of the particles in them."""
        lmp, n = self._instance.library.lmp, len(self._shift)
        self._x, self._f, ids = (lmp.numpy.extract_atom(key)[:n] for key in ("x", "f", "id"))
        order = np.argsort(ids)
        self._order: Any = slice(None) if np.array_equal(order, np.arange(n)) else order
        self._volume = lmp.get_thermo("vol") / lmp.extract_global("nktv2p")

    def follow_box(self) -> None:
        """See RenewedHost."""
        before = self.box
        if self.box_now is not before:
            library = self._instance.library
            library.moved = True
            (a, _, _), (xy, b, _), (xz, yz, c) = self.box.matrix.tolist()
            if leans(self.box.matrix) and not self._leans:
                library.command("change_box all triclinic")
                self._leans = True
            tilts = f"xy final {xy!r} xz final {xz!r} yz final {yz!r} " if self._leans else ""
            edges = f"x final 0 {a!r} y final 0 {b!r} z final 0 {c!r}"
            library.command(f"change_box all {edges} {tilts}units box")

    def calculate(self, anew: bool) -> None:
        """See RenewedHost."""
        library, positions = self._instance.library, self.parts.positions
        if anew:
            box = self.box
            self._shift = np.where(box.periodic_axes, np.floor(box.fractional(positions)), 0.0) @ box.matrix
            self._find_atoms()
        self._x[self._order] = positions - self._shift
        summed = anew or library.always or self.summing
        if anew:
            library.command("run 0 post no")
            self._find_atoms()
        else:
            library.step(summed)
        if not summed:
            self.put(self._f[self._order], 0.0, 0.0)
            self.parts.notes[FORCES_ONLY] = 1
            return
        virial = library.lmp.numpy.extract_compute(VIRIAL, 0, 1)[VOIGT] * self._volume
        energy = library.lmp.extract_compute(ENERGY, 0, 0)
        self.put(self._f[self._order], energy, float(virial[:3].sum()), virial)


def typed_lists(topology: Any) -> tuple[dict[str, list[str]], dict[str, Any], list[str]]:
    """Names of the types of bonds, angles and so on, in LAMMPS' order: by number if they are numbers, else as they
    come. Then rows of a type and particles, both from 1, and the commands that tell LAMMPS the names."""
    found: dict[str, list[str]] = {}
    if topology is None:
        return {}, {}, []
    for kind in SIZES:
        names = list(dict.fromkeys(topology.types(kind)))
        if names and all(name.isdecimal() and 0 < int(name) <= 10_000 for name in names):
            names = [str(k) for k in range(1, max(map(int, names)) + 1)]
        if names:
            found[kind] = names
    lists = {
        kind: np.column_stack([[1 + known.index(name) for name in topology.types(kind)], getattr(topology, kind) + 1])
        for kind, known in found.items()
    }
    labels = [f"labelmap {kind[:-1]} {' '.join(f'{k} {name}' for k, name in enumerate(known, 1))}"
              for kind, known in found.items() if all(map(LABEL.fullmatch, known))]  # fmt: skip
    return found, lists, labels


def lammps_host(force: Any, system: Subject, units: str, renewal: float) -> LammpsHost:
    """The host of a LammpsForce for a System's particles; lists of neighbours serve moves up to ``renewal``."""
    box, state, kinds = system.box, system.state, np.asarray(system.species_index) + 1
    periodic, topology, n = box.periodic_axes, system.topology, len(system.state.masses)
    low, high = state.positions.min(0) - renewal, state.positions.max(0) + renewal
    matrix = np.where(np.array(periodic)[:, None], box.matrix, 0.0)
    ends = [(0.0, matrix[k, k]) if periodic[k] else (low[k], high[k]) for k in range(3)]
    charges = system.charges if force.atom_style != "atomic" else None
    if charges is None and force.atom_style == "charge":
        charges = np.zeros(n)
    names, lists, labels = typed_lists(topology)
    bonds = np.zeros((0, 2), np.int64) if topology is None else topology.bonds
    masses = [system.state.masses[kinds == each] for each in range(1, len(system.species) + 1)]
    data = DataFile(
        heading="kickdrift", bounds=np.array(ends), masses=[float(each[0]) if len(each) else 1.0 for each in masses],
        tilts=[float(each) for each in (matrix[1, 0], matrix[2, 0], matrix[2, 1])] if leans(matrix) else (),
        labels=(), ids=np.arange(1, n + 1), types=kinds, molecules=molecules_of(bonds, n) + 1,
        positions=state.positions - np.where(periodic, np.floor(box.fractional(state.positions)), 0.0) @ box.matrix,
        velocities=np.zeros((n, 3)), lists=lists, counts={kind: len(known) for kind, known in names.items()}, names={},
        charges=charges,
    )  # fmt: skip
    factors = " ".join(map(repr, (topology and topology.factors) or (1.0, 1.0, 1.0)))
    special = [line for line in force.commands if line.split()[0] == "special_bonds"]
    lines = [
        f"units {units}", f"atom_style {'molecular' if charges is None else 'full'}",
        "atom_modify map array sort 0 0", f"boundary {' '.join('p' if each else 'm' for each in periodic)}",
        "box tilt large", *(special or [f"special_bonds lj/coul {factors}"]), "read_data",
        *labels,
        f"pair_style {force.pair_style}", *(f"pair_coeff {each}" for each in force.pair_coeff),
        *(line for line in force.commands if line not in special),
        f"neighbor {2.001 * renewal!r} bin", "neigh_modify delay 1000000000 every 1 check no",
        f"compute {VIRIAL} all pressure NULL virial", f"compute {ENERGY} all pe",
        "thermo_style custom step", "thermo_modify norm no", f"variable {AHEAD} internal 1",
        f"variable kickdrift_next equal step+v_{AHEAD}", "thermo v_kickdrift_next",
    ]  # fmt: skip
    opened: Floats = np.array([ends[k] for k in range(3) if not periodic[k]])
    charged = None if charges is None else charges.tobytes()
    key = (
        tuple(lines), tuple((force.files or {}).items()), opened.tobytes(), kinds.tobytes(), charged, matrix.tobytes(),
        tuple(data.masses), tuple((kind, rows.tobytes()) for kind, rows in lists.items()),
    )  # fmt: skip
    return LammpsHost(
        Kept(key, lines, data, box), force.label, 1.0 / system.coherent_masses, box, reach=renewal,
        sees_velocities=False, pairs=np.nan,
    )  # fmt: skip
