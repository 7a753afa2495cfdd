"""Files that are not a run's, and run files after failures: one clear line, an exit status, and a file that opens."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys

import h5py
import numpy as np
import pytest

import kickdrift as kd
from kickdrift.cli import main as cli
from kickdrift.errors import InputError
from kickdrift.trajectory.read.info import describe, info
from kickdrift.trajectory.write.h5md import Writer

try:
    import resource
except ImportError:  # Windows
    resource = None


@pytest.fixture
def whole(tmp_path):
    path = tmp_path / "whole.h5md"
    system = kd.System(np.eye(3), names=["a", "b", "c"])
    with Writer(path, system, method={}, every=1) as writer:
        writer.append(system.state, {"total_energy": 1.0})
        writer.report = {"verdict": "bounded"}
    return path


def text(path, whole):
    path.write_text("hello")


def empty(path, whole):
    path.write_bytes(b"")


def plain(path, whole):
    with h5py.File(path, "w") as file:
        file["x"] = 1


def foreign(path, whole):
    with h5py.File(path, "w") as file:
        file.create_group("h5md/creator").attrs["name"] = "h5xx"


def truncated(path, whole):
    path.write_bytes(whole.read_bytes()[:-3000])


def newer(path, whole):
    shutil.copy(whole, path)
    with h5py.File(path, "r+") as file:
        file["kickdrift"].attrs["schema"] = 99


def older(path, whole):
    shutil.copy(whole, path)
    with h5py.File(path, "r+") as file:
        file["kickdrift"].attrs["schema"] = 1


def damaged(path, whole):
    shutil.copy(whole, path)
    with h5py.File(path, "r+") as file:
        del file["particles/trajectory/mass"]


def missing(path, whole):
    pass


BAD = {
    text: "is not an HDF5 file",
    empty: "is not an HDF5 file",
    plain: "is an HDF5 file but not H5MD: it has no group 'h5md'",
    foreign: "is an H5MD file written by h5xx; it has no group 'kickdrift' to tell forces, units and method",
    truncated: "is truncated: its end is missing",
    newer: "was written by a newer kickdrift (schema 99; this one reads 2)",
    older: "was written by an older kickdrift (schema 1; this one reads 2)",
    damaged: "damaged",
    missing: "no such file",
}


@pytest.mark.parametrize("made", BAD)
@pytest.mark.parametrize("command", ["open", "info", "plot", "resume", "export"])
def test_a_file_that_is_no_runs_is_refused_in_one_line(tmp_path, whole, monkeypatch, capfd, made, command):
    path = tmp_path / "bad.h5md"
    made(path, whole)
    before = path.read_bytes() if path.exists() else None
    if command == "open":
        with pytest.raises(InputError) as caught:
            kd.open(path)
        said = f"{caught.value}\n"
    else:
        if made is missing and command == "info":
            pytest.skip("is the name of a system, then")
        arguments = ["kickdrift", command, str(path), *([str(tmp_path / "x.xyz")] if command == "export" else [])]
        monkeypatch.setattr(sys, "argv", arguments)
        with pytest.raises(SystemExit) as ended:
            cli.main()
        out, said = capfd.readouterr()
        assert (ended.value.code, out) == (2, "")
    assert BAD[made] in said
    assert str(path) in said
    assert said.count("\n") == 1
    assert (path.read_bytes() if path.exists() else None) == before
    assert {each.name for each in tmp_path.iterdir()} <= {"bad.h5md", "whole.h5md"}


def test_info_says_what_a_kill_left(whole):
    with h5py.File(whole, "r+") as file:
        file["kickdrift/closed"][0] = 0
        for name in ("position/value", "velocity/value", "position/step"):
            file["particles/trajectory"][name].resize(3, axis=0)
        file["kickdrift/samples/step"].resize(4, axis=0)
        file["kickdrift/events/step"].resize(1, axis=0)
    before = whole.read_bytes()
    told = describe(info(whole))
    assert "not properly: the run did not finish, and there is no report" in told
    assert "behind the last whole ones, 2 frames, 3 samples and 1 event were left half written" in told
    assert "checkpoints" in told
    assert whole.read_bytes() == before, "info must repair nothing"


ENV = dict(os.environ)
PROGRAM = """
import resource, sys
sys.dont_write_bytecode = True  # which the limit would cut
from kickdrift.cli.main import main
limit = int(sys.argv.pop(1))
if limit:
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
sys.argv[0] = "kickdrift"
main()
"""
RUN = ("run", "lj-1000", "--steps", "400", "--every", "1", "--flush", "1e-6", "--quiet")


def refused_for_room(done, path, why="disk full: "):
    """Check for one line, exit status 1, and a file that holds whole frames."""
    assert (done.returncode, done.stdout) == (1, ""), done.stderr
    assert done.stderr.startswith(f"kickdrift: {path}: {why}")
    assert "the file is whole and holds" in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.long
@pytest.mark.skipif(resource is None, reason="needs setrlimit")
def test_a_limit_on_a_files_size(tmp_path):
    path = tmp_path / "run.h5md"
    command = [sys.executable, "-W", "error", "-c", PROGRAM, str(3_000_000), *RUN, "--output", str(path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    refused_for_room(done, path, "may not grow further: a limit on the size of a file is reached")
    with kd.open(path) as run:
        assert 10 < len(run) < 100
        assert run.steps.tolist() == list(range(len(run)))
        assert np.isfinite(run.positions).all()
        assert run.report is None


@pytest.mark.skipif(shutil.which("unshare") is None, reason="needs unshare")
def test_the_program_on_a_full_disk(tmp_path):
    """A tmpfs of 4 MB in a separate mount namespace."""
    path = tmp_path / "run.h5md"
    read = f"import kickdrift as kd; run = kd.open({str(path)!r}); print(len(run), run.positions.sum() > 0)"
    script = 'mount -t tmpfs -o size=4m tmpfs "$0" || exit 77; "$@"; status=$?; "$1" -c "$READ" >&2; exit $status'
    command = ["unshare", "-m", "sh", "-c", script, str(tmp_path), sys.executable, "-W", "error", "-c", PROGRAM, "0"]
    done = subprocess.run(
        [*command, *RUN, "--output", str(path)], capture_output=True, text=True, check=False, env={**ENV, "READ": read}
    )
    if done.returncode == 77 or "unshare" in done.stderr:
        pytest.skip("may not mount here")
    said, frames = done.stderr.splitlines()
    assert done.returncode == 1
    assert said.startswith(f"kickdrift: {path}: disk full: ")
    assert "the file is whole and holds" in said
    count, finite = frames.split()
    assert 10 < int(count) < 100
    assert finite == "True"
