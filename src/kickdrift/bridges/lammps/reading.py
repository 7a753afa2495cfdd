"""What LAMMPS holds after it has read an input, and the commands that it was given."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.bridges.lammps.script import MARK, Script
from kickdrift.errors import InputError
from kickdrift.text import clean

SECONDS = 600  # most of an input's processor time
CLOSE = 2e-5  # relative, between a number and its six digits in LAMMPS' data files
_SECTION = re.compile(r"^(\w+) Coeffs[ \t]*(?:#[ \t]*(.*?))?[ \t]*$|^[A-Z][A-Za-z ]*(?:#.*)?$", re.MULTILINE)


class Row(NamedTuple):
    """Coefficients of a type, or of two types of a pair."""

    types: tuple[int, ...]
    style: str
    values: tuple[str, ...]

    def numbers(self) -> list[float]:
        """The values as numbers."""
        return [float(each) for each in self.values]


class Read(NamedTuple):
    """An input as LAMMPS understands it.

    Attributes
    ----------
    told : numbers and texts by name, see `child`
    arrays : by name, rows in the order of the particles' ids
    commands : words of the commands in force, with their variables replaced
    folder : from which the commands name files
    """

    told: dict[str, Any]
    arrays: dict[str, NDArray[Any]]
    commands: list[list[str]]
    folder: Path

    def last(self, word: str) -> list[str]:
        """Arguments of the last command of this word; none without one."""
        return next((words[1:] for words in reversed(self.commands) if words[0] == word), [])

    def all(self, word: str) -> list[list[str]]:
        """Arguments of each command of this word."""
        return [words[1:] for words in self.commands if words[0] == word]

    def rows(self, kind: str) -> list[Row]:
        """Coefficients of a kind such as "Bond" or "PairIJ", from LAMMPS' own list, with the digits of the input. Of
        styles that LAMMPS does not list, those of the input."""
        word = kind.removesuffix("IJ").lower()
        given, size = self._given(word), 2 if kind == "PairIJ" else 1
        if told := _section(self.told["coefficients"], kind):
            return [_exact(row, given, size == 2) for row in told]
        style = " ".join(self.last(f"{word}_style")[:1])
        count = int(
            (
                re.search(
                    rf"^(\d+) {'atom' if word == 'pair' else word} types", self.told["coefficients"], re.MULTILINE
                )
                or "00"
            )[1]
        )
        found = {}
        for words in given:
            for types in product(*(span(each, count) for each in words[:size])):
                found[types] = _row([*map(str, types), *words[size:]], size, style)
        return list(found.values())

    def states(self, i: int, j: int) -> bool:
        """Whether the input gives coefficients of this pair of types, which LAMMPS then does not mix."""
        last = max(i, j)
        for words in self.all("pair_coeff"):
            if not all(set(each) <= set("0123456789*") for each in words[:2]):  # labels of types
                return True
            one, other = (span(each, last) for each in words[:2])
            if (i in one and j in other) or (j in one and i in other):
                return True
        return i == j and any(words[0] == str(i) for text in self.files for words in _lines(text, "pair"))

    def _given(self, word: str) -> list[list[str]]:
        """Words of all coefficients of a kind in commands and in the data files that they read."""
        found = [words for text in self.files for words in _lines(text, word)]
        return found + [[each.strip("\"'") for each in words] for words in self.all(f"{word}_coeff")]

    @property
    def files(self) -> list[str]:
        """Texts of the data files that the input reads, up to their atoms."""
        return list(self.told.get("files", ()))


def read(script: Script, path: Path) -> Read:
    """Let LAMMPS read the commands in the folder of ``path``. Raises InputError with LAMMPS' own words."""
    with tempfile.TemporaryDirectory(prefix="kickdrift-lammps-") as folder:
        commands, answer, said = (Path(folder) / name for name in ("commands", "answer.npz", "said"))
        commands.write_text("\n".join([*script.lines, ""]), encoding="utf-8")
        with said.open("wb") as output:
            status = subprocess.run(
                [sys.executable, "-m", "kickdrift.bridges.lammps.child", commands, answer, str(SECONDS)],
                cwd=path.parent, stdin=subprocess.DEVNULL, stdout=output, stderr=output,
                env=_environment(script.trusted),
                check=False,
            ).returncode  # fmt: skip
        text = said.read_text(encoding="utf-8", errors="replace")
        if not answer.is_file():
            raise InputError(f"LAMMPS ended: {_last_words(text) or f'its process ended with status {status}'}")
        with np.load(answer, allow_pickle=False) as found:
            arrays = {key: found[key] for key in found.files}
    told = json.loads(str(arrays.pop("told")))
    if "error" in told:
        raise InputError(f"LAMMPS: {clean(told['error'], 300)}")
    commands_said = _in_force(line.removeprefix(MARK).split() for line in text.splitlines() if line.startswith(MARK))
    made = Read(told, arrays, commands_said, path.parent)
    told["files"] = [_text(path.parent / words[0].strip("\"'")) for words in made.all("read_data")]
    return made


