"""Barostats: the volume of an ideal gas and of a fluid at constant pressure, and conserved quantities.

At constant pressure P the volume of an ideal gas with f degrees of freedom in d dimensions has the density
V^(f / d) exp(-P V / k_B T), a gamma distribution. Nothing else is exact for every barostat and coupling, so the whole
distribution is tested.

The Lennard-Jones fluid, cut and shifted at 2.5 sigma, is compared with the equation of state of Thol et al. 2015
(equation_of_state.py). The density of its volume is

w(V) = V^(f / d - N) sqrt(d(P_eos / k_B T) / d rho) exp(int (P_eos(N / V) - P) dV / k_B T).

The first factor is that of a conserved centre of mass. The second is the difference between a fixed and an open number
of particles in a periodic box, of relative order 1 / N (Lebowitz & Percus 1961, doi:10.1103/PhysRev.124.1673). So mean
and variance hold for few particles too, and the variance is k_B T kappa V for many. A fluid does not hold the shape of
its box: with edges that change apart the runs are short, or the box large.

Total energy less heat and work is conserved, with an error of second order in the step.
"""

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from scipy import stats
from scipy.integrate import cumulative_trapezoid, trapezoid

import kickdrift as kd
from kickdrift.integrators import integrator
from kickdrift.model.starts.builders import lattice, maxwell_boltzmann
from kickdrift.statistics.blocks import block_average
from kickdrift_validation.claim import Claim, claim, main
from kickdrift_validation.equation_of_state import FORCES, equation
from kickdrift_validation.heat_baths import EQUATION, SIGMAS, SIGNIFICANT, options_of

STATE = (1.5, 0.6)  # T* and the density rho* whose pressure is asked for
GAMMA, THOL = "the gamma distribution", "Thol 2015"
IDEAL = {
    "c-rescale": {"pressure_tau": 0.5, "compressibility": 1.0, "pressure_every": 2},
    "mtk": {"pressure_tau": 0.5},
    "monte-carlo": {"compressibility": 1.0, "pressure_every": 5},
}
FLUID = {
    "c-rescale": {"pressure_tau": 1.0, "compressibility": 0.2},
    "mtk": {"pressure_tau": 1.0},
    "monte-carlo": {"compressibility": 0.2},
}
SLOW = {"c-rescale": {}, "mtk": {"pressure_tau": 2.0}, "monte-carlo": {"pressure_every": 40}}  # keeps the shape longer


class Run(NamedTuple):
    """A run of the fluid."""

    barostat: str
    bath: str
    coupling: str
    particles: int
    time: float


RUNS = (
    *(Run(barostat, bath, "isotropic", count, time) for count, time in ((512, 400.0), (100, 1000.0))
      for barostat, bath in (("c-rescale", "baoab"), ("c-rescale", "csvr"), ("mtk", "nose-hoover"),
                             ("monte-carlo", "csvr"))),
    *(Run(barostat, bath, coupling, 1000, 120.0) for coupling in ("semi-isotropic", "per-axis")
      for barostat, bath in (("c-rescale", "csvr"), ("mtk", "nose-hoover"), ("monte-carlo", "csvr"))),
)  # fmt: skip


def freedom_of(bath: str, count: int) -> int:
    return 3 * count - 3 * (not integrator(bath).drags)


def ideal_claims(long: bool) -> Iterator[Claim]:
    """The volume of an ideal gas has a gamma distribution, for each barostat, coupling and bath."""
    count, seed = 20, 0
    rng = np.random.default_rng(5)
    edge = count ** (1 / 3)
    v = rng.normal(size=(count, 3))
    start = rng.uniform(0, edge, (count, 3))
    for barostat, options in IDEAL.items():
        for bath in ("nose-hoover",) if barostat == "mtk" else ("baoab", "csvr", "nose-hoover"):
            for coupling in ("isotropic", "semi-isotropic", "per-axis"):
                seed += 1
                gas = kd.System(start, v - v.mean(axis=0), box=(edge,) * 3, seed=seed)
                own = options_of(bath, 1.0, {"friction": 2.0, "tau": 0.2})
                sim = kd.Simulation(
                    gas, bath, 0.02, pressure=1.0, barostat=barostat, coupling=coupling, **own, **options
                )
                sim.advance(2000)
                found: list[float] = []
                steps = 800_000 if long else 100_000
                sim.advance(steps, every=100, visit=lambda run, found=found: found.append(run.state.box.volume))  # type: ignore[misc]
                law = stats.gamma(freedom_of(bath, count) / 3 + 1)
                p = float(stats.kstest(found[::2], law.cdf).pvalue)
                ratios = (
                    f"mean {np.mean(found) / law.mean():.4f}, variance {np.var(found) / law.var():.3f} of the exact"
                )
                print(f"  {barostat}, {bath}, {coupling}: {ratios}; p = {p:.3f}", flush=True)
                text = (
                    f"{barostat}, {coupling}, {bath}: volume of {count} ideal particles: p-value of Kolmogorov-Smirnov"
                )
                yield claim(text, p, f"above {SIGNIFICANT}", p > SIGNIFICANT, GAMMA)


def exact(bath: str, count: int, pressure: float) -> tuple[float, float]:
    """Mean and variance of the volume of the fluid at a pressure."""
    temperature, density = STATE
    volumes = count / density * np.linspace(0.75, 1.4, 2601)
    pressures = np.array([equation(EQUATION, temperature, count / volume).pressure for volume in volumes])
    stiffness = np.gradient(pressures, volumes) * -(volumes**2) / (count * temperature)  # d(P / k_B T) / d rho
    power = freedom_of(bath, count) / 3 - count
    log = cumulative_trapezoid(pressures - pressure, volumes, initial=0.0) / temperature
    log = log + power * np.log(volumes) + 0.5 * np.log(stiffness)
    weight = np.exp(log - log.max())
    weight /= trapezoid(weight, volumes)
    mean = float(trapezoid(weight * volumes, volumes))
    return mean, float(trapezoid(weight * (volumes - mean) ** 2, volumes))


