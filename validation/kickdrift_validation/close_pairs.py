"""What hermite4 conserves and reaches with regularised pairs.

A hard binary of eccentricity 0.9 among 100 stars of a Plummer sphere (N-body units): the energy error after 10^6
periods, and the time of a period beside that of plain block steps. A triple whose inner orbit the outer body turns
(Kozai 1962): its eccentricity beside gauss-radau15's. Encounters of a binary with a single star, all of equal masses:
their outcomes beside gauss-radau15's by the chi-square test of homogeneity, and the binaries' energies by the test of
Kolmogorov and Smirnov. Bits over threads, looks and checkpoints, where pairs form and break up. Plummer spheres to
core collapse: the energy error, and the time of collapse over the half-mass relaxation time of Spitzer 1987, eq. 2-63,
with 0.11 n in the Coulomb logarithm (Giersz & Heggie 1994, doi:10.1093/mnras/268.1.257). The core radius is that of
Casertano & Hut 1985, doi:10.1086/163589, with six neighbours.
"""

import math
from time import perf_counter

import numpy as np
from scipy.spatial import cKDTree
from scipy.stats import chi2_contingency, ks_2samp

import kickdrift as kd
from kickdrift.model.starts.plummer import plummer
from kickdrift_validation.claim import Claim, at_least, claim, main, under

BLOCK, PAIRS = {"scheme": "block"}, {"scheme": "block", "pairs": "regularised"}
PERIODS, AXIS, ECCENTRICITY, STARS = 1_000_000, 1e-5, 0.9, 100
PLAIN_PERIODS = 200
CONSERVED = "energy is conserved"
SHORT, LONG = 1000, 4000  # encounters
FAR, NEARLY, PATIENCE = 40.0, 50.0, 20_000.0  # distance of a star that leaves, time between two checks, longest time


def binary(x: np.ndarray, v: np.ndarray, mass: float, axis: float, e: float) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities (2, 3) of two equal bodies of this total mass at apocentre."""
    d, t = np.array([0.6, 0.0, 0.8]), np.array([0.0, 1.0, 0.0])
    r, u = axis * (1 + e), math.sqrt(mass * (1 - e) / (axis * (1 + e)))
    return np.array([x - 0.5 * r * d, x + 0.5 * r * d]), np.array([v - 0.5 * u * t, v + 0.5 * u * t])


def field(axis: float, seed: int = 1) -> kd.System:
    """A Plummer sphere of equal stars, one of which is replaced by a binary of two such stars."""
    x, v, masses = plummer(STARS, seed=seed)
    y, w = binary(x[0], v[0], 2 * masses[0], axis, ECCENTRICITY)
    x, v, masses = np.vstack([y, x[1:]]), np.vstack([w, v[1:]]), np.append(masses, masses[0])
    return kd.System(x, v, masses, forces=[kd.Gravity()], units="nbody", name=f"binary-in-{STARS}")


def hard_binary(timed: bool) -> list[Claim]:
    system = field(AXIS)
    period = 2 * math.pi * math.sqrt(AXIS**3 / float(system.state.masses[:2].sum()))
    seconds = {}
    for name, options, periods in (("plain", BLOCK, PLAIN_PERIODS), ("regularised", PAIRS, PERIODS)):
        sim = kd.Simulation(system, "hermite4", eta=0.002, **options)
        sim.run(1)  # compiled
        sim.state = system.state
        began = perf_counter()
        report = sim.run(until=periods * period, interval=periods * period / 50)
        seconds[name] = (perf_counter() - began) / periods
        assert report.energy is not None
        error = report.energy.max_relative_error
        print(f"{name:12} {periods:8} periods: energy error {error:.1e}, {1e6 * seconds[name]:.3g} us a period")
    rows = [under(f"a = {AXIS:g}, e = 0.9, {PERIODS} periods: energy error", error, 1e-8, CONSERVED)]
    if timed:
        ratio = seconds["plain"] / seconds["regularised"]
        rows.append(at_least("time of a period: plain block steps over regularised", ratio, 50.0, "hermite4 alone"))
    close = field(1e-3)
    for eta, bound in ((0.008, 1e-6), (0.002, 1e-7), (0.0005, 1e-8)):
        report = kd.Simulation(close, "hermite4", eta=eta, **PAIRS).run(until=0.5, interval=0.0125)
        assert report.energy is not None
        error = report.energy.max_relative_error
        rows.append(under(f"a = 0.001, under tides, 356 periods, eta {eta:g}: energy error", error, bound, CONSERVED))
    return rows


def eccentricities(sim: kd.Simulation, times: np.ndarray) -> np.ndarray:
    """Eccentricity of the first two bodies' orbit at each time."""
    found = []
    for time in times:
        sim.run(until=float(time), interval=float(time))
        x, v, m = sim.state.positions, sim.state.velocities, sim.state.masses
        r, u, gm = x[1] - x[0], v[1] - v[0], float(m[:2].sum())
        found.append(np.linalg.norm(np.cross(u, np.cross(r, u)) / gm - r / np.linalg.norm(r)))
    return np.array(found)


