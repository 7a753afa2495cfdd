"""Tables of energies: files of other programs, the curve through the points, refusals, and LAMMPS' own tables."""

from __future__ import annotations

import math
import pickle
import re
from pathlib import Path

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.engines.lammps_world import lammps_class
from kickdrift.errors import InputError
from kickdrift.forces.pairs.terms import force_over_r
from kickdrift.systemfile.reading import loads
from tests.long import rest
from tests.systems import liquid

DEGREE = math.pi / 180.0
R = np.linspace(0.7, 2.5, 4000)


def lennard_jones(r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Energy and force."""
    s6 = r**-6.0
    return 4.0 * (s6 * s6 - s6), 24.0 * (2.0 * s6 * s6 - s6) / r


def section(x: np.ndarray, energy: np.ndarray, force: np.ndarray, flags: str = "", first: str = "# a table") -> str:
    """Text of LAMMPS' table, whose section is called ONE."""
    rows = zip(range(1, len(x) + 1), x.tolist(), energy.tolist(), force.tolist(), strict=True)
    return f"{first}\n\nONE\nN {len(x)} {flags}\n\n" + "".join(f"{k} {a!r} {u!r} {f!r}\n" for k, a, u, f in rows)


def rows(count: int = 400) -> list[tuple[float, ...]]:
    r = np.linspace(0.7, 2.5, count)
    return list(zip(*(each.tolist() for each in (r, *lennard_jones(r))), strict=True))


@pytest.mark.parametrize("columns", [2, rest(3)])
def test_a_table_of_lennard_jones_is_exact_to_a_billionth(columns):
    table = np.column_stack([R, *lennard_jones(R)])[:, :columns]
    force = kd.Tabulated(table=table, truncation="cut")
    assert force.cutoff == 2.5
    r = np.random.default_rng(4).uniform(0.7, 2.5, 4000)
    energy, exact = lennard_jones(r)
    size = np.maximum(np.abs(exact), 1.0)
    found = np.array([force.law.law(each * each) for each in r.tolist()])
    assert np.abs(found[:, 1] * r - exact).max() > 0.0
    assert (np.abs(found[:, 1] * r - exact) / size).max() < 1e-10
    assert (np.abs(found[:, 0] - energy) / np.maximum(np.abs(energy), 1.0)).max() < 1e-10
    compiled = force_over_r(force, "A", "A", r * r)
    np.testing.assert_allclose(compiled, found[:, 1], rtol=1e-13, atol=1e-13)


@pytest.mark.long
def test_a_law_becomes_a_table_with_its_mixture_and_its_ends():
    law = kd.LennardJones(
        cutoff=2.5, truncation="shift", species={"A": {}, "B": {"epsilon": 0.5, "sigma": 0.88, "cutoff": 2.2}}
    )
    table = kd.Tabulated.of(law, start=0.6)
    start = liquid(216)
    species = ["AB"[k % 2] for k in range(216)]
    found = []
    for force in (law, table):
        system = kd.System(start.state.positions, masses=1.0, box=start.box, forces=[force], species=species)
        sim = kd.Simulation(system, dt=0.001)
        found.append((sim.forces(), sim.energy().potential, sim.sample().pressure))
    size = np.abs(found[0][0]).max()
    np.testing.assert_allclose(found[1][0], found[0][0], rtol=0, atol=1e-10 * size)
    assert found[1][1:] == pytest.approx(found[0][1:], rel=1e-9)
    assert table.pair_end("A", "B") == law.pair_end("A", "B")
    assert loads(
        kd.System([[0, 0, 0], [1, 0, 0]], masses=1.0, forces=[table], units="lj", species=["A", "B"]).to_toml()
    )


@pytest.mark.long
def test_a_table_goes_with_pickle_a_file_and_a_run_that_goes_on(tmp_path):
    (tmp_path / "lj.table").write_text(section(R, *lennard_jones(R)), encoding="utf-8")
    text = "[[force]]\ntype = 'tabulated'\nfile = 'lj.table'\ntruncation = 'force-shift'\n"
    start = "units = 'lj'\n[particles]\nlattice = 'sc'\ncount = 64\ndensity = 0.8\n[velocities]\ntemperature = 1.0\n"
    (tmp_path / "a.toml").write_text(f"{start}seed = 1\n[box]\nperiodic = true\n{text}cutoff = 1.9\n", encoding="utf-8")
    system = kd.load(tmp_path / "a.toml")
    force = system.forces[0]
    assert Path(force.file) == tmp_path / "lj.table"
    assert len(force.digest) == 64
    again = pickle.loads(pickle.dumps(force))
    assert again == force
    assert again.law.law(1.2) == force.law.law(1.2)
    whole = kd.Simulation(system, "velocity-verlet", 0.004)
    whole.run(20)
    kd.Simulation(system, "velocity-verlet", 0.004).run(10, every=5, output=tmp_path / "a.h5md")
    resumed = kd.resume(tmp_path / "a.h5md")
    resumed.run(10, every=5)
    np.testing.assert_array_equal(resumed.state.positions, whole.state.positions)
    (tmp_path / "lj.table").write_text(section(R, *lennard_jones(R), first="# changed"), encoding="utf-8")
    with pytest.raises(InputError, match=r"lj\.table has changed: its SHA-256"):
        kd.resume(tmp_path / "a.h5md")


FORMS = {
    "lammps": ("a.table", section(R, *lennard_jones(R)), {}),
    "lammps by r": ("a.table", section(0 * R, *lennard_jones(R), "R 0.7 2.5"), {"keyword": "ONE"}),
    "windows": ("a.table", section(R, *lennard_jones(R)).replace("\n", "\r\n"), {}),
    "fortran": (
        "a.dat", "\n".join(f"{a:.15e} {u:.15e} {f:.15e}  # row" for a, u, f in rows(4000)).replace("e", "D"), {},
    ),
    "columns": ("a.dat", "# r U\n" + "\n".join(f"{a!r}, {u!r}" for a, u, _ in rows(4000)), {}),
    "gromacs": (
        "a.xvg",
        "@ title 'x'\n0 0 0 0 0 0 0\n0.1 0 0 0 0 0 0\n"
        + "\n".join(
            f"{a!r} {1 / a!r} {a**-2!r} {-(a**-6)!r} {-6 * a**-7!r} {a**-12!r} {12 * a**-13!r}" for a in R.tolist()
        ),
        {"c6": 4.0, "c12": 4.0},
    ),
    "gromacs' three": ("a.xvg", "\n".join(f"{a!r} {u!r} {f!r}" for a, u, f in rows(4000)), {}),
    "units": ("a.table", section(10.0 * R, 2.0 * lennard_jones(R)[0], 0.2 * lennard_jones(R)[1], "", "# UNITS: real"),
              {"length_unit": 0.1, "energy_unit": 0.5}),
}  # fmt: skip


@pytest.mark.parametrize("name", FORMS)
def test_a_form_is_read(name, tmp_path):
    file, text, given = FORMS[name]
    (tmp_path / file).write_bytes(text.encode())
    force = kd.Tabulated(str(tmp_path / file), **given)
    r = np.linspace(0.75, 2.4, 7)
    found = np.array([force.law.law(each * each) for each in r.tolist()])
    energy, exact = lennard_jones(r)
    np.testing.assert_allclose(found[:, 0], energy, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(found[:, 1] * r, exact, rtol=1e-8, atol=1e-8)


BAD = {
    "falls": ({"table": rows()[::-1]}, r"tabulated: r must increase from row to row; .* in row 2 follows 2.5"),
    "zero": (
        {"table": [(0.0, 9.0), *(row[:2] for row in rows())]},
        r"begins at r = 0; the first distance must be above",
    ),
    "slope": (
        {"table": [(r, u, 1.01 * f) for r, u, f in rows()]},
        r"the force is not minus the slope of the energy: at r = .*; they differ by (1|0.99\d*) % of the largest force",
    ),
    "sign": ({"table": [(r, u, -f) for r, u, f in rows()]}, r"they differ by 2\d\d % of|they differ by 200 % of"),
    "few": ({"table": rows()[:4]}, r"has 4 rows; expected 5 or more"),
    "uneven": ({"table": [*rows(), (2.6, 0.0)]}, r"row 401 has 2 numbers, and row 1 has 3"),
    "nan": ({"table": [*(row[:2] for row in rows()), (2.6, math.nan)]}, r"row 401: the energy is nan"),
    "words": ({"table": "abc"}, r"table: expected rows of a place, an energy"),
    "cutoff": ({"table": rows(), "cutoff": 3.0}, r"cutoff is 3, and its table ends at 2.5"),
    "none": ({}, r"tabulated: table or file is needed"),
    "both": ({"table": rows(), "file": "a"}, r"give table or file, not both"),
    "missing": ({"file": "no.table"}, r"file: no.table: no such file"),
    "tail": ({"table": rows(), "tail": True, "truncation": "cut"}, r"tail: a table says nothing beyond its end"),
    "unit": ({"table": rows(), "length_unit": -1.0}, r"length_unit must be positive, got -1.0"),
    "digest": ({"table": rows(), "digest": "ab"}, r"the table has changed"),
    "keyword": ({"file": "a", "keyword": ["ONE"]}, r"keyword: expected text, got \['ONE'\]"),
    "factor": ({"table": rows(), "c6": 2.0}, r"c6 goes with file"),
    "nested": ({"table": [(1, [2]), *rows()]}, r"table: expected rows of two or three numbers"),
    "far": ({"table": rows(), "length_unit": 1e300}, r"r goes to 2.5e\+300; expected between 1e-60 and 1e\+60"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_table_is_refused(name):
    given, words = BAD[name]
    with pytest.raises(InputError, match=words) as error:
        kd.Tabulated(**given)
    assert "\n" not in str(error.value)


ONE = section(R, *lennard_jones(R))
CUT = {
    "cut off": (
        ONE[: len(ONE) // 2].rpartition("\n")[0],
        r"ONE: its header says 4000 rows, and the file ends after \d+",
    ),
    "in a row": (ONE[: len(ONE) // 2].rpartition(" ")[0], r"ONE: row \d+ has \d numbers; expected 4"),
    "word": (ONE.replace("\n7 ", "\nseven "), r"expected a number, got 'seven'|the file ends after 6"),
    "two": (ONE + ONE.replace("ONE", "TWO"), r"keyword is needed, one of ONE, TWO"),
    "bitmap": (ONE.replace("N 4000", "N 4000 BITMAP 1 2"), r"BITMAP: tables by the bits of r are not read"),
    "flag": (ONE.replace("N 4000", "N 4000 RSK 1 2"), r"unknown word 'RSK'"),
    "flags": (ONE.replace("N 4000", "N 4000 R 1"), r"R takes 2 numbers, and the line ends after 1"),
    "empty": ("", r"expected rows of two or three numbers"),
    "endless": (ONE.replace("N 4000", "N inf"), r"N must be a number of rows, got inf"),
    "beyond": (ONE.replace("N 4000", "N 4000 RSQ 1 1e300"), r"row \d+: the r is (inf|nan); expected a finite number"),
}


@pytest.mark.parametrize("name", CUT)
def test_a_bad_file_is_refused(name, tmp_path):
    text, words = CUT[name]
    (tmp_path / "a.table").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=words) as error:
        kd.Tabulated(str(tmp_path / "a.table"))
    assert "\n" not in str(error.value)
    assert "a.table" in str(error.value)


def two(force: object, apart: float, **given: object) -> kd.System:
    return kd.System([[0.0, 0.0, 0.0], [apart, 0.0, 0.0]], masses=1.0, forces=[force], **{"units": "lj", **given})


def test_a_table_of_angles_in_other_units(tmp_path):
    angles = np.linspace(0.0, 180.0, 91)
    np.savetxt(tmp_path / "a.xvg", np.column_stack([angles, 1e-3 * (angles - 100.0) ** 2, -2e-3 * (angles - 100.0)]))
    topology = kd.Topology([(0, 1), (1, 2)], angles=[(0, 1, 2)])

    def bent(units: str, **given: object) -> kd.System:
        force = kd.TabulatedAngle(str(tmp_path / "a.xvg"), **given)
        x = [[1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
        return kd.System(x, masses=1.0, forces=[force], units=units, topology=topology)

    with pytest.raises(InputError, match=r"has units 'real'; energy_unit says how large one unit of the table is"):
        bent("real")
    real, gromacs = bent("real", energy_unit="1 kJ/mol"), bent("gromacs")
    assert gromacs.energy().potential == pytest.approx(0.1, rel=1e-9)
    assert real.energy().potential == pytest.approx(0.1 / 4.184, rel=1e-9)
    assert gromacs.in_units("real").energy().potential == pytest.approx(0.1 / 4.184, rel=1e-9)


def test_the_rows_of_a_table_are_counted_not_shown():
    force = kd.Tabulated(pairs={("A", "B"): {"table": rows()}})
    assert repr(force) == "Tabulated(cutoff=2.5, pairs={('A', 'B'): {'table': (400 rows)}})"


def test_what_a_system_refuses(tmp_path):
    force = kd.Tabulated(table=rows())
    with pytest.raises(InputError, match=r"particles 0 and 1 are 0.6 apart, and the table of A-A begins at 0.7"):
        two(force, 0.6)
    two(force, 0.6, topology=kd.Topology([(0, 1)], factors=[0.0, 1.0, 1.0]))
    with pytest.raises(InputError, match=r"tabulated: takes no mixed precision: float32 cannot hold"):
        kd.Simulation(liquid(64).with_forces(kd.Tabulated(table=rows(), cutoff=1.5)), dt=0.001, precision="mixed")
    pairs = kd.Tabulated(pairs={("A", "A"): {"table": rows()}})
    with pytest.raises(InputError, match=r"tabulated: pair A-B has no table"):
        two(pairs, 1.0, species=["A", "B"])
    species = kd.Tabulated(species={"A": {"table": rows()}, "B": {"table": rows(300)}})
    with pytest.raises(InputError, match=r"tabulated: pair A-B is needed: only epsilon and sigma can be mixed"):
        two(species, 1.0, species=["A", "B"])
    (tmp_path / "a.xvg").write_text("\n".join(f"{r!r} {u!r} {f!r}" for r, u, f in rows()), encoding="utf-8")
    with pytest.raises(InputError, match=r"is GROMACS', in nm and kJ/mol, and the System has units 'metal'"):
        two(kd.Tabulated(str(tmp_path / "a.xvg")), 1.0, units="metal")
    (tmp_path / "a.table").write_text(ONE.replace("# a table", "# UNITS: real"), encoding="utf-8")
    with pytest.raises(InputError, match=r"says UNITS: real, and the System has units 'metal'; length_unit and energy"):
        two(kd.Tabulated(str(tmp_path / "a.table")), 1.0, units="metal")
    two(kd.Tabulated(str(tmp_path / "a.table"), length_unit=1.0, energy_unit=0.04), 1.0, units="metal")
    with pytest.raises(InputError, match=r"table: law must|Tabulated.of: law: expected a pair force"):
        kd.Tabulated.of(3.0)


X = np.array([[0.0, 0.0, 0.0], [1.0, 0.2, 0.0], [1.4, 1.1, 0.3], [2.3, 1.2, 1.0]])
LISTED = {  # places, energy and its slope; LAMMPS' words
    "bonds": (np.linspace(0.3, 2.0, 501), lambda r: 3.0 * (r - 0.9) ** 2 + 0.1 * np.sin(4 * r),
              lambda r: 6.0 * (r - 0.9) + 0.4 * np.cos(4 * r), ""),
    "angles": (np.linspace(0.0, 180.0, 361), lambda t: 2.0 * np.cos(t * DEGREE) ** 2 + 0.3 * np.cos(3 * t * DEGREE),
               lambda t: -DEGREE * (2.0 * np.sin(2 * t * DEGREE) + 0.9 * np.sin(3 * t * DEGREE)), ""),
    "dihedrals": (np.linspace(-179.0, 180.0, 360), lambda t: np.cos((3 * t - 40.0) * DEGREE),
                  lambda t: -3.0 * DEGREE * np.sin((3 * t - 40.0) * DEGREE), "DEGREES"),
}  # fmt: skip
CLASSES = {"bonds": kd.TabulatedBond, "angles": kd.TabulatedAngle, "dihedrals": kd.TabulatedDihedral}


def of_lammps(kind: str, file: Path, count: int) -> tuple[float, np.ndarray]:
    """Energy and forces (4, 3) of a chain of four with a table of LAMMPS."""
    word = kind[:-1]
    lmp = lammps_class()(cmdargs=["-log", "none", "-screen", "none", "-nocite"])
    numbers = {"bonds": "1 2", "angles": "1 2 3", "dihedrals": "1 2 3 4"}
    try:
        for line in (
            "units lj", "atom_style molecular", "atom_modify map array", "boundary f f f",
            "region all block -9 9 -9 9 -9 9", "create_box 1 all bond/types 1 angle/types 1 dihedral/types 1 "
            "extra/bond/per/atom 3 extra/angle/per/atom 3 extra/dihedral/per/atom 3 extra/special/per/atom 6",
            "mass * 1.0", f"{word}_style table spline {count}", f"{word}_coeff 1 {file} ONE",
        ):  # fmt: skip
            lmp.command(line)
        lmp.create_atoms(4, [1, 2, 3, 4], [1] * 4, X.ravel().tolist(), [0.0] * 12)
        for line in (
            f"create_bonds single/{word} 1 {numbers[kind]}", "pair_style zero 5.0", "pair_coeff * *",
            "thermo_modify norm no", "run 0 post no",
        ):  # fmt: skip
            lmp.command(line)
        return lmp.get_thermo("pe"), np.array(lmp.gather_atoms("f", 1, 3)).reshape(4, 3)
    finally:
        lmp.close()


@pytest.mark.parametrize("kind", LISTED)
def test_bonded_tables_are_lammps_tables(kind, tmp_path):
    x, energy, slope, flags = LISTED[kind]
    path = tmp_path / "a.table"
    path.write_text(section(x, energy(x), -slope(x), flags), encoding="utf-8")
    force = CLASSES[kind](str(path))
    chain = {"bonds": [(0, 1)], "angles": [(0, 1, 2)], "dihedrals": [(0, 1, 2, 3)]}
    system = kd.System(
        X, masses=1.0, units="lj", forces=[force], topology=kd.Topology(**{"bonds": [], kind: chain[kind]})
    )
    sim = kd.Simulation(system, "velocity-verlet", 0.001)
    expected, forces = of_lammps(kind, path, 4000)
    assert sim.energy().potential == pytest.approx(expected, rel=1e-6)
    np.testing.assert_allclose(sim.forces(), forces, rtol=0, atol=2e-6 * np.abs(forces).max())
    places = np.linspace(x[1], x[-2], 333)
    unit = 1.0 if kind == "bonds" else DEGREE
    found = np.array([force.law.law(each * unit) for each in places.tolist()])
    np.testing.assert_allclose(found[:, 0], energy(places), rtol=0, atol=1e-8)
    np.testing.assert_allclose(found[:, 1], slope(places) / unit, rtol=0, atol=1e-7)


BONDED_BAD = {
    "part": (
        kd.TabulatedAngle,
        [(t, t) for t in range(0, 170)],
        r"goes from 0 to 169 degrees; expected a table from 0",
    ),
    "turn": (kd.TabulatedDihedral, [(t, 0.0) for t in range(0, 180)], r"expected a table of one turn"),
    "jump": (
        kd.TabulatedDihedral,
        [(t, 0.01 * t) for t in range(-180, 181)],
        r"at -180 and 180 degrees, one place, are",
    ),
    "before": (kd.TabulatedBond, [(0.1 * k - 0.2, k * k) for k in range(20)], r"begins at r = -0.2; lengths are zero"),
}


@pytest.mark.parametrize("name", BONDED_BAD)
def test_a_bad_table_of_angles_is_refused(name):
    cls, table, words = BONDED_BAD[name]
    with pytest.raises(InputError, match=words):
        cls(table=table)
    with pytest.raises(InputError, match=r"length_unit goes with tables of lengths"):
        kd.TabulatedAngle(table=[(t, 0.0) for t in range(181)], length_unit=2.0)


def test_a_bond_that_leaves_its_table_is_named():
    force = kd.TabulatedBond(table=[(r, (r - 1.0) ** 2) for r in np.linspace(0.5, 1.5, 50).tolist()])
    topology = kd.Topology([(0, 1)])
    with pytest.raises(
        InputError, match=r"bond 0 of particles 0 and 1 has the length 2, where .*its table goes from 0.5 to"
    ):
        two(force, 2.0, topology=topology)
    system = kd.System(
        [[0, 0, 0], [1.1, 0, 0]], [[0, 0, 0], [5.0, 0, 0]], 1.0, forces=[force], units="lj", topology=topology
    )
    with pytest.raises(kd.RunError, match="bond 0 of particles 0 and 1"):
        kd.Simulation(system, "velocity-verlet", 0.01).run(100)


def test_pairs_are_lammps_pairs(tmp_path):
    r = np.sqrt(np.linspace(0.49, 6.25, 4000))
    energy, force = lennard_jones(r)
    ends = [
        float(np.gradient(force[part], r[part], edge_order=2)[at])
        for part, at in ((slice(3), 0), (slice(-3, None), -1))
    ]
    path = tmp_path / "a.table"
    path.write_text(section(r, energy, force, f"RSQ 0.7 2.5 FPRIME {ends[0]!r} {ends[1]!r}"), encoding="utf-8")
    table = kd.Tabulated(str(path), truncation="cut")
    lmp = lammps_class()(cmdargs=["-log", "none", "-screen", "none", "-nocite"])
    found = []
    try:
        for line in (
            "units lj", "atom_modify map array", "boundary f f f", "region all block -9 9 -9 9 -9 9",
            "create_box 1 all", "mass * 1.0", "pair_style table spline 20000", f"pair_coeff * * {path} ONE",
            "thermo_modify norm no",
        ):  # fmt: skip
            lmp.command(line)
        lmp.create_atoms(2, [1, 2], [1, 1], [0.0] * 5 + [1.0])
        for place in np.linspace(0.75, 2.4, 12).tolist():
            lmp.command(f"set atom 2 z {place!r}")
            lmp.command("run 0 post no")
            own = table.law.law(place * place)
            found.append((*own, lmp.get_thermo("pe"), lmp.gather_atoms("f", 1, 3)[5] / place))
    finally:
        lmp.close()
    energies, over_r, *theirs = np.array(found).T
    np.testing.assert_allclose(energies, theirs[0], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(over_r, theirs[1], rtol=1e-9, atol=1e-9)


def test_no_parameter_of_a_table_has_a_derivative():
    from kickdrift.forces.slopes.pushes import PairPush

    with pytest.raises(InputError, match=re.escape("parameters: tabulated.rows: a table has no parameters")):
        PairPush(kd.Tabulated(table=rows()), "rows", liquid(64), 0, 1.0)


@pytest.mark.parametrize(("engine", "near"), [rest("lammps", 1e-11), ("openmm", 3e-8)])
def test_engines_take_tables(engine, near):
    law = kd.LennardJones(cutoff=2.4, truncation="force-shift", species={"A": {}, "B": {"epsilon": 0.5, "sigma": 0.88}})
    start = liquid(216)
    species = ["AB"[k % 2] for k in range(216)]
    system = kd.System(
        start.state.positions, masses=1.0, box=start.box, forces=[kd.Tabulated.of(law, 0.6)], species=species
    )
    ours, theirs = (kd.Simulation(system, dt=0.001, engine=each) for each in ("native", engine))
    size = np.abs(ours.forces()).max()
    np.testing.assert_allclose(theirs.forces(), ours.forces(), rtol=0, atol=near * size)
    assert theirs.sample().pressure == pytest.approx(ours.sample().pressure, rel=1e-8)
    assert theirs.sample().energies.potential == pytest.approx(ours.energy().potential, rel=1e-11)
    bonds = system.remade(topology=kd.Topology([(0, 1)], factors=[0.5, 1.0, 1.0]))
    if engine == "openmm":
        with pytest.raises(InputError, match="scaled pairs of tables are not possible"):
            kd.Simulation(bonds, dt=0.001, engine=engine)


def test_a_device_takes_no_table():
    from kickdrift.engines import cuda

    sim = kd.Simulation(liquid(216).with_forces(kd.Tabulated(table=rows())), dt=0.001)
    job = type("Job", (), {"system": sim.system})
    assert cuda.refusal(job) == "force 'tabulated': the device takes a formula; a table lies in the processor's memory"
