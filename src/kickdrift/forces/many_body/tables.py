"""Tables of embedded-atom potentials, from the files that LAMMPS reads: funcfl, setfl, Finnis and Sinclair's.

LAMMPS and ASE join the same table by different cubics. Here the cubics are those of LAMMPS (``pair_eam.cpp``): a
Hermite spline whose slopes are differences over five points, of r times the pair energy. ASE's are twice continuously
differentiable, of the pair energy. Both are of fourth order in the spacing of the table.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError
from kickdrift.forces.many_body.entries import number_of, potential_file
from kickdrift.model.units.constants import SYMBOLS
from kickdrift.text import shown

STYLES = {".eam": "eam", ".eam.alloy": "eam/alloy", ".eam.fs": "eam/fs", ".eam.he": "eam/he"}  # LAMMPS' names
COULOMB = 27.2 * 0.529  # eV angstrom: Hartree times Bohr radius, as in LAMMPS


class Potential(NamedTuple):
    """Content of a file, as cubics c3 p^3 + c2 p^2 + c1 p + c0 with p from 0 to 1 in each interval."""

    elements: tuple[str, ...]
    cutoff: float
    dr: float
    drho: float
    density: NDArray[np.float64]  # (elements, elements, intervals, 4) at the first element, from the second
    rphi: NDArray[np.float64]  # (elements, elements, intervals, 4) r times the pair energy
    embedding: NDArray[np.float64]  # (elements, intervals, 4)
    first_density: float  # where the table of embedding energies begins
    lowest_density: float  # below it the embedding energy is a line; minus infinity: the first cubic goes on
    digest: str  # SHA-256 of the file


class Tables(NamedTuple):
    """Numbers of a file."""

    elements: tuple[str, ...]
    cutoff: float
    dr: float
    drho: float
    density: NDArray[np.float64]  # (elements, elements, points) at the first element, from the second
    rphi: NDArray[np.float64]  # (elements, elements, points)
    embedding: NDArray[np.float64]  # (elements, points)
    highest_density: float | None = None  # the end of the embedding energies, which may begin below zero


def style_of_file(name: str, file: str) -> str:
    """LAMMPS' pair style of a file. Raises an InputError unless the name ends as one of these files."""
    for suffix, style in STYLES.items():
        if Path(file).name.endswith(suffix):
            return style
    raise InputError(f"{name}: file: expected a name that ends in {', '.join(STYLES)}, got {shown(file)}")


