"""Speed of every force among few and many particles, beside LAMMPS, in processor time on one core.

    python -m kickdrift_validation.performance.sizes [--turns 7] [--seconds 0.5] [--only NAME …]

All programs of a row begin with the same numbers and take turns (A B A B …). LAMMPS runs its plain styles and its style
opt, crystals with skins of 0.5 and 1 angstrom; the fastest counts. Crystals are at about 600 K, with steps of 2 fs. The
mixture is that of Kob & Andersen 1995, doi:10.1103/PhysRevE.51.4626, at a density of 1.2 and a temperature of 1. The
rows of the liquid, the chains and copper's other table are LAMMPS' own benchmarks; see `published`. A sample is taken
at the end of a turn alone. "Mixed" is kickdrift in mixed precision over kickdrift in float64.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from functools import partial
from time import process_time
from typing import Any, NamedTuple

import numpy as np

import kickdrift as kd
from kickdrift.engines import ENGINES
from kickdrift.model.starts.builders import lattice, maxwell_boltzmann, mixture
from kickdrift_validation.claim import where
from kickdrift_validation.example_forces import crystal
from kickdrift_validation.performance import published
from kickdrift_validation.performance.crystals import Crystal, LammpsCrystal
from kickdrift_validation.performance.turns import Missing, Native, Runner, ratio_of, turns

KOB_ANDERSEN = {("A", "A"): (1.0, 1.0), ("A", "B"): (1.5, 0.8), ("B", "B"): (0.5, 0.88)}  # epsilon, sigma
CUTOFF, SKIN = 2.5, 0.3  # in sigma of A
SETTLE = 200  # steps before the turns


class LammpsMixture(Runner):
    """LAMMPS' lj/cut for the mixture, plain ("") or opt."""

    def __init__(self, system: kd.System, dt: float, style: str) -> None:
        from kickdrift.engines.lammps_world import Model, World

        numbers = [(1 + "AB".index(a), 1 + "AB".index(b), *own) for (a, b), own in KOB_ANDERSEN.items()]
        model = Model(
            system.box, system.species_index.astype(np.int32) + 1, (1.0, 1.0), tuple(numbers), CUTOFF, shifted=True,
            tail=False, dt=dt, fixes=("fix move all nve",),
        )  # fmt: skip
        try:
            self.world = World(["-sf", style] if style else [])
        except ImportError:
            raise Missing(ENGINES["lammps"].install) from None
        self.world.reset(model, system.box.wrap(system.state.positions), system.state.velocities)
        self.world.lmp.command(f"neighbor {SKIN} bin")
        self.world.lmp.command("run 0 post no")

    def run(self, amount: float) -> float:
        self.world.run(round(amount))
        return round(amount)

    def close(self) -> None:
        self.world.close()


class Start(NamedTuple):
    """A settled system, its step, and LAMMPS' contestants by name."""

    system: kd.System
    dt: float
    lammps: Mapping[str, Callable[[], Runner]]


def settled(system: kd.System, dt: float) -> kd.System:
    sim = kd.Simulation(system, "velocity-verlet", dt)
    sim.advance(SETTLE)
    return system.at(sim.state.phase, 0.0)


def of_crystal(name: str, copies: tuple[int, int, int]) -> Start:
    """Copies of a crystal side by side: a shipped system, or silicon under Tersoff's force."""
    one: Any = crystal(kd.Tersoff(), shaken=0.0) if name == "tersoff" else kd.load(name)
    dt = 0.002
    edges, shifts = np.array(one.box.lengths), np.indices(copies).reshape(3, -1).T
    x = (one.state.positions[None] + (shifts * edges)[:, None]).reshape(-1, 3)
    names = [one.species[k] for k in one.species_index] * len(shifts)
    masses = np.tile(one.state.masses, len(shifts))
    system = kd.System(x, None, masses, (edges * copies).tolist(), one.forces, one.units.name, names)
    start = Crystal(settled(system.with_velocities(temperature=1200.0, seed=1), dt), dt)
    skins = {(style, skin): partial(LammpsCrystal, start, style, skin) for style in ("", "opt") for skin in (0.5, 1.0)}
    return Start(
        start.system, dt, {f"{style or 'plain'}, skin {skin:g}": each for (style, skin), each in skins.items()}
    )


