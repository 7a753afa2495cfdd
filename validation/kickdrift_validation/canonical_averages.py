"""Every heat bath: Maxwell's velocities, averages of a fluid, its heat capacity, and conservation over 10^6 steps.

Velocities of 16 replicas of a liquid of 64 particles, ten times each, are compared with Maxwell's law (Kolmogorov and
Smirnov). A bath that conserves the total momentum leaves the share 1 - 1/N of the variance.

Pressure and energy of 216 particles, cut and shifted at 2.5 sigma, are compared with the equation of state of Thol et
al. 2015 at two state points (heat_baths.py has the third). The step is 0.002, as some words have configurations that
are too hot by an error of order two. equation_of_state.py shows that the equation's pressure is off by 0.0087 at
liquid densities; this error counts. A box at rest lacks the pressure k_B T / V of its centre of mass, which is added.

The heat capacity is the variance of the energy over k_B T^2, and the slope of the mean energy from runs at two other
temperatures. Both have errors by blocks.
"""

import math
from collections.abc import Iterator

import numpy as np
from scipy import stats

import kickdrift as kd
from kickdrift.integrators import INTEGRATORS, integrator
from kickdrift.statistics.blocks import block_average
from kickdrift_validation.claim import Claim, claim, main
from kickdrift_validation.equation_of_state import FORCES, STATES, equation, fluid
from kickdrift_validation.heat_baths import EQUATION, OPTIONS, SIGMAS, SIGNIFICANT, STATE, STRONG, options_of

OTHERS = ("brownian", "respa-baoab")  # without velocities; for forces in groups
BATHS = tuple(dict.fromkeys(row.name for row in INTEGRATORS.values() if row.bath and row.name not in OTHERS))
REPLICAS, TIMES = 16, 10
POINTS = tuple(state for state in STATES if state != STATE)
EQUATION_ERROR = 0.0087  # of the pressure, see equation_of_state.py
TEMPERATURE, APART = 2.0, 0.2  # of the heat capacity; the two other temperatures are so far away
CONSERVED, STEPS = ("nose-hoover", "csvr", "baoab"), 1_000_000


def velocity_claims() -> Iterator[Claim]:
    """Velocities over replicas are Maxwellian."""
    system = fluid(64, TEMPERATURE, 0.5, cutoff=2.0)
    for name in BATHS:
        found = []
        for replica in range(REPLICAS):
            seed = {} if name == "nose-hoover" else {"seed": replica}
            sim = kd.Simulation(
                system.with_velocities(temperature=TEMPERATURE, seed=replica + 1), name, 0.004,
                **options_of(name, TEMPERATURE, STRONG), **seed,
            )  # fmt: skip
            sim.advance(500)
            for _ in range(TIMES):
                sim.advance(100)
                found.append(sim.state.velocities.ravel())
        share = 1.0 if integrator(name).drags else 1.0 - 1.0 / len(system)
        p = float(stats.kstest(np.concatenate(found), stats.norm(scale=math.sqrt(share * TEMPERATURE)).cdf).pvalue)
        print(f"  {name}: variance {np.var(found) / (share * TEMPERATURE):.4f} of Maxwell's; p = {p:.3f}", flush=True)
        yield claim(f"{name}: velocities of {REPLICAS} replicas are Maxwell's: p-value of Kolmogorov-Smirnov", p,
                    f"above {SIGNIFICANT}", p > SIGNIFICANT, "the normal distribution")  # fmt: skip


