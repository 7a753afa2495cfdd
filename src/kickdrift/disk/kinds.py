"""Kinds of file that kickdrift writes, with tests that recognise them."""

import os
import re
from collections.abc import Callable
from typing import NamedTuple

from kickdrift.disk.files import opened
from kickdrift.errors import InputError

HEAD = TAIL = 256 * 1024  # bytes at each end of a file that are examined
FIGURES = (".png", ".pdf", ".svg")
FILMS = (".mp4", ".webm", ".gif")
REBOUND = b"REBOUND Binary File. Version:"  # at the beginning of a Simulationarchive
_HDF5 = b"\x89HDF\r\n\x1a\n"
SERIES_MARK = "kickdrift_problem"  # in the table of a Problem's run
_PDB = re.compile(rb"(HEADER|TITLE |REMARK|CRYST1|MODEL |ATOM  |HETATM)")
_SYSTEM = re.compile(rb'(title = "[^\n]*"\n)?units = "[a-z]+"\n(dimensions = 2\n)?\n\[particles\]\n')
LAMMPS_HEADING = "LAMMPS data file by kickdrift"
GROMACS_TOPOLOGY, GROMACS_COORDINATES = "; GROMACS topology by kickdrift", "GROMACS coordinates by kickdrift"
_LAMMPS = (LAMMPS_HEADING.encode(), b"# LAMMPS input by kickdrift", b"written by kickdrift", b"# written by kickdrift")
_EXPORTS: dict[str, Callable[[bytes], bool]] = {
    ".dcd": lambda head: head[4:8] == b"CORD",
    ".xtc": lambda head: int.from_bytes(head[:4], "big") in (1995, 2023),
    ".trr": lambda head: int.from_bytes(head[:4], "big") == 1993,
    ".xyz": lambda head: head.split(b"\n", 1)[0].strip().isdigit(),
    ".extxyz": lambda head: head.split(b"\n", 1)[0].strip().isdigit(),
    ".pdb": lambda head: bool(_PDB.match(head)),
    ".data": lambda head: head.startswith(LAMMPS_HEADING.encode()),
    ".traj": lambda head: head.startswith(b"- of Ulm"),
    ".bin": lambda head: head.startswith(REBOUND),
}


def wrong_ending(name: str | os.PathLike[str], suffixes: tuple[str, ...]) -> str:
    """Text "must end in .h5md, not '.foo'"; where an export writes the ending, the text says so."""
    suffix = os.path.splitext(name)[1]
    text = f"must end in {', '.join(suffixes)}" + (f", not {suffix!r}" if suffix else "")
    from_run = suffix.lower() in _EXPORTS and ".h5md" in suffixes
    return f"{text}; kickdrift export makes such a file from a run's file" if from_run else text


class Kind(NamedTuple):
    """Kind of output file.

    ``noun`` names the kind in messages. ``suffixes`` are the allowed endings of its name (empty: any). ``ours(head,
    tail)`` tells whether kickdrift could have written a file with this beginning and end. If ``streams`` is set, the
    output may go to a pipe or a device.
    """

    noun: str
    suffixes: tuple[str, ...]
    ours: Callable[[bytes, bytes], bool]
    streams: bool = True


def _system(head: bytes, tail: bytes) -> bool:
    """Recognise a System's text (``System.to_toml``), which begins with these keys in this order."""
    return bool(_SYSTEM.match(head))


def _run(head: bytes, tail: bytes) -> bool:
    return head.startswith(_HDF5) and b"kickdrift\0" in head and b"h5md\0" in head and b"particles\0" in head


def _json(head: bytes, tail: bytes) -> bool:
    return head.lstrip().startswith(b"{") and tail.rstrip().endswith(b"}")


def _figure(head: bytes, tail: bytes) -> bool:
    """Recognise a figure: matplotlib names itself in every figure."""
    known = head.startswith((b"\x89PNG\r\n\x1a\n", b"%PDF-")) or b"<svg" in head
    return known and (b"atplotlib" in head or b"atplotlib" in tail)


def _page(head: bytes, tail: bytes) -> bool:
    return b'<meta name="generator" content="kickdrift' in head


