"""Styles of LAMMPS as a force under kickdrift's steps, beside LAMMPS' own `fix nve` over 1000 steps.

LAMMPS starts from the same positions and velocities, with its own lists of neighbours. Its masses carry the difference
between its unit of force and kickdrift's, so that both have the same accelerations. Positions are compared in
angstroms, potential energies relative to the largest one. The long set adds ReaxFF.
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np

import kickdrift as kd
from kickdrift.forces.external.lammps_library import lammps_class
from kickdrift.model.starts.builders import lattice
from kickdrift_validation.claim import Claim, at_most, main, not_run

STEPS, APART, SAME = 1000, 1e-9, 1e-9  # angstroms, relative


class Case(NamedTuple):
    """A potential, and the crystal that it holds together."""

    style: str
    rows: tuple[str, ...]
    species: tuple[str, ...]
    kind: str = "diamond"
    constant: float = 5.431
    cells: int = 2
    units: str = "metal"
    dt: float = 0.0005


W = "W_2940_2017_2"
CASES = (
    Case("meam", ("* * library.meam Cu Cu.meam Cu",), ("Cu",), "fcc", 3.62, 3),
    Case("adp", ("* * Ni.adp Ni",), ("Ni",), "fcc", 3.52, 3),
    Case("hybrid/overlay zbl 4.0 4.8 snap",
         ("1 1 zbl 74 74", f"* * snap {W}.snapcoeff {W}.snapparam W"), ("W",), "bcc", 3.18),
    Case("edip", ("* * Si.edip Si",), ("Si",)),
    Case("tersoff/zbl", ("* * SiC.tersoff.zbl Si C",), ("Si", "C"), constant=4.36),
    Case("tersoff/mod/c", ("* * Si.tersoff.modc Si",), ("Si",)),
    Case("vashishta", ("* * SiC.vashishta Si C",), ("Si", "C"), constant=4.36),
    Case("comb", ("* * ffield.comb Si",), ("Si",)),
    Case("reaxff NULL checkqeq no", ("* * ffield.reax.cho C",), ("C",), constant=3.567, units="real", dt=0.1),
)  # fmt: skip
MASSES = {"Cu": 63.546, "Ni": 58.693, "W": 183.84, "Si": 28.0855, "C": 12.011}
SITES = {"fcc": 4, "bcc": 2, "diamond": 8}
SPEED = 300.0  # kelvin


def system(case: Case) -> kd.System:
    """A crystal with thermal velocities; two species have a sublattice each."""
    x, edges = lattice(case.kind, SITES[case.kind] * case.cells**3, SITES[case.kind] / case.constant**3)
    on = np.floor(4.0 * x[:, 0] / case.constant + 1e-6).astype(int) % len(case.species)
    species = [case.species[k] for k in on.tolist()]
    force = kd.LammpsForce(case.style, case.rows)
    start = kd.System(
        x, masses=[MASSES[each] for each in species], box=kd.Box(edges), forces=[force], units=case.units,
        species=species, charges=np.zeros(len(x)) if case.style.split()[0] in ("comb", "reaxff") else None,
    )  # fmt: skip
    return start.with_velocities(temperature=SPEED, seed=3)


def theirs(start: kd.System, case: Case) -> tuple[Any, list[float]]:
    """Positions after 1000 steps of `fix nve` across all images, and potential energies each tenth of the way."""
    x, v, kinds = start.state.positions, start.state.velocities, start.species_index + 1
    lmp = lammps_class()(cmdargs=["-log", "none", "-screen", "none", "-nocite"])
    edges = " ".join(f"0 {float(edge)!r}" for edge in start.box.lengths)
    lines = (
        f"units {case.units}", "atom_style charge", "atom_modify map array sort 0 0", "boundary p p p",
        f"region box block {edges} units box", f"create_box {len(case.species)} box",
    )  # fmt: skip
    for line in lines:
        lmp.command(line)
    lmp.create_atoms(len(x), list(range(1, len(x) + 1)), kinds.tolist(), x.ravel().tolist(), v.ravel().tolist())
    masses = start.coherent_masses * lmp.extract_global("ftm2v")
    each = [float(masses[kinds == kind][0]) for kind in range(1, len(case.species) + 1)]
    for line in (
        f"pair_style {case.style}", *(f"pair_coeff {row}" for row in case.rows),
        *(f"mass {kind} {mass!r}" for kind, mass in enumerate(each, 1)),  # in place of those of the potential's file
        "neigh_modify every 1 delay 0 check yes",
        f"timestep {case.dt!r}", "thermo_modify norm no", "fix move all nve", "run 0 post no",
    ):  # fmt: skip
        lmp.command(line)
    energies = [lmp.get_thermo("pe")]
    for _ in range(10):
        lmp.command(f"run {STEPS // 10} pre no post no")
        energies.append(lmp.get_thermo("pe"))
    order = np.argsort(lmp.numpy.extract_atom("id")[: len(x)])
    ends = np.array(lmp.numpy.extract_atom("x")[: len(x)])[order]
    lmp.close()
    return ends, energies


def beside(case: Case) -> tuple[float, float]:
    """Largest differences of positions after 1000 steps, in angstroms, and of potential energies on the way."""
    start = system(case)
    sim = kd.Simulation(start, "velocity-verlet", dt=case.dt)
    ours = [sim.energy().potential]
    for _ in range(10):
        sim.advance(STEPS // 10)
        ours.append(sim.energy().potential)
    ends, energies = theirs(start, case)
    apart = start.box.minimum_image(sim.state.positions - ends)
    return float(np.abs(apart).max()), float(np.abs(np.subtract(ours, energies)).max() / np.abs(energies).max())


def claims(long: bool = False) -> list[Claim]:
    if find_spec("lammps") is None:
        return [not_run("styles of LAMMPS as a force", f"at most {APART:g}", "LAMMPS' fix nve")]
    rows: list[Claim] = []
    for case in CASES if long else CASES[:-1]:  # the last one is slow
        positions, energies = beside(case)
        name = f"{case.style.split()[-1] if 'snap' in case.style else case.style.split()[0]}, 1000 steps"
        rows.append(at_most(f"{name}: positions apart, angstroms", positions, APART, "LAMMPS' fix nve"))
        rows.append(at_most(f"{name}: potential energies apart, relative", energies, SAME, "LAMMPS' fix nve"))
    return rows


if __name__ == "__main__":
    main(claims, __doc__)
