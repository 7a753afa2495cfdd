"""Systems as inputs of LAMMPS: the way out and back has the same energies and forces to rounding."""

import sys
from pathlib import Path

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.model.run_defaults import Equilibration, RunDefaults
from tests.long import rest, shortened

BOTH = [1.0, -1.0]


def box(forces, edge=1.2, count=5, charges=None, **more):
    """Particles of two species near the sites of a cubic lattice."""
    rng = np.random.default_rng(1)
    x = edge * np.indices((count,) * 3).reshape(3, -1).T + rng.uniform(-0.1, 0.1, (count**3, 3))
    species = ["B" if k % 3 == 0 else "A" for k in range(len(x))]
    return kd.System(
        x + 7.0 * edge * count, rng.normal(size=x.shape), 1.0 + np.array([each == "B" for each in species]),
        [edge * count] * 3, forces, species=species, charges=charges, **more,
    )  # fmt: skip


def three(**pairs):
    """Parameters of the three pairs of species."""
    return {tuple(pair): values for pair, values in pairs.items()}


ALTERNATE = np.array([*(62 * BOTH), 0.0])
OWN = three(
    AA={"epsilon": 1.1, "sigma": 0.97, "cutoff": 2.2}, AB={"epsilon": 0.7, "sigma": 0.8, "cutoff": 1.987654321},
    BB={"epsilon": 0.6, "sigma": 1.0123456789},
)  # fmt: skip
LAWS = {
    "lj/cut": lambda: [kd.LennardJones(cutoff=2.5, pairs=OWN)],
    "lj/smooth/linear": lambda: [kd.LennardJones(cutoff=2.2, truncation="force-shift")],
    "tail": lambda: [kd.LennardJones(cutoff=2.2, truncation="cut", tail=True)],
    "mie/cut": lambda: [kd.Mie(n=14.0, m=7.0, cutoff=2.3, species={"A": {}, "B": {"epsilon": 0.7, "sigma": 0.9}})],
    "buck/coul/long": lambda: [
        kd.Buckingham(300.0, 0.25, 1.23456789, cutoff=2.0, truncation="cut"), kd.Coulomb("ewald", 1e-5, cutoff=2.2)
    ],
    "born": lambda: [kd.BornMayerHuggins(1.0, 0.25, 1.1, 1.2, 0.3, cutoff=2.0)],
    "morse": lambda: [kd.MorsePair(1.0, 5.0, 1.1, cutoff=2.0)],
    "yukawa": lambda: [kd.Yukawa(2.0, 1.3, cutoff=2.0)],
    "gauss": lambda: [kd.GaussianCore(2.0, 0.9, cutoff=2.0)],
    "soft": lambda: [kd.SoftPair(2.0, 1.8)],
    "wca": lambda: [kd.WeeksChandlerAndersen(species={"A": {"epsilon": 1.1}, "B": {"sigma": 1.3}})],
    "coul/long": lambda: [kd.Coulomb("pme", 1e-5, dielectric=2.0)],
}  # fmt: skip


def same(ours, back, limit=3e-14):
    """Equal energies and forces."""
    found = [BoundForces(each).measure(0.0, each.state.phase) for each in (ours, back)]
    assert found[1].potential == pytest.approx(found[0].potential, rel=limit)
    one, other = (each.accelerations for each in found)
    assert np.abs(one - other).max() < limit * np.abs(one).max()


@pytest.mark.parametrize("name", shortened(LAWS, ["lj/cut", "tail"]))
def test_a_pair_law_comes_back(name, tmp_path):
    forces = LAWS[name]()
    charged = any(isinstance(force, kd.Coulomb) for force in forces)
    system = box(forces, charges=ALTERNATE if charged else None)
    written = system.to_lammps(tmp_path / "in.case")
    assert [each.name for each in written.files] == ["in.case", "case.data"]
    back = kd.System.from_lammps(written.input)
    assert set(back.species) == {*system.species}
    assert not any(isinstance(force, kd.LammpsForce) for force in back.forces)
    np.testing.assert_array_equal(back.state.velocities, system.state.velocities)
    np.testing.assert_array_equal(back.state.masses, system.state.masses)
    same(system, back)


