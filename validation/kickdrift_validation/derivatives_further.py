"""Second derivatives, derivatives by orbital elements, maps with other forces, and Lyapunov spectra.

Second derivatives: heyoka's variational equations of order 2, whose start by orbital elements comes from formulas in
mpmath. The tangent map of wisdom-holman with other forces and kernels: is it symplectic, and what does a direction
cost? Lyapunov spectra: Lorenz's published one, and sums of exponents that the divergence of the flow gives.
"""

from collections.abc import Iterator
from time import process_time
from typing import Any

import numpy as np

import kickdrift as kd
from kickdrift_validation.claim import Claim, at_most, claim, largest, main, not_run
from kickdrift_validation.derivatives import MASSES, cost_of_a_direction, planets

ELEMENTS = {"a": 1.1, "e": 0.2, "inc": 20.0, "Omega": 50.0, "omega": 100.0, "M": 130.0}
SETS = {
    "a, e, inc, Omega, omega, M, mass": ("a", "e", "inc", "Omega", "omega", "M", "mass"),
    "P, h, k, ix, iy, lambda, mass": ("P", "h", "k", "ix", "iy", "lambda", "mass"),
}
LORENZ = (0.9056, 0.0, -14.5723)  # Sprott 2003, Chaos and Time-Series Analysis, appendix A
TIME = 5.0


def claims(long: bool = False) -> Iterator[Claim]:
    yield from second()
    yield from maps(long)
    yield from costs()
    yield from spectra(long)


def second() -> Iterator[Claim]:
    texts = ["second derivatives of three bodies after 5 units of time by starts and masses, relative to the largest"]
    texts += [
        f"first and second derivatives by {name} of a planet, each column relative to its largest" for name in SETS
    ]
    bound, reference = "at most 1e-11", "heyoka's variational equations of order 2, with orbits in mpmath"
    try:
        import heyoka
        import mpmath
    except ImportError:
        for text in texts:
            yield not_run(text, bound, reference, "pip install heyoka mpmath")
        return
    with mpmath.workdps(40):
        start = in_mpmath(mpmath, list(ELEMENTS), [mpmath.mpf(value) for value in ELEMENTS.values()])
    x = np.array([[0.0, 0.0, 0.0], start[:3], [-1.9, 0.1, 0.0]], dtype=float)
    v = np.array([[0.0, 0.0, 0.0], start[3:], [0.0, -0.7, 0.05]], dtype=float)
    system = kd.System(x, v, MASSES, forces=[kd.Gravity(G=1.0)], units="nbody", names=["star", "b", "c"])
    first, twice = by_heyoka(heyoka, system)
    yield from second_of_maps(system, twice)
    found = kd.transition_matrix(system, TIME, "gauss-radau15", masses=True, second=True)
    assert found.second is not None
    value = float(np.abs(found.second - twice).max() / np.abs(twice).max())
    yield claim(texts[0], value, bound, value <= 1e-11, reference)
    for text, keys in zip(texts[1:], SETS.values(), strict=True):
        ours = kd.transition_matrix(system, TIME, "gauss-radau15", elements=[f"b.{key}" for key in keys], second=True)
        assert ours.by_elements is not None
        assert ours.second is not None
        inner, outer = orbit_slopes(mpmath, system, keys)  # of the start and the mass
        one = first @ inner
        two = np.einsum("rij,ik,jl->rkl", twice, inner, inner) + np.einsum("ri,ikl->rkl", first, outer)
        value = largest(
            float((np.abs(ours.by_elements - one).max(axis=0) / np.abs(one).max(axis=0)).max()),
            float((np.abs(ours.second - two).max(axis=0) / np.abs(two).max(axis=0)).max()),
        )
        yield claim(text, value, bound, value <= 1e-11, reference)


