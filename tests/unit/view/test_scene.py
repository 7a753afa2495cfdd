"""Scenes of runs, Systems and Simulations: positions, ellipses, what is left out, and bad input."""

from __future__ import annotations

import json

import h5py
import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.model.patch import patch_of
from kickdrift.trajectory.file.locking import locked
from kickdrift.view import scene, stage
from kickdrift.view.packing import restored, unpacked
from kickdrift.view.page import as_json
from kickdrift.view.scene import scene_of
from tests.run_files import make_system, write
from tests.systems import liquid


def places(chunk):
    """Positions (f, n, 3) of a chunk, as a browser makes them."""
    parts = np.moveaxis(restored(unpacked(chunk["positions"])), 1, 2)
    matrix = np.broadcast_to(unpacked(chunk["matrix"]).reshape(-1, 3, 3), (len(parts), 3, 3))
    return np.array(chunk["origin"]) + np.einsum("fnk,fkj->fnj", parts, matrix)


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    path = tmp_path_factory.mktemp("scenes") / "liquid.h5md"
    kd.Simulation(liquid(), dt=0.001).run(20, every=1, output=path)
    return path


def test_a_run_shows_its_frames_in_the_box(path):
    found = scene_of(path)
    chunk = found["chunks"][0]
    with kd.open(path) as run:
        there = np.array([frame.wrapped() for frame in run])
        apart = places(chunk) - there
        apart -= np.round(apart / run.box.lengths) * run.box.lengths  # a particle on a face may be on the other one
        assert np.abs(apart).max() < np.max(run.box.lengths) / 60000
        assert unpacked(chunk["times"]).tolist() == run.times.tolist()
        speed = np.linalg.norm(run[:].velocities, axis=2)
    assert (found["kind"], found["shown"], chunk["count"], found["notes"]) == ("box", 64, 21, [])
    top = np.quantile(speed, 0.998)
    assert chunk["values"]["speed"]["high"] == pytest.approx(top)
    assert chunk["values"]["speed"]["beyond"]
    assert chunk["energy"] == pytest.approx(np.quantile(0.5 * speed**2, 0.998))
    shown = restored(unpacked(chunk["values"]["speed"]["data"])) * (top - speed.min()) + speed.min()
    assert np.abs(shown - np.minimum(speed, top)).max() < (top - speed.min()) / 250
    assert [each["name"] for each in found["curves"]] == ["energy error", "temperature"]
    assert found["verdict"][0][0] == "system"
    json.loads(as_json(found))


def test_fewer_frames_are_spread_evenly_and_said(path):
    found = scene_of(path, frames=5)
    assert unpacked(found["chunks"][0]["steps"]).tolist() == [0, 5, 10, 15, 20]
    assert found["notes"] == ["Shows 5 of 21 frames, spread evenly."]


def test_a_leaning_box_keeps_its_corners():
    box = kd.Box(matrix=[[4, 0, 0], [1, 4, 0], [0.5, -1, 4]])
    x = np.random.default_rng(0).uniform(-9, 9, (30, 3))
    chunk = scene_of(kd.System(x, box=box))["chunks"][0]
    np.testing.assert_allclose(unpacked(chunk["matrix"]).reshape(3, 3), box.matrix)
    np.testing.assert_allclose(places(chunk)[0], box.wrap(x), atol=2e-4)


def test_ellipses_pass_through_the_bodies_and_have_the_barycentre_as_a_focus():
    system = kd.load("sun-jupiter")
    found = scene_of(system)
    chunk = found["chunks"][0]
    at, axes = places(chunk)[0], unpacked(chunk["ellipses"])[0]
    assert np.isnan(axes[0]).all()
    middle, long, short = at[1] + axes[1, :3], axes[1, 3:6], axes[1, 6:]
    focus = np.sqrt(long @ long - short @ short) / np.linalg.norm(long)
    np.testing.assert_allclose(middle + focus * long, 0.0, atol=1e-4)
    u, w = (at[1] - middle) @ long / (long @ long), (at[1] - middle) @ short / (short @ short)
    assert u**2 + w**2 == pytest.approx(1.0, abs=1e-4)
    m, v = system.state.masses, system.state.velocities
    moving = v[1] - m @ v / m.sum()
    np.testing.assert_allclose(np.cross(-long * w + short * u, moving), 0.0, atol=1e-4)


def test_a_simulation_and_a_shipped_system_show_one_moment():
    assert scene_of(kd.Simulation(kd.load("figure-eight")))["chunks"][0]["count"] == 1
    found = scene_of("lj-1000")
    assert found["notes"] == ["Shows the start: a system has no frames."]
    assert found["shown"] == 1000


def test_molecules_have_bonds_and_numbers():
    topology = kd.Topology(bonds=[(0, 1), (1, 2), (4, 5)])
    found = scene_of(kd.System(np.arange(18).reshape(6, 3) * 1.0, box=[20, 20, 20], topology=topology))
    assert unpacked(found["bonds"]).tolist() == [[0, 1], [1, 2], [4, 5]]
    assert unpacked(found["moleculeOf"]).tolist() == [0, 0, 0, 1, 2, 2]
    assert "molecule" in [each["name"] for each in found["colours"]]
    assert not found["toScale"]


