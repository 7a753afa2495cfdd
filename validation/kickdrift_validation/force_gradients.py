"""Forces are minus the gradient of the energy, pressure is minus its slope with the volume, and no pair is missed.

Energies and forces are compiled apart, so that each can be held against the other: energies of positions moved to and
fro along a random direction, Richardson's extrapolation of three differences (error h^6), against -F . d, for every
force of the registry; energies of a box that is stretched against the virial. No pair crosses the cutoff on the way,
where a plain cut would jump. Pair forces are of a mixture here; pair_forces.py has one species.

Forces of a run come out of its positions, a_n = (x_n+1 - 2 x_n + x_n-1) / dt^2 under velocity Verlet. They are held
against direct sums over all pairs in NumPy at every step of a hot fluid, in which a pair list that is refreshed late
misses pairs. This does not see chaos: each step is on its own.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

import kickdrift as kd
from kickdrift.forces import FORCES
from kickdrift.forces.many_body.base import ManyBodyForce
from kickdrift.forces.pairs.ends import TRUNCATIONS
from kickdrift.forces.pairs.law import PairForce
from kickdrift_validation.claim import Claim, at_most, claim, main
from kickdrift_validation.example_forces import charges, crystal, example, topology
from kickdrift_validation.lennard_jones import direct, frames_of
from kickdrift_validation.performance.liquids import CUTOFF, DENSITY, DT, melt

EDGE, LATTICE, H = 6.0, 3, 2e-3
CLEAR = 0.01  # what no pair's distance is nearer than to the cutoff, or to where a switch begins
SLOPE = 1e-10  # relative: rounding of the energy over the smallest h, and what h^6 leaves, are 1e-12
MIXTURE = {"A": {"epsilon": 1.0, "sigma": 1.0}, "B": {"epsilon": 0.5, "sigma": 0.88}}  # Kob & Andersen's sizes
HOT, STEPS, PARTICLES = 1.7, 300, 512  # times the velocities of T* = 1.33
OPEN: dict[str, Callable[[], Any]] = {  # forces of open space that example_forces would not show at their fullest
    "gravity": lambda: kd.Gravity(G=1.0, softening=0.1),
    "relativity-1pn": lambda: kd.PostNewtonian(c=20.0, form="potential", G=1.0),
    "j2": lambda: kd.Oblateness(j2=0.1, radius=0.8, j3=0.04, j4=-0.05, j5=0.02, j6=0.03, pole=(0.3, -0.4, 0.8), G=1.0),
    "tides": lambda: kd.Tides(k2=0.1, radius=0.8, G=1.0),
    "radiation-pressure": lambda: kd.RadiationPressure(0.3, form="potential", G=1.0),
    "central-potential": lambda: kd.CentralPotential(-0.3, -1.5),
    "springs": lambda: kd.Springs([(0, 1), (1, 2), (5, 9)], stiffness=3.0, length=0.7),
    "harmonic-trap": lambda: kd.HarmonicTrap((1.0, 2.0, 3.0), (0.1, 0.2, 0.3)),
    "restraint": lambda: kd.Restraint((1.0, 2.0, 3.0), [2, 0], [(0.1, 0.2, 0.3), (1.0, -0.5, 0.0)]),
    "harmonic-wall": lambda: kd.HarmonicWall(3.0, (1.0, 2.0, 3.0), (0.1, 0.2, 0.3), reach=20.0),
    "lennard-jones-wall": lambda: kd.LennardJonesWall((1.0, 2.0, 3.0), 20.0, (-1.0, -1.0, -1.0)),
    "uniform-field": lambda: kd.UniformField((0.1, -0.2, 0.3)),
    "driven-field": lambda: kd.DrivenField((0.1, -0.2, 0.3), 0.7, 0.4),
}
PLANETARY = "depends on velocity or time: kickdrift_validation.planetary_forces"
NOT_GRADIENTS = dict.fromkeys(
    (
        "relativity-eih",
        "tides-spin",
        "lense-thirring",
        "relativity-2.5pn",
        "non-gravitational",
        "migration",
        "gas-drag",
        "dynamical-friction",
        "mass-change",
    ),
    PLANETARY,
) | {
    "linear-drag": "depends on velocity and has no energy",
    "reflecting-wall": "mirrors particles, and has no energy: tests/unit/integrators/test_mirrors.py",
    "hill": "depends on velocity: kickdrift_validation.shearing_sheet",
    "ase": "its calculator is ASE's: kickdrift_validation.calculators",
    "eam": "the curvature of its tables jumps, which differences of h^6 do not bear: kickdrift_validation.many_body",
    "gravity-tree": "its energy and its forces are expansions, each to `accuracy`: kickdrift_validation.barnes_hut",
}
DIFFERENCES = "differences of the energy, Richardson's extrapolation"


def places() -> np.ndarray:
    """(27, 3): a lattice, shaken until no pair is near the cutoff or near the start of the switch."""
    sites = np.stack(np.meshgrid(*[np.arange(LATTICE)] * 3), -1).reshape(-1, 3) * (EDGE / LATTICE)
    i, j = np.triu_indices(len(sites), 1)
    for seed in range(10_000):
        x = sites + np.random.default_rng(seed).uniform(-0.35, 0.35, sites.shape)
        separation = x[i] - x[j]
        r = np.linalg.norm(separation - EDGE * np.round(separation / EDGE), axis=1)
        if min(np.abs(r - mark).min() for mark in (CUTOFF, 0.8 * CUTOFF)) > CLEAR and r.min() > 0.95:
            return x
    raise ArithmeticError("no such places")


def slope(f: Callable[[float], float]) -> float:
    """df / ds at 0, from differences over H, H / 2 and H / 4."""
    d = [(f(h) - f(-h)) / (2 * h) for h in (H, H / 2, H / 4)]
    once = [(4 * d[k + 1] - d[k]) / 3 for k in range(2)]
    return (16 * once[1] - once[0]) / 15


def simulation(x: np.ndarray, force: Any, edge: float | None = None, masses: Any = 1.0) -> kd.Simulation:
    """The particles at rest; of two kinds where the force knows two."""
    mixed = isinstance(force, PairForce) and (force.species or force.pairs)
    species, units = ["AB"[k % 2] for k in range(len(x))] if mixed else None, "lj"
    if isinstance(force, ManyBodyForce):
        species, units = [force.known[0]] * len(x), "metal"
    box, joined = None if edge is None else [edge] * 3, topology(force)
    given = {"topology": joined, "charges": charges(force, len(x))}
    system = kd.System(x, masses=masses, box=box, forces=[force], units=units, species=species, **given)
    return kd.Simulation(system, dt=DT)


def gradient(force: Any, x: np.ndarray, edge: float | None) -> float:
    """-F . d against the slope of the energy along d, relative to |F|."""
    masses = np.linspace(0.5, 1.5, len(x))
    way = np.random.default_rng(1).standard_normal(x.shape)
    way /= np.linalg.norm(way)
    along = slope(lambda s: simulation(x + s * way, force, edge, masses).energy().potential)
    forces = simulation(x, force, edge, masses).forces()
    return abs(along + float((forces * way).sum())) / float(np.linalg.norm(forces))


def stretched(force: Any, x: np.ndarray) -> float:
    """The virial 3 P V of particles at rest against minus the slope of the energy with the box's scale, relative."""
    along = slope(lambda s: simulation(x * (1 + s), force, EDGE * (1 + s)).energy().potential)
    virial = 3.0 * EDGE**3 * simulation(x, force, EDGE).sample().pressure
    return abs(virial / -along - 1.0)


