"""Outputs: which files are replaced, and how devices, pipes and odd names are handled."""

from __future__ import annotations

import errno
import fcntl
import io
import json
import os
import shutil
import signal
import stat
import sys
from pathlib import Path

import pytest

import kickdrift as kd
from kickdrift.disk import kinds, outputs
from kickdrift.disk.outputs import checked_target, refuse_outputs, settle, write_json, written_whole
from kickdrift.ensemble import table as tables
from kickdrift.ensemble.table import Lock
from kickdrift.errors import InputError, RunError
from kickdrift.trajectory.file import storage
from tests import run_files
from tests.refusals import assert_refused

SYSTEM = """
units = "nbody"
[particles]
positions = [[0, 0, 0], [1, 0, 0]]
mass = 0.5
[velocities]
values = [[0, -0.5, 0], [0, 0.5, 0]]
[[force]]
type = "gravity"
[run]
integrator = "leapfrog"
dt = 0.01
steps = 1
"""
pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="makes devices and pipes of Linux")
SECONDS = 60  # time limit, after which a process that waits for a pipe is interrupted


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """Each test works in its own folder, with a system and a run. A test that hangs fails."""

    def late(number, frame):
        raise AssertionError("hangs")

    monkeypatch.chdir(tmp_path)
    (tmp_path / "s.toml").write_text(SYSTEM, encoding="utf-8")
    run_files.write(tmp_path / "run.h5md", run_files.make_system("metal"))
    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(SECONDS)
    yield tmp_path
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


def content(folder="."):
    """Name and bytes of every file in the folder."""
    return {path.name: path.read_bytes() for path in Path(folder).iterdir() if path.is_file()}


# --- files that --overwrite replaces ---

NOT_OURS = {
    "notes.json": b"precious",
    "list.json": b"[1, 2]",
    "other.h5md": b"precious",
    "other.png": b"\x89PNG\r\n\x1a\n of a holiday",
    "other.parquet": b"PAR1 of somebody else PAR1",
    "other.h5": b"\x89HDF\r\n\x1a\n of somebody else",
    "other.xyz": b"precious",
}
REFUSED = [
    (["resume", "run.h5md", "--json", "run.h5md"], "--json run.h5md: is an input of this command and is not replaced"),
    (["resume", "run.h5md", "--json", "./run.h5md"], "is an input of this command"),
    (["resume", "run.h5md", "--json", "name.json"], "is an input of this command"),
    (["run", "s.toml", "--json", "s.toml"], "--json s.toml: is an input of this command and is not replaced"),
    (["run", "s.toml", "--output", "o.h5md", "--json", "o.h5md"], "--json o.h5md: --output names the same file"),
    (["run", "s.toml", "--output", "o.h5md", "--json", "there/../o.h5md"], "--output names the same file"),
    (["run", "s.toml", "--output", "one.h5md", "--json", "two.json"], "is not a JSON object that kickdrift wrote"),
    (["run", "s.toml", "--json", "notes.json"], "is not a JSON object that kickdrift wrote; it is not replaced"),
    (["run", "s.toml", "--json", "list.json"], "is not a JSON object"),
    (["run", "s.toml", "--json", "run.h5md"], "is not a JSON object"),
    (["run", "s.toml", "--json", "other.png"], "is not a JSON object"),
    (["run", "s.toml", "--output", "other.h5md"], "is not a run's file that kickdrift wrote; it is not replaced"),
    (["run", "s.toml", "--output", "s.toml"], "the name must end in .h5md"),
    (["compare", "s.toml", "--json", "s.toml"], "is an input of this command"),
    (["compare", "s.toml", "--plot", "other.png"], "is not a figure that kickdrift wrote; it is not replaced"),
    (["compare", "s.toml", "--plot", "x.png", "--json", "x.png"], "--plot x.png: --json names the same file"),
    (["chaos", "s.toml", "--json", "s.toml"], "is an input of this command"),
    (["chaos", "s.toml", "--json", "notes.json"], "is not a JSON object"),
    (["bench", "lj-energy", "--json", "s.toml"], "is not a JSON object"),
    (["bench", "speed", "--json", "s.toml"], "is not a JSON object"),
    (["plot", "run.h5md", "--output", "other.png"], "other.png: is not a figure"),
    (["plot", "--stability", "leapfrog", "--output", "other.png"], "other.png: is not a figure"),
    (["export", "run.h5md", "other.xyz"], "other.xyz: is not an export"),
    (["export", "run.h5md", "name.dcd"], "name.dcd: is an input of this command"),
    (["run", "s.toml", "--json", "link.json"], "is a symbolic link; give the name of the file itself"),
    (["run", "s.toml", "--output", "link.h5md"], "is a symbolic link"),
    (["run", "s.toml", "--output", "nowhere.h5md"], "is a symbolic link"),
    (["run", "s.toml", "--json", "loop.json"], "is a symbolic link"),
    (["plot", "run.h5md", "--output", "link.png"], "is a symbolic link"),
    (["run", "s.toml", "--json", "closed.json"], "is read-only; it is not replaced"),
    (["run", "s.toml", "--json", "there"], "is a folder"),
    (["run", "s.toml", "--json", "x" * 300], "file name too long"),
    (["run", "s.toml", "--output", "x" * 252 + ".h5md"], "file name too long"),
    (["run", "s.toml", "--json", "a\udcff.json"], "--json a\\xff.json: the name is not UTF-8"),
    (["run", "s.toml", "--json", "socket"], "is no regular file"),
    (["run", "s.toml", "--output", "pipe.h5md"], "is a device or a pipe; a run's file is a regular file"),
    (["run", "s.toml", "--json", "pipe.h5md"], "is a pipe that no program reads"),
]