def second_of_maps(system: kd.System, twice: np.ndarray) -> Iterator[Claim]:
    """Maps differ from the motion by the square of their step, and agree with differences of their own matrices."""
    size = np.abs(twice).max()

    def ours(name: str, dt: float, moved: float = 0.0, second: bool = True) -> kd.TransitionMatrix:
        x = system.state.positions.copy()
        x[1, 0] += moved
        there = kd.System(x, system.state.velocities, MASSES, forces=system.forces, units="nbody")
        return kd.transition_matrix(there, TIME, name, dt, masses=True, second=second)

    for name, bound in (("wisdom-holman", 1e-6), ("saba", 1e-11), ("trace", 1e-5)):
        errors = [float(np.abs(ours(name, dt).second - twice).max() / size) for dt in (0.02, 0.01)]
        text = f"{name}: second derivatives of three bodies by starts and masses, dt = 0.01, relative to the largest"
        yield at_most(text, errors[1], bound, "heyoka's variational equations of order 2")
        if name != "saba":  # which reaches rounding
            power = float(np.log2(errors[0] / errors[1]))
            text = f"{name}: power of dt of this difference"
            yield claim(text, power, "2 within 0.1", abs(power - 2.0) <= 0.1, "a method of order 2 for small steps")
        h = 2e-4
        one, two = (
            (_whole(ours(name, 0.05, k * h, False)) - _whole(ours(name, 0.05, -k * h, False))) / (2 * k * h)
            for k in (1, 2)
        )
        wanted = (4 * one - two) / 3
        value = float(np.abs(ours(name, 0.05).second[:, :, 3] - wanted).max() / np.abs(wanted).max())
        text = f"{name}: second derivatives by a planet's x and all starts and masses, dt = 0.05"
        yield claim(text, value, "at most 1e-9", value <= 1e-9, "differences of order 4 of the method's own matrix")


def _whole(found: kd.TransitionMatrix) -> np.ndarray:
    assert found.by_masses is not None
    return np.hstack([found.matrix, found.by_masses])


def by_heyoka(heyoka: Any, system: kd.System) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives (18, 21) and (18, 21, 21) by starts and masses, in the order of a TransitionMatrix."""
    masses = [heyoka.par[i] for i in range(3)]
    equations = heyoka.model.nbody(3, masses=masses, Gconst=1.0)
    varied = heyoka.var_ode_sys(equations, [variable for variable, _ in equations] + masses, order=2)
    start = np.concatenate([system.state.positions, system.state.velocities], axis=1).ravel()
    run = heyoka.taylor_adaptive(varied, start, pars=MASSES, compact_mode=True)
    run.propagate_until(TIME)
    first, twice = run.state[run.get_vslice(order=1)].reshape(18, 21), np.zeros((18, 21, 21))
    places = run.get_vslice(order=2)
    for place in range(places.start, places.stop):
        row, *orders = run.get_mindex(place)
        one, two = (k for k, order in enumerate(orders) for _ in range(order))
        twice[row, one, two] = twice[row, two, one] = run.state[place]
    rows = [6 * body + 3 * half + k for half in range(2) for body in range(3) for k in range(3)]
    columns = [*rows, 18, 19, 20]
    return first[np.ix_(rows, columns)], twice[np.ix_(rows, columns, columns)]


def orbit_slopes(mpmath: Any, system: kd.System, keys: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives (21, k) and (21, k, k) of all starts and masses by elements of planet b: differences in 40 digits."""
    with mpmath.workdps(40):
        x, v = (rows[:, 1] - rows[:, 0] for rows in system.state.phase)
        known = orbit_in_mpmath(mpmath, [mpmath.mpf(float(value)) for value in (*x, *v)])
        at, h = [known[key] for key in keys], mpmath.mpf(10) ** -12

        def moved(*steps: tuple[int, int]) -> np.ndarray:
            values = list(at)
            for k, sign in steps:
                values[k] += sign * h
            return np.array(in_mpmath(mpmath, list(keys), values))

        count = len(keys)
        inner, outer = np.zeros((21, count)), np.zeros((21, count, count))
        rows = [3 * (3 * half + 1) + axis for half in range(2) for axis in range(3)]
        for i in range(count):
            inner[rows, i] = ((moved((i, 1)) - moved((i, -1))) / (2 * h)).astype(float)
            for j in range(count):
                mixed = (
                    moved((i, 1), (j, 1)) - moved((i, 1), (j, -1)) - moved((i, -1), (j, 1)) + moved((i, -1), (j, -1))
                )
                outer[rows, i, j] = (mixed / (4 * h * h)).astype(float)
        inner[19, [k for k, key in enumerate(keys) if key == "mass"]] = 1.0
    return inner, outer