def test_a_switch_becomes_tables(tmp_path):
    system = box([kd.LennardJones(cutoff=2.2, truncation="switch")])
    back = kd.System.from_lammps(system.to_lammps(tmp_path / "case.lmp").input)
    same(system, back, 1e-12)


def test_a_potential_of_many_bodies_lies_beside(tmp_path, monkeypatch):
    system = kd.load("copper-864")
    with pytest.warns(UserWarning, match=r"to_lammps: left out: \[equilibrate\]"):
        written = system.to_lammps(tmp_path)
    assert written.input.name == "in.copper-864"
    monkeypatch.chdir(tmp_path.parent)
    back = kd.System.from_lammps(written.input)
    assert back.species == ("Cu",)
    assert back.run.dt == system.run.dt
    same(system, back)


def test_lammps_own_styles_come_back(tmp_path):
    silicon = kd.load("silicon-512")
    system = silicon.with_equilibration(None).with_forces(kd.LammpsForce("edip", "* * Si.edip Si"))
    back = kd.System.from_lammps(system.to_lammps(tmp_path / "in.edip").input)
    assert back.forces == system.forces
    same(system, back)


def peptide(rigid):
    """Four chains with bonds, angles, dihedrals, impropers, and pairs scaled by two factors, in units of OpenMM."""
    shape = np.array([[0, 0, 0], [0.15, 0.01, 0], [0.21, 0.14, 0.02], [0.36, 0.15, 0.09], [-0.05, 0.13, 0.04]])
    rng = np.random.default_rng(2)
    sites = 0.9 * np.indices((2, 2, 1)).reshape(3, -1).T
    x = (sites[:, None] + shape + rng.uniform(-0.005, 0.005, (4, 5, 3))).reshape(-1, 3)
    one = kd.Topology(
        [(0, 1), (1, 2), (2, 3), (0, 4)], True, True, [(0, 1, 4, 2)], bond_types=["a", "a", "b", "b"], factors=(0, 0, 0)
    ).repeated(4)
    species = ["C", "O", "C", "O", "C"] * 4
    charges = np.tile([0.3, -0.2, 0.1, -0.1, -0.1], 4)
    wells = {"C": {"epsilon": 0.45, "sigma": 0.34}, "O": {"epsilon": 0.88, "sigma": 0.296}}
    lj = kd.LennardJones(cutoff=0.6, truncation="cut", species=wells)
    far = [(5 * m + i, 5 * m + j) for m in range(4) for i, j in ((0, 3), (2, 4))]
    laws = [lj.pair_law(species[i], species[j]) for i, j in far]
    bonds: dict = {"types": {"b": {}}} if rigid else {}
    forces = [
        lj, kd.Coulomb("ewald", 1e-5, cutoff=0.7),
        kd.ListedPairs(far, [0.5 * law.epsilon for law in laws], [law.sigma for law in laws],
                       [charges[i] * charges[j] / 1.2 for i, j in far]),
        kd.HarmonicBond(2.6e5, 0.15, **bonds), kd.HarmonicAngle(500.0, 110.0), kd.PeriodicDihedral(4.0, 2, 180.0),
        kd.PeriodicDihedral(1.0, 3, 0.0), kd.PeriodicImproper(4.6, 2, 175.0),
    ]  # fmt: skip
    held = [kd.Constraint(bonds="a")] if rigid else None
    return kd.System(
        x, 0.1 * rng.normal(size=x.shape), [12.011, 15.9994, 12.011, 15.9994, 12.011] * 4, [1.8, 1.8, 1.5], forces,
        "gromacs", species, charges=charges, topology=one, constraints=held,
    )  # fmt: skip