@pytest.fixture
def furnished(folder):
    for name, data in NOT_OURS.items():
        Path(name).write_bytes(data)
    os.link("run.h5md", "name.json")
    os.link("run.h5md", "name.dcd")
    shutil.copy("run.h5md", "one.h5md")
    os.link("one.h5md", "two.json")
    Path("link.json").symlink_to("ours.json")
    Path("ours.json").write_text("{}")
    Path("link.h5md").symlink_to("run.h5md")
    Path("link.png").symlink_to("other.png")
    Path("nowhere.h5md").symlink_to("elsewhere.h5md")
    Path("loop.json").symlink_to("loop.json")
    Path("closed.json").write_text("{}")
    Path("closed.json").chmod(0o444)
    Path("there").mkdir()
    os.mkfifo("pipe.h5md")
    os.mknod("socket", stat.S_IFSOCK | 0o600)


def test_what_is_not_ours_stays(kickdrift, furnished):
    before = content()
    for arguments, part in REFUSED:
        assert_refused(kickdrift(*arguments, "--overwrite"), part)
        assert content() == before, arguments
    assert stat.S_ISFIFO(os.lstat("pipe.h5md").st_mode)
    assert not os.path.lexists("elsewhere.h5md")


def test_a_table_that_is_not_ours_stays(kickdrift, furnished):
    pytest.importorskip("distributed")
    before = content()
    for name in ("other.parquet", "other.h5"):
        for more in ([], ["--overwrite"]):
            words = ["ensemble", "s.toml", "--vary", "dt=0.01,0.02", "--output", name, *more]
            assert_refused(kickdrift(*words), f"{name}: is not the table of an ensemble that kickdrift wrote")
            assert content() == before


