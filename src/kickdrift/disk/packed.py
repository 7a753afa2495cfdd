"""Files packed by gzip or bzip2, unpacked beside nothing else in a temporary folder."""

import bz2
import gzip
import os
import tempfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from kickdrift.disk.files import shown_path, unfit
from kickdrift.errors import InputError

PACKED: dict[str, Callable[..., Any]] = {".gz": gzip.open, ".bz2": bz2.open}
MOST, PART = 2**31, 2**20  # bytes of an unpacked file, and of one read


def is_packed(path: str | os.PathLike[str]) -> bool:
    """Tell whether the ending of a name is that of a packed file."""
    return os.path.splitext(path)[1].lower() in PACKED


@contextmanager
def unpacked(path: Path) -> Iterator[Path]:
    """Context with the path of the unpacked file. Errors inside name the packed one. Raises InputError for a damaged
    file, and for one that unpacks to more than `MOST` bytes."""
    if why := unfit(path):
        raise InputError(f"{why}: {path}")
    with tempfile.TemporaryDirectory(prefix="kickdrift-") as folder:
        inner = Path(folder) / path.stem
        try:
            with PACKED[path.suffix.lower()](path) as source, inner.open("wb") as made:
                while part := source.read(PART):
                    if made.tell() + len(part) > MOST:
                        raise InputError(f"{shown_path(path)}: unpacks to more than {MOST:,} bytes")
                    made.write(part)
        except (OSError, EOFError, zlib.error) as error:
            text = " ".join(str(error).split())
            raise InputError(f"{shown_path(path)}: cannot be unpacked: {text}") from None
        try:
            yield inner
        except InputError as error:
            raise InputError(str(error).replace(str(inner), str(path))) from None
