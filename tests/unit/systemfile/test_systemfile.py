"""System files: the Systems they make, and one line for each bad file."""

import os
import tomllib
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.forces import FORCES
from kickdrift.systemfile import files
from kickdrift.systemfile import reading as systemfile
from kickdrift.systemfile.files import describe, shipped, toml_table
from kickdrift.systemfile.reading import load, loads
from kickdrift.systemfile.templates import template
from kickdrift.text import choices

GOOD = """
units = "lj"
[particles]
lattice = "sc"
count = 216
density = 0.8
mass = 1.0
[velocities]
temperature = 1.44
seed = 1
[box]
periodic = true
[[force]]
type = "lennard-jones"
cutoff = 2.5
truncation = "shift"
[run]
integrator = "velocity-verlet"
dt = 0.005
steps = 100
every = 10
"""
METAL = """
units = "metal"
[particles]
lattice = "fcc"
count = 256
density = "1.374 g/cm3"
mass = "39.948 u"
species = "Ar"
[[force]]
type = "lennard-jones"
epsilon = "120 K"
sigma = "3.4 angstrom"
cutoff = "7.65 angstrom"
"""
PAIR = """
units = "lj"
force = [{ type = "lennard-jones" }]
[particles]
positions = [[0.0, 0.0, 0.0], [1.5, 0, 0]]
"""
ODE = """
title = "Prey and predators"
[ode]
problem = "lotka-volterra"
alpha = 2
y0 = [3.0, 1]
[run]
integrator = "dop853"
time = 20
rtol = 1e-9
"""


def changed(text, old, new):
    assert old in text
    return text.replace(old, new, 1)


def temperature(system):
    kinetic = 0.5 * (system.coherent_masses * (system.state.velocities**2).sum(axis=1)).sum()
    return 2 * kinetic / (system.degrees_of_freedom * system.units.boltzmann)


@pytest.mark.parametrize("name", [name for name in shipped() if not name.startswith("ode-")])
def test_every_shipped_system_loads_and_says_what_it_is(name):
    system = load(name)
    assert system.name == name
    assert system.source == shipped()[name].read_text(encoding="utf-8")
    assert system.forces or system.events
    assert system.run.dt
    assert system.run.steps
    assert system.invariants["source"]
    moves = any(force.name == "galaxy" for force in system.forces)  # a cluster on its orbit
    assert moves or np.abs(system.state.masses @ system.state.velocities).max() < 1e-10
    about = describe(shipped()[name])
    assert (about.name, about.units) == (name, system.units.name)
    assert about.title


def test_the_lennard_jones_benchmark():
    system = load("lj-1000")
    assert len(system) == 1000
    assert 1000 / system.box.volume == pytest.approx(0.8442, rel=1e-14)
    assert temperature(system) == pytest.approx(1.44, rel=1e-13)
    assert system.seed == 1
    x = system.state.positions
    r2 = (system.box.minimum_image(x - x[0])[1:] ** 2).sum(axis=1)
    r2 = r2[r2 < 2.5**2]
    potential = 500 * (4 * (r2**-6 - r2**-3) - 4 * (2.5**-12 - 2.5**-6)).sum()
    assert potential + 1.5 * 999 * 1.44 == pytest.approx(system.invariants["energy"], abs=1e-7)


def test_rahmans_argon():
    system = load("argon-864")
    assert system.box.lengths == (34.78, 34.78, 34.78)
    assert system.species == ("Ar",)
    assert temperature(system) == pytest.approx(94.4, rel=1e-13)
    (force,) = system.forces
    assert force.sigma == 3.4
    assert force.cutoff == 7.65
    assert force.epsilon == pytest.approx(120 * 8.617333262e-5, rel=1e-9)
    assert system.run.dt == 0.01
    assert system.equilibration.time == 20.0


def test_the_binary_mixture_has_its_published_pairs():
    system = load("lj-binary-1000")
    assert np.bincount(system.species_index)[system.species.index("B")] == 200
    (force,) = system.forces
    assert force.pair_law("A", "A") == (1.0, 1.0)
    assert force.pair_law("B", "A") == (1.5, 0.8)
    assert force.pair_law("B", "B") == (0.5, 0.88)


