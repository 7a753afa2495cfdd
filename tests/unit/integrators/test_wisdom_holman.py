"""wisdom-holman, its kernels and saba: against WHFast and a plain map; order, other forces, looks and refusals."""

from __future__ import annotations

import json
from itertools import product
from math import factorial, sqrt

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError, RunError
from kickdrift.integrators.options import COMPOSITION, CORRECTOR, HELIOCENTRIC, JACOBI, LAZY, MODIFIED_KICK, STANDARD
from kickdrift.integrators.wisdom_holman.corrector import corrector, undone
from kickdrift.integrators.wisdom_holman.method import SABA
from tests.folders import DATA
from tests.oracle.kepler import moved
from tests.oracle.wisdom_holman import energy_error, plain_map, planets

WHFAST = json.loads((DATA / "whfast.json").read_text(encoding="utf-8"))
FIELD = kd.UniformField((0.01, 0.02, -0.03))
KERNELS = LAZY, COMPOSITION, MODIFIED_KICK
BOTH = pytest.mark.parametrize("coordinates", [JACOBI, HELIOCENTRIC])


def after(system, steps, name="wisdom-holman", dt=0.1, pieces=1, **options) -> kd.State:
    sim = kd.Simulation(system, name, dt=dt, **options)
    for _ in range(pieces):
        sim.run(steps // pieces, every=steps if pieces == 1 else None)
    return sim.state


# --- the same trajectory as other programs ---


@pytest.mark.parametrize("case", WHFAST["cases"], ids=lambda case: f"{case['coordinates']}-{case['steps']}")
def test_positions_are_whfasts(case):
    """Errors of 1e-14 after 10 steps and 1e-11 after 1000, relative to the largest coordinate: rounding, growing with
    time."""
    start = WHFAST["start"]
    system = kd.System(
        start["positions"], start["velocities"], masses=start["masses"], forces=[kd.Gravity(start["G"])], units="nbody"
    )
    state = after(system, case["steps"], dt=case["dt"], coordinates=case["coordinates"])
    there = np.array(case["positions"])
    error = np.abs(state.positions - there).max() / np.abs(there).max()
    assert error < {10: 1e-14, 1000: 1e-11}[case["steps"]]
    assert np.abs(there - start["positions"]).max() > 0.01


@BOTH
@pytest.mark.parametrize(("count", "massless"), [(1, 0), (8, 0), (3, 1), (10, 2), (5, 5)])
def test_agrees_with_a_plain_map(coordinates, count, massless):
    system = planets(count, massless, boost=0.3)
    x, v = plain_map(system, 0.11, 3, coordinates == JACOBI)
    state = after(system, 3, dt=0.11, coordinates=coordinates)
    np.testing.assert_allclose(state.positions, x.astype(float), rtol=0.0, atol=3e-16 * np.abs(x).max() + 1e-15)
    np.testing.assert_allclose(state.velocities, v.astype(float), rtol=0.0, atol=2e-15)


def test_two_bodies_move_on_their_ellipse_whatever_the_step():
    system = planets(1, scale=0.1)
    x, v = system.state.positions, system.state.velocities
    far = after(system, 4, dt=11.3).positions
    expected, _ = moved(system.state.masses.sum(), 4 * 11.3, x[1] - x[0], v[1] - v[0])
    np.testing.assert_allclose(far[1] - far[0], expected.astype(float), atol=1e-13)


def test_a_body_alone_moves_straight_on():
    system = kd.System([[1.0, 2.0, 3.0]], [[0.5, 0.0, -1.0]], forces=[kd.Gravity()], units="nbody")
    np.testing.assert_allclose(after(system, 10).positions, [[1.5, 2.0, 2.0]], rtol=1e-15)


def test_the_central_body_may_stand_anywhere():
    """The other bodies keep their order, because Jacobi's coordinates depend on it."""
    system = planets(3)
    order = [1, 2, 0, 3]
    own = system.state
    turned = kd.System(
        own.positions[order], own.velocities[order], own.masses[order], forces=system.forces, units="nbody"
    )
    np.testing.assert_array_equal(after(turned, 50).positions, after(system, 50).positions[order])


@BOTH
def test_comes_back(coordinates):
    system = planets(5, 1)
    sim = kd.Simulation(system, "wisdom-holman", dt=0.1, coordinates=coordinates)
    sim.run(500, every=500)
    there = sim.state
    phase = there.phase.copy()
    phase[1] *= -1.0
    sim.state = kd.State(phase, there.masses, there.ids, there.box)
    sim.run(500, every=500)
    assert np.abs(sim.state.phase[0] - system.state.phase[0]).max() < 1e-12


def test_force_evaluations_are_the_kicks():
    kernels = [("wisdom-holman", {"kernel": kernel}, kicks) for kernel, kicks in ((LAZY, 2), (COMPOSITION, 5))]
    kernels.append(("wisdom-holman", {"kernel": MODIFIED_KICK}, 1))
    for name, options, kicks in (("wisdom-holman", {}, 1), ("saba", {"order": "8,4"}, 5), ("saba", {}, 8), *kernels):
        sim = kd.Simulation(planets(), name, dt=0.1, **options)
        sim.run(10)
        assert sim.run(10).force_evaluations == 20 * kicks


# --- orders ---


@BOTH
def test_error_goes_with_dt_squared_and_with_the_planets_masses(coordinates):
    """Relative to the planets' own energy, the error is epsilon dt^2."""
    errors = {
        (scale, dt): energy_error(planets(3, scale=scale), dt, coordinates=coordinates)
        for scale, dt in ((1e-3, 0.2), (1e-3, 0.1), (1e-4, 0.1))
    }
    assert errors[1e-3, 0.2] / errors[1e-3, 0.1] == pytest.approx(4.0, rel=0.15)
    assert errors[1e-3, 0.1] / errors[1e-4, 0.1] == pytest.approx(10.0, rel=0.15)


@BOTH
def test_corrected_error_goes_with_the_masses_squared(coordinates):
    """The error is epsilon dt^4 with the lowest corrector, epsilon^2 dt^2 with a high one."""
    low = [energy_error(planets(3, scale=1e-5), dt, coordinates=coordinates, corrector=3) for dt in (0.4, 0.2)]
    assert 12.0 < low[0] / low[1] < 24.0
    high = [energy_error(planets(3, scale=s), 0.1, coordinates=coordinates, corrector=11) for s in (1e-2, 1e-3)]
    assert 50.0 < high[0] / high[1] < 200.0
    plain = energy_error(planets(3), 0.1, coordinates=coordinates)
    assert high[1] < 0.02 * plain


@pytest.mark.parametrize("order", SABA)
def test_saba_converges_as_its_name_says(order):
    """With heavy planets, terms quadratic in their masses dominate. The order is then the second number of the name, or
    the third number, which is smaller."""
    coarse, fine = (energy_error(planets(3, scale=3e-2), dt, "saba", order=order) for dt in (0.2, 0.1))
    last = int(order.split(",")[-1])
    assert np.log2(coarse / fine) == pytest.approx(last, abs=0.8 if order.count(",") == 2 else 0.3)


def words(kicks: int, length: int):
    """All words of A and B with this number of B."""
    return [word for word in product("AB", repeat=length) if word.count("B") == kicks]


def coefficient(word, drifts, kicks) -> float:
    """Coefficient of a word of non-commuting A and B in the product of exp(a A) and exp(b B).

    It is the sum over all ways to cut the word into powers of the factors in their order."""
    factors = [pair for both in zip(drifts, [*kicks, 0.0], strict=True) for pair in (("A", both[0]), ("B", both[1]))]
    reach = [1.0] + [0.0] * len(word)  # coefficients of the beginnings of the word so far
    for letter, weight in factors:
        new = list(reach)
        for end in range(1, len(word) + 1):
            power = 1.0
            for count in range(1, end + 1):
                if word[end - count] != letter:
                    break
                power *= weight / count
                new[end] += reach[end - count] * power
        reach = new
    return reach[-1]


@pytest.mark.parametrize("order", SABA)
def test_order_conditions_of_the_tables(order):
    """exp(dt (A + B)) has every word of n letters with 1 / n!. The m-th number of the name is the longest length at
    which the product has the right coefficients for words with m letters B."""
    row = SABA[order]
    for kicks, longest in enumerate(map(int, order.split(",")), 1):
        for length in range(kicks, longest + 1):
            for word in words(kicks, length):
                assert coefficient(word, row.drift, row.kick) == pytest.approx(1 / factorial(length), abs=1e-15)
        wrong = [
            abs(coefficient(word, row.drift, row.kick) - 1 / factorial(longest + 1))
            for word in words(kicks, longest + 1)
        ]
        assert max(wrong) > 1e-12


def test_correctors_are_the_published_ones():
    """The lowest corrector: -+ 1 / (48 alpha) at +- alpha, alpha = sqrt(7 / 40). Correctors are their own inverses
    under reversal."""
    alpha = sqrt(7 / 40)
    np.testing.assert_allclose(corrector(3), [[alpha, -2 * alpha, alpha], [-1 / (48 * alpha), 1 / (48 * alpha), 0.0]])
    for order in CORRECTOR.choices[1:]:
        row = corrector(order)
        assert row[0].sum() == pytest.approx(0.0, abs=1e-14)
        assert row[1].sum() == pytest.approx(0.0, abs=1e-14)
        assert row.shape[1] == 2 * (order - 1) // 2 + 1
        np.testing.assert_array_equal(undone(undone(row)), row)


# --- other forces ---


@BOTH
def test_other_forces_join_the_kicks(coordinates):
    """All other forces at once, against an eighth-order method; the difference scales as dt^2."""
    system = planets(3, forces=[kd.HarmonicTrap(1e-5), FIELD])
    truth = kd.Simulation(system, "dop853", rtol=1e-12, atol=1e-12)
    truth.run(until=8.0)
    errors = [
        np.abs(after(system, round(8.0 / dt), dt=dt, coordinates=coordinates).positions - truth.state.positions).max()
        for dt in (0.04, 0.02)
    ]
    assert errors[1] < 1e-3
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.15)


