"""Parameters for triples of elements, from tables or from LAMMPS' files ``*.sw`` and ``*.tersoff``.

LAMMPS and ASE join the same table of an embedded-atom potential (eam.alloy, eam.fs) by different cubics. Here the
cubics are those of LAMMPS (``pair_eam.cpp``): a Hermite spline whose slopes are differences over five points, of r
times the pair energy. ASE's are twice continuously differentiable, of the pair energy. Both are of fourth order in the
spacing of the table.
"""

import hashlib
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.disk.files import content
from kickdrift.errors import InputError
from kickdrift.model.checks.values import number
from kickdrift.text import shown

POTENTIAL_BYTES = 2**28  # of a file; those of many elements have some 10 MB


def potential_file(name: str, file: str) -> bytes:
    """Content of a file of parameters. Raises an InputError that names the file, unless it is a regular one."""
    try:
        return content(file, POTENTIAL_BYTES, "a file of a potential")
    except InputError as error:
        raise InputError(f"{name}: file: {error}") from None


def read_entries(name: str, file: Any, suffix: str, keys: tuple[str, ...]) -> dict[str, dict[str, float]]:
    """Read a file in LAMMPS' form: three elements and a number for each key, over as many lines as it takes; "#" begins
    a comment. Return {"Si-Si-Si": {key: number}}. Raises an InputError that names the file."""
    if not isinstance(file, str) or "\0" in file or not file.endswith(suffix):
        raise InputError(f"{name}: file: expected a name that ends in {suffix}, got {shown(file)}")
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
            found[triple] = dict(zip(keys, map(float, words[at + 3 : at + length]), strict=True))
        except ValueError:
            raise InputError(f"{name}: file: {file}: the entry {triple} has a word where a number belongs") from None
    return found


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


FORMS = (".eam.alloy", ".eam.fs")


class Potential(NamedTuple):
    """Content of a file, as cubics c3 p^3 + c2 p^2 + c1 p + c0 with p from 0 to 1 in each interval."""

    elements: tuple[str, ...]
    cutoff: float
    dr: float
    drho: float
    density: NDArray[np.float64]  # (elements, elements, intervals, 4) at the first element, from the second
    rphi: NDArray[np.float64]  # (elements, elements, intervals, 4) r times the pair energy
    embedding: NDArray[np.float64]  # (elements, intervals, 4)
    digest: str  # SHA-256 of the file


def hermite(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return LAMMPS' cubics (…, n - 1, 4) between values (…, n) at equal spacing, highest power first."""
    f = np.asarray(values, dtype=float)
    slope = np.empty_like(f)
    slope[..., 0], slope[..., -1] = f[..., 1] - f[..., 0], f[..., -1] - f[..., -2]
    slope[..., 1], slope[..., -2] = 0.5 * (f[..., 2] - f[..., 0]), 0.5 * (f[..., -1] - f[..., -3])
    slope[..., 2:-2] = ((f[..., :-4] - f[..., 4:]) + 8.0 * (f[..., 3:-1] - f[..., 1:-3])) / 12.0
    rise, low, high = np.diff(f), slope[..., :-1], slope[..., 1:]
    return np.stack([low + high - 2.0 * rise, 3.0 * rise - 2.0 * low - high, low, f[..., :-1]], axis=-1)


def read_setfl(name: str, file: str) -> Potential:
    """Read a file of an embedded-atom potential. Raises an InputError that begins with ``name`` and names the file."""
    path = Path(file)
    if not path.name.endswith(FORMS):
        raise InputError(f"{name}: file: expected a name that ends in {' or '.join(FORMS)}, got {shown(file)}")
    content = potential_file(name, file)
    try:
        from ase.calculators.eam import EAM
    except ImportError:
        raise InputError(f"{name}: files of potentials are read by ASE: pip install 'kickdrift[ase]'") from None
    try:
        found = EAM(potential=str(path))
    except Exception as error:  # whatever a file of another kind makes ASE raise
        raise InputError(f"{name}: file: {file}: ASE finds no potential in it ({error})") from None
    density = np.asarray(found.density_data, dtype=float)
    count = len(found.elements)
    density = density.swapaxes(0, 1) if density.ndim == 3 else np.broadcast_to(density, (count, *density.shape))
    rphi = np.array(found.rphi_data, dtype=float)
    for a in range(count):
        for b in range(a):
            rphi[a, b] = rphi[b, a]
    tables = (density, rphi, np.asarray(found.embedded_data, dtype=float))
    if min(each.shape[-1] for each in tables) < 5 or not all(np.isfinite(each).all() for each in tables):
        raise InputError(f"{name}: file: {file}: expected tables of five finite numbers or more")
    if not (0 < found.cutoff < np.inf and 0 < found.dr < np.inf and 0 < found.drho < np.inf):
        raise InputError(f"{name}: file: {file}: expected a positive cutoff and positive spacings")
    return Potential(
        tuple(found.elements),
        float(found.cutoff),
        float(found.dr),
        float(found.drho),
        hermite(tables[0]),
        hermite(tables[1]),
        hermite(tables[2]),
        hashlib.sha256(content).hexdigest(),
    )
