"""Tables of energies from files: LAMMPS' tables, GROMACS' ``.xvg``, and plain columns.

A table has places x that increase, the energy at each, and in most files the force, minus the slope of the energy.
Numbers may have Fortran's exponents, lines may end as on Windows, and "#", "@" and "&" begin comments.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from kickdrift.disk.files import content
from kickdrift.errors import InputError
from kickdrift.forces.tables.curve import FEWEST, wrong_slope
from kickdrift.model.state import Floats
from kickdrift.text import shown, suggestion

MOST_BYTES = 2**28  # of a file
LEAST = 1e-60  # of the farthest place, whose powers float64 holds
TITLES = re.compile(r"[A-Za-z_]")  # a line that begins so names a section of LAMMPS' file
FLAGS = {"N": 1, "R": 2, "RSQ": 2, "BITMAP": 2, "FP": 2, "FPRIME": 2, "EQ": 1, "NOF": 0, "DEGREES": 0, "RADIANS": 0,
         "CHECKU": 1, "CHECKF": 1}  # words of LAMMPS' sections, and how many numbers follow  # fmt: skip
SCALED = ("c6", "c12")
DISPERSION, REPULSION = (3, 4), (5, 6)  # columns of GROMACS' tables of pairs; 1 and 2 are those of charges


class Columns(NamedTuple):
    """Numbers of a table."""

    x: Floats
    energy: Floats
    force: Floats | None
    units: str = ""  # LAMMPS' name of the units that the file says, "xvg" for GROMACS', else ""
    radians: bool = False  # whether angles are in radians


def columns_of(name: str, given: Mapping[str, Any], content_of: Mapping[str, bytes]) -> Columns:
    """The numbers of ``table``, or of the section ``keyword`` of ``file``, whose content is given by its name. ``name``
    begins the message of each InputError."""
    if given.get("file") is None:
        rows = given.get("table")
        if rows is None:
            raise InputError(f"{name}: table or file is needed")
        return _of_rows(f"{name}: table", rows)
    file = str(given["file"])
    lines = content_of[file].decode("utf-8", "replace").splitlines()
    where, keyword = f"{name}: file: {file}", given.get("keyword")
    if file.lower().endswith(".xvg"):
        if keyword is not None:
            raise InputError(f"{where}: keyword goes with LAMMPS' tables")
        return _xvg(where, lines, given)
    if any(given.get(key, 1.0) != 1.0 for key in SCALED):
        raise InputError(f"{where}: c6 and c12 go with GROMACS' tables of seven columns (.xvg)")
    titles = [k for k, line in enumerate(lines) if TITLES.match(line.strip())]
    if titles or keyword is not None:
        return _section(where, lines, keyword)
    return _of_rows(where, [numbers for line in lines if (numbers := _numbers(where, line))])


def read(name: str, file: Any) -> bytes:
    """Content of a table's file."""
    if not isinstance(file, str) or "\0" in file:
        raise InputError(f"{name}: file: expected the name of a file, got {shown(file)}")
    try:
        return content(file, MOST_BYTES, "a table")
    except InputError as error:
        raise InputError(f"{name}: file: {error}") from None


def checked(where: str, x: Floats, energy: Floats, force: Floats | None, of: str, unit: float = 1.0) -> None:
    """Refuse a table whose places do not increase, or whose force is not minus the slope of its energy. ``of`` names
    the places, such as "r", and ``unit`` is their unit."""
    for key, values in ((of, x), ("energy", energy), ("force", force)):
        if values is not None and not np.isfinite(values).all():
            row = int(np.flatnonzero(~np.isfinite(values))[0])
            raise InputError(f"{where}: row {row + 1}: the {key} is {values[row]:g}; expected a finite number")
    if x.size and not LEAST < (farthest := unit * float(np.abs(x).max())) < 1.0 / LEAST:
        raise InputError(f"{where}: {of} goes to {farthest:g}; expected between {LEAST:g} and {1.0 / LEAST:g}")
    if len(x) < FEWEST:
        raise InputError(f"{where}: has {len(x)} rows; expected {FEWEST} or more")
    if (falls := np.flatnonzero(np.diff(x) <= 0)).size:
        k = int(falls[0])
        raise InputError(
            f"{where}: {of} must increase from row to row; {x[k + 1]:.9g} in row {k + 2} follows {x[k]:.9g}"
        )
    if force is not None and (wrong := wrong_slope(x, energy, force)) is not None:
        k, slope, off = wrong
        raise InputError(
            f"{where}: the force is not minus the slope of the energy: at {of} = {x[k]:.6g} it is {force[k]:.6g}, and "
            f"the energies give {slope:.6g}; they differ by {100 * off:.3g} % of the largest force there"
        )


def _of_rows(where: str, rows: Any) -> Columns:
    if isinstance(rows, str | bytes | Mapping) or not isinstance(rows, Sequence | np.ndarray):
        raise InputError(f"{where}: expected rows of a place, an energy and perhaps a force, got {shown(rows)}")
    lengths = {len(row) if hasattr(row, "__len__") else 0 for row in rows}
    if len(lengths) > 1 and 0 not in lengths:
        k = next(k for k, row in enumerate(rows) if len(row) != len(rows[0]))
        raise InputError(f"{where}: row {k + 1} has {len(rows[k])} numbers, and row 1 has {len(rows[0])}")
    try:
        found = np.array(rows, dtype=float)
    except (TypeError, ValueError):
        lengths = set()
    if not lengths <= {2, 3} or not lengths or found.ndim != 2:
        raise InputError(f"{where}: expected rows of two or three numbers: a place, an energy and perhaps a force")
    return Columns(found[:, 0], found[:, 1], found[:, 2] if lengths == {3} else None)


