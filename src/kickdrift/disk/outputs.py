"""Output files of commands: checked before any work starts, and written whole or not at all.

An existing file is replaced only on request, and only if it is a regular file that kickdrift could have written. A
device or a pipe is written to directly. A file that is being written lies in a private folder beside its place.
"""

import contextlib
import errno
import json
import math
import os
import re
import shutil
import stat
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

from kickdrift.disk import kinds
from kickdrift.disk.files import place, same_file, shown_path
from kickdrift.disk.interrupt import tidy
from kickdrift.disk.kinds import Kind, is_ours, wrong_ending
from kickdrift.disk.posix import flags
from kickdrift.errors import InputError, RunError

KINDS = {"json": kinds.JSON, "plot": kinds.FIGURE}  # by option
_OWN = re.compile(r"/(?:dev|proc/self)/(?:fd/(\d{1,9})|(stdin|stdout|stderr))")
STDOUT = Path("-")  # the program's standard output
_CLOSED = (errno.EACCES, errno.EPERM, errno.EROFS)  # places without write permission
_pipes: dict[tuple[int, int], int] = {}  # pipes by device and inode, open since the check, so that no reader leaves


def refuse_outputs(
    paths: Mapping[str, Path | None],
    overwrite: bool,
    inputs: Iterable[str | os.PathLike[str] | None] = (),
    output: Kind | None = None,
) -> None:
    """Raise InputError before any work if an option's file exists, is one of the ``inputs``, or cannot be written.

    ``output`` is the kind of the option of that name; default a run's file."""
    taken: dict[Path, str] = {}
    for option, path in paths.items():
        if path is None:
            continue
        said = f"--{option} {shown_path(path)}"
        kind = KINDS.get(option) or output or kinds.of_run(path)
        if (target := _checked(path, kind, overwrite, inputs, said, "give --overwrite")) is None:
            continue
        for other, name in taken.items():
            if other == target or same_file(other, target):
                raise InputError(f"{said}: --{name} names the same file")
        taken[target] = option
        _try_folder(target.parent, said)


def checked_target(
    output: str | os.PathLike[str], kind: Kind, overwrite: bool, inputs: Iterable[str | os.PathLike[str] | None] = ()
) -> Path:
    """Checked path of a file to be written. Raises InputError for a wrong name, an existing file, and a folder that is
    missing or takes no files."""
    said = shown_path(output)
    if target := _checked(output, kind, overwrite, inputs, said, "pass --overwrite (overwrite=True)"):
        _try_folder(target.parent, said)
    return Path(output)


def _try_folder(folder: Path, said: str) -> None:
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise InputError(f"{said}: cannot be written: {reason(error)}") from None


def _checked(
    path: str | os.PathLike[str],
    kind: Kind,
    overwrite: bool,
    inputs: Iterable[str | os.PathLike[str] | None],
    said: str,
    how: str,
) -> Path | None:
    """Path with its folder's links followed; None for a device or a pipe. ``said`` begins each message."""
    path = Path(path)
    if kind.suffixes and path.suffix.lower() not in kind.suffixes:
        name = "the name" if said.startswith("--") else f"the name of {kind.noun}"
        raise InputError(f"{said}: {name} {wrong_ending(path, kind.suffixes)}")
    status = _status(path, said)
    if is_stream(path):
        if not kind.streams:
            raise InputError(f"{said}: is a device or a pipe; {kind.noun} is a regular file")
        _hold(path, said)
        return None
    if status:
        if why := _not_regular(status):
            raise InputError(f"{said}: {why}")
        if any(each is not None and same_file(each, path) for each in inputs):
            raise InputError(f"{said}: is an input of this command and is not replaced")
        if not overwrite:
            raise InputError(f"{said}: exists already; {how} to replace it")
    if not path.absolute().parent.is_dir():
        raise InputError(f"{said}: there is no folder {shown_path(path.parent)}")
    if status and (why := _not_to_be_replaced(path, status, kind)):
        raise InputError(f"{said}: {why}")
    return place(path)


