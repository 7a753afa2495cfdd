"""Collisions that add and remove bodies: mergers at once, bounces, fragments, a user's rule, their search and their
files."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import kickdrift as kd
from kickdrift.errors import InputError, RunError
from kickdrift.forces.seam import named as external_code
from kickdrift.run.watch import contacts, watched_stepper
from kickdrift.run.watch.contacts import Contacts
from kickdrift.run.watch.fragments import (
    GRAZING_MERGER,
    HIT_AND_RUN,
    MERGING,
    Impact,
    Material,
    disruption_energy,
    fragmented,
    hit_and_run_speed,
    impact_energy,
    largest_remnant,
    left_of_projectile,
    oblique_disruption_energy,
    remnants,
)
from kickdrift.run.watch.span import Part
from kickdrift.systemfile.reading import loads
from kickdrift.view.live import Feed
from kickdrift.view.packing import restored, unpacked
from kickdrift.view.scene import scene_of

FREE = 1e-30  # a G so small that bodies move straight
ROCK = Material(1.9, 0.36, 1000.0, 6.6743e-11)
EARTH = 5.972e24


def straight(x, v, masses=1.0, radii=0.5, G=FREE, **more) -> kd.System:
    return kd.System(x, v, masses=masses, forces=[kd.Gravity(G=G)], units="nbody", radii=radii, **more)


def sphere(mass: float, name: str = "", x=(0.0, 0.0, 0.0), v=(0.0, 0.0, 0.0), density: float = 3000.0) -> kd.Sphere:
    radius = (3 * mass / (4 * math.pi * density)) ** (1 / 3)
    return kd.Sphere(mass, np.array(x, float), np.array(v, float), radius, name)


def meeting(gamma: float, sine: float, speed: float) -> tuple[kd.Sphere, kd.Sphere]:
    """A target of one Earth mass, and a projectile that touches it, at so many times the mutual escape speed."""
    target, other = sphere(EARTH, "T"), sphere(gamma * EARTH, "P")
    reach = target.radius + other.radius
    escape = math.sqrt(2 * ROCK.G * EARTH * (1 + gamma) / reach)
    place = reach * np.array([math.sqrt(1 - sine**2), sine, 0.0])
    return target, other._replace(position=place, velocity=np.array([-speed * escape, 0.0, 0.0]))


# --- mergers and bounces ---


def test_24_mergers_at_once_keep_mass_and_momentum():
    """24 bodies reach a heavy one from all sides at t = 1, within one step."""
    height, angle = (np.arange(24) + 0.5) / 12 - 1, 2.4 * np.arange(24)
    ways = np.column_stack([np.sqrt(1 - height**2) * np.cos(angle), np.sqrt(1 - height**2) * np.sin(angle), height])
    masses = np.append(50.0, np.random.default_rng(24).uniform(0.5, 2, 24))
    drift = np.array([0.3, -0.2, 0.7])
    x, v = np.vstack([np.zeros(3), 2.0 * ways]), np.vstack([np.zeros(3), -1.0 * ways]) + drift
    radii = np.append(0.9, np.full(24, 0.1))
    system = straight(x, v, masses, radii, names=[f"b{i}" for i in range(25)])
    sim = kd.Simulation(system, dt=1.5, events=[kd.Collision()])
    report = sim.run(1)
    assert len(sim.state) == 1
    # The heavy body moves and grows, so that the last contacts come a little later.
    assert [event["time"] for event in report.events] == pytest.approx([1.0] * 24, abs=0.05)
    times = [event["time"] for event in report.events]
    assert times == sorted(times)
    assert abs(sim.state.masses[0] / math.fsum(masses) - 1) <= 1e-15
    scale = float(masses @ np.linalg.norm(v, axis=1))
    assert np.abs(sim.state.masses[0] * sim.state.velocities[0] - masses @ v).max() <= 1e-15 * scale
    assert report.energy.max_relative_error < 1e-14
    assert report.angular_momentum_error < 1e-14


def test_any_number_of_bodies_may_merge_at_one_time(monkeypatch):
    """Only collisions that leave as many bodies can go on for ever."""
    monkeypatch.setattr(watched_stepper, "MOST_ACTS", 3)
    x = [[0.1 * k, 0, 0] for k in range(12)]
    sim = kd.Simulation(straight(x, np.zeros((12, 3))), dt=0.1, events=[kd.Collision()])
    sim.run(1)
    assert (len(sim.state), sim.state.masses.tolist()) == (1, [12.0])


@pytest.mark.parametrize("restitution", [0.0, 0.4, 1.0])
def test_a_bounce_takes_the_energy_of_the_closed_form(restitution):
    """(1 - e^2) mu v_n^2 / 2, with the normal speed at 45 degrees."""
    h = math.sqrt(0.5)
    system = straight([[-2, 0, 0], [0, h, 0]], [[1.5, 0, 0], [0, 0, 0]], [1.0, 3.0])
    sim = kd.Simulation(system, dt=0.3, events=[kd.Collision(action="bounce", restitution=restitution)])
    (event,) = sim.run(8).events
    taken = (1 - restitution**2) * 0.75 * (1.5 * h) ** 2 / 2
    assert event["energy"] == pytest.approx(taken, abs=1e-12)


def test_ice_bounces_as_bridges_and_others_measured():
    """0.32 v^-0.234 with v in cm/s, and at most 1 (doi:10.1038/309333a0)."""
    for speed, expected in ((0.01, 0.32), (0.04, 0.32 * 4**-0.234), (1e-5, 1.0)):
        system = kd.System(
            [[0, 0, 0], [0.3, 0, 0]], [[0, 0, 0], [-speed, 0, 0]], masses=[1e3, 1e3],
            forces=[kd.Gravity()], units="si", radii=0.1,
        ).with_forces(kd.Gravity(G=1e-30))  # fmt: skip
        sim = kd.Simulation(system, dt=0.15 / speed, events=[kd.Collision(action="bounce", restitution="bridges")])
        sim.run(1)
        v = sim.state.velocities[:, 0]
        assert (v[1] - v[0]) / speed == pytest.approx(expected, rel=1e-9)


# --- the scaling laws ---


def test_the_disruption_criterion_of_equal_bodies():
    """With eqs. 28 and 30, V* = sqrt(c* 32 pi G rho_1 / 5) R_C1 and Q*_RD = V*^2 / 8."""
    radius = (2 * EARTH * 3 / (4 * math.pi * 1000)) ** (1 / 3)
    critical = math.sqrt(1.9 * 32 * math.pi * ROCK.G * 1000 / 5) * radius
    assert disruption_energy(EARTH, EARTH, ROCK) == pytest.approx(critical**2 / 8, rel=1e-14)
    assert impact_energy(EARTH, EARTH, critical) == pytest.approx(critical**2 / 8, rel=1e-14)
    target, other = sphere(EARTH), sphere(EARTH)
    impact = Impact(EARTH, EARTH, target.radius, other.radius, critical, 0.0)
    assert remnants(impact, ROCK).largest / (2 * EARTH) == pytest.approx(0.5, abs=1e-14)


def test_the_constants_of_chambers_2013_follow_from_mu_bar_one_third():
    """Q* = ((1 + gamma)^2 / 4 gamma) (mu / mu_alpha)^(3/2) Q_0, doi:10.1016/j.icarus.2013.02.015, eqs. 3 to 5."""
    material = Material(1.8, 1 / 3, 1000.0, ROCK.G)
    big, small = sphere(EARTH), sphere(0.2 * EARTH)
    impact = Impact(EARTH, 0.2 * EARTH, big.radius, small.radius, 1e4, 0.5)
    radius = (3 * 1.2 * EARTH / (4 * math.pi * 1000)) ** (1 / 3)
    length = 0.5 * (big.radius + small.radius)
    assert length < 2 * small.radius
    alpha = length**2 * (3 * small.radius - length) / (4 * small.radius**3)
    ratio = (alpha * 0.2 + 1) / (alpha * 1.2)
    expected = 0.8 * 1.8 * math.pi * 1000 * ROCK.G * radius**2 * 1.2**2 / 0.8 * ratio**1.5
    assert oblique_disruption_energy(impact, material) == pytest.approx(expected, rel=1e-13)


def test_the_largest_remnant_is_continuous_where_the_laws_meet():
    assert largest_remnant(1.0) == 0.5
    assert largest_remnant(1.8 - 1e-12) == pytest.approx(largest_remnant(1.8), rel=1e-10)
    assert largest_remnant(3.6) == pytest.approx(0.1 * 2**-1.5, rel=1e-15)


@pytest.mark.long
def test_a_rule_that_numba_compiles():
    """The rule of `merge`, as machine code."""
    import numba

    @numba.njit
    def merge(heavier, lighter):
        total = heavier.mass + lighter.mass
        x = heavier.position + lighter.mass / total * (lighter.position - heavier.position)
        v = heavier.velocity + lighter.mass / total * (lighter.velocity - heavier.velocity)
        return (kd.Sphere(total, x, v, heavier.radius, heavier.name),)

    def after(event):
        pair = kd.System(
            [[0, 0, 0], [3, 0.1, 0]], [[0, 0, 0], [-1, 0, 0]], [1.0, 0.1], radii=[0.5, 0.3], units="nbody",
            forces=[kd.Gravity()], events=[event],
        )  # fmt: skip
        sim = kd.Simulation(pair, "gauss-radau15")
        sim.run(until=3.0)
        return sim.state.phase

    np.testing.assert_allclose(after(kd.Collision(rule=merge)), after(kd.Collision(action="merge")), rtol=1e-15)


@pytest.mark.parametrize(
    ("gamma", "sine", "speed", "regime"),
    [
        (0.3, 0.0, 0.9, "perfect merging"),
        (0.3, 0.3, 1.5, "partial accretion"),
        (0.3, 0.3, 4.0, "erosion"),
        (1.0, 0.0, 4.0, "super-catastrophic disruption"),
        (0.3, 0.9, 2.0, "hit-and-run"),
        (1.0, 0.6, 1.15, "graze-and-merge"),
    ],
)
def test_regimes(gamma, sine, speed, regime):
    target, other = meeting(gamma, sine, speed)
    found = fragmented(target, other, ROCK, 0.002 * EARTH)
    assert found.regime == regime
    masses = [body.mass for body in found.bodies]
    impact = Impact(target.mass, other.mass, target.radius, other.radius, float(np.linalg.norm(other.velocity)), sine)
    ratio = impact_energy(impact.target, impact.projectile, impact.speed) / oblique_disruption_energy(impact, ROCK)
    if regime == HIT_AND_RUN:
        assert masses[0] == EARTH
        assert masses[1] == pytest.approx(left_of_projectile(impact, ROCK), rel=1e-14)
    elif regime in (MERGING, GRAZING_MERGER):
        assert masses == [pytest.approx(impact.total, rel=1e-15)]
    else:
        assert masses[0] == pytest.approx(largest_remnant(ratio) * impact.total, rel=1e-14)


@pytest.mark.parametrize(
    ("gamma", "sine", "ratio"),
    [(1.0, 0.75, 1.13813), (1.0, 1.0, 1.08), (0.1, 0.96, 1.05380)],  # by hand from the fit of Genda et al. 2012
)
def test_the_speed_of_hit_and_run(gamma, sine, ratio):
    target, other = meeting(gamma, sine, 1.0)
    impact = Impact(target.mass, other.mass, target.radius, other.radius, 1.0, sine)
    escape = np.sqrt(2 * ROCK.G * impact.total / (target.radius + other.radius))
    assert hit_and_run_speed(impact, ROCK) / escape == pytest.approx(ratio, abs=2e-5)


@settings(max_examples=60, deadline=None)
@given(
    st.floats(0.02, 1.0), st.floats(0.0, 0.99), st.floats(0.5, 12.0), st.floats(0.01, 0.2),
    st.lists(st.floats(-1, 1), min_size=3, max_size=3),
)  # fmt: skip
def test_fragments_keep_what_they_must_and_do_not_overlap(gamma, sine, speed, smallest, turn):
    w, x, y, z = np.array([1.5, *turn]) / np.linalg.norm([1.5, *turn])
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    target, other = meeting(gamma, sine, speed)
    other = other._replace(position=rotation @ other.position, velocity=rotation @ other.velocity)
    bodies = fragmented(target, other, ROCK, smallest * EARTH).bodies
    total = target.mass + other.mass
    assert math.fsum(body.mass for body in bodies) == pytest.approx(total, rel=4e-15)
    scale = float(np.linalg.norm(other.momentum))
    assert np.abs(sum(body.momentum for body in bodies) - other.momentum).max() < 3e-15 * scale
    centre = sum(body.mass * body.position for body in bodies) - other.mass * other.position
    assert np.abs(centre).max() < 1e-13 * total * max(np.linalg.norm(body.position) for body in bodies)
    volume = sum(body.radius**3 for body in bodies)
    assert volume == pytest.approx(target.radius**3 + other.radius**3, rel=1e-12)
    assert min(body.mass for body in bodies) >= min(smallest * EARTH, other.mass) * (1 - 1e-12)
    x, radii = np.array([body.position for body in bodies]), np.array([body.radius for body in bodies])
    gaps = np.linalg.norm(x[:, None] - x, axis=2) / (radii[:, None] + radii)
    named = np.array([body.name != "" for body in bodies])
    least = np.where(named[:, None] & named, 1 - 1e-12, 1.01)  # after a hit-and-run, the two bodies still touch
    assert (gaps > least)[np.triu_indices(len(bodies), 1)].all()
    before = 0.5 * target.mass * other.mass / total * float(other.velocity @ other.velocity)
    move = other.momentum / total
    after = 0.5 * sum(body.mass * float((body.velocity - move) @ (body.velocity - move)) for body in bodies)
    assert after <= before * (1 + 1e-12)


# --- the run ---


def crash(G: float = 1e-2, **more) -> kd.System:
    """Two bodies that break into pieces at t = 1, and a third body."""
    return straight(
        [[-2, 0, 0], [1, 0.3, 0], [0, 40, 0]], [[1, 0, 0], [-1, 0, 0], [0.1, 0, 0]], [2.0, 1.0, 0.5], G=G,
        names=["A", "B", "C"], events=[kd.Collision(**more)],
    )  # fmt: skip


BREAK = {"action": "fragment", "fragment_mass": 0.1, "reference_density": 0.02, "new_bodies": 30}


def test_a_live_view_has_the_fragments():
    sent = []
    sim = kd.Simulation(crash(**BREAK), dt=0.1)
    sim.followers.append(Feed(sim, lambda kind, content: sent.append((kind, content))))
    sim.run(15)
    frame = [content for kind, content in sent if kind == "frame"][-1]
    x = restored(unpacked(frame["positions"]))[0]
    assert x.shape == (3, 33)
    there = np.flatnonzero(np.isfinite(x[0]))
    assert there.tolist() == sim.state.ids.tolist()
    assert len(there) > 20
    scene = scene_of(sim)
    assert scene["total"] == 33


def test_fragments_have_names_ids_and_a_log():
    sim = kd.Simulation(crash(**BREAK), dt=0.1)
    report = sim.run(15)
    event = report.events[0]
    assert re.fullmatch(r"super-catastrophic disruption: masses \d+ x 0\.1; momentum error .*e-1.", event["done"])
    names, ids = sim.system.names, sim.state.ids.tolist()
    count = len(ids) - 2
    assert names == ("A", "C", *(f"A/fragment-{k + 1}" for k in range(count)))
    assert ids == [0, 2, *range(3, 3 + count)]
    assert count > 20
    assert sim.state.masses.sum() == pytest.approx(3.5, rel=1e-14)
    assert (4 / 3 * np.pi * sim.system.radii**3).sum() == pytest.approx(3 * 4 / 3 * np.pi / 8, rel=1e-13)
    assert report.momentum_error < 1e-14
    assert report.angular_momentum_error < 1e-14
    assert report.energy.max_relative_error < 1e-4
    assert report.energy_taken == pytest.approx(event["energy"])
    assert np.linalg.norm(report.angular_momentum_taken) > 0.1
    assert "went from orbits into bodies" in str(report)


def test_a_file_holds_bodies_that_come_and_the_run_resumes_with_the_same_bits(tmp_path):
    path = tmp_path / "crash.h5md"
    whole = kd.Simulation(crash(**BREAK), dt=0.1)
    whole.run(30, every=3, output=path)
    half = tmp_path / "half.h5md"
    kd.Simulation(crash(**BREAK), dt=0.1).run(20, every=3, output=half)
    resumed = kd.resume(half)
    resumed.run(10, every=3)
    assert resumed.state.phase.tobytes() == whole.state.phase.tobytes()
    assert (resumed.system.names, resumed.state.ids.tolist()) == (whole.system.names, whole.state.ids.tolist())
    for each in (path, half):
        with kd.open(each) as run:
            assert run.events == whole.events
            there = np.isfinite(run[-1].positions[:, 0])
            rows = np.isin(run.ids, whole.state.ids)
            np.testing.assert_array_equal(run[-1].positions[rows], whole.state.positions)
            assert run.names[: 1 + len(whole.state)] == ("A", "B", "C", *whole.system.names[2:])
            assert not np.isfinite(run[0].positions[3:]).any()
            assert there[3 : 1 + len(whole.state)].all()
            assert not there[1 + len(whole.state) :].any()
            masses = run.observables["body_masses"]
            assert masses.shape == (len(run.sample_steps), 33)
            np.testing.assert_allclose(np.nansum(masses, axis=1), 3.5, rtol=1e-14)
            np.testing.assert_array_equal(np.isfinite(masses[-1]), rows)
            assert run.system().names == ("A", "B", "C")
            assert kd.resume(each, step=0).state.ids.tolist() == [0, 1, 2]


def test_a_file_with_new_bodies_can_be_exported_and_drawn(tmp_path):
    pytest.importorskip("ase")
    from ase.io import read

    path = tmp_path / "crash.h5md"
    kd.Simulation(crash(**BREAK), dt=0.1).run(20, every=5, output=path)
    kd.export(path, tmp_path / "crash.extxyz")
    frames = read(tmp_path / "crash.extxyz", ":")
    assert [len(frame) for frame in frames][:2] == [3, 3]
    assert len(frames[-1]) > 20
    np.testing.assert_allclose([frame.get_masses().sum() for frame in frames], 3.5, rtol=1e-7)
    assert "B" not in frames[-1].info["names"]
    assert "A/fragment-1" in frames[-1].info["names"]
    with kd.open(path) as run:
        assert run.plot() is not None


def test_the_row_of_a_run_that_goes_on_after_collisions():
    """A checkpoint after a collision restores names, ids, radii and the count of new bodies."""
    sim = kd.Simulation(crash(**BREAK), dt=0.1)
    sim.run(15)
    other = kd.Simulation(crash(**BREAK), dt=0.1)
    other.restore(sim.checkpoint())
    for each in (sim, other):
        each.run(20)
    assert other.state.phase.tobytes() == sim.state.phase.tobytes()
    assert other.system.names == sim.system.names
    assert other.system.radii.tolist() == sim.system.radii.tolist()
    bad = sim.checkpoint()
    bad["stepper"]["events"]["names"] = ["x"] * 31
    with pytest.raises(InputError, match="more new bodies than the events of this run allow"):
        other.restore(bad)


@pytest.mark.parametrize("offset", [0.0, 0.3])
def test_fragments_stay_in_the_plane_of_two_dimensions(offset):
    system = kd.System(
        [[-2, 0], [1, offset]], [[1, 0], [-1, 0]], masses=[2.0, 1.0], radii=0.5, forces=[kd.Gravity(G=1e-2)],
        units="nbody", dimensions=2, events=[kd.Collision(**BREAK)],
    )  # fmt: skip
    sim = kd.Simulation(system, dt=0.1)
    sim.run(15)
    assert len(sim.state) > 20
    assert not sim.state.positions[:, 2].any()
    assert not sim.state.velocities[:, 2].any()


def test_more_new_bodies_than_allowed_end_the_run_at_the_last_good_state():
    sim = kd.Simulation(crash(**BREAK | {"new_bodies": 5}), dt=0.1)
    with pytest.raises(RunError, match=r"step \d+ \(t = .*\): the break-up of A and B adds \d+ bodies, and") as caught:
        sim.run(20, every=2)
    assert "new_bodies = 5 leaves room for 5" in str(caught.value)
    assert len(caught.value.state) == len(sim.state) == 3
    assert sim.time == caught.value.state.time


# --- rules ---


def halves(heavier, lighter):
    """The lighter body breaks into two that go sideways; the heavier body stops its approach."""
    side = np.array([0.0, 0.0, 1.0])
    speed = (heavier.momentum + lighter.momentum) / (heavier.mass + lighter.mass)
    return [
        heavier._replace(velocity=speed),
        *(
            kd.Sphere(lighter.mass / 2, lighter.position + way * 0.4 * side, speed + way * side, 0.3)
            for way in (-1.0, 1.0)
        ),
    ]


def merge(heavier, lighter):
    total = heavier.mass + lighter.mass
    speed = (heavier.momentum + lighter.momentum) / total
    return [heavier._replace(mass=total, velocity=speed)]


def ruled(rule, **more) -> kd.Simulation:
    return kd.Simulation(crash(FREE, rule=rule, **more), dt=0.1)


def test_rules_return_any_number_of_bodies():
    found = {}
    for rule in (halves, merge, lambda heavier, lighter: [heavier, lighter]):
        sim = ruled(rule)
        report = sim.run(30)
        assert report.momentum_error < 1e-15
        assert report.energy.max_relative_error < 1e-14
        found[rule.__name__] = sim.system.names
    assert found == {
        "halves": ("A", "C", "A/fragment-1", "A/fragment-2"),
        "merge": ("A", "C"),
        "<lambda>": ("A", "B", "C"),  # they pass through each other
    }
    sim = ruled(lambda heavier, lighter: [], loss=True)
    report = sim.run(30)
    assert sim.system.names == ("C",)
    assert report.events[0]["done"].startswith("rule: no body left; momentum error")
    assert report.momentum_error < 1e-15  # what is lost is booked


def test_a_rule_may_name_its_bodies():
    def named(heavier, lighter):
        names = ("A", "moon", "")
        return [body._replace(name=name) for body, name in zip(halves(heavier, lighter), names, strict=True)]

    sim = ruled(named)
    sim.run(20)
    assert sim.system.names == ("A", "C", "moon", "A/fragment-2")


def changed(**values):
    return lambda heavier, lighter: [heavier._replace(**values), lighter]


@pytest.mark.parametrize(
    ("rule", "message"),
    [
        (lambda heavier, lighter: 1 / 0, "raised ZeroDivisionError: division by zero"),
        (lambda heavier, lighter: None, "returned None; expected a list of kd.Sphere"),
        (lambda heavier, lighter: heavier, "returned Sphere("),
        (lambda heavier, lighter: [heavier, 3], "expected a list of kd.Sphere"),
        (lambda heavier, lighter: [heavier], "returned the mass 2 of 3; loss = true allows less mass"),
        (lambda heavier, lighter: [], "returned the mass 0 of 3"),
        (lambda heavier, lighter: [heavier, lighter, lighter._replace(name="")], "returned the mass 4 of 3"),
        (lambda heavier, lighter: [heavier, heavier], "returned two bodies with the name 'A'"),
        (changed(mass=-2.0), "returned body 0 with mass -2.0; expected a number, zero or more"),
        (changed(mass="big"), "returned body 0 with mass 'big'"),
        (changed(radius=math.nan), "returned body 0 with radius nan"),
        (changed(position=[0.0, 1.0]), "returned body 0 with position [0.0, 1.0]; expected three finite numbers"),
        (changed(velocity=[math.inf, 0, 0]), "returned body 0 with velocity [inf, 0, 0]"),
        (changed(velocity=np.zeros(3)), "changed the momentum by 0.67 of the sum of m |v|"),
        (changed(name="C"), "returned a body with the name 'C': that is the name of another body"),
        (changed(name=7), "returned body 0 with name 7; expected text"),
    ],
)
def test_a_rule_that_returns_nonsense_is_one_line(rule, message):
    sim = ruled(rule)
    with pytest.raises(RunError) as caught:
        sim.run(20, every=2)
    text = str(caught.value)
    assert re.match(r"step 11 \(t = 1\.0\d*\): the rule for A and B ", text)
    assert message in text
    assert "\n" not in text
    assert sim.time == pytest.approx(1.0)  # the last sample
    assert len(sim.state) == 3


def test_a_rule_in_a_file_needs_its_module(tmp_path, monkeypatch, kickdrift):
    (tmp_path / "own_collisions.py").write_text(
        "def through(heavier, lighter):\n    return [heavier, lighter]\n", encoding="utf-8"
    )
    text = (
        crash()
        .to_toml()
        .replace('action = "merge"', 'rule = "own_collisions.through"')
        .replace("[run]", "[run]\ndt = 0.1")
    )
    text = text if "[run]" in text else text + "\n[run]\ndt = 0.1\nsteps = 12\n"
    (tmp_path / "own.toml").write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    status, _, err = kickdrift("run", "own.toml", "--steps", "12")
    assert status == 2
    assert "collision: rule: own_collisions.through is code" in err
    asked = ("run", "own.toml", "--steps", "12", "--output", "own.h5md")
    status, out, err = kickdrift("--load", "own_collisions.py", *asked)
    assert status == 0, err
    assert "rule: masses 2, 1" in out
    assert kd.resume("own.h5md").system.events[0].rule.__name__ == "through"
    (tmp_path / "other.toml").write_text(text.replace("collisions.through", "collisions.thruogh"), encoding="utf-8")
    status, _, err = kickdrift("--load", "own_collisions.py", "run", "other.toml")
    assert status == 2
    assert "rule: own_collisions.py defines no function 'thruogh'; did you mean 'through'?" in err
    monkeypatch.setattr(external_code, "_FUNCTIONS", {})
    with pytest.raises(InputError, match=r"rule 'own_collisions.through' is a function of the user; load its module"):
        kd.resume("own.h5md")
    assert kd.resume("own.h5md", events=[kd.Collision(rule=merge)]).system.names == ("A", "B", "C")


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6), st.integers(2, 60), st.sampled_from([0.01, 0.1, 0.5]), st.booleans())
def test_the_tree_finds_what_the_search_of_all_pairs_finds(seed, n, size, bounce):
    rng = np.random.default_rng(seed)
    y0, y1 = rng.normal(size=(2, 2, 3, n))
    y1[0] = y0[0] + rng.choice([0.02, 0.5]) * y1[0]
    masses = np.where(rng.uniform(size=n) < 0.3, 0.0, 1.0)
    masses[0] = 1.0
    radii = size * rng.uniform(size=n) * (rng.uniform(size=n) < 0.9)
    system = straight(y0[0].T, y0[1].T, masses, radii)
    event = kd.Collision(action="bounce" if bounce else "merge")
    rows = []
    for most in (10**6, 0):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(contacts, "ALL_PAIRS", most)
            found = Contacts(event, system)
            count = found.scan([Part(y0, 0.0, y1, 0.3)], 1)
            rows.append([(*found._pairs[:, int(p)], *rest) for p, *rest in found._rows[:count].tolist()])
            found.touch((0, n - 1))  # a known contact is not reported again, in either search
            again = found.scan([Part(y0, 0.0, y1, 0.3)], 2)
            rows.append([(*found._pairs[:, int(p)], *rest) for p, *rest in found._rows[:again].tolist()])
    assert rows[0] == rows[2]
    assert rows[1] == rows[3]


def test_a_run_with_the_tree_has_the_bits_of_a_run_with_all_pairs(monkeypatch):
    rng = np.random.default_rng(3)
    x, v = rng.uniform(-1, 1, (60, 3)), rng.normal(size=(60, 3))
    system = straight(x, v, rng.uniform(0.5, 2, 60), rng.uniform(0.02, 0.1, 60), G=1e-3)
    ends = []
    for most in (256, 20):
        monkeypatch.setattr(contacts, "ALL_PAIRS", most)
        sim = kd.Simulation(system, dt=0.05, events=[kd.Collision()])
        sim.run(10)
        other = kd.Simulation(system, dt=0.05, events=[kd.Collision()])
        other.restore(sim.checkpoint())
        other.run(10)
        ends.append((other.state.phase.tobytes(), len(other.state)))
    assert ends[0] == ends[1]
    assert ends[0][1] < 55


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: kd.Collision(action="bounce", restitution=-0.1), "restitution must be a number from 0 to 1, got -0.1"),
        (lambda: kd.Collision(action="bounce", restitution="ice"), "a number from 0 to 1, or 'bridges', got 'ice'"),
        (lambda: kd.Collision(action="fragment"), "fragment_mass: required by action 'fragment'"),
        (lambda: kd.Collision(action="fragment", fragment_mass=0), "fragment_mass must be a positive number, got 0"),
        (lambda: kd.Collision(fragment_mass=0.1), "fragment_mass needs action 'fragment', not 'merge'"),
        (lambda: kd.Collision(c_star=5.0), "c_star needs action 'fragment', not 'merge'"),
        (lambda: kd.Collision(action="rule"), "rule: required by action 'rule'"),
        (lambda: kd.Collision(rule=3), "rule: expected a function of two bodies, got 3"),
        (lambda: kd.Collision(rule=lambda body: []), "rule must take (heavier, lighter); it takes (body)"),
        (lambda: kd.Collision(action="bounce", rule=merge), "rule needs action 'rule', not 'bounce'"),
        (lambda: kd.Collision(loss=True), "loss needs action 'rule', not 'merge'"),
        (lambda: kd.Collision(rule=merge, new_bodies=-1), "new_bodies must be a whole number, zero or more, got -1"),
        (lambda: crash(action="fragment", fragment_mass=0.1), "reference_density: required in nbody units: 1000"),
        (lambda: crash(**BREAK, radii=[0.1, 0.0, 0.1]), "radii: action 'fragment' needs a radius for every body with"),
        (lambda: crash(action="bounce", restitution="bridges"), "restitution 'bridges' needs units with metres; nbody"),
        (lambda: kd.System([[0, 0, 0]], radii=1.0, events=[kd.Collision(**BREAK)]), "action 'fragment' needs gravity,"),
    ],
)
def test_what_makes_no_sense_is_refused(make, message):
    with pytest.raises(InputError) as caught:
        make()
    assert str(caught.value).startswith("collision: ")
    assert message in str(caught.value)


def test_the_keys_of_a_file_have_units():
    text = """
units = "astro"
[particles]
masses = [1.0, 3e-6]
names = ["Sun", "Earth"]
positions = [[0, 0, 0], [1, 0, 0]]
radii = ["696000 km", "6371 km"]
[velocities]
values = [[0, 0, 0], [0, 6.28, 0]]
[[force]]
type = "gravity"
[[event]]
type = "collision"
action = "fragment"
fragment_mass = "7.35e22 kg"
reference_density = "3 g/cm^3"
c_star = 5.0
mu_bar = 0.37
new_bodies = 50
"""
    system = loads(text)
    event = system.events[0]
    assert event.fragment_mass == pytest.approx(7.35e22 / 1.98841e30, rel=1e-4)
    assert event.reference_density == pytest.approx(3 * 1683721.76, rel=1e-7)
    assert loads(system.to_toml()).events == system.events
    with pytest.raises(InputError, match=r"event\[0\].fragment_mass: expected a mass .*got '1 km'"):
        loads(text.replace("7.35e22 kg", "1 km"))
