"""Hard spheres under event-driven: hits beside Enskog's rate, pressure beside Carnahan & Starling, energy, cooling.

The unit of length is the diameter. With the density n, the packing fraction eta and the temperature T (k_B = m = 1):

    value of the pair correlation at contact   g = (1 - eta / 2) / (1 - eta)^3   (Carnahan & Starling 1969)
    hits of all N spheres in a unit of time    N / 2 x 4 n g sqrt(pi T)          (Enskog)
    pressure                                   n T (1 + 4 eta g)

A gas of restitution e that stays alike everywhere cools as T0 / (1 + t / tau)^2 (Haff 1983). Each hit takes the part
(1 - e^2) / 4 of the relative energy on average, so 1 / tau = (1 - e^2) / 6 x 4 n g sqrt(pi T0), with velocities that
are normal. Their true distribution has an excess, which changes the rate by 3 a2 / 16 of itself (van Noije & Ernst
1998, doi:10.1007/s100350050009, eqs. 14 and 21).
"""

import math

import numpy as np

import kickdrift as kd
from kickdrift.model.starts.builders import lattice
from kickdrift_validation.claim import Claim, at_most, claim, main

SPHERES = 256
PACKINGS = (0.2, 0.4)
WARM = 40.0  # time before the first sample, some 100 hits of a sphere
RATE, PRESSURE, ENERGY, OVERLAP, COOLING = 0.02, 0.01, 1e-12, 1e-12, 0.02
RESTITUTION = 0.9
GAS, FEWER = 4000, 864  # spheres of a gas that cools
REPLICAS = 16
STARLING = "Carnahan & Starling 1969, doi:10.1063/1.1672048"
ENSKOG = f"Enskog's rate with the contact value of {STARLING}"
HAFF = "Haff 1983, doi:10.1017/S0022112083003419; van Noije & Ernst 1998, doi:10.1007/s100350050009"


def contact(packing: float) -> float:
    """Pair correlation at contact."""
    return (1.0 - 0.5 * packing) / (1.0 - packing) ** 3


def spheres(n: int, packing: float, seed: int = 1) -> kd.System:
    """Spheres on a lattice with random velocities, T = 1, whose centre of mass rests."""
    x, edges = lattice("fcc", n, 6.0 / math.pi * packing)
    v = np.random.default_rng(seed).normal(size=(n, 3))
    v -= v.mean(axis=0)
    v *= math.sqrt((3 * n - 3) / (v**2).sum())
    bounce = kd.Collision(radii=0.5, action="bounce")
    return kd.System(x, v, box=edges, events=[bounce])


def least_gap(system: kd.System, x: np.ndarray) -> float:
    """Least distance of two spheres less the diameter, by SciPy's tree in a periodic box."""
    from scipy.spatial import cKDTree

    edges = system.box.lengths
    near, _ = cKDTree(system.box.wrap(x), boxsize=edges).query(system.box.wrap(x), 2)
    return float(near[:, 1].min()) - 1.0


def fluid(packing: float, hits: int) -> list[Claim]:
    """Rate of hits, pressure, energy and overlap of a fluid over at least so many hits."""
    density, g = 6.0 / math.pi * packing, contact(packing)
    expected = SPHERES / 2 * 4.0 * density * g * math.sqrt(math.pi)
    system, dt = spheres(SPHERES, packing), 0.1
    sim = kd.Simulation(system, "event-driven", dt)
    sim.run(round(WARM / dt))
    before, steps = sim.report().hits.spheres, 10 * math.ceil(hits / expected / dt / 10)
    sim.state = sim.state  # a record of its own
    gaps: list[float] = []
    report = sim.run(steps, every=10, observe=lambda s: gaps.append(least_gap(system, s.state.positions)))
    found, span = report.hits.spheres, steps * dt
    assert before > 10_000
    text = f"{SPHERES} spheres, packing {packing:g}, {found:,} hits"
    rate, pressure = found / span / expected, report.pressure / (density * (1.0 + 4.0 * packing * g))
    off = report.energy.max_relative_error
    return [
        claim(f"{text}: hits in a unit of time over Enskog's", rate, f"1 within {RATE:g}", abs(rate - 1) <= RATE,
              ENSKOG),
        claim(f"{text}: pressure over Carnahan & Starling's", pressure, f"1 within {PRESSURE:g}",
              abs(pressure - 1) <= PRESSURE, STARLING),
        at_most(f"{text}: largest relative error of the energy", off, ENERGY, "the start"),
        at_most(f"{text}: deepest overlap of two spheres at {len(gaps)} frames", -min(gaps), OVERLAP,
                "SciPy's cKDTree"),
    ]  # fmt: skip


def excess(e: float) -> float:
    """Excess a2 of the velocities of a gas that cools."""
    return 16 * (1 - e) * (1 - 2 * e * e) / (81 - 17 * e + 30 * e * e * (1 - e))


def cooling(n: int, packing: float, time: float) -> list[Claim]:
    """Temperature of a gas that cools, in the mean of replicas, beside Haff's law."""
    density, g, e = 6.0 / math.pi * packing, contact(packing), RESTITUTION
    rate = (1 - e * e) / 6 * 4 * density * g * math.sqrt(math.pi) * (1 + 3 / 16 * excess(e))
    found, offs, hits = [], [], 0
    for seed in range(REPLICAS):
        sim = kd.Simulation(spheres(n, packing, seed=seed), "event-driven", 0.5)
        sim.run(20)  # in equilibrium before the loss begins
        bounce = kd.Collision(radii=0.5, action="bounce", restitution=e)
        gas = sim.system.at(sim.state.phase, 0.0).watched([bounce])
        sim = kd.Simulation(gas, "event-driven", 0.5)
        report = sim.run(round(time / 0.5), every=2)
        times, energies = np.array([(s.time, s.energies.kinetic) for s in sim.record.samples]).T
        found.append(energies / energies[0] * (1 + rate * times) ** 2)
        offs.append(report.energy.max_relative_error)
        hits += report.hits.spheres
    mean = np.mean(found, axis=0)
    error = float(np.std(found, axis=0, ddof=1)[-1]) / math.sqrt(REPLICAS)
    text = f"{REPLICAS} gases of {n}, packing {packing:g}, restitution {e:g}, {hits:,} hits"
    return [
        at_most(f"{text}: largest relative distance of T from Haff's law while T falls to "
                f"{1 / (1 + rate * times[-1]) ** 2:.3g}, with a standard error of {error:.2g} at the end",
                float(np.abs(mean - 1).max()), COOLING, HAFF),
        at_most(f"{text}: relative error of the energy with what the hits took", max(offs), ENERGY, "the start"),
    ]  # fmt: skip


def claims(long: bool = False) -> list[Claim]:
    """Fluids at two packing fractions, and a gas that cools."""
    hits = 1_000_000 if long else 150_000
    rows = [row for packing in PACKINGS for row in fluid(packing, hits)]
    return rows + cooling(GAS if long else FEWER, 0.1, 60.0 if long else 30.0)


if __name__ == "__main__":
    main(claims, __doc__)