def in_mpmath(mpmath: Any, keys: list[str], values: list[Any]) -> list[Any]:
    """Position and velocity of planet b relative to the star (Murray & Dermott 1999, chapter 2), angles in degrees."""
    of = dict(zip(keys, values, strict=True))
    mu, turn = 1 + of.get("mass", mpmath.mpf(MASSES[1])), mpmath.pi / 180
    if "h" in of:
        e, tilt = mpmath.hypot(of["h"], of["k"]), mpmath.hypot(of["ix"], of["iy"])
        inc, node, whole = 2 * mpmath.asin(tilt / 2), mpmath.atan2(of["iy"], of["ix"]), mpmath.atan2(of["h"], of["k"])
        pericentre, mean = whole - node, of["lambda"] * turn - whole
    else:
        e, inc, node, pericentre, mean = of["e"], *(of[key] * turn for key in ("inc", "Omega", "omega", "M"))
    a = of["a"] if "a" in of else mpmath.cbrt(mu * (of["P"] / (2 * mpmath.pi)) ** 2)
    anomaly = mean
    for _ in range(60):
        anomaly -= (anomaly - e * mpmath.sin(anomaly) - mean) / (1 - e * mpmath.cos(anomaly))
    n, b, r = mpmath.sqrt(mu / a**3), mpmath.sqrt(1 - e * e), 1 - e * mpmath.cos(anomaly)
    plane = (a * (mpmath.cos(anomaly) - e), a * b * mpmath.sin(anomaly))
    speed = (-n * a * mpmath.sin(anomaly) / r, n * a * b * mpmath.cos(anomaly) / r)
    found = []
    for x, y in (plane, speed):
        along = x * mpmath.cos(pericentre) - y * mpmath.sin(pericentre)
        ahead = x * mpmath.sin(pericentre) + y * mpmath.cos(pericentre)
        flat = ahead * mpmath.cos(inc)
        found += [
            along * mpmath.cos(node) - flat * mpmath.sin(node),
            along * mpmath.sin(node) + flat * mpmath.cos(node),
        ]
        found.append(ahead * mpmath.sin(inc))
    return found


def orbit_in_mpmath(mpmath: Any, state: list[Any]) -> dict[str, Any]:
    """All elements of planet b from its rounded state: ELEMENTS, corrected by Newton's method."""
    keys = list(ELEMENTS)
    values = mpmath.matrix([mpmath.mpf(value) for value in ELEMENTS.values()])
    h = mpmath.mpf(10) ** -18
    for _ in range(3):
        now = in_mpmath(mpmath, keys, list(values))
        slopes = mpmath.matrix(6, 6)
        for k in range(6):
            near = [value + h * (k == i) for i, value in enumerate(values)]
            for row, (one, other) in enumerate(zip(in_mpmath(mpmath, keys, near), now, strict=True)):
                slopes[row, k] = (one - other) / h
        values -= mpmath.lu_solve(slopes, mpmath.matrix([one - two for one, two in zip(now, state, strict=True)]))
    of, turn = dict(zip(keys, values, strict=True)), mpmath.pi / 180
    whole, tilt = (of["omega"] + of["Omega"]) * turn, 2 * mpmath.sin(of["inc"] * turn / 2)
    mu = 1 + mpmath.mpf(MASSES[1])
    return of | {
        "P": 2 * mpmath.pi * mpmath.sqrt(of["a"] ** 3 / mu),
        "h": of["e"] * mpmath.sin(whole), "k": of["e"] * mpmath.cos(whole),
        "ix": tilt * mpmath.cos(of["Omega"] * turn), "iy": tilt * mpmath.sin(of["Omega"] * turn),
        "lambda": of["M"] + of["omega"] + of["Omega"], "mass": mpmath.mpf(MASSES[1]),
    }  # fmt: skip


FLAT = kd.Oblateness(j2=1e-3, radius=0.1, G=1.0)
POTENTIAL = kd.PostNewtonian(c=100.0, form="potential", G=1.0)


