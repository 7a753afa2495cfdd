"""The compiled loop of leapfrog-exact: integer kicks and drifts, and the pair list that it searches by itself.

All floating-point here is strict, operation by operation, so that an increment has the same bits wherever its pair
stands in a list. Positions wrap around at 2^64, the box edge: the difference of two is that of the nearest images.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import overload
from numpy.typing import NDArray

from kickdrift.forces.compiling import driver, strict
from kickdrift.forces.evaluate import EVALUATIONS
from kickdrift.forces.kernel import BLOWN_UP, GROW, OK
from kickdrift.forces.truncation import AtCutoff
from kickdrift.integrators.loops import FRESH, STAGE, STEP
from kickdrift.integrators.stepping import STOPPED

# What one pair's half kick may be at most. Momenta reach to 2^62, so it takes 32 such partners at once for a sum to
# wrap around unseen; a start's largest momentum is 2^54 to 2^55.
LARGEST_KICK = 2.0**57
FAR = 2**62  # momenta, and positions in open space, stay within
LARGEST_DRIFT = 2.0**62  # a quarter of a box in one step
REACH = 2  # cells to look through on each side; cells are at least 1 / REACH of the list's radius wide

# slots of `Particles.counts`
BUILT, BUILDS, ROOM_NEEDED, CULPRIT, AXIS, WHAT = range(6)
POSITION, MOMENTUM = 1, 2  # WHAT left the lattice


class Particles(NamedTuple):
    """The lattice and the pair list on it."""

    periodic: bool
    spacing: NDArray[np.float64]  # (3,)
    x: NDArray[np.int64]  # (3, n)
    images: NDArray[np.int64]  # (3, n)
    p: NDArray[np.int64]  # (3, n)
    kick: NDArray[np.int64]  # (3, n) half a step's
    drift: NDArray[np.float64]  # (3, n) a step's, in steps of spacing per step of momentum
    radius: float  # of the list; 0 without one
    skin: float
    reference: NDArray[np.int64]  # (3, n) positions when the list was made
    span: NDArray[np.int64]  # (n, 2) first and last partner + 1 of a particle
    partners: NDArray[np.int32]  # (room,)
    counts: NDArray[np.int64]


class ExactPairs(NamedTuple):
    """A pair law on the lattice."""

    law: Any  # the law's NamedTuple of parameters (of the first pair of species, where there are several)
    at_cutoff: AtCutoff  # likewise
    tables: Any  # SpeciesTables, or None for one species
    truncation: Any
    cutoff2: float
    gain: NDArray[np.float64]  # (n,) steps of momentum per unit of force in half a step
    alike: bool  # whether that is the same for all, so that action and reaction are the same whole number
    largest: float  # of the gains


class SpeciesTables(NamedTuple):
    """Numbers per pair of species."""

    law: NDArray[np.float64]  # (parameters, species, species)
    at_cutoff: NDArray[np.float64]  # (2, species, species)
    species: NDArray[np.int64]  # (n,)


class ExactGravity(NamedTuple):
    """Gravity on the lattice."""

    softening2: float
    gm: NDArray[np.float64]  # (n,) G m
    gain: NDArray[np.float64]  # (n,) steps of velocity per unit of acceleration in half a step


# --- forces ---


def add_kicks(force: Any, particles: Particles) -> int:
    """Add the half kicks of one force, or of a tuple of them, to ``particles.kick``; a status."""
    raise NotImplementedError("for compiled code")


@overload(add_kicks)
def _add_kicks(force, particles):
    if isinstance(force, types.BaseNamedTuple):
        return {ExactPairs: pair_kicks, ExactGravity: gravity_kicks}[force.instance_class].py_func
    lines = [f"    status = add_kicks(force[{k}], particles)\n    if status: return status" for k in range(len(force))]
    scope = {"add_kicks": add_kicks}
    exec("\n".join(["def each(force, particles):", *lines, "    return 0"]), scope)
    return scope["each"]


@strict
def pair_kicks(force, particles):
    x, kick, span, partners = particles.x, particles.kick, particles.span, particles.partners
    ux, uy, uz = particles.spacing
    law, at_cutoff, truncation, tables = force.law, force.at_cutoff, force.truncation, force.tables
    cutoff2, gain, alike, largest = force.cutoff2, force.gain, force.alike, force.largest
    for i in range(x.shape[1]):
        xi, yi, zi = x[0, i], x[1, i], x[2, i]
        gi = gain[i]
        kx, ky, kz = kick[0, i], kick[1, i], kick[2, i]
        for k in range(span[i, 0], span[i, 1]):
            j = partners[k]
            dx = ux * np.float64(difference(xi, x[0, j]))
            dy = uy * np.float64(difference(yi, x[1, j]))
            dz = uz * np.float64(difference(zi, x[2, j]))
            r2 = dx * dx + dy * dy + dz * dz
            if r2 < cutoff2:
                force_over_r = pair_force(law, at_cutoff, truncation, tables, i, j, r2)
                fx, fy, fz = force_over_r * dx, force_over_r * dy, force_over_r * dz
                if not (abs(fx) + abs(fy) + abs(fz)) * largest < LARGEST_KICK:
                    return BLOWN_UP
                px, py, pz = whole(gi * fx), whole(gi * fy), whole(gi * fz)
                kx, ky, kz = kx + px, ky + py, kz + pz
                if not alike:
                    gj = gain[j]
                    px, py, pz = whole(gj * fx), whole(gj * fy), whole(gj * fz)
                kick[0, j] -= px
                kick[1, j] -= py
                kick[2, j] -= pz
        kick[0, i], kick[1, i], kick[2, i] = kx, ky, kz
    return OK


@strict
def gravity_kicks(force, particles):
    x, kick, gm, gain = particles.x, particles.kick, force.gm, force.gain
    ux, uy, uz = particles.spacing
    for i in range(x.shape[1]):
        for j in range(i):
            to_i, to_j = gm[j] * gain[i], gm[i] * gain[j]
            strongest = max(to_i, to_j)
            if strongest > 0.0:
                dx = ux * np.float64(difference(x[0, i], x[0, j]))
                dy = uy * np.float64(difference(x[1, i], x[1, j]))
                dz = uz * np.float64(difference(x[2, i], x[2, j]))
                r2 = dx * dx + dy * dy + dz * dz + force.softening2
                inverse = 1.0 / np.sqrt(r2)
                w = inverse * inverse * inverse
                fx, fy, fz = w * dx, w * dy, w * dz
                if not (abs(fx) + abs(fy) + abs(fz)) * strongest < LARGEST_KICK:
                    return BLOWN_UP
                kick[0, i] -= whole(to_i * fx)
                kick[1, i] -= whole(to_i * fy)
                kick[2, i] -= whole(to_i * fz)
                kick[0, j] += whole(to_j * fx)
                kick[1, j] += whole(to_j * fy)
                kick[2, j] += whole(to_j * fz)
    return OK


@strict
def whole(value):
    """The nearest whole number, halves to even: an odd function."""
    return np.int64(np.rint(value))


@strict
def wrapped_sum(a, b):
    """a + b around 2^64. Unsigned, since LLVM may take it for granted that signed numbers do not wrap around."""
    return np.int64(np.uint64(a) + np.uint64(b))


@strict
def difference(a, b):
    """a - b around 2^64."""
    return np.int64(np.uint64(a) - np.uint64(b))


def pair_force(law: Any, at_cutoff: Any, truncation: Any, tables: Any, i: int, j: int, r2: float) -> float:
    """Force over r between particles i and j, truncated."""
    raise NotImplementedError("for compiled code")


@overload(pair_force)
def _pair_force(law, at_cutoff, truncation, tables, i, j, r2):
    of_law, apply = strict(law.instance_class.law), strict(truncation.instance_class.apply)
    if isinstance(tables, types.NoneType):

        def one_species(law, at_cutoff, truncation, tables, i, j, r2):
            energy, force_over_r = of_law(law, r2)
            return apply(truncation, at_cutoff, r2, energy, force_over_r)[1]

        return one_species

    parameters = from_table(law.instance_class)

    def many_species(law, at_cutoff, truncation, tables, i, j, r2):
        a, b = tables.species[i], tables.species[j]
        energy, force_over_r = of_law(parameters(tables.law, a, b), r2)
        here = AtCutoff(tables.at_cutoff[0, a, b], tables.at_cutoff[1, a, b])
        return apply(truncation, here, r2, energy, force_over_r)[1]

    return many_species


def from_table(cls: Any) -> Callable[..., Any]:
    """The compiled function that fills a law's NamedTuple from a table of parameters per pair of species."""
    numbers = ", ".join(f"table[{k}, a, b]" for k in range(len(cls._fields)))
    scope: dict[str, Any] = {"cls": cls}
    exec(f"def parameters(table, a, b):\n    return cls({numbers})", scope)
    return strict(scope["parameters"])


