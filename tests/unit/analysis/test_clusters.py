"""Star clusters: radii, core, relaxation, anisotropy, binaries, escapers, tides; reports, columns, the command."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import kickdrift as kd
from kickdrift.analysis.clusters.cluster import lagrangian, relaxation_time
from kickdrift.cli.main import app
from kickdrift.errors import InputError
from kickdrift.model.starts.plummer import plummer

SCALE = 3 * math.pi / 16  # of Plummer's sphere in N-body units
# By clustertools 1 (Webb 2023, doi:10.21105/joss.04483) of the same stars: Lagrangian radii of one to nine tenths about
# the origin, and the half-mass relaxation time with coulomb = 0.11, in pc, km/s and Msun with its G = 0.004302.
RADII = (0.310614, 0.426009, 0.529513, 0.634617, 0.760237, 0.928915, 1.142877, 1.475973, 2.150898)
RELAXATION = 506.06406868899705 / (3.086e13 / 3.1536e13)  # without its factor from pc and km/s to a million years


def stars(n: int, seed: int, forces: Any = ()) -> kd.System:
    x, v, masses = plummer(n, seed, scaled=False)
    return kd.System(x, v, masses, forces=[kd.Gravity(), *forces], units="nbody", name="cluster")


def with_pair(a: float, e: float) -> kd.System:
    """A cluster of 200 stars, of which the first two are a pair at its apocentre."""
    x, v, masses = plummer(200, 3)
    x[1] = x[0] + [a * (1 + e), 0, 0]
    v[1] = v[0] + [0, math.sqrt(2 * masses[0] / a * (1 - e) / (1 + e)), 0]
    return kd.System(x, v, masses, forces=[kd.Gravity()], units="nbody")


def test_plummers_sphere_has_its_radii_and_its_core():
    """Half-mass radius 1.305 a; Casertano & Hut's core radius is the integral of r rho^2 over that of rho^2, 0.6791 a;
    the mean of rho with the weight rho^2 is 0.4631 of the central density."""
    found = [kd.analysis.cluster(stars(1000, seed)) for seed in range(8)]
    means = {
        key: np.mean([getattr(each, key) for each in found]) for key in ("core_radius", "core_density", "anisotropy")
    }
    half = np.mean([each.half_mass_radius for each in found]) / SCALE
    assert half == pytest.approx(1 / math.sqrt(2 ** (2 / 3) - 1), rel=0.03)
    assert means["core_radius"] / SCALE == pytest.approx(0.6791, rel=0.04)
    assert means["core_density"] / (3 / (4 * math.pi * SCALE**3)) == pytest.approx(0.4631, rel=0.08)
    assert abs(means["anisotropy"]) < 0.05
    assert all(np.linalg.norm(each.centre) < 0.2 and each.escapers < 5 and not each.binaries for each in found)


def test_radii_and_relaxation_are_those_of_clustertools():
    x, _, masses = plummer(2000, 7)
    found = lagrangian(np.linalg.norm(x, axis=1), masses, np.arange(1, 10) / 10)
    np.testing.assert_allclose(found, RADII, rtol=4e-3)  # the radius of a star there, between two stars here
    assert relaxation_time(0.004302, 2000, 1.0, RADII[4], 0.11) == pytest.approx(RELAXATION, rel=1e-5)


@pytest.mark.parametrize(("a", "e"), [(1e-3, 0.3), (1e-4, 0.9)])
def test_a_hard_pair_has_its_orbit(a, e):
    system = with_pair(a, e)
    (pair,) = kd.analysis.binaries(system)
    m = 1 / 200
    assert (pair.first, pair.second) == (0, 1)
    assert pair.energy == pytest.approx(-m * m / (2 * a), rel=1e-9)
    assert (pair.semi_major_axis, pair.eccentricity) == pytest.approx((a, e), rel=1e-8)
    assert pair.period == pytest.approx(2 * math.pi * math.sqrt(a**3 / (2 * m)), rel=1e-9)
    found = kd.analysis.cluster(system)
    assert found.binaries == 1
    assert found.binary_energy == pair.energy
    assert found.hardest == pair.hardness == pytest.approx(-pair.energy / found.temperature)
    assert abs(found.anisotropy) < 0.3  # the motion inside the pair does not count


def test_a_fast_star_escapes_and_a_tide_sets_the_radius():
    """In a harmonic field of stiffness k per mass m the tide is Omega^2 - k / m."""
    system = stars(300, 1, [kd.HarmonicTrap(stiffness=0.2 / 300)])
    x, v = system.state.positions + np.array([10.0, 0, 0]), system.state.velocities + np.array([0, 6.0, 0])
    v[5, 2] += 50.0
    moved = kd.System(x, v, system.state.masses, forces=system.forces, units="nbody")
    found = kd.analysis.cluster(moved)
    inside = (np.linalg.norm(x - found.centre, axis=1) <= found.tidal_radius).mean()
    speed = np.linalg.norm(np.cross(found.centre, found.velocity)) / (found.centre @ found.centre)
    assert found.tidal_radius == pytest.approx((inside / (speed**2 - 0.2)) ** (1 / 3), rel=0.01)
    assert found.escapers >= 1
    far = np.linalg.norm(x - found.centre, axis=1) > 2 * found.tidal_radius
    assert found.escapers >= far.sum()
    given = kd.analysis.cluster(system, tidal_radius=1.0)
    r = np.linalg.norm(system.state.positions - given.centre, axis=1)
    assert given.escapers >= (r > 2).sum()
    assert given.tidal_radius == 1.0


def test_a_run_records_what_its_report_tells(tmp_path):
    path, names = tmp_path / "run.h5md", ("core_radius", "lagrangian_radii", "binaries", "tidal_radius")
    sim = kd.Simulation(stars(40, 2), "leapfrog", dt=0.01)
    sim.run(20, every=5, output=path, columns=kd.analysis.cluster_columns(*names, fractions=(0.25, 0.5)))
    with kd.open(path) as run:
        report = kd.analysis.cluster_report(run, fractions=(0.25, 0.5))
        for name in names:
            np.testing.assert_array_equal(run.observables[name], report.series(name))
        assert kd.analysis.cluster(run[-1], fractions=(0.25, 0.5)).core_radius == report.states[-1].core_radius
        assert run.plot("cluster").axes
    assert "Lagrangian radii" in str(report)
    assert report.relaxed[0] == 0.0
    told, drawn = tmp_path / "told.json", tmp_path / "drawn.png"
    done = CliRunner().invoke(
        app,
        ["cluster", str(path), "--fraction", "0.25", "--fraction", "0.5", "--json", str(told), "--plot", str(drawn)],
    )
    assert done.exit_code == 0, done.output
    read = json.loads(told.read_text())
    assert read["core_radius"] == report.series("core_radius").tolist()
    assert read["tidal_radius"] == [None] * 5
    assert drawn.stat().st_size > 1000


@pytest.mark.parametrize(
    ("call", "expected"),
    [
        (lambda: kd.analysis.cluster(kd.load("lj-1000")), "expected a system with the force gravity or gravity-tree"),
        (lambda: kd.analysis.cluster(3), "expected a System, a Simulation or a frame such as run"),
        (lambda: kd.analysis.cluster(stars(5, 1)), "6 neighbours need 7 bodies with mass or more, got 5"),
        (lambda: kd.analysis.cluster(stars(9, 1), fractions=(0.5, 0.2)), "fractions must increase from above 0"),
        (lambda: kd.analysis.cluster(stars(9, 1), neighbours=2), "neighbours must be a whole number, 3 or more"),
        (lambda: kd.analysis.cluster(stars(9, 1), tidal_radius=-1.0), "tidal_radius must be a positive length"),
        (lambda: kd.analysis.binaries(stars(9, 1), -1.0), "least_hardness must be a number of kT, 0 or more"),
        (lambda: kd.analysis.cluster_columns("core"), "no result 'core'; expected one of"),
        (lambda: kd.analysis.cluster_report(3), "expected a run, its path or a System, got int"),
        (lambda: kd.analysis.cluster_report(stars(9, 1)).series("core"), "no result 'core'; expected one of"),
    ],
)
def test_bad_input_is_one_line(call, expected):
    with pytest.raises(InputError, match=expected) as error:
        call()
    assert "\n" not in str(error.value)
