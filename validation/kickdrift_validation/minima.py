"""Does minimization reach the published minima of Lennard-Jones clusters, and does it relax random starts?

Energies: Wales & Doye 1997, doi:10.1021/jp970984n, and the Cambridge Cluster Database, six digits. Geometries are those
that they publish: LJ13 is an icosahedron, LJ38 a truncated octahedron cut from an fcc crystal, LJ55 a Mackay
icosahedron. Each cluster begins with its nearest neighbours 1.2 sigma apart and relaxes in open space without a cutoff
that matters. The energy is that of a direct sum in NumPy, not of kickdrift's forces.

Random starts: 1000 particles, rho* = 0.85, at places drawn independently of each other, so that many overlap. Some
relax to forces of 1e-6 and equilibrate at constant energy. A hundred relax to forces of 0.01 and equilibrate in a heat
bath (baoab).
"""

from collections.abc import Iterator
from itertools import combinations, permutations, product

import numpy as np

import kickdrift as kd
from kickdrift_validation.claim import Claim, claim, largest, main, under

PUBLISHED = {13: -44.326801, 38: -173.928427, 55: -279.248470}
REFERENCE = "Wales & Doye 1997; Cambridge Cluster Database"
ENERGY = 1e-6  # bound on the difference from the published energy
METHODS = ("fire", "l-bfgs")
SHORT, LONG = 5, 100  # random starts
PARTICLES, DENSITY, DT = 1000, 0.85, 0.004
TEMPERATURE, EQUILIBRATION_TIME, STEPS = 1.44, 5.0, 1000
IN_BATHS, SOFT = 100, 0.01  # random starts that equilibrate in a heat bath, and the forces to which they relax
FRICTION, BATH_TIME, BATH_STEPS = 5.0, 1.0, 250
NEAR = 0.1  # bound on the relative difference of a run's mean temperature from that of its equilibration


def icosahedron() -> np.ndarray:
    """Corners (12, 3) of an icosahedron with edges of 2."""
    golden = (1.0 + np.sqrt(5.0)) / 2.0
    corners = [(0.0, a, b * golden) for a, b in product((-1.0, 1.0), repeat=2)]
    return np.array([np.roll(corner, k) for corner in corners for k in range(3)])


def cluster(n: int) -> np.ndarray:
    """Places (n, 3) in the published structure, the nearest neighbours 1.2 apart."""
    if n == 38:
        kinds = ((1, 0, 0), (1, 1, 1), (2, 1, 0))  # fcc sites about an octahedral hole: 6, 8 and 24
        found = {
            tuple(sign * value for sign, value in zip(signs, order, strict=True))
            for kind in kinds
            for order in permutations(kind)
            for signs in product((-1, 1), repeat=3)
        }
        places = np.array(sorted(found), dtype=float)
    else:
        corners = icosahedron()
        places = np.vstack([np.zeros((1, 3)), corners])
        if n == 55:
            edges = [a + b for a, b in combinations(corners, 2) if np.linalg.norm(a - b) < 2.1]
            places = np.vstack([places, 2.0 * corners, edges])
    assert len(places) == n
    return places * 1.2 / distances(places).min()


def distances(places: np.ndarray) -> np.ndarray:
    i, j = np.triu_indices(len(places), k=1)
    found: np.ndarray = np.linalg.norm(places[i] - places[j], axis=1)
    return found


def energy(places: np.ndarray) -> float:
    """Lennard-Jones energy by a direct sum."""
    inverse6 = distances(places) ** -6.0
    return float((4.0 * inverse6 * (inverse6 - 1.0)).sum())


def clusters() -> Iterator[Claim]:
    """Compare the energies with the published ones."""
    for n, published in PUBLISHED.items():
        for method in METHODS:
            force = kd.LennardJones(cutoff=100.0, truncation="cut")
            sim = kd.Simulation(kd.System(cluster(n), forces=[force]), dt=DT)
            found = sim.minimize(method=method)
            off = abs(energy(sim.state.positions) - published)
            print(f"LJ{n} {method}: {found.energy:.6f} after {found.evaluations} evaluations", flush=True)
            yield claim(
                f"energy of LJ{n}, {method}: difference from {published:.6f}", off, f"under {ENERGY:g}",
                found.converged and off < ENERGY, REFERENCE,
            )  # fmt: skip


