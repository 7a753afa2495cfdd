"""Batches of systems against single runs: every method that batches, to round-off; bits that do not depend on the
other members; and events."""

from __future__ import annotations

from dataclasses import asdict, replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import kickdrift as kd
from kickdrift.analysis.chaos import megno as chaos
from kickdrift.analysis.chaos import megno as chaos_lanes
from kickdrift.analysis.chaos.megno import megno, megnos
from kickdrift.batch import lane_events, members
from kickdrift.batch.batch import Batch
from kickdrift.batch.members import refusal
from kickdrift.ensemble.rows import run_columns
from kickdrift.errors import InputError
from kickdrift.integrators import INTEGRATORS
from kickdrift.integrators import integrator as method_named
from kickdrift.integrators.options import Options
from kickdrift.model.run_defaults import RunDefaults

EPSILON = np.finfo(float).eps
BATCHED = sorted({method.name for method in INTEGRATORS.values() if method.batched})
CHOICES = [(name, {}) for name in BATCHED]
CHOICES += [(name, {"coordinates": "democratic-heliocentric"}) for name in ("wisdom-holman", "saba")]
FEW = [choice for choice in CHOICES if choice[0] in ("velocity-verlet", "rk4", "wisdom-holman", "saba", "trace")]


def ids(choice):
    return "-".join([choice[0], *choice[1].values()])


def planets(seed: int, n: int = 4, moving: float = 1.0, **changes) -> kd.System:
    """A star, not always first in the list, and bodies on ellipses; the third body has no mass."""
    rng = np.random.default_rng(seed)
    G, star = rng.uniform(0.5, 2.0, 2)
    masses = np.concatenate([[star], star * 10 ** rng.uniform(-6, -3, n - 1)])
    if n > 3:
        masses[3] = 0.0
    x, v = np.zeros((2, n, 3))
    for k in range(1, n):
        a, e, angle = 1.6 ** (k - 1), rng.uniform(0.0, 0.15), rng.uniform(0, 2 * np.pi)
        along = np.array([np.cos(angle), np.sin(angle), 0.05 * rng.normal()])
        across = np.array([-np.sin(angle), np.cos(angle), 0.05 * rng.normal()])
        x[k], v[k] = a * (1 - e) * along, np.sqrt(G * star / a * (1 + e) / (1 - e)) * across
    order = rng.permutation(n) if seed % 3 == 0 else np.arange(n)
    given = {"forces": [kd.Gravity(G=float(G))], "units": "nbody", "name": f"planets {seed}"} | changes
    return kd.System(x[order], v[order] + moving * rng.normal(size=3), masses[order], **given)


def steps_for(systems, part: float = 60.0):
    """A step for each system: about ``part`` steps in the innermost body's period, with small differences."""
    found = []
    for k, system in enumerate(systems):
        gm = system.forces[0].G * system.state.masses.max()
        found.append(2 * np.pi / np.sqrt(gm) / (part + k % 5))
    return np.array(found)


def apart(phase, other) -> float:
    """Largest difference, in units of the largest position and velocity."""
    size = np.abs(other).max(axis=(1, 2), keepdims=True)
    return float((np.abs(phase - other) / size).max())


def bound(steps: int, stages: int) -> float:
    """Bound of round-off. Each stage rounds. A rounding error of a velocity moves a body in proportion to the time
    since then, and the sum of many errors grows as the square root of their number."""
    return 4 * EPSILON * (steps * stages) ** 1.5


# --- the same as single runs ---


@pytest.mark.parametrize("choice", CHOICES, ids=ids)
def test_every_method_is_what_it_is_one_by_one(choice):
    name, options = choice
    systems = [planets(seed) for seed in range(11)]
    dts = steps_for(systems)
    together = Batch(systems, name, dts, **options)
    together.run(120)
    stages = max(1, method_named(name).evaluations)
    for i, (system, dt) in enumerate(zip(systems, dts, strict=True)):
        alone = kd.Simulation(system, name, dt, **options)
        alone.run(120)
        state = together.states()[i]
        assert apart(state.phase, alone.state.phase) < bound(120, 8 * stages if name == "saba" else stages)
        assert (state.time, state.steps_done) == (alone.time, alone.steps_done)
        np.testing.assert_array_equal(state.ids, alone.state.ids)
        np.testing.assert_array_equal(state.masses, alone.state.masses)
        assert together.record(i).force_evaluations == alone.record.force_evaluations
    assert together.finite.all()


