"""Files of runs whose box changes: written, killed, damaged, continued, read by other programs and exported."""

from __future__ import annotations

import shutil
import warnings

import h5py
import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.trajectory.export.formats import FORMATS
from kickdrift.trajectory.overview import overview
from kickdrift.trajectory.read.info import describe, described, info
from kickdrift.trajectory.write.h5md import Writer
from tests.oracle import h5md_reader
from tests.run_files import ANGSTROM, EVERY, METHOD, N, breathing, make_system, states, write

pytestmark = [
    pytest.mark.filterwarnings(f"ignore:{text}")
    for text in ("Found no information for attr", "Supplied AtomGroup was missing", "Element information is missing",
                 "Unit cell dimensions not found", "DCDReader currently makes", "1 A\\^3 CRYST1",
                 "Reader has no dt information")
]  # fmt: skip
LEANING = np.array([[15.0, 0.0, 0.0], [-4.0, 16.0, 0.0], [5.0, 7.0, 17.5]])
EDGES = "particles/trajectory/box/edges/value"


def leaning(units: str) -> kd.System:
    system = make_system(units)
    return system.remade(box=kd.Box(matrix=LEANING / ANGSTROM.get(units, 1.0)))


@pytest.fixture(params=["rectangular", "leaning"])
def shape(request):
    return make_system if request.param == "rectangular" else leaning


@pytest.mark.parametrize("images", [False, True])
@pytest.mark.parametrize("units", ["lj", "metal", "si"])
def test_every_frame_has_its_box(tmp_path, shape, units, images):
    """H5MD's time-dependent box shares the clock of the positions; positions and states come back."""
    path, system = tmp_path / "run.h5md", shape(units)
    written = write(path, system, breathing(states(system)), write=("images",) if images else ())
    with kd.open(path) as run:
        assert run.box == system.box
        assert run.box_varies
        size = ANGSTROM.get(units, 1.0)
        for frame, box, state in zip(run, run[:].boxes, written, strict=True):
            assert frame.box == box
            np.testing.assert_allclose(frame.box.matrix, state.box.matrix, rtol=1e-15)
            np.testing.assert_allclose(frame.positions, state.positions, rtol=1e-14, atol=1e-14 / size * 100)
            np.testing.assert_allclose(frame.wrapped(), state.wrapped(), rtol=1e-12, atol=1e-12 / size * 20)
            made = frame.system
            assert made.box == frame.box == frame.state.box
            (tmp_path / "frame.toml").write_text(made.at(made.state.phase, 0.0).to_toml())
            assert kd.load(tmp_path / "frame.toml").box == frame.box
        found = h5md_reader.read(path)
        np.testing.assert_allclose(found["positions"], run.positions, rtol=0, atol=1e-14 / size * 40)
        np.testing.assert_allclose(found["box"], [box.shape for box in run.boxes], rtol=1e-15)
    with h5py.File(path) as file:
        for key in ("step", "time"):
            one, other = (file[f"particles/trajectory/{name}/{key}"] for name in ("position", "box/edges"))
            assert h5py.h5o.get_info(one.id).addr == h5py.h5o.get_info(other.id).addr