def test_two_bodies_stand_at_pericentre():
    system = load("two-body")
    x, v, m = system.state.positions, system.state.velocities, system.state.masses
    energy = 0.5 * m @ (v**2).sum(axis=1) - m.prod() / np.linalg.norm(x[1] - x[0])
    assert energy == pytest.approx(system.invariants["energy"], rel=1e-15)
    assert m @ np.cross(x, v) == pytest.approx(system.invariants["angular_momentum"], rel=1e-15)


def test_units_convert_at_the_border():
    system = loads(METAL)
    assert 256 * 39.948 / system.box.volume == pytest.approx(1.374 / 1.66053906892, rel=1e-12)
    lengths = changed(METAL, 'density = "1.374 g/cm3"\n', "") + '[box]\nlengths = ["2.5 nm", 25.0, "25 angstrom"]\n'
    assert loads(lengths).box.lengths == pytest.approx((25, 25, 25), rel=1e-15)
    more = loads(METAL + '[run]\ndt = "10 fs"\ntime = "2 ps"\n[equilibrate]\ntemperature = "94.4 K"\ntime = 1\n')
    assert (more.run.dt, more.run.time) == (0.01, 2.0)
    assert (more.equilibration.time, more.equilibration.interval) == (1.0, 10)


def test_the_box():
    assert loads(PAIR).box.lengths is None
    assert loads(PAIR + "[box]\nlengths = [6, 7.0, 8]\n").box.lengths == (6, 7, 8)
    assert loads(changed(GOOD, "periodic = true", "periodic = false")).box.lengths is None
    assert loads(changed(GOOD, "periodic = true", "lengths = [9.0, 9.0, 20.0]")).box.lengths == (9, 9, 20)


def test_explicit_arrays_species_and_masses():
    system = loads(
        changed(PAIR, "[1.5, 0, 0]]", '[1.5, 0, 0]]\nspecies = ["B", "A"]\nmass = { A = 2.0, B = 3.0 }')
        + "[velocities]\nvalues = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]\n"
    )
    assert system.species == ("B", "A")
    assert system.state.masses.tolist() == [3.0, 2.0]
    assert system.state.velocities.tolist() == [[1, 0, 0], [0, 1, 0]]


POLYMER = template("polymer")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[topology]\nchains = { count = 40, length = 20 }", "", "particles.walks: expected [topology] chains = {"),
        ("length = 20 }", "length = 1 }", "topology.chains.length: expected a number greater than or equal to 2"),
        ("apart = 1.02", "apart = 2.0", "particles.walks.apart: expected 0 or more, and less than two bonds"),
        ("bond = 0.97", "bond = -1", "particles.walks.bond: expected a positive length, got -1"),
        ("density = 0.85\n", "", "particles.density: expected density or box.lengths, got neither"),
        ("[velocities]", "[box]\nlengths = [9, 9, 9]\n[velocities]", "density or box.lengths, got both"),
        ("mass = 1.0", 'species = ["A", "B"]', "particles.species: expected one name, or a list of 20"),
        ("seed = 1  # draws", "# draws", "particles.seed: required key is missing"),
        ('units = "lj"', 'units = "lj"\ndimensions = 2', "particles.walks: expected 3 dimensions, got 2"),
        ("minimize = { soft = true, force = 1.0 }", "steps = 5", "overlap: distance 0.05"),
    ],
)
def test_a_melt_of_random_chains_that_is_wrong_is_one_line(old, new, message):
    assert message in message_of(changed(POLYMER, old, new))


def test_random_chains_fill_their_box():
    melt = loads(POLYMER, name="mine")
    assert len(melt) / melt.box.volume == pytest.approx(0.85)
    boxed = changed(POLYMER, "density = 0.85\n", 'species = ["E", "M", "M", "E"]\n')
    boxed = changed(boxed, "[velocities]", "[box]\nlengths = [20, 9, 7]\n[velocities]")
    boxed = loads(changed(boxed, "length = 20 }", "length = 4 }"), name="mine")
    assert boxed.species_index.reshape(40, 4).tolist() == [[0, 1, 1, 0]] * 40
    first = boxed.state.positions[::4]
    assert boxed.box.lengths == (20, 9, 7)
    np.testing.assert_allclose(first.max(axis=0), boxed.box.lengths, rtol=0.1)


