"""Lennard-Jones in plain NumPy, by direct sums over all pairs at their minimum images, and how rounding grows in it.

Nothing here comes from the compiled kernels. epsilon = sigma = 1; truncation "shift" (of the energy) or "cut".
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

import kickdrift as kd
from kickdrift_validation.claim import Claim, claim

FACTOR = 10.0  # between two differences that began as rounding; their logarithms scatter by 0.3


class Pairs(NamedTuple):
    """The pairs nearer than the cutoff, one entry each."""

    i: np.ndarray
    j: np.ndarray
    separation: np.ndarray  # (pairs, 3) from j to i
    r2: np.ndarray


class Direct(NamedTuple):
    """Energies (n,) and forces (n, 3) of the particles, half of a pair's energy to each, and the sum of r . F."""

    energies: np.ndarray
    forces: np.ndarray
    virial: float


def pairs(x: np.ndarray, edges: np.ndarray, cutoff: float) -> Pairs:
    """Pairs of particles at x (n, 3) in a periodic box."""
    i, j = np.triu_indices(len(x), k=1)
    separation = x[i] - x[j]
    separation -= edges * np.round(separation / edges)
    r2 = np.einsum("ij,ij->i", separation, separation)
    near = r2 < cutoff**2
    return Pairs(i[near], j[near], separation[near], r2[near])


def direct(x: np.ndarray, edges: np.ndarray, cutoff: float, truncation: str = "shift") -> Direct:
    """What particles at x feel."""
    n, (i, j, separation, r2) = len(x), pairs(x, edges, cutoff)
    inverse6 = r2**-3.0
    beyond = 4.0 * (cutoff**-12.0 - cutoff**-6.0) if truncation == "shift" else 0.0
    energy = 4.0 * inverse6 * (inverse6 - 1.0) - beyond
    along = 24.0 * inverse6 * (2.0 * inverse6 - 1.0)  # r . F
    energies = 0.5 * (np.bincount(i, energy, n) + np.bincount(j, energy, n))
    return Direct(energies, scattered(i, j, (along / r2)[:, None] * separation, n), float(along.sum()))


def scattered(i: np.ndarray, j: np.ndarray, on_i: np.ndarray, n: int) -> np.ndarray:
    """(n, 3): what pairs do to their first particle, and the opposite to their second."""
    return np.stack([np.bincount(i, on_i[:, k], n) - np.bincount(j, on_i[:, k], n) for k in range(3)], axis=1)


def pulled(x: np.ndarray, d: np.ndarray, edges: np.ndarray, cutoff: float) -> np.ndarray:
    """(n, 3): the change of the forces on particles at x that are moved by d, to first order. What a pair does that
    crosses the cutoff on the way is left out."""
    i, j, separation, r2 = pairs(x, edges, cutoff)
    inverse6 = r2**-3.0
    over_r = 24.0 * inverse6 * (2.0 * inverse6 - 1.0) / r2  # F / r
    slope = -48.0 * inverse6 * (14.0 * inverse6 - 4.0) / r2**2  # of F / r, over r
    between = d[i] - d[j]
    along = slope * np.einsum("ij,ij->i", separation, between)
    return scattered(i, j, along[:, None] * separation + over_r[:, None] * between, len(x))


def tangent(frames: np.ndarray, d: np.ndarray, dt: float, edges: np.ndarray, cutoff: float) -> np.ndarray:
    """(frames,) ln |d| at each of the frames (k, n, 3), one step of velocity Verlet apart: the linearised steps."""
    w, found, lost = np.zeros_like(d), [float(np.log(np.linalg.norm(d)))], 0.0
    a = pulled(frames[0], d, edges, cutoff)
    for x in frames[1:]:
        w = w + 0.5 * dt * a
        d = d + dt * w
        a = pulled(x, d, edges, cutoff)
        w = w + 0.5 * dt * a
        size = float(np.linalg.norm(d))
        found.append(float(np.log(size)) + lost)
        if size > 1e100:
            d, w, a, lost = d / size, w / size, a / size, lost + float(np.log(size))
    return np.array(found)


def nudged(x: np.ndarray, seed: int) -> np.ndarray:
    """x with every number moved by one rounding, up or down by chance."""
    ups = np.random.default_rng(seed).integers(0, 2, x.shape)
    return np.where(ups, np.nextafter(x, np.inf), np.nextafter(x, -np.inf))


def frames_of(sim: kd.Simulation, steps: int) -> np.ndarray:
    """(steps + 1, n, 3): positions from now on, after every step."""
    found: list[np.ndarray] = []
    sim.run(steps, every=1, observe=lambda sim: found.append(np.array(sim.state.positions)))
    return np.array(found)


def apart(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(frames,): the root mean square distance of the same particle in two runs."""
    return np.sqrt(((first - second) ** 2).sum(axis=2).mean(axis=1))


def parting(ours: np.ndarray, theirs: np.ndarray, own: list[np.ndarray], source: str, of: str = "") -> list[Claim]:
    """Claims on the frames of two programs: the first ones differ by rounding, later ones by what one rounding becomes
    in ``own``, distances of kickdrift from itself one rounding away."""
    rows, rounding, distances = [], float(np.spacing(np.abs(ours).max())), apart(ours, theirs)
    for k in (1, 10):
        off, bound = float(np.abs(ours[k] - theirs[k]).max()), (k + 1) * rounding
        reference = f"{source}; a rounding of the largest coordinate a step"
        rows.append(claim(f"positions{of} after {k} steps", off, f"at most {bound:.1e}", off <= bound, reference))
    for k in (100, 1000):
        off, largest = float(distances[k]), max(float(one[k]) for one in own)
        text = f"positions after {k} steps: {off:.1e} RMS, over what one rounding becomes"
        rows.append(claim(text, off / largest, f"at most {FACTOR:g}", off <= FACTOR * largest, source))
    return rows


def rate(size: np.ndarray, dt: float, begin: int) -> float:
    """The slope of ln size against the time, from frame ``begin`` on."""
    chosen = np.arange(begin, len(size))
    return float(np.polyfit(dt * chosen, np.log(size[chosen]), 1)[0])


def draw(target: Path, own: list[np.ndarray], curves: dict[str, np.ndarray], dt: float, title: str) -> Path:
    """The distances over time: of kickdrift and itself one rounding away, and of others by name."""
    from kickdrift.plots.drawing import COLOURS, new_axes, new_figure, save_figure

    figure = new_figure(8.0, 5.0)
    axes = new_axes(figure, (1, 1, 1))
    for k, one in enumerate(own):
        label = None if k else f"kickdrift and itself, one rounding away ({len(own)} times)"
        axes.plot(dt * np.arange(1, len(one)), one[1:], color=COLOURS[0], linewidth=0.8, alpha=0.6, label=label)
    for colour, (name, curve) in zip(COLOURS[1:], curves.items(), strict=False):
        axes.plot(dt * np.arange(1, len(curve)), curve[1:], color=colour, linewidth=1.8, label=name)
    axes.set_yscale("log")
    axes.set_xlabel("time (tau)")
    axes.set_ylabel("RMS distance (sigma)")
    axes.set_title(title)
    axes.legend(loc="lower right", fontsize=8, frameon=False)
    return save_figure(figure, target)