def test_charges_are_a_colour():
    system = kd.System(np.arange(12).reshape(4, 3) * 1.0, box=[20, 20, 20], charges=[1.0, -1.0, 0.5, 0.0])
    found = scene_of(system, colour="charge")
    values = found["chunks"][0]["values"]["charge"]
    charges = restored(unpacked(values["data"])) * (values["high"] - values["low"]) + values["low"]
    np.testing.assert_allclose(charges[0], system.charges, atol=0.01)
    assert found["colour"] == "charge"
    with pytest.raises(InputError, match="colour: expected one of species, speed, kinetic energy, got 'charge'"):
        scene_of(system.remade(charges=None), colour="charge")


def test_many_particles_are_thinned_and_the_view_says_so(monkeypatch):
    monkeypatch.setattr(stage, "MOST_PARTICLES", 50)
    found = scene_of(liquid(count=216))
    assert (found["shown"], found["total"]) == (44, 216)
    assert found["notes"][0] == "Shows 44 of 216 particles: one in 5."
    assert places(found["chunks"][0]).shape == (1, 44, 3)


def test_many_particles_of_a_run_are_read_thinned(path, monkeypatch):
    monkeypatch.setattr(stage, "MOST_PARTICLES", 50)
    monkeypatch.setattr(scene, "MOST_PLACES", 100)
    found = scene_of(path)
    with kd.open(path) as run:
        there = run[-1].wrapped()[::2]
        lengths = run.box.lengths
    apart = places(found["chunks"][0])[-1] - there
    assert found["notes"] == ["Shows 32 of 64 particles: one in 2.", "Shows 3 of 21 frames, spread evenly."]
    assert np.abs(apart - np.round(apart / lengths) * lengths).max() < 1e-3


def test_a_file_being_written_shows_what_is_there(path):
    with locked(path):
        found = scene_of(path)
    assert found["notes"] == ["The run goes on: the view shows the 21 frames written so far."]


def test_a_run_without_frames_shows_its_start(tmp_path):
    write(tmp_path / "run.h5md", make_system("lj"), [])
    found = scene_of(tmp_path / "run.h5md")
    assert found["notes"][-1] == "The run has no frames: the view shows its start."
    assert found["chunks"][0]["count"] == 1


@pytest.mark.parametrize(
    ("given", "options", "line"),
    [
        ("ode-kepler", {}, "ode-kepler: is a Problem, which has no particles to show; kickdrift plot draws Problems"),
        ("lj-1000", {"colour": "sped"}, "colour: expected one of species, speed, kinetic energy, got 'sped'; did you"),
        ("lj-1000", {"frames": 0}, "frames: expected 1 or more, got 0"),
        ("lj-1000", {"size": -1.0}, "size: expected a positive number, got -1.0"),
        (3, {}, "view: expected a run, a System or a Simulation, got int"),
        ("none.h5md", {}, "none.h5md: no such file"),
    ],
)
def test_bad_input(given, options, line):
    with pytest.raises(InputError) as error:
        scene_of(given, **options)
    assert str(error.value).startswith(line)


def test_a_ring_patch_shows_the_images_inside_the_patch():
    system = kd.load("shearing-sheet")
    patch, time = patch_of(system), 1e5
    assert scene_of(system)["up"] == [0.0, 0.0, 1.0]
    x, v = system.state.positions, system.state.velocities
    images = np.random.default_rng(1).integers(-3, 4, (2, len(x)))
    shift, kick = np.moveaxis(patch.offset(images, time), 1, 2)
    found = patch.folded((x + shift)[None], (v + kick)[None], [time])
    here = (np.abs(x[:, :2]) < [patch.width / 2, patch.length / 2]).all(axis=1)
    np.testing.assert_allclose(found[0][0][here], x[here], atol=1e-9)
    np.testing.assert_allclose(found[1][0][here], v[here], atol=1e-12)
    assert here.sum() > 50
    assert (np.abs(found[0][..., :2]) <= [patch.width / 2, patch.length / 2]).all()


def test_up_is_the_axis_of_bodies_that_go_round_alike():
    assert scene_of("plummer-1000")["up"] == [0.0, 0.0, 1.0]
    assert 0.9 < scene_of("solar-system")["up"][2] < 0.93  # 23 degrees from the axis of the Earth


def test_a_damaged_file_shows_its_good_frames_and_says_which_is_damaged(tmp_path):
    path = tmp_path / "run.h5md"
    sim = kd.Simulation(kd.load("two-body"), dt=0.01)
    column = kd.Column("speed", "velocity", (2,), lambda sim: np.linalg.norm(sim.state.velocities, axis=1))
    sim.run(60, every=10, output=path, columns=[column])
    with h5py.File(path) as file:
        stored = file["particles/trajectory/position/value"]
        place, size = stored.id.get_chunk_info(0).byte_offset, stored[0].nbytes
    data = bytearray(path.read_bytes())
    for frame in (1, 4):
        data[place + frame * size + 5] ^= 16
    path.write_bytes(data)
    found = scene_of(path)
    assert unpacked(found["chunks"][0]["steps"]).tolist() == [0, 20, 30, 50, 60]
    assert "Leaves out what is damaged: frame 1, frame 4." in found["notes"]
    assert "Leaves out what is damaged: frame 4." in scene_of(path, frames=4)["notes"]
    again = kd.resume(path)
    assert "the file stays damaged: frame 1, frame 4" in again.record.warnings