def test_what_is_ours_is_replaced():
    """An empty file is replaced too."""
    outputs_of = {"output": Path("o.h5md"), "json": Path("o.json")}
    for path in outputs_of.values():
        path.touch()
    for k in range(2):
        refuse_outputs(outputs_of, True, ["s.toml"])
        run_files.write(Path("o.h5md"), run_files.make_system("metal"))
        write_json(Path("o.json"), {"k": k}, overwrite=True)
        assert json.loads(Path("o.json").read_text()) == {"k": k}
    with pytest.raises(InputError, match=r"--output o\.h5md: exists already; give --overwrite to replace it"):
        refuse_outputs(outputs_of, False)
    assert set(os.listdir()) == {"s.toml", "run.h5md", "o.h5md", "o.json"}


@pytest.mark.parametrize("suffix", kinds.FIGURES)
def test_a_figure_of_ours_is_known(suffix):
    from kickdrift.plots.stability import plot_stability

    for _ in range(2):
        path = plot_stability(["leapfrog"], f"figure{suffix}", overwrite=True)
        assert kinds.is_ours(path, kinds.FIGURE)
        assert not kinds.is_ours(path, kinds.JSON)


def test_a_run_and_a_table_are_told_apart():
    pd = pytest.importorskip("pandas")
    found = pd.DataFrame({"member": [0], "status": ["done"]})
    found.attrs[tables.PROVENANCE] = {"command": "kickdrift ensemble --trajectories h5md"}
    for name in ("table.h5", "table.parquet"):
        tables.write(found, Path(name))
        assert kinds.is_ours(name, kinds.TABLE)
        assert not kinds.is_ours(name, kinds.RUN)
    assert kinds.is_ours("run.h5md", kinds.RUN)
    assert not kinds.is_ours("run.h5md", kinds.TABLE)


# --- devices and pipes ---


def test_a_device_is_written_to_and_stays():
    null = Path("null.json")
    try:
        os.mknod(null, stat.S_IFCHR | 0o600, os.makedev(1, 3))
        null.write_bytes(b"")
    except PermissionError:
        null.unlink(missing_ok=True)
        null.symlink_to("/dev/null")
    before = os.stat(null)
    for overwrite in (False, True):
        refuse_outputs({"json": null}, overwrite)
        write_json(null, {"a": 1}, overwrite=overwrite)
    assert os.path.samestat(os.stat(null), before)
    assert stat.S_ISCHR(os.stat(null).st_mode)


def test_a_pipe_is_written_to_and_stays():
    os.mkfifo("pipe")
    reader = os.open("pipe", os.O_RDONLY | os.O_NONBLOCK)
    refuse_outputs({"json": Path("pipe")}, False)
    write_json(Path("pipe"), {"a": [1, 2]}, overwrite=False)
    with os.fdopen(reader, "rb") as file:
        assert json.loads(file.read()) == {"a": [1, 2]}
    assert stat.S_ISFIFO(os.lstat("pipe").st_mode)
    with pytest.raises(InputError, match="--json pipe: is a pipe that no program reads"):
        refuse_outputs({"json": Path("pipe")}, False)
    with pytest.raises(RunError, match="pipe: cannot be written"):
        write_json(Path("pipe"), {}, overwrite=False)
    assert set(os.listdir()) == {"s.toml", "run.h5md", "pipe"}


def test_standard_output_is_written_to(capfd):
    """This also works if standard output is a file, as in this test."""
    print("before")
    refuse_outputs({"json": Path("/dev/stdout")}, False)
    write_json(Path("/dev/stdout"), {"a": 1}, overwrite=False)
    print("after")
    assert capfd.readouterr() == ('before\n{\n  "a": 1\n}\nafter\n', "")


def test_a_figure_goes_to_a_pipe(kickdrift):
    os.mkfifo("figure.svg")
    reader = os.open("figure.svg", os.O_RDONLY | os.O_NONBLOCK)
    # A pipe holds 64 KiB, and this test reads only after all is written.
    fcntl.fcntl(reader, fcntl.F_SETPIPE_SZ, 2**20)
    assert kickdrift("plot", "--stability", "leapfrog", "--output", "figure.svg")[0] == 0
    with os.fdopen(reader, "rb") as file:
        assert b"<svg" in file.read()
    assert stat.S_ISFIFO(os.lstat("figure.svg").st_mode)


