"""The forces of a System on the device: one pair law over lists of neighbours, or gravity of all pairs."""

from __future__ import annotations

import math
from typing import Any, Protocol

import numpy as np
from numba import config, cuda

from kickdrift.engines.cuda import cells, gravity, pair_sum
from kickdrift.engines.cuda.device import check_room, processors
from kickdrift.engines.cuda.launches import Launches, zeros
from kickdrift.engines.cuda.law_code import Code, grains, truncated_law
from kickdrift.engines.cuda.motion import MOST, placing_of
from kickdrift.engines.cuda.particles import Particles
from kickdrift.engines.cuda.places import WRITE_NOTHING, places_of, room_for
from kickdrift.engines.cuda.search import list_shape, room_of, search_of
from kickdrift.errors import InputError
from kickdrift.forces.laws.central import gravitational_constant
from kickdrift.model.state import Floats
from kickdrift.model.system import System

LEAST_ROOM = 32  # neighbours
STATE_BYTES = 330  # of a particle, with a bath and without neighbours
LARGEST = 2**31 - 1  # particles: their numbers have 32 bits


def lanes_for(n: int) -> int:
    """Threads of one particle: few particles need many threads to keep the device busy."""
    if config.ENABLE_CUDASIM:
        return 1
    return 16 if n < 50_000 else 4 if n < 300_000 else 2


def skin_for(n: int) -> float:
    """Skin of a list in parts of the cutoff: few particles keep a list for longer, because making one takes as long as
    many steps."""
    return 0.3 if n < 300_000 else 0.2


class DeviceForces(Protocol):
    """What moves particles on the device."""

    write: Code  # writes a place, see `Places`
    half_skin: float  # the way that a particle may go before `prepare`; infinite without a list

    def upload(self, phase: Floats) -> Particles:
        """Particles of a phase (2, 3, n), prepared."""

    def prepare(self, particles: Particles) -> None:
        """Make the list of neighbours anew, and set all marks to zero. The spare copy then is the state."""

    def fits(self, particles: Particles, marks: Floats) -> bool:
        """Tell whether the list had room for all neighbours. If not, make room for another list."""

    def evaluate(self, particles: Particles) -> None:
        """Write the accelerations."""

    def measure(self, particles: Particles) -> tuple[Floats, float, float]:
        """Accelerations (3, n) in the caller's order, energy and virial, in float64."""


