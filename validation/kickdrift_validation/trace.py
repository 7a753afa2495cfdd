"""Is trace the reversible map that rebound's TRACE is, and does it end where TRACE and IAS15 do?

Three giants of about a Jupiter mass between 5 and 9.5 au, which scatter one another; the chaotic exchange orbit of a
massless body inside Jupiter's orbit (Wisdom 2017; Lu, Hernandez & Rein 2024, doi:10.1093/mnras/stae1982); Burrau's
Pythagorean problem. Both programs get the same numbers, steps and switches (3 Hill radii, pericentre "full"). From
the same state, a step of both differs by their inner methods alone; longer runs are chaotic, so samples are compared.
Speeds are processor times in turns. rebound 5.2.2: Rein & Liu 2012, doi:10.1051/0004-6361/201118085.
"""

from collections.abc import Iterator
from time import process_time
from typing import Any

import numpy as np

import kickdrift as kd
from kickdrift.batch import Batch
from kickdrift_validation.claim import INSTALL, Claim, claim, main, not_run
from kickdrift_validation.rebounds import energy, phase, put, simulation

TURN = 2.0 * np.pi  # a year, with G = 1, au and the Sun's mass
DT = 0.4 * TURN
YEARS = 20_000
RADII = [4.65e-3, *[2e-3] * 3]  # au, of the Sun and of giants four times as wide as Jupiter, so that some collide
HEAVY = 0.01  # mass of each giant; some giants leave within 20 000 yr
FAR = 200.0  # au
INNER = ("gauss-radau15", "bulirsch-stoer")
LEAST = {  # speeds over TRACE on a loaded machine
    "gauss-radau15": 2.0,
    "bulirsch-stoer": 2.0,
    "gauss-radau15, in lanes": 3.0,
    "bulirsch-stoer, in lanes": 5.0,
}
TURNS = 40  # systems side by side, between runs of the others
OUTCOMES = ("survival", "ejection", "collision")
SIGNIFICANT = 0.05


def on_orbits(bodies: list[tuple[float, ...]], **given: Any) -> kd.System:
    """A star of mass 1 with bodies (mass, a, e, inc, Omega, omega, M) in radians, from the centre of mass."""
    system = kd.System([[0.0, 0.0, 0.0]], masses=[1.0], forces=[kd.Gravity()], units="nbody")
    for k, (mass, a, e, *angles) in enumerate(bodies):
        inc, node, peri, mean = np.degrees(angles).tolist()
        system = system.with_body(f"b{k}", mass=mass, primary=0, a=a, e=e, inc=inc, Omega=node, omega=peri, M=mean)
    x, v, m = system.state.positions, system.state.velocities, system.state.masses
    return kd.System(x - m @ x / m.sum(), v - m @ v / m.sum(), masses=m, forces=[kd.Gravity()], units="nbody", **given)


def giants(seed: int, **given: Any) -> kd.System:
    """Three giants; the seed sets masses and elements."""
    rng = np.random.default_rng(seed)
    rows = []
    for a in (5.0, 7.25, 9.5):
        mass, e, inc = 1e-3 * rng.uniform(0.5, 1.5), rng.uniform(0.0, 0.1), rng.uniform(0.0, 0.05)
        rows.append((mass, a, e, inc, *rng.uniform(0.0, TURN, 3)))
    return on_orbits(rows, **given)


def packed(seed: int) -> kd.System:
    """Three heavy giants 2.5 mutual Hill radii apart."""
    rng, a, rows = np.random.default_rng(seed), 5.0, []
    width = 2.5 / 2.0 * (2.0 * HEAVY / 3.0) ** (1.0 / 3.0)
    for _ in range(3):
        rows.append((HEAVY, a, rng.uniform(0.0, 0.05), rng.uniform(0.0, 0.03), *rng.uniform(0.0, TURN, 3)))
        a *= (1.0 + width) / (1.0 - width)
    return on_orbits(rows, radii=RADII)


def diver(*forces: Any) -> kd.System:
    """A giant that passes at 0.1 au from the star, and another one."""
    system = on_orbits([(1e-3, 5.0, 0.98, 0.0, 0.0, 0.0, np.pi), (1e-3, 12.0, 0.05, 0.1, 0.0, 0.0, 1.0)])
    return system.with_forces(*system.forces, *forces)


