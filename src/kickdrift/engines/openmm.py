"""OpenMM: custom forces on the Reference platform, and words over flows as a CustomIntegrator.

The Reference platform computes in float64; the others round forces to float32 and are not used. OpenMM's units (nm, ps,
u, kJ/mol) are coherent, and the formulas here have only the system's own constants. So the system's numbers stand
unchanged: 1 sigma is 1 nm, 1 epsilon is 1 kJ/mol. OpenMM's nearest images are those of kickdrift.

OpenMM gives no virial, but the derivative of its energy with respect to a parameter. With U(s r) for U(r), -dU/ds at s
= 1 is the sum of r . F over pairs, from OpenMM's own derivative of the formula. OpenMM's Ewald sum has no such
parameter, but its energy is its virial. Bonds change with the size of a system,
angles and dihedrals do not, so that only the energies of pairs and bonds depend on s.

LangevinMiddleIntegrator is the word BAOA. NoseHooverIntegrator has its chain in the middle of the drift, BANA (Zhang et
al. 2019, doi:10.1021/acs.jpca.9b02771). AndersenThermostat acts where its System is updated, which is here the end of a
step. The other words take OpenMM's normal numbers.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from kickdrift.bridges.bonded_laws import LAWS
from kickdrift.engines import openmm_charges
from kickdrift.engines.fields import IN_OPENMM, openmm_fields, virial_of, without
from kickdrift.engines.forces import (
    beside_charges,
    one_pair_law,
    small_units,
    split,
    strange,
    truncation_of,
)
from kickdrift.engines.job import Job
from kickdrift.engines.session import Session, Trouble
from kickdrift.engines.tables import POINTS
from kickdrift.errors import InputError
from kickdrift.forces import Coulomb, Gravity, LennardJones
from kickdrift.forces.bound.forces import Measured
from kickdrift.forces.charges.coulomb import coulomb_of
from kickdrift.forces.laws.central import gravitational_constant
from kickdrift.forces.pairs.tabulated import Tabulated
from kickdrift.integrators.splitting.method import Splitting
from kickdrift.model.state import Floats
from kickdrift.model.system import System

TAKES = (
    "OpenMM takes lennard-jones and coulomb or tabulated, with bonded forces beside them, or gravity; and fields, "
    "restraints and soft walls"
)
TRUNCATIONS = {  # energies of a pair
    "cut": "U",
    "shift": "U-last",
    "force-shift": "U-last-(s*r-cutoff)*slope; slope=-24*e/cutoff*(2*(l/cutoff)^12-(l/cutoff)^6)",
    "switch": (
        "U*w^5*(1+5*u+15*u^2+35*u^3+70*u^4); w=1-u; u=max(0,((s*r)^2-start^2)/(cutoff^2-start^2))"
    ),
    "potential-switch": "U*w^3*(1+3*u+6*u^2); w=1-u; u=max(0,(s*r-start)/(cutoff-start))",
}  # fmt: skip
LENNARD_JONES = "; last=4*e*((l/cutoff)^12-(l/cutoff)^6); U=4*e*((l/(s*r))^12-(l/(s*r))^6)"
MIXTURE = "; e=epsilon(kind1,kind2); l=sigma(kind1,kind2)"
GRAVITY = "-G*m1*m2/sqrt((s*r)^2 + softening^2)"


def refusal(job: Job) -> str | None:
    """See Engine."""
    system, masses = without(job.system, IN_OPENMM), job.system.state.masses
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
    laws = (LennardJones, Tabulated)
    reason = one_pair_law(
        system, TRUNCATIONS, TAKES, molecules=True, charges=openmm_charges.METHODS, laws=laws
    ) or small_units(system)
    if reason:
        return reason
    if reason := strange(system, "OpenMM"):
        return reason
    if getattr(force := beside_charges(system), "tail", False):
        if system.dimensions == 2:
            return "tail: OpenMM has no tail correction in two dimensions"
        if len(ends := force.ends(system.species)) > 1 or any(end.truncation != "cut" for end in ends):
            return "tail: OpenMM takes it with truncation 'cut' and one cutoff alone"
    if _tabled(system) and coulomb_of(system) is not None:
        return "force 'tabulated': OpenMM gets no tables beside charges"
    if _tabled(system) and system.topology is not None and (system.topology.scaled.factors > 0).any():
        return "topology: scaled pairs of tables are not possible; pairs may be left out"
    return None


def _tabled(system: System) -> bool:
    return type(beside_charges(system)) is Tabulated


def remarks(job: Job) -> list[str]:
    """How OpenMM's forces differ from those asked for."""
    system = without(job.system, IN_OPENMM)
    if getattr(beside_charges(system), "tail", False):
        mixed = ", and averages it over N (N + 1) / 2 pairs, which differs by 1 / N" * (len(system.species) > 1)
        return [f"OpenMM integrates the tail to about 1e-6 of it{mixed}"]
    if not _tabled(system):
        return []
    return [f"OpenMM takes the energy from tables of {POINTS:,} points, joined by cubics: forces agree to about 2e-8"]


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
        import openmm

        system = without(self.job.system, IN_OPENMM)
        force, coulomb = beside_charges(system), coulomb_of(system)
        made = openmm.System()
        for mass in system.coherent_masses.tolist():
            made.addParticle(mass)
        if system.box.periodic:
            made.setDefaultPeriodicBoxVectors(*system.box.matrix.tolist())
        if force is not None:
            made.addForce(_gravity(system, force) if isinstance(force, Gravity) else _lennard_jones(system, force))
        extras = [*added_forces(system, force), *(_charged(system, coulomb) if coulomb else ())]
        for extra in [*extras, *openmm_fields(self.job.system)]:
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
        state = context.getState(positions=True, energy=True, forces=True, parameterDerivatives=True)
        forces, energy = _plain(state.getForces(asNumpy=True)), float(_plain(state.getPotentialEnergy()))
        if not np.isfinite(forces).all() or not np.isfinite(energy):
            return None
        virial = virial_of(self.job.system, _plain(state.getPositions(asNumpy=True)))
        virial -= float(dict(state.getEnergyParameterDerivatives()).get("s", 0.0))
        if coulomb_of(self.job.system) is not None:  # the energy of Ewald's sum falls as 1 / length: it is the virial
            of_waves = context.getState(energy=True, groups={openmm_charges.GROUP}).getPotentialEnergy()
            virial += float(_plain(of_waves))
        return Measured(np.ascontiguousarray(forces.T) / self.job.system.coherent_masses, energy, virial, None)


