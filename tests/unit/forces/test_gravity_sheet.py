"""gravity-sheet: against a plain sum, shear-periodic, momentum, way back, beside rebound, refusals."""

from __future__ import annotations

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError

OMEGA, WIDTH, LENGTH = 0.8, 3.0, 4.0


def sheet(**options) -> kd.GravitySheet:
    return kd.GravitySheet(**({"omega": OMEGA, "width": WIDTH, "length": LENGTH, "softening": 0.1} | options))


def patch(n=7, spread=1.0, time=0.0, ghosts=1, seed=3) -> kd.System:
    """Particles in the patch, some of them without mass, with the velocities of the shear."""
    rng = np.random.default_rng(seed)
    x = spread * np.stack([WIDTH, LENGTH, 0.3]) * rng.uniform(-0.5, 0.5, (n, 3))
    v = 0.02 * rng.normal(size=(n, 3))
    v[:, 1] -= 1.5 * OMEGA * x[:, 0]
    masses = rng.uniform(0.01, 0.03, n)
    masses[1] = 0.0
    system = kd.System(x, v, masses=masses, forces=[sheet(ghosts=ghosts), kd.Hill(OMEGA)], units="nbody")
    return system.at(system.state.phase, time)


def pulls(system, positions, time, ghosts=1):
    """Accelerations by a plain sum over images."""
    masses, found = system.state.masses, np.zeros_like(positions)
    for i, own in enumerate(positions):
        for j, other in enumerate(positions):
            if i == j:
                continue
            nearest = round((own[0] - other[0]) / WIDTH)
            for k in range(nearest - ghosts, nearest + ghosts + 1):
                d = other - own + np.array([k * WIDTH, -1.5 * OMEGA * k * WIDTH * time, 0.0])
                d[1] -= LENGTH * round(d[1] / LENGTH)
                for row in range(-ghosts, ghosts + 1):
                    e = d + np.array([0.0, row * LENGTH, 0.0])
                    found[i] += masses[j] * e / (e @ e + 0.01) ** 1.5
    return found


def hills(state):
    x, v = state.positions, state.velocities
    return np.stack([2 * OMEGA * v[:, 1] + 3 * OMEGA**2 * x[:, 0], -2 * OMEGA * v[:, 0], -(OMEGA**2) * x[:, 2]], axis=1)


@pytest.mark.parametrize("ghosts", [0, 1, 2])
@pytest.mark.parametrize("time", [0.0, 0.3, 17.0])
def test_the_sum_over_images(ghosts, time):
    system = patch(time=time, ghosts=ghosts)
    sim = kd.Simulation(system, "sei", dt=0.01)
    expected = pulls(system, system.state.positions, time, ghosts) + hills(system.state)
    np.testing.assert_allclose(sim.forces(), system.state.masses[:, None] * expected, atol=1e-13)


def test_images_are_as_good_as_the_particles():
    """A particle moved to an image of itself feels and gives the same forces, and stays an image for ever."""
    time = 2.3
    system = patch(time=time)
    phase = system.state.phase.copy()
    for i, (k, row) in {0: (1, 0), 2: (-2, 3), 5: (0, -1)}.items():
        phase[0, :2, i] += k * WIDTH, -1.5 * OMEGA * k * WIDTH * time + row * LENGTH
        phase[1, 1, i] -= 1.5 * OMEGA * k * WIDTH
    ends = []
    for start in (system.state.phase, phase):
        sim = kd.Simulation(system.at(start, time), "sei", dt=0.02)
        sim.run(60, every=60)
        assert sim.time == pytest.approx(time + 1.2)
        ends.append(sim.state)
    moved = ends[1].positions - ends[0].positions
    assert moved[0] == pytest.approx([WIDTH, -1.5 * OMEGA * WIDTH * (time + 1.2), 0.0], abs=1e-11)
    assert moved[2] == pytest.approx([-2 * WIDTH, 3 * OMEGA * WIDTH * (time + 1.2) + 3 * LENGTH, 0.0], abs=1e-11)
    assert moved[5] == pytest.approx([0.0, -LENGTH, 0.0], abs=1e-11)
    assert np.abs(moved[[1, 3, 4, 6]]).max() < 1e-11


def test_momentum_moves_on_an_epicycle():
    """The images of a particle pull it in no direction, so the centre of mass moves as a single particle."""
    system = patch(8)
    x, v, m = system.state.positions, system.state.velocities, system.state.masses
    alone = kd.System([m @ x / m.sum()], [m @ v / m.sum()], [m.sum()], forces=[kd.Hill(OMEGA)], units="nbody")
    centre = kd.Simulation(alone, "sei", dt=0.05)
    sim = kd.Simulation(system, "sei", dt=0.05)
    for each in (centre, sim):
        each.run(100, every=100)
    np.testing.assert_allclose(m @ sim.state.positions / m.sum(), centre.state.positions[0], atol=1e-11)


def test_there_and_back_again():
    sim = kd.Simulation(patch(), "sei", dt=0.02)
    start = sim.state.positions
    sim.run(until=2.0)
    assert np.abs(sim.state.positions - start).max() > 0.3
    sim.run(until=0.0)
    np.testing.assert_allclose(sim.state.positions, start, atol=1e-11)


def test_beside_rebound():
    """Its images are those of the patch, the same while all particles and the lag of the images are near the centre."""
    rebound = pytest.importorskip("rebound")
    system = patch(spread=0.3)
    there, ours = rebound.Simulation(), kd.Simulation(system, "sei", dt=0.01)
    there.G, there.OMEGA, there.softening, there.dt, there.integrator = 1.0, OMEGA, 0.1, 0.01, "sei"
    there.root_size, there.N_root_x, there.N_root_y, there.N_root_z = 1.0, int(WIDTH), int(LENGTH), 2
    there.boundary, there.N_ghost_x, there.N_ghost_y, there.N_ghost_z = "shear", 1, 1, 0
    for m, x, v in zip(system.state.masses, system.state.positions, system.state.velocities, strict=True):
        there.add(m=m, x=x[0], y=x[1], z=x[2], vx=v[0], vy=v[1], vz=v[2])
    there.steps(10)
    ours.run(10, every=10)
    positions = np.array([p.xyz for p in there.particles])
    np.testing.assert_allclose(ours.state.positions, positions, atol=1e-14)
    alone = kd.Simulation(system.with_forces(sheet(ghosts=0), kd.Hill(OMEGA)), "sei", dt=0.01)
    alone.run(10, every=10)
    assert np.abs(alone.state.positions - positions).max() > 1e-8


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: sheet(width=0.0), "gravity-sheet: width must be a positive number"),
        (lambda: sheet(ghosts=21), "gravity-sheet: ghosts must be 0 to 20, got 21"),
        (lambda: sheet(softening=-1.0), "gravity-sheet: softening must be zero or more"),
        (
            lambda: kd.Simulation(patch().with_forces(sheet(), kd.Hill(0.7)), "sei", dt=0.1),
            "gravity-sheet: omega is 0.8, and the omega of hill is 0.7",
        ),
        (lambda: kd.System([[0.0] * 3] * 2, box=(9, 9, 9), forces=[sheet()], units="nbody"), "needs open space"),
    ],
)
def test_bad_input(make, message):
    with pytest.raises(InputError, match=message):
        make()
