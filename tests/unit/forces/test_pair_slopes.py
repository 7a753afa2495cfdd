"""Derivatives of pair laws on neighbour lists: beside a complex step of the plain NumPy oracle, and along runs."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.forces.bound import BoundForces
from kickdrift.forces.pair_law import TRUNCATIONS
from kickdrift.forces.variations import varied
from tests.long import shortened
from tests.oracle.forces import pair_slopes
from tests.systems import PAIRS, SPECIES, liquid

ALONG = 18  # more than the compiled code takes at once


def system_of(truncation: str, mixed: bool, leaning: bool, chained: bool) -> kd.System:
    """60 particles in a small box."""
    rng, n, edge = np.random.default_rng(4), 60, 5.2
    sites = np.indices((4, 4, 4)).reshape(3, -1).T[:n] * edge / 4
    x = sites + rng.uniform(-0.15, 0.15, (n, 3))
    options = {"species": SPECIES, "pairs": PAIRS} if mixed else {"epsilon": 1.3, "sigma": 0.95}
    force = kd.LennardJones(cutoff=2.5, truncation=truncation, **options)
    chains = kd.Topology.chains(15, 4, factors=(0.0, 0.4, 1.0)) if chained else None
    box = kd.Box.from_vectors([[edge, 0, 0], [1.1, edge, 0], [-0.8, 0.9, edge]]).box if leaning else kd.Box([edge] * 3)
    species = [*"AB", *rng.choice(list("ABC"), n - 2)] if mixed else None
    masses = rng.uniform(0.5, 2.0, n)
    return kd.System(x, rng.normal(size=x.shape), masses, box, [force], topology=chains, species=species)


CASES = [(truncation, *kind) for truncation in TRUNCATIONS for kind in ((0, 0, 0), (1, 0, 0), (1, 1, 1))]


@pytest.mark.parametrize(("truncation", "mixed", "leaning", "chained"), shortened(CASES, [("switch", 1, 0, 0)]))
def test_slopes_are_those_of_the_oracle(truncation, mixed, leaning, chained):
    system = system_of(truncation, mixed, leaning, chained)
    n, deviations = len(system), np.random.default_rng(5).normal(size=(2, 3, len(system), ALONG))
    made = varied(system, deviations.reshape(2, 3, -1))
    found = BoundForces(made).measure(0.0, made.state.phase).accelerations
    plain = BoundForces(system).measure(0.0, system.state.phase)
    np.testing.assert_array_equal(found[:, :n], plain.accelerations)
    assert plain.pairs > 10 * n
    slopes = found[:, n:].reshape(3, n, ALONG)
    for k in range(ALONG):
        wanted = pair_slopes(system, deviations[0, :, :, k].T).T / system.state.masses
        np.testing.assert_allclose(slopes[..., k], wanted, rtol=0, atol=1e-13 * np.abs(wanted).max())
