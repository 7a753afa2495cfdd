"""ASE's calculators as forces: beside ASE itself, restarts with a calculator's own memory, bad input."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
import pytest
from ase.build import bulk
from ase.calculators.calculator import Calculator, all_changes
from ase.calculators.emt import EMT
from ase.calculators.lj import LennardJones
from ase.calculators.mixing import SumCalculator
from ase.calculators.singlepoint import SinglePointCalculator
from ase.io import read
from ase.md.verlet import VelocityVerlet

import kickdrift as kd
from kickdrift.forces.seam.named import _MODULES, _NAMED
from kickdrift.integrators.own.registration import load_code
from kickdrift.model.units.file_units import Scale
from kickdrift.systemfile.reading import loads

DT = 0.005
TEXT = """
units = "metal"
[particles]
lattice = "fcc"
count = 32
density = "8.93 g/cm^3"
mass = "63.546 u"
species = "Cu"
[velocities]
temperature = "900 K"
seed = 1
[box]
periodic = true
[[force]]
type = "ase"
calculator = "ase.calculators.emt.EMT"
arguments = { asap_cutoff = true }
"""


def copper(cells=2, calculator=None):
    atoms = bulk("Cu", a=3.61, cubic=True) * (cells, cells, cells)
    rng = np.random.default_rng(1)
    atoms.positions += rng.uniform(-0.05, 0.05, atoms.positions.shape)
    atoms.set_momenta(rng.normal(size=atoms.positions.shape) * np.sqrt(63.5 * 0.1))
    atoms.calc = calculator
    return atoms


def under(force, **more):
    return kd.System.from_ase(copper(), [force], **more)


class Springs(Calculator):
    """Each atom on a spring; faults by keyword."""

    implemented_properties = ["energy", "forces"]  # noqa: RUF012

    def __init__(self, **faults):
        super().__init__()
        self.faults, self.calls, self.home = faults, 0, None

    def calculate(self, atoms=None, properties=("energy",), system_changes=all_changes):
        super().calculate(atoms, properties, system_changes)
        self.calls += 1
        self.home = atoms.positions.copy() if self.home is None else self.home
        d = atoms.positions - self.home
        self.results = {"energy": 0.5 * float((d * d).sum()), "forces": -d}
        if self.calls > self.faults.get("after", np.inf):
            if "raises" in self.faults:
                raise self.faults["raises"]
            self.results |= self.faults["results"]


# --- beside ASE ---


@pytest.mark.parametrize("units", ["metal", "si"])
def test_a_run_is_that_of_ases_own_dynamics(units):
    system = kd.System.from_ase(copper(calculator=EMT()), units=units)
    assert [str(force) for force in system.forces] == ["CalculatorForce(EMT)"]
    scale = Scale.of(system.units)
    dt = DT * 1e-12 if units == "si" else DT
    sim = kd.Simulation(system, "velocity-verlet", dt=dt)
    sim.run(15, every=1)
    atoms = copper(calculator=EMT())
    VelocityVerlet(atoms, dt * scale.velocity / scale.length).run(15)
    np.testing.assert_allclose(sim.state.positions / scale.length, atoms.positions, rtol=0, atol=1e-11)
    assert sim.energy().potential / scale.energy == pytest.approx(atoms.get_potential_energy(), abs=1e-10)
    np.testing.assert_allclose(sim.forces() / scale.force, atoms.get_forces(), rtol=0, atol=1e-10)
    sample = sim.sample()
    of_whole = 0.5 * system.coherent_masses.sum() * (sample.centre_of_mass_velocity**2).sum()  # no heat
    kinetic = 2 * (sample.energies.kinetic - of_whole) / (3 * system.volume)
    stress = atoms.get_stress()[:3].sum() * scale.energy / scale.length**3
    assert sample.pressure == pytest.approx(kinetic - stress / 3, rel=1e-9)
    heat = sample.energies.kinetic - of_whole
    assert sample.temperature == pytest.approx(2 * heat / (3 * (len(system) - 1) * system.units.boltzmann), rel=1e-9)


def test_atoms_come_back_with_their_calculator():
    atoms = copper(calculator=EMT())
    back = kd.System.from_ase(atoms).to_ase()
    assert back.calc is atoms.calc
    other = kd.System.from_ase(copper(), [kd.CalculatorForce(EMT()), kd.UniformField((0.0, 0.0, 1.0))]).to_ase()
    assert other.get_potential_energy() != pytest.approx(back.get_potential_energy())


def test_lennard_jones_in_reduced_units_is_ours():
    x = np.random.default_rng(3).uniform(-0.1, 0.1, (27, 3)) + 1.2 * np.indices((3, 3, 3)).reshape(3, -1).T
    calculator = kd.CalculatorForce(LennardJones, {"rc": 1.7})
    ours = kd.LennardJones(cutoff=1.7, truncation="shift")
    sims = [kd.Simulation(kd.System(x, box=(3.6,) * 3, forces=[force]), dt=0.002) for force in (calculator, ours)]
    for sim in sims:
        sim.run(20)
    np.testing.assert_allclose(sims[0].state.positions, sims[1].state.positions, rtol=0, atol=1e-12)
    assert sims[0].sample().pressure == pytest.approx(sims[1].sample().pressure, rel=1e-10)


# --- the calculator's own memory ---


def test_samples_cost_no_calculation_and_share_the_atoms():
    calculator = Springs()
    sim = kd.Simulation(under(kd.CalculatorForce(calculator, renewal=99.0)), "velocity-verlet", dt=DT)
    sim.run(20, every=1)
    assert calculator.calls == 21
    np.testing.assert_array_equal(calculator.atoms.positions, sim.state.positions)


@pytest.mark.parametrize("method", ["velocity-verlet", "leapfrog-dkd"])
def test_bits_depend_on_no_sample_and_on_no_restart(method):
    """EMT's list has a skin, so that its sums depend on where the list was made."""
    system = kd.System.from_ase(copper(), [kd.CalculatorForce(EMT())])
    whole = kd.Simulation(system, method, dt=DT)
    whole.run(40, every=40)
    looked = kd.Simulation(system, method, dt=DT)
    looked.run(23, every=1)
    checkpoint = looked.checkpoint()
    looked.run(17, every=1)
    assert looked.state.phase.tobytes() == whole.state.phase.tobytes()
    again = kd.Simulation(kd.System.from_ase(copper(), [kd.CalculatorForce(EMT())]), method, dt=DT)
    again.restore(checkpoint)
    again.run(17, every=17)
    assert again.state.phase.tobytes() == whole.state.phase.tobytes()
    fresh = kd.Simulation(system.at(checkpoint["stepper"]["y"], checkpoint["time"], 23), method, dt=DT)
    fresh.run(17, every=17)
    np.testing.assert_allclose(fresh.state.positions, whole.state.positions, rtol=0, atol=1e-11)