def random_start(seed: int) -> kd.System:
    """Particles at random places in a periodic box."""
    edge = (PARTICLES / DENSITY) ** (1 / 3)
    places = np.random.default_rng(seed).uniform(0.0, edge, (PARTICLES, 3))
    return kd.System(places, box=(edge,) * 3, forces=[kd.LennardJones(cutoff=2.5, truncation="switch")])


def random_starts(count: int) -> Iterator[Claim]:
    """Relax, equilibrate and run every start."""
    relaxed = finished = most = 0
    hottest = 0.0
    for seed in range(1, count + 1):
        found = kd.Simulation(random_start(seed), dt=DT).minimize()
        relaxed += found.converged
        most = max(most, found.steps)
        start = found.system.with_velocities(temperature=TEMPERATURE, seed=seed)
        sim = kd.Simulation(start, dt=DT)
        try:
            sim.equilibrate(TEMPERATURE, EQUILIBRATION_TIME)
            report = sim.run(STEPS)
        except kd.RunError as error:
            print(f"start {seed}: {error}", flush=True)
            continue
        finished += 1
        hottest = largest(hottest, abs(float(report.temperature) / TEMPERATURE - 1.0))
        print(
            f"start {seed}: {found.energy_at_start:.2g} -> {found.energy:.3f} in {found.steps} steps; "
            f"T* = {report.temperature:.3f}",
            flush=True,
        )
    where = f"{count} random starts of {PARTICLES} particles, rho* = {DENSITY:g}"
    yield claim("random starts that relaxed to forces of 1e-6", relaxed, f"all {count}", relaxed == count, where)
    yield claim("relaxed starts that equilibrated and ran", finished, f"all {count}", finished == count, where)
    yield under("largest relative difference of the mean temperature", hottest, NEAR, where)
    print(f"most steps: {most}", flush=True)


def starts_in_baths() -> Iterator[Claim]:
    """Relax every start a little, equilibrate it in a heat bath, and run."""
    relaxed = finished = 0
    hottest = 0.0
    for seed in range(1, IN_BATHS + 1):
        found = kd.Simulation(random_start(seed), dt=DT).minimize(force=SOFT)
        relaxed += found.converged
        start = found.system.with_velocities(temperature=TEMPERATURE, seed=seed)
        sim = kd.Simulation(start, "baoab", DT, temperature=TEMPERATURE, friction=FRICTION)
        try:
            sim.equilibrate(TEMPERATURE, BATH_TIME)
            report = sim.run(BATH_STEPS)
        except kd.RunError as error:
            print(f"start {seed}: {error}", flush=True)
            continue
        finished += 1
        hottest = largest(hottest, abs(float(report.temperature) / TEMPERATURE - 1.0))
    where = f"{IN_BATHS} random starts of {PARTICLES} particles, rho* = {DENSITY:g}"
    bound = f"all {IN_BATHS}"
    yield claim(f"random starts that relaxed to forces of {SOFT:g}", relaxed, bound, relaxed == IN_BATHS, where)
    yield claim("starts that equilibrated in a heat bath and ran", finished, bound, finished == IN_BATHS, where)
    yield claim(
        "largest relative difference of the mean temperature in a heat bath", hottest, f"under {NEAR:g}",
        hottest < NEAR, where,
    )  # fmt: skip


def claims(long: bool = False) -> Iterator[Claim]:
    """Claims on the clusters, on a few random starts (on a hundred in the long set), and on a hundred in a bath."""
    yield from clusters()
    yield from random_starts(LONG if long else SHORT)
    yield from starts_in_baths()


if __name__ == "__main__":
    main(claims, __doc__)
