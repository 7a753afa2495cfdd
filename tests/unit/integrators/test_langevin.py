"""Langevin words beyond the plain ones: gjf, brownian, refined noise, and compositions of the Nosé-Hoover chain."""

from __future__ import annotations

import math

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.forces.bound.forces import most_threads
from kickdrift.integrators import integrator
from kickdrift.integrators.own.registration import unregister
from kickdrift.integrators.stepping import loops
from tests.systems import assert_mean_squares, wells

WORDS = ("baoab", "obabo", "aboba", "oabao", "baoa")
BATH = {"temperature": 1.5, "friction": 1.3, "seed": 7}


def free(n: int) -> kd.System:
    return kd.System(np.arange(3.0 * n).reshape(n, 3), np.zeros((n, 3)), units="lj")


def states(system: kd.System, name: str, dt: float, steps: int, **options) -> list[kd.State]:
    sim = kd.Simulation(system, name, dt, **options)
    found = []
    for _ in range(steps):
        sim.advance(1)
        found.append(sim.state)
    return found


def midpoint(dt: float) -> tuple[float, float]:
    """The numbers a and sqrt(1 - a^2) of Gronbech-Jensen & Farago, for unit mass."""
    a = (1.0 - 0.5 * BATH["friction"] * dt) / (1.0 + 0.5 * BATH["friction"] * dt)
    return a, math.sqrt(1.0 - a * a)


def midpoint_noise(n: int, dt: float, steps: int, **options) -> np.ndarray:
    """Normal numbers of gjf, from the velocities of free particles."""
    a, b = midpoint(dt)
    v = [np.zeros((n, 3)), *(state.velocities for state in states(free(n), "gjf", dt, steps, **BATH, **options))]
    return np.array([(v[k + 1] - a * v[k]) / (b * math.sqrt(BATH["temperature"])) for k in range(steps)])


def test_gjf_is_the_published_recursion():
    """The recursion of Gronbech-Jensen & Farago 2013 in NumPy, with the noise that free particles show."""
    n, dt, steps = 20, 0.4, 12
    system, friction = wells(n), BATH["friction"]
    b = 1.0 / (1.0 + 0.5 * friction * dt)
    a = (1.0 - 0.5 * friction * dt) * b
    x, v = system.state.positions, system.state.velocities
    for normal in midpoint_noise(n, dt, steps):
        beta = math.sqrt(2.0 * friction * BATH["temperature"] * dt) * normal
        ahead = x + b * dt * v - 0.5 * b * dt * dt * x + 0.5 * b * dt * beta
        v = a * v - 0.5 * dt * (a * x + ahead) + b * beta
        x = ahead
    found = states(system, "gjf", dt, steps, **BATH)[-1]
    np.testing.assert_allclose(found.positions, x, rtol=0.0, atol=1e-13)
    np.testing.assert_allclose(found.velocities, v, rtol=0.0, atol=1e-13)


def test_brownian_is_the_limit_method():
    """x + dt F / g + sqrt(dt k_B T / 2 g) (R_n + R_n+1), with the velocities as sqrt(k_B T) R."""
    system, dt = wells(20), 0.3
    x, noise = system.state.positions, system.state.velocities
    for state in states(system, "brownian", dt, 10, **BATH):
        spread = math.sqrt(0.5 * dt / BATH["friction"])
        x = x - dt / BATH["friction"] * x + spread * (noise + state.velocities)
        noise = state.velocities
        np.testing.assert_allclose(state.positions, x, rtol=0.0, atol=1e-13)


def test_gjf_and_brownian_have_exact_means_in_a_well():
    """<x^2> = k_B T / k for both; <v^2> = 1 - (omega dt)^2 / 4 for gjf, and Maxwell's for brownian."""
    for name, squares in (("gjf", 0.75), ("brownian", 1.0)):
        sim = kd.Simulation(wells(2000), name, 1.0, temperature=1.0, friction=1.0, seed=3)
        assert_mean_squares(sim, (1.0, squares))


def test_a_report_of_brownian_judges_no_temperature():
    report = kd.Simulation(wells(20), "brownian", 0.01, **BATH).run(200)
    assert report.temperature_verdict == "the bath draws velocities; no test of the motion"
    assert "asked 1.5 ε/k_B: the bath draws velocities" in str(report)
    assert not report.warnings
    with pytest.raises(InputError, match=r"^friction is needed"):
        kd.Simulation(wells(2), "brownian", 0.01, temperature=1.0)


@pytest.mark.parametrize("name", WORDS)
def test_refined_noise_gives_free_particles_the_same_velocities(name):
    """The bridge is exact: without forces, velocities at dt and at dt / 2 are equal at every time."""
    whole = states(free(9), name, 0.5, 6, **BATH)
    half = states(free(9), name, 0.25, 12, noise="refine", **BATH)[1::2]
    for first, second in zip(whole, half, strict=True):
        np.testing.assert_allclose(first.velocities, second.velocities, rtol=0.0, atol=1e-14)
    assert np.abs(whole[-1].velocities).min() > 1e-6


def test_refined_noise_of_gjf_and_brownian_adds_up():
    """Their noise is that of Brownian motion: the numbers of two halves add up to sqrt(2) times that of the whole."""
    spread = math.sqrt(BATH["temperature"])
    drawn = [
        [state.velocities / spread for state in states(free(9), "brownian", dt, steps, **BATH, **options)]
        for dt, steps, options in ((0.5, 4, {}), (0.25, 8, {"noise": "refine"}))
    ]
    for whole, half in (drawn, (midpoint_noise(9, 0.5, 4), midpoint_noise(9, 0.25, 8, noise="refine"))):
        halves = np.array(half)
        np.testing.assert_allclose(halves[::2] + halves[1::2], math.sqrt(2.0) * np.array(whole), rtol=0.0, atol=1e-13)


