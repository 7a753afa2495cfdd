"""Transforms of the planes of a mesh, along their rows and columns, to waves and back.

Sixteen real rows go through at once: eight as real parts of eight lanes, eight as imaginary parts.
"""

from __future__ import annotations

from kickdrift.forces.charges.fourier import POINT, transform
from kickdrift.forces.charges.mesh_ions import share
from kickdrift.forces.charges.splines import put
from kickdrift.jit.compile import as_written, never_inline
from kickdrift.jit.lanes.functions import splat
from kickdrift.jit.lanes.gathering import transposed
from kickdrift.jit.lanes.memory import load, store
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.jit.threads.chunks import chunk_task

PAIR = 2 * WIDTH  # rows of the mesh that one transform takes: eight as real parts, eight as imaginary parts


@as_written
def eight_rows(array, at, stride, last):
    """Return eight transposed rows of eight numbers, ``stride`` apart from ``at`` on; none begins beyond ``last``."""
    return transposed(
        (
            load(array, min(at, last)),
            load(array, min(at + stride, last)),
            load(array, min(at + 2 * stride, last)),
            load(array, min(at + 3 * stride, last)),
            load(array, min(at + 4 * stride, last)),
            load(array, min(at + 5 * stride, last)),
            load(array, min(at + 6 * stride, last)),
            load(array, min(at + 7 * stride, last)),
        )
    )


@as_written
def store_rows(rows, array, at, stride, last):
    """Store eight lanes as rows, ``stride`` apart from ``at`` on; none begins beyond ``last``."""
    a, b, c, d, e, f, g, h = rows
    whole = at + 7 * stride <= last
    if at <= last:
        store(array, at, a)
    if whole or at + stride <= last:
        store(array, at + stride, b)
    if whole or at + 2 * stride <= last:
        store(array, at + 2 * stride, c)
    if whole or at + 3 * stride <= last:
        store(array, at + 3 * stride, d)
    if whole or at + 4 * stride <= last:
        store(array, at + 4 * stride, e)
    if whole or at + 5 * stride <= last:
        store(array, at + 5 * stride, f)
    if whole or at + 6 * stride <= last:
        store(array, at + 6 * stride, g)
    if whole:
        store(array, at + 7 * stride, h)


@chunk_task
def mesh_forward(force, c, thread):
    """Transform a chunk's planes along their rows and columns."""
    never_inline()
    own, mesh, spectrum = force.own[thread], force.mesh, force.spectrum
    ny, nz, row, half = force.second.n, force.third.n, force.row, force.half
    begin, end = share(force.first.n, force.planes.number, c)
    source, target = 2 * POINT * (nz + WIDTH), 3 * POINT * (nz + WIDTH)
    for x in range(begin, end):
        for y in range(ny):
            at = (x * ny + y) * row
            store(mesh, at, load(mesh, at) + load(mesh, at + nz))
        for y in range(0, ny, PAIR):
            at, last = (x * ny + y) * row, (x * ny + ny - 1) * row
            for z in range(0, nz, WIDTH):
                put(eight_rows(mesh, at + z, row, last + z), own, source + POINT * z, POINT)
                put(eight_rows(mesh, at + WIDTH * row + z, row, last + z), own, source + POINT * z + WIDTH, POINT)
            transform(force.third, own, source, POINT, WIDTH, own, target, POINT, WIDTH, own)
            part(own, target, source, nz, half)
            to, last = x * force.plane + 2 * half * y, x * force.plane + 2 * half * (ny - 1)
            for k in range(0, half, WIDTH):
                for which in range(4):  # real and imaginary parts of the first and of the other eight rows
                    side, group = which % 2, which // 2
                    from_here = (target if group else source) + POINT * k + WIDTH * side
                    store_rows(
                        eight_rows(own, from_here, POINT, from_here + 7 * POINT),
                        spectrum,
                        to + 2 * half * WIDTH * group + half * side + k,
                        2 * half,
                        last + half * side + k,
                    )
        for k in range(0, half, WIDTH):
            at = x * force.plane + k
            transform(force.second, spectrum, at, 2 * half, half, spectrum, at, 2 * half, half, own)


@as_written
def part(own, both, first, n, half):
    """Part the transform of two real lines a + i b at ``both``: write that of a to ``first``, that of b in place."""
    for k in range(n // 2 + 1):
        at, other = both + POINT * k, both + POINT * ((n - k) % n)
        a, b, c, d = load(own, at), load(own, at + WIDTH), load(own, other), load(own, other + WIDTH)
        store(own, first + POINT * k, 0.5 * (a + c))
        store(own, first + POINT * k + WIDTH, 0.5 * (b - d))
        store(own, at, 0.5 * (b + d))
        store(own, at + WIDTH, 0.5 * (c - a))
    for k in range(n // 2 + 1, half):
        for side in range(0, POINT, WIDTH):
            store(own, first + POINT * k + side, splat(0.0))
            store(own, both + POINT * k + side, splat(0.0))


@chunk_task
def mesh_backward(force, c, thread):
    """Transform a chunk's planes back: the mesh then holds the potential."""
    never_inline()
    own, mesh, spectrum = force.own[thread], force.mesh, force.spectrum
    ny, nz, row, half = force.second.n, force.third.n, force.row, force.half
    begin, end = share(force.first.n, force.planes.number, c)
    first, second = 2 * POINT * (nz + WIDTH), 3 * POINT * (nz + WIDTH)
    for x in range(begin, end):
        for k in range(0, half, WIDTH):
            at = x * force.plane + k + half
            transform(force.second, spectrum, at, 2 * half, -half, spectrum, at, 2 * half, -half, own)
        for y in range(0, ny, PAIR):
            at, last = x * force.plane + 2 * half * y, x * force.plane + 2 * half * (ny - 1)
            for k in range(0, half, WIDTH):
                for which in range(4):
                    side, group = which % 2, which // 2
                    begins = at + 2 * half * WIDTH * group + half * side + k
                    rows = eight_rows(spectrum, begins, 2 * half, last + half * side + k)
                    put(rows, own, (second if group else first) + POINT * k + WIDTH * side, POINT)
            join(own, first, second, nz)
            transform(force.third, own, first + WIDTH, POINT, -WIDTH, own, second + WIDTH, POINT, -WIDTH, own)
            to, last = (x * ny + y) * row, (x * ny + ny - 1) * row
            for z in range(0, nz, WIDTH):
                for group in range(2):
                    from_here = second + POINT * z + WIDTH * group
                    store_rows(
                        eight_rows(own, from_here, POINT, from_here + 7 * POINT),
                        mesh,
                        to + WIDTH * row * group + z,
                        row,
                        last + z,
                    )
        for y in range(ny):
            at = (x * ny + y) * row
            store(mesh, at + nz, load(mesh, at))


@as_written
def join(own, first, second, n):
    """Join the transforms a and b of two real lines as a + i b, in the place of a."""
    for k in range(n // 2 + 1):
        at, other = first + POINT * k, second + POINT * k
        a, b, c, d = load(own, at), load(own, at + WIDTH), load(own, other), load(own, other + WIDTH)
        opposite = first + POINT * ((n - k) % n)
        store(own, opposite, a + d)
        store(own, opposite + WIDTH, c - b)
        store(own, at, a - d)
        store(own, at + WIDTH, b + c)
