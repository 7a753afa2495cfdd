"""Molten sodium chloride of Tosi and Fumi: density and g(r) at 1100 K beside LAMMPS, and its melting point.

The parameters are those of Fumi & Tosi (J. Phys. Chem. Solids 25, 31 and 45, 1964) as Anwar, Frenkel & Noro (2003,
doi:10.1063/1.1522375) give them. Density and g(r) are means at 1100 K and 1 bar, beside LAMMPS' ``fix npt iso`` from
the same state with the same forces: both leave out what lies beyond the cutoff.

Anwar, Frenkel & Noro found from free energies that crystal and melt are in equilibrium at 1064 ± 14 K. Here a crystal
stands beside its melt at constant pressure and enthalpy. Crystal that grows heats the box and crystal that melts cools
it, until both stay.
"""

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

import kickdrift as kd
from kickdrift.engines.job import Job
from kickdrift.engines.lammps import model_of
from kickdrift.engines.lammps_world import World
from kickdrift.integrators import INTEGRATORS
from kickdrift.integrators.options import Options
from kickdrift.statistics.blocks import block_average
from kickdrift_validation.claim import Claim, claim, main, not_run

ROOM, DT, EVERY = 1100.0, 0.002, 50  # K, ps, steps
BAR = 1e-4 / 160.2176634  # in eV per cubic angstrom
KJ = 1.0 / 96.48533212  # kJ/mol in eV
MOLE = 0.602214076  # atoms per cubic angstrom in mol/cm3
MASSES = {"Na": 22.98976928, "Cl": 35.45}
LAMMPS = "LAMMPS, fix npt iso"
ANWAR, ANWAR_ERROR = 1064.0, 14.0  # K
START, HOT = 1090.0, 2000.0  # K
UNIT = np.array([[0, 0, 0], [0.5, 0.5, 0], [0.5, 0, 0.5], [0, 0.5, 0.5]])
PAIRS = (("Na", "Cl"), ("Na", "Na"), ("Cl", "Cl"))
CUTOFF, WIDTH, BINS = 12.0, 0.1, 60  # of the forces; a bin of g(r), in angstroms; bins
SETTLE, GROUPS, RUNS, SIGMAS = 2500, 10, 2, 3.0


def tosi_fumi(cutoff: float, whole: bool) -> kd.BornMayerHuggins:
    """Repulsion and dispersion of the ions, cut like LAMMPS', or ``whole`` with what lies beyond the cutoff."""
    rows = {
        ("Na", "Na"): (25.4435, 2.340, 101.1719, 48.1771),
        ("Na", "Cl"): (20.3548, 2.755, 674.4793, 837.077),
        ("Cl", "Cl"): (15.2661, 3.170, 6985.6786, 14031.5785),
    }
    given = {
        pair: {"A": a * KJ, "rho": 1.0 / 3.1546, "sigma": sigma, "C": c * KJ, "D": -d * KJ}
        for pair, (a, sigma, c, d) in rows.items()
    }
    own = {pair[0]: given.pop(pair) for pair in (("Na", "Na"), ("Cl", "Cl"))}
    rest: dict[str, Any] = {"truncation": "potential-switch", "tail": True} if whole else {"truncation": "shift"}
    return kd.BornMayerHuggins(species=own, pairs=given, cutoff=cutoff, **rest)


def salt(cells: tuple[int, int, int], edge: float, cutoff: float, whole: bool) -> kd.System:
    """A crystal of so many unit cells of this edge."""
    corners = np.stack(np.meshgrid(*map(np.arange, cells), indexing="ij"), -1).reshape(-1, 1, 3)
    x = ((corners + np.concatenate([UNIT, UNIT + np.array([0.5, 0, 0])]) + 0.125) * edge).reshape(-1, 3)
    kinds = (["Na"] * 4 + ["Cl"] * 4) * math.prod(cells)
    return kd.System(
        x, masses=[MASSES[each] for each in kinds], box=np.array(cells) * edge, units="metal", species=kinds,
        charges=[1.0 if each == "Na" else -1.0 for each in kinds],
        forces=[tosi_fumi(cutoff, whole), kd.Coulomb("auto", accuracy=1e-4)],
    )  # fmt: skip