@BOTH
def test_other_forces_know_the_bodies_by_name_and_number(coordinates):
    """This also holds once a body has been absorbed, and the star's row differs from its number."""
    own = planets(2).state
    x, order = own.positions.copy(), [1, 2, 0]
    x[2] = 1.01 * x[1]

    def star_last(central):
        return kd.System(
            x[order], own.velocities[order], own.masses[order], names=["b", "c", "star"], units="nbody",
            forces=[kd.Gravity(), kd.Oblateness(1e-2, 0.1, central=central)],
        )  # fmt: skip

    meet = kd.Collision(radii=[0.01, 0.01, 0.0])
    ends = [
        after(star_last(central), 5, coordinates=coordinates, events=[meet]).positions for central in (None, "star", 2)
    ]
    assert len(ends[0]) == 2
    assert np.array_equal(ends[0], ends[1])
    assert np.array_equal(ends[0], ends[2])


def test_forces_by_velocity_are_refused():
    with pytest.raises(InputError, match="'linear-drag' depends on velocity"):
        kd.Simulation(planets(2, forces=[kd.LinearDrag(0.1)]), "wisdom-holman", dt=0.1)


# --- bad input ---


@pytest.mark.parametrize(
    ("masses", "message"),
    [
        ([1.0, 1.0, 1.0], "no body dominates: .* heaviest, particle 0, .* 2 of its mass.*gauss-radau15"),
        ([1.0, 0.1, 0.11], "no body dominates"),
        ([0.0, 0.0, 0.0], "needs a central body, but no particle has mass"),  # in a field; gravity alone refuses it
    ],
)
def test_no_central_body(masses, message):
    own = planets(2).state
    system = kd.System(own.positions, own.velocities, masses, forces=[kd.Gravity(), FIELD], units="nbody")
    for name in ("wisdom-holman", "saba"):
        with pytest.raises(InputError, match=message):
            kd.Simulation(system, name, dt=0.1)


