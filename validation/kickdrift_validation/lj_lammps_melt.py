"""Lennard-Jones against LAMMPS: the classic melt step by step, and the positions of 1000 particles.

The melt is LAMMPS' examples/melt: an fcc lattice of 4000 particles, rho* = 0.8442, velocities that LAMMPS draws for
T* = 3, lj/cut at 2.5 sigma, neither shifted nor switched, dt* = 0.005, 250 steps. Both programs start from the same
numbers, and PotEng, KinEng, Temp and Press are compared at every step. A run of 1000 steps and 1000 particles from a
simple cubic lattice at T* = 1.44 compares the positions. Both start as rounding and grow as chaos, which is shown by
kickdrift against itself with every number of the start moved by one rounding.

LAMMPS' own input has `neigh_modify every 20 check no`, which misses pairs soon after step 10, and so do its published
logs; here its list is checked at every step. What the log of its benchmark in.lj has at step 0 needs no velocities:
energy and virial of the lattice of 32,000 particles, which are a sum over the neighbours of one site.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

import kickdrift as kd
from kickdrift.engines.lammps_world import Model, World
from kickdrift.forces.external.lammps_library import lammps_class
from kickdrift.model.starts.builders import lattice
from kickdrift_validation.claim import Claim, at_most, claim, main, not_run
from kickdrift_validation.lennard_jones import FACTOR, apart, draw, frames_of, nudged, parting
from kickdrift_validation.performance.liquids import CUTOFF, DENSITY, DT

MELT, HOT, SEED, MELT_STEPS = 4000, 3.0, 87287, 250
SMALL, WARM, STEPS = 1000, 1.44, 1000
BENCH = 32_000  # particles of in.lj
COLUMNS = ("PotEng", "KinEng", "Temp", "Press")
FIRST = 20  # steps in which rounding has not grown
SAME = 1e-12  # relative, with numbers summed in another order
ADDED = 1e-11  # of PotEng: LAMMPS adds up to 10^6 pairs' energies one by one; on a lattice equal ones round one way
PAIRS = 4
SOURCE = "LAMMPS, lj/cut, `neigh_modify every 1 delay 0 check yes`"


def lammps(x: np.ndarray, edges: Sequence[float], temperature: float) -> World:
    """LAMMPS' own code in double precision, no accelerator package, with velocities that it draws as examples/melt."""
    world = World(flags=())
    model = Model(
        kd.Box(tuple(edges)), np.ones(len(x), np.int32), (1.0,), ((1, 1, 1.0, 1.0),), CUTOFF, shifted=False, tail=False,
        dt=DT,
    )  # fmt: skip
    world.reset(model, x, np.zeros_like(x))
    world.lmp.command(f"velocity all create {temperature} {SEED}")
    world.lmp.command("run 0 post no")
    return world


def unwrapped(theirs: World) -> np.ndarray:
    """(n, 3) positions, sorted by number."""
    x, _, images = theirs.state()
    return x + np.array(theirs.model.box.lengths) * images


def thermo(theirs: World) -> np.ndarray:
    """COLUMNS now; the energies per particle."""
    pe, ke, temperature, pressure = (theirs.lmp.get_thermo(name) for name in ("pe", "ke", "temp", "press"))
    n = theirs.lmp.get_natoms()
    return np.array([pe / n, ke / n, temperature, pressure])


def thermo_of(sim: kd.Simulation) -> list[float]:
    sample, n = sim.sample(), len(sim.system)
    return [sample.energies.potential / n, sample.energies.kinetic / n, sample.temperature, sample.pressure]


class Start(NamedTuple):
    """Positions, velocities and the edge of the box."""

    x: np.ndarray
    v: np.ndarray
    edge: float

    def simulation(self, nudge: int | None = None) -> kd.Simulation:
        """Ours; ``nudge`` is the seed of roundings that the positions are moved by."""
        x = self.x if nudge is None else nudged(self.x, nudge)
        force = kd.LennardJones(cutoff=CUTOFF, truncation="cut")
        return kd.Simulation(kd.System(x, self.v, box=[self.edge] * 3, forces=[force]), dt=DT)


def started(kind: str, particles: int, temperature: float) -> tuple[Start, World]:
    """A lattice with velocities that LAMMPS draws, in both programs."""
    x, edges = lattice(kind, particles, DENSITY)
    theirs = lammps(x, edges, temperature)
    return Start(unwrapped(theirs), theirs.state()[1], float(edges[0])), theirs


