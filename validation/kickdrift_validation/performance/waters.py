"""Rigid SPC/E water at constant energy, in kickdrift, LAMMPS and OpenMM.

All take steps of 2 fs from the same numbers, with Lennard-Jones cut at 9 angstroms and molecules kept rigid: by `fix
shake` in LAMMPS, by SETTLE in OpenMM. Ewald sums differ, so each runner knows the relative error of its forces at the
start, against kickdrift's mesh at 1e-8. Meshes are those with which that error is about 1e-4 or less."""

import tempfile
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import kickdrift as kd
from kickdrift.engines import ENGINES
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.systemfile.files import find
from kickdrift.systemfile.reading import loads
from kickdrift_validation.performance.turns import Missing, Native, Phase, Runner

CUTOFF, EXACT = 9.0, 1e-8
SETTLE = 250  # steps at 2 fs in a heat bath, until the lattice is gone
ACCURACY, PPPM, OPENMM = 4e-4, 1e-5, 5e-5  # that kickdrift's, LAMMPS' and OpenMM's meshes are asked for
SHAKE = 1e-6
KJ = 96.48533212331002  # kJ/mol in an eV


class Water(NamedTuple):
    """Start of water, the same for all programs."""

    system: kd.System
    dt: float = 0.002

    def forces(self, accuracy: float = EXACT, precision: str = "double") -> np.ndarray:
        """Forces (n, 3) without constraints, in eV per angstrom, by a mesh of this accuracy."""
        system = self.system.with_forces(self.system.forces[0], kd.Coulomb("pme", accuracy=accuracy))
        found = BoundForces(system, mixed=precision == "mixed").measure(0.0, system.state.phase)
        assert found is not None
        return np.asarray((found.accelerations * system.coherent_masses).T)

    def error(self, forces: np.ndarray) -> float:
        """Root-mean-square error of forces, relative to the root mean square of the exact ones."""
        exact = _exact(self)
        return float(np.sqrt(((forces - exact) ** 2).mean() / (exact**2).mean()))


@lru_cache(maxsize=1)
def _exact(start: Water) -> np.ndarray:
    return start.forces()


@lru_cache(maxsize=2)
def settled(molecules: int) -> Water:
    """Water of this number of molecules, whose cube root is whole."""
    text = find("water-1000").read_text(encoding="utf-8").replace("1000", str(molecules))
    system = loads(text.replace('truncation = "switch"', 'truncation = "cut"'))
    sim = kd.Simulation(system, "baoab", 0.002, temperature=298.0, friction=10.0)
    sim.run(SETTLE, every=SETTLE)
    return Water(system.at(sim.state.phase, 0.0))


class Ours(Native):
    """kickdrift by a mesh, in float64 or mixed precision."""

    def __init__(self, start: Water, precision: str = "double", threads: int = 1) -> None:
        system = start.system.with_forces(start.system.forces[0], kd.Coulomb("pme", accuracy=ACCURACY))
        sim = kd.Simulation(system, "velocity-verlet", start.dt, precision=precision, threads=threads)
        super().__init__(sim, f"{precision}, force error {start.error(start.forces(ACCURACY, precision)):.0e}")


class LammpsWater(Runner):
    """LAMMPS' lj/cut/coul/long with pppm and fix shake, in style opt."""

    def __init__(self, start: Water) -> None:
        try:
            from kickdrift.engines.lammps_world import lammps_class

            made = lammps_class()
        except ImportError:
            raise Missing(ENGINES["lammps"].install) from None
        self.version, system = ENGINES["lammps"].version or "", start.system
        self.lmp = made(cmdargs=["-log", "none", "-screen", "none", "-sf", "opt"])
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "water.data"
            path.write_text(data_of(system))
            self.lmp.commands_string(f"units metal\natom_style full\nread_data {path}")
        well = system.forces[0].species["O"]  # type: ignore[attr-defined]
        self.lmp.commands_string(
            f"""
            pair_style lj/cut/coul/long {CUTOFF}
            pair_coeff * * 0.0 1.0
            pair_coeff 1 1 {well["epsilon"]} {well["sigma"]}
            pair_modify table 12
            kspace_style pppm {PPPM}
            bond_style harmonic
            bond_coeff 1 20.0 1.0
            angle_style harmonic
            angle_coeff 1 2.0 109.47
            special_bonds lj/coul 0 0 0
            neighbor 1.0 bin
            timestep {start.dt}
            run 0 post no
            """
        )
        # Springs have no force at the lengths of the start, to its rounding.
        error = start.error(np.array(self.lmp.gather_atoms("f", 1, 3)).reshape(-1, 3))
        self.precision = f"float64, force error {error:.0e}"
        self.lmp.commands_string(f"fix rigid all shake {SHAKE} 50 0 b 1 a 1\nfix steps all nve\nrun 0 post no")

    def run(self, amount: float) -> float:
        self.lmp.command(f"run {round(amount)} post no")
        return round(amount)

    def phase(self) -> Phase:
        x, v = (np.array(self.lmp.gather_atoms(name, 1, 3)).reshape(-1, 3) for name in "xv")
        return x, v

    def close(self) -> None:
        self.lmp.close()