session = OpenmmSession  # see Engine


def _context(made: Any, steps: Any, phase: Floats) -> Any:
    import openmm

    found = openmm.Context(made, steps, openmm.Platform.getPlatformByName("Reference"))
    found.setPositions(phase[0].T)
    found.setVelocities(phase[1].T)
    return found


def _plain(quantity: Any) -> Any:
    """Numbers in the units that OpenMM gives."""
    return quantity.value_in_unit(quantity.unit)


def _lennard_jones(system: System, force: Any) -> Any:
    """The pair force: Lennard-Jones, or tables."""
    import openmm

    laws, ends = _of_pairs(system, force.pair_law), _of_pairs(system, force.pair_end)
    energy, different = TRUNCATIONS[truncation_of(force, system)], []
    if type(force) is Tabulated:
        at_end = [law.law(end.cutoff**2) for law, end in zip(laws, ends, strict=True)]
        different = list(dict.fromkeys(laws))
        tables = {
            "lasts": [each[0] for each in at_end],
            "slopes": [-each[1] * end.cutoff for each, end in zip(at_end, ends, strict=True)],
            "numbers": [different.index(law) for law in laws],
        }
        energy = energy.split("; slope=")[0] + "; last=lasts(kind1,kind2); slope=slopes(kind1,kind2); U="
        energy += "+".join(f"delta(numbers(kind1,kind2)-{k})*law{k}(s*r)" for k in range(len(different)))
    else:
        energy += LENNARD_JONES + MIXTURE
        tables = {key: [getattr(law, key) for law in laws] for key in ("epsilon", "sigma")}
    if len(set(ends)) > 1:
        energy = f"step(cutoff-s*r)*all; all={energy}; cutoff=ends(kind1,kind2); start=starts(kind1,kind2)"
        tables |= {"ends": [end.cutoff for end in ends], "starts": [end.switch_start or 0.0 for end in ends]}
    made = openmm.CustomNonbondedForce(energy)
    for k, law in enumerate(different):
        energies = [law.law(r * r)[0] for r in np.linspace(law.start, law.reach, POINTS).tolist()]
        made.addTabulatedFunction(f"law{k}", openmm.Continuous1DFunction(energies, law.start, law.reach))
    count = len(system.species)
    for key, values in tables.items():
        made.addTabulatedFunction(key, openmm.Discrete2DFunction(count, count, [float(value) for value in values]))
    made.addPerParticleParameter("kind")
    if len(set(ends)) == 1:
        made.addGlobalParameter("cutoff", float(ends[0].cutoff))
        made.addGlobalParameter("start", float(ends[0].switch_start or 0.0))
    for kind in system.species_index.tolist():
        made.addParticle([kind])
    exclude(made, system)
    made.setCutoffDistance(max(end.cutoff for end in ends))
    made.setUseLongRangeCorrection(bool(force.tail))
    made.setNonbondedMethod(made.CutoffPeriodic if system.box.periodic else made.CutoffNonPeriodic)
    return _scaled(made)


