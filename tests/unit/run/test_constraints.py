"""Runs with constraints: pressure, temperatures, reports, files and refusals."""

from __future__ import annotations

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError, RunError
from kickdrift.looks.molecules import Molecules
from kickdrift.run.report.warnings import begins_badly
from kickdrift.trajectory.layout.checkpoints import decoded, encoded
from kickdrift.trajectory.overview import overview
from kickdrift.trajectory.read.info import info
from tests.long import rest


def triangles(scale: float = 1.0) -> kd.System:
    """Rigid Lennard-Jones triangles of unequal masses in a box, with all centres and the box scaled."""
    rng, n = np.random.default_rng(4), 27
    shape = np.array([[0.0, 0.0, 0.0], [0.6, 0.0, 0.0], [0.1, 0.5, 0.0]])
    masses = np.array([3.0, 1.0, 0.5])
    shape = shape - masses @ shape / masses.sum()
    centres = (np.indices((3, 3, 3)).reshape(3, -1).T + rng.uniform(-0.1, 0.1, (n, 3))) * 1.7
    turned = [shape @ np.linalg.qr(rng.normal(size=(3, 3)))[0].T for _ in range(n)]
    x = (scale * centres[:, None, :] + np.array(turned)).reshape(-1, 3)
    first = 3 * np.arange(n)
    pairs = np.concatenate([np.column_stack([first + a, first + b]) for a, b in ((0, 1), (0, 2), (1, 2))])
    topology = kd.Topology(exclusions=pairs)
    system = kd.System(
        x, None, np.tile(masses, n), [5.1 * scale] * 3, [kd.LennardJones(cutoff=2.2, truncation="force-shift")],
        topology=topology, constraints=[kd.Constraint(pairs=pairs)],
    )  # fmt: skip
    return system.with_velocities(temperature=1.5, seed=3)


@pytest.mark.long
def test_the_pressure_is_that_of_the_centres():
    """Potential energy against the volume, with molecules that keep their shape, and the motion of the centres."""
    system, h = triangles(), 1e-5
    sample = kd.Simulation(system, dt=0.001).run(0)
    low, high = (kd.Simulation(triangles(1.0 + side), dt=0.001).energy().potential for side in (-h, h))
    volume = system.volume
    slope = (high - low) / (volume * ((1 + h) ** 3 - (1 - h) ** 3))
    masses, v = system.coherent_masses.reshape(-1, 3), system.state.velocities.reshape(-1, 3, 3)
    centres = np.einsum("na,nac->nc", masses, v) / masses.sum(axis=1, keepdims=True)
    twice = float((masses.sum(axis=1) * (centres**2).sum(axis=1)).sum())
    assert sample.pressure == pytest.approx(twice / (3 * volume) - slope, rel=1e-7)


def test_the_pressure_of_the_centres_is_that_of_the_particles_with_their_constraint_forces():
    """For rigid molecules both are the same at each moment: the forces of constraints from Lagrange's multipliers."""
    system = triangles()
    sim = kd.Simulation(system, dt=0.001)
    pressure = sim.run(0).pressure
    held, masses, (x, v) = system.constraints, system.coherent_masses, system.state.phase
    a = sim.integration.flow.accelerations(system.state.phase, 0.0)
    slopes = held.gradients(x).toarray()
    i, j = held.pairs.T
    fast = ((v[:, i] - v[:, j]) ** 2).sum(axis=0)
    matrix = (slopes / np.tile(masses, 3)) @ slopes.T
    push = np.linalg.solve(matrix, -slopes @ a.ravel() - fast)
    free = kd.Simulation(system.remade(constraints=None), dt=0.001).run(0).pressure
    assert pressure == pytest.approx(free + float(push @ held.lengths**2) / (3 * system.volume), rel=1e-10)


def test_start_velocities_have_the_temperature():
    system = triangles()
    assert kd.Simulation(system, dt=0.001).run(0).temperature == pytest.approx(1.5, rel=1e-12)
    assert system.degrees_of_freedom == 6 * 27 - 3


