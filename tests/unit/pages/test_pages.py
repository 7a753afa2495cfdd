"""Pages that compute: the states of compiled loops in node, and what the command refuses."""

import json
import math
import shutil
import subprocess
from importlib.resources import files
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import kickdrift as kd
from docs.studies.textbooks import orbits, unit_oscillator
from kickdrift.errors import InputError
from kickdrift.integrators import INTEGRATORS
from kickdrift.odes import ODES
from kickdrift.pages import linking
from kickdrift.pages.equations import COMPARED, STEP
from kickdrift.pages.image import Image
from kickdrift.pages.linking import BASE, MISSING
from kickdrift.pages.lowering import PLAIN_PROCESSOR
from kickdrift.pages.page import built, write_page
from kickdrift.pages.planets import ADDED, MOST_ADDED
from kickdrift.pages.shipped import PAGES, double_pendulum, three_bodies
from kickdrift.statistics.drift import drift, rounding_of
from kickdrift.view.page import bundle
from tests.processes import python

STEPS = 1000
NATIVE = """
import json, sys
import kickdrift as kd
from kickdrift.odes import ODES
from kickdrift.pages.equations import COMPARED, STEP, fixed_step_methods
found = {}
for name in [f"{problem} {method}" for problem in COMPARED for method in fixed_step_methods()]:
    problem, method = name.split()
    sim = kd.Simulation(ODES[problem](), integrator=method, dt=STEP)
    sim.run(STEPS)
    found[name] = sim.state.y.tolist()
print(json.dumps(found))
"""


def test_an_unknown_page_is_named(tmp_path):
    with pytest.raises(
        InputError, match=r"page 'gas' is unknown; pages: which-integrator, stability, chaos, liquid, planets, or a"
    ):
        write_page("gas", tmp_path / "page.html")


WRONG = {
    "copper-864": "page 'copper-864': force 'eam' stays outside; a page holds pair laws, gravity and laws of fields",
}


def test_a_page_holds_no_fixed_particles_and_no_tables(tmp_path):
    path = tmp_path / "own.toml"
    for force, more, reason in (
        (kd.LennardJones(), {"fixed": [kd.Fixed(0)]}, "has fixed particles, which a page cannot hold"),
        (kd.Tabulated.of(kd.LennardJones(), points=50), {}, "force 'tabulated' stays outside"),
    ):
        system = kd.System([[1.0, 1, 1], [2.5, 1, 1]], box=[8.0] * 3, forces=[force], **more)
        path.write_text(system.with_run(dt=0.01).to_toml(), encoding="utf-8")
        with pytest.raises(InputError, match=reason):
            write_page(str(path), tmp_path / "page.html")


OWN = """
def f(t, y):
    return [-k * y[k] for k in range(len(y))]

y0 = [1.0] * {count}
"""


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (OWN.format(count=101), "has 101 unknowns; a page holds 100"),
        (
            "import kickdrift as kd\nproblem = kd.Problem(lambda t, y: [-y[0]], [1.0], compiled=False)\n",
            "has compiled=False; a page holds compiled functions alone",
        ),
    ],
)
def test_equations_that_a_page_cannot_hold_are_refused_with_their_reason(text, reason, tmp_path):
    path = tmp_path / "own.py"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=f"own.py'?: {reason}"):
        write_page(str(path), tmp_path / "page.html")
    assert list(tmp_path.glob("*.html")) == []


def test_the_output_is_checked_before_anything_is_built(tmp_path, monkeypatch):
    monkeypatch.setattr("kickdrift.pages.page.built", lambda name: pytest.fail("built"))
    for output, reason in (
        (tmp_path / "page.txt", "ends in .txt|must end in .html|expected"),
        (tmp_path / "none" / "page.html", "there is no folder"),
        (Path("/proc/page.html"), "cannot be written"),
    ):
        with pytest.raises(InputError, match=reason):
            write_page("stability", output)


@pytest.mark.parametrize("name", WRONG)
def test_a_system_that_a_page_cannot_hold_is_refused_with_its_reason(name, tmp_path):
    with pytest.raises(InputError) as error:
        write_page(name, tmp_path / "page.html")
    assert str(error.value) == WRONG[name]
    assert not list(tmp_path.iterdir())


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
    assert "http" not in text.replace('http-equiv="', "").replace(bundle(), "")


SHOWN = {  # values for the lines in Python
    "which-integrator": {"problem": "kepler", "start": "0.5", "method": "rk4", "dt": 0.1, "steps": 20, "every": 10},
    "stability": {"omega": 1.0, "method": "rk4", "step": ", dt=0.1", "end": 20},
    "chaos": {
        "place": "kickdrift.odes",
        "problem": "lorenz",
        "start": "[1, 1, 1]",
        "method": "'rk4', dt=0.1",
        "time": 1,
    },
    "liquid": {"cutoff": "2.5", "method": "velocity-verlet", "dt": 0.004, "options": "", "steps": 20, "every": 10},
}