@pytest.mark.parametrize(
    ("forces", "message"),
    [
        ([], "needs one force 'gravity', and .* has none"),
        ([kd.Gravity(softening=0.1)], "needs gravity without softening"),
        ([kd.Gravity(), kd.Gravity(G=2.0)], "needs one force 'gravity', and .* has 2"),
    ],
)
def test_gravity_is_needed(forces, message):
    own = planets(2).state
    system = kd.System(own.positions, own.velocities, own.masses, forces=forces, units="nbody")
    with pytest.raises(InputError, match=message):
        kd.Simulation(system, "wisdom-holman", dt=0.1)


def test_problems_are_refused():
    problem = kd.Problem(lambda t, y: [y[1], -y[0]], [1.0, 0.0], separable=True, name="spring")
    with pytest.raises(InputError, match="needs particles under gravity; 'spring' is an ODE"):
        kd.Simulation(problem, "wisdom-holman", dt=0.1)


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("wisdom-holman", {"coordinates": "barycentric"}, "coordinates 'barycentric' is unknown; known are jacobi"),
        ("wisdom-holman", {"corrector": 4}, "corrector 4 is unknown; known are 0, 3, 5, 7, 11, 17"),
        ("wisdom-holman", {"order": "8,4"}, "order: wisdom-holman does not take it"),
        ("saba", {"order": "9"}, "order '9' is unknown; known are 10,6,4; 4,2; 6,2"),
        ("saba", {"corrector": 3}, "corrector: saba does not take it"),
        ("wisdom-holman", {"kernel": "quick"}, "known are standard, lazy, composition, modified-kick"),
        *(
            ("wisdom-holman", {"kernel": kernel, "coordinates": HELIOCENTRIC}, f"kernel: {kernel} needs coordinates = ")
            for kernel in KERNELS
        ),
        ("saba", {"kernel": LAZY}, "kernel: saba does not take it"),
    ],
)
def test_options_are_checked(name, options, message):
    with pytest.raises(InputError, match=message):
        kd.Simulation(planets(2), name, dt=0.1, **options)


