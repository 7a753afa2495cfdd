"""Signs that a trajectory is no good: blow-up, energy error, positions with few digits, speeds near that of light."""

import math
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from kickdrift.errors import InputError
from kickdrift.model.body_checks import constant_of
from kickdrift.model.checks.values import unwarned
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.statistics.drift import EnergyError, energy_error
from kickdrift.text import measured

# A tenth: speeds are off by a twentieth then, and a planet's semi-major axis by a tenth. Methods in common use stay
# below a hundredth, so a larger error is not a coarse step but a wrong motion.
ENERGY_LIMIT = 0.1
UNRELIABLE: Literal["unreliable"] = "unreliable"  # verdict on a run whose energy error is above this limit
DIGITS = 1e-6  # largest rounding of a position, over the length that forces need: six digits
FEW = 64  # most bodies whose nearest neighbours are measured
LIGHT = "the speed of light"


@unwarned
def energy_doubt(total: ArrayLike, kinetic: ArrayLike, error: EnergyError | None = None) -> str:
    """Warning of a trajectory by its total energies (k,); "" if its largest error is below a tenth of the energy.

    The energy is the larger of |E(0)| and the mean of the ``kinetic`` energies (k,), nan if there are none. A total
    near zero is the difference of large energies, and a part of it says nothing. By the virial theorem the mean
    kinetic energy is |E| of a bound system. ``error`` is the `energy_error`, if it is known."""
    energies, moving = np.asarray(total, dtype=float), np.asarray(kinetic, dtype=float).reshape(-1)
    if not (len(energies) and np.isfinite(energies).all()):
        return ""
    found = error or energy_error(energies, 0.0 if np.isnan(moving[0]) else moving[0])
    mean = float(moving.mean()) if np.isfinite(moving).all() else 0.0
    scale, largest = max(abs(float(energies[0])), mean), float(np.abs(energies - energies[0]).max())
    if not (scale > 0.0 and largest > ENERGY_LIMIT * scale):
        return ""
    relative = "" if found.relative_to == "absolute" else f" of the {found.relative_to}"
    return (
        f"the energy is off by {found.max_relative_error:.3g}{relative}, more than a tenth of the energy, "
        "so the trajectory is no good; take shorter steps or a smaller tolerance"
    )


def of_samples(total: ArrayLike, kinetic: ArrayLike) -> str:
    """`energy_doubt`, and "" for energies that have no error."""
    try:
        return energy_doubt(total, kinetic)
    except InputError:
        return ""


@unwarned
def digits_doubt(system: System, x: Floats) -> str:
    """Warning of positions x (3, n) that have fewer digits than the forces need; "" if they have enough."""
    if not (system.forces and len(system) and np.isfinite(x).all()):
        return ""
    rounding, needed = np.spacing(np.abs(x).max(axis=0)), lengths_needed(system, x)
    worst = int(np.argmax(rounding / needed))
    off = float((rounding / needed)[worst])
    if off <= DIGITS:
        return ""
    far = float(np.abs(x[:, worst]).max())
    return (
        f"{system.body(worst)} is at {far:.3g}, where neighbouring numbers are {rounding[worst]:.2g} apart; this is "
        f"{off:.2g} of the distances that the forces need, so the forces are wrong; shift the origin to the particles"
    )


def lengths_needed(system: System, x: Floats) -> Floats:
    """Length (n,) of which the forces on each particle need some digits: the box or a cutoff, in open space the
    distance of the nearest body that attracts. Infinite where no other particle matters, as in a field."""
    lengths = [float(force.cutoff) for force in system.forces if getattr(force, "cutoff", None)]
    if system.box.periodic:
        lengths.append(system.box.narrowest[1])
    if lengths:
        return np.full(len(system), min(lengths))
    massive = system.state.masses > 0.0
    if len(system) == 1 or not massive.any() or not any(getattr(force, "by_mass", False) for force in system.forces):
        return np.full(len(system), math.inf)
    softening = max((float(getattr(force, "softening", 0.0)) for force in system.forces), default=0.0)
    if len(system) > FEW:
        near = np.full(len(system), float(np.ptp(x, axis=1).max()) / len(system) ** (1.0 / 3.0))
    else:
        apart = np.linalg.norm(x[:, :, None] - x[:, None, massive], axis=0)
        near = np.where(apart > 0.0, apart, math.inf).min(axis=1)
    found = np.maximum(near, softening)
    return np.where(found > 0.0, found, math.inf)


