"""Are the derivatives that trace carries those of its own map, and do they approach those of the motion?

Two giants that meet, with a third; a planet that passes close to the star; massless bodies beside both; other forces,
of velocity too; both inner methods. The columns of the transition matrix, by masses and parameters too, are compared
with differences of trace's own runs, with the variational equations under gauss-radau15, and with heyoka's. Is the map
symplectic across encounters, and what does a direction cost?
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

import kickdrift as kd
from kickdrift_validation.claim import Claim, at_most, claim, main, not_run
from kickdrift_validation.derivatives import cost_of_a_direction

DT, STEPS = 0.4, 16
Rows = list[tuple[float, ...]]
MEETING: Rows = [(1e-3, 5.0, 0.02, -0.12, 0.01), (8e-4, 5.6, 0.04, 0.0, 0.02), (6e-4, 9.0, 0.1, 2.0, 0.03)]
DIVING: Rows = [(1e-3, 5.0, 0.97, -0.35, 0.01), (1e-3, 12.0, 0.05, 1.0, 0.02)]
LIGHT: Rows = [(0.0, 5.2, 0.05, -0.06, 0.0), (0.0, 7.0, 0.97, -0.3, 0.0)]
FLAT = kd.Oblateness(j2=0.02, radius=0.5, pole=(0.1, 0.0, 1.0), G=1.0)
FIELD = kd.DrivenField((1e-4, 0.0, 5e-5), frequency=0.7)
DRAG = kd.LinearDrag(0.01)
CURVED = kd.PostNewtonian(c=20.0, G=1.0)
ALL_CURVED = kd.EinsteinInfeldHoffmann(c=20.0, G=1.0)
SPINS = [(0.0, 0.0, 0.3)] + [(0.0, 0.0, 0.0)] * 3
TIDES = kd.Tides(k2=0.3, radius=0.4, tau=0.05, spin=SPINS, rotation="synchronous", G=1.0)
SHORT = {"inner": "bulirsch-stoer"}


class Case(NamedTuple):
    """A system, its options, and the steps of differences by coordinates and, relative, by masses and parameters."""

    rows: Rows
    forces: tuple[Any, ...] = ()
    h: float = 1e-4
    options: dict[str, str] = {}  # noqa: RUF012
    parameters: tuple[str, ...] = ("gravity.G",)
    by: float = 0.02


CASES = {
    "giants that meet": Case(MEETING),
    "a passage of the pericentre": Case(DIVING, h=1e-5),
    "giants that meet, and massless bodies": Case(MEETING + LIGHT, h=1e-5),
    "all of these about a flat star in a field that changes": Case(MEETING + LIGHT, (FLAT, FIELD), 1e-5),
    "giants that meet about a flat star": Case(MEETING, (FLAT,), parameters=("gravity.G", "j2.j2", "j2.radius")),
    "a passage by a flat star in a field that changes": Case(DIVING, (FLAT, FIELD), 1e-5),
    "giants that meet, with 1PN and drag": Case(
        MEETING, (CURVED, DRAG), parameters=("relativity-1pn.c", "linear-drag.rate")
    ),
    "a passage with 1PN and drag": Case(DIVING, (CURVED, DRAG), 1e-5, parameters=("relativity-1pn.c",)),
    "the same with other attractions as kicks": Case(DIVING, (CURVED, DRAG), 1e-5, {"pericentre": "partial"}),
    "massless bodies too, with 1PN and drag": Case(MEETING + LIGHT, (CURVED, DRAG), 1e-5),
    "giants that meet, with 1PN of all pairs": Case(MEETING, (ALL_CURVED,), parameters=("relativity-eih.c",)),
    "giants that meet, with tides": Case(MEETING, (TIDES,)),
    "giants that meet, by bulirsch-stoer": Case(MEETING, (), 2e-3, SHORT, by=0.1),
    "a passage by bulirsch-stoer, with a flat star": Case(DIVING, (FLAT, FIELD), 2e-4, SHORT, by=0.1),
}


def claims(long: bool = False) -> Iterator[Claim]:
    yield from slopes()
    yield from seconds()
    yield from motion(long)
    yield from under_forces()
    yield from spectra()
    yield from costs()


def system_of(rows: Rows, *forces: Any) -> kd.System:
    """A star of mass 1 with bodies (mass, a, e, eccentric anomaly, height)."""
    n = len(rows) + 1
    x, v, masses = np.zeros((n, 3)), np.zeros((n, 3)), np.ones(n)
    for i, (mass, a, e, angle, height) in enumerate(rows, 1):
        b, rate = np.sqrt(1 - e * e), np.sqrt((1.0 + mass) / a**3) / (1 - e * np.cos(angle))
        x[i] = a * (np.cos(angle) - e), a * b * np.sin(angle), height
        v[i] = -a * np.sin(angle) * rate, a * b * np.cos(angle) * rate, 0.0
        masses[i] = mass
    return kd.System(x, v, masses, forces=[kd.Gravity(G=1.0), *forces], units="nbody")


def moved(system: kd.System, column: int, by: float) -> kd.System:
    phase, n = system.state.phase.transpose(0, 2, 1).copy(), len(system)
    phase[column // (3 * n), column % (3 * n) // 3, column % 3] += by
    return kd.System(*phase, system.state.masses, forces=system.forces, units="nbody")


def heavier(system: kd.System, body: int, by: float) -> kd.System:
    state, masses = system.state, system.state.masses.copy()
    masses[body] += by
    return kd.System(state.positions, state.velocities, masses, forces=system.forces, units="nbody")


def tuned(system: kd.System, name: str, key: str, by: float) -> kd.System:
    changed = [
        replace(force, **{key: getattr(force, key) + by}) if force.name == name else force for force in system.forces
    ]
    return system.with_forces(*changed)


def end_of(system: kd.System, options: dict[str, str]) -> np.ndarray:
    sim = kd.Simulation(system, "trace", DT, **options)
    sim.run(STEPS)
    return np.concatenate([sim.state.positions.ravel(), sim.state.velocities.ravel()])


def difference(end: Callable[[float], np.ndarray], h: float) -> np.ndarray:
    """Derivative by differences of order 6."""
    one, two, three = ((end(k * h) - end(-k * h)) / (2 * k * h) for k in (1, 2, 3))
    return np.asarray(1.5 * one - 0.6 * two + 0.1 * three)


def slopes() -> Iterator[Claim]:
    for name, case in CASES.items():
        system = system_of(case.rows, *case.forces)
        masses, bound = bool((system.state.masses > 0.0).all()), 1e-6 if case.options == SHORT else 1e-8
        found = kd.transition_matrix(
            system, STEPS * DT, "trace", DT, masses=masses, parameters=case.parameters, **case.options
        )
        own = np.concatenate([found.end.positions.ravel(), found.end.velocities.ravel()])
        same = bool((own == end_of(system, case.options)).all())
        yield claim(f"trace, {name}: the same bits with and without derivatives", same, "yes", same, "the plain run")
        text = f"trace, {STEPS} steps of {name}: all columns, each relative to its largest"
        yield at_most(text, max(errors(system, case, found)), bound, "differences of order 6 of trace's own runs")


def seconds() -> Iterator[Claim]:
    """Second derivatives by the first planet's coordinates, in encounters and passages."""
    for name, case in CASES.items():
        if case.forces or "massless bodies too" in name:
            continue
        text = f"trace, {STEPS} steps of {name}: second derivatives by a planet's coordinates"
        yield at_most(text, max(errors_of_second(case)), 1e-6, "differences of order 6 of trace's own matrix")


