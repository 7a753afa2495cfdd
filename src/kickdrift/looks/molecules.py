"""Temperatures of the translation, the rotation and the vibration of molecules, and how well constraints are kept.

The velocities of a molecule are a translation, a rotation as of a rigid body at its present shape, and the rest, its
vibration. These parts have 3, 3 (2 on a line) and all other degrees of freedom. In equilibrium each degree has the same
mean energy, in rigid, in partly rigid and in flexible molecules.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from kickdrift.looks.columns import Column
from kickdrift.model.freedom import BARELY, TURN, apart_of, free_masses, freedom_of, whole_motion
from kickdrift.model.molecules.constraints import in_one_image
from kickdrift.model.molecules.relatives import molecules_of
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.model.system import System

ERROR = "constraint_error"
KINDS = ("translation", "rotation", "vibration")
TEMPERATURES = tuple(f"{kind}_temperature" for kind in KINDS)


class Freedoms(NamedTuple):
    """Degrees of freedom of all molecules together."""

    translation: int
    rotation: int
    vibration: int


class Molecules:
    """Molecules of a System with constraints: particles that bonds or constraints join.

    Attributes
    ----------
    freedoms : degrees of freedom of each kind of motion; None where all particles together turn as a whole, which has
        no such parts
    """

    def __init__(self, system: System, drags: bool = False) -> None:
        held = system.constraints
        assert held is not None
        pairs = held.pairs if system.topology is None else np.concatenate([held.pairs, system.topology.bonds])
        self._system, self._held, self._pairs = system, held, pairs
        self._moving = np.flatnonzero(free_masses(system))  # the others have no heat
        self._of = np.unique(molecules_of(pairs, len(system))[self._moving], return_inverse=True)[1].reshape(-1)
        self._masses, self._apart = system.coherent_masses[self._moving], apart_of(system, drags)
        self._mass = np.bincount(self._of, self._masses)
        d, count = system.dimensions, np.bincount(self._of)
        x = self._whole(system.state.phase[0])
        moments = np.linalg.eigvalsh(self._inertia(x - self._centres(x)[:, self._of]))
        turns = (moments > 1e-9 * np.maximum(moments[:, -1:], 1e-300)).sum(axis=1)
        turns = np.where(count > 1, 1 if d == 2 else turns, 0)
        translation = d * len(count) - d * (self._apart != 0)
        rotation = int(turns.sum())
        left = freedom_of(system, drags) - translation - rotation
        self.freedoms = None if self._apart == TURN else Freedoms(translation, rotation, left)

    def _whole(self, x: Floats) -> Floats:
        """Positions of the moving particles, each molecule in one image, from those (3, n) of all."""
        return in_one_image(self._system.box, self._pairs, x).take(self._moving, axis=1)

    def _centres(self, values: Floats) -> Floats:
        return np.array([np.bincount(self._of, self._masses * row) for row in values]) / self._mass

    def _inertia(self, arm: Floats) -> Floats:
        """Tensors of inertia (molecules, 3, 3) about the centres."""
        m, of = self._masses, self._of
        second = np.array([[np.bincount(of, m * arm[a] * arm[b]) for b in range(3)] for a in range(3)])
        trace = second[0, 0] + second[1, 1] + second[2, 2]
        return np.asarray((np.eye(3)[:, :, None] * trace - second).transpose(2, 0, 1))

    def temperatures(self, phase: Floats) -> Floats:
        """Temperatures (3,) of translation, rotation and vibration at a phase (2, 3, n); nan without freedom."""
        if self.freedoms is None:
            return np.full(3, np.nan)
        freedoms = np.array([each if each > 0 else np.nan for each in self.freedoms])
        return 2.0 * self.heats(phase) / (freedoms * self._system.units.boltzmann)

    def heats(self, phase: Floats) -> Floats:
        """Kinetic energies (3,) of translation, rotation and vibration at a phase (2, 3, n), without the motion of all
        particles together that is no heat."""
        x, v = self._whole(phase[0]), phase[1].take(self._moving, axis=1)
        if (moved := whole_motion(self._masses, x, v, self._apart)) is not None:
            v = v - moved
        centres = self._centres(v)
        arm, own = x - self._centres(x)[:, self._of], v - centres[:, self._of]
        inertia = self._inertia(arm)
        spin = np.array([np.bincount(self._of, self._masses * row) for row in np.cross(arm, own, axis=0)]).T
        small = BARELY * np.trace(inertia, axis1=1, axis2=2) + 1e-300
        rate = np.linalg.solve(inertia + small[:, None, None] * np.eye(3), spin[:, :, None])[:, :, 0]
        moving = float(self._mass @ (centres**2).sum(axis=0))
        turning = float((spin * rate).sum())
        shaking = float(self._masses @ (own**2).sum(axis=0)) - turning
        return 0.5 * np.array([moving, turning, shaking])

    def error(self, phase: Floats) -> float:
        """Largest relative error of a constrained distance at a phase (2, 3, n)."""
        x = in_one_image(self._system.box, self._held.pairs, phase[0])
        return float(np.abs(self._held.errors(x)).max())


def _temperature(molecules: Molecules, kind: int, sim: Any) -> float:
    return float(molecules.temperatures(sim.state.phase)[kind])


def molecule_columns(system: Any, drags: bool) -> list[Column]:
    """Columns of the samples of a run with constraints; none without constraints."""
    if getattr(system, "constraints", None) is None:
        return []
    molecules = Molecules(system, drags)
    columns = [Column(ERROR, "", (), lambda sim: molecules.error(sim.state.phase))]
    for k, name in enumerate(TEMPERATURES):
        if molecules.freedoms is not None and molecules.freedoms[k] > 0:
            columns.append(Column(name, "temperature", (), partial(_temperature, molecules, k)))
    return columns
