"""Derivatives under trace: against differences of its own runs, forty digits, and the motions of gauss-radau15."""

from __future__ import annotations

import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.analysis.tangents.mapped import TraceTangentRun
from kickdrift.errors import InputError, RunError
from kickdrift.integrators.trace.tangent_meeting import add_exactly
from kickdrift.jit.compile import driver
from kickdrift.jit.duals.dual import SLOT, dual_rows
from kickdrift.jit.duals.operators import vector_at

DT, STEPS = 0.4, 16


def system_of(x, v, masses, *forces) -> kd.System:
    return kd.System(x, v, masses, forces=[kd.Gravity(G=1.0), *forces], units="nbody")


def orbits(*bodies) -> kd.System:
    """A star of mass 1 with bodies (mass, a, e, eccentric anomaly, height) on orbits in planes of these heights."""
    n = len(bodies) + 1
    x, v, masses = np.zeros((n, 3)), np.zeros((n, 3)), np.ones(n)
    for i, (mass, a, e, angle, height) in enumerate(bodies, 1):
        b, rate = math.sqrt(1 - e * e), math.sqrt((1.0 + mass) / a**3) / (1 - e * math.cos(angle))
        x[i] = a * (math.cos(angle) - e), a * b * math.sin(angle), height
        v[i] = -a * math.sin(angle) * rate, a * b * math.cos(angle) * rate, 0.0
        masses[i] = mass
    return system_of(x, v, masses)


def meeting() -> kd.System:
    """Two giants that come near each other, and a third."""
    return orbits((1e-3, 5.0, 0.02, -0.12, 0.01), (8e-4, 5.6, 0.04, 0.0, 0.02), (6e-4, 9.0, 0.1, 2.0, 0.03))


def diving() -> kd.System:
    """A planet on its way through the pericentre, and another one."""
    return orbits((1e-3, 5.0, 0.97, -0.35, 0.01), (1e-3, 12.0, 0.05, 1.0, 0.02))


def light(system: kd.System, *bodies) -> kd.System:
    """The system with massless bodies."""
    more = orbits(*((0.0, *each) for each in bodies)).state
    own = system.state
    return system_of(
        np.concatenate([own.positions, more.positions[1:]]), np.concatenate([own.velocities, more.velocities[1:]]),
        np.concatenate([own.masses, more.masses[1:]]),
    )  # fmt: skip


def forced(system: kd.System) -> kd.System:
    """The system about a flat star, in a field that changes."""
    flat = kd.Oblateness(j2=0.02, radius=0.5, pole=(0.1, 0.0, 1.0), G=1.0)
    field = kd.DrivenField((1e-4, 0.0, 5e-5), frequency=0.7)
    return system.with_forces(kd.Gravity(G=1.0), flat, field)


def braked(system: kd.System) -> kd.System:
    """The system about a flat star, with drag, a force of velocity."""
    return system.with_forces(*forced(system).forces[:2], kd.LinearDrag(0.02))


def end_of(system: kd.System, **given) -> tuple[np.ndarray, list[tuple[int, int]]]:
    """The end of a run, and the numbers of near pairs and of passages at its step points."""
    sim, flags = kd.Simulation(system, "trace", DT, **given), []
    for _ in range(STEPS):
        sim.run(1)
        flags.append(sim.integration.stepper.flags)
    return np.concatenate([sim.state.positions.ravel(), sim.state.velocities.ravel()]), flags


def moved(system: kd.System, half=0, body=0, axis=0, by=0.0, mass=0.0) -> kd.System:
    phase, masses = [system.state.positions.copy(), system.state.velocities.copy()], system.state.masses.copy()
    phase[half][body, axis] += by
    masses[body] += mass
    return system_of(*phase, masses, *system.forces[1:])


def slope(end, h):
    """Derivative by differences of order 6."""
    one, two, three = ((end(k * h) - end(-k * h)) / (2 * k * h) for k in (1, 2, 3))
    return 1.5 * one - 0.6 * two + 0.1 * three


