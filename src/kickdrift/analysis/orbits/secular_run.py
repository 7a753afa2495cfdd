"""Proper frequencies, secular periods and librating resonances, from a run's frames.

Pericentres (g) and nodes (s) turn in each secular mode. An orbit's z = e exp(i varpi) and zeta = sin(inc / 2)
exp(i Omega) are sums over the secular modes of the system. One body alone may be ruled by the mode of another one: the
largest line of Venus is that of Jupiter. So z is first written in the modes of Laplace and Lagrange's linear theory
(Murray & Dermott 1999, Solar System Dynamics, sections 7.4 and 7.7, doi:10.1017/CBO9781139174817). The vectors of these
modes are near the true vectors; the frequencies are not near the true frequencies. Each mode then has one large line,
and frequency analysis finds its frequency (Laskar 1990, doi:10.1016/0019-1035(90)90084-M).
"""

import math
import os
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.analysis.orbits.orbits import orbits
from kickdrift.analysis.orbits.secular_report import OrbitReport, ProperOrbit, angle_of, librations
from kickdrift.errors import InputError
from kickdrift.model.checks.values import number, whole_number
from kickdrift.model.orbits import Orbits
from kickdrift.model.state import Floats
from kickdrift.model.units.quantities import time_in
from kickdrift.model.units.unit_systems import UnitSystem
from kickdrift.statistics.quasi_periodic import frequencies
from kickdrift.text import counted, shown
from kickdrift.trajectory.read import reader
from kickdrift.trajectory.read.info import warnings_of

NODES = 512  # of the integral of Laplace's coefficients
CLOSE = 0.95  # ratio of semi-major axes: the linear theory does not hold for closer orbits
LINES = 6  # of each mode that are looked at; a massless body's own mode is its strongest line
RESONANT = 1e-3  # least distance of a massless body from a mode of the planets, relative
LEAST = 64  # frames
FINE = 4  # frames in the shortest secular period of the linear theory
UNEVEN = 1e-6  # of the spacing
ORDER = 4  # largest p - q


class Modes(NamedTuple):
    """Secular modes of one kind, one for each body (m,), named after the body whose orbit it rules most.

    ``frequencies`` are in radians per unit of time, nan where the series is too short. ``amplitudes`` (m,) are those in
    the orbit of the body itself. ``expected`` are the frequencies of the linear theory. ``still`` marks the mode of the
    nodes that the conservation of angular momentum keeps at rest.
    """

    frequencies: Floats
    amplitudes: Floats
    expected: Floats
    still: NDArray[np.bool_]


class Theory(NamedTuple):
    """Linear secular theory: the matrix (m, m) of z' = i A z, weights that make it symmetric, and massive bodies."""

    matrix: Floats
    weights: Floats
    massive: NDArray[np.bool_]


def laplace(j: int, alpha: Floats) -> Floats:
    """Laplace's coefficients b_{3/2}^(j)(alpha); the trapezoidal rule is exact to rounding for a periodic function."""
    psi = 2.0 * math.pi * np.arange(NODES) / NODES
    a = np.asarray(alpha, dtype=float)[..., None]
    found: Floats = 2.0 * (np.cos(j * psi) / (1.0 - 2.0 * a * np.cos(psi) + a * a) ** 1.5).mean(axis=-1)
    return found


def theories(found: Orbits, masses: Floats) -> tuple[Theory, Theory]:
    """The linear theories of pericentres and of nodes, for the mean semi-major axes; ``masses`` (m,) are over the
    central mass."""
    a, mu = found.elements.a.mean(axis=0), found.mu.mean(axis=0)
    motion = np.sqrt(mu / a**3)
    massive = masses > 0
    planets = np.flatnonzero(massive)
    outwards = a[None, planets] / a[:, None]
    alpha = np.minimum(outwards, 1.0 / outwards)
    near = alpha > CLOSE
    safe = np.where(near, 0.5, alpha)
    strength = 0.25 * motion[:, None] * masses[None, planets] * safe * np.where(outwards > 1.0, safe, 1.0)
    pull, across = np.zeros((2, len(a), len(a)))
    pull[:, planets] = np.where(near, 0.0, strength * laplace(1, safe))
    across[:, planets] = np.where(near, 0.0, strength * laplace(2, safe))
    turning = np.diag(pull.sum(axis=1))
    weights = np.sqrt(masses * np.sqrt(mu * a))
    return Theory(turning - across, weights, massive), Theory(pull - turning, weights, massive)


