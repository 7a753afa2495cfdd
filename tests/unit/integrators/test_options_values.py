"""Integrators as values, options of a user's own step, the command line, and options in a run's file."""

from __future__ import annotations

import pickle
import re
from typing import NamedTuple

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.analysis.compare.work_precision import chosen_methods, work_precision
from kickdrift.batch.batch import Batch
from kickdrift.errors import InputError
from kickdrift.forces.seam.kernel import OK
from kickdrift.integrators import integrator
from kickdrift.integrators.asked import known_options
from kickdrift.integrators.options import OPTIONS
from kickdrift.integrators.own.registration import unregister
from kickdrift.integrators.splitting.subflows import FLOWS, Subflow
from kickdrift.integrators.stepping.subflow_code import BoundSubflow, subflow_body
from kickdrift_validation.docs_tables import BEGIN, END, options_table
from tests.folders import DOCS

VALUE = kd.integrator("wisdom-holman", corrector=17)


@pytest.fixture
def system() -> kd.System:
    return kd.load("sun-jupiter")


@pytest.fixture
def damped():
    """A registered step with its own options."""

    @kd.register_step(
        "damped",
        order=1,
        source="symplectic Euler with linear damping",
        options=[
            kd.Option("friction", float, "Rate at which velocities decay.", 0.1, above=0.0),
            kd.Option("halves", int, "Parts of the kick.", 1, above=0.0),
            kd.Option("compensated", bool, "Nothing here.", False),
        ],
    )
    def step(forces, t, x, v, a, dt, friction, halves, compensated):
        kd.accelerations(forces, t, x, v, a)
        for _ in range(halves):
            v += dt / halves * a
        if not compensated:
            v *= 1.0 - friction * dt
        x += dt * v

    yield "damped"
    unregister("damped")


# --- values ---


def test_a_value_is_the_integrator_and_its_options(system):
    assert (VALUE.name, VALUE.options, VALUE.method.order) == ("wisdom-holman", {"corrector": 17}, 2)
    assert repr(VALUE) == "integrator('wisdom-holman', corrector=17)"
    assert str(VALUE) == "wisdom-holman -o corrector=17"
    assert len({VALUE, kd.integrator("wisdom-holman", corrector=17), kd.integrator("wisdom-holman")}) == 2
    assert pickle.loads(pickle.dumps(VALUE)) == VALUE
    one, other = kd.Simulation(system, VALUE), kd.Simulation(system, "wisdom-holman", corrector=17)
    assert one.options == other.options
    one.run(5)
    other.run(5)
    assert one.state.phase.tobytes() == other.state.phase.tobytes()


def test_an_argument_replaces_a_values_option_and_that_one_the_files(system):
    file = system.with_run(corrector=3, coordinates="democratic-heliocentric")
    sim = kd.Simulation(file, VALUE, corrector=11)
    assert (sim.options.corrector, sim.options.coordinates) == (11, "democratic-heliocentric")
    assert kd.Simulation(file, VALUE).options.corrector == 17
    assert kd.Simulation(file, kd.integrator("wisdom-holman", dt=0.25)).dt == 0.25
    assert kd.Simulation(file, kd.integrator("wisdom-holman", dt=0.25), 0.125).dt == 0.125


@pytest.mark.parametrize(("name", "options", "message"), [
    ("wisdom-holmann", {}, "integrator 'wisdom-holmann' is unknown; did you mean wisdom-holman"),
    ("saba", {"corrector": 3}, "corrector: saba does not take it; it takes dt, coordinates, order, compensated"),
    ("saba", {"odrer": "8,4"}, "did you mean 'order', which saba takes? saba takes dt, coordinates"),
    ("saba", {"dt": -1}, "dt must be a positive finite time, got -1"),
])  # fmt: skip
def test_a_value_that_makes_no_sense_is_refused_when_it_is_made(name, options, message):
    with pytest.raises(InputError, match=re.escape(message)):
        kd.integrator(name, **options)


