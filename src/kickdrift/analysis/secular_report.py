"""Proper frequencies, secular periods and librating resonances of a run's orbits."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from kickdrift.analysis.librations import Resonance, angle_of, librations
from kickdrift.analysis.orbits import orbits
from kickdrift.analysis.secular import Modes, modes, theories
from kickdrift.display.showing import Lines, Shown, Table, above
from kickdrift.errors import InputError
from kickdrift.model.checks import number, whole_number
from kickdrift.model.orbits import Orbits
from kickdrift.model.state import Floats
from kickdrift.model.unit_systems import UnitSystem
from kickdrift.model.units import time_in
from kickdrift.text import counted, measured, shown
from kickdrift.trajectory import reader

LEAST = 64  # frames
FINE = 4  # frames in the shortest secular period of the linear theory
UNEVEN = 1e-6  # of the spacing
ORDER = 4  # largest p - q
ARCSEC = math.degrees(1.0) * 3600.0
SHOWN = 30  # most resonances in a table


class ProperOrbit(NamedTuple):
    """Secular motion of one body's orbit. Frequencies are in radians per unit of time.

    ``g`` and ``s`` are the proper frequencies of pericentre and node, nan where the period is longer than the run.
    ``g_amplitude`` and ``s_amplitude`` are the amplitudes of these modes in e exp(i varpi) and sin(inc / 2) exp(i
    Omega). ``g_expected`` and ``s_expected`` are the frequencies of the linear secular theory.
    """

    name: str
    a: float
    period: float
    g: float
    g_amplitude: float
    g_expected: float
    s: float
    s_amplitude: float
    s_expected: float

    @property
    def g_period(self) -> float:
        """2 pi / |g|; infinite for an orbit that keeps its pericentre."""
        return 2.0 * math.pi / abs(self.g) if self.g else math.inf

    @property
    def s_period(self) -> float:
        """2 pi / |s|; infinite for the mode that the conservation of angular momentum keeps at rest."""
        return 2.0 * math.pi / abs(self.s) if self.s else math.inf


@dataclass(frozen=True, eq=False, repr=False)
class OrbitReport(Shown):
    """Secular and resonant motion of a run's orbits.

    Attributes
    ----------
    path : Path of the run
    bodies : a `ProperOrbit` for each body that keeps its ellipse to the end, in the bodies' order
    resonances : a `Resonance` for each angle that librates
    left_out : names of bodies that were removed or absorbed, or left their ellipses
    times : (k,) of the frames
    z, zeta : (k, m) e exp(i varpi) and sin(inc / 2) exp(i Omega) of the bodies
    angles : a (k,) series in radians for each of the resonances
    frame, plane : reference frame and plane
    resolution : 2 pi over the length of the run, in radians per unit of time
    units : UnitSystem
    """

    path: Path
    bodies: tuple[ProperOrbit, ...]
    resonances: tuple[Resonance, ...]
    left_out: tuple[str, ...]
    frame: str
    plane: str
    resolution: float
    units: UnitSystem
    times: Floats = field(repr=False)
    z: Any = field(repr=False)
    zeta: Any = field(repr=False)
    angles: tuple[Floats, ...] = field(repr=False)

    def __repr__(self) -> str:
        return str(self)

    def __getitem__(self, name: str) -> ProperOrbit:
        for body in self.bodies:
            if body.name == name:
                return body
        raise InputError(f"no body {name!r} in this report; expected one of {', '.join(b.name for b in self.bodies)}")

    def as_json(self) -> dict[str, Any]:
        """The report as one JSON object, without the series. Angles are in radians; what is not known is null."""
        return {
            "file": str(self.path),
            "frame": self.frame,
            "plane": self.plane,
            "frames": len(self.times),
            "length": float(self.times[-1] - self.times[0]),
            "time_unit": self.units.time,
            "resolution": self.resolution,
            "bodies": [
                {key: _known(value) for key, value in (body._asdict() | _periods(body)).items()} for body in self.bodies
            ],
            "resonances": [
                {"angle": one.angle} | {key: _known(value) for key, value in one._asdict().items()}
                for one in self.resonances
            ],
            "left_out": list(self.left_out),
        }

    def plot(self) -> Any:
        """Draw z and zeta of the bodies, their lines over frequency, and angles that librate; a matplotlib Figure."""
        return above("orbit report figure")(self)

    @property
    def rate(self) -> tuple[float, str]:
        """Factor from radians per unit of time to the unit of tables and figures, and that unit: arcseconds a year for
        runs in years."""
        if self.units.time == "yr":
            return ARCSEC, '"/yr'
        return 1.0, f"rad/{self.units.symbol('time') or 'time'}"

    def _tables(self) -> list[Table]:
        scale, unit = self.rate
        time = measured("period", f"({self.units.symbol('time')})" if self.units.symbol("time") else "")
        columns = ["body", "a", f"g ({unit})", time, "in e", f"s ({unit})", time, "in sin(i/2)"]
        rows = [[b.name, f"{b.a:.6g}", *_cells(b.g, b.g_period, b.g_amplitude, b.g_expected, scale),
                 *_cells(b.s, b.s_period, b.s_amplitude, b.s_expected, scale)] for b in self.bodies]  # fmt: skip
        tables: list[Table] = [("Proper frequencies", columns, rows)]
        if self.resonances:
            columns = ["resonance", "angle that librates", "centre (deg)", "amplitude (deg)", time]
            rows = [
                [f"{one.p}:{one.q}", one.angle, f"{math.degrees(one.centre):.1f}", f"{math.degrees(one.amplitude):.1f}",
                 "–" if math.isnan(one.period) else f"{one.period:.5g}"]
                for one in self.resonances[:SHOWN]
            ]  # fmt: skip
            tables.append(("Resonances", columns, rows))
        return tables

    def _lines(self) -> Lines:
        length = measured(f"{self.times[-1] - self.times[0]:.6g}", self.units.symbol("time"))
        lines = [("frames", f"{len(self.times):,} over {length}; elements {self.frame}, plane {self.plane}")]
        if not self.resonances:
            lines.append(("resonances", "no angle librates"))
        elif len(self.resonances) > SHOWN:
            lines.append(("resonances", f"{len(self.resonances)} angles librate; --json has all"))
        slow = [b for b in self.bodies if math.isnan(b.g) or math.isnan(b.s)]
        if slow:
            rates = [
                abs(w) for b in slow for w, known in ((b.g_expected, b.g), (b.s_expected, b.s)) if math.isnan(known)
            ]
            longest = 2.0 * math.pi / least if (least := min((w for w in rates if w > 0), default=0.0)) else math.inf
            names = ", ".join(b.name for b in slow[:6]) + (", …" if len(slow) > 6 else "")
            need = (
                f"; run for about {measured(f'{3 * longest:.2g}', self.units.symbol('time'))}"
                if longest < math.inf
                else ""
            )
            lines.append(("too short for", f"{names}: a secular period is longer than the run{need}"))
        if self.left_out:
            lines.append(("left out", f"{', '.join(self.left_out)}: removed, absorbed or not on an ellipse"))
        return lines


def _known(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _periods(body: ProperOrbit) -> dict[str, float]:
    return {"g_period": body.g_period, "s_period": body.s_period}


def _cells(w: float, period: float, amplitude: float, expected: float, scale: float) -> list[str]:
    if math.isnan(w):
        return [f"~ {expected * scale:.2g}", "> run", "–"]
    return [f"{w * scale:.6g}", "–" if math.isinf(period) else f"{period:.5g}", f"{amplitude:.2g}"]


def orbit_report(
    run: reader.Run | str | os.PathLike[str],
    frame: str = "jacobi",
    plane: str = "invariable",
    order: int = ORDER,
    until: float | str | None = None,
) -> OrbitReport:
    """Proper frequencies, secular periods and librating resonances of a run's orbits.

    The frequencies g and s are those of the secular modes: of the direction of pericentre and of the node. Each is the
    strongest line of a mode of the linear secular theory (see `kickdrift.frequencies` for the analysis). The errors are
    some 1e-3 of ``resolution`` for lines apart by three times as much, and short periods that the frames sample too
    sparsely add noise.

    Parameters
    ----------
    run : a run's file, open or by its path
    frame : origin of the orbits: "jacobi" (in the order of the file), "heliocentric" or "barycentric"
    plane : "invariable", perpendicular to the total angular momentum, or "file", the x-y plane
    order : largest p - q of a resonance of mean motions p : q
    until : last time to use, in the run's unit or with a unit such as "20 Myr"; default the end of the run

    Raises
    ------
    InputError
        For a run without orbits, with too few frames, or with frames that are not evenly spaced.
    """
    order = whole_number("order", order, 1)
    path = Path(run.path if isinstance(run, reader.Run) else run)
    found = orbits(run, frame, plane)
    if not len(found.names):
        raise InputError(f"{path}: one body; orbits need two or more")
    units = _units(run)
    if until is not None:
        last = number(time_in(until, units, "until"))
        if not math.isfinite(last):
            raise InputError(f"until: expected a time, got {shown(until)}")
        ahead = math.copysign(1.0, found.times[-1] - found.times[0])
        found = _rows(found, slice(int(np.count_nonzero(ahead * found.times <= ahead * last))))
    found = _even(path, found)
    if found.times[0] > found.times[-1]:  # a run back in time
        found = _rows(found, slice(None, None, -1))
    ellipses = np.asarray((np.nan_to_num(found.elements.e, nan=2.0) < 1.0).all(axis=0))
    if not ellipses.any():
        raise InputError(f"{path}: no body stays on an ellipse to the end")
    left_out = tuple(name for name, kept in zip(found.names, ellipses, strict=True) if not kept)
    found, masses = _chosen(found, ellipses), _masses(run, found.names)[ellipses]
    at = found.elements
    z = at.e * np.exp(1j * (at.Omega + at.omega))
    zeta = np.sin(0.5 * at.inc) * np.exp(1j * at.Omega)
    of_g, of_s = theories(found, masses)
    _check_frames(path, found.times, max(_fastest(of_g.matrix), _fastest(of_s.matrix)))
    resonances = tuple(librations(found, masses, order))
    g, s = modes(z, found.times, of_g, nodes=False), modes(zeta, found.times, of_s, nodes=True)
    return OrbitReport(
        path,
        tuple(_body(k, name, found, g, s) for k, name in enumerate(found.names)),
        resonances,
        left_out,
        frame,
        plane,
        2.0 * math.pi / float(found.times[-1] - found.times[0]),
        units,
        found.times,
        z,
        zeta,
        tuple(angle_of(found, one) for one in resonances),
    )


def _body(k: int, name: str, found: Orbits, g: Modes, s: Modes) -> ProperOrbit:
    a = float(found.elements.a[:, k].mean())
    period = 2.0 * math.pi * math.sqrt(a**3 / float(found.mu[:, k].mean()))
    numbers = (float(each[k]) for mode in (g, s) for each in (mode.frequencies, mode.amplitudes, mode.expected))
    return ProperOrbit(name, a, period, *numbers)


def _units(run: reader.Run | str | os.PathLike[str]) -> UnitSystem:
    if isinstance(run, reader.Run):
        return run.units
    with reader.open(run) as opened:
        return opened.units


def _masses(run: reader.Run | str | os.PathLike[str], names: tuple[str, ...]) -> Floats:
    """Masses of all bodies but the central one, over the central mass."""
    if not isinstance(run, reader.Run):
        with reader.open(run) as opened:
            return _masses(opened, names)
    central = int(np.argmax(run.masses))
    return np.asarray(np.delete(run.masses, central) / run.masses[central])


def _even(path: Path, found: Orbits) -> Orbits:
    """Orbits at evenly spaced times: without a last frame that comes early, as at the end of a run."""
    times = found.times
    if len(times) < LEAST:
        raise InputError(f"{path}: {counted(len(times), 'frame')}; frequencies need {LEAST} or more: lower --every")
    spacing = float(np.median(np.diff(times)))
    if not math.isclose(times[-1] - times[-2], spacing, rel_tol=UNEVEN):
        found = _rows(found, slice(None, -1))
    off = np.abs(found.times - np.linspace(found.times[0], found.times[-1], len(found.times))) / abs(spacing)
    if off.max() > UNEVEN:
        raise InputError(
            f"{path}: frames are not evenly spaced in time (frame {int(off.argmax())}); run with fixed steps, or with "
            "--interval"
        )
    return found


def _rows(found: Orbits, rows: slice) -> Orbits:
    elements = type(found.elements)(*(each[rows] for each in found.elements))
    return Orbits(found.times[rows], found.names, elements, found.mu[rows])


def _chosen(found: Orbits, kept: Any) -> Orbits:
    elements = type(found.elements)(*(each[:, kept] for each in found.elements))
    names = tuple(name for name, keep in zip(found.names, kept, strict=True) if keep)
    return Orbits(found.times, names, elements, found.mu[:, kept])


def _fastest(matrix: Floats) -> float:
    return float(np.abs(np.diag(matrix)).max())


def _check_frames(path: Path, times: Floats, fastest: float) -> None:
    """Raise InputError if frames are too sparse for the fastest secular mode."""
    length = float(times[-1] - times[0])
    needed = math.ceil(FINE * length * fastest / (2.0 * math.pi))
    if len(times) < needed:
        raise InputError(f"{path}: {len(times)} frames are too few; the fastest secular period needs {needed} or more")
