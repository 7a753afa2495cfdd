"""Engines: other programs that run the same System. Reading this registry loads none of them.

An engine declares what it supports, and refuses everything else with a reason. So a run never silently differs from the
request. The run loop, samples, files and reports are the same for all engines (see ``session``).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any

from kickdrift.engines.job import ASE_BATHS, CUDA_BATHS, LAMMPS_BATHS, OPENMM_BATHS, EngineBath
from kickdrift.errors import InputError
from kickdrift.integrators import INTEGRATORS
from kickdrift.integrators.options import MIXED, PRESSURE
from kickdrift.integrators.splitting.method import ROWS
from kickdrift.model.checks.arguments import other_name
from kickdrift.text import shown, suggestion

if TYPE_CHECKING:
    from kickdrift.engines.job import Job

NATIVE = "native"
ALONE = {"noise": "own", "splitting": "velocity-verlet"}  # values of options that other programs have


@dataclass(frozen=True)
class Engine:
    """Row of the registry.

    Attributes
    ----------
    name : also the name of the module in this package, and of the extra that installs the engine
    runs : kinds of systems and integrators that the engine takes, in one line
    needs : required distributions; the first is the program itself
    tested : major versions of the program that the tests have run
    motions : kickdrift's names of the engine's methods without a heat bath, and the program's own names
    baths : kickdrift's names of methods with a heat bath, and the program's own
    processes : whether the engine can use several processes
    source : the article that the program asks its users to cite
    mixed : whether the engine offers mixed precision
    """

    name: str
    runs: str
    needs: tuple[str, ...] = ()
    tested: tuple[str, ...] = ()
    motions: Mapping[str, str] = field(default_factory=dict)
    baths: Mapping[str, EngineBath] = field(default_factory=dict)
    processes: bool = False
    source: str = ""
    mixed: bool = False

    @property
    def methods(self) -> dict[str, str]:
        """kickdrift's names of all methods of the engine, and the program's own names."""
        return {**self.motions, **{ours: bath.name for ours, bath in self.baths.items()}}

    @property
    def foreign(self) -> bool:
        return self.name != NATIVE

    @property
    def version(self) -> str | None:
        """Version of the installed program; None if a part is missing."""
        found = [_version(package) for package in self.needs or ("kickdrift",)]
        return None if None in found else found[0]

    @property
    def install(self) -> str:
        """Command that installs the engine."""
        return f"pip install 'kickdrift[{self.name}]'"

    @property
    def module(self) -> Any:
        """Module of the engine, with ``refusal(job)`` and ``session(job)``. Only ``session`` loads the program."""
        return import_module(f"kickdrift.engines.{self.name}")

    def session(self, job: Job) -> Any:
        return self.module.session(job)

    def method_name(self, name: str) -> str:
        """kickdrift's name of a method, given by kickdrift's or the program's name. kickdrift's names take
        precedence."""
        if not isinstance(name, str) or name in INTEGRATORS:
            return name
        return next((ours for ours, theirs in self.methods.items() if theirs == name), name)

    def refusal(self, job: Job) -> str | None:
        """Reason why the engine cannot run this job, or None."""
        if job.hosts and not self.processes:
            return f"hosts: {self.name} runs on this machine alone"
        if job.processes > 1 and not self.processes:
            return f"processes: {self.name} runs in one process, not in {job.processes}"
        if not self.foreign:
            return None
        if job.threads > 1:
            own = "; give processes instead" if self.processes else ""
            return f"threads: {self.name} runs on one thread here, not on {job.threads}{own}"
        if not hasattr(job.system, "forces"):
            return f"{job.system.name!r} is an ODE; {self.name} moves particles"
        if job.system.events:
            return f"event {job.system.events[0].kind!r}: only a native run watches for events"
        if tie := job.system.held_by:
            return f"{tie}: only a native run keeps them; {self.name} is not given them"
        if job.method.name not in self.methods:
            known = ", ".join(a if a == b else f"{a} ({b})" for a, b in self.methods.items())
            return f"integrator {job.named!r}: {self.name} has {known}"
        if job.options.get(PRESSURE.name) is not None:
            return f"pressure: only a native run changes the box; {self.name} keeps it here"
        if job.options.compensated:
            return f"compensated: {self.name} has no compensated sums of positions and velocities"
        if job.options.precision == MIXED and not self.mixed:
            return f"precision: {self.name} does not offer {MIXED!r}"
        for option, only in ALONE.items():
            if job.options.get(option) not in (None, only):
                return f"{option}: {self.name} has {only!r} alone"
        found: str | None = self.module.refusal(job)
        return found

    def remarks(self, job: Job) -> list[str]:
        """How the program's forces differ from those of the job, a line each."""
        return list(getattr(self.module, "remarks", lambda job: [])(job))

    def check(self, job: Job) -> None:
        """Raise InputError if the engine cannot run the job (the error lists engines that can) or is not installed."""
        if reason := self.refusal(job):
            others = [name for name, other in ENGINES.items() if other is not self and other.refusal(job) is None]
            *first, last = others or [""]
            able = f"; {', '.join(first)} and {last} can" if first else f"; only {last} can" if last else ""
            raise InputError(f"engine {self.name!r}: {reason}{able}")
        missing = [package for package in self.needs if _version(package) is None]
        if missing:
            raise InputError(f"engine {self.name!r}: needs {' and '.join(missing)}: {self.install}")

    @property
    def warnings(self) -> list[str]:
        """Warnings of an untested version."""
        here = self.version
        if here is None or not self.foreign or here.split(".")[0] in self.tested:
            return []
        return [f"{self.needs[0]} {here} is not a tested version: {', '.join(f'{t}.x' for t in self.tested)}"]