def fluid(count: int) -> kd.System:
    """The fluid on sites of a lattice, not yet at equilibrium."""
    temperature, density = STATE
    sites = math.ceil(count ** (1 / 3) - 1e-9) ** 3
    positions, edges = lattice("sc", sites, density * sites / count)
    chosen = np.sort(np.random.default_rng(2).permutation(sites)[:count])
    velocities = maxwell_boltzmann(np.ones(count), temperature, 1.0, seed=1)
    return kd.System(positions[chosen], velocities, box=edges, forces=[kd.LennardJones(**FORCES[EQUATION])])


def volumes_of(run: Run, pressure: float, time: float) -> tuple[np.ndarray, kd.Report]:
    temperature = STATE[0]
    own = options_of(run.bath, temperature) | FLUID[run.barostat]
    own |= {} if run.coupling == "isotropic" else SLOW[run.barostat]
    given: dict[str, Any] = {"pressure": pressure, "barostat": run.barostat, **own}
    sim = kd.Simulation(fluid(run.particles), run.bath, 0.004, **given)
    sim.equilibrate(temperature, 20.0)  # all edges together, since a fluid does not hold the shape of its box
    if run.coupling != "isotropic":
        start = sim.state
        sim = kd.Simulation(fluid(run.particles), run.bath, 0.004, coupling=run.coupling, **given)
        sim.state = start
    report = sim.run(until=sim.time + time, every=25)
    return np.array([sample.volume for sample in sim.record.samples]), report


def fluid_claims(long: bool) -> Iterator[Claim]:
    """Mean and variance of the volume, and the mean pressure."""
    temperature, density = STATE
    pressure = equation(EQUATION, temperature, density).pressure
    for run in RUNS:
        volumes, report = volumes_of(run, pressure, run.time * (4.0 if long and run.coupling == "isotropic" else 1.0))
        mean, variance = exact(run.bath, run.particles, pressure)
        middle, spread = block_average(volumes), block_average((volumes - mean) ** 2)
        rows = (
            ("mean volume per particle", middle.value / run.particles, middle.error / run.particles,
             mean / run.particles, THOL),
            ("variance of the volume over its mean", spread.value / mean, spread.error / mean, variance / mean, THOL),
            ("mean pressure", report.pressure, report.pressure_error, pressure, "the pressure asked for"),
        )  # fmt: skip
        name = f"{run.barostat}, {run.coupling}, {run.bath}, {run.particles} particles"
        for quantity, value, error, wanted, reference in rows:
            off = abs(value - wanted) / error if error else math.inf
            text = f"{value:.4f} ({error or math.inf:.4f})"
            print(f"  {name}: {quantity} {text}, expected {wanted:.4f}: {off:.1f} standard errors", flush=True)
            bound = f"within {SIGMAS:g} standard errors of {wanted:.4f}"
            yield claim(f"{name}: {quantity}", text, bound, off <= SIGMAS, reference)


def conserved_claims(long: bool) -> Iterator[Claim]:
    """Energy less heat and work: order two, and no drift."""
    start, steps = fluid(100), 1_000_000 if long else 300_000
    law = kd.LennardJones(cutoff=2.0, truncation="switch", switch_start=1.5)
    system = kd.System(start.state.positions, start.state.velocities, box=start.box, forces=[law])
    for barostat, bath in (("mtk", "nose-hoover"), ("c-rescale", "csvr"), ("monte-carlo", "csvr")):
        errors, given = [], options_of(bath, STATE[0]) | FLUID[barostat] | {"pressure": 1.0, "barostat": barostat}
        for dt in (0.004, 0.002, 0.001):
            sim = kd.Simulation(system, bath, dt, **given)
            sim.equilibrate(STATE[0], 8.0)
            sim.run(round(20.0 / dt), every=round(0.04 / dt))
            errors.append(np.std([sample.energies.total + sample.taken.energy for sample in sim.record.samples]))
        slope = float(np.polyfit(np.log([0.004, 0.002, 0.001]), np.log(errors), 1)[0])
        print(f"  {barostat}: scatter {errors}, slope {slope:.3f}", flush=True)
        text = f"{barostat}: scatter of energy less heat and work: slope from dt = 0.004, 0.002, 0.001"
        yield claim(text, slope, "1.75 to 2.25", abs(slope - 2.0) <= 0.25, "the order of the word")
        sim = kd.Simulation(system, bath, 0.002, **given)
        sim.equilibrate(STATE[0], 8.0)
        report = sim.run(steps, every=100)
        energy = report.energy
        rate = f"{energy.drift_per_unit_time:+.1e} ± {energy.drift_error:.1e} per τ"
        print(f"  {barostat}: {rate}, {energy.verdict}, heat {report.heat:.5g}, work {report.work:.5g}", flush=True)
        text = f"{barostat}: drift of energy less heat and work over {steps:,} steps"
        held = abs(energy.drift_per_unit_time) <= 1.5 * energy.drift_error
        yield claim(text, rate, "0 within three standard errors", held, "the law of the barostat")


def claims(long: bool = False) -> Iterator[Claim]:
    yield from ideal_claims(long)
    yield from fluid_claims(long)
    yield from conserved_claims(long)


if __name__ == "__main__":
    main(claims, __doc__)
