"""Runs taken up again from their files go on to the bits that they would have had."""

from __future__ import annotations

import h5py
import numpy as np
import pytest
from test_integrators import liquid

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.trajectory import restart
from kickdrift.trajectory.checkpoints import decoded, encoded


class Stopped(Exception):
    """What ends a run without its last flush's checkpoint."""


def interrupted(sim, path, at, length, **how):
    """Run into the file, and end at step ``at`` as a kill does, without a last checkpoint or report."""

    def observe(sim):
        if sim.steps_done >= at:
            raise Stopped

    with pytest.raises(Stopped):
        sim.run(**length, output=path, observe=observe, **how)


def content(path):
    """Frames, observables and events of a file."""
    with kd.open(path) as run:
        frames = [(f.step, f.time, f.positions.tobytes(), f.velocities.tobytes()) for f in run]
        return frames, {name: values.tobytes() for name, values in run.observables.items()}, run.events


def timeless(report):
    """A report without what the clock says."""
    clock = ("wall_seconds", "compile_seconds", "steps_per_second", "ns_per_pair")
    return {key: value for key, value in report.as_json().items() if key not in clock}


def trio(**how):
    """Three bodies, two of which collide on the way: after it there are two."""
    x = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 3.0, 0.0]]
    v = [[0.0, 0.0, 0.0], [0.0, 0.35, 0.0], [-0.5, 0.0, 0.0]]
    events = [kd.Collision(0.05), kd.CloseApproach(2.5)]
    return kd.System(x, v, [1.0, 1e-2, 1e-3], forces=[kd.Gravity()], units="nbody", events=events, **how)


CASES = {
    "fixed steps": (lambda: kd.Simulation(liquid(), dt=0.004), {"steps": 400}, {"every": 20}, 230),
    "two threads": (lambda: kd.Simulation(liquid(), dt=0.004, threads=2), {"steps": 400}, {"every": 20}, 230),
    "its own steps": (lambda: kd.Simulation(liquid(), "dormand-prince45"), {"until": 1.0}, {"interval": 0.07}, 60),
    "samples at step points": (lambda: kd.Simulation(liquid(), "dormand-prince45"), {"until": 1.0}, {}, 60),
    "a merger": (lambda: kd.Simulation(trio(), "velocity-verlet", dt=0.002), {"steps": 1500}, {"every": 50}, 1200),
    "an adaptive merger": (lambda: kd.Simulation(trio(), "dop853", rtol=1e-12), {"until": 3.0}, {"interval": 0.1}, 20),
}


@pytest.mark.parametrize("case", CASES)
def test_what_was_interrupted_ends_in_the_same_file(tmp_path, case):
    made, length, how, at = CASES[case]
    whole, path = made(), tmp_path / "b.h5md"
    report = whole.run(**length, output=tmp_path / "a.h5md", **how)
    interrupted(made(), path, at, length, **how)
    with kd.open(path) as run:
        assert 1 < len(run) < 5000
        assert run.report is None
    resumed = kd.resume(path)
    assert resumed.steps_done >= at
    again = resumed.run()
    assert timeless(again) == timeless(report)
    assert content(path) == content(tmp_path / "a.h5md")
    assert resumed.state.phase.tobytes() == whole.state.phase.tobytes()
    with kd.open(path) as run:
        assert run.report is not None
        assert run.checkpoints.steps[-1] == whole.steps_done


def test_events_were_part_of_the_cases(tmp_path):
    for name in ("a merger", "an adaptive merger"):
        made, length, how, _ = CASES[name]
        sim = made()
        sim.run(**length, **how)
        assert [event["kind"] for event in sim.events].count("collision") == 1, name
        assert len(sim.state) == 2


def test_any_step_of_a_file(tmp_path):
    sim, path = kd.Simulation(liquid(), dt=0.004), tmp_path / "a.h5md"
    sim.run(100, every=20, output=path)
    sim.run(100, output=path)
    for step in (0, 1, 57, 100, 163, 200):
        resumed = kd.resume(path, step=step)
        assert resumed.steps_done == step
        assert resumed.output is None
        assert [sample.step for sample in resumed.record.samples] == [k for k in range(0, 201, 20) if k <= step]
        resumed.run(200 - step)
        assert resumed.state.phase.tobytes() == sim.state.phase.tobytes()
    for step in (-1, 201):
        with pytest.raises(InputError, match=rf"step {step} is not in it; it goes from step 0 to 200"):
            kd.resume(path, step=step)


def test_the_cost_does_not_depend_on_the_length(tmp_path, monkeypatch):
    """A run that ended well is taken up without a step, and one that was cut from its last checkpoint on."""
    path = tmp_path / "a.h5md"
    kd.Simulation(liquid(), dt=0.004).run(300, every=10, output=path)
    taken = []
    advance = kd.Simulation._advance
    monkeypatch.setattr(
        kd.Simulation, "_advance", lambda sim, *how, **more: (taken.append(how), advance(sim, *how, **more))
    )
    kd.resume(path)
    assert taken == []
    kd.resume(path, step=299)
    assert sum(steps for steps, *_ in taken) == 299  # no flush between: the only one before it is the first


