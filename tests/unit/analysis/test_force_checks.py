"""Tests of forces before they run: slopes, sums, symmetries, jumps, virial, and the drift of the energy."""

from __future__ import annotations

import json

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.analysis.certify.force_testing import shell_notes
from kickdrift.analysis.certify.force_tests import jump_along
from kickdrift.model.starts.builders import lattice
from kickdrift.systemfile.files import shipped
from tests.long import rest


def drop(force, **options):
    """Eight particles in open space."""
    rng = np.random.default_rng(3)
    x = np.indices((2, 2, 2)).reshape(3, -1).T * 1.2 + rng.normal(size=(8, 3)) * 0.03
    return kd.System(x, rng.normal(size=(8, 3)) * 0.3, forces=[kd.PythonForce(force, external=False, **options)])


def wells(x, v, t, box, factor=1.0, across=0.0):
    """Springs of rest length zero between all pairs."""
    d = x[:, None, :] - x[None, :, :]
    forces = -factor * d.sum(axis=1)
    return forces + across * np.cross(d, [0.0, 0.0, 1.0]).sum(axis=1), (d**2).sum() / 4


def test_right_forces_pass():
    checks = kd.analysis.force_checks(drop(wells), steps=200, dt=0.01)
    assert checks.passed
    assert checks.row("force = -dE/dx").measured < 1e-8
    assert checks.row("periodic images").verdict == "not tested"
    assert "all 11 tests passed" in str(checks)
    assert json.loads(json.dumps(checks.as_json()))["passed"] is True


@pytest.mark.parametrize(
    ("force", "topology", "named"),
    [
        (kd.Springs([[0, 1]], 1.0), None, "springs"),
        (kd.HarmonicBond(1.0, 1.2), kd.Topology([(0, 1)]), "harmonic-bond"),
        rest(kd.LennardJones(), kd.Topology(exclusions=[(0, 1)]), "topology"),
    ],
)
def test_particles_of_a_list_are_not_exchanged(force, topology, named):
    x = np.indices((2, 2, 2)).reshape(3, -1).T * 1.2
    checks = kd.analysis.force_checks(kd.System(x, forces=[force], topology=topology), steps=100, dt=0.01)
    row = checks.row("exchange of like particles")
    assert (row.verdict, row.remark) == ("not tested", f"{named} acts on listed particles")
    assert checks.passed


def salt(*further):
    """Ions near the sites of a crystal, whose charges have an error of 1e-3."""
    sites = np.indices((4, 4, 4)).reshape(3, -1).T
    charges = np.where(sites.sum(axis=1) % 2, -1.0, 1.0)
    forces = [kd.LennardJones(sigma=1.2, cutoff=2.5, truncation="shift"), kd.Coulomb("pme", accuracy=1e-3), *further]
    return kd.System(1.5 * (sites + 0.5), box=[6.0] * 3, charges=charges, forces=forces)


@pytest.mark.long
def test_the_error_that_charges_state_bounds_the_tests():
    """A mesh moves with no particle, so shifted ions have other forces, by no more than the error that is asked."""
    checks = kd.analysis.force_checks(salt(), steps=100, dt=1e-3)
    assert checks.passed
    for name in ("translation", "sum of forces"):
        row = checks.row(name)
        assert 1e-9 < row.measured < row.bound == 1e-3
        assert row.remark.startswith("the bound is the error of coulomb")
    assert checks.row("same bits again").bound == 1e-9


def test_the_error_of_charges_hides_no_fault_of_other_forces():
    """A weak wave that stands in the box conserves no momentum, although the pair force says so."""

    def wave(x, v, t, box, force=1e-4, k=2.0 * np.pi / 6.0):
        return np.sin(k * x) * [force, 0.0, 0.0], force / k * np.cos(k * x[:, 0]).sum()

    checks = kd.analysis.force_checks(salt(kd.PythonForce(wave, external=False)), steps=100, dt=1e-3)
    for name in ("translation", "sum of forces"):
        row = checks.row(name)
        assert (row.verdict, row.bound < 1e-8, row.measured < 1e-3) == ("fail", True, True)
        assert row.remark.startswith("without coulomb")
    assert checks.row("force = -dE/dx").verdict == "pass"


