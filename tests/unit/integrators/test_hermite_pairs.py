"""hermite4 with regularised pairs: orbits under tides, changes and their events, bits, looks, and refused runs."""

from __future__ import annotations

import math

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError

OPTIONS = {"pairs": "regularised"}  # in block steps


def binary(axis: float, e: float, mass: float) -> tuple[np.ndarray, np.ndarray]:
    """Two bodies of masses 3 : 1 at apocentre, about their centre of mass."""
    d, t = np.array([0.6, 0.0, 0.8]), np.array([0.0, 1.0, 0.0])
    r, u = axis * (1 + e), math.sqrt(mass * (1 - e) / (axis * (1 + e)))
    share = np.array([-0.25, 0.75])[:, None]
    return share * r * d, share * u * t


def few(axis: float = 0.02, e: float = 0.6, massless: bool = True) -> kd.System:
    """A binary, two stars on wide orbits about it, and a massless body near it, last but one of the five."""
    x, v = binary(axis, e, 1.0)
    others = [[1.0, 0.0, 0.1], [0.1, 0.12, 0.0], [-1.2, 0.3, 0.0]]
    speeds = [[0.0, 1.1, 0.0], [-1.8, 1.6, 0.5], [0.1, -0.9, 0.2]]
    masses = [0.75, 0.25, 0.4, 0.0, 0.3] if massless else [0.75, 0.25, 0.4, 0.01, 0.3]
    return kd.System(
        np.vstack([x, others]), np.vstack([v, speeds]), masses, forces=[kd.Gravity(G=1.0)], units="nbody", name="few"
    )


def visitor(speed: float = 0.5) -> kd.System:
    """A binary and a star that comes, breaks the pair up, and takes the heavier body from it."""
    x, v = binary(0.1, 0.3, 1.0)
    x, v = np.vstack([x, [1.5, 0.9, 0.0]]), np.vstack([v, [-speed, -speed / 4, 0.0]])
    return kd.System(x, v, [0.75, 0.25, 1.0], forces=[kd.Gravity(G=1.0)], units="nbody", name="visitor")


def simulation(system: kd.System, eta: float = 0.002, **how) -> kd.Simulation:
    return kd.Simulation(system, "hermite4", eta=eta, **OPTIONS, **how)


@pytest.mark.parametrize("massless", [True, False])
def test_all_bodies_move_as_under_another_method(massless):
    """Also the phase of the pair's orbit, after 112 periods, and a body that feels the pair's two bodies apart."""
    system = few(massless=massless)
    fine, other = simulation(system, eta=1e-4), kd.Simulation(system, "gauss-radau15")
    for sim in (fine, other):
        sim.run(until=2.0)
    assert fine.report().pairs.bodies == [(0, 1)]
    assert fine.state.phase == pytest.approx(other.state.phase, abs=3e-7 if massless else 3e-6)
    assert fine.report().energy.max_relative_error < 1e-9


def test_two_pairs_feel_all_four_bodies():
    """With centres of mass for the other pair's bodies, the energy error would be 1.6e-6 at any eta."""
    x, v = binary(0.1, 0.6, 1.0)
    y, w = binary(0.08, 0.3, 0.8)
    x, v = np.vstack([x, y + np.array([3.0, 0.0, 0.0])]), np.vstack([v, w + np.array([0.0, 0.6, 0.0])])
    system = kd.System(x, v, [0.75, 0.25, 0.6, 0.2], forces=[kd.Gravity(G=1.0)], units="nbody", name="four")
    fine, other = simulation(system, 0.000625), kd.Simulation(system, "gauss-radau15")
    report = fine.run(until=20.0, interval=0.1)
    other.run(until=20.0)
    assert report.pairs.bodies == [(0, 1), (2, 3)]
    assert report.energy.max_relative_error < 1e-8
    assert fine.state.phase == pytest.approx(other.state.phase, abs=1e-5)


def test_a_pair_alone_takes_any_number_of_periods_in_a_step():
    x, v = binary(0.1, 0.6, 1.0)
    sim = simulation(kd.System(x, v, [0.75, 0.25], forces=[kd.Gravity(G=1.0)], units="nbody"))
    report = sim.run(until=1e4, interval=100.0)
    assert sim.steps_done < 100
    assert report.energy.max_relative_error < 1e-12


def test_errors_fall_with_eta():
    errors = []
    for eta in (0.01, 0.000625):
        report = simulation(few(), eta).run(until=2.0, interval=0.01)
        errors.append(report.energy.max_relative_error)
    assert errors[0] < 1e-6
    assert errors[1] < errors[0] / 30


