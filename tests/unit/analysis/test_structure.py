"""g(r) and S(k) against MDAnalysis, slow sums, and known results for ideal gases and crystals."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import kickdrift as kd
from kickdrift.analysis import radial_distribution, structure_factor
from kickdrift.analysis.observables import waves
from kickdrift.errors import InputError
from kickdrift.model.box.box import Box
from kickdrift.model.state import State
from kickdrift.trajectory.write.h5md import Writer

LENGTHS = (8.0, 9.0, 11.0)


def coordinates(frames=3, n=300) -> np.ndarray:
    """Numbers that are exact in float32, which MDAnalysis uses; partly outside the box."""
    x = np.random.default_rng(5).uniform(-20, 20, (frames, n, 3))
    return x.astype("f4").astype("f8")


def write(path, positions, species=None):
    """A run's file of these frames."""
    system = kd.System(positions[0], box=LENGTHS, species=species)
    s = system.state
    with Writer(path, system, method={"integrator": "none"}, every=1) as writer:
        for step, x in enumerate(positions):
            writer.append(State(np.array([x.T, 0 * x.T]), s.masses, s.ids, s.box, float(step), step), {})
    return path


@pytest.fixture
def quiet():
    """Open the Universe of a file, and close it again."""
    opened = []
    yield lambda run: opened.append(run.universe()) or opened[-1]
    for universe in opened:
        universe.trajectory.close()


def test_equals_mdanalysis_on_the_same_file(tmp_path, quiet):
    pytest.importorskip("MDAnalysis")
    from MDAnalysis.analysis.rdf import InterRDF

    species = ["ABB"[k % 3] for k in range(300)]
    with kd.open(write(tmp_path / "run.h5md", coordinates(frames=5), species)) as run:
        universe = quiet(run)
        atoms = universe.atoms
        found = radial_distribution(run, r_max=4.0, bins=80)
        theirs = InterRDF(atoms, atoms, nbins=80, range=(0.0, 4.0), exclusion_block=(1, 1)).run()
        np.testing.assert_allclose(found.r, theirs.results.bins, rtol=1e-14)
        np.testing.assert_allclose(found.g, theirs.results.rdf, rtol=1e-12)
        for first, second in (("A", "B"), ("B", "A")):
            pair = radial_distribution(run, r_max=4.0, bins=80, pair=(first, second))
            one, other = (universe.select_atoms(f"type {name}") for name in (first, second))
            theirs = InterRDF(one, other, nbins=80, range=(0.0, 4.0)).run()
            np.testing.assert_allclose(pair.g, theirs.results.rdf, rtol=1e-12)


def test_a_simple_cubic_lattice_has_six_neighbours():
    x = np.stack(np.meshgrid(*[np.arange(6.0)] * 3), axis=-1).reshape(-1, 3)
    r, g, *_ = radial_distribution(x, (6.0, 6.0, 6.0), r_max=1.2, bins=12)
    width = 0.1
    shells = 4 / 3 * np.pi * ((r + width / 2) ** 3 - (r - width / 2) ** 3)
    np.testing.assert_allclose(np.sum(g * shells) * 215 / 216, 6, rtol=1e-12)
    assert radial_distribution(x, (6.0, 6.0, 6.0), r_max=1.2, bins=12).coordination[-1] == pytest.approx(6, rel=1e-12)


def test_an_ideal_gas_gives_one_within_its_errors():
    x = np.random.default_rng(1).uniform(0, 10, (300, 80, 3))
    found = radial_distribution(x, (10.0, 10.0, 10.0), bins=60)
    off = ((found.g - 1) / found.error)[10:]
    assert np.isfinite(off).all()
    assert np.mean(off**2) == pytest.approx(1, abs=0.6)  # 50 bins and errors of about 15 % each
    counts = found.g * 300 * 80 * 79 / 2 * 4 * np.pi * found.r**2 * (5 / 60) / 1000
    np.testing.assert_allclose(found.error[10:], (found.g / np.sqrt(counts))[10:], rtol=0.6)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6), st.integers(2, 40), st.floats(0.3, 4.0), st.integers(1, 50))
def test_neither_place_nor_order_nor_images_matter(seed, n, r_max, bins):
    rng = np.random.default_rng(seed)
    x = rng.integers(0, 4096, (n, 3)) / 512.0  # so that shifts by eighths are exact
    found = radial_distribution(x, LENGTHS, r_max, bins)
    moved = x[rng.permutation(n)] + rng.integers(-9, 10, 3) / 8 + np.array(LENGTHS) * rng.integers(-3, 4, (n, 3))
    np.testing.assert_array_equal(radial_distribution(moved, LENGTHS, r_max, bins).g, found.g)
    separations = Box(LENGTHS).minimum_image(x[:, None] - x[None])
    r = np.linalg.norm(separations, axis=2)[~np.eye(n, dtype=bool)]
    np.testing.assert_allclose(found.coordination[-1], np.count_nonzero(r < r_max) / n, rtol=1e-12)


def test_species_add_up():
    x, names = coordinates(frames=4, n=50), ["AB"[k % 2] for k in range(50)]
    g = {
        pair: radial_distribution(x, LENGTHS, pair=pair, species=names, bins=20).g
        for pair in (("A", "A"), ("A", "B"), ("B", "A"), ("B", "B"))
    }
    np.testing.assert_array_equal(g["A", "B"], g["B", "A"])
    whole = (25 * 24 * (g["A", "A"] + g["B", "B"]) + 2 * 25 * 25 * g["A", "B"]) / (50 * 49)
    np.testing.assert_allclose(radial_distribution(x, LENGTHS, bins=20).g, whole, rtol=1e-12)