def test_it_goes_on_into_the_file_with_the_same_cadence(tmp_path):
    path = tmp_path / "a.h5md"
    kd.Simulation(liquid(), dt=0.004).run(60, every=20, output=path)
    resumed = kd.resume(path)
    resumed.run(50)
    resumed.run(10)
    with kd.open(path) as run:
        assert run.steps.tolist() == [0, 20, 40, 60, 80, 100, 110, 120]
    other = kd.resume(path)
    other.run(20, output=tmp_path / "b.h5md")
    with kd.open(path) as run:
        assert run.steps[-1] == 120
    with kd.open(tmp_path / "b.h5md") as run:
        assert run.steps.tolist() == [120, 140]


def test_a_start_from_heat(tmp_path):
    """Drawn velocities and an equilibration before: the file begins behind both."""
    sim, path = kd.Simulation(liquid(), dt=0.004), tmp_path / "a.h5md"
    sim.equilibrate(1.0, 0.4)
    interrupted(sim, path, 40, {"steps": 100}, every=20)
    whole = kd.Simulation(liquid(), dt=0.004)
    whole.equilibrate(1.0, 0.4)
    whole.run(100)
    resumed = kd.resume(path)
    resumed.run()
    assert resumed.state.phase.tobytes() == whole.state.phase.tobytes()


def test_nothing_but_a_start(tmp_path):
    """A kill before the first flush."""
    sim, path = kd.Simulation(liquid(), dt=0.004), tmp_path / "a.h5md"
    sim.run(20, every=10, output=tmp_path / "whole.h5md")

    def observe(sim):
        raise Stopped

    begun = kd.Simulation(liquid(), dt=0.004)
    with pytest.raises(Stopped):
        begun.run(20, every=10, output=path, observe=observe)
    with h5py.File(path, "r+") as file:
        file["kickdrift/committed"][...] = 0
    kd.resume(path).run()
    assert content(path) == content(tmp_path / "whole.h5md")


# --- what is refused, and what is said ---


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "a.h5md"
    kd.Simulation(liquid(), dt=0.004).run(20, every=10, output=path)
    return path


def test_another_system_is_refused(path):
    assert kd.resume(path, system=liquid()).steps_done == 20
    with pytest.raises(InputError, match="is the run of another system: positions, velocities differ"):
        kd.resume(path, system=liquid(seed=4))
    with pytest.raises(InputError, match="is the run of another system: forces differ"):
        kd.resume(path, system=liquid(cutoff=1.9))


def test_other_versions_are_named(path, monkeypatch):
    monkeypatch.setattr(restart, "processor", lambda: "abacus")
    (warning,) = kd.resume(path).run(10).warnings
    assert "the same bits are not promised: processor" in warning
    assert "abacus now" in warning


def test_a_frame_that_was_changed_is_noticed(path):
    with h5py.File(path, "r+") as file:
        file["particles/trajectory/position/value"][-1, 3, 0] += 1e-9
    (warning,) = kd.resume(path).record.warnings
    assert "1e-09 away from the file's last frame" in warning


def test_a_checkpoint_that_was_changed_is_refused(path):
    with h5py.File(path, "r+") as file:
        file["kickdrift/checkpoints/data"][-100] ^= 1
    with pytest.raises(InputError, match="damaged: the checkpoint of step 20 has changed"):
        kd.resume(path)


def test_a_file_without_checkpoints_is_refused(path):
    with h5py.File(path, "r+") as file:
        del file["kickdrift/checkpoints"]
    with pytest.raises(InputError, match="holds no checkpoint"):
        kd.resume(path)
    with kd.open(path) as run:
        assert len(run) == 3


def test_bytes_hold_everything_that_may_be_in_a_checkpoint():
    given = {
        "arrays": [np.arange(6.0).reshape(2, 3), np.array([], "i8"), np.array([True, False]), np.array(3.5)],
        "numbers": [1, -0.0, float("nan"), float("inf"), 2**62, 1e-320, np.float64(0.1), True, None],
        "nested": {"text": "å", "empty": {}, "list": [[], {"a": np.array([7], "i4")}]},
    }
    back = decoded(encoded(given))
    for first, second in zip(given["arrays"], back["arrays"], strict=True):
        assert (first.dtype, first.shape, first.tobytes()) == (second.dtype, second.shape, second.tobytes())
        assert second.flags.writeable
    assert repr([float(x) if isinstance(x, float) else x for x in given["numbers"]]) == repr(back["numbers"])
    assert repr(back["nested"]) == repr(given["nested"])
    for bad in ({"a": object()}, {1: 2}, {"array": 3}):
        with pytest.raises(TypeError):
            encoded(bad)
