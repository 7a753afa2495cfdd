"""Crystals under pressure: lattice constants, equations of state, elastic constants and vacancies, beside LAMMPS.

    python -m docs.studies.crystals [--page docs/crystals.md]

Copper of Zhou, Johnson & Wadley 2004 (256 atoms, the table with a smooth end) and silicon of Stillinger & Weber 1985
(216 atoms), at rest and at 0 and 10 GPa. The lattice constant is where the pressure is the wanted one. The equation of
state is Birch and Murnaghan's of third order through the energies of nine volumes. Elastic constants are those of
``kd.analysis.elastic_constants`` at three strains; beside them stand the same from LAMMPS' own stress of the strained
crystals. A vacancy's enthalpy of formation is that at the lattice constant of the
perfect crystal: with the atoms on their sites, at the nearest minimum, and at the minimum after 1 ps at 1000 K.
"""

from __future__ import annotations

import argparse
from functools import cache
from typing import Any

import numpy as np
from scipy.optimize import brentq, curve_fit

import kickdrift as kd
from kickdrift.analysis.crystals.elastic import PLACES, relaxed, strained, stress_of
from kickdrift.engines.job import Job
from kickdrift.engines.lammps import model_of
from kickdrift.engines.lammps_world import World
from kickdrift.integrators import INTEGRATORS
from kickdrift.integrators.options import Options
from kickdrift.model.starts.builders import lattice
from kickdrift.systemfile.files import shipped
from kickdrift.text import with_error
from kickdrift_validation.docs_tables import deliver, outputs, table

BEGIN, END = "<!-- crystals.py writes from here -->", "<!-- crystals.py: to here -->"
GPA = 1.0 / 160.2176634  # in eV per cubic angstrom
PRESSURES = (0.0, 10.0)
STRAINS = (1e-2, 1e-3, 1e-4)
VOLUMES = np.linspace(0.97, 1.03, 9)


def crystal(name: str, edge: float) -> kd.System:
    """Copper or silicon with this lattice constant."""
    if name == "copper":
        path = shipped()["copper-864"].with_name("Cu_zhou2004_smooth.eam.alloy")
        force: Any = kd.EmbeddedAtom(str(path))
        kind, cells, sites, mass = "fcc", 4, 4, 63.546
    else:
        force, kind, cells, sites, mass = kd.StillingerWeber(), "diamond", 3, 8, 28.0855
    x, edges = lattice(kind, sites * cells**3, sites / edge**3)
    element = "Cu" if name == "copper" else "Si"
    return kd.System(x, masses=mass, box=edges, forces=[force], units="metal", species=[element] * len(x))


def energy(system: kd.System) -> float:
    return kd.Simulation(system, "velocity-verlet", 0.001).energy().potential


def edge_at(name: str, pressure: float) -> float:
    """Lattice constant at a pressure in GPa."""
    guess = 3.615 if name == "copper" else 5.431
    return float(
        brentq(
            lambda a: -stress_of(crystal(name, a), 1)[:3].mean() / GPA - pressure, 0.94 * guess, 1.03 * guess, xtol=1e-9
        )
    )


def birch(volume: Any, energy_0: float, volume_0: float, bulk: float, slope: float) -> Any:
    """Energy of Birch & Murnaghan, third order (Birch 1947, doi:10.1103/PhysRev.71.809)."""
    f = (volume_0 / volume) ** (2 / 3) - 1.0
    return energy_0 + 9.0 * volume_0 * bulk / 16.0 * (
        f**3 * slope + f**2 * (6.0 - 4.0 * (volume_0 / volume) ** (2 / 3))
    )


def equation_of_state(name: str) -> list[str]:
    """A row: energy, lattice constant, bulk modulus and its slope, by a fit to nine volumes."""
    guess = 3.615 if name == "copper" else 5.431
    edges = guess * VOLUMES ** (1 / 3)
    systems = [crystal(name, edge) for edge in edges]
    count, per_cell = len(systems[0]), 4 if name == "copper" else 8
    volumes, energies = np.array([each.volume for each in systems]) / count, [energy(each) / count for each in systems]
    start = (min(energies), guess**3 / per_cell, 100.0 * GPA, 4.0)
    found, spread = curve_fit(birch, volumes, energies, p0=start, xtol=1e-14)
    errors = np.sqrt(np.diag(spread))
    edge, edge_error = (per_cell * found[1]) ** (1 / 3), per_cell ** (1 / 3) * errors[1] / (3 * found[1] ** (2 / 3))
    return [
        name, f"{found[0]:.4f}", with_error(edge, edge_error), with_error(found[2] / GPA, errors[2] / GPA),
        with_error(found[3], errors[3]),
    ]  # fmt: skip


@cache
def world() -> World:
    """LAMMPS, which all crystals share."""
    return World()