# --- changes during a run, and failures ---


def write_meanwhile(path, overwrite, makes):
    with written_whole(path, kinds.JSON, overwrite=overwrite) as part:
        part.write_text("{}")
        makes()


def no_room():
    raise OSError(errno.ENOSPC, "No space left on device")


def test_what_takes_the_name_meanwhile_stays():
    path = Path("x.json")
    for overwrite, makes, part in (
        (False, lambda: path.write_text("{}"), "exists already"),
        (True, lambda: path.write_text("precious"), "is not a JSON object"),
        (True, lambda: path.symlink_to("s.toml"), "is a symbolic link"),
        (True, path.mkdir, "is a folder"),
    ):
        refuse_outputs({"json": path}, overwrite)
        with pytest.raises(InputError, match=rf"x\.json: {part}"):
            write_meanwhile(path, overwrite, makes)
        assert Path("s.toml").read_text() == SYSTEM
        path.rmdir() if path.is_dir() else path.unlink()
    assert set(os.listdir()) == {"s.toml", "run.h5md"}


def test_a_file_comes_into_being_where_nobody_else_looks():
    seen = []
    for _ in range(2):
        with written_whole(Path("x.json"), kinds.JSON, overwrite=True) as part:
            part.write_text("{}")
            folder = part.parent
            seen.append(folder.name)
            assert (part.name, folder.parent.resolve()) == ("x.json", Path.cwd())
            assert folder.stat().st_mode & 0o077 == 0
    assert len(set(seen)) == 2
    assert str(os.getpid()) not in seen[0].split("-")
    with pytest.raises(RunError, match=r"y\.json: cannot be written: no space left"):
        write_meanwhile(Path("y.json"), False, no_room)
    assert set(os.listdir()) == {"s.toml", "run.h5md", "x.json"}
    assert Path("x.json").stat().st_mode & 0o777 == 0o666 & ~_umask()


def _umask():
    before = os.umask(0)
    os.umask(before)
    return before


def test_a_folder_that_is_closed_is_bad_input():
    def closed():
        raise OSError(errno.EROFS, "Read-only file system")

    with pytest.raises(InputError, match=r"y\.json: cannot be written: read-only file system"):
        write_meanwhile(Path("y.json"), False, closed)


def test_what_a_kill_left_is_removed_in_time(monkeypatch):
    old, new, other = Path(".kickdrift-a.part"), Path(".kickdrift-b.part"), Path(".kickdrift-c.partly")
    for each in (old, new, other):
        each.mkdir()
        (each / "x.json").write_text("half")
        if each is not new:
            os.utime(each / "x.json", (0, 0))
            os.utime(each, (0, 0))
    Path(".kickdrift-d.part").symlink_to(other)
    with outputs.private_place(Path("x.json")):
        pass
    assert not old.exists()
    assert (new / "x.json").exists()
    assert (other / "x.json").exists()
    assert Path(".kickdrift-d.part").is_symlink()


def test_two_names_of_one_place_are_the_same(folder):
    (folder / "also").symlink_to(folder)
    with pytest.raises(InputError, match=r"--json also/x\.h5md: --output names the same file"):
        refuse_outputs({"output": Path("x.h5md"), "json": Path("also/x.h5md")}, False)


def test_a_null_in_a_name():
    for path in ("a\0b.json", "a\0b.h5md"):
        with pytest.raises(InputError, match="null character"):
            checked_target(path, kinds.JSON if path.endswith("n") else kinds.RUN, True)
    with pytest.raises(InputError, match="expected the path of a file"):
        kd.open("a\0b.h5md")