def _status(path: Path, said: str) -> os.stat_result | None:
    """Status of the name itself, without following a symbolic link; None if it does not exist."""
    try:
        os.fspath(path).encode()
        return os.lstat(path)
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise InputError(f"{said}: cannot be written: {reason(error)}") from None
    except UnicodeEncodeError:
        raise InputError(f"{said}: the name is not UTF-8") from None
    except ValueError:
        raise InputError(f"{said!a}: the name has a null character") from None


def _not_regular(status: os.stat_result) -> str | None:
    """Reason why this is not a regular file, as text."""
    if stat.S_ISREG(status.st_mode):
        return None
    if stat.S_ISLNK(status.st_mode):
        return "is a symbolic link; give the name of the file itself"
    return "is a folder" if stat.S_ISDIR(status.st_mode) else "is no regular file"


def _not_to_be_replaced(path: Path, status: os.stat_result, kind: Kind) -> str | None:
    """Reason why an existing file is kept, although the user permits its replacement."""
    if why := _not_regular(status):
        return why
    if not status.st_mode & 0o222:
        return "is read-only; it is not replaced"
    return None if is_ours(path, kind) else f"is not {kind.noun} that kickdrift wrote; it is not replaced"


def reason(error: OSError) -> str:
    """The system's reason why a file cannot be written."""
    return (error.strerror or str(error)).lower()


# --- writing ---


@contextmanager
def written_whole(path: Path, kind: Kind, *, overwrite: bool) -> Iterator[Path]:
    """Yield a path for writing. At the end its file takes the name ``path``, or goes to the device or pipe there. After
    an error nothing new remains."""
    try:
        if is_stream(path):
            with tempfile.TemporaryDirectory(prefix="kickdrift-") as folder:
                yield Path(folder) / path.name
                with open(Path(folder) / path.name, "rb") as part, _stream(path) as stream:
                    shutil.copyfileobj(part, stream)
        else:
            with private_place(path) as part:
                yield part
                settle(part, path, kind, overwrite=overwrite)
    except OSError as error:
        kind_of_error = InputError if error.errno in _CLOSED else RunError
        raise kind_of_error(f"{shown_path(path)}: cannot be written: {reason(error)}") from None


def settle(part: Path, path: Path, kind: Kind, *, overwrite: bool) -> None:
    """Give a finished file its name. Raises InputError if an existing file must not be replaced."""
    said = shown_path(path)
    if not overwrite:
        try:
            _link(part, path)
        except FileExistsError:
            raise InputError(f"{said}: exists already; pass --overwrite (overwrite=True) to replace it") from None
        return
    status = _status(path, said)
    if status and (why := _not_to_be_replaced(path, status, kind)):
        raise InputError(f"{said}: {why}")
    os.replace(part, path)


def _link(part: Path, path: Path) -> None:
    """Give the file its name unless the name is taken, in one operation if the file system has hard links."""
    try:
        os.link(part, path)
    except FileExistsError:
        raise
    except OSError:
        if os.path.lexists(path):
            raise FileExistsError from None
        os.replace(part, path)


def write_system(path: Path | None, text: str, *, overwrite: bool) -> None:
    """Write a System's text on request. The file is whole or absent."""
    if path is not None:
        with written_whole(path, kinds.SYSTEM, overwrite=overwrite) as part:
            part.write_text(text, encoding="utf-8")


def write_json(path: Path | None, content: dict[str, Any], *, overwrite: bool) -> None:
    """Write one JSON object on request. The file is whole or absent."""
    if path is not None:
        with written_whole(path, kinds.JSON, overwrite=overwrite) as part:
            part.write_text(json.dumps(plain(content), indent=2, allow_nan=False) + "\n", encoding="utf-8")


# --- devices and pipes ---