def state_claims(long: bool) -> Iterator[Claim]:
    """Pressure and energy at two states, beside the equation."""
    count = 216
    for temperature, density in POINTS:
        wanted, where = equation(EQUATION, temperature, density), f"at T* = {temperature}, rho* = {density}"
        system = fluid(count, temperature, density, **FORCES[EQUATION])
        for name in BATHS:
            sim = kd.Simulation(system, name, 0.002, **options_of(name, temperature, OPTIONS))
            sim.equilibrate(temperature, 10.0)
            report = sim.run(until=400.0 if long else 50.0, every=20)
            at_rest = 0.0 if integrator(name).drags else temperature / system.box.volume
            energy = block_average([sample.energies.potential / count for sample in sim.record.samples])
            for quantity, value, error, exact in (
                ("pressure", report.pressure + at_rest, report.pressure_error, wanted.pressure),
                ("energy", float(energy.value), float(energy.error), wanted.energy),
            ):
                both = math.hypot(error or math.inf, EQUATION_ERROR if quantity == "pressure" else 0.0)
                off, text = abs(value - exact) / both, f"{value:.4f} ({error or math.inf:.4f})"
                print(f"  {name}: {quantity} {where}: {text}, expected {exact:.4f}: {off:.1f} errors", flush=True)
                bound = f"within {SIGMAS:g} errors of {exact:.4f}"
                yield claim(f"{name}: {quantity} {where}", text, bound, off <= SIGMAS, "Thol 2015")


def energies(system: kd.System, name: str, temperature: float, steps: int) -> np.ndarray:
    """Total energies of a run in a bath."""
    sim = kd.Simulation(system, name, 0.004, **options_of(name, temperature, STRONG))
    sim.equilibrate(temperature, 8.0)
    sim.run(steps, every=20)
    return np.array([sample.energies.total for sample in sim.record.samples])


def capacity_claims(long: bool) -> Iterator[Claim]:
    """The heat capacity from fluctuations is the slope of the energy."""
    steps, system = 800_000 if long else 80_000, fluid(64, TEMPERATURE, 0.5, cutoff=2.0)
    for name in BATHS:
        values = energies(system, name, TEMPERATURE, steps)
        fluctuation = block_average((values - values.mean()) ** 2 / TEMPERATURE**2 / len(system))
        means = [
            block_average(energies(system, name, TEMPERATURE + sign * APART, steps) / len(system)) for sign in (1, -1)
        ]
        slope = float(means[0].value - means[1].value) / (2.0 * APART)
        slope_error = math.hypot(*(float(each.error) for each in means)) / (2.0 * APART)
        difference, error = float(fluctuation.value) - slope, math.hypot(float(fluctuation.error), slope_error)
        text = f"{float(fluctuation.value):.3f} ({float(fluctuation.error):.3f}) and {slope:.3f} ({slope_error:.3f})"
        print(f"  {name}: heat capacity {text}: {abs(difference) / error:.1f} errors", flush=True)
        yield claim(
            f"{name}: heat capacity per particle, from fluctuations and as a slope", text,
            f"{SIGMAS:g} errors apart at most", abs(difference) <= SIGMAS * error, "statistical mechanics",
        )  # fmt: skip


def conserved_claims() -> Iterator[Claim]:
    """Total energy less heat has no drift over a million steps."""
    system = fluid(27, TEMPERATURE, 0.5, cutoff=1.85, truncation="switch", switch_start=1.3)
    for name in CONSERVED:
        sim = kd.Simulation(system, name, 0.001, **options_of(name, TEMPERATURE, OPTIONS))
        sim.equilibrate(TEMPERATURE, 4.0)
        energy = sim.run(STEPS, every=500).energy
        rate = f"{energy.drift_per_unit_time:+.1e} ± {energy.drift_error:.1e} per τ"
        print(f"  {name}: {rate}, {energy.verdict}", flush=True)
        yield claim(f"{name}: drift of energy less heat over {STEPS:,} steps", rate, "0 within three standard errors",
                    abs(energy.drift_per_unit_time) <= 1.5 * energy.drift_error, "the law of the bath")  # fmt: skip


def claims(long: bool = False) -> Iterator[Claim]:
    yield from velocity_claims()
    yield from state_claims(long)
    yield from capacity_claims(long)
    yield from conserved_claims()


if __name__ == "__main__":
    main(claims, __doc__)
