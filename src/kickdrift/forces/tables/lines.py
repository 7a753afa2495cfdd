"""Rows of polynomials that compiled code reads, from the curve of a table, and the laws that read them.

Pairs: the cells divide r^2 between powers of two into 1024, so the cell follows from the bits of r^2. Its width is a
thousandth of r^2 or less at every distance. A row has four numbers, a cubic of the force over r, joined with its slope.
The energy is the integral of the cubics from the table's end, so the force is exactly its slope, and it is twice
continuously differentiable. A step of the loop without a sample reads one row a pair.

Bonds, angles and dihedrals: cells of one width, each with the polynomial of degree five of the energy.

A law has the addresses of its rows as floats. The rows stay in memory while the process runs; equal tables share them.
"""

from __future__ import annotations

import math
import struct
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError
from kickdrift.forces.tables.curve import Curve
from kickdrift.forces.tables.layout import EDGE, LISTED_ROW, MARK, PAIR_ROW, SHIFT
from kickdrift.model.state import Floats

MOST_CELLS = 1 << 16  # of tables of bonds, angles and dihedrals
_KEPT: dict[Any, Any] = {}  # laws by their table, and rows by their address


class PairRows(NamedTuple):
    """Rows of a table of pairs."""

    forces: NDArray[np.float64]  # (cells, PAIR_ROW)
    energies: NDArray[np.float64]  # (cells,) at the left ends
    begin: int  # number of the first cell
    start: float
    end: float


class PairTable(NamedTuple):
    """A table of pairs, as its compiled code sees it."""

    rows: float  # MARK, plus the address of the row of cell 0
    energies: float  # likewise
    first: float  # r^2 in the cell before the table, whose numbers are nan
    last: float  # r^2 in the last cell

    @property
    def reach(p):
        """Distance at which the table ends."""
        return _KEPT[p.rows].end

    @property
    def start(p):
        """Distance at which the table begins."""
        return _KEPT[p.rows].start

    def law(p, r2):
        forces, energies, first_cell, *_ = _KEPT[p.rows]
        r2 = float(r2)
        (bits,) = struct.unpack("<q", struct.pack("<d", max(min(r2, p.last), p.first)))
        cell = bits >> SHIFT
        (left,) = struct.unpack("<d", struct.pack("<q", cell << SHIFT))
        d, (c0, c1, c2, c3) = r2 - left, forces[cell - first_cell].tolist()
        energy = float(energies[cell - first_cell]) - d * (c0 / 2 + d * (c1 / 4 + d * (c2 / 6 + d * c3 / 8)))
        return energy, c0 + d * (c1 + d * (c2 + d * c3))

    @staticmethod
    def own_code():
        """The compiled law."""
        from kickdrift.forces.tables.code import pair_table

        return pair_table


class ListedTable(NamedTuple):
    """A table of bonds, angles or dihedrals, as its compiled code sees it."""

    rows: float  # MARK, plus the address of the first row
    first: float  # place of the first cell
    per: float  # cells for each unit of length or angle
    last: float  # number of the last cell

    @property
    def said(p):
        """The table's range, for messages."""
        return f"its table goes from {p.first:g} to {p.first + (p.last + 1.0) / p.per:g}"

    def law(p, x):
        q = (float(x) - p.first) * p.per
        if not -EDGE <= q <= p.last + 1.0 + EDGE:
            return math.nan, math.nan
        cell = min(max(math.floor(q), 0), int(p.last))
        q -= cell
        c0, c1, c2, c3, c4, c5, _, _ = _KEPT[p.rows][cell].tolist()
        slope = c1 + q * (2.0 * c2 + q * (3.0 * c3 + q * (4.0 * c4 + q * (5.0 * c5))))
        return c0 + q * (c1 + q * (c2 + q * (c3 + q * (c4 + q * c5)))), p.per * slope

    @staticmethod
    def own_code():
        """The compiled law."""
        from kickdrift.forces.tables.code import listed_table

        return listed_table


