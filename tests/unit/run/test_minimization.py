"""Minimization: known minima, random starts with overlaps, what the Simulation keeps, bad input, and the command."""

from __future__ import annotations

import json
import sys
import tomllib

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.run import minimization
from kickdrift.run.minimization import minimum
from kickdrift.run.push_off import STRENGTHS, soft_systems
from tests.oracle.forces import pair_oracle
from tests.refusals import assert_refused
from tests.systems import liquid

METHODS = ("fire", "l-bfgs")
DT = 0.004


def open_cluster(x):
    """Particles in open space, with a cutoff beyond all distances."""
    return kd.System(x, forces=[kd.LennardJones(cutoff=100.0, truncation="cut")])


def at_random(count=125, density=0.85, seed=4, nearest=1e-3, dimensions=3):
    """Particles drawn independently, so that many overlap; the first two are ``nearest`` apart."""
    rng = np.random.default_rng(seed)
    edge = (count / density) ** (1 / dimensions)
    x = rng.uniform(0, edge, (count, dimensions))
    x[1] = x[0]
    x[1, 0] += nearest
    force = kd.LennardJones(cutoff=2.0, truncation="switch")
    return kd.System(x, rng.normal(size=x.shape), box=(edge,) * dimensions, forces=[force], dimensions=dimensions)


def largest_force(system, x):
    """The largest force by the plain NumPy sum."""
    forces = pair_oracle(kd.System(x, box=system.box, forces=system.forces, dimensions=system.dimensions))[0]
    return np.linalg.norm(forces, axis=1).max()


# --- chains that cross ---


def melt(seed, tmp_path):
    """The chains of ``kickdrift new polymer``, as another seed draws them."""
    path = tmp_path / f"melt-{seed}.toml"
    path.write_text(kd.template("polymer").replace("seed = 1  #", f"seed = {seed}  #"))
    return kd.load(path, overlaps=True).with_stages()


def test_soft_systems_follow_the_laws_of_pairs_and_the_present_length_of_each_type_of_bond():
    bonds = kd.Topology([(0, 1), (1, 2)], angles=True, bond_types=["short", "long"])
    pairs = kd.LennardJones(species={"A": {}, "B": {"epsilon": 4.0, "sigma": 0.5}}, cutoff=2.5, truncation="shift")
    system = kd.System(
        [[0.0, 0, 0], [0.9, 0, 0], [0.9, 1.1, 0]], box=(9.0, 9.0, 9.0), species=["A", "B", "A"], topology=bonds,
        forces=[kd.Fene(30.0, 1.5), kd.HarmonicAngle(1.0, 90.0), pairs],
    )  # fmt: skip
    found = [softened for softened, force in soft_systems(system)]
    for strength, softened in zip(STRENGTHS, found, strict=True):
        soft, angle, spring = softened.forces
        law = soft.pair_law("A", "B")
        assert (law.A, law.sigma) == pytest.approx((2.0 * strength, 0.75 * 2 ** (1 / 6)))
        assert angle is system.forces[1]
        assert [spring.types[kind]["length"] for kind in ("short", "long")] == pytest.approx([0.9, 1.1])


@pytest.mark.long
@pytest.mark.parametrize("seed", range(1, 51))
def test_no_chain_catches_on_another_after_a_soft_start(seed, tmp_path):
    """Without it 24 of these 50 seeds have bonds of 1.33, most often three or six, which stay long in a run."""
    sim = kd.Simulation(melt(seed, tmp_path), "baoa", 0.005, temperature=1.0, friction=0.5)
    assert sim.minimize(force=1.0, soft=True).converged
    sim.run(500)
    sim.minimize(force=1.0)
    bonds = np.diff(sim.state.positions.reshape(40, 20, 3), axis=1)
    assert np.linalg.norm(bonds, axis=2).max() < 1.0


# --- known minima ---