def errors_of_second(case: Case) -> Iterator[float]:
    """Differences of second derivatives, each relative to the largest by its column."""
    system = system_of(case.rows)
    n = len(system)

    def ours(there: kd.System, second: bool = False) -> kd.TransitionMatrix:
        return kd.transition_matrix(there, STEPS * DT, "trace", DT, bodies=1, second=second, **case.options)

    found = ours(system, True).second
    assert found is not None
    for column in range(6):
        place = (column // 3) * 3 * n + 3 + column % 3
        wanted = difference(lambda by, place=place: ours(moved(system, place, by)).matrix, case.h)  # type: ignore[misc]
        yield float(np.abs(found[:, :, column] - wanted).max() / np.abs(wanted).max())


def errors(system: kd.System, case: Case, found: kd.TransitionMatrix) -> Iterator[float]:
    """Differences of the columns by coordinates, masses and parameters, each relative to its largest element."""

    def error(ours: np.ndarray, change: Callable[[float], kd.System], h: float) -> float:
        wanted = difference(lambda by: end_of(change(by), case.options), h)
        return float(np.abs(ours - wanted).max() / np.abs(wanted).max())

    for column in range(found.matrix.shape[1]):
        yield error(found.matrix[:, column], lambda by, k=column: moved(system, k, by), case.h)  # type: ignore[misc]
    if found.by_masses is not None:
        for body, mass in enumerate(system.state.masses):
            h = case.by * mass if body else 0.1 * case.h
            yield error(found.by_masses[:, body], lambda by, k=body: heavier(system, k, by), h)  # type: ignore[misc]
    assert found.by_parameters is not None
    for column, text in enumerate(case.parameters):
        name, key = text.split(".")
        value = next(getattr(force, key) for force in system.forces if force.name == name)
        h = 0.1 * case.h if key == "G" else 0.25 * case.by * value
        yield error(found.by_parameters[:, column], lambda by, n=name, k=key: tuned(system, n, k, by), h)  # type: ignore[misc]


def motion(long: bool) -> Iterator[Claim]:
    single, steps = 1000 if long else 200, 1000
    for name, rows, forces in (
        ("giants that meet", MEETING, ()),
        ("passages of the pericentre", DIVING, ()),
        ("giants that meet about a flat star in a field", MEETING, (FLAT, FIELD)),
    ):
        sim, worst = kd.Simulation(system_of(rows, *forces), "trace", DT), []
        for _ in range(single):
            worst.append(kd.transition_matrix(sim, DT).symplectic_error or 0.0)
            sim.run(1)
        text = f"M^T J M - J of each of {single} steps of trace with {name}, over the largest of M^2"
        yield at_most(text, float(max(worst)), 1e-14, "a symplectic map")
        value = kd.transition_matrix(system_of(rows, *forces), steps * DT, "trace", DT).symplectic_error or 0.0
        text = f"M^T J M - J after {steps} steps of trace with {name}, over the largest of M^2"
        yield at_most(text, value, 1e-12, "a symplectic map")
    system, length = system_of(MEETING), 640.0
    exact = kd.transition_matrix(system, length, "gauss-radau15").matrix
    far = [np.abs(kd.transition_matrix(system, length, "trace", dt).matrix - exact).max() for dt in (0.2, 0.025)]
    value = float(np.log2(far[0] / far[1]) / 3.0)
    text = "giants that meet: power of dt of the matrix's difference from the motion's, between dt = 0.2 and 0.025"
    yield claim(text, value, "1.8 to 2.2", 1.8 <= value <= 2.2, "the variational equations under gauss-radau15")
    value = float(far[1] / np.abs(exact).max())
    text = "the same difference at dt = 0.025, relative to the largest element, some 8e4"
    yield claim(text, value, "at most 1e-2", value <= 1e-2, "the variational equations under gauss-radau15")


def under_forces() -> Iterator[Claim]:
    texts = [
        "giants that meet, with 1PN and drag, columns by starts, masses, G, c and the drag's rate: power of dt of the "
        "median column's difference from the motion's, between dt = 0.2 and 0.025",
        "the largest of these differences at dt = 0.025, each column relative to its largest",
        "the same columns by gauss-radau15, relative to the largest of each",
    ]
    bounds, reference = ("1.8 to 2.2", "at most 1e-5", "at most 1e-8"), "heyoka's variational equations"
    try:
        import heyoka
    except ImportError:
        for text, bound in zip(texts, bounds, strict=True):
            yield not_run(text, bound, reference, "pip install heyoka")
        return
    system, length = system_of(MEETING, CURVED, DRAG), 32.0
    exact = by_heyoka(heyoka, system, length)
    sizes = np.abs(exact).max(axis=0)
    parameters = ("gravity.G", "relativity-1pn.c", "linear-drag.rate")

    def far(*method: Any) -> np.ndarray:
        found = kd.transition_matrix(system, length, *method, masses=True, parameters=parameters)
        assert found.by_masses is not None
        assert found.by_parameters is not None
        ours = np.concatenate([found.matrix, found.by_masses, found.by_parameters], axis=1)
        return np.asarray(np.abs(ours - exact).max(axis=0) / sizes)

    one, two = far("trace", 0.2), far("trace", 0.025)
    value = float(np.log2(np.median(one) / np.median(two)) / 3.0)
    yield claim(texts[0], value, bounds[0], 1.8 <= value <= 2.2, reference)
    value = float(two.max())
    yield claim(texts[1], value, bounds[1], value <= 1e-5, reference)
    value = float(far("gauss-radau15").max())
    yield claim(texts[2], value, bounds[2], value <= 1e-8, reference)


def by_heyoka(heyoka: Any, system: kd.System, length: float) -> np.ndarray:
    """Derivatives by starts, masses, gravity's G, c and the drag's rate."""
    n = len(system)
    masses, (G, c, rate) = [heyoka.par[i] for i in range(n)], (heyoka.par[n + k] for k in range(3))
    equations = heyoka.model.nbody(n, masses=masses, Gconst=G)
    x, v = (np.array([[equations[6 * i + 3 * half + k][0] for k in range(3)] for i in range(n)]) for half in range(2))
    more = -rate * v
    for i in range(1, n):
        r, u = x[i] - x[0], v[i] - v[0]
        r2, v2, along = (heyoka.sum(list(a * b)) for a, b in ((r, r), (u, u), (r, u)))
        gm = CURVED.G * masses[0]  # the force's own G, not gravity's
        felt = gm / (c**2 * r2**1.5) * ((4.0 * gm / r2**0.5 - v2) * r + 4.0 * along * u)
        more[i] = more[i] + felt
        more[0] = more[0] - masses[i] / masses[0] * felt
    system_of_equations = [
        (name, right + more[place // 6, place % 3] if place % 6 >= 3 else right)
        for place, (name, right) in enumerate(equations)
    ]
    by = [name for name, _ in equations] + [*masses, G, c, rate]
    varied = heyoka.var_ode_sys(system_of_equations, by, order=1)
    start = np.concatenate([system.state.positions, system.state.velocities], axis=1).ravel()
    run = heyoka.taylor_adaptive(
        varied, start, pars=[*system.state.masses, 1.0, CURVED.c, DRAG.rate], compact_mode=True
    )
    run.propagate_until(length)
    found = run.state[run.get_vslice(order=1)].reshape(6 * n, len(by))
    rows = [6 * body + 3 * half + k for half in range(2) for body in range(n) for k in range(3)]
    return np.asarray(found[np.ix_(rows, [*rows, *range(6 * n, len(by))])])


def spectra() -> Iterator[Claim]:
    found = kd.lyapunov_spectrum(system_of(MEETING), 400.0, "trace", DT)
    text = "24 Lyapunov exponents of giants that meet: their sum"
    yield at_most(text, abs(found.sum), 1e-11, "a symplectic map keeps volumes")


def costs() -> Iterator[Claim]:
    for name, rows in (("giants that meet", MEETING), ("passages of the pericentre", DIVING)):
        system = system_of(rows)
        text = f"trace, {name}: time of one of {6 * len(system)} directions over that of a step"
        yield at_most(text, cost_of_a_direction(system, "trace", DT, 4000, 5), 1.3, "the same run without directions")


if __name__ == "__main__":
    main(claims, __doc__)
