"""The camera of a film: where it stands, how it turns, and where points lie in the picture."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from kickdrift.errors import InputError
from kickdrift.model.checks.values import number
from kickdrift.model.state import Floats
from kickdrift.text import shown

AWAY = 4.0  # distance of the camera from the middle, in half heights of the picture


class Camera(NamedTuple):
    """A camera that looks at the middle of a scene.

    Attributes
    ----------
    azimuth : angle about the z axis, in degrees
    elevation : angle above the x-y plane, in degrees; 90 looks down on the plane
    turn : angle about the z axis by which the camera turns during the film, in degrees
    zoom : magnification
    """

    azimuth: float = 30.0
    elevation: float = 25.0
    turn: float = 0.0
    zoom: float = 1.0

    def checked(self) -> Camera:
        """Return the camera. Raises InputError for an angle that is not a number, and for a zoom that is not
        positive."""
        for key, value in self._asdict().items():
            if not math.isfinite(number(value)) or (key == "zoom" and value <= 0):
                kind = "a positive number" if key == "zoom" else "an angle in degrees"
                raise InputError(f"{key}: expected {kind}, got {shown(value)}")
        if abs(self.elevation) > 90:
            raise InputError(f"elevation: expected an angle from -90 to 90 degrees, got {shown(self.elevation)}")
        return self

    def at(self, share: float) -> Floats:
        """Axes (3, 3) of the picture after this share of the film: right, up and towards the camera, as rows."""
        a, b = math.radians(self.azimuth + share * self.turn), math.radians(self.elevation)
        right = (-math.sin(a), math.cos(a), 0.0)
        up = (-math.sin(b) * math.cos(a), -math.sin(b) * math.sin(a), math.cos(b))
        towards = (math.cos(b) * math.cos(a), math.cos(b) * math.sin(a), math.sin(b))
        return np.array([right, up, towards])


class View(NamedTuple):
    """Points in the picture: x and y (n, 2) in half heights, size (n,) of a unit length there, and depth (n,)."""

    xy: Floats
    scale: Floats
    depth: Floats


def view(points: Floats, axes: Floats, reach: float, zoom: float) -> View:
    """Points (n, 3) as the camera sees them. ``reach`` is the length of half the picture's height without a zoom.
    A point behind the camera, or without a position, is nan."""
    seen = points @ (axes.T / reach)
    with np.errstate(invalid="ignore"):
        nearer = AWAY - seen[:, 2]
        scale = np.where(nearer > 0.05 * AWAY, zoom * AWAY / nearer, np.nan)
    return View(seen[:, :2] * scale[:, None], scale / reach, seen[:, 2])