ONE_MORE = """\
sim.run(10)
system = sim.now().with_body("new 1", mass=0.001,
    position=[3.5, 3.5, 1.5],
    velocity=[-2.0, 1.7, 0.7])
sim = kd.Simulation(system, "wisdom-holman", dt=0.005)
"""
SHOWN["planets"] = {"method": "wisdom-holman", "dt": 0.005, "lines": ONE_MORE}


@pytest.mark.parametrize("name", PAGES)
def test_the_same_in_python_runs(name, capsys):
    exec(PAGES[name].python.format(**SHOWN[name]), {})
    assert capsys.readouterr().out


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


BROWSED = """<!DOCTYPE html><meta charset="utf-8"><body></body><script type="module">
%s
const found = {};
for (const [name, run] of Object.entries(await load(%s))) {
  run.reset();
  run.advance(%d);
  found[name] = Array.from(run.y);
}
document.body.textContent = JSON.stringify(found);
</script>"""
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")


def in_browser(folder):
    """States in a browser after STEPS steps, of the module that ``in_node`` left in the folder."""
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        pytest.skip("needs Chromium")
    page, runtime = folder / "page.html", (folder / "runtime.mjs").read_text(encoding="utf-8")
    module = (folder / "module.json").read_text().replace("<", "\\u003c")
    page.write_text(BROWSED % (runtime.replace("export ", ""), module, STEPS), encoding="utf-8")
    options = "--headless=new", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=600000", "--dump-dom"
    done = subprocess.run([browser, *options, page.as_uri()], capture_output=True, text=True, check=True, timeout=300)
    return json.loads(done.stdout.partition("<body>")[2].partition("</body>")[0])


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


LIQUID = """
import json
import kickdrift as kd
from kickdrift.pages.particles import CUTOFFS, FRICTION
found = {}
for cutoff in CUTOFFS:
    system = kd.load("lj-1000").with_forces(kd.LennardJones(cutoff=cutoff, truncation="shift"))
    for name, options in (("velocity-verlet", {}), ("baoab", {"temperature": 1.0, "friction": FRICTION})):
        sim = kd.Simulation(system, name, dt=system.run.dt, **options)
        sim.run(STEPS)
        found[f"{name} {cutoff}"] = sim.state.phase.ravel().tolist()
print(json.dumps(found))
"""


@pytest.mark.long
def test_the_liquid_has_the_bits_of_this_machine_in_node_and_in_a_browser(tmp_path):
    """Its pair lists, noise and cutoffs too; 1000 steps."""
    found = in_node("liquid", tmp_path)
    native = python(f"STEPS = {STEPS}\n" + LIQUID, **PLAIN_PROCESSOR)
    assert native.returncode == 0, native.stderr
    states = json.loads(native.stdout)
    assert set(found) == set(states)
    for name, y in states.items():
        assert found[name]["status"] == 0
        assert found[name]["y"] == y, name
    shown = in_browser(tmp_path)
    for name, y in states.items():
        assert shown[name] == y, name


PLANETS = """
import json
import kickdrift as kd
from kickdrift.pages.planets import ADDED, METHODS, MOST_ADDED, PLACES, SYSTEM
found = {}
for count in range(MOST_ADDED + 1):
    for kind, mass in ADDED.items() if count else [("", 0.0)]:
        system = kd.load(SYSTEM)
        for k, place in enumerate(PLACES[:count]):
            system = system.with_body(f"new {k + 1}", mass=mass, a=place)
        for name in METHODS:
            sim = kd.Simulation(system, name, dt=system.run.dt)
            sim.run(STEPS)
            found[f"{name}|{count}|{kind}"] = sim.state.phase.ravel().tolist()
print(json.dumps(found))
"""


@pytest.mark.long
def test_planets_move_as_on_this_machine_in_node_and_in_a_browser(tmp_path):
    """By leapfrog with the same bits, and by Wisdom-Holman to 1e-12 of the solar system's size; 1000 steps."""
    found = in_node("planets", tmp_path)
    native = python(f"STEPS = {STEPS}\n" + PLANETS, **PLAIN_PROCESSOR)
    assert native.returncode == 0, native.stderr
    states = json.loads(native.stdout)
    assert set(found) == set(states)
    assert len(states) == 2 * (1 + MOST_ADDED * len(ADDED))
    shown = in_browser(tmp_path)
    for name, y in states.items():
        assert found[name]["status"] == 0
        assert shown[name] == found[name]["y"], name
        if name.startswith("velocity-verlet"):
            assert found[name]["y"] == y, name
        else:
            np.testing.assert_allclose(found[name]["y"], y, rtol=0, atol=1e-12 * max(map(abs, y)), err_msg=name)


@pytest.mark.long
def test_a_page_of_ones_own_equations_moves_as_on_this_machine(tmp_path):
    path = tmp_path / "own.py"
    path.write_text(OWN.format(count=3) + "args = ()\n", encoding="utf-8")
    found = in_node(str(path), tmp_path)
    assert set(found) == {"problem euler", "problem midpoint", "problem rk4"}
    code = f"""
from kickdrift.systemfile.python_file import load_or_run
import json, kickdrift as kd
problem, found = load_or_run({str(path)!r}), {{}}
for name in ("euler", "midpoint", "rk4"):
    sim = kd.Simulation(problem, name, dt={STEP})
    sim.run({STEPS})
    found["problem " + name] = sim.state.y.tolist()
print(json.dumps(found))
"""
    native = python(code, **PLAIN_PROCESSOR)
    assert native.returncode == 0, native.stderr
    for name, y in json.loads(native.stdout).items():
        assert found[name]["y"] == y, name


