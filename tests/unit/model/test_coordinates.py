"""Coordinates of planetary systems against their definitions, and the inverse maps."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kickdrift.errors import InputError
from kickdrift.model.starts import coordinates as to

EPS = np.finfo(float).eps


def bodies(n=6, seed=0, frames=()):
    rng = np.random.default_rng(seed)
    masses = np.concatenate([[1.0], 10.0 ** rng.uniform(-9, -2, n - 1)])
    masses[2] = 0.0  # a test particle among the planets
    return rng.normal(size=(*frames, n, 3)), rng.normal(size=(*frames, n, 3)), masses


def test_jacobi_is_what_its_definition_says():
    x, _, m = bodies()
    found = to.to_jacobi(x, m)
    assert np.allclose(found[0], m @ x / m.sum(), rtol=0, atol=2 * EPS)
    for i in range(1, len(m)):
        assert np.allclose(found[i], x[i] - m[:i] @ x[:i] / m[:i].sum(), rtol=0, atol=4 * EPS)


def test_kinetic_energy_is_a_sum_over_jacobis_reduced_masses():
    _, v, m = bodies()
    moving = to.to_jacobi(v, m)
    total = np.cumsum(m)
    reduced = np.concatenate([[total[-1]], m[1:] * total[:-1] / total[1:]])
    assert 0.5 * reduced @ (moving**2).sum(axis=1) == pytest.approx(0.5 * m @ (v**2).sum(axis=1), rel=1e-14)


def test_heliocentric_and_democratic():
    x, v, m = bodies()
    assert np.array_equal(to.to_heliocentric(x, m)[1:], x[1:] - x[0])
    centre, moving = m @ x / m.sum(), m @ v / m.sum()
    relative, velocities = to.to_democratic(x, v, m)
    assert np.array_equal(relative[1:], x[1:] - x[0])
    assert np.allclose(velocities[1:], v[1:] - moving, rtol=0, atol=EPS)
    assert np.allclose(relative[0], centre, rtol=0, atol=EPS)
    assert np.allclose(velocities[0], moving, rtol=0, atol=EPS)
    # canonical: the sum of p dq is conserved (Duncan, Levison & Lee 1998), tested here by the angular momentum
    sun = m.sum() * np.cross(relative[0], velocities[0])
    total = sun + (m[1:, None] * np.cross(relative[1:], velocities[1:])).sum(axis=0)
    assert np.allclose(total, (m[:, None] * np.cross(x, v)).sum(axis=0), rtol=0, atol=1e-15)


def test_masses_may_differ_from_frame_to_frame():
    x, v, _ = bodies(frames=(4, 2))
    m = np.random.default_rng(3).uniform(0.1, 1.0, x.shape[:-1])
    for k in np.ndindex(4, 2):
        for name in ("to_heliocentric", "to_jacobi", "from_heliocentric", "from_jacobi", "barycentre"):
            np.testing.assert_allclose(getattr(to, name)(x, m)[k], getattr(to, name)(x[k], m[k]), rtol=0, atol=8 * EPS)
        for name in ("to_democratic", "from_democratic"):
            together, alone = getattr(to, name)(x, v, m), getattr(to, name)(x[k], v[k], m[k])
            for mine, other in zip(together, alone, strict=True):
                np.testing.assert_allclose(mine[k], other, rtol=0, atol=50 * EPS)
        for frame in to.FRAMES:
            found = to.at_barycentre(x, m, frame)[k]
            np.testing.assert_allclose(found, to.at_barycentre(x[k], m[k], frame), rtol=0, atol=50 * EPS)


@given(st.integers(2, 12), st.integers(0, 1000), st.sampled_from([(), (3,), (2, 2)]))
@settings(deadline=None)
def test_every_map_has_an_inverse(n, seed, frames):
    x, v, m = bodies(max(n, 3), seed, frames)
    assert np.abs(to.from_jacobi(to.to_jacobi(x, m), m) - x).max() < 40 * EPS
    assert np.abs(to.from_heliocentric(to.to_heliocentric(x, m), m) - x).max() < 40 * EPS
    back = to.from_democratic(*to.to_democratic(x, v, m), m)
    assert np.abs(np.array(back) - (x, v)).max() < 40 * EPS
    relative, centre = to.to_barycentric(x, m)
    assert np.abs(relative + centre[..., None, :] - x).max() < 40 * EPS
    for frame in to.FRAMES:
        rows = np.concatenate([np.full_like(x[..., :1, :], 9.9), to.about_centre(x, m, frame)], axis=-2)
        assert np.abs(to.at_barycentre(rows, m, frame) - relative).max() < 40 * EPS


def test_the_masses_that_a_body_orbits():
    m = [10.0, 1.0, 2.0, 0.0]
    assert to.attracting_masses(m, "heliocentric").tolist() == [11.0, 12.0, 10.0]
    assert to.attracting_masses(m, "jacobi").tolist() == [11.0, 13.0, 13.0]
    assert to.attracting_masses(m, "barycentric").tolist() == [13.0, 13.0, 13.0]


@pytest.mark.parametrize(
    ("masses", "message"),
    [
        ([0.0, 1.0], "particle 0, has no mass"),
        ([1.0, 1.0, 1.0], "expected coordinates"),
        ([0.0, 0.0], "with a positive sum"),
        ([2.0, -1.0], "zero or more"),
    ],
)
def test_bad_masses(masses, message):
    with pytest.raises(InputError, match=message):
        to.to_jacobi(np.ones((2, 3)), masses)


def test_an_unknown_frame_gets_the_nearest_name():
    with pytest.raises(
        InputError, match="frame: expected one of heliocentric, jacobi, barycentric, got 'jacobian'; did"
    ):
        to.about_centre(np.ones((2, 3)), [1.0, 1.0], "jacobian")
