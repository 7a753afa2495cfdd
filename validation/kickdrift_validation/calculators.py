"""ASE's calculators as forces: the same run as ASE's own, what the loop adds to a step, and runs that are killed.

Copper, 256 atoms, EMT: 100 steps of kickdrift's velocity-verlet beside ASE's VelocityVerlet, and the virial beside the
slope of the energy with the box's scale. The overhead of a step is the processor time of a run less the time inside the
calculator's own ``calculate``, for a calculator that costs little, in the median of several runs; once without looks,
and once with a look and a frame for each step.

Then a child process runs 32 atoms into a file and is killed by SIGKILL at random moments. Each file must open and go on
to the bits of the run that was not killed. EMT keeps a neighbour list with a skin, so its sums depend on where the list
was made: a run that begins anew from positions and velocities alone has other bits, which a claim shows.
"""

import multiprocessing
import tempfile
from collections import Counter
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from time import perf_counter, process_time, sleep
from typing import Any

import numpy as np

import kickdrift as kd
from kickdrift.model.units.file_units import Scale
from kickdrift_validation.claim import Claim, at_least, at_most, claim, largest, main, not_run
from kickdrift_validation.kills import content

CELLS, DT, STEPS, SPREAD = 4, 0.005, 100, 0.05  # cells along an edge, ps, steps, eV of each degree of freedom
SAME = 1e-10
OVERHEAD, OVERHEAD_FILE = 20.0, 100.0  # microseconds a step
RUNS, TIMED, TIMED_FILE = 9, 400, 2000
KILLS, KILLS_LONG, SEED, KILLED_STEPS, EVERY = 30, 120, 4, 150, 3
SOURCE = "ASE's EMT and VelocityVerlet"


def copper(cells: int, seed: int = 1, factor: float = 1.0) -> Any:
    """Warm copper, 4 atoms a cell, with the cell's edge times ``factor``."""
    from ase.build import bulk

    atoms = bulk("Cu", a=3.61 * factor, cubic=True) * (cells, cells, cells)
    rng = np.random.default_rng(seed)
    atoms.positions += factor * rng.uniform(-0.05, 0.05, atoms.positions.shape)
    atoms.set_momenta(rng.normal(size=atoms.positions.shape) * np.sqrt(atoms.get_masses()[:, None] * SPREAD))
    return atoms


def under(atoms: Any, calculator: Any, **given: Any) -> kd.System:
    return kd.System.from_ase(atoms, [kd.CalculatorForce(calculator, **given)])


def beside_ase() -> Iterator[Claim]:
    """The same steps in both programs."""
    from ase.calculators.emt import EMT
    from ase.md.verlet import VelocityVerlet

    atoms = copper(CELLS)
    system = under(atoms, EMT)
    sim = kd.Simulation(system, "velocity-verlet", dt=DT)
    report = sim.run(STEPS, every=1)
    atoms.calc = EMT()
    dynamics = VelocityVerlet(atoms, DT * Scale.of(system.units).velocity)
    energies = [atoms.get_potential_energy()]
    for _ in range(STEPS):
        dynamics.step()
        energies.append(atoms.get_potential_energy())
    ours = [sample.energies.potential for sample in sim.record.samples]
    apart = np.abs(atoms.positions - sim.state.positions).max()
    off = np.abs(np.array(energies) - ours).max()
    what = f"{len(atoms)} atoms, {STEPS} steps:"
    yield claim(f"{what} positions apart, angstrom", float(apart), f"at most {SAME:g}", apart <= SAME, SOURCE)
    yield claim(f"{what} potential energies apart, eV", float(off), f"at most {SAME:g}", off <= SAME, SOURCE)
    calls = sim.integration.flow.forces.hosts[0].calls  # type: ignore[union-attr]
    most = STEPS + 3
    text = f"{what} calls of Python, with a look at each step"
    yield claim(text, calls, f"at most {most}", calls <= most, "one for each step")
    assert report.pressure is not None
    yield from pressure()


def pressure() -> Iterator[Claim]:
    """The virial is minus the slope of the energy with the box's scale."""
    from ase.calculators.emt import EMT

    def energy(factor: float) -> float:
        return kd.Simulation(under(copper(2, factor=factor), EMT), dt=DT).energy().potential

    atoms, h = copper(2), 1e-3
    atoms.set_momenta(np.zeros_like(atoms.positions))
    system = under(atoms, EMT)
    virial = 3.0 * system.volume * kd.Simulation(system, dt=DT).sample().pressure
    slopes = [(energy(1 + d) - energy(1 - d)) / (2 * d) for d in (h, h / 2)]
    slope = (4 * slopes[1] - slopes[0]) / 3
    off = abs(virial / -slope - 1.0)
    yield at_most("virial of the stress: relative difference", off, 1e-8, "energy of a scaled box")


def timed_calculator() -> Any:
    """A calculator that costs little and counts its own processor time."""
    from ase.calculators.calculator import Calculator, all_changes

    class Springs(Calculator):
        implemented_properties = ["energy", "forces", "stress"]  # noqa: RUF012
        inside = 0.0

        def calculate(
            self, atoms: Any = None, properties: Any = ("energy",), system_changes: Any = all_changes
        ) -> None:
            began = process_time()
            super().calculate(atoms, properties, system_changes)
            d = atoms.positions - self.home if hasattr(self, "home") else 0.0 * atoms.positions
            if not hasattr(self, "home"):
                self.home = atoms.positions.copy()
            self.results = {"energy": 0.5 * float((d * d).sum()), "forces": -d, "stress": np.zeros(6)}
            self.inside += process_time() - began

    return Springs()


