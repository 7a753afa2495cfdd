"""Does `kickdrift certify` pass right heat baths, and does it fail wrong ones?

    python -m kickdrift_validation.certify [--long]

27 Lennard-Jones particles at T* = 1, 60,000 steps of dt* = 0.004, a sample every 20 steps. Clean runs use four heat
baths. Wrong runs have one planted fault each. The short set has 16 clean runs, 4 pairs and 3 runs of each fault; the
long set 200 clean runs, 40 pairs and 20 runs of each fault.
"""

from __future__ import annotations

import sys
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
from kickdrift.analysis.certificate import EnsembleChecks
from kickdrift.analysis.certifying import checked
from kickdrift.analysis.sampled_run import SampledRun, kinetic_groups, sampled_run
from kickdrift.integrators import csvr, ornstein_uhlenbeck
from kickdrift_validation.claim import Claim, claim, main

DT, STEPS, EVERY, SETTLING = 0.004, 60_000, 20, 5_000
FRICTION = 10.0
BATHS: dict[str, dict[str, float]] = {
    "baoab": {"friction": FRICTION}, "csvr": {"tau": 0.05}, "nose-hoover": {"tau": 0.1},
    "andersen": {"collision_rate": FRICTION},
}  # fmt: skip
SHORT, LONG = (16, 4, 3), (200, 40, 20)  # clean runs, pairs of runs, runs of each fault
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
    """27 particles in a harmonic well, which do not feel one another."""
    rng = np.random.default_rng(seed)
    return kd.System(rng.normal(size=(27, 3)), rng.normal(size=(27, 3)), forces=[kd.HarmonicTrap(1.0)], units="lj")


def simulation(name: str, seed: int, temperature: float = 1.0, system: kd.System | None = None) -> kd.Simulation:
    """A Simulation that has reached its temperature."""
    noise = {} if name == "nose-hoover" else {"seed": seed}
    sim = kd.Simulation(system or fluid(seed), name, DT, temperature=temperature, **noise, **BATHS[name])
    sim.advance(SETTLING)
    return sim


def written(sim: kd.Simulation, path: Path, steps: int = STEPS) -> Path:
    """The file of a run."""
    sim.run(steps, every=EVERY, output=path, overwrite=True)
    return path


# --- faults: each returns the verdicts on a run of a seed ---


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
        numbers(ornstein_uhlenbeck, lambda bath: bath._replace(spread=bath.spread * share)),
        patch.dict(BATHS, baoab={"friction": 2 * FRICTION}),
    ):
        return ensemble_checks(written(simulation("baoab", seed), path))


def off_temperature(seed: int, path: Path) -> EnsembleChecks:
    """The noise belongs to a temperature 2 % higher; runs are twice as long, as their errors are 0.5 %."""
    with numbers(ornstein_uhlenbeck, lambda bath: bath._replace(spread=bath.spread * np.sqrt(1.02))):
        return ensemble_checks(written(simulation("baoab", seed), path, 2 * STEPS))


def two_axes(seed: int, path: Path) -> EnsembleChecks:
    """The bath leaves out the third axis, of particles that do not collide."""
    with numbers(ornstein_uhlenbeck, lambda bath: bath._replace(axes=2)):
        return ensemble_checks(written(simulation("baoab", seed, system=wells(seed)), path))


def centre_removed(seed: int, path: Path) -> EnsembleChecks:
    """The program takes out the motion of the centre of mass, and counts its degrees of freedom."""
    with kd.open(written(simulation("baoab", seed), path)) as run:
        true, velocities = sampled_run(run), run.velocities
        masses, names = run.masses, np.array(run.species)[run.species_index]
    velocities -= np.einsum("n,fnk->fk", masses / masses.sum(), velocities)[:, np.newaxis]
    return checked([of_velocities(true, velocities, masses, names)])


def wrong_energies(seed: int, path: Path) -> EnsembleChecks:
    """Potential energies are 1.5 times those that belong to the forces."""
    runs = pair("baoab", seed, path)
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


FAULTS: dict[str, Callable[[int, Path], EnsembleChecks]] = {
    "wrong degrees of freedom": wrong_freedom,
    "a doubled drag": doubled_drag,
    "a temperature 2 % too high": off_temperature,
    "one axis without a bath": two_axes,
    "a removed centre of mass that is not counted": centre_removed,
    "noise that is reused in each step": frozen_counter,
    "scaled velocities without noise": weak_coupling,
    "energies that do not belong to the forces": wrong_energies,
}


def pair(name: str, seed: int, path: Path) -> list[Path]:
    """Files of two runs at neighbouring temperatures."""
    return [
        written(simulation(name, 2 * seed + k, temperature), path.with_stem(f"{path.stem}-{k}"))
        for k, temperature in enumerate((1.0, 1.4))
    ]


def alarms(verdicts: Iterator[EnsembleChecks], label: str) -> int:
    """How many of the verdicts are failures; prints the tests that failed."""
    failed = 0
    for found in verdicts:
        failed += not found.passed
        worst = min(found.rows, key=lambda row: row.p_value)
        said = ", ".join(row.test for row in found.failed) or "passed"
        print(f"{label}: smallest p {worst.p_value:.1e}; {said}", flush=True)
    return failed


def claims(long: bool = False) -> Iterator[Claim]:
    """False alarms of clean runs and pairs, and how often each fault is found."""
    runs, pairs, each = LONG if long else SHORT
    names = list(BATHS)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "run.h5md"
        clean = (ensemble_checks(written(simulation(names[seed % 4], 1000 + seed), path)) for seed in range(runs))
        found = alarms(clean, "clean run")
        most = int(FALSE_ALARMS * runs) if long else 1
        reference = f"{runs} runs with {', '.join(names)}"
        yield claim("clean runs that fail", found, f"at most {most}", found <= most, reference)
        both = (ensemble_checks(pair(names[seed % 4], 5000 + seed, path)) for seed in range(pairs))
        found = alarms(both, "clean pair")
        most = int(FALSE_ALARMS * pairs) if long else 1
        reference = f"{pairs} pairs of runs at T* = 1 and 1.4"
        yield claim("clean pairs that fail", found, f"at most {most}", found <= most, reference)
        for name, fault in FAULTS.items():
            found = alarms((fault(9000 + seed, path) for seed in range(each)), name)
            least = int(0.9 * each)
            yield claim(f"found: {name}", found, f"{least} or more of {each}", found >= least, fault.__doc__ or "")


if __name__ == "__main__":
    sys.exit(main(claims, __doc__))