@cache  # listing all installed distributions takes a millisecond
def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


_VERLET = "velocity-verlet"

ENGINES: dict[str, Engine] = {
    engine.name: engine
    for engine in (
        Engine(NATIVE, "everything, with kickdrift's own compiled kernels"),
        Engine(
            "ase", "shifted Lennard-Jones of one species, embedded atoms, Tersoff: VelocityVerlet and heat baths",
            ("ase",), ("3",), {_VERLET: "VelocityVerlet"}, ASE_BATHS,
            source="Larsen et al. 2017, J. Phys.: Condens. Matter 29, 273002, doi:10.1088/1361-648X/aa680e",
        ),
        Engine(
            "rebound", "gravity in open space: rebound's leapfrog, whfast, saba, trace and ias15", ("rebound",), ("5",),
            {
                "leapfrog-dkd": "leapfrog", "forest-ruth": "leapfrog of order 4", "wisdom-holman": "whfast",
                "saba": "saba", "trace": "trace", "gauss-radau15": "ias15",
            },
            source="Rein & Liu 2012, A&A 537, A128, doi:10.1051/0004-6361/201118085",
        ),
        Engine(
            "lammps", "Lennard-Jones, charges, molecules, many-body forces: fix nve and baths, in one process or many",
            ("lammps", "mpich"), ("2025",), {_VERLET: "fix nve"}, LAMMPS_BATHS, processes=True,
            source="Thompson et al. 2022, Comput. Phys. Commun. 271, 108171, doi:10.1016/j.cpc.2021.108171",
        ),
        Engine(
            "openmm", "Lennard-Jones, charges, molecules, gravity: OpenMM's Reference platform, which is in float64",
            ("openmm",), ("8",), {_VERLET: "CustomIntegrator"}, OPENMM_BATHS,
            source="Eastman et al. 2024, J. Phys. Chem. B 128, 109, doi:10.1021/acs.jpcb.3c06662",
        ),
        Engine(
            "cuda", "one pair law, or gravity, on a graphics processor",
            ("numba-cuda",), ("0",), {row.name: row.name for row in ROWS}, CUDA_BATHS, mixed=True,
            source="Lam, Pitrou & Seibert 2015, LLVM '15, 7, doi:10.1145/2833157.2833162 (numba)",
        ),
    )
}  # fmt: skip


def engine(name: str) -> Engine:
    """Engine of that name. Raises an InputError that lists the known names for an unknown one."""
    if not isinstance(name, str) or name not in ENGINES:
        hint = other_name("engine", name) or suggestion(name, ENGINES)
        raise InputError(f"engine {shown(name)} is not one of {', '.join(ENGINES)}{hint}")
    return ENGINES[name]


def engines() -> list[str]:
    """Names of all engines, installed or not."""
    return list(ENGINES)