def settled(system: kd.System, temperature: float, steps: int, **options: Any) -> kd.System:
    """The System after some steps of Langevin's bath."""
    sim = kd.Simulation(system, "baoab", DT, temperature=temperature, friction=2.0, **options)
    sim.advance(steps)
    found: kd.System = sim.now()
    return found


def pressed(coupling: str = "isotropic") -> dict[str, Any]:
    """Options of a gentle barostat at 1 bar."""
    return {"pressure": BAR, "pressure_tau": 1.0, "compressibility": 50.0, "coupling": coupling}


def two_phases(seed: int) -> kd.System:
    """Crystal beside melt near the melting point: springs hold a third of a crystal while the rest melts."""
    cold = salt((4, 4, 12), 5.90, 10.0, whole=True)
    solid = settled(cold, START, 2000, seed=seed, **pressed())
    lower = np.flatnonzero(cold.state.positions[:, 2] < 0.35 * cold.box.lengths[2])
    held = solid.with_forces(*solid.forces, kd.Restraint(5.0, particles=lower))
    molten = settled(held, HOT, 8000, seed=seed + 1, **pressed("semi-isotropic"))
    cooled = settled(molten, START, 1500, seed=seed + 2, **pressed("semi-isotropic"))
    return settled(cooled.with_forces(*solid.forces), START, 250, seed=seed + 3, **pressed("semi-isotropic"))