def test_the_seed_can_be_replaced():
    assert (load("lj-1000", seed=1).state.velocities == load("lj-1000").state.velocities).all()
    other = load("lj-1000", seed=2)
    assert other.seed == 2
    assert (other.state.velocities != load("lj-1000").state.velocities).any()
    with pytest.warns(UserWarning, match="^seed: this system draws nothing at random, so the seed has no effect"):
        assert load("two-body", seed=2).seed is None


def test_a_structure_file_beside_the_system_file(tmp_path):
    ase = pytest.importorskip("ase")
    from ase.io import write

    write(tmp_path / "start.extxyz", ase.Atoms("Ar2", [[1, 1, 1], [5, 1, 1]], cell=[20, 21, 22], pbc=True))
    path = tmp_path / "argon.toml"
    path.write_text('units = "metal"\nforce = []\n[particles]\nfile = "start.extxyz"\n')
    system = load(path)
    assert system.box.lengths == pytest.approx((20, 21, 22))
    assert system.species == ("Ar",)
    assert system.state.masses == pytest.approx([39.95, 39.95], abs=0.01)
    path.write_text('units = "lj"\nforce = []\n[particles]\nfile = "start.extxyz"\n')
    with pytest.raises(
        InputError, match=r'argon\.toml: particles\.file: .* expected units = "metal", "real" or "gromacs", got "lj"'
    ):
        load(str(path))


def test_a_new_force_is_checked_once_it_is_registered(monkeypatch):
    class Spring:
        name = "spring"
        dimensions = {"length": "length"}  # noqa: RUF012

        def __init__(self, stiffness: float, length: float = 1.0, both: bool = False) -> None:
            self.given = (stiffness, length, both)

        def check(self, system):
            pass

    monkeypatch.setitem(FORCES, "spring", Spring)
    text = changed(METAL, METAL[METAL.index("type") :], 'type = "spring"\nstiffness = 2\nlength = "1 nm"\n')
    assert loads(text).forces[0].given == (2.0, 10.0, False)
    for old, new, message in [
        ("stiffness = 2\n", "", "force[0].stiffness: required key is missing"),
        ("stiffness", "stifness", "force[0].stifness: unknown key; did you mean 'stiffness'?"),
        ('"1 nm"', '"1 K"', "force[0].length: expected a length"),
        ("stiffness = 2", "stiffness = true", "force[0].stiffness: expected a plain number, got True"),
    ]:
        assert message in message_of(changed(text, old, new))


def message_of(text):
    with pytest.raises(InputError) as error:
        loads(text, name="mine")
    message = str(error.value)
    assert message.startswith("mine: ")
    assert "\n" not in message
    return message


