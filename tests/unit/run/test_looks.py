"""Looks at a run: their values, their number, the time of the verdict, and that they change no bit."""

from __future__ import annotations

import pickle
from dataclasses import asdict

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.integrators.flows import particle_flow
from kickdrift.looks.observers import Energies, Looks, Sample, Taken, take_sample
from kickdrift.model.starts.builders import lattice, maxwell_boltzmann
from kickdrift.run.plan.plan import looks_at
from kickdrift.run.report import energy as reports

VALUES = ("energies", "momentum", "angular_momentum", "centre_of_mass", "centre_of_mass_velocity")


def planets() -> kd.System:
    """A central body, two bodies with mass and one without."""
    r = np.array([1.0, 1.6, 2.3])
    x = np.concatenate([np.zeros((1, 3)), np.stack([r, 0.1 * r, 0.02 * r], axis=1)])
    v = np.concatenate([np.zeros((1, 3)), np.stack([-0.1 / r**0.5, 1.0 / r**0.5, 0.03 * r], axis=1)])
    return kd.System(x, v, masses=[1.0, 1e-3, 5e-4, 0.0], forces=[kd.Gravity()], units="nbody")


def liquid(**given) -> kd.System:
    x, box = lattice("fcc", 108, 0.8)
    v = maxwell_boltzmann(np.ones(108), 1.2, 1.0, 3)
    return kd.System(x, v, forces=[kd.LennardJones(cutoff=2.2)], units="lj", box=box, **given)


def unit_masses() -> kd.System:
    """Enough bodies for sums in several blocks."""
    rng = np.random.default_rng(4)
    x, v = rng.normal(size=(2, 600, 3))
    return kd.System(x, v, masses=rng.uniform(0.5, 2.0, 600), forces=[kd.Gravity(softening=0.05)], units="nbody")


def tree_of_masses() -> kd.System:
    own = unit_masses().state
    force = kd.GravityTree(softening=0.05)
    return kd.System(own.positions, own.velocities, masses=own.masses, forces=[force], units="nbody")


RUNS = {
    "splitting": (planets, "leapfrog", {"dt": 0.01}),
    "drift first": (planets, "leapfrog-dkd", {"dt": 0.01}),
    "corrected": (planets, "wisdom-holman", {"dt": 0.01, "corrector": 11}),
    "lists": (liquid, "velocity-verlet", {"dt": 0.004}),
    "lists, mixed": (liquid, "velocity-verlet", {"dt": 0.004, "precision": "mixed"}),
    "many bodies": (unit_masses, "leapfrog", {"dt": 0.001}),
    "a tree": (tree_of_masses, "leapfrog", {"dt": 0.001}),
    "python's steps": (planets, "gauss-legendre4", {"dt": 0.05}),
    "whole numbers": (planets, "leapfrog-exact", {"dt": 0.01}),
}


# --- values of looks ---


@pytest.mark.parametrize("make", [planets, liquid, unit_masses])
def test_a_look_is_the_sum_over_the_particles(make):
    sim = kd.Simulation(make(), "leapfrog", 0.004)
    sim.run(5)
    found = sim.sample()
    wanted = take_sample(sim.system, sim.integration.flow._aside, sim.steps_done, sim.time, sim.state.phase)
    assert (found.step, found.time, found.pairs, found.taken) == (5, 0.02, wanted.pairs, wanted.taken)
    for name in ("temperature", "pressure"):
        assert getattr(found, name) == pytest.approx(getattr(wanted, name), rel=1e-12, nan_ok=True)
    scale = np.abs(sim.state.phase).sum()  # size of the terms in the sums
    for name in VALUES:
        np.testing.assert_allclose(getattr(found, name), getattr(wanted, name), rtol=1e-12, atol=1e-15 * scale)


def test_many_particles_keep_no_lists_for_samples_alone(monkeypatch):
    sims = []
    for many in (particle_flow.MANY, 100):
        monkeypatch.setattr(particle_flow, "MANY", many)
        sims.append(kd.Simulation(liquid(), "velocity-verlet", 0.004))
        sims[-1].run(5)
    few, many = sims
    assert few.integration.flow._kept is not None
    assert many.integration.flow._kept is None
    assert asdict(few.sample())["energies"] == asdict(many.sample())["energies"]
    np.testing.assert_array_equal(few.state.phase, many.state.phase)


def test_particles_without_mass_have_no_centre():
    system = kd.System(np.eye(3), np.eye(3), masses=np.zeros(3), forces=[kd.UniformField((0, 0, -1))], units="nbody")
    sample = kd.Simulation(system, dt=0.1).sample()
    assert (sample.centre_of_mass, sample.centre_of_mass_velocity) == (None, None)
    np.testing.assert_array_equal(sample.momentum, np.zeros(3))


