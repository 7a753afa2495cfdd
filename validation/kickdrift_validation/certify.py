"""Does `kickdrift certify` pass right heat baths, and does it fail wrong ones?

27 Lennard-Jones particles at T* = 1, 24,000 steps of dt* = 0.004, twice as many in pairs, and a sample every 20 steps.
Clean runs use four heat baths. Wrong runs have one planted fault each: most in kickdrift's own baths, the others in
small simulations in NumPy (wrong_baths.py), which also have a barostat. The short set has 200 clean runs, 8 pairs at
two temperatures, 8 pairs at two pressures and 2 runs of each fault; the long set 600 clean runs, 40 pairs of each kind
and 20 runs of each fault.

A mass of the barostat that is three times too large everywhere changes the period of the volume and no average, so the
fault is a noise that does not belong to the mass.
"""

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch

import numpy as np

import kickdrift as kd
from kickdrift.analysis import ensemble_checks
from kickdrift.analysis.certify.certificate import EnsembleChecks
from kickdrift.analysis.certify.certifying import checked
from kickdrift.analysis.certify.sampled_run import SampledRun, kinetic_groups, sampled_run
from kickdrift.integrators.splitting.baths import csvr, velocity_noise
from kickdrift_validation.claim import Claim, claim, main
from kickdrift_validation.wrong_baths import gas, oscillators

DT, STEPS, EVERY, SETTLING = 0.004, 24_000, 20, 5_000
LONG_DT = 0.025  # half of the longest stable step
FRICTION = 10.0
BATHS: dict[str, dict[str, float]] = {
    "baoab": {"friction": FRICTION}, "csvr": {"tau": 0.05}, "nose-hoover": {"tau": 0.1},
    "andersen": {"collision_rate": FRICTION},
}  # fmt: skip
SHORT, LONG = (200, 8, 2), (600, 40, 20)  # clean runs, pairs of runs, runs of each fault
PRESSURES = (1.0, 1.3)  # of the gas
FALSE_ALARMS = 0.05  # largest share of clean runs that may fail


def fluid(seed: int) -> kd.System:
    """27 Lennard-Jones particles of two species in a periodic box."""
    rng = np.random.default_rng(seed)
    edge = (27 / 0.7) ** (1 / 3)
    x = np.indices((3, 3, 3)).reshape(3, -1).T * edge / 3 + rng.uniform(-0.05, 0.05, (27, 3))
    masses = np.array([1.0, 3.0, 1.0] * 9)
    v = rng.normal(size=(27, 3)) / np.sqrt(masses)[:, np.newaxis]
    v -= masses @ v / masses.sum()
    force = kd.LennardJones(cutoff=1.6, truncation="switch")
    return kd.System(x, v, masses, box=(edge,) * 3, forces=[force], species=["A", "B", "A"] * 9)


def wells(seed: int) -> kd.System:
    """27 particles in a harmonic well, which do not feel one another. Each has twice the mean energy at T* = 1."""
    phase = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, (27, 3))
    return kd.System(2.0 * np.cos(phase), 2.0 * np.sin(phase), forces=[kd.HarmonicTrap(1.0)], units="lj")


def simulation(name: str, seed: int, temperature: float = 1.0, system: kd.System | None = None) -> kd.Simulation:
    """A Simulation that has reached its temperature."""
    noise = {} if name == "nose-hoover" else {"seed": seed}
    sim = kd.Simulation(system or fluid(seed), name, DT, temperature=temperature, **noise, **BATHS[name])
    sim.advance(SETTLING)
    return sim


def written(sim: kd.Simulation, path: Path, steps: int = STEPS) -> Path:
    sim.run(steps, every=EVERY, output=path, overwrite=True)
    return path


@contextmanager
def numbers(module: Any, change: Callable[[Any], Any]) -> Iterator[None]:
    """Change the numbers of a heat bath when a run binds them."""
    true = module.bathed
    with patch.object(module, "bathed", lambda *given, **named: change(true(*given, **named))):
        yield


def wrong_freedom(seed: int, path: Path) -> EnsembleChecks:
    """The bath counts 3 N degrees of freedom, although it leaves the total momentum at zero."""
    with numbers(csvr, lambda bath: bath._replace(freedom=3.0 * 27)):
        return ensemble_checks(written(simulation("csvr", seed), path))


def doubled_drag(seed: int, path: Path) -> EnsembleChecks:
    """The drag is doubled and the noise is not."""
    kept = np.exp(-FRICTION * DT)
    share = np.sqrt((1 - kept**2) / (1 - kept**4))
    with (
        numbers(velocity_noise, lambda bath: bath._replace(spread=bath.spread * share)),
        patch.dict(BATHS, baoab={"friction": 2 * FRICTION}),
    ):
        return ensemble_checks(written(simulation("baoab", seed), path))


