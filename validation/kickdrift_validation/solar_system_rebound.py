"""The solar system for a thousand years beside rebound, planet by planet: WHFast and IAS15.

The Sun and eight planets (JPL DE421 at J2000, the Earth with the Moon) as point masses under Newton's law.
wisdom-holman and WHFast (Jacobi coordinates, no corrector) take the same step, a hundredth of Mercury's period;
gauss-radau15 and IAS15 run with their defaults. Two programs that do the same still part: roundings push each planet
along its orbit, by a way that grows as t^1.5. How far that is shows rebound against itself, from starts one rounding
away. --long goes on to 10^5 years. rebound 5: Rein & Liu 2012, doi:10.1051/0004-6361/201118085; Rein & Tamayo 2015,
doi:10.1093/mnras/stv1257; Rein & Spiegel 2015, doi:10.1093/mnras/stu2164.
"""

from importlib.util import find_spec
from pathlib import Path
from time import perf_counter

import numpy as np

import kickdrift as kd
from kickdrift_validation.claim import Claim, claim, main, not_run
from kickdrift_validation.exact_reversal import solar_system
from kickdrift_validation.rebounds import phase, simulation
from kickdrift_validation.wisdom_holman import MERCURY, energy, whfast

YEARS, LONG_YEARS, LOOKS = 1e3, 1e5, 20
LAST = LOOKS // 4  # looks, of which the farthest counts: the ways of roundings cross each other
PLANETS = ("Mercury", "Venus", "Earth", "Mars", "Jupiter", "Saturn", "Uranus", "Neptune")
NUDGES = 2  # runs of rebound's from starts one rounding away
FACTOR = 10.0  # times the farthest of those
SAME_MAP = 0.01  # by which the energy errors of one map, worked out twice, may differ
ENERGY = 10.0  # times IAS15's: both are random walks of roundings
PAIRS = {"wisdom-holman": "WHFast", "gauss-radau15": "IAS15"}


class Track:
    """Positions (looks, n, 3) and relative energy errors (looks,) of a run."""

    def __init__(self, system: kd.System) -> None:
        self.system, self.x, self.errors = system, [], []

    def add(self, x: np.ndarray, v: np.ndarray) -> None:
        self.x.append(np.array(x))
        self.errors.append(energy(self.system, x, v))

    @property
    def error(self) -> float:
        return float(np.abs(self.errors).max())

    def from_sun(self) -> np.ndarray:
        x = np.array(self.x)
        return x[:, 1:] - x[:, :1]


def apart(first: Track, second: Track) -> np.ndarray:
    """(looks, planets): how far each planet is from itself in the other run, of its distance from the Sun."""
    a, b = first.from_sun(), second.from_sun()
    return np.linalg.norm(a - b, axis=2) / np.linalg.norm(b, axis=2)


def nudges(system: kd.System) -> list[kd.System]:
    """The system, and as often as NUDGES with every position one rounding away."""
    found = [system]
    for seed in range(NUDGES):
        x, ups = system.state.positions, np.random.default_rng(seed).integers(0, 2, system.state.positions.shape)
        x = np.where(ups, np.nextafter(x, np.inf), np.nextafter(x, -np.inf))
        found.append(kd.System(x, system.state.velocities, system.state.masses, forces=system.forces, units="astro"))
    return found


def ours(system: kd.System, name: str, years: float) -> Track:
    """Our run, looked at LOOKS times."""
    track, dt = Track(system), MERCURY / 100
    if name == "wisdom-holman":
        each = round(years / LOOKS / dt)
        sim = kd.Simulation(system, name, dt=dt, coordinates="jacobi")
        for _ in range(LOOKS):
            sim.run(each, every=2**40)
            track.add(sim.state.positions, sim.state.velocities)
        return track
    sim = kd.Simulation(system, name)
    for time in np.linspace(0.0, years, LOOKS + 1)[1:]:
        sim.run(until=float(time), every=2**40)
        track.add(sim.state.positions, sim.state.velocities)
    return track