@pytest.mark.parametrize("rigid", [rest(False), True])
def test_molecules_of_a_force_field_come_back(rigid, tmp_path):
    system = peptide(rigid)
    back = kd.System.from_lammps(system.to_lammps(tmp_path / "in.chains").input)
    same(system.in_units("real"), back, 1e-12)
    if rigid:
        given, found = system.in_units("real").constraints, back.constraints
        order = [np.lexsort(np.sort(each.pairs, axis=1).T) for each in (given, found)]
        np.testing.assert_allclose(found.lengths[order[1]], given.lengths[order[0]], rtol=1e-14)


def test_other_units_have_the_same_energies():
    system = peptide(True)
    real = system.in_units("real")
    kilocalorie = 4.184
    found = [BoundForces(each).measure(0.0, each.state.phase).potential for each in (system, real)]
    assert found[1] * kilocalorie == pytest.approx(found[0], rel=1e-12)
    assert real.in_units("gromacs").state.phase == pytest.approx(system.state.phase, rel=1e-14)
    said = system.with_run(integrator="baoa", dt=0.002, temperature=300.0, friction=1.0, steps=10).in_units("real").run
    assert said.said() == pytest.approx(
        {"integrator": "baoa", "dt": 2.0, "temperature": 300.0, "friction": 1e-3, "steps": 10}
    )
    for other, problem in (
        (kd.load("lj-1000"), "lj to real: possible are metal, real, gromacs"),
        (kd.load("copper-864"), "force 'eam': its numbers are of one unit system alone"),
    ):
        with pytest.raises(kd.InputError, match=f"in_units: {problem}"):
            other.in_units("real")


def test_what_a_run_needs_goes_into_other_units():
    r = np.linspace(3.0, 9.0, 200)
    table = kd.Tabulated(table=[*zip(r, 40.0 * r**-6, strict=True)])
    x = 10.0 + 4.0 * np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)])
    system = kd.System(
        x, masses=40.0, box=[40.0] * 3, forces=[table], units="metal", seed=5,
        stages=[kd.Stage("still", minimize={"force": 1.0}), kd.Stage("warm", dt=0.002, steps=3)],
        fixed=[kd.Fixed(2, velocity=(1.0, 0.0, 2.0))],
    ).with_equilibration(Equilibration(300.0, time=2.0, interval=7))  # fmt: skip
    found = system.in_units("real")
    assert found.energy().potential == pytest.approx(23.06054783 * system.energy().potential, rel=1e-8)
    assert found.fixed.tables == [{"particles": [2], "velocity": pytest.approx([1e-3, 0.0, 2e-3])}]
    assert found.stages[0].minimize == {"force": pytest.approx(23.06054783)}
    assert found.stages[1].run == {"dt": pytest.approx(2.0), "steps": 3}
    assert (found.equilibration.time, found.equilibration.interval, found.seed) == (pytest.approx(2000.0), 7, 5)
    own = system.with_forces(kd.PythonForce(lambda x, v, m, t: (0.0 * x, 0.0)))
    with pytest.raises(kd.InputError, match="in_units: force 'python': its numbers are of one unit system alone"):
        own.in_units("gromacs")


def test_a_run_goes_along(tmp_path):
    run = {"integrator": "baoab", "dt": 0.003, "temperature": 1.1, "friction": 0.5, "steps": 10}
    system = box([kd.LennardJones()]).with_run(**run)
    assert kd.System.from_lammps(system.to_lammps(tmp_path / "in.case").input).run.said() == run