CASES = [
    pytest.param(meeting, {}, 1e-4, 1, id="giants meet"),
    pytest.param(diving, {}, 1e-5, 2, id="all move together"),
    pytest.param(diving, {"pericentre": "partial"}, 1e-5, 2, id="a passage with kicks"),
    pytest.param(
        lambda: light(meeting(), (5.2, 0.05, -0.06, 0.0), (5.6, 0.04, 2.0, 0.0), (7.0, 0.97, -0.3, 0.0)), {}, 1e-5, 1,
        id="massless bodies meet giants and pass the star", marks=pytest.mark.long,
    ),
    pytest.param(
        lambda: light(diving(), (12.5, 0.05, 1.03, 0.0), (7.0, 0.1, 2.0, 0.0)), {}, 1e-5, 2,
        id="massless bodies while a planet passes the star", marks=pytest.mark.long,
    ),
    pytest.param(lambda: forced(meeting()), {}, 1e-4, 1, id="giants meet under other forces"),
    pytest.param(
        lambda: forced(diving()), {}, 1e-5, 2, id="all move together under other forces", marks=pytest.mark.long
    ),
    pytest.param(
        lambda: forced(light(meeting(), (5.2, 0.05, -0.06, 0.0), (7.0, 0.97, -0.3, 0.0))), {}, 1e-5, 1,
        id="massless bodies under other forces",
    ),
    pytest.param(
        lambda: forced(light(diving(), (12.5, 0.05, 1.03, 0.0), (7.0, 0.1, 2.0, 0.0))), {}, 1e-5, 2,
        id="massless bodies while a planet passes, under other forces", marks=pytest.mark.long,
    ),
    pytest.param(lambda: braked(meeting()), {}, 1e-4, 1, id="giants meet with drag"),
    pytest.param(lambda: braked(diving()), {"pericentre": "partial"}, 1e-5, 2, id="a passage with kicks and drag"),
    pytest.param(
        lambda: braked(light(meeting(), (5.2, 0.05, -0.06, 0.0), (7.0, 0.97, -0.3, 0.0))), {}, 1e-5, 1,
        id="massless bodies with drag", marks=pytest.mark.long,
    ),
    pytest.param(
        lambda: braked(light(diving(), (12.5, 0.05, 1.03, 0.0), (7.0, 0.1, 2.0, 0.0))), {}, 1e-5, 2,
        id="massless bodies while a planet passes, with drag", marks=pytest.mark.long,
    ),
]  # fmt: skip


@pytest.mark.parametrize(("made", "given", "h", "flagged"), CASES)
def test_columns_are_slopes_of_runs(made, given, h, flagged):
    system = made()
    end, flags = end_of(system, **given)
    assert sum(each != (0, 0) for each in flags) >= 2
    assert any(each[flagged - 1] for each in flags)
    found = kd.transition_matrix(system, STEPS * DT, "trace", DT, **given)
    own = np.concatenate([found.end.positions.ravel(), found.end.velocities.ravel()])
    np.testing.assert_array_equal(own, end)  # the same bits as without derivatives
    if "drag" not in "".join(force.name for force in system.forces):
        assert found.symplectic_error is None or found.symplectic_error < 1e-14
    n = len(system)
    for column in range(0, 6 * n, 5):
        half, body, axis = column // (3 * n), column % (3 * n) // 3, column % 3

        def after(by, half=half, body=body, axis=axis):
            there, seen = end_of(moved(system, half, body, axis, by), **given)
            assert seen == flags  # no switch between these runs
            return there

        wanted = slope(after, h)
        np.testing.assert_allclose(found.matrix[:, column], wanted, rtol=0, atol=1e-8 * np.abs(wanted).max())