BAD = [
    (
        GOOD,
        'units = "lj"',
        "",
        "units: required key is missing; expected one of lj, metal, real, gromacs, si, astro, stellar, galactic, nbody",
    ),
    (
        GOOD,
        '"lj"',
        '"LJ"',
        "expected one of lj, metal, real, gromacs, si, astro, stellar, galactic, nbody, got 'LJ'; did you mean 'lj'?",
    ),
    (GOOD, '"lj"', "3", "units: expected one of lj, metal, real, gromacs, si, astro, stellar, galactic, nbody, got 3"),
    (
        GOOD,
        '"lj"',
        "[1]",
        "units: expected one of lj, metal, real, gromacs, si, astro, stellar, galactic, nbody, got [1]",
    ),
    (GOOD, "[box]", "[bx]", "bx: unknown key; did you mean 'box'? (known: box, …"),
    (GOOD, "[particles]", "[particle]", "particle: unknown key; did you mean 'particles'?"),
    (GOOD, "count", "cuont", "particles.cuont: unknown key; did you mean 'count'?"),
    (GOOD, "count = 216", "", "particles.count: required key is missing"),
    (GOOD, "count = 216", "count = 216.0", "particles.count: expected a whole number, got 216.0"),
    (GOOD, "count = 216", "count = true", "particles.count: expected a whole number, got True"),
    (GOOD, "count = 216", "count = -8", "particles.count: expected a number greater than 0, got -8"),
    (GOOD, "count = 216", "count = 1001", "particles.count: 1001 does not fill a sc lattice in a cube; the nearest"),
    (
        GOOD,
        '"sc"',
        '"hcp"',
        "particles.lattice: expected 'sc', 'bcc', 'fcc', 'diamond', 'rock-salt', 'caesium-chloride', 'zincblende', "
        "'square' or 'hexagonal', got",
    ),
    (GOOD, 'lattice = "sc"', "", "particles: expected a table with exactly one of lattice, walks, positions"),
    (GOOD, "count", "positions = [[1, 1, 1]]\ncount", "particles: expected a table with exactly one of lattice,"),
    (GOOD, "0.8\n", "nan\n", "particles.density: expected a finite number, got nan"),
    (GOOD, "0.8\n", "0\n", "particles.density: expected a positive finite number, got 0.0"),
    (GOOD, "0.8\n", '"1.374 g/cm3"\n', "particles.density: lj quantities are plain numbers, got '1.374 g/cm3'"),
    (GOOD, "0.8\n", "[1]\n", "particles.density: expected a number density or a mass density, got [1]"),
    (GOOD, "density = 0.8", "", "particles.density: required key is missing (or box.lengths"),
    (GOOD, "mass = 1.0", "mass = -1.0", "particles.mass: expected a non-negative mass, got -1.0"),
    (GOOD, "mass = 1.0", "mass = inf", "particles.mass: expected a finite number, got inf"),
    (GOOD, "mass = 1.0", "mass = { B = 1.0 }", "particles.mass: species 'A' has no mass"),
    (GOOD, "mass = 1.0", "mass = { A = 1, B = 1 }", "particles.mass: no particle is of species 'B'"),
    (GOOD, "mass = 1.0", "species = 3", "particles.species: expected a name, a list of names, or fractions"),
    (GOOD, "mass = 1.0", "species = { A = 0.5, B = 0.6 }", "particles.species: expected positive fractions that add"),
    (GOOD, "mass = 1.0", "species = { A = 0.5, B = 0.5 }", "particles.seed: required key is missing; a mixture"),
    (GOOD, "temperature = 1.44", "temperature = -1", "velocities.temperature: expected a non-negative temperature"),
    (GOOD, "temperature = 1.44", 'temperature = "hot"', "velocities.temperature: lj quantities are plain numbers"),
    (GOOD, "temperature = 1.44", "", "velocities: expected exactly one of temperature, values, got none"),
    (GOOD, "seed = 1", "", "velocities: seed and temperature need each other"),
    (GOOD, "seed = 1", "seed = 1.5", "velocities.seed: expected a whole number, got 1.5"),
    (GOOD, "[box]\nperiodic", "[box]\nperiodc", "box.periodc: unknown key; did you mean 'periodic'?"),
    (GOOD, "periodic = true", 'periodic = "yes"', "box.periodic: expected true or false, got 'yes'"),
    (GOOD, "periodic = true", "lengths = [9.0, 9.0]", "box.lengths: expected 3 items, got 2"),
    (GOOD, "periodic = true", "lengths = [9.0, 9.0, -9]", "box.lengths[2]: expected a positive length, got -9"),
    (GOOD, "periodic = true", "lengths = [9.0, 3.0, 9.0]", "box.lengths[1]: expected at least 6.46330407"),
    (GOOD, "periodic = true", "periodic = false\nlengths = [9, 9, 9]", "box: lengths make a box periodic"),
    (GOOD, "[[force]]", "[force]", "force: expected a list of tables [[force]], got {'type'"),
    (GOOD, GOOD[GOOD.index("[[force") : GOOD.index("[run]")], "", "force: required key is missing"),
    (GOOD, 'type = "lennard-jones"', "", "force[0].type: required key is missing; expected one of lennard-jones,"),
    (GOOD, "lennard-jones", "lenard-jones", "got 'lenard-jones'; did you mean 'lennard-jones'?"),
    (GOOD, "cutoff", "cutof", "force[0].cutof: unknown key; did you mean 'cutoff'?"),
    (GOOD, "cutoff = 2.5", "cutoff = -2.5", "force[0]: lennard-jones: cutoff must be a positive length, got -2.5"),
    (GOOD, "cutoff = 2.5", "cutoff = [2.5]", "force[0].cutoff: expected a length as a plain number, got [2.5]"),
    (GOOD, "cutoff = 2.5", "cutoff = nan", "force[0].cutoff: expected a finite number, got nan"),
    (GOOD, "cutoff = 2.5", "cutoff = 3.5", "lennard-jones: box edge x is 6.4633, shorter than twice the cutoff"),
    (GOOD, "cutoff = 2.5", "tail = 1", "force[0].tail: expected true or false, got 1"),
    (GOOD, "cutoff = 2.5", "species.A.sigm = 1.0", "force[0].species.A.sigm: unknown key; did you mean 'sigma'?"),
    (GOOD, "cutoff = 2.5", 'pairs = [{ species = ["A"] }]', "force[0].pairs[0].species: expected 2 items, got 1"),
    (GOOD, "cutoff = 2.5", "pairs = [{ sigma = 1 }]", "force[0].pairs[0].species: required key is missing"),
    (
        GOOD,
        "cutoff = 2.5",
        'pairs = [{ species = ["A", "B"] }, { species = ["B", "A"] }]',
        "force[0].pairs[1].species: the pair B-A is given twice",
    ),
    (GOOD, "shift", "shft", "force[0]: lennard-jones: truncation 'shft' is not one of cut, shift,"),
    (GOOD, "dt = 0.005", "dt = 0", "run.dt: expected a positive time, got 0"),
    (GOOD, "dt = 0.005", 'dt = "10 fs"', "run.dt: lj quantities are plain numbers, got '10 fs'"),
    (GOOD, "every = 10", "every = 0", "run.every: expected a number greater than 0, got 0"),
    (GOOD, "every = 10", "time = 1.0", "run: expected steps or time, got both"),
    (GOOD, "every = 10", "evry = 10", "run.evry: unknown key; did you mean 'every'?"),
    (
        GOOD,
        "[run]",
        "[equilibrate]\ntime = 1.0\n[run]",
        "equilibrate.temperature: is missing, and [run] has no heat bath",
    ),
    (GOOD, "[run]", "[[run]]", "run: expected a table, got [{"),
    (GOOD, '"velocity-verlet"', "1", "run.integrator: expected text in quotes, got 1"),
    (GOOD, "[run]", "[run", "not valid TOML: "),
    (METAL, 'mass = "39.948 u"', "", "particles.mass: required key is missing; units 'metal' have no default mass"),
    (METAL, '"39.948 u"', '"39.948"', "particles.mass: missing unit in '39.948'; expected a mass such as"),
    (METAL, '"39.948 u"', '"39.948 K"', "particles.mass: expected a mass such as \"39.948 u\", got '39.948 K'"),
    (METAL, '"3.4 angstrom"', '"3.4 K"', "force[0].sigma: expected a length such as \"3.4 angstrom\", got '3.4 K'"),
    (METAL, '"3.4 angstrom"', '"3.4 angstrm"', "force[0].sigma: unknown unit 'angstrm'; did you mean 'angstrom'?"),
    (METAL, "g/cm3", "K", "particles.density: expected a density such as"),
    (PAIR, "[1.5, 0, 0]", "[1.5, 0]", "particles.positions[1]: expected 3 items, got 2"),
    (PAIR, "[1.5, 0, 0]", "[1.5, 0, nan]", "particles.positions[1][2]: expected a finite number, got nan"),
    (PAIR, "[1.5, 0, 0]", "3", "particles.positions[1]: expected a list, got 3"),
    (PAIR, "[1.5, 0, 0]]", "[1.5, 0, 0]]\nmasses = [1.0]", "particles.masses: expected 2, one for each position, got"),
    (PAIR, "[1.5, 0, 0]]", "[1.5, 0, 0]]\nmasses = [1, -1]", "particles.masses[1]: expected a non-negative mass"),
    (PAIR, "[1.5, 0, 0]]", '[1.5, 0, 0]]\nnames = ["Sun"]', "particles.names: expected 2, one for each"),
    (PAIR, "[1.5, 0, 0]]", '[1.5, 0, 0]]\nnames = ["Sun", "Sun"]', "particles.names: particle 1 is called 'Sun'"),
    (PAIR, "[1.5, 0, 0]]", '[1.5, 0, 0]]\nspecies = ["A"]', "particles.species: expected one name or 2, got 1"),
    (PAIR, "[1.5, 0, 0]]", "[1.5, 0, 0]]\n[box]\nperiodic = true", "box.lengths: required key is missing; nothing"),
    (PAIR, "[1.5, 0, 0]]", "[1.5, 0, 0]]\n[velocities]\nvalues = [[1, 1, 1]]", "velocities: expected shape (2, 3)"),
    (PAIR, "[1.5, 0, 0]", "[0.2, 0, 0]", "particles 0 and 1 overlap: distance 0.2, less than 0.3 of the shortest"),
    (PAIR, "[1.5, 0, 0]", "[0, 0, 0]", "positions: particles 0 and 1 are at the same place, distance 0"),
    (PAIR, ", [1.5, 0, 0]]", "]\n[velocities]\ntemperature = 1\nseed = 1", "velocities.temperature: needs two or more"),
    (PAIR, "positions = [[0.0, 0.0, 0.0], [1.5, 0, 0]]", "positions = []", "particles.positions: expected 1 or more"),
]


