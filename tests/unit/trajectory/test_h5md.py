"""Native file format: reading by MDAnalysis and plain h5py, and the file after kills, full disks and second writers."""

from __future__ import annotations

import errno
import json
import os
import shutil
import subprocess
import sys
import time
from collections import namedtuple
from pathlib import Path

import h5py
import numpy as np
import pytest

from kickdrift.errors import InputError, RunError
from kickdrift.model.state import State
from kickdrift.model.system import System
from kickdrift.model.units.unit_systems import UnitSystem
from kickdrift.trajectory.file import storage
from kickdrift.trajectory.layout import header
from kickdrift.trajectory.layout.contents import Contents
from kickdrift.trajectory.layout.options import FileOptions
from kickdrift.trajectory.read import reader
from kickdrift.trajectory.read.info import describe, info
from kickdrift.trajectory.write.h5md import Writer
from tests.long import rest

METHOD = {"integrator": "velocity-verlet", "dt": 0.005, "threads": 1, "seed": 7}
SI = UnitSystem("si", "m", "s", "kg", "J", "K", 1.380649e-23)


def make_system(n=30, box=(5.0, 6.0, 7.0), units="lj", scale=1.0) -> System:
    rng = np.random.default_rng(1)
    x, v = rng.uniform(-20, 20, (n, 3)) * scale, rng.normal(size=(n, 3))
    return System(
        x, v, masses=np.arange(1.0, n + 1), box=box, units=units, species=["A", "Bb", "A"] * (n // 3), source="# lj\n"
    )


@pytest.mark.parametrize("units", ["lj", "si"])
@pytest.mark.parametrize(
    ("box", "precision", "write"),
    [
        (None, "float64", ()),
        (None, "float32", ("forces",)),
        ((5.0, 6.0, 7.0), "float32", ()),
        ((5.0, 6.0, 7.0), "float64", ("forces", "images")),
    ],
)
def test_what_a_new_file_holds_is_known_without_reading_it(path, units, box, precision, write):
    system, options = make_system(box=box, units=units), FileOptions(store=precision, write=write)
    Writer(path, system, method=METHOD, every=10, options=options).close()
    with h5py.File(path) as file:
        found = header.read(Contents(file, path))
    for name, known in vars(header.outline_of(system, options)).items():
        np.testing.assert_equal(getattr(found, name), known, err_msg=name)
    assert found.growing == header.outline_of(system, options).growing


def make_state(system: System, step: int, dt=0.005) -> State:
    s = system.state
    phase = s.phase.copy()
    phase[0] += phase[1] * step * dt
    return State(phase, s.masses, s.ids, s.box, step * dt, step)


def sample(step: int) -> dict:
    return {
        "kinetic_energy": 1.0 + step,
        "potential_energy": -3.0 - step / 3,
        "total_energy": -2.0 + step * 2 / 3,
        "temperature": 1.5,
        "momentum": np.array([step, 0.0, 1.0]),
    }


def write(path, system=None, steps=40, every=10, frame_every=20, report=None, **options) -> System:
    system = system or make_system()
    with Writer(path, system, method=METHOD, every=every, **options) as writer:
        for step in range(0, steps + 1, every):
            writer.append(make_state(system, step), sample(step), frame=step % frame_every == 0)
        writer.report = report
    return system


@pytest.fixture
def path(tmp_path) -> Path:
    return tmp_path / "run.h5md"


# -- other programs


@pytest.mark.filterwarnings("ignore:there is no reference attributes:UserWarning")
@pytest.mark.parametrize("box", [(5.0, 6.0, 7.0), None])
def test_mdanalysis_opens_with_no_keyword(path, box):
    MDAnalysis = pytest.importorskip("MDAnalysis")
    system = write(path, make_system(box=box))
    universe = MDAnalysis.Universe(str(path))
    assert len(universe.atoms) == 30
    assert len(universe.trajectory) == 3
    for index, frame in enumerate(universe.trajectory):
        state = make_state(system, 20 * index)
        np.testing.assert_array_equal(frame.positions, state.positions.astype("f4"))
        np.testing.assert_array_equal(frame.velocities, state.velocities.astype("f4"))
        assert frame.time == state.time
        assert frame.data["step"] == 20 * index
        # Samples between frames do not shift the observables that MDAnalysis assigns to a frame.
        assert frame.data["total_energy"] == sample(20 * index)["total_energy"]
        np.testing.assert_array_equal(frame.data["momentum"], sample(20 * index)["momentum"])
        assert frame.dimensions is None if box is None else list(frame.dimensions) == [*box, 90, 90, 90]
    universe.trajectory.close()


@pytest.mark.filterwarnings("ignore:there is no reference attributes:UserWarning")
def test_si_is_stored_in_angstrom_and_ps(path):
    MDAnalysis = pytest.importorskip("MDAnalysis")
    system = write(path, make_system(units=SI, box=(5e-9,) * 3, scale=1e-10))
    with h5py.File(path) as file:
        np.testing.assert_allclose(
            file["particles/trajectory/velocity/value"][0], system.state.velocities * 0.01, rtol=1e-15
        )
    universe = MDAnalysis.Universe(str(path))
    np.testing.assert_allclose(universe.trajectory[1].positions, make_state(system, 20).positions * 1e10, rtol=1e-6)
    assert universe.trajectory[1].time == pytest.approx(0.1e12)
    assert universe.dimensions[0] == pytest.approx(50)
    universe.trajectory.close()
    with reader.open(path) as run:
        assert not run.nominal_units
        assert run[1].time == pytest.approx(0.1, rel=1e-15)
        np.testing.assert_allclose(run[1].positions, make_state(system, 20).positions, rtol=4e-16, atol=0)
        assert run.box.lengths == system.box.lengths


def test_plain_h5py_finds_h5md_1_1(path):
    """Based on the H5MD 1.1 specification (de Buyl, Colberg & Höfling 2014) and the layout in `h5md.py`."""
    system = write(path, report={"verdict": "bounded"})
    with open(path, "rb") as raw:
        assert raw.read(9)[8] == 0, "superblock version 0: HDF5's earliest format"
    with h5py.File(path) as file:
        assert list(file["h5md"].attrs["version"]) == [1, 1]
        assert "name" in file["h5md/author"].attrs
        assert file["h5md/creator"].attrs["name"] == "kickdrift"
        assert file["h5md/creator"].attrs["version"]
        assert list(file["particles"]) == ["trajectory"]
        group = file["particles/trajectory"]
        assert group["box"].attrs["dimension"] == 3
        assert list(group["box"].attrs["boundary"]) == [b"periodic"] * 3
        assert group["position/value"].dtype == group["velocity/value"].dtype == np.float64
        for key in ("step", "time"):
            for element in (group["velocity"], group["box/edges"], file["observables/momentum"]):
                assert element[key] == group["position"][key], "must be a hard link to the same dataset"
        for index, step in enumerate((0, 20, 40)):
            state = make_state(system, step)
            assert group["position/step"][index] == step
            assert group["position/time"][index] == state.time
            np.testing.assert_array_equal(group["position/value"][index], state.positions)
            np.testing.assert_array_equal(group["velocity/value"][index], state.velocities)
            np.testing.assert_array_equal(group["box/edges/value"][index], system.box.lengths)
        assert group["position/value"].attrs["unit"] == "Angstrom"
        assert group["position/time"].attrs["unit"] == "ps"
        assert group["velocity/value"].attrs["unit"] == "Angstrom ps-1"
        assert h5py.check_enum_dtype(group["species"].dtype) == {"A": 0, "Bb": 1}
        np.testing.assert_array_equal(group["species"], system.species_index)
        np.testing.assert_array_equal(group["mass"], system.state.masses)
        np.testing.assert_array_equal(group["id"], np.arange(30))
        for name, element in file["observables"].items():
            assert isinstance(element, h5py.Group), name
            assert len(element["value"]) == 3
        own = file["kickdrift"]
        assert own.attrs["every"] == 10
        assert own["units"].attrs["name"] == "lj"
        assert own["units"].attrs["length"] == "sigma"
        assert own["units"].attrs["nominal"]
        assert own["system/source"].asstr()[()] == "# lj\n"
        np.testing.assert_array_equal(own["system/phase"], system.state.phase)
        assert json.loads(own["method"].asstr()[()]) == METHOD
        assert {"kickdrift", "numpy", "numba", "h5py"} <= json.loads(own["versions"].asstr()[()]).keys()
        assert json.loads(own["report"][()].tobytes()) == {"verdict": "bounded"}
        np.testing.assert_array_equal(own["samples/step"], [0, 10, 20, 30, 40])
        np.testing.assert_array_equal(own["samples/momentum"][3], [30, 0, 1])
        assert own["samples/total_energy"].attrs["unit"] == "epsilon"


# -- our reader


def test_frames_keep_the_order_of_the_ids(path):
    system = make_system()
    order = np.random.default_rng(2).permutation(30)
    s = system.state
    with Writer(path, system, method=METHOD, every=1) as writer:
        writer.append(State(s.phase[:, :, order], s.masses[order], s.ids[order], s.box), {})
    with reader.open(path) as run:
        np.testing.assert_array_equal(run[0].positions, s.positions)
        np.testing.assert_array_equal(run[0].velocities, s.velocities)


def test_forces_and_array_parameters_are_recorded(path):
    class Spring(namedtuple("Spring", "k anchors")):
        def check(self, system):
            pass

    system = System(np.zeros((2, 3)), forces=[Spring(2.0, np.eye(2))])
    Writer(path, system, method=METHOD, every=1).close()
    with reader.open(path) as run:
        force = run.system_record["forces"][0]
        assert force["type"].endswith("<locals>.Spring")
        assert force["parameters"] == {"k": 2.0, "anchors": [[1.0, 0.0], [0.0, 1.0]]}


@pytest.mark.parametrize("n", [1, 9, 1000, 20_000])
def test_chunks_are_whole_and_small(path, n):
    system = System(np.zeros((n, 3)))
    with Writer(path, system, method=METHOD, every=1) as writer:
        for step in range(3):
            writer.append(make_state(system, step), {})
    with h5py.File(path) as file:
        frames, particles, _ = file["particles/trajectory/position/value"].chunks
        assert frames * particles * 24 <= 128 * 1024
        assert frames >= min(32, 8 * 2**20 // (48 * n)), "one particle's path must not read a chunk for each frame"
    assert path.stat().st_size < 3 * 48 * n * 20 + 2**20


def test_info_tells_what_is_there(path):
    write(path, report={"energy": {"verdict": "bounded"}})
    found = info(path)
    assert found["particles"] == 30
    assert found["species"] == {"A": 20, "Bb": 10}
    assert found["frames"] == 3
    assert found["samples"] == 5
    assert found["observables"]["total_energy"] == {"first": -2.0, "last": sample(40)["total_energy"]}
    assert found["closed"]
    text = describe(found)
    for part in ("1 σ as 1 angstrom", "velocity-verlet", "0 to 0.2 τ", "bounded", "5 × 6 × 7", "20 A, 10 Bb"):
        assert part in text
    json.dumps(found)


def test_info_and_writing_do_not_load_numba(path):
    code = (
        "import kickdrift.trajectory.read.info, kickdrift.trajectory.write.h5md, sys; sys.exit('numba' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


# -- continuing


def test_append_to_continues_the_same_run(path):
    system = write(path, report={"part": 1})
    with reader.open(path) as run:
        run_id = run.run_id
    with Writer.append_to(path, run_id) as writer:
        assert writer.last_sample[0] == writer.last_frame[0] == 40
        for step in (40, 50, 60):  # 40 exists already and stays unchanged
            writer.append(make_state(system, step), sample(step), frame=step != 50)
        with pytest.raises(InputError, match="ends at step 60"):
            writer.append(make_state(system, 50), sample(50))
        writer.report = {"part": 2}
    with reader.open(path) as run:
        np.testing.assert_array_equal(run.steps, [0, 20, 40, 60])
        np.testing.assert_array_equal(run.sample_steps, np.arange(0, 70, 10))
        np.testing.assert_array_equal(run[-1].positions, make_state(system, 60).positions)
        assert run.report == {"part": 2}


def test_a_continuation_that_does_not_finish_leaves_no_report(path):
    write(path, report={"part": 1})
    with reader.open(path) as run:
        run_id = run.run_id
    Writer.append_to(path, run_id).close()
    with reader.open(path) as run:
        assert run.report is None


def test_append_to_refuses_another_run(path):
    write(path)
    with pytest.raises(InputError, match="another run"):
        Writer.append_to(path, "0" * 32)


def test_append_to_cuts_what_a_kill_left(path):
    system = write(path)
    with h5py.File(path, "r+") as file:  # two more frames, as after a kill before the commit
        run_id = file["kickdrift"].attrs["run_id"]
        for name in ("position/value", "velocity/value", "position/step"):
            file["particles/trajectory"][name].resize(5, axis=0)
        file["kickdrift/samples/time"].resize(9, axis=0)
    with reader.open(path) as run:
        assert len(run) == 3
        assert run.half_written == {"frames": 2, "samples": 0, "events": 0}
        assert len(run.sample_times) == 5
    assert "2 frames were left half written" in describe(info(path))
    with Writer.append_to(path, run_id) as writer:
        writer.append(make_state(system, 60), sample(60))
    with h5py.File(path) as file:
        assert all(len(file["particles/trajectory"][name]) == 4 for name in ("position/value", "velocity/value"))
        np.testing.assert_array_equal(file["kickdrift/samples/step"], [0, 10, 20, 30, 40, 60])


# -- failures

CHILD = """
import sys, numpy as np
from kickdrift.model.state import State
from kickdrift.model.system import System
from kickdrift.trajectory.write.h5md import Writer

system = System(np.zeros((40, 3)), box=(10, 10, 10))
s = system.state
with Writer(sys.argv[1], system, method={}, every=1, flush_bytes=1) as writer:
    for step in range(10**9):
        state = State(np.full((2, 3, 40), float(step)), s.masses, s.ids, s.box, step / 2, step)
        writer.append(state, {"total_energy": step}, frame=step % 2 == 0)
        if step == 4:
            print("running", flush=True)
"""


def start_child(path) -> subprocess.Popen:
    child = subprocess.Popen([sys.executable, "-c", CHILD, path], stdout=subprocess.PIPE)
    assert child.stdout is not None
    assert child.stdout.readline() == b"running\n"
    return child


@pytest.mark.skipif(sys.platform == "win32", reason="needs kill -9")
@pytest.mark.parametrize("delay", [0.0, rest(0.03), rest(0.11), 0.23])
def test_a_killed_run_leaves_whole_frames(path, delay):
    """The child flushes every sample, so nearly every moment is inside a flush."""
    child = start_child(path)
    time.sleep(delay)
    child.kill()
    child.wait()
    child.stdout.close()
    with reader.open(path) as run:
        assert len(run) >= 3
        np.testing.assert_array_equal(run.steps, 2 * np.arange(len(run)))
        for frame in run:
            assert np.all(frame.positions == frame.step)
            assert np.all(frame.velocities == frame.step)
        np.testing.assert_array_equal(run.observables["total_energy"], run.sample_steps)
        assert run.report is None
    with h5py.File(path) as file:  # a program that counts frames by the positions finds the other data
        n = len(file["particles/trajectory/position/value"])
        assert len(file["particles/trajectory/velocity/value"]) >= n
        assert len(file["observables/total_energy/value"]) >= n


def test_a_second_writer_in_another_process_is_refused(path):
    child = start_child(path)
    try:
        with pytest.raises(InputError, match="is open in another program"):
            Writer(path, make_system(), method=METHOD, every=1, overwrite=True)
        with pytest.raises(InputError, match="writing to it at this moment"):
            reader.open(path)
    finally:
        child.kill()
        child.wait()
        child.stdout.close()
    with reader.open(path) as run:
        assert len(run) >= 3


def test_a_second_writer_in_this_process_is_refused(path):
    system = make_system()
    with Writer(path, system, method=METHOD, every=1) as writer:
        with pytest.raises(InputError, match="is open in another"):
            Writer.append_to(path, writer.run_id)
        writer.append(make_state(system, 0), sample(0))
    with reader.open(path) as run:
        assert len(run) == 1


def test_a_full_disk_keeps_what_was_flushed(path, monkeypatch):
    """A disk takes half of the new data and then no more: the file is unchanged to the byte."""
    system = make_system()
    writer = Writer(path, system, method=METHOD, every=10)
    writer.append(make_state(system, 0), sample(0))
    writer.flush()
    before = path.read_bytes()
    put = storage.PagedFile._put

    def no_room(self, offset, data):
        put(self, offset, data[: len(data) // 2])
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(storage.PagedFile, "_put", no_room)
    monkeypatch.setattr(storage, "free_bytes", lambda folder: 5000)
    for step in range(10, 3000, 10):
        writer.append(make_state(system, step), sample(step))
    with pytest.raises(RunError, match=r"run\.h5md: disk full: .* 5,000 bytes free; .* holds 1 frames, up to step 0"):
        writer.flush()
    with pytest.raises(RunError, match="earlier write failed"):
        writer.flush()
    writer.close()
    assert path.read_bytes() == before
    with reader.open(path) as run:
        assert len(run) == 1
        assert run.report is None


def test_a_removed_file_is_noticed(path):
    system = make_system()
    writer = Writer(path, system, method=METHOD, every=1)
    writer.append(make_state(system, 0), sample(0))
    path.unlink()
    with pytest.raises(RunError, match="was removed or replaced"):
        writer.close()
    assert not path.exists()


def test_a_removed_folder_is_noticed(tmp_path):
    system = make_system()
    folder = tmp_path / "runs"
    folder.mkdir()
    writer = Writer(folder / "run.h5md", system, method=METHOD, every=1)
    shutil.rmtree(folder)
    with pytest.raises(RunError, match=r"run\.h5md: was removed or replaced"):
        writer.append(make_state(system, 0), sample(0))
    writer.close()
    assert not folder.exists()


def test_a_run_that_fails_keeps_its_frames(path):
    system = make_system()
    with pytest.raises(ZeroDivisionError), Writer(path, system, method=METHOD, every=1) as writer:  # noqa: PT012
        writer.append(make_state(system, 0), sample(0))
        1 / 0
    with reader.open(path) as run:
        assert len(run) == 1


def test_an_interrupt_inside_a_flush_loses_nothing(path, monkeypatch):
    system = make_system()
    with pytest.raises(KeyboardInterrupt), Writer(path, system, method=METHOD, every=1) as writer:  # noqa: PT012
        writer.append(make_state(system, 0), sample(0))
        put = writer._rows._put

        def interrupted(name, start, rows):
            put(name, start, rows)
            if name.endswith("velocity/value"):
                monkeypatch.setattr(writer._rows, "_put", put)
                raise KeyboardInterrupt

        monkeypatch.setattr(writer._rows, "_put", interrupted)
        writer.flush()
    with reader.open(path) as run:
        assert len(run) == 1
        np.testing.assert_array_equal(run[0].velocities, system.state.velocities)


# -- mistakes of users


def test_an_existing_file_stays(path):
    path.write_text("precious")
    with pytest.raises(InputError, match="exists already"):
        write(path)
    assert path.read_text() == "precious"
    with pytest.raises(InputError, match="is not a run's file that kickdrift wrote; it is not replaced"):
        write(path, overwrite=True)
    assert path.read_text() == "precious"
    path.unlink()
    write(path)
    write(path, overwrite=True)
    with reader.open(path) as run:
        assert len(run) == 3
    assert [p.name for p in path.parent.iterdir()] == ["run.h5md"]


def test_an_aborted_start_leaves_the_old_file(path, monkeypatch):
    write(path)
    before = path.read_bytes()

    def fail(self, data):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", fail)
    with pytest.raises(InputError, match="cannot be written: no space left on device"):
        write(path, overwrite=True)
    assert path.read_bytes() == before
    assert [p.name for p in path.parent.iterdir()] == ["run.h5md"]


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("run.h5", "must end in .h5md, not '.h5'"),
        ("run", "must end in .h5md"),
        ("nowhere/run.h5md", "there is no folder"),
    ],
)
def test_bad_names(tmp_path, name, message):
    with pytest.raises(InputError, match=message):
        write(tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_an_unwritable_folder(path, monkeypatch):
    if hasattr(os, "geteuid") and os.geteuid() == 0:  # root may write anywhere

        def denied(self, data):
            raise PermissionError(errno.EACCES, "Permission denied")

        monkeypatch.setattr(Path, "write_bytes", denied)
    else:
        path.parent.chmod(0o500)
    with pytest.raises(InputError, match="cannot be written: permission denied"):
        write(path)
    path.parent.chmod(0o700)
    assert not list(path.parent.iterdir())


def test_changed_observables_are_refused(path):
    system = make_system()
    with Writer(path, system, method=METHOD, every=1) as writer:
        writer.append(make_state(system, 0), {"total_energy": 1.0})
        with pytest.raises(InputError, match=r"expected .*total_energy"):
            writer.append(make_state(system, 1), {"energy": 1.0})
        with pytest.raises(InputError, match="reserved"):
            writer.append(make_state(system, 1), {"time": 1.0})
        with pytest.raises(InputError, match="holds 30 particles; this state has 2"):
            writer.append(make_state(System(np.zeros((2, 3))), 1), {"total_energy": 1.0})