def overhead(folder: Path) -> Iterator[Claim]:
    """Microseconds of a step outside the calculator."""
    calculator = timed_calculator()
    system = under(copper(CELLS), calculator)

    def spent(steps: int, every: int, output: Path | None) -> tuple[float, float]:
        sim = kd.Simulation(system, "velocity-verlet", dt=0.1 * DT)
        sim.run(10, every=every)
        calculator.inside, began = 0.0, process_time()
        sim.run(steps, every=every, output=output, overwrite=output is not None)
        whole = process_time() - began
        return 1e6 * (whole - calculator.inside) / steps, 1e6 * calculator.inside / steps

    cases = (
        ("without looks", TIMED, TIMED, None, OVERHEAD),
        ("a look at each step", TIMED, 1, None, OVERHEAD),
        ("a look and a frame in a file at each step", TIMED_FILE, 1, folder / "timed.h5md", OVERHEAD_FILE),
    )
    for what, steps, every, output, bound in cases:
        spent(50, every, output)
        found = [spent(steps, every, output) for _ in range(RUNS)]
        outside, inside = (float(np.median(values)) for values in zip(*found, strict=True))
        text = f"256 atoms, {what}: microseconds a step outside the calculator, {inside:.0f} inside, median of {RUNS}"
        yield claim(text, round(outside, 1), f"under {bound:g}", outside < bound, "processor time")


def killed_run(path: str | None, steps: int = KILLED_STEPS) -> kd.Simulation:
    from ase.calculators.emt import EMT

    sim = kd.Simulation(under(copper(2, seed=3), EMT, arguments={"asap_cutoff": True}), dt=DT)
    file = kd.FileOptions(flush=1e-9) if path else None
    sim.run(steps, every=EVERY, output=path, file=file)
    return sim


def kills(folder: Path, long: bool) -> Iterator[Claim]:
    """Runs that are killed at random moments, and go on."""
    rng, count = np.random.default_rng(SEED), KILLS_LONG if long else KILLS
    whole, path = folder / "whole.h5md", folder / "run.h5md"
    killed_run(None, 1)  # compiles, too: children are forked from here
    began = perf_counter()
    reference = killed_run(str(whole))
    lasting = perf_counter() - began
    truth = content(whole)
    found: Counter[str] = Counter()
    wrong: Counter[str] = Counter()
    for _ in range(count):
        path.unlink(missing_ok=True)
        process = multiprocessing.get_context("fork").Process(target=killed_run, args=(str(path),))
        process.start()
        sleep(float(rng.uniform(0.0, lasting)))
        process.kill()
        process.join()
        if not path.exists():
            found["before there was a file"] += 1
            continue
        sim = kd.resume(path)
        found["at its end" if sim.steps_done >= KILLED_STEPS else "inside"] += 1
        sim.run()
        there = content(path)
        wrong.update(key for key in truth if there[key] != truth[key])
    text = f"{count} kills ({', '.join(f'{number} {where}' for where, number in found.items())}): other bits"
    yield claim(text, sum(wrong.values()), "0", not wrong, "the run that was not killed")
    yield claim("kills inside the run", found["inside"], f"at least {count // 2}", found["inside"] >= count // 2, "")
    half = killed_run(None, KILLED_STEPS // 2)
    fresh = kd.Simulation(half.system.at(half.state.phase, half.time, half.steps_done), dt=DT)
    fresh.run(KILLED_STEPS - fresh.steps_done)
    apart = float(np.abs(fresh.state.positions - reference.state.positions).max())
    text = "a run begun anew from positions and velocities alone, apart, angstrom"
    yield claim(text, apart, "over 0, under 1e-09", 0.0 < apart < 1e-9, "EMT's neighbour list was made elsewhere")


def functions() -> Iterator[Claim]:
    """A plain function beside the compiled force of the same formula, for every method that takes both."""
    from kickdrift.integrators import INTEGRATORS

    def trap(x: np.ndarray, v: np.ndarray, t: float, box: Any) -> tuple[np.ndarray, float]:
        return -2.0 * x, float((x * x).sum())

    rng = np.random.default_rng(2)
    x, v = rng.normal(size=(4, 3)), rng.normal(size=(4, 3))
    off, took = 0.0, 0
    for name, method in INTEGRATORS.items():
        options: dict[str, Any] = {} if method.chooses_steps else {"dt": 0.01}
        for option in method.declared:
            if option.default is None and option.type is float:
                options.setdefault(option.name, 1.0)
        ends = []
        for force in (kd.PythonForce(trap), kd.HarmonicTrap(2.0)):
            try:
                sim = kd.Simulation(kd.System(x, v, forces=[force]), name, **options)
                sim.run(until=0.2)
                ends.append(sim.state.phase)
            except kd.InputError:
                ends.append(None)
        assert (ends[0] is None) == (ends[1] is None), name
        if ends[0] is not None:
            took += 1
            off = largest(off, float(np.abs(ends[0] - ends[1]).max()))
    text = f"a Python function under {took} methods: largest difference from the compiled trap"
    yield claim(text, off, "0", off == 0.0, "kd.HarmonicTrap")
    yield at_least("methods that take a Python function", took, 25, "the registry")


def claims(long: bool = False) -> Iterator[Claim]:
    """``long`` kills more runs, and measures the overhead of a step, which needs an idle machine."""
    yield from functions()
    if find_spec("ase") is None:
        yield not_run("copper with EMT beside ASE, overhead, kills", "as stated", SOURCE)
        return
    with tempfile.TemporaryDirectory() as folder:
        yield from beside_ase()
        if long:
            yield from overhead(Path(folder))
        yield from kills(Path(folder), long)


if __name__ == "__main__":
    main(claims, __doc__)
