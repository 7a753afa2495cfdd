"""Damage to a run's file: a changed row is named, any other fault is one line, and the run can continue."""

from __future__ import annotations

import json
import shutil
import struct

import h5py
import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.model.state import State
from kickdrift.systemfile.files import shipped
from kickdrift.trajectory.file.opening import open_to_read
from kickdrift.trajectory.layout import checksums
from kickdrift.trajectory.layout.checkpoints import decoded
from kickdrift.trajectory.layout.contents import MOST_NESTED
from kickdrift.trajectory.read.info import describe, info
from kickdrift.trajectory.write.h5md import Writer
from tests.long import rest

FRAMES, N = 6, 5
VALUE = "particles/trajectory/position/value"
RECORD, METHOD = "kickdrift/system/record", "kickdrift/method"


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A file with every kind of content; tests must not change it."""
    path = tmp_path_factory.mktemp("damage") / "run.h5md"
    rng = np.random.default_rng(1)
    system = kd.System(rng.uniform(0, 9, (N, 3)), rng.normal(size=(N, 3)), box=(9.0,) * 3, units="metal", masses=20.0)
    s = system.state
    with Writer(
        path, system, method={"integrator": "velocity-verlet", "dt": 0.5, "options": {"dt": 0.5}}, every=1,
        options=kd.FileOptions(write=("forces", "images")), plan=[0, 0.0, 99, np.inf, 1, 0, 1],
        checkpoint=lambda: {"step": 0, "time": 0.0, "x": np.arange(4.0)},
    ) as writer:  # fmt: skip
        for step in range(FRAMES):
            event = {"time": step / 2, "step": step, "ids": [1], "distance": 1.0, "energy": None, "kind": "escape"}
            writer.append_event({**event, "done": ""})
            state = State(s.phase * (1 + step), s.masses, s.ids, s.box, step / 2, step)
            energies = {f"{kind}_energy": step / 3 for kind in ("kinetic", "potential", "total")}
            writer.append(state, energies | {"momentum": np.full(3, step)}, forces=state.velocities)
        writer.report = {"stopped": "", "events": [], "verdict": "bounded"}
    return path


@pytest.fixture
def path(written, tmp_path):
    shutil.copy(written, tmp_path / "run.h5md")
    return tmp_path / "run.h5md"


def changed(path, name, row, value):
    with h5py.File(path, "r+") as file:
        file[name][row] = value


def older(path):
    """Change the file to version 0.1.0, without checksums."""
    with h5py.File(path, "r+") as file:
        del file["kickdrift"].attrs["sha256"], file["kickdrift/checksums"]


def content(path):
    with kd.open(path) as run:
        frames = [(f.step, f.time, f.positions.tobytes(), f.velocities.tobytes()) for f in run]
        return frames, {name: values.tobytes() for name, values in run.observables.items()}, run.events


# --- rows ---


@pytest.mark.parametrize("what", ["position", "velocity", "force", "image"])
def test_a_flipped_bit_of_a_frame_is_noticed_wherever_it_is(path, written, what):
    with kd.open(written) as run:
        truth = {name: getattr(run, name) for name in ("positions", "velocities", "forces")}
    with h5py.File(written) as file:
        data = file[f"particles/trajectory/{what}/value"]
        begin, size = data.id.get_chunk_info(0).byte_offset, data.dtype.itemsize * 3 * N
    whole = written.read_bytes()
    read = "positions" if what == "image" else {"velocity": "velocities"}.get(what, f"{what}s")
    for place in np.random.default_rng(2).integers(FRAMES * size, size=10):
        flipped = bytearray(whole)
        flipped[begin + int(place)] ^= 1 << int(place) % 8
        path.write_bytes(flipped)
        wrong = int(place) // size
        with kd.open(path) as run:
            for frame in run:
                if frame.index == wrong:
                    with pytest.raises(InputError, match=rf"run\.h5md: damaged: frame {wrong} \(step {wrong}\) is not"):
                        getattr(frame, read)
                else:
                    np.testing.assert_array_equal(getattr(frame, read), truth[read][frame.index])
            with pytest.raises(InputError, match=f"frame {wrong} "):
                getattr(run, read)
            assert run.damage().frames == [wrong]


ROWS = {
    "particles/trajectory/position/step": ("frames", lambda run: run[:].steps),
    "particles/trajectory/position/time": ("frames", lambda run: run.times),
    "particles/trajectory/box/edges/value": ("frames", lambda run: run.positions),
    "observables/total_energy/value": ("frames", lambda run: run[:].energies),
    "observables/momentum/value": ("frames", lambda run: run[3].energies),
    "kickdrift/samples/step": ("samples", lambda run: run.sample_steps),
    "kickdrift/samples/time": ("samples", lambda run: run.energies),
    "kickdrift/samples/momentum": ("samples", lambda run: run.observables),
    "kickdrift/events/time": ("events", lambda run: run.events),
    "kickdrift/events/ids": ("events", lambda run: run.events),
    "kickdrift/events/kind": ("events", lambda run: run.events),
}


@pytest.mark.parametrize("name", ROWS)
def test_a_changed_row_is_named(path, name):
    what, read = ROWS[name]
    changed(path, name, 3, b"x" if name.endswith("kind") else 4)
    with kd.open(path) as run:
        with pytest.raises(
            InputError, match=rf"run\.h5md: damaged: {what[:-1]} 3 (\(step 3\) )?is not what was written"
        ):
            read(run)
        assert [key for key, rows in run.damage()._asdict().items() if rows] == [what]
        assert getattr(run.damage(), what) == [3]
    assert f" {what} 3\n" in describe(info(path))


def test_fewer_frames_than_there_are_is_noticed(path):
    changed(path, "kickdrift/committed", 0, 2)
    with pytest.raises(InputError, match="damaged: kickdrift/committed: counts 2 frames, but there are more"):
        kd.open(path)


def test_info_lists_what_is_damaged(path):
    for row in (0, 2, 3, 4):
        changed(path, VALUE, row, 0.5)
    told = describe(info(path))
    assert "damaged" in told
    assert "frames 0, 2 to 4" in told


def test_a_file_without_checksums_is_read_and_says_so(path, written):
    older(path)
    assert content(path) == content(written)
    assert "no frame has one" in describe(info(path))
    changed(path, "kickdrift/samples/step", FRAMES - 1, 2**61)
    with kd.open(path) as run, pytest.raises(InputError, match="damaged: sample 5"):
        run.sample_steps  # step 2^61 is beyond the plan's end


def test_what_older_versions_added_has_no_checksum(path):
    """Older versions do not write checksums, but add rows to the other datasets."""
    with h5py.File(path, "r+") as file:
        for name in ("frame", "sample"):
            file[f"kickdrift/checksums/{name}"].resize(FRAMES - 2, axis=0)
    assert "2 frames without" in describe(info(path))
    with kd.open(path) as run:
        assert run.damage().frames == []
        assert np.isfinite(run.positions).all()
        run_id, state = run.run_id, run[0].state
    with Writer.append_to(path, run_id) as writer:
        more = State(state.phase, state.masses, state.ids, state.box, 9.0, 9)
        energies = {f"{kind}_energy": 0.0 for kind in ("kinetic", "potential", "total")}
        writer.append(more, energies | {"momentum": np.zeros(3)}, forces=state.velocities)
    with kd.open(path) as run:
        assert len(run) == FRAMES + 1
        assert not run.damage()


def test_checksums_see_bits_and_places():
    rng = np.random.default_rng(3)
    row = rng.normal(size=(1, 64))
    truth = checksums.sums(row)
    raw = row.view("u8")
    for place in range(64):
        for bit in (0, 1, 31, 62, 63):
            other = raw.copy()
            other[0, place] ^= np.uint64(1 << bit)
            assert checksums.sums(other) != truth
        assert checksums.sums(np.roll(raw, place, axis=1)) != truth or place == 0
    assert checksums.sums(np.zeros((1, 64))) == 1, "0, the fill value, must not be a checksum of zeros"
    assert checksums.sums_of_vectors(rng.normal(size=(4, 7, 3)).astype("f4"), 3).shape == (4, 3)


CHANGES = {
    "gravity": lambda file: file["kickdrift/units"].attrs.__setitem__("boltzmann", 1.5),
    "length": lambda file: file["kickdrift/units"].attrs.__setitem__("length", "nm"),
    "method": lambda file: file[METHOD].__setitem__((), file[METHOD].asstr()[()].replace("0.5", "0.6")),
    "every": lambda file: file["kickdrift"].attrs.__setitem__("every", 2),
    "mass": lambda file: file["particles/trajectory/mass"].__setitem__(0, 19.0),
    "box": lambda file: file[RECORD].__setitem__((), file[RECORD].asstr()[()].replace("9.0", "8.0")),
    "phase": lambda file: file["kickdrift/system/phase"].__setitem__((0, 0, 0), 0.25),
}


@pytest.mark.parametrize("change", CHANGES)
def test_what_the_run_was_given_is_covered_by_a_hash(path, change):
    with h5py.File(path, "r+") as file:
        CHANGES[change](file)
    with kd.open(path) as run:
        assert not run.unchanged
        for read in (lambda: run.positions, lambda: run[2].velocities, run.system, lambda: run[0].system):
            with pytest.raises(InputError, match=r"run\.h5md: damaged: its system was changed after the run began"):
                read()
    assert "was changed after the run began" in describe(info(path))
    with pytest.raises(InputError, match="was changed after the run began"):
        kd.resume(path)


def put_text(name, change):
    """A file with another JSON text."""

    def make(file):
        text = file[name].asstr()[()]
        file[name][()] = change if isinstance(change, str) else json.dumps(change(json.loads(text)))

    return make


def put(name, **how):
    """A file with another dataset, group or type at a place."""

    def make(file):
        del file[name]
        if how:
            file.create_dataset(name, **how)

    return make


def group_at(name):
    def make(file):
        del file[name]
        file.create_group(name)

    return make


def attribute(name, key, value):
    return lambda file: file[name].attrs.__setitem__(key, value)


def report_of(text):
    def make(file):
        file["kickdrift/report"].resize(len(text), axis=0)
        file["kickdrift/report"][...] = np.frombuffer(text.encode(), "u1")

    return make


deep = "[" * (MOST_NESTED + 2) + "]" * (MOST_NESTED + 2)
BAD = {
    "a list for the method": (put_text(METHOD, "[]"), "kickdrift/method"),
    "a number for the versions": (put_text("kickdrift/versions", "7"), "kickdrift/versions"),
    "a text for the record": (put_text(RECORD, '"x"'), "kickdrift/system/record"),
    "half a text": (put_text(RECORD, '{"name": '), "record is not JSON"),
    "lists in lists": (put_text(METHOD, '{"options": {"x": ' + deep + "}}"), "nested more than 40 levels deep"),
    "lists without end": (put_text(METHOD, "[" * 100_000), "nested more than 40 levels deep"),
    "a path for the method": (put_text(METHOD, lambda m: m | {"integrator": "/etc/passwd"}), "method: integrator"),
    "no such precision": (put_text(METHOD, lambda m: m | {"options": {"precision": "mixd"}}), "options.precision"),
    "2^63 steps": (put_text(RECORD, lambda r: r | {"run": {"steps": 2**63}}), "record: run.steps"),
    "no number for dt": (put_text(METHOD, lambda m: m | {"dt": float("nan")}), "kickdrift/method: dt"),
    "threads without end": (put_text(METHOD, lambda m: m | {"threads": 10**12}), "kickdrift/method: threads"),
    "two edges": (put_text(RECORD, lambda r: r | {"box": [1.0, 2.0]}), "record: box"),
    "no forces": (put_text(RECORD, lambda r: {k: v for k, v in r.items() if k != "forces"}), "record: forces"),
    "names of others": (put_text(RECORD, lambda r: r | {"names": ["a"]}), "1 names for 5 particles"),
    "a list for the report": (report_of("[]"), "kickdrift/report"),
    "a report of no text": (report_of('{"stopped": 3}'), "kickdrift/report: stopped"),
    "a report with half an event": (report_of('{"events": [{"kind": 1}]}'), "kickdrift/report: events.0"),
    "no method": (put(METHOD), "kickdrift/method is missing"),
    "no samples": (put("kickdrift/samples"), "kickdrift/samples"),
    "no positions": (put("particles/trajectory/position"), "particles/trajectory/position"),
    "a group for a dataset": (group_at("kickdrift/committed"), "kickdrift/committed is a group; expected a dataset"),
    "a dataset for a group": (put("kickdrift/units", data=[1]), "kickdrift/units is a dataset; expected a group"),
    "texts for masses": (put("particles/trajectory/mass", data=[b"x"] * N), "mass holds"),
    "objects for a row": (put("kickdrift/report", data=["x"], dtype=h5py.string_dtype()), "report holds text"),
    "two of three counts": (put("kickdrift/committed", data=[1, 2]), "kickdrift/committed has the shape"),
    "counts of the future": (lambda f: f["kickdrift/committed"].__setitem__(0, 2**60), "rows; expected"),
    "counts below zero": (lambda f: f["kickdrift/committed"].__setitem__(1, -1), "expected three counts"),
    "2^40 masses": (put("particles/trajectory/mass", shape=(2**40,), dtype="f8", chunks=(8,)), "mass has the shape"),
    "2^40 species": (put("particles/trajectory/species", shape=(2**40,), dtype="i4", chunks=(8,)), "more than"),
    "2^40 frames": (lambda f: f[VALUE].resize(2**40, axis=0), "more than the file's"),
    "positions of two axes": (put(VALUE, shape=(FRAMES, N, 2), maxshape=(None, N, 2), dtype="f8"), "has the shape"),
    "nothing": (put("particles/trajectory/id", data=h5py.Empty("i8")), "particles/trajectory/id"),
    "two particles with one id": (lambda f: f["particles/trajectory/id"].__setitem__(0, 1), "have the same id"),
    "a text for every": (attribute("kickdrift", "every", "x"), "attribute every of kickdrift is"),
    "a number for a unit": (attribute("kickdrift/units", "length", 7), "attribute length of kickdrift/units is"),
    "no number for boltzmann": (attribute("kickdrift/units", "boltzmann", np.nan), "attribute boltzmann"),
    "no UTF-8": (attribute("kickdrift", "run_id", np.bytes_(b"\xff")), "attribute run_id"),
    "a block of no particle": (attribute("kickdrift/checksums", "particles", 0), "kickdrift/checksums"),
    "a schema of text": (attribute("kickdrift", "schema", "x"), "damaged"),
}  # fmt: skip


@pytest.mark.parametrize("bad", BAD)
def test_whatever_is_wrong_is_one_line(path, bad):
    make, said = BAD[bad]
    with h5py.File(path, "r+") as file:
        make(file)
    for read in (kd.open, info, kd.resume):
        with pytest.raises(InputError) as caught:
            read(path)
        line = str(caught.value)
        assert line.startswith(f"{path}: damaged: ")
        assert said in line
        assert "\n" not in line
        assert len(line) < 400


# --- texts, which are in a heap ---


def heap_of(data):
    return data.index(b"GCOL\x01\0\0\0")


def reference(data, text):
    """Place of a reference to a text, with its length, heap and index."""
    return data.index(struct.pack("<IQ", len(text), heap_of(data)))


HEAPS = {  # offset and bytes: the heap's size at 8, the first object's index at 16 and its size at 24
    "zeros": (16, bytes(512)),
    "a free object of no size": (16, bytes(16)),
    "a free object for a text": (16, bytes(2)),
    "two texts of one number": (16, b"\2\0"),
    "an object beyond the heap": (24, struct.pack("<Q", 4096)),
    "an object of 2^64 bytes": (24, bytes([255] * 8)),
    "a shorter text": (24, struct.pack("<Q", 1)),
    "a heap of no size": (8, bytes(8)),
    "half a heap": (8, struct.pack("<Q", 40)),
    "a heap beyond the file": (8, struct.pack("<Q", 2**40)),
    "no heap": (0, b"HEAP"),
}


@pytest.mark.parametrize("change", HEAPS)
def test_a_damaged_heap_of_texts_is_one_line(path, change):
    """HDF5 itself would loop for ever on some of these."""
    place, new = HEAPS[change]
    data = bytearray(path.read_bytes())
    place += heap_of(data)
    data[place : place + len(new)] = new
    path.write_bytes(data)
    for read in (kd.open, lambda path: Writer.append_to(path, "x")):
        with pytest.raises(InputError, match=r"^[^\n]*run\.h5md: damaged: /[^\n]*$"):
            read(path)


REFERENCES = {
    "length of 2 GiB": (0, 2**31, "I", "claims 2,147,483,648 bytes of text, more than"),
    "length of 1": (0, 1, "I", "its text of 1 bytes is missing from its place"),
    "heap in nothing": (4, 8, "Q", "there is no heap of texts at 8"),
    "heap beyond the file": (4, 2**40, "Q", "beyond the file's end"),
    "no such text": (12, 9999, "I", "is missing from its place"),
    "the free rest": (12, 0, "I", "is missing from its place"),
}


@pytest.mark.parametrize("name", ["kickdrift", METHOD], ids=["attribute", "dataset"])
@pytest.mark.parametrize("change", REFERENCES)
def test_a_text_that_is_not_in_the_heap_is_one_line(path, change, name):
    place, number, kind, said = REFERENCES[change]
    with h5py.File(path) as file:
        text = file[METHOD][()] if name == METHOD else file["kickdrift"].attrs["run_id"]
    data = bytearray(path.read_bytes())
    struct.pack_into(f"<{kind}", data, reference(data, text) + place, number)
    path.write_bytes(data)
    with pytest.raises(InputError) as caught:
        kd.open(path)
    assert str(caught.value).startswith(f"{path}: damaged: /{name}: ")
    assert said in str(caught.value)


@pytest.mark.parametrize("made", [{}, {"libver": "latest"}, {"userblock_size": 512}], ids=["old", "latest", "block"])
def test_texts_of_other_programs_are_read_where_their_heaps_are_whole(tmp_path, made):
    path = tmp_path / "x.h5"
    with h5py.File(path, "w", **made) as file:
        for k in range(12):
            file.attrs[f"{k}"] = ["a", "", "bcd"]
        file.attrs["nothing"] = h5py.Empty(h5py.string_dtype())
        file["text"] = "all of it"
        file.create_dataset("chunks", data=["a", "bb"], dtype=h5py.string_dtype(), chunks=(1,), compression="gzip")
        file.create_dataset("fill", shape=2, dtype=h5py.string_dtype(), fillvalue="empty")
        file.create_dataset("never", shape=2, dtype=h5py.string_dtype())
        file.create_dataset(
            "rows", data=np.array([np.arange(3.0), np.arange(2.0)], object), dtype=h5py.vlen_dtype(float)
        )
        file["parts"] = np.array([(1, "x")], dtype=[("number", int), ("text", h5py.string_dtype())])
    with open_to_read(path) as file:
        assert file["text"].asstr()[()] == "all of it"
        assert list(file["fill"].asstr()) == ["empty"] * 2
        assert file["rows"][0].tolist() == [0.0, 1.0, 2.0]
    data = bytearray(path.read_bytes())
    place = heap_of(data) + 16
    data[place : place + 512] = bytes(512)
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"x\.h5: damaged: /: the heap of texts at \d+ is damaged"):
        open_to_read(path)


PLANS = {
    "steps below zero": [0, 0.0, -5, np.inf, 1, 0, 1],
    "half a step": [0.5, 0.0, 10, np.inf, 1, 0, 1],
    "looks below zero": [0, 0.0, 10, np.inf, -1, 0, 1],
    "looks that never come": [0, 1.0, 2.0**62, 9.0, 0, 1e-300, 1],
    "no numbers": [0, np.nan, 10, np.inf, 1, 0, 1],
    "2^63 steps": [0, 0.0, 2.0**63, np.inf, 1, 0, 1],
}


@pytest.mark.parametrize("plan", PLANS)
def test_a_plan_that_is_none_is_refused(path, plan):
    changed(path, "kickdrift/plan", ..., PLANS[plan])
    with kd.open(path) as run, pytest.raises(InputError, match=r"damaged: kickdrift/plan: .* is not the plan of a run"):
        run.plan


OTHERS = ("", "kickdrift", "kickdrift/samples", "kickdrift/events", "kickdrift/checkpoints", "observables")
OTHERS += ("observables/total_energy", "particles", "particles/trajectory", "h5md", "kickdrift/units")


def test_what_is_not_known_is_passed_over(path, written):
    with h5py.File(path, "r+") as file:
        for name in OTHERS:
            file.create_group(f"{name}/of_others/inner")
            file[f"{name}/fixed"] = np.arange(3)
            file[f"{name or '/'}"].attrs["note"] = "x"
    for make in (lambda: None, lambda: older(path)):
        make()
        assert content(path) == content(written)
        assert info(path)["unchanged"]
        with kd.open(path) as run:
            run_id, state = run.run_id, run[5].state
        with Writer.append_to(path, run_id) as writer:
            assert writer.last_frame == (5, 2.5)
            assert len(state) == N
    with h5py.File(path) as file:
        assert file["kickdrift/samples/fixed"].shape == (3,)


def test_a_file_of_fixed_size_is_read_but_not_continued(path, written):
    with h5py.File(path, "r+") as file:
        data = file[VALUE][()]
        del file[VALUE]
        file[VALUE] = data
        file[VALUE].attrs["unit"] = "Angstrom"
    assert content(path) == content(written)
    with kd.open(path) as run:
        run_id = run.run_id
    with pytest.raises(InputError, match="has a fixed size, so the run cannot continue this file"):
        Writer.append_to(path, run_id)


def test_a_file_that_another_program_wrote_anew_is_not_continued(path, written):
    """The new file has another superblock, so a commit would write into the middle of the file."""
    path.unlink()
    with h5py.File(written) as file, h5py.File(path, "w", libver="latest") as other:
        for name in file:
            file.copy(name, other)
    assert content(path) == content(written)
    before = path.read_bytes()
    with kd.open(path) as run:
        run_id = run.run_id
    with pytest.raises(InputError, match="was rewritten by another program"):
        Writer.append_to(path, run_id)
    assert path.read_bytes() == before


def with_text(text):
    data = text.encode()
    return len(data).to_bytes(8, "little") + data


@pytest.mark.parametrize(
    "data",
    [
        b"", b"\xff" * 8, with_text("[]"), with_text("{"), with_text("[" * 9999), with_text('{"x": ' + deep + "}"),
        with_text('{"y": {"array": ["|O", [1], 0]}}'), with_text('{"y": {"array": ["<f8", [1000000000000], 0]}}'),
        with_text('{"y": {"array": ["<f8", [-1], 0]}}'), with_text('{"y": {"array": ["<f8", [1], -8]}}') + bytes(64),
        with_text('{"y": {"array": ["<f8", 3, 0]}}'), with_text('{"y": {"array": 3}}'), b"\xff\xfe" + bytes(6),
        with_text('{"y": {"array": ["nonsense", [1], 0]}}'), with_text('{"y": {"array": ["<f8", [1.5], 0]}}'),
    ],
    ids=range(15),
)  # fmt: skip
def test_bytes_of_no_checkpoint_are_a_value_error(data):
    with pytest.raises(ValueError):  # noqa: PT011
        decoded(data)


# --- continuation ---


def bodies():
    x, v = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 3.0, 0.0]], [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-0.5, 0.0, 0.0]]
    system = kd.System(x, v, [1.0, 1e-3, 1e-4], forces=[kd.Gravity()], units="nbody", events=[kd.CloseApproach(2.5)])
    return kd.Simulation(system, "velocity-verlet", dt=0.01)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A run in two pieces, with a checkpoint at 0, 200 and 400."""
    path = tmp_path_factory.mktemp("whole") / "run.h5md"
    sim = bodies()
    sim.run(200, every=10, output=path)
    sim.run(200, every=10, output=path)
    with kd.open(path) as run:
        assert run.checkpoints.steps.tolist() == [0, 200, 400]
        assert run.events
    return path


