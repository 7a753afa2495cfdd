"""Compiled pair forces beside the oracle's."""

from __future__ import annotations

import numpy as np

from kickdrift.forces.bound import BoundForces
from tests.oracle.forces import interacting_pairs, lennard_jones, mixed_parameters, pair_oracle


def round_off(pairs, system):
    """What each pair's untruncated law may leave near the cutoff, where the truncated one is small."""
    epsilon, sigma = mixed_parameters(system.forces[0], system)
    a, b = system.species_index[pairs.i], system.species_index[pairs.j]
    energy, force = lennard_jones(pairs.r, epsilon[a, b], sigma[a, b])
    return 1e-14 * (np.abs(energy) + np.abs(force))


def assert_right(system, bound=None, tolerance=1e-12):
    """The compiled forces agree with the oracle; returns what was measured."""
    bound = bound or BoundForces(system)
    measured = bound.measure(0.0, system.state.phase)
    assert measured is not None
    forces, energy, virial, count = pair_oracle(system)
    assert measured.pairs == count
    got = (measured.accelerations * system.coherent_masses).T
    pairs = interacting_pairs(system.forces[0], system)
    least = round_off(pairs, system)
    assert np.abs(got - forces).max() <= tolerance * np.abs(forces).max() + least.max(initial=0.0)
    assert abs(measured.potential - energy) <= tolerance * np.abs(pairs.energy).sum() + least.sum()
    assert abs(measured.virial - virial) <= tolerance * np.abs(pairs.force * pairs.r).sum() + least.sum()
    return measured