def test_a_report_has_the_temperatures_of_the_motions_of_molecules():
    """Drawn velocities have one temperature; a molecule's parts add up to its kinetic energy."""
    system = triangles()
    sim = kd.Simulation(system, "baoab", dt=0.005, temperature=1.5, friction=2.0)
    report = sim.run(1000, every=10)
    found = report.molecules
    assert found.constraints == 81
    assert found.error < 1e-13
    assert (found.moved, found.lost) == (0.0, 0.0)
    assert set(found.temperatures) == {"translation", "rotation"}
    samples = sim.record.samples
    for sample in (samples[3], samples[-1]):
        parts = 81 * sample.columns["translation_temperature"] + 81 * sample.columns["rotation_temperature"]
        assert parts == pytest.approx(2.0 * sample.energies.kinetic, rel=1e-12)
    assert "rigid distances" in str(report)
    for kind, mean in found.temperatures.items():
        assert abs(mean - 1.5) < 5.0 * (found.errors[kind] or 0.1)


def test_a_flexible_part_vibrates():
    """A chain of three with rigid bonds has one vibration besides three translations and three rotations."""
    x = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.5, 0.8, 0.0]]
    x = np.concatenate([np.array(x) + 6.0 * k * np.eye(3)[0] for k in range(3)])
    pairs = [(3 * k + a, 3 * k + a + 1) for k in range(3) for a in range(2)]
    system = kd.System(x, None, box=[18.0] * 3, constraints=[kd.Constraint(pairs=pairs)])
    assert system.degrees_of_freedom == 18
    assert Molecules(system).freedoms == (6, 9, 3)


def hinged(massless: int = 0) -> kd.System:
    """Three molecules of a rigid and a flexible bond in a box, and free particles without mass."""
    x = [[6.0 * k + a, b, 0.0] for k in range(3) for a, b in ((0.0, 0.0), (1.0, 0.0), (1.5, 0.8))]
    v = np.random.default_rng(8).normal(size=(9 + massless, 3))
    topology = kd.Topology([(3 * k + a, 3 * k + a + 1) for k in range(3) for a in range(2)])
    return kd.System(
        x + [[3.0, 5.0, 5.0]] * massless, v, [1.0, 2.0, 3.0] * 3 + [0.0] * massless, [18.0] * 3,
        topology=topology, constraints=[kd.Constraint(pairs=[(3 * k, 3 * k + 1) for k in range(3)])],
    )  # fmt: skip


def test_the_motions_of_molecules_do_not_depend_on_the_image_of_a_bonded_particle():
    system = hinged()
    molecules, phase = Molecules(system), system.state.phase.copy()
    phase[0][:, [2, 5]] += [[18.0, 0.0], [0.0, -36.0], [0.0, 18.0]]
    np.testing.assert_allclose(molecules.heats(phase), molecules.heats(system.state.phase), rtol=1e-12)
    assert Molecules(system.at(phase, 0.0)).freedoms == molecules.freedoms == (6, 9, 6)


def test_a_free_particle_without_mass_has_no_heat():
    systems = hinged(massless=1), hinged()
    first, second = (Molecules(system) for system in systems)
    assert first.freedoms == second.freedoms
    heats = first.heats(systems[0].state.phase), second.heats(systems[1].state.phase)
    np.testing.assert_allclose(*heats, rtol=1e-12)


def test_a_file_keeps_the_constraints_and_a_resumed_run_the_bits(tmp_path):
    system, path = triangles(), tmp_path / "run.h5md"
    whole = kd.Simulation(system, dt=0.002)
    whole.run(20)
    kd.Simulation(system, dt=0.002).run(10, every=5, output=path)
    with kd.open(path) as run:
        read = run.system()
    np.testing.assert_array_equal(read.constraints.pairs, system.constraints.pairs)
    np.testing.assert_array_equal(read.constraints.lengths, system.constraints.lengths)
    np.testing.assert_array_equal(read.state.phase, system.state.phase)
    later = kd.resume(path)
    later.run(10)
    np.testing.assert_array_equal(later.state.phase, whole.state.phase)


def test_a_state_from_elsewhere_is_projected():
    system = triangles()
    sim = kd.Simulation(system, dt=0.002)
    rng = np.random.default_rng(6)
    other = system.at(system.state.phase + rng.normal(size=system.state.phase.shape) * 1e-3, 0.0).state
    sim.state = other
    assert np.abs(system.constraints.errors(sim.state.phase[0])).max() < 1e-14
    assert np.abs(system.constraints.rates(*sim.state.phase)).max() < 1e-13