def lammps_stress(system: kd.System) -> np.ndarray:
    """Stress (6,) by LAMMPS' own virial."""
    job = Job(system, INTEGRATORS["velocity-verlet"], "velocity-verlet", Options(dt=0.001))
    x = system.box.wrap(system.state.positions)
    world().reset(model_of(job, 1), x, np.zeros_like(x))
    return -np.array([float(world().lmp.get_thermo(key)) for key in ("pxx", "pyy", "pzz", "pyz", "pxz", "pxy")])


def by_lammps(system: kd.System, strain: float) -> np.ndarray:
    """Elastic constants (6, 6) from LAMMPS' stress of the crystals that kickdrift has strained and relaxed."""
    slopes = np.zeros((2, 6, 6))
    for k in range(6):
        for which, size in enumerate((0.5 * strain, strain)):
            found = []
            for sign in (-1, 1):
                made, rotation = strained(system, k, sign * size)
                tensor = np.zeros((3, 3))
                for value, (i, j) in zip(lammps_stress(relaxed(made, 1)), PLACES, strict=True):
                    tensor[i, j] = tensor[j, i] = value
                tensor = rotation.T @ tensor @ rotation
                found.append(np.array([tensor[place] for place in PLACES]))
            slopes[which, :, k] = (found[1] - found[0]) / (2.0 * size)
    return (4.0 * slopes[0] - slopes[1]) / 3.0


def cubic(c: np.ndarray) -> np.ndarray:
    """C11, C12 and C44."""
    return np.array([np.trace(c[:3, :3]) / 3, (c[:3, :3].sum() - np.trace(c[:3, :3])) / 6, np.trace(c[3:, 3:]) / 3])


def constants(name: str, pressure: float) -> list[list[str]]:
    """Rows: elastic constants at each strain, and those of LAMMPS."""
    system, rows = crystal(name, edge_at(name, pressure)), []
    for strain in STRAINS:
        ours = kd.analysis.elastic_constants(system, strain)
        theirs = cubic(by_lammps(system, strain)) / GPA
        errors = cubic(ours.error) / GPA
        values = [
            with_error(value, max(error, 1e-4)) for value, error in zip(np.array(ours.cubic) / GPA, errors, strict=True)
        ]
        off = float(np.abs(np.array(ours.cubic) / GPA / theirs - 1.0).max())
        print(name, pressure, strain, values, theirs, off, flush=True)
        texts = [f"{value:.2f}" for value in theirs]
        rows.append([name, f"{pressure:g}", f"{strain:g}", *values, *texts, f"{off:.1e}"])
    return rows


def vacancy(name: str, pressure: float) -> list[str]:
    """A row: lattice constant, and a vacancy's enthalpy of formation, of a vacancy."""
    edge = edge_at(name, pressure)
    perfect = crystal(name, edge)
    whole, count = energy(perfect), len(perfect)
    x, kinds = perfect.state.positions[1:], ["Cu" if name == "copper" else "Si"] * (count - 1)
    left = perfect.remade(
        positions=x, velocities=None, masses=perfect.state.masses[1:], species=kinds, ids=np.arange(count - 1)
    )
    work = pressure * GPA * perfect.volume / count
    frozen = energy(left) - whole * (count - 1) / count + work
    hot = kd.Simulation(
        left.with_velocities(temperature=1000.0, seed=1), "baoab", 0.001, temperature=1000.0, friction=1.0, seed=1
    )
    hot.run(1000)
    minima = [kd.Simulation(each, "velocity-verlet", 0.001).minimize(force=1e-6).energy for each in (left, hot.now())]
    found = [each - whole * (count - 1) / count + work for each in minima]
    print(name, pressure, edge, frozen, found, flush=True)
    return [name, f"{pressure:g}", f"{edge:.4f}", f"{frozen:.4f}", *(f"{each:.4f}" for each in found)]


def page() -> str:
    """All tables."""
    names = ("copper", "silicon")
    states = [equation_of_state(name) for name in names]
    both = [(name, pressure) for name in names for pressure in PRESSURES]
    head = ["crystal", "P (GPa)", "strain", "C11", "C12", "C44", "C11, LAMMPS", "C12", "C44", "largest difference"]
    return "\n\n".join(
        [
            "### Equation of state",
            table(["crystal", "energy (eV per atom)", "lattice constant (angstrom)", "B (GPa)", "B'"], states),
            "### Elastic constants in GPa",
            table(head, [row for each in both for row in constants(*each)]),
            "### Vacancies",
            table(
                [
                    "crystal",
                    "P (GPa)",
                    "lattice constant (angstrom)",
                    "sites (eV)",
                    "nearest minimum (eV)",
                    "after 1000 K (eV)",
                ],
                [vacancy(*each) for each in both],
            ),
        ]
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    outputs(parser)
    deliver(parser.parse_args(), {}, page(), BEGIN, END)
