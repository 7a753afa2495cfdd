"""Frames of a run as values: sequences that read on demand, tables, and Systems for new runs."""

from __future__ import annotations

import sys
import weakref
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import kickdrift as kd
from kickdrift.model.run_defaults import RunDefaults
from kickdrift.model.state import State
from kickdrift.trajectory.write.h5md import Writer

N, FRAMES, EVERY, DT = 7, 12, 4, 0.25  # a sample every two steps, a frame every four
METHOD = {"integrator": "velocity-verlet", "dt": DT, "threads": 1, "seed": None}


def state_at(system: kd.System, step: int) -> State:
    phase = system.state.phase.copy()
    phase[0] += step * DT * phase[1]
    return State(phase, system.state.masses, system.state.ids, system.box, step * DT, step)


def seen_at(step: int) -> dict:
    kinetic, potential = 1.0 + step / 8, -3.0 + step / 16
    return {
        "kinetic_energy": kinetic,
        "potential_energy": potential,
        "total_energy": kinetic + potential,
        "momentum": [step, 0.5, -step],
    }


def write(path: Path, system: kd.System) -> kd.System:
    with Writer(path, system, method=METHOD, every=2) as writer:
        for step in range(0, FRAMES * EVERY, 2):
            writer.append(state_at(system, step), seen_at(step), frame=step % EVERY == 0)
    return system


def make_system(units: str = "lj") -> kd.System:
    rng = np.random.default_rng(5)
    x, v = np.arange(3 * N).reshape(N, 3) * 1.25, rng.normal(size=(N, 3))
    return kd.System(
        x, v, np.arange(1.0, N + 1), (60.0, 70.0, 80.0), [kd.LennardJones(cutoff=3.0, truncation="force-shift")], units,
        ["A", "B", "A", "B", "A", "B", "A"], name="seven", names=[f"n{k}" for k in range(N)], radii=np.arange(N) / 8,
        run=RunDefaults(integrator="velocity-verlet", dt=DT),
    )  # fmt: skip


@pytest.fixture(scope="module")
def file(tmp_path_factory) -> tuple[Path, kd.System]:
    path = tmp_path_factory.mktemp("runs") / "run.h5md"
    return path, write(path, make_system())


@pytest.fixture
def run(file):
    with kd.open(file[0]) as opened:
        yield opened


def test_a_run_is_the_sequence_of_its_frames(run, file):
    assert len(run) == FRAMES
    assert [frame.step for frame in run] == list(range(0, FRAMES * EVERY, EVERY))
    assert run[-1] == run[FRAMES - 1] != run[0]
    assert run[3] in run
    assert run.index(run[3]) == 3
    assert len({run[3], run[3], run[4]}) == 2
    for index in (FRAMES, -FRAMES - 1):
        with pytest.raises(IndexError, match=f"frame {index} of {FRAMES}"):
            run[index]
    for k, frame in enumerate(run):
        state = state_at(file[1], k * EVERY)
        np.testing.assert_array_equal(frame.positions, state.positions)
        np.testing.assert_array_equal(frame.velocities, state.velocities)
        assert frame.time == state.time


def test_a_run_has_arrays_over_its_frames(run, file):
    states = [state_at(file[1], k * EVERY) for k in range(FRAMES)]
    np.testing.assert_array_equal(run.positions, [state.positions for state in states])
    np.testing.assert_array_equal(run.velocities, [state.velocities for state in states])
    np.testing.assert_array_equal(run.time, [state.time for state in states])
    np.testing.assert_array_equal(run.time, run.times)
    np.testing.assert_array_equal(run.steps, [state.steps_done for state in states])
    np.testing.assert_array_equal(run.path_of(4), run.positions[:, 4])
    for particle in (-1, N):
        with pytest.raises(kd.InputError, match=f"particle {particle}: expected a number from 0 to 6"):
            run.path_of(particle)


places = st.none() | st.integers(-FRAMES - 3, FRAMES + 3)


@given(first=st.tuples(places, places, places), second=st.tuples(places, places, places))
def test_slices_are_those_of_a_list(file, first, second):
    """A slice, and a slice of that slice, in every direction, against NumPy's own."""
    with kd.open(file[0]) as run:
        cuts = [slice(start, stop, step or None) for start, stop, step in (first, second)]
        part, steps = run[cuts[0]][cuts[1]], run.steps[cuts[0]][cuts[1]]
        assert [frame.step for frame in part] == steps.tolist()
        np.testing.assert_array_equal(part.steps, steps)
        np.testing.assert_array_equal(part.times, run.times[cuts[0]][cuts[1]])
        np.testing.assert_array_equal(part.positions, run.positions[cuts[0]][cuts[1]])
        np.testing.assert_array_equal(part.path_of(2), run.positions[:, 2][cuts[0]][cuts[1]])
        np.testing.assert_array_equal(part.energies.kinetic, [seen_at(step)["kinetic_energy"] for step in steps])
        np.testing.assert_array_equal(part.observables["momentum"].shape, (len(part), 3))


