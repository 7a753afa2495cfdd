"""Contents of a film: a liquid as spheres in its box, or a few bodies with trails and names."""

import math
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import numpy as np

from kickdrift.analysis.orbits.orbits import gravity_of, paths
from kickdrift.errors import InputError
from kickdrift.model.box.box import Box
from kickdrift.model.molecules.relatives import molecules_of
from kickdrift.model.orbits import Paths, axes_of
from kickdrift.model.patch import patch_of
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.model.units.unit_systems import symbol_of
from kickdrift.plots.bonds import STICK, pairs_of
from kickdrift.plots.drawing import COLOURS, own_matplotlib_folder
from kickdrift.plots.orbits import BODY_COLOURS
from kickdrift.plots.scene import Camera, Scene
from kickdrift.text import clean, measured, shown, suggestion
from kickdrift.trajectory.read import reader
from kickdrift.trajectory.read.universe import topology_of

BODIES = 30  # most bodies under gravity with a trail and a name each
MOST = 20_000  # most spheres; of more particles, evenly chosen ones are shown
COLOURINGS = ("species", "molecule", "speed", "body")
ALONG = np.linspace(0.25, 0.75, 6)  # places of small spheres that make a bond, as parts of it
THIN = 0.45  # their radius, as part of the spheres' at the ends
LOOKS = 12  # frames by which speeds and distances of a whole run are judged
TRAIL = 0.25  # length of a trail, as a share of the film
AROUND = np.linspace(0.0, 2 * math.pi, 181)[:, None]  # eccentric anomalies at which an ellipse is drawn
WIDEST = 4.0  # orbits that reach further than this times the bodies' distances leave the picture


def has_trails(run: reader.Run) -> bool:
    return gravity_of(run) is not None and 1 < len(run.ids) <= BODIES and not run.box.periodic


class Filmed:
    """Shared parts of both kinds of films: rows, notes, colours and the text of the time."""

    def __init__(self, run: reader.Run, rows: list[int], colour: str | None, usual: str | None) -> None:
        with own_matplotlib_folder():
            from matplotlib.colors import is_color_like
        self.run, self.rows, self.notes = run, rows, list[str]()
        self.topology = topology_of(run)
        if usual is None:
            bonded = self.topology is not None and len(self.topology.bonds) > 0
            usual = "species" if len(run.species) > 1 else "molecule" if bonded else "speed"
        self.colouring = usual if colour is None else colour
        if self.colouring not in COLOURINGS and not is_color_like(self.colouring):
            raise InputError(
                f"colour: expected {', '.join(COLOURINGS)} or a colour such as #0072B2, got {shown(colour)}"
                f"{suggestion(str(colour), COLOURINGS)}"
            )

    def fixed_colours(self, kept: Any) -> Floats | None:
        """Colours (n, 3) that do not change; None for those by speed."""
        from matplotlib.colors import to_rgb

        if self.colouring == "speed":
            return None
        ids = np.arange(len(self.run.ids))[kept]
        if self.colouring == "species":
            names = [COLOURS[k % len(COLOURS)] for k in self.run.species_index[kept]]
        elif self.colouring == "molecule":
            bonds = np.zeros((0, 2), np.int64) if self.topology is None else self.topology.bonds
            names = [BODY_COLOURS[k % len(BODY_COLOURS)] for k in molecules_of(bonds, len(self.run.ids))[kept]]
        elif self.colouring == "body":
            names = [BODY_COLOURS[k % len(BODY_COLOURS)] for k in ids]
        else:
            names = [self.colouring] * len(ids)
        return np.array([to_rgb(each) for each in names])

    def by_speed(self, v: Floats, fastest: float) -> Floats:
        """Colours (n, 3) of particles with these velocities (n, 3)."""
        import matplotlib

        found: Floats = matplotlib.colormaps["viridis"](np.linalg.norm(v, axis=1) / fastest)[:, :3]
        return found

    def time_text(self, row: int) -> str:
        """Text of a frame's time."""
        span = float(self.run.all_times[-1] - self.run.all_times[0])
        digits = max(0, 2 - math.floor(math.log10(span))) if span > 0 else 0
        shown_time = f"{float(self.run.all_times[row]):.{min(digits, 12)}f}"
        return f"t = {measured(shown_time, symbol_of(self.run.units.time))}"

    def looks(self) -> list[int]:
        """A few rows, spread over the film."""
        return [self.rows[k] for k in np.unique(np.linspace(0, len(self.rows) - 1, LOOKS).astype(int))]


