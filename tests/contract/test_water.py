"""Twenty steps of rigid water beside OpenMM's Reference platform and LAMMPS' fix rattle."""

from __future__ import annotations

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.forces.external.lammps_library import lammps_class

COUNT, EDGE, CUTOFF, DT = 27, 12.6, 6.0, 0.001
EPSILON, SIGMA, CHARGE, ANGLE = 0.006738, 3.166, 0.4238, 109.47
MASSES = (15.9994, 1.008, 1.008)


def water() -> kd.System:
    table = {
        "units": "metal",
        "particles": {
            "lattice": "sc", "count": COUNT, "seed": 1, "species": ["O", "H", "H"],
            "molecule": [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [-0.3333, 0.9428, 0.0]],
            "mass": {"O": MASSES[0], "H": MASSES[1]}, "charge": {"O": -2.0 * CHARGE, "H": CHARGE},
        },
        "box": {"lengths": [EDGE] * 3},
        "topology": {"bonds": [[0, 1], [0, 2]], "angles": True, "factors": [0.0, 0.0, 1.0], "copies": COUNT},
        "constraint": [{"bonds": True, "distance": 1.0}, {"angles": True, "angle": ANGLE}],
        "velocities": {"temperature": 298.0, "seed": 1},
        "force": [
            {
                "type": "lennard-jones", "cutoff": CUTOFF, "truncation": "cut",
                "species": {"O": {"epsilon": EPSILON, "sigma": SIGMA}, "H": {"epsilon": 0.0, "sigma": 1.0}},
            },
            {"type": "coulomb", "method": "ewald", "cutoff": CUTOFF, "accuracy": 1e-9},
        ],
    }  # fmt: skip
    return kd.load(table)


@pytest.fixture(scope="module")
def ours() -> tuple[kd.System, np.ndarray, np.ndarray]:
    system = water()
    sim = kd.Simulation(system, "velocity-verlet", dt=DT)
    sim.run(20, every=20)
    assert np.abs(sim.state.positions - system.state.positions).max() > 0.3
    return system, sim.state.positions, sim.state.velocities


def distance(found: np.ndarray, ours: np.ndarray) -> float:
    apart = found - ours
    return float(np.abs(apart - EDGE * np.round(apart / EDGE)).max())


@pytest.mark.long
def test_openmm_moves_water_the_same_way(ours):
    mm = pytest.importorskip("openmm")
    system, nb, nm = mm.System(), mm.NonbondedForce(), 0.1
    system.setDefaultPeriodicBoxVectors(*(mm.Vec3(*row) for row in np.eye(3) * EDGE * nm))
    nb.setNonbondedMethod(mm.NonbondedForce.Ewald)
    nb.setCutoffDistance(CUTOFF * nm)
    nb.setEwaldErrorTolerance(1e-10)
    nb.setUseDispersionCorrection(False)
    across = 2.0 * np.sin(np.radians(ANGLE / 2.0)) * nm
    for k in range(COUNT):
        for site, mass in enumerate(MASSES):
            system.addParticle(mass)
            charge, strength = (CHARGE, 0.0) if site else (-2.0 * CHARGE, EPSILON * 96.48533212331)
            nb.addParticle(charge, SIGMA * nm, strength)
        for a, b, length in ((0, 1, nm), (0, 2, nm), (1, 2, across)):
            nb.addException(3 * k + a, 3 * k + b, 0.0, 1.0, 0.0)
            system.addConstraint(3 * k + a, 3 * k + b, length)
    system.addForce(nb)
    rattle = mm.CustomIntegrator(DT)
    rattle.addPerDofVariable("before", 0.0)
    rattle.setConstraintTolerance(1e-12)
    for variable, formula in (("v", "v+0.5*dt*f/m"), ("x", "x+dt*v"), ("before", "x")):
        rattle.addComputePerDof(variable, formula)
    rattle.addConstrainPositions()
    rattle.addComputePerDof("v", "v+0.5*dt*f/m+(x-before)/dt")
    rattle.addConstrainVelocities()
    context = mm.Context(system, rattle, mm.Platform.getPlatformByName("Reference"))
    start = ours[0].state
    context.setPositions(start.positions * nm)
    context.setVelocities(start.velocities * nm)
    rattle.step(20)
    found = context.getState(getPositions=True).getPositions(asNumpy=True)._value / nm
    assert distance(found, ours[1]) < 1e-6


@pytest.mark.parametrize("fix", ["rattle", "shake"])
def test_lammps_moves_water_the_same_way(ours, tmp_path, fix):
    """`fix shake` leaves velocities with parts along the bonds, 0.05 angstrom/ps here; without these they are ours."""
    pytest.importorskip("lammps")
    start, n = ours[0].state, 3 * COUNT
    sites = [(1, -2.0 * CHARGE), (2, CHARGE), (2, CHARGE)]
    lines = ["water", "", f"{n} atoms", f"{2 * COUNT} bonds", f"{COUNT} angles", "2 atom types", "1 bond types"]
    lines += ["1 angle types", "", *(f"0 {EDGE} {axis}lo {axis}hi" for axis in "xyz"), "", "Masses", ""]
    lines += [f"1 {MASSES[0]}", f"2 {MASSES[1]}", "", "Atoms # full", ""]
    for k, row in enumerate(start.positions.tolist()):
        kind, charge = sites[k % 3]
        lines.append(f"{k + 1} {k // 3 + 1} {kind} {charge!r} {row[0]!r} {row[1]!r} {row[2]!r}")
    lines += ["", "Velocities", ""]
    lines += [f"{k + 1} {row[0]!r} {row[1]!r} {row[2]!r}" for k, row in enumerate(start.velocities.tolist())]
    lines += ["", "Bonds", ""]
    lines += [f"{2 * k + j} 1 {3 * k + 1} {3 * k + 1 + j}" for k in range(COUNT) for j in (1, 2)]
    lines += ["", "Angles", "", *(f"{k + 1} 1 {3 * k + 2} {3 * k + 1} {3 * k + 3}" for k in range(COUNT))]
    (tmp_path / "water.data").write_text("\n".join(lines) + "\n", encoding="utf-8")
    world = lammps_class()(cmdargs=["-screen", "none", "-log", "none"])
    world.commands_string(f"""
        units metal
        atom_style full
        bond_style zero
        angle_style zero
        pair_style lj/cut/coul/long {CUTOFF}
        pair_modify table 0
        kspace_style ewald 1e-10
        special_bonds lj/coul 0 0 1
        read_data {tmp_path / "water.data"}
        bond_coeff * 1.0
        angle_coeff * {ANGLE}
        pair_coeff 1 1 {EPSILON} {SIGMA}
        pair_coeff 1 2 0.0 1.0
        pair_coeff 2 2 0.0 1.0
        neigh_modify every 1 delay 0 check yes
        timestep {DT}
        fix move all nve
        fix hold all {fix} 1e-12 200 0 b 1 a 1
        run 20
    """)
    found, velocities = (np.array(world.gather_atoms(key, 1, 3)).reshape(-1, 3) for key in "xv")
    world.close()
    assert distance(found, ours[1]) < 1e-6
    held, masses, along = ours[0].constraints, ours[0].coherent_masses, velocities.T.copy()
    rates = np.abs(held.rates(ours[1].T, along)).max()
    if fix == "shake":
        assert 0.01 < rates < 0.1
        along = held.projected(masses, ours[1].T.copy(), along)[1]
    assert np.abs(along.T - ours[2]).max() < 2e-5
