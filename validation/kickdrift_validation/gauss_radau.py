"""Does gauss-radau15 reach what IAS15 reaches: Brouwer's law, and references in binary128?

Energy: Hairer's outer solar system (Hairer, Lubich & Wanner 2006, I.2.4) from 16 starts whose coordinates differ by a
part in 1e15, in the barycentre's frame: in another one rounding grows with the way that the centre of mass has gone.
Root mean square relative energy errors of kickdrift's gauss-radau15 and rebound's IAS15 (its wheel, default settings;
Rein & Spiegel 2015, doi:10.1093/mnras/stu2164) at the same times, energies in extended precision from the states that
both hand out. Where rounding is random they grow as the root of the time (Brouwer 1937, doi:10.1086/105423; Hairer,
McLachlan & Razakarivony 2008, doi:10.1007/s10543-008-0170-3). The long set goes on to 10^8 days.

References: `data/nbody` holds starting values of the figure-eight, the Pythagorean problem, the Pleiades, the outer
solar system and Arenstorf's orbit, their states in binary128 at several times, and by how much IAS15 in double misses
them. Where close encounters multiply what the rounding of the starting values did, no program in double can do better
than some factor of that; all run with default settings.
"""

import json
from importlib.util import find_spec
from time import perf_counter
from typing import Any

import numpy as np

import kickdrift as kd
from kickdrift.odes import arenstorf
from kickdrift_validation.claim import Claim, at_most, claim, largest, main, not_run
from kickdrift_validation.folders import DATA
from kickdrift_validation.rebounds import energy, simulation

NBODY = DATA / "nbody"
NAME = "gauss-radau15"
STARTS, SHORT, LONG, YEAR = 16, 10_000.0, 1e8 / 365.25, 365.25
SHIFT = 1e-15
MOST = 1.2  # times IAS15's energy error
BROUWER, NEAR = 0.5, 0.15  # the power of the time, and how far from it
ENCOUNTERS = 3.0  # times what IAS15 in double misses the reference by, at most; and no better than
ROUNDING = 2e-15
SHIFTED = {"pythagorean_burrau": 5}  # one rounding apart, where close encounters multiply a rounding by 10^10
EPSILON = float(np.finfo(float).eps)


def record(name: str) -> dict[str, Any]:
    """Record of a system in binary128."""
    return json.loads((NBODY / "quad_states.json").read_text(encoding="utf-8"))[name]


def system_of(name: str) -> kd.System:
    found = record(name)
    start = np.array(found["initial_state"], dtype=float).reshape(-1, 6)
    gravity, masses = kd.Gravity(G=float(found["G"])), np.array(found["masses"], dtype=float)
    return kd.System(start[:, :3], start[:, 3:], masses, forces=[gravity], units="nbody", name=name)


def shifted(system: kd.System, count: int) -> list[kd.System]:
    """The system at rest as a whole, from starts a rounding apart."""
    masses, random = system.state.masses, np.random.default_rng(5)
    x, v = (part - masses @ part / masses.sum() for part in (system.state.positions, system.state.velocities))
    return [
        kd.System(x * (1 + SHIFT * random.standard_normal(x.shape)), v, masses, forces=system.forces, units="nbody")
        for _ in range(count)
    ]


def ours(system: kd.System, times: np.ndarray, G: float) -> tuple[np.ndarray, int]:
    """Relative energy errors at the first step points from these times on; steps."""
    sim = kd.Simulation(system, NAME)
    found = [energy(sim.state.masses, sim.state.positions, sim.state.velocities, G)]
    for time in times:
        while sim.time < time:
            sim.run(until=time, every=2**40)
        sim.run(1, every=2**40)  # a step point, and no look between two
        found.append(energy(sim.state.masses, sim.state.positions, sim.state.velocities, G))
    return np.array([float(one / found[0] - 1) for one in found[1:]]), sim.steps_done


def rebounds(system: kd.System, times: np.ndarray, G: float) -> tuple[np.ndarray, int]:
    sim = simulation(system, "ias15", G=G)
    masses = system.state.masses

    def now() -> Any:
        x, v = np.array([p.xyz for p in sim.particles]), np.array([p.vxyz for p in sim.particles])
        return energy(masses, x, v, G)

    found = [now()]
    for time in times:
        sim.integrate(time, exact_finish_time=0)
        found.append(now())
    return np.array([float(one / found[0] - 1) for one in found[1:]]), int(sim.steps_done)


