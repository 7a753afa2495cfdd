"""Numbers, counts, laws and steps from Python code and small files; every refusal is one clear line."""

import math
import resource
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.integrators.step_choice.step_length import TOO_LONG, bound_by_gravity, fastest
from kickdrift.model.checks import limits
from kickdrift.model.checks import values as checks
from kickdrift.model.run_defaults import RunDefaults
from kickdrift.model.units.quantities import quantity
from kickdrift.model.units.unit_systems import unit_system
from kickdrift.systemfile.reading import loads

TWO = [[1.0, 1.0, 1.0], [2.5, 1.0, 1.0]]
BOX = (10.0, 10.0, 10.0)
METAL = unit_system("metal")


def pair(**changes):
    return kd.System(**{"positions": TWO, "box": BOX, "forces": [kd.LennardJones(cutoff=2.5)], **changes})


# --- units ---


@pytest.mark.parametrize(
    ("text", "dimension"),
    [
        ("1 mol", "mass"),
        ("1 g mol", "mass"),
        ("1 g/mol^2", "mass"),
        ("1 percent", "angle"),
        ("1 bit", "angle"),
        ("1 count", "angle"),
        ("1 rad^2", "angle"),
        ("1 deg percent", "angle"),
        ("3 K/mol", "temperature"),
        ("3 K/mol", "energy"),
        ("1 m/mol", "length"),
        ("1 m percent", "length"),
        ("1 nm deg", "length"),
        ("1 deg/s", "rate"),
        ("1 rpm", "frequency"),
        ("1 Bq", "frequency"),
        ("1 g/mol/cm^3", "density"),
    ],
)
def test_a_quantity_has_its_own_dimension(text, dimension):
    with pytest.raises(kd.InputError, match=r"^key: expected an? .*, got '"):
        quantity(text, dimension, METAL, "key")


@pytest.mark.parametrize(
    ("text", "dimension", "value"),
    [
        ("39.948 g/mol", "mass", 39.948),
        ("1 kcal/mol", "energy", 0.0433641),
        ("1 kcal/mol/angstrom", "force", 0.0433641),
        ("1 mol/m^3", "number density", 6.02214e-7),
        ("1 degC", "temperature", 274.15),
        ("1 turn", "angle", 360.0),
        ("120 K", "energy", 0.0103408),
        ("2 THz", "frequency", 2.0),
        (".5e1 nm", "length", 50.0),
    ],
)
def test_what_has_the_dimension_is_read(text, dimension, value):
    assert quantity(text, dimension, METAL) == pytest.approx(value, rel=1e-5)


@pytest.mark.parametrize(
    "text",
    [
        "39.948 " + "u" * 60 + "!",
        "39.948 " + "u" * 10_000 + "!",
        "1" * 50_000 + "\n!",
        "1 " + "(" * 150,
        "1 m" + " " * 10**5,
    ],
)
def test_no_unit_takes_long_to_refuse(text):
    with pytest.raises(kd.InputError) as refused:
        quantity(text, "mass", METAL, "mass")
    assert len(str(refused.value)) < 300


LATTICE = """units = "lj"
force = []
[particles]
lattice = "fcc"
count = {count}
density = {density}
"""


@pytest.mark.parametrize("key", ['"\\u0007\\u001b[31mx"', "k" * 10_000, '"\\u202e"'])
def test_a_key_of_a_file_is_shown_without_control_characters_and_cut(key):
    with pytest.raises(kd.InputError, match="unknown key") as refused:
        loads(f"{key} = 1\n" + LATTICE.format(count=4, density=1))
    assert str(refused.value).isprintable()
    assert len(str(refused.value)) < 300


# --- counts and sizes ---


ORBITS = """units = "astro"
force = [{{type = "gravity"}}]
[particles]
central = {{mass = 1.0}}
elements = [{{mass = 0, count = {count}, a = [1.0, 2.0]}}]
seed = 1
"""
PLUMMER = """units = "nbody"
force = [{{type = "gravity"}}]
[particles]
plummer = {{count = {count}, seed = 1, scaled = false}}
"""


@pytest.mark.parametrize("count", [10**9, 10**12, 10**30])
@pytest.mark.parametrize("text", [LATTICE, ORBITS, PLUMMER])
def test_a_count_beyond_the_memory_is_refused_with_what_fits(text, count):
    with pytest.raises(
        kd.InputError, match=r"count: [0-9,.e+]+ particles take .* this machine has .*; the limit is [0-9,]+"
    ):
        loads(text.format(count=count, density=1.0))