class Particles(Filmed):
    """Spheres, inside the box where it is periodic, and the bonds between them."""

    def __init__(
        self, run: reader.Run, rows: list[int], size: tuple[int, int], camera: Camera, colour: str | None,
        dark: bool | None,
    ) -> None:  # fmt: skip
        super().__init__(run, rows, colour, None)
        n = len(run.ids)
        self.system: System | None = None
        with suppress(InputError):  # of a force of the user's own, say
            self.system = run.system()
        self.patch = None if self.system is None else patch_of(self.system)
        self.kept = np.linspace(0, n - 1, min(n, MOST)).astype(int)
        if n > MOST:
            self.notes.append(f"the film shows {MOST:,} of {n:,} particles, evenly chosen")
        self.periodic = bool(run.box.periodic)
        looks = [run[k] for k in self.looks()]
        self.colours = self.fixed_colours(self.kept)
        speeds = np.concatenate([np.linalg.norm(each.velocities[self.kept], axis=1) for each in looks])
        self.fastest = float(np.nanquantile(speeds, 0.99)) or 1.0
        if self.periodic:
            self.middle = np.zeros(3)
            corners = [0.5 * np.linalg.norm(np.abs(each.box.matrix).sum(axis=0)) for each in looks]
            reach = 1.04 * float(max(corners))
            room = float(np.prod([edge for edge in np.diag(looks[0].box.matrix) if edge > 0]))
            apart = float(room / n) ** (1 / int(np.count_nonzero(np.diag(looks[0].box.matrix))))
        else:
            x = np.concatenate([self._places(each)[self.kept] for each in looks])
            self.middle = np.nanmedian(x, axis=0)
            far = np.linalg.norm(x - self.middle, axis=1)
            reach = 1.15 * float(np.nanquantile(far, 0.95)) or 1.0
            apart = reach * (1.5 / n ** (1 / 3) if gravity_of(run) is None else 0.012)
        self.bonds = np.zeros((0, 2), np.int64) if self.system is None or n > MOST else pairs_of(self.system)
        self.radii = self._radii(0.5 * apart)
        spheres = len(self.kept) + len(self.bonds) * len(ALONG)
        self.scene = Scene(size, camera, reach, dark=bool(dark), spheres=spheres, boxed=self.periodic)

    def _radii(self, usual: float) -> Floats:
        """Radii of the spheres: the bodies' own, if the system has any, else half the usual distance."""
        own = None if self.system is None else self.system.radii
        if own is not None and len(own) == len(self.run.ids) and np.any(own > 0):
            return np.asarray(own)[self.kept]
        return np.full(len(self.kept), usual * (STICK if len(self.bonds) else 1.0))

    def _with_bonds(self, x: Floats, colours: Floats, box: Box | None) -> tuple[Floats, Floats, Floats]:
        """Places, radii and colours of the spheres, and of small ones along each bond within the box."""
        if not len(self.bonds):
            return x, self.radii, colours
        first, last = self.bonds.T
        between = x[last] - x[first]
        if box is not None:  # a bond that leaves the box would cross the picture
            there = np.linalg.norm(between - box.minimum_image(between), axis=1) < 1e-6 * np.linalg.norm(box.matrix)
            first, last, between = first[there], last[there], between[there]
        places = x[first, None] + ALONG[:, None] * between[:, None]
        thin = THIN * 0.5 * (self.radii[first] + self.radii[last])
        halves = np.where(ALONG[:, None] < 0.5, colours[first, None], colours[last, None])
        return (
            np.concatenate([x, places.reshape(-1, 3)]),
            np.concatenate([self.radii, np.repeat(thin, len(ALONG))]),
            np.concatenate([colours, halves.reshape(-1, 3)]),
        )

    def _places(self, frame: Any) -> Floats:
        """Positions (n, 3) in open space: as they are, or in the patch that repeats."""
        if self.patch is None:
            return np.asarray(frame.positions)
        return self.patch.folded(frame.positions, frame.velocities, frame.time)[0]

    def pictures(self) -> Iterator[Floats]:
        """Picture of each row."""
        for k, row in enumerate(self.rows):
            frame = self.run[row]
            matrix = np.asarray(frame.box.matrix) if self.periodic else None
            x = frame.wrapped() if self.periodic else self._places(frame)
            x = x[self.kept] - (self.middle if matrix is None else matrix.sum(axis=0) / 2)
            if self.colours is None:
                colours = self.by_speed(np.nan_to_num(frame.velocities[self.kept]), self.fastest)
            else:
                colours = self.colours
            share = k / max(len(self.rows) - 1, 1)
            spheres = self._with_bonds(x, colours, frame.box if self.periodic else None)
            yield self.scene.picture(share, *spheres, self.time_text(row), matrix)