# --- the pair list: each pair within `radius` once ---


@strict
def refresh(particles):
    """Search for the pairs anew where a particle has moved by half the skin; a status."""
    counts = particles.counts
    if particles.radius == 0.0 or (counts[BUILT] and not moved(particles)):
        return OK
    counts[BUILT] = 0
    found = search(particles)
    counts[ROOM_NEEDED] = found
    if found > particles.partners.size:
        return GROW
    counts[BUILT] = 1
    counts[BUILDS] += 1
    return OK


@strict
def moved(particles):
    x, reference = particles.x, particles.reference
    ux, uy, uz = particles.spacing
    limit = (0.499 * particles.skin) ** 2
    for i in range(x.shape[1]):
        dx = ux * np.float64(difference(x[0, i], reference[0, i]))
        dy = uy * np.float64(difference(x[1, i], reference[1, i]))
        dz = uz * np.float64(difference(x[2, i], reference[2, i]))
        if dx * dx + dy * dy + dz * dz > limit:
            return True
    return False


@strict
def sort_into_cells(particles, cells):
    """cells <- how many along each axis; where each cell's particles begin, and the particles by cell."""
    x, n = particles.x, particles.x.shape[1]
    low, width = np.zeros(3), np.zeros(3)
    most = int((8.0 * n) ** (1.0 / 3.0)) + 1
    for k in range(3):
        low[k], high = -(2.0**63), 2.0**63
        if not particles.periodic:
            low[k] = high = np.float64(x[k, 0])
            for i in range(n):
                low[k], high = min(low[k], np.float64(x[k, i])), max(high, np.float64(x[k, i]))
        extent = max(high - low[k], 1.0)
        cells[k] = int(max(1.0, min(float(most), extent * particles.spacing[k] * REACH / particles.radius)))
        width[k] = extent / cells[k]
    cell = np.zeros(n, np.int64)
    begin = np.zeros(cells[0] * cells[1] * cells[2] + 1, np.int64)
    for i in range(n):
        for k in range(3):
            c = int((np.float64(x[k, i]) - low[k]) / width[k])
            cell[i] = cell[i] * cells[k] + min(max(c, 0), cells[k] - 1)
        begin[cell[i] + 1] += 1
    for c in range(begin.size - 1):
        begin[c + 1] += begin[c]
    order, fill = np.zeros(n, np.int64), begin[:-1].copy()
    for i in range(n):
        order[fill[cell[i]]] = i
        fill[cell[i]] += 1
    return begin, order


