"""Pair forces in mixed precision: pairs in float32, all else in float64."""

from __future__ import annotations

import json

import numpy as np
import pytest
from numba import typeof

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.forces.lists import list_code
from kickdrift.integrators import INTEGRATORS
from kickdrift.model.run_defaults import RunDefaults
from kickdrift.systemfile.files import shipped
from tests.systems import fluid, make_system

SIZES = (9, 33, 500)
SHAPES = ({"truncation": "switch"}, {"mixed": True})  # one species, and a mixture


def liquid(n: int = 512, **options) -> kd.System:
    x, edges = fluid(np.random.default_rng(4), n)
    v = np.random.default_rng(5).normal(0, 1, (n, 3))
    force = kd.LennardJones(cutoff=2.5, truncation="switch")
    return kd.System(x, v - v.mean(axis=0), box=edges, forces=[force], **options)


def simulation(threads: int = 1, **options) -> kd.Simulation:
    return kd.Simulation(liquid(), dt=0.002, threads=threads, precision="mixed", **options)


@pytest.mark.parametrize("shape", SHAPES, ids=("one species", "a mixture"))
@pytest.mark.parametrize("n", SIZES)
def test_forces_and_sums_are_those_of_float64_but_for_float32s_rounding(n, shape):
    x, edges = fluid(np.random.default_rng(n), n)
    system = make_system(x, edges, **shape)
    double, mixed = (BoundForces(system, mixed=mixed).measure(0.0, system.state.phase) for mixed in (False, True))
    off = np.abs(mixed.accelerations - double.accelerations).max() / np.abs(double.accelerations).max()
    # each coordinate is off by 2^-24 of the box, twice; r^-13 multiplies this by 13 at r = 0.75, the smallest distance
    # here
    assert off <= 2 * 13 / 0.6 * max(edges) * 2.0**-24
    assert off > 1e-9
    assert abs(mixed.pairs - double.pairs) <= 2  # pairs at the cutoff itself
    assert mixed.potential == pytest.approx(double.potential, rel=1e-5)
    assert mixed.virial == pytest.approx(double.virial, rel=1e-5)


@pytest.mark.parametrize("mixed", [False, True])
def test_the_disk_keeps_the_code_of_lists_and_forces(mixed):
    """Code that refers to an object of one process cannot be kept; then each process compiles for seconds."""
    system = liquid()
    (force,) = BoundForces(system, mixed=mixed).forces
    codes = [list_code._CODE[typeof(force.ready().pairs)], type(force)._compiled_for[typeof(force.ready().parts)]]
    assert not any(code._library.has_dynamic_globals for code in codes)


def test_an_open_box():
    x, _ = fluid(np.random.default_rng(2), 200)
    system = make_system(x, truncation="switch")
    double, mixed = (BoundForces(system, mixed=mixed).measure(0.0, system.state.phase) for mixed in (False, True))
    scale = np.abs(double.accelerations).max()
    assert 1e-9 * scale < np.abs(mixed.accelerations - double.accelerations).max() < 1e-4 * scale


def test_an_open_box_far_from_the_origin():
    """Positions in float32 count from the middle of the particles."""
    x, _ = fluid(np.random.default_rng(2), 200)
    system = make_system(x + 1e5, truncation="switch")
    double, mixed = (BoundForces(system, mixed=mixed).measure(0.0, system.state.phase) for mixed in (False, True))
    scale = np.abs(double.accelerations).max()
    assert mixed.pairs == double.pairs
    assert np.abs(mixed.accelerations - double.accelerations).max() < 1e-4 * scale


def test_empty_places_meet_nobody_in_a_large_thin_box():
    """Clusters as long as the box, a row's second particle an edge away, and empty places far outside."""
    for seed in range(20):
        x = np.random.default_rng(seed).uniform(0, 200.0, (12, 3))
        x[1] = x[0] + (0.9, 0.5, 0.3)
        system = make_system(x, (200.0, 200.0, 200.0), truncation="switch")
        double, mixed = (BoundForces(system, mixed=mixed).measure(0.0, system.state.phase) for mixed in (False, True))
        assert mixed.pairs == double.pairs
        assert mixed.potential == pytest.approx(double.potential, rel=1e-3)


def test_a_file_that_says_mixed_and_a_run_that_says_double(tmp_path):
    path = str(tmp_path / "run.h5md")
    system = kd.System(
        liquid().state.positions, liquid().state.velocities, box=liquid().box, forces=liquid().forces,
        run=RunDefaults(dt=0.002, precision="mixed"),
    )  # fmt: skip
    kd.Simulation(system, precision="double").run(10, every=5, output=path)
    assert kd.resume(path).options.precision == "double"
    assert kd.Simulation(system).options.precision == "mixed"


def test_momentum_is_conserved_as_in_float64_and_energy_nearly():
    """A report's energies are in float64, so they show the effect of rounded forces."""
    mixed, double = simulation(), kd.Simulation(liquid(), dt=0.002)
    for sim in (mixed, double):
        sim.run(2000, every=20)
    one, other = mixed.report(), double.report()
    assert one.momentum_error < 1e-14
    assert one.energy.initial == other.energy.initial
    assert one.energy.rms_relative_error < 1.5 * other.energy.rms_relative_error
    assert one.options == {"precision": "mixed"}
    assert other.options == {}


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: kd.Simulation(kd.load("figure-eight"), "rk4", dt=0.01, precision="mixed"),
            "mixed needs pair forces; .* has none",
        ),
        (
            lambda: kd.Simulation(kd.Problem(lambda t, y: [-y[0]], [1.0]), precision="mixed"),
            "precision: mixed needs pair forces; .* is an ODE",
        ),
        (
            lambda: kd.Simulation(liquid(), "leapfrog-exact", dt=0.01, precision="mixed"),
            "leapfrog-exact adds up forces of its own, and takes double alone",
        ),
        (
            lambda: kd.Simulation(kd.load("sun-jupiter"), "wisdom-holman", dt=0.1, precision="mixed"),
            "wisdom-holman adds up forces of its own, and takes double alone",
        ),
        (lambda: kd.Simulation(liquid(), dt=0.01, precision="half"), "precision 'half' is unknown; known are double"),
        (lambda: kd.Simulation(liquid(), dt=0.01, precision="mixed", engine="ase"), "does not offer 'mixed'"),
    ],
)
def test_what_cannot_be_is_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()


@pytest.mark.parametrize("name", ["backward-euler", "implicit-midpoint", "gauss-radau15", "rosenbrock", "bdf", "lsoda"])
def test_methods_that_solve_equations_take_float64_alone(name):
    dt = {"dt": 0.001} if INTEGRATORS[name].needs_dt else {}
    with pytest.raises(InputError, match=f"{name} solves equations to the rounding of float64, and takes double alone"):
        kd.Simulation(liquid(), name, precision="mixed", **dt)


def test_the_file_and_the_command_line(tmp_path, kickdrift):
    path, out, states = tmp_path / "liquid.toml", tmp_path / "out.json", []
    text, said = shipped()["lj-1000-switch"].read_text(encoding="utf-8"), 'precision = "mixed"'
    for flags, key in (([], ""), (["--mixed"], ""), ([], said), (["--double"], said)):
        path.write_text(text.replace("[run]", f"[run]\n{key}"), encoding="utf-8")
        out.unlink(missing_ok=True)
        assert kickdrift("run", path, "--steps", 2, "--json", out, "--quiet", *flags)[0] == 0
        states.append(json.loads(out.read_text())["options"])
    assert states == [{}, {"precision": "mixed"}, {"precision": "mixed"}, {"precision": "double"}]