@pytest.mark.parametrize("name", ["obabo", "brownian"])
def test_refined_noise_is_noise(name):
    """Its numbers are standard normal and independent: variance one and no correlation, within four errors."""
    n = 20_000
    if name == "brownian":
        numbers = np.array([s.velocities for s in states(free(n), name, 0.25, 4, noise="refine", **BATH)]) / 1.5**0.5
    else:
        kept = math.exp(-BATH["friction"] * 0.25)
        v = [s.velocities for s in states(free(n), name, 0.25, 4, noise="refine", **BATH)]
        numbers = np.array([(v[k + 1] - kept * v[k]) for k in range(3)]) / math.sqrt(1.5 * (1.0 - kept**2))
    rows = numbers.reshape(len(numbers), -1)
    products = rows @ rows.T / rows.shape[1]
    assert np.abs(products - np.eye(len(rows))).max() < 4 * math.sqrt(2.0 / rows.shape[1])


@pytest.mark.parametrize(("name", "order"), [*((name, 1.0) for name in (*WORDS, "gjf")), ("brownian", 0.5)])
def test_strong_order(name, order):
    apart = []
    for dt in (0.1, 0.05):
        steps = round(1.6 / dt)
        whole, half = (
            kd.Simulation(wells(2000), name, dt, **BATH),
            kd.Simulation(wells(2000), name, dt / 2, noise="refine", **BATH),
        )
        whole.advance(steps)
        half.advance(2 * steps)
        apart.append(np.std(whole.state.positions - half.state.positions))
    assert math.log2(apart[0] / apart[1]) == pytest.approx(order, abs=0.1)


def test_refined_noise_needs_equal_parts():
    kd.register_splitting("uneven", word="OABAO", weights=(0.25, 0.5, 1, 0.5, 0.75), order=1, source="a test")
    try:
        kd.Simulation(wells(2), "uneven", 0.1, **BATH).advance(2)
        with pytest.raises(InputError, match=r"^noise: refine needs a word whose bath acts for equal parts"):
            kd.Simulation(wells(2), "uneven", 0.1, noise="refine", **BATH)
    finally:
        unregister("uneven")


@pytest.mark.parametrize(
    ("word", "options"),
    [
        ("OBABO", {"friction": 1.0}),
        ("BACAB", {"tau": 0.5}),
        ("BANAB", {"tau": 0.5}),
        ("ABDBA", {"collision_rate": 1.0}),
    ],
)
def test_a_word_with_a_bath_is_one_line(word, options):
    kd.register_splitting("mine", word=word, order=2, source="a test")
    try:
        report = kd.Simulation(wells(300), "mine", 0.1, temperature=2.0, **options).run(400, every=10)
        assert report.temperature == pytest.approx(2.0, rel=0.2)
        assert report.heat != 0
    finally:
        unregister("mine")


def test_two_baths_in_a_word_are_refused():
    with pytest.raises(InputError, match=r"^mine: a word has one heat bath, not 2: O \(Ornstein-Uhlenbeck\) and C"):
        kd.register_splitting("mine", word="BAOCAB", order=2, source="a test")


@pytest.mark.parametrize(
    ("splitting", "dt", "order"), [("yoshida4", 0.1, 4), ("yoshida6", 0.2, 6), ("yoshida8", 0.2, 8)]
)
def test_the_order_of_the_chain(splitting, dt, order):
    """Slopes of positions and of the conserved quantity; a fine run of yoshida8 stands for the exact solution."""
    rng = np.random.default_rng(4)
    system = kd.System(rng.normal(size=(4, 3)), rng.normal(size=(4, 3)), forces=[kd.HarmonicTrap(1.0)], units="lj")

    def run(dt: float, splitting: str) -> tuple[np.ndarray, float]:
        sim = kd.Simulation(system, "nose-hoover", dt, temperature=1.0, tau=1.0, splitting=splitting, compensated=True)
        sim.run(round(4.0 / dt))
        kept = [sample.energies.total + sample.taken.energy for sample in sim.record.samples]
        return sim.state.positions, float(np.std(kept))

    exact = run(0.0125, "yoshida8")[0]
    (coarse, spread), (fine, less) = run(dt, splitting), run(0.5 * dt, splitting)
    assert math.log2(np.abs(coarse - exact).max() / np.abs(fine - exact).max()) == pytest.approx(order, abs=0.2)
    assert math.log2(spread / less) == pytest.approx(order, abs=0.2)
    assert integrator("nose-hoover").order == 2


@pytest.mark.parametrize(("name", "bath"), [("baoab", BATH), ("andersen", {"temperature": 1.5, "collision_rate": 1.3})])
def test_chunks_of_the_noise_have_the_same_bits_on_any_number_of_threads(monkeypatch, name, bath):
    """The last of eight chunks is not full. Chunks change no velocity, and the heat of a run by rounding alone."""
    found = []
    for fewest, threads in ((10**6, 1), (10, 1), (10, min(2, most_threads()))):
        monkeypatch.setattr(loops, "WORTH_CHUNKS", fewest)
        sim = kd.Simulation(wells(101), name, 0.1, threads=threads, **bath)
        sim.run(6)
        found.append((sim.state.phase.tobytes(), sim.integration.stepper.heat))
    assert found[1] == found[2]
    assert found[0][0] == found[1][0]
    assert found[0][1] == pytest.approx(found[1][1], rel=1e-13)
