"""Simulationarchives of rebound: read as Systems, and written with a snapshot for each frame of a run."""

from __future__ import annotations

import sys
import warnings

import numpy as np
import pytest
import rebound
from typer.testing import CliRunner

import kickdrift as kd
from kickdrift.bridges import rebound_snapshot
from kickdrift.cli.main import app
from kickdrift.errors import InputError


@pytest.fixture
def archive(tmp_path):
    """A star, two planets and a test particle: three snapshots 4 apart, to a time of 8."""
    sim = rebound.Simulation()
    sim.units = ("AU", "yr", "Msun")
    sim.add(m=1.0, r=0.005, name="Sun")
    sim.add(m=1e-3, a=1.1, e=0.1, inc=0.1, name="b")
    sim.add(m=3e-4, a=2.3, e=0.2, omega=1.0)
    sim.add(a=3.5, e=0.01)
    sim.N_active = 3
    sim.move_to_com()
    sim.integrator, sim.dt = "whfast", 0.01
    sim.integrator.safe_mode = 0
    path = tmp_path / "archive.bin"
    for _ in range(3):
        sim.save_to_file(str(path))
        sim.steps(400)
    return path


def phase(sim):
    return np.array([[p.x, p.y, p.z, p.vx, p.vy, p.vz] for p in sim.particles])


def own(state):
    return np.hstack([state.positions, state.velocities])


@pytest.mark.parametrize("snapshot", [None, 0, 1, -2])
def test_a_snapshot_is_a_system(archive, snapshot):
    system = kd.load(archive, snapshot=snapshot)
    there = rebound.Simulationarchive(str(archive))[-1 if snapshot is None else snapshot]
    np.testing.assert_array_equal(own(system.state), phase(there))
    assert (system.name, system.units.name, system.state.time) == ("archive", "astro", there.t)
    assert system.names == ("Sun", "b", "particle 2", "particle 3")
    assert system.radii.tolist() == [0.005, 0.0, 0.0, 0.0]
    assert (system.run.integrator, system.run.dt) == ("wisdom-holman", 0.01)
    assert system.to_rebound().G == there.G


def test_a_run_from_an_archive_goes_on_as_rebound(archive):
    sim = kd.Simulation(kd.load(archive))
    sim.run(300)
    there = rebound.Simulationarchive(str(archive))[-1]
    there.steps(300)
    there.synchronize()
    np.testing.assert_allclose(own(sim.state), phase(there), rtol=0, atol=1e-9)


def test_a_run_comes_back_from_its_archive(archive, tmp_path):
    run, out = tmp_path / "run.h5md", tmp_path / "out.bin"
    kd.Simulation(kd.load(archive)).run(50, every=10, output=run)
    done = kd.export(run, out)
    assert (done.frames, done.notes) == (6, ())
    found = rebound.Simulationarchive(str(out))
    with kd.open(run) as frames:
        assert len(found) == len(frames)
        for there, frame in zip(found, frames, strict=True):
            np.testing.assert_array_equal(phase(there), own(frame.state))
            assert (there.t, there.steps_done, there.N_active) == (frame.time, frame.step, 3)
            assert there.integrator == "whfast"
    back = kd.load(out, snapshot=2)
    assert (back.names, back.units.name, back.run.dt) == (("Sun", "b", "particle 2", "particle 3"), "astro", 0.01)
    with pytest.raises(InputError, match="exists already"):
        kd.export(run, out)
    kd.export(run, out, overwrite=True, start=-1)
    assert len(rebound.Simulationarchive(str(out))) == 1


def test_merged_and_removed_bodies_leave_the_archive(tmp_path):
    """The second body merges with the first, and the third escapes."""
    x = [[0, 0, 0], [0.4, 0, 0], [9.0, 0, 0], [0, 5.0, 0]]
    system = kd.System(
        x, [[0, 0, 0], [-1.0, 0, 0], [4.0, 0, 0], [0.3, 0, 0]], [1.0, 0.1, 0.0, 0.01], forces=[kd.Gravity()],
        units="nbody", radii=[0.1, 0.1, 0.0, 0.0], names=["Sun", "b", "c", "d"],
        events=[kd.Collision(), kd.Escape(distance=12.0, action="remove")],
    )  # fmt: skip
    run, out = tmp_path / "run.h5md", tmp_path / "out.bin"
    kd.Simulation(system, "gauss-radau15").run(until=2.0, interval=0.5, output=run)
    done = kd.export(run, out)
    assert "bodies that were removed are left out from then on" in done.notes
    found = rebound.Simulationarchive(str(out))
    assert [found[0].N, found[len(found) - 1].N] == [4, 2]
    last = found[len(found) - 1]
    assert [p.name for p in last.particles] == ["Sun", "d"]
    assert last.particles[0].m == pytest.approx(1.1, rel=1e-15)


def test_the_command_line_takes_archives(archive, tmp_path):
    runner, run = CliRunner(), tmp_path / "run.h5md"
    done = runner.invoke(app, ["run", str(archive), "--steps", "20", "--every", "10", "--output", str(run)])
    assert done.exit_code == 0, done.output
    assert "archive: 4 particles, units astro" in done.output
    done = runner.invoke(app, ["export", str(run), str(tmp_path / "out.bin")])
    assert done.exit_code == 0, done.output
    assert "3 frames of 4 particles" in done.output
    done = runner.invoke(app, ["info", str(archive)])
    assert done.exit_code == 0, done.output
    assert "wisdom-holman" in done.output