@pytest.mark.parametrize("bodies", [1, 2, 3, 9, 17])
@pytest.mark.parametrize("choice", FEW, ids=ids)
def test_any_number_of_bodies(choice, bodies):
    name, options = choice
    systems = [planets(seed, bodies) for seed in range(3)]
    dts = steps_for(systems)
    together = Batch(systems, name, dts, **options)
    together.run(20)
    for i, (system, dt) in enumerate(zip(systems, dts, strict=True)):
        alone = kd.Simulation(system, name, dt, **options)
        alone.run(20)
        assert apart(together.phase[i], alone.state.phase) < bound(20, 40)


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    seeds=st.lists(st.integers(0, 10**6), min_size=1, max_size=9),
    bodies=st.integers(2, 6),
    softening=st.sampled_from([0.0, 0.1]),
    choice=st.sampled_from(FEW),
    part=st.floats(20.0, 200.0),
)
def test_any_systems(seeds, bodies, softening, choice, part):
    name, options = choice
    if softening and "kepler" in method_named(name).family.lower():
        softening = 0.0
    systems = [planets(seed, bodies) for seed in seeds]
    systems = [system.under([replace(system.forces[0], softening=softening)]) for system in systems]
    dts = steps_for(systems, part)
    together = Batch(systems, name, dts, **options)
    together.run(30)
    for i, (system, dt) in enumerate(zip(systems, dts, strict=True)):
        alone = kd.Simulation(system, name, dt, **options)
        alone.run(30)
        # bodies on neighbouring orbits may meet, and then differences grow
        assert apart(together.phase[i], alone.state.phase) < 100 * bound(30, 40)


@pytest.mark.parametrize("choice", FEW, ids=ids)
def test_reports_are_those_of_one_by_one(choice):
    name, options = choice
    systems = [planets(seed, 3, moving=0.0) for seed in range(9)]  # angular momentum is about the origin
    dts = steps_for(systems)
    together = Batch(systems, name, dts, **options)
    together.run(2000, every=4)
    costs = "wall_seconds", "compile_seconds", "seconds", "steps_per_second", "ns_per_pair"
    for i in (0, 8):
        sim = kd.Simulation(systems[i], name, dts[i], **options)
        alone, mine = asdict(sim.run(2000, every=4)), asdict(together.report(i))
        assert alone.keys() == mine.keys()
        assert alone.pop("about").units == mine.pop("about").units
        for key in costs:
            assert (alone.pop(key) is None) == (mine.pop(key) is None)
        energy, own = alone.pop("energy"), mine.pop("energy")
        for key in ("momentum_error", "angular_momentum_error"):
            assert mine.pop(key) == pytest.approx(alone.pop(key), rel=1e-6, abs=1e-12)
        assert mine == alone
        resolved = bound(2000, 40) / energy["rms_relative_error"]
        for key in ("initial", "final", "rms_relative_error", "max_relative_error"):
            assert own[key] == pytest.approx(energy[key], rel=max(1e-12, 2 * resolved))
        assert own["relative_to"] == energy["relative_to"]
        if resolved < 1e-6:
            assert own["verdict"] == energy["verdict"]
            assert abs(own["drift_per_unit_time"] - energy["drift_per_unit_time"]) < 0.1 * energy["drift_error"] + 1e-15
    assert together.reports()[3] == together.report(3)


