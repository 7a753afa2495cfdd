"""Looks that follow one another before the file gets them: the same file as looks one by one."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.trajectory.write.h5md import Writer

STEPS = 300


def trap(x, v, t, box):
    return -2.0 * x, float((x * x).sum())


def weak(x, v, t, box):
    if abs(x).max() > 3.0:
        raise ValueError("too far")
    return trap(x, v, t, box)


def made(function=trap, speed=1.0, method="velocity-verlet"):
    rng = np.random.default_rng(1)
    system = kd.System(rng.normal(size=(5, 3)), speed * np.ones((5, 3)), forces=[kd.PythonForce(function)])
    return kd.Simulation(system, method, dt=0.01)


def content(path):
    with kd.open(path) as run:
        assert not run.damage()
        samples = {name: values.tobytes() for name, values in run.observables.items()}
        vectors = run.positions.tobytes(), run.velocities.tobytes()
        return run.steps.tolist(), run.times.tobytes(), run.sample_steps.tolist(), samples, *vectors


def one_by_one(sim):
    """A watcher between the looks and the file makes each look alone."""


@pytest.fixture
def appended(monkeypatch):
    """The steps that were appended one by one."""
    found, append = [], Writer.append

    def noted(self, state, *given, **more):
        found.append(state.steps_done)
        return append(self, state, *given, **more)

    monkeypatch.setattr(Writer, "append", noted)
    return found


@pytest.mark.parametrize("method", ["velocity-verlet", "rk4", "wisdom-holman"])
@pytest.mark.parametrize("every", [1, 7])
def test_the_file_is_the_same(tmp_path, appended, method, every):
    paths = [tmp_path / "series.h5md", tmp_path / "alone.h5md"]
    for path, observe in zip(paths, (None, one_by_one), strict=True):
        appended.clear()
        if method == "wisdom-holman":
            sim = kd.Simulation(kd.load("sun-jupiter"), method, dt=0.01)
        else:
            sim = made(method=method)
        sim.run(STEPS, every=every, output=path, observe=observe)
        assert (len(appended) < 5) == (observe is None)
        sim.run(50)
    assert content(paths[0]) == content(paths[1])


@pytest.mark.parametrize(
    "options",
    [{"store": "float32"}, {"write": ["forces"]}, {"write": ["images"]}, {"compress": True}, {"flush": 1e-9}],
)
def test_options_of_the_file_hold(tmp_path, options):
    paths = [tmp_path / "series.h5md", tmp_path / "alone.h5md"]
    for path, observe in zip(paths, (None, one_by_one), strict=True):
        sim = kd.Simulation(kd.load("lj-1000"), dt=0.004)
        sim.run(12, every=1, output=path, observe=observe, file=kd.FileOptions(**options))
    assert content(paths[0]) == content(paths[1])


def test_copies_of_a_live_file_go_on_to_the_same_bits(tmp_path):
    path, copies = tmp_path / "run.h5md", []

    def copied(done, of):
        if len(copies) < 5 and done > len(copies) * of // 5:
            copies.append(tmp_path / f"copy-{done}.h5md")
            shutil.copy(path, copies[-1])

    made().run(8 * STEPS, every=1, output=path, file=kd.FileOptions(flush=0.005), progress=copied)
    truth = content(path)
    assert len(copies) == 5
    inside = 0
    for copy in copies:
        with kd.open(copy) as run:
            assert truth[0][: len(run)] == run.steps.tolist()
            inside += 1 < len(run) < len(truth[0])
        kd.resume(copy, system=made().system).run()
        assert content(copy) == truth
    assert inside >= 3


@pytest.mark.parametrize("observe", [None, one_by_one])
def test_a_run_that_fails_leaves_all_looks_before(tmp_path, observe):
    path = tmp_path / "run.h5md"
    sim = made(weak, speed=4.0)
    with pytest.raises(kd.RunError, match=r"step 123 .*weak raised ValueError: too far"):
        sim.run(STEPS, every=2, output=path, observe=observe)
    with kd.open(path) as run:
        assert run.steps.tolist() == list(range(0, 123, 2))
        assert sim.steps_done == 122
        np.testing.assert_array_equal(run[-1].positions, sim.state.positions)
    sim.state = made(weak).state
    sim.run(4)
