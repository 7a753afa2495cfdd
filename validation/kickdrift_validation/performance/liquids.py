"""Programs that move a Lennard-Jones liquid, most at constant energy, each set up as an experienced user would.

All take velocity Verlet's steps or the same in leapfrog's form, cut the potential at 2.5 sigma and find every pair at
every step. LAMMPS checks at every step whether its list must be made anew, which is its default. No program prints
while it runs. Programs that compute energies at the start and at the end of a turn include this in their time.
"""

import io
from contextlib import redirect_stderr
from functools import lru_cache
from importlib.metadata import version
from typing import Any, NamedTuple

import numpy as np

import kickdrift as kd
from kickdrift.engines import ENGINES
from kickdrift.model.box.box import Box
from kickdrift.model.starts.builders import lattice, maxwell_boltzmann
from kickdrift_validation.performance.turns import Missing, Native, Phase, Runner

DENSITY, TEMPERATURE, CUTOFF, DT = 0.8442, 1.44, 2.5, 0.005
FORCE = kd.LennardJones(cutoff=CUTOFF, truncation="shift")


class Liquid(NamedTuple):
    """Start of a liquid, the same for all programs: positions and velocities (n, 3) of particles of mass 1, and the
    edges of the box."""

    positions: np.ndarray
    velocities: np.ndarray
    edges: tuple[float, float, float]
    dt: float = DT

    def simulation(self, threads: int = 1, **options: Any) -> kd.Simulation:
        """Simulation from this state; ``options`` are Simulation's."""
        system = kd.System(self.positions, self.velocities, box=self.edges, forces=[FORCE])
        return kd.Simulation(system, **{"integrator": "velocity-verlet", "dt": self.dt, "threads": threads, **options})

    @property
    def temperature(self) -> float:
        return float((self.velocities**2).sum() / (3 * len(self.velocities) - 3))

    def energy(self, x: np.ndarray, v: np.ndarray) -> float:
        """Total energy at any positions and velocities, in float64, by the same code for all programs."""
        return self._replace(positions=x, velocities=v).simulation().energy().total

    def apart(self, x: np.ndarray, y: np.ndarray) -> float:
        """Largest difference of two programs' coordinates, by the nearest images."""
        edges = np.array(self.edges)
        difference = x - y
        return float(np.abs(difference - edges * np.round(difference / edges)).max())


@lru_cache(maxsize=2)
def liquid(particles: int, steps: int, threads: int = 1) -> Liquid:
    sim = melt(particles, steps, threads)
    state = sim.state
    return Liquid(state.wrapped(), state.velocities, sim.system.box.lengths)


def melt(particles: int, steps: int, threads: int = 1) -> kd.Simulation:
    """A simple cubic lattice at T* = 1.44, cut and shifted at 2.5 sigma, after ``steps`` steps."""
    positions, edges = lattice("sc", particles, DENSITY)
    velocities = maxwell_boltzmann(np.ones(particles), TEMPERATURE, 1.0, seed=1)
    sim = kd.Simulation(kd.System(positions, velocities, box=edges, forces=[FORCE]), dt=DT, threads=threads)
    sim.run(steps, every=steps)
    return sim


def again(sim: kd.Simulation, threads: int = 1, **changes: Any) -> kd.Simulation:
    """A Simulation from the state of ``sim``; ``changes`` are arguments of System, such as other forces."""
    state = sim.state
    arguments = {"box": sim.system.box, "forces": sim.system.forces, **changes}
    return kd.Simulation(kd.System(state.positions, state.velocities, **arguments), dt=DT, threads=threads)


def kickdrift(start: Liquid, threads: int = 1, precision: str = "float64", **options: Any) -> Native:
    """kickdrift. ``precision`` is Simulation's where it is not the default, and ``options`` are the other arguments."""
    options |= {} if precision == "float64" else {"precision": precision}
    return Native(start.simulation(threads, **options), precision)


def in_bath(start: Liquid, **options: Any) -> Native:
    return kickdrift(start, temperature=start.temperature, **options)