def test_energies_are_at_samples_in_a_run_and_at_frames_in_a_slice(run):
    assert len(run.energies.time) == 2 * FRAMES
    np.testing.assert_array_equal(run.energies.time, run.sample_times)
    part = run[2:5]
    np.testing.assert_array_equal(part.energies.time, part.times)
    for frame, total in zip(part, part.energies.total, strict=True):
        wanted = seen_at(frame.step)
        assert frame.energies == (wanted["kinetic_energy"], wanted["potential_energy"], wanted["total_energy"])
        assert frame.energies.total == total


def test_nothing_is_read_before_it_is_asked_for(file, monkeypatch):
    with kd.open(file[0]) as run:
        read = []
        whole = h5py.Dataset.__getitem__

        def noted(data, key):
            if not data.name.startswith("/kickdrift/checksums"):  # a few numbers for each frame
                read.append(key)
            return whole(data, key)

        monkeypatch.setattr(h5py.Dataset, "__getitem__", noted)
        part = run[1:9:2]
        part[1:][0].time
        assert not read
        run.refuse_changed()  # reads the parts that are written once
        read.clear()
        part[-1].positions
        assert read == [(slice(7, 8, 1), slice(0, 7))]
        part.path_of(3)
        assert read[1:] == [(slice(1, 8, 2), slice(0, 7))], "one checksum covers a block of particles, here all 7"


def test_a_closed_run_says_so(file):
    with kd.open(file[0]) as run:
        frame, part = run[2], run[::3]
    for read in (
        lambda: frame.positions, lambda: frame.energies, lambda: frame.system, lambda: part.velocities,
        lambda: part.observables, lambda: run.positions, lambda: run.energies, lambda: run.events,
        lambda: run.path_of(0), lambda: run.to_pandas(), lambda: run.to_xarray(), lambda: run.system(),
    ):  # fmt: skip
        with pytest.raises(kd.InputError, match=r"run\.h5md: is closed; read it inside of its with block"):
            read()
    assert len(run) == FRAMES
    assert part[1].time == 3 * EVERY * DT


def test_a_file_without_energies_says_so(tmp_path):
    path, system = tmp_path / "run.h5md", make_system()
    with Writer(path, system, method=METHOD, every=1) as writer:
        writer.append(system.state)
    with kd.open(path) as run:
        for read in (lambda: run.energies, lambda: run[:].energies, lambda: run[0].energies):
            with pytest.raises(kd.InputError, match="holds no kinetic_energy"):
                read()


def test_pandas_has_a_row_for_each_sample(run):
    pandas = pytest.importorskip("pandas")
    table = run.to_pandas()
    assert isinstance(table, pandas.DataFrame)
    assert len(table) == 2 * FRAMES
    np.testing.assert_array_equal(table["step"], np.arange(0, FRAMES * EVERY, 2))
    np.testing.assert_array_equal(table["time"], run.sample_times)
    np.testing.assert_array_equal(table[["momentum_x", "momentum_y", "momentum_z"]], run.observables["momentum"])
    np.testing.assert_array_equal(table["total_energy"], run.energies.total)
    assert table.attrs["units"]["momentum_y"] == "m sigma/tau"
    assert table.attrs["units"]["time"] == "tau"
    assert run[::-3].to_pandas()["step"].tolist() == run[::-3].steps.tolist()
    assert list(run[:0].to_pandas()) == list(table)


def test_xarray_has_frames_and_samples(run, file):
    xarray = pytest.importorskip("xarray")
    data = run.to_xarray()
    assert isinstance(data, xarray.Dataset)
    assert dict(data.sizes) == {"frame": FRAMES, "particle": N, "axis": 3, "sample": 2 * FRAMES}
    np.testing.assert_array_equal(data.positions, run.positions)
    np.testing.assert_array_equal(data.velocities.sel(particle=3, axis="y"), run.velocities[:, 3, 1])
    np.testing.assert_array_equal(data.momentum.sel(axis="x"), run.sample_steps)
    np.testing.assert_array_equal(data.time, run.times)
    np.testing.assert_array_equal(data.sample_time, run.sample_times)
    assert data.positions.attrs["units"] == "sigma"
    assert data.kinetic_energy.attrs["units"] == "epsilon"
    assert data.species.values.tolist() == ["A", "B", "A", "B", "A", "B", "A"]
    assert data.names.values.tolist() == list(file[1].names)
    assert data.attrs["integrator"] == "velocity-verlet"
    part = run[3:6].to_xarray()
    assert part.kinetic_energy.dims == ("frame",)
    assert part.step.values.tolist() == [12, 16, 20]


