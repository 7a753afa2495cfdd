"""Do systems of three planets in lanes last as long as in rebound's TRACE, and at what cost?

Three planets of 1e-5 of the star's mass on circles, as far apart as 3.5 to 6 mutual Hill radii, with random phases (as
in Chambers, Wetherill & Boss 1996, doi:10.1006/icar.1996.0019). A system is unstable with the first encounter within
one Hill radius. Both programs have 20 steps in the first period of the innermost planet, the same switches and the same
contact: bodies with half a Hill radius touch. TRACE takes some of the systems that the lanes take: lifetimes spread
over orders of magnitude, most by the spacing. With ``--long`` TRACE also takes 200 systems of its own seeds, so that
the two samples are independent. Their number and seeds were fixed before the first run. Processor times are taken in
turns. rebound 5.2.2: Rein & Liu 2012, doi:10.1051/0004-6361/201118085.
"""

from collections.abc import Iterator
from time import process_time
from typing import Any

import numpy as np

import kickdrift as kd
from kickdrift.batch import Batch
from kickdrift_validation.claim import INSTALL, Claim, claim, main, not_run
from kickdrift_validation.trace import SIGNIFICANT, TURN, on_orbits, theirs

MASS = 1e-5
STEPS = 20  # in a period of the innermost planet
DT = TURN / STEPS
WIDER = 2.0  # factor of radii in rebound's search, whose contacts are tried again
WARM = 2_000_000  # first seed of the systems that only compile the code
OWN = 5_000_000  # first seed of the systems that only TRACE takes
TOUCH = kd.Collision(action="stop")


def three_planets(seed: int, nearest: float, farthest: float) -> kd.System:
    """Three planets; the seed sets phases and their common spacing, in mutual Hill radii between two numbers."""
    rng = np.random.default_rng(seed)
    hill = (2.0 * MASS / 3.0) ** (1.0 / 3.0)
    width, a, rows, radii = 0.5 * hill * rng.uniform(nearest, farthest), 1.0, [], [0.0]
    for _ in range(3):
        rows.append((MASS, a, 0.0, 0.0, 0.0, 0.0, rng.uniform(0.0, TURN)))
        radii.append(0.5 * hill * a)
        a *= (1.0 + width) / (1.0 - width)
    return on_orbits(rows, radii=radii, events=[TOUCH])


def in_lanes(systems: list[kd.System], orbits: int) -> tuple[np.ndarray, float]:
    """Numbers of orbits until the first encounter, at most ``orbits``, and the processor time."""
    batch = Batch(systems, "trace", DT)
    steps = orbits * STEPS
    began = process_time()
    batch.run(steps, every=steps)
    return batch.time / TURN, process_time() - began


def closest(one: Any, other: Any, length: float) -> float:
    """Smallest distance of two bodies in the last step, back from its end along their polynomials of degree three: with
    the attraction by the star and by each other, and its change by the star."""
    s = np.linspace(0.0, length, 200)[:, None]
    way, pull = np.zeros((200, 3)), []
    for sign, body in ((1.0, one), (-1.0, other)):
        x, v = np.array(body.xyz), np.array(body.vxyz)
        r = float(np.linalg.norm(x))
        jerk = -v / r**3 + 3.0 * (x @ v) * x / r**5
        way += sign * (x - s * v - s * s * x / (2.0 * r**3) - s**3 * jerk / 6.0)
        pull.append(x)
    d = pull[0] - pull[1]
    return float(np.linalg.norm(way - s * s * MASS * d / np.linalg.norm(d) ** 3, axis=1).min())


def beside(system: kd.System, orbits: int) -> tuple[float, float]:
    """The same of one system by rebound's TRACE.

    Its search of contacts takes straight lines, whose error is half a Hill radius here. So its bodies are wider, and
    each contact that it finds is tried again."""
    sim: Any = theirs(system, DT)
    assert system.radii is not None
    radii = system.radii
    for body, radius in zip(sim.particles, radii, strict=True):
        body.r = WIDER * radius
    met = []

    def check(pointer: Any, contact: Any) -> int:
        here, i, j = pointer.contents, contact.p1, contact.p2
        if min(i, j) > 0 and closest(here.particles[i], here.particles[j], here.dt) <= radii[i] + radii[j]:
            met.append(here.t)
            here.stop()
        return 0

    sim.collision, sim.collision_resolve = "line", check
    began = process_time()
    sim.integrate(orbits * TURN, exact_finish_time=0)
    return (met[0] if met else sim.t) / TURN, process_time() - began


