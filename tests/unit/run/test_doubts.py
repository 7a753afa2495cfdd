"""A report says when the trajectory is no good: its energy, speeds beyond light, and positions with too few digits."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

import kickdrift as kd
from kickdrift.cli.main import app
from kickdrift.looks.doubts import digits_doubt, energy_doubt
from kickdrift.trajectory.overview import overview
from kickdrift.trajectory.read.info import describe, info
from tests.systems import liquid, three_bodies

OFF = "the energy is off by"


@pytest.mark.parametrize(("name", "options"), [("hermite4", {"eta": 1.0}), ("dop853", {"rtol": 10.0})])
def test_no_verdict_stands_beside_a_wrong_energy(name, options):
    report = kd.Simulation(three_bodies(), name, **options).run(until=20.0)
    (warning,) = report.warnings
    assert report.energy.max_relative_error > 1.0
    assert warning.startswith(f"{OFF} {report.energy.max_relative_error:.3g} of the initial energy")
    assert report.energy.verdict == "unreliable"


def test_the_warning_is_in_the_text_the_json_and_the_file(tmp_path):
    path, system = tmp_path / "run.h5md", tmp_path / "three.toml"
    report = kd.Simulation(three_bodies(), "rk4", dt=0.5).run(200, every=2, output=path)
    (warning,) = report.warnings
    assert warning.startswith(OFF)
    assert f"warning           {warning}" in str(report)
    assert report.as_json()["warnings"] == info(path)["report"]["warnings"] == info(path)["warnings"] == [warning]
    assert ("warning", warning) in overview(path)
    assert describe(info(path)).count(warning) == 1
    system.write_text(three_bodies().to_toml())
    arguments = ["run", str(system), "--integrator", "rk4", "--dt", "0.5", "--steps", "200", "--quiet"]
    done = CliRunner().invoke(app, [*arguments, "--json", str(tmp_path / "run.json")])
    assert done.exit_code == 0
    assert OFF in done.stdout
    assert json.loads((tmp_path / "run.json").read_text())["warnings"][0].startswith(OFF)


def test_a_file_without_a_report_tells_it_by_its_samples(tmp_path):
    path = tmp_path / "run.h5md"

    def ends(sim):
        if sim.steps_done == 198:
            raise RuntimeError("ended")

    with pytest.raises(RuntimeError, match="ended"):
        kd.Simulation(three_bodies(), "rk4", dt=0.5).run(200, every=2, output=path, observe=ends)
    assert info(path)["report"] is None
    assert any(key == "warning" and text.startswith(OFF) for key, text in overview(path))
    assert any("unreliable" in text for _, text in overview(path))


def test_a_total_near_zero_is_no_sign_of_a_wrong_energy():
    """The total of a parabolic orbit, and of two particles that begin at rest where the energy of the pair is zero."""
    x, v = [[0, 0, 0], [1, 0, 0]], [[0, 0, 0], [0, 2**0.5, 0]]
    parabola = kd.System(x, v, [1, 1e-9], forces=[kd.Gravity()], units="nbody")
    pair = kd.System([[0, 0, 0], [1 + 1e-15, 0, 0]], forces=[kd.LennardJones(cutoff=2.5, truncation="cut")])
    for system in (parabola, pair):
        assert not kd.Simulation(system, "velocity-verlet", dt=0.002).run(500).warnings
    assert energy_doubt([1e-17, 1e-3], [0.0, 1.0]) == energy_doubt([0.0, 0.0], [0.0, 0.0]) == ""
    assert OFF in energy_doubt([1e-17, 0.2], [0.0, 1.0])
    assert energy_doubt([0.0, 5.0], np.full(2, np.nan)) == ""  # a Problem whose energy begins at zero has no scale


def test_forces_that_do_work_and_heat_baths_are_not_judged():
    slowed = kd.System([[1.0, 0, 0]], forces=[kd.HarmonicTrap(1.0), kd.LinearDrag(0.5)], units="nbody")
    report = kd.Simulation(slowed, "rk4", dt=0.01).run(2000)
    assert report.energy.max_relative_error > 0.9
    assert not report.warnings
    assert report.energy.verdict.startswith("not conserved")
    bath = kd.Simulation(liquid(), "baoab", dt=0.004, temperature=5.0, friction=5.0, seed=1).run(200)
    assert not [line for line in bath.warnings if OFF in line]


@pytest.mark.parametrize(("speed", "every"), [(10.0, 1), (0.3, 5)])
def test_speeds_beyond_light_are_told_wherever_a_look_meets_them(speed, every):
    """The slower body is fast at its pericentre alone, far from the first look and the last. The third body, with its
    relativity, is too light to matter."""
    forces = [kd.Gravity(), kd.PostNewtonian(c=5.0, central=2)]
    x, v = [[0, 0, 0], [1, 0, 0], [9, 0, 0]], [[0, 0, 0], [0, speed, 0], [0, 0, 0]]
    sim = kd.Simulation(kd.System(x, v, [1, 0, 1e-12], forces=forces, units="nbody"), "rk4", dt=0.001)
    speeds = []
    warnings = sim.run(
        1500, every=every, observe=lambda sim: speeds.append(np.abs(sim.state.velocities[1]).max())
    ).warnings
    assert speed == 10.0 or max(speeds) > 5.0 > 5.0 * max(speeds[0], speeds[-1]) / 4.0
    (warning,) = [line for line in warnings if "light" in line]
    assert warning.startswith("particle 1 moves at ")
    assert warning.endswith("times the speed of light, but relativity-1pn holds only for speeds far below it")
    again = kd.Simulation(sim.system, "rk4", dt=0.001)  # looks by compiled code
    assert warning in again.run(1500, every=every).warnings
    assert warning in again.run(200).warnings


def test_slow_bodies_under_relativity_have_no_warning_and_the_same_bits():
    forces = [kd.Gravity(), kd.PostNewtonian(c=100.0)]
    system = kd.System([[0, 0, 0], [1, 0, 0]], [[0, 0, 0], [0, 1, 0]], [1, 0], forces=forces, units="nbody")
    looked, straight = (kd.Simulation(system, "rk4", dt=0.01) for _ in range(2))
    assert not looked.run(300, every=1).warnings
    straight.advance(300)
    assert np.array_equal(looked.state.phase, straight.state.phase)


def test_positions_with_too_few_digits_are_told():
    near = liquid()
    edge = near.box.lengths[0]
    far = near.remade(positions=near.state.positions + edge * 2.0**44)
    report = kd.Simulation(far, dt=0.004).run(2)
    (warning,) = [line for line in report.warnings if "neighbouring numbers" in line]
    assert warning.endswith("so the forces are wrong; shift the origin to the particles")
    assert not kd.Simulation(near.remade(positions=near.state.positions + 64 * edge), dt=0.004).run(2).warnings


def test_each_body_counts_by_its_own_neighbour():
    """A body that has left the others needs no digits of their distances; a close pair far out does."""
    x = np.array([[0.0, 0, 0], [1, 0, 0], [1e12, 0, 0]])
    escaped = kd.System(x, forces=[kd.Gravity()], units="nbody")
    assert digits_doubt(escaped, escaped.state.phase[0]) == ""
    pair = kd.System([*x, [1e12, 1, 0]], forces=[kd.Gravity()], units="nbody")
    assert digits_doubt(pair, pair.state.phase[0]).startswith("particle 2 is at 1e+12")
    clones = kd.System([[0, 0, 0], [1, 0, 0], [1, 1e-11, 0]], masses=[1, 0, 0], forces=[kd.Gravity()], units="nbody")
    assert digits_doubt(clones, clones.state.phase[0]) == ""  # test particles do not feel each other
    soft = pair.with_forces(kd.Gravity(softening=1e4))
    assert digits_doubt(soft, soft.state.phase[0]) == ""