def brouwer(starts: int, years: float) -> list[Claim]:
    """Energy errors over the time."""
    text = f"RMS energy error over {starts} starts"
    if find_spec("rebound") is None:
        return [not_run(text, f"at most {MOST:g} times IAS15's", "rebound")]
    system = system_of("hairer_outer_solar")
    G = float(record("hairer_outer_solar")["G"])
    decades = [decade for decade in (1e2, 1e3, 1e4, 1e5) if decade < 0.999 * years]
    passed = np.array([*decades, years])
    sides = {}
    for name, run in ((NAME, ours), ("IAS15", rebounds)):
        began = perf_counter()
        runs = [run(one, passed * YEAR, G) for one in shifted(system, starts)]
        errors = np.array([found for found, _ in runs])
        sides[name] = np.sqrt((errors**2).mean(axis=0))
        means = ", ".join(f"{m:.1e}" for m in errors.mean(axis=0))
        print(
            f"  {name:14} rms {', '.join(f'{e:.2e}' for e in sides[name])}; mean {means}; {runs[0][1]} steps, "
            f"{perf_counter() - began:.0f} s"
        )
    found = []
    for year, us, them in zip(passed, sides[NAME], sides["IAS15"], strict=True):
        found.append(
            claim(f"{text}, {year:g} years, over IAS15's", us / them, f"at most {MOST:g}", us <= MOST * them, "rebound")
        )
    power = float(np.polyfit(np.log(passed), np.log(sides[NAME]), 1)[0])
    theirs = float(np.polyfit(np.log(passed), np.log(sides["IAS15"]), 1)[0])
    holds = abs(power - BROUWER) <= NEAR
    bound = f"{BROUWER:g} to {NEAR:g}"
    return [*found, claim("power of the time that it grows with", power, bound, holds, f"Brouwer; IAS15: {theirs:.2f}")]


def errors_of(name: str, seed: int) -> list[float]:
    """Largest difference of any coordinate or velocity from the reference, at each time; of the start itself (seed 0),
    or of one whose coordinates are a rounding away."""
    of, system = record(name), system_of(name)
    signs = np.random.default_rng(seed).choice([-1.0, 0.0, 1.0], size=system.state.phase.shape) if seed else 0.0
    sim = kd.Simulation(system.at(system.state.phase * (1.0 + EPSILON * signs), 0.0, 0, system.state.ids), NAME)
    errors = []
    for time, state in zip(of["times"], of["reference_states_quad"], strict=True):
        sim.run(until=float(time), every=2**40)
        wanted = np.array(state, dtype=float).reshape(-1, 6)
        off = abs(sim.state.positions - wanted[:, :3]).max(), abs(sim.state.velocities - wanted[:, 3:]).max()
        errors.append(float(max(off)))
    return errors


def against_binary128() -> list[Claim]:
    """Errors at each time; for Burrau's problem the median over several starts, since one run alone says little."""
    found = []
    for name in ("figure_eight", "pythagorean_burrau", "pleiades", "hairer_outer_solar"):
        of = record(name)
        runs = [errors_of(name, seed) for seed in range(SHIFTED.get(name, 1))]
        errors = np.median(runs, axis=0).tolist()
        errors = errors[: len(of["ias15_double_maxdiff"])]
        theirs = of["ias15_double_maxdiff"]
        print(f"  {name}")
        for time, us, them in zip(of["times"], errors, theirs, strict=False):
            print(f"    t = {float(time):<12.6g} {us:.1e}   IAS15 {them:.1e}")
        bounds = [max(ENCOUNTERS * them, ROUNDING) for them in np.maximum.accumulate(theirs)]
        worst = largest(*(us / bound for us, bound in zip(errors, bounds, strict=True)))
        text = f"{name}: error over {ENCOUNTERS:g} times the largest of IAS15's so far, or {ROUNDING:g}"
        found.append(at_most(text, worst, 1.0, "binary128, Taylor's method"))
    return [*found, arenstorfs()]


def arenstorfs() -> Claim:
    """Over a period with four passages of the Moon's place; before the last time of the file."""
    of = json.loads((NBODY / "arenstorf.json").read_text(encoding="utf-8"))["arenstorf_4loop"]
    sim = kd.Simulation(arenstorf(), NAME)
    errors = []
    for time, state in zip(of["times"], of["states_quad_x_y_vx_vy"], strict=True):
        sim.run(until=float(time))
        errors.append(float(abs(sim.state.y - np.array(state, dtype=float)).max()))
    print(f"  arenstorf: {sim.steps_done} steps, {sim.record.force_evaluations} evaluations")
    for time, us in zip(of["times"], errors, strict=True):
        print(f"    t = {float(time):<12.6g} {us:.1e}")
    amplified = sensitivity(of)
    text = f"arenstorf: error at the period; a start off by 1e-16 ends {amplified:.1e} off"
    return claim(text, errors[-1], f"at most {30 * amplified:.1e}", errors[-1] <= 30 * amplified, "binary128, Taylor")


def sensitivity(of: dict[str, Any]) -> float:
    """How far the end moves where each number of the start moves by its rounding, 1e-16 of it."""
    ends = []
    for factor in (1.0, 1.0 + 1e-9):
        problem = arenstorf()
        moved = kd.Problem(problem.f, problem.y0 * factor, name="arenstorf")
        sim = kd.Simulation(moved, NAME)
        sim.run(until=float(of["times"][-1]))
        ends.append(sim.state.y)
    return float(abs(ends[1] - ends[0]).max()) * 1e-16 / 1e-9


def claims(long: bool = False) -> list[Claim]:
    found = against_binary128()
    years = LONG if long else SHORT
    print(f"energy errors of the outer solar system, {STARTS} starts, to {years:g} years")
    return [*found, *brouwer(STARTS, years)]


if __name__ == "__main__":
    main(claims, __doc__)