@strict
def search(particles):
    """Fill the list, as far as there is room; the number of pairs found. The positions become the reference."""
    x, n, reference = particles.x, particles.x.shape[1], particles.reference
    for k in range(3):
        for i in range(n):
            reference[k, i] = x[k, i]
    cells = np.zeros(3, np.int64)
    begin, order = sort_into_cells(particles, cells)
    near = np.empty(n, np.int64)  # the particles that those of one cell may pair with, its own first
    found = 0
    for cell in range(begin.size - 1):
        own = begin[cell + 1] - begin[cell]
        if own:
            count = gather(particles, cells, cell, begin, order, near)
            for q in range(own):
                found = add_partners(particles, near, q, count, found)
    return found


@strict
def gather(particles, cells, cell, begin, order, near):
    """near <- the particles of a cell and of the cells after it within reach; their number."""
    low, high = np.zeros(3, np.int64), np.zeros(3, np.int64)
    here = (cell // (cells[1] * cells[2]), cell // cells[2] % cells[1], cell % cells[2])
    for k in range(3):
        low[k], high[k] = here[k] - REACH, here[k] + REACH + 1
        if not particles.periodic:
            low[k], high[k] = max(low[k], 0), min(high[k], cells[k])
        elif cells[k] <= 2 * REACH:
            low[k], high[k] = 0, cells[k]
    count = 0
    for q in range(begin[cell], begin[cell + 1]):
        near[count] = order[q]
        count += 1
    for a in range(low[0], high[0]):
        for b in range(low[1], high[1]):
            for c in range(low[2], high[2]):
                other = (a % cells[0] * cells[1] + b % cells[1]) * cells[2] + c % cells[2]
                if other > cell:
                    for q in range(begin[other], begin[other + 1]):
                        near[count] = order[q]
                        count += 1
    return count


@strict
def add_partners(particles, near, q, count, found):
    """List particle near[q] with those after it that are within the radius; the number of pairs found so far."""
    x, partners, i = particles.x, particles.partners, near[q]
    ux, uy, uz = particles.spacing
    radius2, room = particles.radius**2, partners.size
    particles.span[i, 0] = found
    for k in range(q + 1, count):
        j = near[k]
        dx = ux * np.float64(difference(x[0, i], x[0, j]))
        dy = uy * np.float64(difference(x[1, i], x[1, j]))
        dz = uz * np.float64(difference(x[2, i], x[2, j]))
        if dx * dx + dy * dy + dz * dz < radius2:
            if found < room:
                partners[found] = j
            found += 1
    particles.span[i, 1] = found
    return found


# --- steps ---


@strict
def fill_kicks(forces, particles, cursor):
    """particles.kick <- the half kicks here; a status."""
    status = refresh(particles)
    if status != OK:
        return status
    particles.kick[:, :] = 0
    cursor[EVALUATIONS] += 1
    return add_kicks(forces, particles)


@strict
def leave(particles, what, k, i):
    """Note which particle left the lattice."""
    counts = particles.counts
    counts[WHAT], counts[AXIS], counts[CULPRIT] = what, k, i
    return STOPPED


@strict
def apply_kicks(particles):
    p, kick = particles.p, particles.kick
    for k in range(3):
        for i in range(p.shape[1]):
            p[k, i] += kick[k, i]
            if p[k, i] >= FAR or p[k, i] <= -FAR:
                return leave(particles, MOMENTUM, k, i)
    return OK


@strict
def apply_drift(particles):
    x, images, p, drift = particles.x, particles.images, particles.p, particles.drift
    for k in range(3):
        for i in range(p.shape[1]):
            d = drift[k, i] * np.float64(p[k, i])
            if not abs(d) < LARGEST_DRIFT:
                return BLOWN_UP
            step = whole(d)
            before = x[k, i]
            now = wrapped_sum(before, step)
            x[k, i] = now
            if particles.periodic:
                if step > 0 and now < before:
                    images[k, i] += 1
                elif step < 0 and now > before:
                    images[k, i] -= 1
            elif now >= FAR or now <= -FAR:
                return leave(particles, POSITION, k, i)
    return OK


@driver
def exact_loop(forces, particles, steps, cursor):
    while cursor[STEP] < steps:
        if cursor[STAGE] == 0:
            if not cursor[FRESH]:
                status = fill_kicks(forces, particles, cursor)
                if status != OK:
                    return status
                cursor[FRESH] = 1
            status = apply_kicks(particles)
            if status == OK:
                status = apply_drift(particles)
            if status != OK:
                return status
            cursor[STAGE] = 1
        status = fill_kicks(forces, particles, cursor)
        if status == OK:
            status = apply_kicks(particles)
        if status != OK:
            return status
        cursor[STAGE] = 0
        cursor[STEP] += 1
    return OK
