"""Gravity of all pairs: tiles of bodies in shared memory, each pair twice, and sums in the order of the bodies.

The bodies keep their order. Several blocks share the pairs of the same bodies, and their partial sums are added in one
order. In mixed precision, a position is the sum of two float32 numbers, so a distance has the relative error of
float32. The sums over a tile are float32, and those over tiles are float64.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np
from numba import config, cuda

from kickdrift.engines.cuda.law_code import Code


def _root(value):
    return 1.0 / math.sqrt(value) if value else 0.0  # threads without a body have the last body's place


if config.ENABLE_CUDASIM:
    inverse_root = inverse_root_single = _root
else:
    from numba.cuda import libdevice

    inverse_root, inverse_root_single = libdevice.rsqrt, libdevice.rsqrtf

TILE = 16 if config.ENABLE_CUDASIM else 128
EACH = 4  # bodies of one thread


def parts_of(n: int, processors: int) -> int:
    """Number of blocks that share the pairs of the same bodies, so that all processors have work."""
    blocks, tiles = -(-n // (TILE * EACH)), -(-n // TILE)
    return max(1, min(tiles, 16 * processors // blocks))


@lru_cache(maxsize=8)
def forces_of(softening: float) -> Code:
    """Kernel that writes partial accelerations (parts, 3, n) in float64."""
    softening2 = softening**2

    @cuda.jit
    def forces(x, gm, partial):
        t, n = np.uint32(cuda.threadIdx.x), np.uint32(gm.size)
        base = np.uint32(cuda.blockIdx.x * TILE * EACH + t)
        parts, part = partial.shape[0], cuda.blockIdx.y
        tiles = (n + TILE - 1) // TILE
        tile = cuda.shared.array((4, TILE), np.float64)
        own = cuda.local.array((3, EACH), np.float64)
        a = cuda.local.array((3, EACH), np.float64)
        for e in range(EACH):
            i = min(np.uint32(base + e * TILE), np.uint32(n - 1))
            for k in range(3):
                own[k, e], a[k, e] = x[k, i], 0.0
        for step in range(tiles * part // parts, tiles * (part + 1) // parts):
            first = np.uint32(step * TILE)
            j = np.uint32(first + t)
            if j < n:
                tile[0, t], tile[1, t], tile[2, t], tile[3, t] = x[0, j], x[1, j], x[2, j], gm[j]
            cuda.syncthreads()
            k, end = np.uint32(0), np.uint32(min(TILE, n - first))
            while k < end:
                for e in range(EACH):
                    dx, dy, dz = tile[0, k] - own[0, e], tile[1, k] - own[1, e], tile[2, k] - own[2, e]
                    r2 = dx * dx + dy * dy + dz * dz + softening2
                    if softening2 > 0.0 or np.uint32(first + k) != np.uint32(base + e * TILE):
                        inverse = inverse_root(r2)
                        g = tile[3, k] * (inverse * inverse * inverse)
                        a[0, e] += g * dx
                        a[1, e] += g * dy
                        a[2, e] += g * dz
                k = np.uint32(k + 1)
            cuda.syncthreads()
        for e in range(EACH):
            i = np.uint32(base + e * TILE)
            if i < n:
                for k in range(3):
                    partial[part, k, i] = a[k, e]

    return forces


@lru_cache(maxsize=8)
def mixed_forces_of(softening: float) -> Code:
    """Kernel that writes partial accelerations (parts, 3, n) in mixed precision."""
    softening2, none = np.float32(softening**2), np.float32(0.0)

    @cuda.jit(fastmath={"contract", "arcp", "nsz"})
    def forces(x, gm, partial):
        t, n = np.uint32(cuda.threadIdx.x), np.uint32(gm.size)
        base = np.uint32(cuda.blockIdx.x * TILE * EACH + t)
        parts, part = partial.shape[0], cuda.blockIdx.y
        tiles = (n + TILE - 1) // TILE
        tile = cuda.shared.array((7, TILE), np.float32)
        high = cuda.local.array((3, EACH), np.float32)
        low = cuda.local.array((3, EACH), np.float32)
        sums = cuda.local.array((3, EACH), np.float32)
        a = cuda.local.array((3, EACH), np.float64)
        for e in range(EACH):
            i = min(np.uint32(base + e * TILE), np.uint32(n - 1))
            for k in range(3):
                high[k, e], a[k, e] = np.float32(x[k, i]), 0.0
                low[k, e] = np.float32(x[k, i] - high[k, e])
        for step in range(tiles * part // parts, tiles * (part + 1) // parts):
            first = np.uint32(step * TILE)
            j = np.uint32(first + t)
            if j < n:
                for k in range(3):
                    top = np.float32(x[k, j])
                    tile[k, t], tile[3 + k, t] = top, np.float32(x[k, j] - top)
                tile[6, t] = np.float32(gm[j])
            cuda.syncthreads()
            for e in range(EACH):
                sums[0, e], sums[1, e], sums[2, e] = none, none, none
            k, end = np.uint32(0), np.uint32(min(TILE, n - first))
            while k < end:
                for e in range(EACH):
                    dx = (tile[0, k] - high[0, e]) + (tile[3, k] - low[0, e])
                    dy = (tile[1, k] - high[1, e]) + (tile[4, k] - low[1, e])
                    dz = (tile[2, k] - high[2, e]) + (tile[5, k] - low[2, e])
                    r2 = dx * dx + dy * dy + dz * dz + softening2
                    if softening2 > none or np.uint32(first + k) != np.uint32(base + e * TILE):
                        inverse = inverse_root_single(r2)
                        g = tile[6, k] * (inverse * inverse * inverse)
                        sums[0, e] += g * dx
                        sums[1, e] += g * dy
                        sums[2, e] += g * dz
                k = np.uint32(k + 1)
            for e in range(EACH):
                for k in range(3):
                    a[k, e] += sums[k, e]
            cuda.syncthreads()
        for e in range(EACH):
            i = np.uint32(base + e * TILE)
            if i < n:
                for k in range(3):
                    partial[part, k, i] = a[k, e]

    return forces


@lru_cache(maxsize=8)
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

    return potential


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