@pytest.mark.long
@pytest.mark.parametrize(
    ("made", "given", "h", "bodies"),
    [
        pytest.param(meeting, {}, 1e-4, [1, 2], id="giants meet"),
        pytest.param(
            meeting, {"inner": "bulirsch-stoer"}, 1e-3, [1, 2], id="giants meet by bulirsch-stoer",
        ),
        pytest.param(diving, {}, 2e-5, [1, 0], id="all move together"),
        pytest.param(diving, {"pericentre": "partial"}, 2e-5, [1], id="a passage with kicks"),
        pytest.param(
            lambda: light(meeting(), (5.2, 0.05, -0.06, 0.0), (7.0, 0.97, -0.3, 0.0)), {}, 2e-5, [1, 4, 5],
            id="massless bodies meet giants and pass the star",
        ),
    ],
)  # fmt: skip
def test_second_derivatives_are_slopes_of_columns(made, given, h, bodies):
    """Beside differences of the columns, without a switch between these runs; the bodies keep their bits."""
    system = made()
    end, flags = end_of(system, **given)
    assert sum(each != (0, 0) for each in flags) >= 2
    found = kd.transition_matrix(system, STEPS * DT, "trace", DT, bodies=bodies, second=True, **given)
    own = np.concatenate([found.end.positions.ravel(), found.end.velocities.ravel()])
    np.testing.assert_array_equal(own, end)
    k = len(bodies)
    for column in (0, 3 * k + 1):
        place = column // (3 * k), bodies[column % (3 * k) // 3], column % 3

        def matrix(by, place=place):
            there = moved(system, *place, by)
            assert end_of(there, **given)[1] == flags
            return kd.transition_matrix(there, STEPS * DT, "trace", DT, bodies=bodies, **given).matrix

        wanted = slope(matrix, h)
        np.testing.assert_allclose(found.second[:, :, column], wanted, rtol=0, atol=1e-7 * np.abs(wanted).max())
    turned = kd.transition_matrix(system, STEPS * DT, "trace", DT, bodies=bodies[::-1], second=True, **given)
    order = np.arange(6 * k).reshape(2, k, 3)[:, ::-1].ravel()
    largest = np.abs(found.second).max()
    np.testing.assert_allclose(turned.second[:, order][:, :, order], found.second, rtol=0, atol=1e-9 * largest)


def test_columns_by_masses_and_the_constant():
    system = meeting()
    found = kd.transition_matrix(system, STEPS * DT, "trace", DT, bodies=1, masses=True, parameters="gravity.G")
    for body in range(3):
        wanted = slope(lambda by, body=body: end_of(moved(system, body=body, mass=by))[0], 1e-6)
        np.testing.assert_allclose(found.by_masses[:, body], wanted, rtol=0, atol=1e-8 * np.abs(wanted).max())
    wanted = slope(lambda by: end_of(system.with_forces(kd.Gravity(G=1.0 + by)))[0], 1e-5)
    np.testing.assert_allclose(found.by_parameters[:, 0], wanted, rtol=0, atol=1e-8 * np.abs(wanted).max())


@pytest.mark.parametrize(("made", "h"), [(meeting, 1.0), (diving, 0.5)])
def test_columns_by_masses_and_parameters_under_other_forces(made, h):
    """Forces that depend on masses and on velocities; a number of gravity, and of each other force."""
    system = braked(made())
    by = ["gravity.G", "j2.j2", "linear-drag.rate"]
    found = kd.transition_matrix(system, STEPS * DT, "trace", DT, bodies=1, masses=True, parameters=by)

    def same(ours, system_by, step):
        wanted = slope(lambda by: end_of(system_by(by))[0], step)
        np.testing.assert_allclose(ours, wanted, rtol=0, atol=2e-8 * np.abs(wanted).max())

    for body in (0, 1):
        same(found.by_masses[:, body], lambda by, body=body: moved(system, body=body, mass=by), 1e-5 * h)
    gravity, flat, drag = system.forces
    for column, of in enumerate((
        lambda by: system.with_forces(kd.Gravity(G=1.0 + by), flat, drag),
        lambda by: system.with_forces(gravity, replace(flat, j2=flat.j2 + by), drag),
        lambda by: system.with_forces(gravity, flat, kd.LinearDrag(drag.rate + by)),
    )):  # fmt: skip
        same(found.by_parameters[:, column], of, (1e-5, 1e-3, 1e-3)[column] * h)


