"""Folders for files that kickdrift can make again: compiled code, font lists.

Whoever can write a file of code here can run code as the user who loads the file. So a folder counts only if nobody but
this user can write to it, or nobody but root if it is only read.
"""

import atexit
import os
import shutil
import stat
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path

PRIVATE = 0o700  # mode of a folder
CODE = "jit"  # the folder of compiled code
PYTHONS = "__pycache__"  # Python's own folder, which all users of an installation share


@cache
def folder() -> Path | None:
    """A writable folder, private to the user: the package's own ``__pycache__``, else one in the user's cache, else a
    temporary one. None if nothing is writable."""
    for candidate in _candidates():
        if _made(candidate) and _private(candidate) and _writable(candidate):
            return candidate
    return _temporary()


@cache
def warm() -> tuple[Path, ...]:
    """Readable folders before `folder` that are not writable, such as an installation for many users."""
    before: list[Path] = []
    for candidate in _candidates():
        if candidate == folder():
            break
        if _private(candidate) and not _writable(candidate):
            before.append(candidate)
    return tuple(before)


def _candidates() -> Iterator[Path]:
    yield Path(__file__).resolve().parents[2] / PYTHONS
    given = Path(os.environ.get("XDG_CACHE_HOME", ""))
    try:
        home = given if given.is_absolute() else Path("~/.cache").expanduser()  # a relative path does not count
    except RuntimeError:  # no HOME, and no entry for the user
        home = Path()
    if home.is_absolute():
        yield home / "kickdrift"
        yield home / "kickdrift-private"  # if others can write to the first
    try:
        yield Path(tempfile.gettempdir()) / f"kickdrift-{_user()}"
    except OSError:  # none is writable
        return


def _user() -> int:
    return os.getuid() if hasattr(os, "getuid") else 0


def make_private(place: Path) -> None:
    """Make a folder and its missing parents, for this user alone."""
    if not os.path.isdir(place):
        make_private(place.parent)
        place.mkdir(PRIVATE, exist_ok=True)


def _made(place: Path) -> bool:
    try:
        if place.name == PYTHONS:
            place.mkdir(exist_ok=True)
        make_private(place)
    except OSError:
        return False
    return True


def _private(place: Path) -> bool:
    """Tell whether only this user and root can change the folder and its folder of code."""
    if not hasattr(os, "getuid"):  # Windows keeps a user's folders apart
        return place.is_dir()
    try:
        around = os.stat(place.parent)
        held = around.st_uid in (0, _user()) and (around.st_mode & stat.S_ISVTX or not around.st_mode & 0o022)
        return bool(held) and _own(place) and (not os.path.lexists(place / CODE) or _own(place / CODE))
    except OSError:
        return False


def _own(place: Path) -> bool:
    found = os.stat(place)
    return stat.S_ISDIR(found.st_mode) and found.st_uid in (0, _user()) and not found.st_mode & 0o022


def _writable(place: Path) -> bool:
    inside = place / CODE if os.path.isdir(place / CODE) else place  # False if it cannot be read
    try:
        with tempfile.TemporaryFile(dir=inside):
            return True
    except OSError:
        return False


def _temporary() -> Path | None:
    """A temporary folder that is removed with this process."""
    try:
        made, process = Path(tempfile.mkdtemp(prefix="kickdrift-")), os.getpid()
    except OSError:
        return None

    def clear() -> None:
        if os.getpid() == process:  # not in a forked copy of the process
            shutil.rmtree(made, ignore_errors=True)

    atexit.register(clear)
    return made