def modes(z: NDArray[np.complex128], times: Floats, theory: Theory, nodes: bool) -> Modes:
    """Modes of the series z (k, m) of bodies; one mode of the ``nodes`` stays at rest."""
    m = z.shape[1]
    u, expected = _in_modes(z, theory)
    still = np.zeros(m, dtype=bool)
    if nodes and theory.massive.sum() > 1:  # the direction of the total angular momentum
        still[np.argmin(np.where(theory.massive, np.abs(expected), np.inf))] = True
    element = 2.0 * math.pi / (len(times) * (times[-1] - times[0]) / (len(times) - 1))
    lines = np.where(theory.massive, LINES, 1)
    spectra = [None if still[i] else frequencies(u[:, i], times, int(lines[i])) for i in range(m)]
    w = np.full(m, np.nan)
    w[still] = 0.0
    strength = [spectrum.amplitudes[0] if spectrum and len(spectrum.amplitudes) else 0.0 for spectrum in spectra]
    taken: list[float] = []
    for i in np.argsort(strength)[::-1]:
        spectrum = spectra[i]
        if spectrum is None:
            continue
        own = theory.massive[i]
        for line in spectrum.frequencies.tolist():
            if abs(line) >= element and not (own and any(abs(line - other) < element for other in taken)):
                w[i] = line
                taken += [line] if own else []
                break
            if abs(line) < element:
                break  # the strongest line is slower than the series is long
    return Modes(w, _amplitudes(z, times, w), expected, still)


def _in_modes(z: NDArray[np.complex128], theory: Theory) -> tuple[NDArray[np.complex128], Floats]:
    """The series in the modes of the linear theory, and their frequencies there, in the order of the bodies.

    A massless body has its own z less what the planets force (Murray & Dermott, section 7.10)."""
    from scipy.optimize import linear_sum_assignment

    matrix, weights, massive = theory
    u, expected = z.copy(), np.diag(matrix).copy()
    planets = np.flatnonzero(massive)
    if not len(planets):
        return u, expected
    d = weights[planets]
    symmetric = d[:, None] * matrix[np.ix_(planets, planets)] / d[None, :]
    rates, vectors = np.linalg.eigh(0.5 * (symmetric + symmetric.T))
    bodies, order = linear_sum_assignment(-(vectors**2))  # a mode for each body: the one that it shares most
    assert np.array_equal(bodies, np.arange(len(planets)))
    rates, vectors = rates[order], vectors[:, order]
    amplitudes = (d * z[:, planets]) @ vectors
    u[:, planets], expected[planets] = amplitudes / d, rates
    for i in np.flatnonzero(~massive):
        apart = rates - expected[i]
        resonant = np.abs(apart) < RESONANT * np.abs(rates).max()
        forced = (matrix[i, planets] / d) @ vectors / np.where(resonant, np.inf, apart)
        u[:, i] -= amplitudes @ forced
    return u, expected


def _amplitudes(z: NDArray[np.complex128], times: Floats, w: Floats) -> Floats:
    """Amplitude of each body's own mode in its own series, by least squares on the modes of all massive bodies."""
    found = np.full(len(w), np.nan)
    known = np.flatnonzero(np.isfinite(w))
    if len(known) > len(times) // 4:  # many massless bodies: each with its own line alone
        for i in known:
            found[i] = abs(np.mean(z[:, i] * np.exp(-1j * w[i] * times)))
        return found
    lines = np.exp(1j * np.outer(times - times[0], w[known]))
    fitted = np.linalg.lstsq(lines, z[:, known], rcond=None)[0]
    found[known] = np.abs(np.diag(fitted))
    return found


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
