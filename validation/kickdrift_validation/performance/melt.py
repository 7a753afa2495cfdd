"""The Lennard-Jones melt that the performance scripts time."""

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

import kickdrift as kd
from kickdrift.model.starts.builders import lattice, maxwell_boltzmann

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
