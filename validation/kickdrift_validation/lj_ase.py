"""Lennard-Jones against ASE: the same run, and its difference, which is rounding that chaos multiplies.

216 particles, rho* = 0.8442, melted for 2000 steps, cut and shifted at 2.5 sigma, dt* = 0.005. From there kickdrift's
velocity-verlet and ASE's VelocityVerlet with ASE's own LennardJones take 1000 steps each. The two must part: a fluid
multiplies any difference by exp(lambda t). That this is all there is to it is shown three ways:

* kickdrift against itself, eight times, every starting number moved by one rounding, parts at the same rate (--long:
  ASE against itself as well);
* so does a deviation that obeys the linearised equations along the same trajectory, which are summed in plain NumPy
  over all pairs: the largest Lyapunov exponent of this stretch, without any rounding (Benettin, Galgani & Strelcyn
  1976, doi:10.1103/PhysRevA.14.2338);
* with what both start from, the roundings of the first steps, this gives the size of the difference at any time.

Energies and forces are compared at the same positions, which leaves chaos out.
"""

from importlib.util import find_spec
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

import kickdrift as kd
from kickdrift_validation.claim import Claim, claim, largest, main, not_run
from kickdrift_validation.lennard_jones import apart, direct, draw, frames_of, nudged, parting, rate, tangent
from kickdrift_validation.performance.liquids import CUTOFF, DT, melt

PARTICLES, MELT, STEPS, PAIRS = 216, 2000, 1000, 8
SETTLED = 400  # steps until the fastest direction has won
FRAMES = (0, 1, 10, 100, 1000)
SIGMAS = 4.0  # of one pair's rate, from eight
SAME = 1e-12  # relative
SOURCE = "ASE's LennardJones and VelocityVerlet"


def ases(system: kd.System) -> Any:
    """The same particles with ASE's own calculator."""
    from ase.calculators.lj import LennardJones

    atoms = system.to_ase(calculator=False)
    atoms.calc = LennardJones(epsilon=1.0, sigma=1.0, rc=CUTOFF)
    return atoms


def ase_frames(system: kd.System, steps: int) -> np.ndarray:
    """(steps + 1, n, 3): positions after every step of ASE's."""
    from ase.md.verlet import VelocityVerlet

    atoms, found = ases(system), []
    dynamics = VelocityVerlet(atoms, DT)
    dynamics.attach(lambda: found.append(atoms.positions.copy()))
    dynamics.run(steps)
    return np.array(found)


def moved(system: kd.System, x: np.ndarray) -> kd.System:
    return kd.System(x, system.state.velocities, box=system.box, forces=system.forces)


def at_frames(system: kd.System, frames: np.ndarray) -> list[Claim]:
    """The largest differences of energy and force where both programs, and NumPy, look at the same positions."""
    edges, scale = np.array(system.box.lengths), 0.0
    off = {(what, who): 0.0 for what in ("potential energy", "forces") for who in ("ASE", "NumPy")}
    for k in FRAMES:
        sim, atoms = kd.Simulation(moved(system, frames[k]), dt=DT), ases(moved(system, frames[k]))
        energy, forces = sim.energy().potential, sim.forces()
        plain = direct(frames[k], edges, CUTOFF)
        scale = float(np.abs(plain.forces).max())
        for who, e, f in (
            ("ASE", atoms.get_potential_energy(), atoms.get_forces()), ("NumPy", plain.energies.sum(), plain.forces)
        ):  # fmt: skip
            rows = {"potential energy": abs(energy / e - 1.0), "forces": float(np.abs(forces - f).max()) / scale}
            for what, value in rows.items():
                off[what, who] = largest(off[what, who], value)
    names = {"ASE": "ASE's LennardJones", "NumPy": "direct sum in NumPy"}
    return [
        claim(f"{what}, steps {', '.join(map(str, FRAMES))}: largest relative difference", value, f"at most {SAME:g}",
              value <= SAME, names[who])
        for (what, who), value in off.items()
    ]  # fmt: skip


def growth(curves: dict[str, np.ndarray], own: list[np.ndarray], ours: np.ndarray, theirs: np.ndarray) -> list[Claim]:
    rows = parting(ours, theirs, own, SOURCE)
    rates = np.array([rate(one, DT, SETTLED) for one in own])
    mean, error = float(rates.mean()), float(rates.std(ddof=1))
    reference = f"kickdrift and itself a rounding away: {mean:.2f}, {error:.2f} from pair to pair"
    for name, curve in curves.items():
        found = rate(curve, DT, SETTLED)
        text = f"rate at which they part, {name}: {found:.2f} a unit of time, off by"
        off = abs(found - mean)
        rows.append(claim(text, off, f"at most {SIGMAS * error:.2f}", off <= SIGMAS * error, reference))
    return rows


def claims(long: bool = False, figures: Path | None = None) -> list[Claim]:
    """``long`` adds ASE against itself; ``figures`` is a folder for the figure."""
    if find_spec("ase") is None:
        return [not_run("positions after 1, 10, 100, 1000 steps", "rounding times exp(lambda t)", SOURCE)]
    state = (melted := melt(PARTICLES, MELT)).state
    system = kd.System(state.positions, state.velocities, box=melted.system.box, forces=melted.system.forces)
    x, edges = np.array(system.state.positions), np.array(system.box.lengths)
    ours = frames_of(kd.Simulation(system, dt=DT), STEPS)
    starts = [nudged(x, seed) for seed in range(PAIRS)]
    own = [apart(ours, frames_of(kd.Simulation(moved(system, start), dt=DT), STEPS)) for start in starts]
    began = perf_counter()
    theirs = ase_frames(system, STEPS)
    print(f"{STEPS} steps of ASE's: {perf_counter() - began:.0f} s")
    logs = tangent(ours, starts[0] - x, DT, edges, CUTOFF)
    curves = {
        "kickdrift and ASE": apart(ours, theirs),
        "linearised equations": np.exp(logs) / np.sqrt(PARTICLES),
    }
    if long:
        curves["ASE and itself a rounding away"] = apart(theirs, ase_frames(moved(system, starts[0]), STEPS))
    print("RMS distance after 1, 10, 100, 1000 steps:")
    for name, curve in {"kickdrift and itself": own[0], **curves}.items():
        print(f"  {name:32} {', '.join(f'{curve[k]:.1e}' for k in FRAMES[1:])}")
    if figures:
        print(draw(figures / "lj_ase.png", own, curves, DT, "Lennard-Jones fluid: the same start in two programs"))
    return [*growth(curves, own, ours, theirs), *at_frames(system, ours)]


if __name__ == "__main__":
    main(claims, __doc__)