@pytest.mark.parametrize(
    ("fault", "named"),
    [({"factor": 1.001}, "force = -dE/dx"), ({"factor": -1.0}, "force = -dE/dx"), ({"across": 0.01}, "sum of torques")],
)
def test_wrong_forces_are_named(fault, named):
    checks = kd.analysis.force_checks(drop(lambda *given: wells(*given, **fault)), steps=100, dt=0.01)
    assert named in [row.test for row in checks.failed]


@pytest.mark.parametrize(
    ("truncation", "verdict", "remark"),
    [
        ("cut", "fail", "the energy jumps by 0.016"),
        ("shift", "pass", "no method keeps more than order 1"),
        ("force-shift", "pass", "no method keeps more than order 2"),
        ("switch", "pass", "no jump up to the curvature of the force"),
    ],
)
def test_a_cutoff_is_found(truncation, verdict, remark):
    """The jump of a cut Lennard-Jones energy at 2.5 sigma is 4 (2.5^-6 - 2.5^-12) = 0.0163."""
    checks = kd.analysis.force_checks(kd.LennardJones(truncation=truncation), steps=100)
    row = checks.row("smoothness")
    assert row.verdict == verdict
    assert remark in row.remark
    assert checks.row("virial = -dE/dV").verdict == "pass"


def test_small_jumps_of_the_energy_blame_only_a_force_that_states_no_error():
    """Pairs of charges cross the cutoff of a sum that states its error. Their force is right beside the jumps."""

    class Stating(kd.PythonForce):
        def stated_error(self):
            return 1e-3

    def stairs(x, v, t, box):
        forces, energy = wells(x, v, t, box)
        return forces, energy + 1e-4 * np.floor(x / 4e-3).sum()

    plain = drop(stairs)
    row = kd.analysis.force_checks(plain, steps=100, dt=0.01).row("force = -dE/dx")
    assert (row.verdict, row.measured > 1e-4) == ("fail", True)
    stating = kd.analysis.force_checks(plain.with_forces(Stating(stairs, external=False)), steps=100, dt=0.01)
    assert stating.row("force = -dE/dx").measured < 1e-7


@pytest.mark.parametrize("derivative", [0, 1, 2, 3])
def test_jumps_of_each_derivative(derivative):
    """An energy with one jump, of one derivative, at 0.4 of the line."""

    def values(s):
        beyond = max(s - 0.4, 0.0)
        energy = np.sin(s) + (0.5 * (s > 0.4) if derivative == 0 else 0.5 * beyond**derivative)
        slope = 0.0 if derivative == 0 else 0.5 * derivative * beyond ** (derivative - 1) * (s > 0.4)
        return energy, -np.cos(s) - slope

    found = jump_along(values, 1.0)
    assert found.derivative == derivative
    assert found.place == pytest.approx(0.4, abs=0.01)
    sizes = {0: 0.5, 1: 0.5, 2: 1.0, 3: 3.0}
    assert found.size == pytest.approx(sizes[derivative], rel=0.05)
    assert jump_along(lambda s: (np.sin(s), -np.cos(s)), 1.0) is None


def test_forces_without_energy_are_not_tested_for_it():
    checks = kd.analysis.force_checks(
        kd.System(np.eye(3), np.eye(3), forces=[kd.HarmonicTrap(1.0), kd.LinearDrag(0.1)]), dt=0.01
    )
    assert checks.passed
    assert checks.row("force = -dE/dx").remark == "linear-drag has no potential energy"
    assert checks.row("translation").verdict == "not tested"


