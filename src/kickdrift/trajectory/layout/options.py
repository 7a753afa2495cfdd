"""Options for writing a run's file."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from numbers import Real
from warnings import warn

import numpy as np

from kickdrift.errors import InputError

STORES = ("float64", "float32")
EXTRAS = ("forces", "images")


@dataclass(frozen=True, init=False)
class FileOptions:
    """Options for the file that `Simulation.run` writes.

    Parameters
    ----------
    flush : seconds between writes to disk; a kill loses at most this much of the run
    store : "float64", or "float32" for positions, velocities and forces of half the size. Checkpoints for a restart and
        observables stay float64
    compress : compress the file at the run's end with HDF5's gzip and shuffle filters, without loss. During the run,
        and after a kill, the file is not compressed
    write : further content of each frame: "forces", and "images" (how many boxes each particle is away from the box at
        the origin; positions are then stored inside the box, as H5MD recommends)

    Raises
    ------
    InputError
        If a value makes no sense.
    """

    flush: float
    store: str
    compress: bool
    write: tuple[str, ...]

    def __init__(
        self,
        flush: float = 10.0,
        store: str = "float64",
        compress: bool = False,
        write: Iterable[str] = (),
        *,
        precision: str | None = None,  # old name of ``store``; removed in 0.3
    ) -> None:
        if precision is not None:
            warn("FileOptions(precision=…) is deprecated since 0.2; use store=…", DeprecationWarning, stacklevel=2)
            store = precision
        for key, value in (("flush", flush), ("store", store), ("compress", compress), ("write", write)):
            object.__setattr__(self, key, value)
        self._check()

    @property
    def precision(self) -> str:
        """Old name of ``store``, removed in 0.3."""
        warn("FileOptions.precision is deprecated since 0.2; use store", DeprecationWarning, stacklevel=2)
        return self.store

    def _check(self) -> None:
        number = isinstance(self.flush, Real) and not isinstance(self.flush, bool)
        if not (number and np.isfinite(self.flush) and self.flush > 0):
            raise InputError(f"flush: must be a positive number of seconds, got {self.flush!r}")
        if self.store not in STORES:
            raise InputError(f"store: must be {' or '.join(STORES)}, got {self.store!r}")
        if not isinstance(self.compress, bool):
            raise InputError(f"compress: must be True or False, got {self.compress!r}")
        if isinstance(self.write, str) or any(each not in EXTRAS for each in self.write):
            raise InputError(f"write: must be among {', '.join(EXTRAS)}, got {self.write!r}")
        object.__setattr__(self, "write", tuple(each for each in EXTRAS if each in self.write))

    @property
    def dtype(self) -> str:
        """Type of stored vectors in NumPy's short form."""
        return "f8" if self.store == "float64" else "f4"
