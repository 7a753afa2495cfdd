"""Opening of HDF5 files. Before anything is read, a walk through the structure refuses links out of the file.

HDF5 follows external links, external raw storage and virtual datasets into any file that this process may read or
write. kickdrift writes none of these, nor soft links or references, so a file that holds one is refused whole. The walk
also refuses damage that HDF5 itself does not survive (see `heaps`). It reads object headers and heaps alone, follows no
link, and opens no other file.
"""

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import h5py
from h5py import h5a, h5d, h5g, h5l, h5o, h5t

from kickdrift.disk.files import descriptor, reason, shown_path
from kickdrift.disk.foreign import foreign
from kickdrift.errors import InputError
from kickdrift.systemfile.files import is_shipped
from kickdrift.trajectory.file.headers import Headers
from kickdrift.trajectory.file.heaps import Heaps

DEEPEST = 32  # groups within groups
MOST = 10_000  # objects and attributes, each
OURS = ("h5md", "kickdrift", "observables", "particles", "table")  # groups at the top that kickdrift reads
FILTERS = (1, 2, 3, 4, 5, 6, 32000)  # HDF5's own and h5py's LZF; for any other, HDF5 would load code from a folder
BEING_WRITTEN = "a run is writing to it at this moment"
SETTLED = 2.0  # seconds: if a file has not changed for so long, the next change will show in the times of its status
_last: list[tuple[int, ...]] = [()]  # status of the file that was walked last, which need not be walked again
_LINKS = {h5l.TYPE_SOFT: "a soft link", h5l.TYPE_EXTERNAL: "an external link"}


def open_to_read(path: str | os.PathLike[str]) -> h5py.File:
    """Open an HDF5 file for reading. Raises InputError if it cannot be read, is being written, or has links out of
    itself."""
    if (text := shown_path(path)).endswith(".toml") or (is_shipped(text) and not os.path.lexists(path)):
        raise InputError(f"{text}: is a system file, not the file of a run; kickdrift run and kd.load take it")
    number = _descriptor(path)
    try:
        status = os.fstat(number)
        name = f"/dev/fd/{number}"  # the very file that was checked, even if another file has its name now
        name = name if os.path.exists(name) else os.fspath(path)
        key = (status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns, status.st_ctime_ns)
        with open(number, "rb", buffering=0, closefd=False) as source:
            check_root(path, source)
            try:
                file = h5py.File(name, "r", locking="best-effort")
            except (OSError, RuntimeError, ValueError) as error:
                raise InputError(f"{shown_path(path)}: {_why_not(path, name, error)}") from None
            if key == _last[0]:
                return file
            _walked(path, file, source)
    finally:
        os.close(number)
    if max(status.st_mtime, status.st_ctime) < time.time() - SETTLED:
        _last[0] = key
    return file


def open_stored(storage: Any, path: str | os.PathLike[str], *, own: bool = False, **options: Any) -> h5py.File:
    """Open the HDF5 file in a file object for writing. Raises OSError, or InputError if the file is damaged or has
    links out of itself. A file of this process's ``own`` making is not walked."""
    if not own:
        check_root(path, storage)
    file = h5py.File(storage, "r+", libver="earliest", **options)
    return file if own else _walked(path, file, storage)


def created(place: Any, **options: Any) -> h5py.File:
    """Create an HDF5 file in a file object, or under a name that no other process knows."""
    return h5py.File(place, "w", **options)


def check_root(path: str | os.PathLike[str], source: Any) -> None:
    """Raise InputError if HDF5 would allocate more for the first object than the file has. ``source`` is a file object
    with the file's bytes."""
    try:
        headers = Headers(source)
    except OSError as error:
        raise InputError(f"{shown_path(path)}: cannot be read: {reason(error)}") from None
    with _Walk(shown_path(path)).at("/"):
        headers.check_root()


def refuse_ways_out(path: str | os.PathLike[str], file: h5py.File, source: Any) -> None:
    """Raise InputError if the structure has links out of the file, has a loop or is damaged; the error names file and
    object. ``source`` is a file object with the file's bytes."""
    walk = _Walk(shown_path(path))
    with walk.at("/"):
        walk.heaps, walk.headers = Heaps(file, source), Headers(source)
        walk.look(file.id, "", ())