def others() -> list[str]:
    """Forces of the registry that are gradients and no pair laws."""
    pairs = {name for name, force in FORCES.items() if isinstance(force, type) and issubclass(force, PairForce)}
    return [name for name in FORCES if name not in pairs | {*NOT_GRADIENTS}]


def made(name: str) -> Any:
    """One of a force that is no pair law."""
    return OPEN[name]() if name in OPEN else example(FORCES[name], G=1.0)


def gradient_of(name: str) -> float:
    """``gradient`` of a force that is no pair law: a crystal for a many-body force, else particles in open space."""
    force = made(name)
    if not isinstance(force, ManyBodyForce):
        return gradient(force, 0.5 * places(), None)
    system = crystal(force)
    return gradient(force, system.state.positions, float(system.box.lengths[0]))


def gradients() -> list[Claim]:
    """Every force of the registry, every truncation of the pair laws between two species."""
    x, rows, bound = places(), [], f"at most {SLOPE:g}"
    pair_forces = [force for force in FORCES.values() if isinstance(force, type) and issubclass(force, PairForce)]
    for kind in pair_forces:
        for truncation in TRUNCATIONS:
            mixed = {"epsilon", "sigma"} <= {*kind.law_keys}
            own = {"species": MIXTURE} if mixed else {"pairs": {("A", "B"): {kind.law_keys[0]: 0.8}}}
            force, name = example(kind, cutoff=CUTOFF, truncation=truncation, **own), f"{kind.name}, {truncation}"
            off = gradient(force, x, EDGE)
            rows.append(claim(f"{name}, mixture: force, relative difference", off, bound, off <= SLOPE, DIFFERENCES))
            off = stretched(force, x)
            text = f"{name}, mixture: virial, relative difference"
            rows.append(claim(text, off, bound, off <= SLOPE, "energy of a stretched box"))
    for name in others():
        off = gradient_of(name)
        rows.append(claim(f"{name}: force, relative difference", off, bound, off <= SLOPE, DIFFERENCES))
    return rows


