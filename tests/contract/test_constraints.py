"""Contract tests over the methods: constraints are kept, to rounding and in order, with the same bits; or refused."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.integrators import INTEGRATORS, integrator
from kickdrift.model.freedom import freedom_of
from kickdrift.trajectory.layout.checkpoints import decoded, encoded
from tests.long import shortened
from tests.systems import needed

METHODS = [name for name, method in INTEGRATORS.items() if method.name == name]
KEEPING = [name for name in METHODS if not integrator(name).free_because]
TRAP = kd.HarmonicTrap(0.5)


def molecules(seed: int = 5, more: int = 0) -> kd.System:
    """Pairs, a triangle, a ring of four, a tetrahedron, a chain of six and two free particles in a trap."""
    rng = np.random.default_rng(seed)
    shapes = [(2, [(0, 1)])] * (2 + more)
    shapes += [(3, [(0, 1), (0, 2), (1, 2)]), (4, [(0, 1), (1, 2), (2, 3), (3, 0)])]
    shapes += [(4, [(a, b) for b in range(4) for a in range(b)]), (6, [(k, k + 1) for k in range(5)])]
    shapes += [(1, []), (1, [])]
    pairs, n = [], 0
    for size, own in shapes:
        pairs += [(n + a, n + b) for a, b in own]
        n += size
    x = rng.normal(size=(n, 3)) * 0.4 + np.repeat(rng.normal(size=(len(shapes), 3)), [size for size, _ in shapes], 0)
    v, order = rng.normal(size=(n, 3)), rng.permutation(n)
    back = np.argsort(order)
    return kd.System(
        x[order], v[order], rng.uniform(0.5, 2.0, n), forces=[TRAP],
        constraints=[kd.Constraint(pairs=back[np.array(pairs)])], name="molecules",
    )  # fmt: skip


def errors(system: kd.System, state: kd.State) -> tuple[float, float]:
    held = system.constraints
    speed = np.abs(state.phase[1]).max()
    return np.abs(held.errors(state.phase[0])).max(), np.abs(held.rates(*state.phase)).max() / speed


def exact(system: kd.System, time: float) -> np.ndarray:
    """Phase (2, 3, n) after a time by Lagrange's equations of the first kind, to many digits."""
    held, masses = system.constraints, system.coherent_masses
    i, j = held.pairs.T
    n, c = len(masses), len(held)

    def slope(t, y):
        x, v = y.reshape(2, 3, n)
        apart, fast = x[:, i] - x[:, j], v[:, i] - v[:, j]
        jacobian = np.zeros((c, 3, n))
        jacobian[np.arange(c), :, i], jacobian[np.arange(c), :, j] = apart.T, -apart.T
        a = -TRAP.stiffness * x / masses
        flat = jacobian.reshape(c, -1)
        matrix = (flat / np.tile(masses, 3)) @ flat.T
        push = np.linalg.solve(matrix, -(flat @ a.ravel()) - (fast**2).sum(axis=0))
        return np.concatenate([v.ravel(), (a + (push @ flat).reshape(3, n) / masses).ravel()])

    y = system.state.phase.ravel()
    return solve_ivp(slope, (0.0, time), y, "DOP853", rtol=1e-12, atol=1e-12).y[:, -1].reshape(2, 3, n)


@pytest.fixture(scope="module")
def at_one() -> np.ndarray:
    return exact(molecules(), 1.0)


@pytest.mark.parametrize("name", KEEPING)
def test_distances_and_velocities_stay_at_rounding(name):
    system = molecules()
    sim = kd.Simulation(system, name, dt=0.01, **needed(name))
    sim.run(100)
    length, rate = errors(system, sim.state)
    assert length < 1e-14
    assert rate < 1e-13


@pytest.mark.parametrize("name", [name for name in KEEPING if not integrator(name).bath])
def test_the_order_is_that_of_the_method(name, at_one):
    system, found = molecules(), []
    order = integrator(name).order
    steps = 40 if order < 4 else 25
    for count in (steps, 2 * steps):
        sim = kd.Simulation(system, name, dt=1.0 / count)
        sim.run(count)
        found.append(np.abs(sim.state.phase - at_one).max())
    assert np.log2(found[0] / found[1]) > order - 0.35 or found[1] < 1e-10
    assert found[0] < 0.2


@pytest.mark.parametrize("name", KEEPING)
def test_bits_are_the_same_in_pieces_and_after_a_restart(name):
    system = molecules()
    whole, parts, later = (kd.Simulation(system, name, dt=0.01, **needed(name)) for _ in range(3))
    whole.run(12)
    parts.run(5)
    later.restore(decoded(encoded(parts.checkpoint())))
    for sim in (parts, later):
        sim.run(7)
        np.testing.assert_array_equal(sim.state.phase, whole.state.phase)