class _Walk:
    """A walk over all objects of a file. Each is checked once, whatever the number of its names."""

    heaps: Heaps
    headers: Headers

    def __init__(self, path: str) -> None:
        self.path = path
        self.seen: set[int] = set()
        self.attributes = 0

    @contextmanager
    def at(self, name: str) -> Iterator[None]:
        """Name the object in an error if HDF5 cannot read it."""
        try:
            yield
        except InputError:
            raise
        except (OSError, RuntimeError, ValueError, KeyError, TypeError, OverflowError, MemoryError) as error:
            raise InputError(f"{self.path}: damaged: {_shown(name)}: {_one_line(error)}") from None

    def refuse(self, name: str, what: str) -> None:
        raise InputError(f"{self.path}: {_shown(name)} {what}; kickdrift does not open such a file")

    def look(self, item: Any, name: str, above: tuple[int, ...]) -> None:
        """Check one object and its content."""
        found = h5o.get_info(item)
        if found.addr in above:
            self.refuse(name, "is a group that holds itself")
        if found.addr in self.seen:
            return
        self.seen.add(found.addr)
        if len(self.seen) > MOST:
            self.refuse("/", f"holds more than {MOST:,} objects")
        self._attributes(item, name, found)
        if isinstance(item, h5d.DatasetID):
            self.heaps.check_dataset(found.addr, item)
            self._dataset(item, name)
        elif isinstance(item, h5t.TypeID):
            if item.detect_class(h5t.REFERENCE):
                self.refuse(name, "is a type of references")
        else:
            self._group(item, name, (*above, found.addr))

    def _group(self, group: Any, name: str, above: tuple[int, ...]) -> None:
        if len(above) > DEEPEST:
            self.refuse(name, f"lies more than {DEEPEST} groups deep")
        links: list[tuple[bytes, int, int]] = []

        def note(link: bytes, about: Any) -> int | None:
            links.append((link, about.type, about.u))
            return 1 if len(links) > MOST else None  # any value but None ends the iteration

        group = group if isinstance(group, h5g.GroupID) else h5g.open(group, b"/")
        group.links.iterate(note, info=True)
        if len(links) > MOST:
            self.refuse(name or "/", f"holds more than {MOST:,} names")
        for link, kind, address in links:
            inner = f"{name}/{link.decode('utf-8', 'backslashreplace')}"
            if kind != h5l.TYPE_HARD:
                self.refuse(inner, f"is {_LINKS.get(kind, 'a link of unknown kind')}")
            with self.at(inner):
                self.headers.check(address)
                self.look(h5o.open(group, link), inner, above)

    def _dataset(self, data: Any, name: str) -> None:
        made = data.get_create_plist()
        if made.get_external_count():
            self.refuse(name, "keeps its values in another file")
        if made.get_layout() == h5d.VIRTUAL:
            self.refuse(name, "is a virtual dataset, whose values are in other files")
        if data.get_type().detect_class(h5t.REFERENCE):
            self.refuse(name, "holds references")
        if name.split("/")[1] in OURS:
            for k in range(made.get_nfilters()):
                if (number := made.get_filter(k)[0]) not in FILTERS:
                    self.refuse(name, f"needs filter {number}, which kickdrift does not use")

    def _attributes(self, item: Any, name: str, about: Any) -> None:
        self.attributes += about.num_attrs
        if self.attributes > MOST:
            self.refuse(name or "/", f"and the objects before it have more than {MOST:,} attributes")
        there = [h5a.open(item, index=k) for k in range(about.num_attrs)]
        if any(each.get_type().detect_class(h5t.REFERENCE) for each in there):
            self.refuse(name or "/", "has an attribute of references")
        self.heaps.check_attributes(about.addr, there)


def _walked(path: str | os.PathLike[str], file: h5py.File, source: Any) -> h5py.File:
    try:
        refuse_ways_out(path, file, source)
    except BaseException:
        file.close()
        raise
    return file


def _descriptor(path: str | os.PathLike[str]) -> int:
    try:
        return descriptor(path)
    except (OSError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{shown_path(path)}: {reason(error)}") from None


def _why_not(path: str | os.PathLike[str], name: str, error: Exception) -> str:
    """Reason why HDF5 cannot open a file."""
    if isinstance(error, BlockingIOError):
        return f"{BEING_WRITTEN}; it can be read when that is over"
    if "truncated file" in str(error):
        return "is truncated: its end is missing (copied in part?)"
    with suppress(OSError):  # if not even the first bytes can be read
        if not h5py.is_hdf5(name):
            what = foreign(path)
            return "is not an HDF5 file" + (f": it {what}" if what else "")
    return f"cannot be read: {_one_line(error)}"


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__


def _shown(name: str) -> str:
    """An object's name for a message: without control characters and limited in length."""
    text = "".join(each if each.isprintable() else f"\\x{ord(each):02x}" for each in name)
    return text if len(text) <= 100 else f"{text[:97]}…"