BAD_ODE = [
    ("lotka-volterra", "lotka-voltera", "ode.problem: expected one of harmonic-oscillator, pendulum, kepler,"),
    ("lotka-volterra", "lotka-voltera", "got 'lotka-voltera'; did you mean 'lotka-volterra'?"),
    ('problem = "lotka-volterra"', "problem = 3", "ode.problem: expected one of harmonic-oscillator,"),
    ('problem = "lotka-volterra"', "", "ode.problem: required key is missing; expected one of harmonic-oscillator,"),
    ("[ode]", "[[ode]]", "ode: expected a table, got [{"),
    ("alpha", "alhpa", "ode.alhpa: unknown key; did you mean 'alpha'? (known: problem, y0, alpha, beta,"),
    ("alpha = 2", 'alpha = "2"', "ode.alpha: expected a valid number, got '2'"),
    ("alpha = 2", "alpha = true", "ode.alpha: expected a valid number, got True"),
    ("alpha = 2", "alpha = nan", "ode.alpha: expected a finite number, got nan"),
    ("alpha = 2", "t0 = inf", "ode.t0: expected a finite number, got inf"),
    ("[3.0, 1]", "3.0", "ode.y0: expected a list, got 3.0"),
    ("[3.0, 1]", "[3.0]", "ode.y0: expected 2 numbers, got 1"),
    ("[3.0, 1]", "[3.0, 1.0, 2.0]", "ode.y0: expected 2 numbers, got 3"),
    ("[3.0, 1]", "[3.0, nan]", "ode.y0[1]: expected a finite number, got nan"),
    ("[3.0, 1]", "[3.0, 0]", "ode.y0: expected populations above 0, got [3.0, 0.0]"),
    ("[run]", "[particles]\nlattice = 'sc'\n[run]", "particles: not allowed in an ODE file; allowed beside ode"),
    ("[run]", "[[force]]\ntype = 'gravity'\n[run]", "force: not allowed in an ODE file; allowed beside ode: title"),
    ("[run]", "[box]\n[run]", "box: not allowed in an ODE file"),
    ("[run]", "[velocities]\nseed = 1\n[run]", "velocities: not allowed in an ODE file"),
    ("[run]", "[equilibrate]\n[run]", "equilibrate: not allowed in an ODE file"),
    ("title", "units = 'lj'\ntitle", "units: not allowed in an ODE file"),
    ("[run]", "[rnu]", "rnu: unknown key; did you mean 'run'? (known: title, ode, run, invariants)"),
    ("time = 20", "time = -20", "run.time: expected a number greater than 0, got -20"),
    ("time = 20", 'time = "20 s"', "run.time: expected a valid number, got '20 s'"),
    ("time = 20", "tmie = 20", "run.tmie: unknown key; did you mean 'time'?"),
    ("rtol = 1e-9", "rtol = 0", "run.rtol: expected a number greater than 0, got 0"),
    ("rtol = 1e-9", "steps = 3", "run: expected steps or time, got both"),
]


