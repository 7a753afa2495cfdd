"""Contents of a view at each moment: the particles, their sizes and names. A Stage packs moments into chunks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from kickdrift.model.box.box import Box
from kickdrift.model.molecules.relatives import molecules_of
from kickdrift.model.orbits import G_given, Paths, axes_of, central_row
from kickdrift.model.patch import patch_of
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.model.units.unit_systems import UnitSystem, symbol_of
from kickdrift.plots.bonds import STICK, pairs_of
from kickdrift.view.packing import packed, quantised, scaled, unpacked
from kickdrift.view.sizes import pixels_of, radii_of

MOST_PARTICLES = 50_000  # on a page; a larger system shows every k-th particle
FINE = 500_000  # coordinates outside of a box; up to this number they have 32 bits, beyond it and in a box 16
TOP = 0.998  # part of the values within the range of a colour; the few largest would leave the rest in one colour
FEW = 24  # most bodies with an own colour, trail, ellipse and name
ALIKE = 0.2  # least share of the bodies' angular momenta that adds up in bodies that go round alike
WIDEST = 4.0  # ellipses that reach further than this times the bodies' distances begin outside the view
DIMENSIONS = ("length", "time", "energy", "velocity", "temperature", "mass")


@dataclass(frozen=True)
class Stage:
    """Particles of a view, of which every ``stride``-th is shown.

    Attributes
    ----------
    system : System
        Gives masses, species, names, radii, forces, units and the first box.
    masses, names, species_index : of all rows, which collisions may have made more than the System has
    stride : int
    """

    system: System
    masses: Floats
    names: tuple[str, ...]
    species_index: np.ndarray
    stride: int

    @classmethod
    def of(cls, system: System, masses: Floats | None = None, names: Sequence[str] = (), index: Any = None) -> Stage:
        """Stage of a System, or of a run of this System with other rows."""
        held = system.state.masses if masses is None else masses
        kinds = system.species_index if index is None else index
        stride = -(-len(held) // MOST_PARTICLES)
        return cls(system, held, tuple(names or system.names), np.asarray(kinds), stride)

    @property
    def units(self) -> UnitSystem:
        return self.system.units

    @property
    def charges(self) -> Floats | None:
        """Charges (k,) of the shown rows; None where no particle has one."""
        found = self.system.charges
        return None if found is None or not found.any() else found[self.rows]

    @property
    def rows(self) -> slice:
        """Rows that are shown."""
        return slice(0, len(self.masses), self.stride)

    @property
    def gravity(self) -> float | None:
        """G of the forces, if the bodies attract one another in open space."""
        if patch_of(self.system) is not None:  # the patch turns about a body that is not in it
            return None
        attracts = any("Gravity" in type(force).__name__ for force in self.system.forces)
        return G_given(self.system.forces, self.units) if attracts and not self.system.box.periodic else None

    @property
    def few(self) -> bool:
        """Whether each body has an own colour and name."""
        return self.gravity is not None and len(self.masses) <= FEW

    @property
    def kind(self) -> str:
        """ "box" for a periodic box, "orbits" for a few bodies under gravity, else "open"."""
        return "box" if self.system.box.periodic else "orbits" if self.few else "open"

    def chunk(
        self,
        steps: Sequence[int] | Any,
        times: Sequence[float] | Any,
        positions: Floats,
        velocities: Floats,
        boxes: Sequence[Box] | None = None,
        columns: dict[str, Floats] | None = None,
        held: Floats | None = None,
    ) -> dict[str, Any]:
        """Some moments, packed: what ``append`` of the browser takes.

        Parameters
        ----------
        steps, times : (f,)
        positions, velocities : (f, k, 3) of the shown rows (``rows``); nan for a body that is not there
        boxes : box of each moment; default that of the System
        columns : further numbers (f, k) for colours, by name
        held : masses (f, k); default those of the stage
        """
        x, v = np.asarray(positions, "f8"), np.asarray(velocities, "f8")
        m = self.masses[None, self.rows] if held is None else held
        places = _Places.of(x, boxes or [self.system.box] * len(x))
        bits = 32 if x.size <= FINE and self.kind != "box" else 16
        speed = np.linalg.norm(v, axis=2)
        top = 1.0 if self.few else TOP
        values = {"speed": speed, **(columns or {})}
        if self.charges is not None:
            values["charge"] = np.broadcast_to(self.charges, speed.shape)
        energy = 0.5 * self.units.coherent_mass * m * np.nan_to_num(speed) ** 2
        found: dict[str, Any] = {
            "count": len(x),
            "steps": packed(np.asarray(steps, "f8")),
            "times": packed(np.asarray(times, "f8")),
            "origin": places.origin,
            "matrix": packed(places.matrices),
            "positions": packed(quantised(np.moveaxis(places.parts, 2, 1), bits), delta=True),
            "energy": float(np.quantile(energy, top)) if energy.size else 0.0,  # the browser makes energies from speeds
            "values": {name: _ranged(each, top) for name, each in values.items()},
        }
        if self.few and self.gravity is not None and len(self.masses) > 1:
            paths = Paths(np.asarray(times), x, v, self.masses, np.broadcast_to(m, x.shape[:2]), (), self.gravity,
                          central_row(self.masses))  # fmt: skip
            if paths.central is not None:
                found["ellipses"] = packed(axes_of(paths).astype("f4"))
        return found

    def scene(self, chunks: Sequence[dict[str, Any]], x: Floats, v: Floats, **more: Any) -> dict[str, Any]:
        """The scene of these chunks; x and v (k, 3) are the first moment, which sets sizes and the point of view."""
        system, m = self.system, self.masses[self.rows]
        units = {each: symbol_of(self.units.unit(each)).replace("angstrom", "Å") for each in DIMENSIONS}
        central = central_row(self.masses) if self.few and len(m) > 1 else None
        there = np.isfinite(x[:, 0])
        label = "body" if self.few else "species"
        colours = [{"name": label, "label": label, "unit": "", "kind": "class"}]
        bonds = pairs_of(system) if self.stride == 1 else np.zeros((0, 2), np.int64)
        if len(bonds) and system.topology is not None:
            colours.append({"name": "molecule", "label": "molecule", "unit": "", "kind": "class"})
        first = colours[-1 if len(system.species) == 1 else 0]["name"]
        colours += [
            {"name": name, "label": name, "unit": unit, "kind": "range"}
            for name, unit in (("speed", units["velocity"]), ("kinetic energy", units["energy"]))
        ]
        if self.charges is not None:
            colours.append({"name": "charge", "label": "charge", "unit": self.units.symbol("charge"), "kind": "range"})
        colours += [{**each, "kind": "range"} for each in more.pop("columns", [])]
        radii = radii_of(system, x[there], len(m), self.rows)
        named = self.names or tuple(f"particle {i}" for i in range(len(m))) if self.few else ()
        found: dict[str, Any] = {
            "version": 1,
            "title": system.name,
            "kind": self.kind,
            "flat": system.dimensions == 2,
            "total": len(self.masses),
            "shown": len(m),
            "units": units,
            "species": list(system.species),
            "speciesOf": packed(self.species_index[self.rows].astype("u2")),
            "names": list(named),
            "masses": packed(m * self.units.coherent_mass),
            "bonds": packed(bonds.astype("u4")) if len(bonds) else None,
            "moleculeOf": packed(molecules_of(bonds, len(m)).astype("u4")) if len(bonds) else None,
            "radii": packed((radii * STICK if len(bonds) and system.radii is None else radii).astype("f4")),
            "pixels": packed(pixels_of(m, central, self.kind).astype("f4")),
            "central": central,
            "toScale": not self.few and (system.radii is not None or (self.kind == "box" and not len(bonds))),
            "periodic": list(system.box.periodic_axes) if system.box.periodic else None,
            "up": _up(self, x, v, central),
            "centre": _centre(x[there], central, self.kind, system.box),
            "reach": _reach(x[there], self.kind, system.box, chunks),
            "colours": colours,
            "colour": first,
            "size": 1.0,
            "curves": [],
            "verdict": [],
            "notes": self.notes(),
            "events": [],
            "chunks": list(chunks),
        }
        return found | more

    def notes(self) -> list[str]:
        """Parts that the view leaves out, as text."""
        if self.stride == 1:
            return []
        shown = len(self.masses[self.rows])
        return [f"Shows {shown:,} of {len(self.masses):,} particles: one in {self.stride}."]


@dataclass(frozen=True)
class _Places:
    """Positions as parts of a cell: x = origin + parts @ matrix."""

    parts: Floats  # (f, k, 3), from 0 to 1
    origin: list[float]
    matrices: Floats  # (f, 9), or (1, 9) for all moments

    @classmethod
    def of(cls, x: Floats, boxes: Sequence[Box]) -> _Places:
        """Cell of the box along periodic axes, and the range of the positions along the others."""
        low, high = (edge(x, axis=(0, 1)) if np.isfinite(x).any() else np.zeros(3) for edge in (np.nanmin, np.nanmax))
        open_axes = ~np.array(boxes[0].periodic_axes)
        middle, wide = (low + high) / 2, np.maximum(high - low, 1e-9 * np.maximum(1e-9, np.abs(high)))
        wide = np.maximum(wide, np.max(wide) * 1e-6) * 1.000001
        origin = np.where(open_axes, middle - wide / 2, 0.0)
        same = all(box is boxes[0] or box == boxes[0] for box in boxes)
        matrices = np.array([box.matrix for box in (boxes[:1] if same else boxes)])
        matrices[:, open_axes] = np.diag(wide)[open_axes]
        parts = np.einsum("fnk,fkj->fnj", x - origin, np.broadcast_to(np.linalg.inv(matrices), (len(x), 3, 3)))
        parts[..., ~open_axes] %= 1.0
        return cls(parts, origin.tolist(), matrices.reshape(-1, 9))


def _ranged(values: Floats, top: float) -> dict[str, Any]:
    """Numbers (f, k) for a colour in 8 bits, with their range; ``beyond``: whether larger ones are cut to it."""
    known = values[np.isfinite(values)]
    low, high = (float(known.min()), float(np.quantile(known, top))) if known.size else (0.0, 0.0)
    parts = np.where(np.isfinite(values), scaled(np.nan_to_num(values), low, high), np.nan)
    return {
        "low": low,
        "high": high,
        "beyond": bool(known.max(initial=high) > high),
        "data": packed(quantised(parts, 8), delta=True),
    }


def _up(stage: Stage, x: Floats, v: Floats, central: int | None) -> list[float]:
    """Direction that is up on the page: that of the angular momentum of bodies that go round alike, else z."""
    m = stage.masses[stage.rows]
    each = np.nan_to_num(m[:, None] * np.cross(x, v))
    alike = np.linalg.norm(each.sum(axis=0)) > ALIKE * np.linalg.norm(each, axis=1).sum()
    if stage.gravity is None or len(x) < 2 or not alike:
        return [0.0, 0.0, 1.0]
    paths = Paths(np.zeros(1), x[None], v[None], m, m[None], (), stage.gravity, central)
    axis: list[float] = paths.invariable_axes()[2].tolist()
    return axis


def _centre(x: Floats, central: int | None, kind: str, box: Box) -> list[float]:
    """Point at which the view looks first."""
    middle = (x.min(axis=0) + x.max(axis=0)) / 2 if len(x) else np.zeros(3)
    if kind == "box":
        return np.where(box.periodic_axes, box.matrix.sum(axis=0) / 2, middle).tolist()
    if central is not None or kind == "open":
        return np.zeros(3).tolist() if central is not None else np.median(x, axis=0).tolist()
    return middle.tolist()


def _reach(x: Floats, kind: str, box: Box, chunks: Sequence[dict[str, Any]]) -> float:
    """Radius that the view shows first: the box, nearly all particles, or the bodies and their ellipses."""
    if kind == "box":
        corners = np.where(box.periodic_axes, 1.0, 0.0) @ box.matrix
        open_part = np.ptp(x, axis=0)[~np.array(box.periodic_axes)] if len(x) else np.zeros(0)
        return 0.5 * float(np.hypot(np.linalg.norm(corners), np.linalg.norm(open_part))) or 1.0
    if not len(x):
        return 1.0
    if kind == "open":
        return float(np.quantile(np.linalg.norm(x - np.median(x, axis=0), axis=1), 0.97)) or 1.0
    far = float(np.linalg.norm(x, axis=1).max()) or 1.0
    if chunks and "ellipses" in chunks[0]:
        axes = unpacked(chunks[0]["ellipses"])[0]
        _, a, b = np.split(axes[np.isfinite(axes[:, 0])].astype("f8"), 3, axis=1)
        focal = np.sqrt(np.maximum(np.sum(a * a - b * b, axis=1), 0.0))
        apocentres = np.linalg.norm(a, axis=1) + focal
        far = max(far, min(float(apocentres.max(initial=0.0)), WIDEST * far))
    return far
