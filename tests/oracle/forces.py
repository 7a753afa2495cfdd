"""The oracle: forces, energies and virials in plain NumPy, slow and obvious, written from the definitions alone.

Every pair of particles is visited, at its minimum image. Nothing here comes from the compiled kernels: parameters are
read from the force as the user gave them, and mixing and truncation are written out again.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
from scipy.special import beta, betainc

from kickdrift.forces import DrivenField, Gravity, HarmonicTrap, LinearDrag, Springs, UniformField
from kickdrift.model.system import System


class Pairs(NamedTuple):
    """Interacting pairs, one entry each."""

    i: np.ndarray
    j: np.ndarray
    separation: np.ndarray  # (pairs, 3) from j to i, minimum image
    r: np.ndarray
    energy: np.ndarray
    force: np.ndarray  # -dU/dr: positive where i and j repel


def pair_oracle(system: System, time: float = 0.0) -> tuple[np.ndarray, float, float, int]:
    """Forces (n, 3), potential energy, virial (the sum of r . F over pairs) and number of interacting pairs."""
    forces, energy, virial, count = np.zeros((len(system), 3)), 0.0, 0.0, 0
    for force in system.forces:
        if isinstance(force, HarmonicTrap | UniformField | DrivenField | LinearDrag):
            field_forces, field_energy = field(force, system, time)
            forces += field_forces
            energy += field_energy
            continue
        p = interacting_pairs(force, system)
        on_i = np.divide(p.force, p.r, out=np.zeros_like(p.r), where=p.r > 0)[:, None] * p.separation
        np.add.at(forces, p.i, on_i)
        np.add.at(forces, p.j, -on_i)
        tail_energy, tail_virial = tail(force, system)
        energy += p.energy.sum() + tail_energy
        virial += (p.force * p.r).sum() + tail_virial
        count += len(p.r)
    return forces, energy, virial, count


def interacting_pairs(force, system: System) -> Pairs:
    """Energy and force of each pair."""
    x, m = system.state.positions, system.state.masses
    i, j = np.triu_indices(len(x), k=1) if not isinstance(force, Springs) else np.array(force.pairs).T
    if isinstance(force, Gravity):
        attracts = (m[i] > 0) | (m[j] > 0)
        i, j = i[attracts], j[attracts]
    separation = x[i] - x[j]
    separation = nearest_image(system.box, separation)
    r = np.sqrt((separation**2).sum(axis=1))
    if isinstance(force, Gravity):
        return Pairs(i, j, separation, r, *gravity(force, system, i, j, r))
    if isinstance(force, Springs):
        k, stretch = np.array(force.stiffness), r - np.array(force.length)
        return Pairs(i, j, separation, r, 0.5 * k * stretch**2, -k * stretch)
    near = (separation**2).sum(axis=1) < force.cutoff**2
    i, j, separation, r = i[near], j[near], separation[near], r[near]
    epsilon, sigma = mixed_parameters(force, system)
    a, b = system.species_index[i], system.species_index[j]
    energy, radial = truncated_lennard_jones(force, r, epsilon[a, b], sigma[a, b])
    return Pairs(i, j, separation, r, energy, radial)


def nearest_image(box, separation: np.ndarray) -> np.ndarray:
    """Nearest image of each separation (m, 3), among images by up to two of each edge vector."""
    rows = box.matrix * np.array(box.periodic_axes)[:, None]
    for k in (2, 1, 0):
        if rows[k, k]:
            separation = separation - np.round(separation[:, [k]] / rows[k, k]) * rows[k]
    if not box.triclinic:
        return separation
    nearest = separation
    for whole in itertools.product(range(-2, 3), repeat=3):
        image = separation + np.array(whole) @ rows
        nearest = np.where(((image**2).sum(axis=1) < (nearest**2).sum(axis=1))[:, None], image, nearest)
    return nearest


def pair_slopes(system: System, deviations: np.ndarray) -> np.ndarray:
    """Derivatives (n, 3) of the forces of a pair law along deviations (n, 3) of the positions, by a complex step
    (Squire & Trapp 1998, doi:10.1137/S003614459631241X), exact to rounding. Scaled pairs count with their factor."""
    (force,), step = system.forces, 1e-30
    p = interacting_pairs(force, system)
    a, b = system.species_index[p.i], system.species_index[p.j]
    epsilon, sigma = mixed_parameters(force, system)
    moved = p.separation + 1j * step * (deviations[p.i] - deviations[p.j])
    r = np.sqrt((moved**2).sum(axis=1))
    radial = truncated_lennard_jones(force, r, epsilon[a, b], sigma[a, b])[1]
    factor = np.ones((len(system), len(system)))
    if system.topology is not None:
        scaled, values = system.topology.scaled
        factor[scaled[:, 0], scaled[:, 1]] = values
    slopes, found = ((factor[p.i, p.j] * radial / r)[:, None] * moved).imag / step, np.zeros((len(system), 3))
    np.add.at(found, p.i, slopes)
    np.add.at(found, p.j, -slopes)
    return found


def lennard_jones(r, epsilon, sigma):
    """U = 4 epsilon ((sigma/r)^12 - (sigma/r)^6) and -dU/dr."""
    q = (sigma / r) ** 6
    return 4.0 * epsilon * (q * q - q), 24.0 * epsilon * (2.0 * q * q - q) / r


def truncated_lennard_jones(force, r, epsilon, sigma):
    """Truncated energy and -dU/dr below the cutoff."""
    energy, radial = lennard_jones(r, epsilon, sigma)
    energy_at_cutoff, radial_at_cutoff = lennard_jones(force.cutoff, epsilon, sigma)
    if force.truncation == "cut":
        return energy, radial
    if force.truncation == "shift":
        return energy - energy_at_cutoff, radial
    if force.truncation == "force-shift":  # U - U_c - (r - r_c) U'_c
        return energy - energy_at_cutoff + (r - force.cutoff) * radial_at_cutoff, radial - radial_at_cutoff
    if force.truncation == "switch":  # U S; the smooth step of degree nine is the incomplete beta function I_u(5, 5)
        start = 0.8 * force.cutoff if force.switch_start is None else force.switch_start
        width = force.cutoff**2 - start**2
        u = (r * r - start**2) / width
        u = np.where(u.real <= 0.0, 0.0, np.where(u.real >= 1.0, 1.0, u))
        s, ds_du = 1.0 - betainc(5, 5, u.real), -(u**4) * (1.0 - u) ** 4 / beta(5, 5)
        s = s + 1j * u.imag * ds_du.real if np.iscomplexobj(u) else s  # a complex step
        return energy * s, radial * s - energy * ds_du * 2.0 * r / width
    if force.truncation == "potential-switch":
        start = 0.8 * force.cutoff if force.switch_start is None else force.switch_start
        u = (r - start) / (force.cutoff - start)
        u = np.where(u.real <= 0.0, 0.0, np.where(u.real >= 1.0, 1.0, u))
        s, ds_du = 1.0 - 10.0 * u**3 + 15.0 * u**4 - 6.0 * u**5, -30.0 * u**2 * (1.0 - u) ** 2
        return energy * s, radial * s - energy * ds_du / (force.cutoff - start)
    raise ValueError(force.truncation)


def mixed_parameters(force, system: System) -> tuple[np.ndarray, np.ndarray]:
    """epsilon and sigma for each two species: the values for the pair if given, else the Lorentz-Berthelot means."""
    names = system.species
    epsilon, sigma = np.empty((2, len(names), len(names)))
    for a, first in enumerate(names):
        for b, second in enumerate(names):
            own = [(force.species or {}).get(name, {}) for name in (first, second)]
            e = [given.get("epsilon", force.epsilon) for given in own]
            s = [given.get("sigma", force.sigma) for given in own]
            epsilon[a, b], sigma[a, b] = np.sqrt(e[0] * e[1]), (s[0] + s[1]) / 2
            for pair in ((first, second), (second, first)):
                if pair in (force.pairs or {}):
                    epsilon[a, b] = force.pairs[pair].get("epsilon", force.epsilon)
                    sigma[a, b] = force.pairs[pair].get("sigma", force.sigma)
    return epsilon, sigma


def tail(force, system: System) -> tuple[float, float]:
    """Energy and virial of a uniform fluid beyond the cutoff: 2 pi N_a N_b / V times integrals of U r^2 and -U' r^3."""
    if not getattr(force, "tail", False):
        return 0.0, 0.0
    epsilon, sigma = mixed_parameters(force, system)
    counts = np.bincount(system.species_index)
    density = 2.0 * np.pi * np.outer(counts, counts) / system.box.volume
    twelve, six = sigma**12 / (9 * force.cutoff**9), sigma**6 / (3 * force.cutoff**3)
    return (density * 4 * epsilon * (twelve - six)).sum(), (density * 24 * epsilon * (2 * twelve - six)).sum()