def bad_checkpoint(file):
    file["kickdrift/checkpoints/data"][-1] ^= 1


HURT = {
    "last step": lambda file: file["kickdrift/samples/step"].__setitem__(-1, 2**61),
    "last time": lambda file: file["kickdrift/samples/time"].__setitem__(-1, np.nan),
    "last frame": lambda file: file[VALUE].__setitem__((-1, 0, 0), 7.0),
    "last frames": lambda file: file[VALUE].__setitem__((slice(-5, None), 0, 0), 7.0),
    "last frame's step": lambda file: file["particles/trajectory/position/step"].__setitem__(-1, 0),
    "last checkpoint": bad_checkpoint,
    "a checkpoint's step": lambda file: file["kickdrift/checkpoints/step"].__setitem__(2, 390),
    "a checkpoint's end": lambda file: file["kickdrift/checkpoints/end"].__setitem__(2, 2**60),
    "last sample and checkpoint": lambda file: (
        bad_checkpoint(file), file["kickdrift/samples/total_energy"].__setitem__(-1, 0.0)
    ),
}  # fmt: skip


@pytest.mark.parametrize("old", [False, rest(True)], ids=["checksums", "none"])
@pytest.mark.parametrize("hurt", HURT)
def test_a_run_goes_on_from_what_is_whole(whole, tmp_path, hurt, old):
    """The run computes the damaged end again with the same bits. After 50 steps more, all is as without damage."""
    path = tmp_path / "run.h5md"
    if old and hurt in ("last frame", "last frames", "last sample and checkpoint"):
        pytest.skip("nobody can tell")
    shutil.copy(whole, path)
    if old:
        older(path)
    with h5py.File(path, "r+") as file:
        HURT[hurt](file)
    sim = kd.resume(path)
    sim.run(450 - sim.steps_done)
    other = tmp_path / "other.h5md"
    shutil.copy(whole, other)
    kd.resume(other).run(50)
    found, truth = content(path), content(other)
    assert found == truth
    with kd.open(path) as run:
        assert run.damage()[:2] == ([], [])


