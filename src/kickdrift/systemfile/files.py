"""System files on disk: find, list and parse them; and Python values that stand in for their tables."""

import os
import re
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from io import BytesIO, TextIOWrapper
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from kickdrift.disk.files import SYSTEM_FILE_BYTES, content, unfit
from kickdrift.disk.foreign import foreign
from kickdrift.errors import InputError
from kickdrift.model.checks.arguments import other_name
from kickdrift.model.checks.values import path_text
from kickdrift.text import shown, suggestion

_PART = r"""(?:[A-Za-z0-9_-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')"""  # of a key; many values look like one
_LONG = r"""\"{3}(?:[^"\\]|\\.|"(?!""))*+\"{3,5}|'{3}(?:[^']|'(?!''))*+'{3,5}"""
_TOKEN = re.compile(
    rf"""{_LONG}|(?P<open>"{{3}}|'{{3}})|(?P<key>{_PART}(?:[ \t]*+\.[ \t]*+{_PART})*+)"""
    r"""|["'].*+|\#[^\n]*+|[^\w"'#-]++|.""",
    re.DOTALL | re.ASCII,
)
PARAMETERS = (".prmtop", ".parm7", ".top", ".psf")  # files of force fields, which OpenMM reads
WHOLE = (".prmtop", ".parm7")  # those that hold all parameters
STRUCTURES = (".xyz", ".extxyz", ".pdb", ".cif", ".gro", ".vasp", ".traj", ".lammps-data")  # files that ASE reads
SCHEMA = "#:schema"  # begins a line that names the file's schema, for editors


class Description(NamedTuple):
    """Entry in a list of systems."""

    name: str
    path: Path
    title: str  # the key ``title``, else the first comment, if the file begins with one
    units: str


def parsed(path: Path) -> tuple[str, dict[str, Any]]:
    """Text of a system file, and its TOML tables, not yet checked. The error for a file of another program says what
    the file is."""
    try:
        stored = content(path, SYSTEM_FILE_BYTES, "a system file")
        with prefixed(f"{path}: "):
            text = decoded(stored)
            return text, toml_table(text)
    except InputError:
        if what := foreign(path):
            raise InputError(f"{path}: {what}") from None
        raise


def shipped() -> dict[str, Path]:
    """System files that come with kickdrift, by name."""
    package = Path(__file__).parents[1]
    inside = package / "systems"  # in a wheel
    folder = inside if inside.is_dir() else package.parents[1] / "systems"  # in a checkout
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def describe(path: str | os.PathLike[str]) -> Description:
    """Name, title and units of a system file; the rest of the file is not checked."""
    path = Path(path)
    text, data = parsed(path)
    first = next((line for line in text.split("\n") if not line.startswith(SCHEMA)), "")
    comment = first.lstrip("# ").strip() if first.startswith("#") else ""
    return Description(path.stem, path, str(data.get("title", comment)), str(data.get("units", "")))


def is_shipped(name_or_path: str | os.PathLike[str]) -> bool:
    """Tell whether this is the bare name of a shipped system. A local file of the same name is given as ./NAME."""
    return isinstance(name_or_path, str) and Path(name_or_path).name == name_or_path and name_or_path in shipped()


def find(name_or_path: str | os.PathLike[str]) -> Path:
    """Path of the file with this name or path. Raises an InputError that suggests the nearest name for an unknown
    one."""
    given = path_text("system", name_or_path)
    bare = isinstance(name_or_path, str) and Path(given).name == given and not given.endswith(".toml")
    known = shipped()
    if is_shipped(name_or_path):
        return known[given]
    path = Path(given)
    if (what := unfit(path, "a system file")) is None and path.suffix.lower() != ".h5md":
        return path
    if path.suffix.lower() == ".h5md":
        raise InputError(f"{shown(given)} is the file of a run: kd.open(…)[-1].system is the System of its last frame")
    if bare and not os.path.lexists(given):
        hint = other_name("system", given) or suggestion(given, known)
        raise InputError(
            f"{shown(given)} is neither a file nor a shipped system{hint} (kickdrift list systems shows all)"
        )
    raise InputError(f"{' '.join(given.split())}: {what}{suggestion(path.stem, known)}")


@contextmanager
def prefixed(prefix: str) -> Iterator[None]:
    """Put a prefix, such as the file or key, before the message of an InputError."""
    try:
        yield
    except InputError as error:
        raise InputError(prefix + str(error)) from None


def decoded(stored: bytes) -> str:
    """Text of a file in UTF-8."""
    try:
        return TextIOWrapper(BytesIO(stored), encoding="utf-8-sig").read()
    except UnicodeDecodeError:
        raise InputError("not a text file in UTF-8") from None


def toml_table(text: str) -> dict[str, Any]:
    """Tables of a text in TOML."""
    _refuse_long_keys(text)
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"not valid TOML: {' '.join(str(error).split())}") from None
    except RecursionError:
        raise InputError("not valid TOML: nested too deeply") from None
    except ValueError as error:  # an integer with thousands of digits
        raise InputError(f"not valid TOML: {' '.join(str(error).split(';')[0].split())}") from None


def _refuse_long_keys(text: str) -> None:
    """Raise InputError for a key of many parts, a.b.c…, on which the parser spends time and memory of its square."""
    if all(line.count(".") <= DEEPEST for line in text.split("\n")):
        return
    for token in _TOKEN.finditer(text):
        if token["open"]:
            return  # a string that does not end, which the parser refuses
        if token["key"] and token[0].count(".") > DEEPEST and len(re.findall(_PART, token[0])) > DEEPEST:
            line = text.count("\n", 0, token.start()) + 1
            raise InputError(f"not valid TOML for kickdrift: line {line}: a key has more than {DEEPEST} parts")


DEEPEST = 32  # tables and lists within one another, and parts of a key


def plain(value: Any, depth: int = 0) -> Any:
    """Convert mappings to dicts, tuples and arrays to lists, NumPy's numbers to Python's; keep everything else. Raises
    InputError for a value that is nested too deeply, as one that holds itself is."""
    if depth > DEEPEST:
        raise InputError(f"nested more than {DEEPEST} deep")
    if isinstance(value, Mapping):
        return {key: plain(item, depth + 1) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist(), depth)
    if isinstance(value, (list, tuple)):
        return [plain(item, depth + 1) for item in value]
    return value.item() if isinstance(value, np.generic) else value