def test_two_runs_that_share_a_calculator_have_their_own_bits():
    force = kd.CalculatorForce(EMT())
    alone = kd.Simulation(under(force), dt=DT)
    alone.run(24)
    system = under(force)
    one, other = kd.Simulation(system, dt=DT), kd.Simulation(system.with_velocities(2 * system.state.velocities), dt=DT)
    for _ in range(3):
        one.run(8)
        other.run(8)
    assert one.state.phase.tobytes() == alone.state.phase.tobytes()


def test_a_sum_of_calculators_begins_anew_with_its_parts():
    system = under(kd.CalculatorForce(SumCalculator([EMT(), EMT()])))
    sim = kd.Simulation(system, dt=DT)
    assert sim.energy().potential == pytest.approx(2 * copper(calculator=EMT()).get_potential_energy())
    sim.run(5)
    assert np.isfinite(sim.state.phase).all()


# --- files ---


def test_a_run_resumes_by_the_calculators_path_and_arguments(tmp_path):
    path = tmp_path / "run.h5md"
    kd.register_force(EMT)
    system = loads(TEXT)
    kd.Simulation(system, dt=DT).run(20, every=3, output=path)
    there = kd.resume(path)
    assert there.system.forces == system.forces
    there.run(13)
    whole = kd.Simulation(system, dt=DT)
    whole.run(33)
    assert there.state.phase.tobytes() == whole.state.phase.tobytes()
    assert loads(system.to_toml()).forces == system.forces


def test_a_file_runs_no_code_that_nobody_has_named(tmp_path, monkeypatch):
    path = tmp_path / "run.h5md"
    kd.register_force(EMT)
    kd.Simulation(loads(TEXT), dt=DT).run(2, output=path)
    monkeypatch.delitem(_NAMED, "ase.calculators.emt.EMT")
    line = re.escape("ase: calculator: ase.calculators.emt.EMT is code, and a file runs no code by itself; ")
    for act in (lambda: loads(TEXT), lambda: kd.resume(path)):
        with pytest.raises(kd.InputError, match=line) as raised:
            act()
        assert "\n" not in str(raised.value)
    kd.open(path).close()
    load_code(Path("ase.calculators.emt"))
    try:
        assert kd.resume(path).steps_done == 2
        with pytest.raises(
            kd.InputError, match=r"module ase.calculators.emt defines no calculator EMTT; did you mean 'EMT'\?"
        ):
            loads(TEXT.replace("emt.EMT", "emt.EMTT"))
        with pytest.raises(kd.InputError, match=r"module ase.calculators.emt defines no calculator sqrt"):
            loads(TEXT.replace("emt.EMT", "emt.sqrt"))
    finally:
        _MODULES.discard("ase.calculators.emt")


