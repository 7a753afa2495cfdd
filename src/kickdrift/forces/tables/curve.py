"""A smooth curve through the points of a table: polynomials of degree five, twice continuously differentiable.

At each point the curve has the table's energy. Its slope there is minus the table's force, or else, as the second
derivative, that of the polynomial through the nearest seven points. So the energy has an error of order six in the
spacing, and the force is exactly the slope of the energy.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kickdrift.model.state import Floats

NEAREST = 7  # points of a local polynomial
FEWEST = 5  # points of a table
SLOPE_TOLERANCE = 1e-3  # of the largest force beside a point, between a table's force and the slope of its energies
ROUNDED = 1e-6  # relative rounding of the energies in a file


class Curve(NamedTuple):
    """Points x (n,) that increase, and energy, first and second derivative at each."""

    x: Floats
    energy: Floats
    slope: Floats
    bend: Floats

    def at(self, x: Floats) -> tuple[Floats, Floats, Floats]:
        """Energy, first and second derivative at places x (m,)."""
        k = np.clip(np.searchsorted(self.x, x, side="right") - 1, 0, len(self.x) - 2)
        h = self.x[k + 1] - self.x[k]
        q, c = (x - self.x[k]) / h, self.coefficients()[:, k]
        energy, slope, bend = c[5], 5.0 * c[5], 20.0 * c[5]
        for power in range(4, -1, -1):
            energy = energy * q + c[power]
            slope = slope * q + power * c[power] if power else slope
            bend = bend * q + power * (power - 1) * c[power] if power > 1 else bend
        return energy, slope / h, bend / (h * h)

    def coefficients(self) -> Floats:
        """Coefficients (6, n - 1) of each piece, of powers of its argument from 0 to 1."""
        h = np.diff(self.x)
        u, rise = self.energy[:-1], np.diff(self.energy)
        d0, d1 = self.slope[:-1] * h, self.slope[1:] * h
        b0, b1 = self.bend[:-1] * h * h, self.bend[1:] * h * h
        rest, turn, change = rise - d0 - b0 / 2, d1 - d0 - b0, b1 - b0
        return np.array([
            u, d0, b0 / 2, 10 * rest - 4 * turn + change / 2, -15 * rest + 7 * turn - change,
            6 * rest - 3 * turn + change / 2,
        ])  # fmt: skip


def curve_through(x: Floats, energy: Floats, force: Floats | None) -> Curve:
    """The curve through a table. Its force must have passed `wrong_slope`."""
    slope, bend = local_derivatives(x, energy, NEAREST)
    if force is not None:
        slope, bend = -force, local_derivatives(x, -force, NEAREST)[0]
    return Curve(x, energy, slope, bend)


def closed(x: Floats, energy: Floats, force: Floats | None, turn: float) -> Curve:
    """The curve through a table of one turn: the energy at x[0] + ``turn`` is that at x[0]."""
    count, beside = len(x), NEAREST // 2
    rows = np.arange(-beside, count + 1 + beside)
    longer = x[rows % count] + turn * (rows // count)
    found = curve_through(longer, energy[rows % count], None if force is None else force[rows % count])
    return Curve(*(each[beside : beside + count + 1] for each in found))


def local_derivatives(x: Floats, y: Floats, points: int) -> tuple[Floats, Floats]:
    """First and second derivative (n,) at each x (n,) of the polynomial through the nearest ``points``."""
    count = min(points, len(x))
    begin = np.clip(np.arange(len(x)) - count // 2, 0, len(x) - count)
    rows = begin[:, None] + np.arange(count)
    others = rows[rows != np.arange(len(x))[:, None]].reshape(len(x), count - 1)
    apart = x[others] - x[:, None]
    size = np.abs(apart).max(axis=1, keepdims=True)
    powers = (apart / size)[:, :, None] ** np.arange(1, count)
    found = np.linalg.solve(powers, (y[others] - y[:, None])[:, :, None])[:, :, 0]
    return found[:, 0] / size[:, 0], 2.0 * found[:, 1] / size[:, 0] ** 2


def wrong_slope(x: Floats, energy: Floats, force: Floats) -> tuple[int, float, float] | None:
    """The worst point whose force is not minus the slope of the energies, with that slope and how far the two are apart
    relative to the largest force beside the point; None if all agree.

    Agreement is to `SLOPE_TOLERANCE`, and to what the digits and the spacing of the energies allow."""
    slope = -local_derivatives(x, energy, NEAREST)[0]
    coarse = np.abs(slope + local_derivatives(x, energy, FEWEST)[0])
    spacing = np.diff(x)
    near = np.minimum(np.append(spacing, np.inf), np.append(np.inf, spacing))
    scale = beside(np.maximum(np.abs(force), np.abs(slope)))
    allowed = SLOPE_TOLERANCE * scale + ROUNDED * beside(np.abs(energy)) / near + beside(coarse)
    off = np.abs(force - slope)
    if (off <= allowed).all():
        return None
    worst = int(np.argmax(off / np.maximum(allowed, np.finfo(float).tiny)))
    return worst, float(slope[worst]), float(off[worst] / scale[worst])


def beside(values: Floats) -> Floats:
    """The largest of each value and its two neighbours."""
    longer = np.concatenate([values[:1], values, values[-1:]])
    return np.maximum(np.maximum(longer[:-2], longer[2:]), values)