def test_changes_are_events_and_cost_no_energy():
    """The visitor takes the heavier body's place, as under another method."""
    sim, other = simulation(visitor(), 0.000625), kd.Simulation(visitor(), "gauss-radau15")
    report = sim.run(until=6.0, interval=0.01)
    formed, broken = ([each for each in sim.events if each["kind"] == f"pair-{kind}"] for kind in ("formed", "broken"))
    assert (report.pairs.formed, report.pairs.broken) == (len(formed), len(broken)) == (2, 1)
    assert [each["time"] for each in sim.events] == sorted(each["time"] for each in sim.events)
    assert formed[0]["bodies"] == ["particle 0", "particle 1"]
    assert formed[0]["time"] == 0.0
    assert "a = 0.1, e = 0.3" in formed[0]["done"]
    assert 0 < broken[0]["step"] < formed[1]["step"] <= sim.steps_done
    assert formed[1]["bodies"] == ["particle 1", "particle 2"]
    assert report.energy.max_relative_error < 1e-7
    other.run(until=6.0)
    assert sim.state.phase == pytest.approx(other.state.phase, abs=2e-4)
    assert "pairs             1 pair now; 2 formed, 1 broken up" in str(report)
    assert report.as_json()["pairs"]["formed"] == 2


def test_bits_do_not_depend_on_cuts_looks_threads_and_checkpoints(tmp_path):
    whole = simulation(visitor())
    whole.run(until=6.0)
    middle = whole.events[1]["time"]
    looked = simulation(visitor(), threads=2)
    looked.run(until=middle, interval=0.0213, output=tmp_path / "run.h5md")
    other = simulation(visitor())
    other.restore(looked.checkpoint())
    resumed = kd.resume(tmp_path / "run.h5md")
    for sim in (looked, other, resumed):
        sim.run(until=6.0)
        np.testing.assert_array_equal(sim.state.phase, whole.state.phase)
        assert sim.events == whole.events
    assert [each["kind"] for each in kd.open(tmp_path / "run.h5md").events] == [each["kind"] for each in whole.events]


def test_a_run_back_in_time_returns():
    sim = simulation(few(), eta=1e-4)
    sim.run(until=0.5)
    sim.run(until=0.0)
    assert sim.report().pairs.bodies == [(0, 1)]
    assert [(each["kind"], each["time"]) for each in sim.events] == [("pair-formed", 0.5)]
    assert sim.state.phase == pytest.approx(few().state.phase, abs=1e-6)


def test_a_state_put_in_place_forgets_pairs():
    sim = simulation(visitor())
    sim.run(until=1.0)
    sim.state = visitor().state
    assert sim.report().pairs.formed == 0
    sim.run(until=1.0)
    again = simulation(visitor())
    again.run(until=1.0)
    np.testing.assert_array_equal(sim.state.phase, again.state.phase)


@pytest.mark.parametrize(
    ("key", "value"),
    [("tally", [2, 1, 0, 0]), ("tally", [1, 1, 0, 5]), ("partner", [1, 2, -1]), ("nears", [1000]), ("near", -1)],
)
def test_a_checkpoint_whose_pairs_make_no_sense_is_refused(key, value):
    sim = simulation(visitor())
    sim.run(until=0.1)
    checkpoint = sim.checkpoint()
    checkpoint["stepper"][key][...] = value
    with pytest.raises(InputError, match="checkpoint: pairs do not fit the bodies of this system"):
        simulation(visitor()).restore(checkpoint)


@pytest.mark.parametrize(
    ("options", "events", "softening", "message"),
    [
        ({"pairs": "ks"}, [], 0.0, "pairs 'ks' is unknown; known are plain, regularised"),
        (
            {"pairs": "regularised", "scheme": "shared"}, [], 0.0,
            "pairs: are regularised in block steps alone, got scheme = shared",
        ),
        (
            {"pairs": "regularised", "dt": 0.1}, [], 0.0,
            "dt: fixes the step of hermite4; give either dt, or eta, scheme and pairs",
        ),
        (OPTIONS, [], 0.1, "pairs: orbits of pairs need gravity with softening = 0, got 0.1"),
        (OPTIONS, [kd.CloseApproach(0.1)], 0.0, "pairs: one step of a regularised pair may be many orbits, in which"),
    ],
)  # fmt: skip
def test_what_it_cannot_run(options, events, softening, message):
    system = few()
    system = kd.System(
        system.state.positions, system.state.velocities, system.state.masses, forces=[kd.Gravity(1.0, softening)],
        units="nbody",
    )  # fmt: skip
    with pytest.raises(InputError) as caught:
        kd.Simulation(system, "hermite4", events=events, **options)
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)


def test_bodies_in_one_place_are_refused():
    x = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    system = kd.System(x, masses=np.ones(3), forces=[kd.Gravity()], units="nbody")
    with pytest.raises(InputError, match=r"^positions: particles 0 and 2 are at the same place, distance 0$"):
        simulation(system).run(1)
