"""Engines on two-dimensional systems: each runs what the native engine runs, or says by name what it cannot run."""

from __future__ import annotations

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.engines import ENGINES
from kickdrift.model.starts.builders import plane_lattice
from tests.simulated import marked

FOREIGN = [marked(name) for name in ENGINES if name != "native"]
ROUND_OFF = 1e-12
STEPS, DT = 10, 0.002
BOXES = {
    "rectangle": lambda edges: kd.Box(edges),
    "leaning": lambda edges: kd.Box([[edges[0], 0.0], [-0.4 * edges[0], edges[1]]]),
    "strip": lambda edges: kd.Box(edges, periodic=(True, False, False)),
    "open": lambda edges: None,
}


def plane(box="rectangle", z=0.0, **law) -> kd.System:
    """120 moving particles near a hexagonal lattice in the plane z, some of them boxes away."""
    x, edges = plane_lattice("hexagonal", 120, 0.7)
    rng = np.random.default_rng(1)
    made = BOXES[box](edges)
    x[:, :2] += rng.uniform(-0.05, 0.05, (120, 2))
    if made is not None:
        x = x / [*edges, 1.0] @ np.where(np.eye(3)[:, 2:].any(axis=1)[:, None], np.eye(3), made.matrix)
        x += np.where(made.periodic_axes, rng.integers(-2, 3, (120, 3)), 0) @ made.matrix
    x[:, 2] = z
    v = rng.normal(size=(120, 2))
    forces = [kd.LennardJones(**{"cutoff": 2.5} | law)]
    return kd.System(x, v - v.mean(axis=0), box=made, forces=forces, dimensions=2)


def line() -> kd.System:
    """Particles in a row: the box that LAMMPS finds around them has no height."""
    return kd.System(np.outer(1.1 * np.arange(20.0), [0.6, 0.0]) / 0.6, forces=[kd.LennardJones()], dimensions=2)


SYSTEMS = {
    **{name: lambda name=name: plane(name) for name in BOXES},
    "above": lambda: plane("leaning", z=0.5),
    "cut": lambda: plane(truncation="cut"),
    "tail": lambda: plane(truncation="cut", tail=True),
    "line": line,
}
PERIODIC = "box: OpenMM: (needs a box periodic|cannot use a leaning box)"
CUT = "truncation 'cut': possible are 'shift'"
REFUSALS = {
    "rebound": dict.fromkeys(SYSTEMS, "force 'lennard-jones': rebound runs only gravity"),
    "ase": {"cut": CUT, "tail": CUT},
    "lammps": {"tail": "tail: LAMMPS has no tail correction in two dimensions"},
    "openmm": dict.fromkeys(["rectangle", "leaning", "strip", "above", "cut", "tail"], PERIODIC),
    "cuda": dict.fromkeys(["leaning", "above"], "box: it leans"),
}


def same(found, expected) -> bool:
    return float(np.abs(found - expected).max()) <= ROUND_OFF * float(np.abs(expected).max())


@pytest.mark.parametrize("name", SYSTEMS)
@pytest.mark.parametrize("engine", FOREIGN)
def test_a_plane_runs_as_on_the_native_engine_or_is_refused(engine, name):
    system, refusal = SYSTEMS[name](), REFUSALS[engine].get(name)
    if refusal:
        with pytest.raises(kd.InputError, match=rf"^engine '{engine}': {refusal}"):
            kd.Simulation(system, next(iter(ENGINES[engine].methods)), DT, engine=engine)
        return
    ours, theirs = (kd.Simulation(system, "velocity-verlet", DT, engine=one) for one in ("native", engine))
    expected, found = ours.sample(), theirs.sample()
    assert found.energies.potential == pytest.approx(expected.energies.potential, rel=ROUND_OFF)
    assert found.temperature == pytest.approx(expected.temperature, rel=ROUND_OFF)
    assert found.pressure == pytest.approx(expected.pressure, rel=ROUND_OFF, nan_ok=True)
    assert np.isfinite(expected.pressure) == np.isfinite(system.volume)
    assert same(theirs.forces(), ours.forces())
    steps = 3 if engine == "cuda" else STEPS  # a simulated device is slow
    ours.run(steps), theirs.run(steps)
    assert same(theirs.state.positions, ours.state.positions)
    assert same(theirs.state.velocities + 0.0, ours.state.velocities)
    z = system.state.positions[0, 2]
    assert np.unique(theirs.state.positions[:, 2]).tolist() == [z]
    assert not theirs.state.velocities[:, 2].any()


@pytest.mark.long
def test_lammps_in_two_processes_has_the_same_plane():
    ours, theirs = (kd.Simulation(plane("leaning", z=0.5), "velocity-verlet", DT, engine=e, processes=p)
                    for e, p in (("native", 1), ("lammps", 2)))  # fmt: skip
    ours.run(STEPS), theirs.run(STEPS)
    assert same(theirs.state.positions, ours.state.positions)
    assert theirs.sample().pressure == pytest.approx(ours.sample().pressure, rel=1e-11)


@pytest.mark.parametrize("method", ENGINES["rebound"].methods)
def test_rebound_keeps_planets_in_their_plane(method):
    rng = np.random.default_rng(2)
    angle, r = rng.uniform(0, 6.28, 4), np.array([0.0, 1.0, 1.7, 3.1])
    x = np.column_stack([r * np.cos(angle), r * np.sin(angle), np.full(4, 0.3)])
    speed = np.divide(1.0, np.sqrt(r), out=np.zeros(4), where=r > 0)
    v = np.column_stack([-speed * np.sin(angle), speed * np.cos(angle)])
    system = kd.System(x, v, [1.0, 1e-4, 2e-4, 1e-4], forces=[kd.Gravity()], units="nbody", dimensions=2)
    dt = None if method == "gauss-radau15" else 0.02
    ours, theirs = (kd.Simulation(system, method, dt, engine=engine) for engine in ("native", "rebound"))
    for sim in (ours, theirs):
        sim.run(until=2.0)
    assert np.abs(theirs.state.positions - ours.state.positions).max() < 1e-12
    assert np.ptp(theirs.state.positions[:, 2]) == 0
    assert not theirs.state.velocities[:, 2].any()