@pytest.mark.parametrize(("call", "package"), [("to_pandas", "pandas"), ("to_xarray", "xarray")])
def test_what_is_not_installed_is_named(run, monkeypatch, call, package):
    monkeypatch.setitem(sys.modules, package, None)
    for frames in (run, run[2:]):
        with pytest.raises(kd.InputError, match=rf"{call}\(\) needs {package}: pip install 'kickdrift\[tables\]'"):
            getattr(frames, call)()


def orbits() -> kd.System:
    return kd.System(
        [[0, 0, 0], [1, 0, 0], [0, 3, 0]], [[0, 0, 0], [0, 6.3, 0], [3.6, 0, 0]], [1.0, 1e-3, 0.0], units="astro",
        forces=[kd.Gravity(), kd.Oblateness(1e-3, 0.1, central="Sun")], names=["Sun", "b", "dust"],
        radii=[0.005, 0.0, 0.0],
        events=[kd.Escape(1e3), kd.Collision(action="bounce"), kd.Crossing.ascending_node("b", "Sun")],
    )  # fmt: skip


@pytest.mark.parametrize("make", [make_system, orbits])
def test_any_frame_starts_a_new_run(tmp_path, make):
    given = write(tmp_path / "run.h5md", make())
    with kd.open(tmp_path / "run.h5md") as run:
        frame = run[5]
        system = frame.system
        np.testing.assert_array_equal(run[:6][-1].system.state.phase, system.state.phase)
        np.testing.assert_array_equal(run.system().state.phase, given.state.phase)
        assert run.system().state.time == 0.0
    assert (system.forces, system.events) == (given.forces, given.events)
    assert (system.units, system.box, system.names, system.run) == (given.units, given.box, given.names, given.run)
    assert [system.species[k] for k in system.species_index] == [given.species[k] for k in given.species_index]
    np.testing.assert_array_equal(system.radii, given.radii)
    np.testing.assert_array_equal(system.state.masses, given.state.masses)
    np.testing.assert_array_equal(system.state.phase, state_at(given, 5 * EVERY).phase)
    assert (system.state.time, system.state.steps_done) == (frame.time, 0)


def test_a_frames_state_is_taken_by_a_simulation(tmp_path):
    """A run that continues from the state equals the first run."""
    system = kd.System(
        [[0.0, 0, 0], [1.0, 0, 0]], [[0, -1e-3, 0], [0, 1.0, 0]], [1.0, 1e-3], forces=[kd.Gravity()], units="nbody"
    )
    first = kd.Simulation(system, "leapfrog", dt=0.01)
    first.run(40, output=tmp_path / "run.h5md", every=10)
    with kd.open(tmp_path / "run.h5md") as run:
        second, third = kd.Simulation(system, "leapfrog", dt=0.01), kd.Simulation(run[2].system, "leapfrog", dt=0.01)
        second.state = run[2].state
        assert second.steps_done == 20
    for sim in (second, third):
        sim.run(20)
        np.testing.assert_array_equal(sim.state.phase, first.state.phase)
    assert third.time == pytest.approx(first.time, rel=1e-15)


def test_a_run_that_nobody_has_any_more_is_gone_and_so_closed(file):
    """The run closes at once, without the garbage collector: the run and its slices form no reference cycle."""
    run = kd.open(file[0])
    alive, part = weakref.ref(run), run[2:]
    del run
    part[0].positions
    del part
    assert alive() is None


# -- frames as particles of a system file
FORCE = 'cutoff = 3.0\ntruncation = "force-shift"\n'


def beside(path: Path, particles: str = "", more: str = "", units: str = "lj") -> kd.System:
    """System of a file whose particles are a frame of the run at ``path``."""
    text = f'units = "{units}"\n{more}\n[[force]]\ntype = "lennard-jones"\n{FORCE}[particles]\nfile = "{path.name}"\n'
    (path.parent / "next.toml").write_text(text + particles)
    return kd.load(path.parent / "next.toml")


