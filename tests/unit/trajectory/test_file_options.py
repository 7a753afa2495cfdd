"""Options of a run's file: precision, compression, forces and images, the flush interval; and its readers."""

from __future__ import annotations

import signal

import h5py
import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.model.state import State
from kickdrift.model.units.unit_systems import UNIT_SYSTEMS
from kickdrift.trajectory.file import storage
from kickdrift.trajectory.layout.names import system_hash
from kickdrift.trajectory.read import reader
from kickdrift.trajectory.read.info import describe, info
from kickdrift.trajectory.write.h5md import Writer

KINDS = [
    kd.FileOptions(),
    kd.FileOptions(store="float32"),
    kd.FileOptions(compress=True),
    kd.FileOptions(write=("forces",)),
    kd.FileOptions(write=("images",)),
    kd.FileOptions(store="float32", compress=True, write=("images", "forces")),
]
FRAMES = 70


@pytest.fixture
def path(tmp_path):
    return tmp_path / "run.h5md"


def system(units="lj", box=(5.0, 6.0, 7.0), scale=1.0, n=40):
    rng = np.random.default_rng(3)
    edges = None if box is None else tuple(scale * np.array(box))
    return kd.System(rng.uniform(-20, 20, (n, 3)) * scale, rng.normal(size=(n, 3)), box=edges, units=units)


def state(start, step):
    s = start.state
    phase = s.phase.copy()
    phase[0] += phase[1] * step * 0.5 * abs(phase[0]).max() / 20
    return State(phase, s.masses, s.ids, s.box, step * 0.5, step)


def forces(start, step):
    return np.cos(state(start, step).positions)


def write(path, start, options, frames=range(FRAMES), run_id=None):
    if run_id is None:
        writer = Writer(path, start, method={}, every=1, options=options, flush_bytes=50_000)
    else:
        writer = Writer.append_to(path, run_id, options=options)
    with writer:
        for step in frames:
            given = forces(start, step) if "forces" in writer.writes else None
            writer.append(state(start, step), {"total_energy": step}, forces=given)
        writer.report = {"last": frames.stop}
    return writer.run_id


