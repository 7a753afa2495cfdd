"""Inputs of LAMMPS, taken by `kd.System.from_lammps`, beside LAMMPS itself; and written again by `to_lammps`.

Each term's energy, the forces, and the positions after 20 steps of velocity Verlet. The polymer, the copper and the
rhodopsin are LAMMPS' own benchmarks. The salt's sum over waves has an error of 1e-11 in both. LAMMPS' erfc is a
polynomial with errors of 1.5e-7, so energies of charges are compared on the scale of the sums that cancel. The file of
the rhodopsin has rigid bonds that are wrong by up to 1.4e-4 angstrom, and kickdrift projects its start on the
constraints. So LAMMPS gets kickdrift's start, and its own constraints for the steps alone, since they add to the
forces. LAMMPS' forces of impropers are wrong below 0.001 rad, where it divides by a sine of 0.001, so their particles
are left out of the comparison of forces. ``long`` adds the copper and the rhodopsin.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import chdir
from pathlib import Path
from typing import Any

import numpy as np

import kickdrift as kd
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.forces.external.lammps_library import lammps_class
from kickdrift.model.molecules.relatives import measured
from kickdrift_validation.claim import Claim, at_most, main

STEPS = 20
FLAT = 0.001  # sine of an angle, to which LAMMPS raises smaller ones in the forces of impropers
PEER = "LAMMPS"
TERMS = {"pair": ("evdwl",), "charges": ("ecoul", "elong"), "bonds": ("ebond",), "angles": ("eangle",),
         "dihedrals": ("edihed",), "impropers": ("eimp",)}  # fmt: skip
JOINED = (("pair", "charges"), ("bonds", "angles"))  # kickdrift's springs across angles and listed pairs are in both
CRYSTAL = """\
units metal
lattice {lattice}
region box block 0 {cells} 0 {cells} 0 {cells}
create_box {types} box
create_atoms {types} box {basis}
mass * {mass}
displace_atoms all random 0.08 0.08 0.08 7
pair_style {style}
pair_coeff {coefficients}
velocity all create 300.0 4711 loop geom
fix 1 all nve
timestep 0.001
run 100
"""
SALT = """\
units metal
atom_style charge
lattice fcc 5.64 origin 0.25 0.25 0.25
region box block 0 3 0 3 0 3
create_box 2 box
create_atoms 1 box
lattice fcc 5.64 origin 0.75 0.25 0.25
create_atoms 2 box
set type 1 charge 1.0
set type 2 charge -1.0
mass 1 22.98977
mass 2 35.453
displace_atoms all random 0.1 0.1 0.1 3 units box
pair_style born/coul/long 8.0 8.0
pair_coeff 1 1 0.2637 0.317 2.34 1.0486 -0.4993
pair_coeff 1 2 0.2110 0.317 2.755 6.9906 -8.6758
pair_coeff 2 2 0.1582 0.317 3.17 72.4022 -145.4285
kspace_style ewald 1e-11
pair_modify table 0
velocity all create 1000.0 4711
fix 1 all nve
timestep 0.001
run 10
"""


def benchmark(name: str) -> str:
    """Text of one of LAMMPS' benchmarks, without its heat bath."""
    import lammps

    folder = Path(lammps.__file__).parent / "share" / "lammps" / "bench"
    lines = (folder / f"in.{name}").read_text(encoding="utf-8").splitlines()
    kept = [line for line in lines if "langevin" not in line]
    return "\n".join(kept).replace(f"data.{name}", str(folder / f"data.{name}"))


def rhodopsin() -> str:
    """The benchmark of a protein in a membrane at constant energy, with charges and constraints that are finer."""
    text = benchmark("rhodo").replace("fix             2 all npt temp 300.0 300.0 100.0 &", "fix 2 all nve")
    text = text.replace("                z 0.0 0.0 1000.0 mtk no pchain 0 tchain 1\n", "").replace("1e-4", "1e-7")
    return text.replace("0.0001 5 0", "1e-10 100 0").replace("mix arithmetic", "mix arithmetic table 0")


def _c(values: Any) -> Any:
    """The rows of an array as C's doubles."""
    return np.ctypeslib.as_ctypes(np.array(values).ravel())