@pytest.mark.parametrize("method", METHODS)
def test_a_trap_brings_particles_to_its_centre(method):
    system = kd.System([[3.0, 0.0, 1.0], [-1.0, 2.0, 0.5]], masses=[1.0, 20.0], forces=[kd.HarmonicTrap(2.0)])
    sim = kd.Simulation(system, dt=DT)
    found = sim.minimize(force=1e-9, method=method)
    assert found.converged
    assert found.max_displacement == np.inf
    np.testing.assert_allclose(sim.state.positions, 0.0, atol=1e-8)
    assert found.energy_at_start == pytest.approx(sim.system.forces[0].stiffness / 2 * (10.0 + 5.25))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("distance", [1e-3, 0.9, 1.5])
def test_a_dimer_has_the_length_of_the_closed_form(method, distance):
    sim = kd.Simulation(open_cluster([[0.0] * 3, [distance, 0.0, 0.0]]), dt=DT)
    found = sim.minimize(force=1e-8, method=method)
    assert found.converged
    first, second = sim.state.positions
    assert np.linalg.norm(second - first) == pytest.approx(2 ** (1 / 6), abs=1e-8)
    assert found.energy == pytest.approx(-1.0, abs=1e-14)


@pytest.mark.parametrize("method", METHODS)
def test_an_icosahedron_of_13_has_the_published_energy(method):
    from kickdrift_validation.minima import PUBLISHED, cluster

    sim = kd.Simulation(open_cluster(cluster(13)), dt=DT)
    found = sim.minimize(method=method)
    assert found.converged
    assert sim.energy().total == pytest.approx(found.energy, rel=1e-14)
    assert found.energy == pytest.approx(PUBLISHED[13], abs=1e-6)


# --- any start ---


@pytest.mark.parametrize("method", METHODS)
def test_a_random_start_with_overlaps_relaxes_and_equilibrates(method):
    system = at_random()
    found = kd.Simulation(system, dt=DT).minimize(method=method)
    assert found.converged
    assert found.energy_at_start > 1e30
    assert largest_force(system, found.system.state.positions) <= 1.01e-6
    sim = kd.Simulation(found.system, dt=DT)
    sim.equilibrate(1.0, 0.4)
    assert np.isfinite(sim.run(50).temperature)


def test_a_random_start_in_two_dimensions_stays_in_its_plane():
    system = at_random(count=100, density=0.7, dimensions=2)
    found = kd.Simulation(system, dt=DT).minimize()
    assert found.converged
    x = found.system.state.positions
    assert not x[:, 2].any()
    assert largest_force(system, x) <= 1.01e-6


@pytest.mark.parametrize("distance", [1e-30, 1e-200])
def test_forces_that_overflow_part_the_particles(distance):
    system = open_cluster([[0.0] * 3, [distance, 0.0, 0.0], [1.0, 1.5, 0.0]])
    found = minimum(system)
    assert found.converged
    assert found.energy == pytest.approx(-3.0, abs=1e-12)  # an equilateral triangle


@pytest.mark.parametrize("method", METHODS)
def test_no_particle_moves_further_than_the_cap_in_a_step(method, monkeypatch):
    cap, points = 0.02, []
    monkeypatch.setattr(minimization.BoundForces, "measure", noted(minimization.BoundForces.measure, points))
    start = at_random(count=64, seed=5)
    minimum(start, method=method, max_displacement=cap, steps=40)
    moves = np.linalg.norm(np.diff(points, axis=0), axis=1).max(axis=1)
    several = np.sqrt(3.0) if method == "l-bfgs" else 1.5  # along each axis; FIRE also steps back by half a step
    assert cap / 10 < moves.max() <= 2 * several * cap  # twice: to and fro between two trials


def noted(measure, points):
    def seen(self, time, phase):
        points.append(phase[0].copy())
        return measure(self, time, phase)

    return seen


# --- the Simulation afterwards ---


def test_velocities_are_zero_and_a_new_record_starts():
    sim = kd.Simulation(liquid(), dt=DT)
    sim.run(20)
    velocities = sim.state.velocities.copy()
    found = sim.minimize(force=1e-3)
    assert not sim.state.velocities.any()
    assert (sim.steps_done, sim.record.steps) == (20, 0)
    assert sim.time == pytest.approx(20 * DT)
    np.testing.assert_array_equal(found.system.state.velocities, velocities)
    np.testing.assert_array_equal(found.system.state.positions, sim.state.positions)
    assert found.system.state.time == 0.0
    assert sim.energy().kinetic == 0.0
    assert np.linalg.norm(sim.forces(), axis=1).max() == pytest.approx(found.largest_force, rel=1e-6)
    assert sim.run(5).energy.max_relative_error < 1e-3