def _of_pairs(system: System, of_pair: Callable[[str, str], Any]) -> list[Any]:
    """What a function returns for each pair of species, by rows of a table."""
    return [of_pair(a, b) for b in system.species for a in system.species]


def _charged(system: System, coulomb: Coulomb) -> list[Any]:
    import openmm

    found = openmm_charges.charged_forces(system, coulomb)
    for each in found:
        if not isinstance(each, openmm.NonbondedForce):
            _scaled(each)
        if isinstance(each, openmm.CustomNonbondedForce):
            exclude(each, system)
    return found


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


def exclude(force: Any, system: System) -> None:
    """Leave all special pairs out of a CustomNonbondedForce."""
    if system.topology is not None:
        for i, j in system.topology.scaled.pairs.tolist():
            force.addExclusion(i, j)


def added_forces(system: System, pair_force: Any) -> list[Any]:
    """Bonded forces, and the scaled pairs of the pair force."""
    made = [_bonded(system, force) for force in split(system)[1]]
    if pair_force is not None and system.topology is not None and (system.topology.scaled.factors > 0).any():
        made.append(_scaled_pairs(system, pair_force))
    return made


def _bonded(system: System, force: Any) -> Any:
    import openmm

    terms, kind = LAWS[type(force)], force.kind
    items, laws, which = force.items(system)
    parameters = [terms.keys(law) for law in laws]
    energy, add = terms.energy, {"bonds": "addBond", "angles": "addAngle"}.get(kind, "addTorsion")
    if kind == "bonds":
        made = openmm.CustomBondForce(energy.replace("exp(", "EXP(").replace("r", "(s*r)").replace("EXP(", "exp("))
        _scaled(made)
    else:
        made = openmm.CustomAngleForce(energy) if kind == "angles" else openmm.CustomTorsionForce(energy)
    for key in parameters[0]:
        getattr(made, f"addPer{add[3:]}Parameter")(key)
    for item, law in zip(items.tolist(), which.tolist(), strict=True):
        getattr(made, add)(*item, list(parameters[law].values()))
    made.setUsesPeriodicBoundaryConditions(system.box.periodic)
    return made


def _scaled_pairs(system: System, force: Any) -> Any:
    import openmm

    assert system.topology is not None
    energy = f"scale*step(cutoff-r)*all; all={TRUNCATIONS[truncation_of(force, system)]}{LENNARD_JONES}"
    made = openmm.CustomBondForce(energy)
    _scaled(made)
    for key in ("scale", "e", "l", "cutoff", "start"):
        made.addPerBondParameter(key)
    kinds = system.species_index
    for (i, j), factor in zip(*(part.tolist() for part in system.topology.scaled), strict=True):
        if factor > 0:
            named = system.species[kinds[i]], system.species[kinds[j]]
            law, end = force.pair_law(*named), force.pair_end(*named)
            numbers = factor, law.epsilon, law.sigma, end.cutoff, end.switch_start or 0.0
            made.addBond(i, j, [float(number) for number in numbers])
    made.setUsesPeriodicBoundaryConditions(system.box.periodic)
    return made


