"""Collisions in a shear-periodic patch: contacts with images, bounces and mergers across the boundary, files,
refusals."""

from __future__ import annotations

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError, RunError
from kickdrift.model.patch import Patch
from kickdrift.run.watch.patch_contacts import ImageContacts
from kickdrift.run.watch.span import Part
from kickdrift.systemfile.reading import loads

WIDTH, LENGTH, RADIUS = 6.0, 8.0, 0.5
SHEET = (kd.Hill(1.0), kd.GravitySheet(1.0, WIDTH, LENGTH, G=0.0))
BOUNCE = {"action": "bounce", "restitution": 0.6, "elastic_below": 0.01}


def patch(x, v, event=BOUNCE, masses=1.0, radii=RADIUS, **more) -> kd.System:
    return kd.System(
        x, v, masses=masses, radii=radii, forces=SHEET, units="nbody", events=[kd.Collision(**event)], **more
    )


def spread(n: int = 24, seed: int = 2, event=BOUNCE, **more) -> kd.System:
    """Bodies without overlap in the patch, in the shear and with random velocities."""
    rng = np.random.default_rng(seed)
    found = np.zeros((0, 3))
    while len(found) < n:
        place = rng.uniform(-0.5, 0.5, 3) * (WIDTH, LENGTH, 3.0)
        apart = found - place
        apart[:, :2] -= np.round(apart[:, :2] / (WIDTH, LENGTH)) * (WIDTH, LENGTH)
        if (np.linalg.norm(apart, axis=1) > 2 * RADIUS).all():
            found = np.vstack([found, place])
    v = rng.normal(0, 0.8, (n, 3)) - 1.5 * np.outer(found[:, 0], [0, 1, 0])
    return patch(found, v, event, masses=np.linspace(1.0, 2.0, n), **more)


def across(event=BOUNCE, **more) -> kd.System:
    """A body near the outer edge and one near the inner edge, whose image comes towards the first."""
    x, v = [[2.6, 0.0, 0.0], [3.8 - WIDTH, 0.1, 0.1]], [[1.0, -4.2, 0.0], [-1.5, -5.0 + 1.5 * WIDTH, 0.0]]
    return patch(x, v, event, (2.0, 1.0), **more)


def after(system: kd.System, time: float = 2.0, dt: float = 0.02) -> kd.Simulation:
    sim = kd.Simulation(system, "sei", dt=dt)
    sim.run(round(time / dt), every=round(time / dt))
    return sim


@pytest.mark.parametrize("seed", range(3))
def test_contacts_are_those_of_all_images(seed):
    """Beside distances to 49 images of each body at many times of a step, far from t = 0 and from the patch."""
    rng = np.random.default_rng(seed)
    n, begin, h = 50, 40.0, 0.3
    own = Patch(1.0, WIDTH, LENGTH)
    x = rng.uniform(-0.5, 0.5, (3, n)) * [[WIDTH], [LENGTH], [0.6]]
    v = rng.normal(0, 0.5, (3, n))
    v[1] -= 1.5 * x[0]
    far = own.offset(rng.integers(-2, 3, (2, n)), begin)
    y0 = np.array([x, v]) + far
    y1 = y0.copy()
    y1[0] += h * y0[1]  # straight ways
    system = patch(y0[0].T, y0[1].T, radii=0.25)
    found = ImageContacts(system.events[0], system)
    count = found.scan([Part(y0, begin, y1, begin + h)], 0)
    rows = found._rows[:count, 0].astype(int)
    seen = {tuple(pair) for pair in found._pairs[:, rows].T.tolist()}
    expected = set()
    for i in range(n):
        for j in range(i + 1, n):
            for k in range(-4, 5):
                start = y0[:, :, i] - y0[:, :, j] - own.offset((k, 0), begin)
                base = round(start[0, 1] / LENGTH)
                for row in range(base - 1, base + 2) if abs(start[0, 0]) < 3 else ():
                    first = start[0] - [0.0, row * LENGTH, 0.0]
                    distance = np.linalg.norm(first[:, None] + np.linspace(0, h, 400) * start[1][:, None], axis=0)
                    if distance.min() < 0.5 and distance[0] > distance.min():
                        expected.add((i, j, k, row))
    assert len(expected) > 3
    assert {pair[2:] for pair in expected} != {(0, 0)}
    assert seen == expected


def test_a_bounce_across_the_boundary_is_that_of_the_same_bodies_side_by_side():
    """The second body stands at its image, and the two meet in the middle of nowhere."""
    system = across()
    there = kd.Simulation(system, "sei", dt=0.02)
    (event,) = there.run(100, every=100).events
    shift = Patch(1.0, WIDTH, LENGTH).offset((1, 0), 0.0)
    moved = patch(*(system.state.phase.transpose(0, 2, 1) + [[0, 0, 0], [1, 1, 1]] * shift[:, None]), masses=(2.0, 1.0))
    beside = after(moved)
    offset = Patch(1.0, WIDTH, LENGTH).offset((1, 0), 2.0)
    np.testing.assert_allclose(there.state.phase[:, :, 0], beside.state.phase[:, :, 0], atol=1e-13)
    np.testing.assert_allclose(there.state.phase[:, :, 1] + offset, beside.state.phase[:, :, 1], atol=1e-12)
    assert event["distance"] == pytest.approx(2 * RADIUS)