def test_the_bound_is_a_share_of_the_memory(monkeypatch):
    monkeypatch.setattr(limits, "memory", lambda: 2**33)
    limits.check_particles("count", 4 * 10**6)
    with pytest.raises(
        kd.InputError, match=r"count: 5,000,000 particles take about 4\.66 GiB, and this machine has 8 GiB"
    ):
        limits.check_particles("count", 5 * 10**6)


def test_the_memory_is_at_most_what_the_process_may_have():
    assert 0 < limits.memory() <= limits._of_machine()
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    assert limit == resource.RLIM_INFINITY or limits.memory() <= limit


def test_close_approaches_among_too_many_bodies_are_refused(monkeypatch):
    monkeypatch.setattr(limits, "memory", lambda: 10**5)
    bodies = kd.System(np.arange(300.0).reshape(100, 3), forces=[kd.Gravity(G=1.0)])
    with pytest.raises(kd.InputError, match="close-approach: 4,950 pairs of bodies take"):
        bodies.watched([kd.CloseApproach(0.1)])


def test_fractions_of_species_go_with_a_lattice():
    with pytest.raises(kd.InputError, match="species: expected one name or a list of 1;"):
        loads('units = "lj"\nforce = []\n[particles]\npositions = [[0, 0, 0]]\nspecies = {A = 0.5, B = 0.5}\n')


@pytest.mark.parametrize("density", ["1e-320", "1e400"])
def test_a_density_whose_box_has_no_volume_is_refused(density):
    with pytest.raises(kd.InputError, match=r"particles\.density: "):
        loads(LATTICE.format(count=4, density=density))


def test_an_integer_of_thousands_of_digits_is_one_line():
    with pytest.raises(kd.InputError, match="not valid TOML: "):
        loads("count = " + "1" * 5000)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("100000000000\nx\nAr 0 0 0\n", "frame 0 claims 100000000000 atoms, but the file has"),
        ("1\nx\nAr 0 0 0\n100000000000\nx\nAr 0 0 0\n", "frame 1 claims 100000000000 atoms"),
        ("1\nProperties=species:S:1:pos:R:99999999999\nAr 0 0 0\n", "frame 0 claims 99999999999 columns"),
    ],
)
def test_an_xyz_that_claims_more_than_it_holds_is_refused(tmp_path: Path, text, message):
    pytest.importorskip("ase")
    (tmp_path / "a.xyz").write_text(text)
    with pytest.raises(kd.InputError, match=message):
        loads('units = "metal"\nforce = []\n[particles]\nfile = "a.xyz"\n', folder=tmp_path)


# --- arrays and arguments from Python ---


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"positions": np.array(TWO) + 5j}, "positions: expected numbers of shape .n, 3.: got complex numbers"),
        ({"positions": np.array(TWO) > 1}, "positions: .* got true and false"),
        ({"positions": [["1", "2", "3"]]}, "positions: .* got text"),
        ({"positions": [[None, 1, 2]]}, r"positions\[0\]\[0\]: .* got None"),
        ({"positions": {"a": 1}}, "positions: "),
        ({"positions": [[1, 2], [1, 2, 3]]}, "positions: .* rows of different lengths"),
        ({"positions": np.ma.masked_greater(TWO, 2)}, "positions: .* masked"),
        ({"positions": [[10**400, 0, 0]]}, "positions: particle 0 has inf in x"),
        ({"velocities": 1j * np.ones((2, 3))}, "velocities: .* complex"),
        ({"masses": [1 + 1j, 1]}, "masses: expected one number or 2: got complex"),
        ({"masses": "abc"}, "masses: "),
        ({"masses": None}, "masses: expected one number or 2: got None"),
        ({"radii": [1j, 1]}, "radii: .* complex"),
        ({"box": "abc"}, "box: expected three edge lengths, a matrix of edge vectors, or None, got 'abc'"),
        ({"box": 3}, "box: expected three edge lengths, got 3; a cube is box=\\(3, 3, 3\\)"),
        ({"box": [None] * 3}, "box: edge x must be a positive finite length, got None"),
        ({"box": [True] * 3}, "box: edge x"),
        ({"box": [1e-300] * 3}, "box: edges of 1e-300, 1e-300 and 1e-300 have a volume beyond the range of numbers"),
        ({"box": [1e300] * 3}, "box: edges of"),
        ({"forces": [None]}, r"forces\[0\]: expected a force, such as .*, got None"),
        ({"forces": [kd.LennardJones]}, r"forces\[0\]: expected a force"),
        ({"forces": kd.LennardJones()}, "forces: expected a list of forces"),
        ({"forces": None}, "forces: expected a list of forces"),
        ({"units": 3}, "units: expected one of lj, "),
        ({"species": 3}, "species: expected a list of names, got 3"),
        ({"species": [None, "A"]}, r"species\[0\]: expected a name, got None"),
        ({"names": 3}, "names: expected a list of names, got 3"),
        ({"name": 3}, "name: expected text, got 3"),
        ({"run": {"dt": 1}}, "run: expected a RunDefaults"),
        ({"invariants": 3}, "invariants: expected a Mapping, got 3"),
        ({"seed": "x"}, "seed must be a whole number, zero or more, got 'x'"),
    ],
)
def test_a_system_refuses_what_is_no_number_or_no_force(changes, message):
    with pytest.raises(kd.InputError, match=message):
        pair(**changes)


