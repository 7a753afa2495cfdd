"""Lattices, Maxwell-Boltzmann velocities, mixtures, structure files and the check for overlaps."""

import sys
from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kickdrift.errors import InputError
from kickdrift.forces import Gravity, LennardJones
from kickdrift.model.starts.builders import (
    any_nearer,
    check_overlaps,
    lattice,
    maxwell_boltzmann,
    mixture,
    read_structure,
)
from kickdrift.model.starts.chains import random_chains
from kickdrift.model.system import System
from kickdrift.model.units.unit_systems import UNIT_SYSTEMS

METAL = UNIT_SYSTEMS["metal"]
NEIGHBOURS = {
    "sc": (1, 6, 1.0),
    "bcc": (2, 8, np.sqrt(0.75)),
    "fcc": (4, 12, np.sqrt(0.5)),
    "diamond": (8, 4, np.sqrt(0.1875)),
}


@pytest.mark.parametrize("apart", [0.0, 1.02])
def test_random_chains_have_the_size_of_freely_rotating_ones(apart):
    """Source: P. J. Flory, Statistical Mechanics of Chain Molecules, 1969, chapter 1, for a mean cosine."""
    chains, bonds, bond = 4000, 20, 0.97
    x = random_chains(chains, bonds + 1, np.eye(3), bond, apart, seed=3).reshape(chains, bonds + 1, 3)
    np.testing.assert_allclose(np.linalg.norm(np.diff(x, axis=1), axis=2), bond, rtol=1e-12)
    assert np.linalg.norm(x[:, 2:] - x[:, :-2], axis=2).min() >= apart * (1 - 1e-12)
    c = (apart / (2 * bond)) ** 2
    exact = bonds * bond**2 * ((1 + c) / (1 - c) - 2 * c * (1 - c**bonds) / (bonds * (1 - c) ** 2))
    squared = ((x[:, -1] - x[:, 0]) ** 2).sum(axis=1)
    assert abs(squared.mean() - exact) < 4 * squared.std() / np.sqrt(chains) < 0.06 * exact
    assert np.abs((x[:, -1] - x[:, 0]).mean(axis=0)).max() < 4 * np.sqrt(exact / 3 / chains)


@given(st.sampled_from(sorted(NEIGHBOURS)), st.integers(2, 5), st.floats(1e-3, 1e3))
@settings(max_examples=40, deadline=None)
def test_every_site_has_the_neighbours_of_its_lattice(kind, cells, density):
    sites, count, distance = NEIGHBOURS[kind]
    positions, edges = lattice(kind, sites * cells**3, density)
    assert len(positions) / np.prod(edges) == pytest.approx(density, rel=1e-12)
    assert positions.min() > 0
    assert (positions < edges).all()
    separations = positions - positions[0]
    separations -= np.round(separations / edges) * edges
    r = np.sort(np.linalg.norm(separations, axis=1))[1:]
    cell = edges[0] / cells
    assert r[0] == pytest.approx(distance * cell, rel=1e-9)
    if cells > 2:  # with two cells along an edge, a neighbour on both sides is the same particle
        assert np.count_nonzero(r < r[0] * (1 + 1e-9)) == count


@pytest.mark.parametrize(
    ("kind", "count", "density", "message"),
    [
        ("fcc", 1000, 1.0, "count: 1000 does not fill a fcc lattice in a cube; the nearest counts are 864 and 1372"),
        ("sc", 999, 1.0, "count: 999 does not fill a sc lattice in a cube; the nearest counts are 729 and 1000"),
        ("bcc", 3, 1.0, "count: 3 does not fill a bcc lattice in a cube; the nearest counts are 2 and 16"),
        ("fcc", 1, 1.0, "count: 1 does not fill a fcc lattice in a cube; the nearest counts are 4 and 32"),
        ("sc", 0, 1.0, "count: expected a whole number of particles from 1 to 100000000, got 0"),
        ("sc", 8.0, 1.0, "count: expected a whole number of particles from 1 to 100000000, got 8.0"),
        ("sc", 10**400, 1.0, "count: expected a whole number of particles from 1 to 100000000, got 1000"),
        ("sc", 8, -1.0, "density: expected a positive finite number, got -1.0"),
        ("sc", 8, float("nan"), "density: expected a positive finite number, got nan"),
        (
            "fc",
            4,
            1.0,
            "lattice: expected one of sc, bcc, fcc, diamond, rock-salt, caesium-chloride, zincblende, got 'fc'",
        ),
    ],
)
def test_bad_lattices(kind, count, density, message):
    with pytest.raises(InputError) as error:
        lattice(kind, count, density)
    assert str(error.value).startswith(message)