@pytest.mark.parametrize(("old", "new", "message"), BAD_ODE, ids=range(len(BAD_ODE)))
def test_a_bad_ode_file_gets_one_line_that_names_the_key(old, new, message):
    assert message in message_of(changed(ODE, old, new))


def test_an_ode_file():
    problem = loads(ODE, name="mine")
    assert (problem.name, problem.equation, problem.source) == ("mine", "lotka-volterra", ODE)
    assert problem.parameters == {"alpha": 2.0, "beta": 1.0, "gamma": 3.0, "delta": 1.0}
    assert problem.y0.tolist() == [3.0, 1.0]
    assert problem.f(0.0, problem.y0) == (3.0, 0.0)
    assert (problem.run.integrator, problem.run.time, problem.run.options["rtol"]) == ("dop853", 20.0, 1e-9)
    assert loads(changed(ODE, "alpha = 2", "t0 = -3")).t0 == -3.0
    with pytest.warns(UserWarning, match="^seed: this system draws nothing at random, so the seed has no effect"):
        loads(ODE, name="mine", seed=1)


@pytest.mark.parametrize(("text", "old", "new", "message"), BAD, ids=range(len(BAD)))
def test_a_bad_file_gets_one_line_that_names_the_key(text, old, new, message):
    assert message in message_of(changed(text, old, new))


