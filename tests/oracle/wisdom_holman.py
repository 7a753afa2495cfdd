"""The Wisdom-Holman map and its kernels in extended precision, planets for it, and the error of a run's energy."""

from __future__ import annotations

from itertools import product

import numpy as np

import kickdrift as kd
from tests.oracle.kepler import L, moved


def planets(count=4, massless=0, scale=1e-3, seed=1, boost=0.0, forces=(), **options) -> kd.System:
    """A star of mass 1 and bodies on near-circular orbits, each 1.8 times as large as the last; some may be
    massless."""
    rng = np.random.default_rng(seed)
    a, f = 1.8 ** np.arange(count), rng.uniform(0.0, 2.0 * np.pi, count)
    speed = (1.0 + rng.uniform(-0.05, 0.05, count)) / np.sqrt(a)
    x, v = np.zeros((2, count + 1, 3))
    x[1:] = np.stack([a * np.cos(f), a * np.sin(f), 0.05 * a * rng.normal(size=count)], axis=1)
    v[1:] = np.stack([-speed * np.sin(f), speed * np.cos(f), 0.05 * speed * rng.normal(size=count)], axis=1)
    masses = np.array([1.0, *(scale * rng.uniform(0.2, 1.0, count))])
    masses[1 + rng.permutation(count)[:massless]] = 0.0
    x[0], v[0] = -(masses[1:] @ x[1:]), -(masses[1:] @ v[1:])
    return kd.System(x, v + boost, masses=masses, forces=[kd.Gravity(), *forces], units="nbody", **options)


LEAPFROG = (0.5, 1.0), (0.5, 0.0)  # drifts, and the kicks after each
COMPOSITION = (0.625, -1 / 6), (-0.25, 1 / 6), (0.125, 1.0), (-0.125, -1 / 6), (0.25, 1 / 6), (0.375, 0.0)


def accelerations(x, masses):
    """Newton's accelerations (n, 3), pair by pair."""
    a = np.zeros_like(x)
    for i, j in product(range(len(x)), repeat=2):
        if i != j:
            d = x[j] - x[i]
            a[i] += masses[j] * d / np.sqrt(d @ d) ** 3
    return a


def plain_map(system, dt, steps, jacobi, kernel="standard"):
    """Drift, kernel, drift in extended precision, with matrices for coordinates and plain differences."""
    m = system.state.masses.astype(L)
    x, v = system.state.positions.astype(L), system.state.velocities.astype(L)
    n = len(m)
    to = np.zeros((n, n), L)  # rows: the centre of mass, then each body
    to[0] = m / m.sum()
    for i in range(1, n):
        inner = m[:i] / m[:i].sum() if jacobi else np.array([L(1)] + [L(0)] * (i - 1))
        to[i, :i], to[i, i] = -inner, 1
    to_v = to if jacobi else np.vstack([to[:1], np.eye(n, dtype=L)[1:] - to[0]])
    back, back_v = (np.linalg.inv(matrix.astype(float)).astype(L) for matrix in (to, to_v))
    for _ in range(3):  # Newton's iteration: to extended precision
        back, back_v = back @ (2 * np.eye(n) - to @ back), back_v @ (2 * np.eye(n) - to_v @ back_v)
    gm = np.cumsum(m) if jacobi else np.full(n, m[0])
    q, p = to @ x, to_v @ v

    def drift(h):
        q[0] += h * p[0]
        for i in range(1, n):
            q[i], p[i] = moved(gm[i], h, q[i], p[i])

    def felt(q):
        """Accelerations of the interaction."""
        if not jacobi:
            return np.vstack([np.zeros((1, 3)), accelerations(back @ q, np.array([0, *m[1:]], L))[1:]])
        a = to @ accelerations(back @ q, m)
        for i in range(1, n):
            a[i] += gm[i] * q[i] / np.sqrt(q[i] @ q[i]) ** 3
        return a

    def kick(h):
        a, weight = felt(q), L(dt) ** 2 / 12
        if kernel == "lazy":
            a = felt(q + weight * a)
        if kernel == "modified-kick":  # the slope by differences of fourth order
            slopes = [(felt(q + e * a) - felt(q - e * a)) / (2 * e) for e in (L(0.02), L(0.01))]
            a = a + weight * (4 * slopes[1] - slopes[0]) / 3
        p[1:] += h * a[1:]

    for _ in range(steps):
        for before, weight in COMPOSITION if kernel == "composition" else LEAPFROG:
            drift(L(before) * L(dt))
            if weight:
                if not jacobi:
                    q[1:] += L(dt) * (m[1:] @ p[1:]) / m[0]
                kick(L(weight) * L(dt))
    return back @ q, back_v @ p


def energy_error(system, dt, name="wisdom-holman", **options) -> float:
    """Largest energy change over a few orbits, with exact summation of the first and each later energy."""

    def energy(state):
        x, v, m = state.positions.astype(L), state.velocities.astype(L), state.masses.astype(L)
        total = (m[:, None] * v * v).sum() / 2
        for i in range(1, len(m)):
            total -= (m[i] * m[:i] / np.sqrt(((x[:i] - x[i]) ** 2).sum(axis=1))).sum()
        return total

    sim, found = kd.Simulation(system, name, dt=dt, **options), []
    sim.run(round(24.0 / dt), every=1, observe=lambda sim: found.append(energy(sim.state)))
    return float(np.abs(np.array(found) / found[0] - 1).max())
