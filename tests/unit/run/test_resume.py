"""Runs resumed from their files have the bits of uninterrupted runs."""

from __future__ import annotations

import importlib
import linecache
import sys
from dataclasses import replace
from typing import Any

import h5py
import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.integrators import integrator
from kickdrift.run import resuming as restart
from kickdrift.run.advance import Integration
from kickdrift.trajectory.layout.checkpoints import decoded, encoded
from kickdrift.trajectory.layout.record import changed_sources, system_of
from kickdrift.trajectory.write import continued
from kickdrift.trajectory.write.h5md import Writer
from tests.long import rest, shortened
from tests.methods import METHODS, OF_EACH_FORM
from tests.systems import in_frame, liquid, needed, pressed, tried_with


class Stopped(Exception):
    """Exception that ends a run without the checkpoint of its last flush."""


def interrupted(sim, path, at, length, **how):
    """Run into the file, and stop at step ``at`` like a kill, without a last checkpoint or report."""

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
    """A report without wall times."""
    clock = ("wall_seconds", "compile_seconds", "seconds", "steps_per_second", "ns_per_pair")
    return {key: value for key, value in report.as_json().items() if key not in clock}


def trio(**how):
    """Three bodies; two of them merge during the run."""
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


@pytest.mark.parametrize("case", shortened(CASES, {*CASES} - {"its own steps"}))
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


OF_METHODS: list[Any] = [(name, {}) if name in OF_EACH_FORM else rest(name, {}) for name in METHODS]
OF_METHODS += [
    rest(name, {key: value})
    for name in METHODS for key, all in integrator(name).choices.items() for value in all if tried_with(name, key)
]  # fmt: skip


@pytest.mark.parametrize(("name", "options"), OF_METHODS, ids=lambda value: str(value).strip("{}"))
def test_files_of_every_method_and_choice_are_opened_and_resumed(tmp_path, name, options):
    sim, path = taken_by(name, options), tmp_path / "a.h5md"
    sim.run(4, every=2, output=path)
    resumed = kd.resume(path, step=2)
    assert resumed.integrator == name
    resumed.run(2)
    assert resumed.state.phase.tobytes() == sim.state.phase.tobytes()


def taken_by(name, given):
    """A Simulation with a method, of planets, or of a liquid if the method refuses planets."""
    method = integrator(name)
    options = given | ({"dt": 0.002} if method.needs_dt else {})
    options |= needed(name) | pressed(given) | ({"rtol": 1e-6} if "rtol" in method.tunable else {})
    try:
        return kd.Simulation(in_frame(name, trio().watched(())), name, **options)
    except InputError:
        return kd.Simulation(liquid(), name, **options)


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
        with pytest.raises(InputError, match=rf"has no step {step}; its steps are 0 to 200"):
            kd.resume(path, step=step)


def test_the_cost_does_not_depend_on_the_length(tmp_path, monkeypatch):
    """A restart begins at the last checkpoint, and checkpoints are no further apart in a longer run."""
    monkeypatch.setattr(continued, "SHARE", 1e-9)
    monkeypatch.setattr(continued, "SECONDS", 1e9)
    path, longer = tmp_path / "a.h5md", tmp_path / "b.h5md"
    kd.Simulation(liquid(), dt=0.004).run(300, every=10, output=path)
    monkeypatch.setattr(continued, "SHARE", 1e9)
    kd.Simulation(liquid(), dt=0.004).run(600, every=10, output=longer, file=kd.FileOptions(flush=1e-9))
    taken = []
    advance = Integration.advance
    monkeypatch.setattr(
        Integration, "advance", lambda run, *how, **more: (taken.append(how), advance(run, *how, **more))[1]
    )
    kd.resume(path)
    assert taken == []
    kd.resume(path, step=299)
    assert sum(steps for steps, *_ in taken) == 299  # a short run, without a flush between start and end
    for step in (99, 599):
        taken.clear()
        kd.resume(longer, step=step)
        assert sum(steps for steps, *_ in taken) == 9


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
    """Velocities are drawn and the system is equilibrated first: the file begins after both."""
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
    """A kill comes before the first flush."""
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


# --- refusals and warnings ---


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "a.h5md"
    kd.Simulation(liquid(), dt=0.004).run(20, every=10, output=path)
    return path


