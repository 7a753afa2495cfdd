"""The oracle of many-body forces: energies in plain NumPy over all pairs and triples, written from the papers.

Forces and virials are derivatives of these energies by a complex step (Squire & Trapp 1998,
doi:10.1137/S003614459631241X), exact to rounding. Nothing here comes from the compiled kernels or their splines.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from tests.oracle.forces import nearest_image

STEP = 1e-30


def separations(x: np.ndarray, box) -> np.ndarray:
    """(n, n, 3): from particle i to the nearest image of j, for complex positions."""
    d = (x[None, :] - x[:, None]).reshape(-1, 3)
    if not box.periodic:
        return d.reshape(len(x), len(x), 3)
    return (d + (nearest_image(box, d.real) - d.real)).reshape(len(x), len(x), 3)


def lengths(d: np.ndarray) -> np.ndarray:
    """(n, n): distances, with ones on the diagonal."""
    return np.sqrt((d**2).sum(axis=-1) + np.eye(len(d)))


def slope(energy: Callable[[np.ndarray], complex], way: np.ndarray) -> float:
    """Derivative of the energy along a way of the separations (n, n, 3)."""
    return float(energy(1j * STEP * way).imag / STEP)


def stillinger_weber(d: np.ndarray, species: list[str], entries: dict) -> complex:
    """Eqs. (2.1)-(2.5), in units of eV and angstroms."""
    r, n, energy = lengths(d), len(d), 0.0
    for i in range(n):
        g, near = {}, []
        for j in range(n):
            p = entries[f"{species[i]}-{species[j]}-{species[j]}"]
            cut = p["a"] * p["sigma"]
            if i == j or r[i, j].real >= cut:
                continue
            near.append(j)
            q = p["sigma"] / r[i, j]
            energy += (
                0.5 * p["A"] * p["epsilon"] * (p["B"] * q ** p["p"] - q ** p["q"])
                * np.exp(p["sigma"] / (r[i, j] - cut))
            )  # fmt: skip
            g[j] = np.exp(p["gamma"] * p["sigma"] / (r[i, j] - cut))
        for a, j in enumerate(near):
            for k in near[:a]:
                p = entries[f"{species[i]}-{species[j]}-{species[k]}"]
                cosine = (d[i, j] * d[i, k]).sum() / (r[i, j] * r[i, k])
                energy += p["lambda_"] * p["epsilon"] * (cosine - p["cos_theta0"]) ** 2 * g[j] * g[k]
    return energy


def smooth_cutoff(r: complex, R: float, D: float) -> complex:
    """Eq. (4)."""
    if r.real < R - D:
        return 1.0
    return 0.0 if r.real > R + D else 0.5 - 0.5 * np.sin(0.5 * math.pi * (r - R) / D)


def tersoff(d: np.ndarray, species: list[str], entries: dict) -> complex:
    """Eqs. (1)-(9)."""
    r, n, energy = lengths(d), len(d), 0.0
    for i in range(n):
        bonds = [entries[f"{species[i]}-{species[j]}-{species[j]}"] for j in range(n)]
        reach = [bond["R"] + bond["D"] for bond in bonds]
        near = [j for j in range(n) if j != i]
        for j in near:
            if r[i, j].real >= reach[j]:
                continue
            p = bonds[j]
            zeta = 0.0
            for k in near:
                if k == j:
                    continue
                t = entries[f"{species[i]}-{species[j]}-{species[k]}"]
                away = t["cos_theta0"] - (d[i, j] * d[i, k]).sum() / (r[i, j] * r[i, k])
                angle = t["gamma"] * (1 + t["c"] ** 2 / t["d"] ** 2 - t["c"] ** 2 / (t["d"] ** 2 + away**2))
                stretch = (t["lambda3"] * (r[i, j] - r[i, k])) ** t["m"]
                zeta += smooth_cutoff(r[i, k], t["R"], t["D"]) * angle * np.exp(stretch)
            power = (p["beta"] * zeta) ** p["n"] if zeta != 0.0 else 0.0
            order = (1.0 + power) ** (-0.5 / p["n"])
            both = p["A"] * np.exp(-p["lambda1"] * r[i, j]) - order * p["B"] * np.exp(-p["lambda2"] * r[i, j])
            energy += 0.5 * smooth_cutoff(r[i, j], p["R"], p["D"]) * both
    return energy


def hermite(values: np.ndarray, spacing: float, at: complex) -> complex:
    """The cubic of LAMMPS' manual between equally spaced values: slopes are differences over five points."""
    n = len(values)
    m = min(int(at.real / spacing), n - 2)
    p = at / spacing - m

    def tangent(k: int) -> float:
        if k in (0, n - 1):
            return values[1] - values[0] if k == 0 else values[-1] - values[-2]
        if k in (1, n - 2):
            return 0.5 * (values[k + 1] - values[k - 1])
        return (values[k - 2] - 8 * values[k - 1] + 8 * values[k + 1] - values[k + 2]) / 12

    f, g, s, t = values[m], values[m + 1], tangent(m), tangent(m + 1)
    # Hermite's four basis functions
    return (
        f * (1 + 2 * p) * (1 - p) ** 2 + s * p * (1 - p) ** 2 + g * p**2 * (3 - 2 * p) + t * p**2 * (p - 1)
    )  # fmt: skip


def embedded_atom(d: np.ndarray, species: list[str], tables: dict) -> complex:
    """``tables``: cutoff, dr, drho, embedding {element}, density {(at, from)}, rphi {(one, other)}; the embedding
    energies may begin at the density ``first``."""
    r, n, energy = lengths(d), len(d), 0.0
    for i in range(n):
        density = 0.0
        for j in range(n):
            if i == j or r[i, j].real >= tables["cutoff"]:
                continue
            density += hermite(tables["density"][species[i], species[j]], tables["dr"], r[i, j])
            energy += 0.5 * hermite(tables["rphi"][species[i], species[j]], tables["dr"], r[i, j]) / r[i, j]
        energy += hermite(tables["embedding"][species[i]], tables["drho"], complex(density) - tables.get("first", 0.0))
    return energy
