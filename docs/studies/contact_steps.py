"""Do fixed steps find every contact, at its time, whatever the step?

Random systems of a star and one to three pairs of small bodies on circular orbits. The bodies of each pair close, 30 %
of the pairs exactly head-on, and merge within half a time unit. The contacts of each method stand beside those of
gauss-radau15. A run fails if a contact is missing or extra, if its time is wrong by more than 1 % of the step, or if
the energy error exceeds 1 %. Pairs that miss have their least distances beside those of gauss-radau15.
"""

import math
import sys
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

import kickdrift as kd
from kickdrift_validation.claim import Claim, claim, main

METHODS = ("leapfrog", "velocity-verlet", "yoshida4", "forest-ruth", "rk4", "wisdom-holman", "trace", "hermite4")
SHORT, LONG = 40, 2000  # systems
LATE, WRONG = 0.01, 0.01  # largest error of a time, of the step; largest energy error
END, FAR = 1.0, 1.2  # last time of a contact or a closest point, and the end of runs with flybys
FLYBYS, FLYBYS_LONG = 20, 500  # systems


class Drawn(NamedTuple):
    """A system with pairs that meet, and a step for its run."""

    system: kd.System
    dt: float


def drawn(seed: int, part: float | None = None) -> Drawn:
    """The system of a seed. All impact parameters are this ``part`` of the sum of the radii, if it is given."""
    rng = np.random.default_rng(seed)
    masses, radii = [1.0], [0.005]
    places, speeds = [np.zeros(3)], [np.zeros(3)]
    pairs = int(rng.integers(1, 4))
    for pair in range(pairs):
        m, r = 10 ** rng.uniform(-9, -5, 2), 10 ** rng.uniform(-3, -2, 2)
        far, angle = rng.uniform(3, 7), 2 * math.pi * (pair + rng.uniform(0.1, 0.9)) / pairs
        out = np.array([math.cos(angle), math.sin(angle), 0.0])
        along = np.array([-math.sin(angle), math.cos(angle), 0.0])
        closing, time = rng.uniform(0.05, 0.5), rng.uniform(0.05, 0.5)
        aimed = rng.uniform(0.0, 0.5) if rng.uniform() >= 0.3 else 0.0
        way = _turned(rng, out, along)
        side = np.cross(way, (0.0, 0.0, 1.0))
        reach, sideways = r.sum(), (aimed if part is None else part) * r.sum()
        apart = closing * time + math.sqrt(max(0.0, reach**2 - sideways**2))
        offset = apart * way + sideways * side
        centre, speed = far * out, along / math.sqrt(far)
        masses += m.tolist()
        radii += r.tolist()
        places += [centre, centre + offset]
        speeds += [speed, speed - closing * way]
    dt = rng.uniform(0.05, 1.0)
    return Drawn(
        kd.System(
            np.array(places), np.array(speeds), masses, radii=radii, forces=[kd.Gravity()], units="nbody",
            names=["star", *(f"p{k}" for k in range(1, len(masses)))],
        ),
        dt,
    )  # fmt: skip


def _turned(rng: np.random.Generator, out: Any, along: Any) -> Any:
    """A direction in the plane of the orbit."""
    angle = rng.uniform(0, 2 * math.pi)
    return math.cos(angle) * out + math.sin(angle) * along


def contacts_of(drawn: Drawn, method: str, **options: Any) -> tuple[list[tuple[frozenset[str], float]], float]:
    """Contacts of a run to the first step point after ``END``, and the energy error."""
    dt = options.get("dt")
    sim = kd.Simulation(drawn.system, method, events=[kd.Collision()], **options)
    report = sim.run(math.ceil(END / dt)) if dt and method != "hermite4" else sim.run(until=END)
    found = [(frozenset(event["bodies"]), float(event["time"])) for event in report.events]
    assert report.energy is not None
    return [each for each in found if each[1] <= END], float(report.energy.max_relative_error)


def fault(drawn: Drawn, method: str, truth: list[tuple[frozenset[str], float]]) -> str:
    """What is wrong with a run; "" if nothing is."""
    try:
        found, error = contacts_of(drawn, method, dt=drawn.dt)
    except kd.RunError as failed:
        return f"error: {failed}"
    times = dict(truth)
    if len(found) != len(truth) or {pair for pair, _ in found} != set(times):
        return f"{len(found)} of {len(truth)} contacts, or other pairs"
    late = max((abs(time - times[pair]) / drawn.dt for pair, time in found), default=0.0)
    if late > LATE:
        return f"a contact is late by {late:.3g} of the step"
    return f"energy error {error:.3g}" if not error <= WRONG else ""


def faults(seeds: range, methods: tuple[str, ...] = METHODS, tell: bool = False) -> dict[str, int]:
    """Number of runs that fail, by method."""
    failed = dict.fromkeys(methods, 0)
    for seed in seeds:
        each = drawn(seed)
        truth, _ = contacts_of(each, "gauss-radau15")
        for method in methods:
            if wrong := fault(each, method, truth):
                failed[method] += 1
                if tell:
                    print(f"seed {seed}, {method}, dt = {each.dt:.4g}: {wrong}", file=sys.stderr)
    return failed


def passages(drawn: Drawn, method: str, **options: Any) -> dict[frozenset[str], tuple[float, float]]:
    """Least distance of each pair, and its time."""
    dt = options.get("dt")
    sim = kd.Simulation(drawn.system, method, events=[kd.CloseApproach(0.5)], **options)
    report = sim.run(math.ceil(FAR / dt)) if dt and method != "hermite4" else sim.run(until=FAR)
    found: dict[frozenset[str], tuple[float, float]] = {}
    for event in [*report.events, *sim.going_on()]:
        nearest = float(event["distance"]), float(event["time"])
        pair = frozenset(event["bodies"])
        found[pair] = min(found.get(pair, nearest), nearest)
    return found


def flybys(seeds: range, methods: tuple[str, ...] = METHODS) -> Iterator[Claim]:
    """Least distances of pairs that miss each other by 1.01 to 20 times the sum of their radii."""
    errors: dict[str, list[float]] = {method: [] for method in methods}
    for seed in seeds:
        aimed = 10 ** float(np.random.default_rng(seed).uniform(math.log10(1.01), math.log10(20.0)))
        each = drawn(seed, aimed)
        assert each.system.radii is not None
        radius = dict(zip(each.system.names, each.system.radii.tolist(), strict=True))
        truth = passages(each, "gauss-radau15")
        for method in methods:
            found = passages(each, method, dt=each.dt)
            for pair, (distance, time) in truth.items():
                if distance >= sum(radius[body] for body in pair) and time < END:
                    errors[method].append(abs(found.get(pair, (math.inf, 0.0))[0] / distance - 1))
    for method, each_error in errors.items():
        worst = max(each_error, default=math.nan)
        text = f"least distances by {method}: largest relative error of {len(each_error)} flybys"
        yield claim(text, worst, "< 1e-2", worst < 1e-2, "gauss-radau15")


def claims(long: bool = False) -> Iterator[Claim]:
    """Runs that fail, and errors of least distances, for each method."""
    count = LONG if long else SHORT
    for method, failed in faults(range(count), tell=True).items():
        text = f"contacts by {method}: runs with a wrong contact or energy, of {count} systems"
        yield claim(text, failed, "0", failed == 0, "gauss-radau15")
    yield from flybys(range(FLYBYS_LONG if long else FLYBYS))


if __name__ == "__main__":
    main(claims, __doc__)