TOOLS = """
called = []
def remove(*given, **named):
    called.append("remove")
class Command:
    def __init__(self, *given, **named):
        called.append("Command")
class Half(Command):
    implemented_properties = ("energy", "forces")
"""


@pytest.mark.parametrize("name", ["remove", "Command", "Half", "called"])
def test_a_file_calls_only_calculators_of_a_loaded_module(name, tmp_path, monkeypatch):
    (tmp_path / "tools.py").write_text(TOOLS)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "tools", raising=False)
    load_code(Path("tools"))
    try:
        with pytest.raises(kd.InputError, match=f"calculator: module tools defines no calculator {name}"):
            loads(TEXT.replace("ase.calculators.emt.EMT", f"tools.{name}"))
        if name != "remove":
            with pytest.raises(kd.InputError, match=f"function: module tools defines no function {name}"):
                kd.PythonForce(f"tools.{name}")
        assert sys.modules["tools"].called == []
    finally:
        _MODULES.discard("tools")


@pytest.mark.parametrize("name", ["subprocess", "os", "shutil", "multiprocessing.util"])
def test_a_module_of_pythons_own_is_not_loaded(name):
    with pytest.raises(kd.InputError, match=f"^--load {name}: a module of Python's own; .* that you trust$"):
        load_code(Path(name))
    assert name not in _MODULES


def test_the_hint_does_not_repeat_a_strangers_module():
    with pytest.raises(kd.InputError, match="allows it for a module that you trust") as raised:
        loads(TEXT.replace("ase.calculators.emt.EMT", "stranger.module.Calculator"))
    assert "--load stranger" not in str(raised.value)


@pytest.mark.parametrize("name", ["ase.calculators.nobody", "nobody.at.all"])
def test_a_module_that_does_not_exist_is_one_line(name):
    with pytest.raises(kd.InputError, match=f"--load {name}: there is no module '"):
        load_code(Path(name))


@pytest.mark.parametrize("made", [EMT(asap_cutoff=True), LennardJones(sigma=2.3, epsilon=0.1, rc=6.0)])
def test_a_ready_made_calculator_is_stored_by_its_class_and_parameters(made, tmp_path):
    path = tmp_path / "run.h5md"
    used = copper(calculator=made)
    used.get_potential_energy()
    system = under(kd.CalculatorForce(used.calc))
    kd.Simulation(system, dt=DT).run(2, output=path)
    there = kd.resume(path)
    assert there.system.forces == system.forces
    assert there.system.forces[0].made is not made
    assert loads(system.to_toml()).forces == system.forces
    whole = kd.Simulation(system, dt=DT)
    there.run(3), whole.run(5)
    assert there.state.phase.tobytes() == whole.state.phase.tobytes()


class Kept(EMT):
    """A calculator with a number that its parameters do not have."""

    def __init__(self, strength=1.0):
        super().__init__()
        self.strength = strength


@pytest.mark.parametrize("made", [Kept(2.0), SumCalculator([EMT()])])
def test_a_ready_made_calculator_that_cannot_be_said_resumes_with_the_system(made, tmp_path):
    path, name = tmp_path / "run.h5md", type(made).__name__
    system = under(kd.CalculatorForce(made))
    kd.Simulation(system, dt=DT).run(2, output=path)
    with pytest.raises(kd.InputError, match=rf"cannot say how the calculator '\S*{name}' was made"):
        kd.resume(path)
    assert kd.resume(path, system=system).steps_done == 2
    with pytest.raises(kd.InputError, match=f"to_toml: a system file cannot say how the calculator {name} was made"):
        system.to_toml()


# --- without stress, forces, or an answer ---


def test_without_stress_the_pressure_is_left_out_by_a_note(tmp_path):
    system = under(kd.CalculatorForce(Springs()))
    report = kd.Simulation(system, dt=DT).run(3, every=1, output=tmp_path / "run.h5md")
    assert report.warnings == ["pressure is left out: the calculator Springs gives no stress"]
    assert report.pressure is None
    with kd.open(tmp_path / "run.h5md") as run:
        assert {"pressure", "pairs"}.isdisjoint(run.observables)
    quiet = kd.Simulation(under(kd.CalculatorForce(EMT(), stress=False)), dt=DT).run(3)
    assert quiet.warnings == ["pressure is left out: stress=False leaves it out"]


