"""Regular or chaotic: do MEGNO's verdicts agree with those of another program?

Two planets (Jupiter, and Saturn moved to other orbits), asteroids in Jupiter's reach as massless particles, and the
figure-eight, each with one deviation of ours (dop853) and three of rebound's (WHFast; IAS15 where there are encounters
and for the figure-eight, which a Wisdom-Holman map cannot follow). A case counts where rebound's three say the same.
Each is run for 10^4 years, and ten times as long where either side cannot decide yet or rebound's three do not agree:
the secular motion of planets takes that long. The short set has the first planets, for 10^4 years.
Besides, the exponent of Lagrange's triangle against its closed form.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

import kickdrift as kd
from kickdrift.analysis.chaos.report import verdict
from kickdrift_validation.claim import Claim, claim, main, not_run

YEAR = 2 * math.pi  # with G = 1, the Sun's mass and the astronomical unit
LENGTH, LONGER = 1e4 * YEAR, 1e5 * YEAR
SEEDS = (1, 2, 3)
QUICK = 15  # the first of the cases, Saturn with e up to 0.3
AGREED, FEW = 10, 2  # cases of each class, in the long set and in the short one
JUPITER = {"m": 0.000954, "a": 5.204, "e": 0.048, "M": 0.6, "omega": 0.257}
SATURN = {"m": 0.000285, "M": 0.871, "omega": 1.616}
ASTEROID = {"m": 0.0, "e": 0.05, "M": 2.1, "omega": 0.4}
# Chenciner & Montgomery 2000, doi:10.2307/2661357; digits by Simo
EIGHT_X = [[0.97000435669734, -0.24308753153583, 0.0], [-0.97000435669734, 0.24308753153583, 0.0], [0.0, 0.0, 0.0]]
EIGHT_V = [[0.46620368572052, 0.43236573046051, 0.0]] * 2 + [[-0.93240737144104, -0.86473146092102, 0.0]]
REFERENCE = "rebound's, where its three seeds agree"


class Case(NamedTuple):
    """A system as rebound's orbits make it, how rebound runs it, and for how long."""

    name: str
    make: Callable[[Any], Any]  # of the rebound module
    integrator: str = "whfast"
    lengths: tuple[float, ...] = (LENGTH, LONGER)


class Found(NamedTuple):
    """What both say of a case."""

    case: Case
    length: float
    ours: kd.ChaosReport
    theirs: list[float]  # one per seed

    @property
    def theirs_agree(self) -> str | None:
        verdicts = {verdict(value) for value in self.theirs}
        return verdicts.pop() if len(verdicts) == 1 else None

    @property
    def settled(self) -> bool:
        return self.theirs_agree not in (None, "undecided") and self.ours.verdict != "undecided"


def orbits(*bodies: dict[str, float]) -> Callable[[Any], Any]:
    """A star of mass 1 with bodies on orbits about it."""

    def make(rebound: Any) -> Any:
        sim = rebound.Simulation()
        sim.add(m=1.0)
        for body in bodies:
            sim.add(**body)
        sim.N_active = sum(p.m > 0 for p in sim.particles)
        sim.move_to_com()
        return sim

    return make


def figure_eight(rebound: Any) -> Any:
    sim = rebound.Simulation()
    for x, v in zip(EIGHT_X, EIGHT_V, strict=True):
        sim.add(m=1.0, x=x[0], y=x[1], z=x[2], vx=v[0], vy=v[1], vz=v[2])
    return sim


def cases() -> list[Case]:
    found = [
        Case(
            f"Saturn at a = {a}, e = {e}", orbits(JUPITER, SATURN | {"a": a, "e": e}), "ias15" if e > 0.2 else "whfast"
        )
        for e in (0.0, 0.1, 0.2, 0.3, 0.4)
        for a in (7.0, 8.0, 9.0, 9.5)
    ]
    found += [
        Case(f"asteroid at a = {a}", orbits(JUPITER, ASTEROID | {"a": a}), "ias15" if a > 4.2 else "whfast")
        for a in (2.0, 2.5, 3.0, 3.6, 4.2, 4.5, 4.7)
    ]
    return [*found, Case("figure-eight", figure_eight, "ias15", (1000.0,))]


