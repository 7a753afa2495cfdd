"""Run files of leaning boxes, and of boxes that are open along an axis."""

from __future__ import annotations

import ase.io
import h5py
import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.model.state import State
from kickdrift.trajectory.read.info import describe, info
from kickdrift.trajectory.write.h5md import Writer
from tests import run_files

LEANING = kd.Box(matrix=[[10.0, 0.0, 0.0], [4.0, 9.0, 0.0], [-3.0, 2.0, 8.0]])
PLANE = (True, True, False)
BOXES = {
    "leaning": LEANING,
    "leaning in a plane": kd.Box(matrix=[[10.0, 0.0, 0.0], [4.0, 9.0, 0.0], [0.0, 0.0, 7.0]], periodic=PLANE),
    "a slab": kd.Box((10.0, 9.0, 7.0), periodic=PLANE),
    "a tube": kd.Box((0.0, 0.0, 7.0), periodic=(False, False, True)),
    "a plane": kd.Box((10.0, 9.0)),
}  # fmt: skip
IMAGES = kd.FileOptions(write=("images",))


def falling(box, n=12, spread=30.0) -> kd.System:
    rng = np.random.default_rng(5)
    x = rng.uniform(-spread, spread, (n, 3))
    return kd.System(x, rng.normal(size=(n, 3)), box=box, forces=[kd.UniformField((0.1, -0.2, 0.3))])


def matrix_of(box) -> np.ndarray:
    return np.where(np.array(box.periodic_axes)[:, None], box.matrix, 0.0)


@pytest.mark.parametrize("box", BOXES.values(), ids=BOXES)
@pytest.mark.parametrize("options", [None, IMAGES], ids=["plain", "images"])
def test_a_run_gives_its_box_and_positions_back(tmp_path, box, options):
    sim = kd.Simulation(falling(box), "velocity-verlet", 0.05)
    seen = []
    path = tmp_path / "run.h5md"
    sim.run(40, every=10, output=path, file=options, observe=lambda sim: seen.append(sim.state.positions.copy()))
    with kd.open(path) as run:
        assert run.box == run[2].box == run[2].state.box == run.system().box == box
        np.testing.assert_allclose(run.positions, seen, rtol=0, atol=0 if options is None else 1e-13)
        np.testing.assert_array_equal(run[3].wrapped(), box.wrap(run[3].positions))
        assert run.exact == (options is None)
        assert not run.damage()


@pytest.mark.parametrize("box", BOXES.values(), ids=BOXES)
def test_plain_h5py_finds_edges_boundaries_and_images(tmp_path, box):
    path = tmp_path / "run.h5md"
    states = run_files.write(path, falling(box), write=("images",))
    matrix = matrix_of(box)
    with h5py.File(path) as file:
        group = file["particles/trajectory"]
        edges = group["box/edges/value"][:]
        assert edges.shape == (5, 3, 3) if box.triclinic else (5, 3)
        assert all(np.array_equal(each, matrix if box.triclinic else np.diag(matrix)) for each in edges)
        assert [each == b"periodic" for each in group["box"].attrs["boundary"]] == list(box.periodic_axes)
        inside, images = group["position/value"][:], group["image/value"][:]
    for k, state in enumerate(states):
        np.testing.assert_array_equal(inside[k], box.wrap(state.positions))
        np.testing.assert_allclose(inside[k] + images[k] @ matrix, state.positions, rtol=0, atol=1e-13)
    assert np.abs(images[:, :, np.array(box.periodic_axes)]).max() > 1
    assert not images[:, :, ~np.array(box.periodic_axes)].any()


def test_a_file_at_right_angles_is_as_it_was(tmp_path):
    path = tmp_path / "run.h5md"
    run_files.write(path, falling(kd.Box((10.0, 9.0, 8.0))))
    with h5py.File(path) as file:
        assert file["particles/trajectory/box/edges/value"].shape == (5, 3)
        assert b'"box": [10.0, 9.0, 8.0]' in file["kickdrift/system/record"][()]