@pytest.mark.parametrize(
    ("faults", "message"),
    [
        ({"raises": RuntimeError("no convergence\nat all")}, "Springs raised RuntimeError: no convergence at all"),
        ({"results": {"forces": np.full((32, 3), np.nan)}}, "Springs returned a force on particle 0 that is not"),
        ({"results": {"energy": np.nan}}, "Springs returned the energy nan"),
        ({"results": {"forces": np.zeros((31, 3))}}, "Springs returned forces of shape (31, 3), expected (32, 3)"),
    ],
)
def test_a_calculator_that_fails_names_the_step_and_keeps_the_atoms(faults, message, tmp_path):
    path = tmp_path / "run.h5md"
    system = under(kd.CalculatorForce(Springs(after=11, **faults), renewal=99.0))
    with pytest.raises(kd.RunError) as raised:
        kd.Simulation(system, "velocity-verlet", dt=DT).run(40, every=2, output=path)
    line = str(raised.value)
    assert f"step 11 (t = 0.055): {message}" in line
    assert line.endswith(f"; its particles are in {tmp_path / 'run-step-11.extxyz'}")
    assert "\n" not in line
    atoms = read(tmp_path / "run-step-11.extxyz")
    assert atoms.info["step"] == 11
    assert atoms.get_chemical_formula() == "Cu32"
    with kd.open(path) as run:
        assert run.steps.tolist() == [0, 2, 4, 6, 8, 10]
        np.testing.assert_allclose(atoms.positions, run[-1].positions, atol=0.2)
        np.testing.assert_allclose(atoms.cell.lengths(), run.box.lengths)


class Blind(Springs):
    implemented_properties = ["energy"]  # noqa: RUF012


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: under(kd.CalculatorForce(Blind())), "ase: the calculator Blind gives no forces; it gives energy"),
        (lambda: under(kd.CalculatorForce(7)), "ase: calculator: expected one of ASE's calculators, got 7"),
        (lambda: under(kd.CalculatorForce(dict)), "ase: calculator: expected one of ASE's calculators, got {}"),
        (lambda: under(kd.CalculatorForce(EMT(), {"a": 1})), "arguments belong to a class of calculators"),
        (lambda: under(kd.CalculatorForce(EMT, [1])), "ase: arguments: expected a table, got [1]"),
        (lambda: under(kd.CalculatorForce(SumCalculator, {"calcs": 3})), "SumCalculator(calcs=3) raised TypeError"),
        (lambda: under(kd.CalculatorForce(EMT(), renewal=-1)), "ase: renewal must be a length, zero or more, got -1"),
        (lambda: under(kd.CalculatorForce(EMT(), stress=1)), "ase: stress must be True or False, got 1"),
        (lambda: under(kd.CalculatorForce(EMT(), {}, {"Ag": "Cu"})), "ase: symbols: no species 'Ag'; known are Cu"),
        (
            lambda: kd.System.from_ase(copper(), [kd.CalculatorForce(EMT())], species=["A"] * 32),
            "ase: 'A' for species 'A' is not a chemical element; symbols={\"A\": \"Cu\"} names it",
        ),
        (
            lambda: kd.System([[0, 0], [1, 1]], dimensions=2, forces=[kd.CalculatorForce(EMT())]),
            "ase: a calculator needs three dimensions, and the system has two",
        ),
        (
            lambda: kd.System([[0, 0, 0], [2, 1, 1]], masses=[1, 0], forces=[kd.CalculatorForce(EMT())]),
            "ase: particle 1 has no mass",
        ),
        (
            lambda: kd.System.from_ase(copper(calculator=SinglePointCalculator(copper(), energy=1.0))),
            "forces: the calculator SinglePointCalculator only holds results of one configuration; give forces",
        ),
    ],
)
def test_calculators_that_do_not_fit_are_refused_before_the_run(make, message):
    with pytest.raises(kd.InputError, match=re.escape(message)) as raised:
        make()
    assert "\n" not in str(raised.value)


def test_species_may_have_other_names_than_elements():
    system = kd.System.from_ase(copper(calculator=EMT()), species=["core"] * 16 + ["shell"] * 16)
    expected = copper(calculator=EMT()).get_potential_energy()
    assert kd.Simulation(system, dt=DT).energy().potential == pytest.approx(expected, abs=1e-10)


def test_charges_that_a_system_cannot_hold_are_refused():
    atoms = copper(calculator=EMT())
    atoms.set_initial_charges(np.ones(32))
    with pytest.raises(kd.InputError, match="atoms: initial_charges have no place in a System"):
        kd.System.from_ase(atoms)


def test_without_ase_one_line_says_what_to_install(monkeypatch):
    made = EMT()
    monkeypatch.setitem(sys.modules, "ase", None)
    with pytest.raises(kd.InputError, match=re.escape("ase: a calculator needs ase: pip install 'kickdrift[ase]'")):
        kd.CalculatorForce(made)


def test_chaos_refuses_a_calculator_by_name():
    with pytest.raises(kd.InputError, match="force 'ase': has no variational equations"):
        kd.megno(under(kd.CalculatorForce(EMT())), dt=DT, time=0.05)
