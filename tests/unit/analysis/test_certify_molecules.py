"""Certificates of runs with constraints, and faults of constraints that they and reports find."""

from __future__ import annotations

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.analysis.certify.certifying import checked
from kickdrift.analysis.certify.sampled_run import sampled_run
from kickdrift.integrators.splitting import stepper
from kickdrift.integrators.splitting.baths import bath
from kickdrift.integrators.splitting.constraints import flows
from kickdrift.looks import looking
from kickdrift.model import freedom
from tests.long import rest


def pairs(n: int = 40, tolerance: float = 2.0**-52) -> kd.System:
    """Free rigid pairs in a box."""
    rng = np.random.default_rng(1)
    x = np.repeat(rng.uniform(0.0, 20.0, (n, 3)), 2, axis=0)
    x[1::2] += [1.0, 0.0, 0.0]
    held = kd.Constraint(pairs=np.arange(2 * n).reshape(n, 2), distance=1.0, tolerance=tolerance)
    system = kd.System(x, None, np.tile([1.0, 3.0], n), [20.0] * 3, constraints=[held])
    return system.with_velocities(temperature=1.0, seed=1)


def run(path, integrator="baoab", system=None, **options):
    given = {"temperature": 1.0} | ({"friction": 1.0} if integrator == "baoab" else {"tau": 0.5}) | options
    sim = kd.Simulation(system or pairs(), integrator, dt=0.05, **given)
    report = sim.run(30_000, every=60, output=path, overwrite=True)
    return sim, report, sampled_run(path)


def excess(found) -> dict[str, float]:
    """Relative excess of the mean heat of each kind of motion over that at temperature 1, in standard errors of
    independent samples."""
    return {
        group.name.split()[0]: (2.0 * group.kinetic.mean() / group.freedom - 1.0)
        / np.sqrt(2.0 / (group.freedom * len(group.kinetic)))
        for group in found.groups
    }


def test_a_run_with_constraints_is_tested_by_the_motions_of_its_molecules(tmp_path):
    _, report, found = run(tmp_path / "run.h5md")
    assert [(group.name, group.freedom) for group in found.groups] == [
        ("translation of molecules", 120.0),
        ("rotation of molecules", 80.0),
    ]
    assert found.freedom == 200.0
    assert all(abs(value) < 4.0 for value in excess(found).values())
    assert report.molecules.verdict == "equipartition within three standard errors"
    assert "secular" not in report.energy.verdict


def test_a_certificate_of_flexible_molecules_in_a_plane_has_their_vibration(tmp_path):
    """Three chains of three with rigid bonds have 4 freedoms each: 2 translations, a rotation and a vibration."""
    x = np.array([[6.0 * k + a, b] for k in range(3) for a, b in ((0.0, 0.0), (1.0, 0.0), (1.5, 0.8))])
    held = kd.Constraint(pairs=[(3 * k + a, 3 * k + a + 1) for k in range(3) for a in range(2)])
    system = kd.System(x, None, box=[18.0] * 2, constraints=[held], dimensions=2)
    system = system.with_velocities(temperature=1.0, seed=1)
    sim = kd.Simulation(system, "baoab", dt=0.05, temperature=1.0, friction=1.0)
    sim.run(20, every=5, output=tmp_path / "run.h5md")
    found = sampled_run(tmp_path / "run.h5md")
    assert [group.freedom for group in found.groups] == [6.0, 3.0, 3.0]
    assert found.freedom == 12.0
    kinetic = [sample.energies.kinetic for sample in sim.record.samples]
    np.testing.assert_allclose(found.kinetic, kinetic, rtol=1e-12)


def test_a_run_at_rest_with_constraints_goes_back_to_its_start():
    """The check of forces begins at shaken positions, which the run projects."""
    system = pairs(4).with_velocities(np.zeros((8, 3))).with_forces(kd.HarmonicTrap(0.5))
    row = kd.analysis.force_checks(system, steps=100, dt=0.01).row("time reversal")
    assert row.verdict == "pass"
    assert row.measured < 1e-12


def test_a_bath_that_counts_the_constraints_as_freedoms_is_found(tmp_path, monkeypatch):
    def wrong(system, drags=False):
        return freedom.freedom_of(system, drags) + len(system.constraints)

    monkeypatch.setattr(bath, "freedom_of", wrong)
    _, report, found = run(tmp_path / "run.h5md", "csvr")
    assert report.temperature_verdict.startswith("differs")
    assert sum(excess(found).values()) > 20.0


def without(letter):
    def word(letters, weights):
        kept = [(a, b) for a, b in zip(*flows.on_manifold(letters, weights), strict=True) if a != letter]
        return tuple(a for a, _ in kept), tuple(b for _, b in kept)

    return word


def test_velocities_that_are_not_projected_are_found(tmp_path, monkeypatch):
    monkeypatch.setattr(stepper, "on_manifold", without(flows.PROJECT))
    sim, report, found = run(tmp_path / "run.h5md")
    rates = sim.system.constraints.rates(*sim.state.phase)
    assert np.abs(rates).max() > 1e-3
    assert max(map(abs, excess(found).values())) > 5.0 or "secular" in report.energy.verdict


def test_noise_that_is_not_projected_is_found(tmp_path, monkeypatch):
    """The heat of the bath then includes motion that the next projection takes."""
    monkeypatch.setattr(stepper, "on_manifold", without(flows.TEMPER))
    _, report, _ = run(tmp_path / "run.h5md")
    assert report.energy.verdict == "secular drift"


@pytest.mark.parametrize("faulty", [rest(False), True])
def test_a_virial_without_the_forces_of_constraints_is_found(tmp_path, monkeypatch, faulty):
    """All kinetic energy then counts as pressure, 5 / 3 of that of an ideal gas of pairs."""
    if faulty:
        monkeypatch.setattr(looking, "parted", lambda constraints: np.zeros(0))
    barostat = {"pressure": 0.005, "pressure_tau": 5.0, "compressibility": 200.0}
    _, report, found = run(tmp_path / "run.h5md", **barostat)
    failed = [row.test for row in checked([found]).failed]
    assert ("mean pressure" in failed) == faulty
    assert report.pressure_verdict.startswith("differs" if faulty else "agrees")


@pytest.mark.parametrize("tolerance", [1e-3, 1e-5])
def test_a_loose_tolerance_is_reported(tolerance):
    system = pairs(tolerance=tolerance)
    report = kd.Simulation(system, "velocity-verlet", dt=0.1).run(50, every=5)
    assert 1e-13 < report.molecules.error < 2.0 * tolerance


def test_a_step_too_long_for_a_molecule_stops_the_run_and_names_it():
    with pytest.raises(kd.RunError, match="have no solution, because a molecule turned too far in one step"):
        kd.Simulation(pairs(), "velocity-verlet", dt=2.0).run(50)
