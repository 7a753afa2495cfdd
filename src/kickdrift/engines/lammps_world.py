"""LAMMPS in one process, alone or as one of several that act together.

Particles are passed wrapped into the box, with their counts of box crossings.
"""

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kickdrift.engines.lammps_model import BATH, Model, Space, acting, bonded_commands, data_of, model_style
from kickdrift.engines.lammps_model import SKIN as SKIN
from kickdrift.forces.external.lammps_library import lammps_class
from kickdrift.model.state import Floats

AT_ONCE = 100_000  # particles in one Python list


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
        edges, boundary = Space.of(model, x)
        self._commands(
            "units lj",  # no constants: the numbers are in any coherent system of units
            f"dimension {model.dimensions}",
            f"atom_style {model_style(model)}",
            f"boundary {boundary}",
            *(["atom_modify map array"] if model.ewald or model.held else []),  # by which numbers find their particles
        )
        with tempfile.TemporaryDirectory(prefix="kickdrift-lammps-") as folder:
            if model.bonded:
                start = Path(folder) / "start.data"
                with start.open("w", encoding="ascii") as file:
                    file.writelines(data_of(model, edges, x, v).lines())
                self._commands(*bonded_commands(model, f"read_data {start}"))
            else:
                box = model.box
                shape = " ".join(["prism" if box.tilts else "block", *map(repr, [*edges.ravel().tolist(), *box.tilts])])
                self._commands(f"region box {shape} units box", f"create_box {len(model.masses)} box")
            self._commands(*acting(model, Path(folder) / "potential", lambda file: repr(str(file))))
        self._commands(
            *(f"mass {kind} {mass!r}" for kind, mass in enumerate(model.masses, 1)),  # after eam, which sets masses
            f"neighbor {model.skin!r} bin",
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