def exchange() -> kd.System:
    """Jupiter on a circle, and a massless body at 4.42 au with 0.0072 au a day."""
    x = np.array([[0.0, 0.0, 0.0], [5.2, 0.0, 0.0], [4.42, 0.0, 0.0]])
    v, m = np.zeros((3, 3)), np.array([1.0, 9.55e-4, 0.0])
    v[1, 1], v[2, 1] = np.sqrt((1.0 + m[1]) / 5.2), 0.0072 * 365.25 / TURN
    turned = x.copy()
    turned[2] = [-4.42, 0.0, 0.0]
    v[2] = -v[2]
    return kd.System(turned - m @ turned / m.sum(), v - m @ v / m.sum(), masses=m, forces=[kd.Gravity()], units="nbody")


def burrau() -> kd.System:
    """Masses 5, 4 and 3 at rest at the corners of a triangle; the heaviest first, as rebound needs."""
    x = [[1.0, -1.0, 0.0], [-2.0, -1.0, 0.0], [1.0, 3.0, 0.0]]
    return kd.System(x, masses=[5.0, 4.0, 3.0], forces=[kd.Gravity()], units="nbody")


def theirs(system: kd.System, dt: float = DT, name: str = "trace") -> Any:
    return simulation(system, name, dt, 1.0)


def jacobi_constant(m: np.ndarray, x: np.ndarray, v: np.ndarray) -> float:
    """Jacobi constant of the massless body; the two other bodies move on circles."""
    r = x[1] - x[0]
    turn = np.cross(r, v[1] - v[0]) / (r @ r)
    potential = m[0] / np.linalg.norm(x[2] - x[0]) + m[1] / np.linalg.norm(x[2] - x[1])
    return float(0.5 * v[2] @ v[2] - potential - turn @ np.cross(x[2], v[2]))


def steps_beside_trace(systems: list[kd.System], steps: int) -> Iterator[Claim]:
    """Steps of both from each state of a run."""
    apart, moved, counts = 0.0, np.zeros((2, 2)), np.zeros(2, int)
    for system in systems:
        m, rebounds = system.state.masses, theirs(system)
        sim, flags = kd.Simulation(system, "trace", dt=DT), (0, 0)
        for _ in range(steps):
            before, after = sim.state, None
            put(rebounds, before)
            sim.run(1)
            rebounds.steps(1)
            after, (x, v) = sim.state, phase(rebounds)
            apart = max(apart, float(np.abs(after.positions - x).max() / np.abs(x).max()))
            pairs, passages = (max(each) for each in zip(flags, sim.integration.stepper.flags, strict=True))
            flags = sim.integration.stepper.flags
            if pairs or passages:
                start, row = energy(m, before.positions, before.velocities), int(passages > 0)
                counts[row] += 1
                ends = energy(m, after.positions, after.velocities), energy(m, x, v)
                moved[row] += [float(abs(end / start - 1)) for end in ends]
    text = f"largest difference of a step from TRACE's, of the largest coordinate, in {len(systems) * steps} steps"
    note = f"TRACE, bulirsch-stoer at 1e-11; {counts[0]} steps with near pairs, {counts[1]} in passages"
    yield claim(text, apart, "at most 1e-9", apart <= 1e-9 and counts.min() > 0, note)
    for row, what in enumerate(("with near pairs", "in pericentre passages")):
        ours, other = moved[row]
        text = f"sum of |dE / E| over steps {what}"
        yield claim(text, ours, "at most TRACE's, to 0.1%", ours <= 1.001 * other, f"TRACE {other:.3e}")


def way_back(long: bool) -> Iterator[Claim]:
    """Steps there and back, against the growth of one rounding."""
    for seed in range(8 if long else 3):
        for inner in INNER:
            system, steps = giants(seed), 800
            m = system.state.masses

            def run(x: Any, v: Any, m: Any = m, inner: str = inner, steps: int = steps) -> kd.State:
                start = kd.System(x, v, masses=m, forces=[kd.Gravity()], units="nbody")
                sim = kd.Simulation(start, "trace", dt=DT, inner=inner)
                sim.run(steps)
                return sim.state

            x, v = system.state.positions, system.state.velocities
            there = run(x, v)
            error = float(np.abs(run(there.positions, -there.velocities).positions - x).max())
            nudged = max(
                float(np.abs(run(x * (1 + k * 2.0**-52), v).positions - there.positions).max()) for k in (-2, 1, 2)
            )
            bound = 100 * nudged
            text = f"giants {seed}, {inner}: {steps} steps there and back"
            note = f"one rounding at the start grows to {nudged:.1e} on the way there"
            yield claim(text, error, "at most 100 times the growth of a rounding", error <= bound, note)


