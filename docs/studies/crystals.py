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
from typing import Any

import numpy as np
from scipy.optimize import curve_fit

import kickdrift as kd
from kickdrift.text import with_error
from kickdrift_validation.docs_tables import deliver, outputs, table
from kickdrift_validation.elastic_constants import GPA, STRAINS, by_lammps, copper, cubic, silicon

BEGIN, END = "<!-- crystals.py writes from here -->", "<!-- crystals.py: to here -->"
PRESSURES = (0.0, 10.0)
CRYSTALS = {"copper": copper(), "silicon": silicon()}
VOLUMES = np.linspace(0.97, 1.03, 9)


def crystal(name: str, edge: float) -> kd.System:
    """Copper or silicon with this lattice constant."""
    return CRYSTALS[name].at(edge)


def energy(system: kd.System) -> float:
    return system.energy().potential


def edge_at(name: str, pressure: float) -> float:
    """Lattice constant at a pressure in GPa."""
    return CRYSTALS[name].edge_at(pressure)


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
