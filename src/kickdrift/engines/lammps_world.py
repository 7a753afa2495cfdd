"""LAMMPS in one process, alone or as one of several that act together. Particles are passed wrapped into the box, with
their counts of box crossings."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.engines.lammps_baths import BATH, FIXES
from kickdrift.engines.lammps_bonded import Bonded, read_particles
from kickdrift.engines.lammps_library import lammps_class
from kickdrift.model.box.box import Box
from kickdrift.model.state import Floats

AT_ONCE = 100_000  # particles in one Python list
SKIN = 0.3  # in sigma, LAMMPS' own default: reach of its lists beyond the cutoff, without effect on the forces
MANY_BODY_SKIN = 1.0  # in angstroms, likewise


class Model(NamedTuple):
    """Simulated model, in LAMMPS' terms.

    Attributes
    ----------
    types : (n,) int32, from 1; particles of one type share mass and parameters
    masses : by type
    pairs : (type, type, epsilon, sigma) for each pair of types; empty for a many-body force
    shifted, tail : options of pair_modify
    dimensions : 2 or 3
    fixes : commands of the fixes that take a step
    bonded : bonds, angles and dihedrals, if any
    many_body : of a many-body force, the pair style, the text of its file, and the species of each type
    """

    box: Box
    types: NDArray[np.int32]
    masses: tuple[float, ...]
    pairs: tuple[tuple[int, int, float, float], ...]
    cutoff: float
    shifted: bool
    tail: bool
    dt: float
    dimensions: int = 3
    fixes: tuple[str, ...] = FIXES["velocity-verlet"]
    bonded: Bonded | None = None
    many_body: tuple[str, str, tuple[str, ...]] | None = None


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
        skin = MANY_BODY_SKIN if model.many_body else SKIN * max(sigma for *_, sigma in model.pairs)
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
            f"atom_style {'molecular' if model.bonded else 'atomic'}",
            f"boundary {' '.join(boundary)}",
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
        else:
            self._commands(
                f"pair_style lj/cut {model.cutoff!r}",
                f"pair_modify shift {yes[model.shifted]} tail {yes[model.tail]}",
                *(f"pair_coeff {i} {j} {epsilon!r} {sigma!r} {model.cutoff!r}" for i, j, epsilon, sigma in model.pairs),
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
        self.lmp.command("run 0 post no")

    def _commands(self, *lines: str) -> None:
        for line in lines:
            self.lmp.command(line)

    def _many_body(self, style: str, text: str, species: Sequence[str]) -> None:
        """Give LAMMPS a many-body force, whose parameters it reads from a file."""
        self.lmp.command(f"pair_style {style}")
        with tempfile.TemporaryDirectory(prefix="kickdrift-lammps-") as folder:
            file = Path(folder) / "potential"
            file.write_text(text, encoding="utf-8")
            self.lmp.command(f"pair_coeff * * {str(file)!r} {' '.join(species)}")

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
