"""Coordinates of planetary systems: barycentric, heliocentric, democratic heliocentric and Jacobi's, and their
inverses.

Arrays are (…, n, 3), the central body first, with masses (n,) or (…, n). Massless bodies may be in any row but the
first. In all coordinates but barycentric, row 0 is the centre of mass of all bodies. So no information is lost and each
map has an inverse, exact to rounding. Positions and velocities go through the same linear map, except in
``democratic``.

Sources: Murray & Dermott 1999, 9.2 (Jacobi); Duncan, Levison & Lee 1998, doi:10.1086/300541 (democratic heliocentric).
"""

import numpy as np
from numpy.typing import ArrayLike

from kickdrift.errors import InputError
from kickdrift.model.checks.values import numbers
from kickdrift.model.state import Floats
from kickdrift.text import shown, suggestion


def barycentre(x: ArrayLike, masses: ArrayLike) -> Floats:
    """Mean (…, 3) of the rows of x (…, n, 3), weighted with the masses."""
    x, m = _checked(x, masses, heavy_first=False)
    return np.einsum("...n,...nk->...k", m, x) / m.sum(axis=-1, keepdims=True)


def to_barycentric(x: ArrayLike, masses: ArrayLike) -> tuple[Floats, Floats]:
    """Rows relative to the centre of mass (…, n, 3), and the centre of mass (…, 3)."""
    centre = barycentre(x, masses)
    return np.asarray(x, dtype=float) - centre[..., None, :], centre


def to_heliocentric(x: ArrayLike, masses: ArrayLike) -> Floats:
    """Rows relative to row 0; row 0 becomes the centre of mass."""
    x, m = _checked(x, masses)
    relative = x - x[..., :1, :]
    relative[..., 0, :] = barycentre(x, m)
    return relative


def from_heliocentric(x: ArrayLike, masses: ArrayLike) -> Floats:
    """Inverse of ``to_heliocentric``."""
    x, m = _checked(x, masses)
    central = x[..., :1, :] - _share(m, x, m.sum(axis=-1, keepdims=True))
    return np.concatenate([central, x[..., 1:, :] + central], axis=-2)


def to_democratic(x: ArrayLike, v: ArrayLike, masses: ArrayLike) -> tuple[Floats, Floats]:
    """Heliocentric positions and barycentric velocities, a canonical pair; row 0 of both is of the centre of mass."""
    relative, moving = to_barycentric(v, masses)
    relative[..., 0, :] = moving
    return to_heliocentric(x, masses), relative


def from_democratic(x: ArrayLike, v: ArrayLike, masses: ArrayLike) -> tuple[Floats, Floats]:
    """Inverse of ``to_democratic``."""
    v, m = _checked(v, masses)
    moving = v[..., :1, :]
    central = moving - _share(m, v, m[..., :1])
    return from_heliocentric(x, m), np.concatenate([central, v[..., 1:, :] + moving], axis=-2)


def to_jacobi(x: ArrayLike, masses: ArrayLike) -> Floats:
    """Row i relative to the centre of mass of the rows before it; row 0 becomes the centre of mass of all."""
    x, m = _checked(x, masses)
    centres = np.cumsum(m[..., None] * x, axis=-2) / np.cumsum(m, axis=-1)[..., None]
    return np.concatenate([centres[..., -1:, :], x[..., 1:, :] - centres[..., :-1, :]], axis=-2)


def from_jacobi(x: ArrayLike, masses: ArrayLike) -> Floats:
    """Inverse of ``to_jacobi``."""
    x, m = _checked(x, masses)
    share = (m / np.cumsum(m, axis=-1))[..., 1:, None] * x[..., 1:, :]
    # Centre of the rows before i: the centre of all rows, less the shifts by row i and the rows after it.
    before = x[..., :1, :] - np.cumsum(share[..., ::-1, :], axis=-2)[..., ::-1, :]
    central = before[..., :1, :] if x.shape[-2] > 1 else x
    return np.concatenate([central, x[..., 1:, :] + before], axis=-2)


FRAMES = ("heliocentric", "jacobi", "barycentric")


def attracting_masses(masses: ArrayLike, frame: str) -> Floats:
    """Masses (n - 1,) whose product with G is the mu of each body's orbit in a frame of ``FRAMES``, without the central
    body.

    Heliocentric: the body and the central body; jacobi: the body and all bodies before it; barycentric: all bodies.
    """
    m = np.asarray(masses, dtype=float)
    _known(frame)
    if frame == "heliocentric":
        return m[0] + m[1:]
    return np.cumsum(m)[1:] if frame == "jacobi" else np.full(len(m) - 1, m.sum())


def about_centre(x: ArrayLike, masses: ArrayLike, frame: str) -> Floats:
    """Positions (…, n - 1, 3) of the bodies relative to their centres of motion in a frame of ``FRAMES``; velocities
    too."""
    _known(frame)
    if frame == "barycentric":
        return to_barycentric(x, masses)[0][..., 1:, :]
    return (to_heliocentric if frame == "heliocentric" else to_jacobi)(x, masses)[..., 1:, :]


def at_barycentre(x: ArrayLike, masses: ArrayLike, frame: str) -> Floats:
    """Rows (…, n, 3) relative to the centre of mass, from rows in a frame of ``FRAMES``; row 0 of x is ignored."""
    _known(frame)
    x, m = _checked(x, masses)
    x = np.concatenate([np.zeros_like(x[..., :1, :]), x[..., 1:, :]], axis=-2)
    if frame == "barycentric":
        x[..., :1, :] = -_share(m, x, m[..., :1])
        return x
    return (from_heliocentric if frame == "heliocentric" else from_jacobi)(x, m)


def _share(masses: Floats, x: Floats, by: Floats) -> Floats:
    """Sum (…, 1, 3) of m x over all rows but the first, divided by a mass (…, 1)."""
    return np.asarray((np.einsum("...n,...nk->...k", masses[..., 1:], x[..., 1:, :]) / by)[..., None, :])


def _known(frame: str) -> None:
    if frame not in FRAMES:
        raise InputError(f"frame: expected one of {', '.join(FRAMES)}, got {shown(frame)}{suggestion(frame, FRAMES)}")


def _checked(x: ArrayLike, masses: ArrayLike, heavy_first: bool = True) -> tuple[Floats, Floats]:
    x, m = numbers("coordinates", x), numbers("masses", masses)
    if x.ndim < 2 or x.shape[-1] != 3 or m.shape not in (x.shape[-2:-1], x.shape[:-1]):
        raise InputError(f"expected coordinates (…, n, 3) and masses (n,), got shapes {x.shape} and {m.shape}")
    if not np.all(m >= 0) or not np.all(m.sum(axis=-1) > 0):
        raise InputError(f"masses: expected numbers, zero or more, with a positive sum, got a sum of {m.sum():g}")
    if heavy_first and not np.all(m[..., 0] > 0):
        raise InputError("masses: the central body, particle 0, has no mass")
    return x, m
