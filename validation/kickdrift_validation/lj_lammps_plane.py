"""Two-dimensional Lennard-Jones beside LAMMPS' `dimension 2`: mean pressure and energy, each with its error.

Two fluids, one from a hexagonal lattice and one from a square lattice, cut and shifted at 2.5 sigma, by velocity Verlet
at dt* = 0.004. Replicas begin on the same lattice at the same kinetic energy, each with velocities of its own. So all
replicas of both programs sample the same energy, number and area, and share no part of a trajectory. The first 30 units
of time melt the lattice and are left out.

Each program gives its own pressure and potential energy: LAMMPS by its thermo keywords `press` and `pe`, kickdrift by
its samples, (2 K + W) / (2 A) with the area A. The standard error of a mean is the scatter of the replicas over the
root of their number, whatever the memory of a run. The bound is three standard errors of the difference.
"""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

import kickdrift as kd
from kickdrift.engines.lammps_world import Model, World
from kickdrift.forces.external.lammps_library import lammps_class
from kickdrift.model.starts.builders import maxwell_boltzmann, plane_lattice
from kickdrift_validation.claim import Claim, claim, main, not_run

CUTOFF, DT, EVERY = 2.5, 0.004, 25
MELT, STEPS = 7500, 12_500  # 30 and 50 units of time
REPLICAS, LONG_REPLICAS = 8, 64
SIGMAS = 3.0
SOURCE = "LAMMPS, dimension 2, lj/cut, pair_modify shift yes"


class Fluid(NamedTuple):
    """A start: the lattice, its particles, their density and the temperature of their velocities."""

    lattice: str
    particles: int
    density: float
    hot: float


FLUIDS = (Fluid("hexagonal", 480, 0.5, 1.0), Fluid("square", 400, 0.75, 1.0))


def start(fluid: Fluid, seed: int) -> kd.System:
    """The lattice with velocities of its own; the total momentum is zero."""
    x, edges = plane_lattice(fluid.lattice, fluid.particles, fluid.density)
    v = maxwell_boltzmann(np.ones(fluid.particles), fluid.hot, 1.0, seed, dimensions=2)
    return kd.System(x, v, box=edges, forces=[kd.LennardJones(cutoff=CUTOFF, truncation="shift")], dimensions=2)


def of_kickdrift(fluid: Fluid, seed: int) -> list[float]:
    """Our means in one replica: temperature, pressure, potential energy per particle."""
    sim = kd.Simulation(start(fluid, seed), "velocity-verlet", DT)
    sim.advance(MELT)
    sim.run(STEPS, every=EVERY)
    found = sim.record.samples[-(STEPS // EVERY) :]
    rows = [(one.temperature, one.pressure, one.energies.potential / fluid.particles) for one in found]
    return np.mean(rows, axis=0).tolist()


def of_lammps(fluid: Fluid, seed: int) -> list[float]:
    """LAMMPS' means, with its own code in double precision and no accelerator package."""
    system, one = start(fluid, seed), ((1, 1, 1.0, 1.0),)
    model = Model(
        system.box, np.ones(fluid.particles, np.int32), (1.0,), one, CUTOFF, shifted=True, tail=False, dt=DT,
        dimensions=2,
    )  # fmt: skip
    world = World(flags=())
    world.reset(model, system.box.wrap(system.state.positions), np.array(system.state.velocities))
    world.run(MELT)
    rows = []
    for _ in range(STEPS // EVERY):
        world.run(EVERY)
        temperature, pressure, energy = (float(world.lmp.get_thermo(name)) for name in ("temp", "press", "pe"))
        rows.append((temperature, pressure, energy / fluid.particles))
    world.close()
    return np.mean(rows, axis=0).tolist()


def compared(fluid: Fluid, replicas: int) -> Iterator[Claim]:
    """The claims of one fluid; prints a line for each quantity."""
    seeds = range(1, replicas + 1)
    ours = np.array([of_kickdrift(fluid, seed) for seed in seeds])
    theirs = np.array([of_lammps(fluid, replicas + seed) for seed in seeds])
    state = f"{fluid.particles} particles in a plane, rho* = {fluid.density}, T* = {ours[:, 0].mean():.3f}"
    for k, quantity in enumerate(("temperature", "pressure", "energy")):
        own, other = ours[:, k].mean(), theirs[:, k].mean()
        error, of_other = (float(rows[:, k].std(ddof=1)) / math.sqrt(replicas) for rows in (ours, theirs))
        together, off = math.hypot(error, of_other), float(own - other)
        text = f"{own:.4f} ({error:.4f}), LAMMPS {other:.4f} ({of_other:.4f})"
        print(f"  {state}: {quantity:11} {text}: {off:+.5f}, {off / together:+.1f} sigma", flush=True)
        if k:  # at one total energy the temperature says what the potential energy says
            bound = f"difference at most {SIGMAS * together:.4f}"
            holds = abs(off) <= SIGMAS * together
            yield claim(f"mean {quantity}, {state}, {fluid.lattice} start", text, bound, holds, SOURCE)


def claims(long: bool = False) -> Iterator[Claim]:
    """Both fluids; ``long`` runs eight times as many replicas."""
    try:
        lammps_class()
    except ImportError:
        yield not_run("mean pressure and energy in two dimensions", f"within {SIGMAS:g} standard errors", SOURCE)
        return
    replicas = LONG_REPLICAS if long else REPLICAS
    print(f"dt* = {DT}, {replicas} replicas of {STEPS} steps after {MELT} steps")
    for fluid in FLUIDS:
        yield from compared(fluid, replicas)


if __name__ == "__main__":
    main(claims, __doc__)