def exchange_orbit() -> Claim:
    """Jacobi's constant over a thousand years."""
    system, dt = exchange(), 8.0 * TURN / 365.25
    m = system.state.masses
    sim, rebounds = kd.Simulation(system, "trace", dt=dt), theirs(system, dt)
    start = jacobi_constant(m, system.state.positions, system.state.velocities)
    errors = []
    for _ in range(450):
        sim.run(100)
        rebounds.steps(100)
        state = sim.state
        both = (state.positions, state.velocities), phase(rebounds)
        errors.append([jacobi_constant(m, *each) / start - 1 for each in both])
    ours, other = np.sqrt((np.array(errors) ** 2).mean(axis=0))
    text = "chaotic exchange orbit, dt = 8 d, 986 yr: RMS error of Jacobi's constant"
    return claim(text, float(ours), "at most TRACE's", bool(ours <= 1.001 * other), f"TRACE {other:.3e}")


def scattered(count: int) -> Iterator[Claim]:
    """Energy errors of a sample, and processor times in turns."""
    from scipy.stats import mannwhitneyu

    steps = int(YEARS * TURN / DT)
    ours = tuple(LEAST)
    errors: dict[str, list[float]] = {name: [] for name in (*ours, "TRACE")}
    times = dict.fromkeys(errors, 0.0)
    kd.Simulation(giants(0), "trace", dt=DT).run(1)
    systems = [giants(seed) for seed in range(count)]
    for seed, system in enumerate(systems):
        if seed % TURNS == 0:
            for name in INNER:
                some = systems[seed : seed + TURNS]
                batch = Batch(some, "trace", DT, inner=name)
                batch.run(1)
                began = process_time()
                batch.run(steps - 1, every=steps)
                times[f"{name}, in lanes"] += process_time() - began
                for each, state in zip(some, batch.states(), strict=True):
                    m = each.state.masses
                    begun = energy(m, each.state.positions, each.state.velocities)
                    error = float(abs(energy(m, state.positions, state.velocities) / begun - 1))
                    errors[f"{name}, in lanes"].append(error)
        m = system.state.masses
        start = energy(m, system.state.positions, system.state.velocities)
        for name in INNER:
            sim = kd.Simulation(system, "trace", dt=DT, inner=name)
            sim.advance(1)
            began = process_time()
            sim.advance(steps - 1)  # without looks, as TRACE
            times[name] += process_time() - began
            errors[name].append(float(abs(energy(m, sim.state.positions, sim.state.velocities) / start - 1)))
        rebounds = theirs(system)
        began = process_time()
        rebounds.steps(steps)
        times["TRACE"] += process_time() - began
        errors["TRACE"].append(float(abs(energy(m, *phase(rebounds)) / start - 1)))
    other = np.array(errors["TRACE"])
    for name in ours:
        found = np.array(errors[name])
        p = float(mannwhitneyu(found, other, alternative="greater").pvalue)
        text = f"{count} scatterings of {YEARS} yr, {name}: median of the energy error"
        note = f"TRACE {np.median(other):.2e}; Mann-Whitney that ours are larger: p = {p:.2f}"
        yield claim(text, float(np.median(found)), "not larger than TRACE's: p > 0.05", p > SIGNIFICANT, note)
        speed, least = times["TRACE"] / times[name], LEAST[name]
        text = f"the same: speed over TRACE, processor time in turns, {name}"
        yield claim(text, round(speed, 2), f"at least {least:g}", speed >= least, "rebound's TRACE")


def pythagorean() -> Iterator[Claim]:
    """Burrau's problem to t = 70."""
    system = burrau()
    m = system.state.masses
    start = energy(m, system.state.positions, system.state.velocities)
    for dt in (0.01, 0.001):
        sim, rebounds, errors = kd.Simulation(system, "trace", dt=dt), theirs(system, dt), []
        for _ in range(70):
            every = round(1.0 / dt)
            sim.run(every)
            rebounds.steps(every)
            both = (sim.state.positions, sim.state.velocities), phase(rebounds)
            errors.append([float(abs(energy(m, *each) / start - 1)) for each in both])
        ours, other = np.array(errors).max(axis=0)
        text = f"Pythagorean problem, dt = {dt:g}, t = 70: largest energy error"
        yield claim(text, float(ours), "at most TRACE's", bool(ours <= other), f"TRACE {other:.2e}")


