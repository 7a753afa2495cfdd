"""Structures of GROMACS (.gro): whether a file is whole. Readers take what there is, or stop with poor messages."""

from __future__ import annotations

import re
from pathlib import Path

from kickdrift.disk.files import opened
from kickdrift.errors import InputError
from kickdrift.text import shown

LONGEST = 30  # letters of the line with the number of atoms
ATOM = re.compile(rb".{20}(?: *-?\d+\.\d+ ?){3}")  # residue, name, number, and three coordinates
BOX = re.compile(rb"(?: *-?\d+(?:\.\d+)?){3}(?:(?: *-?\d+(?:\.\d+)?){6})? *")


def refuse_cut(path: Path) -> None:
    """Raise InputError for a .gro file that ends before its last atom or its box."""
    with opened(path) as file:
        title, count = file.readline(), file.readline()
        if not title.endswith(b"\n") or not count.strip():
            raise InputError("is no whole .gro file: it ends before the number of its atoms")
        if not count.strip().isdigit() or len(count) > LONGEST:
            text = count.decode("utf-8", "replace").strip()
            raise InputError(f"line 2: expected the number of atoms of a .gro file, got {shown(text)}")
        total = int(count)
        for number in range(total):
            line = file.readline()
            if not ATOM.match(line) or not line.endswith(b"\n"):
                raise InputError(f"line {number + 3}: is no whole atom, and line 2 says {total} atoms")
        last = file.readline().rstrip(b"\r\n")
        if not BOX.fullmatch(last):
            what = "the lengths of its box, three or nine numbers"
            raise InputError(f"is no whole .gro file: after {total} atoms it lacks {what}")