def test_a_system_takes_a_value_as_its_default(system):
    file = system.with_run(corrector=3, coordinates="democratic-heliocentric")
    made = file.with_run(integrator=VALUE)
    assert (made.run.integrator, made.run.options["corrector"]) == ("wisdom-holman", 17)
    assert made.run.options["coordinates"] == "democratic-heliocentric"
    assert kd.Simulation(made).options.corrector == 17
    assert system.with_run(integrator=VALUE, corrector=11).run.options["corrector"] == 11
    assert system.with_run(integrator=kd.integrator("saba", dt=0.25, order="8,4")).run.dt == 0.25
    assert file.with_run(integrator="saba").run.options == file.run.options
    problem = kd.load("ode-kepler").with_run(integrator=kd.integrator("rk4", dt=0.01))
    assert (problem.run.integrator, problem.run.dt) == ("rk4", 0.01)


def test_batches_chaos_and_ensembles_take_values(system):
    alone = kd.integrator("saba", order="8,4", dt=0.25)
    batch = Batch([system, system], alone)
    assert (batch.options.order, batch.dt.tolist()) == ("8,4", [0.25, 0.25])
    assert Batch([system], alone, order="10,4").options.order == "10,4"
    report = kd.megno(system, 20.0, kd.integrator("yoshida4", dt=0.5))
    assert (report.integrator, report.dt) == ("yoshida4", 0.5)
    assert dict(kd.Ensemble(system, integrator=VALUE, corrector=3)._recipe.settings) == {
        "integrator": "wisdom-holman", "corrector": 3,
    }  # fmt: skip


def test_a_comparison_takes_values_and_options(system):
    values = [VALUE, "wisdom-holman", "saba", "leapfrog"]
    names = [str(each) for each in chosen_methods(system, values, {"coordinates": "jacobi"})]
    assert names == [
        "wisdom-holman -o coordinates=jacobi -o corrector=17", "wisdom-holman -o coordinates=jacobi",
        "saba -o coordinates=jacobi", "velocity-verlet",
    ]  # fmt: skip
    with pytest.raises(InputError, match="corrector: saba does not take it; wisdom-holman takes it"):
        chosen_methods(system, ["saba"], {"corrector": 3})
    for key in ("dt", "rtol", "precision"):
        with pytest.raises(InputError, match=f"{key}: compare sets it"):
            chosen_methods(system, ["dop853"], {key: 1})
    with pytest.raises(InputError, match="rtol: compare sets it"):
        chosen_methods(system, [kd.integrator("dop853", rtol=1e-3)])
    problem = kd.load("ode-harmonic")
    found = work_precision(problem, [kd.integrator("rk4", compensated=True)], 12.0, budget=5.0)
    assert found.methods == ["rk4 -o compensated=true"]
    assert found.slopes["rk4 -o compensated=true"][0] == pytest.approx(4.0, abs=0.3)


# --- a flow and a step with options ---


class Drag(NamedTuple):
    rate: float


@subflow_body(Drag)
def drag(parts, t, x, v, span, step, stage):
    """Velocities decay at this rate."""
    v *= np.exp(-parts.rate * span)
    return OK


def test_a_flows_option_is_one_of_every_method_whose_word_has_it(system, monkeypatch):
    rate = kd.Option("drag", float, "Rate at which velocities decay.", 0.0)
    flow = Subflow("drag", False, options=(rate,), bind=lambda _, options, weights: BoundSubflow(Drag(options.drag)))
    monkeypatch.setitem(FLOWS, "D", flow)
    kd.register_splitting("dragged", word="BADAB", weights=[0.5, 0.5, 1.0, 0.5, 0.5], order=2, source="this test")
    try:
        assert integrator("dragged").tunable == ("compensated", "drag")
        free, slow = (kd.Simulation(system, kd.integrator("dragged", drag=drag), 0.1) for drag in (0.0, 0.5))
        verlet = kd.Simulation(system, "velocity-verlet", 0.1)
        for sim in (free, slow, verlet):
            sim.run(10)
        assert free.state.phase == pytest.approx(verlet.state.phase, rel=1e-12, abs=1e-15)
        assert slow.energy().kinetic < 0.9 * free.energy().kinetic
        assert slow.report().options == {"drag": 0.5}
    finally:
        unregister("dragged")


