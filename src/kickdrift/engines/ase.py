"""ASE: its LennardJones, EAM or Tersoff calculator, and its molecular dynamics.

ASE's numbers stand for the system's own units (see ``session``). Masses are coherent, so ASE's eV, angstrom and u are
only names here. Energy, forces and stress come from the calculator at its present positions, so a sample changes
nothing.

LangevinBAOAB and Andersen move the centre of mass. NoseHooverChainNVT conserves the total momentum and still counts 3 N
degrees of freedom. Bussi counts 3 N too, unless a FixCom constraint takes 3 of these, as it does here.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from kickdrift.engines.forces import many_body, one_pair_law, small_units
from kickdrift.engines.job import Job
from kickdrift.engines.session import Session
from kickdrift.forces.bound.forces import Measured
from kickdrift.forces.many_body.base import TabledForce
from kickdrift.forces.many_body.embedded_atom import EmbeddedAtom
from kickdrift.forces.many_body.stillinger_weber import StillingerWeber
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.text import choices

TAKES = "ASE takes one force alone: lennard-jones, eam or tersoff"


def refusal(job: Job) -> str | None:
    """See Engine."""
    system = job.system
    if many_body(system):
        return _no_calculator(system)
    if reason := one_pair_law(system, ("shift",), TAKES) or small_units(system):
        return reason
    if job.method.bath and system.dimensions == 2:
        return "two dimensions: ASE's heat baths act along z too"
    force: Any = system.forces[0]
    laws = {force.pair_law(a, b) for a in system.species for b in system.species}
    if len(laws) > 1:
        return f"species: ASE's LennardJones has one sigma and epsilon, and {choices(system.species)} differ"
    if len(force.ends(system.species)) > 1:
        return f"cutoff: ASE's LennardJones has one, and pairs of {choices(system.species)} have their own"
    return None


def _no_calculator(system: System) -> str | None:
    """Reason why ASE has no calculator for the system's many-body force, or None."""
    force = system.forces[0]
    if isinstance(force, StillingerWeber):
        return f"force {force.name!r}: ASE has no calculator for it"
    if isinstance(force, TabledForce) and force.form != ".tersoff":
        return f"force {force.name!r}: ASE knows Tersoff's form of 1988 alone"
    if force.elements:
        return f"force {force.name!r}: elements: ASE's calculators know species by the elements of their parameters"
    if isinstance(force, EmbeddedAtom) and force.style == "eam/he":
        return f"force {force.name!r}: ASE does not read files of {force.style}"
    from ase.data import atomic_numbers

    strange = [species for species in system.species if species not in atomic_numbers]
    return f"species: {strange[0]!r} is no element, and ASE's calculator goes by elements" if strange else None


def _calculator(force: Any) -> Any:
    """ASE's calculator of a many-body force. Its EAM joins the tables by another spline than kickdrift."""
    if isinstance(force, EmbeddedAtom):
        from ase.calculators.eam import EAM

        return EAM(potential=force.file)
    from ase.calculators.tersoff import Tersoff, TersoffParameters

    table = {tuple(triple.split("-")): TersoffParameters(*numbers.values()) for triple, numbers in force.table.items()}
    return Tersoff(table)


class AseSession(Session):
    """Atoms with a calculator and their dynamics."""

    def reset(self, phase: Floats, time: float) -> None:
        from ase import Atoms
        from ase.calculators.lj import LennardJones

        system = self.job.system
        force: Any = system.forces[0]
        axes = system.box.periodic_axes
        # ASE computes a stress if all three cell vectors are longer than zero, even along open axes.
        cell = np.where(np.array(axes)[:, None], system.box.matrix, np.eye(3)) if system.box.periodic else None
        elements = [system.species[k] for k in system.species_index] if many_body(system) else "X" * len(system)
        self._atoms = Atoms(elements, positions=phase[0].T, cell=cell, pbc=axes)
        self._atoms.set_masses(system.coherent_masses)
        self._atoms.set_velocities(phase[1].T)
        if many_body(system):
            self._atoms.calc = _calculator(force)
        else:
            first = system.species[0]
            law, end = force.pair_law(first, first), force.pair_end(first, first)
            self._atoms.calc = LennardJones(sigma=law.sigma, epsilon=law.epsilon, rc=end.cutoff, smooth=False)
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


session = AseSession  # see Engine


def dynamics(atoms: Any, job: Job, seed: int) -> tuple[Any, Callable[[], float] | None]:
    """Dynamics for a job, and a function that returns the heat, or None if ASE does not tell it."""
    from ase import units

    name, options, dt = job.method.name, job.options, job.options.dt
    assert dt is not None
    if not job.method.bath:
        from ase.md.verlet import VelocityVerlet

        return VelocityVerlet(atoms, dt), None
    kelvin = job.system.units.boltzmann * options.temperature / units.kB  # ASE's k_B T is then the job's
    noise = np.random.default_rng(seed)
    if name == "baoab":
        from ase.md.langevinbaoab import LangevinBAOAB

        return LangevinBAOAB(atoms, dt, temperature_K=kelvin, T_tau=1.0 / options.friction, rng=noise), None
    if name == "andersen":
        from ase.md.andersen import Andersen

        chance = -math.expm1(-options.collision_rate * dt)
        return Andersen(atoms, dt, temperature_K=kelvin, andersen_prob=chance, fixcm=False, rng=noise), None
    if name == "csvr":
        from ase.constraints import FixCom
        from ase.md.bussi import Bussi

        atoms.set_constraint(FixCom())
        rescaling = Bussi(atoms, dt, temperature_K=kelvin, taut=options.tau, rng=noise)
        return rescaling, lambda: float(rescaling.transferred_energy)
    from ase.md.nose_hoover_chain import NoseHooverChainNVT

    chain = NoseHooverChainNVT(atoms, dt, temperature_K=kelvin, tdamp=options.tau, tchain=options.chain)
    return chain, lambda: atoms.get_total_energy() - chain.get_conserved_energy()