def test_numbers_of_numpy_and_of_python_are_taken():
    made = pair(positions=np.array(TWO, dtype=np.float32), masses=np.int64(2), box=np.array(BOX), species=[1, 2])
    assert made.state.masses.tolist() == [2.0, 2.0]
    assert made.box.lengths == BOX
    assert kd.LennardJones(sigma=np.float32(1.5)).law.sigma == 1.5
    assert checks.number(10**400) == math.inf
    assert math.isnan(checks.number(True))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda s: kd.Simulation(s, dt=0.001, threads=0.5), "threads must be 1 to .* got 0.5"),
        (lambda s: kd.Simulation(s, dt=0.001, threads=True), "threads must be .* got True"),
        (lambda s: kd.Simulation(s, dt=0.001, threads="2"), "threads must be .* got '2'"),
        (lambda s: kd.Simulation(s, dt=0.001, threads=10**30), "threads must be 1 to"),
        (lambda s: kd.Simulation(s, dt=10**400), "dt must be a positive finite time"),
        (lambda s: kd.Simulation(s, dt=True), "dt must be a positive finite time, got True"),
        (lambda s: kd.Simulation(s, ["leapfrog"], dt=0.001), "integrator must be a name"),
        (lambda s: kd.Simulation(s, "x" * 5000, dt=0.001), "integrator 'xxx.* is unknown"),
        (lambda s: kd.Simulation(s, "dormand-prince45", rtol=True), "rtol must be a positive number, got True"),
        (lambda s: kd.Simulation(s, "dormand-prince45", controller=["i"]), r"controller \['i'\] is unknown"),
        (lambda s: kd.Simulation(kd.Simulation(s, dt=0.001)), "got a Simulation: give its"),
        (lambda s: kd.Simulation("lj-1000"), "takes a System or a Problem, got 'lj-1000': give kd.load"),
        (lambda s: kd.Simulation(kd.System), "takes a System or a Problem, got the class System"),
        (lambda s: kd.Simulation(s, dt=0.001).run(True), "steps must be a whole number, zero or more, got True"),
        (lambda s: kd.Simulation(s, dt=0.001).run(2, every=0.5), "every must be a whole number, one or more, got 0.5"),
        (lambda s: kd.Simulation(s, dt=0.001).run(until=10**400), "must be a finite time"),
        (lambda s: kd.Simulation(s, dt=0.001).run(2, observe=3), "observe must be a function, got 3"),
        (lambda s: kd.Simulation(s, dt=0.001).run(2, output=3), "output: expected the path of a file, got 3"),
        (lambda s: kd.Simulation(s, dt=0.001).run(2, overwrite="no"), "overwrite must be True or False, got 'no'"),
        (lambda s: kd.Simulation(s, dt=0.001).equilibrate("x", 1), "temperature must be positive, got 'x'"),
        (lambda s: kd.Simulation(s, dt=0.001).equilibrate(1, 1j), "equilibrate: time must be positive, got 1j"),
        (lambda s: kd.Simulation(s, dt=0.001).equilibrate(1, 1e300), "takes 1e.303 steps of 0.001; a run has at most"),
        (lambda s: kd.Simulation(s, dt=0.001).equilibrate(1, 1, 0.5), "equilibrate: interval must be a whole number"),
        (lambda s: kd.load(None), "system: expected the path of a file, got None"),
        (lambda s: kd.load(3), "system: expected the path of a file, got 3"),
        (lambda s: kd.load("plummer-1000", seed=-1), "seed must be a whole number, zero or more, got -1"),
        (lambda s: kd.open(None), "path: expected the path of a file, got None"),
        (lambda s: kd.resume(s), "path: expected the path of a file, got <System "),
        (lambda s: kd.resume("x.h5md", system=3), "system: expected a System, got 3"),
    ],
)  # fmt: skip
def test_arguments_of_the_wrong_kind_are_refused(make, message):
    with pytest.raises(kd.InputError, match=message):
        make(pair(velocities=[[1.0, 0, 0], [-1.0, 0, 0]]))