# --- warnings ---


def warnings_of(system, steps=10, **options) -> list[str]:
    sim = kd.Simulation(system, "wisdom-holman", dt=options.pop("dt", 0.05), **options)
    sim.run(steps)
    return sim.run(steps).warnings


def test_an_ordinary_run_warns_of_nothing():
    assert warnings_of(planets(4, 1)) == []


@BOTH
def test_a_long_step_is_warned_of_once(coordinates):
    names = ["Star", "Inner", "Outer"]
    (line,) = warnings_of(planets(2, names=names), dt=0.4, coordinates=coordinates)
    assert line.startswith("dt = 0.4 is long: Inner passes its pericentre as on a circle of period ")
    assert line.endswith(" kicks; 20 or more resolve it")


def test_eccentric_orbits_need_steps_for_their_pericentre():
    """a = 1, e = 0.9: 2 pi sqrt(0.1^3 / 1.9) = 0.1441."""
    x, v = [[0.0, 0.0, 0.0], [1.9, 0.0, 0.0]], [[0.0, 0.0, 0.0], [0.0, sqrt(0.1 / 1.9), 0.0]]
    system = kd.System(x, v, masses=[1.0, 0.0], forces=[kd.Gravity()], units="nbody")
    (line,) = warnings_of(system, dt=0.01)
    assert "particle 1 passes its pericentre as on a circle of period 0.1441, in 14.4 kicks" in line
    assert warnings_of(system, dt=0.007) == []


@BOTH
def test_a_visitor_is_warned_of_once(coordinates):
    x, v = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [-30.0, 4.0, 0.0]], [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.5, 0.0, 0.0]]
    names = ["Star", "Planet", "Visitor"]
    system = kd.System(x, v, masses=[1.0, 1e-3, 1e-8], forces=[kd.Gravity()], units="nbody", names=names)
    (line,) = warnings_of(system, coordinates=coordinates)
    assert line.startswith("Visitor is on a hyperbola from t = 0.025 on")


def test_a_visitor_that_is_past_its_pericentre_needs_no_steps_for_it():
    x, v = [[0.0, 0.0, 0.0], [3.0, 0.0, 0.0]], [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]]
    (line,) = warnings_of(kd.System(x, v, masses=[1.0, 0.0], forces=[kd.Gravity()], units="nbody"))
    assert line.startswith("particle 1 is on a hyperbola")