def field(force, system: System, time: float) -> tuple[np.ndarray, float]:
    """Forces (n, 3) and potential energy of a field."""
    x, v, m = system.state.positions, system.state.velocities, system.coherent_masses[:, None]
    if isinstance(force, HarmonicTrap):
        k, d = np.array(force.stiffness), x - np.array(force.centre)
        return -k * d, (0.5 * k * d**2).sum()
    if isinstance(force, LinearDrag):
        return -force.rate * m * v, 0.0
    if isinstance(force, DrivenField):
        g = np.array(force.amplitude) * np.cos(2 * np.pi * force.frequency * time + force.phase)
    else:
        g = np.array(force.acceleration)
    return m * g, -(m * g * x).sum()


def gravity(force: Gravity, system: System, i, j, r):
    """U = -G m m' / sqrt(r^2 + softening^2) and -dU/dr."""
    constant = force.G if force.G is not None else system.units.gravity
    gmm = constant * system.state.masses[i] * system.coherent_masses[j]  # G belongs to the users' unit of mass
    softened = np.sqrt(r * r + force.softening**2)
    return -gmm / softened, -gmm * r / softened**3


def gravity_accelerations(system: System) -> np.ndarray:
    """Accelerations (n, 3) by direct gravity, including those of massless particles."""
    force, x, m = system.forces[0], system.state.positions, system.state.masses
    constant = force.G if force.G is not None else system.units.gravity
    a = np.zeros_like(x)
    for i in range(len(x)):
        attracts = (m > 0) & (np.arange(len(x)) != i)
        d = x[attracts] - x[i]
        r2 = (d**2).sum(axis=1) + force.softening**2
        a[i] = (constant * m[attracts, None] * d / r2[:, None] ** 1.5).sum(axis=0)
    return a
