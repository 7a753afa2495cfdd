"""LAMMPS at work: an instance that computes forces at positions which kickdrift's steps give."""

from __future__ import annotations

from typing import Any

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.external.lammps_library import lammps_class
from kickdrift.forces.external.renewed import RenewedHost
from kickdrift.model.subject import Subject
from kickdrift.text import choices, suggestion

QUIET = ["-log", "none", "-screen", "none", "-nocite"]
VOIGT = [0, 1, 2, 5, 4, 3]  # LAMMPS: xx, yy, zz, xy, xz, yz
VIRIAL = "kickdrift_virial"


class Library:
    """LAMMPS' library, closed when nothing uses it."""

    def __init__(self) -> None:
        self.lmp = lammps_class()(cmdargs=QUIET)

    def command(self, line: str) -> None:
        """Give a command. Raises InputError with LAMMPS' own words."""
        try:
            self.lmp.command(line)
        except Exception as error:
            what = " ".join(str(error).split()).partition("(src/")[0].strip().removeprefix("ERROR: ")
            raise InputError(f"lammps: LAMMPS refuses {line!r}: {what}{self._styles(line)}") from None

    def _styles(self, line: str) -> str:
        """Name the nearest pair style of this LAMMPS to one that is missing; "" if there is none."""
        words = line.split()
        if words[0] != "pair_style" or words[1] in (known := self.lmp.available_styles("pair")):
            return ""
        return f"{suggestion(words[1], known)}; this LAMMPS has {choices(known, words[1])}"

    def __del__(self) -> None:
        if lmp := getattr(self, "lmp", None):
            lmp.close()


def leans(matrix: Any) -> bool:
    """Whether a box has tilts. LAMMPS rounds positions in such a box, and only there."""
    return bool(np.tril(matrix, -1).any())


class LammpsHost(RenewedHost):
    """Atoms of LAMMPS. They lie in the box, so they are shifted by whole edges from the particles.

    LAMMPS moves its arrays and counts a volume only where it begins anew, so what it shares is kept until then."""

    def __init__(self, library: Library, *given: Any, **more: Any) -> None:
        super().__init__(library, *given, **more)
        self._library = library
        self._shift = np.zeros_like(self.parts.positions)
        self._leans = leans(self.box.matrix)  # LAMMPS' box, which never becomes rectangular again
        self._per_volume = library.lmp.extract_global("nktv2p")
        self._find_atoms()

    def _find_atoms(self) -> None:
        """Find LAMMPS' arrays, and the places of the particles in them."""
        lmp, n = self._library.lmp, len(self._shift)
        self._x, self._f, ids = (lmp.numpy.extract_atom(key)[:n] for key in ("x", "f", "id"))
        self._order = np.argsort(ids)

    def follow_box(self) -> None:
        """See RenewedHost."""
        before = self.box
        if self.box_now is not before:
            (a, _, _), (xy, b, _), (xz, yz, c) = self.box.matrix.tolist()
            if leans(self.box.matrix) and not self._leans:
                self._library.command("change_box all triclinic")
                self._leans = True
            tilts = f"xy final {xy!r} xz final {xz!r} yz final {yz!r} " if self._leans else ""
            edges = f"x final 0 {a!r} y final 0 {b!r} z final 0 {c!r}"
            self._library.command(f"change_box all {edges} {tilts}units box")

    def calculate(self, anew: bool) -> None:
        """See RenewedHost."""
        lmp, box, positions = self._library.lmp, self.box, self.parts.positions
        if anew:
            self._shift = np.where(box.periodic_axes, np.floor(box.fractional(positions)), 0.0) @ box.matrix
        self._x[self._order] = positions - self._shift
        self._library.command("run 0 post no" if anew else "run 1 pre no post no")
        if anew:
            self._find_atoms()
            self._volume = lmp.get_thermo("vol") / self._per_volume
            self._pressed = lmp.numpy.extract_compute(VIRIAL, 0, 1)
        virial = self._pressed[VOIGT] * self._volume
        self.put(self._f[self._order], lmp.get_thermo("pe"), float(virial[:3].sum()), virial)


def lammps_host(force: Any, system: Subject, units: str, renewal: float) -> LammpsHost:
    """The host of a LammpsForce for a System's particles; lists of neighbours serve moves up to ``renewal``."""
    try:
        library = Library()
    except ImportError as error:
        raise InputError(f"{force.name}: {error}") from None
    box, state, kinds = system.box, system.state, np.asarray(system.species_index) + 1
    periodic = box.periodic_axes
    low, high = state.positions.min(0) - renewal, state.positions.max(0) + renewal
    matrix = np.where(np.array(periodic)[:, None], box.matrix, 0.0)
    ends = [(0.0, matrix[k, k]) if periodic[k] else (low[k], high[k]) for k in range(3)]
    edges = " ".join(f"{a!r} {b!r}" for a, b in (map(float, each) for each in ends))
    tilts = " ".join(repr(float(each)) for each in (matrix[1, 0], matrix[2, 0], matrix[2, 1]))
    region = f"prism {edges} {tilts}" if leans(matrix) else f"block {edges}"
    lines = [
        f"units {units}", f"atom_style {force.atom_style}", "atom_modify map array sort 0 0",
        f"boundary {' '.join('p' if each else 'm' for each in periodic)}", "box tilt large",
        f"region box {region} units box", f"create_box {len(system.species)} box",
    ]  # fmt: skip
    for line in lines:
        library.command(line)
    inside = state.positions - np.where(periodic, np.floor(box.fractional(state.positions)), 0.0) @ box.matrix
    made = library.lmp.create_atoms(
        len(inside), list(range(1, len(inside) + 1)), kinds.tolist(), np.ascontiguousarray(inside).ravel().tolist()
    )
    if made != len(inside):
        raise InputError(f"{force.name}: LAMMPS took {made} of {len(inside)} particles")
    if force.atom_style == "charge":
        library.lmp.numpy.extract_atom("q")[: len(inside)] = system.charges
    masses = [system.state.masses[kinds == each] for each in range(1, len(system.species) + 1)]
    lines = [
        *(f"mass {k} {float(each[0]) if len(each) else 1.0!r}" for k, each in enumerate(masses, 1)),
        f"pair_style {force.pair_style}", *(f"pair_coeff {each}" for each in force.pair_coeff), *force.commands,
        f"neighbor {2.001 * renewal!r} bin", "neigh_modify delay 1000000000 every 1 check no",
        f"compute {VIRIAL} all pressure NULL virial", f"thermo_style custom step pe vol c_{VIRIAL}[1]",
        "thermo_modify norm no", "thermo 1",
    ]  # fmt: skip
    for line in lines:
        library.command(line)
    return LammpsHost(
        library, force.label, 1.0 / system.coherent_masses, box, reach=renewal, sees_velocities=False, pairs=np.nan
    )