@pytest.mark.parametrize("name", ["velocity-verlet", "baoab"])
def test_bits_are_the_same_on_two_threads(name):
    system = molecules(more=600)
    states = []
    for threads in (1, 2):
        sim = kd.Simulation(system, name, dt=0.01, threads=threads, **needed(name))
        sim.run(5)
        states.append(sim.state.phase)
    np.testing.assert_array_equal(*states)


@pytest.mark.parametrize("name", [name for name in KEEPING if integrator(name).reversible])
def test_a_run_goes_back_to_its_start(name):
    system = molecules()
    sim = kd.Simulation(system, name, dt=0.01)
    sim.run(50)
    sim.run(until=0.0)
    assert np.abs(sim.state.phase - system.state.phase).max() < 1e-11


@pytest.mark.parametrize("name", [name for name in METHODS if name not in KEEPING])
def test_other_methods_refuse_by_name(name):
    options = needed(name) | ({} if integrator(name).adaptive else {"dt": 0.01})
    with pytest.raises(InputError, match=f"^{name}: keeps no constraints, because it "):
        kd.Simulation(molecules(), name, **options)


@pytest.mark.parametrize("dimensions", [2, 3])
@pytest.mark.parametrize("around", ["open", "trap", "box"])
def test_degrees_of_freedom_are_the_rank_of_the_conditions(around, dimensions):
    start = molecules()
    if dimensions == 2:  # without the tetrahedron and the ring, which have no plane form of their own
        start = flat()
    x, masses, n = start.state.phase[0], start.coherent_masses, len(start)
    box = [40.0] * dimensions if around == "box" else None
    system = start.remade(forces=[TRAP] if around == "trap" else [], box=kd.Box(box) if box else None)
    rows = [start.constraints.gradients(x).toarray()]
    if around != "trap":
        rows.append(np.kron(np.eye(3), masses))
    if around == "open":
        turns = np.array([np.cross(axis, x.T).T * masses for axis in np.eye(3)[-1 if dimensions == 2 else 0 :]])
        rows.append(turns.reshape(len(turns), -1))
    conditions = np.concatenate([row / np.sqrt(np.tile(masses, 3)) for row in rows])
    conditions = conditions[:, : dimensions * n]
    scaled = conditions / np.maximum(np.linalg.norm(conditions, axis=1, keepdims=True), 1e-300)
    assert freedom_of(system) == dimensions * n - np.linalg.matrix_rank(scaled, tol=1e-8)
    assert freedom_of(system, drags=True) == dimensions * n - len(system.constraints)


def flat() -> kd.System:
    """A pair, a triangle, a chain and a free particle in a plane."""
    rng = np.random.default_rng(2)
    pairs = [(0, 1), (2, 3), (3, 4), (2, 4), (5, 6), (6, 7), (7, 8)]
    return kd.System(
        rng.normal(size=(10, 2)), rng.normal(size=(10, 2)), rng.uniform(0.5, 2.0, 10), forces=[TRAP], dimensions=2,
        constraints=[kd.Constraint(pairs=pairs)],
    )  # fmt: skip


@pytest.mark.parametrize("name", shortened([name for name in KEEPING if integrator(name).drags], ["baoab"]))
def test_baths_give_each_motion_its_temperature(name):
    """Free pairs: three translations and two rotations each. Ten standard errors would need a fault."""
    rng, n = np.random.default_rng(1), 400
    x = np.repeat(rng.uniform(0.0, 50.0, (n, 3)), 2, axis=0)
    x[1::2] += [1.0, 0.0, 0.0]
    pairs = np.arange(2 * n).reshape(n, 2)
    masses = np.tile([1.0, 3.0], n)
    system = kd.System(x, None, masses, box=[50.0] * 3, constraints=[kd.Constraint(pairs=pairs, distance=1.0)])
    sim = kd.Simulation(system, name, dt=0.05, **needed(name) | {"friction": 4.0})
    sim.run(20)
    moving, turning = [], []
    for _ in range(40):
        sim.run(10)
        v = sim.state.velocities.reshape(n, 2, 3)
        centre = np.einsum("a,nac->nc", [0.25, 0.75], v)
        moving.append(4.0 * (centre**2).sum() / (3 * n))
        turning.append(0.75 * ((v[:, 1] - v[:, 0]) ** 2).sum() / (2 * n))
    for found, freedom in ((moving, 3), (turning, 2)):
        error = np.sqrt(2.0 / (freedom * n * 40)) * 1.5
        assert abs(np.mean(found) - 1.0) < 4.0 * error
    assert sim.report().temperature == pytest.approx(1.0, abs=0.05)
    length, rate = errors(system, sim.state)
    assert length < 1e-12
    assert rate < 1e-12
