"""Splitting methods are words over flows: a word registered by a user, and a flow that kickdrift does not have."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from scipy.linalg import expm

import kickdrift as kd
from kickdrift.errors import InputError, RunError
from kickdrift.forces.seam.kernel import BLOWN_UP, OK
from kickdrift.integrators import INTEGRATORS, integrator
from kickdrift.integrators.own.registration import unregister
from kickdrift.integrators.splitting.method import Splitting, even_weights
from kickdrift.integrators.splitting.subflows import FLOWS, Subflow
from kickdrift.integrators.stepping.subflow_code import BoundSubflow, subflow_body

FIELD = np.array([0.3, -0.2, 1.1])  # angular velocity of the rotation of every particle's velocity in a magnetic field


class Rotation(NamedTuple):
    """An angular velocity, and the first step at which the flow fails."""

    wx: float
    wy: float
    wz: float
    fails: int


@subflow_body(Rotation)
def rotation(parts, t, x, v, span, step, stage):
    """Turn velocities by Rodrigues' formula: v cos q + (w x v) sin q / |w| + w (w . v) (1 - cos q) / |w|^2."""
    if step >= parts.fails:
        return BLOWN_UP
    rate = np.sqrt(parts.wx**2 + parts.wy**2 + parts.wz**2)
    cosine, sine = np.cos(rate * span), np.sin(rate * span)
    nx, ny, nz = parts.wx / rate, parts.wy / rate, parts.wz / rate
    for i in range(v.shape[1]):
        vx, vy, vz = v[0, i], v[1, i], v[2, i]
        along = (nx * vx + ny * vy + nz * vz) * (1.0 - cosine)
        v[0, i] = vx * cosine + (ny * vz - nz * vy) * sine + nx * along
        v[1, i] = vy * cosine + (nz * vx - nx * vz) * sine + ny * along
        v[2, i] = vz * cosine + (nx * vy - ny * vx) * sine + nz * along
    return OK


class Push(NamedTuple):
    """Record of a flow's calls: (calls, 4) time, span, step and stage."""

    notes: np.ndarray
    count: np.ndarray


@subflow_body(Push)
def push(parts, t, x, v, span, step, stage):
    """Move every particle along x, and record the call."""
    note, parts.count[0] = parts.notes[parts.count[0]], parts.count[0] + 1
    note[0], note[1], note[2], note[3] = t, span, step, stage
    for i in range(x.shape[1]):
        x[0, i] += span
    return OK


@pytest.fixture
def magnetic(monkeypatch):
    """The letter R: a magnetic field rotates velocities. The returned list holds the first step at which the flow
    fails."""
    fails = [2**62]
    made = Subflow("rotation", moves=False, symplectic=False, bind=lambda *_: BoundSubflow(Rotation(*FIELD, fails[0])))
    monkeypatch.setitem(FLOWS, "R", made)
    return fails


@pytest.fixture
def word(magnetic):
    """Register a word for one test."""
    names = []

    def register(word, order=2, **more):
        names.append(word.lower())
        kd.register_splitting(names[-1], word=word, order=order, source="this test", **more)
        return names[-1]

    yield register
    for name in names:
        unregister(name)


def trap(n=5):
    rng = np.random.default_rng(3)
    return kd.System(
        rng.normal(size=(n, 3)), rng.normal(size=(n, 3)), np.ones(n), forces=[kd.HarmonicTrap(1.0)], units="lj"
    )


def exact(system, time):
    """Positions and velocities in the trap and the field at that time: x' = v, v' = -x + w x v is linear."""
    cross = np.array([np.cross(FIELD, e) for e in np.eye(3)]).T
    matrix = np.block([[np.zeros((3, 3)), np.eye(3)], [-np.eye(3), cross]])
    start = np.hstack([system.state.positions, system.state.velocities])
    return start @ expm(matrix * time).T


def ends(name, dt, steps, **options):
    sim = kd.Simulation(trap(), name, dt, **options)
    sim.run(steps)
    return np.hstack([sim.state.positions, sim.state.velocities])