def of_mixture(count: int) -> Start:
    x, box = lattice("fcc", count, 1.2)
    pairs = {pair: {"epsilon": epsilon, "sigma": sigma} for pair, (epsilon, sigma) in KOB_ANDERSEN.items()}
    force = kd.LennardJones(cutoff=CUTOFF, truncation="shift", pairs=pairs)
    names = mixture({"A": 0.8, "B": 0.2}, count, 1)
    v, dt = maxwell_boltzmann(np.ones(count), 2.0, 1.0, 1), 0.002
    system = settled(kd.System(x, v, 1.0, box, [force], "lj", names), dt)
    styles = {style or "plain": partial(LammpsMixture, system, dt, style) for style in ("", "opt")}
    return Start(system, dt, styles)


STARTS: dict[str, Callable[[], Start]] = {
    "copper, embedded atom": partial(of_crystal, "copper-864", (1, 1, 1)),
    "copper, embedded atom, many": partial(of_crystal, "copper-864", (3, 3, 4)),
    "silicon, Stillinger-Weber": partial(of_crystal, "silicon-512", (1, 1, 1)),
    "silicon, Stillinger-Weber, many": partial(of_crystal, "silicon-512", (4, 4, 4)),
    "silicon, Tersoff": partial(of_crystal, "tersoff", (1, 1, 1)),
    "silicon, Tersoff, many": partial(of_crystal, "tersoff", (4, 4, 4)),
    "Kob-Andersen mixture": partial(of_mixture, 864),
    "Kob-Andersen mixture, many": partial(of_mixture, 32_000),
}
COLUMNS = "| system | particles | kickdrift, steps/s | LAMMPS, steps/s | kickdrift over it | mixed |"


def in_processor_time(runners: list[Runner], seconds: float, count: int) -> np.ndarray:
    for runner in runners:
        runner.clock = process_time
    return turns(runners, seconds, count)


def row_of(name: str, count: int, seconds: float) -> str:
    """Measure a row of the table."""
    start = STARTS[name]()
    runners: list[Runner] = []
    try:
        for precision in ("double", "mixed"):
            sim = kd.Simulation(start.system, "velocity-verlet", start.dt, precision=precision)
            runners.append(Native(sim, precision))
        for make in start.lammps.values():
            runners.append(make())
        speeds = in_processor_time(runners, seconds, count)
    finally:
        for runner in runners:
            runner.close()
    fastest = 2 + int(np.argmax(np.median(speeds[:, 2:], axis=0)))
    theirs = f"{np.median(speeds[:, fastest]):.4g} ({list(start.lammps)[fastest - 2]})"
    mixed = f"{np.median(speeds[:, 1] / speeds[:, 0]):.2f}"
    return text_of(name, len(start.system), speeds[:, 0], theirs, ratio_of(speeds[:, 0], speeds[:, fastest]), mixed)


def text_of(name: str, particles: int, ours: Any, theirs: str, ratio: Any, mixed: str) -> str:
    spread = f"{ratio.median:.2f} ({ratio.low:.2f} to {ratio.high:.2f})"
    cells = name.removesuffix(", many"), f"{particles:,}", f"{np.median(ours):.4g}", theirs, spread, mixed
    return f"| {' | '.join(cells)} |"


def published_row(name: str, count: int, seconds: float) -> str:
    """Measure one of LAMMPS' own benchmarks."""
    found = published.measure(name, count=count, seconds=seconds)
    theirs = f"{found.lammps:.4g} ({found.style or 'plain'})"
    return text_of(f"LAMMPS' benchmark {name}", found.particles, [found.kickdrift], theirs, found.ratio, "–")


def main() -> None:
    """Measure, and print the rows of the table."""
    names = [*STARTS, *published.BENCHMARKS]
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--turns", type=int, default=7)
    parser.add_argument("--seconds", type=float, default=0.5)
    parser.add_argument("--only", nargs="+", choices=names, default=names)
    given = parser.parse_args()
    print(where("numpy", "lammps"), flush=True)
    print(f"{COLUMNS}\n{'| --- ' * 6}|", flush=True)
    for name in given.only:
        measure = row_of if name in STARTS else published_row
        print(measure(name, given.turns, given.seconds), flush=True)


if __name__ == "__main__":
    main()