def check(path, start, options, frames):
    rounding = 0 if options.store == "float64" else 2**-24
    edge = 0 if start.box.lengths is None else max(start.box.lengths)
    wrapping = 2**-52 * abs(state(start, frames).positions).max() if "images" in options.write else 0
    with reader.open(path) as run:
        assert len(run) == frames
        assert run.options == options
        for step in (0, 1, frames // 2, frames - 1):
            truth = state(start, step)
            here = rounding * (edge if "images" in options.write else abs(truth.positions).max()) + wrapping
            np.testing.assert_allclose(run[step].positions, truth.positions, rtol=0, atol=here)
            np.testing.assert_allclose(run[step].velocities, truth.velocities, rtol=2 * rounding, atol=0)
            if "forces" in options.write:
                np.testing.assert_allclose(run[step].forces, forces(start, step), rtol=2 * rounding + 1e-15)
        np.testing.assert_array_equal(run.path_of(7), run.positions[:, 7])
        np.testing.assert_array_equal(run.observables["total_energy"], np.arange(frames))


@pytest.mark.parametrize("options", KINDS, ids=str)
def test_what_is_written_is_read_and_continued(path, options):
    start = system()
    run_id = write(path, start, options)
    check(path, start, options, FRAMES)
    write(path, start, options, range(FRAMES, FRAMES + 9), run_id)
    check(path, start, options, FRAMES + 9)
    with h5py.File(path) as file:
        group = file["particles/trajectory"]
        assert group["position/value"].dtype == options.dtype
        assert group["position/value"].compression == ("gzip" if options.compress else None)
        assert group["velocity/step"] == group["position/step"], "hard links must survive compression"
        assert ("image" in group, "force" in group) == ("images" in options.write, "forces" in options.write)
        assert system_hash(file) == file["kickdrift/system"].attrs["sha256"]
    assert [each.name for each in path.parent.iterdir()] == [path.name]
    assert ("compressed" in describe(info(path))) == options.compress


@pytest.mark.filterwarnings("ignore:there is no reference attributes:UserWarning")
@pytest.mark.parametrize("options", KINDS, ids=str)
def test_mdanalysis_opens_each_with_no_keyword(path, options):
    MDAnalysis = pytest.importorskip("MDAnalysis")
    start = system()
    write(path, start, options)
    universe = MDAnalysis.Universe(str(path))
    assert len(universe.trajectory) == FRAMES
    for frame in (universe.trajectory[k] for k in (0, 33, FRAMES - 1)):
        truth = state(start, frame.frame)
        expected = truth.wrapped() if "images" in options.write else truth.positions
        np.testing.assert_array_equal(frame.positions, expected.astype("f4"))
        np.testing.assert_array_equal(frame.velocities, truth.velocities.astype("f4"))
        assert frame.has_forces == ("forces" in options.write)
        if frame.has_forces:
            np.testing.assert_array_equal(frame.forces, forces(start, frame.frame).astype("f4"))
    universe.trajectory.close()


@pytest.mark.filterwarnings("ignore:there is no reference attributes:UserWarning")
@pytest.mark.parametrize(
    ("units", "factor", "scale"),
    [("metal", 96.48533212331, 1.0), ("real", 4.184, 1.0), ("gromacs", 0.1, 10.0), ("si", 6.02214076e10, 1e-10)],
)
def test_forces_in_real_units_are_those_that_mdanalysis_says(path, units, factor, scale):
    """1 eV/angstrom = 96.485 kJ/mol/angstrom; 1 N = 6.022e10 kJ/mol/angstrom: from e and N_A, exact since 2019."""
    MDAnalysis = pytest.importorskip("MDAnalysis")
    start = system(UNIT_SYSTEMS[units], scale=scale)
    write(path, start, kd.FileOptions(write=("forces",)))
    universe = MDAnalysis.Universe(str(path))
    expected = forces(start, 0) * factor
    # MDAnalysis' own constants are CODATA's of 2010.
    np.testing.assert_allclose(universe.trajectory[0].forces, expected, rtol=3e-7, atol=1e-7 * abs(expected).max())
    universe.trajectory.close()
    with reader.open(path) as run:
        np.testing.assert_allclose(run[0].forces, forces(start, 0), rtol=1e-15)


def test_positions_and_images_are_those_of_h5md(path):
    """With images, a position is inside the box, and position + image x edge is the particle's unwrapped position."""
    start = system()
    write(path, start, kd.FileOptions(write=("images",)))
    edges = np.array(start.box.lengths)
    with h5py.File(path) as file:
        group = file["particles/trajectory"]
        assert group["image/value"].dtype == np.int32
        for step in (0, FRAMES - 1):
            inside, images = group["position/value"][step], group["image/value"][step]
            assert ((inside >= 0) & (inside < edges)).all()
            np.testing.assert_allclose(inside + images * edges, state(start, step).positions, rtol=0, atol=1e-12)
            assert abs(images).max() > 2


def test_a_particle_just_below_zero_is_not_an_edge_away(path):
    start = kd.System([[-1e-18, 1.0, 5.0]], box=(5.0, 5.0, 5.0))
    with Writer(path, start, method={}, every=1, options=kd.FileOptions(write=("images",))) as writer:
        writer.append(start.state, {})
    with reader.open(path) as run:
        np.testing.assert_allclose(run[0].positions, [[0, 1, 5]], atol=1e-15)


def test_a_run_writes_what_it_is_asked_for(path):
    """Forces of a run are those at its frames; the trap in this run has a linear law."""
    start = kd.System([[0.5, 0, 0], [-0.5, 1, 0]], forces=[kd.HarmonicTrap(2.0)], masses=[1.0, 3.0])
    sim = kd.Simulation(start, dt=0.01)
    sim.run(20, every=5, output=path, file=kd.FileOptions(write=("forces",), flush=0.5))
    with pytest.raises(InputError, match="was begun with write=\\('forces',\\), which cannot change"):
        sim.run(20, output=path, file=kd.FileOptions())
    sim.run(20, output=path)
    with kd.open(path) as run:
        assert run.steps.tolist() == list(range(0, 41, 5))
        np.testing.assert_allclose(run.forces, -2.0 * run.positions, rtol=1e-14)


def test_the_hash_is_that_of_the_system(path):
    def found(start):
        Writer(path, start, method={}, every=1, overwrite=True).close()
        with h5py.File(path) as file:
            return file["kickdrift/system"].attrs["sha256"]

    one = found(system())
    assert one == found(system())
    assert one != found(system(box=(5.0, 6.0, 7.5)))
    assert one != found(kd.System(system().state.positions, box=(5.0, 6.0, 7.0)))


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("flush", 0, "flush: must be a positive number of seconds, got 0"),
        ("flush", "3", "flush: must be a positive number"),
        ("flush", float("nan"), "flush: must be a positive number"),
        ("store", "float16", "store: must be float64 or float32, got 'float16'"),
        ("compress", "gzip", "compress: must be True or False"),
        ("write", ("energies",), "write: must be among forces, images"),
        ("write", "forces", "write: must be among forces, images"),
    ],
)
def test_options_that_make_no_sense(key, value, message):
    with pytest.raises(InputError, match=message):
        kd.FileOptions(**{key: value})


