"""On cost: how often a step evaluates the force, and what the same number of evaluations buys elsewhere.

Counted by the run itself, per step under way, against published counts and SciPy's; the errors at equal cost against
plain Python loops of the same methods, and SciPy's DOP853.
"""

import math
from collections.abc import Callable

import numpy as np
from scipy.integrate import RK23, RK45, solve_ivp

import kickdrift as kd
from docs.studies.textbooks.article import Claim, Reading, article, magnitude, near
from kickdrift.odes import kepler
from kickdrift_validation.measures import evaluations

ECCENTRICITY, ORBITS, MANY = 0.3, 10, 200
PER_ORBIT = 1200  # evaluations
PER_STEP = 400  # steps an orbit, where steps are equal
EVERY = 37  # steps between looks at the energy
EIGHTH = 600  # of the methods of order 8
PERIOD = 2 * math.pi
YOSHIDA = "Yoshida 1990, doi:10.1016/0375-9601(90)90092-3"
FOREST_RUTH = "Forest & Ruth 1990, doi:10.1016/0167-2789(90)90019-L"
PLAIN = "plain Python loops of both"


def count(text: str, found: float, agrees: bool, published: float, reference: str) -> Reading:
    return Reading(text, found, agrees, f"exactly {published:g}", found == published, reference, "evaluations")


def counts() -> list[Claim]:
    """Claims on the number of evaluations of the splittings."""
    published = {
        "forest-ruth": (3, FOREST_RUTH),
        "yoshida4": (3, f"{YOSHIDA}, eq. 2.11"),
        "yoshida6": (7, f"{YOSHIDA}, table 1, 2 m + 1 with m = 3"),
        "yoshida8": (15, f"{YOSHIDA}, table 2, 2 m + 1 with m = 7"),
    }
    problem, readings = kepler(ECCENTRICITY), []
    for name, (number, reference) in published.items():
        found, _ = evaluations(name, problem)
        readings.append(count(name, found, 6 <= found <= 15, number, reference))
    return article(
        "Forest-Ruth and Yoshida take 6 to 15 evaluations",
        "Those of order 4 take 3, one less than RK4, for the last kick of a step is the first of the next; 7 and 15 "
        "belong to orders 6 and 8.",
        *readings,
    )


def run(name: str, orbits: int, dt: float) -> tuple[float, float]:
    """The error of the position at the end, and the largest of the energy at the steps looked at."""
    problem = kepler(ECCENTRICITY)
    steps = round(PERIOD / dt)
    sim = kd.Simulation(problem, name, dt=PERIOD / steps)
    sim.run(orbits * steps, every=EVERY)
    assert problem.exact is not None
    energies = np.array([sample.energies.total for sample in sim.record.samples])
    place = np.abs(sim.state.y - problem.exact(orbits * PERIOD))[:2].max()
    return float(place), float(np.abs(energies - energies[0]).max())


def pull(y: list[float]) -> tuple[float, float]:
    r3 = math.hypot(y[0], y[1]) ** 3
    return -y[0] / r3, -y[1] / r3


def plain_triple_jump(y: list[float], dt: float) -> list[float]:
    """Three leapfrogs, drift first: Forest and Ruth's."""
    x, z, vx, vz = y
    outer = 1 / (2 - 2 ** (1 / 3))
    for w in (outer, 1 - 2 * outer, outer):
        x, z = x + w * dt / 2 * vx, z + w * dt / 2 * vz
        ax, az = pull([x, z])
        vx, vz = vx + w * dt * ax, vz + w * dt * az
        x, z = x + w * dt / 2 * vx, z + w * dt / 2 * vz
    return [x, z, vx, vz]


def plain_rk4(y: list[float], dt: float) -> list[float]:

    def slope(y: list[float]) -> list[float]:
        return [y[2], y[3], *pull(y)]

    k1 = slope(y)
    k2 = slope([a + dt / 2 * b for a, b in zip(y, k1, strict=True)])
    k3 = slope([a + dt / 2 * b for a, b in zip(y, k2, strict=True)])
    k4 = slope([a + dt * b for a, b in zip(y, k3, strict=True)])
    return [a + dt / 6 * (p + 2 * q + 2 * r + s) for a, p, q, r, s in zip(y, k1, k2, k3, k4, strict=True)]


def plain(step: Callable[[list[float], float], list[float]], orbits: int, dt: float) -> tuple[float, float]:
    """What `run` gives, in plain Python."""
    problem, steps = kepler(ECCENTRICITY), round(PERIOD / dt)
    assert problem.exact is not None
    y, largest = list(problem.y0), 0.0
    for n in range(1, orbits * steps + 1):
        y = step(y, PERIOD / steps)
        if n % EVERY == 0:
            energy = (y[2] ** 2 + y[3] ** 2) / 2 - 1 / math.hypot(y[0], y[1])
            largest = max(largest, abs(energy + 0.5))
    return float(np.abs(np.array(y) - problem.exact(orbits * PERIOD))[:2].max()), largest