def lifetimes(
    count: int, others: int, turns: int, nearest: float, farthest: float, orbits: int, own: int = 0
) -> Iterator[Claim]:
    """``count`` systems in lanes and ``others`` of them by TRACE, in some turns; then ``own`` others by TRACE."""
    from scipy.stats import ks_2samp, wilcoxon

    in_lanes([three_planets(WARM + seed, 2.5, 3.0) for seed in range(16)], 300)  # compiles; some meet
    ours: list[float] = []
    other: list[float] = []
    both = range(0, count, count // others)[:others]
    spent = np.zeros(2)
    for turn in range(turns):
        seeds = range(count * turn // turns, count * (turn + 1) // turns)
        found, seconds = in_lanes([three_planets(seed, nearest, farthest) for seed in seeds], orbits)
        ours += found.tolist()
        spent[0] += seconds
        for seed in both[len(other) : others * (turn + 1) // turns]:
            time, seconds = beside(three_planets(seed, nearest, farthest), orbits)
            other.append(time)
            spent[1] += seconds
    most = 0.999999 * orbits
    same, alone = np.minimum([ours[seed] for seed in both], most), np.minimum(other, most)
    p = float(ks_2samp(same, alone).pvalue)
    paired = float(wilcoxon(np.log(same) - np.log(alone)).pvalue)
    what = f"three planets for {orbits:,} orbits, {count} in lanes and {others} by TRACE"
    medians = f"median {np.median(same):.3g} and {np.median(alone):.3g} orbits"
    stable = f"survivors {(same == most).mean():.0%} and {(alone == most).mean():.0%}"
    note = f"{medians}; {stable}; Wilcoxon of pairs p = {paired:.2f}"
    yield claim(f"{what}: KS test of the instability times, p", round(p, 3), "above 0.05", p > SIGNIFICANT, note)
    each = spent / [count, others]
    ratio = float(each[1] / each[0])
    note = f"{1e3 * each[0]:.3g} ms in lanes, {1e3 * each[1]:.3g} ms by TRACE"
    yield claim(
        f"{what}: processor time of a system, TRACE over lanes", round(ratio, 1), "at least 10", ratio >= 10, note
    )
    step = spent / [sum(ours), sum(other)] / STEPS
    speed = float(step[1] / step[0])
    note = f"{1e9 * step[0]:.0f} ns a step in lanes, {1e9 * step[1]:.0f} ns by TRACE"
    yield claim(
        f"{what}: processor time of a step, TRACE over lanes", round(speed, 1), "at least 10", speed >= 10, note
    )
    if own:
        apart = [beside(three_planets(OWN + seed, nearest, farthest), orbits)[0] for seed in range(own)]
        everyone, apart = np.minimum(ours, most), np.minimum(apart, most)
        p = float(ks_2samp(everyone, apart).pvalue)
        what = f"three planets for {orbits:,} orbits, {count} in lanes and {own} of other seeds by TRACE"
        medians = f"median {np.median(everyone):.3g} and {np.median(apart):.3g} orbits"
        note = f"{medians}; survivors {(everyone == most).mean():.0%} and {(apart == most).mean():.0%}"
        yield claim(f"{what}: KS test of the instability times, p", round(p, 3), "above 0.05", p > SIGNIFICANT, note)


def claims(long: bool = False) -> Iterator[Claim]:
    """A short sample, and with ``long`` 1000 systems for 10^6 orbits, and 200 of other seeds by TRACE."""
    try:
        import rebound  # noqa: F401
    except ImportError:
        yield not_run("three planets beside rebound's TRACE", "see the other claims", "rebound", INSTALL)
        return
    if long:
        yield from lifetimes(1000, 100, 5, 3.5, 6.0, 1_000_000, 200)
    else:
        yield from lifetimes(128, 40, 4, 4.5, 6.0, 60_000)


if __name__ == "__main__":
    main(claims, __doc__)
