"""Barostats: exact distributions of the volume, the same bits, quantities that are conserved, and refusals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

import kickdrift as kd
from kickdrift.errors import InputError, RunError
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.integrators import integrator
from kickdrift.integrators.asked import settled
from kickdrift.integrators.options import Options
from kickdrift.integrators.splitting.barostats import barostat as barostat_module
from kickdrift.integrators.splitting.barostats.barostat import Barostat, check_pressed, every_of
from kickdrift.looks.pressure import instantaneous_pressure
from kickdrift.model.live_box import LiveBox, in_box
from kickdrift.model.run_defaults import RunDefaults
from kickdrift.systemfile.reading import loads
from tests.long import rest
from tests.systems import SPECIES, liquid, needed

BAROSTATS = {
    "c-rescale": {"pressure_tau": 0.5, "compressibility": 1.0, "pressure_every": 2},
    "mtk": {"pressure_tau": 0.5},
    "monte-carlo": {"compressibility": 1.0, "pressure_every": 4},
}


def options_of(barostat, name="nose-hoover", **more):
    """A pressure, and what bath and barostat need."""
    return needed(name) | {"pressure": 1.0, "barostat": barostat} | BAROSTATS[barostat] | more


def ideal_gas(count, dimensions=3, seed=5):
    rng = np.random.default_rng(seed)
    edge = count ** (1 / dimensions)
    v = rng.normal(size=(count, dimensions))
    return kd.System(
        rng.uniform(0, edge, (count, dimensions)), v - v.mean(axis=0), box=(edge,) * dimensions, dimensions=dimensions
    )


def volumes(sim, count, every):
    found = []
    sim.advance(1000)
    sim.advance(count * every, every=every, visit=lambda run: found.append(run.state.box))
    return np.array([box.volume if math.isfinite(box.volume) else box.area for box in found])


@pytest.mark.parametrize(
    ("barostat", "name", "dimensions", "coupling"),
    [
        ("c-rescale", "baoab", 3, "isotropic"),
        ("c-rescale", "csvr", 3, "semi-isotropic"),
        rest("c-rescale", "nose-hoover", 2, "isotropic"),
        rest("mtk", "nose-hoover", 3, "isotropic"),
        ("mtk", "nose-hoover", 3, "per-axis"),
        rest("mtk", "nose-hoover", 2, "isotropic"),
        rest("monte-carlo", "baoab", 3, "isotropic"),
        ("monte-carlo", "csvr", 3, "per-axis"),
        rest("monte-carlo", "nose-hoover", 2, "per-axis"),
    ],
)
def test_the_volume_of_an_ideal_gas_has_its_gamma_law(barostat, name, dimensions, coupling):
    """The volume of f / d particles has the density V^(f / d) exp(-P V / k_B T): a gamma law of shape f / d + 1."""
    system = ideal_gas(20, dimensions)
    strong = {"friction": 2.0} if name == "baoab" else {"tau": 0.2}
    sim = kd.Simulation(system, name, 0.02, **options_of(barostat, name, coupling=coupling, **strong))
    found = volumes(sim, 1000, 100)
    freedom = dimensions * (20 if name == "baoab" else 19)
    law = stats.gamma(freedom / dimensions + 1)
    assert stats.kstest(found[::2], law.cdf).pvalue > 1e-3
    assert abs(found.mean() - law.mean()) < 4 * law.std() / math.sqrt(len(found) / 2)


@pytest.mark.parametrize("mixed", [False, True])
def test_no_pair_is_missed_while_the_box_changes(mixed):
    """Energy and number of pairs are those of a list made anew, whatever the scaling of the axes."""
    system, rng = liquid(512, 2.0), np.random.default_rng(7)
    live = LiveBox(system.box)
    lengths, start = live.lengths, live.lengths.copy()
    forces = BoundForces(system, live=live, mixed=mixed)
    phase, searches, begun = system.state.phase.copy(), [], rng.uniform(0.0, 2.0 * math.pi, (3, 512))
    for k in range(120):
        factors = np.exp(rng.normal(0.0, 0.02, 3) - 0.3 * np.log(lengths / start))
        lengths *= factors
        here = system.state.phase[0] + 0.15 * np.sin(begun + 0.3 * k)
        phase[0] = here * (lengths / start)[:, None]
        fresh = in_box(system.at(phase, 0.0), kd.Box(lengths.tolist()))
        found, wanted = forces.measure(0.0, phase), BoundForces(fresh, mixed=mixed).measure(0.0, phase)
        assert found.pairs == wanted.pairs
        assert found.potential == pytest.approx(wanted.potential, rel=1e-5 if mixed else 1e-11)
        size = np.abs(wanted.accelerations).max()
        assert np.allclose(found.accelerations, wanted.accelerations, rtol=0, atol=(1e-5 if mixed else 1e-11) * size)
        searches.append(forces.list_builds[0])
    assert 2 < searches[-1] < 100  # lists were kept over changes of the box


def test_tail_corrections_belong_to_the_box_of_now():
    x = liquid(125, 2.0)
    system = kd.System(x.state.positions, box=x.box, forces=[kd.LennardJones(cutoff=2.0, truncation="cut", tail=True)])
    live = LiveBox(system.box)
    forces = BoundForces(system, live=live)
    forces.measure(0.0, system.state.phase)
    live.lengths *= (1.02, 1.05, 1.1)
    phase = system.state.phase * np.array([1.02, 1.05, 1.1])[None, :, None]
    fresh = kd.System(phase[0].T, box=live.box, forces=system.forces)
    found, wanted = forces.measure(0.0, phase), BoundForces(fresh).measure(0.0, phase)
    assert found.potential == pytest.approx(wanted.potential, rel=1e-12)
    assert found.virial == pytest.approx(wanted.virial, rel=1e-12)


@pytest.mark.parametrize("species", [None, pytest.param(SPECIES, marks=pytest.mark.long)])
def test_the_virial_along_each_axis(species):
    x = liquid(512, 2.0)
    law = kd.LennardJones(cutoff=2.0, truncation="shift", **({"species": species} if species else {}))
    kinds = (["A", "B", "C", "A", "B"] * 103)[:512] if species else None
    system = kd.System(x.state.positions, box=x.box, forces=[law], species=kinds)
    forces = BoundForces(system, live=LiveBox(system.box), apart=True)
    forces.measure(0.0, system.state.phase)
    wanted = np.diag(instantaneous_pressure(system, system.state.positions, 0 * system.state.positions))
    assert forces.along.sum(axis=0) / system.volume == pytest.approx(wanted, rel=1e-10)


@pytest.mark.parametrize(
    ("barostat", "coupling"), [("c-rescale", "isotropic"), ("mtk", "per-axis"), ("monte-carlo", "isotropic")]
)
def test_the_same_bits_however_a_run_is_cut(barostat, coupling):
    system = liquid(512, 2.5)
    options = options_of(barostat, coupling=coupling) | {"pressure": 0.5}
    options |= {"compressibility": 0.05, "pressure_every": 7} if barostat != "mtk" else {}

    def made(threads=1):
        return kd.Simulation(system, "nose-hoover", 0.004, threads, temperature=1.2, tau=0.5, **{
            key: value for key, value in options.items() if key not in ("temperature", "tau")
        })  # fmt: skip

    def end(sim):
        return sim.state.phase.tobytes() + repr(sim.state.box).encode()

    whole = made()
    whole.run(300, every=300)
    looked = made(2)
    looked.run(300, every=3)
    assert end(looked) == end(whole)
    cut = made()
    cut.advance(101)
    cut.advance(7)
    kept = cut.checkpoint()
    cut.run(192)
    assert end(cut) == end(whole)
    again = made(2)
    again.restore(kept)
    assert again.state.box.lengths != system.box.lengths
    again.run(192, every=5)
    assert end(again) == end(whole)
    assert again.box_varies


@pytest.mark.parametrize(
    ("barostat", "name", "own"),
    [("mtk", "nose-hoover", {}), ("mtk", "nose-hoover", {"pressure_every": 4}), ("c-rescale", "csvr", {})],
)
def test_energy_less_heat_and_work_is_conserved_to_second_order(barostat, name, own):
    errors, x = [], liquid(64, 1.6)
    law = kd.LennardJones(cutoff=1.6, truncation="switch", switch_start=1.2)
    system = kd.System(x.state.positions, x.state.velocities, box=x.box, forces=[law])
    for dt in (0.004, 0.002):
        options = options_of(barostat, name) | ({} if barostat == "mtk" else {"compressibility": 0.05}) | own
        sim = kd.Simulation(system, name, dt, **options)
        report = sim.run(round(1.6 / dt), every=round(0.016 / dt))
        totals = np.array([sample.energies.total for sample in sim.record.samples])
        conserved = totals + [sample.taken.energy for sample in sim.record.samples]
        errors.append(np.abs(conserved - conserved[0]).max())
        assert np.ptp(totals) > 50 * errors[-1]
        assert report.work == sim.integration.stepper.work != 0
    assert 1.6 < math.log2(errors[0] / errors[1]) < 2.4


def test_a_report_knows_the_pressure():
    sim = kd.Simulation(
        liquid(64, 1.5), "csvr", 0.004, temperature=1.5, tau=0.1, pressure=5.0, pressure_tau=0.2, compressibility=0.05
    )
    sim.equilibrate(1.5, 4.0)
    report = sim.run(6000, every=10)
    found = [sample.volume for sample in sim.record.samples]
    assert report.volume == pytest.approx(np.mean(found))
    assert np.std(found) > 0.5
    assert sim.record.samples[-1].volume == sim.state.box.volume
    assert 0 < report.volume_error < np.std(found)
    assert report.pressure_verdict == report.as_json()["pressure_verdict"] == "agrees"
    lines = {line[:17].strip(): line[18:] for line in str(report).splitlines()}
    assert lines["pressure"].endswith("(mean), asked 5 ε/σ^3: agrees")
    assert lines["volume"].endswith("σ^3 (mean)")
    assert lines["work"] == f"{report.work:.8g} ε from the change of the box"
    assert lines["energy drift"].endswith("(energy less heat and work)")
    fixed = kd.Simulation(liquid(64, 1.5), "csvr", 0.004, temperature=1.5, tau=0.1).run(20)
    assert fixed.volume is fixed.work is fixed.pressure_verdict is fixed.volume_error is None


def test_springs_stretch_with_the_box():
    """A spring over the edge of the box: the pressure follows from the energies of two boxes."""
    pairs = [(0, 1), (1, 2), (2, 0)]
    system = kd.System(
        [[0.5, 1, 1], [9.0, 2, 1], [7.0, 1, 2]], [[0.1, 0, 0], [0, 0.1, 0], [-0.1, -0.1, 0]], box=(10.0,) * 3,
        forces=[kd.Springs(pairs, stiffness=2.0, length=1.0)],
    )  # fmt: skip
    sim = kd.Simulation(system, "csvr", 0.01, **options_of("c-rescale", "csvr", pressure=0.01))
    sim.run(400)
    now = sim.state
    assert now.box.lengths != system.box.lengths
    fresh = kd.System(now.positions, now.velocities, box=now.box, forces=system.forces)
    assert sim.energy().potential == pytest.approx(kd.Simulation(fresh, dt=0.01).energy().potential, rel=1e-12)


def test_a_box_that_shrinks_below_twice_the_cutoff_stops_the_run():
    sim = kd.Simulation(
        liquid(125, 2.4), "csvr", 0.004, temperature=1.0, tau=0.5, pressure=30.0, pressure_tau=1.0, compressibility=0.05
    )
    with pytest.raises(
        RunError, match=r"would make box edge x 4\.7\d*, shorter than twice the cutoff, 2 x 2\.4 = 4\.8"
    ) as at:
        sim.run(5000, every=10)
    assert "stopped at step" in str(at.value)
    assert at.value.state.box == sim.state.box
    assert min(sim.state.box.lengths) >= 4.8


@pytest.mark.parametrize(
    ("name", "options", "line"),
    [
        ("csvr", {"pressure": math.inf}, "pressure must be a finite number, got inf"),
        ("csvr", {"pressure": "1 bar"}, "pressure: lj quantities are plain numbers, got '1 bar'"),
        ("csvr", {"pressure_tau": 0}, "pressure_tau must be a positive finite time, got 0"),
        ("csvr", {"pressure_tau": None}, "pressure_tau is needed: barostat c-rescale has no default"),
        ("csvr", {"compressibility": None}, "compressibility is needed: barostat c-rescale has no default"),
        ("csvr", {"pressure": None}, "barostat: is an option of a barostat, which needs a pressure"),
        ("csvr", {"barostat": "mtk"}, "barostat: mtk goes with nose-hoover, not with csvr"),
        ("nose-hoover", {"barostat": "mtk"}, "compressibility: barostat mtk does not take it; it takes pressure_tau"),
        ("csvr", {"barostat": "berendsen"}, "barostat 'berendsen' is unknown; known are c-rescale, mtk, monte-carlo"),
        ("csvr", {"coupling": "xy"}, "coupling 'xy' is unknown; known are isotropic, semi-isotropic, per-axis"),
        ("velocity-verlet", {}, "pressure: velocity-verlet does not take it; .* velocity-verlet has no heat bath"),
    ],
)
def test_barostats_refuse_numbers_that_make_no_sense(name, options, line):
    given = {
        **(options_of("c-rescale", "csvr", pressure_every=None) if name != "velocity-verlet" else {"pressure": 1.0})
    }
    given |= options
    with pytest.raises(InputError, match=f"^{line}"):
        kd.Simulation(liquid(64, 2.0), name, 0.004, **given)


def test_barostats_refuse_boxes_and_forces_that_do_not_scale():
    x, law = liquid(64, 2.0).state.positions, kd.LennardJones(cutoff=2.0)
    options = options_of("c-rescale", "csvr")
    for box, forces, line in (
        (None, [law], "pressure: 'system' is a system in open space, which has no volume"),
        (
            kd.Box((5, 5, 5), periodic=(True, True, False)),
            [law],
            "pressure: .* open along an axis, which has no volume",
        ),
        ((5, 5, 5), [kd.UniformField([0, 0, 1.0])], "pressure: force 'uniform-field' does not scale with the box"),
    ):
        with pytest.raises(InputError, match=f"^{line}"):
            kd.Simulation(kd.System(x, box=box, forces=forces), "csvr", 0.004, **options)
    plane = ideal_gas(16, 2)
    with pytest.raises(InputError, match="coupling: semi-isotropic needs three dimensions"):
        kd.Simulation(plane, "csvr", 0.004, **options, coupling="semi-isotropic")
    with pytest.raises(InputError, match="a barostat acts between whole steps"):
        kd.Simulation(liquid(64, 2.0), "csvr", 0.004, **options).run(until=0.0101, exact="shorten")


def test_a_leaning_box_stops_at_its_height():
    start = liquid(125, 2.2)
    edge = start.box.lengths[0]
    box = kd.Box(matrix=[[edge, 0, 0], [0.4 * edge, edge, 0], [0, 0, edge]])
    system = kd.System(start.state.positions, start.state.velocities, box=box, forces=start.forces)
    options = options_of("c-rescale", "csvr", pressure=60.0, compressibility=0.05, pressure_tau=1.0)
    with pytest.raises(RunError, match=r"would make the box height across a 4\.[34]\d*, shorter than twice the cutoff"):
        kd.Simulation(system, "csvr", 0.004, **options).run(5000, every=10)
    with pytest.raises(InputError, match="coupling: per-axis needs a rectangular box; a leaning box takes isotropic"):
        kd.Simulation(system, "csvr", 0.004, **options, coupling="per-axis")


def test_forces_without_what_a_barostat_needs_say_so():
    class Stranger:
        name = "stranger"

        def check(self, system):
            """Take any system."""

        def bind(self, system, threads=1):
            raise NotImplementedError

    def trap(positions, velocities, time, box):
        return -positions, 0.5 * float(np.sum(positions**2))

    def gas(positions, velocities, time, box):
        return 0.0 * positions, 0.0, 0.0

    start = liquid(27, 1.4)
    for force, coupling, line in (
        (kd.PythonForce(trap), "isotropic", "pressure: force 'python' does not scale with the box: the function trap"),
        (kd.PythonForce(gas), "per-axis", "coupling: per-axis needs the virial along each axis, and the function gas"),
    ):
        system = kd.System(start.state.positions, box=start.box, forces=[force])
        with pytest.raises(InputError, match=f"^{line} returns"):
            kd.Simulation(system, "csvr", 0.004, **options_of("c-rescale", "csvr"), coupling=coupling)
    with pytest.raises(
        InputError, match=r"^pressure: force 'stranger' does not scale with the box: its class does not"
    ):
        check_pressed(start.with_forces(Stranger()), Options(**options_of("c-rescale", "csvr")))


def test_doubtful_choices_are_warnings():
    x = liquid(64, 1.5)
    system = kd.System(
        x.state.positions, x.state.velocities, box=x.box, forces=[kd.LennardJones(cutoff=1.5, truncation="cut")]
    )
    options = {"temperature": 1.0, "tau": 0.5, "pressure": 1.0, "pressure_tau": 0.02, "compressibility": 1e-4}
    options["pressure_every"] = 10
    warned = kd.Simulation(system, "csvr", 0.004, **options).run(20).warnings
    assert "pressure_tau = 0.02 is 5 steps; use 10 steps or more" in warned
    assert any("pressure_tau = 0.02 is 0.5 actions of the barostat; use 5 or more" in line for line in warned)
    assert any("the virial lacks this impulse" in line for line in warned)
    given = {**needed("nose-hoover"), "pressure": 1.0, "barostat": "mtk", "pressure_tau": 0.1, "pressure_every": 10}
    warned = kd.Simulation(system, "nose-hoover", 0.004, **given).run(20).warnings
    assert any("pressure_tau = 0.1 is 2.5 actions of the barostat; use 5 or more" in line for line in warned)


def test_by_default_c_rescale_acts_ten_times_in_its_time_or_every_30_steps():
    asked = [every_of("c-rescale", Options(dt=0.004, pressure_tau=tau)) for tau in (0.02, 0.4, 1.2, 5.0)]
    assert asked == [1, 10, 30, 30]
    assert every_of("c-rescale", Options(dt=0.004, pressure_tau=0.4, pressure_every=7)) == 7
    assert (every_of("mtk", Options(dt=0.004, pressure_tau=0.4)), every_of("monte-carlo", Options(dt=0.004))) == (1, 10)


def test_a_resumed_run_keeps_the_steps_between_actions_of_its_file(tmp_path, monkeypatch):
    """Files of older versions do not have these steps, and acted every 10 steps by default."""
    given = needed("baoab") | {"pressure": 1.0, "barostat": "c-rescale", "pressure_tau": 1.2, "compressibility": 1.0}
    memory = Barostat.memory
    with monkeypatch.context() as old:
        old.setattr(barostat_module, "MOST_STEPS", 10)
        old.setattr(Barostat, "memory", lambda self: {k: v for k, v in memory(self).items() if k != "every"})
        whole, cut = (kd.Simulation(liquid(), "baoab", 0.004, **given) for _ in range(2))
        whole.run(60, every=20)
        cut.run(35, every=20, output=tmp_path / "old.h5md")
        checkpoint = cut.checkpoint()
    with pytest.raises(
        InputError, match="pressure_every is 10 in the checkpoint and 30 in this run; give pressure_every"
    ):
        kd.Simulation(liquid(), "baoab", 0.004, **given).restore(checkpoint)
    told = kd.Simulation(liquid(), "baoab", 0.004, **given, pressure_every=10)
    told.restore(checkpoint)
    told.advance(25)
    assert np.array_equal(told.state.positions, whole.state.positions)
    resumed = kd.resume(tmp_path / "old.h5md")
    assert resumed.options.pressure_every == 10
    resumed.advance(25)
    assert np.array_equal(resumed.state.positions, whole.state.positions)
    kd.Simulation(liquid(), "baoab", 0.004, **given).run(35, every=20, output=tmp_path / "new.h5md")
    assert kd.resume(tmp_path / "new.h5md").options.get("pressure_every") is None


def test_another_barostat_takes_what_it_knows_of_a_file():
    """`-o barostat=monte-carlo` leaves the pressure_tau of the file out, since monte-carlo has none."""
    run = RunDefaults("csvr", 0.004, temperature=1.0, tau=0.5, pressure=1.0, pressure_tau=0.5, compressibility=0.1)
    options = settled(integrator("csvr"), {"barostat": "monte-carlo"}, run)
    assert (options.get("pressure_tau"), options.compressibility, options.pressure) == (None, 0.1, 1.0)
    asked = {"barostat": "monte-carlo", "pressure_tau": 2.0}
    assert settled(integrator("csvr"), asked, run).pressure_tau == 2.0  # which the run refuses
    assert settled(integrator("nose-hoover"), {"barostat": "mtk"}, run).get("compressibility") is None


def test_pressure_and_compressibility_have_units():
    x = liquid(64, 2.0)
    system = kd.System(
        x.state.positions * 3.4, masses=39.948, box=np.array(x.box.lengths) * 3.4, units="metal",
        forces=[kd.LennardJones(0.0103, 3.4, cutoff=6.8, truncation="shift")],
    )  # fmt: skip
    sim = kd.Simulation(
        system, "csvr", 0.002, temperature=90.0, tau="0.1 ps", pressure="1 bar", pressure_tau="1 ps",
        compressibility="2e-4 bar^-1",
    )  # fmt: skip
    assert sim.options["pressure"] == pytest.approx(6.241509074e-7)  # 1 bar in eV per cubic angstrom
    assert sim.options["pressure"] * sim.options["compressibility"] == pytest.approx(2e-4)


@pytest.mark.parametrize(("given", "found"), [("0", 0.0), ("-0.001", -0.001), ('"-1 GPa"', -1.0 / 160.2176634)])
def test_a_file_may_ask_for_no_pressure_or_a_pull(given, found):
    text = f"""
        units = "metal"
        particles = {{ lattice = "fcc", count = 256, density = "0.0846 angstrom^-3", mass = "63.546 u" }}
        force = [{{ type = "lennard-jones", cutoff = "5 angstrom", epsilon = "0.4 eV", sigma = "2.3 angstrom" }}]
        run = {{ integrator = "csvr", dt = "1 fs", temperature = "300 K", tau = "1 ps", pressure = {given} }}
    """
    assert loads(text).run.options["pressure"] == pytest.approx(found, rel=1e-9)
