"""Hints for names of other programs: they name what is there, they reach every message, and they change nothing."""

from __future__ import annotations

import inspect
import re

import pytest

import kickdrift as kd
from kickdrift.engines import ENGINES, engine
from kickdrift.errors import InputError
from kickdrift.forces import FORCES
from kickdrift.integrators import INTEGRATORS
from kickdrift.integrators import integrator as method_named
from kickdrift.integrators.asked import known_options
from kickdrift.model.checks.arguments import ROWS, TEMPERATURE, other_name
from kickdrift.model.units.quantities import quantity
from kickdrift.model.units.unit_systems import UNIT_SYSTEMS, unit_system
from kickdrift.systemfile.files import shipped
from kickdrift.systemfile.schema_base import AddedTable
from kickdrift.systemfile.schema_run import run_keys
from tests.refusals import assert_refused

RUN_ARGUMENTS = {"output", "seed", "threads"}  # of the command line and of Simulation
KNOWN = {
    "integrator": {*INTEGRATORS, *FORCES},
    "force": {*FORCES, "shift"},
    "units": {*UNIT_SYSTEMS},
    "unit": {"angstrom", "Msun", "hartree", "Da"},
    "system": {*shipped(), *FORCES},
    "engine": {*ENGINES},
    "body": {*AddedTable.model_fields},
    "argument": {*inspect.signature(kd.LennardJones).parameters},
    "option": {*run_keys(), *known_options(), *FORCES, *RUN_ARGUMENTS},
}
SYSTEM = """
units = "{units}"
[particles]
positions = [[0, 0, 0], [2, 0, 0]]
mass = 1
[[force]]
type = "{force}"
[run]
dt = 0.01
{more}
"""


@pytest.mark.parametrize("kind", ROWS)
def test_hints_name_what_is_there(kind):
    for _, text in ROWS[kind]:
        assert {*re.findall(r"'([\w-]+)'", text)} <= KNOWN[kind], text


@pytest.mark.parametrize("kind", ROWS)
def test_each_word_has_one_hint(kind):
    words = [word for words, _ in ROWS[kind] for word in words.split()]
    assert len(words) == len({*words})
    assert words == [word.lower() for word in words]


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("ias15", "rebound's ias15 is 'gauss-radau15' here"),
        ("IAS15", "rebound's IAS15 is 'gauss-radau15' here"),
        ("whfast", "rebound's whfast is 'wisdom-holman' here"),
        ("mercurius", "mercurius is 'trace' here"),
        ("RK45", "RK45 is 'dormand-prince45' here"),
        ("DOP853", "DOP853 is 'dop853' here"),
        ("velocity_verlet", "did you mean velocity-verlet"),
        ("verlet", "did you mean 'velocity-verlet', or 'stormer-verlet'"),
        ("nvt", TEMPERATURE),
        ("nose_hoover", "did you mean nose-hoover"),
        ("V-rescale", "V-rescale is 'csvr' here"),
        ("npt", "methods with a heat bath take pressure and barostat"),
        ("nothing-like-it", "see: kickdrift list integrators"),
    ],
)
def test_integrators_of_other_programs(name, hint):
    with pytest.raises(InputError) as error:
        method_named(name)
    assert f"integrator {name!r} is unknown; " in str(error.value)
    assert hint in str(error.value)


def test_words_that_nobody_knows_have_no_hint():
    for word in ("", "velocity-verlet", 15, None, "x" * 10_000, "\x1b[31m"):
        assert other_name("integrator", word) == ""


