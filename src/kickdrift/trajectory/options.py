"""How a run's file is written."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Real

import numpy as np

from kickdrift.errors import InputError

PRECISIONS = ("float64", "float32")
EXTRAS = ("forces", "images")


@dataclass(frozen=True)
class FileOptions:
    """How `Simulation.run` writes its ``output``.

    Parameters
    ----------
    flush : seconds after which what was kept in memory goes to the file; that much a kill can cost at most
    precision : "float64", or "float32" for positions, velocities and forces of half the size. What a run is resumed
        from, and observables, stay float64
    compress : write the file anew with HDF5's gzip and shuffle filters when the run has come to its end; lossless. A
        run that is killed leaves the file as it is while it is written, not compressed
    write : what else each frame holds: "forces", and "images" (how many boxes each particle is away from the box at the
        origin; positions are then stored inside the box, as H5MD wants it)

    Raises
    ------
    InputError
        Where a value makes no sense.
    """

    flush: float = 10.0
    precision: str = "float64"
    compress: bool = False
    write: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        number = isinstance(self.flush, Real) and not isinstance(self.flush, bool)
        if not (number and np.isfinite(self.flush) and self.flush > 0):
            raise InputError(f"flush: must be a positive number of seconds, got {self.flush!r}")
        if self.precision not in PRECISIONS:
            raise InputError(f"precision: must be {' or '.join(PRECISIONS)}, got {self.precision!r}")
        if not isinstance(self.compress, bool):
            raise InputError(f"compress: must be True or False, got {self.compress!r}")
        if isinstance(self.write, str) or any(each not in EXTRAS for each in self.write):
            raise InputError(f"write: must be some of {', '.join(EXTRAS)}, got {self.write!r}")
        object.__setattr__(self, "write", tuple(each for each in EXTRAS if each in self.write))

    @property
    def dtype(self) -> str:
        """Of stored vectors, in NumPy's short form."""
        return "f8" if self.precision == "float64" else "f4"