# --- forces ---


class DividesByZero(NamedTuple):
    k: float = 1.0

    def law(p, r2):
        return 1.0 / 0.0, 1.0


class Raises(NamedTuple):
    k: float = 1.0

    def law(p, r2):
        raise ValueError("no such thing")


class Text(NamedTuple):
    k: float = 1.0

    def law(p, r2):
        return "ab"


class OneValue(NamedTuple):
    k: float = 1.0

    def law(p, r2):
        return p.k / r2


class NotFinite(NamedTuple):
    k: float = 1.0

    def law(p, r2):
        return math.nan * r2, r2


class Loops(NamedTuple):
    k: float = 1.0

    def law(p, r2):
        total = 0.0
        for factor in [1.0, 2.0]:
            total = total + factor / r2
        return total, 2.0 * total / r2


@pytest.mark.parametrize(
    ("law", "message"),
    [
        (DividesByZero, "divides-by-zero: law.* raised ZeroDivisionError: .* in line [0-9]+: 'return 1.0 / 0.0, 1.0'"),
        (Raises, "raises: law.* raised ValueError: no such thing, in line"),
        (Text, "text: law.* must return two numbers, energy and force over r; it returned 'ab'"),
        (OneValue, "one-value: law.* must return two numbers.* it returned 0.16"),
        (NotFinite, "not-finite: law.* must return finite numbers; it returned .nan, "),
    ],
)
def test_a_pair_law_is_tried_when_the_system_is_made(law, message):
    with pytest.raises(kd.InputError, match=message):
        pair(forces=[kd.pair_law(law)(cutoff=2.5)])


def test_a_law_that_does_not_compile_is_quoted():
    system = pair(forces=[kd.pair_law(Loops)(cutoff=2.5)])
    with pytest.raises(
        kd.InputError, match=r"^Loops: law does not compile .*, line [0-9]+: 'for factor in .*Cannot unify"
    ):
        kd.Simulation(system, dt=0.001).run(1)


@pytest.mark.parametrize("made", [3, tuple, type("Plain", (), {})])
def test_what_is_no_law_is_refused(made):
    with pytest.raises(kd.InputError, match="pair_law: expected a NamedTuple class"):
        kd.pair_law(made)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"cutoff": 1e300}, "cutoff must be between 1e-100 and 1e.100"),
        ({"cutoff": 1e-300}, "cutoff must be between"),
        ({"cutoff": "2"}, "cutoff must be a positive length, got '2'"),
        ({"cutoff": 1j}, "cutoff must be a positive length"),
        ({"cutoff": True}, "cutoff must be a positive length, got True"),
        ({"epsilon": "x"}, "epsilon must be a finite number, got 'x'"),
        ({"epsilon": 10**400}, "epsilon must be a finite number"),
        ({"sigma": None}, "sigma must be a positive number, got None"),
        ({"tail": 1}, "tail must be True or False, got 1"),
        ({"truncation": "switch", "switch_start": "x"}, "switch_start must be a length, got 'x'"),
        ({"species": 3}, "species: expected a table, got 3"),
        ({"species": {"A": 3}}, "species\\['A'\\]: expected a table, got 3"),
        ({"pairs": {"A": {}}}, "pairs: expected two names"),
    ],
)
def test_a_pair_force_refuses_bad_parameters(given, message):
    with pytest.raises(kd.InputError, match=f"^lennard-jones: {message}"):
        kd.LennardJones(**{"cutoff": 2.5, **given})


