"""Speed in boxes of odd shapes and densities beside a plain neighbour list.

    python -m docs.studies.odd_shapes [--turns 7] [--only NAME …]

The plain program is one compiled loop of velocity-verlet in numba: a list of neighbours within the cutoff plus a skin,
each pair once, from cells where the box has three or more along each axis. Each entry keeps its shift to the nearest
image. The list is made anew when two particles may have moved by the skin. The better of two skins counts. kickdrift
and the plain program begin with the same state, take turns in one process, and are timed in processor time. The
energies after the first hundred steps must agree.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from time import process_time
from typing import Any, NamedTuple

import numpy as np
from numba import njit

import kickdrift as kd
from kickdrift.model.starts.builders import lattice, maxwell_boltzmann
from kickdrift_validation.claim import Claim, claim, show, where

LEAST = 0.9  # share of the plain program's speed
SKINS = 0.3, 0.6
ROOM = 200  # neighbours of a particle
DT = 0.002


@njit(fastmath=True)
def nearest(matrix, d, shift):
    """shift <- the edges that bring the separation d to its nearest image; ``matrix`` has zeros without a box."""
    shift[:] = 0.0
    for k in (2, 1, 0):
        if matrix[k, k] > 0.0:
            count = np.round((d[k] + shift[k]) / matrix[k, k])
            for axis in range(k + 1):
                shift[axis] -= count * matrix[k, axis]


@njit(fastmath=True)
def candidates(x, matrix, reach, cells, head, following):
    """Sort particles into cells; return the number of cells along each axis, or zeros where cells do not pay."""
    n = x.shape[0]
    fractions = np.empty((n, 3))
    for axis in range(3):
        if matrix[axis, axis] <= 0.0:
            cells[:] = 0
            return
    room = 1.25 * reach  # the leaning box is a fifth lower than its edges say
    many = matrix[0, 0] * matrix[1, 1] * matrix[2, 2] / room**3
    fewer = max(1.0, (many / (8.0 * n)) ** (1.0 / 3.0))
    for axis in range(3):
        cells[axis] = int(matrix[axis, axis] / (fewer * room))
        if cells[axis] < 3:
            cells[:] = 0
            return
    for i in range(n):
        rest = x[i].copy()
        for k in (2, 1, 0):
            fractions[i, k] = rest[k] / matrix[k, k]
            for axis in range(k + 1):
                rest[axis] -= fractions[i, k] * matrix[k, axis]
    head[:] = -1
    for i in range(n):
        c = 0
        for k in range(3):
            f = fractions[i, k] - np.floor(fractions[i, k])
            c = c * cells[k] + min(cells[k] - 1, int(f * cells[k]))
        following[i] = head[c]
        head[c] = i


@njit(fastmath=True)
def add(x, matrix, reach2, i, j, d, shift, count, near, shifts):
    for axis in range(3):
        d[axis] = x[i, axis] - x[j, axis]
    nearest(matrix, d, shift)
    r2 = 0.0
    for axis in range(3):
        r2 += (d[axis] + shift[axis]) ** 2
    if r2 < reach2:
        near[i, count[i]] = j
        for axis in range(3):
            shifts[i, count[i], axis] = shift[axis]
        count[i] += 1


@njit(fastmath=True)
def make_list(x, matrix, reach, count, near, shifts):
    n = x.shape[0]
    cells, following = np.zeros(3, np.int64), np.empty(n, np.int64)
    head = np.empty(max(27, int(8.5 * n) + 64), np.int64)
    candidates(x, matrix, reach, cells, head, following)
    d, shift = np.empty(3), np.empty(3)
    count[:] = 0
    if cells[0] == 0:
        for i in range(n):
            for j in range(i + 1, n):
                add(x, matrix, reach * reach, i, j, d, shift, count, near, shifts)
        return
    nx, ny, nz = cells
    for c in range(nx * ny * nz):
        cx, cy, cz = c // (ny * nz), c // nz % ny, c % nz
        for step in range(14):  # half of the neighbours, and the cell itself
            ox, oy, oz = (step + 13) // 9 - 1, (step + 13) // 3 % 3 - 1, (step + 13) % 3 - 1
            other = ((cx + ox) % nx * ny + (cy + oy) % ny) * nz + (cz + oz) % nz
            i = head[c]
            while i >= 0:
                j = following[i] if step == 0 else head[other]
                while j >= 0:
                    add(x, matrix, reach * reach, i, j, d, shift, count, near, shifts)
                    j = following[j]
                i = following[i]


@njit(fastmath=True)
def forces(x, a, cutoff2, table, species, count, near, shifts):
    """a <- the accelerations of unit masses; return the energy."""
    a[:] = 0.0
    energy = 0.0
    for i in range(x.shape[0]):
        xi, yi, zi, ax, ay, az, own = x[i, 0], x[i, 1], x[i, 2], 0.0, 0.0, 0.0, species[i]
        for k in range(count[i]):
            j = near[i, k]
            dx, dy, dz = xi - x[j, 0] + shifts[i, k, 0], yi - x[j, 1] + shifts[i, k, 1], zi - x[j, 2] + shifts[i, k, 2]
            r2 = dx * dx + dy * dy + dz * dz
            if r2 < cutoff2:
                inverse6 = table[own, species[j], 1] / (r2 * r2 * r2)
                well = 4.0 * table[own, species[j], 0]
                energy += well * (inverse6 * inverse6 - inverse6)
                g = well * (12.0 * inverse6 * inverse6 - 6.0 * inverse6) / r2
                ax, ay, az = ax + g * dx, ay + g * dy, az + g * dz
                a[j, 0] -= g * dx
                a[j, 1] -= g * dy
                a[j, 2] -= g * dz
        a[i, 0] += ax
        a[i, 1] += ay
        a[i, 2] += az
    return energy


@njit(fastmath=True)
def plain_steps(x, v, a, made_at, matrix, cutoff, skin, table, species, count, near, shifts, dt, steps, fresh):
    """Take steps; return the potential energy."""
    energy = 0.0
    for step in range(steps + int(fresh)):
        if not (fresh and step == 0):
            v += 0.5 * dt * a
            x += dt * v
        largest = 0.0
        for i in range(x.shape[0]):
            moved2 = 0.0
            for axis in range(3):
                moved2 += (x[i, axis] - made_at[i, axis]) ** 2
            largest = max(largest, moved2)
        if (fresh and step == 0) or 4.0 * largest > skin * skin:
            make_list(x, matrix, cutoff + skin, count, near, shifts)
            made_at[:] = x
        energy = forces(x, a, cutoff * cutoff, table, species, count, near, shifts)
        if not (fresh and step == 0):
            v += 0.5 * dt * a
    return energy


class Plain:
    """The plain program, from the state of a System with one cut Lennard-Jones force."""

    def __init__(self, system: kd.System, skin: float) -> None:
        n, (force,), names = len(system), system.forces, system.species
        self.x, self.v = system.state.positions.copy(), system.state.velocities.copy()
        self.a, self.made_at = np.zeros((2, n, 3))
        self.count, self.near, self.shifts = (
            np.zeros(n, np.int64), np.zeros((n, ROOM), np.int32), np.zeros((n, ROOM, 3)),
        )  # fmt: skip
        table = np.array(
            [[(law.epsilon, law.sigma**6) for law in (force.pair_law(a, b) for b in names)] for a in names]
        )
        periodic = np.array(system.box.periodic_axes)[:, None]
        self.given = system.box.matrix * periodic, force.cutoff, skin, table, system.species_index.astype(np.int64)
        self.fresh = True

    def advance(self, steps: int) -> float:
        """Take steps; return the potential energy after these."""
        parts = self.x, self.v, self.a, self.made_at, *self.given, self.count, self.near, self.shifts
        energy = plain_steps(*parts, DT, steps, self.fresh)
        self.fresh = False
        return float(energy)


def system_of(x: Any, box: Any, cutoff: float = 2.5, **more: Any) -> kd.System:
    v = maxwell_boltzmann(np.ones(len(x)), 1.0, 1.0, 1)
    force = kd.LennardJones(cutoff=cutoff, truncation="cut", **more.pop("force", {}))
    return kd.System(x, v, box=box, forces=[force], units="lj", **more)


def gas() -> kd.System:
    return system_of(*lattice("sc", 4096, 4096 / 1e12))


def drop() -> kd.System:
    x, _ = lattice("fcc", 500, 0.85)
    return system_of(x + 100.0, (400.0,) * 3)


def slab() -> kd.System:
    x, (edge, *_) = lattice("fcc", 4000, 0.85)
    return system_of(x, (edge, edge, 20.0 * edge))


def leaning() -> kd.System:
    x, (edge, *_) = lattice("fcc", 4000, 0.85)
    matrix = edge * np.array([[1.0, 0.0, 0.0], [0.5, 1.0, 0.0], [0.25, -0.5, 1.0]])
    return system_of(x / edge @ matrix, matrix)


def smallest() -> kd.System:
    x, (edge, *_) = lattice("fcc", 108, 108 / 5.001**3)
    return system_of(x, (edge,) * 3)


def one_of_a_species() -> kd.System:
    x, box = lattice("fcc", 4000, 0.85)
    pair = {"A": {"epsilon": 1.0, "sigma": 1.0}, "B": {"epsilon": 0.5, "sigma": 0.9}}
    return system_of(x, box, species=["B", *["A"] * 3999], force={"species": pair})


def short() -> kd.System:
    x, box = lattice("fcc", 4000, 0.85)
    return system_of(x, box, cutoff=1.0001)


class Shape(NamedTuple):
    """A system and the steps of a turn."""

    text: str
    make: Callable[[], kd.System]
    steps: int


SHAPES = {
    "gas": Shape("4096 particles in a box of 10,000 diameters", gas, 4000),
    "drop": Shape("500 particles in one corner of a box of 400 diameters", drop, 2000),
    "slab": Shape("4000 particles in a twentieth of a box, vacuum in the rest", slab, 300),
    "leaning": Shape("4000 particles in a leaning box", leaning, 300),
    "smallest": Shape("108 particles in a box of twice the cutoff", smallest, 5000),
    "one": Shape("4000 particles, one of them of another species", one_of_a_species, 300),
    "short": Shape("4000 particles with a cutoff of 1.0001 diameters", short, 1000),
}


def seconds(advance: Callable[[int], Any], steps: int) -> float:
    began = process_time()
    advance(steps)
    return process_time() - began


def claim_of(shape: Shape, turns: int) -> Claim:
    """Speed of kickdrift over that of the plain program with its better skin."""
    system = shape.make()
    sim, plain = kd.Simulation(system, "velocity-verlet", DT), [Plain(system, skin) for skin in SKINS]
    sim.advance(100)
    energies = [sim.energy().potential, *(each.advance(100) for each in plain)]
    np.testing.assert_allclose(energies, energies[0], rtol=1e-6, atol=1e-9)
    ratios = []
    for _ in range(turns):
        ours = seconds(sim.advance, shape.steps)
        ratios.append(min(seconds(each.advance, shape.steps) for each in plain) / ours)
    low, ratio, high = np.quantile(ratios, [0.25, 0.5, 0.75]).tolist()
    print(f"  {shape.text}: {shape.steps / ours:.4g} steps/s, ratio {low:.3g} to {high:.3g}", flush=True)
    text = f"speed over a plain neighbour list: {shape.text}"
    return claim(text, ratio, f"at least {LEAST}", ratio >= LEAST, "a plain list, in turns")


def main() -> int:
    """Measure and print. The exit status is 1 where a bound is missed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--turns", type=int, default=7)
    parser.add_argument("--only", nargs="+", choices=list(SHAPES), default=list(SHAPES))
    given = parser.parse_args()
    print(where("numpy"), flush=True)
    return show([claim_of(SHAPES[name], given.turns) for name in given.only])


if __name__ == "__main__":
    sys.exit(main())