def test_a_run_after_a_minimization_resumes_from_its_file(tmp_path):
    sim = kd.Simulation(at_random(), dt=DT)
    sim.minimize(force=1e-2)
    sim.run(10, output=tmp_path / "run.h5md")
    again = kd.resume(tmp_path / "run.h5md")
    again.run(10)
    sim.run(10)
    np.testing.assert_array_equal(again.state.positions, sim.state.positions)


def test_the_relaxed_system_is_a_system_file():
    found = minimum(at_random(count=27, density=0.2, nearest=0.1), force=1e-3)
    again = kd.load(tomllib.loads(found.system.to_toml()))
    np.testing.assert_array_equal(again.state.phase, found.system.state.phase)


def test_the_same_bits_on_any_number_of_threads():
    one, two = (minimum(at_random(), threads, steps=300) for threads in (1, 2))
    np.testing.assert_array_equal(one.system.state.positions, two.system.state.positions)


def test_progress_ends_at_the_last_step():
    told = []
    sim = kd.Simulation(open_cluster([[0.0] * 3, [1.5, 0.0, 0.0]]), dt=DT)
    found = sim.minimize(steps=200, progress=lambda done, of: told.append((done, of)))
    assert told == [*((k, 200) for k in range(1, found.steps + 1)), (200, 200)]


# --- what does not converge, and bad input ---


def test_too_few_steps_say_so():
    found = kd.Simulation(open_cluster([[0.0] * 3, [1.5, 0.0, 0.0]]), dt=DT).minimize(steps=3)
    assert not found.converged
    assert found.steps == 3
    assert "converged         no, the largest force is more than 1e-06, after 3 steps" in str(found)


def test_bodies_that_fly_apart_have_not_converged():
    system = kd.System([[0.0] * 3, [1.0, 0.0, 0.0]], forces=[kd.Gravity()], units="nbody")
    found = minimum(system, max_displacement=10.0, steps=2000)
    assert not found.converged
    assert found.trouble


@pytest.mark.parametrize(
    ("given", "part"),
    [
        ({"force": 0.0}, "force must be positive, got 0.0"),
        ({"force": float("nan")}, "force must be positive"),
        ({"force": "1 eV/angstrom"}, "force: lj quantities are plain numbers"),
        ({"steps": -1}, "steps"),
        ({"steps": 1.5}, "steps"),
        ({"method": "cg"}, "method: expected one of fire, l-bfgs, got 'cg'"),
        ({"method": None}, "method: expected one of fire, l-bfgs, got None"),
        ({"max_displacement": -0.1}, "max_displacement must be positive"),
        ({"soft": 1}, "soft must be True or False, got 1"),
        ({"progress": 3}, "progress must be True, False or a function"),
    ],
)
def test_bad_arguments_are_one_line_and_change_nothing(given, part):
    sim = kd.Simulation(liquid(), dt=DT)
    before = sim.state.positions.copy()
    with pytest.raises(InputError, match=r"^minimize: ") as error:
        sim.minimize(**given)
    assert part in str(error.value)
    np.testing.assert_array_equal(sim.state.positions, before)


def test_units_of_force_and_length():
    system = kd.System(
        [[0.0] * 3, [4.5, 0.0, 0.0]], forces=[kd.LennardJones(0.0104, 3.4, cutoff=30.0, truncation="cut")],
        units="metal",
    )  # fmt: skip
    found = minimum(system, force="1e-8 eV/angstrom", max_displacement="0.02 nm")
    assert (found.force, found.max_displacement) == (1e-8, pytest.approx(0.2))
    first, second = found.system.state.positions
    assert np.linalg.norm(second - first) == pytest.approx(3.4 * 2 ** (1 / 6), abs=1e-5)
    assert "eV/angstrom" in str(found)