@BOTH
def test_a_close_encounter_is_warned_of_once(coordinates):
    """A massless body on a crossing course, 0.05 from a planet whose Hill radius is 0.069."""
    f = 0.15
    x = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.05 * np.cos(f), 1.05 * np.sin(f), 0.0]]
    v = [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-0.9 * np.sin(f), 0.9 * np.cos(f), 0.0]]
    names = ["Star", "Planet", "Stone"]
    system = kd.System(x, v, masses=[1.0, 1e-3, 0.0], forces=[kd.Gravity()], units="nbody", names=names)
    lines = warnings_of(system, 60, coordinates=coordinates)
    (line,) = [line for line in lines if "Hill" in line]
    time = float(line.split("t = ")[1].split(":")[0])
    assert line.startswith("Planet and Stone come within the Hill radius at t = ")
    sim = kd.Simulation(system, "dop853", rtol=1e-10, atol=1e-10)
    gaps = []
    for moment in (time - 0.05, time):
        sim.run(until=moment)
        gaps.append(np.linalg.norm(sim.state.positions[1] - sim.state.positions[2]))
    hill = (1e-3 / 3.0) ** (1 / 3)
    assert gaps[1] < hill * 1.01
    assert gaps[0] > hill * 0.99


def test_a_fall_to_infinity_is_an_error():
    sim = kd.Simulation(planets(2), "wisdom-holman", dt=1e300)
    with pytest.raises(RunError, match="wisdom-holman, dt = 1e\\+300: "):
        sim.run(2)


@pytest.mark.parametrize("coordinates", ["jacobi", "democratic-heliocentric"])
def test_errors_of_an_orbits_energy_have_no_common_sign(coordinates):
    """Planets almost without mass keep their energies. Errors of one sign in the Kepler series once added up to 4e-12
    in this orbit. A walk by 1.5 units of rounding a step reaches 2e-13; some 4e-13 beside it are left. Orbits in
    registers and in lanes have code of their own."""
    steps, a, e = 1_000_000, 0.3871, 0.2056
    x, v = np.zeros((2, 3, 3))
    x[1, 0], v[1, 1] = a * (1.0 - e), sqrt((1.0 + e) / (1.0 - e) / a)
    x[2, 0], v[2, 1] = 30.0, sqrt(1.0 / 30.0)
    system = kd.System(x, v, masses=[1.0, 1e-16, 1e-16], forces=[kd.Gravity(G=1.0)])
    dt = 0.1447  # in no simple ratio to the period, so that all phases occur
    state = after(system, steps, dt=dt, coordinates=coordinates)
    moved_x, moved_v = state.positions[1] - state.positions[0], state.velocities[1] - state.velocities[0]
    energy = 0.5 * moved_v @ moved_v - 1.0 / sqrt(moved_x @ moved_x)
    assert abs(energy * 2.0 * a + 1.0) < 1.5e-12


EACH = pytest.mark.parametrize("kernel", KERNELS)