def coexistence(start: kd.System, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Temperatures, and potential energies of an ion, at constant pressure and enthalpy."""
    sim = kd.Simulation(
        start, "nose-hoover", DT, temperature=START, tau=1e5, pressure=BAR, pressure_tau=2.0, barostat="mtk",
        coupling="semi-isotropic",
    )  # fmt: skip
    sim.run(steps, every=25)
    samples = sim.record.samples
    found = np.array([[each.temperature, each.energies.potential / len(start)] for each in samples])
    return found[:, 0], found[:, 1]


class Melt(NamedTuple):
    """Volumes of an ion (f,), and g(r) of each of PAIRS in groups of frames (groups, pairs, bins)."""

    volumes: np.ndarray
    g: np.ndarray


def ours(start: kd.System, steps: int) -> Melt:
    """The melt in kickdrift."""
    sim = kd.Simulation(
        start, "nose-hoover", DT, temperature=ROOM, tau=0.1, pressure=BAR, barostat="mtk", pressure_tau=1.0
    )
    sim.advance(SETTLE)
    names = [start.species[k] for k in start.species_index]
    volumes: list[float] = []
    found = []
    for _ in range(GROUPS):
        places: list[np.ndarray] = []
        boxes: list[kd.Box] = []

        def watch(run: kd.Simulation, places: list[np.ndarray] = places, boxes: list[kd.Box] = boxes) -> None:
            places.append(run.state.positions)
            boxes.append(run.state.box)

        sim.run(steps // GROUPS, every=EVERY, observe=watch)
        volumes += [each.volume / len(start) for each in boxes]
        found.append([
            kd.analysis.radial_distribution(
                np.array(places), box=boxes, r_max=BINS * WIDTH, bins=BINS, pair=pair, species=names
            ).g
            for pair in PAIRS
        ])  # fmt: skip
    return Melt(np.array(volumes), np.array(found))


def of_lammps(start: kd.System, steps: int) -> Melt:
    """The same from the same state on in LAMMPS, whose ``compute rdf`` counts the pairs."""
    job = Job(start, INTEGRATORS["velocity-verlet"], "velocity-verlet", Options(dt=DT))
    energy = start.units.boltzmann * ROOM
    world = World()
    try:
        model = model_of(job, 1)._replace(fixes=())
        world.reset(model, start.box.wrap(start.state.positions), start.state.velocities)
        kinds = {
            name: int(model.types[np.flatnonzero(start.species_index == k)[0]]) for k, name in enumerate(start.species)
        }
        counted = " ".join(f"{kinds[one]} {kinds[other]}" for one, other in PAIRS)
        world.lmp.commands_string(f"""
velocity all zero linear
fix pressed all npt temp {energy!r} {energy!r} 0.1 iso {BAR!r} {BAR!r} 1.0 mtk yes
compute pairs all rdf {round(CUTOFF / WIDTH)} {counted}
run {SETTLE} post no
""")
        volumes, found = [], []
        for _ in range(GROUPS):
            frames = []
            for _ in range(steps // GROUPS // EVERY):
                world.lmp.command(f"run {EVERY} post no")
                low, high, *_ = world.lmp.extract_box()
                volumes.append(float(np.prod(np.array(high) - low)) / len(start))
                table = world.lmp.numpy.extract_compute("pairs", 0, 2)
                frames.append(np.array(table)[:BINS, 1::2].T)
            found.append(np.mean(frames, axis=0))
    finally:
        world.close()
    return Melt(np.array(volumes), np.array(found))


def peak(g: np.ndarray) -> tuple[float, float]:
    """Place and height of the first peak of g (bins,): those of a parabola through its highest bins."""
    top = int(np.argmax(g))
    near = np.arange(top - 2, top + 3)
    a, b, c = np.polyfit((near + 0.5) * WIDTH, g[near], 2)
    return -b / (2 * a), c - b * b / (4 * a)


def numbers(melt: Melt) -> dict[str, tuple[float, float]]:
    """Density in g/cm3, and place (angstrom) and height of each first peak, each with its standard error."""
    volume = block_average(melt.volumes)
    density = sum(MASSES.values()) / 2 / MOLE / volume.value
    found = {"density in g/cm3": (density, density * volume.error / volume.value)}
    for k, (one, other) in enumerate(PAIRS):
        peaks = np.array([peak(each[k]) for each in melt.g])
        errors = peaks.std(axis=0, ddof=1) / math.sqrt(GROUPS)
        for what, value, error in zip(("place in Å", "height"), peaks.mean(axis=0), errors, strict=True):
            found[f"first peak of g(r) of {one} and {other}, {what}"] = (value, error)
    return found


def melt_claims(long: bool) -> Iterator[Claim]:
    """Density and first peaks of the melt beside LAMMPS."""
    steps = 200_000 if long else 20_000
    start = settled(salt((4, 4, 4), 6.25, CUTOFF, whole=False), 3000.0, 5000, seed=5)
    start = settled(start, ROOM, 10_000, seed=6, **pressed())
    found = numbers(ours(start, steps))
    bound = f"within {SIGMAS:g} standard errors of LAMMPS'"
    try:
        theirs = numbers(of_lammps(start, steps))
    except ImportError:
        yield from (not_run(f"molten salt at {ROOM:.0f} K: {what}", bound, LAMMPS) for what in found)
        return
    for what, (value, error) in found.items():
        other, spread = theirs[what]
        off = abs(value - other) / math.hypot(error, spread)
        text = f"{value:.4f}({error:.4f}), LAMMPS {other:.4f}({spread:.4f})"
        print(f"  {what}: {text}, {off:.1f} standard errors", flush=True)
        yield claim(f"molten salt at {ROOM:.0f} K: {what}", text, bound, off <= SIGMAS, LAMMPS)


def melting_claims() -> Iterator[Claim]:
    """The melting point."""
    means = []
    for seed in range(RUNS):
        temperatures, _ = coexistence(two_phases(10 * (seed + 1)), 50_000)
        means.append(temperatures[len(temperatures) // 3 :].mean())
    value, error = float(np.mean(means)), float(np.std(means, ddof=1) / math.sqrt(RUNS))
    text = f"{value:.0f}({error:.0f}) K"
    print(f"  melting point: {text}", flush=True)
    bound = f"within two standard errors of {ANWAR:.0f}({ANWAR_ERROR:.0f}) K"
    held = abs(value - ANWAR) <= 2.0 * math.hypot(error, ANWAR_ERROR)
    yield claim("salt of Tosi and Fumi: melting point at 1 bar", text, bound, held, "Anwar, Frenkel & Noro 2003")


def claims(long: bool = False) -> Iterator[Claim]:
    yield from melt_claims(long)
    if long:
        yield from melting_claims()


if __name__ == "__main__":
    main(claims, __doc__)
