"""Particles on the device, and the forces that move them."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numba import config, cuda

from kickdrift.engines.cuda import gravity, pair_sum
from kickdrift.engines.cuda.cells import counting_of, grid_of, moving_of, scan_of, search_of
from kickdrift.engines.cuda.device import blocks, check_room, processors, zeros
from kickdrift.engines.cuda.law_code import grains, truncated_law
from kickdrift.engines.cuda.motion import MARKS, put_in_order
from kickdrift.engines.cuda.places import Places, places_of, room_for
from kickdrift.forces.laws.central import gravitational_constant
from kickdrift.model.state import Floats
from kickdrift.model.system import System

SKIN = 0.16  # of the cutoff
LANES = 1 if config.ENABLE_CUDASIM else 8  # threads of one particle
SCAN = 32 if config.ENABLE_CUDASIM else 1024  # threads of the scan
ROOM = 32  # neighbours at first


class Particles:
    """State on the device, in the order of the forces.

    Attributes
    ----------
    x, v, a : (3, n) positions, velocities and accelerations
    at : (3, n) positions at the last list
    ids : (n,) place of each particle in the caller's order
    weights : (n,) inverse masses, or G m
    placed : positions in the form that the forces read
    marks : see `motion`
    """

    def __init__(self, phase: Floats, weights: Floats, places: Places) -> None:
        self.n = phase.shape[2]
        self.x, self.v = (cuda.to_device(np.ascontiguousarray(rows)) for rows in phase)
        self.a, self.at = zeros((3, self.n), float), cuda.to_device(np.ascontiguousarray(phase[0]))
        self.ids = cuda.to_device(np.arange(self.n, dtype=np.int32))
        self.weights = cuda.to_device(np.ascontiguousarray(weights))
        self.placed = zeros(*room_for(places, self.n))
        self.marks = zeros(MARKS, float)

    def phase(self) -> Floats:
        """Copy of positions and velocities (2, 3, n), in the caller's order."""
        return np.array([self.in_order(self.x), self.in_order(self.v)])

    def in_order(self, rows: Any) -> Floats:
        """Copy of rows (m, n) in the caller's order."""
        ordered = cuda.device_array(rows.shape, np.float64)
        put_in_order[blocks(self.n)](self.ids, rows, ordered)
        return np.array(ordered.copy_to_host())


class DeviceForces(Protocol):
    """The forces of a System on the device."""

    places: Places
    half_skin: float  # the way that a particle may go before `prepare`; infinite without a list

    def upload(self, phase: Floats) -> Particles:
        """Particles of a phase (2, 3, n), prepared."""

    def prepare(self, particles: Particles) -> None:
        """Make the list of neighbours anew."""

    def evaluate(self, particles: Particles) -> None:
        """Write the accelerations."""

    def measure(self, particles: Particles) -> tuple[Floats, float, float]:
        """Accelerations (3, n) in the caller's order, energy and virial, in float64."""


