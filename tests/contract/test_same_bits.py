"""Contract tests over the registries: restarts, pieces and looks leave a run's bits unchanged.

A newly registered method or force is tested without further code. A checkpoint is turned into bytes and back, as in a
file, and restored in a Simulation that has never run.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from itertools import product
from typing import Any

import numpy as np
import pytest

import kickdrift as kd
from docs.studies import same_bits
from kickdrift.errors import InputError
from kickdrift.forces import FORCES
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.forces.many_body.base import ManyBodyForce
from kickdrift.forces.pairs.law import PairForce
from kickdrift.forces.pairs.lists import with_room
from kickdrift.integrators import integrator
from kickdrift.integrators.method import DOUBLE, PRECISIONS
from kickdrift.integrators.own.registration import REGISTERED
from kickdrift.integrators.stepping.step_control import CONTROLLERS
from kickdrift.trajectory.layout.checkpoints import decoded, encoded
from kickdrift_validation.example_forces import changed, charges, crystal, example, topology
from kickdrift_validation.problems import pendulum
from tests.long import rest, shortened
from tests.methods import METHODS, OF_EACH_FORM
from tests.processes import python
from tests.systems import in_frame, liquid, needed, pressed, tried_with

OURS_OF_FORCES = [name for name, cls in FORCES.items() if cls.__module__.startswith("kickdrift.")]
# The first force of each base class: the others are bound, and remember, in the same way. And the forces of a host.
OF_EACH_KIND = [*{FORCES[name].__mro__[1]: name for name in OURS_OF_FORCES[::-1]}.values(), "ase", "lammps"]
SHARED = (
    "lennard-jones 1 species, 4 chunks",
    "eam",
    "coulomb",
    "gravity",
    "gravity-tree",
    "harmonic-bond",
    "j2",
    "springs",
)
CLOCKS = {"wall_seconds": 0.0, "compile_seconds": 0.0, "spent": {}}  # values of a record in which any two runs differ


def planets() -> kd.System:
    """A star, two planets that meet, and a massless body."""
    r = np.array([1.0, 1.6, 2.3])
    x = np.concatenate([np.zeros((1, 3)), np.stack([r, 0.1 * r, 0.02 * r], axis=1)])
    v = np.concatenate([np.zeros((1, 3)), np.stack([-0.1 / r**0.5, 1.0 / r**0.5, 0.03 * r], axis=1)])
    return kd.System(
        x, v, masses=[1.0, 1e-3, 5e-4, 0.0], forces=[kd.Gravity()], units="nbody", names=["S", "A", "B", "c"]
    )


def small_liquid() -> kd.System:
    """A liquid whose force jumps at the cutoff. A fixed-point iteration would fail with a stage there; in these runs,
    none does."""
    return liquid(27, 1.5, seed=8)


def choices(name: str) -> list[dict[str, Any]]:
    """The method with default options, and with each value of each of its options that has names."""
    method = integrator(name)
    known: dict[str, tuple[Any, ...]] = {key: all for key, all in method.choices.items() if tried_with(name, key)}
    known |= {"compensated": (True,)} if "compensated" in method.tunable else {}
    known |= {"controller": tuple(CONTROLLERS)} if "controller" in method.tunable else {}
    return [{}, *({key: value} for key, values in known.items() for value in values[-3:] if value is not None)]


def subjects(name: str, **options: Any) -> list[Callable[..., kd.Simulation]]:
    """Functions that make Simulations with a method, one for each kind of subject that the method takes."""
    found = []
    for subject, dt in ((small_liquid, 0.002), (planets, 0.02), (pendulum, 0.05)):

        def make(subject=subject, dt=dt, **more) -> kd.Simulation:
            method = integrator(name)
            step = {"dt": dt} if method.needs_dt and "scheme" not in options else {}
            tolerance = {"rtol": 1e-6} if "rtol" in method.tunable else {}
            return kd.Simulation(
                in_frame(name, subject()), name, **(tolerance | step | needed(name) | pressed(options) | options | more)
            )

        try:
            make()
        except InputError:
            continue
        found.append(make)
    assert found, f"{name} with {options} takes no subject"
    return found


def through_bytes(value: Any) -> Any:
    """A checkpoint, or a part of it, as a file returns it."""
    return decoded(encoded({"value": value}))["value"]


def differences(one: Any, other: Any, path: str = "") -> list[str]:
    """Parts of two checkpoints that differ in a bit."""
    if type(one) is not type(other):
        return [f"{path}: {one!r:.60} and {other!r:.60}"]
    if isinstance(one, dict):
        assert one.keys() == other.keys(), path
        return [line for key in one for line in differences(one[key], other[key], f"{path}/{key}")]
    if isinstance(one, list):
        assert len(one) == len(other), path
        pairs = enumerate(zip(one, other, strict=True))
        return [line for k, (a, b) in pairs for line in differences(a, b, f"{path}/{k}")]
    if isinstance(one, np.ndarray):
        same = one.shape == other.shape and one.dtype == other.dtype and one.tobytes() == other.tobytes()
        return [] if same else [f"{path}: {one!r:.60} and {other!r:.60}"]
    return [] if one == other or (one != one and other != other) else [f"{path}: {one!r} and {other!r}"]


def kept(sim: kd.Simulation) -> dict[str, Any]:
    """The checkpoint as a file holds it."""
    return through_bytes(sim.checkpoint())


def but_for_clocks(checkpoint: dict[str, Any]) -> dict[str, Any]:
    return checkpoint | {"record": checkpoint["record"] | CLOCKS}


def bits(sim: kd.Simulation) -> bytes:
    state = sim.state
    return (state.phase if isinstance(sim.system, kd.System) else state.y).tobytes()


def assert_goes_on(make: Callable[..., kd.Simulation], first: Callable, then: Callable) -> kd.Simulation:
    """Check that a run with a checkpoint between ``first`` and ``then`` has the same bits when it continues, when a new
    Simulation continues it, and without a checkpoint. Returns the run."""
    whole, other, alone = make(), make(), make()
    first(whole)
    checkpoint = kept(whole)
    other.restore(checkpoint)
    assert differences(checkpoint, kept(other)) == []
    assert bits(other) == bits(whole)
    for sim in (whole, other):
        then(sim)
    assert bits(other) == bits(whole)
    assert other.time == whole.time
    assert differences(but_for_clocks(kept(whole)), but_for_clocks(kept(other))) == []
    first(alone)
    then(alone)
    assert bits(alone) == bits(whole)
    return whole


# --- every method ---


@pytest.mark.parametrize("chosen", [False, rest(True)], ids=["defaults", "choices"])
@pytest.mark.parametrize("name", METHODS)
def test_a_run_goes_on_from_a_checkpoint(name, chosen):
    """Fixed steps, with and without a pair list that is pruned before and after the checkpoint. An adaptive method is
    also stopped inside a step."""
    for options in choices(name)[1:] if chosen else [{}]:
        for make in subjects(name, **options):
            builds = []

            def first(sim, builds=builds):
                sim.run(45, every=11)
                if sim.method.chooses_steps:
                    sim.run(until=sim.time + 2.6 * sim.integration.stepper.last_step)
                    assert sim.checkpoint()["present"] is not None
                builds.append(sim.integration.flow.forces.list_builds)

            whole = assert_goes_on(make, first, lambda sim: sim.run(47, every=7))
            if builds[0][1] > 1 and not whole.method.chooses_steps:  # adaptive steps become tiny where the force jumps
                assert whole.integration.flow.forces.list_builds[1] > builds[0][1]


@pytest.mark.parametrize("name", shortened(METHODS, OF_EACH_FORM))
def test_looks_at_given_times_change_no_bit(name):
    """The steps stay as they are, and a run that was cut inside a step sees the same states."""
    for make in subjects(name):
        whole, timed, first, then = make(), make(), make(), make()
        whole.run(12)
        times = whole.time * np.array([0.13, 0.14, 0.5, 0.79, 1.0])
        seen: list[tuple[float, bytes]] = []
        timed.run(times=times, observe=lambda sim, seen=seen: seen.append((sim.time, bits(sim))))
        assert [time for time, _ in seen] == [0.0, *(pytest.approx(time, rel=1e-12) for time in times)]
        assert [seen[k][0] for k in (1, 2, 4)] == times[[0, 1, 3]].tolist()
        still = bits(make()) == bits(whole)  # respa kicks no pendulum
        assert still or len({state for _, state in seen}) == 6
        assert (timed.steps_done, timed.time) == (12, whole.time)
        again: list[tuple[float, bytes]] = []
        first.run(times=times[:2], observe=lambda sim, again=again: again.append((sim.time, bits(sim))))
        then.restore(kept(first))
        then.run(times=times[2:], observe=lambda sim, again=again: again.append((sim.time, bits(sim))))
        earlier_end_counts = whole.method.chooses_steps and whole.integration.moving.clocked
        if not earlier_end_counts:  # f has no value beyond the end
            assert again[:3] + again[4:] == seen
            assert again[3] == again[2]
        for sim in (whole, timed, then):
            sim.run(3)
        assert bits(timed) == bits(whole) == bits(then)


@pytest.mark.parametrize("name", shortened(METHODS, OF_EACH_FORM))
def test_pieces_and_looks_change_no_bit(name):
    for make in subjects(name):
        whole, pieces = make(), make()
        whole.run(40)
        if whole.method.chooses_steps:
            whole.run(until=1.3 * whole.time)
        end, steps = whole.time, whole.steps_done

        def look(sim):
            sim.energy()
            sim.checkpoint()
            if isinstance(sim.system, kd.System):
                sim.forces()

        for k in range(1, 11):
            if whole.method.chooses_steps:
                pieces.run(until=end if k == 10 else k / 10 * end, interval=end / 37, observe=look)
            else:
                pieces.run(steps // 10, every=3, observe=look)
        assert (pieces.time, pieces.steps_done) == (end, steps)
        assert bits(pieces) == bits(whole)
        assert differences(whole.checkpoint()["stepper"], pieces.checkpoint()["stepper"]) == []


PRESSURE_EVERY = 3
PRESSING = [  # every method with every barostat, coupling and precision
    (name, *chosen)
    for name in METHODS
    if "barostat" in integrator(name).choices
    for chosen in product(*(integrator(name).choices[key][1:] for key in ("barostat", "coupling")), PRECISIONS)
    if chosen[0] != "mtk" or name == "nose-hoover"
]
FEW_PRESSING = [  # every method once, every barostat and every coupling
    case
    for case in PRESSING
    if case[1:] == ("c-rescale", "per-axis", DOUBLE)
    or case in [("nose-hoover", *each, DOUBLE) for each in (("mtk", "full"), ("monte-carlo", "semi-isotropic"))]
]


def pressed_run(name: str, barostat: str, coupling: str, precision: str) -> kd.Simulation:
    options = needed(name) | {"barostat": barostat, "coupling": coupling, "precision": precision}
    options |= {"pressure_every": PRESSURE_EVERY}
    return kd.Simulation(liquid(27, 1.2, seed=8), name, dt=0.002, **pressed(options) | options)


@pytest.mark.parametrize("case", shortened(PRESSING, FEW_PRESSING), ids=" ".join)
def test_a_run_at_constant_pressure_goes_on_from_a_checkpoint(case):
    """Cuts before and after every action of the barostat. No look comes between, because its sums would refill what a
    checkpoint lacks."""
    whole, other, checkpoints = pressed_run(*case), pressed_run(*case), []
    whole.advance(PRESSURE_EVERY)
    for _ in range(PRESSURE_EVERY):
        checkpoints.append(kept(whole))
        whole.advance(1)
    whole.advance(PRESSURE_EVERY + 1)
    assert whole.state.box != whole.system.box or case[1] == "monte-carlo"
    for checkpoint in checkpoints:
        other.restore(checkpoint)
        assert differences(checkpoint, kept(other)) == []
        other.advance(whole.steps_done - other.steps_done)
        at = f"cut at step {checkpoint['step']}"
        assert differences(but_for_clocks(kept(whole)), but_for_clocks(kept(other))) == [], at
        assert other.state.box == whole.state.box, at


@pytest.mark.parametrize("barostat", ["c-rescale", "mtk"])
def test_a_checkpoint_without_virials_along_the_axes(barostat):
    """Version 0.2.0 wrote none: the run evaluates its forces again, and has the same bits."""
    whole, other = (pressed_run("nose-hoover", barostat, "per-axis", DOUBLE) for _ in range(2))
    whole.advance(2 * PRESSURE_EVERY)
    checkpoint = kept(whole)
    del checkpoint["stepper"]["barostat"]["along"]
    other.restore(checkpoint)
    for sim in (whole, other):
        sim.advance(5)
    assert bits(other) == bits(whole)
    assert other.state.box == whole.state.box


@pytest.mark.parametrize("name", shortened(OF_EACH_KIND, ("lennard-jones", "eam", "ase")))  # with lists; with a host
def test_forces_remember_what_their_sums_depend_on(name):
    """Along a given path, a force gives the same sums with its memory restored as without the interruption."""
    rng = np.random.default_rng(8)
    x = 1.2 * np.indices((8, 8, 8)).reshape(3, -1) + rng.uniform(-0.1, 0.1, (3, 512))
    unlike: dict[str, Any] = {"species": {"A": {}, "B": {"sigma": 0.9}}}
    if issubclass(FORCES[name], PairForce) and not {"epsilon", "sigma"} <= set(FORCES[name].law_keys):
        unlike = {"pairs": {("A", "B"): changed(FORCES[name].law_keys[0], 0.8)}}  # laws mix only these two
    force = example(FORCES[name], cutoff=2.5, **unlike, softening=0.1, G=1e-4)
    species, masses = ["A" if k % 3 else "B" for k in range(512)], np.where(np.arange(512) == 200, 30.0, 1.0)
    if isinstance(force, ManyBodyForce):
        system = crystal(force)
        x = system.state.positions.T
    else:
        given = {"topology": topology(force), "charges": charges(force, 512)}
        system = kd.System(x.T, masses=masses, units="nbody", species=species, forces=[force], **given)
    v = rng.normal(size=x.shape)

    def along(bound: BoundForces, steps: range) -> list[Any]:
        found = [bound.measure(0.1 * k, np.array([x + 0.01 * k * v, v])) for k in steps]
        return [each and (each.accelerations.tobytes(), *each[1:]) for each in found]

    whole, other = BoundForces(system), BoundForces(system)
    along(whole, range(30))
    other.recall(through_bytes(whole.memory()))
    assert differences(whole.memory(), other.memory()) == []
    measured = along(whole, range(30, 60))
    assert measured == along(other, range(30, 60))
    assert None not in measured
    assert differences(whole.memory(), other.memory()) == []


def test_lists_that_have_grown():
    """A restored list has the room that it had grown to, because growing takes an evaluation."""

    def make() -> kd.Simulation:
        sim = kd.Simulation(liquid(512, 2.5), "velocity-verlet", dt=0.004)
        sim.integration.flow.forces.forces = tuple(
            with_room(force, 500) for force in sim.integration.flow.forces.forces
        )
        return sim

    whole = assert_goes_on(make, lambda sim: sim.run(3), lambda sim: sim.run(40))
    assert whole.checkpoint()["stepper"]["forces"][0]["room"] > 500


def meeting() -> kd.System:
    """Three balls on a line that move towards a heavy one, the second slower; a fourth passes by, and a fifth
    leaves."""
    x = [[0, 0, 0], [1.0, 0, 0], [4.0, 0, 0], [-1.2, -2.5, 0.3], [9.0, 0, 0]]
    v = [[0, 0, 0], [-1.0, 0, 0], [-1.0, 0, 0], [-0.1, 1.0, 0], [1.2, 0, 0]]
    masses = [1.0, 0.01, 0.02, 1e-3, 1e-4]
    return kd.System(x, v, masses, forces=[kd.Gravity()], units="nbody", radii=0.1, names=list("abcde"))


EVENTS = [
    kd.Collision(action="merge"),
    kd.CloseApproach(1.5, bodies=["a", "d"]),
    kd.Escape(12.0, action="remove"),
    kd.Crossing.pericentre("d", "a"),
]


@pytest.mark.parametrize("name", shortened(METHODS, OF_EACH_FORM))
def test_events_go_on_from_a_checkpoint(name):
    """Checkpoints after a merger, during a passage, before another merger and an escape; with and without looks inside
    steps."""
    method = integrator(name)
    if method.bath or method.bounces:
        pytest.skip("refuses gravity")
    options = {"rtol": 1e-6} if "rtol" in method.tunable else {"dt": 0.01} if method.needs_dt else {}

    def make() -> kd.Simulation:
        return kd.Simulation(in_frame(name, meeting()), name, events=EVENTS, **options)

    def go(time: float) -> Callable[[kd.Simulation], Any]:
        def run(sim):
            return sim.run(until=time, interval=0.3) if method.chooses_steps else sim.run(until=time, every=9)

        return run

    def first(sim):
        go(2.4)(sim)
        assert len(sim.state) == 4
        assert np.isfinite(sim.checkpoint()["stepper"]["events"]["watches"][0]["closest_of"]).any()

    whole = assert_goes_on(make, first, go(3.6))
    kinds = [event["kind"] for event in whole.events]
    assert len(whole.state) < 4, kinds


def test_a_collision_that_the_present_has_not_come_to():
    """An adaptive step contains a bounce, and a look comes before the bounce: the checkpoint holds the waiting
    event."""

    def make() -> kd.Simulation:
        system = kd.System(
            [[-1, 0, 0], [1, 0, 0]], [[1, 0, 0], [-1, 0, 0]], forces=[kd.Gravity(G=1e-9)], units="nbody", radii=0.2
        )
        return kd.Simulation(system, "dormand-prince45", rtol=1e-6, events=[kd.Collision(action="bounce")])

    def first(sim):
        sim.run(until=0.7)
        assert sim.checkpoint()["stepper"]["events"]["act"] is not None
        assert sim.events == []

    whole = assert_goes_on(make, first, lambda sim: sim.run(until=1.5))
    assert [event["done"] for event in whole.events] == ["bounced"]


def disc() -> kd.System:
    """A star and light planets on circular orbits."""
    r = np.linspace(1.0, 4.0, 199)[:, None]
    angle = 2.4 * np.arange(199)[:, None]
    x = r * np.hstack([np.cos(angle), np.sin(angle), 0.05 * np.sin(7 * angle)])
    v = r**-0.5 * np.hstack([-np.sin(angle), np.cos(angle), 0 * angle])
    nothing = np.zeros((1, 3))
    masses = [1.0, *[1e-6] * 199]
    return kd.System(np.vstack([nothing, x]), np.vstack([nothing, v]), masses, forces=[kd.Gravity()], units="nbody")


THREADS = (1, 2, 4)
OURS = [name for name in METHODS if name not in REGISTERED]  # which another process knows
# The first method of each family, with and without a heat bath: the others run the same loops.
OF_EACH_LOOP = [*{(integrator(name).family, integrator(name).bath): name for name in OURS[::-1]}.values()]


def fingerprints(names: list[str]) -> list[list[str]]:
    """Fingerprints of runs with these methods, continued on each number of threads after a start on one thread."""
    found = []
    for name in names:
        for subject, dt in ((lambda: liquid(343, 2.5), 0.002), (disc, 0.02)):
            method = integrator(name)
            options = ({"dt": dt} if method.needs_dt else {}) | ({"rtol": 1e-6} if "rtol" in method.tunable else {})
            options |= needed(name)
            try:
                one, *sims = (kd.Simulation(subject(), name, threads=k, **options) for k in (1, *THREADS))
            except InputError:
                continue
            one.run(3)
            checkpoint = through_bytes(one.checkpoint())
            for sim in sims:
                sim.restore(checkpoint)
                sim.run(3)
            found.append([name, *(hashlib.sha256(bits(sim)).hexdigest() for sim in sims)])
            break
    return found


@pytest.mark.parametrize("names", [OF_EACH_LOOP, rest(OURS)], ids=["of each loop", "all"])
def test_threads_change_no_bit(names):
    """In a process that may use four threads, whatever the machine has."""
    code = f"import json, {__name__} as t; print(json.dumps(t.fingerprints({names})))"
    run = python(code, timeout=900, NUMBA_NUM_THREADS="4")
    assert run.returncode == 0, run.stderr
    found = json.loads(run.stdout)
    assert len(found) >= len(names) - 5
    for name, *of_each in found:
        assert of_each == [of_each[0]] * len(THREADS), name


def one_of_a_kind(case: same_bits.Case) -> bool:
    """Whether a case is in the short set: one of each way to share sums among threads, in double precision, and one
    pair force in mixed precision."""
    if case.system == "lennard-jones shift 2 species":
        return True
    return case.system in SHARED and case.precision == DOUBLE


@pytest.mark.parametrize("short", [True, rest(False)], ids=["one of a kind", "the rest"])
def test_forces_give_the_same_bits_however_they_run(short):
    """Every registered force, each truncation, mixtures and both precisions: threads, pieces, looks, file, restart."""
    velocities = {name for name, force in FORCES.items() if getattr(force, "velocity_dependent", False)}
    method = {name: "rk4" if name in velocities else "velocity-verlet" for name in same_bits.systems()}
    listed = [case for case in same_bits.cases(long=False) if case.method == method[case.system]]
    expected = [case for case in listed if one_of_a_kind(case) == short]
    taken, apart = same_bits.compared(expected)
    assert apart == []
    assert {case.precision for case in taken} == set(PRECISIONS)
    assert {case.system for case in taken} == {case.system for case in expected}
    assert not short or {*SHARED} <= {case.system for case in taken}


def test_a_checkpoint_of_another_run_is_refused():
    sim = kd.Simulation(small_liquid(), "velocity-verlet", dt=0.002)
    checkpoint = sim.checkpoint()
    integrators = "checkpoint: integrator is 'velocity-verlet' in the checkpoint and 'rk4' in this run"
    with pytest.raises(InputError, match=integrators):
        kd.Simulation(small_liquid(), "rk4", dt=0.002).restore(checkpoint)
    with pytest.raises(InputError, match=r"checkpoint: dt is 0\.002 in the checkpoint and 0\.001 in this run"):
        kd.Simulation(small_liquid(), "velocity-verlet", dt=0.001).restore(checkpoint)
    with pytest.raises(InputError, match="checkpoint: holds 27 particles or unknowns; the system has 64"):
        kd.Simulation(liquid(), "velocity-verlet", dt=0.002).restore(checkpoint)
    with pytest.raises(InputError, match="restore: the Simulation is already running"):
        sim.run(2, every=1, observe=lambda sim: sim.restore(checkpoint))


def test_a_checkpoint_shares_nothing_with_the_run():
    sim = kd.Simulation(small_liquid(), "velocity-verlet", dt=0.002)
    sim.run(20)
    checkpoint = sim.checkpoint()
    before = through_bytes(checkpoint)
    sim.run(30)
    assert differences(before, checkpoint) == []
    sim.restore(checkpoint)
    sim.run(30)
    assert differences(before, checkpoint) == []