@given(
    st.lists(st.floats(1e-3, 1e3), min_size=2, max_size=50),
    st.floats(1e-6, 1e6),
    st.sampled_from([1.0, METAL.boltzmann, 1.380649e-23]),
    st.integers(0, 2**64),
)
@settings(deadline=None)
def test_momentum_is_zero_and_temperature_exact(masses, temperature, boltzmann, seed):
    m = np.array([*masses, 0.0])
    v = maxwell_boltzmann(m, temperature, boltzmann, seed)
    assert (v[-1] == 0).all()
    momenta = m[:, None] * v
    assert np.abs(momenta.sum(axis=0)).max() <= 1e-13 * np.abs(momenta).sum()
    kinetic = 0.5 * (momenta * v).sum()
    assert 2 * kinetic / ((3 * len(masses) - 3) * boltzmann) == pytest.approx(temperature, rel=1e-12)


def test_velocities_follow_from_the_seed_and_are_normal():
    m = np.repeat([1.0, 4.0], 20_000)
    v = maxwell_boltzmann(m, 2.0, 1.0, seed=7)
    assert (v == maxwell_boltzmann(m, 2.0, 1.0, seed=7)).all()
    assert (v != maxwell_boltzmann(m, 2.0, 1.0, seed=8)).any()
    scaled = v * np.sqrt(m[:, None] / 2.0)
    for half in (scaled[:20_000], scaled[20_000:]):
        assert np.mean(half**2) == pytest.approx(1, abs=5 * np.sqrt(2 / 60_000))
        assert np.mean(half**4) == pytest.approx(3, abs=5 * np.sqrt(96 / 60_000))


def test_bad_velocities():
    assert (maxwell_boltzmann([1.0, 2.0], 0.0, 1.0, 1) == 0).all()
    for masses, temperature, seed, message in [
        ([1.0], 1.0, 1, "temperature: needs two or more particles with mass"),
        ([1.0, 0.0], 1.0, 1, "temperature: needs two or more particles with mass"),
        ([1.0, 1.0], -1.0, 1, "temperature: expected a finite number, zero or more, got -1.0"),
        ([1.0, 1.0], 1.0, -1, "seed: expected a whole number, zero or more, got -1"),
        ([1.0, -1.0], 1.0, 1, "masses: expected a list of finite numbers, zero or more"),
    ]:
        with pytest.raises(InputError, match=message):
            maxwell_boltzmann(masses, temperature, 1.0, seed)


@given(st.lists(st.integers(1, 9), min_size=1, max_size=5), st.integers(1, 200), st.integers(0, 99))
def test_a_mixture_has_its_fractions_to_within_one_particle(parts, count, seed):
    fractions = {f"S{k}": part / sum(parts) for k, part in enumerate(parts)}
    names = mixture(fractions, count, seed)
    assert len(names) == count
    number = Counter(names)
    assert all(abs(number[name] - part * count) < 1 for name, part in fractions.items())
    assert names == mixture(fractions, count, seed)


@pytest.mark.parametrize("box", [None, (10.0, 10.0, 10.0)])
def test_the_closest_pair_that_overlaps_is_named(box):
    x = np.array([[1.0, 1.0, 1.0], [0.05, 5.0, 5.0], [4.0, 1.0, 1.0], [4.28, 1.0, 1.0], [9.9, 5.0, 5.0]])
    system = System(x, box=box, forces=[LennardJones()])
    pair, distance = ("1 and 4", "0.15") if box else ("2 and 3", "0.28")
    with pytest.raises(InputError) as error:
        check_overlaps(system)
    assert str(error.value) == (
        f"positions: particles {pair} overlap: distance {distance}, less than 0.3 of the shortest sigma, 1; "
        "kickdrift relax (sim.minimize) moves them apart"
    )


