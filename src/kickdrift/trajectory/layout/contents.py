"""Reading a run's file as untrusted data: each object's kind, type and shape is checked before it is read.

Every fault becomes an InputError of one line that names the file and the object. No array that is read is larger than
the file, or than the file's compressed bytes can hold.
"""

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError, KickdriftError

# Errors of h5py and NumPy for wrong links, indices, types or sizes in a file.
_ERRORS = (
    ArithmeticError, AttributeError, LookupError, MemoryError, OSError, RuntimeError, SystemError, TypeError, ValueError
)  # fmt: skip
_FILTERS = {h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_FLETCHER32}
_DEFLATED = 1032  # most bytes that one compressed byte can become
_LEAST_BYTES = 16 * 2**20  # room for the first chunks of a file without rows
MOST_NESTED = 40  # levels of a JSON text; kickdrift writes ten at most
_WORDS = {"i": "whole numbers", "u": "whole numbers", "f": "numbers", "S": "texts"}

Shape = tuple[int | None, ...]


class Contents:
    """An open HDF5 file whose objects are checked before they are read.

    Parameters
    ----------
    file : the open file
    path : its name, for errors
    """

    def __init__(self, file: h5py.File, path: Path | str) -> None:
        self._file, self.path = file, path
        self._objects: dict[str, Any] = {}  # objects that were opened, and datasets that were checked
        self._datasets: dict[tuple[str, str, Shape], h5py.Dataset] = {}
        with self.guarded("its size"):
            self.bytes = int(file.id.get_filesize())

    @property
    def file(self) -> h5py.File:
        """Open HDF5 file. Raises InputError once it is closed."""
        if not self._file:
            raise InputError(f"{self.path}: is closed; read it inside of its with block")
        return self._file

    def damaged(self, what: str) -> InputError:
        """InputError of one line with the file's name and what is wrong."""
        return InputError(f"{self.path}: damaged: {' '.join(what.split())}")

    @contextmanager
    def guarded(self, what: str) -> Iterator[None]:
        """Turn every error of HDF5 into one line about ``what``."""
        try:
            yield
        except KickdriftError:
            raise
        except _ERRORS as error:
            said = " ".join(str(error).split())
            raise self.damaged(f"{what} cannot be read{': ' * bool(said)}{said[:120]}") from None

    def has(self, name: str) -> bool:
        with self.guarded(name):
            return name in self.file

    def group(self, name: str) -> h5py.Group:
        found = self.anything(name)
        if not isinstance(found, h5py.Group):
            raise self.damaged(f"{name} is a dataset; expected a group")
        return found

    def names(self, name: str) -> list[str]:
        """Names of a group's members."""
        group = self.group(name)
        with self.guarded(name):
            return list(group)

    def anything(self, name: str) -> Any:
        """Return the object with this name, of any kind."""
        file = self.file
        if name not in self._objects:
            with self.guarded(name):
                try:
                    self._objects[name] = file[name]
                except KeyError:
                    if name not in file:
                        raise self.damaged(f"{name} is missing") from None
                    raise
        return self._objects[name]

    def dataset(self, name: str, kinds: str, shape: Shape) -> h5py.Dataset:
        """Return the dataset with this name.

        Its type must be one of the ``kinds`` ("f8 f4", "text") and its shape must match, where None is any length. Its
        size must fit into the file."""
        known = self._datasets.get((name, kinds, shape))
        if known is not None and self.file:
            return known
        found = self.anything(name)
        if not isinstance(found, h5py.Dataset):
            raise self.damaged(f"{name} is a group; expected a dataset")
        with self.guarded(name):
            dtype, there = found.dtype, found.shape
            kind = "text" if h5py.check_string_dtype(dtype) and dtype.kind == "O" else f"{dtype.kind}{dtype.itemsize}"
            most = self._most_bytes(found)
            chunk = found.chunks or ()
        if kind not in kinds.split():
            wanted = _WORDS.get(kinds[0], "text") + (f" ({kinds})" if kinds != "text" else "")
            raise self.damaged(f"{name} holds {'text' if kind == 'text' else dtype}; expected {wanted}")
        if there is None or len(there) != len(shape) or any(n not in (None, m) for n, m in zip(shape, there)):  # noqa: B905
            wanted = ", ".join("any" if n is None else str(n) for n in shape)
            raise self.damaged(f"{name} has the shape {there}; expected ({wanted})")
        for what, sizes in (("rows", there), ("chunks", chunk)):
            if _product(sizes) * dtype.itemsize > (most if what == "rows" else max(most, _LEAST_BYTES)):
                raise self.damaged(f"{name} claims {what} of {sizes}, more than the file's {self.bytes:,} bytes hold")
        self._datasets[name, kinds, shape] = found
        return found

    def _most_bytes(self, dataset: h5py.Dataset) -> int:
        """Largest possible size of a dataset in bytes."""
        properties = dataset.id.get_create_plist()
        filters = {properties.get_filter(k)[0] for k in range(properties.get_nfilters())}
        if unknown := filters - _FILTERS:
            raise self.damaged(f"{dataset.name} uses an unknown filter ({min(unknown)})")
        return self.bytes * (_DEFLATED if h5py.h5z.FILTER_DEFLATE in filters else 1)

    def series(self, name: str, kinds: str, rows: int, shape: Shape = ()) -> h5py.Dataset:
        """Return a dataset of at least ``rows`` rows, each of this shape."""
        found = self.dataset(name, kinds, (None, *shape))
        if found.shape[0] < rows:
            raise self.damaged(f"{name} has {found.shape[0]} rows; expected {rows}")
        return found

    def read(self, dataset: h5py.Dataset, chosen: Any = ()) -> NDArray:
        """Numbers of a checked dataset, or a part of them, in this machine's byte order."""
        with self.guarded(str(dataset.name)):
            found = np.asarray(dataset[chosen])
            return found.astype(found.dtype.newbyteorder("="), copy=False)

    def array(self, name: str, kinds: str, shape: Shape) -> NDArray:
        """Read all numbers of a dataset."""
        return self.read(self.dataset(name, kinds, shape))

    def text(self, name: str) -> str:
        """Read a scalar text."""
        found = self.dataset(name, "text", ())
        with self.guarded(name):
            return str(found.asstr()[()])

    def json(self, name: str) -> Any:
        """Read a JSON text as a value."""
        return self.parsed(self.text(name), name)

    def parsed(self, text: str, name: str) -> Any:
        """Value of a JSON text that is nested at most MOST_NESTED levels deep."""
        try:
            found = json.loads(text)
            deep = too_deep(found)
        except RecursionError:
            deep = True
        except ValueError as error:
            raise self.damaged(f"{name} is not JSON: {error}") from None
        if deep:
            raise self.damaged(f"{name}: JSON nested more than {MOST_NESTED} levels deep")
        return found

    def attribute(self, name: str, key: str, kind: type) -> Any:
        """Read an object's attribute: a str, an int (from 0 to 2^63), a finite float or a bool."""
        owner, label = self.anything(name), f"attribute {key} of {name}"
        with self.guarded(label):
            if key not in owner.attrs:
                raise self.damaged(f"{label} is missing")
            value = owner.attrs[key]
            value = value.decode() if isinstance(value, bytes) else value
            value = value.item() if isinstance(value, np.generic) else value
            if kind is str and isinstance(value, str):
                value.encode()  # raises if the text is not UTF-8
                return value
        if kind is float and type(value) in (int, float) and np.isfinite(value):
            return float(value)
        if kind is int and type(value) is int and 0 <= value < 2**63:
            return value
        if kind is bool and type(value) is bool:
            return value
        raise self.damaged(f"{label} is {short(value)}; expected {_KINDS[kind]}")


_KINDS = {str: "text", int: "a whole number, zero or more", float: "a finite number", bool: "true or false"}


def short(value: Any) -> str:
    """A value from a file, shortened for an error of one line."""
    text = " ".join(ascii(value).split())
    return text if len(text) <= 60 else f"{text[:57]}..."


def too_deep(value: Any, most: int = MOST_NESTED) -> bool:
    """Tell whether lists and dictionaries are nested more than ``most`` levels deep."""
    level = [value]
    for _ in range(most + 1):
        level = [inner for each in level for inner in _inside(each)]
        if not level:
            return False
    return True


def _inside(value: Any) -> Sequence[Any]:
    if isinstance(value, dict):
        return list(value.values())
    return value if isinstance(value, list) else ()


def _product(sizes: Sequence[int]) -> int:
    """Product in Python integers, which cannot overflow."""
    found = 1
    for size in sizes:
        found *= int(size)
    return found