def pair_table(curve: Curve) -> PairTable:
    """The law of a curve of distances."""
    return _kept(PairTable, curve, _pair_table)


def listed_table(curve: Curve) -> ListedTable:
    """The law of a curve of lengths, or of angles in radians."""
    return _kept(ListedTable, curve, _listed_table)


def _kept(kind: type, curve: Curve, make: Any) -> Any:
    key = kind, *(each.tobytes() for each in curve)
    if key not in _KEPT:
        _KEPT[key] = make(curve)
    return _KEPT[key]


def _pair_table(curve: Curve) -> PairTable:
    first, last = curve.x[0] ** 2, curve.x[-1] ** 2
    ends = np.array([first, math.nextafter(last, 0.0)])
    cells = np.arange(*(ends.view(np.int64) >> SHIFT) + (0, 1))
    left = (cells << SHIFT).view(np.float64)
    s = np.clip(np.append(left, last), first, last)  # ends of the cells, within the table
    r = np.sqrt(s)
    _, slope, bend = curve.at(r)
    force, change = -slope / r, (slope / r - bend) / (2.0 * s)  # -2 dU/ds and its derivative by s = r^2
    c = _cubics(np.diff(s), force, change, s[0] - left[0])
    h, end = s[:-1] - left, s[1:] - left
    area = _area(c, end) - _area(c, h)
    energies = curve.energy[-1] + 0.5 * np.cumsum(area[::-1])[::-1] + 0.5 * _area(c, h)
    nearer, begin = np.full((1, PAIR_ROW), math.nan), int(cells[0]) - 1  # a cell before the first
    forces, energies = _aligned(np.vstack([nearer, c.T])), _aligned(np.append(nearer[0, :1], energies))
    rows, first_energy = (MARK + each.ctypes.data - each.strides[0] * begin for each in (forces, energies))
    _KEPT[rows] = PairRows(forces, energies, begin, float(curve.x[0]), float(curve.x[-1]))
    start = float(np.array(begin << SHIFT).view(np.float64))
    return PairTable(float(rows), float(first_energy), start, float(ends[1]))


def _cubics(h: Floats, force: Floats, change: Floats, ahead: float) -> Floats:
    """Coefficients (4, cells) of Hermite's cubics, of powers of the distance to the left end of each cell; the table
    begins ``ahead`` of the first cell's left end."""
    mean, low, high = np.diff(force) / h, change[:-1], change[1:]
    c = np.array([force[:-1], low, (3.0 * mean - 2.0 * low - high) / h, (low + high - 2.0 * mean) / h**2])
    c0, c1, c2, c3 = c[:, 0]
    c[:, 0] = (
        c0 - ahead * (c1 - ahead * (c2 - ahead * c3)), c1 - ahead * (2.0 * c2 - ahead * 3.0 * c3),
        c2 - 3.0 * ahead * c3, c3,
    )  # fmt: skip
    return c


def _area(c: Floats, d: Floats) -> Floats:
    return d * (c[0] + d * (c[1] / 2 + d * (c[2] / 3 + d * c[3] / 4)))


def _listed_table(curve: Curve) -> ListedTable:
    span = float(curve.x[-1] - curve.x[0])
    cells = round(span / float(np.diff(curve.x).min()))
    if cells > MOST_CELLS:
        raise InputError(f"points are as close as 1/{cells} of the table's length; 1/{MOST_CELLS} is the least")
    x = np.linspace(curve.x[0], curve.x[-1], cells + 1)
    rows = np.zeros((cells, LISTED_ROW))
    rows[:, :6] = Curve(x, *curve.at(x)).coefficients().T
    rows = _aligned(rows)
    address = float(MARK + rows.ctypes.data)
    _KEPT[address] = rows
    return ListedTable(address, float(x[0]), cells / span, float(cells - 1))


def _aligned(values: Floats) -> NDArray[np.float64]:
    from kickdrift.jit.lanes.memory import aligned

    made = aligned(values.shape)
    made[...] = values
    return made
