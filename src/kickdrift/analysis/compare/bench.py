"""Lennard-Jones energy benchmark: energy errors of integrators at the same step and at the same cost."""

import platform
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from importlib.metadata import version
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from kickdrift.errors import InputError, RunError
from kickdrift.integrators import integrator as method_named
from kickdrift.looks.observers import kinetic_energy
from kickdrift.model.system import System
from kickdrift.run.report.report import Report
from kickdrift.run.simulation import Simulation
from kickdrift.systemfile.files import find
from kickdrift.systemfile.reading import loads

METHODS = ("velocity-verlet", "leapfrog-dkd", "forest-ruth", "yoshida6", "rk4")
SAME_STEP = 0.005
COST = 1000.0  # force evaluations per unit of time in the second table: velocity Verlet with dt = 0.001
TEMPERATURE, EQUILIBRATION_TIME = 1.44, 10.0
DEFAULT_STEPS = 2000
FULL_STEPS = 1_000_000
SAMPLES = 250  # energy samples in each run
# Claimed RMS energy errors for 10^6 steps; temperature, truncation and the error's definition are not stated.
CLAIMED = {"leapfrog-dkd": "0.003 %", "rk4": "0.0002 % and growing"}


@dataclass(frozen=True)
class Row:
    """One method in one table. After a blow-up ``report`` is None, and ``failure`` gives the step."""

    table: str
    method: str
    dt: float
    report: Report | None
    failure: str | None = None
    times: np.ndarray = field(default_factory=lambda: np.empty(0))
    relative_error: np.ndarray = field(default_factory=lambda: np.empty(0))

    def as_json(self) -> dict[str, Any]:
        """The row as plain numbers, including its energy series."""
        return {
            "table": self.table,
            "method": self.method,
            "dt": self.dt,
            "failure": self.failure,
            "report": self.report.as_json() if self.report else None,
            "times": self.times.tolist(),
            "relative_error": self.relative_error.tolist(),
        }


@dataclass(frozen=True)
class Plan:
    """Runs of the benchmark, (table, method, dt, steps), and their expected time."""

    runs: tuple[tuple[str, str, float, int], ...]
    seconds: float


Progress = Callable[[str, int, int], Any]


def benchmark_system(particles: int) -> System:
    """The shipped system lj-1000-switch with this many particles (a whole number of simple cubic cells)."""
    text = Path(find("lj-1000-switch")).read_text(encoding="utf-8")
    if particles != 1000:
        text = text.replace("count = 1000", f"count = {particles}")
    system = loads(text, f"lj-{particles}-switch")
    assert isinstance(system, System)
    return system


def plan(system: System, methods: Sequence[str], steps: int, threads: int = 1) -> Plan:
    """Plan both tables for the same physical length, ``steps`` x 0.005. A short pilot run gives the expected time."""
    if steps < 1:
        raise InputError(f"bench: steps must be one or more, got {steps}")
    runs = [("same step", name, SAME_STEP, steps) for name in methods]
    for name in methods:
        if name == "leapfrog-dkd" and "velocity-verlet" in methods:
            continue  # costs as much as velocity Verlet, so its row would repeat the first table's
        dt = method_named(name).evaluations / COST
        runs.append(("same cost", name, dt, max(1, round(steps * SAME_STEP / dt))))
    pilot = Simulation(system, integrator="velocity-verlet", dt=SAME_STEP, threads=threads)
    pilot.run(200)
    per_evaluation = pilot.record.wall_seconds / pilot.record.force_evaluations
    evaluations = sum(count * method_named(name).evaluations for _, name, _, count in runs)
    return Plan(tuple(runs), per_evaluation * (evaluations + EQUILIBRATION_TIME / SAME_STEP))


def lj_energy(system: System, the_plan: Plan, threads: int = 1, progress: Progress | None = None) -> list[Row]:
    """Run the plan from one equilibrated start. Returns a Row for each method in each table."""
    begin = Simulation(system, integrator="velocity-verlet", dt=SAME_STEP, threads=threads)
    begin.equilibrate(TEMPERATURE, EQUILIBRATION_TIME, progress=progress and partial(progress, "equilibration"))
    start = begin.state
    rows = []
    for table, name, dt, steps in the_plan.runs:
        sim = Simulation(system, integrator=name, dt=dt, threads=threads)
        sim.state = start
        show = progress and partial(progress, f"{name}, {table}")
        failure = None
        try:
            sim.run(steps, every=max(1, steps // SAMPLES), progress=show)
        except RunError as error:
            failure = str(error)
        samples = sim.record.samples
        initial = samples[0].energies.total
        error_of = np.array([(s.energies.total - initial) / abs(initial) for s in samples])
        times = np.array([s.time for s in samples])
        rows.append(Row(table, name, dt, None if failure else sim.report(), failure, times, error_of))
    return rows


def as_json(system: System, rows: Sequence[Row], seconds: float, threads: int) -> dict[str, Any]:
    """The benchmark as one object, with the processor and the versions."""
    masses = system.coherent_masses
    return {
        "benchmark": "lj-energy",
        "system": system.name,
        "particles": len(system),
        "temperature": TEMPERATURE,
        "initial_kinetic_energy": kinetic_energy(masses, system.state.phase[1]),
        "threads": threads,
        "wall_seconds": seconds,
        "versions": {name: version(name) for name in ("kickdrift", "numpy", "numba")}
        | {"python": platform.python_version()},
        "processor": processor(),
        "claimed_rms_error": CLAIMED,
        "rows": [row.as_json() for row in rows],
    }


def processor() -> str:
    """Name of the processor, if the system gives one."""
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def timed(work: Callable[[], Any]) -> tuple[Any, float]:
    """Result of ``work``, and its seconds."""
    began = perf_counter()
    return work(), perf_counter() - began