def test_events_and_other_programs_refuse_constraints():
    system = triangles()
    with pytest.raises(InputError, match="constraints: only a native run keeps them"):
        kd.Simulation(system, "velocity-verlet", dt=0.001, engine="ase")
    with pytest.raises(InputError, match="events search the motion of free particles"):
        system.remade(box=None).watched([kd.CloseApproach(0.1)])


def pairs_of_an_ideal_gas(n: int = 27) -> kd.System:
    rng = np.random.default_rng(1)
    x = np.repeat(rng.uniform(0.0, 3.8, (n, 3)), 2, axis=0)
    x[1::2] += [0.5, 0.0, 0.0]
    held = kd.Constraint(pairs=np.arange(2 * n).reshape(n, 2), distance=0.5)
    system = kd.System(x, None, np.tile([1.0, 3.0], n), [3.8] * 3, constraints=[held])
    return system.with_velocities(temperature=1.0, seed=1)


def pressed(barostat: str, pressure: float, **more) -> kd.Simulation:
    own = {"pressure_tau": 1.0} if barostat == "c-rescale" else {}
    return kd.Simulation(
        pairs_of_an_ideal_gas(), "baoab", dt=0.05, temperature=1.0, friction=2.0, pressure=pressure, barostat=barostat,
        compressibility=1.0, pressure_every=2, **own, **more,
    )  # fmt: skip


@pytest.mark.parametrize("barostat", ["c-rescale", rest("monte-carlo")])
def test_a_barostat_moves_the_centres_of_molecules(barostat):
    """An ideal gas of N rigid pairs has the mean volume (N + 1) k_B T / P; 2 N particles have almost twice that."""
    n, pressure = 27, 0.5
    sim = pressed(barostat, pressure)
    report = sim.run(20_000, every=20)
    assert abs(report.volume - (n + 1) / pressure) < 5.0 * report.volume_error
    assert report.volume_error < 2.0
    assert abs(report.pressure - pressure) < 5.0 * report.pressure_error
    errors = sim.system.constraints.errors(sim.state.phase[0])
    assert np.abs(errors).max() < 1e-12


@pytest.mark.parametrize("barostat", ["c-rescale", "monte-carlo"])
def test_a_box_of_molecules_has_its_law_of_shapes(barostat):
    """A stress holds the shape of a gas of N rigid pairs, by the work H = s V0 (tr G G^T - 3) / 2 for G = h / h0.

    Scaling all edges at once shows that the mean of P V + s V0 tr G G^T / 3 is (N + 1) k_B T."""
    n, half, edge, found = 27, 0.25, 3.8, []
    sim = pressed(barostat, half, coupling="full", stress=[-half] * 3 + [0.0] * 3)

    def look(run):
        h = np.array(run.state.box.matrix)
        found.append(half * np.linalg.det(h) + half * edge * (h * h).sum() / 3.0)

    sim.advance(1000)
    sim.advance(20_000, every=20, visit=look)
    mean = kd.analysis.block_average(np.array(found))
    assert abs(mean.value - (n + 1)) < 5.0 * mean.error
    assert mean.error < 0.6
    assert np.abs(sim.system.constraints.errors(sim.state.phase[0])).max() < 1e-12


def test_a_run_at_constant_pressure_goes_on_with_the_same_bits():
    system = triangles()
    options = {"temperature": 1.5, "friction": 2.0, "pressure": 0.5, "pressure_tau": 1.0, "compressibility": 0.1}
    whole, parts, later = (kd.Simulation(system, "baoab", dt=0.005, **options) for _ in range(3))
    whole.run(37)
    parts.run(20)
    later.restore(decoded(encoded(parts.checkpoint())))
    later.run(17)
    np.testing.assert_array_equal(later.state.phase, whole.state.phase)