def _environment(trusted: bool) -> dict[str, str]:
    """The environment of LAMMPS' process, which finds this kickdrift, and no module in the input's folder. LAMMPS hands
    the names of packed files to a shell, so without trust it finds no program that unpacks."""
    folders = [str(Path(__file__).parents[3]), os.environ.get("PYTHONPATH", "")]
    return dict(os.environ) | {
        "PYTHONPATH": os.pathsep.join(each for each in folders if each), "PYTHONSAFEPATH": "1", "OMP_NUM_THREADS": "1",
    } | ({} if trusted else {"PATH": ""})  # fmt: skip


def _last_words(text: str) -> str:
    """The last error in the output, as one line."""
    told = [line for line in text.splitlines() if "ERROR" in line or "rror:" in line]
    return clean(told[-1].removeprefix("ERROR: ").partition(" (src/")[0], 300) if told else ""


def _in_force(commands: Iterable[list[str]]) -> list[list[str]]:
    """The commands since the last ``clear``."""
    found: list[list[str]] = []
    for words in commands:
        found = [] if words[0] == "clear" else [*found, words]
    return found


def _text(path: Path) -> str:
    """Text of a data file without its atoms and lists; "" for a packed one."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, ValueError):
        return ""
    return "".join(f"{title}\n\n{body}\n" for title, body in _sections(text))


def _sections(text: str) -> Iterator[tuple[str, str]]:
    """Yield title and body of each section of coefficients."""
    found = list(_SECTION.finditer(text))
    for k, title in enumerate(found):
        end = found[k + 1].start() if k + 1 < len(found) else len(text)
        if title[1]:
            yield title[0], text[title.end() : end]


def _lines(text: str, word: str) -> Iterator[list[str]]:
    for title, body in _sections(text):
        if title.split()[0].removesuffix("IJ").lower() == word:
            for line in body.splitlines():
                if words := line.partition("#")[0].split():
                    yield words


def _section(text: str, kind: str) -> list[Row]:
    """Rows of a section of LAMMPS' own data file."""
    size = 2 if kind == "PairIJ" else 1
    for title, body in _sections(text):
        if title.split()[0] == kind:
            style = title.partition("#")[2].strip()
            rows = [line.partition("#")[0].split() for line in body.splitlines()]
            return [_row(words, size, style) for words in rows if words]
    return []


def _row(words: Sequence[str], size: int, style: str) -> Row:
    own = style.startswith("hybrid")
    values = words[size + own :]
    return Row(tuple(map(int, words[:size])), words[size] if own else style, tuple(values))


def _exact(row: Row, given: Sequence[Sequence[str]], paired: bool = False) -> Row:
    """The row with the digits of the input: its numbers as they end a line of coefficients, if they are the same to
    LAMMPS' six digits. A line of a pair may leave out the cutoff, the last number, or the last two of four."""
    count = len(row.values)
    for part in range(count, count - (3 if count == 4 else 2), -1) if paired else (count,):
        for words in given if part else ():
            values = words[-part:]
            if len(values) == part and all(map(_same, values, row.values[:part])):
                return row._replace(values=(*values, *row.values[part:]))
    return row


def span(text: str, count: int) -> range:
    """Types that a word such as 2, *3 or 2*4 names."""
    low, star, high = text.partition("*")
    begin = int(low) if low else 1
    return range(begin, (int(high) if high else count) + 1) if star else range(begin, begin + 1)


def _same(one: str, other: str) -> bool:
    if one == other:
        return True
    try:
        first, second = float(one), float(other)
    except ValueError:
        return False
    return abs(first - second) <= CLOSE * abs(second)