@pytest.mark.parametrize(("letters", "order"), [("BARAB", 2), ("RBABR", 2), ("ARBRA", 2), ("BRA", 1), ("ABR", 1)])
def test_a_flow_of_ones_own_has_the_order_of_its_word(word, letters, order):
    name = word(letters, order)
    errors = [np.abs(ends(name, 1.0 / n, n) - exact(trap(), 1.0)).max() for n in (64, 128)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.1)
    assert integrator(name).reversible == (order == 2)
    assert not integrator(name).symplectic
    assert integrator(name).evaluations == 1


def test_the_bits_of_a_further_flow_do_not_depend_on_how_it_runs(word, tmp_path):
    name = word("BARAB")
    whole = ends(name, 0.05, 40)
    assert np.array_equal(ends(name, 0.05, 40, threads=2), whole)
    sim = kd.Simulation(trap(), name, 0.05)
    for steps in (7, 1, 20):
        sim.run(steps, every=3)
    other = kd.Simulation(trap(), name, 0.05)
    other.restore(sim.checkpoint())
    other.run(12)
    assert np.array_equal(np.hstack([other.state.positions, other.state.velocities]), whole)


def test_a_flow_is_told_time_span_step_and_stage(word, monkeypatch):
    notes, count = np.zeros((6, 4)), np.zeros(1, np.int64)
    bind = lambda *_: BoundSubflow(Push(notes, count))  # noqa: E731
    monkeypatch.setitem(FLOWS, "P", Subflow("push", moves=True, bind=bind))
    name = word("PABAP", weights=(0.25, 0.5, 1.0, 0.5, 0.75))
    free = kd.System(np.zeros((1, 3)), [[0.0, 2.0, 0.0]], [1.0], units="lj")
    sim = kd.Simulation(free, name, 0.5)
    sim.run(2)
    assert notes[: count[0]].tolist() == [
        [0.0, 0.125, 0, 0],
        [0.5, 0.375, 0, 2],
        [0.5, 0.125, 1, 0],
        [1.0, 0.375, 1, 2],
    ]
    assert sim.state.positions.tolist() == [[1.0, 2.0, 0.0]]


@pytest.mark.parametrize(
    ("letters", "evaluations", "ends_fresh"),
    [("BAB", 1, True), ("ABA", 1, False), ("BA", 1, False), ("AB", 1, True), ("BABAB", 2, True), ("BARAB", 1, True),
     ("BRBA", 1, False), ("ABRB", 1, True), ("ABPBA", 2, False), ("BPAPB", 1, True)],
)  # fmt: skip
def test_forces_are_evaluated_when_positions_moved(word, monkeypatch, letters, evaluations, ends_fresh):
    bind = lambda *_: BoundSubflow(Push(np.zeros((99, 4)), np.zeros(1, np.int64)))  # noqa: E731
    monkeypatch.setitem(FLOWS, "P", Subflow("push", moves=True, bind=bind))
    name = word(letters, 1)
    assert integrator(name).evaluations == evaluations
    sim = kd.Simulation(trap(), name, 0.01)
    sim.run(10)
    before = sim.record.force_evaluations
    sim.run(10)
    assert sim.record.force_evaluations - before == 10 * evaluations
    assert sim.integration.stepper.ends_fresh == ends_fresh


def test_a_flow_that_fails_stops_the_run_at_its_step(word, magnetic):
    magnetic[0] = 13
    sim = kd.Simulation(trap(), word("BARAB"), 0.05)
    with pytest.raises(RunError, match="step 14"):
        sim.run(40)
    assert sim.state.steps_done <= 13


def test_words_with_further_flows_are_for_particles(word):
    name = word("BARAB")
    with pytest.raises(InputError, match="barab"):
        kd.Simulation(kd.Problem(lambda t, y: [y[1], -y[0]], [1.0, 0.0]), name, dt=0.1)
    assert not integrator(name).batched


def test_equal_weights_make_the_known_methods():
    assert even_weights("BAB") == INTEGRATORS["velocity-verlet"].weights
    kd.register_splitting("mine", word="ABA", order=2, source="this test")
    try:
        assert integrator("mine").stages.tolist() == integrator("leapfrog-dkd").stages.tolist()
    finally:
        unregister("mine")


def test_letters_of_weight_zero_are_left_out():
    row = Splitting("mine", "BABAB", (0.5, 0.5, 0.0, 0.5, 0.5), 2, "me")
    assert row.stages.tolist() == [[0.5, 0.0, 0.5], [0.5, 0.5, 0.0], [0.0, 0.5, 1.0]]
