"""OpenMM: a CustomNonbondedForce on the Reference platform; ``openmm_steps`` has the integrators.

The Reference platform computes in float64; the others round forces to float32 and are not used. OpenMM's units (nm, ps,
u, kJ/mol) are coherent, and the formulas here have only the system's own constants. So the system's numbers stand
unchanged: 1 sigma is 1 nm, 1 epsilon is 1 kJ/mol.

OpenMM gives no virial, but the derivative of its energy with respect to a parameter. With U(s r) for U(r), -dU/ds at s
= 1 is the sum of r . F over pairs, from OpenMM's own derivative of the formula.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from kickdrift.engines.bonded import split, strange
from kickdrift.engines.job import Job
from kickdrift.engines.lennard_jones import only_lennard_jones, small_units
from kickdrift.engines.openmm_bonded import added_forces, exclude
from kickdrift.engines.openmm_steps import integrator
from kickdrift.engines.session import Session, Trouble
from kickdrift.errors import InputError
from kickdrift.forces import Gravity
from kickdrift.forces.bound.forces import Measured
from kickdrift.forces.laws.central import gravitational_constant
from kickdrift.model.state import Floats
from kickdrift.model.system import System

TAKES = "OpenMM takes lennard-jones, with bonded forces beside it, or gravity alone"
LENNARD_JONES = "4*e*((l/(s*r))^12 - (l/(s*r))^6)"
SHIFT = " - 4*e*((l/cutoff)^12 - (l/cutoff)^6)"
MIXTURE = "; e=epsilon(kind1,kind2); l=sigma(kind1,kind2)"
GRAVITY = "-G*m1*m2/sqrt((s*r)^2 + softening^2)"


def refusal(job: Job) -> str | None:
    """See Engine."""
    system, masses = job.system, job.system.state.masses
    try:
        system.box.cuboid("box: OpenMM")  # whose lists miss pairs near the cutoff in boxes of other shapes
    except InputError as error:
        return str(error)
    if job.method.bath and system.dimensions == 2:
        return "two dimensions: OpenMM's heat baths act along z too"
    if not all(masses):
        still = system.body(int(np.argmin(masses)))
        return f"masses: {still} has no mass, and OpenMM fixes massless particles"
    if [type(force) for force in system.forces] == [Gravity] and system.topology is None:
        return None
    if reason := only_lennard_jones(system, ("cut", "shift"), TAKES, molecules=True) or small_units(system):
        return reason
    if reason := strange(system, "OpenMM"):
        return reason
    if split(system)[0][0].tail:
        return "tail: OpenMM has no tail correction for this kind of force"
    return None


def session(job: Job) -> Session:
    """See Engine."""
    return OpenmmSession(job)


class OpenmmSession(Session):
    """OpenMM Context."""

    def reset(self, phase: Floats, time: float) -> None:
        import openmm

        made = self._made()
        self._steps, self._heat = integrator(self.job, made, self.seed)
        self._context = _context(made, self._steps, phase)
        # A CustomIntegrator draws noise when OpenMM asks for its kinetic energy, so samples have another Context.
        self._probe = _context(self._made(), openmm.VerletIntegrator(1.0), phase) if self.job.method.bath else None
        self._begun = False

    def _made(self) -> Any:
        """OpenMM's System."""
        import openmm

        system = self.job.system
        force: Any = split(system)[0][0]
        made = openmm.System()
        for mass in system.coherent_masses.tolist():
            made.addParticle(mass)
        if system.box.periodic:
            made.setDefaultPeriodicBoxVectors(*system.box.matrix.tolist())
        made.addForce(_gravity(system, force) if isinstance(force, Gravity) else _lennard_jones(system, force))
        for extra in added_forces(system, force):
            made.addForce(extra)
        return made

    def advance(self, steps: int, until: float) -> int:
        import openmm

        try:
            self._steps.step(steps)
            self._begun = True
        except openmm.OpenMMException as error:
            raise Trouble(f"OpenMM: {' '.join(str(error).split())}") from None
        return steps

    def phase(self) -> Floats:
        state = self._context.getState(positions=True, velocities=True)
        return np.array([_plain(state.getPositions(asNumpy=True)).T, _plain(state.getVelocities(asNumpy=True)).T])

    @property
    def heat(self) -> float:
        assert self._heat is not None
        return self._heat() if self._begun else 0.0  # OpenMM's chain has no energy before its first step

    def measure(self, time: float) -> Measured | None:
        context = self._probe or self._context
        if self._probe:
            context.setPositions(self._context.getState(positions=True).getPositions(asNumpy=True))
        state = context.getState(energy=True, forces=True, parameterDerivatives=True)
        forces, energy = _plain(state.getForces(asNumpy=True)), float(_plain(state.getPotentialEnergy()))
        if not np.isfinite(forces).all() or not np.isfinite(energy):
            return None
        virial = -float(state.getEnergyParameterDerivatives()["s"])
        return Measured(np.ascontiguousarray(forces.T) / self.job.system.coherent_masses, energy, virial, None)


def _context(made: Any, steps: Any, phase: Floats) -> Any:
    import openmm

    found = openmm.Context(made, steps, openmm.Platform.getPlatformByName("Reference"))
    found.setPositions(phase[0].T)
    found.setVelocities(phase[1].T)
    return found


def _plain(quantity: Any) -> Any:
    """Number in OpenMM's internal units."""
    return quantity.value_in_unit(quantity.unit)


def _lennard_jones(system: System, force: Any) -> Any:
    import openmm

    shift = SHIFT if force.truncation == "shift" else ""
    made = openmm.CustomNonbondedForce(LENNARD_JONES + shift + MIXTURE)
    laws = [[force.pair_law(a, b) for a in system.species] for b in system.species]
    count = len(system.species)
    for key in ("epsilon", "sigma"):
        values = [float(getattr(law, key)) for row in laws for law in row]
        made.addTabulatedFunction(key, openmm.Discrete2DFunction(count, count, values))
    made.addPerParticleParameter("kind")
    made.addGlobalParameter("cutoff", force.cutoff)
    for kind in system.species_index.tolist():
        made.addParticle([kind])
    exclude(made, system)
    made.setCutoffDistance(force.cutoff)
    made.setNonbondedMethod(made.CutoffPeriodic if system.box.periodic else made.CutoffNonPeriodic)
    return _scaled(made)


def _gravity(system: System, force: Gravity) -> Any:
    import openmm

    made = openmm.CustomNonbondedForce(GRAVITY)
    made.addPerParticleParameter("m")
    made.addGlobalParameter("G", gravitational_constant(force.name, force.G, system))
    made.addGlobalParameter("softening", force.softening)
    for mass in system.state.masses.tolist():
        made.addParticle([mass])
    return _scaled(made)


def _scaled(force: Any) -> Any:
    """The force with the scale parameter of the virial."""
    force.addGlobalParameter("s", 1.0)
    force.addEnergyParameterDerivative("s")
    return force