@pytest.mark.parametrize(
    ("values", "hint"),
    [
        ({"force": "LJ"}, "LJ is 'lennard-jones' here"),
        ({"force": "lj/cut"}, "lj/cut is 'lennard-jones' here"),
        ({"force": "ewald"}, "ewald is the force 'coulomb' here, or one of its methods"),
        ({"force": "pme"}, "pme is the force 'coulomb' here, with method = pme"),
        ({"force": "meam"}, "are 'eam', 'stillinger-weber' and 'tersoff', and the force 'ase' is any calculator of"),
        ({"force": "buck"}, "buck is 'buckingham' here"),
        ({"force": "soft-sphere"}, "soft-sphere is not shipped; kd.pair_law makes the force from its formula"),
        ({"units": "kpc"}, "kpc, Myr and Msun are 'galactic' here"),
        ({"units": "akma"}, "'real' is kcal/mol, angstrom and fs"),
        ({"units": "openmm"}, "kJ/mol, nm and ps are 'gromacs' here"),
        ({"units": "SI"}, "did you mean 'si'?"),
        ({"more": "timestep = 1"}, "run.timestep: unknown key; timestep is 'dt' here"),
        ({"more": "nsteps = 1"}, "nsteps is 'steps' here"),
        ({"more": "t_end = 1"}, "t_end is 'time' here"),
        ({"more": "thermostat = 1"}, TEMPERATURE),
        ({"more": "softening = 1"}, "softening is a parameter of the force 'gravity'"),
    ],
)
def test_system_files(values, hint, kickdrift, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    chosen = {"units": "lj", "force": "gravity", "more": ""} | values
    (tmp_path / "other.toml").write_text(SYSTEM.format(**chosen), encoding="utf-8")
    assert_refused(kickdrift("info", "other.toml"), hint)


@pytest.mark.parametrize(
    ("arguments", "hint"),
    [
        (["--nsteps", "5"], "nsteps is 'steps' here"),
        (["--tmax", "5"], "tmax is 'time' here"),
        (["-o", "tolerance=1e-3"], "tolerance is 'rtol' here"),
        (["--integrator", "janus"], "rebound's janus is not there"),
        (["--engine", "gromacs"], "kickdrift export writes frames for gromacs"),
    ],
)
def test_command_lines(arguments, hint, kickdrift, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert_refused(kickdrift("run", "two-body", *arguments), hint)


@pytest.mark.parametrize(
    ("option", "hint"), [("timestep", "timestep is 'dt' here"), ("steps", "steps belongs to Simulation.run")]
)
def test_options_of_a_simulation(option, hint):
    with pytest.raises(InputError, match=re.escape(hint)):
        kd.Simulation(kd.load("two-body"), dt=0.01, **{option: 1})


@pytest.mark.parametrize(
    ("key", "hint"),
    [
        ("m", "bodies[1].m: unknown key; m is 'mass' here"),
        ("i", "i is 'inc' here"),
        ("pomega", "give 'Omega', 'omega' and 'M' or 'f'"),
        ("vx", "System.with_body takes 'position' and 'velocity'"),
        ("p", "did you mean 'P'"),
    ],
)
def test_keys_of_a_body(key, hint):
    with pytest.raises(InputError, match=re.escape(hint)):
        kd.System.from_elements([{"mass": 1.0}, {"mass": 1e-3, "a": 1.0, key: 0.1}])


@pytest.mark.parametrize(
    ("argument", "hint"),
    [("rc", "rc is 'cutoff' here"), ("shift", "a kind of 'truncation'"), ("eps", "did you mean 'epsilon'")],
)
def test_arguments_of_a_force(argument, hint):
    with pytest.raises(InputError, match=re.escape(hint)):
        kd.LennardJones(**{argument: 2.5})


def test_engines_systems_and_units():
    with pytest.raises(InputError, match="'rebound' is"):
        engine("gadget")
    with pytest.raises(InputError, match="'kepler-e09'"):
        kd.load("kepler")
    with pytest.raises(InputError, match=r"unknown unit 'Msol' in '1 Msol'; write 'Msun'"):
        quantity("1 Msol", "mass", unit_system("astro"))


@pytest.mark.parametrize(
    ("text", "dimension", "units"),
    [
        ("2 fs", "time", "real"),
        ("2 bohr", "length", "metal"), ("1 cm", "length", "si"), ("1 g", "mass", "si"),
        ("5.9722e24 kg", "mass", "astro"), ("1.89813e27 kg", "mass", "astro"), ("6.957e8 m", "length", "astro"),
        ("6378.1 km", "length", "astro"),
    ],
)  # fmt: skip
def test_the_quantities_that_hints_propose(text, dimension, units):
    assert quantity(text, dimension, unit_system(units)) > 0
    assert any(text in hint for rows in ROWS.values() for _, hint in rows)
