"""Proper frequencies, secular periods and librating resonances, from a run's frames."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Any

import numpy as np

from kickdrift.analysis.orbits.librations import angle_of, librations
from kickdrift.analysis.orbits.orbits import orbits
from kickdrift.analysis.orbits.secular import Modes, modes, theories
from kickdrift.analysis.orbits.secular_report import OrbitReport, ProperOrbit
from kickdrift.errors import InputError
from kickdrift.model.checks.values import number, whole_number
from kickdrift.model.orbits import Orbits
from kickdrift.model.state import Floats
from kickdrift.model.units.quantities import time_in
from kickdrift.model.units.unit_systems import UnitSystem
from kickdrift.text import counted, shown
from kickdrift.trajectory.read import reader
from kickdrift.trajectory.read.info import warnings_of

LEAST = 64  # frames
FINE = 4  # frames in the shortest secular period of the linear theory
UNEVEN = 1e-6  # of the spacing
ORDER = 4  # largest p - q


def orbit_report(
    run: reader.Run | str | os.PathLike[str],
    frame: str = "jacobi",
    plane: str = "invariable",
    order: int = ORDER,
    until: float | str | None = None,
) -> OrbitReport:
    """Proper frequencies, secular periods and librating resonances of a run's orbits.

    The frequencies g belong to secular modes of the pericentres, and s to modes of the nodes. Each is the strongest
    line of a mode of the linear secular theory (see `kickdrift.frequencies` for the analysis). The errors are some 1e-3
    of ``resolution`` for lines that lie three times ``resolution`` apart or more. Short periods add noise where frames
    are too sparse for them.

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
    units, warnings = _units_and_warnings(run)
    if until is not None:
        last = number(time_in(until, units, "until"))
        if not math.isfinite(last):
            raise InputError(f"until: expected a time, got {shown(until)}")
        ahead = math.copysign(1.0, found.times[-1] - found.times[0])
        count = int(np.count_nonzero(ahead * found.times <= ahead * last))
        if count < min(LEAST, len(found.times)):
            raise InputError(f"until {shown(until)}: {counted(count, 'frame')}; frequencies need {LEAST} or more")
        found = _rows(found, slice(count))
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
        warnings,
    )


def _body(k: int, name: str, found: Orbits, g: Modes, s: Modes) -> ProperOrbit:
    a = float(found.elements.a[:, k].mean())
    period = 2.0 * math.pi * math.sqrt(a**3 / float(found.mu[:, k].mean()))
    numbers = (float(each[k]) for mode in (g, s) for each in (mode.frequencies, mode.amplitudes, mode.expected))
    return ProperOrbit(name, a, period, *numbers)


def _units_and_warnings(run: reader.Run | str | os.PathLike[str]) -> tuple[UnitSystem, list[str]]:
    if isinstance(run, reader.Run):
        return run.units, warnings_of(run)
    with reader.open(run) as opened:
        return _units_and_warnings(opened)


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