class PairForces:
    """One pair law over lists of neighbours. ``skin`` is in parts of the cutoff, and ``lanes`` threads share a
    particle; 0: by the number of particles."""

    def __init__(self, system: System, launches: Launches, single: bool, skin: float = 0.0, lanes: int = 0) -> None:
        force: Any = system.forces[0]
        cutoff, mixture = float(force.cutoff), len(system.species) > 1
        skin = skin or skin_for(len(system))
        self._launches, self._reach = launches, (1.0 + skin) * cutoff
        self._lanes = lanes or lanes_for(len(system))
        self.half_skin = 0.499 * skin * cutoff
        self._edges = np.where(system.box.periodic_axes, np.diag(system.box.matrix), 0.0)
        self._inverse_masses = 1.0 / system.coherent_masses
        self._tail = force.tail_corrections(system)
        self._places, self._exact = (places_of(self._edges, each, mixture) for each in (single, False))
        self.write = self._places.write
        self._kinds = cuda.to_device(system.species_index.astype(np.int32)) if mixture else None
        terms, table = truncated_law(force, system.species, single)
        law = pair_sum.Law(terms, len(system.species), cutoff, *grains(force, system.species))
        self._forces = pair_sum.forces_of(law, self._places, self._lanes)
        terms, exact_table = truncated_law(force, system.species, False)
        self._measure = pair_sum.measure_of(law._replace(terms=terms), self._exact, self._lanes)
        self._table, self._exact_table = cuda.to_device(table), cuda.to_device(exact_table)
        self._moving = cells.moving_of(self.write)

    def upload(self, phase: Floats) -> Particles:
        n, launches = phase.shape[2], self._launches
        room = self._room(phase[0])
        if n > LARGEST:
            raise InputError(f"engine 'cuda': at most {LARGEST:,} particles, got {n:,}")
        check_room(n, STATE_BYTES + 4 * room)
        particles = Particles(launches, phase, self._inverse_masses)
        particles.at, particles.placed = zeros((3, n), float), zeros(*room_for(self._places, n))
        self._grid = cells.grid_of(self._edges, phase[0], self._reach)
        self._count = cells.counting_of(self._grid)
        self._search = search_of(self._grid, self._places, self._reach, self._lanes)
        self._cells, self._numbers, self._homes, self.found = (cuda.device_array(n, np.int32) for _ in range(4))
        self._sizes, self._starts = zeros(self._grid.size, np.int32), zeros(self._grid.size + 1, np.int32)
        self._sums = zeros(-(-self._grid.size // cells.CHUNK), np.int32)
        self._near = cuda.device_array(list_shape(n, room, self._lanes), np.uint32)
        self.prepare(particles)
        while not self.fits(particles, launches.read(particles.marks)):
            self.prepare(particles)
        return particles

    def _room(self, x: Floats) -> int:
        """Neighbours of a particle at even density, and a third more."""
        lengths = np.where(self._edges > 0, self._edges, np.maximum(np.ptp(x, axis=1), self._reach))
        even = x.shape[1] / lengths.prod() * 4.0 / 3.0 * math.pi * self._reach**3
        return 8 * math.ceil(min(max(LEAST_ROOM, 1.33 * even), x.shape[1]) / 8)

    def prepare(self, particles: Particles) -> None:
        self._launches.repeat("list", lambda: self.listed(particles))

    def fits(self, particles: Particles, marks: Floats) -> bool:
        if marks[MOST] <= room_of(self._near, self._lanes):
            return True
        self._launches.forget()
        room = math.ceil(1.1 * marks[MOST])
        check_room(particles.n, 4 * room)
        self._near = cuda.device_array(list_shape(particles.n, room, self._lanes), np.uint32)
        return False

    def listed(self, particles: Particles) -> None:
        """Sort the particles, and search their neighbours."""
        p, over = particles, self._launches.over
        over(p.n, self._count, p.x, self._cells, self._numbers, self._sizes)
        over(self._sums.size, cells.add_chunks, self._sizes, self._sums)
        self._launches.grid(1, cells.SCAN, cells.scan, self._sums, p.marks)
        over(self._sums.size, cells.start_cells, self._sizes, self._sums, self._starts)
        found = self._homes, p.at, p.placed
        over(p.n, self._moving, self._cells, self._numbers, self._starts, *p.arrays, *p.spare.arrays, *found)
        p.settle()
        self._name_species(p, p.placed)
        self.search(p)

    def _name_species(self, particles: Particles, placed: Any) -> None:
        """Write the numbers of the species of a mixture to places."""
        if self._kinds is not None:
            self._launches.over(particles.n, cells.write_kinds, particles.ids, self._kinds, placed)

    def search(self, particles: Particles) -> None:
        """Write the neighbours of particles in the order of the cells."""
        lists = self._homes, self._starts, self._near, self.found, particles.marks
        self._launches.over(particles.n, self._search, particles.placed, *lists)

    def evaluate(self, particles: Particles) -> None:
        p = particles
        lists = p.placed, self._near, self.found
        self._launches.over(p.n * self._lanes, self._forces, *lists, p.weights, self._table, p.a, p.marks)

    def measure(self, particles: Particles) -> tuple[Floats, float, float]:
        p, rows, placed = particles, cuda.device_array((5, particles.n), np.float64), particles.placed
        if self._places.single:
            placed = cuda.device_array(*room_for(self._exact, p.n))
            self._launches.over(p.n, placing_of(self._exact.write), p.x, placed)
            self._name_species(p, placed)
        lists = placed, self._near, self.found
        self._launches.over(p.n, self._measure, *lists, p.weights, self._exact_table, p.ids, rows, p.marks)
        found = self._launches.read(rows)
        return found[:3], float(found[3].sum()) + self._tail[0], float(found[4].sum()) + self._tail[1]


class GravityForces:
    """Gravity of all pairs."""

    half_skin = math.inf

    def __init__(self, system: System, launches: Launches, single: bool) -> None:
        force: Any = system.forces[0]
        self._launches, self.write = launches, WRITE_NOTHING
        self._masses = system.coherent_masses
        self._gm = gravitational_constant(force.name, force.G, system) * system.state.masses
        self._exact = gravity.forces_of(force.softening)
        self._forces = gravity.mixed_forces_of(force.softening) if single else self._exact
        self._potential = gravity.potential_of(force.softening)

    def upload(self, phase: Floats) -> Particles:
        n = phase.shape[2]
        parts = gravity.parts_of(n, processors())
        check_room(n, STATE_BYTES + 24 * parts)
        self._partial = zeros((parts, 3, n), float)
        return Particles(self._launches, phase, self._gm)

    def prepare(self, particles: Particles) -> None:
        particles.keep()

    def fits(self, particles: Particles, marks: Floats) -> bool:
        return True

    def evaluate(self, particles: Particles) -> None:
        self._summed(self._forces, particles, particles.a)

    def _summed(self, forces: Any, particles: Particles, a: Any) -> None:
        p, columns = particles, -(-particles.n // (gravity.TILE * gravity.EACH))
        self._launches.grid((columns, self._partial.shape[0]), gravity.TILE, forces, p.x, p.weights, self._partial)
        self._launches.over(p.n, gravity.add_parts, self._partial, a)

    def measure(self, particles: Particles) -> tuple[Floats, float, float]:
        n = particles.n
        a, rows = cuda.device_array((3, n), np.float64), cuda.device_array((2, n), np.float64)
        self._summed(self._exact, particles, a)
        self._launches.over(n, self._potential, particles.x, particles.weights, rows)
        energies, virials = self._launches.read(rows) @ self._masses
        return self._launches.read(a), 0.5 * float(energies), 0.5 * float(virials)
