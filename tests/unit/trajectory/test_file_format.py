"""A run's file agrees with docs/file-format.md: a reader made from that page finds the same as our own."""

from __future__ import annotations

import re

import h5py
import numpy as np
import pytest

import kickdrift as kd
from kickdrift.model.state import State
from kickdrift.model.units.unit_systems import UNIT_SYSTEMS
from kickdrift.trajectory.layout.names import SCHEMA
from kickdrift.trajectory.write.h5md import Writer
from tests.folders import DOCS
from tests.oracle import h5md_reader

LEANING = kd.Box(matrix=[[10.0, 0.0, 0.0], [4.0, 9.0, 0.0], [-3.0, 2.0, 8.0]])
SLAB = kd.Box((10.0, 9.0, 0.0), periodic=(True, True, False))
PAGE = DOCS / "file-format.md"
FILES = {
    "lj": (lambda: kd.load("lj-1000"), kd.FileOptions()),
    "lj, float32": (lambda: kd.load("lj-1000"), kd.FileOptions(store="float32")),
    "metal, forces": (lambda: kd.load("argon-864"), kd.FileOptions(write=("forces",))),
    "metal, images, compressed": (lambda: kd.load("argon-864"), kd.FileOptions(compress=True, write=("images",))),
    "astro, names": (lambda: kd.load("solar-system"), kd.FileOptions()),
    "si": (lambda: bodies("si", 1e-10), kd.FileOptions(store="float32", compress=True, write=("forces",))),
    "lj, leaning, images": (lambda: boxed(LEANING), kd.FileOptions(write=("images",))),
    "lj, a slab, images": (lambda: boxed(SLAB), kd.FileOptions(write=("images",))),
    "nbody, a merger": (lambda: bodies("nbody", 1.0), kd.FileOptions()),
}


def bodies(units, scale):
    x = scale * np.array([[0.0, 1.0, 2.0], [3.0, 4.0, 5.5], [6.0, -7.0, 8.0]])
    return kd.System(x, -x, [1.0, 2.0, 3.0], units=UNIT_SYSTEMS[units], species=["A", "B", "A"], names=["a", "b", "c"])


def boxed(box):
    x = np.random.default_rng(4).uniform(-30, 30, (7, 3))
    return kd.System(x, -x, box=box)


def written(path, system, options):
    """A file with every kind of content: three frames among five samples, and the third of three bodies is absorbed."""
    s = system.state
    with Writer(
        path, system, method={"integrator": "x"}, every=5, options=options, plan=[0, 0.0, 20, np.inf, 5, 0, 1],
        checkpoint=lambda: {"step": 3, "time": 0.25, "x": np.arange(4.0)},
    ) as writer:  # fmt: skip
        writer.absorbed = {2: 0}
        for step in range(0, 25, 5):
            phase = s.phase * (1 + step / 7)
            merged = len(s) == 3 and system.units.name == "nbody" and step > 10
            keep = slice(0, 2) if merged else slice(None)
            state = State(phase[:, :, keep], s.masses[keep], s.ids[keep], s.box, s.time + step / 8, step)
            force = np.sin(state.positions) if "forces" in writer.writes else None
            if merged and step == 15:
                writer.append_event(
                    {"time": 1.6, "step": 13, "ids": [0, 2], "distance": 0.5, "energy": -2.0, "kind": "collision",
                     "done": "c merged into a"}
                )  # fmt: skip
                writer.append_event(
                    {"time": 1.7, "step": 14, "ids": [1], "distance": None, "energy": None, "kind": "escape",
                     "done": ""}
                )  # fmt: skip
            observables = {"total_energy": -step / 3, "momentum": np.array([step, 1.0, 2.0])}
            writer.append(state, observables, frame=step % 10 == 0, forces=force)
        writer.report = {"verdict": "bounded"}


@pytest.mark.parametrize("name", FILES)
def test_a_reader_of_the_page_reads_what_we_write(tmp_path, name):
    made, options = FILES[name]
    path, system = tmp_path / "run.h5md", made()
    written(path, system, options)
    found = h5md_reader.read(path)
    with kd.open(path) as run:
        for key, ours in (
            ("steps", run.steps), ("times", run.times), ("positions", run.positions), ("velocities", run.velocities),
            ("masses", run.masses), ("ids", run.ids), ("start", run.initial_phase), ("plan", run.plan),
            ("sample_steps", run.sample_steps), ("sample_times", run.sample_times),
        ):  # fmt: skip
            np.testing.assert_array_equal(found[key], ours, err_msg=key)
        assert len(found["steps"]) == 3
        assert len(found["sample_steps"]) == 5
        if "forces" in options.write:
            np.testing.assert_array_equal(found["forces"], run.forces)
        assert found["species"] == [run.species[k] for k in run.species_index]
        assert tuple(found["record"]["names"]) == run.names
        if run.box.periodic:
            np.testing.assert_allclose(found["box"], [box.shape for box in run.boxes], rtol=1e-15)
        assert (found["box"] is None) == (not run.box.periodic)
        assert found["source"] == run.system_source == system.source
        assert (found["method"], found["versions"], found["report"]) == (run.method, run.versions, run.report)
        assert found["samples"].keys() == run.observables.keys()
        for key, values in run.observables.items():
            np.testing.assert_array_equal(found["samples"][key], values)
            np.testing.assert_array_equal(found["observables"][key], values[::2])
        bodies_of = [{key: value for key, value in event.items() if key != "bodies"} for event in run.events]
        assert found["events"] == bodies_of
        assert len(bodies_of) == (2 if system.units.name == "nbody" else 0)
        assert found["units"]["length"] == run.units.length
        assert found["units"]["boltzmann"] == run.units.boltzmann
        assert found["units"]["nominal"] == run.nominal_units
        assert (found["dtype"], found["compressed"]) == (options.dtype, options.compress)
        assert (found["run_id"], found["every"]) == (run.run_id, run.every)
        assert run.checkpoints is not None
        assert found["checkpoints"] == list(zip(run.checkpoints.steps, run.checkpoints.times, strict=True))
        assert len(found["checkpoints"]) >= 1
        assert found["damaged"] == {"frames": [], "samples": [], "events": []}


def test_the_page_names_every_object_of_a_file(tmp_path):
    written(tmp_path / "run.h5md", kd.load("argon-864"), kd.FileOptions(write=("forces", "images")))
    text = PAGE.read_text(encoding="utf-8")
    with h5py.File(tmp_path / "run.h5md") as file:
        names, attributes = [], []
        file.visititems(lambda name, item: (names.append(name), attributes.extend(item.attrs))[0])
    words = set(re.findall(r"\w+", text))
    parts = {part for name in names for part in name.split("/")} - {"total_energy", "momentum"}
    assert parts <= words
    assert set(attributes) <= words
    assert f"version {SCHEMA}**" in text
    assert h5md_reader.KNOWN_SCHEMA == SCHEMA