def is_stream(path: str | os.PathLike[str]) -> bool:
    """Tell whether the path is a pipe, a character device such as /dev/null, or one of the program's own streams such
    as /dev/stdout or ``-``."""
    if os.fspath(path) == os.fspath(STDOUT):
        return True
    try:
        mode = os.stat(path).st_mode
    except (OSError, ValueError):
        return False
    return stat.S_ISFIFO(mode) or stat.S_ISCHR(mode) or _own(path) in (1, 2)


def _own(path: str | os.PathLike[str]) -> int | None:
    """Descriptor of a name such as /dev/stdout, or of ``-``."""
    if os.fspath(path) == os.fspath(STDOUT):
        return 1
    found = _OWN.fullmatch(os.fspath(path))
    if not found:
        return None
    number, word = found.groups()
    return int(number) if number else {"stdin": 0, "stdout": 1, "stderr": 2}[word]


def _hold(path: Path, said: str) -> None:
    """Open a pipe now, without waiting for a reader, so that an existing reader does not wait in vain."""
    if _own(path) is not None or not stat.S_ISFIFO((status := os.stat(path)).st_mode):
        return
    if (status.st_dev, status.st_ino) not in _pipes:
        try:
            _pipes[status.st_dev, status.st_ino] = os.open(path, os.O_WRONLY | flags("O_NONBLOCK", "O_CLOEXEC"))
        except OSError as error:
            why = "is a pipe that no program reads" if error.errno == errno.ENXIO else reason(error)
            raise InputError(f"{said}: {why}") from None


def _stream(path: Path) -> BinaryIO:
    """Open a device or a pipe for writing."""
    if (own := _own(path)) is not None:
        for each in (sys.stdout, sys.stderr):
            each.flush()
        number = os.dup(own)
    else:
        status = os.stat(path)
        number = _pipes.pop((status.st_dev, status.st_ino), -1)
        if number < 0:
            number = os.open(path, os.O_WRONLY | flags("O_NONBLOCK", "O_NOCTTY", "O_CLOEXEC"))
        mode = os.fstat(number).st_mode
        if not (stat.S_ISFIFO(mode) or stat.S_ISCHR(mode)):
            os.close(number)
            raise OSError(errno.EEXIST, "another file has taken its place")
        os.set_blocking(number, True)
    return os.fdopen(number, "wb")


def plain(value: Any) -> Any:
    """Replace NaN and infinity by None, since JSON cannot hold them."""
    if isinstance(value, dict):
        return {key: plain(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(inner) for inner in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


PREFIX, SUFFIX = ".kickdrift-", ".part"
STALE = 3600.0  # seconds without changes after which a folder counts as left by a kill


@contextmanager
def private_place(path: Path) -> Iterator[Path]:
    """Yield a path of the same name in a new private folder beside ``path``, with a name that cannot be guessed. The
    folder and its content are removed at the end, also after SIGTERM. So are old folders left by a kill."""
    _remove_stale(path.parent)
    with tidy():
        folder = Path(tempfile.mkdtemp(SUFFIX, PREFIX, path.parent))  # mode 0700
        try:
            yield folder / path.name
        finally:
            shutil.rmtree(folder, ignore_errors=True)


def _remove_stale(folder: Path) -> None:
    """Remove folders of this kind, of this user, that have not changed for a long time."""
    with contextlib.suppress(OSError), os.scandir(folder) as found:
        for entry in found:
            if entry.name.startswith(PREFIX) and entry.name.endswith(SUFFIX):
                with contextlib.suppress(OSError):
                    _remove_if_stale(entry)


def _remove_if_stale(entry: os.DirEntry[str]) -> None:
    status = entry.stat(follow_symlinks=False)
    if not stat.S_ISDIR(status.st_mode) or status.st_uid != getattr(os, "getuid", lambda: status.st_uid)():
        return
    with os.scandir(entry.path) as inside:
        latest = max([status.st_mtime, *(each.stat(follow_symlinks=False).st_mtime for each in inside)])
    if latest < time.time() - STALE:
        shutil.rmtree(entry.path, ignore_errors=True)
