"""A layer in three dimensions: the run warns that its temperature counts a direction without motion."""

from __future__ import annotations

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.analysis import radial_distribution
from kickdrift.errors import InputError


def layer(axis=2, **more):
    rng = np.random.default_rng(4)
    x = np.insert(np.indices((4, 4)).reshape(2, -1).T * 1.2 + 0.3, axis, 2.0, axis=1)
    v = np.insert(rng.normal(size=(16, 2)), axis, 0.0, axis=1)
    forces = [kd.LennardJones(cutoff=1.5)]
    return kd.System(x, v, **{"box": (4.8,) * 3, "forces": forces, **more})


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_layer_is_warned_of(axis):
    report = kd.Simulation(layer(axis), dt=0.001).run(2)
    (warning,) = [line for line in report.warnings if "plane" in line]
    assert warning.startswith(f"all particles have {'xyz'[axis]} = 2 and never leave this plane")
    assert "give dimensions = 2" in warning


def test_two_dimensions_are_no_layer():
    system = layer(box=(4.8, 4.8), dimensions=2)
    assert not kd.Simulation(system, dt=0.001).run(2).warnings


def test_g_of_r_of_a_layer_in_a_periodic_box_is_refused():
    x = layer().state.positions
    with pytest.raises(InputError, match=r"radial_distribution: all particles have the same z.* dimensions = 2"):
        radial_distribution(x, (4.8,) * 3)


def test_factors_beside_gravity_alone_are_told():
    x = [[0, 0, 0], [1.2, 0, 0], [0, 1.2, 1.0]]
    topology = kd.Topology([(0, 1), (1, 2)], factors=(0, 0, 0.5))
    found = {}
    for name, forces in {"gravity": [kd.Gravity()], "both": [kd.Gravity(), kd.LennardJones(cutoff=2.0)]}.items():
        system = kd.System(x, forces=forces, units="nbody", topology=topology)
        found[name] = kd.Simulation(system, dt=0.001).run(1).warnings
    assert found["gravity"] == [
        "topology: factors and exclusions have no effect: they are about pair forces, and not gravity"
    ]
    assert not any("factors" in each for each in found["both"])
