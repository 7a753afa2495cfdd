"""Hard spheres from hit to hit: beside a slow search of all pairs and images, and beside fixed steps that are searched;
walls, losses, pressure, restarts, and what is refused."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.analysis import pressure_tensor
from kickdrift.errors import InputError, RunError
from kickdrift.integrators.event_driven.spheres import spheres_of
from kickdrift.model.starts.builders import lattice
from tests.long import rest

BOXES = {
    "rectangular": kd.Box((5.0, 6.0, 7.0)),
    "leaning": kd.Box(matrix=[[5.0, 0, 0], [1.5, 6, 0], [-2, 1, 7]]),
    "slab": kd.Box((5.0, 6.0, 7.0), periodic=(True, True, False)),
}
SLAB = (
    kd.ReflectingWall((0, 0, 1), (0, 0, -0.6), restitution=0.8),
    kd.ReflectingWall((0, 0, -1), (0, 0, 7.6), speed=0.3),
)


def gas(box=BOXES["leaning"], n=20, walls=(), seed=4, **bounce):
    """Spheres of unlike mass and size at random places, without overlap."""
    rng = np.random.default_rng(seed)
    radii, x = rng.uniform(0.3, 0.6, n), []
    for radius in radii:
        while True:
            place = box.cartesian(rng.uniform(size=3) * np.where(box.periodic_axes, 1.0, 7.0))
            apart = [np.linalg.norm(box.minimum_image(place - other)) for other in x]
            if all(gap > radius + other for gap, other in zip(apart, radii, strict=False)):
                break
        x.append(place)
    masses, v = rng.uniform(0.5, 2.0, n), rng.normal(size=(n, 3))
    event = kd.Collision(action="bounce", **bounce)
    return kd.System(np.array(x), v, masses, box=box, radii=radii, forces=walls, events=[event])


def slow(system, until):
    """Positions and velocities at a time, and the number of hits: all pairs and images, one hit after the other."""
    x, v, m, radii = system.state.positions, system.state.velocities.copy(), system.state.masses, system.radii
    (event,), now, hits = system.events, 0.0, 0
    ways = [(-2, -1, 0, 1, 2) if along else (0,) for along in system.box.periodic_axes]
    shifts = np.array(list(itertools.product(*ways))) @ system.box.matrix
    i, j = np.triu_indices(len(x), 1)
    while True:
        home = x - system.box.wrap(x)
        d = (x - home)[i] - (x - home)[j] - shifts[:, None]
        u = np.broadcast_to(v[i] - v[j], d.shape)
        b, c = (d * u).sum(2), (d * d).sum(2) - (radii[i] + radii[j]) ** 2
        under = b * b - (u * u).sum(2) * c
        meet = (b < 0) & (under > 0)
        times = np.where(meet, np.maximum(c, 0.0) / (-b + np.sqrt(np.where(meet, under, 1.0))), np.inf)
        k, pair = np.unravel_index(times.argmin(), times.shape)
        first, wall = times[k, pair], None
        for each in system.forces:
            gap = (x - np.array(each.point)) @ np.array(each.normal, float) - each.speed * now - radii
            speed = v @ np.array(each.normal, float) - each.speed
            due = np.where(speed < 0, np.maximum(gap, 0.0) / np.where(speed < 0, -speed, 1.0), np.inf)
            if due.min() < first:
                first, wall, who = due.min(), each, int(due.argmin())
        if now + first >= until:
            return x + v * (until - now), v, hits
        x, now, hits = x + v * first, now + first, hits + 1
        if wall is not None:
            normal = np.array(wall.normal, float)
            v[who] -= (1 + wall.restitution) * (v[who] @ normal - wall.speed) * normal
            continue
        p, q = i[pair], j[pair]
        normal = d[k, pair] + (v[p] - v[q]) * first
        normal /= np.linalg.norm(normal)
        push = -(1 + event.restitution) * ((v[p] - v[q]) @ normal) / (m[p] + m[q]) * normal
        v[p] += m[q] * push
        v[q] -= m[p] * push


@pytest.mark.parametrize("name", BOXES)
@pytest.mark.parametrize("restitution", [1.0, 0.9])
def test_hits_are_those_of_a_search_of_all_pairs_and_images(name, restitution):
    system = gas(BOXES[name], walls=SLAB if name == "slab" else (), restitution=restitution)
    sim = kd.Simulation(system, "event-driven", 0.25)
    report = sim.run(16)
    x, v, hits = slow(system, 4.0)
    assert report.hits.spheres + report.hits.walls == hits > 20
    np.testing.assert_allclose(sim.state.positions, x, atol=1e-8)  # a hit makes an error some 3 times larger
    np.testing.assert_allclose(sim.state.velocities, v, atol=1e-8)


@pytest.mark.parametrize("name", BOXES)
def test_fixed_steps_that_are_searched_have_the_same_hits(name):
    system = gas(BOXES[name], restitution=0.95)
    exact, searched = (kd.Simulation(system, each, 0.01) for each in ("event-driven", "velocity-verlet"))
    there, here = exact.run(150), searched.run(150)
    assert there.hits.spheres == len(here.events) > 5
    np.testing.assert_allclose(searched.state.positions, exact.state.positions, atol=1e-10)
    assert here.energy_taken == pytest.approx(there.energy_taken, rel=1e-10)


@pytest.mark.parametrize(("restitution", "walls"), [(1.0, ()), (0.7, ()), (0.7, SLAB)])
def test_energy_and_momentum_are_booked(restitution, walls):
    system = gas(BOXES["slab" if walls else "rectangular"], walls=walls, restitution=restitution)
    report = kd.Simulation(system, "event-driven", 0.5).run(40, every=4)
    assert report.hits.spheres > 20
    assert (report.hits.walls > 10) == bool(walls)
    assert report.energy.max_relative_error < 1e-13
    assert (report.energy_taken is None) == (restitution == 1.0 and not walls)
    if not walls:
        assert report.momentum_error < 1e-14


def test_a_sample_has_the_pressure_of_the_hits_before():
    looked, silent = (kd.Simulation(gas(BOXES["rectangular"]), "event-driven", 0.5) for _ in range(2))
    assert np.isnan(looked.pressure())
    looked.run(40, every=40)
    silent.advance(40)
    last = looked.record.samples[-1].pressure
    assert looked.sample().pressure == last > 1.2 * looked.record.samples[0].pressure
    assert silent.pressure() == pytest.approx(last, rel=1e-12)
    for sim in (looked, silent):
        sim.advance(40)
    both = 0.5 * (last + looked.pressure())  # the motion has the same energy all the time
    assert silent.pressure() == pytest.approx(both, rel=1e-12)


def test_a_restored_run_of_spheres_knows_no_hits_before_its_next_look():
    sim = kd.Simulation(gas(BOXES["rectangular"]), "event-driven", 0.5)
    sim.run(40, every=40)
    sim.restore(sim.checkpoint())
    assert np.isnan(sim.pressure())
    sim.advance(40)
    assert sim.pressure() > 0.0


def test_spheres_never_overlap():
    system = gas(n=40)
    sim = kd.Simulation(system, "event-driven", 0.1)
    i, j = np.triu_indices(40, 1)
    for _ in range(50):
        sim.advance(1)
        x = sim.state.positions
        apart = np.linalg.norm(system.box.minimum_image(x[i] - x[j]), axis=1)
        assert (apart - system.radii[i] - system.radii[j]).min() > -1e-13


def test_pressure_is_that_of_motion_and_pushes(tmp_path):
    system = gas(BOXES["rectangular"])
    sim = kd.Simulation(system, "event-driven", 0.5)
    report = sim.run(20, every=5, output=tmp_path / "gas.h5md")
    pressures = [sample.pressure for sample in sim.record.samples]
    assert pressures[0] < min(pressures[1:])  # which have hits before them
    motion = 2.0 * sim.energy().kinetic / (3.0 * system.box.volume)
    pushes = sim.integration.stepper.hits.virial / (3.0 * system.box.volume * sim.time)
    # heat excludes the motion of the centre of mass, which is no pressure
    drift = (system.coherent_masses @ system.state.velocities) ** 2 / system.coherent_masses.sum()
    assert report.pressure == pytest.approx(motion - drift.sum() / (3.0 * system.box.volume) + pushes, rel=1e-12)
    assert "hits of two spheres" in str(report)


def test_a_restart_and_looks_keep_the_bits(tmp_path):
    system = gas(restitution=0.9)
    whole = kd.Simulation(system, "event-driven", 0.3)
    whole.run(30, every=3, output=tmp_path / "whole.h5md")
    kd.Simulation(system, "event-driven", 0.3).run(12, every=3, output=tmp_path / "cut.h5md")
    resumed = kd.resume(tmp_path / "cut.h5md")
    resumed.run(18)
    silent = kd.Simulation(system, "event-driven", 0.3)
    silent.advance(30)
    for other in (resumed, silent):
        np.testing.assert_array_equal(other.state.phase, whole.state.phase)
    with kd.open(tmp_path / "whole.h5md") as one, kd.open(tmp_path / "cut.h5md") as two:
        np.testing.assert_array_equal(one.observables["pressure"], two.observables["pressure"])
        np.testing.assert_array_equal(one.observables["energy_taken"], two.observables["energy_taken"])


def test_massless_spheres_pass_through_each_other():
    x, v = [[0.0, 0, 0], [2.0, 0, 0], [4.0, 0, 0]], [[1.0, 0, 0], [0.0, 0, 0], [-1.0, 0, 0]]
    event = kd.Collision(radii=0.5, action="bounce")
    system = kd.System(x, v, [0.0, 0.0, 1.0], events=[event])
    sim = kd.Simulation(system, "event-driven", 2.5)
    assert sim.run(1).hits.spheres == 2
    np.testing.assert_allclose(sim.state.velocities[:, 0], [-3.0, -2.0, -1.0])


def test_spheres_that_come_to_rest_are_an_error():
    x = [[0.5, 0, 0], [1.6, 0, 0], [2.7, 0, 0]]
    system = kd.System(
        x, [[0.0, 0, 0], [-1.0, 0, 0], [-1.0, 0, 0]], forces=[kd.ReflectingWall((1, 0, 0), restitution=0.0)],
        events=[kd.Collision(radii=0.5, action="bounce", restitution=0.1)],
    )  # fmt: skip
    with pytest.raises(RunError, match="elastic_below"):
        kd.Simulation(system, "event-driven", 1.0).run(100)


BOUNCE = kd.Collision(radii=0.5, action="bounce")
CLOSING = [kd.ReflectingWall((1, 0, 0), (-1, 0, 0), speed=0.5), kd.ReflectingWall((-1, 0, 0), (1, 0, 0))]
NARROW = [kd.ReflectingWall((1, 0, 0), (-0.5, 0, 0)), kd.ReflectingWall((-1, 0, 0), (0.5, 0, 0))]


@pytest.mark.parametrize("walls", [rest(CLOSING), NARROW])
def test_a_sphere_that_walls_squeeze_is_an_error(walls):
    system = kd.System([[0.0, 0, 0]], [[1.0, 0, 0]], forces=walls, events=[BOUNCE])
    with pytest.raises(RunError, match="walls squeeze them"):
        kd.Simulation(system, "event-driven", 0.5).run(10)


def test_many_hits_at_one_time_are_no_trouble():
    """Rows of pairs that all meet at t = 1."""
    rows = np.stack(np.meshgrid(*[np.arange(48) * 4.0] * 2), axis=-1).reshape(-1, 2)
    x = np.concatenate([np.column_stack([rows + shift, 0.0 * rows[:, 0]]) for shift in ([0.0, 0], [3.0, 0])])
    v = np.repeat([[1.0, 0, 0], [-1.0, 0, 0]], len(rows), axis=0)
    assert kd.Simulation(kd.System(x, v, events=[BOUNCE]), "event-driven", 1.25).run(1).hits.spheres == len(rows)


def test_a_thin_layer_has_few_cells():
    x = np.column_stack([np.arange(1000) * 10.0, np.arange(1000) % 7 * 1000.0, np.arange(1000) % 2 * 1e-9])
    assert np.prod(spheres_of(BOUNCE, kd.System(x, events=[BOUNCE])).cells) <= 1000


def test_pressures_without_the_pushes_are_refused(tmp_path):
    """A method that searches its steps does not add up pushes, and frames do not have them."""
    system = gas(BOXES["rectangular"])
    assert kd.Simulation(system, "leapfrog", 0.01).run(3).pressure is None
    assert np.isnan(system.pressure())
    kd.Simulation(system, "event-driven", 0.1).run(3, output=tmp_path / "gas.h5md")
    with pytest.raises(InputError, match="lacks the pushes of collisions"):
        pressure_tensor(tmp_path / "gas.h5md")


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: kd.System([[0.0, 0, 0], [0.9, 0, 0]], box=(5,) * 3, events=[BOUNCE]), "particle 1 overlap at the"),
        (lambda: kd.System([[0.0, 0, 0], [4.9, 0, 0]], box=(5,) * 3, events=[BOUNCE]), "they are 0.1 apart"),
        (lambda: kd.System([[0.0, 0, 0]], box=(1.9, 5, 5), events=[BOUNCE]), "has the diameter 1, which must be less"),
        (lambda: kd.System(lattice("sc", 64, 1.0)[0], box=(4,) * 3, events=[kd.Collision(0.63, action="bounce")]),
         "not fit"),
        (lambda: kd.System([[0.0, 0, 0.4]], forces=[kd.ReflectingWall((0, 0, 1))], events=[BOUNCE]),
         "reflecting-wall: reaches 0.1 into particle 0"),
        (lambda: kd.Collision(radii=0.5, action="bounce", restitution=1.1), "restitution must be a number from 0 to 1"),
        (lambda: kd.ReflectingWall((0, 0, 1), restitution=1.5), "restitution must be a number from 0 to 1"),
        (lambda: kd.System([[0.0, 0, 0]], events=[kd.Collision(radii=0.5)]), "needs one event 'collision' with"),
        (lambda: kd.System([[0.0, 0, 0]]), "has none"),
        (lambda: kd.System([[0.0, 0, 0]], forces=[kd.HarmonicTrap(1.0)], events=[BOUNCE]), "'harmonic-trap' bends"),
    ],
)  # fmt: skip
def test_bad_input_is_named(make, says):
    with pytest.raises(InputError, match=says):
        kd.Simulation(make(), "event-driven", 0.1).run(1)


def test_a_wall_that_moves_needs_the_method():
    system = kd.System([[0.0, 0, 1.0]], forces=[kd.ReflectingWall((0, 0, 1), speed=0.1)])
    with pytest.raises(InputError, match="moves or loses energy needs the integrator 'event-driven'"):
        kd.Simulation(system, "velocity-verlet", 0.1)


def test_other_programs_and_comparisons_refuse_hard_spheres(tmp_path):
    system = kd.load("hard-spheres-256")
    with pytest.raises(InputError, match="compare: 'hard-spheres-256' moves by its hits alone"):
        kd.compare(system, time=1.0)
    with pytest.raises(InputError, match="to_lammps: event 'collision': LAMMPS' particles would pass"):
        system.to_lammps(tmp_path / "in.spheres")
    assert not list(tmp_path.iterdir())