@pytest.mark.parametrize(("coupling", "every"), [rest("per-axis", 1), rest("full", 1), ("full", 4)])
def test_a_piston_on_molecules_conserves_the_energy_to_second_order(coupling, every):
    """Energy less heat and work, while the box moves: it has the pressure of the centres, and the motion of these."""
    system, errors = triangles(1.2), []
    for dt in (0.002, 0.001):
        sim = kd.Simulation(
            system, "nose-hoover", dt, temperature=1.5, tau=0.5, pressure=0.5, barostat="mtk", pressure_tau=1.0,
            coupling=coupling, pressure_every=every,
        )  # fmt: skip
        report = sim.run(round(0.48 / dt), every=round(0.016 / dt))
        totals = np.array([sample.energies.total for sample in sim.record.samples])
        conserved = totals + [sample.taken.energy for sample in sim.record.samples]
        errors.append(np.abs(conserved - conserved[0]).max())
        assert np.ptp(totals) > 200 * errors[-1]
        assert np.abs(sim.state.box.matrix - system.box.matrix).max() > 0.02
        assert report.molecules.error < 1e-13
        assert np.abs(system.constraints.rates(*sim.state.phase)).max() < 1e-13
        if coupling == "full":
            found = sim.record.samples[-1].columns["pressure_tensor"]
            assert np.mean(found[:3]) == pytest.approx(sim.pressure(), rel=1e-9)
    assert 1.6 < np.log2(errors[0] / errors[1]) < 2.4


def test_a_piston_on_molecules_goes_on_with_the_same_bits():
    system = triangles(1.1)
    options = {"temperature": 1.5, "tau": 0.5, "pressure": 0.5, "pressure_tau": 1.0, "coupling": "full"}
    whole, parts, later = (kd.Simulation(system, "nose-hoover", 0.004, barostat="mtk", **options) for _ in range(3))
    whole.run(37)
    parts.run(20)
    later.restore(decoded(encoded(parts.checkpoint())))
    later.run(17)
    np.testing.assert_array_equal(later.state.phase, whole.state.phase)
    assert later.state.box == whole.state.box


@pytest.mark.parametrize("barostat", ["c-rescale", "monte-carlo"])
def test_molecules_turn_with_the_frame_of_their_box(barostat):
    """Places and velocities stay on the manifold without a projection, whatever the shape of the box has become."""
    system = triangles(1.1)
    own = {"pressure_tau": 0.5} if barostat == "c-rescale" else {}
    sim = kd.Simulation(
        system, "csvr", 0.002, temperature=1.5, tau=0.5, pressure=0.5, barostat=barostat, coupling="full",
        compressibility=0.05, pressure_every=2, **own,
    )  # fmt: skip
    sim.run(200, every=1)
    held = system.constraints
    assert np.abs(np.array(sim.state.box.tilts)).max() > 0.01
    assert np.abs(held.errors(sim.state.phase[0])).max() < 1e-13
    assert np.abs(held.rates(*sim.state.phase)).max() < 1e-13


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_drift_in_numpy_is_that_of_the_compiled_flow(sign):
    """`compare` follows paths to the next bath on the manifold; a step without forces is one drift and a projection."""
    system, dt = triangles().with_forces([]), 0.05
    held, masses = system.constraints, system.coherent_masses
    sim = kd.Simulation(system, "velocity-verlet", dt=dt)
    sim.run(1)
    begin, end = (system.state.phase, sim.state.phase) if sign > 0 else (sim.state.phase, system.state.phase)
    x, v = held.drifted(masses, *begin, sign * dt)
    np.testing.assert_allclose(x, end[0], rtol=0.0, atol=1e-13)
    np.testing.assert_allclose(held.projected(masses, x, v)[1], end[1], rtol=0.0, atol=1e-11)


WATER = """
units = "metal"
[particles]
lattice = "sc"
count = 8
density = 0.02
molecule = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [-0.3333, 0.9428, 0.0]]
species = ["O", "H", "H"]
mass = { O = 16.0, H = 1.0 }
seed = 1
[topology]
bonds = [[0, 1], [0, 2]]
copies = 8
[[constraint]]
bonds = true
[[force]]
type = "uniform-field"
acceleration = [0.0, 0.0, 0.0]
"""
BAD = [
    ("copies = 8", "copies = 7", "topology.copies: the lattice has 8 molecules of 3 particles, and the"),
    ("bonds = true", "bonds = true\ndistance = 9.0", "keep 9 apart; it must be under 0.49 of the shortest box edge"),
    ("bonds = true", "pairs = [[0, 24]]", "constraint[0]: pair [0, 24]: there is no particle 24"),
    ("bonds = true", "bonds = true\ntolerance = 1e-20", "tolerance: expected a number from 1e-17, below which all is"),
    ("H = 1.0", "H = 0.0", "has no mass, and a constraint moves particles by their masses"),
    ("bonds = true", "pairs = [[0, 1], [0, 1]]", "constraint[0]: pairs[1] = [0, 1] is given twice"),
    (
        "bonds = true", "bonds = true\n[[constraint]]\npairs = [[0, 1]]\ndistance = 1.5",
        "particles 0 and 1 cannot be both 1 and 1.5 apart",
    ),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "message"), BAD)
