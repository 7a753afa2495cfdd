"""Molten salt at constant energy, in kickdrift and LAMMPS.

Both take velocity Verlet's steps from the same numbers, with Lennard-Jones cut at 9 angstroms. The relative error of
the forces is about 1e-4 for both: LAMMPS' pppm asks for 1e-5, because its error is relative to another force."""

from functools import lru_cache

import kickdrift as kd
from kickdrift.engines import ENGINES
from kickdrift.engines.job import Job
from kickdrift.systemfile.files import find
from kickdrift.systemfile.reading import loads
from kickdrift_validation.performance.crystals import Crystal, LammpsCrystal
from kickdrift_validation.performance.turns import Missing, Native

SETTLE = 1000  # steps at 2 fs in which the hot crystal loses its order
ACCURACY, PPPM = 1e-4, 1e-5


@lru_cache(maxsize=2)
def settled(count: int) -> Crystal:
    """Molten salt of this number of ions."""
    text = find("molten-salt").read_text(encoding="utf-8").replace("count = 512", f"count = {count}")
    system = loads(text)
    sim = kd.Simulation(system, "velocity-verlet", 0.002)
    sim.run(SETTLE, every=SETTLE)
    return Crystal(system.at(sim.state.phase, 0.0))


def kickdrift(start: Crystal, method: str) -> Native:
    forces = start.system.forces[0], kd.Coulomb(method, accuracy=ACCURACY)
    return Native(Crystal(start.system.with_forces(*forces)).simulation(), "float64")


class LammpsSalt(LammpsCrystal):
    """LAMMPS' lj/cut/coul/long with pppm, in style opt. ``cutoff`` of the near part is in angstroms."""

    def __init__(self, start: Crystal, cutoff: float) -> None:
        from kickdrift.engines.lammps import model_of
        from kickdrift.engines.lammps_world import World

        self.version, system = ENGINES["lammps"].version or "", start.system
        sim = start.simulation()
        model = model_of(Job(system, sim.method, sim.integrator, sim.integration.options), 1)  # type: ignore[arg-type]
        assert model.ewald is not None
        try:
            self.world = World(["-sf", "opt"])
        except ImportError:
            raise Missing(ENGINES["lammps"].install) from None
        model = model._replace(ewald=model.ewald._replace(cutoff=cutoff))
        self.world.reset(model, system.box.wrap(system.state.positions), system.state.velocities)
        for line in ("pair_modify table 12", f"kspace_style pppm {PPPM}", "neighbor 1.0 bin", "run 0 post no"):
            self.world.lmp.command(line)
