"""Are multiple time steps of order 2 and reversible, do they resonate where theory says, and what do they save?

Order and reversal: two particles on a stiff spring in a soft trap. Resonance: one particle in a stiff and a soft trap,
whose propagation matrix is known. Savings: the Earth and the Moon, whose attraction is fast, beside the Sun's; and a
Kremer-Grest melt, with bonded neighbours in the fast group. A saving is the ratio of force evaluations of velocity
Verlet to those of respa at the same error: of the Moon's place, of the energy of the Moon's orbit, and of the energy of
the melt. Two claims say why savings are not larger: the error of the total energy of Sun, Earth and Moon belongs to the
slow step, and the slow forces of the melt are almost as stiff as its bonds. ``--long`` measures the processor time of
each group's forces, which needs an idle machine.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from time import process_time
from typing import Any, NamedTuple

import numpy as np

import kickdrift as kd
from kickdrift_validation.claim import Claim, claim, main

TUCKERMAN = "Tuckerman, Berne & Martyna 1992, doi:10.1063/1.463137"
BIESIADECKI = "Biesiadecki & Skeel 1993, doi:10.1006/jcph.1993.1220"
FAST, SLOW = 30.0, 3.0  # angular frequencies of the two traps
SUBSTEPS = 400  # of the fast trap, so that its motion is nearly exact
GM = 4 * math.pi**2  # of the Sun, in AU^3 / yr^2
SAVING = 1.8
MELT = 40.0  # length of its runs
WINDOW = 5.0  # of time, for the scatter of the energy of the melt


@kd.body_law
class Attraction(NamedTuple):
    """Gravity of the pair of bodies 1 and 2 alone, or of all other pairs."""

    of_others: float

    def law(p, x, v, m, t, a):
        energy = 0.0
        for i in range(x.shape[1]):
            for j in range(i):
                if (j == 0) == (p.of_others > 0.5):
                    d = x[:, i] - x[:, j]
                    r = math.sqrt(d[0] ** 2 + d[1] ** 2 + d[2] ** 2)
                    energy -= 39.47841760435743 * m[i] * m[j] / r
                    for k in range(3):
                        a[k, i] -= 39.47841760435743 * m[j] * d[k] / r**3
                        a[k, j] += 39.47841760435743 * m[i] * d[k] / r**3
        return energy


def sprung() -> kd.System:
    """Two particles on a stiff spring and one beside, in a soft trap."""
    x = np.array([[0.0, 0.0, 0.0], [1.1, 0.0, 0.0], [3.0, 1.0, 0.0]])
    v = np.array([[0.1, -0.2, 0.1], [0.0, 0.1, -0.1], [-0.1, 0.1, 0.05]])
    return kd.System(x, v, forces=[kd.Springs([(0, 1)], 900.0, 1.0), kd.HarmonicTrap(1.0, group=1)])


def orders() -> Iterator[Claim]:
    """Slope of the error at t = 2, and the way back."""
    system = sprung()
    exact = kd.Simulation(system, "yoshida8", dt=0.0005)
    exact.run(until=2.0)
    for substeps in (4, 16):
        steps, errors = (0.01, 0.005, 0.0025, 0.00125), []
        for dt in steps:
            sim = kd.Simulation(system, "respa", dt=dt, substeps=substeps)
            sim.run(until=2.0)
            errors.append(float(np.abs(sim.state.positions - exact.state.positions).max()))
        slope = float(np.polyfit(np.log(steps), np.log(errors), 1)[0])
        text = f"respa, {substeps} substeps: slope of the error of a stiff spring in a soft trap"
        yield claim(text, round(slope, 3), "2 to 0.1", abs(slope - 2) < 0.1, TUCKERMAN)
    sim = kd.Simulation(system, "respa", dt=0.02)
    sim.advance(1000)
    back = kd.Simulation(system.at(sim.state.phase * np.array([1.0, -1.0])[:, None, None], 0.0), "respa", dt=0.02)
    back.advance(1000)
    off = float(np.abs(back.state.positions - system.state.positions).max())
    yield claim("respa: distance from the start after 1000 steps there and back", off, "1e-10", off < 1e-10, "itself")


def growth(dt: float) -> float:
    """Logarithm of the larger eigenvalue of the impulse method with exact fast motion, per step; 0 if bounded."""
    angle = FAST * dt
    half = abs(math.cos(angle) - SLOW**2 * dt / (2 * FAST) * math.sin(angle))
    return math.acosh(half) if half > 1 else 0.0


def measured_growth(dt: float, steps: int = 4000) -> float:
    """Growth of the amplitude in a run, per step, over its second half."""
    system = kd.System(
        [[0.3, 0.0, 0.0]], [[0.1, 0.0, 0.0]],
        forces=[kd.HarmonicTrap((FAST**2, 0.0, 0.0)), kd.HarmonicTrap((SLOW**2, 0.0, 0.0), group=1)],
    )  # fmt: skip
    sim = kd.Simulation(system, "respa", dt=dt, substeps=SUBSTEPS)
    sizes = []
    for _ in range(2):
        sim.advance(steps // 2)
        phase = sim.state.phase
        sizes.append(math.hypot(FAST * phase[0, 0, 0], phase[1, 0, 0]))
    return math.log(sizes[1] / sizes[0]) / (steps // 2)


def resonance() -> Iterator[Claim]:
    """Steps around half a period of the fast trap: growth or none, as theory says."""
    resonant = math.pi / FAST
    steps = [resonant * part for part in (0.6, 0.8, 0.9, 0.95, 0.98, 0.985, 0.99, 0.995, 0.999, 1.01, 1.05)]
    theory = np.array([growth(dt) for dt in steps])
    found = np.array([measured_growth(dt) for dt in steps])
    unstable = [f"{dt / resonant:g}" for dt, rate in zip(steps, found, strict=True) if rate > 1e-3]
    predicted = [f"{dt / resonant:g}" for dt, rate in zip(steps, theory, strict=True) if rate > 1e-3]
    text = "steps that resonate, in halves of the fast period"
    yield claim(text, ", ".join(unstable), ", ".join(predicted), unstable == predicted, BIESIADECKI)
    off = float(np.abs(found - theory)[theory > 1e-3].max() / theory.max())
    text = "rate of growth in resonance beside the propagation matrix, relative"
    yield claim(text, off, "0.05", off < 0.05, BIESIADECKI)


def moon() -> kd.System:
    """Sun, Earth and Moon; the Earth and the Moon attract each other in group 0."""
    earth, moon_mass, apart = 3.003e-6, 3.694e-8, 0.00257
    speed, around = math.sqrt(GM), math.sqrt(GM * (earth + moon_mass) / apart)
    x = np.array([[0.0, 0, 0], [1.0, 0, 0], [1.0 + apart, 0, 0]])
    v = np.array([[0.0, 0, 0], [0, speed, 0], [0, speed + around, 0]])
    masses = np.array([1.0, earth, moon_mass])
    v -= masses @ v / masses.sum()
    return kd.System(x, v, masses, units="astro", forces=[Attraction(0.0), Attraction(1.0, group=1)])


def melt() -> kd.System:
    """kremer-grest-1000 with the repulsion of bonded beads in the law of bonds, in group 0."""
    system = kd.load("kremer-grest-1000")
    pairs = next(force for force in system.forces if isinstance(force, kd.LennardJones))
    chains = kd.Topology.chains(20, 50, factors=(0.0, 1.0, 1.0))
    return system.remade(forces=[kd.Fene(epsilon=1.0), replace(pairs, group=1)], topology=chains)


def energies(method: str, dt: float, time: float, **options: int) -> tuple[np.ndarray, np.ndarray]:
    """Times, and the energy per bead of the melt."""
    sim = kd.Simulation(melt(), method, dt=dt, **options)
    sim.advance(round(2.0 / dt))
    series = sim.run(round(time / dt), every=max(1, round(0.03 / dt))).about.series
    return series.times - series.times[0], series.total / 1000


def scatter(method: str, dt: float, time: float, **options: int) -> float:
    """Standard deviation of the energy per bead of the melt, in stretches of WINDOW, so that a drift does not count."""
    times, energy = energies(method, dt, time, **options)
    stretch = (times / WINDOW).astype(int)
    return math.sqrt(np.mean([energy[stretch == k].var() for k in range(round(time / WINDOW))]))


def moons_error(method: str, steps: int, **options: int) -> float:
    """Error of the Moon's place relative to the Earth after a year, relative to its distance."""
    exact, sim = kd.Simulation(moon(), "gauss-radau15"), kd.Simulation(moon(), method, dt=1.0 / steps, **options)
    exact.run(until=1.0)
    sim.advance(steps)
    found, right = (each.state.positions[2] - each.state.positions[1] for each in (sim, exact))
    return float(np.abs(found - right).max() / np.linalg.norm(right))


