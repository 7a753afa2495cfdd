"""g(r) against MDAnalysis, a slow count of pairs, and what an ideal gas must give."""

from __future__ import annotations

import numpy as np
import pytest

from kickdrift.analysis import structure
from kickdrift.analysis.structure import radial_distribution
from kickdrift.box import Box
from kickdrift.errors import InputError

LENGTHS = (8.0, 9.0, 11.0)


def coordinates(frames=3, n=300) -> np.ndarray:
    """Numbers that float32, which MDAnalysis computes with, holds exactly; partly outside the box."""
    x = np.random.default_rng(5).uniform(-20, 20, (frames, n, 3))
    return x.astype("f4").astype("f8")


def test_equals_mdanalysis():
    MDAnalysis = pytest.importorskip("MDAnalysis")
    from MDAnalysis.analysis.rdf import InterRDF

    x = np.array([Box(LENGTHS).wrap(frame) for frame in coordinates()]).astype("f4").astype("f8")
    universe = MDAnalysis.Universe.empty(300, trajectory=True)
    dimensions = np.tile([*LENGTHS, 90, 90, 90], (3, 1)).astype("f4")
    universe.load_new(x, dimensions=dimensions)
    theirs = InterRDF(universe.atoms, universe.atoms, nbins=80, range=(0.0, 4.0), exclusion_block=(1, 1)).run()
    r, g = radial_distribution(x, LENGTHS, r_max=4.0, bins=80)
    np.testing.assert_allclose(r, theirs.results.bins, rtol=1e-14)
    np.testing.assert_allclose(g, theirs.results.rdf, rtol=1e-6)  # the volume in it is from float32 edges


def test_equals_a_slow_count(monkeypatch):
    monkeypatch.setattr(structure, "BLOCK", 7)
    x = coordinates(frames=1, n=50)[0]
    r, g = radial_distribution(x, LENGTHS, bins=40)
    separations = Box(LENGTHS).minimum_image(x[:, None] - x[None])
    distances = np.linalg.norm(separations, axis=2)[~np.eye(50, dtype=bool)]
    counts, edges = np.histogram(distances, 40, (0.0, 4.0))
    ideal = 50 * 49 * 4 / 3 * np.pi * np.diff(edges**3) / np.prod(LENGTHS)
    np.testing.assert_allclose(g, counts / ideal, rtol=1e-12)
    np.testing.assert_allclose(r, (edges[1:] + edges[:-1]) / 2)


def test_an_ideal_gas_gives_one():
    x = np.random.default_rng(0).uniform(0, 10, (200, 100, 3))
    _, g = radial_distribution(x, (10.0, 10.0, 10.0), r_max=5.0, bins=1)
    pairs = 200 * 100 * 99 / 2 * (4 / 3 * np.pi * 125 / 1000)
    assert abs(g[0] - 1) < 4 / np.sqrt(pairs)


def test_a_simple_cubic_lattice_has_six_neighbours():
    x = np.stack(np.meshgrid(*[np.arange(6.0)] * 3), axis=-1).reshape(-1, 3)
    r, g = radial_distribution(x, (6.0, 6.0, 6.0), r_max=1.2, bins=12)
    width = 0.1
    shells = 4 / 3 * np.pi * ((r + width / 2) ** 3 - (r - width / 2) ** 3)
    np.testing.assert_allclose(np.sum(g * shells) * 215 / 216, 6, rtol=1e-12)


def test_bad_input():
    x = coordinates(1)[0]
    with pytest.raises(InputError, match=r"r_max = 4.1 is not in \(0, 4\]"):
        radial_distribution(x, LENGTHS, r_max=4.1)
    with pytest.raises(InputError, match="needs a periodic box"):
        radial_distribution(x, Box())
    with pytest.raises(InputError, match="n >= 2"):
        radial_distribution(x[:1], LENGTHS)
    with pytest.raises(InputError, match="one bin or more"):
        radial_distribution(x, LENGTHS, bins=0)
