"""A file gives no access to other files: links out of a run's file or a table are refused before anything is read."""

from __future__ import annotations

import ctypes
import os
import shutil
import signal
import socket
import struct
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

import kickdrift as kd
from kickdrift.cli import main as cli
from kickdrift.disk import files
from kickdrift.ensemble import table as tables
from kickdrift.errors import InputError
from kickdrift.trajectory.file import opening, storage
from kickdrift.trajectory.read import reader
from kickdrift.trajectory.write.h5md import Writer
from tests import run_files

SOURCE = Path(kd.__file__).parent
FEW = 200  # objects in a file, for these tests
SECONDS = 30  # time limit, after which a process that waits for a pipe is interrupted
IN_ACCESS, IN_MODIFY, IN_OPEN = 0x1, 0x2, 0x20  # events of inotify(7)

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="watches files with inotify")


class Canary:
    """A file that must neither be opened nor changed."""

    def __init__(self, path: Path) -> None:
        self.path = path
        with h5py.File(path, "w") as file:
            file["x"] = np.arange(12.0)
            file["group/x"] = np.arange(12.0)
        self.before = path.read_bytes()
        self._libc = ctypes.CDLL(None, use_errno=True)
        self._watch = self._libc.inotify_init1(os.O_NONBLOCK)
        assert self._libc.inotify_add_watch(self._watch, os.fsencode(path), IN_ACCESS | IN_MODIFY | IN_OPEN) >= 0

    def sang(self) -> bool:
        """Whether the file was opened, read or changed."""
        try:
            return bool(os.read(self._watch, 4096))
        except BlockingIOError:
            return False

    def close(self) -> None:
        os.close(self._watch)


@pytest.fixture
def canary(tmp_path):
    (tmp_path / "elsewhere").mkdir()
    found = Canary(tmp_path / "elsewhere" / "canary.h5")
    yield found
    found.close()


@pytest.fixture(autouse=True)
def _few(monkeypatch):
    monkeypatch.setattr(opening, "MOST", FEW)


@pytest.fixture(autouse=True)
def _interrupted():
    """Interrupt a test that hangs."""

    def late(number, frame):
        raise AssertionError("hangs")

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(SECONDS)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    path = tmp_path_factory.mktemp("whole") / "run.h5md"
    run_files.write(path, run_files.make_system("metal"))
    return path


@pytest.fixture(scope="module")
def whole_table(tmp_path_factory):
    pd = pytest.importorskip("pandas")
    path = tmp_path_factory.mktemp("whole") / "table.h5"
    found = pd.DataFrame({"member": [0, 1], "x": [1.0, 2.0], "status": ["done", "done"]})
    found.attrs[tables.PROVENANCE] = {"identity": {}, "members": 2, "grids": {}}
    tables.write(found, path)
    return path


def external_link(file, canary):
    del file["x"]
    file["x"] = h5py.ExternalLink(canary, "x")


def external_group(file, canary):
    file["more/inner/other"] = h5py.ExternalLink(canary, "group")


def external_storage(file, canary):
    del file["x"]
    file.create_dataset("x", (4,), "f8", external=[(str(canary), 0, 32)])


def virtual_dataset(file, canary):
    layout = h5py.VirtualLayout((12,), "f8")
    layout[:] = h5py.VirtualSource(str(canary), "x", (12,))
    del file["x"]
    file.create_virtual_dataset("x", layout)


def soft_link(file, canary):
    file["more"] = h5py.SoftLink("/x")


def soft_link_out(file, canary):
    file["door"] = h5py.ExternalLink(canary, "group")
    del file["x"]
    file["x"] = h5py.SoftLink("/door/x")


def object_reference(file, canary):
    file.create_dataset("more", data=file["x"].ref, dtype=h5py.ref_dtype)


def region_reference(file, canary):
    file.create_dataset("more", (1,), h5py.regionref_dtype)


def hidden_reference(file, canary):
    file.create_dataset("more", (1,), np.dtype([("a", "i4"), ("b", h5py.ref_dtype)]))


def reference_attribute(file, canary):
    file["x"].attrs["where"] = file["x"].ref


def type_of_references(file, canary):
    file["more"] = np.dtype([("a", "i4"), ("b", h5py.ref_dtype)])


def circle(file, canary):
    file["more/inner"] = file["/"]


def depth(file, canary):
    file["/".join(["more"] * 100)] = 1.0


def crowd(file, canary):
    group = file.create_group("more")
    for k in range(FEW + 1):
        group[f"{k}"] = file["x"]


