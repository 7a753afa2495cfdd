"""Files of free particles in five unit systems, written without running anything."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy import constants

from kickdrift.model.box.box import Box
from kickdrift.model.state import State
from kickdrift.model.system import System
from kickdrift.trajectory.layout.options import FileOptions
from kickdrift.trajectory.write.h5md import Writer

METHOD = {"integrator": "velocity-verlet", "dt": 0.005}
EVERY, FRAMES, N = 20, 5, 12
ANGSTROM = {"si": 1e10, "gromacs": 10.0}  # angstroms per unit of length; 1 in all other units
PS = {"si": 1e12, "real": 1e-3}
ATOMIC = {"si": 1 / constants.atomic_mass}
UNITS = ("lj", "nbody", "astro", "metal", "real", "gromacs", "si")
REAL = UNITS[3:]  # with atoms


def make_system(units: str, n: int = N, spread: float = 20.0) -> System:
    """Particles of argon's size in real units; bodies with names in units of stars."""
    rng = np.random.default_rng(3)
    length, time = 1 / ANGSTROM.get(units, 1.0), 1 / PS.get(units, 1.0)
    stars = units in ("nbody", "astro")
    return System(
        rng.uniform(-spread, spread, (n, 3)) * length,
        rng.normal(size=(n, 3)) * length / time,
        masses=(np.arange(n) % 3 + 1.0) * 20 / ATOMIC.get(units, 1.0),
        box=None if stars else np.array([15.0, 16.0, 17.5]) * length,
        units=units,
        species=["Ar", "Kr", "Ar"] * (n // 3) if units in REAL else ["A", "Bb", "A"] * (n // 3),
        names=[f"body {k}" for k in range(n)] if stars else (),
    )


def states(system: System, steps=range(0, EVERY * FRAMES, EVERY)) -> list[State]:
    """States of free particles, at steps of 0.005 of the run's unit of time (or of a ps, in si)."""
    s, dt = system.state, 0.005 / PS.get(system.units.name, 1.0)
    return [
        State(np.array([s.phase[0] + s.phase[1] * k * dt, s.phase[1]]), s.masses, s.ids, s.box, k * dt, k)
        for k in steps
    ]


def write(
    path: Path, system: System, of: list[State] | None = None, absorbed: dict[int, int] | None = None, **options
) -> list[State]:
    """Write the states (default: those of `states`) with these FileOptions, and return them."""
    of = states(system) if of is None else of
    method = METHOD | {"dt": METHOD["dt"] / PS.get(system.units.name, 1.0)}
    with Writer(path, system, method=method, every=EVERY, overwrite=True, options=FileOptions(**options)) as writer:
        writer.absorbed = absorbed or {}
        for state in of:
            writer.append(state, {})
    return of


def without(state: State, particle: int) -> State:
    """The state without one body."""
    keep = np.arange(len(state)) != particle
    return State(state.phase[:, :, keep], state.masses[keep], state.ids[keep], state.box, state.time, state.steps_done)


def breathing(of: list[State]) -> list[State]:
    """The same states in boxes that grow and shrink, each axis by itself, and positions with them."""
    found = []
    for k, state in enumerate(of):
        factors = 1 + 0.02 * np.sin([k, 2.0 * k, 0.5 * k])
        box = Box(matrix=state.box.matrix * factors, periodic=state.box.periodic_axes)
        phase = np.array([state.phase[0] * factors[:, None], state.phase[1]])
        found.append(State(phase, state.masses, state.ids, box, state.time, state.steps_done))
    return found