def test_what_cannot_be_minimized():
    with pytest.raises(InputError, match="a Problem has no forces"):
        kd.Simulation(kd.load("ode-harmonic"), dt=0.1).minimize()
    with pytest.raises(InputError, match=r"minimize: soft = true needs a pair force with epsilon and sigma"):
        kd.Simulation(kd.load("spring-net"), dt=0.1).minimize(soft=True)
    with pytest.raises(InputError, match="has no forces"):
        kd.Simulation(kd.System([[0.0] * 3]), dt=0.1).minimize()
    with pytest.raises(InputError, match="already running"):
        kd.Simulation(liquid(), dt=DT).run(1, observe=lambda sim: sim.minimize())


def test_overlaps_are_refused_before_the_first_step_only():
    sim = kd.Simulation(at_random(), dt=DT)
    for steps in (sim.run, sim.advance):
        with pytest.raises(InputError, match=r"particles 0 and 1 overlap: .*sim\.minimize\) moves them apart"):
            steps(1)
    sim.minimize(force=1e-2)
    sim.run(1)


# --- the command ---


@pytest.fixture
def start(tmp_path, monkeypatch):
    """A folder with random.toml, a random start that ``kickdrift run`` refuses."""
    monkeypatch.chdir(tmp_path)
    text = at_random().with_run(dt=DT, steps=10).to_toml()
    (tmp_path / "random.toml").write_text(text, encoding="utf-8")
    return tmp_path


def test_the_command_writes_a_system_that_runs(kickdrift, start):
    assert_refused(kickdrift("run", "random.toml"), "particles 0 and 1 overlap", "kickdrift relax")
    code, out, err = kickdrift("relax", "random.toml", "--output", "relaxed.toml", "--json", "relaxed.json")
    assert (code, err) == (0, "")
    assert "converged         yes" in out
    assert "written           relaxed.toml" in out
    found = json.loads((start / "relaxed.json").read_text(encoding="utf-8"))
    assert found["converged"]
    relaxed, given = kd.load("relaxed.toml"), kd.load("random.toml", overlaps=True)
    assert largest_force(relaxed, relaxed.state.positions) <= 1.01e-6
    np.testing.assert_array_equal(relaxed.state.velocities, given.state.velocities)
    assert kickdrift("run", "relaxed.toml", "--quiet")[0] == 0
    assert_refused(kickdrift("relax", "random.toml", "--output", "relaxed.toml"), "exists already")
    assert kickdrift("relax", "random.toml", "--output", "relaxed.toml", "--overwrite", "--force", 1e-2)[0] == 0


def test_the_command_fails_where_it_does_not_converge(kickdrift, start):
    code, out, err = kickdrift("relax", "random.toml", "--steps", 5, "--output", "part.toml")
    assert code == 1
    assert "converged         no" in out
    assert err == "warning: not converged: the largest force is more than 1e-06\n"
    assert (start / "part.toml").is_file()


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (["--force", "-1"], "force must be positive"),
        (["--force", "much"], "--force: 'much' is not a force such as 1e-6"),
        (["--method", "cg"], "expected one of fire, l-bfgs"),
        (["--steps", "-1"], "--steps: '-1' is not a whole number"),
        (["--strain", "0.2"], "strain must be at most 0.05, got 0.2"),
        (["--strain", "0"], "elastic_constants: strain must be a positive number"),
        (["--output", "out.h5md"], "the name must end in .toml"),
        (["--output", "random.toml", "--overwrite"], "is an input of this command"),
        (["--output", "mine.toml", "--overwrite"], "is not a system file that kickdrift wrote"),
    ],
)
def test_bad_input_of_the_command_is_one_line(kickdrift, start, arguments, part):
    (start / "mine.toml").write_text("# by hand\nunits = 'lj'\n", encoding="utf-8")
    before = {path.name: path.read_bytes() for path in start.iterdir()}
    assert_refused(kickdrift("relax", "random.toml", *arguments), part)
    assert {path.name: path.read_bytes() for path in start.iterdir()} == before


def test_fire_needs_no_scipy(monkeypatch):
    monkeypatch.setitem(sys.modules, "scipy.optimize", None)
    assert minimum(open_cluster([[0.0] * 3, [1.5, 0.0, 0.0]])).converged
    with pytest.raises(ImportError):
        minimum(open_cluster([[0.0] * 3, [1.5, 0.0, 0.0]]), method="l-bfgs")