def _numbers(where: str, line: str) -> list[float]:
    """Numbers of a line, without comments."""
    words = re.split(r"[#@&]", line, maxsplit=1)[0].replace(",", " ").split()
    return [_number(where, word) for word in words]


def _number(where: str, word: str) -> float:
    try:
        return float(re.sub("[dD]", "e", word))  # also as Fortran writes it
    except ValueError:
        raise InputError(f"{where}: expected a number, got {shown(word)}") from None


def _xvg(where: str, lines: Sequence[str], given: Mapping[str, Any]) -> Columns:
    """GROMACS' table. Tables of pairs have seven columns: r, and energy and force of charges, dispersion and repulsion;
    tables of bonds, angles and dihedrals have three. GROMACS fills the rows before a table's start with zeros."""
    rows = [numbers for line in lines if (numbers := _numbers(where, line))]
    if not rows or len(rows[0]) != 7:
        if any(given.get(key, 1.0) != 1.0 for key in SCALED):
            raise InputError(f"{where}: c6 and c12 go with tables of seven columns")
        found = _of_rows(where, rows)
    else:
        if odd := [k for k, row in enumerate(rows) if len(row) != 7]:
            raise InputError(f"{where}: row {odd[0] + 1} has {len(rows[odd[0]])} numbers, and row 1 has 7")
        table = np.array(rows).T
        scale = np.array([[given.get("c6", 1.0)], [given.get("c12", 1.0)]], dtype=float)
        energy, force = ((scale * table[[DISPERSION[k], REPULSION[k]]]).sum(axis=0) for k in range(2))
        begin = int(np.argmax((energy != 0) & (table[0] > 0)))
        found = Columns(table[0, begin:], energy[begin:], force[begin:])
    return found._replace(units="xvg")


def _section(where: str, lines: Sequence[str], keyword: str | None) -> Columns:
    """A section of LAMMPS' file: its name, a line of flags, and numbered rows."""
    units = ""
    if lines and (said := re.search(r"UNITS:\s*(\S+)", lines[0])):
        units = said[1]
    kept = [line for line in (each.split("#")[0].strip() for each in lines) if line]
    begins = [k for k, line in enumerate(kept) if TITLES.match(line)]
    heads = [k for k in begins if k + 1 < len(kept) and kept[k + 1].split()[0] == "N"]
    names = [kept[k].split()[0] for k in heads]
    if not names:
        raise InputError(f"{where}: expected sections of LAMMPS' tables: a name, then a line that begins with N")
    if keyword is None and len(names) > 1:
        raise InputError(f"{where}: keyword is needed, one of {', '.join(names)}")
    if keyword is not None and keyword not in names:
        raise InputError(f"{where}: has no section {keyword!r}{suggestion(keyword, names)}; it has {', '.join(names)}")
    head = heads[names.index(keyword) if keyword is not None else 0]
    where = f"{where}: {kept[head].split()[0]}"
    flags = _flags(where, kept[head + 1].split())
    count = int(flags["N"][0])
    force_columns = 3 if "NOF" in flags else 4
    rows: list[list[float]] = []
    for line in kept[head + 2 : head + 2 + count]:
        if TITLES.match(line):
            break
        numbers = _numbers(where, line)
        if len(numbers) < force_columns:
            raise InputError(f"{where}: row {len(rows) + 1} has {len(numbers)} numbers; expected {force_columns}")
        rows.append(numbers[:force_columns])
    if len(rows) < count or not rows:
        raise InputError(f"{where}: its header says {count} rows, and the file ends after {len(rows)}")
    table = np.array(rows).T
    x = table[1]
    if "R" in flags or "RSQ" in flags:
        power = 1 if "R" in flags else 2
        first, last = (end * end if power == 2 else end for end in flags["R" if power == 1 else "RSQ"])
        with np.errstate(all="ignore"):  # `checked` refuses what is not finite
            x = np.linspace(first, last, count) ** (1.0 / power)
    return Columns(x, table[2], None if force_columns == 3 else table[3], units, "RADIANS" in flags)


def _flags(where: str, words: Sequence[str]) -> dict[str, list[float]]:
    found: dict[str, list[float]] = {}
    at = 0
    while at < len(words):
        word = words[at]
        if word not in FLAGS:
            raise InputError(f"{where}: unknown word {shown(word)}; expected {', '.join(FLAGS)}")
        values = words[at + 1 : at + 1 + FLAGS[word]]
        if len(values) < FLAGS[word]:
            raise InputError(f"{where}: {word} takes {FLAGS[word]} numbers, and the line ends after {len(values)}")
        found[word] = [] if word.startswith("CHECK") else [_number(where, value) for value in values]
        at += 1 + FLAGS[word]
    if "BITMAP" in found:
        raise InputError(f"{where}: BITMAP: tables by the bits of r are not read; write the table with R or RSQ")
    if not (found["N"][0] >= 1 and found["N"][0].is_integer()):
        raise InputError(f"{where}: N must be a number of rows, got {found['N'][0]:g}")
    return found
