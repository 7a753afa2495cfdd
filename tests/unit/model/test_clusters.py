"""Starts of star clusters: King's profile, mass functions, segregation, binaries, units, and bad input."""

from __future__ import annotations

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.model.starts import clusters, king
from kickdrift.model.starts.plummer import pair_sum
from kickdrift.systemfile.reading import loads


def energies(x, v, m):
    return -pair_sum(x, m), 0.5 * float(m @ np.sum(v**2, axis=1))


def test_kings_models_have_their_published_concentrations():
    """King 1966, figure 1 and later tables. W0 = 0 is the polytrope of index 5/2, whose edge is at 5.35528 of Lane and
    Emden's lengths (Chandrasekhar 1939), which are a third of ours."""
    for depth, concentration in ((3.0, 0.672), (5.0, 1.029), (7.0, 1.528), (9.0, 2.119), (12.0, 2.739)):
        assert king.profile(depth).concentration == pytest.approx(concentration, abs=1e-3)
    assert king.profile(0.0).radii[-1] == pytest.approx(5.355275459 / 3.0, rel=1e-5)


@pytest.mark.parametrize("depth", [0.0, 6.0, 16.0])
def test_stars_of_a_king_model_are_in_equilibrium_and_within_its_edge(depth):
    model = king.profile(depth)
    x, v, own = king.draw(depth, 5000, np.random.default_rng(3))
    potential, kinetic = energies(x, v, np.full(5000, 1 / 5000))
    assert potential == pytest.approx(-0.5, rel=0.03)
    assert kinetic == pytest.approx(0.25, rel=0.03)
    virial = 0.5 * model.masses[-1] ** 2 / -model.energy
    assert np.linalg.norm(x, axis=1).max() <= model.radii[-1] / virial
    assert own.max() <= 0.0


def test_a_cluster_has_the_energy_and_the_size_that_are_asked():
    system = kd.cluster("king", 600, 4, W0=5.0, masses="kroupa", segregation=0.5)
    x, v, m = system.state.positions, system.state.velocities, system.state.masses
    assert m.sum() == pytest.approx(1.0)
    assert energies(x, v, m) == (pytest.approx(-0.5), pytest.approx(0.25))
    np.testing.assert_allclose([m @ x, m @ v], 0.0, atol=1e-15)
    given = {"W0": 5.0, "masses": "kroupa", "segregation": 0.5}
    given |= {"position": ["8 kpc", 0, 0], "velocity": [0, "220 km/s", 0]}
    there = kd.cluster("king", 600, 4, "stellar", half_mass_radius="3 pc", **given)
    x, v, m = there.state.positions - [8000.0, 0, 0], there.state.velocities, there.state.masses
    r = np.linalg.norm(x, axis=1)
    order = np.argsort(r)
    within = np.cumsum(m[order]) / m.sum()
    assert r[order][np.searchsorted(within, 0.5)] == pytest.approx(3.0, rel=1e-9)
    assert m.min() > 0.08
    potential, kinetic = energies(x, v - m @ v / m.sum(), m)
    assert kinetic / (there.units.gravity * -potential) == pytest.approx(0.5, rel=1e-3)
    larger = kd.cluster("king", 600, 4, "stellar", virial_radius=1.0, mass="1e5 Msun", W0=5.0)
    assert larger.state.masses.sum() == pytest.approx(1e5)


def test_segregation_places_heavy_stars_inside_and_keeps_the_profile():
    heavy = {"fraction": 0.1, "ratio": 8.0}
    medians = []
    for segregation in (0.0, 0.5, 1.0):
        made = clusters.cluster("plummer", 3000, 2, heavy=heavy, segregation=segregation)
        r = np.linalg.norm(made.positions, axis=1)
        assert clusters.half_mass_radius(made) == pytest.approx(0.77, rel=0.1)
        medians.append(np.median(r[made.masses > made.masses.min()]))
    assert medians[0] > 1.1 * medians[1] > 1.2 * medians[2]


