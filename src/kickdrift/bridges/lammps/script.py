"""Inputs of LAMMPS as text: the commands before the first run, and which of them an input may have.

An input is a program: it can run commands of the shell and Python, and write files. So an input may hold only commands
that build a system, unless the user trusts it. Commands that write are left out of every input, and fixes are noted
and not made. No loop runs, because a loop could hold any command.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import NamedTuple

from kickdrift.disk.files import content
from kickdrift.errors import InputError
from kickdrift.forces.external.lammps import REFUSED
from kickdrift.text import shown

BYTES = 2**24  # most that an input may have
DEEPEST = 8  # inputs within one another
MOST_COMMANDS = 100_000  # with those of included inputs
NEAR = 0.75  # likeness of a misspelt command to the right one, at least
MARK = "@kickdrift "  # begins the line in which LAMMPS says a command, with its variables replaced
END = frozenset(("run", "minimize", "rerun", "neb", "neb/spin", "prd", "tad", "hyper", "temper", "temper/grem",
                 "temper/npt", "dynamical_matrix", "third_order"))  # fmt: skip
SKIPPED = frozenset((
    "print", "log", "echo", "info", "timer", "dump", "dump_modify", "undump", "restart", "thermo", "thermo_style",
    "thermo_modify", "write_data", "write_dump", "write_restart", "write_coeff", "pair_write", "bond_write",
    "angle_write", "dihedral_write", "compute", "compute_modify", "uncompute", "package", "suffix", "processors",
    "balance", "min_style", "min_modify", "comm_style", "include",
))  # fmt: skip
NOTED = frozenset(("fix", "unfix", "fix_modify", "run_style"))  # told to kickdrift, not to LAMMPS
TOLD = frozenset((  # told to both
    "units", "atom_style", "read_data", "clear", "timestep", "dielectric", "special_bonds",
    "neigh_modify", "delete_bonds", *(f"{word}_{what}" for word in ("pair", "bond", "angle", "dihedral", "improper")
                                      for what in ("style", "coeff", "modify")), "kspace_style", "kspace_modify",
))  # fmt: skip
BUILDING = frozenset((
    "atom_modify", "boundary", "box", "change_box", "comm_modify", "create_atoms", "create_bonds", "create_box",
    "delete_atoms", "dimension", "displace_atoms", "group", "labelmap", "lattice", "mass", "molecule", "neighbor",
    "newton", "region", "replicate", "reset_atoms", "reset_timestep", "set", "variable", "velocity",
))  # fmt: skip
LOOPS = frozenset(("jump", "next", "label", "if"))
RUNS = {"shell": "runs commands of the shell", "python": "runs Python", "plugin": "loads libraries"}
RESTART = "read_restart hides styles that kickdrift needs; let LAMMPS write_data and read that file"
VARIABLES = frozenset((
    "index", "loop", "string", "format", "equal", "atom", "vector", "internal", "delete", "getenv", "file", "atomfile",
    "world",
))  # fmt: skip
_QUOTED = re.compile(r"\"[^\"]*\"|'[^']*'|#.*")
TRUSTED: set[Path] = set()  # inputs that the user has named to --load


class Script(NamedTuple):
    """Commands of an input for LAMMPS, a line each, and what they are for.

    Attributes
    ----------
    lines : commands that build the system, each followed by one that says it
    steps : of the first run, if that is a plain number
    trusted : whether LAMMPS may start other programs
    """

    lines: list[str]
    steps: int | None
    trusted: bool = False


def script_of(path: Path, trusted: bool = False) -> Script:
    """Return the commands of an input up to its first run. Raises InputError for what an input may not have."""
    trusted = trusted or path.resolve() in TRUSTED
    lines, steps = list[str](), None
    for count, (where, line) in enumerate(_commands(path, path.parent, 0)):
        if count == MOST_COMMANDS:
            raise InputError(f"{where}: kickdrift reads at most {MOST_COMMANDS:,} commands")
        word, *rest = line.split()
        if word in END:
            steps = (int(rest[0]) or None) if word == "run" and rest and rest[0].isdecimal() else None
            break
        if word in SKIPPED:
            continue
        if word == "read_restart":
            raise InputError(f"{where}: {RESTART}")
        if not trusted and (why := refusal(word, rest)):
            known = (*SKIPPED, *NOTED, *TOLD, *BUILDING, *LOOPS, *RUNS, *END)
            near = get_close_matches(word, known, 1, NEAR) if word not in known else []
            advice = "in Python trusted=True, on the command line --load FILE, if you trust the input"
            raise InputError(f"{where}: {word} {why}; {f'did you mean {near[0]!r}?' if near else advice}")
        lines += [] if word in NOTED else [line]
        lines += [_said(line)] if word in TOLD | NOTED else []
    return Script(lines, steps, trusted)


def refusal(word: str, rest: list[str]) -> str:
    """Why an input may not have a command, unless the user trusts the input; "" for one that it may have."""
    if word in RUNS:
        return f"{RUNS[word]}, which an input may not do"
    if word in LOOPS:
        return "makes a loop or a choice, which kickdrift does not follow"
    if word not in NOTED | TOLD | BUILDING:
        return "is not among the commands that build a system"
    if word == "variable" and len(rest) > 1 and rest[1] not in VARIABLES:
        return f"of style {shown(rest[1])} may run code or write files, which an input may not do"
    if word == "labelmap" and not (rest and rest[0].isalpha() and rest[0] != "write"):
        return "may write files, which an input may not do"
    if word == "pair_style":
        named = rest if rest and rest[0].startswith("hybrid") else rest[:1]
        if any(set("$\"'") & set(each) for each in named):
            return "names its style by a variable or in quotes"
        if found := next((each for each in named if each.split("/")[0] in REFUSED), None):
            return f"{found} {REFUSED[found.split('/')[0]]}, which an input may not do"
    return ""


def _commands(path: Path, folder: Path, depth: int) -> Iterator[tuple[str, str]]:
    """Yield each command with its place; those of included files, too, whose names count from ``folder``."""
    if depth > DEEPEST:
        raise InputError(f"{path}: inputs include one another more than {DEEPEST} deep")
    text = content(path, BYTES, "an input of LAMMPS").decode("utf-8", "replace")
    if '"""' in text:
        raise InputError(f"{path}: has triple quotes, which kickdrift does not read")
    joined, first = "", 0
    for number, raw in enumerate(text.splitlines(), 1):
        plain = _QUOTED.sub(lambda found: "" if found[0].startswith("#") else found[0], raw).rstrip()
        first = first if joined else number
        joined += plain.removesuffix("&")
        if plain.endswith("&"):
            joined += " "
            continue
        line, joined = joined.strip(), ""
        if not line:
            continue
        where = f"{path}: line {first}"
        if line.endswith("&"):
            raise InputError(f"{where}: ends with a second &")
        if line.split()[0] == "include":
            inner = line.partition("include")[2].strip().strip("\"'")
            if "$" in inner:
                raise InputError(f"{where}: include names its file by a variable, which kickdrift does not follow")
            yield where, line  # so that includes count
            yield from _commands(Path(os.path.join(folder, inner)), folder, depth + 1)
        else:
            yield where, line


def data_script(path: Path, units: str, commands: Sequence[str], style: str) -> Script:
    """Commands that read a data file in an atom style, with the user's commands for its forces."""
    before, after = [f"units {units}", f"atom_style {style}"], [f"read_data {shown_path(path)}"]
    for line in commands:
        word, *rest = line.split()
        if word not in BUILDING | TOLD or "\n" in line or '"""' in line:
            raise InputError(f"commands: expected styles and coefficients, got {shown(line)}")
        if why := refusal(word, rest):
            raise InputError(f"commands: {word} {why}")
        (before if word.endswith("_style") or word in ("boundary", "special_bonds", "newton") else after).append(line)
    return Script([each for line in [*before, *after] for each in _with_mark(line)], None)


def _with_mark(line: str) -> list[str]:
    return [line, _said(line)] if line.split()[0] in TOLD else [line]


def _said(line: str) -> str:
    """The command with which LAMMPS says a line, which may end with a quote."""
    return f'print """{MARK}{line} """'


def shown_path(path: Path) -> str:
    """A path as a word of an input."""
    return f"'{path.resolve()}'"