def test_no_file_system_without_hard_links_loses_a_file(monkeypatch):
    def unable(*_, **__):
        raise OSError(errno.EPERM, "Operation not permitted")

    monkeypatch.setattr(outputs.os, "link", unable)
    Path("part").write_text("{}")
    settle(Path("part"), Path("x.json"), kinds.JSON, overwrite=False)
    Path("part").write_text("{}")
    with pytest.raises(InputError, match="exists already"):
        settle(Path("part"), Path("x.json"), kinds.JSON, overwrite=False)


def test_a_limit_on_size_is_no_full_disk():
    said = str(storage.write_error(Path("run.h5md"), OSError(errno.EFBIG, "File too large")))
    assert said == "run.h5md: may not grow further: a limit on the size of a file is reached (see ulimit -f)"


# --- the journal and lock of an ensemble ---


def test_a_full_disk_names_the_journal_and_releases_the_lock(monkeypatch):
    def work():
        with tables.Journal(Path("table.parquet"), {"identity": {}}) as journal:
            journal.begin([])
            journal._file.close()
            journal._file = Full()
            journal.append([{"member": 0}])

    with pytest.raises(RunError, match=r"table\.parquet\.journal: cannot be written: no space left on device"):
        work()
    assert "table.parquet.lock" not in os.listdir()


class Full(io.RawIOBase):
    """A stream that takes half of the first write, and then refuses everything, even closing."""

    taken = False

    def writable(self):
        return True

    def write(self, data):
        if self.taken:
            raise OSError(errno.ENOSPC, "No space left on device")
        self.taken = True
        return len(data) // 2


@pytest.mark.parametrize("kind", ["link", "pipe", "text", "folder"])
def test_a_lock_changes_nothing_that_is_not_one(kind):
    lock, output = Path("table.lock"), Path("table.parquet")
    Path("precious").write_text("precious")
    {
        "link": lambda: lock.symlink_to("precious"),
        "pipe": lambda: os.mkfifo(lock),
        "text": lambda: lock.write_text("precious"),
        "folder": lock.mkdir,
    }[kind]()
    with pytest.raises(InputError, match=r"table\.lock: is "):
        Lock(lock, output)
    assert Path("precious").read_text() == "precious"
    assert os.path.lexists(lock)
    assert kind != "text" or lock.read_text() == "precious"


def test_a_lock_keeps_others_away():
    lock, output = Path("table.lock"), Path("table.parquet")
    lock.touch()  # as after a kill
    first = Lock(lock, output)
    with pytest.raises(InputError, match=r"table\.parquet: another process is at work on it"):
        Lock(lock, output)
    first.release()
    assert not lock.exists()
    Lock(lock, output).release()


@pytest.mark.parametrize("kind", ["link", "pipe"])
def test_a_journal_that_is_not_one_stays(kind):
    pytest.importorskip("distributed")
    journal = Path("table.parquet.journal")
    Path("precious").write_text("precious")
    {
        "link": lambda: journal.symlink_to("precious"),
        "pipe": lambda: os.mkfifo(journal),
    }[kind]()
    with pytest.raises(InputError, match=r"table\.parquet\.journal: is "):
        tables.checked_output("table.parquet")
    assert Path("precious").read_text() == "precious"


def test_a_text_in_place_of_a_journal_stays():
    journal = Path("table.parquet.journal")
    journal.write_text("precious")
    with pytest.raises(InputError, match="is not the journal of an ensemble that kickdrift wrote; it is not replaced"):
        tables.Journal(Path("table.parquet"), {}).begin([])
    assert journal.read_text() == "precious"


def test_info_and_run_look_for_the_same_system(kickdrift):
    """A shipped system comes first, even if a file has its name; ./NAME is that file."""
    shutil.copy("run.h5md", "sun-jupiter")
    code, out, err = kickdrift("info", "sun-jupiter")
    assert (code, err) == (0, "")
    assert "sun-jupiter" in out
    assert "frames" not in out
    code, out, err = kickdrift("info", "./sun-jupiter")
    assert (code, err) == (0, "")
    assert "frames" in out
