"""The picture of a film: camera, spheres, box, trails, names and the time. Artists are made once and then moved."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from kickdrift.errors import InputError
from kickdrift.model.checks.values import number
from kickdrift.model.state import Floats
from kickdrift.plots.drawing import new_figure
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


DPI = 100
FOG = 0.45  # share of the background in the colour of the farthest spheres
LEAST = 1.2  # radius of the smallest sphere, in points
# Discs of a sphere, from behind: radius, shift towards the light, and share of black (negative) or white.
SHADES = ((1.0, 0.0, -0.55), (0.93, 0.03, -0.12), (0.62, 0.20, 0.14), (0.22, 0.42, 0.62))
FLAT = 3000  # most spheres with all their shades; more have the first two
NAME = (0.18, 0.045)  # room of a name, in half heights; a name that would cover an earlier one is left out
CORNERS = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)], dtype=float)
EDGES = [(a, b) for a in range(8) for b in range(a) if np.abs(CORNERS[a] - CORNERS[b]).sum() == 1]
DARK, LIGHT = ("#0B0E14", "#E8E8E8"), ("#FFFFFF", "#333333")  # background and ink


class Scene:
    """A figure whose picture changes from frame to frame.

    Parameters
    ----------
    size : width and height in pixels
    camera : where the pictures are taken
    reach : half the height of the picture, in the system's unit of length, at the middle and without a zoom
    dark : whether the background is dark
    spheres : number of spheres
    names : names beside the spheres; () for none
    trails : colours (n, 3) of the trails; () for none
    boxed : whether a box is drawn
    """

    def __init__(
        self, size: tuple[int, int], camera: Camera, reach: float, *, dark: bool, spheres: int,
        names: Sequence[str] = (), trails: Sequence[Any] = (), boxed: bool = False,
    ) -> None:  # fmt: skip
        from matplotlib.collections import LineCollection

        self.size, self.camera, self.reach = size, camera, reach
        background, ink = DARK if dark else LIGHT
        self.figure = new_figure(size[0] / DPI, size[1] / DPI)
        self.figure.set_layout_engine("none")
        self.figure.set_dpi(DPI)
        self.figure.set_facecolor(background)
        axes = self.figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_axis_off()
        axes.set(xlim=(-size[0] / size[1], size[0] / size[1]), ylim=(-1.0, 1.0))
        self._points = 72.0 / DPI * size[1] / 2  # points in half a height
        self._background = np.array(_rgb(background))
        self._shades = np.array(SHADES if spheres <= FLAT else SHADES[:2])
        self._edges = LineCollection([], colors=ink, linewidths=0.8, alpha=0.45, zorder=1)
        self._trails = LineCollection([], colors=list(trails) or ink, linewidths=1.3, alpha=0.7, zorder=2)
        axes.add_collection(self._edges if boxed else LineCollection([]), autolim=False)
        self._orbits = LineCollection([], colors=list(trails) or ink, linewidths=0.8, alpha=0.4, zorder=1.5)
        axes.add_collection(self._trails, autolim=False)
        axes.add_collection(self._orbits, autolim=False)
        self._spheres = axes.scatter(np.zeros(1), np.zeros(1), s=1.0, linewidths=0, zorder=3)
        self._names = [
            axes.text(0, 0, name, color=ink, fontsize=9, zorder=4, parse_math=False, clip_on=True) for name in names
        ]
        corner = -size[0] / size[1] + 0.05
        self._time = axes.text(corner, -0.95, "", color=ink, fontsize=11, zorder=5, parse_math=False)
        self._boxed = boxed

    def picture(
        self, share: float, x: Floats, radii: Floats, colours: Floats, time: str, matrix: Floats | None = None,
        trails: Sequence[Floats] = (), orbits: Sequence[Floats] = (),
    ) -> Floats:  # fmt: skip
        """Picture (height, width, 4) after this share of the film.

        Parameters
        ----------
        share : 0 at the start, 1 at the end
        x : positions (n, 3) relative to the middle of the scene; nan for a body that is gone
        radii, colours : (n,) radii and (n, 3) colours of the spheres
        time : text in the corner
        matrix : (3, 3) edges of the box as rows
        trails : points (k, 3) of each trail
        orbits : points (k, 3) of each body's orbit
        """
        from matplotlib.backends.backend_agg import FigureCanvasAgg

        axes, zoom = self.camera.at(share), self.camera.zoom
        self._move_spheres(x, radii, colours, axes)
        if matrix is not None and self._boxed:
            corners = view((CORNERS - 0.5) @ matrix, axes, self.reach, zoom).xy
            self._edges.set_segments([corners[[a, b]] for a, b in EDGES])
        self._trails.set_segments([view(line, axes, self.reach, zoom).xy for line in trails])
        self._orbits.set_segments([view(line, axes, self.reach, zoom).xy for line in orbits])
        self._time.set_text(time)
        canvas = self.figure.canvas
        assert isinstance(canvas, FigureCanvasAgg)
        canvas.draw()
        found: Floats = np.asarray(canvas.buffer_rgba())
        return found

    def _move_spheres(self, x: Floats, radii: Floats, colours: Floats, axes: Floats) -> None:
        """Draw all discs of the farthest sphere first, and those of the nearest last."""
        seen = view(x, axes, self.reach, self.camera.zoom)
        points = np.maximum(radii * seen.scale * self._points, LEAST)
        fog = FOG * (1 - np.clip((seen.depth + 1) / 2, 0, 1))[:, None] if len(x) > len(self._names) else 0.0
        hazy = colours * (1 - fog) + self._background * fog
        there = np.flatnonzero(np.isfinite(seen.scale))
        order = there[np.argsort(seen.depth[there], kind="stable")]
        size, shift, white = (self._shades[:, k] for k in range(3))
        place = seen.xy[order][:, None] + (points[order, None] * shift / self._points)[..., None] * (-0.6, 0.8)
        towards = np.where(white > 0, 1.0, 0.0)[None, :, None]
        colour = hazy[order][:, None] + (towards - hazy[order][:, None]) * np.abs(white)[None, :, None]
        self._spheres.set_offsets(place.reshape(-1, 2))
        self._spheres.set_sizes(((2 * points[order, None] * size) ** 2).ravel())
        self._spheres.set_facecolor(np.clip(colour, 0, 1).reshape(-1, 3))
        placed: list[Floats] = []
        for text, xy, radius in zip(self._names, seen.xy, points, strict=False):
            at = xy + (radius + 4) / self._points * np.array([0.8, 0.6])
            free = bool(np.isfinite(at[0])) and not any(np.all(np.abs(at - other) < NAME) for other in placed)
            text.set_visible(free)
            if free:
                placed.append(at)
                text.set_position((float(at[0]), float(at[1])))


def _rgb(colour: Any) -> tuple[float, float, float]:
    from matplotlib.colors import to_rgb

    found: tuple[float, float, float] = to_rgb(colour)
    return found
