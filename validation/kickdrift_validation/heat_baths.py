"""Heat baths: averages of a harmonic well, kinetic energies, conserved quantities, and a fluid at constant temperature.

A step of a word over A, B and O on an oscillator (m = omega = k_B T = 1) is a linear map of (x, v) with normal noise.
So its stationary covariance solves a discrete Lyapunov equation, which SciPy solves here from the word alone. At
omega dt = 1 the mean squares of x and v are rational numbers (Leimkuhler & Matthews 2013, doi:10.1093/amrx/abs010;
Kieninger & Keller 2022, doi:10.1021/acs.jctc.2c00585, for baoa). 20,000 particles in three dimensions are 60,000
independent oscillators. Each gives one mean over time, and their scatter gives the standard error.

The kinetic energy of a liquid in a bath is canonical: 2 K / k_B T is chi-squared with one degree of freedom for each
velocity. Baths that conserve the momentum have three fewer. Total energy less heat is conserved: exactly as dt goes to
0, with an error of order two for a word of order two. The deterministic chain keeps it bounded.

The Lennard-Jones fluid, cut and shifted at 2.5 sigma, is compared with the equation of state of Thol et al. 2015
(equation_of_state.py). The bound is three standard errors of the run; two numbers of each of eight baths are tried.
"""

import math
from collections.abc import Iterator

import numpy as np
from scipy import stats
from scipy.linalg import solve_discrete_lyapunov

import kickdrift as kd
from kickdrift.integrators import integrator
from kickdrift.integrators.splitting.method import Splitting
from kickdrift.statistics.blocks import block_average
from kickdrift_validation.claim import Claim, claim, main
from kickdrift_validation.equation_of_state import FORCES, equation, fluid

CLOSED = {"baoab": (1, 3 / 4), "aboba": (1, 4 / 3), "obabo": (4 / 3, 1), "oabao": (3 / 4, 1), "baoa": (1, 1)}
GRID = ((0.2, 1.0), (0.5, 0.3), (1.0, 2.0), (1.5, 1.0), (1.8, 0.5))  # omega dt and friction
OSCILLATORS, BURN_IN, SAMPLES = 20_000, 60.0, 40
BATHS = (*CLOSED, "csvr", "nose-hoover", "andersen")
OPTIONS = {"friction": 1.0, "tau": 0.5, "collision_rate": 1.0}
STRONG = {"friction": 5.0, "tau": 0.05, "collision_rate": 5.0}  # forget a sample before the next
SIGMAS = 3.0
SIGNIFICANT = 1e-3  # smallest p-value of a Kolmogorov-Smirnov test
LYAPUNOV = "SciPy's solution of the discrete Lyapunov equation"
LANGEVIN = "Leimkuhler & Matthews 2013; Kieninger & Keller 2022"
CANONICAL = "the chi-squared distribution"
EQUATION = "thol2015_cutshift_2.5"
STATE = (1.5, 0.6)  # T*, rho*
ORDERED, CONSERVED = ("nose-hoover", "csvr"), ("nose-hoover", "csvr", "baoab")


def options_of(name: str, temperature: float, values: dict[str, float] | None = None) -> dict[str, float]:
    known = {"temperature": temperature, **(values or OPTIONS)}
    return {key: value for key, value in known.items() if key in integrator(name).tunable}


def covariance(word: str, dt: float, friction: float) -> np.ndarray:
    """Stationary covariance of (x, v) after a step of the word on the oscillator of unit frequency and temperature."""
    step, noise = np.eye(2), np.zeros((2, 2))
    for letter in word:
        span = dt / word.count(letter)
        kept = math.exp(-friction * span)
        flow = {"A": [[1, span], [0, 1]], "B": [[1, 0], [-span, 1]], "O": [[1, 0], [0, kept]]}[letter]
        matrix = np.array(flow, dtype=float)
        step, noise = matrix @ step, matrix @ noise @ matrix.T
        if letter == "O":
            noise[1, 1] += 1.0 - kept**2
    found: np.ndarray = solve_discrete_lyapunov(step, noise)
    return found