HEAT = "heat"  # a variable of words with a bath


def integrator(job: Job, made: Any, seed: int) -> tuple[Any, Callable[[], float] | None]:
    """Integrator for a job, and a function that returns the heat, or None if OpenMM does not tell it.

    ``made`` is OpenMM's System. Some baths add a force to it."""
    import openmm

    options, dt = job.options, job.options.dt
    assert dt is not None
    if job.method.name == "nose-hoover":
        made.addForce(openmm.CMMotionRemover(1))  # OpenMM counts 3 N - 3 degrees of freedom where it sees this force
        chain = openmm.NoseHooverIntegrator(
            _kelvin(job), 1.0 / options.tau, dt, options.chain, 1, 3  # parts of a step, and of Suzuki and Yoshida's
        )  # fmt: skip
        return chain, lambda: -_in_md_units(chain.computeHeatBathEnergy())
    if job.method.name == "baoa":
        middle = openmm.LangevinMiddleIntegrator(_kelvin(job), options.friction, dt)
        middle.setRandomNumberSeed(seed)
        return middle, None
    if job.method.name == "andersen":
        collisions = openmm.AndersenThermostat(_kelvin(job), options.collision_rate)
        collisions.setRandomNumberSeed(seed)
        made.addForce(collisions)
    assert isinstance(job.method, Splitting)
    word = openmm.CustomIntegrator(dt)
    word.setRandomNumberSeed(seed)
    if job.method.bath:
        for name in (HEAT, "before", "after"):
            word.addGlobalVariable(name, 0.0)
    for letter, weight in zip(job.method.word, job.method.weights, strict=True):
        _FLOWS[letter](word, job, weight * dt)
    return word, (lambda: float(word.getGlobalVariableByName(HEAT))) if job.method.bath else None


def _kelvin(job: Job) -> float:
    """The temperature at which OpenMM's k_B T is that of the job."""
    import openmm.unit

    return _thermal(job) / _in_md_units(openmm.unit.MOLAR_GAS_CONSTANT_R)


def _thermal(job: Job) -> float:
    return float(job.system.units.boltzmann * job.options.temperature)


def _kick(word: Any, job: Job, span: float) -> None:
    word.addComputePerDof("v", f"v + {span!r}*f/m")


def _drift(word: Any, job: Job, span: float) -> None:
    word.addComputePerDof("x", f"x + {span!r}*v")


def _ornstein_uhlenbeck(word: Any, job: Job, span: float) -> None:
    rate = job.options.friction
    kept, spread = math.exp(-rate * span), math.sqrt(-math.expm1(-2.0 * rate * span) * _thermal(job))
    _counted(word, lambda: word.addComputePerDof("v", f"{kept!r}*v + {spread!r}*gaussian/sqrt(m)"))


def _collisions(word: Any, job: Job, span: float) -> None:
    _counted(word, word.addUpdateContextState)


def _counted(word: Any, act: Callable[[], Any]) -> None:
    """Let a bath act, and add the change of the kinetic energy to the heat."""
    word.addComputeSum("before", "0.5*m*v*v")
    act()
    word.addComputeSum("after", "0.5*m*v*v")
    word.addComputeGlobal(HEAT, f"{HEAT} + after - before")


_FLOWS: dict[str, Callable[[Any, Job, float], None]] = {
    "A": _drift, "B": _kick, "O": _ornstein_uhlenbeck, "D": _collisions,
}  # fmt: skip


def _in_md_units(quantity: Any) -> float:
    """Number in nm, ps, u and kJ/mol."""
    import openmm.unit

    return float(quantity.value_in_unit_system(openmm.unit.md_unit_system))
