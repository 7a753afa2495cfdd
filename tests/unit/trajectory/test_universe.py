"""MDAnalysis on a run's file: its content, and its results against our own."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.model.state import State
from kickdrift.model.system import System
from tests.run_files import ANGSTROM, EVERY, FRAMES, PS, REAL, UNITS, N, make_system, states, without, write

MDAnalysis = pytest.importorskip("MDAnalysis")


@pytest.fixture
def path(tmp_path) -> Path:
    return tmp_path / "run.h5md"


@pytest.mark.parametrize("units", UNITS)
def test_universe_has_all_that_the_file_knows(path, units):
    system = make_system(units)
    written = write(path, system)
    with kd.open(path) as run:
        universe = run.universe()
    trajectory, atoms = universe.trajectory, universe.atoms
    length, time = ANGSTROM.get(units, 1.0), PS.get(units, 1.0)
    assert (len(trajectory), len(atoms)) == (FRAMES, N)
    assert trajectory.dt == pytest.approx(0.1, rel=1e-12)
    assert trajectory.totaltime == pytest.approx(0.1 * (FRAMES - 1), rel=1e-12)
    for ts, state in zip(trajectory, written, strict=True):
        np.testing.assert_allclose(atoms.positions, state.positions * length, rtol=1e-7)
        np.testing.assert_allclose(atoms.velocities, state.velocities * length / time, rtol=1e-7)
        assert ts.time == pytest.approx(state.time * time, rel=1e-12)
        assert ts.data["step"] == state.steps_done
        if system.box.periodic:
            np.testing.assert_allclose(ts.dimensions, [15, 16, 17.5, 90, 90, 90], rtol=1e-7)
        else:
            assert ts.dimensions is None
    assert list(atoms.types) == [system.species[k] for k in system.species_index]
    assert list(atoms.names) == (list(system.names) or list(atoms.types))
    np.testing.assert_allclose(atoms.masses, (np.arange(N) % 3 + 1.0) * 20, rtol=1e-12)
    np.testing.assert_array_equal(atoms.ids, system.state.ids)
    assert hasattr(atoms, "elements") == (units in REAL)
    assert universe.select_atoms("type Kr or type Bb").n_atoms == N // 3
    trajectory.close()


@pytest.mark.parametrize("units", ["metal", "si"])
def test_positions_inside_the_box_are_unwrapped(path, units):
    """A run with images stores positions inside the box."""
    written = write(path, make_system(units), write=("images",), store="float32")
    with kd.open(path) as run:
        universe = run.universe()
    for _ in range(2):  # a second pass through the frames works too
        for ts, state in zip(universe.trajectory, written, strict=True):
            np.testing.assert_allclose(ts.positions, state.positions * ANGSTROM.get(units, 1.0), rtol=0, atol=4e-6)
    again = pickle.loads(pickle.dumps(universe))
    np.testing.assert_array_equal(again.trajectory[2].positions, universe.trajectory[2].positions)
    again.trajectory.close()
    universe.trajectory.close()


def test_one_frame_has_the_time_step_that_the_run_would_have_had(path):
    system = make_system("si")
    write(path, system, states(system)[:1])
    with kd.open(path) as run:
        universe = run.universe()
    assert universe.trajectory.dt == pytest.approx(EVERY * 0.005, rel=1e-12)
    universe.trajectory.close()


def test_uneven_frames_are_said_and_keep_their_times(path):
    system = make_system("lj")
    written = write(path, system, states(system, (0, 20, 40, 70)))
    with kd.open(path) as run, pytest.warns(UserWarning, match="not evenly spaced; dt is 0.116"):
        universe = run.universe()
    assert universe.trajectory.totaltime == pytest.approx(0.35)
    assert [ts.time for ts in universe.trajectory] == [state.time for state in written]
    universe.trajectory.close()


def test_an_end_off_the_grid_leaves_the_time_step(path):
    system = make_system("lj")
    write(path, system, states(system, (0, 20, 40, 45)))
    with kd.open(path) as run, pytest.warns(UserWarning, match="not evenly spaced; dt is 0.1 ps"):
        universe = run.universe()
    universe.trajectory.close()


def test_a_removed_body_is_nan_in_the_universe(path):
    system = make_system("nbody")
    first, last = states(system, (0, 20))
    write(path, system, [first, without(last, 4)], absorbed={4: -1})
    with kd.open(path) as run:
        universe = run.universe()
    universe.trajectory[1]
    there = np.isfinite(universe.atoms.positions).all(axis=1)
    assert np.flatnonzero(~there).tolist() == [4]
    assert list(universe.atoms[~there].names) == ["body 4"]
    np.testing.assert_allclose(universe.atoms[there].positions, without(last, 4).positions, rtol=1e-6)
    universe.trajectory.close()


def test_a_file_without_frames_is_refused(path):
    write(path, make_system("lj"), [])
    with kd.open(path) as run, pytest.raises(InputError, match=r"run\.h5md: holds no frame"):
        run.universe()
    with pytest.raises(InputError, match=r"run\.h5md: holds no frame"):
        kd.export(path, path.with_suffix(".xyz"))


def on_a_grid(system: System) -> list[State]:
    """Frames whose positions and box are exact in float32, so that differences are not rounding."""
    of = states(system, range(0, 200, 20))
    for state in of:
        state.phase[0] = np.round(state.phase[0] * 1024) / 1024
    return of


@pytest.mark.filterwarnings("ignore:Box padding:UserWarning")
def test_density_is_ours(path):
    density = pytest.importorskip("MDAnalysis.analysis.density")
    from MDAnalysis.transformations import wrap

    system = make_system("lj", n=300)
    written = write(path, system, on_a_grid(system))
    with kd.open(path) as run:
        universe = run.universe()
    universe.trajectory.add_transformations(wrap(universe.atoms))
    edges = np.array(system.box.lengths)
    box = {"gridcenter": edges / 2, "xdim": edges[0], "ydim": edges[1], "zdim": edges[2]}
    theirs = density.DensityAnalysis(universe.atoms, delta=0.5, **box).run().results.density
    x = np.concatenate([state.wrapped() for state in written])
    ours, _ = np.histogramdd(x, theirs.edges)
    assert ours.sum() == len(written) * 300
    np.testing.assert_allclose(theirs.grid, ours / len(written) / 0.5**3, rtol=1e-12)
    universe.trajectory.close()
