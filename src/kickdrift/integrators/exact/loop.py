"""Compiled loop of leapfrog-exact: forces as whole numbers, kicks and drifts.

All floating-point arithmetic here is strict, operation by operation. So an increment has the same bits wherever its
pair stands in a list.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from kickdrift.forces.bound.table import EVALUATIONS
from kickdrift.forces.pairs.truncations import OfPairs, nearer
from kickdrift.forces.seam.kernel import BLOWN_UP, OK
from kickdrift.integrators.exact.list import (
    AXIS,
    CULPRIT,
    MOMENTUM,
    POSITION,
    WHAT,
    difference,
    refresh,
    whole,
    wrapped_sum,
)
from kickdrift.integrators.stepping.loops import FRESH, STAGE, STEP
from kickdrift.integrators.stepping.stepper import STOPPED
from kickdrift.jit.compile import driver, strict
from kickdrift.jit.inner import by_type

# Largest half kick of one pair. Momenta reach to 2^62, so a sum can overflow unseen only with 32 such partners at once.
# A start's largest momentum is 2^54 to 2^55.
LARGEST_KICK = 2.0**57
FAR = 2**62  # limit of momenta, and of positions in open space
LARGEST_DRIFT = 2.0**62  # a quarter of a box in one step


class ExactPairs(NamedTuple):
    """A pair law on the lattice."""

    law: Any  # the law's NamedTuple of parameters (of the first pair of species, if there are several)
    at_cutoff: Any  # likewise; AtCutoff or AtOwnCutoff
    tables: Any  # SpeciesTables, or None for one species
    truncation: Any
    cutoff2: float
    gain: NDArray[np.float64]  # (n,) steps of momentum per unit of force in half a step
    alike: bool  # whether the gain is equal for all, so that action and reaction are the same whole number
    largest: float  # largest gain


class SpeciesTables(NamedTuple):
    """Parameters per pair of species."""

    law: NDArray[np.float64]  # (parameters, species, species)
    at_cutoff: NDArray[np.float64]  # (numbers of an AtCutoff or AtOwnCutoff, species, species)
    species: NDArray[np.int64]  # (n,)


class ExactGravity(NamedTuple):
    """Gravity on the lattice."""

    softening2: float
    gm: NDArray[np.float64]  # (n,) G m
    gain: NDArray[np.float64]  # (n,) steps of velocity per unit of acceleration in half a step


# --- forces ---


@by_type
def add_kicks(force, particles):
    """Add the half kicks of one force, or of a tuple of forces, to ``particles.kick``. Return a status."""
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


@by_type
def pair_force(law, at_cutoff, truncation, tables, i, j, r2):
    """Truncated force over r between particles i and j."""
    of_law, apply = strict(law.instance_class.law), truncated(truncation)
    if isinstance(tables, types.NoneType):

        def one_species(law, at_cutoff, truncation, tables, i, j, r2):
            energy, force_over_r = of_law(law, r2)
            return apply(truncation, at_cutoff, r2, energy, force_over_r)[1]

        return one_species

    parameters, numbers = from_table(law.instance_class), from_table(at_cutoff.instance_class)

    def many_species(law, at_cutoff, truncation, tables, i, j, r2):
        a, b = tables.species[i], tables.species[j]
        energy, force_over_r = of_law(parameters(tables.law, a, b), r2)
        return apply(truncation, numbers(tables.at_cutoff, a, b), r2, energy, force_over_r)[1]

    return many_species


def truncated(truncation: Any) -> Callable[..., Any]:
    """Compiled function that applies a truncation of this type."""
    if truncation.instance_class is not OfPairs:
        return strict(truncation.instance_class.apply)
    first, then, last = (strict(each.instance_class.apply) for each in truncation.types)

    def of_pair(truncation, at_cutoff, r2, energy, force_over_r):
        energy, force_over_r = first(at_cutoff, at_cutoff, r2, energy, force_over_r)
        energy, force_over_r = then(at_cutoff, at_cutoff, r2, energy, force_over_r)
        energy, force_over_r = last(at_cutoff, at_cutoff, r2, energy, force_over_r)
        return energy, nearer(r2, at_cutoff.cutoff2, force_over_r)

    return strict(of_pair)


def from_table(cls: Any) -> Callable[..., Any]:
    """Compiled function that fills a law's NamedTuple from a table of parameters per pair of species."""
    numbers = ", ".join(f"table[{k}, a, b]" for k in range(len(cls._fields)))
    scope: dict[str, Any] = {"cls": cls}
    exec(f"def parameters(table, a, b):\n    return cls({numbers})", scope)
    return strict(scope["parameters"])


# --- steps ---


@strict
def fill_kicks(forces, particles, cursor):
    """particles.kick <- the half kicks at these positions. Return a status."""
    status = refresh(particles)
    if status != OK:
        return status
    particles.kick[:, :] = 0
    cursor[EVALUATIONS] += 1
    return add_kicks(forces, particles)


@strict
def leave(particles, what, k, i):
    """Record which particle left the lattice."""
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