JUNK = st.recursive(
    st.booleans() | st.integers() | st.floats() | st.text(max_size=9),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=4,
)
GOOD_DATA = tomllib.loads(GOOD)
PATHS = [(table, key) for table in ("particles", "velocities", "box", "run") for key in GOOD_DATA[table]]
PATHS += [("force", 0, key) for key in ("epsilon", "sigma", "cutoff", "truncation", "tail", "species", "pairs", "type")]
PATHS += [("force", 0, "mixing"), ("force",), ("units",), ("title",), ("invariants",)]


@given(st.sampled_from([*((table,) for table, *_ in PATHS), *PATHS]), JUNK)
@settings(deadline=None, max_examples=200)
def test_whatever_stands_at_a_key_builds_or_is_one_line(path, junk):
    data = tomllib.loads(GOOD)
    table = data
    for key in path[:-1]:
        table = table[key]
    table[path[-1]] = junk
    if path == ("particles", "count") and isinstance(junk, int) and junk > 10**6:
        return
    line = ""
    try:
        systemfile._system(data, shipped()["lj-1000"], "", None)
    except InputError as error:
        line = str(error)
    assert "\n" not in line


@pytest.mark.parametrize("part", ["a", '"a b"', "''", ' "\\"" '])
def test_a_key_of_many_parts_is_refused_before_it_is_parsed(part):
    key = ".".join([part] * 20_000)
    for text in (f"{key} = 1\n", f"[{key}]\n", f"x = [1.5, {{ {key} = 2 }}]\n", f'x = """\n"a" """\n{key} = 1\n'):
        with pytest.raises(InputError, match="a key has more than 32 parts"):
            loads(text)
    dots = "1.2." * 100
    for text in (f"# {dots}\n", f"x = '{dots}'\n", f'x = """{dots}\n{dots}"""\n', f"x = [{'1.5,' * 100}]\n"):
        assert toml_table(text) == tomllib.loads(text)