def fourth() -> list[Reading]:
    """Forest-Ruth and RK4, where they are and what energy they have: at equal cost, and with equal steps."""
    readings = []
    cost = {"forest-ruth": 3 * PERIOD / PER_ORBIT, "rk4": 4 * PERIOD / PER_ORBIT}
    step = dict.fromkeys(cost, PERIOD / PER_STEP)
    steps = {"forest-ruth": plain_triple_jump, "rk4": plain_rk4}
    for how, dt, orbits, which, what in (
        ("at equal cost", cost, ORBITS, 0, f"position after {ORBITS} orbits"),
        ("at equal cost", cost, MANY, 1, f"energy over {MANY} orbits"),
        ("with equal steps", step, 1, 0, "position after an orbit"),
        ("with equal steps", step, ORBITS, 0, f"position after {ORBITS} orbits"),
    ):
        ours, theirs = (run(name, orbits, dt[name])[which] for name in dt)
        by_hand = [plain(steps[name], orbits, dt[name])[which] for name in dt]
        times = ours / theirs
        text = f"Forest-Ruth's error over RK4's {how}, {what}"
        readings.append(near(text, times, magnitude(times, 1), by_hand[0] / by_hand[1], 1e-3, PLAIN, "times"))
    return readings


def at_cost(costs: list[int], errors: list[float], wanted: float) -> float:
    """The error at that cost, between those measured."""
    order = np.argsort(costs)
    return float(np.exp(np.interp(np.log(wanted), np.log(costs)[order], np.log(errors)[order])))


def eighth() -> Reading:
    """Yoshida 8 against Dormand and Prince's method of order 8, which chooses its steps."""
    problem, length, wanted = kepler(ECCENTRICITY), ORBITS * PERIOD, float(EIGHTH * ORBITS)
    assert problem.exact is not None
    end = np.array(problem.exact(length))[:2]
    found: dict[str, tuple[list[int], list[float]]] = {"ours": ([], []), "scipy": ([], [])}
    for tolerance in (1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11):
        sim = kd.Simulation(problem, "dop853", rtol=tolerance, atol=tolerance)
        cost = sim.run(until=length, interval=length).force_evaluations
        peer = solve_ivp(problem.f, (0.0, length), problem.y0, "DOP853", rtol=tolerance, atol=tolerance)
        for key, evaluated, y in (("ours", cost, sim.state.y), ("scipy", peer.nfev, peer.y[:, -1])):
            found[key][0].append(evaluated)
            found[key][1].append(float(np.abs(y[:2] - end).max()))
    ours, peers = (at_cost(*found[key], wanted) for key in ("ours", "scipy"))
    times = run("yoshida8", ORBITS, 15 * PERIOD / EIGHTH)[0] / ours
    return Reading(
        f"Yoshida 8's error over DOP853's, position after {ORBITS} orbits", times, magnitude(times, 1),
        f"our DOP853 {ours:.2g} is {peers:.2g} to a factor of 5", 0.2 <= ours / peers <= 5.0, "SciPy's DOP853", "times",
    )  # fmt: skip


def power(name: str, dt: float, order: int) -> Reading:
    """Power of dt in the error of the position after an orbit."""
    found = math.log2(run(name, 1, dt)[0] / run(name, 1, dt / 2)[0])
    return near(f"{name}, power of dt in its error", found, round(found) == order, order, 0.05, "its order")


def matches() -> list[Claim]:
    """What they reach with the same number of evaluations; "match" is to half a power of ten."""
    return article(
        "Forest-Ruth and Yoshida … match RK4/RK8",
        "In order they do. At equal cost on a smooth orbit Forest-Ruth is twice as far off as RK4, but keeps the "
        "energy, which RK4 does not. With equal steps Forest-Ruth is 16 times as far off after an orbit and 7 times "
        "after ten. Yoshida 8, whose steps go back and forth, is far behind an embedded RK8.",
        power("forest-ruth", PERIOD / 400, 4),
        power("yoshida8", PERIOD / 80, 8),
        *fourth(),
        eighth(),
    )


def pair(name: str, peer: type[RK23] | type[RK45], said: int) -> list[Reading]:
    """Counted under way, rejected steps included, and in a step by itself whose length is given."""
    sim = kd.Simulation(kepler(0.5), name, dt=0.01, rtol=1e-6, atol=1e-6)
    first = sim.run(1)
    alone, tried = first.force_evaluations, first.steps + first.rejected_steps
    then = sim.run(200, every=200)
    under_way = (then.force_evaluations - alone) / (then.steps + then.rejected_steps - tried)
    scipys = f"stages of SciPy's {peer.__name__}"
    return [
        count("a step under way", under_way, under_way == said, peer.n_stages, scipys),
        count("a step by itself", alone, alone == said, peer.n_stages + 1, f"{scipys} and its error estimate's"),
    ]


def pairs() -> list[Claim]:
    """Dormand and Prince's and Bogacki and Shampine's."""
    return [
        *article(
            "Dormand-Prince has 6 evaluations a step",
            "Seven stages, of which the last is the first of the next step: 6 under way, 7 in a first step.",
            *pair("dormand-prince45", RK45, 6),
        ),
        *article(
            "Bogacki-Shampine has 4 evaluations a step",
            "Four stages, of which the last is the first of the next step: 3 under way. By the counting that gives "
            "Dormand-Prince its 6, it has 3.",
            *pair("bogacki-shampine23", RK23, 4),
        ),
    ]


def claims(long: bool = False) -> list[Claim]:
    return [*counts(), *matches(), *pairs()]
