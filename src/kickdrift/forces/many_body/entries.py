"""Parameters for triples of elements, from tables or from LAMMPS' files such as ``*.sw`` and ``*.tersoff``."""

import re
from collections.abc import Mapping
from typing import Any

from kickdrift.disk.files import content
from kickdrift.errors import InputError
from kickdrift.model.checks.values import number
from kickdrift.text import VALUE, clean, shown

POTENTIAL_BYTES = 2**28  # of a file; those of many elements have some 10 MB


def potential_file(name: str, file: str) -> bytes:
    """Content of a file of parameters. Raises an InputError that names the file, unless it is a regular one, and where
    its first line says that its units are others than LAMMPS' ``metal``."""
    try:
        found = content(file, POTENTIAL_BYTES, "a file of a potential")
    except InputError as error:
        raise InputError(f"{name}: file: {error}") from None
    units = re.search(rb"UNITS:\s*(\S+)", found.partition(b"\n")[0])
    if units and units[1] != b"metal":
        raise InputError(
            f"{name}: file: {file}: its first line says UNITS: {clean(units[1].decode('utf-8', 'replace'), VALUE)}; "
            "expected metal, with eV and angstroms"
        )
    return found


def number_of(word: str) -> float:
    """A number of a file, also with Fortran's exponent, as in 1.0D+00. Raises ValueError."""
    return float(word.replace("D", "E").replace("d", "e"))


def read_entries(name: str, file: Any, forms: Mapping[str, tuple[str, ...]]) -> dict[str, dict[str, float]]:
    """Read a file in LAMMPS' form: three elements and a number for each key, over as many lines as it takes; "#" begins
    a comment. ``forms`` are keys by suffix. Return {"Si-Si-Si": {key: number}}. Raises an InputError that names the
    file."""
    suffix = isinstance(file, str) and "\0" not in file and next(filter(file.endswith, forms), None)
    if not suffix:
        raise InputError(f"{name}: file: expected a name that ends in {', '.join(forms)}, got {shown(file)}")
    keys = forms[suffix]
    text = potential_file(name, file).decode("utf-8", "replace")
    words = [word for line in text.splitlines() for word in line.split("#")[0].split()]
    length, found = 3 + len(keys), {}
    if not words or len(words) % length:
        raise InputError(
            f"{name}: file: {file}: expected entries of three elements and {len(keys)} numbers, got {len(words)} words"
        )
    for at in range(0, len(words), length):
        triple = "-".join(words[at : at + 3])
        try:
            found[triple] = dict(zip(keys, map(number_of, words[at + 3 : at + length]), strict=True))
        except ValueError:
            raise InputError(f"{name}: file: {file}: the entry {triple} has a word where a number belongs") from None
    return found


def likest(forms: Mapping[str, tuple[str, ...]], entries: Any) -> str:
    """Suffix of the form whose keys differ least from those of the first entry."""
    first = next(iter(entries.values()), None) if isinstance(entries, Mapping) else None
    given = set(map(str, first)) if isinstance(first, Mapping) else set()
    return min(forms, key=lambda suffix: len(given ^ set(forms[suffix])))


def checked_entries(name: str, entries: Any, keys: tuple[str, ...]) -> dict[str, dict[str, float]]:
    """Return entries {"Si-Si-Si": {key: number}} as dicts of floats. Raises an InputError that names the entry."""
    if not isinstance(entries, Mapping) or not entries:
        raise InputError(f"{name}: entries: expected a table of triples such as 'Si-Si-Si', got {shown(entries)}")
    found: dict[str, dict[str, float]] = {}
    for triple, given in entries.items():
        if not isinstance(triple, str) or not re.fullmatch(r"[^-\s]+-[^-\s]+-[^-\s]+", triple):
            raise InputError(f"{name}: entries: expected three species such as 'Si-Si-Si', got {shown(triple)}")
        if not isinstance(given, Mapping):
            raise InputError(f"{name}: entries.{triple}: expected a table, got {shown(given)}")
        if strange := sorted(set(map(str, given)) - set(keys)):
            raise InputError(f"{name}: entries.{triple}: unknown key {shown(strange[0])}; expected {', '.join(keys)}")
        if missing := [key for key in keys if key not in given]:
            raise InputError(f"{name}: entries.{triple}: {missing[0]}: required key is missing")
        found[triple] = {}
        for key in keys:
            value = number(given[key])
            if not abs(value) < float("inf"):
                raise InputError(f"{name}: entries.{triple}: {key} must be a finite number, got {shown(given[key])}")
            found[triple][key] = float(value)
    return found


def elements_of(entries: Mapping[str, Any]) -> tuple[str, ...]:
    """Elements of the entries, in the order of their first mention."""
    return tuple(dict.fromkeys(part for triple in entries for part in triple.split("-")))


def entry_of(name: str, source: str, entries: Mapping[str, Any], *triple: str) -> Any:
    """Entry of three species. Raises an InputError that names the missing entry."""
    key = "-".join(triple)
    if key not in entries:
        raise InputError(f"{name}: {source} has no parameters for {key}")
    return entries[key]