def test_images_need_a_box_and_options_an_output(path):
    with pytest.raises(InputError, match="images need a periodic box"):
        Writer(path, system(box=None), method={}, every=1, options=kd.FileOptions(write=("images",)))
    assert not path.exists()
    sim = kd.Simulation(kd.System([[0.5, 0, 0]], forces=[kd.HarmonicTrap(2.0)]), dt=0.01)
    with pytest.raises(InputError, match="file: sets how output is written; give output as well"):
        sim.run(1, file=kd.FileOptions())


def test_frames_without_forces_say_so(path):
    write(path, system(), kd.FileOptions(), range(3))
    with reader.open(path) as run, pytest.raises(InputError, match="holds no forces"):
        run[0].forces


def test_what_waits_is_flushed_in_time_though_no_frame_follows(path):
    """In a run with looks far apart, data in memory are flushed during the run."""
    start = kd.System([[0.5, 0, 0]], forces=[kd.HarmonicTrap(2.0)])
    sim = kd.Simulation(start, dt=0.01)
    seen = []

    def look(done, of):
        with open(path, "rb") as raw:
            frames = h5py.File(raw)["kickdrift/committed"][0]
        seen.append(int(frames))

    sim.run(3_000_000, every=2_000_000, output=path, file=kd.FileOptions(flush=1e-9), progress=look)
    assert 1 in seen
    assert seen[-1] == 3 or seen[-1] == 2


def test_the_command_line_takes_the_options(path, kickdrift, monkeypatch):
    monkeypatch.chdir(path.parent)
    words = ("run", "kepler-e09", "--steps", 10, "--every", 5, "--quiet")
    given = ("--output", path, "--flush", 2, "--store", "float32", "--compress", "--write", "forces")
    code, _, err = kickdrift(*words, *given)
    assert code == 0, err
    with kd.open(path) as found:
        assert found.options == kd.FileOptions(store="float32", compress=True, write=("forces",))
        assert found.packed
        assert len(found) == 3
    for options, message in (
        (("--output", "no.h5md", "--flush", "-1"), "flush: must be a positive number of seconds, got -1.0"),
        (("--output", "no.h5md", "--store", "half"), "store: must be float64 or float32, got 'half'"),
        (("--output", "no.h5md", "--write", "forces,heat"), "write: must be among forces, images"),
        (("--store", "float32"), "--store: needs --output"),
    ):
        code, _, err = kickdrift(*words, *options)
        assert code == 2
        assert message in err
        assert err.count("\n") == 1


def test_an_interrupt_inside_a_flush_ends_the_run_cleanly(path, monkeypatch):
    commit, pressed = storage.PagedFile.commit, []

    def interrupted(self, **how):
        with h5py.File(path, "r", locking=False) as file:
            if not pressed and file["kickdrift/committed"][0] == 3:
                pressed.append(True)
                signal.raise_signal(signal.SIGINT)
        commit(self, **how)

    monkeypatch.setattr(storage.PagedFile, "commit", interrupted)
    sim = kd.Simulation(kd.System([[0.5, 0, 0]], forces=[kd.HarmonicTrap(2.0)]), dt=0.01)
    with pytest.raises(KeyboardInterrupt):
        sim.run(1000, every=1, output=path, file=kd.FileOptions(flush=1e-9))
    assert pressed
    with kd.open(path) as run:
        assert run.closed
        assert run.steps.tolist() == list(range(sim.steps_done + 1))
        assert len(run) < 20