def test_a_dict_that_holds_itself_is_one_line():
    whole: dict[str, Any] = {"units": "lj"}
    whole["particles"] = whole
    rows: list[Any] = []
    rows.append(rows)
    for data in (whole, {"units": "lj", "force": rows}):
        with pytest.raises(InputError, match="nested more than 32 deep"):
            load(data)


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("", "expected a name, got ''"),
        (" ", "expected a name, got ' '"),
        ("a\x1b[31m", "a name without control characters"),
        ("a\0b", "a name without control characters"),
        ("\udcff", "a name without control characters"),
        ("a" * 256, "at most 255 letters, got 256: 'aaa"),
    ],
)
def test_names_are_checked_when_they_are_read(name, why):
    for key in ("species", "names"):
        with pytest.raises(InputError) as refused:
            kd.System(np.eye(3), **{key: ["B", name, "C"]})
        assert str(refused.value).startswith(f"{key}[1]: ")
        assert why in str(refused.value)
        assert len(str(refused.value)) < 200
    with pytest.raises(InputError, match="crossing: name"):
        kd.Crossing(lambda sim: 1.0, name=name)
    assert kd.System(np.eye(2, 3), species=["Ä" * 255, "水 1"]).species == ("Ä" * 255, "水 1")


def test_more_species_than_a_file_can_name_are_refused_before_the_run(tmp_path):
    system = kd.System(np.eye(300, 3), species=[f"{k:0255}" for k in range(300)])
    with pytest.raises(InputError, match="cannot hold 300 species, whose names take 78,000 bytes"):
        kd.Simulation(system, dt=0.1).run(1, output=tmp_path / "run.h5md")
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(not os.path.exists("/proc/self/mem"), reason="needs Linux")
@pytest.mark.parametrize("read", [kd.load, kd.open])
def test_a_file_that_the_system_cannot_read_is_one_line(read):
    with pytest.raises(InputError, match="/proc/self/mem: cannot be read"):
        read("/proc/self/mem")


def test_files_that_are_not_there(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    (tmp_path / "folder.toml").mkdir()
    for given_path, message in [
        ("lj-100", "'lj-100' is neither a file nor a shipped system; did you mean 'lj-1000'? (kickdrift list "),
        ("lj-1000.toml", "lj-1000.toml: no such file; did you mean 'lj-1000'?"),
        (tmp_path / "none.toml", "none.toml: no such file"),
        ("folder.toml", "folder.toml: is a folder, not a system file"),
        ("binary.toml", "binary.toml: not a text file in UTF-8"),
        ("", "is neither a file nor a shipped system"),
    ]:
        with pytest.raises(InputError) as error:
            load(given_path)
        assert message in str(error.value)


def test_a_path_to_a_file_of_any_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine").write_text("\ufeff# My own melt\r\n" + GOOD, encoding="utf-8")
    assert load("mine").name == "mine"
    assert describe("mine").title == "My own melt"


def test_an_installed_wheel_brings_its_systems_inside_the_package(tmp_path, monkeypatch):
    (tmp_path / "systems").mkdir()
    (tmp_path / "systems" / "melt.toml").write_text(GOOD)
    monkeypatch.setattr(files, "__file__", str(tmp_path / "systemfile" / "files.py"))
    assert list(shipped()) == ["melt"]
    assert len(load("melt")) == 216


def test_long_lists_of_names_are_cut_and_begin_with_the_nearest():
    known = [f"law-{k}" for k in range(40)] + ["gravity"]
    assert choices(known[:3]) == "law-0, law-1, law-2"
    assert choices(known, "gravty").startswith("gravity, ")
    assert choices(known, "gravty").endswith("… (41 in all)")
    assert choices(known) == "law-0, law-1, law-2, law-3, law-4, law-5, … (41 in all)"
    assert len(choices(["a" * 10_000] * 12, "b")) < 12 * 63


def test_an_unknown_force_names_the_nearest():
    with pytest.raises(InputError) as refused:
        loads(GOOD.replace('"lennard-jones"', '"lennard-jonez"'))
    assert "force[0].type: expected one of lennard-jones, " in str(refused.value)
    assert len(str(refused.value)) < 250