def refused():
    pair = kd.LennardJones(cutoff=2.2)
    yield box([kd.LennardJones(cutoff=2.2, truncation="potential-switch")]), "truncation 'potential-switch'"
    yield box([kd.Zbl(cutoff=2.0)]), "force 'zbl': LAMMPS takes one force of"
    yield box([pair, kd.HarmonicTrap(1.0)]), "forces 'lennard-jones' and 'harmonic-trap'"
    yield kd.load("tip4p2005-500"), "virtual sites: LAMMPS has none in general"
    yield kd.load("solar-system"), "units 'astro': expected lj, metal, real, gromacs"
    held = box([pair], topology=kd.Topology([(0, 1)]), constraints=[kd.Constraint(pairs=[(2, 3)])])
    yield held, r"constraints: LAMMPS keeps bonds and angles between rigid bonds, and \[2, 3\] is neither"
    spring = kd.HarmonicBond(9.0, 1.2)
    twice = box([pair, spring], topology=kd.Topology([(0, 1)]), constraints=[kd.Constraint(bonds="1")])
    yield twice, r"constraints: harmonic-bond acts on the rigid \[0, 1\]"
    far = box([pair], topology=kd.Topology([(0, 1)], exclusions=[(0, 9)]))
    yield far, r"topology: LAMMPS scales pairs one to three bonds apart, and this one leaves out \[0, 9\]"
    yield box([pair]).with_fixed(kd.Fixed(0)), "fixed particles: the input would move them"


@pytest.mark.parametrize("k", range(9))
def test_what_lammps_lacks_is_named(k, tmp_path):
    system, problem = list(refused())[k]
    with pytest.raises(kd.InputError, match=f"to_lammps: {problem}"):
        system.to_lammps(tmp_path / "in.case")
    assert not list(tmp_path.iterdir())


def test_an_input_has_another_name_than_its_data(tmp_path):
    with pytest.raises(kd.InputError, match=r"case\.data: is the name of the data file beside the input; take in"):
        box([kd.LennardJones()]).to_lammps(tmp_path / "case.data")
    assert not list(tmp_path.iterdir())


def test_files_are_replaced_on_request_alone(tmp_path, kickdrift, monkeypatch):
    monkeypatch.chdir(tmp_path)
    system = box([kd.LennardJones()])
    system.to_lammps(tmp_path / "in.case")
    with pytest.raises(kd.InputError, match=r"in\.case: exists already"):
        system.to_lammps(tmp_path / "in.case")
    system.to_lammps(tmp_path / "in.case", overwrite=True)
    (tmp_path / "other.data").write_text("mine")
    with pytest.raises(kd.InputError, match=r"other\.data: is not a file of LAMMPS that kickdrift wrote"):
        system.to_lammps(tmp_path / "in.other", overwrite=True)
    assert not (tmp_path / "in.other").exists()
    (tmp_path / "case.toml").write_text(system.to_toml())
    status, output, _ = kickdrift("export", "case.toml", "made.in")
    assert (status, output.split()) == (0, ["made.in", "made.data"])
    status, _, said = kickdrift("export", "case.toml", "made.in", "--start", "2")
    assert status == 2
    assert "an input of LAMMPS has one --frame" in said


def test_what_stays_behind_is_named(tmp_path):
    run = {"integrator": "baoab", "dt": 0.001, "time": 0.01, "temperature": 1.0, "friction": 1.0, "barostat": "mtk"}
    given = kd.System([[0, 0, 0], [1.5, 0, 0]], box=(9.0, 9.0, 9.0), forces=[kd.LennardJones(cutoff=2.5)],
                      run=RunDefaults(**run, pressure=0.1))  # fmt: skip
    staged = given.with_stages(kd.Stage("heat", run={"steps": 5}))
    with pytest.warns(UserWarning, match="to_lammps: left out: barostat = mtk, pressure = 0.1, stage 'heat'"):
        files = staged.to_lammps(tmp_path / "in.a")
    assert files.input.read_text().endswith("run 10\n")


def test_a_place_that_cannot_be_written_is_named(tmp_path):
    given = kd.System([[0, 0, 0], [1.5, 0, 0]], box=(9.0, 9.0, 9.0), forces=[kd.LennardJones(cutoff=2.5)])
    place = Path("/proc") if sys.platform == "linux" else tmp_path / "none"
    with pytest.raises(kd.InputError, match=r"in\.a: (cannot be written|there is no folder)"):
        given.to_lammps(place / "in.a")
