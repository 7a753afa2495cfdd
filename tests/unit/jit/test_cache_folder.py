"""Folders of compiled code: they are the user's alone, and damaged or foreign files in them do no harm."""

from __future__ import annotations

import os
import pickle
import stat
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from kickdrift.jit.cache import cache as code_cache
from kickdrift.jit.cache import folders
from kickdrift.jit.cache.code_files import DIGEST, load, save
from kickdrift.jit.cache.folders import make_private
from kickdrift.jit.compile import driver

pytestmark = pytest.mark.skipif(not hasattr(os, "getuid"), reason="permissions of a kind that this system has not")


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A package whose own folder is not writable, and a user with a separate home."""
    (tmp_path / "site-packages").write_text("a file where a folder would be")
    (tmp_path / "tmp").mkdir()
    monkeypatch.setattr(folders, "__file__", str(tmp_path / "site-packages" / "jit" / "cache" / "folders.py"))
    monkeypatch.setattr(folders.tempfile, "tempdir", str(tmp_path / "tmp"))
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setattr(folders, "folder", folders.folder.__wrapped__)
    return tmp_path


def mode(path):
    return stat.S_IMODE(os.stat(path).st_mode)


def test_the_folder_is_private(place):
    own = place / "home" / ".cache" / "kickdrift"
    previous = os.umask(0o002)
    try:
        assert folders.folder() == own
        make_private(own / folders.CODE / "abc")
    finally:
        os.umask(previous)
    assert [mode(each) for each in (own, own / folders.CODE, own / folders.CODE / "abc")] == [0o700] * 3
    assert folders.folder() == own


@pytest.mark.parametrize("what", ["the folder", "its code", "around"])
def test_a_folder_that_others_can_write_to_is_not_used(place, what):
    own = place / "home" / ".cache" / "kickdrift"
    (own / folders.CODE).mkdir(parents=True)
    os.chmod({"the folder": own, "its code": own / folders.CODE, "around": own.parent}[what], 0o777)
    wanted = own.with_name("kickdrift-private") if what != "around" else place / "tmp" / f"kickdrift-{os.getuid()}"
    assert folders.folder() == wanted
    assert mode(wanted) == 0o700
    os.chmod(own.parent, 0o1777)  # sticky: nobody can replace another user's files
    assert folders.folder() == own.with_name("kickdrift-private" if what != "around" else "kickdrift")


@pytest.mark.skipif(os.name == "nt" or os.getuid() != 0, reason="only root can give a folder away")
def test_a_folder_of_another_user_is_not_used(place):
    own = place / "home" / ".cache" / "kickdrift"
    own.mkdir(parents=True)
    os.chown(own, 12345, 12345)
    assert folders.folder() == own.with_name("kickdrift-private")


def test_no_home(place, monkeypatch):
    monkeypatch.delenv("HOME")
    monkeypatch.setattr("pwd.getpwuid", lambda user: (_ for _ in ()).throw(KeyError(user)))
    own = place / "tmp" / f"kickdrift-{os.getuid()}"
    assert folders.folder() == own
    assert mode(own) == 0o700
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")  # would mean a folder in the current directory
    assert folders.folder() == own
    assert not Path("relative").exists()


def test_a_temporary_folder_goes_with_the_process(place, monkeypatch):
    removed = []
    monkeypatch.delenv("HOME")
    monkeypatch.setattr("pwd.getpwuid", lambda user: (_ for _ in ()).throw(KeyError(user)))
    monkeypatch.setattr(folders.atexit, "register", removed.append)
    taken = place / "tmp" / f"kickdrift-{os.getuid()}"
    taken.mkdir()
    os.chmod(taken, 0o777)
    made = folders.folder()
    assert made.parent == place / "tmp"
    assert (made != taken, mode(made)) == (True, 0o700)
    (made / "code").write_text("x")
    (clear,) = removed
    monkeypatch.setattr(folders.os, "getpid", lambda: -1)
    clear()
    assert made.exists(), "a forked process must leave the folder alone"
    monkeypatch.undo()
    clear()
    assert not made.exists()


def test_nowhere_to_write(place, monkeypatch):
    monkeypatch.setattr(folders, "_writable", lambda place: False)
    monkeypatch.setattr(folders.tempfile, "mkdtemp", lambda **how: (_ for _ in ()).throw(FileNotFoundError("none")))
    assert folders.folder() is None


def test_a_warm_folder_that_cannot_be_written_is_read(place, monkeypatch):
    package = place / "package"
    (package / "__pycache__" / folders.CODE).mkdir(parents=True)
    monkeypatch.setattr(folders, "__file__", str(package / "jit" / "cache" / "folders.py"))
    monkeypatch.setattr(folders, "_writable", lambda place: package not in place.parents)
    assert folders.folder() == place / "home" / ".cache" / "kickdrift"
    assert folders.warm.__wrapped__() == (package / "__pycache__",)
    os.chmod(package / "__pycache__", 0o775)
    assert folders.warm.__wrapped__() == ()


USER = """
import os, sys
from pathlib import Path
from kickdrift.jit.cache import code_files, folders
folders.__file__, user, home = sys.argv[1], int(sys.argv[2]), sys.argv[3]
os.environ["HOME"] = home
os.umask(0o022)
os.setuid(user)
folder = folders.folder()
folders.make_private(folder / folders.CODE)
for place in folders.warm():
    assert code_files.load(place / folders.CODE / "function.nbc", "key") is None
