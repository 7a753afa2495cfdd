"""Slopes of gravity along deviations of order 1 and 2, with bodies and with deviations in the lanes: forty digits."""

from __future__ import annotations

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.forces.slopes import variations_kernel
from kickdrift.forces.slopes.variations import varied
from kickdrift.forces.slopes.variations_kernel import prefers_bodies


def by_mpmath(mp, force, x, m, dx, dm):
    """Accelerations of the deviations: mixed differences of a(x + p u + q w + p q s, m + p m_u + q m_w)."""
    n, count = len(m), 2

    def accelerations(x, m):
        a = np.full((3, n), mp.mpf(0))
        for i in range(n):
            for j in range(n):
                if i != j:
                    d = x[:, j] - x[:, i]
                    a[:, i] += m[j] * d / mp.sqrt(sum(d * d) + mp.mpf(force.softening) ** 2) ** 3
        return a

    h, found = mp.mpf(10) ** -12, []
    exact = np.vectorize(lambda value: mp.mpf(float(value)), otypes=[object])
    x, m, dx, dm = (exact(each) for each in (x, m, dx, dm))
    for k in range(count):
        both = [accelerations(x + sign * h * dx[..., k], m + sign * h * dm[:, k]) for sign in (1, -1)]
        found.append((both[0] - both[1]) / (2 * h))
    pairs = [(one, two) for one in range(count) for two in range(one, count)]
    for column, (one, two) in enumerate(pairs, count):
        total = 0
        for p in (1, -1):
            for q in (1, -1):
                there = x + p * h * dx[..., one] + q * h * dx[..., two] + p * q * h * h * dx[..., column]
                total = total + p * q * accelerations(there, m + p * h * dm[:, one] + q * h * dm[:, two])
        found.append(total / (4 * h * h))
    return np.stack(found, axis=-1).astype(float)


@pytest.mark.parametrize(
    ("n", "light", "softening", "moves"), [(3, 0, 0.0, True), (9, 2, 0.3, True), (10, 6, 0.0, False)]
)
def test_slopes_have_their_digits(n, light, softening, moves, monkeypatch):
    mp = pytest.importorskip("mpmath")
    rng = np.random.default_rng(n)
    x, v, dx, dm = rng.normal(size=(3, n)), np.zeros((3, n)), rng.normal(size=(3, n, 5)), np.zeros((n, 2))
    m = rng.uniform(0.1, 1.0, n)
    m[1 : 1 + light] = 0.0
    if moves:  # one of a massless body too
        dm[[0, 1], [0, 1]] = 0.5, 0.25
    force = kd.Gravity(G=1.0, softening=softening)
    system = kd.System(x.T, v.T, m, forces=[force], units="nbody")
    deviations = np.array([dx, np.zeros_like(dx)]).reshape(2, 3, -1)
    with mp.workdps(40):
        wanted = by_mpmath(mp, force, x, m, dx, dm)
    for cheaper in (0.0, np.inf):  # lanes of deviations, lanes of bodies
        monkeypatch.setattr(variations_kernel, "CHEAPER", cheaper)
        masses = np.concatenate([dm, np.zeros((n, 3))], axis=1) if moves else None
        made = varied(system, deviations, masses, (), 2)
        found = BoundForces(made).measure(0.0, made.state.phase).accelerations[:, n:].reshape(3, n, 5)
        for column in range(5):
            size = np.abs(wanted[..., column]).max()
            np.testing.assert_allclose(found[..., column], wanted[..., column], rtol=0, atol=2e-14 * size)


def test_few_deviations_of_some_bodies_prefer_lanes_of_bodies():
    assert prefers_bodies(8, 8, 6, 6)
    assert not prefers_bodies(3, 3, 6, 6)
    assert prefers_bodies(8, 8, 48 + 48 * 49 // 2, 48)
    assert not prefers_bodies(100, 100, 48, 48)
