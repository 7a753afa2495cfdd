"""`eos`: its map beside rebound's, its order, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.integrators.wisdom_holman.embedded import MAPS, embedded

NEAR = [{"name": f"n{k}", "mass": 1e-7, "a": 4.0 * 1.3**k, "e": 0.02, "f": 50.0 * k} for k in range(7)]
BODIES = [
    {"name": "b", "mass": 1e-3, "a": 1.0, "e": 0.05},
    {"name": "star", "mass": 1.0},
    {"name": "c", "mass": 1e-3, "a": 1.6, "e": 0.05, "f": 57.0},
    {"name": "d", "mass": 0.0, "a": 2.6},
]


def planets(forces=None, more=0):
    return kd.System.from_elements([BODIES[1], BODIES[0], *BODIES[2:], *NEAR[:more]], forces, units="nbody")


@pytest.mark.parametrize(
    ("phi0", "phi1", "substeps", "dt", "more"),
    [
        ("lf", "lf", 16, 0.06, 0), ("lf4", "lf4", 2, 0.02, 2), ("lf4_2", "lf6", 2, 0.05, 4),
        ("lf8_6_4", "lf8", 1, 0.05, 7),
        ("plf7_6_4", "pmlf4", 4, 0.02, 0), ("pmlf4", "pmlf6", 3, 0.02, 0), ("pmlf6", "plf7_6_4", 2, 0.02, 0),
    ],
)  # fmt: skip
def test_the_map_is_that_of_rebound(phi0, phi1, substeps, dt, more):
    """With three, five, seven and ten planets: one after another, in lanes, and by pairs; and with modified kicks."""
    pytest.importorskip("rebound")
    there = planets(more=more).to_rebound()
    there.integrator, there.dt = "eos", dt
    there.integrator.phi0, there.integrator.phi1, there.integrator.n = phi0, phi1, substeps
    there.steps(100)
    there.synchronize()
    sim = kd.Simulation(planets(more=more), "eos", dt=dt, phi0=phi0, phi1=phi1, substeps=substeps)
    sim.run(100)
    found = np.array([each.xyz for each in there.particles])
    np.testing.assert_allclose(sim.state.positions, found, rtol=0, atol=2e-13)


def test_compensated_sums_take_the_same_map_and_survive_a_restart(tmp_path):
    given = {"dt": 0.05, "phi0": "pmlf4", "phi1": "pmlf6"}
    plain, sim, whole = (
        kd.Simulation(planets(), "eos", compensated=compensated, **given) for compensated in (False, True, True)
    )
    plain.run(200)
    whole.run(200)
    assert np.abs(plain.state.phase - whole.state.phase).max() < 1e-12
    assert not np.array_equal(plain.state.phase, whole.state.phase)
    sim.run(77, output=tmp_path / "run.h5md")
    again = kd.resume(tmp_path / "run.h5md")
    again.run(123)
    np.testing.assert_array_equal(again.state.phase, whole.state.phase)


@pytest.mark.parametrize(
    ("name", "order"), [("lf", 2), ("lf4", 4), ("lf6", 6), ("lf8", 8), ("plf7_6_4", 4), ("pmlf4", 4), ("pmlf6", 6)]
)
def test_both_maps_have_their_order(name, order):
    exact = kd.Simulation(planets(), "gauss-radau15")
    exact.run(until=2.0, exact="shorten")
    errors = []
    for dt in (0.5, 0.25) if order == 8 else (0.2, 0.1):
        sim = kd.Simulation(planets(), "eos", dt=dt, phi0=name, phi1=name, substeps=1)
        sim.run(until=2.0)
        errors.append(np.abs(sim.state.phase - exact.state.phase).max())
    assert np.log2(errors[0] / errors[1]) > order - 0.6


def test_a_word_has_its_kicks_and_drifts():
    word, weights = embedded(MAPS["lf"], MAPS["lf"], 2)
    assert word == "A B0 A B0 A B1 A B0 A B0 A"
    assert weights == (0.125, 0.25, 0.25, 0.25, 0.125, 1.0, 0.125, 0.25, 0.25, 0.25, 0.125)


def test_other_forces_join_the_planets_kicks():
    def end(name, **given):
        sim = kd.Simulation(planets([kd.Gravity(), kd.UniformField((0.0, 0.1, 0.0))]), name, **given)
        sim.run(until=1.0, exact="shorten")
        return sim.state.phase

    found = end("eos", dt=0.02, phi0="lf4", phi1="lf4")
    np.testing.assert_allclose(found, end("gauss-radau15"), atol=1e-6)


@pytest.mark.parametrize(
    ("forces", "options", "message"),
    [
        ([kd.UniformField((0.0, 0.1, 0.0))], {}, "eos: needs one force 'gravity', and 'system' has none"),
        ([kd.Gravity(softening=0.1)], {}, "eos: needs gravity without softening"),
        (None, {"phi0": "lf5"}, "phi0 'lf5' is unknown; known are lf, lf4, lf6"),
        (None, {"substeps": 0}, "substeps must be"),
        ([kd.Gravity(), kd.LinearDrag(1e-3)], {}, "eos: needs accelerations"),
        (
            [kd.Gravity(), kd.UniformField((0.0, 0.1, 0.0))],
            {"phi0": "pmlf6"},
            "phi0: pmlf6 modifies the kicks by gravity, and 'uniform-field' has no such kick",
        ),
        (None, {"kernel": "lazy"}, "kernel: eos does not take it"),
    ],
)
def test_what_is_refused(forces, options, message):
    with pytest.raises(InputError, match=f"^{message}"):
        kd.Simulation(planets(forces), "eos", dt=0.1, **options)