def slow_structure_factor(x, k) -> np.ndarray:
    return np.mean(np.abs(np.exp(-1j * x @ k.T).sum(axis=1)) ** 2, axis=0) / x.shape[1]


def test_structure_factor_equals_slow_sums(monkeypatch):
    x = coordinates(frames=3, n=40)
    vectors = np.array([[1, 0, 0], [0, -2, 1], [3, 3, -3], [0, 0, 5], [-1, 0, 0]])
    k = 2 * np.pi * vectors / np.array(LENGTHS)
    found = structure_factor(x, LENGTHS, vectors=vectors)
    np.testing.assert_allclose(found.s, slow_structure_factor(x, k), rtol=1e-11)
    np.testing.assert_allclose(found.k, np.linalg.norm(k, axis=1), rtol=1e-14)
    assert found.s[0] == pytest.approx(found.s[4], rel=1e-12), "k and -k are equal"
    whole = structure_factor(x, LENGTHS, k_max=3.0)
    monkeypatch.setattr(waves, "ROOM", 100)
    np.testing.assert_allclose(structure_factor(x, LENGTHS, k_max=3.0).s, whole.s, rtol=1e-12)


def test_structure_factor_of_ideal_gases_is_one():
    off = []
    for seed in range(8):
        x = np.random.default_rng(seed).uniform(0, 10, (400, 60, 3))
        found = structure_factor(x, (10.0, 10.0, 10.0))
        off.append((found.s - 1) / found.error)
    assert np.isfinite(off).all()
    assert np.mean(np.square(off)) == pytest.approx(1, abs=0.4)  # 88 shells: 1 +- 0.15, and errors from few blocks
    assert np.max(np.abs(off)) < 5


def fcc(cells: int) -> np.ndarray:
    corners = np.stack(np.meshgrid(*[np.arange(cells)] * 3, indexing="ij"), axis=-1).reshape(-1, 1, 3)
    return (corners + np.array([[0, 0, 0], [0, 0.5, 0.5], [0.5, 0, 0.5], [0.5, 0.5, 0]])).reshape(-1, 3)


def test_a_perfect_crystal_has_bragg_peaks_and_nothing_else():
    """fcc: indices all even or all odd, in the units of the cell; S = n at these, and 0 elsewhere."""
    x = fcc(3)
    vectors = np.stack(np.meshgrid(*[np.arange(-6, 7)] * 3), axis=-1).reshape(-1, 3)
    vectors = vectors[np.any(vectors != 0, axis=1)]
    found = structure_factor(x, (3.0, 3.0, 3.0), vectors=vectors)
    cell = np.all(vectors % 3 == 0, axis=1)
    parity = (vectors // 3) % 2
    bragg = cell & np.all(parity == parity[:, :1], axis=1)
    assert bragg.sum() == 34  # eight (111), six (200), twelve (220) and eight (222)
    np.testing.assert_allclose(found.s, np.where(bragg, len(x), 0.0), atol=1e-10)


def test_an_einstein_crystal_has_debye_and_wallers():
    """Gaussian displacements of variance u on each axis: S = 1 + (n - 1) exp(-k^2 u) on a peak, 1 - exp(-k^2 u)
    elsewhere."""
    lattice, u = fcc(3), 0.05**2
    x = lattice + np.random.default_rng(3).normal(scale=np.sqrt(u), size=(600, *lattice.shape))
    vectors = np.array([[3, 3, 3], [6, 0, 0], [3, 3, -3], [1, 2, 4], [5, 0, 1]])
    found = structure_factor(x, (3.0, 3.0, 3.0), vectors=vectors)
    on, damped = np.array([1, 1, 1, 0, 0]), np.exp(-(found.k**2) * u)
    wanted = np.where(on, 1 + (len(lattice) - 1) * damped, 1 - damped)
    assert np.all(np.abs(found.s - wanted) < 4 * found.error)
    assert np.all(found.error < 0.06 * wanted)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"k_max": 0.1}, "k_max = 0.1 is below the smallest wave vector"),
        ({"width": 0.0}, "width must be positive"),
        ({"vectors": [[0.5, 0, 0]]}, "whole numbers"),
        ({"vectors": [1, 2, 3]}, "whole numbers"),
        ({"box": None}, "needs a periodic box"),
    ],
)
def test_structure_factors_that_are_none(change, message):
    with pytest.raises(InputError, match=message):
        structure_factor(**{"source": coordinates(1), "box": LENGTHS, **change})


def test_bad_input(tmp_path):
    x = coordinates(1)[0]
    with pytest.raises(InputError, match="no species 'C'; known are A"):
        radial_distribution(x, LENGTHS, pair=("A", "C"))
    with pytest.raises(InputError, match="expected two species"):
        radial_distribution(x, LENGTHS, pair="AA")
    with pytest.raises(InputError, match="a run has its own"):
        radial_distribution(write(tmp_path / "run.h5md", x[None]), LENGTHS)
    with pytest.raises(InputError, match=r"r_max = 4.1 is not in \(0, 4\]"):
        radial_distribution(x, LENGTHS, r_max=4.1)
    with pytest.raises(InputError, match="needs a periodic box"):
        radial_distribution(x, Box())
    with pytest.raises(InputError, match="n >= 2"):
        radial_distribution(x[:1], LENGTHS)
    with pytest.raises(InputError, match="one bin or more"):
        radial_distribution(x, LENGTHS, bins=0)
