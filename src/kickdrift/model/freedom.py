"""Heat and the motion of the whole: which motions of all particles together are no heat, and the degrees of freedom.

This is the one place that counts degrees of freedom. A total momentum that the run conserves belongs to no bath. Heat
is the kinetic energy in the frame of the centre of mass, and has d degrees of freedom less in d dimensions. A cluster
in open space also conserves its angular momentum. Heat is then without rigid rotation too (Jellinek & Li 1989,
doi:10.1103/PhysRevLett.62.241). Each constraint takes one degree of freedom. Fixed particles have no heat and no
degrees of freedom. Everything else is heat where the method drags, which means that it draws velocities anew as
``baoab`` does, where a field acts, and beside fixed particles. A field that accelerates all particles alike leaves
relative motion alone.
"""

from typing import Protocol

import numpy as np

from kickdrift.model.state import Floats
from kickdrift.model.subject import Subject

NONE, DRIFT, TURN = 0, 1, 2  # motion apart from heat: none, of the centre of mass, and also of rigid rotation
BARELY = 4.0 * np.finfo(float).eps  # of the trace of the inertia: keeps bodies on one line from dividing by zero


class Acting(Subject, Protocol):
    """Particles with forces of known traits; see ``System``."""

    def acting(self, trait: str) -> list[str]:
        """Names of the forces that have a trait."""


def disturbing(system: Acting) -> list[str]:
    """Names of the forces that change the total momentum, without those that accelerate all particles alike."""
    return [name for name in system.acting("external") if name not in system.acting("alike")]


def apart_of(system: Acting, drags: bool = False) -> int:
    """The motion that is no heat under a method: NONE, DRIFT or TURN. ``drags`` tells whether the method changes the
    total momentum."""
    if drags or disturbing(system):
        return NONE
    return DRIFT if any(system.box.periodic_axes) else TURN


def freedom_of(system: Acting, drags: bool = False) -> int:
    """Degrees of freedom of the heat; fixed particles and those without mass have none."""
    moving, d, apart = int(np.count_nonzero(free_masses(system))), system.dimensions, apart_of(system, drags)
    turns = 0
    if apart == TURN and moving > 1:
        turns = 1 if d == 2 else min(moving, 3)  # two bodies do not turn about their line
    return max(d * (moving - (apart != NONE)) - turns - len(system.constraints or ()), 0)


def free_masses(system: Subject) -> Floats:
    """Masses (n,) that carry heat, in the unit of ``coherent_masses``: those of fixed particles are zero."""
    return system.coherent_masses if system.fixed is None else system.fixed.free(system.coherent_masses)


def fixed_heat(system: Subject) -> float:
    """Kinetic energy of fixed particles that move, which is no heat."""
    return 0.0 if system.fixed is None else system.fixed.heat(system.coherent_masses)


def whole_motion(masses: Floats, x: Floats, v: Floats, apart: int) -> Floats | None:
    """Velocities (3, n) that particles at x (3, n) would have if they moved as one rigid body with the momentum, and
    for TURN the angular momentum, of v. None if its energy is beyond the rounding of the kinetic energy."""
    total = masses.sum()
    if apart == NONE or not total:
        return None
    drift = v @ masses / total
    kinetic, energy = 0.5 * float(masses @ (v * v).sum(axis=0)), 0.5 * total * float(drift @ drift)
    moved = np.repeat(drift[:, None], v.shape[1], axis=1)
    if apart == TURN:
        arm, inertia = inertia_of(masses, x)
        spin = (masses * np.cross(arm, v - moved, axis=0)).sum(axis=1)
        if (trace := float(np.trace(inertia))) > 0:
            rate = np.linalg.solve(inertia + BARELY * trace * np.eye(3), spin)
            energy += 0.5 * float(rate @ spin)
            moved += np.cross(rate, arm, axisa=0, axisb=0, axisc=0)
    return None if kinetic - energy == kinetic else moved


def turning(masses: Floats, x: Floats) -> Floats:
    """Degrees of freedom (3, n) that rigid rotation takes from each velocity component of particles at x (3, n)."""
    arm, inertia = inertia_of(masses, x)
    moments, axes = np.linalg.eigh(inertia)
    found = np.zeros_like(arm)
    for size, axis in zip(moments, axes.T, strict=True):
        if size > BARELY * moments[-1]:
            found += masses * np.cross(axis, arm, axisb=0, axisc=0) ** 2 / size
    return found


def inertia_of(masses: Floats, x: Floats) -> tuple[Floats, Floats]:
    """Positions (3, n) from the centre of mass, and the tensor of inertia (3, 3) about it."""
    arm = x - (x @ masses / masses.sum())[:, None]
    inertia = np.eye(3) * (masses @ (arm * arm).sum(axis=0)) - np.einsum("i,ki,li->kl", masses, arm, arm)
    return arm, inertia