def maps(long: bool) -> Iterator[Claim]:
    steps = 100_000 if long else 10_000
    given: tuple[tuple[str, list[Any], dict[str, Any]], ...] = (
        ("with j2 and relativity-1pn", [FLAT, POTENTIAL], {}),
        ("with j2 and the lazy kernel", [FLAT], {"kernel": "lazy"}),
        ("with the modified kick and a corrector", [], {"kernel": "modified-kick", "corrector": 17}),
    )
    for words, forces, options in given:
        value = kd.transition_matrix(planets(*forces), steps * 0.05, "wisdom-holman", 0.05, **options).symplectic_error
        assert value is not None
        text = f"M^T J M - J after {steps} steps of wisdom-holman {words}, over the largest of M^2"
        yield at_most(text, value, 1e-12, "a symplectic map")


def costs() -> Iterator[Claim]:
    system, dt, steps = kd.load("trappist-1"), 0.06 / 365.25, 10_000
    flat = system.with_forces(*system.forces, kd.Oblateness(j2=1e-5, radius=5e-4))
    value = cost_of_a_direction(flat, "wisdom-holman", dt, steps, 3)
    text = "wisdom-holman with j2: time of one of 48 directions over that of a step, TRAPPIST-1"
    yield at_most(text, value, 1.3, "the same run without directions")
    yield from costs_of_second(system, dt)


def costs_of_second(system: kd.System, dt: float) -> Iterator[Claim]:
    """Times of long runs less short ones, so that what happens once does not count."""
    plain = kd.Simulation(system, "yoshida6", dt)
    for name, columns, given in (
        ("one body's coordinates", 6, {"bodies": "b"}),
        ("two bodies' coordinates", 12, {"bodies": ["b", "c"]}),
    ):
        directions, ratios = columns + columns * (columns + 1) // 2, []
        for turn in range(6):
            times = []
            for steps in (1000, 8000):
                begun = process_time()
                kd.transition_matrix(system, steps * dt, "yoshida6", dt, second=True, **given)
                times.append(process_time() - begun)
            alone = -process_time()
            plain.advance(70_000)
            alone += process_time()
            if turn:  # the first compiles
                ratios.append((10.0 * (times[1] - times[0]) / alone - 1.0) / directions)
        text = f"yoshida6, second derivatives by {name}: time of one of {directions} directions over that of a step"
        yield at_most(text, float(np.median(ratios)), 1.3, "the same run without directions, TRAPPIST-1")


def spectra(long: bool) -> Iterator[Claim]:
    found = kd.lyapunov_spectrum(kd.load("ode-lorenz"), 20_000.0 if long else 2000.0, "rk4", 0.01)
    value = float(np.abs(found.exponents - LORENZ).max())
    yield claim(
        "Lyapunov spectrum of Lorenz's system, the largest difference", value, "at most 0.01", value <= 0.01,
        "Sprott 2003: 0.9056, 0, -14.5723",
    )  # fmt: skip
    value = abs(found.sum + 10.0 + 1.0 + 8.0 / 3.0)
    text = "sum of these exponents, difference from the divergence"
    yield claim(text, value, "at most 1e-3", value <= 1e-3, "-(10 + 1 + 8 / 3)")
    assert found.dimension is not None
    value = abs(found.dimension - 2.062)
    text = "Kaplan-Yorke dimension of Lorenz's attractor, difference"
    yield claim(text, value, "at most 2e-3", value <= 2e-3, "Sprott 2003: 2.062")
    star = kd.lyapunov_spectrum(kd.load("ode-henon-heiles"), 2000.0, "yoshida6", 0.1)
    pairs = float(np.abs(star.exponents + star.exponents[::-1]).max())
    text = "Henon and Heiles' star: exponents are pairs of opposite signs, the largest sum of a pair"
    yield claim(text, pairs, "at most 1e-5", pairs <= 1e-5, "a Hamiltonian flow of two degrees of freedom")
    system = kd.lyapunov_spectrum(planets(FLAT), 500.0, "wisdom-holman", 0.05)
    text = "18 exponents of two planets and a flat star by wisdom-holman: their sum"
    yield at_most(text, abs(system.sum), 1e-12, "a symplectic map keeps volumes")


if __name__ == "__main__":
    main(claims, __doc__)