WAYS = {
    external_link: "/x is an external link",
    external_group: "/more/inner/other is an external link",
    external_storage: "/x keeps its values in another file",
    virtual_dataset: "/x is a virtual dataset, whose values are in other files",
    soft_link: "/more is a soft link",
    soft_link_out: "/door is an external link",
    object_reference: "/more holds references",
    region_reference: "/more holds references",
    hidden_reference: "/more holds references",
    reference_attribute: "/x has an attribute of references",
    type_of_references: "/more is a type of references",
    circle: "/more/inner is a group that holds itself",
    depth: "groups deep",
    crowd: "/more holds more than 200 names",
}


# --- the entry points ---


def command(*words):
    def call(path):
        saved, sys.argv = sys.argv, ["kickdrift", *(str(path) if word is None else word for word in words)]
        try:
            with pytest.raises(SystemExit) as ended:
                cli.main()
        finally:
            sys.argv = saved
        assert ended.value.code == 2

    return call


def python(call):
    def refused(path):
        with pytest.raises(InputError) as caught:
            call(path)
        print(f"kickdrift: {caught.value}", file=sys.stderr)

    return refused


RUNS = {
    "info": command("info", None),
    "resume": command("resume", None),
    "export": command("export", None, "out.xyz"),
    "plot": command("plot", None, "--output", "out.png"),
    "open": python(kd.open),
    "kd.resume": python(kd.resume),
    "append": python(lambda path: Writer.append_to(path, "0")),
    "write": python(storage.open_to_write),
}
TABLES = {
    "info": command("info", None),
    "plot": command("plot", None, "--output", "out.png"),
    "read": python(kd.Ensemble.read),
    "go on": python(lambda path: tables.Journal(tables.checked_output(path), {"identity": {}, "members": 2}).known()),
}


def assert_one_line(said, path, part):
    out, err = said
    assert out == ""
    assert err.startswith("kickdrift: ")
    assert (err.count("\n"), err[-1]) == (1, "\n"), err
    assert str(path) in err
    assert part in err
    assert "Traceback" not in err


def made(path, whole, way, canary):
    """A copy of a good file with the link in place of a dataset, ``x``."""
    shutil.copy(whole, path)
    with h5py.File(path, "r+") as file:
        file["x"] = 1.0
        way(file, str(canary.path))
    return path.read_bytes()


@pytest.mark.parametrize("way", WAYS)
def test_no_way_leads_out_of_a_runs_file(tmp_path, monkeypatch, capfd, whole, canary, way):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "run.h5md"
    before = made(path, whole, way, canary)
    canary.sang()
    for entry in RUNS.values():
        entry(path)
        assert_one_line(capfd.readouterr(), path, WAYS[way])
        assert not canary.sang()
    assert (path.read_bytes(), canary.path.read_bytes()) == (before, canary.before)
    assert sorted(os.listdir()) == ["elsewhere", "run.h5md"]


@pytest.mark.parametrize("way", [external_link, external_storage, virtual_dataset, soft_link_out, circle])
@pytest.mark.parametrize("place", ["particles/trajectory/mass", "kickdrift/units", "particles"])
def test_no_way_in_place_of_what_is_read(tmp_path, capfd, whole, canary, way, place):
    path = tmp_path / "run.h5md"
    shutil.copy(whole, path)
    with h5py.File(path, "r+") as file:
        file["x"] = 1.0
        way(file, str(canary.path))
        name = "more/inner" if way is circle else "x"
        link = file.get(name, getlink=True)
        del file[place]
        file[place] = file[name] if isinstance(link, h5py.HardLink) else link
    canary.sang()
    for name in ("info", "resume", "write"):
        RUNS[name](path)
        assert "kickdrift does not open such a file" in capfd.readouterr().err
    assert not canary.sang()
    assert canary.path.read_bytes() == canary.before


@pytest.mark.parametrize("way", WAYS)
def test_no_way_leads_out_of_a_table(tmp_path, monkeypatch, capfd, whole_table, canary, way):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "table.h5"
    before = made(path, whole_table, way, canary)
    canary.sang()
    for entry in TABLES.values():
        entry(path)
        assert_one_line(capfd.readouterr(), path, WAYS[way])
    assert not canary.sang()
    assert (path.read_bytes(), canary.path.read_bytes()) == (before, canary.before)


# --- files that are not regular ---


def fifo(path):
    os.mkfifo(path)


def device(path):
    path.symlink_to("/dev/zero")


def folder(path):
    path.mkdir()


def loop(path):
    path.symlink_to(path.name)


def listening(path):
    with socket.socket(socket.AF_UNIX) as found:
        found.bind(str(path))


IRREGULAR = {
    fifo: "is a pipe, not a",
    device: "is a device, not a",
    folder: "is a folder, not a",
    loop: "is a loop of symbolic links",
    listening: "is a socket, not a",
}


