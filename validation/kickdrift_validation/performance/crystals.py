"""Crystals under many-body forces at constant energy, in kickdrift and LAMMPS.

Both take velocity Verlet's steps from the same numbers. LAMMPS checks at every step whether its list must be made anew.
Its skin is 1 angstrom, and 0.5 in another style. Among 0.5, 1 and 2 (the default for metals), LAMMPS was fastest with
0.5 in cold crystals."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

import kickdrift as kd
from kickdrift.engines import ENGINES
from kickdrift.engines.forces import style_of, text_of
from kickdrift_validation.example_forces import crystal
from kickdrift_validation.performance.turns import Missing, Native, Phase, Runner

DT, SETTLE = 0.001, 500  # ps; steps until the bonds have their share of the energy


class Crystal(NamedTuple):
    """Start of a crystal, the same for all programs."""

    system: kd.System
    dt: float = DT

    @property
    def positions(self) -> np.ndarray:
        return np.asarray(self.system.state.positions)

    @property
    def velocities(self) -> np.ndarray:
        return np.asarray(self.system.state.velocities)

    def simulation(self) -> kd.Simulation:
        return kd.Simulation(self.system, "velocity-verlet", self.dt)

    def energy(self, x: np.ndarray, v: np.ndarray) -> float:
        """Total energy at any positions and velocities, by the same code for all programs."""
        return Crystal(self.system.at(np.array([x.T, v.T]), 0.0)).simulation().energy().total

    def apart(self, x: np.ndarray, y: np.ndarray) -> float:
        """Largest difference of two programs' coordinates, by the nearest images."""
        return float(np.abs(self.system.box.minimum_image(x - y)).max())


@lru_cache(maxsize=3)
def settled(name: str) -> Crystal:
    """A crystal at about 300 K. ``name`` is a shipped system, or "tersoff" for the shipped silicon."""
    system = crystal(kd.Tersoff(), shaken=0.0) if name == "tersoff" else kd.load(name)
    system = system.with_velocities(temperature=600.0, seed=1)  # half of the energy goes into the bonds
    sim = kd.Simulation(system, "velocity-verlet", DT)
    sim.run(SETTLE, every=SETTLE)
    return Crystal(sim.system.at(sim.state.phase, 0.0))


def kickdrift(start: Crystal) -> Native:
    return Native(start.simulation(), "float64")


class LammpsCrystal(Runner):
    """LAMMPS' style for the force: plain (""), opt or omp. ``skin`` is in angstroms."""

    def __init__(self, start: Crystal, style: str = "", skin: float = 1.0) -> None:
        from kickdrift.engines.lammps_world import Model, World

        self.version, self.skin = ENGINES["lammps"].version or "", f"{skin:g}"
        system, force = start.system, start.system.forces[0]
        model = Model(
            system.box, np.ones(len(system), np.int32), (float(system.coherent_masses[0]),), (), force.cutoff,
            shifted=False, tail=False, dt=start.dt, many_body=(style_of(force), text_of(force), system.species),
        )  # fmt: skip
        flags = ["-sf", style] if style else []
        try:
            self.world = World([*flags, "-pk", "omp", "1"] if style == "omp" else flags)
        except ImportError:
            raise Missing(ENGINES["lammps"].install) from None
        self.world.reset(model, system.box.wrap(system.state.positions), system.state.velocities)
        self.world.lmp.command(f"neighbor {skin} bin")
        self.world.lmp.command("run 0 post no")

    def run(self, amount: float) -> float:
        self.world.run(round(amount))
        return round(amount)

    def phase(self) -> Phase:
        return self.world.state()[:2]

    def close(self) -> None:
        self.world.close()
