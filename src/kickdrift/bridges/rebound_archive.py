"""Simulationarchives of rebound with a snapshot for each frame of a run."""

from __future__ import annotations

import errno
import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from kickdrift.bridges.rebound import simulation_of
from kickdrift.bridges.rebound_reading import snapshots_in
from kickdrift.errors import InputError
from kickdrift.forces import Gravity
from kickdrift.model.box.box import Box
from kickdrift.model.state import Floats
from kickdrift.model.system import System


class Archive:
    """An archive in the making: ``append`` adds a snapshot.

    Attributes
    ----------
    notes : what the archive does not hold, or holds in another form
    """

    def __init__(self, path: Path, system: System) -> None:
        if not str(path).isascii():
            raise InputError(f"{path}: rebound takes file names in ASCII alone")
        self.path, self.count = str(path), 0
        gravity = [force for force in system.forces if isinstance(force, Gravity)]
        self.notes = [f"force {force.name!r} is left out" for force in system.forces if not isinstance(force, Gravity)]
        if system.box.periodic:
            self.notes.append("the box is left out")
        self.system = system.remade(forces=gravity, box=Box(None), equilibration=None, topology=None, events=())
        self.notes += [f"event {event.kind!r} is left out" for event in system.events]
        self._there: tuple[int, ...] | None = None
        self._sim: Any = None

    def append(self, x: Floats, v: Floats, masses: Floats, time: float, step: int) -> None:
        """Write the bodies of a frame: positions and velocities (n, 3), nan where a body is gone, and masses (n,)."""
        there = np.flatnonzero(np.isfinite(x[:, 0]))
        if (rows := tuple(there.tolist())) != self._there:
            self._sim, self._there = self._made(rows), rows
        x, v, m = (np.ascontiguousarray(each[there]) for each in (x, v, masses))
        self._sim.set_serialized_particle_data(xyz=x, vxvyvz=v, m=m)
        self._sim.t, self._sim.steps_done = time, step
        self._sim.save_to_file(self.path)
        self.count += 1

    def _made(self, rows: Iterable[int]) -> Any:
        """A Simulation of some bodies, with G, units, method and step."""
        system, chosen = self.system, list(rows)
        kept = system.remade(
            positions=system.state.positions[chosen],
            velocities=system.state.velocities[chosen],
            masses=system.state.masses[chosen],
            species=[system.species[system.species_index[k]] for k in chosen],
            names=[system.names[k] for k in chosen] if system.names else (),
            radii=None if system.radii is None else system.radii[chosen],
            ids=system.state.ids[chosen],
        )
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            sim = simulation_of(kept)
        lost = [str(each.message).rpartition(": ")[2] + " is left out" for each in said]
        self.notes += [note for note in lost if note not in self.notes]
        return sim

    def check(self) -> None:
        """Read the archive back. Raises OSError if snapshots are missing: rebound does not tell of a full disk."""
        try:
            found = snapshots_in(Path(self.path))
        except InputError:
            found = 0
        if found != self.count:
            raise OSError(errno.ENOSPC, f"{found} of {self.count} snapshots were written")