def test_a_registered_step_has_options_of_its_own(system, damped):
    free = kd.Simulation(system, damped, 0.1, compensated=True)
    slow, fast = (kd.Simulation(system, damped, 0.1, friction=friction) for friction in (0.1, 0.5))
    for sim in (free, slow, fast):
        sim.run(20)
    kinetic = [sim.energy().kinetic for sim in (free, slow, fast)]
    v = system.state.velocities.copy()
    assert kinetic[0] > kinetic[1] > kinetic[2] > 0.0
    assert kd.Simulation(system, damped, 0.1).options.friction == 0.1
    once = kd.Simulation(system, damped, 0.1, friction=0.5)
    acceleration = once.forces() / system.coherent_masses[:, None]
    once.run(1)
    assert once.state.velocities == pytest.approx((v + 0.1 * acceleration) * (1 - 0.05), rel=1e-12)


def test_options_of_a_users_own_are_in_files_lists_and_texts(system, damped, tmp_path, kickdrift):
    path = tmp_path / "run.h5md"
    sim = kd.Simulation(system, kd.integrator(damped, friction=0.25), 0.1)
    sim.run(4, every=2, output=path)
    with kd.open(path) as run:
        assert run.method["options"]["friction"] == run.method["friction"] == 0.25
        assert run.report["options"]["friction"] == 0.25
    resumed = kd.resume(path, step=2)
    assert resumed.options == sim.options
    resumed.run(2)
    assert resumed.state.phase.tobytes() == sim.state.phase.tobytes()
    other = kd.Simulation(system, damped, 0.1, friction=0.5)
    with pytest.raises(InputError, match=r"checkpoint: friction is 0\.25 in the checkpoint and 0\.5 in this run"):
        other.restore(sim.checkpoint())
    file = tmp_path / "x.toml"
    text = system.source.replace("[run]", '[run]\nintegrator = "damped"\nfriction = 0.75')
    file.write_text("\n".join(line for line in text.split("\n") if not line.startswith('integrator = "wisdom')))
    assert kd.Simulation(kd.load(file)).options.friction == 0.75
    status, out, err = kickdrift("run", str(file), "-o", "friction=0.5", "-o", "halves=2", "--steps", "3", "--quiet")
    assert (status, err) == (0, "")
    assert "damped, dt = 0.5 yr, friction = 0.5, halves = 2" in out
    status, out, _ = kickdrift("list", "integrators", damped)
    assert status == 0
    assert "Rate at which velocities decay." in out
    assert kickdrift("run", str(file), "-o", "fricton=1")[::2] == (
        2, "kickdrift: fricton: no integrator takes such an option; did you mean 'friction', which baoab, obabo, aboba "
        "and 6 others take?\n",
    )  # fmt: skip


@pytest.mark.parametrize(("options", "message"), [
    ([kd.Option("way", str, "Way.", "a", ("a", "b"))], "option way: of a compiled step is a number or a switch"),
    ([kd.Option("rate", float, "Rate.")], "option rate: .* has a default"),
    ([kd.Option("order", float, "Order.", 1.0)], "option order: is a name of other methods; give yours another name"),
    ([kd.Option("rate", float, "Rate.", 1.0)] * 2, "option rate: is declared already"),
    (["rate"], "options: expected kd.Option"),
])  # fmt: skip
def test_options_that_a_step_cannot_have_are_refused(options, message):
    with pytest.raises(InputError, match=message):
        kd.register_step("own", order=1, source="x", options=options)


# --- the command line and files ---


def test_the_command_line_takes_any_option(kickdrift, tmp_path):
    path = tmp_path / "run.h5md"
    status, out, _ = kickdrift("run", "sun-jupiter", "-o", "corrector=5", "-o", "dt=0.25", "--coordinates", "jacobi",
        "--compensated", "--double", "--steps", "4", "--output", str(path),
    )  # fmt: skip
    assert status == 0
    assert "wisdom-holman, dt = 0.25 yr, compensated = True, coordinates = jacobi, corrector = 5" in out
    with kd.open(path) as run:
        options = run.method["options"]
        own = {"dt": 0.25, "compensated": True, "coordinates": "jacobi", "corrector": 5, "precision": "double"}
        assert {key: options[key] for key in own} == own
        assert list(options) == ["dt", *OPTIONS]
        own = ["integrator", "dt", "steps", "time", "every", "interval", "times"]
        assert list(run.system_record["run"]) == [*own, *OPTIONS]
    assert kickdrift("run", "ode-kepler", "-o", "controller=pid", "--time", "1")[0] == 0