@pytest.mark.parametrize("made", [meeting, diving, lambda: light(meeting(), (7.0, 0.97, -0.3, 0.0))])
def test_both_inner_methods_have_the_same_slopes(made):
    """Bulirsch-Stoer moves bodies that meet within 1e-11 of Gauss-Radau in each of its steps."""
    system = made()
    masses = bool((system.state.masses > 0.0).all())
    one, two = (
        kd.transition_matrix(system, STEPS * DT, "trace", DT, masses=masses, inner=inner)
        for inner in ("gauss-radau15", "bulirsch-stoer")
    )
    plain = end_of(system, inner="bulirsch-stoer")[0][: 3 * len(system)]
    np.testing.assert_array_equal(two.end.positions.ravel(), plain)
    assert not np.array_equal(two.matrix, one.matrix)
    np.testing.assert_allclose(two.matrix, one.matrix, rtol=0, atol=1e-8 * np.abs(one.matrix).max())
    if masses:
        np.testing.assert_allclose(two.by_masses, one.by_masses, rtol=0, atol=1e-8 * np.abs(one.by_masses).max())


def test_the_star_may_be_in_any_row():
    system, order = light(meeting(), (7.0, 0.97, -0.3, 0.0)), [4, 1, 0, 3, 2]
    state = system.state
    turned = system_of(state.positions[order], state.velocities[order], state.masses[order])
    one, two = (kd.transition_matrix(each, STEPS * DT, "trace", DT).matrix for each in (system, turned))
    rows = np.add.outer(3 * np.array(order), np.arange(3)).ravel()
    rows = np.concatenate([rows, 15 + rows])
    np.testing.assert_allclose(two, one[np.ix_(rows, rows)], rtol=0, atol=1e-12 * np.abs(one).max())


def test_massless_bodies_about_a_star_alone():
    """Kepler motions, whose matrix is that of gauss-radau15, in a passage too."""
    system = light(system_of(np.zeros((1, 3)), np.zeros((1, 3)), [1.0]), (7.0, 0.97, -0.3, 0.0), (7.0, 0.1, 2.0, 0.0))
    assert any(passages for _, passages in end_of(system)[1])
    found, exact = (kd.transition_matrix(system, STEPS * DT, *each) for each in (("trace", DT), ("gauss-radau15",)))
    np.testing.assert_allclose(found.matrix, exact.matrix, rtol=0, atol=1e-12 * np.abs(exact.matrix).max())


