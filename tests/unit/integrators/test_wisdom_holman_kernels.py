"""Kernels of wisdom-holman: against a plain map, slopes of the error, looks and restarts, other forces, refusals."""

from __future__ import annotations

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.integrators.options.option import COMPOSITION, CORRECTOR, HELIOCENTRIC, LAZY, MODIFIED_KICK, STANDARD
from kickdrift.integrators.wisdom_holman.corrector import corrector
from tests.oracle.wisdom_holman import energy_error, plain_map, planets

KERNELS = LAZY, COMPOSITION, MODIFIED_KICK
EACH = pytest.mark.parametrize("kernel", KERNELS)


def run(system, steps=60, pieces=1, **options) -> kd.Simulation:
    sim = kd.Simulation(system, "wisdom-holman", dt=0.1, **options)
    for _ in range(pieces):
        sim.run(steps // pieces, every=steps if pieces == 1 else None)
    return sim


@EACH
@pytest.mark.parametrize(("count", "massless"), [(1, 0), (3, 1), (10, 2), (5, 5)])
def test_agrees_with_a_plain_map(kernel, count, massless):
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


@EACH
def test_restarts_with_the_same_bits(kernel, tmp_path):
    given = {"integrator": "wisdom-holman", "dt": 0.1, "kernel": kernel, "corrector": 17}
    whole, part = (kd.Simulation(planets(4, 1), **given) for _ in range(2))
    whole.run(40, every=10)
    part.run(20, every=10, output=tmp_path / "run.h5md")
    again = kd.resume(tmp_path / "run.h5md")
    assert again.options.get("kernel") == kernel
    again.run(20, every=10)
    np.testing.assert_array_equal(again.state.phase, whole.state.phase)


def test_force_evaluations_are_the_kicks():
    for kernel, kicks in ((STANDARD, 1), (LAZY, 2), (COMPOSITION, 5), (MODIFIED_KICK, 1)):
        sim = run(planets(), 10, kernel=kernel)
        assert sim.run(10).force_evaluations == 20 * kicks


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


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"kernel": "quick"}, "kernel 'quick' is unknown; known are standard, lazy, composition, modified-kick"),
        *(
            (
                {"kernel": kernel, "coordinates": HELIOCENTRIC},
                f"kernel: {kernel} needs coordinates = 'jacobi', and coordinates is 'democratic-heliocentric'",
            )
            for kernel in KERNELS
        ),
        ({"integrator": "saba", "kernel": LAZY}, "kernel: saba does not take it"),
    ],
)
def test_options_are_checked(given, message):
    with pytest.raises(InputError, match=message):
        kd.Simulation(planets(2), **{"integrator": "wisdom-holman", "dt": 0.1} | given)


def test_a_modified_kick_needs_gravity_alone():
    system = planets(2, forces=[kd.UniformField((0.0, 0.0, 1e-3))])
    with pytest.raises(
        InputError, match="modified-kick needs the gradient of each force, and 'uniform-field' has none"
    ):
        kd.Simulation(system, "wisdom-holman", dt=0.1, kernel=MODIFIED_KICK)