def test_another_system_is_refused(path):
    assert kd.resume(path, system=liquid()).steps_done == 20
    with pytest.raises(InputError, match="belongs to another system: positions, velocities differ"):
        kd.resume(path, system=liquid(seed=4))
    with pytest.raises(InputError, match="belongs to another system: forces differ"):
        kd.resume(path, system=liquid(cutoff=1.9))


def test_other_versions_are_named(path, monkeypatch):
    monkeypatch.setattr(restart, "processor", lambda: "abacus")
    (warning,) = kd.resume(path).run(10).warnings
    assert "bits may differ: processor" in warning
    assert "now abacus" in warning


def test_other_processor_features_are_named(path, monkeypatch):
    """The compiler may use different features of one processor (NUMBA_CPU_FEATURES)."""
    assert kd.resume(path).run(10).warnings == []
    monkeypatch.setattr(restart, "features", lambda: ("abacus", "beads"))
    (warning,) = kd.resume(path).run(10).warnings
    assert "bits may differ: the file's run used " in warning
    assert warning.endswith("this one does not; this run uses abacus, beads, the file's did not")


@pytest.mark.parametrize("checksums", [True, False])
def test_a_frame_that_was_changed_is_noticed(path, checksums):
    """The checksum shows the change. An older file has no checksum; the resumed run notices the difference."""
    with h5py.File(path, "r+") as file:
        file["particles/trajectory/position/value"][-1, 3, 0] += 1e-9
        if not checksums:
            del file["kickdrift/checksums"], file["kickdrift"].attrs["sha256"]
    (warning,) = kd.resume(path).record.warnings
    damaged = "the file's end is damaged; the run is computed again from step 10"
    assert (damaged if checksums else "positions differ by 1e-09 from the file's frame") in warning


def test_an_earlier_checkpoint_takes_the_place_of_one_that_was_changed(path):
    with h5py.File(path, "r+") as file:
        file["kickdrift/checkpoints/data"][-100] ^= 1
    sim = kd.resume(path)
    assert sim.steps_done == 20
    (warning,) = sim.record.warnings
    assert "damaged: the checkpoint of step 20 has changed; an earlier checkpoint is used" in warning


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


# --- earlier parts of the run ---


def test_a_state_that_was_replaced(tmp_path):
    sim, path = kd.Simulation(liquid(), dt=0.004), tmp_path / "a.h5md"
    sim.run(100, every=20, output=path)
    sim.state = replace(sim.state, phase=sim.state.phase * [[[1.0]], [[-1.0]]])
    sim.run(100, output=path)
    resumed = kd.resume(path, step=150)
    resumed.run(50)
    assert resumed.state.phase.tobytes() == sim.state.phase.tobytes()


def test_a_lattice_that_was_turned_around(tmp_path):
    sim, path = kd.Simulation(liquid(), "leapfrog-exact", dt=0.004), tmp_path / "a.h5md"
    sim.run(40, every=20, output=path)
    sim.method_state = sim.method_state.reversed()
    sim.run(40, output=path)
    resumed = kd.resume(path, step=50)
    resumed.run(30)
    assert resumed.state.phase.tobytes() == sim.state.phase.tobytes()


def test_a_run_that_an_event_stopped_and_that_went_on(tmp_path):
    path = tmp_path / "a.h5md"
    sim = kd.Simulation(trio().watched([kd.Collision(0.05, action="stop")]), "velocity-verlet", dt=0.002)
    sim.run(700, every=50, output=path)
    assert sim.stopped
    stopped_at = sim.steps_done
    assert kd.resume(path).stopped == sim.stopped
    sim.run(700, output=path)
    resumed = kd.resume(path, step=stopped_at + 80)
    assert resumed.steps_done == stopped_at + 80
    resumed.run(620)
    assert resumed.state.phase.tobytes() == sim.state.phase.tobytes()


def test_events_behind_the_last_look_are_written_once(tmp_path):
    path, system = tmp_path / "a.h5md", trio().watched([kd.Crossing.pericentre(1, 0), kd.Crossing.apocentre(1, 0)])
    system = system.at(system.state.phase * [[[1.0]], [[2.0]]], 0.0)

    def killed(done, of):
        if len(sim.events) >= 3:
            raise Stopped

    sim = kd.Simulation(system, "velocity-verlet", dt=0.002)
    with pytest.raises(Stopped):
        sim.run(9000, every=9000, output=path, progress=killed, file=kd.FileOptions(flush=1e-9))
    with kd.open(path) as run:
        assert run.events == []
    resumed = kd.resume(path)
    resumed.run()
    with kd.open(path) as run:
        times = [event["time"] for event in run.events]
    assert len(times) == len(set(times)) == len(resumed.events) >= 3