class PairForces:
    """One pair law over lists of neighbours."""

    def __init__(self, system: System, single: bool, skin: float = SKIN, lanes: int = LANES) -> None:
        force: Any = system.forces[0]
        self._edges = np.where(system.box.periodic_axes, np.diag(system.box.matrix), 0.0)
        self._inverse_masses = 1.0 / system.coherent_masses
        kind, self._cutoff = system.species[0], float(force.cutoff)
        self._tail = force.tail_corrections(system)
        self._reach, self._lanes = (1.0 + skin) * self._cutoff, lanes
        self.half_skin = 0.499 * skin * self._cutoff
        self.places, self._exact = places_of(self._edges, single), places_of(self._edges, False)
        law = pair_sum.Law(truncated_law(force, kind, single), self._cutoff, *grains(force, kind))
        exact = law._replace(terms=truncated_law(force, kind, False)) if single else law
        self._forces = pair_sum.forces_of(law, self.places, lanes)
        self._measure = pair_sum.measure_of(exact, self._exact)
        self._scan, self._moving = scan_of(SCAN), moving_of(self.places)
        check_room(len(system), 700)

    def upload(self, phase: Floats) -> Particles:
        particles, n = Particles(phase, self._inverse_masses, self.places), phase.shape[2]
        self._grid = grid_of(self._edges, phase[0], self._reach)
        self._count, self._search = counting_of(self._grid), search_of(self._grid, self.places, self._reach)
        self._cells, self._numbers = (cuda.device_array(n, np.int32) for _ in range(2))
        self._homes = cuda.device_array(n, np.int32)
        self._sizes, self._starts = zeros(self._grid.size, np.int32), zeros(self._grid.size + 1, np.int32)
        self._near, self._found = cuda.device_array((n, ROOM), np.uint32), cuda.device_array(n, np.int32)
        self._spare = Particles(phase, self._inverse_masses, self.places)
        self.prepare(particles)
        return particles

    def prepare(self, particles: Particles) -> None:
        p, q, shape = particles, self._spare, blocks(particles.n)
        self._count[shape](p.x, self._cells, self._numbers, self._sizes)
        self._scan[1, SCAN](self._sizes, self._starts)
        self._moving[shape](
            self._cells, self._numbers, self._starts, p.x, p.v, p.a, p.ids, p.weights,
            q.x, q.v, q.a, q.ids, q.weights, p.at, p.placed, self._homes,
        )  # fmt: skip
        for name in ("x", "v", "a", "ids", "weights"):
            mine, other = getattr(p, name), getattr(q, name)
            setattr(p, name, other), setattr(q, name, mine)
        while True:
            most = zeros(1, np.int32)
            self._search[shape](p.placed, self._homes, self._starts, self._near, self._found, most)
            needed = int(most.copy_to_host()[0])
            if needed <= self._near.shape[1]:
                break
            self._near = cuda.device_array((p.n, 8 * -(-int(1.1 * needed) // 8)), np.uint32)
        p.marks.copy_to_device(np.zeros(MARKS))

    def stages(self, particles: Particles) -> list[tuple[str, Any]]:
        """Names and launches of the parts of a list, for timings."""
        p, shape, most = particles, blocks(particles.n), zeros(1, np.int32)
        sizes = zeros(self._grid.size, np.int32)
        return [
            ("count", lambda: self._count[shape](p.x, self._cells, self._numbers, sizes)),
            ("scan", lambda: self._scan[1, SCAN](zeros(self._grid.size, np.int32), cuda.device_array(self._grid.size + 1, np.int32))),
            ("search", lambda: self._search[shape](p.placed, self._homes, self._starts, self._near, self._found, most)),
        ]

    def evaluate(self, particles: Particles) -> None:
        p = particles
        self._forces[blocks(p.n * self._lanes)](p.placed, self._near, self._found, p.weights, p.a, p.marks)

    def measure(self, particles: Particles) -> tuple[Floats, float, float]:
        p = particles
        rows = cuda.device_array((5, p.n), np.float64)
        self._measure[blocks(p.n)](p.x, self._near, self._found, p.weights, p.ids, rows, p.marks)
        found = rows.copy_to_host()
        return found[:3], float(found[3].sum()) + self._tail[0], float(found[4].sum()) + self._tail[1]


class GravityForces:
    """Gravity of all pairs."""

    half_skin = np.inf

    def __init__(self, system: System, single: bool) -> None:
        force: Any = system.forces[0]
        self.places = places_of(np.zeros(3), False)
        self._masses = system.coherent_masses
        self._gm = gravitational_constant(force.name, force.G, system) * system.state.masses
        kernel = gravity.mixed_forces_of if single else gravity.forces_of
        self._forces, self._exact = kernel(force.softening), gravity.forces_of(force.softening)
        self._potential = gravity.potential_of(force.softening)
        check_room(len(system), 400)

    def upload(self, phase: Floats) -> Particles:
        particles = Particles(phase, self._gm, self.places)
        particles.at = particles.placed = particles.x
        self._partial = zeros((gravity.parts_of(particles.n, processors()), 3, particles.n), float)
        return particles

    def prepare(self, particles: Particles) -> None:
        """Nothing: there is no list."""

    def evaluate(self, particles: Particles) -> None:
        self._summed(self._forces, particles, particles.a)

    def _summed(self, forces: Any, particles: Particles, a: Any) -> None:
        columns, threads = blocks(particles.n, gravity.TILE * gravity.EACH)[0], gravity.TILE
        forces[(columns, self._partial.shape[0]), threads](particles.x, particles.weights, self._partial)
        gravity.add_parts[blocks(particles.n)](self._partial, a)

    def measure(self, particles: Particles) -> tuple[Floats, float, float]:
        n, a = particles.n, cuda.device_array((3, particles.n), np.float64)
        rows = cuda.device_array((2, n), np.float64)
        self._summed(self._exact, particles, a)
        self._potential[blocks(n)](particles.x, particles.weights, rows)
        energies, virials = rows.copy_to_host() @ self._masses
        return a.copy_to_host(), 0.5 * float(energies), 0.5 * float(virials)
