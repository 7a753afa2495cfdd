"""Heat baths: exact averages of a harmonic well, the right distributions, and quantities that are conserved."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.integrators import integrator
from tests.systems import BATH, assert_mean_squares, liquid, needed, wells

BATHS = ("baoab", "obabo", "aboba", "oabao", "baoa", "csvr", "nose-hoover", "andersen")
# Means of x^2 and v^2 at omega dt = 1, friction 1, over the exact ones: Leimkuhler & Matthews 2013,
# doi:10.1093/amrx/abs010, and for baoa Kieninger & Keller 2022, doi:10.1021/acs.jctc.2c00585.
OSCILLATOR = {
    "baoab": (1, 3 / 4), "aboba": (1, 4 / 3), "obabo": (4 / 3, 1), "oabao": (3 / 4, 1), "baoa": (1, 1),
}  # fmt: skip


@pytest.mark.parametrize("name", OSCILLATOR)
def test_averages_of_a_harmonic_well(name):
    sim = kd.Simulation(wells(2000, seed=1), name, dt=1.0, temperature=1.0, friction=1.0, seed=3)
    assert_mean_squares(sim, OSCILLATOR[name])


@pytest.mark.parametrize("name", BATHS)
def test_energy_and_heat_are_conserved_together(name):
    """The error of total energy less heat has the order of velocity Verlet; the energy itself wanders."""
    errors, system = [], liquid(64, 2.0)
    for dt in (0.004, 0.002):
        sim = kd.Simulation(system, name, dt, **needed(name))
        report = sim.run(round(0.8 / dt), every=round(0.008 / dt))
        errors.append(report.energy.max_relative_error)
        totals = [sample.energies.total for sample in sim.record.samples]
        assert np.ptp(totals) > 20 * report.energy.max_relative_error * abs(totals[0])
        assert report.heat == sim.integration.stepper.heat
        assert (report.momentum_error is None) == integrator(name).drags
    assert math.log2(errors[0] / errors[1]) > (1.0 if integrator(name).order == 2 else 0.7)  # the paths differ


@pytest.mark.parametrize("name", ["csvr", "nose-hoover", "baoab", "andersen"])
def test_the_kinetic_energy_has_its_canonical_distribution(name):
    """2 K / k_B T is chi-squared with 3 N - 3 degrees of freedom, or 3 N where the bath moves the centre of mass."""
    system, strong = liquid(64, 2.0), {"friction": 5.0, "tau": 0.05, "collision_rate": 5.0}
    options = needed(name) | {key: value for key, value in strong.items() if key in needed(name)}
    sim = kd.Simulation(system, name, 0.004, **options)
    sim.advance(1000)
    found = []
    for _ in range(300):
        sim.advance(40)
        found.append(2 * sim.energy().kinetic)
    freedom = 3 * 64 - 3 * (not integrator(name).drags)
    assert stats.kstest(found, stats.chi2(freedom).cdf).pvalue > 1e-3
    report = sim.report()
    assert report.temperature == pytest.approx(2 * sim.record.samples[-1].energies.kinetic / freedom, rel=0.5)


@pytest.mark.parametrize(("box", "freedom"), [((10.0, 10.0), 2), (None, 1)])
def test_csvr_of_one_or_two_degrees_of_freedom(box, freedom):
    """Two particles in two dimensions, of which the second pair does not turn: no gamma variate is needed."""
    turn = 0.0 if box is None else 1.0
    system = kd.System([[0.0, 0], [5.0, 0]], [[0.3, turn], [-0.3, -turn]], box=box, dimensions=2, units="lj")
    sim = kd.Simulation(system, "csvr", 0.1, temperature=2.0, tau=0.1, seed=5)
    found = []
    for _ in range(400):
        sim.advance(5)
        found.append(sim.energy().kinetic)
    assert stats.kstest(found, stats.gamma(freedom / 2, scale=2.0).cdf).pvalue > 1e-3
    assert np.abs(sim.state.velocities.sum(axis=0)).max() < 1e-13


def test_two_dimensions_stay_in_the_plane():
    x = np.indices((4, 4)).reshape(2, -1).T * 1.2
    system = kd.System(x, box=(4.8, 4.8), forces=[kd.LennardJones(cutoff=2.0)], dimensions=2)
    for name in ("baoab", "andersen"):
        sim = kd.Simulation(system, name, 0.005, **needed(name))
        sim.run(200)
        assert not sim.state.velocities[:, 2].any()
        assert sim.energy().kinetic > 1.0


def test_noise_depends_on_the_seed_and_the_particle():
    system = wells(20, seed=1)

    def end(**options):
        sim = kd.Simulation(system, "baoab", 0.1, temperature=1.0, friction=1.0, **options)
        sim.run(5)
        return sim.state.velocities

    assert np.array_equal(end(), end(seed=0))
    assert not np.any(end(seed=1) == end(seed=2))


@pytest.mark.parametrize(
    ("name", "options", "line"),
    [
        ("baoab", {"friction": 1.0}, "temperature is needed: a heat bath has no default temperature"),
        ("baoab", {"temperature": 1.0}, "friction is needed: a heat bath has no default friction"),
        ("csvr", {"temperature": 1.0}, "tau is needed"),
        ("baoab", {"temperature": -1.0, "friction": 1.0}, "temperature must be a positive finite temperature, got"),
        ("baoab", {"temperature": 1.0, "friction": 0}, "friction must be a positive finite rate, got 0"),
        ("nose-hoover", BATH | {"chain": 0}, "friction: nose-hoover does not take it; it takes dt, compensated"),
        ("velocity-verlet", {"temperature": 1.0}, "temperature: velocity-verlet does not take it"),
    ],
)
def test_baths_refuse_numbers_that_make_no_sense(name, options, line):
    with pytest.raises(InputError, match=f"^{line}"):
        kd.Simulation(liquid(64, 2.0), name, 0.004, **options)


def test_gravity_and_odes_have_no_bath():
    bodies = kd.System([[0, 0, 0], [1, 0, 0]], masses=[1, 1e-3], forces=[kd.Gravity()], units="nbody")
    with pytest.raises(InputError, match="a heat bath makes no sense under gravity"):
        kd.Simulation(bodies, "langevin", 0.01, temperature=1.0, friction=1.0)
    with pytest.raises(InputError, match="a heat bath needs particles"):
        kd.Simulation(
            kd.Problem(lambda t, y: [y[1], -y[0]], [1.0, 0.0], separable=True), "csvr", 0.01, temperature=1.0, tau=1.0
        )