def test_looks_are_those_of_a_simulation():
    system = planets(1)
    together, alone = Batch([system], "leapfrog", 0.01), kd.Simulation(system, "leapfrog", 0.01)
    for steps, every in ((20, 7), (0, None), (3, None), (25, 10), (1, None)):
        together.run(steps, every)
        alone.run(steps, every=every)
    assert together._steps == [sample.step for sample in alone.record.samples]
    long = Batch([system], "leapfrog", 0.01)
    long.run(2500)
    assert len(long.record(0).series().steps) == 1251  # as SAMPLES requires
    assert long.report(0).samples == kd.Simulation(system, "leapfrog", 0.01).run(2500).samples


def test_a_start_at_another_time():
    late = planets(2).at(planets(2).state.phase, 5.0, 40)
    together, alone = Batch([late], "wisdom-holman", 0.02), kd.Simulation(late, "wisdom-holman", 0.02)
    together.run(9)
    alone.run(9)
    assert (together.time[0], together.steps_done) == (alone.time, alone.steps_done)
    assert apart(together.phase[0], alone.state.phase) < bound(9, 4)


def odd_company() -> list[kd.System]:
    """Systems with unusual solutions of Kepler's equation: nearly parabolic, hyperbolic, one that blows up, one with
    two bodies at one place, one with a step of several periods."""
    systems = []
    for seed, (factor, distance) in enumerate([(0.2, 1.0), (3.0, 1.0), (1e200, 1.0), (1.0, 0.0), (1.0, 0.01)]):
        system = planets(3 * seed + 1)
        phase = system.state.phase.copy()
        phase[1, :, 1] *= factor
        phase[0, :, 1] = phase[0, :, 0] + distance * (phase[0, :, 1] - phase[0, :, 0])
        systems.append(system.at(phase, 0.0))
    return systems


@pytest.mark.parametrize("choice", FEW, ids=ids)
def test_bits_depend_on_no_company(choice):
    name, options = choice
    count = 20 if name == "trace" else 200  # trace follows two bodies at one place as far as it can
    systems = [planets(seed) for seed in range(4)]
    dts = steps_for(systems)
    alone = []
    for system, dt in zip(systems, dts, strict=True):
        single = Batch([system], name, dt, **options)
        single.run(count, every=10)
        alone.append((single.phase[0], single.record(0).series()))
    strangers = odd_company()
    mixed = [*strangers[:3], systems[2], *strangers[3:], systems[0], systems[3], systems[1], strangers[0]]
    places = {3: 2, 6: 0, 7: 3, 8: 1}
    steps = np.array([dts[places[k]] if k in places else 0.3 for k in range(len(mixed))])
    together = Batch(mixed, name, steps, **options)
    together.run(count, every=10)
    for k, which in places.items():
        phase, series = alone[which]
        np.testing.assert_array_equal(together.phase[k], phase)
        for mine, other in zip(together.record(k).series(), series, strict=True):
            np.testing.assert_array_equal(mine, other)
    assert together.finite[list(places)].all()
    assert not together.finite[[2, 4]].any()  # at 1e200 the energy overflows; two bodies at one place
    assert [report is None for report in together.reports()] == (~together.finite).tolist()


@pytest.mark.parametrize("choice", FEW, ids=ids)
def test_bits_depend_on_no_cut(choice, monkeypatch):
    name, options = choice
    systems = [planets(seed) for seed in range(9)]
    whole, pieces = (Batch(systems, name, 0.05, **options) for _ in range(2))
    whole.run(60, every=5)
    monkeypatch.setattr(members, "PAIR_STEPS", 300)
    for steps in (7, 0, 43, 10):
        pieces.run(steps, every=5)
    np.testing.assert_array_equal(whole.phase, pieces.phase)
    for i in (0, 8):
        assert whole._stepper.evaluations_of(i) == pieces._stepper.evaluations_of(i)


# --- MEGNO ---