def test_mdanalysis_reads_each_box_without_a_topology_or_keyword(tmp_path, shape):
    MDAnalysis = pytest.importorskip("MDAnalysis")
    path, system = tmp_path / "run.h5md", shape("metal")
    written = write(path, system, breathing(states(system)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # MDAnalysis guesses types and masses, and warns if it cannot
        universe = MDAnalysis.Universe(str(path))
    lengths = set()
    for ts, state in zip(universe.trajectory, written, strict=True):
        matrix = MDAnalysis.lib.mdamath.triclinic_vectors(ts.dimensions)
        np.testing.assert_allclose(matrix, state.box.matrix, rtol=0, atol=2e-5)
        lengths.add(float(ts.dimensions[0]))
    assert len(lengths) == len(written)
    universe.trajectory.close()


@pytest.mark.parametrize("unwrapped", [False, True])
@pytest.mark.parametrize("suffix", [name for name, format in FORMATS.items() if format.box and not format.single])
def test_every_export_has_each_box(tmp_path, shape, suffix, unwrapped):
    path, system = tmp_path / "run.h5md", shape("metal")
    written = write(path, system, breathing(states(system)))
    found = kd.export(path, path.with_suffix(suffix), unwrapped=unwrapped)
    assert ("scale with the box" in " ".join(found.notes)) == unwrapped
    positions = [state.positions if unwrapped else state.wrapped() for state in written]
    if FORMATS[suffix].package == "ASE":
        ase_io = pytest.importorskip("ase.io")
        frames = ase_io.read(found.path, ":")
        read = [(np.asarray(each.cell), each.positions) for each in frames]
        close = 2e-8
    else:
        MDAnalysis = pytest.importorskip("MDAnalysis")
        with MDAnalysis.coordinates.core.reader(str(found.path), n_atoms=N) as frames:
            vectors = MDAnalysis.lib.mdamath.triclinic_vectors
            read = [(vectors(ts.dimensions), ts.positions.astype(float)) for ts in frames]
        close = {".xtc": 1e-2, ".pdb": 2e-3}.get(suffix, 2e-5)
    assert len(read) == len(written)
    for (matrix, x), state, wanted in zip(read, written, positions, strict=True):
        np.testing.assert_allclose(matrix, state.box.matrix, rtol=0, atol=max(close, 2e-5 if close > 1e-7 else 0))
        np.testing.assert_allclose(x, wanted, rtol=0, atol=close)


def test_a_box_that_is_changed_on_the_disk_is_damage(tmp_path):
    path, system = tmp_path / "run.h5md", make_system("lj")
    write(path, system, breathing(states(system)))
    with h5py.File(path, "r+") as file:
        file[EDGES][2, 1] *= 1 + 1e-12
    with kd.open(path) as run:
        assert run.damage().frames == [2]
        with pytest.raises(InputError, match="frame 2"):
            _ = run[2].box
        assert run[1].box.lengths != run[0].box.lengths


def test_a_file_is_continued_in_another_box(tmp_path):
    path, system = tmp_path / "run.h5md", make_system("lj")
    all_states = breathing(states(system))
    write(path, system, all_states[:2])
    with kd.open(path) as run:
        run_id = run.run_id
    with Writer.append_to(path, run_id) as writer:
        for state in all_states[2:]:
            writer.append(state, {})
    with kd.open(path) as run:
        assert [box.lengths for box in run.boxes] == [state.box.lengths for state in all_states]
    last = leaning("lj").state
    with Writer.append_to(path, run_id) as writer, pytest.raises(InputError, match="its frames have a box like"):
        writer.append(kd.State(last.phase, last.masses, last.ids, last.box, 9.0, 900), {})


def test_a_copy_of_a_file_that_is_being_written_has_its_boxes(tmp_path):
    """A reader finds the frames and boxes that are whole, while the writer goes on."""
    path, system = tmp_path / "run.h5md", make_system("lj")
    all_states = breathing(states(system))
    with Writer(path, system, method=METHOD, every=EVERY) as writer:
        for count, state in enumerate(all_states, 1):
            writer.append(state, {})
            writer.flush()
            shutil.copy(path, tmp_path / "copy.h5md")
            with kd.open(tmp_path / "copy.h5md") as run:
                assert [box.lengths for box in run.boxes] == [each.box.lengths for each in all_states[:count]]


def test_a_compressed_file_keeps_its_boxes(tmp_path):
    path, system = tmp_path / "run.h5md", make_system("lj")
    written = write(path, system, breathing(states(system)), compress=True)
    with kd.open(path) as run:
        assert [box.lengths for box in run.boxes] == [state.box.lengths for state in written]
        table = run.to_xarray()
        np.testing.assert_array_equal(table["box"], [state.box.matrix for state in written])


def test_a_fixed_box_is_one_object(tmp_path):
    path, system = tmp_path / "run.h5md", make_system("lj")
    write(path, system)
    with kd.open(path) as run:
        assert not run.box_varies
        assert all(box is run.box for box in run.boxes)
        assert "box" not in run.to_xarray()


def test_info_says_the_mean_volume_and_density(tmp_path):
    path, system = tmp_path / "run.h5md", make_system("lj")
    written = write(path, system, breathing(states(system, range(0, 40 * EVERY, EVERY))))
    volumes = np.array([state.box.volume for state in written])
    found = info(path)
    assert found["volume"]["mean"] == pytest.approx(volumes.mean(), rel=1e-14)
    assert found["density"]["mean"] == pytest.approx((N / volumes).mean(), rel=1e-14)
    assert 0 < found["volume"]["error"] < volumes.std()
    text = describe(found)
    assert "at the start" in text
    assert "density" in text
    with h5py.File(path, "r+") as file:
        file[EDGES][39, 1] *= 2
    assert info(path)["volume"]["mean"] == pytest.approx(volumes[:-1].mean(), rel=1e-14)
    lines = dict(overview(path))
    assert lines["volume"] == dict(described(info(path)))["volume"]
    assert "density" in lines
    write(path, system)
    assert "volume" not in info(path)
    assert "volume" not in dict(overview(path))
