"""Frequency analysis on series of known lines; secular frequencies of the solar system beside Laskar's.

Synthetic series check `kickdrift.frequencies` itself. The outer planets for 5 million years have the frequencies g5 to
g8 and s6 to s8 of La2004 up to the part of the inner planets, whose mass this system puts into the Sun. Pluto librates
in the 3:2 resonance of Neptune.

The long set runs the Sun, eight planets and Pluto with the Sun's 1PN potential for 10^8 years, about an hour on a
core. Its file stays in the folder for temporary files, and a stopped run goes on from there. The motion of the inner
planets is chaotic with a Lyapunov time of 5 million years (Laskar 1989, doi:10.1038/338237a0), so their frequencies
are compared over the first 20 million years, as in La2004's table. Our Earth and Moon are one body.
"""

import math
import tempfile
from importlib.util import find_spec
from pathlib import Path

import numpy as np

import kickdrift as kd
from kickdrift_validation.claim import Claim, claim, largest, main, not_run

SAMPLES, SPACING = 8192, 300.0
ELEMENTS = np.array([12.3, -7.7, 20.1, 16.9, 33.3])  # frequencies in resolution elements
SIZES = np.array([1.0, 0.5, 0.2, 0.05, 0.01])
PHASES = np.array([0.3, 1.2, -2.0, 3.0, 0.1])

PAPER = "Sidlichovsky & Nesvorny 1997"
LA2004 = "Laskar et al. 2004, doi:10.1051/0004-6361:20041335, table 3"
PLANETS = ("Mercury", "Venus", "Earth-Moon", "Mars", "Jupiter", "Saturn", "Uranus", "Neptune")
G = (5.59, 7.452, 17.368, 17.916, 4.257452, 28.2449, 3.087951, 0.673021)  # arcseconds a year
S = (-5.59, -7.05, -18.850, -17.755, 0.0, -26.347855, -2.9925259, -0.691736)
OUTER_YEARS, OUTER_BOUND = 5e6, 5e-3  # the Sun's mass stands for the inner planets
YEARS, DT, EVERY = 1e8, "6 day", 30_437  # a frame every 500 years
WINDOW = 2e7  # years of La2004's frequencies of the inner planets
INNER_BOUND, GIANT_BOUND = 2e-2, 1e-3


def synthetic() -> list[Claim]:
    """Five lines, the nearest 3.2 resolution elements apart."""
    element = 2 * math.pi / (SAMPLES * SPACING)
    times = 1234.5 + SPACING * np.arange(SAMPLES)
    lines = ELEMENTS * element
    z = (SIZES * np.exp(1j * (np.outer(times, lines) + PHASES))).sum(axis=1)
    rows, errors = [], []
    for corrections in (0, 1, 2, 8):
        found = kd.frequencies(z, times, len(lines), corrections=corrections)
        errors.append(largest(*np.abs(found.frequencies - lines)) / element)
        print(f"{corrections} corrections: frequencies off by {errors[-1]:.1e} of a resolution element", flush=True)
        if corrections == 8:
            off = largest(*np.abs(found.amplitudes - SIZES))
            rows.append(claim("five lines: amplitudes", off, "below 1e-11", off < 1e-11, "known lines"))
    gain = errors[0] / errors[1]
    rows.append(claim("the linear correction: error before over after", gain, "above 50", gain > 50, PAPER))
    rows.append(claim("five lines: frequencies, in resolution elements", errors[-1], "below 1e-10", errors[-1] < 1e-10,
                      "known lines"))  # fmt: skip
    text, bound = "a series' lines beside rebound's fmft2, in resolution elements", "below 1e-6"
    if find_spec("rebound") is None:
        return [*rows, not_run(text, bound, "rebound 5")]
    import rebound

    pairs = np.column_stack([z.real, z.imag]).ravel()
    there = rebound.frequency_analysis(pairs, type="fmft2", nfreq=len(lines), minfreq=-0.1, maxfreq=0.1)
    off = largest(*np.abs(np.array(there[0]) / SPACING - found.frequencies)) / element
    return [*rows, claim(text, off, bound, off < 1e-6, "rebound 5")]


def outer() -> list[Claim]:
    """The outer solar system for 5 million years."""
    system = kd.load("outer-solar-system")
    system = system.with_forces(*system.forces, kd.PostNewtonian(form="potential"))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "outer.h5md"
        sim = kd.Simulation(system, "wisdom-holman", dt="100 day", corrector=17)
        sim.run(time=OUTER_YEARS, every=1826, output=path)
        found = kd.analysis.orbit_report(path)
    print(found)
    rows = compared(found, PLANETS[4:], OUTER_BOUND, "outer planets, 5 million years")
    pluto = found.resonances[0]
    centre, swing = math.degrees(pluto.centre), math.degrees(pluto.amplitude)
    rows.append(
        claim("3 λ(Pluto) - 2 λ(Neptune) - ϖ(Pluto): centre, degrees", centre, "180 within 3", abs(centre - 180) < 3,
              "Cohen & Hubbard 1965, doi:10.1086/109674")
    )  # fmt: skip
    rows.append(
        claim("its amplitude, degrees", swing, "75 to 90", 75 < swing < 90, "Cohen & Hubbard 1965: 76 in 120,000 years")
    )
    off = abs(pluto.period / 19_670 - 1)
    rows.append(claim("its period, years", pluto.period, "19670 within 2%", off < 0.02, "Cohen & Hubbard 1965"))
    return rows


def solar(years: float = YEARS, path: Path | None = None) -> list[Claim]:
    """The solar system, from the file of an earlier run if there is one."""
    path = path or Path(tempfile.gettempdir()) / f"kickdrift-solar-system-{years:.0e}.h5md"
    if path.exists():
        sim = kd.resume(path)
        sim.run(until=years, progress=True)
    else:
        system = kd.load("solar-system")
        system = system.with_forces(*system.forces, kd.PostNewtonian(form="potential"))
        sim = kd.Simulation(system, "wisdom-holman", dt=DT, corrector=17)
        sim.run(time=years, every=EVERY, output=path, progress=True)
    with kd.open(path) as run:
        error = run.report["energy"]["max_relative_error"] if run.report else math.nan
        whole = kd.analysis.orbit_report(run)
        early = kd.analysis.orbit_report(run, until=WINDOW) if years > WINDOW else whole
    print(early)
    print(whole)
    span = f"{years:.0e} years"
    rows = [claim(f"the solar system, {span}: energy error", error, "below 1e-9", error < 1e-9, "the start")]
    rows += compared(early, PLANETS[:4], INNER_BOUND, f"inner planets, {min(years, WINDOW):.0e} years")
    return [*rows, *compared(whole, PLANETS[4:], GIANT_BOUND, f"giant planets, {span}")]


def compared(found: kd.analysis.OrbitReport, names: tuple[str, ...], bound: float, text: str) -> list[Claim]:
    """The largest relative distance of g and of s from La2004's."""
    rows = []
    scale = found.rate[0]
    for kind, table in (("g", G), ("s", S)):
        off = [
            abs(getattr(found[name], kind) * scale / there - 1)
            for name, there in zip(PLANETS, table, strict=True)
            if name in names and there
        ]
        rows.append(claim(f"{text}: {kind}, relative", largest(*off), f"below {bound:g}", max(off) < bound, LA2004))
    return rows


def claims(long: bool = False) -> list[Claim]:
    """Synthetic series and the outer planets; the whole system for 10^8 years in the long set only."""
    return [*synthetic(), *outer(), *(solar() if long else [])]


if __name__ == "__main__":
    main(claims, __doc__)