class Bodies(Filmed):
    """A few bodies under gravity, with trails and names."""

    def __init__(
        self, run: reader.Run, rows: list[int], size: tuple[int, int], camera: Camera, colour: str | None,
        dark: bool | None,
    ) -> None:  # fmt: skip
        super().__init__(run, rows, colour, "body")
        found = paths(run)
        axes = found.invariable_axes()
        origin = found.positions[:, [found.central]] if found.central is not None else 0.0
        self.x, self.v = (found.positions - origin) @ axes.T, found.velocities @ axes.T
        bodies = self.x.shape[1]
        kept = np.arange(len(run.ids))[:bodies]
        fixed = self.fixed_colours(kept)
        self.fastest = float(np.nanmax(np.linalg.norm(self.v, axis=2))) or 1.0
        self.colours = fixed
        if fixed is not None and found.central is not None and self.colouring == "body":
            fixed[found.central] = (0.98, 0.78, 0.25)
        self.ellipses = _ellipses(found, rows, axes)
        reach = 1.08 * _far(self.x[rows], self.ellipses) or 1.0
        self.radii = np.full(bodies, 0.012 * reach / camera.zoom)
        if found.central is not None:
            self.radii[found.central] *= 1.8
        self.trail = max(math.ceil(TRAIL * (rows[-1] - rows[0])), 1)
        drawn = fixed if fixed is not None else np.full((bodies, 3), 0.6)
        self.scene = Scene(
            size, camera, reach, dark=dark is not False, spheres=bodies, names=[clean(each) for each in found.names],
            trails=list(drawn),
        )  # fmt: skip

    def pictures(self) -> Iterator[Floats]:
        """Picture of each row."""
        for k, row in enumerate(self.rows):
            past = self.x[max(row - self.trail, 0) : row + 1]
            colours = self.by_speed(np.nan_to_num(self.v[row]), self.fastest) if self.colours is None else self.colours
            trails = [past[:, i] for i in range(past.shape[1])]
            share = k / max(len(self.rows) - 1, 1)
            x = self.x[row]
            middle, long, short = self.ellipses[k].swapaxes(0, 1)[:, :, None]
            orbits = [*(x[:, None] + middle + long * np.cos(AROUND) + short * np.sin(AROUND))]
            yield self.scene.picture(share, x, self.radii, colours, self.time_text(row), None, trails, orbits)


def _ellipses(found: Paths, rows: list[int], axes: Floats) -> Floats:
    """Centre and two semi-axes (rows, n, 3, 3) of the bodies' ellipses at these rows; the centre is relative to the
    body. nan without an ellipse."""
    if found.central is None:
        return np.full((len(rows), found.positions.shape[1], 3, 3), np.nan)
    here = {name: getattr(found, name)[rows] for name in ("times", "positions", "velocities", "held")}
    return axes_of(found._replace(**here), central_rests=True).reshape(len(rows), -1, 3, 3) @ axes.T


def _far(x: Floats, ellipses: Floats) -> float:
    """Distance that the picture shows: of the bodies (rows, n, 3), and of their orbits unless these reach much
    further."""
    far = float(np.nanmax(np.linalg.norm(x, axis=2)))
    apocentres = np.linalg.norm(x + ellipses[:, :, 0], axis=2) + np.linalg.norm(ellipses[:, :, 1], axis=2)
    known = apocentres[np.isfinite(apocentres)]
    return max(far, min(float(known.max(initial=0.0)), WIDEST * far))