def test_bodies_far_from_the_patch_bounce_as_their_images_in_the_patch():
    system = spread()
    ids = np.arange(len(system))
    images = np.array([ids % 5 - 2, ids % 3 - 1])
    own = Patch(1.0, WIDTH, LENGTH)
    there = after(system, 1.0)
    away = system.state.phase + own.offset(images, 0.0)
    moved = after(patch(away[0].T, away[1].T, masses=system.state.masses), 1.0)
    np.testing.assert_allclose(moved.state.phase - own.offset(images, 1.0), there.state.phase, atol=1e-9)
    assert len(kd.Simulation(system, "sei", dt=0.02).run(50, every=50).events) > 5


def test_the_centre_of_mass_follows_its_epicycle_and_energy_closes():
    system = spread()
    sim = kd.Simulation(system, "sei", dt=0.02)
    report = sim.run(150, every=150)
    share = system.state.masses / system.state.masses.sum()
    body = kd.System(
        [share @ system.state.positions], [share @ system.state.velocities], forces=[kd.Hill(1.0)], units="nbody"
    )
    alone = after(body, 3.0)
    assert len(report.events) > 20
    np.testing.assert_allclose(share @ sim.state.positions, alone.state.positions[0], atol=1e-12)
    np.testing.assert_allclose(share @ sim.state.velocities, alone.state.velocities[0], atol=1e-12)
    assert report.energy.max_relative_error < 1e-12
    assert report.energy_taken == pytest.approx(sum(event["energy"] for event in report.events))


def test_bodies_merge_across_the_boundary():
    """The survivor stays where the two met, with the mass and momentum of the first and of the image."""
    sim = after(across({"action": "merge"}))
    assert len(sim.state) == 1
    assert sim.state.masses[0] == 3.0
    fine = after(across({"action": "stop"}), 2.0)
    assert fine.state.time < 2.0
    offset = Patch(1.0, WIDTH, LENGTH).offset((1, 0), fine.state.time)
    x, v = fine.state.phase + np.array([0.0, 1.0]) * offset[..., None]
    common = [2 / 3 * a[:, 0] + 1 / 3 * a[:, 1] for a in (x, v)]
    body = kd.System([common[0]], [common[1]], forces=[kd.Hill(1.0)], units="nbody")
    alone = after(body, 2.0 - fine.state.time)
    np.testing.assert_allclose(sim.state.positions, alone.state.positions, atol=1e-12)


def test_a_run_resumes_with_the_same_bits(tmp_path):
    whole = after(spread(), 3.0)
    path = tmp_path / "ring.h5md"
    kd.Simulation(spread(), "sei", dt=0.02).run(80, every=40, output=path)
    resumed = kd.resume(path)
    resumed.run(70, every=35)
    assert resumed.state.phase.tobytes() == whole.state.phase.tobytes()


def test_slow_bounces_are_elastic():
    """The work of the shear alone is left in the energy of a bounce."""

    def energy(**bounce) -> float:
        sim = kd.Simulation(across({"action": "bounce", **bounce}), "sei", dt=0.02)
        return sim.run(40, every=40).events[0]["energy"]

    assert energy(restitution=0.0, elastic_below=100.0) == pytest.approx(energy(), abs=1e-14)
    assert energy(restitution=0.0, elastic_below=0.1) == energy(restitution=0.0) != pytest.approx(energy())


def test_a_system_file_declares_a_ring_without_self_gravity():
    system = loads(
        """
        units = "si"
        [particles]
        masses = [1, 1]
        radii = [1, 1]
        positions = [[0, 0, 0], [4, 0, 0]]
        [[force]]
        type = "hill"
        omega = 1e-4
        [[force]]
        type = "gravity-sheet"
        omega = 1e-4
        width = 20
        length = 20
        G = 0
        [[event]]
        type = "collision"
        action = "bounce"
        restitution = 0.5
        elastic_below = "0.1 mm/s"
        """
    )
    assert system.events[0].elastic_below == pytest.approx(1e-4)
    assert loads(system.to_toml()).events == system.events


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: across(radii=1.5), "the patch has the width 6; it must exceed 4 radii of the largest body, 6"),
        (lambda: kd.GravitySheet(1.0, 2.0, 2.0, G=-1.0), "G must be zero or more, got -1"),
        (lambda: kd.Collision(action="bounce", elastic_below=-1.0), "elastic_below must be a speed, zero or more"),
        (lambda: kd.Collision(elastic_below=1.0), "elastic_below needs action 'bounce', not 'merge'"),
    ],
)
def test_bad_input(make, message):
    with pytest.raises(InputError, match=message):
        make()


@pytest.mark.parametrize("event", [kd.CloseApproach(1.0), kd.Escape(100.0)])
def test_events_that_do_not_see_images_are_refused(event):
    with pytest.raises(InputError, match=f"^{event.kind}: does not see the images of a shear-periodic patch"):
        kd.load("shearing-sheet").watched([event])


def test_a_step_across_many_patches_is_refused():
    fast = patch([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]], [[900.0, 0.0, 0.0], [0.0, -3.0, 0.0]])
    with pytest.raises(RunError, match="crosses many widths or lengths of the patch in one step; take a smaller dt"):
        kd.Simulation(fast, "sei", dt=0.5).run(2)