def test_laws_that_cannot_be_tried_or_mixed_are_refused():
    with pytest.raises(kd.InputError, match=r"lennard-jones: law.* raised OverflowError"):
        pair(forces=[kd.LennardJones(cutoff=1e-99)])
    mixed = kd.LennardJones(cutoff=2.5, species={"A": {"epsilon": -1.0}, "B": {"epsilon": 1.0}})
    with pytest.raises(kd.InputError, match="pair A-B is needed: epsilons of different signs"):
        pair(forces=[mixed], species=["A", "B"])
    with pytest.raises(kd.InputError, match="gravity: G must be a positive number, got 'x'"):
        kd.Gravity(G="x")


# --- steps beyond the limit of stability ---


def circle(**changes):
    """Two bodies with period 2 pi."""
    v = [[0, 0, 0], [0, 1.0, 0]]
    return kd.System([[0, 0, 0], [1.0, 0, 0]], v, [1.0, 0.0], forces=[kd.Gravity(G=1.0)], **changes)


@pytest.mark.parametrize("integrator", ["leapfrog", "rk4"])
def test_a_step_of_many_periods_is_warned_of(integrator):
    report = kd.Simulation(circle(), integrator, dt=16 * 2 * math.pi).run(20)
    (warning,) = report.warnings
    assert TOO_LONG in warning
    assert "has a period of 6.283" in warning


def test_a_step_that_resolves_the_orbit_is_not():
    sim = kd.Simulation(circle(), "leapfrog", dt=0.1)
    assert sim.run(20).warnings == []
    phase = sim.system.state.phase
    assert fastest(sim.integration.flow, 0.0, phase) == pytest.approx(1.0, rel=1e-6)
    assert bound_by_gravity(circle()) >= 1.0


def test_the_fastest_spring_of_many_is_found():
    n = 40
    x = np.zeros((n, 3))
    x[:, 0] = np.arange(n)
    pairs = [(i, i + 1) for i in range(0, n, 2)]
    stiffness = np.linspace(1.0, 50.0, n // 2)
    system = kd.System(x, forces=[kd.Springs(pairs, stiffness, 1.0)])
    sim = kd.Simulation(system, "leapfrog", dt=0.01)
    assert fastest(sim.integration.flow, 0.0, system.state.phase) == pytest.approx(10.0, rel=0.1)  # sqrt(2 k / m)


# --- a Problem's run ---


def swing(t, y):
    return [y[1], -y[0]]


def test_a_problem_takes_other_run_defaults():
    problem = kd.Problem(swing, [1.0, 0.0], separable=True, run=RunDefaults("leapfrog", 0.1, 50))
    changed = problem.with_run(dt=0.2, time=3.0)
    assert (changed.run.dt, changed.run.steps, changed.run.time) == (0.2, None, 3.0)
    assert (problem.run.dt, problem.run.steps) == (0.1, 50)


def test_an_ensemble_of_a_problem_heeds_dt_and_steps():
    pytest.importorskip("distributed")
    from kickdrift.ensemble.members import members_of
    from kickdrift.ensemble.recipe import Recipe, SystemMaker
    from kickdrift.ensemble.work import run_member

    recipe = Recipe(SystemMaker("swing", kd.Problem(swing, [1.0, 0.0])), {"integrator": "rk4", "steps": 10})
    rows = [run_member(recipe, member) for member in members_of({"dt": [0.1, 0.2]}, 1, 0)]
    assert [row["error"] for row in rows] == ["", ""]
    assert [row["time"] for row in rows] == pytest.approx([1.0, 2.0])
    assert [row["y0"] for row in rows] == pytest.approx([math.cos(1.0), math.cos(2.0)], abs=1e-4)


def test_a_name_of_another_kind_among_many_is_refused_by_its_place():
    for wrong in (True, None, 1.5, ["A"]):
        with pytest.raises(kd.InputError, match=r"species\[2\]: expected a name, got"):
            kd.System([[0.0] * 3, [1.0] * 3, [2.0] * 3], species=["A", 1, wrong])
    system = kd.System([[0.0] * 3, [1.0] * 3, [2.0] * 3], species=["A", 1, np.str_("A")])
    assert system.species == ("A", "1")
    assert system.species_index.tolist() == [0, 1, 0]
    assert all(type(name) is str for name in system.species)