def triple() -> list[Claim]:
    """The inner orbit's eccentricity rises from 0.1 to 0.9 and returns."""
    turn, period = math.radians(80.0), 2 * math.pi / math.sqrt(2.0)
    y, w = binary(np.zeros(3), np.zeros(3), 2.0, 1.0, 0.1)
    speed = math.sqrt(3.0 / 12.0)
    x = np.vstack([y, [0.0, 12.0 * math.cos(turn), 12.0 * math.sin(turn)]])
    v = np.vstack([w, [-speed, 0.0, 0.0]])
    system = kd.System(x, v, [1.0, 1.0, 1.0], forces=[kd.Gravity(G=1.0)], units="nbody", name="triple")
    times = period * np.linspace(100.0, 3000.0, 30)
    runs = {"gauss-radau15": {}, "hermite4": {"eta": 0.002, **PAIRS}}
    found = {name: eccentricities(kd.Simulation(system, name, **options), times) for name, options in runs.items()}
    for name, each in found.items():
        print(f"{name:14} e = {' '.join(f'{e:.4f}' for e in each[::3])}")
    spread = float(np.ptp(found["gauss-radau15"]))
    off = float(np.abs(found["hermite4"] - found["gauss-radau15"]).max())
    return [
        at_least("triple: change of the inner eccentricity in 3000 periods", spread, 0.3, "gauss-radau15"),
        under("triple: largest error of the inner eccentricity", off, 1e-3, "gauss-radau15"),
    ]


def encounter(rng: np.random.Generator) -> kd.System:
    """A binary of two unit masses, a = 1, with a random shape and phase, and a star of unit mass that comes from a
    distance of 30 with half the critical speed at infinity."""
    speed = 0.5 * math.sqrt(1.5)  # the critical speed is sqrt(3 / 2)
    b = 5.0 * math.sqrt(rng.random())
    e, anomaly = math.sqrt(0.8 * rng.random()), 2 * math.pi * rng.random()
    eccentric = anomaly
    for _ in range(200):  # Kepler's equation by fixed points
        eccentric = anomaly + e * math.sin(eccentric)
    c, s = math.cos(eccentric), math.sin(eccentric)
    r = np.array([c - e, math.sqrt(1 - e * e) * s, 0.0])
    u = math.sqrt(2.0) / (1 - e * c) * np.array([-s, math.sqrt(1 - e * e) * c, 0.0])
    frame = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    r, u = frame @ r, frame @ u
    distance = 30.0
    inward = math.sqrt(speed**2 + 2 * 3.0 / distance - (b * speed / distance) ** 2)
    place, motion = np.array([distance, 0.0, 0.0]), np.array([-inward, b * speed / distance, 0.0])
    x, v = np.array([-0.5 * r, 0.5 * r, place]), np.array([-0.5 * u, 0.5 * u, motion])
    return kd.System(x, v, np.ones(3), forces=[kd.Gravity(G=1.0)], units="nbody", name="encounter")


def outcome(sim: kd.Simulation) -> tuple[int, float, float]:
    """Run until a star has left: its number (3 for none), the energy of the others' orbit, and the energy error."""
    began = sim.sample().energies.total
    leaver, energy = 3, math.nan
    while leaver == 3 and sim.time < PATIENCE:
        sim.run(until=sim.time + NEARLY, interval=NEARLY)
        x, v = sim.state.positions, sim.state.velocities
        for i in range(3):
            j, k = (other for other in range(3) if other != i)
            d, u = x[i] - 0.5 * (x[j] + x[k]), v[i] - 0.5 * (v[j] + v[k])
            r = float(np.linalg.norm(d))
            if r > FAR and d @ u > 0.0 and 0.5 * u @ u > 3.0 / r:
                leaver, energy = i, float(0.25 * np.sum((v[j] - v[k]) ** 2) - 1.0 / np.linalg.norm(x[j] - x[k]))
    return leaver, energy, abs(sim.sample().energies.total / began - 1.0)