def test_bad_constraints_are_one_line(old, new, message, tmp_path):
    path = tmp_path / "water.toml"
    path.write_text(WATER.replace(old, new), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        kd.load(path)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_constraint_between_two_molecules_is_a_warning(tmp_path):
    path = tmp_path / "water.toml"
    path.write_text(WATER.replace("bonds = true", "pairs = [[0, 3]]"), encoding="utf-8")
    found = begins_badly(kd.load(path))
    line = (
        "constraint: particle 0 and particle 3 are of two molecules of the topology, which the constraint joins to one"
    )
    assert line in found


def test_a_short_run_has_no_verdict_on_equipartition():
    """Many samples of a time in which the motions hardly exchange heat are few independent ones."""
    system = triangles()
    short = kd.Simulation(system, "velocity-verlet", dt=0.002).run(60, every=1).molecules
    assert short.verdict == "too short to judge equipartition"


def test_the_step_bias_is_that_of_forces_on_centres():
    """The part that the step takes from translation is dt^2 / 6 times the mean square of the forces on centres."""
    system = triangles()
    sim = kd.Simulation(system, "velocity-verlet", dt=0.004)
    bias = sim.run(10, every=5).molecules.step_bias
    a = sim.integration.flow.accelerations(sim.state.phase, 0.0)
    masses = system.coherent_masses
    centres = np.array([np.add.reduceat(masses * row, np.arange(0, 81, 3)) for row in a])
    expected = 0.004**2 / 6.0 * float((centres**2).sum() / masses[:3].sum()) / 78.0
    assert bias["translation"] == pytest.approx(expected, rel=1e-10)
    assert bias["rotation"] > 0
    assert not kd.Simulation(system, "baoab", dt=0.004, temperature=1.5, friction=2.0).run(4).molecules.step_bias


def test_the_step_bias_of_vibration_leaves_out_forces_along_rigid_distances():
    """A rigid triangle with springs along its sides, beside a pair on a spring: its pull of 9 alone makes vibration."""
    x = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.3, 0.9, 0.0], [5.0, 0.0, 1.0], [5.4, 0.3, 2.2]])
    springs = kd.Springs([[0, 1], [0, 2], [1, 2], [3, 4]], [500.0, 500.0, 500.0, 30.0], [0.0, 0.0, 0.0, 1.0])
    system = kd.System(
        x, None, [16.0, 1.0, 1.0, 2.0, 3.0], [20.0] * 3, [springs],
        topology=kd.Topology([(3, 4)]), constraints=[kd.Constraint(rigid=[[0, 1, 2]])],
    )  # fmt: skip
    bias = kd.Simulation(system, "velocity-verlet", dt=1e-3).run(0).molecules.step_bias
    assert bias["vibration"] == pytest.approx(1e-6 / 6.0 * 9.0**2 * (1 / 2.0 + 1 / 3.0), rel=1e-9)


def test_an_equilibration_counts_its_steps_from_its_start():
    sim = kd.Simulation(triangles(), "baoab", dt=0.6, temperature=1.5, friction=0.5)
    with pytest.raises(RunError, match=r"step \d+ of the equilibration") as caught:
        sim.equilibrate(1.5, steps=400)
    assert "step -" not in str(caught.value)


def test_info_and_cite_name_constraints_and_charges(tmp_path):
    path = tmp_path / "run.h5md"
    options = {"temperature": 1.5, "friction": 2.0, "pressure": 0.5, "pressure_tau": 1.0, "compressibility": 0.1}
    kd.Simulation(triangles(), "baoab", dt=0.005, **options).run(4, every=2, output=path)
    assert info(path)["constraints"] == 81
    text = "\n".join(" ".join(line) for line in overview(path))
    assert "constraints 81 rigid distances, largest relative error" in text
    sources = kd.cite(path)
    for doi in (
        "10.1016/0021-9991(77)90098-5",
        "10.1016/0021-9991(83)90014-1",
        "10.1098/rspa.2016.0138",
        "10.1063/5.0020514",
    ):
        assert doi in sources
