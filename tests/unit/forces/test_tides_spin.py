"""Tides whose spins evolve: state, files, restarts, conservation, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.systemfile.reading import loads

SPINS = [(0.0, 0.1, 0.7), (0.3, 0.0, 2.0)]
BODIES = [{"name": "Star", "mass": 1.0}, {"name": "Planet", "mass": 1e-2, "a": 1.0, "e": 0.2}]


def with_spins(events=(), **given):
    force = kd.TidesSpin(**{"k2": 0.3, "radius": [0.1, 0.05], "inertia": 0.25, "spin": SPINS, "tau": 0.01, **given})
    return kd.System.from_elements(BODIES, units="nbody").with_forces(kd.Gravity(), force).watched(list(events))


def test_orbit_and_spins_keep_their_angular_momentum():
    """The sum is formed here from the state, not by the code of samples."""

    def total(state):
        orbits = (state.masses[:, None] * np.cross(state.positions, state.velocities)).sum(axis=0)
        return orbits + state.spins @ (0.25 * state.masses * np.array([0.1, 0.05]) ** 2)

    sim = kd.Simulation(with_spins(), "gauss-radau15")
    before = total(sim.state)
    report = sim.run(until=20.0, interval=0.1)
    assert np.abs(sim.state.spins[:, 1] - SPINS[1]).max() > 1e-3
    np.testing.assert_allclose(total(sim.state), before, rtol=0, atol=1e-15)
    np.testing.assert_allclose(sim.sample().angular_momentum, total(sim.state), rtol=0, atol=1e-15)
    assert report.angular_momentum_error < 1e-14
    assert report.energy.max_relative_error < 1e-9
    assert report.energy.work["tides-spin"] < 0


def test_a_restart_and_a_file_hold_the_spins(tmp_path):
    path = tmp_path / "run.h5md"
    whole = kd.Simulation(with_spins(), "gauss-radau15")
    whole.run(40, every=10)
    half = kd.Simulation(with_spins(), "gauss-radau15")
    half.run(20, every=10, output=path)
    del half
    resumed = kd.resume(path)
    resumed.run(20, every=10, output=path)
    np.testing.assert_array_equal(resumed.state.spins, whole.state.spins)
    np.testing.assert_array_equal(resumed.state.phase, whole.state.phase)
    with kd.open(path) as run:
        assert run.observables["spins"].shape == (5, 2, 3)
        np.testing.assert_array_equal(run.observables["spins"][-1], whole.state.spins.T)
        np.testing.assert_array_equal(run.observables["spins"][0], SPINS)
        np.testing.assert_array_equal(run[-1].state.spins, whole.state.spins)
        again = kd.Simulation(run[-1].system, "gauss-radau15")
    np.testing.assert_array_equal(again.state.spins, whole.state.spins)


def test_an_export_names_the_spins_that_it_loses(tmp_path):
    path = tmp_path / "run.h5md"
    kd.Simulation(with_spins(), "gauss-radau15").run(4, output=path)
    pytest.importorskip("ase")
    assert "spins are lost" in kd.export(path, tmp_path / "run.extxyz").notes


def test_a_state_carries_its_spins():
    first = kd.Simulation(with_spins(), "gauss-radau15")
    first.run(until=3.0)
    other = kd.Simulation(with_spins(), "gauss-radau15")
    other.state = first.state
    np.testing.assert_array_equal(other.state.spins, first.state.spins)
    first.run(until=0.0)  # back in time
    np.testing.assert_allclose(first.state.spins.T, SPINS, atol=1e-11)


def test_a_run_stops_where_bodies_with_spins_meet():
    sim = kd.Simulation(with_spins([kd.Collision(radii=[0.5, 0.4], action="stop")]), "gauss-radau15")
    sim.run(until=7.0)
    assert sim.stopped.startswith("Star and Planet touch")


FILE = """
units = "astro"
[particles]
masses = [1.0, 1e-3]
positions = [[0, 0, 0], [0.05, 0, 0]]
[velocities]
values = [[0, 0, 0], [0, 28.0, 0]]
[[force]]
type = "gravity"
[[force]]
type = "tides-spin"
k2 = 0.3
radius = "60000 km"
inertia = 0.25
"""


def test_a_file_gives_units_and_names_what_is_missing():
    system = loads(FILE + 'spin = [[0, 0, "2.9e-6 s^-1"], [0, 0, 0]]\n')
    assert system.forces[1].spin[0][2] == pytest.approx(2.9e-6 * 365.25 * 86400, rel=1e-12)
    with pytest.raises(InputError, match="spin"):
        loads(FILE)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"spin": SPINS[:1]}, "tides-spin: spin: 1 values for 2 particles; particle 1 has none"),
        ({"inertia": [0.25, 0.0]}, "tides-spin: inertia: Planet has tides and no moment of inertia; give inertia"),
        ({"tau": -1.0}, "tides-spin: tau must be zero or more"),
        ({"flattening": "yes"}, "tides-spin: flattening: expected rotational or none"),
        ({"events": [kd.Collision(radii=0.1, action="merge")]}, "collision: action 'merge' cannot act on bodies"),
    ],
)
def test_what_is_refused(change, message):
    with pytest.raises(InputError, match=f"^{message}"):
        kd.Simulation(with_spins(**change), "gauss-radau15")


def test_methods_and_derivatives_without_spins_are_refused():
    with pytest.raises(InputError, match=r"wisdom-holman: needs .* 'tides-spin' depends on velocity"):
        kd.Simulation(with_spins(), "wisdom-holman", dt=0.1)
    with pytest.raises(InputError, match=r"^trace: moves bodies, and force 'tides-spin' also turns their spins"):
        kd.Simulation(with_spins(), "trace", dt=0.1)
    with pytest.raises(InputError, match=r"tides-spin.*no variational equations"):
        kd.transition_matrix(with_spins(), 1.0)
    state = kd.Simulation(with_spins(), "gauss-radau15").state
    with pytest.raises(InputError, match=r"state: expected finite spins of shape \(3, 2\)"):
        kd.Simulation(with_spins(), "gauss-radau15").state = kd.State(
            state.phase, state.masses, state.ids, spins=np.zeros((3, 5))
        )