def tails() -> list[Claim]:
    """What lies beyond the cutoff in a uniform fluid; Allen & Tildesley 2017, eqs. 2.144 to 2.146."""
    x, volume = places(), EDGE**3
    sixth = 0.5 * (1.0 + 0.88)
    kinds = {(0, 0): (1.0, 1.0), (0, 1): (math.sqrt(0.5), sixth), (1, 0): (math.sqrt(0.5), sixth), (1, 1): (0.5, 0.88)}
    rows = []
    for name, mixed, counts in (("one species", None, [len(x)]), ("mixture", MIXTURE, [14, 13])):
        energy = pressure = 0.0
        for (a, b), (epsilon, sigma) in kinds.items():
            if max(a, b) < len(counts):
                pairs, q = counts[a] * counts[b] / volume, sigma / CUTOFF
                energy += 8 / 3 * math.pi * pairs * epsilon * sigma**3 * (q**9 / 3 - q**3)
                pressure += 16 / 3 * math.pi * pairs / volume * epsilon * sigma**3 * (2 / 3 * q**9 - q**3)
        forces = [kd.LennardJones(cutoff=CUTOFF, truncation="cut", species=mixed, tail=tail) for tail in (False, True)]
        samples = [simulation(x, force, EDGE).sample() for force in forces]
        found = samples[1].energies.potential - samples[0].energies.potential, samples[1].pressure - samples[0].pressure
        for what, value, wanted in zip(("energy", "pressure"), found, (energy, pressure), strict=True):
            text = f"{what} from beyond the cutoff, {name}, relative difference"
            rows.append(at_most(text, abs(value / wanted - 1.0), 1e-11, "Allen & Tildesley 2017, eqs. 2.144-2.146"))
    return rows


def pair_list() -> list[Claim]:
    """The forces of a run."""
    melted = melt(PARTICLES, 200)
    state, edges = melted.state, np.array(melted.system.box.lengths)
    hot = kd.System(state.positions, HOT * state.velocities, box=melted.system.box, forces=melted.system.forces)
    frames = frames_of(kd.Simulation(hot, dt=DT), STEPS)
    used = (frames[2:] - 2 * frames[1:-1] + frames[:-2]) / DT**2
    worst, off = 0, 0.0
    for k, x in enumerate(frames[1:-1]):
        miss = float(np.abs(used[k] - direct(x, edges, CUTOFF).forces).max())
        if not miss <= off:  # nan, too
            worst, off = k + 1, miss
    moved = float(np.linalg.norm(frames[-1] - frames[0], axis=1).max())
    bound = 4.0 * float(np.spacing(np.abs(frames).max())) / DT**2
    text = (
        f"forces in {STEPS} steps at rho* = {DENSITY}, way of up to {moved:.1f} sigma; largest difference, step {worst}"
    )
    reference = "direct sums in NumPy; four roundings of a place over dt^2, and a missed pair is 0.04"
    return [claim(text, off, f"at most {bound:.1g}", off <= bound, reference)]


def claims(long: bool = False) -> list[Claim]:
    for name, why in NOT_GRADIENTS.items():
        print(f"not looked at: {name}: {why}")
    return [*gradients(), *tails(), *pair_list()]


if __name__ == "__main__":
    main(claims, __doc__)
