"""Results from runs whose box changes: displacements, structure and pressure, each frame in its own box."""

from __future__ import annotations

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.analysis import mean_squared_displacement, pressure_tensor, radial_distribution, structure_factor
from kickdrift.analysis.observables.vectors import travelled
from kickdrift.errors import InputError
from kickdrift.looks.pressure import instantaneous_pressure
from kickdrift.model.state import State
from kickdrift.trajectory.write.h5md import Writer
from tests.run_files import breathing, states, write
from tests.systems import liquid

D, DT, EDGE, SWING = 1.0, 1.0, 10.0, 0.02


def walk(frames=4000, particles=60, seed=5):
    """Free Brownian particles in a cube whose edge fluctuates: each step scales all positions x = w + n L with the box
    and adds independent normal displacements. The diffusion coefficient is D, whatever the box does."""
    rng = np.random.default_rng(seed)
    edges = EDGE * (1 + SWING * rng.normal(size=frames))
    x = np.empty((frames, particles, 3))
    x[0] = rng.uniform(0, edges[0], (particles, 3))
    for k in range(1, frames):
        x[k] = x[k - 1] * edges[k] / edges[k - 1] + rng.normal(0, np.sqrt(2 * D * DT), (particles, 3))
    return x, [kd.Box((edge,) * 3) for edge in edges]


def nearest_image(x, edges):
    """The scheme of von Bülow, Bullerjahn & Hummer 2020 from wrapped positions alone, by the nearest image."""
    inside = x % edges[:, None, None]
    u = x.copy()
    for k in range(1, len(x)):
        step = inside[k] - inside[k - 1]
        u[k] = u[k - 1] + step - np.floor(step / edges[k] + 0.5) * edges[k]
    return u


def test_travelled_positions_are_those_of_the_nearest_image():
    """Steps far shorter than half a box: the counts of edges and the nearest image say the same."""
    x, boxes = walk(frames=300, particles=8)
    edges = np.array([box.lengths[0] for box in boxes])
    x = x[0] * edges[:, None, None] / edges[0] + 0.2 * (x - x[0] * edges[:, None, None] / edges[0])
    np.testing.assert_allclose(travelled(x, boxes), nearest_image(x, edges), rtol=0, atol=1e-9)


def test_travelled_positions_in_a_leaning_box_and_a_slab():
    rng = np.random.default_rng(3)
    matrix = np.array([[9.0, 0, 0], [-3.0, 10.0, 0], [2.0, 4.0, 11.0]])
    for periodic in (True, (True, True, False)):
        rows = matrix if periodic is True else np.diag(np.diag(matrix))
        scales = 1 + 0.02 * rng.normal(size=50)
        boxes = [kd.Box(matrix=rows * s, periodic=periodic) for s in scales]
        x = np.cumsum(rng.normal(0, 0.5, (50, 6, 3)), axis=0) + 20
        found = travelled(x, boxes)
        for k in range(1, 50):  # each step is the shortest of the images of the step inside the boxes
            step = boxes[k].wrap(x[k]) - boxes[k - 1].wrap(x[k - 1])
            apart = found[k] - found[k - 1]
            np.testing.assert_allclose(boxes[k].minimum_image(apart - step), 0.0, atol=1e-9)
        np.testing.assert_array_equal(travelled(x, [boxes[0]] * 50)[0], x[0])
        np.testing.assert_allclose(travelled(x, [boxes[0]] * 50), x, rtol=0, atol=1e-9)


@pytest.mark.long
def test_displacements_do_not_scale_with_the_box(tmp_path):
    """Diffusion in a fluctuating box. The positions themselves give far too much, as in fig. 1 of the paper."""
    x, boxes = walk()
    path = tmp_path / "walk.h5md"
    first = kd.System(x[0], box=boxes[0])
    s = first.state
    with Writer(path, first, method={"integrator": "baoab", "dt": DT}, every=1) as writer:
        for k, (positions, box) in enumerate(zip(x, boxes, strict=True)):
            writer.append(State(np.array([positions.T, s.phase[1]]), s.masses, s.ids, box, k * DT, k), {})
    with kd.open(path) as run:
        for source, tolerance in ((run, 4.0), (run[::2], 4.0)):
            found = mean_squared_displacement(source, lags=60).diffusion(10.0, 50.0)
            assert abs(found.value - D) < tolerance * found.error + 0.02 * D
        plain = mean_squared_displacement(run.positions, run.times, lags=60)
        right = mean_squared_displacement(run, lags=60)
        assert plain.values[1] > 2 * right.values[1]  # the swing of the box times the distance from the origin
        assert right.values[1] == pytest.approx(6 * D * DT + (SWING * EDGE) ** 2 * 2, rel=0.05)
        still = mean_squared_displacement(run, lags=20, remove_drift=True)
        assert still.values[10] == pytest.approx(right.values[10] * (1 - 1 / 60), rel=0.05)


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """A liquid whose box swings by two parts in a hundred, each axis by itself."""
    path, system = tmp_path_factory.mktemp("boxes") / "run.h5md", liquid()
    write(path, system, breathing(states(system, range(0, 800, 20))))
    return path, system


def test_structure_is_that_of_each_frame_in_its_box(file):
    path, _ = file
    with kd.open(path) as run:
        found = radial_distribution(run, r_max=1.9, bins=40)
        alone = [radial_distribution(frame.positions, frame.box, r_max=1.9, bins=40) for frame in run]
        np.testing.assert_allclose(found.g, np.mean([each.g for each in alone], axis=0), rtol=1e-12)
        neighbours = np.mean([each.coordination for each in alone], axis=0)
        np.testing.assert_allclose(found.coordination, neighbours, rtol=1e-12)
        again = radial_distribution(run.positions, run.boxes, r_max=1.9, bins=40)
        np.testing.assert_array_equal(again.g, found.g)
        fixed = radial_distribution(run.positions, run.box, r_max=1.9, bins=40)
        assert np.abs(fixed.g - found.g).max() > 0.01
        half = min(min(box.lengths) for box in run.boxes) / 2
        with pytest.raises(InputError, match=f"not in \\(0, {half:g}\\], half the least height"):
            radial_distribution(run, r_max=2.11)
        wanted = [[1, 0, 0], [0, 2, 0], [1, 1, 1]]
        s = structure_factor(run, vectors=wanted)
        each = [structure_factor(frame.positions, frame.box, vectors=wanted) for frame in run]
        np.testing.assert_allclose(s.s, np.mean([one.s for one in each], axis=0), rtol=1e-12)
        np.testing.assert_allclose(s.k, np.mean([one.k for one in each], axis=0), rtol=1e-12)
        assert len(structure_factor(run).k) > 3
        with pytest.raises(InputError, match="expected one Box, or 40, one for each frame"):
            radial_distribution(run.positions, run.boxes[:3])


def test_pressure_is_that_of_each_frame_in_its_box(file):
    path, system = file
    with kd.open(path) as run:
        found = pressure_tensor(run)
        wanted = [
            instantaneous_pressure(
                kd.System(frame.positions, frame.velocities, box=frame.box, forces=system.forces),
                frame.positions, frame.velocities,
            )
            for frame in run
        ]  # fmt: skip
    np.testing.assert_allclose(found.tensors, wanted, rtol=1e-12)


def test_figures_of_a_changing_box(file):
    pytest.importorskip("matplotlib")
    path, _ = file
    with kd.open(path) as run:
        for kind in ("rdf", "msd", "structure-factor"):
            assert run.plot(kind).axes