class Lammps(Runner):
    """LAMMPS' lj/cut of a style: plain (""), opt or omp. Several processes take opt. A ``friction`` adds fix langevin,
    without the tally of the heat."""

    def __init__(
        self, start: Liquid, style: str = "", threads: int = 1, processes: int = 1, friction: float = 0.0
    ) -> None:
        from kickdrift.engines.lammps_world import SKIN, Model, World

        self.start, self.version, self.skin = start, ENGINES["lammps"].version or "", f"{SKIN:g}"
        flags = ["-sf", style] if style else []
        flags += ["-pk", "omp", str(threads)] if style == "omp" else []
        n = len(start.positions)
        model = Model(
            Box(start.edges), np.ones(n, np.int32), (1.0,), ((1, 1, 1.0, 1.0),), CUTOFF, shifted=True, tail=False,
            dt=start.dt, fixes=self._fixes(start.temperature, friction),
        )  # fmt: skip
        try:
            self.world = World(flags) if processes == 1 else self._several(processes)
        except ImportError:
            raise Missing(ENGINES["lammps"].install) from None
        self.world.reset(model, start.positions, start.velocities)

    @staticmethod
    def _fixes(temperature: float, friction: float) -> tuple[str, ...]:
        move = "fix move all nve"
        return (move, f"fix bath all langevin {temperature} {temperature} {1.0 / friction} 1") if friction else (move,)

    @staticmethod
    def _several(processes: int):
        from kickdrift.engines.lammps_processes import Processes

        return Processes(processes)

    def run(self, amount: float) -> float:
        steps = round(amount)
        self.world.run(steps)
        return steps

    def phase(self) -> Phase:
        return self.world.state()[:2]

    def close(self) -> None:
        self.world.close()


class Openmm(Runner):
    """OpenMM's NonbondedForce and VerletIntegrator on its CPU platform; lengths in nm stand for sigma, and so on.

    The integrator is leapfrog, with velocities half a step behind. It begins with such velocities, and ``phase`` moves
    them by half a step.
    """

    precision = "float32 forces"

    def __init__(self, start: Liquid, threads: int = 1) -> None:
        try:
            import openmm
        except ImportError:
            raise Missing(ENGINES["openmm"].install) from None
        self.dt, self.version = start.dt, version("openmm")
        system, force = openmm.System(), openmm.NonbondedForce()
        system.setDefaultPeriodicBoxVectors(*np.diag(start.edges).tolist())
        for _ in start.positions:
            system.addParticle(1.0)
            force.addParticle(0.0, 1.0, 1.0)
        force.setNonbondedMethod(force.CutoffPeriodic)
        force.setCutoffDistance(CUTOFF)
        force.setUseDispersionCorrection(False)
        system.addForce(force)
        self.verlet = openmm.VerletIntegrator(start.dt)
        platform = openmm.Platform.getPlatformByName("CPU")
        self.context = openmm.Context(system, self.verlet, platform, {"Threads": str(threads)})
        self.context.setPositions(start.positions)
        self.context.setVelocities(start.velocities - 0.5 * start.dt * self._get("Forces"))

    def _get(self, what: str) -> np.ndarray:
        """Plain numbers in OpenMM's units."""
        state = self.context.getState(**{what.lower(): True})
        found = getattr(state, f"get{what}")(asNumpy=True)
        return found.value_in_unit(found.unit)

    def run(self, amount: float) -> float:
        self.verlet.step(round(amount))
        return round(amount)

    def phase(self) -> Phase:
        return self._get("Positions"), self._get("Velocities") + 0.5 * self.dt * self._get("Forces")


class Ase(Runner):
    """ASE's VelocityVerlet with its LennardJones. dt and energies are in ASE's own units, which need no constants
    here."""

    least = 2.0
    skin = "0.3"  # for each particle, ASE's default

    def __init__(self, start: Liquid) -> None:
        try:
            from ase import Atoms
            from ase.calculators.lj import LennardJones
            from ase.md.verlet import VelocityVerlet
        except ImportError:
            raise Missing(ENGINES["ase"].install) from None
        self.version = version("ase")
        self.atoms = Atoms(f"Ar{len(start.positions)}", positions=start.positions, cell=start.edges, pbc=True)
        self.atoms.set_masses(np.ones(len(start.positions)))
        self.atoms.set_velocities(start.velocities)
        self.atoms.calc = self.calculator(LennardJones)
        self.dynamics = VelocityVerlet(self.atoms, start.dt, logfile=None)

    def calculator(self, ases: type) -> object:
        """ASE's own calculator; a subclass returns another program's calculator for ASE."""
        return ases(sigma=1.0, epsilon=1.0, rc=CUTOFF, smooth=False)

    def run(self, amount: float) -> float:
        self.dynamics.run(round(amount))
        return round(amount)

    def phase(self) -> Phase:
        return self.atoms.get_positions(), self.atoms.get_velocities()


class Asap(Ase):
    """ASAP's compiled LennardJones and VelocityVerlet, on ASE's Atoms."""

    least = 20.0
    skin = ""  # ASAP does not tell

    def __init__(self, start: Liquid) -> None:
        try:
            from asap3.md.verlet import VelocityVerlet
        except ImportError:
            raise Missing("pip install asap3, which needs a C++ compiler") from None
        super().__init__(start)
        self.version = version("asap3")
        with redirect_stderr(io.StringIO()):  # ASAP prints which of its two versions runs
            self.dynamics = VelocityVerlet(self.atoms, start.dt, logfile=None)

    def calculator(self, ases: type) -> object:
        from asap3 import LennardJones

        return LennardJones([18], 1.0, 1.0, rCut=CUTOFF, modified=True)
