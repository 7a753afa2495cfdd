"""g(r) and S(k) in boxes of any shape: against MDAnalysis, slow sums, and known results for gases and crystals."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import kickdrift as kd
from kickdrift.analysis import pressure_tensor, radial_distribution, structure_factor
from kickdrift.analysis.observables import structure
from kickdrift.analysis.observables.structure import reciprocal
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


def test_partial_structure_factors_equal_slow_sums_and_add_up():
    rng = np.random.default_rng(8)
    x, kinds = rng.uniform(0, 5, (40, 3)), ["A"] * 25 + ["B"] * 15
    vectors = np.array([[1, 0, 0], [1, -2, 1], [3, 1, 2]])
    k = 2 * np.pi * vectors / 5.0
    rho = {name: np.exp(-1j * x[np.array(kinds) == name] @ k.T).sum(axis=0) for name in "AB"}
    found = {}
    for pair in (("A", "A"), ("A", "B"), ("B", "A"), ("B", "B")):
        found[pair] = structure_factor(x, [5.0] * 3, vectors=vectors, pair=pair, species=kinds).s
        expected = (rho[pair[0]] * rho[pair[1]].conj()).real / 40
        np.testing.assert_allclose(found[pair], expected, rtol=1e-11, atol=1e-13)
    whole = structure_factor(x, [5.0] * 3, vectors=vectors).s
    np.testing.assert_allclose(sum(found.values()), whole, rtol=1e-11)
    with pytest.raises(InputError, match="structure_factor: pair: no species 'C'; known are A, B"):
        structure_factor(x, [5.0] * 3, vectors=vectors, pair=("A", "C"), species=kinds)


def test_structure_factor_equals_slow_sums(monkeypatch):
    x = coordinates(frames=3, n=40)
    vectors = np.array([[1, 0, 0], [0, -2, 1], [3, 3, -3], [0, 0, 5], [-1, 0, 0]])
    k = 2 * np.pi * vectors / np.array(LENGTHS)
    found = structure_factor(x, LENGTHS, vectors=vectors)
    np.testing.assert_allclose(found.s, slow_structure_factor(x, k), rtol=1e-11)
    np.testing.assert_allclose(found.k, np.linalg.norm(k, axis=1), rtol=1e-14)
    assert found.s[0] == pytest.approx(found.s[4], rel=1e-12), "k and -k are equal"
    whole = structure_factor(x, LENGTHS, k_max=3.0)
    monkeypatch.setattr(structure, "ROOM", 100)
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


LEANING = Box(matrix=[[9.0, 0.0, 0.0], [-4.5, 10.0, 0.0], [3.0, 5.0, 11.0]])
PLANE = (True, True, False)
tilts = st.sampled_from([-0.5, 0.0, 0.5]) | st.floats(-0.5, 0.5)
edges = st.floats(3.0, 12.0)
matrices = st.builds(
    lambda a, b, c, f, g, h: np.array([[a, 0, 0], [f * a, b, 0], [g * a, h * b, c]]),
    edges, edges, edges, tilts, tilts, tilts,
)  # fmt: skip


def distances(box, x) -> np.ndarray:
    i, j = np.triu_indices(len(x), 1)
    return np.linalg.norm(box.minimum_image(x[i] - x[j]), axis=1)


@settings(max_examples=60, deadline=None)
@given(matrices, st.integers(0, 10**6), st.integers(2, 60), st.floats(0.05, 1.0))
def test_g_equals_a_slow_count(matrix, seed, n, share):
    box = Box(matrix=matrix)
    x = np.random.default_rng(seed).uniform(-30, 30, (n, 3))
    r_max = share * float(box.heights.min()) / 2
    found = radial_distribution(x, box, r_max, bins=10)
    counts, bounds = np.histogram(distances(box, x), 10, (0.0, r_max))
    ideal = n * (n - 1) * 4 / 3 * np.pi * np.diff(bounds**3) / box.volume
    np.testing.assert_allclose(found.g, 2 * counts / ideal, rtol=1e-12)


@settings(max_examples=30, deadline=None)
@given(matrices, st.integers(0, 10**6), st.integers(2, 60))
def test_g_in_a_leaning_plane_equals_a_slow_count(matrix, seed, n):
    matrix[2] = [0, 0, 5]
    box = Box(matrix=matrix, periodic=PLANE)
    x = np.random.default_rng(seed).uniform(-30, 30, (n, 3)) * [1, 1, 0]
    found = radial_distribution(x, box, bins=10)
    r_max = float(box.heights.min()) / 2
    counts, bounds = np.histogram(distances(box, x), 10, (0.0, r_max))
    np.testing.assert_allclose(found.g, 2 * counts / (n * (n - 1) * np.pi * np.diff(bounds**2) / box.area), rtol=1e-12)


def supercell(x, by=10.0, ax=9.0):
    """Particles of a box with b = (ax/2, by) in a rectangular box of twice the size, and the leaning box."""
    return np.concatenate([x, x + np.array([ax / 2, by, 0])]), Box((ax, 2 * by, 11.0))


SHEARED = Box(matrix=[[9.0, 0.0, 0.0], [4.5, 10.0, 0.0], [0.0, 0.0, 11.0]])


def test_the_upright_supercell_has_the_same_neighbours_and_waves():
    x = np.random.default_rng(1).uniform(-30, 30, (200, 3))
    twice, upright = supercell(x)
    r_max = float(SHEARED.heights.min()) / 2
    ours = radial_distribution(x, SHEARED, r_max, bins=50).coordination
    np.testing.assert_allclose(radial_distribution(twice, upright, r_max, bins=50).coordination, ours, rtol=1e-12)
    whole = np.array([[1, 0, 0], [0, 1, 0], [2, -1, 3], [-1, 4, 2]])
    k = whole @ reciprocal(SHEARED)
    there = np.rint(k * np.diag(upright.matrix) / (2 * np.pi)).astype(int)
    one, other = structure_factor(x, SHEARED, vectors=whole), structure_factor(twice, upright, vectors=there)
    np.testing.assert_allclose(one.k, other.k, rtol=1e-13)
    np.testing.assert_allclose(2 * one.s, other.s, rtol=1e-10)


@settings(max_examples=60, deadline=None)
@given(matrices)
def test_reciprocal_vectors_are_those_of_the_edges(matrix):
    box = Box(matrix=matrix)
    np.testing.assert_allclose(reciprocal(box) @ matrix.T, 2 * np.pi * np.eye(3), atol=1e-12)


def test_structure_factor_of_a_leaning_box_equals_slow_sums():
    x = np.random.default_rng(2).uniform(-30, 30, (3, 40, 3))
    whole = np.array([[1, 0, 0], [0, -2, 1], [3, 3, -3], [0, 0, 5]])
    k = 2 * np.pi * whole @ np.linalg.inv(LEANING.matrix).T
    found = structure_factor(x, LEANING, vectors=whole)
    slow = np.mean(np.abs(np.exp(-1j * x @ k.T).sum(axis=1)) ** 2, axis=0) / 40
    np.testing.assert_allclose(found.s, slow, rtol=1e-10)
    np.testing.assert_allclose(found.k, np.linalg.norm(k, axis=1), rtol=1e-13)


def test_shells_hold_every_vector_once():
    x = np.random.default_rng(2).uniform(-30, 30, (2, 30, 3))
    found = structure_factor(x, LEANING, k_max=2.5, width=0.25)
    grid = np.stack(np.meshgrid(*[np.arange(-9, 10)] * 3), axis=-1).reshape(-1, 3)
    k = 2 * np.pi * grid @ np.linalg.inv(LEANING.matrix).T
    length = np.linalg.norm(k, axis=1)
    assert found.vectors.sum() == np.count_nonzero((length > 0) & (length <= 2.5)) / 2
    assert found.k[0] == pytest.approx(length[length > 0].min(), rel=0.2)
    k = k[(length > 0) & (length <= 2.5)]
    slow = np.mean(np.abs(np.exp(-1j * x @ k.T).sum(axis=1)) ** 2, axis=0) / 30
    assert np.sum(found.s * found.vectors) == pytest.approx(slow.sum() / 2, rel=1e-10)


def test_a_crystal_in_its_primitive_cell_has_its_bragg_peaks():
    """fcc in a rhombohedral box: every reciprocal vector of the primitive cell is a peak, and there are no peaks in
    between."""
    primitive = np.array([[0, 0.5, 0.5], [0.5, 0, 0.5], [0.5, 0.5, 0]])
    sites = np.stack(np.meshgrid(*[np.arange(4)] * 3), axis=-1).reshape(-1, 3)
    box, rotation = Box.from_vectors(4 * primitive)
    x = sites @ primitive @ rotation.T
    whole = np.stack(np.meshgrid(*[np.arange(-4, 5)] * 3), axis=-1).reshape(-1, 3)
    found = structure_factor(x, box, vectors=whole)
    shift = whole @ reciprocal(box) @ (primitive @ rotation.T).T / (2 * np.pi)
    bragg = np.all(np.abs(shift - np.rint(shift)) < 1e-9, axis=1)
    assert bragg.sum() > 8
    np.testing.assert_allclose(found.s, np.where(bragg, 64.0, 0.0), atol=1e-9)


def test_waves_of_a_plane_lie_in_it():
    box = Box(matrix=[[9.0, 0.0], [-4.5, 10.0]])
    x = np.random.default_rng(2).uniform(-30, 30, (2, 40, 3)) * [1, 1, 0]
    found = structure_factor(x, box, k_max=3.0)
    grid = np.stack(np.meshgrid(*[np.arange(-9, 10)] * 2), axis=-1).reshape(-1, 2)
    length = np.linalg.norm(2 * np.pi * grid @ np.linalg.inv(box.matrix[:2, :2]).T, axis=1)
    assert found.vectors.sum() == np.count_nonzero((length > 0) & (length <= 3.0)) / 2
    with pytest.raises(InputError, match="expected 0 along open axes"):
        structure_factor(x, box, vectors=[[1, 0, 1]])


def solid(dimensions=3) -> kd.System:
    rng = np.random.default_rng(4)
    n, matrix = 8, np.array([[8.4, 0, 0], [-4.2, 8.3, 0], [3.3, 4.0, 8.5]])
    if dimensions == 2:
        n, matrix = 10, np.array([[12.0, 0], [6.0, 12.0]])
    sites = np.indices((n,) * dimensions).reshape(dimensions, -1).T
    sites = (sites + rng.uniform(0.42, 0.58, sites.shape)) / n
    force = kd.LennardJones(cutoff=2.5, tail=dimensions == 3, truncation="cut")
    v = rng.normal(size=sites.shape)
    return kd.System(sites @ matrix, v, box=Box(matrix=matrix), forces=[force], dimensions=dimensions)


@pytest.mark.parametrize("dimensions", [2, 3])
def test_the_trace_of_the_tensor_is_the_pressure_of_the_run(tmp_path, dimensions):
    path = tmp_path / "run.h5md"
    kd.Simulation(solid(dimensions), "velocity-verlet", 0.002).run(40, every=10, output=path)
    with kd.open(path) as run:
        found = pressure_tensor(run)
        traces = np.trace(found.tensors, axis1=1, axis2=2) / dimensions
        np.testing.assert_allclose(traces, run[:].observables["pressure"], rtol=1e-11)
        assert found.pressure == pytest.approx(traces.mean(), rel=1e-12)


def test_a_mean_squared_displacement_goes_through_leaning_walls(tmp_path):
    """Free particles have (v t)^2, from a file that holds the positions inside the box."""
    system = kd.System(np.random.default_rng(5).uniform(0, 9, (20, 3)), np.full((20, 3), 3.0), box=LEANING)
    path = tmp_path / "run.h5md"
    kd.Simulation(system, "velocity-verlet", 0.5).run(40, every=4, output=path, file=kd.FileOptions(write=("images",)))
    found = kd.analysis.mean_squared_displacement(path)
    np.testing.assert_allclose(found.values, 27 * found.times**2, rtol=1e-10)


def test_diffusion_in_two_dimensions_divides_by_four(tmp_path):
    """Between these two lags of free particles with v^2 = 18, the slope is 18 (t1 + t0)."""
    x = np.random.default_rng(5).uniform(0, 9, (20, 2))
    system = kd.System(x, np.full((20, 2), 3.0), box=[[9.0, 0.0], [4.5, 9.0]], dimensions=2)
    path = tmp_path / "run.h5md"
    kd.Simulation(system, "velocity-verlet", 0.5).run(40, every=4, output=path)
    displacement = kd.analysis.mean_squared_displacement(path, lags=4)
    first, second = displacement.times[2:4]
    assert displacement.diffusion(first, second).value == pytest.approx(18 * (first + second) / 4, rel=1e-9)
    velocity = kd.analysis.velocity_autocorrelation(path, lags=4)
    assert velocity.diffusion(second).value == pytest.approx(18 * second / 2, rel=1e-9)


def test_a_distance_beyond_half_the_least_height_is_refused():
    x = np.random.default_rng(3).uniform(0, 20, (30, 3))
    half = float(LEANING.heights.min()) / 2
    with pytest.raises(InputError, match=rf"r_max = 4.9 is not in \(0, {half:g}\], half the least height of the box"):
        radial_distribution(x, LEANING, r_max=4.9)
    with pytest.raises(InputError, match="periodic along all axes, or along x and y"):
        radial_distribution(x, Box((9.0, 9.0, 9.0), periodic=(True, False, True)))


@pytest.mark.parametrize("dimensions", [2, 3])
def test_a_plot_shows_g_of_a_leaning_box(tmp_path, dimensions):
    pytest.importorskip("matplotlib")
    path = tmp_path / "run.h5md"
    kd.Simulation(solid(dimensions), "velocity-verlet", 0.002).run(20, every=10, output=path)
    from kickdrift.plots import figures, runs

    with kd.open(path) as run:
        r, g, frames = runs._rdf(run)
    assert frames == 2
    assert g[r > 1].max() > 1.2
    assert figures.plot_file(path, tmp_path / "run.png", "energies").stat().st_size > 0


def test_a_slab_has_the_rings_of_its_pairs():
    """Pairs are counted and weighed one by one; an ideal slab has g = 1."""
    rng = np.random.default_rng(3)
    x, edge = rng.random((30, 80, 3)) * [6.0, 6.0, 2.0], 6.0
    box = kd.Box([edge, edge, 0.0], periodic=(True, True, False))
    species = ["A"] * 30 + ["B"] * 50
    found = kd.analysis.radial_distribution(x, box, bins=12)
    assert abs(found.g - 1.0).max() < 0.2
    edges = np.linspace(0.0, edge / 2, 13)
    for pair, first, second in ((None, slice(0, 80), slice(0, 80)), (("A", "B"), slice(0, 30), slice(30, 80))):
        found = kd.analysis.radial_distribution(x, box, bins=12, pair=pair, species=species)
        total = np.zeros(12)
        for frame in x:
            apart = frame[first, None] - frame[None, second]
            apart[..., :2] -= edge * np.rint(apart[..., :2] / edge)
            distance = np.linalg.norm(apart, axis=-1)
            other = ~np.eye(80, dtype=bool) if pair is None else np.ones(distance.shape, bool)
            counts = np.histogram(distance[other], edges)[0]
            rings = np.pi * np.maximum(0.0, edges**2 - apart[other][:, 2, None] ** 2).sum(axis=0) / edge**2
            total += counts / np.diff(rings)
        np.testing.assert_allclose(found.g, total / len(x), rtol=1e-9)