def test_springs_and_a_step_of_their_own():
    """No dt is given, so the fastest oscillation sets the step; the springs name their particles."""
    system = kd.System(np.eye(3), np.zeros((3, 3)), forces=[kd.Springs([(0, 1)], 100.0, 1.3)])
    checks = kd.analysis.force_checks(system, steps=100)
    assert checks.passed
    assert checks.row("exchange of like particles").verdict == "not tested"
    assert checks.row("energy drift").verdict == "pass"


def test_the_figure_shows_what_was_measured():
    checks = kd.analysis.force_checks(drop(wells), steps=100, dt=0.01)
    assert len(checks.plot().axes) == 4


def test_what_cannot_be_tested_is_refused():
    with pytest.raises(kd.InputError, match="expected a System, a pair force or ASE Atoms"):
        kd.analysis.force_checks(3)
    with pytest.raises(kd.InputError, match="has no forces"):
        kd.analysis.force_checks(kd.System(np.eye(3), np.eye(3), forces=[]))
    with pytest.raises(kd.InputError, match="dt must be"):
        kd.analysis.force_checks(drop(wells), dt=-1.0)


def test_the_command(kickdrift, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, _ = kickdrift("certify", "figure-eight", "--steps", 100, "--json", "page.json", "--plot", "page.png")
    assert code == 0
    assert "all 11 tests passed" in out
    assert json.loads((tmp_path / "page.json").read_text())["passed"] is True
    assert (tmp_path / "page.png").stat().st_size > 10_000
    code, _, err = kickdrift("certify", "figure-eight", "sun-jupiter", "--forces")
    assert code == 2
    assert "tests the forces of one system, got 2" in err


def test_a_failing_force_ends_with_exit_status_1(kickdrift, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    box = (5.3,) * 3
    x = np.indices((4, 4, 4)).reshape(3, -1).T * 5.3 / 4 + np.random.default_rng(1).normal(size=(64, 3)) * 0.05
    force = kd.LennardJones(cutoff=2.6, truncation="cut")
    text = kd.System(x, np.zeros((64, 3)), box=box, forces=[force]).to_toml()
    (tmp_path / "cut.toml").write_text(text, encoding="utf-8")
    code, out, _ = kickdrift("certify", "cut.toml", "--steps", 100)
    assert "the energy jumps by 0.013" in out
    assert code == 1


def test_a_force_by_its_name_and_a_calculator_on_a_structure(kickdrift, tmp_path, monkeypatch):
    from ase.build import bulk
    from ase.io import write

    monkeypatch.chdir(tmp_path)
    assert kickdrift("certify", "lennard-jones", "--steps", 100)[0] == 0
    write("cu.xyz", bulk("Cu", cubic=True), format="extxyz")
    given = ("certify", "cu.xyz", "--calculator", "ase.calculators.lj.LennardJones", "--steps", 100, "--dt", 0.001)
    code, out, err = kickdrift(*given)
    assert "force = -dE/dx" in out, err
    assert code in (0, 1)
    code, _, err = kickdrift("certify", "cu.xyz", "--calculator", "ase.calculators.lj.LenardJones")
    assert code == 2
    assert "defines no LenardJones; did you mean 'LennardJones'?" in err
    assert "expected a System, a pair force" in kickdrift("certify", "gravity")[2]


def test_a_table_whose_cutoff_lies_on_a_shell_is_named():
    """The copper that ships ends on the fifth shell, and its table with a smooth end between shells."""
    plain = str(shipped()["copper-864"].with_name("Cu_zhou2004.eam.alloy"))
    for path, expected in ((plain, 1), (plain.replace("2004", "2004_smooth"), 0)):
        x, edges = lattice("fcc", 256, 4 / (2**0.5 * 2.556162) ** 3)
        crystal = kd.System(
            x, box=edges, forces=[kd.EmbeddedAtom(path)], units="metal", species=["Cu"] * 256, masses=63.5
        )
        notes = list(shell_notes(crystal))
        assert len(notes) == expected
        assert all("eam: its cutoff, 5.71575, lies on shell 5 of the neighbours (3072 pairs)" in note for note in notes)
