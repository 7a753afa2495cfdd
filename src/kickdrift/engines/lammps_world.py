"""LAMMPS at work on one process, alone or as one of several that do the same at the same time.

It is told particles wrapped into the box, and gives them so, with the counts of edges that they have crossed since.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.engines.lammps_library import lammps_class
from kickdrift.model.state import Floats

AT_ONCE = 100_000  # particles, of which Python makes lists
SKIN = 0.3  # sigma, LAMMPS' own default: how far beyond the cutoff its lists reach; of no effect on the forces


class Model(NamedTuple):
    """What is simulated, as LAMMPS asks for it.

    Attributes
    ----------
    lengths : of the box's edges, None in open space
    types : (n,) int32, from 1, of particles that have mass and parameters in common
    masses : by type
    pairs : (type, type, epsilon, sigma) for each pair of types
    shifted, tail : pair_modify's
    """

    lengths: tuple[float, float, float] | None
    types: NDArray[np.int32]
    masses: tuple[float, ...]
    pairs: tuple[tuple[int, int, float, float], ...]
    cutoff: float
    shifted: bool
    tail: bool
    dt: float


class World:
    """A LAMMPS instance; ``flags`` are of its command line, and say which style of its force is taken."""

    def __init__(self, flags: Sequence[str] = ("-sf", "opt")) -> None:
        self.lmp = lammps_class()(cmdargs=["-log", "none", "-screen", "none", "-nocite", *flags])

    @property
    def rank(self) -> int:
        return int(self.lmp.extract_setting("world_rank"))

    def reset(self, model: Model, x: Floats, v: Floats) -> None:
        """Begin anew with particles at x (n, 3), inside the box, with velocities v (n, 3)."""
        self.model = model
        if self.lmp.get_natoms():
            self.lmp.command("clear")
        skin = SKIN * max(sigma for *_, sigma in model.pairs)
        if model.lengths is None:
            low, high = x.min(axis=0) - skin, x.max(axis=0) + skin
        else:
            low, high = np.zeros(3), np.array(model.lengths)
        edges = " ".join(f"{float(a)!r} {float(b)!r}" for a, b in zip(low, high, strict=True))
        yes = {True: "yes", False: "no"}
        for line in (
            "units lj",  # no constants: the numbers are those of a system in any coherent units
            "atom_style atomic",
            f"boundary {'s s s' if model.lengths is None else 'p p p'}",
            f"region box block {edges} units box",
            f"create_box {len(model.masses)} box",
            *(f"mass {kind} {mass!r}" for kind, mass in enumerate(model.masses, 1)),
            f"pair_style lj/cut {model.cutoff!r}",
            f"pair_modify shift {yes[model.shifted]} tail {yes[model.tail]}",
            *(f"pair_coeff {i} {j} {epsilon!r} {sigma!r} {model.cutoff!r}" for i, j, epsilon, sigma in model.pairs),
            f"neighbor {skin!r} bin",
            "neigh_modify every 1 delay 0 check yes one 20000 page 400000",  # no pair is missed
            "fix move all nve",
            f"timestep {model.dt!r}",
            "compute pull all pressure NULL virial",
            "thermo 1000000000",  # at the end of each run alone
            "thermo_modify norm no lost error",
        ):
            self.lmp.command(line)
        n = len(x)
        for at in range(0, n, AT_ONCE):
            part = slice(at, min(n, at + AT_ONCE))
            self.lmp.create_atoms(
                part.stop - at, list(range(at + 1, part.stop + 1)), model.types[part].tolist(),
                x[part].ravel().tolist(), v[part].ravel().tolist(),
            )  # fmt: skip
        if (made := int(self.lmp.get_natoms())) != n:
            raise RuntimeError(f"LAMMPS accepted {made} of {n} particles")
        self.lmp.command("run 0 post no")

    def run(self, steps: int) -> None:
        """Take steps. Nothing is set up again, so that the lists do not depend on how a run is cut."""
        self.lmp.command(f"run {steps} pre no post no")

    def kinetic_energy(self) -> float:
        """Of all particles; LAMMPS stops by itself at positions that are no numbers."""
        return float(self.lmp.get_thermo("ke"))

    def images(self) -> NDArray[np.int32]:
        """(n, 3) counts of edges crossed, modulo 1024."""
        return self._gathered("image", integer=True)

    def state(self) -> tuple[Floats, Floats, NDArray[np.int32]]:
        """(n, 3) positions inside the box, velocities, and ``images``."""
        return self._gathered("x"), self._gathered("v"), self.images()

    def measure(self) -> tuple[Floats, float, float]:
        """(n, 3) forces, potential energy, and the virial's part of the pressure."""
        energy, pressure = (self.lmp.extract_compute(name, 0, 0) for name in ("thermo_pe", "pull"))
        return self._gathered("f"), float(energy), float(pressure)

    def _gathered(self, name: str, integer: bool = False) -> Any:
        """Of all particles, by their ids, on each process."""
        data = self.lmp.gather_atoms(name, 0 if integer else 1, 3)
        return np.ctypeslib.as_array(data).reshape(-1, 3).copy()

    def close(self) -> None:
        """End this instance; MPI is left to the process."""
        self.lmp.close()