def test_what_an_archive_loses_is_said(tmp_path):
    sim = rebound.Simulation()
    sim.add(m=1.0)
    sim.add(m=1e-3, a=1.0)
    sim.collision = "direct"
    sim.additional_forces = lambda r: None
    sim.save_to_file(str(tmp_path / "a.bin"))
    with pytest.warns(UserWarning, match=r"left out: additional forces .*; the action on collisions \('direct'\)"):
        kd.load(tmp_path / "a.bin")
    kd.Simulation(kd.load("lj-1000")).run(2, output=tmp_path / "lj.h5md")
    done = kd.export(tmp_path / "lj.h5md", tmp_path / "lj.bin")
    assert done.notes == (
        "positions are inside the box",
        "force 'lennard-jones' is left out",
        "the box is left out",
        "integrator 'velocity-verlet' as it is set here is left out",
    )


def test_bad_archives_are_one_line(archive, tmp_path, monkeypatch):
    content = archive.read_bytes()
    for name, bytes_, text in [
        ("a.bin", b"precious", "is no Simulationarchive of rebound"),
        ("b.bin", content[:64], "rebound cannot read this archive"),
    ]:
        (tmp_path / name).write_bytes(bytes_)
        with pytest.raises(InputError, match=f"{name}: {text}"):
            kd.load(tmp_path / name)
    with pytest.raises(InputError, match="has no snapshot 7; the archive holds 3, from 0 to 2"):
        kd.load(archive, snapshot=7)
    with pytest.raises(InputError, match=r"snapshot: expected a whole number, got 1\.5"):
        kd.load(archive, snapshot=1.5)
    with pytest.raises(InputError, match="snapshot: is for archives of rebound"):
        kd.load("two-body", snapshot=1)
    (tmp_path / "cut.bin").write_bytes(content[:-200])
    with pytest.warns(UserWarning, match="the end of the archive is damaged; its 2 whole snapshots are read"):
        assert kd.load(tmp_path / "cut.bin").state.time == pytest.approx(4.0)
    for name in [each for each in sys.modules if each.split(".")[0] == "rebound"]:
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.setitem(sys.modules, "rebound", None)
    with pytest.raises(
        InputError, match=r"archive.bin: an archive of rebound needs rebound: pip install 'kickdrift\[rebound\]'"
    ):
        kd.load(archive)


def test_a_name_beyond_ascii(archive, tmp_path):
    other = tmp_path / "Käse.bin"
    other.write_bytes(archive.read_bytes())
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(kd.load(other)) == 4
    kd.Simulation(kd.load(archive)).run(2, output=tmp_path / "run.h5md")
    with pytest.raises(InputError, match="ASCII alone"):
        kd.export(tmp_path / "run.h5md", tmp_path / "ä.bin")


def changed_at(content, place, value):
    return content[:place] + bytes([value]) + content[place + 1 :]


def outcome(path):
    """What a damaged archive gives: "" for a System, or the line of the refusal."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            kd.load(path)
    except InputError as error:
        return str(error)
    return ""


def test_an_archive_that_ends_rebound_is_one_line(archive, tmp_path):
    """rebound's own reader ends the process with a signal on the first of these, and raises on the second."""
    content, bad = archive.read_bytes(), tmp_path / "bad.bin"
    bad.write_bytes(changed_at(content, 220, 255))
    done = CliRunner().invoke(app, ["info", str(bad)])
    assert isinstance(done.exception, InputError)
    assert "bad.bin: rebound cannot read this archive, so it is damaged: rebound ended with SIG" in str(done.exception)
    bad.write_bytes(changed_at(content, content.index(b"Sun\0"), 255))
    assert outcome(bad).endswith("bad.bin: rebound cannot read this archive: a name in it is not text")


@pytest.mark.skipif(sys.platform != "linux", reason="the limits of other systems differ")
@pytest.mark.parametrize(
    ("work", "text"),
    [
        ("while True: pass", "takes too much time or memory"),
        ("x = bytearray(2**31)", "ended with status 1"),
        ("os.write(os.open('new', os.O_CREAT | os.O_WRONLY), b'x')", "ended with status 1"),
        ("print('x' * 2**23)", "takes too much time or memory"),
        ('print(\'{"snapshots": "many"}\')', "its settings make no sense"),
        ('print(\'{"snapshots": 1, "snapshot": {}}\')', "its settings make no sense"),
    ],
)
def test_the_reader_of_archives_has_limits(archive, tmp_path, monkeypatch, work, text):
    """A reader that goes wrong in one of these ways, under the limits of the real one."""
    reader = tmp_path / "reader.py"
    limits = f"limit = runpy.run_path({rebound_snapshot.__file__!r})['_limit']\nlimit.__globals__['CPU_SECONDS'] = 1\n"
    reader.write_text(f"import os, runpy\nos.chdir({str(tmp_path)!r})\n{limits}limit(0)\n{work}\n")
    monkeypatch.setattr(rebound_snapshot, "__file__", str(reader))
    assert outcome(archive).endswith(text)