def test_a_system_file_takes_a_frame(tmp_path):
    path, made = tmp_path / "run.h5md", make_system()
    topology, charges = kd.Topology(bonds=[[0, 1], [1, 2]], exclusions=[[0, 2]]), np.arange(N) - 3.0
    write(path, made.remade(topology=topology, charges=charges))
    for frame, said in ((-1, ""), (-1, "frame = -1"), (2, "frame = 2"), (0, "frame = -12")):
        found = beside(path, said)
        with kd.open(path) as run:
            np.testing.assert_array_equal(found.state.positions, run[frame].positions)
            np.testing.assert_array_equal(found.state.velocities, run[frame].velocities)
        assert (found.box, found.names, found.state.time) == (made.box, made.names, 0.0)
        np.testing.assert_array_equal(found.species_index, made.species_index)
        for one, other in (
            (found.charges, charges),
            (found.radii, made.radii),
            (found.state.masses, made.state.masses),
        ):
            np.testing.assert_array_equal(one, other)
        assert found.topology.tables() == topology.tables()
        assert len(found.forces) == 1
    assert beside(path, "frame = 2").seed != beside(path, "frame = 3").seed  # noise does not repeat
    other = beside(path, "charge = 0.5", "[box]\nlengths = [90, 90, 90]\n[topology]\nbonds = [[3, 4]]")
    assert (other.box, set(other.charges)) == (kd.Box((90.0, 90.0, 90.0)), {0.5})
    assert other.topology.tables()["bonds"] == [[3, 4]]
    drawn = beside(path, "", "[velocities]\ntemperature = 1.0\nseed = 4")
    assert drawn.seed == 4
    assert (drawn.state.velocities != found.state.velocities).any()


@pytest.mark.parametrize(
    ("name", "particles", "more", "units", "told"),
    [
        ("run.h5md", "frame = 12", "", "lj", "particles.file: {} has no frame 12; it holds 12"),
        ("run.h5md", "frame = -13", "", "lj", "particles.file: {} has no frame -13; it holds 12"),
        ("run.h5md", "frame = 0.5", "", "lj", "particles.frame: expected a whole number, got 0.5"),
        ("run.h5md", "", "", "metal", 'units: the run of {} is in units = "lj", got "metal"'),
        ("run.h5md", "", "dimensions = 2", "lj", "dimensions: the run of {} has 3 dimensions; expected dimensions = 3"),
        ("run.h5md", 'atom_style = "full"', "", "lj", "particles.atom_style: is for data files of LAMMPS, and {} is"),
        ("none.h5md", "", "", "lj", "particles.file: {} no such file"),
        ("ode.h5", "", "", "lj", "particles.file: {} has no frames of particles; a run of particles ends in .h5md"),
        ("ode.h5md", "", "", "lj", "particles.file: {} is the file of a Problem's run"),
        ("start.xyz", "frame = 0", "", "lj", "particles.frame: is for the file of a run (.h5md), and {} is none"),
    ],
)
def test_a_frame_that_no_system_file_takes(name, particles, more, units, told, tmp_path):
    write(tmp_path / "run.h5md", make_system())
    kd.Simulation(kd.load({"ode": {"problem": "kepler"}}), "rk4", dt=0.1).run(2, output=tmp_path / "ode.h5")
    (tmp_path / "ode.h5md").write_bytes((tmp_path / "ode.h5").read_bytes())
    with pytest.raises(kd.InputError) as refused:
        beside(tmp_path / name, particles, more, units)
    text = str(refused.value).replace(f"{tmp_path / name}:", "{}").replace(str(tmp_path / name), "{}")
    assert told in text
    assert "\n" not in text


def test_a_frame_of_a_file_that_a_run_writes(tmp_path):
    system = make_system()
    with Writer(tmp_path / "run.h5md", system, method=METHOD, every=2) as writer:
        writer.append(state_at(system, 0), seen_at(0), frame=True)
        with pytest.raises(kd.InputError, match=r"particles\.file: .*a run is writing to it at this moment"):
            beside(tmp_path / "run.h5md")


def test_an_exported_frame_comes_back_in_reduced_units(tmp_path):
    made = write(tmp_path / "run.h5md", make_system())
    kd.export(tmp_path / "run.h5md", tmp_path / "last.extxyz", start=-1, unwrapped=True)
    for found in (beside(tmp_path / "last.extxyz"), kd.load(tmp_path / "last.extxyz")):
        assert (found.units, found.box, found.species) == (made.units, made.box, made.species)
        end = state_at(made, (FRAMES - 1) * EVERY)
        np.testing.assert_allclose(found.state.positions, end.positions, atol=6e-9)
        np.testing.assert_allclose(found.state.velocities, end.velocities, atol=6e-9)
        np.testing.assert_array_equal(found.state.masses, made.state.masses)
    with pytest.raises(kd.InputError, match='expected units = "metal", "real" or "gromacs", got "nbody"'):
        beside(tmp_path / "last.extxyz", units="nbody")
