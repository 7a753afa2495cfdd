"""Words of a report: on means beside what was asked, on the cause of a drift, and on a system that moves as a whole."""

from __future__ import annotations

from kickdrift.forces.pairs.law import PairForce
from kickdrift.looks.record import Series
from kickdrift.model.freedom import NONE, apart_of
from kickdrift.model.system import System

AGREES = 3.0  # standard errors
DIFFERS = "differs"
SLOW = "a long step makes velocities of this bath too slow, and configurations hardly at all"
DRAWN = "the bath draws velocities; no test of the motion"
JUMPS = "; the force jumps at the cutoff, see lj-1000-switch"
TOO_LONG = "; a shorter dt tells whether the step is too long"
LARGE = 10.0  # energy of the centre of mass that is worth a word, in heats of one particle
SHARE = 0.01  # of the kinetic energy


def verdict(mean: float, error: float | None, asked: float) -> str:
    """A mean beside the number that was asked for, in words."""
    if not error:
        return "too short to judge"
    off = abs(mean - asked) / error
    return "agrees" if off <= AGREES else f"{DIFFERS} by {off:.1f} standard errors"


def cause_of_drift(system: System, fixed: bool) -> str:
    """Words on the likely cause of a secular drift under pair forces; ``fixed`` tells whether the step is."""
    pairs = [force for force in system.forces if isinstance(force, PairForce)]
    if any(force.jumps_at_cutoff(system.species) for force in pairs):
        return JUMPS
    return TOO_LONG if pairs and fixed else ""


def moving(system: System, drags: bool, series: Series) -> list[str]:
    """Return a line if the centre of mass moves much faster than heat would make it, so that this motion is no heat."""
    if series.temperatures is None or series.momentum is None or apart_of(system, drags) == NONE:
        return []
    masses, momentum = system.coherent_masses, series.momentum[0]
    energy = 0.5 * float(momentum @ momentum) / float(masses.sum())
    if energy <= max(SHARE * series.kinetic, LARGE * (series.kinetic - energy) / len(masses)):
        return []
    return [
        f"the particles move as a whole: their centre of mass has {energy / series.kinetic:.3g} of the kinetic energy, "
        "which is no heat; temperature and pressure are without this motion"
    ]
