"""A System from a run's file equals the System of the run."""

from __future__ import annotations

import sys
import types

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.forces.seam import named
from kickdrift.model.events.events import Escape
from kickdrift.systemfile.files import shipped
from kickdrift.systemfile.reading import load
from kickdrift.trajectory.layout.record import differences, system_of
from kickdrift.trajectory.write.h5md import Writer

SYSTEMS = [name for name in shipped() if isinstance(load(name), kd.System)]


def written(path, system):
    """Write the file of a run of this system, and return the System from the file."""
    with Writer(path, system, method={}, every=1):
        pass
    with kd.open(path) as run:
        found = system_of(run)
        assert differences(found, run) == []
        return found


def same(first, second):
    for key in ("name", "forces", "units", "names", "species", "run", "equilibration", "source", "seed", "events"):
        assert getattr(first, key) == getattr(second, key), key
    assert dict(first.invariants) == dict(second.invariants)
    assert first.state.phase.tobytes() == second.state.phase.tobytes()
    for key in ("masses", "ids", "box", "time", "steps_done"):
        np.testing.assert_array_equal(getattr(first.state, key), getattr(second.state, key))
    np.testing.assert_array_equal(first.species_index, second.species_index)
    np.testing.assert_array_equal(first.radii, second.radii)


@pytest.mark.parametrize("name", SYSTEMS)
def test_every_system_that_ships_comes_back(tmp_path, name):
    system = load(name)
    same(system, written(tmp_path / "a.h5md", system))


def test_what_a_file_of_text_has_no_key_for_comes_back(tmp_path):
    pairs = {("A", "B"): {"epsilon": 0.5}, ("B", "B"): {"sigma": 1.1}}
    force = kd.LennardJones(species={"A": {}, "B": {"epsilon": 0.3}}, pairs=pairs, truncation="switch")
    system = kd.System(np.eye(3) * 2, box=(9.0, 9.0, 9.0), species="ABA", forces=[force], names=["x", "y", "z"])
    system = system.at(system.state.phase, 3.25, 17, np.array([4, 2, 9]))
    same(system, written(tmp_path / "a.h5md", system))
    events = [
        kd.Collision({"x": 0.1}),
        kd.CloseApproach(1.0, ["x", "z"]),
        kd.Crossing.pericentre("x", "y"),
        Escape(50.0),
    ]
    system = kd.System(np.eye(3), forces=[kd.Gravity()], units="nbody", names=["x", "y", "z"], events=events)
    same(system, written(tmp_path / "b.h5md", system))


def test_a_force_of_ones_own_is_found_where_it_was_registered(tmp_path, monkeypatch):
    module = types.ModuleType("somebodys_forces")
    monkeypatch.setitem(sys.modules, module.__name__, module)

    class Trap(kd.HarmonicTrap):
        pass

    module.Trap, Trap.__module__, Trap.__qualname__ = Trap, module.__name__, "Trap"
    system = kd.System(np.eye(3), forces=[Trap(2.0)])
    with pytest.raises(InputError, match=r"force Trap belongs to module somebodys_forces, which is not loaded"):
        written(tmp_path / "b.h5md", system)  # importing a class does not register it
    monkeypatch.setattr(named, "REGISTERED", {})
    assert kd.register_force(Trap) is Trap
    same(system, written(tmp_path / "a.h5md", system))
    with pytest.raises(InputError, match="register_force: expected a dataclass with name, check and bind"):
        kd.register_force(dict)


def test_a_function_cannot_come_back(tmp_path):
    system = kd.System(
        np.eye(3), forces=[kd.Gravity()], units="nbody", events=[kd.Crossing(lambda t, x, v: t - 1, "one")]
    )
    with pytest.raises(InputError, match="event 'one' has a function"):
        written(tmp_path / "a.h5md", system)


def test_differences_are_named(tmp_path):
    first = load("lj-1000")
    written(tmp_path / "a.h5md", first)
    with kd.open(tmp_path / "a.h5md") as run:
        assert differences(load("lj-1000", seed=5), run) == ["velocities"]
        assert differences(first.under([kd.LennardJones(cutoff=2.4)]), run) == ["forces"]
        assert "particles" in differences(load("two-body"), run)
