"""Comparison of compiled pair forces with the oracle."""

from __future__ import annotations

import numpy as np

from kickdrift.forces.bound.forces import BoundForces
from tests.oracle.forces import interacting_pairs, lennard_jones, mixed_parameters, pair_oracle


def round_off(pairs, system):
    """Round-off of each pair's untruncated law near the cutoff, where the truncated law is small."""
    epsilon, sigma = mixed_parameters(system.forces[0], system)
    a, b = system.species_index[pairs.i], system.species_index[pairs.j]
    energy, force = lennard_jones(pairs.r, epsilon[a, b], sigma[a, b])
    return 1e-14 * (np.abs(energy) + np.abs(force))


def assert_right(system, bound=None, tolerance=1e-12):
    """Check that the compiled forces agree with the oracle, and return the measured values."""
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