@pytest.mark.parametrize("kind", IRREGULAR)
def test_what_is_no_regular_file_is_refused_at_once(tmp_path, monkeypatch, capfd, kind):
    monkeypatch.chdir(tmp_path)
    names = ("run.h5md", "table.h5", "table.parquet", "system.toml", "extra.py")
    for name in names:
        kind(Path(name))
    cases = [(RUNS[name], "run.h5md") for name in ("info", "resume", "export", "plot", "open", "kd.resume")]
    cases += [(TABLES[name], suffix) for name in ("info", "plot", "read") for suffix in ("table.h5", "table.parquet")]
    cases += [(command(word, None), "system.toml") for word in ("run", "info", "show", "compare", "chaos", "ensemble")]
    cases += [(python(kd.load), "system.toml"), (command("--load", None, "list", "forces"), "extra.py")]
    for entry, name in cases:
        entry(name)
        assert_one_line(capfd.readouterr(), name, IRREGULAR[kind])
    assert sorted(os.listdir()) == sorted(names)


def test_a_structure_file_that_is_a_pipe(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    os.mkfifo("start.xyz")
    text = 'units = "metal"\n[particles]\nfile = "start.xyz"\n[[force]]\ntype = "lennard-jones"\ncutoff = 2.5\n'
    Path("s.toml").write_text(text, encoding="utf-8")
    command("info", None)("s.toml")
    assert_one_line(capfd.readouterr(), "s.toml", "particles.file: is a pipe, not a file")


def test_a_system_file_has_a_largest_size(tmp_path):
    path = tmp_path / "s.toml"
    with path.open("wb") as file:
        file.truncate(2**40)  # a sparse file
    with pytest.raises(InputError, match=r"s\.toml: too large: a system file has at most 16,777,216 bytes"):
        kd.load(path)


# --- changes between the check and the use ---


def swapped(path, makes):
    """Put another object in the file's place."""
    path.rename(path.with_name("was"))
    makes(path)


def test_a_pipe_that_takes_the_name_between_look_and_open(tmp_path, monkeypatch, whole):
    path = Path(shutil.copy(whole, tmp_path / "run.h5md"))
    opened = os.open

    def late(name, *rest, **options):
        if os.fspath(name) == str(path) and not path.is_fifo():
            swapped(path, os.mkfifo)
        return opened(name, *rest, **options)

    monkeypatch.setattr(files.os, "open", late)
    with pytest.raises(InputError, match="is a pipe, not a file"):
        kd.open(path)


def test_a_link_that_takes_the_name_of_a_file_that_was_looked_at(tmp_path, monkeypatch, whole, canary):
    """The checked file is the one that is read."""
    path = Path(shutil.copy(whole, tmp_path / "run.h5md"))
    with kd.open(path) as run:
        expected = run.positions
    opened = h5py.File

    def late(*arguments, **options):
        if not path.is_symlink():
            swapped(path, lambda path: path.symlink_to(canary.path))
        return opened(*arguments, **options)

    monkeypatch.setattr(opening.h5py, "File", late)
    canary.sang()
    with kd.open(path) as run:
        assert np.array_equal(run.positions, expected)
    assert not canary.sang()


def test_a_link_that_takes_the_name_of_a_file_that_is_written_to(tmp_path, whole, canary):
    path = Path(shutil.copy(whole, tmp_path / "run.h5md"))
    swapped(path, lambda path: path.symlink_to(canary.path))
    canary.sang()
    with pytest.raises(InputError, match="cannot be opened for writing: a symbolic link has taken its place"):
        storage.open_to_write(path)
    assert not canary.sang()


def test_another_run_that_takes_the_name_is_not_written_to(tmp_path, monkeypatch, whole):
    path = Path(shutil.copy(whole, tmp_path / "run.h5md"))
    with kd.open(path) as run:
        run_id = run.run_id
    run_files.write(other := tmp_path / "other.h5md", run_files.make_system("lj"))
    before, checked = other.read_bytes(), Writer._open

    def late(self, *arguments):
        swapped(path, lambda path: shutil.copy(other, path))
        checked(self, *arguments)

    monkeypatch.setattr(Writer, "_open", late)
    with pytest.raises(InputError, match="another file has taken its place"):
        Writer.append_to(path, run_id)
    assert path.read_bytes() == before


def test_a_file_that_grows_while_it_is_read(tmp_path, whole):
    path = Path(shutil.copy(whole, tmp_path / "run.h5md"))
    with kd.open(path) as run:
        with path.open("ab") as file:
            file.write(os.urandom(100_000))
        assert np.isfinite(run.positions).all()
        assert len(run) == run_files.FRAMES


def append_one(path):
    with kd.open(path) as run:
        run_id, last = run.run_id, run.steps[-1]
    states = run_files.states(run_files.make_system("metal"), [int(last) + run_files.EVERY])
    with Writer.append_to(path, run_id) as writer:
        writer.append(states[0], {})


def test_what_has_another_name_is_not_written_to(tmp_path, whole):
    """A hard link keeps its content; the run continues in a separate file."""
    path, other = tmp_path / "run.h5md", tmp_path / "elsewhere.h5md"
    shutil.copy(whole, other)
    os.link(other, path)
    append_one(path)
    assert other.read_bytes() == whole.read_bytes()
    with kd.open(path) as run:
        assert len(run) == run_files.FRAMES + 1
    assert sorted(os.listdir(tmp_path)) == ["elsewhere.h5md", "run.h5md"]


def test_a_hard_link_to_a_read_only_file(tmp_path, whole):
    path, other = tmp_path / "run.h5md", tmp_path / "elsewhere.h5md"
    shutil.copy(whole, other)
    other.chmod(0o444)
    os.link(other, path)
    with pytest.raises(InputError, match=r"run\.h5md: (is read-only|cannot be opened for writing: permission denied)"):
        append_one(path)
    with pytest.raises(InputError, match=r"run\.h5md: is read-only; it is not replaced"):
        run_files.write(path, run_files.make_system("metal"))
    assert other.read_bytes() == path.read_bytes() == whole.read_bytes()


# --- allowed links ---


def test_unknown_things_that_lead_nowhere_stay_allowed(tmp_path, whole):
    path = Path(shutil.copy(whole, tmp_path / "run.h5md"))
    with h5py.File(path, "r+") as file:
        file["mine/notes"] = "hello"
        file["mine/table"] = np.zeros(3, [("a", "i4"), ("b", "f8")])
        file["mine/again"] = file["mine/table"]
        file["also mine"] = file["mine"]
        file["mine"].attrs["by"] = "me"
        file["kind"] = np.dtype("f4")
        file["mine"].create_dataset("lists", (2,), h5py.vlen_dtype("f8"))
    with kd.open(path) as run:
        assert len(run) == run_files.FRAMES
    append_one(path)
    with h5py.File(path) as file:
        assert file["also mine/notes"].asstr()[()] == "hello"


def test_code_that_hdf5_would_load_for_a_filter_is_not_asked_for(tmp_path, whole):
    path = Path(shutil.copy(whole, tmp_path / "run.h5md"))
    with h5py.File(path, "r+") as file:
        made = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        made.set_chunk((4,))
        made.set_filter(4242, h5py.h5z.FLAG_OPTIONAL)
        space = h5py.h5s.create_simple((4,))
        for name in (b"mine", b"kickdrift/mine"):
            h5py.h5d.create(file.id, name, h5py.h5t.NATIVE_DOUBLE, space, made)
    with pytest.raises(InputError, match="/kickdrift/mine needs filter 4242, which kickdrift does not use"):
        kd.open(path)
    with h5py.File(path, "r+") as file:
        del file["kickdrift/mine"]
    kd.open(path).close()


def test_a_journal_cannot_reach_behind_the_file(tmp_path, whole):
    """An unfinished commit is finished inside the file, or not at all."""
    path = Path(shutil.copy(whole, tmp_path / "run.h5md"))
    stored = path.read_bytes()
    end = struct.unpack("<q", stored[40:48])[0]
    path.write_bytes(stored[:end] + storage._journal([(2**40, b"far away")]))
    storage.PagedFile(path).close()
    assert path.stat().st_size < 2**20
    for end in (2**63, 2**64 - 1):
        path.write_bytes(stored[:40] + struct.pack("<Q", end) + stored[48:])
        with pytest.raises(InputError):
            storage.open_to_write(path)


def test_one_module_opens_hdf5_files():
    """Every call of h5py.File is in the module ``opening``."""
    found = {path.name for path in SOURCE.rglob("*.py") if "h5py.File(" in path.read_text(encoding="utf-8")}
    assert found == {"opening.py"}


def test_the_walk_is_done_once_for_a_file_that_stays(tmp_path, monkeypatch, whole):
    path = Path(shutil.copy(whole, tmp_path / "run.h5md"))
    os.utime(path, (0, 0))
    walked = []
    monkeypatch.setattr(opening, "_walked", lambda path, file, source: walked.append(path))
    monkeypatch.setattr(opening.time, "time", lambda: path.stat().st_ctime + 10)
    monkeypatch.setattr(opening, "_last", [()])
    for _ in range(3):
        reader.open(path).close()
    assert len(walked) == 1
    os.utime(path, (0, 1))
    reader.open(path).close()
    assert len(walked) == 2
