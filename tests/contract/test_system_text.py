"""Contract tests: `System.to_toml` preserves every shipped system of particles, every force and every event."""

from __future__ import annotations

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.forces import FORCES
from kickdrift.forces.many_body.base import ManyBodyForce
from kickdrift.forces.pairs.law import PairForce
from kickdrift.systemfile.files import describe, shipped
from kickdrift.systemfile.reading import loads
from kickdrift_validation.example_forces import changed, charges, crystal, example, topology

SYSTEMS = [name for name in shipped() if isinstance(kd.load(name), kd.System)]
FIELDS = (
    "forces", "units", "species", "names", "run", "equilibration", "invariants", "events", "dimensions", "topology"
)  # fmt: skip


def assert_same(read: kd.System, system: kd.System) -> None:
    for key in ("phase", "masses", "ids"):
        np.testing.assert_array_equal(getattr(read.state, key), getattr(system.state, key))
    assert read.box == system.box
    for key in FIELDS:
        assert getattr(read, key) == getattr(system, key), key
    np.testing.assert_array_equal(read.species_index, system.species_index)
    assert (read.radii is None) == (system.radii is None)
    if system.radii is not None:
        np.testing.assert_array_equal(read.radii, system.radii)
    assert (read.charges is None) == (system.charges is None)
    if system.charges is not None:
        np.testing.assert_array_equal(read.charges, system.charges)


@pytest.mark.parametrize("name", SYSTEMS)
def test_a_shipped_system_comes_back_from_its_text(name, tmp_path):
    system, path = kd.load(name), tmp_path / f"{name}.toml"
    path.write_text(system.to_toml(), encoding="utf-8")
    assert_same(kd.load(path), system)
    assert describe(path).title == describe(shipped()[name]).title


@pytest.mark.parametrize("name", [name for name, cls in FORCES.items() if cls.__module__.startswith("kickdrift.")])
def test_a_force_comes_back_from_its_text(name):
    law = FORCES[name].law_keys if issubclass(FORCES[name], PairForce) else ("epsilon", "sigma")
    first, last = law[0], law[-1]
    species = {"A": {}, "B": {**changed(last, 0.9), "cutoff": 1.2, "truncation": "force-shift"}}
    pairs = {("B", "A"): {**changed(first, 0.3), "truncation": "switch", "switch_start": 0.9}}
    lists = {"springs": {"stiffness": (2.0, 3.0)}, "listed-pairs": {"sigma": (0.8, 0.9)}}  # which list their own pairs
    own = lists.get(name, {"pairs": pairs, "softening": 0.1, "G": 1e-4})
    force = example(FORCES[name], cutoff=1.5, species=species, group=1, **own)
    x = 1.2 * np.indices((2, 2, 2)).reshape(3, -1).T + np.random.default_rng(5).uniform(-0.1, 0.1, (8, 3))
    masses = np.where(np.arange(8) == 3, 30.0, 1.0)
    if isinstance(force, ManyBodyForce):
        system = crystal(force, few=True)
    else:
        given = {"forces": [force], "topology": topology(force), "charges": charges(force, 8)}
        system = kd.System(x, masses=masses, units="nbody", species=list("ABABABAB"), **given)
    text = system.to_toml()
    assert_same(loads(text), system)
    assert loads(text).to_toml() == text


EVENTS = [
    kd.CloseApproach(0.1),
    kd.CloseApproach(3.0, ["Earth", 2], hill=True),
    kd.Collision(action="bounce", restitution=0.5),
    kd.Collision({"Sun": 0.005, "Mars": 1e-5}),
    kd.Collision([0.005, 1e-5, 2e-5]),
    kd.Escape(50.0, "Sun", "remove"),
    kd.Crossing.pericentre("Earth", 0),
    kd.Crossing.descending_node("Mars", "Sun"),
]


@pytest.mark.parametrize("event", EVENTS, ids=lambda event: event.kind)
def test_an_event_comes_back_from_its_text(event):
    bodies = [{"name": "Sun", "mass": 1.0}, {"name": "Earth", "mass": 3e-6, "a": 1.0, "radius": 4e-5}]
    system = kd.System.from_elements([*bodies, {"name": "Mars", "mass": 3e-7, "a": 1.5}]).watched([event])
    assert_same(loads(system.to_toml()), system)


@pytest.mark.parametrize(
    ("box", "dimensions"),
    [
        ((6.0, 7.0, 8.0), 3),
        (kd.Box(matrix=[[6, 0, 0], [1.5, 7, 0], [-2, 3, 8]]), 3),
        (kd.Box([6.0, 7.0, 8.0], periodic=(True, True, False)), 3),
        (kd.Box([6.0, 7.0, 0.0], periodic=(True, True, False)), 3),
        ((6.0, 7.0), 2),
        (kd.Box(matrix=[[6, 0], [1.5, 7]]), 2),
        (None, 2),
    ],
    ids=str,
)
def test_a_box_comes_back_from_its_text(box, dimensions):
    x = np.array([[0.5, 0.1, 0.25], [1 / 3, 2.0, 0.25]])
    options = {"names": ['"a"', "β\\é"], "radii": [0.1, 0.2], "invariants": {"note": "a\nb", "list": [1, 2.5, True]}}
    system = kd.System(x, x * [0.1, 0.7, 0.0], box=box, dimensions=dimensions, **options)
    system = system.with_run(dt=1e-5, time=0.1, integrator="dormand-prince45", rtol=1e-7, controller="pi")
    assert_same(loads(system.to_toml()), system)