def _film(head: bytes, tail: bytes) -> bool:
    """Recognise a film, whose comment names kickdrift."""
    known = head[4:8] == b"ftyp" or head.startswith((b"GIF8", b"\x1aE\xdf\xa3"))
    return known and (b"kickdrift" in head or b"kickdrift" in tail)


def _problem(head: bytes, tail: bytes) -> bool:
    return head.startswith(_HDF5) and all(name in head for name in (b"kickdrift\0", b"problem\0", b"checkpoints\0"))


def _series(head: bytes, tail: bytes) -> bool:
    if head.startswith(b"PAR1"):
        return SERIES_MARK.encode() in tail
    return head.startswith(b"time,y0")


def _table(head: bytes, tail: bytes) -> bool:
    if head.startswith(b"PAR1"):
        return b"kickdrift" in tail and SERIES_MARK.encode() not in tail
    return not _problem(head, tail) and head.startswith(_HDF5) and b"kickdrift" in head and b"columns" in head


RUN = Kind("a run's file", (".h5md",), _run, streams=False)
SYSTEM = Kind("a system file", (".toml",), _system)
PROBLEM = Kind("the file of a Problem's run", (".h5",), _problem, streams=False)
SERIES = Kind("the table of a Problem's run", (".csv", ".parquet"), _series, streams=False)
JSON = Kind("a JSON object", (), _json)
NUMBERS = Kind("the numbers of a figure", (".csv",), lambda head, tail: head.startswith(b"panel,line,x,y"))
FIGURE = Kind("a figure", FIGURES, _figure)
PAGE = Kind("a view", (".html",), _page)
FILM = Kind("a film", FILMS, _film, streams=False)
TABLE = Kind("the table of an ensemble", (".parquet", ".h5"), _table, streams=False)
LAMMPS_INPUT = Kind("a file of LAMMPS", (), lambda head, tail: head.startswith(_LAMMPS), streams=False)
GROMACS_FILE = Kind(
    "a file of GROMACS", (".top", ".gro"),
    lambda head, tail: head.startswith((GROMACS_TOPOLOGY.encode(), GROMACS_COORDINATES.encode())), streams=False,
)  # fmt: skip
JOURNAL = Kind("the journal of an ensemble", (), lambda head, tail: head.startswith(b"{"), streams=False)


def of_run(path: str | os.PathLike[str]) -> Kind:
    """Kind of a run's output with that suffix: particles or a Problem, a file or a table."""
    suffix = os.path.splitext(os.fspath(path))[1].lower()
    written = [kind for kind in (RUN, PROBLEM, SERIES) if suffix in kind.suffixes]
    every = (*RUN.suffixes, *PROBLEM.suffixes, *SERIES.suffixes)
    return written[0] if written else RUN._replace(suffixes=every)


def export(suffix: str, suffixes: tuple[str, ...]) -> Kind:
    """Kind of an export with that suffix."""
    written = _EXPORTS.get(suffix.lower(), lambda head: False)
    return Kind("an export", suffixes, lambda head, tail: written(head))


def is_archive(path: str | os.PathLike[str]) -> bool:
    """Tell whether a regular file is a Simulationarchive of rebound. Raises InputError for another file that ends in
    .bin."""
    with opened(path) as file:
        found = file.read(len(REBOUND)) == REBOUND
    if not found and os.path.splitext(path)[1].lower() == ".bin":
        raise InputError(f"{os.fspath(path)}: is no Simulationarchive of rebound")
    return found


def may_be_snapshot(path: str | os.PathLike[str]) -> bool:
    """Tell whether a file is in HDF5 or begins as NEMO's do, in either order of bytes."""
    with opened(path) as file:
        head = file.read(len(_HDF5))
    return head == _HDF5 or head[:2] in (b"\x92\x09", b"\x09\x92", b"\x92\x0b", b"\x0b\x92")


def is_ours(path: str | os.PathLike[str], kind: Kind) -> bool:
    """Tell whether kickdrift could have written this regular file. An empty file has nothing to lose."""
    try:
        with opened(path) as file:
            head = file.read(HEAD)
            size = file.seek(0, os.SEEK_END)
            file.seek(max(0, size - TAIL))
            return not size or kind.ours(head, file.read(TAIL))
    except (OSError, InputError):
        return False