def test_binaries_have_the_orbits_that_are_asked():
    made = kd.cluster("plummer", 300, 5, binaries={"fraction": 0.5, "a": [1e-4, 1e-3], "e": 0.3}, masses="salpeter")
    x, v, m = (each[:200] for each in (made.state.positions, made.state.velocities, made.state.masses))
    d, u, total = x[1::2] - x[::2], v[1::2] - v[::2], m[1::2] + m[::2]
    a = 1.0 / (2.0 / np.linalg.norm(d, axis=1) - np.sum(u**2, axis=1) / total)
    assert (a >= 1e-4 * (1 - 1e-9)).all()
    assert (a <= 1e-3 * (1 + 1e-9)).all()
    e2 = 1.0 - np.sum(np.cross(d, u) ** 2, axis=1) / (total * a)
    np.testing.assert_allclose(e2, 0.09, atol=1e-9)
    centres = (m[::2, None] * x[::2] + m[1::2, None] * x[1::2]) / total[:, None]
    centres = np.concatenate([centres, made.state.positions[200:]])
    joint = np.concatenate([total, made.state.masses[200:]])
    assert pair_sum(centres, joint) == pytest.approx(0.5)
    np.testing.assert_allclose(made.state.masses @ made.state.velocities, 0.0, atol=1e-12)


FILE = """
units = "{units}"
[particles.{model}]
count = 20
seed = 1
{more}
[[force]]
type = "gravity"
"""


def test_a_file_makes_the_cluster_of_python():
    more = 'W0 = 6\nmasses = "salpeter"\nmass_range = ["0.2 Msun", 30]\nhalf_mass_radius = "2 pc"'
    found = loads(FILE.format(units="stellar", model="king", more=more))
    made = kd.cluster(
        "king", 20, 1, "stellar", W0=6, masses="salpeter", mass_range=[0.2, "30 Msun"], half_mass_radius="2 pc"
    )
    np.testing.assert_array_equal(found.state.positions, made.state.positions)
    np.testing.assert_array_equal(found.state.masses, made.state.masses)


@pytest.mark.parametrize(
    ("units", "model", "more", "message"),
    [
        ("nbody", "king", "W0 = 16.5", "particles.king.W0: expected a number from 0 to 16, got 16.5"),
        ("nbody", "king", "W0 = -1", "particles.king.W0: expected a number from 0 to 16, got -1"),
        ("nbody", "king", "", "particles.king.W0: required key is missing"),
        ("nbody", "plummer", "W0 = 3", "particles.plummer.W0: unknown key"),
        ("stellar", "plummer", "", "half_mass_radius: required key is missing (or virial_radius); it sets the size"),
        ("nbody", "plummer", 'masses = "kropa"', "masses: expected kroupa, salpeter, or numbers, got 'kropa'"),
        ("nbody", "plummer", 'masses = "kroupa"\nmass_range = [0, 1]', "mass_range: expected two masses above zero"),
        ("nbody", "plummer", "mass_range = [1, 2]", 'mass_range: goes with masses = "kroupa" or "salpeter"'),
        ("nbody", "plummer", f"masses = [{'1, ' * 19}0]", "masses[19]: expected a mass above zero, got 0"),
        ("nbody", "plummer", "masses = [1.0]", "masses: expected 20 numbers, got 1"),
        ("nbody", "plummer", "segregation = 2", "segregation: expected a number from 0 to 1, got 2"),
        (
            "nbody",
            "plummer",
            "binaries = { fraction = 1.5, a = 1 }",
            "binaries.fraction: expected a number from 0 to 1",
        ),
        (
            "nbody",
            "plummer",
            "binaries = { fraction = 1, a = [2, 1] }",
            "binaries.a: expected a length above zero, or a",
        ),
        (
            "nbody",
            "plummer",
            "binaries = { fraction = 1, a = 1, e = 1 }",
            'binaries.e: expected "thermal", or a number',
        ),
        ("nbody", "plummer", "heavy = { fraction = 0.1, ratio = 0 }", "heavy.ratio: expected a positive number, got 0"),
        ("nbody", "plummer", "half_mass_radius = 1\nvirial_radius = 1", "half_mass_radius: excludes virial_radius"),
    ],
)
def test_bad_clusters_are_named(units, model, more, message):
    with pytest.raises(InputError) as error:
        loads(FILE.format(units=units, model=model, more=more))
    assert message in str(error.value)