@pytest.mark.parametrize("rate", [0.0, 0.3])
def test_a_step_without_encounters_against_forty_digits(rate):
    """Kick, jump, drift, jump and kick in democratic heliocentric coordinates, and differences, in mpmath. Drag acts by
    implicit midpoint steps, v' = v - h rate (v + v') / 2."""
    mp = pytest.importorskip("mpmath")
    dt, steps, masses = 0.3, 2, [1, mp.mpf(1e-3), mp.mpf(3e-4)]
    x = np.array([[0.1, -0.05, 0.0], [1.3, 0.2, 0.02], [-2.6, 0.1, 0.3]])
    v = np.array([[0.02, 0.0, 0.01], [-0.1, 0.9, 0.0], [0.0, -0.6, 0.05]])
    drag, by = ((kd.LinearDrag(rate),), ("linear-drag.rate",)) if rate else ((), ())
    system = system_of(x, v, [float(each) for each in masses], *drag)
    found = kd.transition_matrix(system, steps * dt, "trace", dt, masses=True, parameters=by)

    def drifted(x, v, mu, t):
        """A Kepler motion by Newton's method on the eccentric anomaly's change (Danby 1988, chapter 6)."""
        r, eta = mp.sqrt(sum(x * x)), sum(x * v)
        a = 1 / (2 / r - sum(v * v) / mu)
        n, root = mp.sqrt(mu / a**3), mp.sqrt(mu * a)
        e = n * t
        for _ in range(60):
            off = e - (1 - r / a) * mp.sin(e) + eta / root * (1 - mp.cos(e)) - n * t
            e -= off / (1 - (1 - r / a) * mp.cos(e) + eta / root * mp.sin(e))
        f, g = 1 - a / r * (1 - mp.cos(e)), t - (e - mp.sin(e)) / n
        after = f * x + g * v
        s = mp.sqrt(sum(after * after))
        return after, -root / (r * s) * mp.sin(e) * x + (1 - a / s * (1 - mp.cos(e))) * v

    def end(x, v, m, rate):
        total, t = sum(m), mp.mpf(dt)
        place, pace = sum(m[i] * x[i] for i in range(3)) / total, sum(m[i] * v[i] for i in range(3)) / total
        q, u = [x[i] - x[0] for i in (1, 2)], [v[i] - pace for i in (1, 2)]

        def kick():
            d = q[1] - q[0]
            pull = t / 2 * d / mp.sqrt(sum(d * d)) ** 3
            u[0], u[1] = u[0] + m[2] * pull, u[1] - m[1] * pull

        def jump():
            way = t / 2 * (m[1] * u[0] + m[2] * u[1]) / m[0]
            q[0], q[1] = q[0] + way, q[1] + way

        slower = (1 - t * rate / 4) / (1 + t * rate / 4)
        for _ in range(steps):
            u[0], u[1], pace = slower * u[0], slower * u[1], slower * pace
            kick()
            jump()
            for i in range(2):
                q[i], u[i] = drifted(q[i], u[i], m[0], t)
            place = place + t * pace
            jump()
            kick()
            u[0], u[1], pace = slower * u[0], slower * u[1], slower * pace
        star = place - (m[1] * q[0] + m[2] * q[1]) / total
        rows = [star, star + q[0], star + q[1]]
        rows += [pace - (m[1] * u[0] + m[2] * u[1]) / m[0], pace + u[0], pace + u[1]]
        return np.concatenate(rows)

    with mp.workdps(40):
        start = [np.array([[mp.mpf(float(each)) for each in row] for row in rows]) for rows in (x, v)]
        h = mp.mpf(10) ** -13
        columns = np.column_stack([found.matrix, found.by_masses, *([found.by_parameters] if rate else [])])
        for column in range(0, columns.shape[1], 2 if rate == 0.0 else 3):
            both = []
            for sign in (1, -1):
                one, two, m, brake = start[0].copy(), start[1].copy(), list(masses), mp.mpf(rate)
                if column < 18:
                    (one, two)[column // 9][column % 9 // 3, column % 3] += sign * h
                elif column < 21:
                    m[column - 18] += sign * h
                else:
                    brake += sign * h
                both.append(end(one, two, m, brake))
            wanted = ((both[0] - both[1]) / (2 * h)).astype(float)
            rounded = 2e-15 if not rate else 1e-14 if column < 18 else 1e-13  # iterated; by differences
            np.testing.assert_allclose(columns[:, column], wanted, rtol=0, atol=rounded * np.abs(columns).max())


def test_the_step_goes_to_zero_like_the_error_of_the_map():
    system = meeting()
    exact = kd.transition_matrix(system, 6.4, "gauss-radau15")
    far = [np.abs(kd.transition_matrix(system, 6.4, "trace", dt).matrix - exact.matrix).max() for dt in (0.4, 0.1)]
    assert far[1] < 0.1 * far[0]
    assert far[0] < 1e-3 * np.abs(exact.matrix).max()


def test_megno_and_lyapunov_spectra_follow_the_map():
    system = meeting()
    report = kd.megno(system, 200.0, "trace", DT)
    assert report.integrator == "trace"
    found = kd.lyapunov_spectrum(system, 200.0, "trace", DT)
    assert abs(found.sum) < 1e-12  # the map keeps volumes
    vector = kd.lyapunov_spectrum(system, 200.0, "trace", DT, count=1, seed=3)
    assert vector.exponents[0] > 0.0


def test_transits_under_a_map():
    system, given = kd.load("trappist-1"), {"until": "4 day", "direction": (0, -1, 0), "bodies": "c"}
    exact = kd.transits(system, "b", **given)
    step = {"integrator": "trace", "dt": "0.03 day"}
    found = kd.transits(system, "b", **given, **step)
    assert found.integrator == "trace"
    np.testing.assert_allclose(found.times, exact.times, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.jacobian, exact.jacobian, rtol=0, atol=1e-3 * np.abs(exact.jacobian).max())

    def times(by):
        x, v = system.state.positions.copy(), system.state.velocities
        x[2, 0] += by
        near = kd.System(x, v, system.state.masses, forces=system.forces, units=system.units, names=system.names)
        return kd.transits(near, "b", **given, **step).times

    wanted = slope(times, 1e-5)
    np.testing.assert_allclose(found.jacobian[:, 0], wanted, rtol=0, atol=1e-7 * np.abs(wanted).max())
    other = kd.transits(system, "b", **given, **step | {"integrator": "wisdom-holman"})
    np.testing.assert_allclose(other.times, exact.times, rtol=0, atol=1e-9)
    sim = kd.Simulation(system, "trace", "0.03 day")
    np.testing.assert_array_equal(kd.transits(sim, "b", **given).times, found.times)
    with pytest.raises(InputError, match=r"dt: b turns by 1\.7 radians in a step of trace; transits"):
        kd.transits(system, "b", **given, integrator="trace", dt="0.4 day")


@driver
def added(x, lost, changes):
    for i in range(x.size // (3 * SLOT)):
        add_exactly(dual_rows(x, 2), dual_rows(lost, 2), i, vector_at(dual_rows(changes, 2), i))


def test_what_rounding_takes_from_deviations_is_kept():
    rng = np.random.default_rng(5)
    x, changes = (rng.standard_normal(6 * SLOT) * scale for scale in (1.0, 1e-5))
    lost = np.zeros_like(x)
    wanted = [Fraction(a) + Fraction(b) for a, b in zip(x, changes, strict=True)]
    added(x, lost, changes)
    assert [Fraction(a) + Fraction(b) for a, b in zip(x, lost, strict=True)] == wanted
    assert np.count_nonzero(lost) > lost.size // 2
    before = lost.copy()
    added(x, lost, np.zeros_like(x))
    np.testing.assert_array_equal(lost, before)


def test_deviations_scale_in_a_passage():
    """What rounding took in the last step scales with the deviations: a power of two changes no other bit."""
    system = orbits((0.2, 1.0, 0.1, 0.3, 0.01), (1e-3, 6.0, 0.05, 1.0, 0.02))  # so heavy a planet is always in passage
    start = np.random.default_rng(1).normal(size=(2, 3, len(system), 2))

    def end(scaled, mixed):
        run = TraceTangentRun(system, None, "trace", 1, {"dt": 0.05})
        run.start(start)
        run.advance(20)
        run.scale(scaled)
        run.mix(mixed * np.eye(2))
        run.advance(20)
        return run.now()[1] / (scaled * mixed)

    plain = end(1.0, 1.0)
    np.testing.assert_array_equal(end(2.0**-200, 1.0), plain)
    np.testing.assert_array_equal(end(1.0, 2.0**-200), plain)


def test_the_systems_own_method_serves_where_it_can():
    own = meeting().with_run(integrator="trace", dt=DT)
    assert kd.transition_matrix(own, 4.0).integrator == "trace"
    some = light(meeting(), (7.0, 0.1, 2.0, 0.0)).with_run(integrator="trace", dt=DT)
    assert kd.transition_matrix(some, 4.0, masses=True).integrator == "gauss-radau15"


@pytest.mark.long  # compiles second derivatives
def test_the_systems_own_method_serves_for_second_derivatives():
    own = meeting().with_run(integrator="trace", dt=DT)
    assert kd.transition_matrix(own, 4.0, second=True, bodies=1).integrator == "trace"


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"parameters": "gravity.softening"}, "parameters: the tangent map of trace takes no gravity.softening; gauss"),
        ({"masses": True}, "masses: particle 4 has no mass, and the tangent map of trace has no slope by it; gauss"),
    ],
)
def test_what_the_map_does_not_have(given, message):
    with pytest.raises(InputError, match=f"^{message}"):
        kd.transition_matrix(light(meeting(), (7.0, 0.1, 2.0, 0.0)), 4.0, "trace", DT, **given)


def test_a_step_with_too_many_points_is_named(monkeypatch):
    monkeypatch.setattr("kickdrift.analysis.tangents.mapped.POINTS", 5)
    with pytest.raises(RunError, match=r"^trace, dt = 0\.4: step \d+ has more than 5 points of bodies that meet$"):
        kd.transition_matrix(meeting(), 4.0, "trace", DT)
