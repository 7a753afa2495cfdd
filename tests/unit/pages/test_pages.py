"""Pages that compute: the states of compiled loops in node, and what the command refuses."""

import json
import math
import shutil
import subprocess
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.integrators import INTEGRATORS
from kickdrift.odes import ODES
from kickdrift.pages import linking
from kickdrift.pages.image import Image
from kickdrift.pages.linking import BASE, MISSING
from kickdrift.pages.lowering import PLAIN_PROCESSOR
from kickdrift.pages.page import built, write_page
from kickdrift.pages.shipped import PAGES, STEP, double_pendulum
from tests.processes import python

STEPS = 1000
NATIVE = """
import json, sys
import kickdrift as kd
from kickdrift.odes import ODES
from kickdrift.pages.shipped import COMPARED, STEP, fixed_step_methods
found = {}
for name in [f"{problem} {method}" for problem in COMPARED for method in fixed_step_methods()]:
    problem, method = name.split()
    sim = kd.Simulation(ODES[problem](), integrator=method, dt=STEP)
    sim.run(STEPS)
    found[name] = sim.state.y.tolist()
print(json.dumps(found))
"""


def test_an_unknown_page_is_named(tmp_path):
    with pytest.raises(InputError, match=r"page 'liquid' is unknown; pages: which-integrator, stability, chaos"):
        write_page("liquid", tmp_path / "page.html")


def test_without_a_linker_the_error_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setattr(linking.shutil, "which", lambda name: None)
    monkeypatch.setattr(linking, "find_spec", lambda name: None)
    with pytest.raises(InputError) as error:
        write_page("stability", tmp_path / "page.html")
    assert str(error.value) == MISSING
    assert "\n" not in MISSING
    assert not list(tmp_path.iterdir())


def test_arrays_that_share_memory_share_it_on_the_page():
    image, whole = Image(), np.arange(12.0).reshape(3, 4)
    first, row = image.array(whole), image.array(whole[1])
    assert first % 64 == 0
    assert row - first == whole[1].__array_interface__["data"][0] - whole.__array_interface__["data"][0]
    assert bytes(image.bytes[first - BASE : first - BASE + whole.nbytes]) == whole.tobytes()


def test_pieces_hold_all_that_is_not_zero():
    image = Image()
    image.array(np.concatenate([[1.0], np.zeros(100), [2.0]]))
    again = bytearray(len(image.bytes))
    for place, piece in image.pieces():
        again[place : place + len(piece)] = piece
    assert again == image.bytes
    assert len(image.pieces()) == 2


@pytest.mark.parametrize("name", PAGES)
def test_ready_pages_are_small_and_load_nothing(name):
    path = Path(__file__).parents[3] / "docs" / "pages" / f"{name}.html"
    text = path.read_text(encoding="utf-8")
    assert path.stat().st_size < 1_000_000
    assert "default-src 'none'" in text
    assert "http" not in text.replace('http-equiv="', "")


def test_the_energy_of_the_double_pendulum_is_kept():
    problem = double_pendulum()
    sim = kd.Simulation(problem, integrator="rk4", dt=0.001)
    before = problem.energy(0.0, problem.y0)
    sim.run(2000)
    assert abs(problem.energy(sim.time, sim.state.y) - before) < 1e-9


def in_node(name, tmp_path):
    """Module of a page, and its states in node after STEPS steps."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("needs node")
    try:
        module = built(name)
    except InputError as error:
        if str(error) == MISSING:
            pytest.skip(MISSING)
        raise
    place = tmp_path / "module.json"
    place.write_text(json.dumps(module))
    runtime = tmp_path / "runtime.mjs"
    runtime.write_text((files("kickdrift.pages") / "assets" / "runtime.js").read_text(encoding="utf-8"))
    command = [node, str(Path(__file__).with_name("states.mjs")), str(runtime), str(place), str(STEPS)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


@pytest.mark.long
def test_states_in_node_are_those_of_this_machine(tmp_path):
    found = in_node("which-integrator", tmp_path)
    native = python(f"STEPS = {STEPS}\n" + NATIVE, **PLAIN_PROCESSOR)
    assert native.returncode == 0, native.stderr
    states = json.loads(native.stdout)
    assert set(found) == set(states)
    for name, y in states.items():
        problem, method = name.split()
        assert found[name]["status"] == 0
        if problem == "pendulum":  # its sine is the browser's
            np.testing.assert_allclose(found[name]["y"], y, rtol=0, atol=1e-12 * max(1.0, *map(abs, y)), err_msg=name)
        else:
            assert found[name]["y"] == y, name
        energy = ODES[problem]().energy(0.0, np.array(found[name]["y"]))
        assert math.isclose(found[name]["energy"], energy, rel_tol=1e-12)
        assert found[name]["evaluations"] >= STEPS * INTEGRATORS[method].evaluations


@pytest.mark.long
def test_chaotic_states_in_node_are_those_of_this_machine(tmp_path):
    found = in_node("chaos", tmp_path)["henon-heiles rk4"]  # without sines, so that the bits are the same
    code = f"import kickdrift as kd\nsim = kd.Simulation(kd.odes.henon_heiles(), integrator='rk4', dt={STEP})\n"
    native = python(code + f"sim.run({STEPS})\nprint(sim.state.y.tolist())", **PLAIN_PROCESSOR)
    assert native.returncode == 0, native.stderr
    assert found["y"] == json.loads(native.stdout)
