"""ASE: its LennardJones calculator; ``ase_dynamics`` has the integrators.

ASE's numbers stand for the system's own units (see ``session``). Masses are coherent, so ASE's eV, angstrom and u are
only names here. Energy, forces and stress come from the calculator at its present positions, so a sample changes
nothing.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from kickdrift.engines.ase_dynamics import dynamics
from kickdrift.engines.job import Job
from kickdrift.engines.lennard_jones import only_lennard_jones, small_units
from kickdrift.engines.session import Session
from kickdrift.forces.bound import Measured
from kickdrift.model.state import Floats


def refusal(job: Job) -> str | None:
    """See Engine."""
    system = job.system
    if reason := only_lennard_jones(system, ("shift",)) or small_units(system):
        return reason
    if job.method.bath and system.dimensions == 2:
        return "two dimensions: ASE's heat baths act along z too"
    force: Any = system.forces[0]
    laws = {force.pair_law(a, b) for a in system.species for b in system.species}
    if len(laws) > 1:
        return f"species: ASE's LennardJones has one sigma and epsilon, and {', '.join(system.species)} differ"
    return None


def session(job: Job) -> Session:
    """See Engine."""
    return AseSession(job)


class AseSession(Session):
    """Atoms with a calculator and their dynamics."""

    def reset(self, phase: Floats, time: float) -> None:
        from ase import Atoms
        from ase.calculators.lj import LennardJones

        system = self.job.system
        force: Any = system.forces[0]
        law = force.pair_law(system.species[0], system.species[0])
        axes = system.box.periodic_axes
        # ASE computes a stress if all three cell vectors are longer than zero, even along open axes.
        cell = np.where(np.array(axes)[:, None], system.box.matrix, np.eye(3)) if system.box.periodic else None
        self._atoms = Atoms("X" * len(system), positions=phase[0].T, cell=cell, pbc=axes)
        self._atoms.set_masses(system.coherent_masses)
        self._atoms.set_velocities(phase[1].T)
        self._atoms.calc = LennardJones(sigma=law.sigma, epsilon=law.epsilon, rc=force.cutoff, smooth=False)
        self._dynamics, self._heat = dynamics(self._atoms, self.job, self.seed)

    def advance(self, steps: int, until: float) -> int:
        with np.errstate(all="ignore"):  # NaN is reported
            for _ in range(steps):
                self._dynamics.step()
        return steps

    def phase(self) -> Floats:
        return np.array([self._atoms.positions.T, self._atoms.get_velocities().T])

    @property
    def heat(self) -> float:
        assert self._heat is not None
        return self._heat()

    def measure(self, time: float) -> Measured | None:
        atoms, system = self._atoms, self.job.system
        forces, energy = atoms.get_forces(apply_constraint=False), atoms.get_potential_energy()
        if not np.isfinite(forces).all() or not np.isfinite(energy):
            return None
        if not system.box.periodic:
            return Measured(forces.T / system.coherent_masses, energy, np.nan, None)
        volume = system.box.volume if all(system.box.periodic_axes) else atoms.get_volume()
        virial = -float(np.sum(atoms.get_stress()[:3])) * volume
        return Measured(forces.T / system.coherent_masses, energy, virial, None)
