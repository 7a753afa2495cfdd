"""Gravity of all pairs: tiles of bodies in shared memory, each pair twice, and sums in the order of the bodies.

The bodies keep their order. Several blocks share the pairs of the same bodies, and their partial sums are added in one
order. In mixed precision, a position is the sum of two float32 numbers, so a distance has the relative error of
float32. The sums over a tile are float32, and those over tiles are float64.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import config, cuda

from kickdrift.engines.cuda.law_code import Code

def _root(value):
    return 1.0 / math.sqrt(value)


if config.ENABLE_CUDASIM:
    inverse_root = inverse_root_single = _root
else:
    from numba.cuda import libdevice

    inverse_root, inverse_root_single = libdevice.rsqrt, libdevice.rsqrtf

TILE = 16 if config.ENABLE_CUDASIM else 128


def parts_of(n: int, processors: int) -> int:
    """Number of blocks that share the pairs of the same bodies, so that all processors have work."""
    blocks, tiles = -(-n // TILE), -(-n // TILE)
    return max(1, min(tiles, 16 * processors // blocks))


def forces_of(softening: float) -> Code:
    """Kernel that writes partial accelerations (parts, 3, n) in float64."""
    softening2 = softening**2

    @cuda.jit
    def forces(x, gm, partial):
        i, t = cuda.grid(1), cuda.threadIdx.x
        n, parts, part = gm.size, partial.shape[0], cuda.blockIdx.y
        tiles = (n + TILE - 1) // TILE
        tile = cuda.shared.array((4, TILE), np.float64)
        xi, yi, zi = 0.0, 0.0, 0.0
        if i < n:
            xi, yi, zi = x[0, i], x[1, i], x[2, i]
        ax, ay, az = 0.0, 0.0, 0.0
        for step in range(tiles * part // parts, tiles * (part + 1) // parts):
            first = step * TILE
            j = first + t
            if j < n:
                tile[0, t], tile[1, t], tile[2, t], tile[3, t] = x[0, j], x[1, j], x[2, j], gm[j]
            cuda.syncthreads()
            for k in range(min(TILE, n - first)):
                dx, dy, dz = tile[0, k] - xi, tile[1, k] - yi, tile[2, k] - zi
                r2 = dx * dx + dy * dy + dz * dz + softening2
                if first + k != i:
                    inverse = inverse_root(r2)
                    g = tile[3, k] * (inverse * inverse * inverse)
                    ax += g * dx
                    ay += g * dy
                    az += g * dz
            cuda.syncthreads()
        if i < n:
            partial[part, 0, i], partial[part, 1, i], partial[part, 2, i] = ax, ay, az

    return forces  # type: ignore[no-any-return]


def mixed_forces_of(softening: float) -> Code:
    """Kernel that writes partial accelerations (parts, 3, n) in mixed precision."""
    softening2 = np.float32(softening**2)

    @cuda.jit(fastmath={"contract", "arcp", "nsz"})
    def forces(x, gm, partial):
        i, t = cuda.grid(1), cuda.threadIdx.x
        n, parts, part = gm.size, partial.shape[0], cuda.blockIdx.y
        tiles = (n + TILE - 1) // TILE
        tile = cuda.shared.array((7, TILE), np.float32)
        none = np.float32(0.0)
        xi, yi, zi, xl, yl, zl = none, none, none, none, none, none
        if i < n:
            xi, yi, zi = np.float32(x[0, i]), np.float32(x[1, i]), np.float32(x[2, i])
            xl, yl, zl = np.float32(x[0, i] - xi), np.float32(x[1, i] - yi), np.float32(x[2, i] - zi)
        ax, ay, az = 0.0, 0.0, 0.0
        for step in range(tiles * part // parts, tiles * (part + 1) // parts):
            first = step * TILE
            j = first + t
            if j < n:
                for k in range(3):
                    high = np.float32(x[k, j])
                    tile[k, t], tile[3 + k, t] = high, np.float32(x[k, j] - high)
                tile[6, t] = np.float32(gm[j])
            cuda.syncthreads()
            sx, sy, sz = none, none, none
            for k in range(min(TILE, n - first)):
                dx = (tile[0, k] - xi) + (tile[3, k] - xl)
                dy = (tile[1, k] - yi) + (tile[4, k] - yl)
                dz = (tile[2, k] - zi) + (tile[5, k] - zl)
                r2 = dx * dx + dy * dy + dz * dz + softening2
                if first + k != i:
                    inverse = inverse_root_single(r2)
                    g = tile[6, k] * (inverse * inverse * inverse)
                    sx += g * dx
                    sy += g * dy
                    sz += g * dz
            ax += sx
            ay += sy
            az += sz
            cuda.syncthreads()
        if i < n:
            partial[part, 0, i], partial[part, 1, i], partial[part, 2, i] = ax, ay, az

    return forces  # type: ignore[no-any-return]


def potential_of(softening: float) -> Code:
    """Kernel that writes rows (2, n): each body's potential, and its virial over its mass."""
    softening2 = softening**2

    @cuda.jit
    def potential(x, gm, rows):
        i = cuda.grid(1)
        if i < gm.size:
            energy, virial = 0.0, 0.0
            for j in range(gm.size):
                dx, dy, dz = x[0, j] - x[0, i], x[1, j] - x[1, i], x[2, j] - x[2, i]
                square = dx * dx + dy * dy + dz * dz
                if j != i:
                    inverse = inverse_root(square + softening2)
                    energy -= gm[j] * inverse
                    virial -= gm[j] * inverse * inverse * inverse * square
            rows[0, i], rows[1, i] = energy, virial

    return potential  # type: ignore[no-any-return]


@cuda.jit
def add_parts(partial: Any, a: Any) -> None:
    """Add partial accelerations (parts, 3, n) in one order."""
    i = cuda.grid(1)
    if i < a.shape[1]:
        for k in range(3):
            total = 0.0
            for part in range(partial.shape[0]):
                total += partial[part, k, i]
            a[k, i] = total
