"""Osculating ellipses of bodies about a central one, as three vectors that a picture draws without any mechanics."""

from __future__ import annotations

import numpy as np

from kickdrift.model.orbits.orbits import Paths, orbits_of
from kickdrift.model.state import Floats

COARSE = 0.35  # largest angle in radians between frames for which a trail is a path


def axes_of(found: Paths, central_rests: bool = False) -> Floats:
    """Ellipses (f, n, 9): centre c relative to the body, and semi-axes a and b of r = c + a cos E + b sin E.

    The ellipse is the orbit about the centre of mass of the bodies inside (Jacobi), as seen where the barycentre rests,
    or where the central body rests. The row of the central body, and rows without an ellipse, are nan.
    """
    central = found.central
    assert central is not None
    frames, n = found.positions.shape[:2]
    axes = np.full((frames, n, 9), np.nan)
    found = found._replace(names=tuple(map(str, range(n))))
    with np.errstate(all="ignore"):
        orbits = orbits_of(found)
        at = orbits.elements
        a = at.q / (1.0 - at.e)
        b = a * np.sqrt(np.maximum(1.0 - at.e**2, 0.0))
        towards, across = _perifocal(at.Omega, at.omega, at.inc)
        long, short = a[..., None] * towards, b[..., None] * across
        here = long * (np.cos(at.E) - at.e)[..., None] + short * np.sin(at.E)[..., None]
        middle = -at.e[..., None] * long - here  # the ellipse passes through the body
        bound = (at.e < 1.0)[..., None]
        found_axes = np.where(bound, np.concatenate([middle, long, short], axis=2), np.nan)
    others = np.delete(np.arange(n), central)
    if central_rests:
        axes[:, others] = found_axes
        return axes
    inside = np.cumsum(found.held[:, [central, *others]], axis=1)[:, 1:]
    part = 1.0 - found.held[:, others] / inside  # the barycentre of the body and all inside its orbit is at rest
    axes[:, others] = found_axes * part[..., None]
    return axes


def _perifocal(Omega: Floats, omega: Floats, inc: Floats) -> tuple[Floats, Floats]:
    """Unit vectors to the pericentre, and across to the direction of motion there."""
    co, so, cw, sw, ci, si = np.cos(Omega), np.sin(Omega), np.cos(omega), np.sin(omega), np.cos(inc), np.sin(inc)
    towards = np.stack([co * cw - so * sw * ci, so * cw + co * sw * ci, sw * si], axis=-1)
    across = np.stack([-co * sw - so * cw * ci, -so * sw + co * cw * ci, cw * si], axis=-1)
    return towards, across