def run(system, steps=60, pieces=1, **options) -> kd.Simulation:
    sim = kd.Simulation(system, "wisdom-holman", dt=0.1, **options)
    for _ in range(pieces):
        sim.run(steps // pieces, every=steps if pieces == 1 else None)
    return sim


@EACH
@pytest.mark.parametrize(("count", "massless"), [(1, 0), (3, 1), (10, 2), (5, 5)])
def test_kernels_agree_with_a_plain_map(kernel, count, massless):
    """Heavy planets, so that the correction of the kick is far above rounding."""
    system = planets(count, massless, scale=1e-2, boost=0.3)
    x, v = plain_map(system, 0.1, 3, True, kernel)
    state = run(system, 3, kernel=kernel).state
    np.testing.assert_allclose(state.positions, x.astype(float), rtol=0.0, atol=3e-16 * np.abs(x).max() + 1e-15)
    np.testing.assert_allclose(state.velocities, v.astype(float), rtol=0.0, atol=2e-15)
    if count - massless > 1:
        assert np.abs(run(system, 3).state.velocities - state.velocities).max() > 5e-11


@EACH
def test_error_goes_with_dt_to_the_fourth_and_with_the_masses_squared(kernel):
    """epsilon^2 dt^4 with a high corrector, where the standard kernel has epsilon^2 dt^2 (Rein et al. 2019)."""
    errors = {
        (scale, dt): energy_error(planets(3, scale=scale), dt, kernel=kernel, corrector=17, compensated=True)
        for scale, dt in ((1e-3, 0.2), (1e-3, 0.14), (1e-4, 0.2))
    }
    assert np.log(errors[1e-3, 0.2] / errors[1e-3, 0.14]) / np.log(0.2 / 0.14) == pytest.approx(4.0, abs=0.3)
    assert np.log10(errors[1e-3, 0.2] / errors[1e-4, 0.2]) == pytest.approx(2.0, abs=0.15)
    plain = energy_error(planets(3, scale=1e-3), 0.14, corrector=17)
    assert errors[1e-3, 0.14] < 0.01 * plain


@EACH
def test_looks_and_pieces_change_no_bit(kernel):
    given = {"kernel": kernel, "corrector": 7, "compensated": True}
    system = planets(9, 3)
    whole = run(system, **given).state.phase
    np.testing.assert_array_equal(run(system, pieces=60, **given).state.phase, whole)
    np.testing.assert_array_equal(run(system, pieces=4, **given).state.phase, whole)


def test_the_standard_kernel_is_the_default():
    np.testing.assert_array_equal(run(planets(), kernel=STANDARD).state.phase, run(planets()).state.phase)
    assert run(planets(), 1).options.get("kernel") is None


@pytest.mark.parametrize("kernel", [LAZY, COMPOSITION])
def test_other_forces_join_the_kernel(kernel):
    """Against an eighth-order method; the difference scales as dt^4, and as dt^2 with the standard kernel."""
    system = planets(3, forces=[kd.HarmonicTrap(1e-4), kd.UniformField((1e-3, 2e-3, -3e-3))])
    truth = kd.Simulation(system, "dop853", rtol=1e-13, atol=1e-13)
    truth.run(until=8.0)

    def error(dt: float, kernel: str) -> float:
        sim = kd.Simulation(system, "wisdom-holman", dt=dt, kernel=kernel, corrector=17)
        sim.run(round(8.0 / dt), every=round(8.0 / dt))
        return float(np.abs(sim.state.positions - truth.state.positions).max())

    coarse, fine = (error(dt, kernel) for dt in (0.2, 0.1))
    assert np.log2(coarse / fine) == pytest.approx(4.0, abs=0.6)
    assert fine < 0.1 * error(0.1, STANDARD)


@pytest.mark.parametrize("order", CORRECTOR.choices[1:])
def test_a_mirrored_corrector_has_the_same_linear_terms_and_is_a_palindrome(order):
    plain, mirrored = corrector(order), corrector(order, mirrored=True)
    assert mirrored.shape[1] == 2 * plain.shape[1] - 2
    np.testing.assert_allclose(mirrored[0], mirrored[0, ::-1] * [-1.0], atol=1e-15)
    np.testing.assert_array_equal(mirrored[1, :-1], mirrored[1, -2::-1])
    for power in range(order):
        terms = [kicks @ np.cumsum(drifts) ** power for drifts, kicks in (plain, mirrored)]
        assert terms[1] == pytest.approx(terms[0], abs=1e-12)


def test_a_step_of_a_composition_is_as_long_as_any():
    """Its five kicks within a step are no five steps: the pericentre needs as many steps as with one kick."""
    (line,) = run(planets(2), 1, kernel=COMPOSITION, coordinates="jacobi").run(3).warnings or [""]
    assert line == ""
    sim = kd.Simulation(planets(2), "wisdom-holman", dt=0.4, kernel=COMPOSITION)
    assert any("is long" in line for line in sim.run(3).warnings)


def test_a_modified_kick_needs_gravity_alone():
    system = planets(2, forces=[kd.UniformField((0.0, 0.0, 1e-3))])
    with pytest.raises(
        InputError, match="modified-kick needs the gradient of each force, and 'uniform-field' has none"
    ):
        kd.Simulation(system, "wisdom-holman", dt=0.1, kernel=MODIFIED_KICK)