def test_particles(count: int) -> Iterator[Claim]:
    """The Sun, eight planets and massless bodies between 0.5 and 4 au."""
    rng = np.random.default_rng(1)
    planets = [
        (1.66e-7, 0.387, 0.2), (2.45e-6, 0.723, 0.007), (3.04e-6, 1.0, 0.017), (3.23e-7, 1.52, 0.09),
        (9.55e-4, 5.2, 0.05), (2.86e-4, 9.55, 0.05), (4.37e-5, 19.2, 0.05), (5.15e-5, 30.1, 0.01),
    ]  # fmt: skip
    rows = [(*each, rng.uniform(0.0, 0.03), *rng.uniform(0.0, TURN, 3)) for each in planets]
    rows += [
        (0.0, rng.uniform(0.5, 4.0), rng.uniform(0.0, 0.3), rng.uniform(0.0, 0.2), *rng.uniform(0.0, TURN, 3))
        for _ in range(count)
    ]
    system, dt, steps = on_orbits(rows), 0.012 * TURN, 50
    sim, rebounds, best = kd.Simulation(system, "trace", dt=dt), theirs(system, dt), np.full(2, np.inf)
    sim.run(1)
    rebounds.steps(1)
    for _ in range(4):
        for k, go in enumerate((sim.run, rebounds.steps)):
            began = process_time()
            go(steps)
            best[k] = min(best[k], process_time() - began)
    far = np.abs(sim.state.positions - phase(rebounds)[0]).max(axis=1)
    text = f"Sun, 8 planets, {count} massless: largest difference of a planet after {4 * steps + 1} steps"
    yield claim(text, float(far[:9].max()), "at most 1e-11", bool(far[:9].max() <= 1e-11), "TRACE")
    text = "the same: median difference of a massless body"
    yield claim(text, float(np.median(far[9:])), "at most 1e-12", bool(np.median(far[9:]) <= 1e-12), "TRACE")
    speed = float(best[1] / best[0])
    text = "the same: speed over TRACE, processor time in turns"
    yield claim(text, round(speed, 1), "at least 3, on a loaded machine", speed >= 3.0, "rebound's TRACE")


def outcome(system: kd.System, years: float) -> str:
    """What happens first: an ejection, a collision, or neither in that time."""
    events = [kd.Collision(action="stop"), kd.Escape(FAR, action="stop")]
    report = kd.Simulation(system, "trace", dt=DT, events=events).run(until=years * TURN)
    return "collision" if "touch" in report.stopped else "ejection" if report.stopped else "survival"


def their_outcome(system: kd.System, years: float, name: str) -> str:
    import rebound

    sim = theirs(system, DT if name == "trace" else 0.01, name)
    sim.collision, sim.collision_resolve = "line", "halt"  # "direct" sees only the ends of steps
    m = system.state.masses
    for time in np.arange(20.0, years + 20.0, 20.0) * TURN:
        try:
            sim.integrate(time, exact_finish_time=0)
        except rebound.Collision:
            return "collision"
        x, v = phase(sim)
        if (np.linalg.norm(x, axis=1) > FAR).any():
            far = int(np.argmax(np.linalg.norm(x, axis=1)))
            rest = np.arange(4) != far
            centre, speed = m[rest] @ x[rest] / m[rest].sum(), m[rest] @ v[rest] / m[rest].sum()
            if 0.5 * ((v[far] - speed) ** 2).sum() > m.sum() / np.linalg.norm(x[far] - centre):
                return "ejection"
    return "survival"


def outcomes(count: int, years: float, others: dict[str, str]) -> Iterator[Claim]:
    """Fractions of ejections, collisions and survivals, by a chi-square test of two samples."""
    from scipy.stats import chi2_contingency

    found: dict[str, list[str]] = {name: [] for name in ("trace", *others)}
    for seed in range(count):
        system = packed(seed)
        found["trace"].append(outcome(system, years))
        for other, method in others.items():
            found[other].append(their_outcome(system, years, method))
    table = {name: [each.count(kind) for kind in OUTCOMES] for name, each in found.items()}
    for other in others:
        both = np.array([table["trace"], table[other]])
        p = float(chi2_contingency(both[:, both.any(axis=0)]).pvalue)
        text = f"{count} systems for {years:g} yr: chi-square of outcomes beside {other}, p"
        note = f"survival, ejection, collision: {table['trace']} and {table[other]}"
        yield claim(text, round(p, 3), "above 0.05", p > SIGNIFICANT, note)


def claims(long: bool = False) -> Iterator[Claim]:
    """All comparisons; samples of 1000 with ``long``."""
    try:
        import rebound  # noqa: F401
    except ImportError:
        yield not_run("trace beside rebound's TRACE", "see the other claims", "rebound", INSTALL)
        return
    yield from steps_beside_trace([giants(4), packed(1), diver()], 20_000 if long else 2000)
    yield from way_back(long)
    yield exchange_orbit()
    yield from pythagorean()
    yield from scattered(1000 if long else 40)
    yield from test_particles(1000)
    yield from outcomes(1000 if long else 12, YEARS, {"IAS15": "ias15", "TRACE": "trace"})


if __name__ == "__main__":
    main(claims, __doc__)