def hermite(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return LAMMPS' cubics (…, n - 1, 4) between values (…, n) at equal spacing, highest power first."""
    f = np.asarray(values, dtype=float)
    slope = np.empty_like(f)
    slope[..., 0], slope[..., -1] = f[..., 1] - f[..., 0], f[..., -1] - f[..., -2]
    slope[..., 1], slope[..., -2] = 0.5 * (f[..., 2] - f[..., 0]), 0.5 * (f[..., -1] - f[..., -3])
    slope[..., 2:-2] = ((f[..., :-4] - f[..., 4:]) + 8.0 * (f[..., 3:-1] - f[..., 1:-3])) / 12.0
    rise, low, high = np.diff(f), slope[..., :-1], slope[..., 1:]
    return np.stack([low + high - 2.0 * rise, 3.0 * rise - 2.0 * low - high, low, f[..., :-1]], axis=-1)


def read_potential(name: str, file: str) -> Potential:
    """Read a file of an embedded-atom potential. Raises an InputError that begins with ``name`` and names the file."""
    style = style_of_file(name, file)
    content = potential_file(name, file)
    try:
        lines = iter(content.decode("utf-8", "replace").splitlines())
        most = len(content) // 2  # numbers that a file of this size can hold
        found = _read_funcfl(lines, most) if style == "eam" else _read_setfl(lines, style, most)
    except (ValueError, IndexError, StopIteration) as error:
        why = f"{error}" if str(error) else "the file ends too early"
        raise InputError(f"{name}: file: {file}: no potential of the form {style}: {why}") from None
    tables = (found.density, found.rphi, found.embedding)
    if min(each.shape[-1] for each in tables) < 5 or not all(
        np.isfinite(each).all() for each in (*tables, found.highest_density or 0.0)
    ):
        raise InputError(f"{name}: file: {file}: expected tables of five finite numbers or more")
    if not (0 < found.cutoff < np.inf and 0 < found.dr < np.inf and 0 < found.drho < np.inf):
        raise InputError(f"{name}: file: {file}: expected a positive cutoff and positive spacings")
    embedding, first, lowest = hermite(found.embedding), 0.0, -np.inf
    if found.highest_density is not None:
        first = lowest = found.highest_density - (found.embedding.shape[-1] - 1) * found.drho
        embedding[:, 0] = _earlier(embedding[:, 1])
    return Potential(
        found.elements, found.cutoff, found.dr, found.drho, hermite(found.density), hermite(found.rphi), embedding,
        first, lowest, hashlib.sha256(content).hexdigest(),
    )  # fmt: skip


def _earlier(cubic: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same cubics (…, 4) on the interval before, where LAMMPS' ``eam/he`` goes on with them."""
    c3, c2, c1, c0 = np.moveaxis(cubic, -1, 0)
    return np.stack([c3, c2 - 3.0 * c3, c1 - 2.0 * c2 + 3.0 * c3, c0 - c1 + c2 - c3], axis=-1)


def _words(line: str) -> list[str]:
    return line.split("#")[0].split()


def _row(lines: Iterator[str], count: int) -> NDArray[np.float64]:
    """The next numbers, over as many lines as they take; what else stands in the last of these lines is left out."""
    found: list[float] = []
    while len(found) < count:
        found += map(number_of, _words(next(lines)))
    return np.array(found[:count])


def _sizes(line: str, most: int, more: int = 0) -> tuple[int, float, int, float, list[float]]:
    """Points and spacings of densities and of distances, and the numbers after them."""
    words = _words(line)
    points = [int(words[0]), int(words[2])]
    if min(points) < 1:
        raise ValueError(f"expected numbers of points, got {points[0]} and {points[1]}")
    if max(points) > most:
        raise ValueError(f"the header says {points[0]} and {points[1]} points, more than a file of this size can hold")
    return (
        points[0],
        number_of(words[1]),
        points[1],
        number_of(words[3]),
        [number_of(word) for word in words[4 : 5 + more]],
    )


def _read_funcfl(lines: Iterator[str], most: int) -> Tables:
    """One element, whose pair energy is that of two charges. LAMMPS leaves out the last points."""
    next(lines)
    number = int(_words(next(lines))[0])
    if not 0 < number < len(SYMBOLS):
        raise ValueError(f"no element has the number {number}")
    densities, drho, points, dr, (cutoff,) = _sizes(next(lines), most)
    embedding, charge, density = (_row(lines, count)[:-1] for count in (densities, points, points))
    return Tables(
        (SYMBOLS[number],), cutoff, dr, drho, density[None, None], COULOMB * (charge * charge)[None, None],
        embedding[None],
    )  # fmt: skip


def _read_setfl(lines: Iterator[str], style: str, most: int) -> Tables:
    """Several elements, with one density of each, or one for each pair of elements."""
    for _ in range(3):
        next(lines)
    count, *elements = _words(next(lines))
    if len(elements) != int(count) or not elements:
        raise ValueError(f"expected {count} elements, got {len(elements)}")
    densities, drho, points, dr, (cutoff, *highest) = _sizes(next(lines), most, style == "eam/he")
    if style == "eam/he" and not highest:
        raise ValueError("the highest density is missing")
    n, of_pairs = len(elements), style != "eam/alloy"
    embedding, density, rphi = np.empty((n, densities)), np.empty((n, n, points)), np.empty((n, n, points))
    for source in range(n):
        next(lines)
        embedding[source] = _row(lines, densities)
        for at in range(n) if of_pairs else (slice(None),):
            density[at, source] = _row(lines, points)
    for a in range(n):
        for b in range(a + 1):
            rphi[a, b] = rphi[b, a] = _row(lines, points)
    return Tables(tuple(elements), cutoff, dr, drho, density, rphi, embedding, highest[0] if highest else None)