def total_error(method: str, steps: int, **options: int) -> float:
    """Largest error of the total energy of Sun, Earth and Moon in a year, relative."""
    report = kd.Simulation(moon(), method, dt=1.0 / steps, **options).run(steps, every=max(1, steps // 500))
    total = report.about.series.total
    return float(np.abs(total / total[0] - 1.0).max())


def orbits_errors(method: str, ladder: Sequence[int], **options: int) -> list[float]:
    """Largest error of the energy of the Moon's orbit about the Earth at ten times of a year, relative, for each number
    of steps."""

    def energy(sim: kd.Simulation) -> float:
        x, v = (each[2] - each[1] for each in (sim.state.positions, sim.state.velocities))
        return float(0.5 * v @ v - GM * moon().state.masses[1:].sum() / np.linalg.norm(x))

    def energies(sim: kd.Simulation) -> np.ndarray:
        found = []
        for time in np.arange(1, 11) / 10:
            sim.run(until=time)
            found.append(energy(sim))
        return np.array(found)

    exact = energies(kd.Simulation(moon(), "gauss-radau15"))
    sims = [kd.Simulation(moon(), method, dt=1.0 / steps, **options) for steps in ladder]
    return [float(np.abs(energies(sim) / exact - 1.0).max()) for sim in sims]


def einstein_frequencies() -> tuple[float, float]:
    """Root mean squares of the angular frequencies of one bead among fixed neighbours, by bonds and by other pairs:
    the mean curvature of each group's energy, the sum of U'' + 2 U' / r over the pairs of a bead, over 3 masses."""
    system = melt()
    sim = kd.Simulation(system, dt=0.005)
    sim.advance(400)
    x, edge = sim.state.positions, np.array(system.box.lengths)
    first, second = np.triu_indices(len(x), 1)
    apart = x[first] - x[second]
    r = np.linalg.norm(apart - edge * np.rint(apart / edge), axis=1)
    assert system.topology is not None
    bonded = np.zeros((len(x), len(x)), bool)
    bonded[tuple(np.sort(system.topology.bonds).T)] = True
    fast = bonded[first, second]
    core = r < 2.0 ** (1 / 6)
    curvature = np.where(core, 24.0 * (22.0 * r**-12 - 5.0 * r**-6) / r**2, 0.0)
    left = 1.0 - (r[fast] / 1.5) ** 2
    curvature[fast] += 30.0 * (3.0 / left + 2.0 * (r[fast] / 1.5) ** 2 / left**2)
    of_bonds, of_pairs = (2.0 * curvature[group].sum() / (3 * len(x)) for group in (fast, ~fast))
    return math.sqrt(of_bonds), math.sqrt(of_pairs)


def force_seconds() -> tuple[float, float]:
    """Processor time of one evaluation of the melt's bonds, and of its other pairs, whose lists are made already."""

    def spent(forces: list[Any]) -> float:
        sim = kd.Simulation(melt().remade(forces=forces), dt=1e-9)
        sim.advance(10)
        found = []
        for _ in range(7):
            began = process_time()
            sim.advance(500)
            found.append(process_time() - began)
        return min(found) / 500

    bonds, pairs = melt().forces
    free = spent([])
    return spent([bonds]) - free, spent([replace(pairs, group=0)]) - free


def step_of(wanted: float, steps: Sequence[float], errors: Sequence[float]) -> float:
    """Step of velocity Verlet with the wanted error, from the power law of a ladder."""
    slope, offset = np.polyfit(np.log(steps), np.log(errors), 1)
    return math.exp((math.log(wanted) - offset) / slope)


def savings(long: bool) -> Iterator[Claim]:
    """Fewer evaluations at the same error."""
    ladder = [1 / steps for steps in (500, 1000, 2000, 4000)]
    errors = [moons_error("velocity-verlet", round(1 / dt)) for dt in ladder]
    for substeps in (4, 8):
        wanted = moons_error("respa", 1000, substeps=substeps)
        ratio = 3 / step_of(wanted, ladder, errors) / ((2 + substeps) * 1000)
        text = f"Sun, Earth and Moon: fewer pairs of bodies at an error of the Moon's place of {wanted:.1e}"
        bound = f"at least {SAVING}"
        yield claim(f"{text}, {substeps} substeps", round(ratio, 2), bound, ratio >= SAVING, "gauss-radau15")
    fine = (500, 1000, 2000, 4000)
    errors = orbits_errors("velocity-verlet", fine)
    for substeps in (2, 4):
        (wanted,) = orbits_errors("respa", [500], substeps=substeps)
        ratio = 3 / step_of(wanted, [1 / steps for steps in fine], errors) / ((2 + substeps) * 500)
        text = (
            f"Sun, Earth and Moon: fewer pairs of bodies at an error of the energy of the Moon's orbit of {wanted:.1e}"
        )
        yield claim(f"{text}, {substeps} substeps", round(ratio, 2), "at least 1.4", ratio >= 1.4, "gauss-radau15")
    ratio = total_error("respa", 1000, substeps=4) / total_error("velocity-verlet", 1000)
    text = "Sun, Earth and Moon: error of the total energy, over that of velocity Verlet with the same slow step"
    yield claim(text, round(ratio, 3), "1 to 0.05: the slow step sets it", abs(ratio - 1) < 0.05, "velocity-verlet")
    ratio = total_error("velocity-verlet", 4000) / total_error("blanes-moan4", 74)
    text = "Sun, Earth and Moon: error of the total energy with 12000 pairs a year, over that of blanes-moan4 with 1332"
    yield claim(text, round(ratio, 2), "over 1: a method of order 4 is the way", ratio > 1, "blanes-moan4")
    fast, slow = einstein_frequencies()
    text = f"Kremer-Grest melt: Einstein frequency of a bead by bonds, {fast:.1f}, over that by other pairs, {slow:.1f}"
    yield claim(
        text, round(fast / slow, 2), "under 2.5: hardly any slow force", fast / slow < 2.5, "curvature of the laws"
    )
    ladder = [0.003, 0.004, 0.005, 0.006, 0.007]
    errors = [scatter("velocity-verlet", dt, MELT) for dt in ladder]
    steps = {}
    for outer, substeps, bound in ((0.008, 2, 1.4), (0.01, 4, 1.5)):
        wanted = scatter("respa", outer, MELT, substeps=substeps)
        steps[outer, substeps] = step_of(wanted, ladder, errors)
        ratio = outer / steps[outer, substeps]
        text = f"Kremer-Grest melt: fewer evaluations of the pair force at a scatter of the energy of {wanted:.1e}"
        text = f"{text}, dt = {outer} / {substeps}"
        yield claim(text, round(ratio, 2), f"at least {bound}", ratio >= bound, "velocity-verlet")
    if long:
        yield from in_seconds(steps)


def in_seconds(steps: dict[tuple[float, int], float]) -> Iterator[Claim]:
    """Savings of processor time of the forces, and drift. ``steps`` are those of velocity Verlet with the scatter of
    respa with that step and number of substeps."""
    bonds, pairs = force_seconds()
    for (outer, substeps), step in steps.items():
        ratio = (bonds + pairs) / step * outer / (pairs + substeps * bonds)
        text = f"Kremer-Grest melt: fewer force seconds, bonds {1e6 * bonds:.0f} us and pairs {1e6 * pairs:.0f} us"
        bound = "over 1, under 1.8"
        yield claim(f"{text}, dt = {outer} / {substeps}", round(ratio, 2), bound, 1 < ratio < SAVING, "processor time")
    for outer, substeps, good in ((0.008, 2, True), (0.01, 4, False)):
        times, energy = energies("respa", outer, 150.0, substeps=substeps)
        drift = abs(float(np.polyfit(times, energy, 1)[0]))
        text = f"Kremer-Grest melt: drift of the energy per bead in a unit of time, dt = {outer} / {substeps}"
        bound = "under 1e-05" if good else "over 1e-05: the step is too long"
        yield claim(text, drift, bound, (drift < 1e-5) == good, "itself")


def claims(long: bool = False) -> Iterator[Claim]:
    yield from orders()
    yield from resonance()
    yield from savings(long)


if __name__ == "__main__":
    main(claims, __doc__)