def test_a_file_is_left_as_it_is_by_who_has_fallen_behind(tmp_path):
    sim, path = kd.Simulation(liquid(), dt=0.004), tmp_path / "a.h5md"
    sim.run(20, every=10, output=path)
    kd.resume(path).run(20)
    before = path.read_bytes()
    with pytest.raises(InputError, match="ends at step 40; step 20 cannot follow it"):
        sim.run(10, output=path)
    assert path.read_bytes() == before


def test_a_law_that_was_edited_is_named(tmp_path, monkeypatch):
    law = """
from typing import NamedTuple
import kickdrift as kd

@kd.pair_law
class Mine(NamedTuple):
    k: float = 1.0
    def law(p, r2):
        return p.k * (4.0 - r2) ** 2, 4.0 * p.k * (4.0 - r2)
"""
    for text, expected in ((law, []), (law.replace("p.k * (4.0 - r2) ** 2", "1.0 * p.k * (4.0 - r2) ** 2"), ["Mine"])):
        (tmp_path / "somebodys_law.py").write_text(text)
        monkeypatch.syspath_prepend(tmp_path)
        monkeypatch.delitem(sys.modules, "somebodys_law", raising=False)
        importlib.invalidate_caches()
        linecache.clearcache()
        module = importlib.import_module("somebodys_law")
        system = kd.System(np.eye(3), box=(9.0,) * 3, forces=[module.Mine(cutoff=2.0)])
        path = tmp_path / "a.h5md"
        if not path.exists():
            with Writer(path, system, method={}, every=1):
                pass
        with kd.open(path) as run:
            assert changed_sources(system_of(run), run) == expected


def test_a_file_that_was_begun_after_a_merger(tmp_path):
    system = trio(names=["star", "planet", "rock"]).watched(
        [kd.Collision(0.05), kd.CloseApproach(2.5, ["planet", "rock"])]
    )
    sim, path = kd.Simulation(system, "velocity-verlet", dt=0.002), tmp_path / "a.h5md"
    sim.run(800)
    assert len(sim.state) == 2
    sim.run(100, every=20, output=path)
    resumed = kd.resume(path, step=850)
    resumed.run(50)
    assert resumed.state.phase.tobytes() == sim.state.phase.tobytes()


def test_time_counts_from_step_0(tmp_path):
    sim, path = kd.Simulation(liquid(), dt=0.01), tmp_path / "a.h5md"
    sim.run(100)
    sim.run(50, every=50, output=path)
    resumed = kd.resume(path)
    assert restart.continued(resumed, None, 2.5).end_step == 250
    assert restart.continued(resumed, 300, None).end_step == 300


def test_a_function_of_ones_own_with_a_system_of_ones_own(tmp_path):
    crossing = kd.Crossing(lambda t, x, v: t - 0.01, "a time")
    system, path = trio().watched([crossing]), tmp_path / "a.h5md"
    kd.Simulation(system, "velocity-verlet", dt=0.002).run(20, every=10, output=path)
    assert kd.resume(path, system=system, events=[crossing]).steps_done == 20


def test_the_file_that_a_run_goes_on_into_is_not_lost(path):
    resumed = kd.resume(path)
    with pytest.raises(InputError, match="this run continues this file; give another output"):
        resumed.run(10, overwrite=True)
    path.rename(path.with_name("b.h5md"))
    with pytest.raises(InputError, match="this run continues this file, which is gone"):
        resumed.run(10)
    assert not path.exists()


def test_a_link_stays_one(tmp_path, path):
    link = tmp_path / "link.h5md"
    link.symlink_to(path)
    kd.resume(link).run(10)
    assert link.is_symlink()
    with kd.open(path) as run:
        assert run.steps[-1] == 30


@pytest.mark.parametrize("step", [1.5, "x", True])
def test_a_step_is_a_whole_number(path, step):
    with pytest.raises(InputError, match="step: expected a whole number"):
        kd.resume(path, step=step)