def shells(cutoff: float) -> tuple[float, float]:
    """U / N and W / 3 V of the fcc lattice: a sum over the neighbours of one site."""
    a = (4.0 / DENSITY) ** (1 / 3)
    reach = np.arange(-4, 5)
    sites = np.stack(np.meshgrid(reach, reach, reach), -1).reshape(-1, 3)
    sites = sites[(sites.sum(axis=1) % 2 == 0) & sites.any(axis=1)]
    r2 = (sites**2).sum(axis=1) * (a / 2) ** 2
    inverse6 = np.sort(r2[r2 < cutoff**2]) ** -3.0
    energy, along = 4.0 * inverse6 * (inverse6 - 1.0), 24.0 * inverse6 * (2.0 * inverse6 - 1.0)
    return float(energy.sum() / 2), float(along.sum() / 2 * DENSITY / 3)


def bench() -> list[Claim]:
    start, theirs = started("fcc", BENCH, WARM)
    ours, them = np.array(thermo_of(start.simulation())), thermo(theirs)
    energy, virial = shells(CUTOFF)
    pressure = virial + 2.0 * ours[1] * DENSITY / 3.0
    print(f"{BENCH} particles at step 0: {thermo_line(ours)}; LAMMPS {thermo_line(them)}")
    rows = []
    for name, value, of_lammps, lattice_sum in (
        ("PotEng", ours[0], them[0], energy), ("Press", ours[3], them[3], pressure)
    ):  # fmt: skip
        for reference, wanted in ((SOURCE, of_lammps), ("sum over the neighbours of one site", lattice_sum)):
            off, bound = abs(value / wanted - 1.0), ADDED if (name, reference) == ("PotEng", SOURCE) else SAME
            text = f"in.lj, {BENCH} particles, step 0: {name} {value:.7f}, relative difference"
            rows.append(at_most(text, off, bound, reference))
    return rows


def thermo_line(values: np.ndarray) -> str:
    return ", ".join(f"{name} {value:.7f}" for name, value in zip(COLUMNS, values, strict=True))


def melting() -> list[Claim]:
    """PotEng, KinEng, Temp and Press at each step."""
    start, theirs = started("fcc", MELT, HOT)
    ours, own = start.simulation(), start.simulation(nudge=0)
    table = []
    for step in range(MELT_STEPS + 1):
        if step:
            for sim in (ours, own):
                sim.run(1, every=2**40)
            theirs.run(1)
        table.append([thermo_of(ours), thermo(theirs), thermo_of(own)])
        if step % 50 == 0:
            print(f"  step {step:3}  {thermo_line(table[-1][0])}")
    us, them, shifted = np.array(table).transpose(1, 0, 2)
    rows, scale = [], np.abs(them).max(axis=0)
    for k, name in enumerate(COLUMNS):
        off = np.abs(us - them)[:, k] / scale[k]
        early, bound = float(off[: FIRST + 1].max()), ADDED if name == "PotEng" else SAME
        text = f"melt, {MELT} particles: {name} of steps 0 to {FIRST}, largest relative difference"
        rows.append(at_most(text, early, bound, SOURCE))
        late = float(off.max())
        bound = max(bound, FACTOR * float(np.abs(us - shifted)[:, k].max() / scale[k]))
        text = f"melt, {MELT} particles: {name} of steps 0 to {MELT_STEPS}, largest relative difference"
        reference = f"{SOURCE}; {FACTOR:g} times ours from a start one rounding away, or that"
        rows.append(claim(text, late, f"at most {bound:.1e}", late <= bound, reference))
    return rows


def positions(figures: Path | None) -> list[Claim]:
    """Claims on the positions of 1000 particles, for 1000 steps."""
    start, theirs = started("sc", SMALL, WARM)
    ours = frames_of(start.simulation(), STEPS)
    own = [apart(ours, frames_of(start.simulation(nudge), STEPS)) for nudge in range(PAIRS)]
    frames = [unwrapped(theirs)]
    for _ in range(STEPS):
        theirs.run(1)
        frames.append(unwrapped(theirs))
    other = np.array(frames)
    distances = apart(ours, other)
    print("RMS distance after 1, 10, 100, 1000 steps:")
    for name, curve in (("kickdrift and itself", own[0]), ("kickdrift and LAMMPS", distances)):
        print(f"  {name:24} {', '.join(f'{curve[k]:.1e}' for k in (1, 10, 100, 1000))}")
    rows = parting(ours, other, own, SOURCE, f" of {SMALL} particles")
    if figures:
        curves = {"kickdrift and LAMMPS": distances}
        print(draw(figures / "lj_lammps_melt.png", own, curves, DT, "Lennard-Jones: the same start in two programs"))
    return rows


def claims(long: bool = False, figures: Path | None = None) -> list[Claim]:
    try:
        lammps_class()
    except ImportError:
        return [not_run("thermo of the melt, and positions", "rounding, and what chaos makes of it", SOURCE)]
    return [*bench(), *melting(), *positions(figures)]


if __name__ == "__main__":
    main(claims, __doc__)
