"""Pruning of old compiled code: code that nobody used for long, and code beyond the size limit, but never code in
use."""

from __future__ import annotations

import itertools
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from kickdrift.jit.cache import cache as code_cache
from kickdrift.jit.cache import code_files
from kickdrift.jit.compile import driver


@pytest.fixture
def code(tmp_path, monkeypatch):
    """A folder of compiled code, and a function that puts files of some size there, last used some days ago."""
    place = tmp_path / "code"
    place.mkdir()
    monkeypatch.setattr(code_files, "_used", set())

    def put(name, size=10, days=0.0):
        path = place / name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(b"x" * size)
        then = time.time() - days * code_files.DAY
        os.utime(path, (then, then))
        return path

    return put


def left(code):
    place = code("probe.nbc").parent
    (place / "probe.nbc").unlink()
    code_files.prune(place)
    return {str(path.relative_to(place)) for path in place.rglob("*")}


def test_code_that_nobody_used_for_long_is_removed(code):
    code("new.nbc", days=code_files.DAYS - 1)
    code("old.nbc", days=code_files.DAYS + 1)
    code("old.txt", days=code_files.DAYS + 1)  # another program's file
    code("from-the-future.nbc", days=-1000)
    code("half.nbc.tmp0123", days=0.5)  # another process may be writing it
    code("given-up.nbc.tmp0123", days=1.5)
    code("abc/old-1.py311.nbi", days=code_files.DAYS + 1)  # from earlier versions
    code("abc/old-1.py311.1.nbc", days=code_files.DAYS + 1)
    code("def/new-1.py311.1.nbc")
    kept = {"new.nbc", "old.txt", "from-the-future.nbc", "half.nbc.tmp0123", "def", "def/new-1.py311.1.nbc"}
    assert left(code) == {*kept, "abc"}
    assert left(code) == kept


def test_the_least_recently_used_code_is_removed_when_there_is_too_much(code, monkeypatch):
    monkeypatch.setattr(code_files, "BYTES", 100)
    for days in range(1, 6):
        code(f"{days}.nbc", 40, days)
    assert left(code) == {"1.nbc", "2.nbc"}
    code_files.use(code("used.nbc", 90, 50))
    assert left(code) == {"used.nbc"}


def test_what_this_process_uses_stays(code, monkeypatch):
    monkeypatch.setattr(code_files, "BYTES", 100)
    for k in range(5):
        code_files.use(code(f"{k}.nbc", 90, code_files.DAYS + k))
    assert left(code) == {f"{k}.nbc" for k in range(5)}
    assert time.time() - os.stat(code("x.txt").parent / "4.nbc").st_mtime < code_files.DAY, "others must see the use"


def test_what_is_used_again_counts_as_recent(code):
    path = code("old.nbc", days=code_files.DAYS + 1)
    code_files.use(path)
    code_files._used.clear()  # as in another process
    assert left(code) == {"old.nbc"}


@pytest.mark.parametrize("error", [FileNotFoundError, PermissionError])
def test_other_processes_prune_too(code, monkeypatch, error):
    """A file that another process has removed, or holds open, is no error, and does not stop the removal of others."""
    for k in range(3):
        code(f"{k}.nbc", days=code_files.DAYS + 1 + k)
    unlink = os.unlink

    def raced(path):
        if str(path).endswith("1.nbc"):
            raise error(path)
        unlink(path)

    monkeypatch.setattr(code_files.os, "unlink", raced)
    assert left(code) == {"1.nbc"}
    code_files.prune(Path("/nowhere/at/all"))
    code_files.use(Path("/nowhere/at/all"))


def test_links_are_not_followed(code, tmp_path):
    place = code("x.nbc").parent
    (tmp_path / "others").mkdir()
    old = tmp_path / "others" / "old.nbc"
    old.write_bytes(b"x")
    os.utime(old, (0, 0))
    (place / "link").symlink_to(tmp_path / "others")
    (place / "link.nbc").symlink_to(old)
    code_files.prune(place)
    assert old.exists()
    assert (place / "link").is_symlink()


def test_code_is_pruned_when_more_is_saved(tmp_path, monkeypatch):
    home = tmp_path / "home"
    monkeypatch.setattr(code_cache, "folder", lambda: home)
    monkeypatch.setattr(code_cache, "warm", lambda: ())
    monkeypatch.setattr(code_files, "_used", set())
    monkeypatch.setattr(code_files, "BYTES", 1)
    monkeypatch.setattr(code_cache, "PRUNED_EVERY", 1)

    def compiled(number):
        assert driver(lambda x: x + number)(1.0) == 1.0 + number
        return {path.name for path in home.rglob("*.nbc")}

    assert len(compiled(1.0)) == 1
    assert len(compiled(2.0)) == 2, "this process still uses the first"
    code_files._used.clear()
    assert len(compiled(3.0)) == 1
    monkeypatch.setattr(code_cache, "PRUNED_EVERY", 2)
    monkeypatch.setattr(code_cache, "_saved", itertools.count(1))
    code_files._used.clear()
    assert len(compiled(4.0)) == 2, "not every save looks for old code"
    code_files._used.clear()
    assert len(compiled(5.0)) == 1
    monkeypatch.setattr(code_cache, "prune", lambda folder: (_ for _ in ()).throw(AssertionError))
    assert len(compiled(5.0)) == 1, "nothing may be saved"


@pytest.mark.long
def test_processes_that_save_and_prune_at_once(tmp_path):
    """Each process gets its results, whatever the others remove."""
    script = (
        "import sys; from pathlib import Path; import kickdrift.jit.cache.cache as c;"
        "from kickdrift.jit.cache import code_files;"
        "code_files.BYTES = 1; c.PRUNED_EVERY = 1; c.folder = lambda: Path(sys.argv[1]); c.warm = lambda: ();"
        "from kickdrift.jit.compile import driver;"
        "made = lambda n: driver(lambda x: x + n)(1.0);"
        "print(sum(made(float(n)) for n in range(12)))"
    )
    command = [sys.executable, "-c", script, str(tmp_path / "home")]
    running = [subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) for _ in range(3)]
    for each in running:
        out, errors = each.communicate(timeout=300)
        assert (each.returncode, out.strip(), errors) == (0, "78.0", "")
