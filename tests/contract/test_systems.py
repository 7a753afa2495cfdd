"""Contract tests: every shipped system of particles has a title, starts with the invariants in its file, and runs with
its own defaults. Shipped ODEs are in tests/unit/model/test_odes.py."""

from __future__ import annotations

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.systemfile.files import describe, shipped
from tests.long import shortened

SYSTEMS = [name for name in shipped() if isinstance(kd.load(name), kd.System)]
STATED = [name for name in SYSTEMS if isinstance(kd.load(name).invariants.get("energy"), float)]  # as numbers
# Those with compiled code of their own are in the long set: sites, two kinds of particles, chains.
COMPILED = ("tip4p2005-500", "kob-andersen-1000", "kremer-grest-1000")


@pytest.mark.parametrize("name", SYSTEMS)
def test_a_shipped_system_says_what_it_is(name):
    assert describe(shipped()[name]).title
    stated = kd.load(name).invariants
    assert stated.get("source") or not stated


@pytest.mark.parametrize("name", shortened(STATED, {*STATED} - {*COMPILED}))
def test_a_shipped_system_starts_with_its_invariants(name):
    system = kd.load(name)
    sample = kd.Simulation(system).sample()
    assert sample.energies.total == pytest.approx(
        system.invariants["energy"], rel=1e-10
    )  # some files state eleven digits
    x, v, m = system.state.positions, system.state.velocities, system.coherent_masses[:, None]
    sizes = {"momentum": np.abs(m * v).sum(), "angular_momentum": np.abs(m * np.cross(x, v)).sum()}
    for key, size in sizes.items():
        if key in system.invariants:
            np.testing.assert_allclose(getattr(sample, key), system.invariants[key], rtol=1e-12, atol=1e-14 * size)


@pytest.mark.parametrize("name", shortened(SYSTEMS, {*SYSTEMS} - {*COMPILED}))
def test_a_shipped_system_runs_with_its_defaults(name):
    report = kd.Simulation(kd.load(name)).run(2)
    assert report.steps == 2
