"""Proper frequencies, secular periods and librating resonances of a run's orbits.

Two bodies with mean motions near p : q have the angles p lambda' - q lambda - j1 varpi' - j2 varpi - j3 Omega' - j4
Omega with j1 + j2 + j3 + j4 = p - q and j3 + j4 even (d'Alembert's rules; Murray & Dermott 1999, Solar System Dynamics,
section 6.7, doi:10.1017/CBO9781139174817). Primed quantities are those of the outer body. An angle librates if a part
of the circle stays empty while the angle crosses its centre again and again.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from kickdrift.analysis.doubts import warning_lines
from kickdrift.display.showing import Lines, Shown, Table, above
from kickdrift.errors import InputError
from kickdrift.model.orbits import Orbits
from kickdrift.model.state import Floats
from kickdrift.model.units.unit_systems import UnitSystem
from kickdrift.statistics.quasi_periodic import frequencies
from kickdrift.text import measured

NEAR = 0.03  # largest distance of a period ratio from p / q, relative
MOST = 12  # largest p
EMPTY = math.radians(20)  # least empty part of the circle
CHANCE = 14.0  # -ln of the chance that so large a part stays empty at random
CROSSINGS = 4  # least ways from beyond half the amplitude on one side to beyond it on the other
SPARSE = 4.0  # least frames in a period of libration for the period to be known
FLAT = 1e-8  # an orbit with a smaller e has no pericentre, with a smaller sin(inc / 2) no node
ARCSEC = math.degrees(1.0) * 3600.0
SHOWN = 30  # most bodies, and most resonances, in a table


class Resonance(NamedTuple):
    """A resonant angle that librates.

    ``p`` and ``q`` multiply the mean longitudes of ``outer`` and ``inner``. ``powers`` (j1, j2, j3, j4) multiply varpi
    and Omega of the outer body and of the inner body, in the order varpi', varpi, Omega', Omega. ``centre`` and
    ``amplitude`` are in radians; the amplitude is half the range of the angle. ``period`` is nan if the frames are too
    sparse.
    """

    inner: str
    outer: str
    p: int
    q: int
    powers: tuple[int, int, int, int]
    centre: float
    amplitude: float
    period: float

    @property
    def angle(self) -> str:
        """The angle in letters, such as "3 λ(Pluto) - 2 λ(Neptune) - ϖ(Pluto)"."""
        letters = (f"ϖ({self.outer})", f"ϖ({self.inner})", f"Ω({self.outer})", f"Ω({self.inner})")
        terms = [f"{_times(self.p)}λ({self.outer})", f"- {_times(self.q)}λ({self.inner})"]
        terms += [f"- {_times(j)}{name}" for j, name in zip(self.powers, letters, strict=True) if j]
        return " ".join(terms)


def _times(factor: int) -> str:
    return "" if factor == 1 else f"{factor} "


def powers(order: int) -> Iterator[tuple[int, int, int, int]]:
    """All j1 to j4 of an order that d'Alembert's rules allow; none is negative."""
    for j1, j2, j3, j4 in product(range(order + 1), repeat=4):
        if j1 + j2 + j3 + j4 == order and (j3 + j4) % 2 == 0:
            yield j1, j2, j3, j4


def librations(found: Orbits, masses: Floats, order: int) -> list[Resonance]:
    """Angles that librate in all pairs with a massive body, up to an order p - q; the smallest amplitude of each pair
    first."""
    at = found.elements
    motion = np.sqrt(found.mu / np.abs(at.a) ** 3).mean(axis=0)
    round_, level = at.e.max(axis=0) < FLAT, np.abs(np.sin(0.5 * at.inc)).max(axis=0) < FLAT
    resonances: list[Resonance] = []
    ranks = np.argsort(-motion)
    for i, j in ((i, j) for k, i in enumerate(ranks) for j in ranks[k + 1 :] if masses[i] or masses[j]):
        undefined = np.array([round_[j], round_[i], level[j], level[i]])
        kept: list[Resonance] = []
        for p, q in ratios(motion[i] / motion[j], order):
            for each in powers(p - q):
                if not np.any(undefined & (np.array(each) > 0)):
                    one = Resonance(found.names[i], found.names[j], p, q, each, math.nan, math.nan, math.nan)
                    if (swing := libration(angle_of(found, one), found.times)) is not None:
                        kept.append(one._replace(centre=swing[0], amplitude=swing[1], period=swing[2]))
        resonances += sorted(kept, key=lambda one: one.amplitude)
    return resonances


def angle_of(found: Orbits, one: Resonance) -> Floats:
    """The angle (k,) of a resonance, in radians, of any size."""
    at, j, i = found.elements, found.names.index(one.outer), found.names.index(one.inner)
    angle = np.zeros(len(found.times))
    for k, factor, of_pericentre, of_node in ((j, one.p, *one.powers[::2]), (i, -one.q, *one.powers[1::2])):
        varpi = at.Omega[:, k] + at.omega[:, k]
        angle += factor * (varpi + at.M[:, k]) - of_pericentre * varpi - of_node * at.Omega[:, k]
    return angle


def ratios(ratio: float, order: int) -> list[tuple[int, int]]:
    """Numbers p > q without a common factor, p - q up to ``order``, whose ratio is near a ratio of mean motions."""
    return [
        (p, p - k)
        for k in range(1, order + 1)
        for p in range(k + 1, MOST + 1)
        if math.gcd(p, k) == 1 and abs(ratio * (p - k) / p - 1.0) < NEAR
    ]


def libration(angle: Floats, times: Floats) -> tuple[float, float, float] | None:
    """Centre, amplitude and period of an angle (k,) in radians; None if the angle circulates or hardly moves."""
    ordered = np.sort(angle % (2.0 * math.pi))
    gaps = np.diff(ordered, append=ordered[0] + 2.0 * math.pi)
    widest = int(gaps.argmax())
    empty, others = float(gaps[widest]), np.delete(gaps, widest)
    least = 2.0 * math.pi * (math.log(len(angle)) + CHANCE) / len(angle)
    if empty < max(EMPTY, least) or others.max() > 0.5 * empty:
        return None
    centre = float(ordered[widest] + 0.5 * empty + math.pi) % (2.0 * math.pi)
    swing = (angle - centre + math.pi) % (2.0 * math.pi) - math.pi
    amplitude = math.pi - 0.5 * empty
    if np.count_nonzero(np.diff(np.sign(swing[np.abs(swing) > 0.5 * amplitude]))) < CROSSINGS:
        return None
    line = frequencies(swing - swing.mean(), times, 1).frequencies
    spacing = (times[-1] - times[0]) / (len(times) - 1)
    period = 2.0 * math.pi / abs(float(line[0])) if len(line) and line[0] else math.nan
    return centre, amplitude, period if period > SPARSE * spacing else math.nan


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
    warnings : what is wrong with the run, from its file
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
    warnings: list[str] = field(default_factory=list)

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
            "warnings": self.warnings,
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
        rows = [
            [b.name, f"{b.a:.6g}", *_cells(b.g, b.g_period, b.g_amplitude, b.g_expected, scale),
             *_cells(b.s, b.s_period, b.s_amplitude, b.s_expected, scale)]
            for b in self.bodies[:SHOWN]
        ]  # fmt: skip
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
        if len(self.bodies) > SHOWN:
            lines.append(("bodies", f"{len(self.bodies):,}, of which the table shows {SHOWN}; --json has all"))
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
        return lines + warning_lines(self.warnings)


def _known(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _periods(body: ProperOrbit) -> dict[str, float]:
    return {"g_period": body.g_period, "s_period": body.s_period}


def _cells(w: float, period: float, amplitude: float, expected: float, scale: float) -> list[str]:
    if math.isnan(w):
        return [f"~ {expected * scale:.2g}", "> run", "–"]
    return [f"{w * scale:.6g}", "–" if math.isinf(period) else f"{period:.5g}", f"{amplitude:.2g}"]