@pytest.mark.parametrize("options", [None, IMAGES], ids=["plain", "images"])
def test_a_leaning_run_is_resumed_to_the_same_bits(tmp_path, options):
    whole, half = tmp_path / "whole.h5md", tmp_path / "half.h5md"
    system = falling(LEANING)
    kd.Simulation(system, "velocity-verlet", 0.05).run(40, every=10, output=whole, file=options)
    kd.Simulation(system, "velocity-verlet", 0.05).run(20, every=10, output=half, file=options)
    sim = kd.resume(half)
    assert sim.system.box == LEANING
    sim.run(20, every=10)
    with kd.open(whole) as one, kd.open(half) as other:
        assert one.positions.tobytes() == other.positions.tobytes()
        assert one.velocities.tobytes() == other.velocities.tobytes()


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("leaning", "[[10, 0, 0], [4, 9, 0], [-3, 2, 8]] σ, periodic"),
        ("a slab", "10 × 9 × 7 σ, periodic along x and y"),
        ("a plane", "10 × 9 σ, periodic along x and y"),
    ],
)
def test_info_shows_the_box(tmp_path, name, text):
    path = tmp_path / "run.h5md"
    run_files.write(path, falling(BOXES[name]))
    found = info(path)
    assert f"  {text}\n" in describe(found)
    assert kd.Box(found["box"], periodic=found["periodic"]) == BOXES[name]


def test_a_box_that_the_edges_cannot_hold_is_refused(tmp_path):
    system = falling(kd.Box((10.0, 9.0, 8.0)))
    s = system.state
    refused = pytest.raises(InputError, match=r"a box like 10 x 9 x 8 σ, but this state's is \[\[10, 0, 0\]")
    with Writer(tmp_path / "run.h5md", system, method={"dt": 1.0}, every=1) as writer, refused:
        writer.append(State(s.phase, s.masses, s.ids, LEANING, 0.0, 0), {})


@pytest.mark.parametrize(
    ("box", "message"),
    [
        (
            '{"matrix": [[10.0, 0.0, 0.0], [4.0, 9.0, 0.0], [-30.0, 2.0, 8.0]], "periodic": [true, true, true]}',
            "too far",
        ),
        ('{"matrix": [[10.0, 0.0], [4.0, 9.0]], "periodic": [true, true, true]}', "record: box"),
        ('{"matrix": [[10.0, 0.0, 0.0], [4.0, 9.0, 0.0], [-3.0, 2.0, 8.0]], "periodic": [1, 1, 1]}', "record: box"),
        ("[10.0, 9.0, 8.0]", "changed"),
        ("null", "sha256|changed|periodic"),
    ],
)
def test_a_record_that_makes_no_sense_is_refused(tmp_path, kickdrift, box, message):
    path = tmp_path / "run.h5md"
    run_files.write(path, falling(LEANING))
    with h5py.File(path, "r+") as file:
        record = file["kickdrift/system/record"].asstr()[()]
        begin = record.index('"box": ') + len('"box": ')
        end = record.index(', "species"')
        del file["kickdrift/system/record"]
        file["kickdrift/system"].create_dataset(
            "record", data=record[:begin] + box + record[end:], dtype=h5py.string_dtype()
        )
    status, _, err = kickdrift("export", path, tmp_path / "run.extxyz")
    assert status == 2
    assert err.count("\n") == 1
    assert path.name in err
    assert any(word in err for word in message.split("|"))


def test_a_run_in_two_dimensions_is_kept_and_resumed(tmp_path):
    x = np.random.default_rng(6).uniform(-20, 20, (30, 2))
    box = kd.Box(matrix=[[10.0, 0.0], [4.0, 9.0]])
    system = kd.System(x, -x, box=box, forces=[kd.UniformField((0.1, -0.2, 0.0))], dimensions=2)
    whole, half = tmp_path / "whole.h5md", tmp_path / "half.h5md"
    kd.Simulation(system, "velocity-verlet", 0.05).run(40, every=10, output=whole)
    kd.Simulation(system, "velocity-verlet", 0.05).run(20, every=10, output=half)
    sim = kd.resume(half)
    assert sim.system.dimensions == 2
    sim.run(20, every=10)
    with kd.open(whole) as one, kd.open(half) as other:
        assert one.positions.tobytes() == other.positions.tobytes()
        assert one.box == one[1].box == box
        assert one.system().dimensions == one[2].system.dimensions == 2
    kd.export(whole, tmp_path / "run.extxyz", unwrapped=True)
    last = ase.io.read(tmp_path / "run.extxyz", index=-1)
    back = kd.System.from_ase(last, [], "lj")
    assert (back.dimensions, back.box) == (2, box)
    np.testing.assert_allclose(back.state.positions, sim.state.positions, rtol=0, atol=1e-7)
    run_files.write(whole, falling(LEANING))
    with h5py.File(whole) as file:
        assert b"dimensions" not in file["kickdrift/system/record"][()]