@pytest.mark.parametrize("name", ["leapfrog", "blanes-moan6", "rk4", "midpoint"])
def test_megno_is_what_it_is_one_by_one(name):
    systems = [planets(seed) for seed in range(11)]
    dts, seeds = steps_for(systems), list(range(5, 16))
    found = megnos(systems, list(400 * dts), name, dts, seeds=seeds)
    stages = method_named(name).evaluations
    for k in range(0, 11, 3):
        mine, alone = found[k], megno(systems[k], 400 * dts[k], name, dts[k], seed=seeds[k])
        assert isinstance(mine, chaos.ChaosReport)
        np.testing.assert_allclose(mine.times, alone.times, rtol=1e-15)
        np.testing.assert_allclose(mine.growth, alone.growth, rtol=0, atol=10 * bound(400, stages))
        np.testing.assert_allclose(mine.means, alone.means, rtol=0, atol=100 * bound(400, stages))
        for key in ("megno", "lyapunov", "lyapunov_error", "energy_error", "time"):
            assert getattr(mine, key) == pytest.approx(getattr(alone, key), rel=1e-6, abs=1e-9), key
        for key in ("system", "integrator", "dt", "time_unit", "steps", "seed", "verdict"):
            assert getattr(mine, key) == getattr(alone, key), key


def test_scaling_deviations_back_changes_no_growth(monkeypatch):
    systems = [planets(seed) for seed in range(3)]
    before = megnos(systems, 40.0, "leapfrog", 0.02)
    monkeypatch.setattr(chaos_lanes, "LARGEST", 2.0)
    after = megnos(systems, 40.0, "leapfrog", 0.02)
    for one, other in zip(before, after, strict=True):
        assert np.ptp(one.growth) > 2.0
        np.testing.assert_allclose(one.growth, other.growth, rtol=0, atol=1e-14 * np.abs(one.growth).max())


def test_megno_of_one_that_blows_up():
    found = megnos([*odd_company()[2:4], planets(0)], 2.0, "leapfrog", 0.02)
    assert found[:2] == [None, None]
    np.testing.assert_array_equal(found[2].means, megnos([planets(0)], 2.0, "leapfrog", 0.02)[0].means)


def test_megno_refuses():
    systems = [planets(0), planets(1)]
    with pytest.raises(InputError, match="carries no variations"):
        megnos(systems, 1.0, "wisdom-holman", 0.01)
    with pytest.raises(InputError, match="system 0: dop853 moves one system at a time"):
        megnos(systems, 1.0, "dop853", None)
    with pytest.raises(
        InputError, match="system 1: all systems of a batch need the same steps; it has 200, system 0 has 100"
    ):
        megnos(systems, [1.0, 2.0], "leapfrog", 0.01)
    with pytest.raises(InputError, match="seeds: expected one or 2"):
        megnos(systems, 1.0, "leapfrog", 0.01, seeds=[1])
    with pytest.raises(InputError, match="time must be a positive"):
        megnos(systems, -1.0, "leapfrog", 0.01)


@pytest.mark.parametrize("coordinates", ["jacobi", "democratic-heliocentric"])
def test_warnings_are_those_of_one_by_one(coordinates):
    systems = [planets(seed) for seed in range(2)] + [odd_company()[1]]
    near = planets(4)
    phase, masses = near.state.phase.copy(), near.state.masses.copy()
    phase[:, :, 2] = phase[:, :, 0] + 1.02 * (phase[:, :, 1] - phase[:, :, 0])
    masses[1:3] = 1e-2
    systems.append(kd.System(*phase.transpose(0, 2, 1), masses, forces=near.forces, units="nbody"))
    dts = np.array([0.05, 0.9, 0.05, 0.02])
    together = Batch(systems, "wisdom-holman", dts, coordinates=coordinates)
    together.run(40)
    warned = [together.report(i).warnings for i in range(4)]
    for system, dt, mine in zip(systems, dts, warned, strict=True):
        assert mine == kd.Simulation(system, "wisdom-holman", dt, coordinates=coordinates).run(40).warnings
    assert "is long" in warned[1][0]
    assert any("hyperbola" in line for line in warned[2])
    assert any("Hill radius" in line for line in warned[3])


# --- refusals ---


