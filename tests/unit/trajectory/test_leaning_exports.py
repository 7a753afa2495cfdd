"""MDAnalysis and ASE read a run's box of any shape, from the run's file and from exports."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.trajectory.export.formats import FORMATS
from tests.run_files import ANGSTROM, N, write

MDAnalysis = pytest.importorskip("MDAnalysis")
ase_io = pytest.importorskip("ase.io")

pytestmark = [
    pytest.mark.filterwarnings(f"ignore:{text}")
    for text in ("Found no information for attr", "Supplied AtomGroup was missing", "Element information is missing",
                 "Unit cell dimensions not found", "DCDReader currently makes", "1 A\\^3 CRYST1",
                 "Reader has no dt information")
]  # fmt: skip
MATRIX = np.array([[15.0, 0.0, 0.0], [-4.0, 16.0, 0.0], [5.0, 7.5, 17.5]])
PLANE = (True, True, False)
WITH_BOX = [suffix for suffix, format in FORMATS.items() if format.package == "MDAnalysis" and format.box]
READ_BY_ASE = [suffix for suffix, format in FORMATS.items() if format.package == "ASE"]


def leaning(units="lj", periodic=True, matrix=MATRIX) -> kd.System:
    rng = np.random.default_rng(8)
    length = 1 / ANGSTROM.get(units, 1.0)
    x, v = rng.uniform(-40, 40, (2, N, 3)) * length
    return kd.System(x, v, box=kd.Box(matrix=matrix * length, periodic=periodic), units=units)


def vectors(dimensions) -> np.ndarray:
    return MDAnalysis.lib.mdamath.triclinic_vectors(dimensions)


@pytest.mark.parametrize("units", ["lj", "metal", "si"])
@pytest.mark.parametrize("images", [False, True])
def test_mdanalysis_reads_the_box_of_a_file(tmp_path, units, images):
    path = tmp_path / "run.h5md"
    written = write(path, leaning(units), write=("images",) if images else ())
    with kd.open(path) as run:
        ours = run.universe()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # MDAnalysis guesses types and masses, and warns if it cannot
        plain = MDAnalysis.Universe(str(path))
    scale = ANGSTROM.get(units, 1.0)
    for universe in (ours, plain):
        for ts, state in zip(universe.trajectory, written, strict=True):
            np.testing.assert_allclose(vectors(ts.dimensions), MATRIX, rtol=0, atol=1e-5)
            unwrapped = state.positions if universe is ours or not images else state.wrapped()
            np.testing.assert_allclose(ts.positions, unwrapped * scale, rtol=0, atol=2e-5)
        universe.trajectory.close()


def test_mdanalysis_sees_no_period_along_an_open_axis(tmp_path):
    path = tmp_path / "run.h5md"
    system = leaning(periodic=PLANE, matrix=np.diag([15.0, 16.0, 17.5]))
    write(path, system)
    with kd.open(path) as run:
        universe, state = run.universe(), run[0].state
    ts = universe.trajectory[0]
    np.testing.assert_array_equal(ts.dimensions, [15, 16, 0, 90, 90, 90])
    i, j = np.triu_indices(N, 1)
    ours = np.linalg.norm(state.box.minimum_image(state.positions[i] - state.positions[j]), axis=1)
    theirs = MDAnalysis.lib.distances.calc_bonds(ts.positions[i], ts.positions[j], box=ts.dimensions)
    np.testing.assert_allclose(theirs, ours, rtol=1e-5)
    universe.trajectory.close()


@pytest.mark.parametrize("unwrapped", [False, True])
@pytest.mark.parametrize("suffix", WITH_BOX)
def test_mdanalysis_reads_the_box_of_an_export(tmp_path, suffix, unwrapped):
    path = tmp_path / "run.h5md"
    written = write(path, leaning("metal"))
    kd.export(path, path.with_suffix(suffix), unwrapped=unwrapped)
    off = {".xtc": 1e-2, ".pdb": 5.1e-4}.get(suffix, 2e-5)
    with MDAnalysis.coordinates.core.reader(str(path.with_suffix(suffix)), n_atoms=N) as found:
        assert len(found) == len(written)
        for ts, state in zip(found, written, strict=True):
            np.testing.assert_allclose(vectors(ts.dimensions), MATRIX, rtol=0, atol=2e-3 if suffix == ".pdb" else 2e-5)
            x = state.positions if unwrapped else state.wrapped()
            np.testing.assert_allclose(ts.positions, x, rtol=0, atol=off)


@pytest.mark.parametrize("suffix", WITH_BOX)
def test_a_box_open_along_an_axis_is_left_out_and_that_is_said(tmp_path, suffix):
    path = tmp_path / "run.h5md"
    matrix = MATRIX.copy()
    matrix[2] = [0.0, 0.0, 17.5]
    write(path, leaning("metal", PLANE, matrix))
    done = kd.export(path, path.with_suffix(suffix))
    assert any(f"no box, since {suffix} has none like" in note and "along x and y" in note for note in done.notes)
    with MDAnalysis.coordinates.core.reader(str(path.with_suffix(suffix)), n_atoms=N) as found:
        assert all(ts.dimensions is None for ts in found)


@pytest.mark.parametrize("periodic", [True, PLANE])
@pytest.mark.parametrize("suffix", READ_BY_ASE)
def test_ase_reads_the_box_of_an_export(tmp_path, suffix, periodic):
    path = tmp_path / "run.h5md"
    matrix = MATRIX if periodic is True else np.diag(np.diag(MATRIX))
    written = write(path, leaning("metal", periodic, matrix))
    kd.export(path, path.with_suffix(suffix))
    found = ase_io.read(path.with_suffix(suffix), ":")
    assert len(found) == len(written)
    for atoms, state in zip(found, written, strict=True):
        np.testing.assert_allclose(atoms.cell[:], matrix, rtol=1e-14)
        assert tuple(atoms.pbc) == state.box.periodic_axes
        np.testing.assert_allclose(atoms.positions, state.wrapped(), rtol=0, atol=5.1e-9)