def rebounds(system: kd.System, name: str, years: float) -> Track:
    track, dt = Track(system), MERCURY / 100
    if name == "wisdom-holman":
        each, sim = round(years / LOOKS / dt), whfast(system, dt, "jacobi")
        for _ in range(LOOKS):
            sim.steps(each)
            track.add(*phase(sim))
        return track
    sim = simulation(system, "ias15")
    for time in np.linspace(0.0, years, LOOKS + 1)[1:]:
        sim.integrate(float(time))
        track.add(*phase(sim))
    return track


def compare(system: kd.System, name: str, years: float, figures: Path | None) -> list[Claim]:
    began = perf_counter()
    mine, seconds = ours(system, name, years), perf_counter()
    runs = [rebounds(one, name, years) for one in nudges(system)]
    other, shifted = runs[0], [apart(runs[0], run) for run in runs[1:]]
    distance, rounding = apart(mine, other), np.max(shifted, axis=0)
    peer = PAIRS[name]
    print(f"{name} {seconds - began:.1f} s, {peer} {(perf_counter() - seconds) / len(runs):.1f} s for {years:g} years")
    rows = []
    for k, planet in enumerate(PLANETS):
        off, alone = (float(each[-LAST:, k].max()) for each in (distance, rounding))
        print(f"  {planet:8} {name} and {peer} {off:.1e} of its distance; {peer} and itself {alone:.1e}")
        text = (
            f"{planet}, last quarter of {years:g} years, {name} and {peer}: {off:.1e} of its distance, over rounding's"
        )
        reference = f"rebound's {peer}; from {NUDGES} starts one rounding away it differs from itself by {alone:.1e}"
        rows.append(claim(text, off / alone, f"at most {FACTOR:g}", off <= FACTOR * alone, reference))
    text = f"{name}: largest relative energy error in {years:g} years, {mine.error:.2e}, over {peer}'s"
    ratio = mine.error / other.error
    if name == "wisdom-holman":
        bound, holds = f"1 within {SAME_MAP:g}", abs(ratio - 1.0) <= SAME_MAP
    else:
        bound, holds = f"at most {ENERGY:g}", ratio <= ENERGY
    rows.append(claim(text, ratio, bound, holds, f"rebound's {peer}, {other.error:.2e}"))
    if figures:
        print(draw(figures / f"solar_system_{name}.png", name, years, distance, rounding))
    return rows


def draw(target: Path, name: str, years: float, distance: np.ndarray, rounding: np.ndarray) -> Path:
    """Both over time, four planets."""
    from kickdrift.plots.drawing import COLOURS, new_axes, new_figure, save_figure

    figure = new_figure(8.0, 5.0)
    axes, times = new_axes(figure, (1, 1, 1)), years * np.arange(1, LOOKS + 1) / LOOKS
    for colour, planet in zip(COLOURS, ("Mercury", "Earth", "Jupiter", "Neptune"), strict=False):
        k = PLANETS.index(planet)
        axes.plot(times, distance[:, k], color=colour, linewidth=1.8, label=f"{planet}, {name} and {PAIRS[name]}")
        axes.plot(times, rounding[:, k], color=colour, linewidth=0.9, linestyle="--")
    axes.plot([], [], color="#333333", linewidth=0.9, linestyle="--", label=f"{PAIRS[name]}, starts one rounding apart")
    axes.set_yscale("log")
    axes.set_xscale("log")
    axes.set_xlabel("years")
    axes.set_ylabel("difference of position over distance from the Sun")
    axes.set_title(f"Solar system: {name} beside rebound's {PAIRS[name]}")
    axes.legend(loc="best", fontsize=8, frameon=False)
    return save_figure(figure, target)


def claims(long: bool = False, figures: Path | None = None) -> list[Claim]:
    """A thousand years; ``long`` 10^5. ``figures`` is a folder for the figures."""
    if find_spec("rebound") is None:
        return [not_run("planets beside rebound's", f"at most {FACTOR:g} times rounding", "rebound")]
    system, years = solar_system(), LONG_YEARS if long else YEARS
    return [row for name in PAIRS for row in compare(system, name, years, figures)]


if __name__ == "__main__":
    main(claims, __doc__)