def cloud(n: int) -> kd.System:
    rng = np.random.default_rng(0)
    return kd.System(rng.normal(size=(n, 3)), masses=1.0, forces=[kd.Gravity()], units="nbody")


@pytest.mark.parametrize(
    ("system", "name", "options", "why"),
    [
        (planets(0), "dop853", {}, "one system at a time"),
        (planets(0), "gauss-radau15", {}, "one system at a time"),
        (planets(0), "leapfrog", {"compensated": True}, "compensated"),
        (planets(0), "wisdom-holman", {"corrector": 3}, "corrector"),
        (planets(0), "wisdom-holman", {"kernel": "lazy"}, "the standard kernel only"),
        (
            planets(0, forces=[kd.Gravity(), kd.UniformField((0.0, 0.0, 1.0))]),
            "leapfrog",
            {},
            "exactly one force, 'gravity'",
        ),
        (planets(0, 3, forces=[kd.LennardJones()]), "leapfrog", {}, "exactly one force, 'gravity'"),
        (planets(0, forces=[kd.GravityTree()]), "leapfrog", {}, "exactly one force, 'gravity'"),
        (planets(0, events=[kd.CloseApproach(0.1)]), "leapfrog", {}, "events"),
        (planets(0, forces=[kd.Gravity(softening=0.1)]), "wisdom-holman", {}, "without softening"),
        (cloud(members.MOST_BODIES + 1), "leapfrog", {}, "bodies are too many"),
        (cloud(3), "wisdom-holman", {}, "no body dominates"),
    ],
)
def test_refusals(system, name, options, why):
    method = method_named(name)
    assert why in refusal(system, method, Options(dt=0.01, **options))
    with pytest.raises(InputError, match="system 0: "):
        Batch([system], name, 0.01, **options)


def test_what_members_must_share():
    with pytest.raises(InputError, match="system 0: expected a System of particles, got str"):
        Batch(["planets"], "leapfrog", 0.01)
    with pytest.raises(
        InputError, match="system 1: all systems of a batch need the same bodies; it has 5, system 0 has 4"
    ):
        Batch([planets(0), planets(1, 5)], "leapfrog", 0.01)
    with pytest.raises(InputError, match="system 1: all systems of a batch need the same steps_done"):
        Batch([planets(0), planets(0).at(planets(0).state.phase, 1.0, 3)], "leapfrog", 0.01)
    with pytest.raises(InputError, match="dt: expected one number or 2"):
        Batch([planets(0), planets(1)], "leapfrog", [0.01])
    with pytest.raises(InputError, match="dt must be a positive"):
        Batch([planets(0), planets(1)], "leapfrog", [0.01, -1.0])
    with pytest.raises(InputError, match="dt is needed"):
        Batch([planets(0)], "leapfrog")
    with pytest.raises(InputError, match="expected one system or more"):
        Batch([], "leapfrog", 0.01)
    with pytest.raises(InputError, match="order: velocity-verlet does not take it"):
        Batch([planets(0)], "leapfrog", 0.01, order="8,4")
    cadences = [planets(0, run=RunDefaults(every=every)) for every in (5, 7)]
    with pytest.raises(InputError, match="every: the systems have different values"):
        Batch(cadences, "leapfrog", 0.01).run(20)
    one = Batch(cadences[:1], "leapfrog", 0.01)
    one.run(20)
    assert one.report(0).samples == 5
    with pytest.raises(InputError, match="run first"):
        Batch([planets(0)], "leapfrog", 0.01).report(0)


def test_a_registered_method_batches_by_itself():
    kd.register_splitting("two kicks", (0.25, 0.5, 0.25), (0.5, 0.5), order=2, source="this test")
    try:
        systems = [planets(seed) for seed in range(2)]
        together = Batch(systems, "two kicks", 0.02)
        together.run(50)
        alone = kd.Simulation(systems[1], "two kicks", 0.02)
        alone.run(50)
        assert apart(together.phase[1], alone.state.phase) < bound(50, 2)
    finally:
        from kickdrift.integrators.own.registration import unregister

        unregister("two kicks")


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