@pytest.mark.parametrize(("arguments", "message"), [
    (("run", "sun-jupiter", "-o", "corector=3"), "corector: no integrator takes such an option; did you mean 'corr"),
    (("run", "sun-jupiter", "-o", "corrector=x"), "corrector: expected one of 0, 3, 5, 7, 11, 17, got 'x'"),
    (("run", "sun-jupiter", "-o", "corrector=4"), "corrector 4 is unknown; known are 0, 3, 5, 7, 11, 17"),
    (("run", "sun-jupiter", "-o", "eta=0.1"), "eta: wisdom-holman does not take it; it takes dt, coordinates, "),
    (("run", "sun-jupiter", "-o", "corrector"), "-o: expected KEY=VALUE, such as corrector=17, got 'corrector'"),
    (("run", "sun-jupiter", "-o", "eta=1", "--eta", "1"), "-o eta: is given twice"),
    (("run", "sun-jupiter", "-o", "precision=double", "--mixed"), "-o precision: is given twice"),
    (("run", "sun-jupiter", "--max-step", "long"), "--max-step: expected a number, got 'long'"),
    (("run", "sun-jupiter", "--rtol", "1e-3,x"), "--rtol: expected a number, or numbers with commas between them, got"),
    (("compare", "sun-jupiter", "--integrator", "saba", "-o", "corrector=3"), "corrector: saba does not take it"),
    (("compare", "sun-jupiter", "-o", "rtol=1e-3"), "rtol: compare sets it"),
    (("chaos", "sun-jupiter", "-o", "eta=0.1"), "eta: dop853 does not take it"),
    (("ensemble", "sun-jupiter", "-o", "corector=3"), "corector: no integrator takes such an option"),
    (("list", "integrators", "sabba"), "integrator 'sabba' is unknown; did you mean saba"),
    (("list", "forces", "gravity"), "list forces gravity: only integrators are explained by name"),
])  # fmt: skip
def test_the_command_line_refuses_in_one_line(kickdrift, arguments, message):
    status, out, err = kickdrift(*arguments)
    assert (status, out) == (2, "")
    assert message in err
    assert err.count("\n") == 1


@pytest.mark.parametrize("name", ["hermite4", "gauss-radau15", "leapfrog"])
def test_the_list_explains_a_method_and_its_options(kickdrift, name):
    status, out, err = kickdrift("list", "integrators", name)
    assert (status, err) == (0, "")
    method = kd.integrator(name).method
    text = " ".join(out.split())
    for word in (method.family, method.source, method.use, f"order {method.order}"):
        assert " ".join(word.split()) in text
    for option in method.options:
        assert re.search(rf"^ *{option.name} ", out, re.MULTILINE)
        assert option.fallback in out
        assert option.known in out


def test_the_files_numbers_are_stored_under_one_name(kickdrift, tmp_path):
    path = tmp_path / "run.h5md"
    run = ("run", "sun-jupiter", "--steps", "4", "--output", str(path), "--overwrite")
    assert kickdrift(*run, "--store", "float32", "--quiet")[2] == ""
    with kd.open(path) as found:
        assert found.options.store == "float32"
    status, _, err = kickdrift(*run, "--precision", "float32")
    assert status == 0
    assert "warning: --precision is deprecated since 0.2 and goes in 0.3; use --store" in err
    with kd.open(path) as found:
        assert found.options.store == "float32"
    assert kickdrift(*run, "--precision", "float32", "--store", "float32")[0] == 2
    with pytest.warns(DeprecationWarning, match="deprecated since 0.2; use store=…"):
        old = kd.FileOptions(precision="float32")
    assert old == kd.FileOptions(store="float32")
    with pytest.warns(DeprecationWarning, match="deprecated since 0.2; use store"):
        assert old.precision == "float32"


def test_the_documentation_has_the_table_of_options():
    page = (DOCS / "integrators.md").read_text(encoding="utf-8")
    assert page.split(BEGIN)[1].split(END)[0].strip() == options_table()
    assert all(f"| `{name}` |" in options_table() for name in known_options())
