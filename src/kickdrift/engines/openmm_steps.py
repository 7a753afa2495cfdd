"""OpenMM's integrators: words over flows as a CustomIntegrator, and OpenMM's own heat baths.

LangevinMiddleIntegrator is the word BAOA. NoseHooverIntegrator has its chain in the middle of the drift, BANA (Zhang et
al. 2019, doi:10.1021/acs.jpca.9b02771). AndersenThermostat acts where its System is updated, which is here the end of a
step. The other words take OpenMM's normal numbers.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from kickdrift.integrators.splitting.method import Splitting

if TYPE_CHECKING:
    from kickdrift.engines.job import Job

HEAT = "heat"  # a variable of words with a bath


def integrator(job: Job, made: Any, seed: int) -> tuple[Any, Callable[[], float] | None]:
    """Integrator for a job, and a function that returns the heat, or None if OpenMM does not tell it.

    ``made`` is OpenMM's System. Some baths add a force to it."""
    import openmm

    options, dt = job.options, job.options.dt
    assert dt is not None
    if job.method.name == "nose-hoover":
        made.addForce(openmm.CMMotionRemover(1))  # OpenMM counts 3 N - 3 degrees of freedom where it sees this force
        chain = openmm.NoseHooverIntegrator(
            _kelvin(job), 1.0 / options.tau, dt, options.chain, 1, 3  # parts of a step, and of Suzuki and Yoshida's
        )  # fmt: skip
        return chain, lambda: -_plain(chain.computeHeatBathEnergy())
    if job.method.name == "baoa":
        middle = openmm.LangevinMiddleIntegrator(_kelvin(job), options.friction, dt)
        middle.setRandomNumberSeed(seed)
        return middle, None
    if job.method.name == "andersen":
        collisions = openmm.AndersenThermostat(_kelvin(job), options.collision_rate)
        collisions.setRandomNumberSeed(seed)
        made.addForce(collisions)
    assert isinstance(job.method, Splitting)
    word = openmm.CustomIntegrator(dt)
    word.setRandomNumberSeed(seed)
    if job.method.bath:
        for name in (HEAT, "before", "after"):
            word.addGlobalVariable(name, 0.0)
    for letter, weight in zip(job.method.word, job.method.weights, strict=True):
        _FLOWS[letter](word, job, weight * dt)
    return word, (lambda: float(word.getGlobalVariableByName(HEAT))) if job.method.bath else None


def _kelvin(job: Job) -> float:
    """The temperature at which OpenMM's k_B T is that of the job."""
    import openmm.unit

    return _thermal(job) / _plain(openmm.unit.MOLAR_GAS_CONSTANT_R)


def _thermal(job: Job) -> float:
    return float(job.system.units.boltzmann * job.options.temperature)


def _kick(word: Any, job: Job, span: float) -> None:
    word.addComputePerDof("v", f"v + {span!r}*f/m")


def _drift(word: Any, job: Job, span: float) -> None:
    word.addComputePerDof("x", f"x + {span!r}*v")


def _ornstein_uhlenbeck(word: Any, job: Job, span: float) -> None:
    rate = job.options.friction
    kept, spread = math.exp(-rate * span), math.sqrt(-math.expm1(-2.0 * rate * span) * _thermal(job))
    _counted(word, lambda: word.addComputePerDof("v", f"{kept!r}*v + {spread!r}*gaussian/sqrt(m)"))


def _collisions(word: Any, job: Job, span: float) -> None:
    _counted(word, word.addUpdateContextState)


def _counted(word: Any, act: Callable[[], Any]) -> None:
    """Let a bath act, and add the change of the kinetic energy to the heat."""
    word.addComputeSum("before", "0.5*m*v*v")
    act()
    word.addComputeSum("after", "0.5*m*v*v")
    word.addComputeGlobal(HEAT, f"{HEAT} + after - before")


_FLOWS: dict[str, Callable[[Any, Job, float], None]] = {
    "A": _drift, "B": _kick, "O": _ornstein_uhlenbeck, "D": _collisions,
}  # fmt: skip


def _plain(quantity: Any) -> float:
    """Number in OpenMM's internal units."""
    import openmm.unit

    return float(quantity.value_in_unit_system(openmm.unit.md_unit_system))
