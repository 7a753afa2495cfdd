"""Events of systems in lanes against single runs; lanes that become free; the way back."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.batch import lane_events
from kickdrift.batch.batch import Batch
from kickdrift.ensemble.rows import run_columns
from kickdrift.errors import InputError

MET = kd.CloseApproach(0.5, hill=True, action="stop")
TOUCH = kd.Collision(radii=0.1, action="stop")
FAR = kd.Escape(60.0, action="stop")
DT = 2.5


def giants(seed: int, *events: kd.Event, mass: float = 1e-3) -> kd.System:
    """A star and three giants too close to each other, the star not always first."""
    rng = np.random.default_rng(seed)
    x, v = np.zeros((2, 4, 3))
    for k, a in enumerate((5.0, 6.2, 7.8), 1):
        angle, speed = rng.uniform(0.0, 2.0 * np.pi), np.sqrt(1.0 / a) * rng.uniform(0.97, 1.03)
        x[k] = a * np.cos(angle), a * np.sin(angle), 0.02 * rng.normal()
        v[k] = -speed * np.sin(angle), speed * np.cos(angle), 0.0
    order = np.roll(np.arange(4), seed % 2)
    m = np.array([1.0, *[mass] * 3])
    found = kd.System(x[order], v[order], m[order], forces=[kd.Gravity()], units="nbody", name=f"giants {seed}")
    return found.watched(events)


@pytest.mark.parametrize("events", [(MET,), (TOUCH, FAR)], ids=["met", "touch-far"])
def test_members_stop_as_alone(events):
    heavy = 1e-3 if MET in events else 1e-2
    systems = [giants(seed, *events, mass=heavy) for seed in range(9)]
    together = Batch(systems, "trace", DT)
    together.run(150, every=20)
    same = 0
    for i, system in enumerate(systems):
        sim = kd.Simulation(system, "trace", DT)
        alone, mine = asdict(sim.run(150, every=20)), asdict(together.report(i))
        state = together.states()[i]
        if sim.steps_done > 60:  # rounding has grown: only the kind of report is the same
            assert state.steps_done == (150 if not mine["stopped"] else mine["steps"])
            assert together.time[i] == mine["steps"] * DT
            continue
        same += 1
        assert run_columns(together.report(i))["stopped_by"] == (mine["events"][-1]["kind"] if mine["stopped"] else "")
        for key in ("stopped", "steps", "time", "samples"):
            assert mine[key] == alone[key], key
        assert [row["kind"] for row in mine["events"]] == [row["kind"] for row in alone["events"]]
        np.testing.assert_allclose(state.phase, sim.state.phase, rtol=1e-6, atol=1e-6)
        assert mine["energy"]["final"] == pytest.approx(alone["energy"]["final"], rel=1e-7)
    assert same >= 2


def test_lanes_that_become_free_are_taken(monkeypatch):
    systems = [giants(seed, MET) for seed in range(20)]
    whole = Batch(systems, "trace", DT)
    whole.run(200)
    monkeypatch.setattr(lane_events, "PIECE", 25)
    some = [*range(3, 20, 2), 0]
    packed = Batch([systems[i] for i in some], "trace", DT)
    for steps in (60, 40, 100):
        packed.run(steps)
    assert packed._stepper.blocks < 2
    assert packed.stopped == [whole.stopped[i] for i in some]
    np.testing.assert_array_equal(packed.phase, whole.phase[some])
    np.testing.assert_array_equal(packed.time, whole.time[some])
    assert [packed._stepper.evaluations_of(k) for k in range(len(some))] == [
        whole._stepper.evaluations_of(i) for i in some
    ]


def test_there_and_back():
    systems = [giants(seed) for seed in range(9)]
    there = Batch(systems, "trace", DT)
    there.run(40)
    assert max(there._stepper.evaluations_of(i) for i in range(9)) > 40  # some meet, in steps taken twice
    turned = [system.at(phase * [[[1.0]], [[-1.0]]], 0.0) for system, phase in zip(systems, there.phase, strict=True)]
    back = Batch(turned, "trace", DT)
    back.run(40)
    for system, phase in zip(systems, back.phase, strict=True):
        np.testing.assert_allclose(phase[0], system.state.phase[0], atol=1e-9)


@pytest.mark.parametrize(
    ("events", "integrator", "why"),
    [
        ((kd.CloseApproach(1.0),), "trace", 'with action = "stop" alone'),
        ((MET,), "wisdom-holman", "watches events with trace, not with wisdom-holman"),
        ((FAR, kd.Escape(9.0, about=0, action="stop")), "trace", "watches one escape"),
        ((kd.Escape(9.0, about=1, action="stop"),), "trace", "from particle 0 or from the centre of mass"),
        ((kd.Crossing.pericentre(1, 0),), "trace", 'with action = "stop" alone'),
    ],
)
def test_other_events_are_refused(events, integrator, why):
    with pytest.raises(InputError, match=why):
        Batch([giants(0, *events)], integrator, DT)