def test_a_row_gives_back_the_sample_that_filled_it():
    looks = Looks()
    taken = Taken(0.5, np.array([1.0, 2.0, 3.0]), np.array([4.0, 5.0, 6.0]))
    of_particles = Sample(
        7, 0.7, Energies(1.0, -3.0, -2.0), np.arange(3.0), np.arange(3.0) + 1, 1.5, 2.5, None, taken, np.ones(3), None
    )
    of_a_problem = Sample(9, 0.9, Energies(float("nan"), float("nan"), 4.0))
    looks.add(of_particles)
    looks.add(of_a_problem)
    for found, wanted in zip(looks.samples, (of_particles, of_a_problem), strict=True):
        for key, value in vars(wanted).items():
            np.testing.assert_equal(getattr(found, key), value)


def test_a_second_look_at_one_point_takes_the_first_ones_place_but_not_in_what_was_read():
    looks = Looks()
    looks.add(Sample(1, 0.1, Energies(0.0, 1.0, 1.0)))
    held = looks.held()[1]
    assert len(looks.samples) == 1
    looks.add(Sample(1, 0.1, Energies(0.0, 2.0, 2.0)))
    assert [sample.energies.total for sample in looks.samples] == [2.0]
    assert looks.samples is looks.samples
    assert held[0].tolist() != looks.held()[1][0].tolist()


# --- looks change nothing ---


@pytest.mark.parametrize("kind", RUNS)
def test_looks_change_no_bit_of_a_run_and_who_takes_them_none_of_theirs(kind):
    make, name, options = RUNS[kind]
    system, seen = make(), {}
    for key, given in {
        "none": {"every": 1000},
        "each": {"every": 1},
        "some": {"every": 7},
        "default": {},
        "watched": {"every": 7, "observe": lambda sim: None},
    }.items():
        sim = kd.Simulation(system, name, **options)
        report = sim.run(300, **given)
        found = {sample.step: sample for sample in sim.record.samples}
        seen[key] = sim.state.phase.tobytes(), report.force_evaluations, found
        assert report.samples == len(found) == len(sim.record.looks)
        assert [sample.time for sample in found.values()] == [step * options["dt"] for step in found]
        assert sorted(found) == list(found)
    assert len({(bits, count) for bits, count, _ in seen.values()}) == 1
    assert [len(found) for *_, found in seen.values()][:3] == [2, 301, 44]
    for *_, found in seen.values():
        for step, sample in found.items():
            each = seen["each"][2][step]
            for value in VALUES:
                np.testing.assert_array_equal(getattr(sample, value), getattr(each, value))


@pytest.mark.parametrize("name", ["gauss-radau15", "dormand-prince45", "hermite4"])
def test_looks_change_no_bit_of_steps_that_differ(name):
    ends, seen = set(), {}
    for key, given in {"none": {"every": 10**6}, "default": {}, "watched": {"observe": lambda sim: None}}.items():
        sim = kd.Simulation(planets(), name)
        report = sim.run(until=20.0, **given)
        ends.add((sim.state.phase.tobytes(), sim.time, report.steps))
        seen[key] = [(sample.step, sample.time, sample.energies) for sample in sim.record.samples]
    assert len(ends) == 1
    assert seen["default"] == seen["watched"]
    assert len(seen["none"]) == 2 < len(seen["default"])


def test_lists_that_grow_in_a_series_of_looks():
    from kickdrift.forces.pairs.lists import with_room

    ends = []
    for room in (None, 40):
        sim = kd.Simulation(liquid(), "velocity-verlet", 0.004)
        sim.run(2, every=1)
        if room:
            sim.integration.flow.forces.forces = tuple(
                with_room(force, room) for force in sim.integration.flow.forces.forces
            )
            sim.integration.flow.forces.forget()
        sim.run(200, every=5)
        ends.append(sim.sample().energies.total)
    assert ends[0] == pytest.approx(ends[1], rel=1e-12)


def test_what_is_not_finite_is_seen():
    from kickdrift.forces.seam.kernel import BLOWN_UP, OK
    from kickdrift.looks.looking import NO_ENERGY

    system = planets()
    for half, value, wanted in (
        (0, 1.0, OK), (0, np.inf, BLOWN_UP), (0, np.nan, BLOWN_UP), (1, np.nan, BLOWN_UP), (1, np.inf, BLOWN_UP),
        (1, 1e200, NO_ENERGY),
    ):  # fmt: skip
        for forces in ([kd.Gravity()], []):  # without forces, nothing else checks the positions
            sim = kd.Simulation(kd.System(*state_of(system), forces=forces, units="nbody"), dt=0.01)
            y = sim.state.phase
            y[half, 1, 3 if value != 1e200 else 0] = value
            assert sim.integration.flow.look(Looks(), y, 0.0, 0, np.empty_like(y)) == wanted


def state_of(system):
    return system.state.positions, system.state.velocities, system.state.masses


