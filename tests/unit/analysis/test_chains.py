"""Sizes of chains: exact sums of a freely jointed chain, a slow oracle, and bad input."""

from __future__ import annotations

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.analysis import chain_diffusion, chain_statistics
from kickdrift.errors import InputError
from kickdrift.model.state import State
from kickdrift.trajectory.write.h5md import Writer

BONDS, CHAINS, EDGE = 20, 30, 7.0


def written(path, frames, topology, box=EDGE):
    """File of a run with these positions (frames, n, 3)."""
    n = frames.shape[1]
    system = kd.System(frames[0], box=[box] * 3, forces=[kd.HarmonicBond(30.0, 1.0)], topology=topology)
    with Writer(path, system, method={"integrator": "none"}, every=1) as file:
        for k, x in enumerate(frames):
            file.append(State(np.stack([x.T, np.zeros((3, n))]), np.ones(n), np.arange(n), system.box, 0.1 * k, k), {})
    return path


def freely_jointed(frames=60, seed=1):
    """Chains of random unit bonds, wrapped into the box."""
    bonds = np.random.default_rng(seed).normal(size=(frames, CHAINS, BONDS, 3))
    bonds /= np.linalg.norm(bonds, axis=-1, keepdims=True)
    places = np.concatenate([np.zeros((frames, CHAINS, 1, 3)), np.cumsum(bonds, axis=2)], axis=2)
    return places.reshape(frames, -1, 3)


def test_a_freely_jointed_chain_has_its_exact_sizes(tmp_path):
    """Sources: Rubinstein & Colby, Polymer Physics 2003, eqs. 2.17 and 2.54 (with the finite sum of N bonds)."""
    frames = freely_jointed()
    found = chain_statistics(written(tmp_path / "run.h5md", frames, kd.Topology.chains(CHAINS, BONDS + 1)))
    assert (found.chains, found.bonds) == (CHAINS, BONDS)
    exact = {
        "end_to_end": BONDS, "gyration": BONDS * (BONDS + 2) / (6 * (BONDS + 1)), "persistence": 1.0,
        "characteristic_ratio": 1.0,
    }  # fmt: skip
    for name, value in exact.items():
        mean = getattr(found, name)
        assert abs(float(mean.value) - value) < 4 * float(mean.error) < 0.2 * value
    assert float(found.contour.value) == pytest.approx(BONDS)
    chains = frames.reshape(60, CHAINS, BONDS + 1, 3)
    apart = chains[:, :, :, None] - chains[:, :, None]
    oracle = 0.5 * (apart**2).sum(axis=-1).mean(axis=(2, 3)).mean()
    assert float(found.gyration.value) == pytest.approx(oracle, rel=1e-12)


def test_the_centres_of_chains_diffuse(tmp_path):
    """All particles of a chain take the same random steps, so their centre does too."""
    rng = np.random.default_rng(2)
    steps = np.cumsum(rng.normal(scale=0.1, size=(100, CHAINS, 1, 3)), axis=0)
    frames = (freely_jointed(1).reshape(1, CHAINS, BONDS + 1, 3) + steps).reshape(100, -1, 3)
    found = chain_diffusion(written(tmp_path / "run.h5md", frames, kd.Topology.chains(CHAINS, BONDS + 1)), lags=10)
    alone = kd.analysis.mean_squared_displacement(steps[:, :, 0], 0.1 * np.arange(100), 10)
    np.testing.assert_allclose(found.values, alone.values, rtol=1e-9, atol=1e-12)
    assert found.values[1] == pytest.approx(0.03, rel=0.1)


def test_what_is_no_set_of_equal_chains_is_refused(tmp_path):
    x = np.random.default_rng(3).random((1, 6, 3))
    for bonds, said in (
        ([[0, 1], [0, 2], [0, 3]], "particle 0 has 3 bonds; chains are linear"),
        ([[0, 1], [1, 2], [0, 2], [3, 4]], "particle 0 is in a ring"),
        ([[0, 1], [1, 2], [3, 4]], "chains have 2 to 3 particles"),
    ):
        path = written(tmp_path / f"{len(said)}.h5md", x, kd.Topology(bonds=bonds))
        with pytest.raises(InputError, match=said):
            chain_statistics(path)
    kd.Simulation(kd.load("two-body"), "leapfrog", 0.01).run(4, every=2, output=tmp_path / "none.h5md")
    with pytest.raises(InputError, match="expected a run with bonds"):
        chain_statistics(tmp_path / "none.h5md")


def test_a_frame_alone_is_refused():
    with pytest.raises(InputError, match="chains: expected a run, its path, or some of its frames, got System"):
        kd.analysis.chain_statistics(kd.load("kremer-grest-1000"))