class Beside:
    """LAMMPS after the same input: energies by term, forces, and positions after steps."""

    def __init__(self, path: Path, system: kd.System) -> None:
        with chdir(path.parent):
            self.lmp = lammps_class()(cmdargs=["-log", "none", "-screen", "none", "-nocite"])
            lines = path.read_text(encoding="utf-8").splitlines()
            self.rigid = [line for line in lines if " shake " in line]
            for line in lines:
                if not line.startswith(("run", "thermo")) and line not in self.rigid:
                    self.lmp.command(line)
            for line in ("thermo_style one", "thermo_modify norm no", "neigh_modify delay 0 every 1 check yes"):
                self.lmp.command(line)
            if system.constraints is not None:
                low = np.array(self.lmp.extract_box()[0])
                self.lmp.scatter_atoms("x", 1, 3, _c(system.box.wrap(system.state.positions) + low))
                self.lmp.scatter_atoms("v", 1, 3, _c(system.state.velocities))
            self.lmp.command("run 0")

    def rows(self, name: str) -> Any:
        """Values of all atoms in the order of their ids."""
        n = self.lmp.get_natoms()
        ids = self.lmp.numpy.extract_atom("id")[:n]
        return np.array(self.lmp.numpy.extract_atom(name)[:n])[np.argsort(ids)]

    def energies(self) -> dict[str, float]:
        """Energy of each term."""
        return {name: sum(self.lmp.get_thermo(key) for key in keys) for name, keys in TERMS.items()}

    def cancelling(self) -> float:
        """Size of the parts of the pair energy, which may cancel."""
        return float(sum(abs(self.lmp.get_thermo(key)) for key in ("evdwl", "ecoul", "elong")))

    def moved(self, system: kd.System, steps: int) -> float:
        """Largest component by which particles are apart after these steps of velocity Verlet here and there."""
        sim = kd.Simulation(system, "velocity-verlet", dt=system.run.dt)
        sim.advance(steps)
        for line in self.rigid:
            self.lmp.command(line)
        self.lmp.command(f"run {steps}")
        low = np.array(self.lmp.extract_box()[0])
        apart = system.box.minimum_image(sim.state.positions - (self.rows("x") - low))
        return float(np.abs(apart).max())


def ours(system: kd.System) -> tuple[dict[str, float], Any]:
    """Energies by term, and forces (n, 3)."""
    energies, forces = dict.fromkeys(TERMS, 0.0), np.zeros((len(system), 3))
    for force in system.forces:
        found = BoundForces(system.under([force])).measure(0.0, system.state.phase)
        assert found is not None
        kind = "charges" if force.name == "coulomb" else getattr(force, "kind", "pair")
        energies["pair" if force.name == "listed-pairs" else kind] += found.potential
        forces += (found.accelerations * system.coherent_masses).T
    return energies, forces


def beside_flat(system: kd.System) -> Any:
    """Which particles (n,) are in no improper that is flatter than LAMMPS' force of it is right."""
    kept = np.ones(len(system), bool)
    if system.topology is not None and len(impropers := system.topology.impropers):
        angles = measured(system.box, system.state.phase[0], impropers, "impropers")
        kept[impropers[np.abs(np.sin(angles)) < FLAT].ravel()] = False
    return kept


def compare(what: str, text: str) -> Iterator[Claim]:
    """Claims of one input."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "in.case"
        path.write_text(text, encoding="utf-8")
        system = kd.System.from_lammps(path)
        there = Beside(path, system)
        energies, forces = ours(system)
        theirs = there.energies()
        for one, other in JOINED if "angle_style charmm" in " ".join(text.split()) else ():
            for each in (energies, theirs):
                each[f"{one} and {other}"] = each.pop(one) + each.pop(other)
        for name, expected in theirs.items():
            if expected:
                scale = max(abs(expected), there.cancelling() if name.startswith(("pair", "charges")) else 0.0)
                off = abs(energies[name] - expected) / scale
                yield at_most(f"{what}: energy of {name}, relative difference", off, 1e-6, PEER)
        f = there.rows("f")
        bent = beside_flat(system)
        forces, f = forces[bent], f[bent]
        off = float(np.sqrt(((forces - f) ** 2).sum() / (f**2).sum()))
        yield at_most(f"{what}: forces, relative RMS difference", off, 1e-5, PEER)
        unit = "sigma" if system.units.name == "lj" else "angstrom"
        apart = there.moved(system, STEPS)
        yield at_most(f"{what}: positions after {STEPS} steps of {system.run.dt:g}, {unit}", apart, 1e-5, PEER)
        there.lmp.close()
        again = kd.System.from_lammps(system.to_lammps(Path(folder) / "in.again").input)
        energy, same = (BoundForces(each).measure(0.0, each.state.phase).potential for each in (again, system))
        off = abs(energy / same - 1.0)
        yield at_most(f"{what}: energy after to_lammps and from_lammps, relative difference", off, 1e-13, "kickdrift")


def claims(long: bool = False) -> Iterator[Claim]:
    """A polymer, metals, two silicons, and a salt."""
    alloy = {"lattice": "fcc 3.6", "cells": 4, "types": 2, "basis": "basis 1 1 basis 2 1 basis 3 2 basis 4 2"}
    diamond = {"lattice": "diamond 5.431", "cells": 3, "types": 1, "basis": "", "mass": 28.0855}
    yield from compare("32,000 beads of LAMMPS' polymer", benchmark("chain"))
    made = CRYSTAL.format(**alloy, mass=60.0, style="eam/alloy", coefficients="* * CuNi.eam.alloy Ni Cu")
    yield from compare("copper and nickel, eam/alloy", made)
    for style, file in (("sw", "Si.sw"), ("tersoff", "Si.tersoff")):
        yield from compare(f"silicon, {style}", CRYSTAL.format(**diamond, style=style, coefficients=f"* * {file} Si"))
    yield from compare("sodium chloride, born/coul/long", SALT)
    if long:
        yield from compare("32,000 atoms of LAMMPS' copper, eam", benchmark("eam"))
        yield from compare("32,000 atoms of LAMMPS' rhodopsin", rhodopsin())


if __name__ == "__main__":
    main(claims, __doc__)
