"""Runs with a barostat and their files: each frame's box, restarts, and what follows from a frame."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.analysis.certify.sampled_run import sampled_run
from kickdrift.errors import InputError
from kickdrift.integrators.method import PRECISIONS
from kickdrift.trajectory.read.info import info
from tests.systems import liquid

PRESSED = {
    "temperature": 1.0, "friction": 1.0, "pressure": 1.0, "pressure_tau": 0.5, "compressibility": 0.1, "seed": 3,
}  # fmt: skip
STEPS, EVERY = 200, 20


def simulation(**options) -> kd.Simulation:
    return kd.Simulation(liquid(cutoff=1.6).with_run(dt=0.004), "baoab", **PRESSED | options)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The file of a run, copies of it in the middle of the run, and the states at its looks."""
    folder = tmp_path_factory.mktemp("pressed")
    path, seen, copies = folder / "run.h5md", [], []

    def look(sim):
        seen.append(sim.state)
        copies.append(folder / f"at-{sim.steps_done}.h5md")
        shutil.copy(path, copies[-1])

    sim = simulation()
    sim.run(STEPS, every=EVERY, output=path, observe=look, file=kd.FileOptions(flush=1e-9))
    return path, seen, copies


def test_frames_have_the_box_of_their_time(whole):
    path, seen, _ = whole
    assert len({state.box for state in seen}) == len(seen)
    with kd.open(path) as run:
        for frame, state in zip(run, seen, strict=True):
            assert frame.box == state.box == frame.state.box
            np.testing.assert_array_equal(frame.positions, state.positions)
        assert run.box == liquid().box == run[0].box
        assert run.box_varies


def test_a_run_goes_on_with_the_same_bits_and_boxes(whole, tmp_path):
    """Copies that were taken while the run wrote, as a kill would leave them, and an earlier step of the whole file."""
    path, seen, copies = whole
    for copy in copies[2], copies[7]:
        shutil.copy(copy, tmp_path / "on.h5md")
        sim = kd.resume(tmp_path / "on.h5md")
        k = sim.steps_done // EVERY
        assert sim.box_varies
        assert sim.state.box == seen[k].box
        assert not [line for line in sim.record.warnings if "differ" in line]
        sim.run()
        with kd.open(tmp_path / "on.h5md") as run:
            assert [frame.box for frame in run] == [state.box for state in seen]
            np.testing.assert_array_equal(run[-1].positions, seen[-1].positions)
            np.testing.assert_array_equal(run[-1].velocities, seen[-1].velocities)
    sim = kd.resume(path, step=90)
    sim.run(STEPS - 90)
    assert sim.state.box == seen[-1].box
    np.testing.assert_array_equal(sim.state.phase, seen[-1].phase)


@pytest.mark.parametrize("precision", PRECISIONS)
def test_a_file_that_ends_on_an_action_of_the_barostat_goes_on(precision, tmp_path):
    """The next action needs the virials along the axes at the file's end."""
    whole = simulation(coupling="per-axis", pressure_every=10, precision=precision)
    whole.run(20, every=10, output=tmp_path / "run.h5md")
    again = kd.resume(tmp_path / "run.h5md")
    for sim in (whole, again):
        sim.run(11)
    assert again.state.box == whole.state.box
    np.testing.assert_array_equal(again.state.phase, whole.state.phase)


def test_a_new_run_begins_in_the_box_of_a_frame(whole, tmp_path):
    path, seen, _ = whole
    with kd.open(path) as run:
        frame, system = run[5].state, run[5].system
    assert system.box == seen[5].box
    assert kd.Simulation(system, "velocity-verlet", dt=0.004).state.box == seen[5].box
    sim = simulation()
    sim.state = frame
    assert sim.state.box == seen[5].box
    fixed = kd.Simulation(liquid(cutoff=1.6), dt=0.004)
    with pytest.raises(InputError, match="state: the box is"):
        fixed.state = frame
    text = system.at(system.state.phase, 0.0).to_toml()
    (tmp_path / "frame.toml").write_text(text)
    assert kd.load(tmp_path / "frame.toml").box == seen[5].box


def test_a_liquid_equilibrates_at_a_pressure_and_runs_at_its_volume(tmp_path):
    """The barostat of the equilibration alone: the run has a fixed box, in which its file and a restart begin."""
    options = {key: value for key, value in PRESSED.items() if key not in ("temperature", "seed")}
    sim = kd.Simulation(liquid(cutoff=1.6).with_run(dt=0.004))
    sim.equilibrate(1.0, steps=150, integrator="baoab", **options)
    box = sim.state.box
    assert box != liquid().box
    assert sim.system.box == box
    assert (sim.steps_done, sim.time, sim.box_varies) == (0, 0.0, False)
    momentum = sim.state.masses @ sim.state.velocities
    np.testing.assert_allclose(momentum, 0.0, atol=1e-12)  # velocity Verlet would keep what the bath left
    report = sim.run(60, every=20, output=tmp_path / "run.h5md")
    assert report.energy.max_relative_error < 1e-2
    with kd.open(tmp_path / "run.h5md") as run:
        assert not run.box_varies
        assert run.box == box
    on = kd.resume(tmp_path / "run.h5md")
    on.run(40)
    sim.run(40)
    np.testing.assert_array_equal(on.state.phase, sim.state.phase)


def test_the_volumes_of_samples_are_those_of_frames(whole):
    path, seen, _ = whole
    volumes = [state.box.volume for state in seen]
    np.testing.assert_allclose(sampled_run(path).volume, volumes, rtol=1e-15)
    assert sampled_run(path).pressure == 1.0
    sim = simulation()
    sim.run(STEPS, every=EVERY)
    np.testing.assert_allclose(sampled_run(sim).volume, volumes, rtol=1e-15)
    found = info(path)
    assert found["volume"]["mean"] == pytest.approx(np.mean(volumes), rel=1e-14)
    assert found["density"]["mean"] == pytest.approx(np.mean(64 / np.array(volumes)), rel=1e-14)


def test_a_minimum_is_found_in_the_box_of_now(whole):
    path, seen, _ = whole
    sim = simulation()
    sim.state = seen[-1]
    found = sim.minimize(force=1e-3)
    assert found.converged
    assert found.system.box == sim.state.box == seen[-1].box
    with kd.open(path) as run:
        wanted = kd.Simulation(run[-1].system, dt=0.004).minimize(force=1e-3)
    assert found.energy == pytest.approx(wanted.energy, rel=1e-9)