def asset(folder, name):
    """A script of the pages as a module for node."""
    place = folder / name.replace(".js", ".mjs")
    place.write_text((files("kickdrift.pages") / "assets" / name).read_text(encoding="utf-8"), encoding="utf-8")
    return str(place)


def node_prints(script, *args):
    """What a script beside this test prints in node, as JSON."""
    done = subprocess.run(
        [shutil.which("node"), str(Path(__file__).with_name(script)), *args], capture_output=True, text=True, check=True
    )
    return json.loads(done.stdout)


@pytest.mark.long
def test_a_page_finds_a_drift_where_the_report_finds_one(tmp_path):
    """All other verdicts agree too, but for the report's doubts, which a page calls bounded."""
    in_node("which-integrator", tmp_path)
    found = node_prints(
        "verdicts.mjs", asset(tmp_path, "runtime.js"), asset(tmp_path, "verdict.js"), str(tmp_path / "module.json")
    )
    assert len(found) > 140
    doubts = 0
    for each in found:
        errors = np.array(each["errors"])
        report = drift(np.arange(len(errors)), errors, rounding_of(1.0, each["steps"])).verdict
        expected = "unreliable" if np.abs(errors).max() > 0.1 else report
        if expected in ("random walk", "not resolvable"):
            doubts += 1
            expected = "bounded"
        assert each["verdict"] == expected, each["name"]
    assert doubts < 12


@pytest.mark.long
def test_the_articles_claims_hold_from_the_pages_own_loops(tmp_path, monkeypatch):
    """The studies of docs/textbooks.md on the oscillator and on orbits, each run by the page's loop in node."""
    in_node("which-integrator", tmp_path)
    ran, native = set(), kd.Simulation

    class OnThePage:
        """What these studies ask of a Simulation."""

        def __init__(self, problem, method, dt):
            self.problem, self.dt, self.name = problem, dt, f"{problem.name} {kd.integrator(method).method.name}"

        def run(self, steps, every):
            given = (self.name, self.dt, steps, every, json.dumps(list(self.problem.y0)))
            found = node_prints("runs.mjs", runtime, str(tmp_path / "module.json"), *map(str, given))
            self.state = SimpleNamespace(y=np.array(found["y"]))
            looks = [SimpleNamespace(energies=SimpleNamespace(total=energy)) for energy in found["energies"]]
            self.record = SimpleNamespace(samples=looks)
            ran.add(self.name)

    def simulation(problem, method, dt):
        return OnThePage(problem, method, dt) if problem.name in COMPARED else native(problem, method, dt=dt)

    runtime = asset(tmp_path, "runtime.js")
    monkeypatch.setattr(kd, "Simulation", simulation)
    monkeypatch.setattr(orbits, "energy_errors", orbits.energy_errors.__wrapped__)  # which keeps no native run
    claims = [*unit_oscillator.claims(), *orbits.claims()]
    assert [row["claim"] for row in claims if row["verdict"] == "fail"] == []
    assert {"harmonic-oscillator euler", "harmonic-oscillator rk4", "kepler euler", "kepler symplectic-euler"} <= ran
    assert len({row["said"] for row in claims}) == 8


@pytest.mark.long
def test_the_tangent_vector_of_lorenz_equations_grows_at_the_known_rate(tmp_path):
    """0.9056: Sprott 2003, Chaos and Time-Series Analysis, appendix A."""
    states = in_node("chaos", tmp_path)
    assert "three-bodies dop853" in states
    rate = node_prints("growth.mjs", asset(tmp_path, "runtime.js"), str(tmp_path / "module.json"), "lorenz dop853")
    assert abs(rate - 0.9056) < 0.01


def test_three_bodies_move_as_the_shipped_figure_eight():
    system = kd.load("figure-eight")
    one = kd.Simulation(system, "rk4", dt=0.001)
    other = kd.Simulation(three_bodies(), "rk4", dt=0.001)
    one.run(1000)
    other.run(1000)
    x = other.state.y.reshape(2, 3, 2)
    np.testing.assert_allclose(x, one.state.phase.transpose(0, 2, 1)[:, :, :2], rtol=0, atol=1e-12)


@pytest.mark.long
def test_chaotic_states_in_node_are_those_of_this_machine(tmp_path):
    found = in_node("chaos", tmp_path)["henon-heiles rk4"]  # without sines, so that the bits are the same
    code = f"""
import kickdrift as kd
from kickdrift.odes import henon_heiles
sim = kd.Simulation(henon_heiles(), integrator="rk4", dt={STEP})
sim.run({STEPS})
print(sim.state.y.tolist())
"""
    native = python(code, **PLAIN_PROCESSOR)
    assert native.returncode == 0, native.stderr
    assert found["y"] == json.loads(native.stdout)
