"""Energy and forces of charges in a slab by the exact Ewald sum in two dimensions, in plain NumPy.

Parry 1975, doi:10.1016/0039-6028(75)90362-3: the sum over images of the plane x-y, and no image along z.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
from scipy.special import erf, erfc

from kickdrift.model.state import Floats

SHELLS, WAVES = 4, 16  # images and waves on each side


def energy_and_forces(x: Floats, charges: Floats, edges: Floats, alpha: float) -> tuple[float, Floats]:
    """Energy, and forces (n, 3), at positions x (n, 3) in a rectangle with these edges (2,)."""
    n, area = len(x), float(np.prod(edges))
    products = charges[:, None] * charges[None]
    apart = x[:, None] - x[None]
    energy, forces = -alpha / math.sqrt(math.pi) * float(charges @ charges), np.zeros((n, 3))
    for i, j in itertools.product(range(-SHELLS, SHELLS + 1), repeat=2):
        d = apart + np.array([i * edges[0], j * edges[1], 0.0])
        r = np.linalg.norm(d, axis=2)
        if i == j == 0:
            np.fill_diagonal(r, np.inf)
        u = products * erfc(alpha * r) / r
        energy += 0.5 * float(u.sum())
        gaussian = 2.0 * alpha / math.sqrt(math.pi) * products * np.exp(-((alpha * r) ** 2))
        forces += np.einsum("ij,ijk->ik", (u + gaussian) / r**2, d)
    z = apart[:, :, 2]
    for i, j in itertools.product(range(-WAVES, WAVES + 1), repeat=2):
        if i == j == 0:
            continue
        wave = 2.0 * math.pi * np.array([i, j]) / edges
        k = float(np.linalg.norm(wave))
        up = np.exp(k * z) * erfc(0.5 * k / alpha + alpha * z)
        down = np.exp(-k * z) * erfc(0.5 * k / alpha - alpha * z)
        phase = apart[:, :, :2] @ wave
        energy += 0.5 * math.pi / area / k * float((products * np.cos(phase) * (up + down)).sum())
        sine = math.pi / area / k * (products * np.sin(phase) * (up + down)).sum(axis=1)
        forces[:, :2] += sine[:, None] * wave
        forces[:, 2] -= math.pi / area * (products * np.cos(phase) * (up - down)).sum(axis=1)
    flat = z * erf(alpha * z) + np.exp(-((alpha * z) ** 2)) / (alpha * math.sqrt(math.pi))
    energy -= math.pi / area * float((products * flat).sum())
    forces[:, 2] += 2.0 * math.pi / area * (products * erf(alpha * z)).sum(axis=1)
    return energy, forces
