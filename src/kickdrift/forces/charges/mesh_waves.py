"""Waves of a mesh: transforms across its planes, the influence of the charges, and energy and virial of the waves."""

from __future__ import annotations

import math

from numba import types

from kickdrift.forces.charges.fourier import POINT, transform
from kickdrift.forces.charges.mesh_ions import WANTED, share
from kickdrift.forces.lists.along import add_along, store_along, zeros_along
from kickdrift.jit.compile import as_written, never_inline
from kickdrift.jit.inner import by_type
from kickdrift.jit.lanes.functions import lane_exp, lane_numbers, lane_sum, multiply_add, splat
from kickdrift.jit.lanes.masks import select
from kickdrift.jit.lanes.memory import load, store
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.jit.threads.chunks import chunk_task


@chunk_task
def mesh_lines(force, c, thread):
    """Transform a chunk's lines across the planes, multiply by the influence, sum energy and virial, and go back."""
    never_inline()
    own, spectrum, influence = force.own[thread], force.spectrum, force.influence
    nx, half = force.first.n, force.half
    line = 2 * POINT * (nx + WIDTH)
    energy, virial, total = splat(0.0), splat(0.0), zeros_along(force.along, force.sums)
    begin, end = share(force.second.n, force.lines.number, c)
    for y in range(begin, end):
        for z in range(0, half, WIDTH):
            at = 2 * half * y + z
            transform(force.first, spectrum, at, force.plane, half, own, line, POINT, WIDTH, own)
            factors = (y * half + z) * nx
            if force.state[WANTED]:
                for x in range(nx):
                    re, im = load(own, line + POINT * x), load(own, line + POINT * x + WIDTH)
                    each = load(influence, factors + WIDTH * x) * load(force.weights, z) * (re * re + im * im)
                    k2 = squared_wave(force, x, y, z)
                    total = add_wave(total, force, x, y, z, k2, each)
                    energy = energy + each
                    virial = multiply_add(k2, each, virial)
            for x in range(nx):
                factor, point = load(influence, factors + WIDTH * x), line + POINT * x
                store(own, point, factor * load(own, point))
                store(own, point + WIDTH, factor * load(own, point + WIDTH))
            transform(force.first, own, line + WIDTH, POINT, -WIDTH, spectrum, at + half, force.plane, -half, own)
    if force.state[WANTED]:
        store_along(total, force.along, c + 1)
    energies = 0.5 * lane_sum(energy)
    force.sums[c + 1, 0] = energies
    force.sums[c + 1, 1] = energies - 0.25 * lane_sum(virial) / (force.alpha * force.alpha)


@by_type
def add_wave(total, force, x, y, z, k2, square):
    """Sums with the virial along each axis of eight waves with twice the energy ``square``, less their energy (Heyes
    1994, doi:10.1103/PhysRevB.49.755)."""
    if isinstance(total, types.NoneType):
        return lambda total, force, x, y, z, k2, square: None

    def add(total, force, x, y, z, k2, square):
        a, b, c = waves_at(force, x, y, z)
        pull = select(
            k2 > 0.0, (-4.0 * math.pi * math.pi) * square * (1.0 / k2 + 0.25 / (force.alpha * force.alpha)), 0.0
        )
        return add_along(total, pull * a, pull * b, pull * c, a, b, c)

    return add


@as_written
def waves_at(force, x, y, z):
    """Return k / (2 pi) of eight waves, from the third number z on."""
    inverse = force.inverse
    u = float(x if 2 * x <= force.first.n else x - force.first.n)
    v = float(y if 2 * y <= force.second.n else y - force.second.n)
    w = lane_numbers() + float(z)
    a = splat(inverse[0, 0] * u)
    b = splat(inverse[1, 0] * u + inverse[1, 1] * v)
    c = multiply_add(splat(inverse[2, 2]), w, splat(inverse[2, 0] * u + inverse[2, 1] * v))
    return a, b, c


@as_written
def squared_wave(force, x, y, z):
    """Return k^2 of eight waves, from the third number z on."""
    a, b, c = waves_at(force, x, y, z)
    return (4.0 * math.pi * math.pi) * (a * a + b * b + c * c)


@chunk_task
def mesh_influence(force, c):
    """Write the influence of a chunk's lines for the box of now."""
    never_inline()
    nx, half, matrix = force.first.n, force.half, force.edges
    scale = 4.0 * math.pi / (matrix[0, 0] * matrix[1, 1] * matrix[2, 2])
    over = -0.25 / (force.alpha * force.alpha)
    begin, end = share(force.second.n, force.lines.number, c)
    for y in range(begin, end):
        for z in range(0, half, WIDTH):
            for x in range(nx):
                k2 = squared_wave(force, x, y, z)
                outer = scale * force.first_moduli[x] * force.second_moduli[y]
                at = (y * half + z) * nx + WIDTH * x
                store(force.influence, at, outer * load(force.third_moduli, z) * lane_exp(over * k2) / k2)
    if begin == 0:
        force.influence[0] = 0.0  # the wave of no wavelength