def measured(name: str, dt: float, friction: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Means of x^2, x v and v^2, and their standard errors."""
    rng = np.random.default_rng(seed)
    start = rng.normal(size=(2, OSCILLATORS, 3))
    wells = kd.System(start[0], start[1], forces=[kd.HarmonicTrap(1.0)], units="lj")
    sim = kd.Simulation(wells, name, dt, temperature=1.0, friction=friction, seed=seed)
    sim.advance(round(BURN_IN / min(friction, 1.0) / dt / 4))
    sums = np.zeros((3, 3 * OSCILLATORS))
    for _ in range(SAMPLES):
        sim.advance(max(1, round(1.0 / dt)))
        state = sim.state
        x, v = state.positions.ravel(), state.velocities.ravel()
        sums += np.array([x * x, x * v, v * v])
    means = sums / SAMPLES
    return means.mean(axis=1), means.std(axis=1, ddof=1) / math.sqrt(3 * OSCILLATORS)


def oscillator_claims() -> Iterator[Claim]:
    """Averages at omega dt = 1, and the covariance at other steps."""
    for seed, (name, exact) in enumerate(CLOSED.items(), 10):
        means, errors = measured(name, 1.0, 1.0, seed)
        for quantity, k, wanted in (("x^2", 0, exact[0]), ("v^2", 2, exact[1])):
            off = abs(means[k] - wanted) / errors[k]
            value = f"{means[k]:.5f} ({errors[k]:.5f})"
            print(f"  {name}: mean {quantity} {value}, exact {wanted:.5f}: {off:.1f} standard errors", flush=True)
            bound = f"within {SIGMAS:g} standard errors of {wanted:.5f}"
            yield claim(f"{name}: mean {quantity} at omega dt = 1", value, bound, off <= SIGMAS, LANGEVIN)
    for k, name in enumerate(CLOSED):
        method = integrator(name)
        assert isinstance(method, Splitting)
        apart = []
        for dt, friction in GRID:
            wanted = covariance(method.word, dt, friction)[[0, 0, 1], [0, 1, 1]]
            means, errors = measured(name, dt, friction, seed=2 + k)
            apart.append(np.abs(means - wanted) / errors)
            off = ", ".join(f"{each:.1f}" for each in apart[-1])
            print(f"  {name}, dt = {dt}, friction = {friction}: {means}, expected {wanted}; apart {off}", flush=True)
        value, bound = float(np.max(apart)), f"at most {SIGMAS:g}"
        text = f"{name}: covariance of x and v at {len(GRID)} steps and frictions: farthest, in standard errors"
        yield claim(text, value, bound, value <= SIGMAS, LYAPUNOV)


def kinetic_claims(long: bool) -> Iterator[Claim]:
    """Kinetic energies of 64 particles are canonical."""
    temperature = 2.0
    system = fluid(64, temperature, 0.5, cutoff=2.0)
    for name in BATHS:
        sim = kd.Simulation(system, name, 0.004, **options_of(name, temperature, STRONG))
        sim.equilibrate(temperature, 8.0)
        found = []
        for _ in range(4000 if long else 800):
            sim.advance(50)
            found.append(2.0 * sim.energy().kinetic / temperature)
        freedom = 3 * len(system) - 3 * (not integrator(name).drags)
        p = float(stats.kstest(found, stats.chi2(freedom).cdf).pvalue)
        print(f"  {name}: 2 K / k_B T = {np.mean(found):.2f}, variance {np.var(found):.1f}; p = {p:.3f}", flush=True)
        text = f"{name}: 2 K / k_B T is chi-squared with {freedom} degrees of freedom: p-value of Kolmogorov-Smirnov"
        yield claim(text, p, f"above {SIGNIFICANT}", p > SIGNIFICANT, CANONICAL)


def conserved_claims(long: bool) -> Iterator[Claim]:
    """Total energy less heat: order two, and no drift over 100,000 steps."""
    system, steps = (
        fluid(64, 2.0, 0.5, cutoff=2.2, truncation="switch", switch_start=1.6),
        1_000_000 if long else 100_000,
    )
    for name in CONSERVED:
        errors = []
        for dt in (0.004, 0.002, 0.001):
            sim = kd.Simulation(system, name, dt, **options_of(name, 2.0))
            sim.equilibrate(2.0, 4.0)
            sim.run(round(20.0 / dt), every=round(0.04 / dt))
            errors.append(np.std([sample.energies.total + sample.taken.energy for sample in sim.record.samples]))
        slope = float(np.polyfit(np.log([0.004, 0.002, 0.001]), np.log(errors), 1)[0])
        print(f"  {name}: scatter {errors}, slope {slope:.3f}", flush=True)
        if name in ORDERED:
            text = f"{name}: scatter of energy less heat: slope from dt = 0.004, 0.002, 0.001"
            yield claim(text, slope, "1.75 to 2.25", abs(slope - 2.0) <= 0.25, "the order of the word")
        sim = kd.Simulation(system, name, 0.002, **options_of(name, 2.0))
        sim.equilibrate(2.0, 4.0)
        report = sim.run(steps, every=100)
        energy = report.energy
        rate = f"{energy.drift_per_unit_time:+.1e} ± {energy.drift_error:.1e} per τ"
        print(f"  {name}: {rate}, {energy.verdict}, heat {report.heat:.5g}", flush=True)
        yield claim(f"{name}: drift of energy less heat over {steps:,} steps", rate, "0 within three standard errors",
                    abs(energy.drift_per_unit_time) <= 1.5 * energy.drift_error, "the law of the bath")  # fmt: skip


def state_claims(long: bool) -> Iterator[Claim]:
    """Pressure, energy and temperature of a fluid beside the equation of state."""
    temperature, density = STATE
    wanted = equation(EQUATION, temperature, density)
    count, time = (1000, 400.0) if long else (512, 40.0)
    system = fluid(count, temperature, density, **FORCES[EQUATION])
    for name in BATHS:
        sim = kd.Simulation(system, name, 0.004, **options_of(name, temperature))
        sim.equilibrate(temperature, 8.0)
        report = sim.run(until=time, every=20)
        at_rest = 0.0 if integrator(name).drags else temperature / system.box.volume  # lacks the centre of mass
        energy = block_average([sample.energies.potential / count for sample in sim.record.samples])
        rows = (
            ("pressure", report.pressure + at_rest, report.pressure_error, wanted.pressure, "Thol 2015"),
            ("energy", float(energy.value), float(energy.error), wanted.energy, "Thol 2015"),
            ("temperature", report.temperature, report.temperature_error, temperature, "the bath's temperature"),
        )
        for quantity, value, error, exact, reference in rows:
            off = abs(value - exact) / error if error else math.inf
            text = f"{value:.4f} ({error or math.inf:.4f})"
            print(f"  {name}: {quantity} {text}, expected {exact:.4f}: {off:.1f} standard errors", flush=True)
            bound = f"within {SIGMAS:g} standard errors of {exact:.4f}"
            yield claim(
                f"{name}: {quantity} at T* = {temperature}, rho* = {density}", text, bound, off <= SIGMAS, reference
            )


def claims(long: bool = False) -> Iterator[Claim]:
    yield from oscillator_claims()
    yield from kinetic_claims(long)
    yield from conserved_claims(long)
    yield from state_claims(long)


if __name__ == "__main__":
    main(claims, __doc__)
