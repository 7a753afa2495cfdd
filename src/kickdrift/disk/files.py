"""Input files of the user: only regular files are opened, and no open waits for another program."""

import errno
import os
import stat
from io import BufferedReader, FileIO
from pathlib import Path
from typing import Any, BinaryIO

from kickdrift.errors import InputError

SYSTEM_FILE_BYTES = 16 * 2**20  # about 200,000 particles line by line; put more into a structure file
BLOCK = 2**20  # bytes read at a time
_WORDS = {
    errno.ENOENT: "no such file",
    errno.ENOTDIR: "no such file",
    errno.EACCES: "no permission to read it",
    errno.EPERM: "no permission to read it",
    errno.ELOOP: "is a loop of symbolic links",
    errno.ENAMETOOLONG: "the name is too long",
    errno.ENXIO: "is a socket or device, not a file",
}
_KINDS = {
    stat.S_IFDIR: "is a folder",
    stat.S_IFIFO: "is a pipe",
    stat.S_IFCHR: "is a device",
    stat.S_IFBLK: "is a device",
    stat.S_IFSOCK: "is a socket",
}


def unfit(path: str | os.PathLike[str], what: str = "a file") -> str | None:
    """Reason why the path is not a regular file, or None. Opens nothing."""
    try:
        return _unfit(os.stat(path), what)
    except (OSError, ValueError) as error:
        return reason(error)


def refuse_unfit(path: str | os.PathLike[str], what: str = "a file") -> None:
    """Raise InputError if the path is not a regular file."""
    if why := unfit(path, what):
        raise InputError(f"{shown_path(path)}: {why}")


def descriptor(path: str | os.PathLike[str], flags: int = os.O_RDONLY, what: str = "a file") -> int:
    """Open a regular file without waiting and return its descriptor. Raises OSError, or InputError if the path is not a
    regular file.

    The type is checked before opening, since opening a device may have effects. It is checked again afterwards, since
    another file may have taken the name meanwhile.
    """
    if why := _unfit(os.stat(path), what):
        raise InputError(f"{shown_path(path)}: {why}")
    number = os.open(path, flags | _flag("O_NONBLOCK") | _flag("O_CLOEXEC") | _flag("O_NOCTTY") | _flag("O_BINARY"))
    if why := _unfit(os.fstat(number), what):
        os.close(number)
        raise InputError(f"{shown_path(path)}: {why}")
    return number


def opened(path: str | os.PathLike[str], what: str = "a file") -> BinaryIO:
    """Open a regular file for reading. Raises an InputError with the reason if it cannot be opened."""
    try:
        return BufferedReader(_Input(descriptor(path, what=what), os.fspath(path)))
    except (OSError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{shown_path(path)}: {reason(error)}") from None


class _Input(FileIO):
    """The bytes of an input file. An error of the system becomes an InputError that names the file."""

    def __init__(self, number: int, path: str) -> None:
        super().__init__(number)
        self._path = path

    def readinto(self, buffer: Any) -> int:
        try:
            return super().readinto(buffer)
        except OSError as error:
            raise InputError(f"{shown_path(self._path)}: cannot be read: {reason(error)}") from None

    def readall(self) -> bytes:
        return b"".join(iter(lambda: self.read(BLOCK), b""))


def content(path: str | os.PathLike[str], most: int, what: str = "a file") -> bytes:
    """Bytes of a regular file. Raises InputError if there are more than ``most``, even if the file grows during
    reading."""
    with opened(path, what) as file:
        found = file.read(most + 1)
    if len(found) > most:
        raise InputError(f"{shown_path(path)}: too large: {what} has at most {most:,} bytes")
    return found


def shown_path(path: str | os.PathLike[str]) -> str:
    """Path as shown in messages: bytes that are not UTF-8 are written as numbers."""
    return os.fspath(path).encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")


def reason(error: OSError | ValueError) -> str:
    """The system's reason why a file cannot be read, as text."""
    if not isinstance(error, OSError):
        return "the name has a null character"
    return _WORDS.get(error.errno or 0, (error.strerror or str(error)).lower())


def _unfit(status: os.stat_result, what: str) -> str | None:
    if stat.S_ISREG(status.st_mode):
        return None
    return f"{_KINDS.get(stat.S_IFMT(status.st_mode), 'is no regular file')}, not {what}"


def _flag(name: str) -> int:
    return getattr(os, name, 0)  # Windows lacks most of these


def same_file(one: str | os.PathLike[str], other: str | os.PathLike[str]) -> bool:
    """Tell whether two names belong to one existing file."""
    try:
        return os.path.samestat(os.stat(one), os.stat(other))
    except (OSError, ValueError):
        return False


def place(path: str | os.PathLike[str]) -> Path:
    """Path with symbolic links of the folder resolved; a link with the name itself is kept."""
    path = Path(os.path.abspath(path))
    return Path(os.path.realpath(path.parent)) / path.name