def half_noise(seed: int, path: Path) -> EnsembleChecks:
    """The variance of the noise is half of what belongs to the drag."""
    with numbers(velocity_noise, lambda bath: bath._replace(spread=bath.spread * np.sqrt(0.5))):
        return ensemble_checks(written(simulation("baoab", seed), path))


def off_temperature(seed: int, path: Path) -> EnsembleChecks:
    """k_B is 2 % too large; runs are five times as long, as their errors are then 0.4 %."""
    with numbers(velocity_noise, lambda bath: bath._replace(spread=bath.spread * np.sqrt(1.02))):
        return ensemble_checks(written(simulation("baoab", seed), path, 5 * STEPS))


def other_tau(seed: int, path: Path) -> EnsembleChecks:
    """The kinetic energy decays with the tau of this bath, and the noise belongs to twice this tau."""
    lost, wrong = (-np.expm1(-0.5 * DT / (times * BATHS["csvr"]["tau"])) for times in (1.0, 2.0))
    with numbers(csvr, lambda bath: bath._replace(thermal=bath.thermal * wrong / lost)):
        return ensemble_checks(written(simulation("csvr", seed), path))


def long_step(seed: int, path: Path) -> EnsembleChecks:
    """The step is about half of the longest stable one: dt* = 0.025."""
    sim = kd.Simulation(fluid(seed), "baoab", LONG_DT, temperature=1.0, seed=seed, **BATHS["baoab"])
    sim.advance(SETTLING // 5)
    sim.run(STEPS // 2, every=EVERY // 4, output=path, overwrite=True)
    return ensemble_checks(path)


def two_axes(seed: int, path: Path) -> EnsembleChecks:
    """The bath leaves out the third axis, of particles that do not collide; runs are three times as long."""
    with numbers(velocity_noise, lambda bath: bath._replace(axes=2)):
        return ensemble_checks(written(simulation("baoab", seed, system=wells(seed)), path, 3 * STEPS))


def centre_removed(seed: int, path: Path) -> EnsembleChecks:
    """The program takes out the motion of the centre of mass, and counts its degrees of freedom."""
    with kd.open(written(simulation("baoab", seed), path)) as run:
        true, velocities = sampled_run(run), run.velocities
        masses, names = run.masses, np.array(run.species)[run.species_index]
    velocities -= np.einsum("n,fnk->fk", masses / masses.sum(), velocities)[:, np.newaxis]
    return checked([of_velocities(true, velocities, masses, names)])


def wrong_energies(seed: int, path: Path) -> EnsembleChecks:
    """Potential energies are 1.5 times those that belong to the forces; runs are four times as long."""
    runs = pair("baoab", seed, path, 4 * STEPS)
    return checked([replace(run, potential=1.5 * run.potential) for run in map(sampled_run, runs)])  # type: ignore[operator]


def frozen_counter(seed: int, path: Path) -> EnsembleChecks:
    """Each step draws the noise of step 0."""
    sim, velocities = simulation("baoab", seed), []
    written(sim, path, 2 * EVERY)
    stepper: Any = sim.integration.stepper
    for done in range(STEPS):
        stepper.steps_done = 0
        assert stepper.advance(1) == 0
        if done % 10 == 0:
            velocities.append(stepper.y[1].T.copy())
    return collected(path, velocities)


def weak_coupling(seed: int, path: Path) -> EnsembleChecks:
    """Velocities are scaled towards the temperature, without noise (Berendsen et al. 1984, doi:10.1063/1.448118)."""
    sim, velocities = kd.Simulation(fluid(seed), "velocity-verlet", DT), []
    written(simulation("csvr", seed), path, 2 * EVERY)
    for done in range(2_500):
        sim.advance(10)
        state, kinetic = sim.state, sim.energy().kinetic
        scale = np.sqrt(1 + 10 * DT / 0.1 * (0.5 * 78 / kinetic - 1))
        sim.state = _scaled(state, scale)
        if done >= 500:
            velocities.append(sim.state.velocities)
    return collected(path, velocities)


def _scaled(state: kd.State, factor: float) -> kd.State:
    phase = np.array([state.positions.T, factor * state.velocities.T])
    return replace(state, phase=phase)


def collected(path: Path, velocities: list[Any]) -> EnsembleChecks:
    """Verdicts on velocities of a run like that of the file."""
    with kd.open(path) as run:
        masses, names = run.masses, np.array(run.species)[run.species_index]
        return checked([of_velocities(sampled_run(run), np.array(velocities), masses, names)])


def of_velocities(true: SampledRun, velocities: Any, masses: Any, names: Any) -> SampledRun:
    """The run with other velocities (k, n, 3), and with the degrees of freedom that it had."""
    groups = kinetic_groups(lambda: [velocities], masses, names, 3, true.freedom < 3 * len(masses))
    kinetic = np.sum([each.kinetic for each in groups[:3]], axis=0)
    volume = np.full(len(kinetic), true.volume[0])
    return replace(true, groups=groups, kinetic=kinetic, potential=None, volume=volume)


def one_species(seed: int, path: Path) -> EnsembleChecks:
    """The bath leaves out a species of oscillators."""
    return checked([oscillators(seed, species="A")])


def reused_noise(seed: int, path: Path) -> EnsembleChecks:
    """Random numbers serve in two steps each."""
    return checked([oscillators(seed, reused=2)])


def heavy_barostat(seed: int, path: Path) -> EnsembleChecks:
    """The barostat's noise belongs to a mass 3 times too large."""
    return checked([gas(2 * seed + k, pressure, noise_mass=3.0) for k, pressure in enumerate(PRESSURES)])


def no_kinetic_pressure(seed: int, path: Path) -> EnsembleChecks:
    """The barostat balances the pressure of the forces alone."""
    return checked([gas(2 * seed + k, pressure, kinetic_pressure=False) for k, pressure in enumerate(PRESSURES)])


FAULTS: dict[str, Callable[[int, Path], EnsembleChecks]] = {
    "wrong degrees of freedom": wrong_freedom,
    "a doubled drag": doubled_drag,
    "half of the noise": half_noise,
    "a k_B 2 % too large": off_temperature,
    "tau of another bath in the noise": other_tau,
    "a step that is too long": long_step,
    "one axis without a bath": two_axes,
    "one species without a bath": one_species,
    "noise that is used in two steps": reused_noise,
    "the mass of a barostat 3 times too large in its noise": heavy_barostat,
    "a barostat without the kinetic pressure": no_kinetic_pressure,
    "a removed centre of mass that is not counted": centre_removed,
    "noise that is the same in every step": frozen_counter,
    "scaled velocities without noise": weak_coupling,
    "energies that do not belong to the forces": wrong_energies,
}


def pair(name: str, seed: int, path: Path, steps: int = 2 * STEPS) -> list[Path]:
    """Files of two runs at neighbouring temperatures."""
    return [
        written(simulation(name, 2 * seed + k, temperature), path.with_stem(f"{path.stem}-{k}"), steps)
        for k, temperature in enumerate((1.0, 1.4))
    ]


def alarms(verdicts: Iterator[EnsembleChecks], label: str) -> tuple[int, str]:
    """How many of the verdicts are failures, and the test that failed most often; prints the tests that failed."""
    failed, tests = 0, Counter[str]()
    for found in verdicts:
        failed += not found.passed
        worst = min(found.rows, key=lambda row: row.p_value)
        tests.update(dict.fromkeys((row.test for row in found.failed), 1))
        said = ", ".join(dict.fromkeys(row.test for row in found.failed)) or "passed"
        print(f"{label}: smallest p {worst.p_value:.1e}; {said}", flush=True)
    return failed, tests.most_common(1)[0][0] if tests else ""


def claims(long: bool = False) -> Iterator[Claim]:
    """False alarms of clean runs and pairs, and how often each fault is found."""
    runs, pairs, each = LONG if long else SHORT
    names = list(BATHS)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "run.h5md"
        clean = {
            "runs": (ensemble_checks(written(simulation(names[seed % 4], 1000 + seed), path)) for seed in range(runs)),
            "pairs at two temperatures": (ensemble_checks(pair(names[k % 4], 5000 + k, path)) for k in range(pairs)),
            "pairs at two pressures": (
                checked([gas(7000 + 2 * k + j, pressure) for j, pressure in enumerate(PRESSURES)]) for k in range(pairs)
            ),
        }
        for kind, verdicts in clean.items():
            count = runs if kind == "runs" else pairs
            found, _ = alarms(verdicts, f"clean {kind}")
            most = max(int(FALSE_ALARMS * count), 1)
            where = "a gas in NumPy with a barostat" if "pressures" in kind else ", ".join(names)
            yield claim(f"clean {kind} that fail, of {count}", found, f"at most {most}", found <= most, where)
        for name, fault in FAULTS.items():
            found, test = alarms((fault(9000 + seed, path) for seed in range(each)), name)
            least = int(0.9 * each) if long else each
            text = f"{found} of {each}; {test}"
            yield claim(f"found: {name}", text, f"{least} or more", found >= least, fault.__doc__ or "")


if __name__ == "__main__":
    main(claims, __doc__)