@pytest.mark.parametrize("force", [Gravity(), LennardJones()], ids=lambda force: force.name)
def test_particles_at_the_same_place(force):
    x = [[0.0, 0.0, 0.0], [5.0, 0.0, 0.0], [9.0, 0.0, 0.0], [5.0, 0.0, 0.0]]
    with pytest.raises(InputError, match="particles 1 and 3 are at the same place, distance 0"):
        check_overlaps(System(x, forces=[force], units="nbody"))
    x[3][0] += 20.0
    a_box_apart = System(x, box=(20.0, 20.0, 20.0), forces=[LennardJones()])
    with pytest.raises(InputError, match="particles 1 and 3 are at the same place"):
        check_overlaps(a_box_apart)


def test_far_cells_with_the_same_number_are_no_neighbours():
    from kickdrift.model.nearness import CELLS

    apart = 2.0 * CELLS  # cells have twice the limit
    assert not any_nearer(np.array([[0.0] * 3, [apart, 0.0, 0.0], [0.0, 0.0, -apart]]), None, 1.0)
    assert any_nearer(np.array([[0.0] * 3, [apart, 0.0, 0.0], [apart + 0.9, 0.0, 0.0]]), None, 1.0)


def test_near_particles_are_allowed_where_asked():
    x = [[0.0] * 3, [1e-3, 0.0, 0.0]]
    check_overlaps(System(x, forces=[LennardJones()]), near=False)
    with pytest.raises(InputError, match="at the same place"):
        check_overlaps(System([x[0], x[0]], forces=[LennardJones()]), near=False)


def test_what_does_not_overlap():
    check_overlaps(System([[0.0] * 3, [0.31, 0.0, 0.0]], forces=[LennardJones()]))
    check_overlaps(System([[0.0] * 3, [1e-12, 0.0, 0.0]], forces=[Gravity()], units="nbody"))
    check_overlaps(System([[0.0] * 3, [0.0] * 3]))
    check_overlaps(System([[0.0] * 3], forces=[LennardJones()]))


def test_a_distance_that_underflows_still_names_two_particles():
    with pytest.raises(InputError, match="particles 0 and 1 overlap"):
        check_overlaps(System([[0.0] * 3, [1e-200, 0.0, 0.0]], forces=[LennardJones()]))


def test_ase_round_trip(tmp_path):
    ase = pytest.importorskip("ase")
    from ase.io import write

    atoms = ase.Atoms("ArKr", [[1, 2, 3], [4, 5, 6]], cell=[10, 11, 12], pbc=True)
    velocity = np.array([[1.0, 2.0, 3.0], [-4.0, 5.0, 6.0]])  # angstrom/ps
    atoms.set_velocities(velocity / (1000 * ase.units.fs))
    write(tmp_path / "start.extxyz", atoms)
    read = read_structure(tmp_path / "start.extxyz", METAL)
    assert read.positions == pytest.approx(atoms.positions)
    assert read.edges == pytest.approx([10, 11, 12])
    assert read.species == ["Ar", "Kr"]
    assert read.masses == pytest.approx(atoms.get_masses())
    assert read.velocities == pytest.approx(velocity, rel=1e-6)  # ASE: CODATA 2014, eight digits in text


def test_bad_structure_files(tmp_path, monkeypatch):
    ase = pytest.importorskip("ase")
    from ase.io import write

    path = tmp_path / "start.extxyz"
    with pytest.raises(InputError, match="no such file"):
        read_structure(path, METAL)
    path.write_text("not a structure\n")
    with pytest.raises(InputError, match=r"ASE cannot read .*start\.extxyz"):
        read_structure(path, METAL)
    write(path, ase.Atoms("Ar", cell=[[9, 0, 0], [9, 0, 0], [0, 0, 9]], pbc=True))
    with pytest.raises(InputError, match=r"the edge vectors are singular \(no volume\)"):
        read_structure(path, METAL)
    with pytest.raises(InputError, match='expected units = "metal", "real" or "gromacs", got "lj"'):
        read_structure(path, UNIT_SYSTEMS["lj"])
    monkeypatch.setitem(sys.modules, "ase.io", None)
    with pytest.raises(InputError, match=r"pip install 'kickdrift\[ase\]'"):
        read_structure(path, METAL)


def test_far_away_and_crowded_places():
    far = np.array([[0.0, 0.0, 0.0], [1e12, -1e12, 0.0], [1e12, -1e12, 1.0]])
    assert not any_nearer(far, None, 0.9)
    assert any_nearer(far, None, 1.1)
    crowd = np.random.default_rng(1).random((20_000, 3))
    assert any_nearer(crowd, None, 1.0)