def theirs(rebound: Any, case: Case, length: float, seed: int) -> float:
    sim = case.make(rebound)
    sim.integrator = case.integrator
    if case.integrator == "ias15":
        sim.integrator.adaptive_mode = 1  # its default hangs where an acceleration passes through zero
    sim.dt = 2 * math.pi * JUPITER["a"] ** 1.5 / 100
    sim.init_megno(seed=seed)
    sim.integrate(length, exact_finish_time=0)
    return float(sim.megno())


def ours(rebound: Any, case: Case, length: float) -> kd.ChaosReport:
    bodies = case.make(rebound).particles
    x, v = np.array([body.xyz for body in bodies]), np.array([body.vxyz for body in bodies])
    system = kd.System(x, v, [body.m for body in bodies], forces=[kd.Gravity(G=1.0)], units="nbody", name=case.name)
    return kd.megno(system, length, "dop853", rtol=1e-10, atol=1e-12)


def compared(rebound: Any, chosen: list[Case]) -> list[Found]:
    found = []
    for case in chosen:
        for length in case.lengths:
            last = Found(case, length, ours(rebound, case, length), [theirs(rebound, case, length, s) for s in SEEDS])
            if last.settled:
                break
        found.append(last)
        their = ", ".join(f"{value:8.3f}" for value in last.theirs)
        print(
            f"{case.name:28} {last.length / YEAR:8.0f}  {last.ours.megno:8.3f} {last.ours.verdict:10} {their}  "
            f"{last.theirs_agree or 'disagree':10} {last.ours.energy_error:.0e}",
            flush=True,
        )
    return found


def judged(found: list[Found], least: int = AGREED) -> list[Claim]:
    rows = []
    for each in ("regular", "chaotic"):
        both = sum(row.theirs_agree == row.ours.verdict == each for row in found)
        rows.append(claim(f"{each} cases on which both agree", both, f"{least} or more", both >= least, REFERENCE))
    differ = [row.case.name for row in found if row.theirs_agree not in (None, "undecided", row.ours.verdict)]
    rows.append(claim("cases with another verdict", "; ".join(differ) or "none", "none", not differ, REFERENCE))
    return rows


def triangle() -> list[Claim]:
    """Three equal masses on a circle; s^4 + s^2 + 27/4 (m1 m2 + m2 m3 + m3 m1) / M^2 = 0 (Gascheau 1843; Routh
    1875)."""
    angle = 2 * math.pi * np.arange(3) / 3
    x = np.stack([np.cos(angle), np.sin(angle), 0 * angle], 1)
    v = np.stack([-np.sin(angle), np.cos(angle), 0 * angle], 1)
    system = kd.System(x, v, masses=math.sqrt(3.0), forces=[kd.Gravity(G=1.0)], units="nbody")
    report = kd.megno(system, 28.0, "dop853", rtol=1e-12, atol=1e-13)
    settled = (report.times > 10.0) & (report.times < 26.0)
    slope = float(np.polyfit(report.times[settled], report.growth[settled], 1)[0])
    error = abs(slope * math.sqrt(2.0) - 1.0)
    text = "Lagrange's triangle: relative error of the exponent"
    return [claim(text, error, "at most 1e-3", error < 1e-3, "1 / sqrt 2 of the angular velocity")]


def claims(long: bool = False) -> list[Claim]:
    """Claims on all cases if ``long``, else on the quick cases."""
    rows = triangle()
    try:
        import rebound
    except ImportError:
        return [*rows, not_run("cases with another verdict", "none", REFERENCE)]
    print(f"{'case':28} {'years':>8}  {'ours':>8} {'verdict':10} {'rebound, three seeds':28}  {'verdict':10} energy")
    chosen = cases() if long else [case._replace(lengths=(LENGTH,)) for case in cases()[:QUICK]]
    return [*rows, *judged(compared(rebound, chosen), AGREED if long else FEW)]


if __name__ == "__main__":
    main(claims, __doc__)