def test_damage_in_the_middle_stays_and_is_told(whole, tmp_path):
    path = tmp_path / "run.h5md"
    shutil.copy(whole, path)
    changed(path, VALUE, (3, 0, 0), 7.0)
    changed(path, "kickdrift/samples/total_energy", 5, 7.0)
    sim = kd.resume(path)
    report = sim.run(10)
    assert "1 damaged sample of the file left out of the report" in " ".join(report.warnings)
    with kd.open(path) as run:
        assert (run.damage().frames, run.damage().samples) == ([3], [5])
        assert run[-1].step == 410


def test_a_run_that_is_still_there_does_not_write_over_a_damaged_end(tmp_path):
    sim, path = bodies(), tmp_path / "run.h5md"
    sim.run(20, every=10, output=path)
    changed(path, VALUE, (-1, 0, 0), 7.0)
    with pytest.raises(InputError, match="damaged after step 10; resume the run from that step"):
        sim.run(20, output=path)
    resumed = kd.resume(path)
    assert resumed.steps_done == 10
    resumed.run()
    resumed.run(20)
    with kd.open(path) as run:
        assert run.steps.tolist() == [0, 10, 20, 30, 40]
        assert not run.damage()


def test_without_a_whole_checkpoint_there_is_one_line(whole, tmp_path):
    path = tmp_path / "run.h5md"
    shutil.copy(whole, path)
    with h5py.File(path, "r+") as file:
        file["kickdrift/checkpoints/crc32"][...] = 0
    with pytest.raises(InputError, match="damaged: no intact checkpoint up to step 400"):
        kd.resume(path)
    assert "checkpoints of step 0, 200, 400" in describe(info(path))


@pytest.mark.parametrize(("key", "value", "said"), [
    ("integrator", "/etc/passwd", "run: integrator '/etc/passwd' is unknown"),
    ("precision", "mixd", "run.precision: expected 'double' or 'mixed', got 'mixd'"),
])  # fmt: skip
def test_info_says_what_a_system_file_cannot_run_with(tmp_path, kickdrift, key, value, said):
    path, file = tmp_path / "x.toml", shipped()["sun-jupiter"].read_text(encoding="utf-8")
    lines = [line for line in file.splitlines() if not line.startswith(key)]
    path.write_text("\n".join(f'[run]\n{key} = "{value}"' if line == "[run]" else line for line in lines))
    code, out, err = kickdrift("info", path)
    assert (code, out) == (2, "")
    assert said in err
    assert err.count("\n") == 1