def test_a_run_that_blows_up_in_a_series_of_looks_goes_back_to_the_last_one():
    field = kd.HarmonicTrap(stiffness=1.0)
    system = kd.System(np.eye(3), np.zeros((3, 3)), forces=[field], units="nbody")
    sim = kd.Simulation(system, "leapfrog", 3.0)  # stable only up to 2
    with pytest.raises(kd.RunError, match="blew up at step") as error:
        sim.run(10_000, every=2)
    last = sim.record.samples[-1]
    assert error.value.state.steps_done == last.step == sim.steps_done
    assert error.value.state.time == last.time
    assert np.isfinite(sim.state.phase).all()
    assert last.step % 2 == 0
    assert sim.report().steps == last.step


# --- number of looks ---


@pytest.mark.parametrize(
    ("steps", "evaluations", "bodies", "wanted"),
    [
        (10**6, 1, 9, 1000),
        (10**5, 4, 3, 1000),
        (2000, 1, 2, 1000),
        (400, 1, 1000, 50),
        (20_000, 1, 1000, 200),
        (20_000, 4, 1000, 800),
        (10, 0, 10**6, 50),
        (10**9, 1, 10**6, 1000),
    ],
)
def test_how_many_looks_follows_from_the_run_alone(steps, evaluations, bodies, wanted):
    assert looks_at(steps, evaluations, bodies) == wanted


@pytest.mark.parametrize(
    ("steps", "cost", "wanted"),
    [(60, 0.3, 20), (400, 0.3, 50), (400, 1.2, 33), (60, 4.0, 1), (2000, 4.0, 50), (5, 4.0, 1)],
)
def test_default_looks_at_many_particles_take_a_tenth_of_the_time_of_the_steps(steps, cost, wanted):
    assert looks_at(steps, 1, 32_000, cost) == wanted


def test_a_default_run_looks_as_often_as_the_rule_says():
    assert kd.Simulation(planets(), "leapfrog", 0.01).run(5000).samples == 1001
    assert kd.Simulation(unit_masses(), "leapfrog", 0.001).run(120).samples == 31
    assert kd.Simulation(unit_masses(), "leapfrog-dkd", 0.001).run(400).samples == 35


def test_how_often_is_forgotten_after_a_run():
    sim = kd.Simulation(planets(), "leapfrog", 0.01)
    assert sim.run(10, every=1).samples == 11
    assert sim.run(100_000).samples == 11 + 1001
    adaptive = kd.Simulation(planets(), "dormand-prince45")
    adaptive.run(until=1.0, interval=0.5)
    assert [sample.time for sample in adaptive.record.samples] == [0.0, 0.5, 1.0]
    adaptive.run(until=2.0)
    assert adaptive.record.samples[3].time - 1.0 < 0.4


def test_a_file_keeps_how_often(tmp_path):
    path = tmp_path / "a.h5md"
    sim = kd.Simulation(planets(), "leapfrog", 0.01)
    sim.run(20, every=10, output=path)
    sim.run(20)  # a run without the file
    path_b = tmp_path / "b.h5md"
    sim.run(4, every=2, output=path_b)
    sim.run(4, output=path_b)
    with kd.open(path_b) as run:
        assert run.steps.tolist() == [40, 42, 44, 46, 48]
    adaptive = kd.Simulation(planets(), "dormand-prince45")
    adaptive.run(until=1.0, interval=0.5, output=tmp_path / "c.h5md")
    adaptive.run(until=2.0, output=tmp_path / "c.h5md")
    with kd.open(tmp_path / "c.h5md") as run:
        assert run.times.tolist() == [0.0, 0.5, 1.0, 1.5, 2.0]


# --- the verdict ---


def test_the_verdict_is_worked_out_once_and_when_it_is_read(monkeypatch):
    asked, trend = [], reports.energy_trend

    def counted(*args):
        asked.append(args)
        return trend(*args)

    monkeypatch.setattr(reports, "energy_trend", counted)
    sim = kd.Simulation(planets(), "leapfrog", 0.01)
    report = sim.run(2000)
    assert report.energy.initial == sim.record.samples[0].energies.total
    assert not asked
    verdict = report.energy.verdict
    sim.run(2000)  # steps after the first report
    assert (report.energy.verdict, report.as_json()["energy"]["verdict"], len(asked)) == (verdict, verdict, 1)
    assert np.isfinite(report.energy.drift_error)
    with pytest.raises(AttributeError, match="no attribute 'colour'"):
        report.energy.colour


def test_a_report_that_nobody_has_read_goes_to_other_processes_whole():
    report = kd.Simulation(planets(), "leapfrog", 0.01).run(500)
    there = pickle.loads(pickle.dumps(report))
    assert there == report
    assert asdict(there.energy) == asdict(report.energy)


def test_looks_after_the_report_do_not_change_it():
    sim = kd.Simulation(planets(), "leapfrog", 0.01)
    early = sim.run(500, every=1)
    again = kd.Simulation(planets(), "leapfrog", 0.01).run(500, every=1)
    assert again.energy.verdict
    sim.run(5000, every=1)
    assert early.energy == again.energy
