"""Atoms of LAMMPS' data files, read as whole tables of numbers.

Format: https://docs.lammps.org/read_data.html.
"""

import re
import warnings
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.model.state import Floats

# columns of the type, the charge and x, after the column of the id
STYLES: dict[str, tuple[int, int | None, int]] = {
    "atomic": (1, None, 2), "charge": (1, 2, 3), "bond": (2, None, 3), "angle": (2, None, 3),
    "molecular": (2, None, 3), "full": (2, 3, 4),
}  # fmt: skip
_TITLE = re.compile(r"^[ \t]*([A-Z][A-Za-z]*(?: [A-Z][A-Za-z]*)*)[ \t]*(?:#[ \t]*(.*?))?[ \t]*$", re.MULTILINE)
_EDGES = {("xlo", "xhi"): 0, ("ylo", "yhi"): 1, ("zlo", "zhi"): 2}


class AtomTable(NamedTuple):
    """Atoms in the order of their ids, with the numbers of the file."""

    cell: Floats  # (3, 3)
    positions: Floats  # (n, 3), moved by the image flags
    types: NDArray[np.int64]  # (n,)
    masses: Floats  # (n,)
    velocities: Floats | None  # (n, 3)
    charges: Floats | None  # (n,)


class _Other(Exception):
    """The file is none of the plain files that this module reads."""


def atom_table(path: Path, style: str | None) -> AtomTable | None:
    """Return the atoms of a data file whose sections are tables of numbers, with a mass for each type.

    None for any other file, also for a damaged one. ``style`` is the atom style, default the one in the file, or
    "atomic" or "full" by the number of columns."""
    try:
        return _read(path.read_text(encoding="utf-8"), style)
    except (_Other, ValueError, KeyError, IndexError, OverflowError):
        return None


def _read(text: str, style: str | None) -> AtomTable:
    titles = list(_TITLE.finditer(text, text.index("\n") + 1))
    ends = [title.start() for title in titles[1:]] + [len(text)]
    sections = {title[1]: (title[2] or "", text[title.end() : end]) for title, end in zip(titles, ends, strict=True)}
    if len(sections) < len(titles) or not {"Atoms", "Masses"} <= set(sections) or "Atom Type Labels" in sections:
        raise _Other
    count, cell = _header(text[: titles[0].start()])
    named, body = sections["Atoms"]
    rows = _numbers(body, count)
    columns = rows.shape[1]
    style = style or named or {5: "atomic", 8: "atomic", 7: "full", 10: "full"}[columns]
    kind, charge, first = STYLES[style]
    if columns not in (first + 3, first + 6):
        raise _Other
    rows = _by_id(rows)
    ids, types = _whole(rows[:, 0]), _whole(rows[:, kind])
    if not (np.diff(ids) > 0).all() or types.min() < 1:
        raise _Other
    positions = rows[:, first : first + 3].copy()
    if columns == first + 6:
        positions += _whole(rows[:, first + 3 :]) @ cell
    given = dict(line.split()[:2] for line in re.sub("#.*", "", sections["Masses"][1]).splitlines() if line.strip())
    masses, velocities = {int(key): float(value) for key, value in given.items()}, None
    if "Velocities" in sections:
        moving = _by_id(_numbers(sections["Velocities"][1], count))
        if moving.shape[1] != 4 or not np.array_equal(moving[:, 0], ids):
            raise _Other
        velocities = moving[:, 1:].copy()
    own = np.array([masses[each] for each in range(1, int(types.max()) + 1)])
    charges = None if charge is None else rows[:, charge].copy()
    return AtomTable(cell, positions, types, own[types - 1], velocities, charges)


def _header(text: str) -> tuple[int, Floats]:
    """Number of atoms and the cell (3, 3)."""
    count, cell = 0, np.diag([1.0, 1.0, 1.0])
    for line in text.splitlines():
        match line.partition("#")[0].split():
            case [number, "atoms"]:
                count = int(number)
            case [low, high, "xlo" | "ylo" | "zlo" as first, "xhi" | "yhi" | "zhi" as last]:
                axis = _EDGES[first, last]
                cell[axis, axis] = float(high) - float(low)
            case [xy, xz, yz, "xy", "xz", "yz"]:
                cell[1, 0], cell[2, 0], cell[2, 1] = float(xy), float(xz), float(yz)
            case [*_, "avec" | "bvec" | "cvec" | "origin"]:
                raise _Other
    if count < 1:
        raise _Other
    return count, cell


def _numbers(body: str, count: int) -> Floats:
    """A section's table of ``count`` rows of equal length."""
    if "#" in body:
        body = re.sub("#.*", "", body)
    begin = len(body) - len(body.lstrip())
    columns = len(body[begin : body.index("\n", begin)].split())
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # NumPy warns of text that is no number
        try:
            found: Any = np.fromstring(body, sep=" ")
        except DeprecationWarning:
            raise _Other from None
    if found.size != count * columns or body.count("\n") < count:
        raise _Other
    return found.reshape(count, columns)


def _by_id(rows: Floats) -> Floats:
    """The rows in the order of the ids in their first column."""
    ids = rows[:, 0]
    return rows if (ids[1:] > ids[:-1]).all() else rows[np.argsort(ids)]


def _whole(numbers: Floats) -> NDArray[np.int64]:
    """The same numbers as integers."""
    found = numbers.astype(np.int64)
    if not np.array_equal(found, numbers):
        raise _Other
    return found