def data_of(system: kd.System) -> str:
    """Text of a data file of LAMMPS with molecules of three atoms."""
    n, edges, charges = len(system), system.box.lengths, system.charges
    assert charges is not None
    x = np.array(system.state.positions)
    lines = ["water", f"{n} atoms\n{2 * n // 3} bonds\n{n // 3} angles\n2 atom types\n1 bond types\n1 angle types"]
    lines += [f"0 {edge!r} {axis}lo {axis}hi" for edge, axis in zip(map(float, edges), "xyz", strict=True)]
    lines += ["Masses\n", "1 15.9994\n2 1.008\n\nAtoms # full\n"]
    places = system.box.wrap(x)
    kinds = [1 if charge < 0 else 2 for charge in charges]
    lines += [
        f"{k + 1} {k // 3 + 1} {kinds[k]} {charges[k]} {' '.join(repr(float(c)) for c in places[k])}" for k in range(n)
    ]
    v = np.array(system.state.velocities)
    lines += ["\nVelocities\n", *(f"{k + 1} {' '.join(repr(float(c)) for c in v[k])}" for k in range(n))]
    pairs = [(3 * m + 1, 3 * m + 1 + k) for m in range(n // 3) for k in (1, 2)]
    lines += ["\nBonds\n", *(f"{k + 1} 1 {i} {j}" for k, (i, j) in enumerate(pairs))]
    lines += ["\nAngles\n", *(f"{m + 1} 1 {3 * m + 2} {3 * m + 1} {3 * m + 3}" for m in range(n // 3))]
    return "\n".join(lines) + "\n"


class OpenmmWater(Runner):
    """OpenMM's NonbondedForce with its mesh, rigid by SETTLE, on its CPU platform. The integrator is leapfrog."""

    precision = "float32 forces"

    def __init__(self, start: Water, threads: int = 1) -> None:
        try:
            import openmm
        except ImportError:
            raise Missing(ENGINES["openmm"].install) from None
        self.version, given = ENGINES["openmm"].version or "", start.system
        system, force = openmm.System(), openmm.NonbondedForce()
        system.setDefaultPeriodicBoxVectors(*np.diag(0.1 * np.array(given.box.lengths)).tolist())
        well: Any = given.forces[0].species["O"]  # type: ignore[attr-defined]
        assert given.charges is not None
        for k, (mass, charge) in enumerate(zip(given.state.masses, given.charges, strict=True)):
            system.addParticle(float(mass))
            force.addParticle(float(charge), 0.1 * well["sigma"], KJ * well["epsilon"] if k % 3 == 0 else 0.0)
        held = given.constraints
        assert held is not None
        for (i, j), length in zip(held.pairs.tolist(), held.lengths.tolist(), strict=True):
            system.addConstraint(i, j, 0.1 * length)
            force.addException(i, j, 0.0, 1.0, 0.0)
        force.setNonbondedMethod(force.PME)
        force.setCutoffDistance(0.1 * CUTOFF)
        force.setUseDispersionCorrection(False)
        force.setEwaldErrorTolerance(OPENMM)
        system.addForce(force)
        self.verlet = openmm.VerletIntegrator(start.dt)
        platform = openmm.Platform.getPlatformByName("CPU")
        self.context = openmm.Context(system, self.verlet, platform, {"Threads": str(threads)})
        self.context.setPositions(0.1 * np.array(given.state.positions))
        self.context.setVelocities(0.1 * np.array(given.state.velocities))
        error = start.error(self._get("Forces") / KJ / 10.0)
        self.precision = f"float32 forces, force error {error:.0e}"

    def _get(self, what: str) -> np.ndarray:
        found = getattr(self.context.getState(**{what.lower(): True}), f"get{what}")(asNumpy=True)
        return np.asarray(found.value_in_unit(found.unit))

    def run(self, amount: float) -> float:
        self.verlet.step(round(amount))
        return round(amount)

    def phase(self) -> Phase:
        return 10.0 * self._get("Positions"), 10.0 * self._get("Velocities")