print(folder)
"""


@pytest.mark.skipif(os.name == "nt" or os.getuid() != 0, reason="only root can become another user")
@pytest.mark.parametrize("before", ["nothing", "0.2"])
def test_the_first_user_of_an_installation_does_not_lock_out_others(before):
    """Without compiled modules, `__pycache__` is not there at first. Version 0.2 made it for its user alone."""
    with TemporaryDirectory() as folder:
        place = Path(folder)
        place.chmod(0o755)
        pycache, homes = place / "package" / "__pycache__", {user: place / f"home-{user}" for user in (0, 12345)}
        for user, home in homes.items():
            home.mkdir()
            os.chown(home, user, user)
        pycache.parent.mkdir(mode=0o755)
        if before == "0.2":
            pycache.mkdir(0o700)

        def used(user):
            file = str(pycache.parent / "jit" / "cache" / "folders.py")
            words = [sys.executable, "-c", USER, file, str(user), str(homes[user])]
            done = subprocess.run(words, capture_output=True, text=True, check=True)
            return Path(done.stdout.strip())

        assert used(0) == pycache
        assert mode(pycache) == (0o700 if before == "0.2" else 0o755)
        assert mode(pycache / folders.CODE) == 0o700
        assert used(12345) == homes[12345] / ".cache" / "kickdrift"


class Harmful:
    """A pickle that records that it was loaded."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return Path.touch, (Path(self.path),)


def test_damaged_files_count_as_not_there(tmp_path):
    path = tmp_path / "function.nbc"
    save(path, "key", {"code": b"x" * 1000})
    assert load(path, "key") == {"code": b"x" * 1000}
    assert load(path, "another key") is None
    assert load(tmp_path / "another.nbc", "key") is None
    mark, good = tmp_path / "loaded", path.read_bytes()
    flipped = good[: DIGEST + 5] + bytes([good[DIGEST + 5] ^ 1]) + good[DIGEST + 6 :]
    foreign = pickle.dumps(Harmful(mark))
    for bad in (b"", good[: DIGEST - 1], good[:DIGEST], good[:-1], good + b"x", flipped, foreign, b"\0" * 500):
        path.write_bytes(bad)
        assert load(path, "key") is None
        save(path, "key", {"code": b"new"})  # newly compiled code is found again
        assert load(path, "key") == {"code": b"new"}
    path.unlink()
    path.mkdir()
    assert load(path, "key") is None
    with pytest.raises(OSError, match="function"):
        save(path, "key", {})
    path.rmdir()
    os.mkfifo(path)
    assert load(path, "key") is None
    path.unlink()
    (tmp_path / "elsewhere").write_bytes(good)
    path.symlink_to(tmp_path / "elsewhere")
    assert load(path, "key") is None
    path.unlink()
    path.write_bytes(good)
    os.chmod(path, 0o666)
    assert load(path, "key") is None
    assert not mark.exists()
    assert sorted(each.name for each in tmp_path.iterdir()) == ["elsewhere", "function.nbc"], "an unfinished file stays"


def test_what_is_saved_counts_whatever_the_users_mask(tmp_path):
    previous = os.umask(0o002)  # as on many systems: the group may write to new files
    try:
        save(tmp_path / "function.nbc", "key", 1.0)
    finally:
        os.umask(previous)
    assert load(tmp_path / "function.nbc", "key") == 1.0


def test_a_function_whose_files_are_damaged_is_compiled_anew(tmp_path, monkeypatch):
    home = tmp_path / "home"
    monkeypatch.setattr(code_cache, "folder", lambda: home)
    monkeypatch.setattr(code_cache, "warm", lambda: ())

    def add(a, b):
        return a + b

    def hits():
        made = driver(add)
        assert made(1, 2) == 3
        return sum(made.stats.cache_hits.values())

    assert (hits(), hits()) == (0, 1)
    (path,) = home.rglob("*.*")
    assert mode(path.parent) == 0o700
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    assert (hits(), hits()) == (0, 1)
    monkeypatch.setattr(code_cache, "warm", lambda: (home,))
    monkeypatch.setattr(code_cache, "folder", lambda: None)
    assert hits() == 1, "a warm cache must be readable without write permission"
    monkeypatch.setattr(code_cache, "warm", lambda: ())
    assert hits() == 0
    monkeypatch.setattr(code_cache, "folder", lambda: Path("/dev/null"))
    assert hits() == 0, "code that cannot be saved must be no error"


def test_a_process_without_a_home_leaves_nothing(tmp_path):
    (tmp_path / "tmp").mkdir()
    (tmp_path / "tmp" / f"kickdrift-{os.getuid()}").write_text("taken")
    environment = {key: value for key, value in os.environ.items() if key not in ("HOME", "XDG_CACHE_HOME")}
    environment |= {"TMPDIR": str(tmp_path / "tmp"), "HOME": "relative"}
    code = (
        "import kickdrift.jit.cache.folders as folders; folders.__file__ = '/dev/null/jit/cache/folders.py';"
        "made = folders.folder(); (made / 'x').touch(); print(made)"
    )
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert str(tmp_path / "tmp" / "kickdrift-") in done.stdout
    assert [each.name for each in (tmp_path / "tmp").iterdir()] == [f"kickdrift-{os.getuid()}"]