def slowest_light(system: object) -> float:
    """Least speed of light of the forces that hold for speeds far below it; infinite without such forces."""
    if not isinstance(system, System):
        return math.inf
    found = [constant_of(force, "c", system) for force in system.forces]
    return min((c for c in found if c), default=math.inf)


@unwarned
def light_doubt(system: System, v: Floats) -> str:
    """Warning of velocities v (3, n) that reach the speed of light of a force; "" if all are below it."""
    light, own = slowest_light(system), v[:, : len(system)]  # spins, if there are any, follow
    speeds = np.sqrt(np.einsum("ki,ki->i", own, own))
    if light == math.inf or not speeds.max(initial=0.0) >= light:
        return ""
    fastest = int(np.argmax(speeds))
    names = [force.name for force in system.forces if constant_of(force, "c", system)]
    return (
        f"{system.body(fastest)} moves at {speeds[fastest] / light:.3g} times {LIGHT}, but {' and '.join(names)} "
        f"{'holds' if len(names) == 1 else 'hold'} only for speeds far below it"
    )


FAR = 1e11  # times the size of the system; farther out, rounding (2e-16 relative) hides a particle's origin
MOST = 10_000  # most particles in a search for the nearest pair


def explain(system: System, phase: Floats, before: Floats, good: Floats, step: int, time: float, good_step: int) -> str:
    """Describe in one line the step, the particle, its nearest neighbour and the last good frame.

    ``phase`` (2, 3, n) holds the last positions and velocities, ``good`` those of the last good frame. ``before``
    (3, n) holds the positions one step before ``phase``: since then, the particle has flown away from its neighbour.
    """
    finite = np.isfinite(phase).all(axis=(0, 1))
    if finite.all():
        speeds = np.linalg.norm(phase[1], axis=0)
        particle = int(np.argmax(speeds))
        speed = measured(f"{speeds[particle]:.3g}", system.units.symbol("velocity"))
        what = f"{system.body(particle)} moves at {speed}"
    else:
        particle = int(np.flatnonzero(~finite)[0])
        what = f"{system.body(particle)} has no finite position or velocity"
    if stretched := _out_of_range(system, phase, before):
        return f"blew up at step {step} (t = {time:.6g}): {stretched}; the last good frame is step {good_step}"
    known = finite.all() and np.abs(phase[0]).max() < FAR * np.abs(good[0]).max()
    here, when = (before, "the step before") if known else (good[0], f"at step {good_step}")
    distances = np.linalg.norm(system.box.minimum_image((here - here[:, [particle]]).T), axis=1)
    distances[particle] = np.inf
    neighbour = ""
    if len(distances) > 1:
        other = int(np.argmin(distances))
        apart = measured(f"{distances[other]:.4g}", system.units.symbol("length"))
        which = system.names[other] if system.names else system.state.ids[other]
        neighbour = f", its nearest neighbour was {which} at {apart} {when}"
    return f"blew up at step {step} (t = {time:.6g}): {what}{neighbour}; the last good frame is step {good_step}"


def _out_of_range(system: System, phase: Floats, before: Floats) -> str:
    """Describe a bond, angle or dihedral that has left the range of its law at the last finite positions."""
    x = next((x for x in (phase[0], before) if np.isfinite(x).all()), None)
    for force in system.forces:
        if x is not None and hasattr(force, "trouble") and (found := force.trouble(system, x)):
            return f"{force.name}: {found}"
    return ""


def nearest_pair(system: System, x: Floats) -> str:
    """Describe the nearest pair of particles at x (3, n), at least one of them with mass.

    The text is "" if there is no such pair, or too many particles to search."""
    massive = np.flatnonzero(system.state.masses)
    if not 2 <= len(system) <= MOST or not massive.size or not np.isfinite(x).all():
        return ""
    best, pair = np.inf, (0, 0)
    for i in massive:
        distances = np.linalg.norm(system.box.minimum_image((x - x[:, [i]]).T), axis=1)
        distances[i] = np.inf
        if distances.min() < best:
            best, pair = float(distances.min()), (int(i), int(np.argmin(distances)))
    first, second = (system.body(k) for k in sorted(pair))
    return f"; {first} and {second} are nearest, {measured(f'{best:.3g}', system.units.symbol('length'))} apart"