def scatterings(count: int) -> list[Claim]:
    runs = {"gauss-radau15": {}, "hermite4": {"eta": 0.002, **PAIRS}}
    found, formed = {}, 0
    for name, options in runs.items():
        rng = np.random.default_rng(44)
        sim, began = kd.Simulation(encounter(rng), name, **options), perf_counter()
        rows = []
        for _ in range(count):
            sim.state = encounter(rng).state
            rows.append(outcome(sim))
            formed += sim.report().pairs.formed if name == "hermite4" else 0
        found[name] = np.array(rows)
        counts = np.bincount(found[name][:, 0].astype(int), minlength=4)
        print(
            f"{name:14} leaves 1, 2, the third, none: {counts}; energy error: "
            f"median {np.median(found[name][:, 2]):.1e}, largest {found[name][:, 2].max():.1e}; "
            f"{perf_counter() - began:.0f} s"
        )
    table = np.array([np.bincount(each[:, 0].astype(int), minlength=4) for each in found.values()])
    p = float(chi2_contingency(table[:, table.any(axis=0)]).pvalue)
    first, second = (each[np.isfinite(each[:, 1]), 1] for each in found.values())
    q = float(ks_2samp(first, second).pvalue)
    shown = " and ".join("-".join(map(str, row)) for row in table)
    print(f"outcomes {shown}: p = {p:.3f}; energies of the binaries: p = {q:.3f}; {formed} pairs formed")
    return [
        at_least(f"{count} encounters: p of equal outcomes, {shown}", p, 0.01, "gauss-radau15"),
        at_least(f"{count} encounters: p of equal energies of the binaries", q, 0.01, "gauss-radau15"),
        under(
            f"{count} encounters: median energy error",
            float(np.median(found["hermite4"][:, 2])),
            1e-6,
            CONSERVED,
        ),
    ]


def same_bits() -> list[Claim]:
    """A binary among 100 stars, which a third star breaks up."""
    system = field(1e-4)

    def run(threads: int = 1, *, cut: bool = False) -> tuple[np.ndarray, list[dict[str, object]]]:
        sim = kd.Simulation(system, "hermite4", eta=0.01, threads=threads, **PAIRS)
        if cut:
            sim.run(until=4.1, interval=0.37)
            other = kd.Simulation(system, "hermite4", eta=0.01, threads=threads, **PAIRS)
            other.restore(sim.checkpoint())
            sim = other
        sim.run(until=9.0)
        return sim.state.phase, sim.events

    whole, log = run()
    others = [run(2), run(cut=True)]
    same = all(np.array_equal(whole, phase) and log == events for phase, events in others)
    return [claim(f"bits and {len(log)} events: 2 threads, looks and a checkpoint", same, "the same", same, "own")]


def core_radius(x: np.ndarray, masses: np.ndarray) -> float:
    """Root of the mean square distance from the density centre, weighted by the squared density at each star."""
    distance = cKDTree(x).query(x, k=7)[0][:, -1]
    density = 5.0 * masses / distance**3
    centre = density @ x / density.sum()
    return float(np.sqrt(density**2 @ ((x - centre) ** 2).sum(axis=1) / (density**2).sum()))


def collapses(n: int, seeds: int, eta: float = 0.002) -> list[Claim]:
    """Run Plummer spheres past the time at which the core is smallest."""
    times, errors, began = [], [], perf_counter()
    half_mass = 0.769  # of a Plummer sphere in N-body units, as the relaxation time has it
    relaxation = 0.138 * n * half_mass**1.5 / math.log(0.11 * n)
    for seed in range(1, seeds + 1):
        x, v, masses = plummer(n, seed=seed)
        system = kd.System(x, v, masses, forces=[kd.Gravity()], units="nbody", name=f"plummer-{n}")
        sim = kd.Simulation(system, "hermite4", eta=eta, **PAIRS)
        radii: list[tuple[float, float]] = []

        def look(sim: kd.Simulation, radii: list[tuple[float, float]] = radii) -> None:
            radii.append((core_radius(sim.state.positions, sim.state.masses), sim.time))

        report = sim.run(until=20.0 * relaxation, interval=0.5, observe=look)
        assert report.energy is not None
        assert report.pairs is not None
        least, time = min(radii)
        times.append(time / relaxation)
        errors.append(report.energy.max_relative_error)
        print(
            f"{n} stars, seed {seed}: core radius {radii[0][0]:.3f}, least {least:.4f} at {time / relaxation:.1f} "
            f"relaxation times; energy error {errors[-1]:.1e}; pairs: {report.pairs.formed} formed, "
            f"{report.pairs.broken} broken up; {perf_counter() - began:.0f} s",
            flush=True,
        )
    rows = [
        under(
            f"{n} stars, to core collapse and beyond, {seeds} runs: energy error",
            max(errors),
            1e-4,
            CONSERVED,
        )
    ]
    if seeds > 2:
        mean, error = float(np.mean(times)), float(np.std(times, ddof=1) / math.sqrt(seeds))
        text = f"{n} stars, {seeds} runs: time of collapse in relaxation times, within {error:.1f}"
        near = 15.0 - 2 * error <= mean <= 17.0 + 2 * error
        rows.append(claim(text, mean, "15 to 17 within 2 errors", near, "Giersz & Heggie 1994"))
    return rows


def claims(long: bool = False) -> list[Claim]:
    """The long set has ten collapses of 1024 stars, which take hours, and what depends on the clock."""
    rows = [*hard_binary(timed=long), *triple(), *same_bits(), *scatterings(LONG if long else SHORT)]
    return [*rows, *collapses(256, 1), *(collapses(1024, 10) if long else [])]


if __name__ == "__main__":
    main(claims, __doc__)
