"""Fields and springs against the plain oracle and closed forms, and their tables in system files.

A few sets of forces serve all tests: ``one_body``, two sets of springs (as in spring-net), and all together, with the
trap and without.
"""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.forces import DrivenField, HarmonicTrap, LinearDrag, Springs, UniformField
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.forces.seam.group import InText
from kickdrift.model.state import State
from kickdrift.model.units.unit_systems import UNIT_SYSTEMS
from kickdrift.systemfile.reading import loads
from tests.oracle.forces import interacting_pairs, pair_oracle

NOTHING = (0.0, 0.0, 0.0)


def one_body(trap=None, uniform=None, driven=None, drag=None):
    """A trap, a uniform field, a driven field and drag; forces that are not given have zero strength."""
    return [
        trap or HarmonicTrap(0.0),
        uniform or UniformField(NOTHING),
        driven or DrivenField(NOTHING, 0.0),
        drag or LinearDrag(0.0),
    ]


def particle(x=NOTHING, v=NOTHING, mass=0.7, units="lj", **fields):
    return kd.System([x], [v], mass, forces=one_body(**fields), units=units)


def after(system, time, dt, integrator="velocity-verlet"):
    """State at a time."""
    sim = kd.Simulation(system, integrator, dt)
    sim.run(round(time / dt))
    assert sim.time == pytest.approx(time, rel=1e-12)
    return sim.state


def cloud(seed=0, n=11, scale=1.0, trap=True, **options):
    """Particles under every force of this module, with various strengths."""
    rng = np.random.default_rng(seed)
    signed = lambda *shape: scale * rng.normal(size=shape)  # noqa: E731
    i, j = np.triu_indices(n, 1)
    chosen = rng.permutation(len(i))[: rng.integers(1, 3 * n)]
    swap = rng.random(len(chosen)) < 0.5
    pairs = np.where(swap, [i[chosen], j[chosen]], [j[chosen], i[chosen]]).T
    number = (len(chosen),) if rng.random() < 0.5 else ()
    fields = one_body(
        HarmonicTrap(tuple(np.abs(signed(3))) if rng.random() < 0.5 else abs(signed(1)[0]), tuple(signed(3))),
        UniformField(tuple(signed(3))),
        DrivenField(tuple(signed(3)), rng.uniform(0, 3), rng.uniform(-9, 9)),
        LinearDrag(abs(signed(1)[0])),
    )
    springs = Springs(pairs, scale * rng.uniform(0.1, 9, number), rng.uniform(0, 2, number))
    forces = [springs, *(fields if trap else fields[1:])]
    x = rng.normal(size=(n, 3)) * rng.choice([0.1, 1.0, 10.0], size=(n, 1))
    return kd.System(x, rng.normal(size=(n, 3)), rng.uniform(0.1, 3.0, n), forces=forces, **options)


def assert_right(system, time=0.0):
    measured = BoundForces(system).measure(time, system.state.phase)
    forces, energy, virial, count = pair_oracle(system, time)
    got = measured.accelerations.T * system.coherent_masses[:, None]
    parts = [pair_oracle(system_with(system, force), time) for force in system.forces]
    scale = sum(np.abs(part[0]).max() for part in parts) + 1e-300
    np.testing.assert_allclose(got, forces, rtol=0, atol=1e-13 * scale * len(system))
    terms = sum(abs(part[1]) for part in parts) + gross_field_energy(system)
    assert measured.potential == pytest.approx(energy, rel=1e-12, abs=1e-13 * terms)
    springs = [interacting_pairs(force, system) for force in system.forces if isinstance(force, Springs)]
    gross = sum(np.abs(p.force * p.r).sum() + np.abs(p.force).max() for p in springs)
    assert measured.virial == pytest.approx(virial, abs=1e-12 * gross)
    assert measured.pairs == count == sum(len(p.r) for p in springs)
    return measured


def gross_field_energy(system):
    """Sum of m |g| |x|, the scale of a field's potential, which is a difference of such terms."""
    mx = np.abs(system.coherent_masses[:, None] * system.state.positions).sum(axis=0)
    g = [getattr(force, key, NOTHING) for force in system.forces for key in ("acceleration", "amplitude")]
    return sum(float(mx @ np.abs(each)) for each in g)


def system_with(system, force):
    return kd.System(
        system.state.positions, system.state.velocities, system.state.masses, system.box, [force], system.units
    )


# --- against the oracle ---


@pytest.mark.long
@given(st.integers(0, 2**32 - 1), st.integers(2, 40), st.sampled_from([1e-3, 1.0, 1e3]), st.floats(0, 100))
@settings(max_examples=60, deadline=None)
def test_all_of_them_add_up(seed, n, scale, time):
    assert_right(cloud(seed, n, scale), time)


@pytest.mark.parametrize("units", ["si", "metal", "astro"])
def test_in_units(units):
    assert_right(cloud(3, units=units), 0.3)


@pytest.mark.parametrize("seed", range(5))
def test_in_a_periodic_box(seed):
    system = cloud(seed, trap=False, box=(5.0, 6.0, 7.0))
    measured = assert_right(system, 0.4)
    rng = np.random.default_rng(seed)
    moved = system.state.positions + rng.integers(-3, 4, (len(system), 3)) * np.array(system.box.lengths)
    elsewhere = kd.System(moved, system.state.velocities, system.state.masses, system.box, system.forces)
    there = assert_right(elsewhere, 0.4)  # the fields' potential is that of the unwrapped positions
    np.testing.assert_allclose(there.accelerations, measured.accelerations, rtol=1e-11, atol=1e-11)
    assert there.virial == pytest.approx(measured.virial, rel=1e-11)


def test_the_driven_field_follows_the_clock():
    system = particle(x=(1.0, 2.0, 3.0), driven=DrivenField((1.0, 0.0, -2.0), 0.25, phase=0.1))
    sim = kd.Simulation(system, dt=0.01)
    start = sim.energy().potential
    assert start == pytest.approx(-0.7 * (1.0 - 6.0) * math.cos(0.1), rel=1e-14)
    state = sim.state
    sim.state = State(state.phase, state.masses, state.ids, state.box, 2.0, 0)  # half a period later
    assert sim.energy().potential == pytest.approx(-start, rel=1e-13)
    np.testing.assert_allclose(sim.forces()[0], -0.7 * np.array([1.0, 0.0, -2.0]) * math.cos(0.1), rtol=1e-13)


def test_massless_particles_fall_and_slow_down():
    forces = one_body(uniform=UniformField((0.0, 0.0, -2.0)), drag=LinearDrag(0.5))[1:]
    for force in forces:
        kd.System(np.eye(2, 3), masses=[1.0, 0.0], forces=[force])
    for force in (HarmonicTrap(1.0), Springs([[0, 1]], 1.0)):
        with pytest.raises(InputError, match="particle 1 has no mass, so this force would accelerate it without limit"):
            kd.System(np.eye(2, 3), masses=[1.0, 0.0], forces=[force])
    kd.System(np.eye(3), masses=[1.0, 0.0, 1.0], forces=[Springs([[0, 2]], 1.0)])


def test_fields_may_begin_in_one_place():
    sim = kd.Simulation(kd.System(np.zeros((3, 3)), np.eye(3), forces=one_body(HarmonicTrap(1.0))), dt=0.01)
    sim.run(10)
    assert len(np.unique(sim.state.positions, axis=0)) == 3


def test_springs_without_a_direction():
    x = [[0.0, 0.0, 0.0], [1.0, 2.0, 3.0], [1.0, 2.0, 3.0]]
    collapsed = kd.System(x, forces=[Springs([[1, 2]], 3.0), Springs([[0, 1]], 1.0, 0.5)])
    assert kd.Simulation(collapsed, dt=0.1).forces()[2].tolist() == [0.0, 0.0, 0.0]
    message = r"springs: particles 2 and 1 are at the same place, where their spring of length 0\.5 has no direction"
    with pytest.raises(InputError, match=message):
        kd.System(x, forces=[Springs([[0, 1], [2, 1]], 1.0, [1.0, 0.5])])
    with pytest.raises(InputError, match="particles 0 and 1 are at the same place"):
        kd.System([[0.0, 0.0, 0.0], [0.0, 4.0, 0.0]], box=(4, 4, 4), forces=[Springs([[0, 1]], 1.0, 1.0)])
    apart = kd.System(np.eye(2, 3), forces=[Springs([[0, 1]], 3.0, 0.5), Springs([[1, 0]], 1.0)])
    measured = BoundForces(apart).measure(0.0, np.zeros((2, 3, 2)))  # a state as runs reach it
    assert not measured.accelerations.any()
    assert (measured.potential, measured.virial, measured.pairs) == (0.5 * 3.0 * 0.5**2, 0.0, 2)


@pytest.mark.parametrize("culprit", [np.nan, np.inf, -np.inf])
def test_positions_that_are_no_numbers(culprit):
    springs = kd.System(np.eye(2, 3), forces=[Springs([[0, 1]], 3.0, 0.5), Springs([[1, 0]], 1.0)])
    for system in (springs, particle(trap=HarmonicTrap(1.0))):
        phase = system.state.phase.copy()
        phase[0, 1, 0] = culprit
        assert BoundForces(system).measure(0.0, phase) is None


# --- closed forms ---


def order(error_at, dt):
    """Order of a method from the errors at a step and at half of it."""
    return math.log2(error_at(dt) / error_at(dt / 2))


def test_what_takes_or_gives_energy_is_named():
    system = particle(v=(1.0, 0.0, 0.0), drag=LinearDrag(0.5))
    assert kd.Simulation(system, "rk4", dt=0.01).run(100).energy.verdict == "not conserved: linear-drag"


def test_a_driven_particle():
    a, f, phase, time = np.array([1.0, -2.0, 0.5]), 0.4, 0.6, 7.0
    omega, v0 = 2 * math.pi * f, np.array([0.1, 0.2, 0.3])
    system = particle(v=v0, driven=DrivenField(tuple(a), f, phase))
    swing = -(math.cos(omega * time + phase) - math.cos(phase)) / omega - time * math.sin(phase)
    exact = v0 * time + a / omega * swing

    def error(integrator):
        return lambda dt: np.abs(after(system, time, dt, integrator).positions[0] - exact).max()

    assert error("velocity-verlet")(0.01) < 1e-3
    assert order(error("velocity-verlet"), 0.05) == pytest.approx(2, abs=0.05)
    assert order(error("rk4"), 0.1) == pytest.approx(4, abs=0.1)


def test_springs_conserve_momentum_in_a_periodic_box():
    rng = np.random.default_rng(5)
    n, edge = 20, 6.0
    i, j = np.triu_indices(n, 1)
    chosen = rng.permutation(len(i))[:50]
    pairs = np.array([i[chosen], j[chosen]]).T
    springs = [Springs(pairs[:25], rng.uniform(1, 3, 25)), Springs(pairs[25:], 2.0, rng.uniform(0, 2, 25))]
    system = kd.System(
        rng.uniform(-edge, 2 * edge, (n, 3)), rng.normal(size=(n, 3)), rng.uniform(1, 2, n), (edge,) * 3, springs
    )
    assert kd.Simulation(system, dt=0.005).run(2000).momentum_error < 1e-13


def test_spring_net():
    system = kd.load("spring-net")
    sim = kd.Simulation(system)
    assert_right(system)
    assert sim.energy().total == pytest.approx(system.invariants["energy"], rel=1e-14)
    sample = sim.sample()
    for key in ("momentum", "angular_momentum"):
        np.testing.assert_allclose(getattr(sample, key), system.invariants[key], atol=1e-15)
    report = sim.run(system.run.steps, every=system.run.every)
    assert report.energy.verdict == "bounded"
    assert report.energy.max_relative_error < 1e-3
    assert report.momentum_error < 1e-12
    assert report.angular_momentum_error < 1e-12
    assert str(system.forces[0]) == "Springs(24 pairs, stiffness=100.0, length=0.1)"


# --- system files ---

FILE = """
units = "si"
[particles]
positions = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, "50 cm", 0.0]]
mass = "1 g"
"""


def forces_of(force, text=FILE):
    return loads(f"{text}\n[[force]]\n{force}\n").forces[0]


def message_of(force, text=FILE):
    with pytest.raises(InputError) as error:
        forces_of(force, text)
    message = str(error.value)
    assert "\n" not in message
    assert message.startswith("system: ")
    return message.removeprefix("system: ")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('type = "harmonic-trap"\nstiffness = "1 N/cm"', HarmonicTrap(100.0)),
        (
            'type = "harmonic-trap"\nstiffness = [1, "2 J/m^2", 0.5]\ncentre = ["1 cm", 0, -2]',
            HarmonicTrap((1.0, 2.0, 0.5), (0.01, 0.0, -2.0)),
        ),
        ('type = "uniform-field"\nacceleration = [0, 0, "-981 cm/s^2"]', UniformField((0.0, 0.0, -9.81))),
        (
            'type = "driven-field"\namplitude = ["1 m/s2", 0, 0]\nfrequency = "2 kHz"\nphase = 0.5',
            DrivenField((1.0, 0.0, 0.0), 2000.0, 0.5),
        ),
        ('type = "driven-field"\namplitude = [1, 0, 0]\nfrequency = "120 min^-1"', DrivenField((1.0, 0.0, 0.0), 2.0)),
        ('type = "linear-drag"\nrate = "3 1/min"', LinearDrag(0.05)),
        ('type = "springs"\npairs = [[0, 1]]\nstiffness = "1 N/cm"', Springs([(0, 1)], 100.0)),
        (
            'type = "springs"\npairs = [[0, 1], [2, 1]]\nstiffness = [1, "2 N/m"]\nlength = "20 cm"',
            Springs([[0, 1], [2, 1]], [1.0, 2.0], 0.2),
        ),
    ],
)
def test_what_a_file_says(text, expected):
    force = forces_of(text)
    assert type(force) is type(expected)
    for key in expected.dimensions:
        np.testing.assert_allclose(getattr(force, key), getattr(expected, key), rtol=1e-14)
    assert getattr(force, "pairs", None) == getattr(expected, "pairs", None)
    assert getattr(force, "phase", None) == getattr(expected, "phase", None)


def test_units_of_atoms():
    text = FILE.replace('"si"', '"metal"').replace('"1 g"', '"39.948 u"')
    assert forces_of('type = "uniform-field"\nacceleration = ["10 m/s^2", 0, 0]', text).acceleration[0] == (
        pytest.approx(1e-13, rel=1e-12)
    )
    assert forces_of('type = "harmonic-trap"\nstiffness = "1 N/m"', text).stiffness == pytest.approx(
        1 / 16.02176634, rel=1e-12
    )
    assert forces_of('type = "driven-field"\namplitude = [1, 0, 0]\nfrequency = "2 THz"', text).frequency == (
        pytest.approx(2.0)
    )
    assert forces_of('type = "linear-drag"\nrate = "1 ns^-1"', text).rate == pytest.approx(1e-3)


TRAP, SPRINGS = 'type = "harmonic-trap"\n', 'type = "springs"\n'
DRIVEN = 'type = "driven-field"\namplitude = [1, 0, 0]\n'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (TRAP, "force[0].stiffness: required key is missing"),
        (TRAP + 'stiffness = "1 N"', "force[0].stiffness: expected a stiffness such as"),
        (TRAP + "stiffness = -1", "force[0]: harmonic-trap: stiffness must be zero or more, got -1"),
        (TRAP + "stiffness = [1, 2]", "force[0].stiffness: expected 3 items, got 2"),
        (TRAP + 'stiffness = [1, 2, "3 K"]', "force[0].stiffness[2]: expected a stiffness such as"),
        (TRAP + "stiffness = [1, 2, nan]", "force[0].stiffness[2]: expected a finite number, got nan"),
        (TRAP + "stiffness = true", "force[0].stiffness: expected a stiffness such as"),
        (TRAP + "stiffness = 1\ncentre = 3", "force[0].centre: expected a list, got 3"),
        (TRAP + "stiffness = 1\ncenter = [0, 0, 0]", "force[0].center: unknown key; did you mean 'centre'?"),
        (
            TRAP + "stiffness = [1, 2, 3]\n[box]\nmatrix = [[9, 0, 0], [4, 9, 0], [0, 0, 9]]",
            "harmonic-trap: stiffness has three values, but a leaning box takes one",
        ),
        ('type = "uniform-field"', "force[0].acceleration: required key is missing"),
        ('type = "uniform-field"\nacceleration = 9.81', "force[0].acceleration: expected a list, got 9.81"),
        ('type = "uniform-field"\nacceleration = [0, 0, "9 m/s"]', "force[0].acceleration[2]: expected an"),
        (DRIVEN, "force[0].frequency: required key is missing"),
        (DRIVEN + "frequency = -1", "force[0]: driven-field: frequency must be zero or more, got -1"),
        (DRIVEN + 'frequency = "6 rad/s"', "got '6 rad/s'; a frequency counts cycles, not angles"),
        (DRIVEN + 'frequency = "60 rpm"', "got '60 rpm'; a frequency counts cycles, not angles"),
        (DRIVEN + 'frequency = "1 m"', "force[0].frequency: expected a frequency such as"),
        (DRIVEN + 'frequency = 1\nphase = "90 deg"', "force[0].phase: expected a plain number, got '90 deg'"),
        ('type = "linear-drag"\nrate = -0.1', "force[0]: linear-drag: rate must be zero or more, got -0.1"),
        ('type = "linear-drag"\nrate = [1, 2]', "force[0].rate: expected a rate such as"),
        (SPRINGS + "stiffness = 1", "force[0].pairs: required key is missing"),
        (SPRINGS + "stiffness = 1\npairs = []", "force[0]: springs: expected one pair or more, got none"),
        (SPRINGS + "stiffness = 1\npairs = [[0, 1], 2]", "force[0].pairs[1]: expected a list, got 2"),
        (SPRINGS + "stiffness = 1\npairs = [[0, 1], [1]]", "force[0].pairs[1]: expected 2 items, got 1"),
        (SPRINGS + "stiffness = 1\npairs = [[0, 1.0]]", "force[0].pairs[0][1]: expected a whole number, got 1.0"),
        (SPRINGS + 'stiffness = 1\npairs = [["A", 1]]', "force[0].pairs[0][0]: expected a whole number, got 'A'"),
        (SPRINGS + "stiffness = 1\npairs = [[0, -1]]", "pairs[0]: expected the ids of two particles, got [0, -1]"),
        (SPRINGS + "stiffness = 1\npairs = [[0, 1], [2, 2]]", "springs: pair [2, 2] joins a particle to itself"),
        (SPRINGS + "stiffness = 1\npairs = [[0, 1], [1, 0]]", "springs: pair [1, 0] is given twice"),
        (SPRINGS + "stiffness = 1\npairs = [[0, 1], [3, 1]]", "springs: pair [3, 1]: there is no particle 3; ids are"),
        (SPRINGS + "stiffness = 0\npairs = [[0, 1]]", "force[0]: springs: stiffness must be positive, got 0"),
        (SPRINGS + "stiffness = [1, 2]\npairs = [[0, 1]]", "springs: stiffness: expected one number or 1, got 2"),
        (SPRINGS + "stiffness = 1\nlength = []\npairs = [[0, 1]]", "springs: length: expected one number or 1, got 0"),
        (SPRINGS + "stiffness = 1\nlength = -1\npairs = [[0, 1]]", "springs: length must be zero or more, got -1"),
        (
            SPRINGS + "stiffness = 1\npairs = [[0, 1]]\nlength = 4.5\n[box]\nlengths = [10, 10, 9]",
            "springs: length 4.5 must be under half the shortest box edge, 4.5",
        ),
        ('type = "spring"', "force[0].type: expected one of"),
    ],
)
def test_what_a_file_may_not_say(text, message):
    assert message in message_of(text)


JUNK = st.recursive(
    st.none() | st.booleans() | st.integers(-3, 10**30) | st.floats() | st.text(max_size=6) | st.just(np.ones(2)),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=3), inner, max_size=2),
    max_leaves=6,
)
FULL = [
    (HarmonicTrap, {"stiffness": 1.0, "centre": NOTHING}),
    (UniformField, {"acceleration": NOTHING}),
    (DrivenField, {"amplitude": NOTHING, "frequency": 1.0, "phase": 0.0}),
    (LinearDrag, {"rate": 1.0}),
    (Springs, {"pairs": [[0, 1]], "stiffness": 1.0, "length": 1.0}),
]


@given(st.sampled_from(FULL), st.integers(0, 2), JUNK)
@settings(max_examples=100, deadline=None)
def test_junk_makes_a_force_or_one_line(full, which, junk):
    cls, parameters = full
    parameters = {**parameters, list(parameters)[which % len(parameters)]: junk}
    said = ""
    try:
        force = cls(**parameters)
    except InputError as error:
        said = str(error)
    if not said and isinstance(force, InText):  # a text that may have a unit, which a System reads
        try:
            force = force.in_units(UNIT_SYSTEMS["metal"])
        except InputError as error:
            said = str(error)
    if said:
        assert re.fullmatch(rf"{cls.name}: .+", said)
    else:
        assert force == cls(**vars(force))
        assert hash(force) == hash(cls(**vars(force)))


def test_drag_needs_a_method_for_forces_that_depend_on_velocity():
    """A splitting method would lose its order with such a force."""
    system = particle(drag=LinearDrag(0.5))
    for name in ("velocity-verlet", "stormer-verlet", "yoshida6"):
        with pytest.raises(InputError, match=f"{name}: needs accelerations .* force 'linear-drag' depends on velocity"):
            kd.Simulation(system, name, dt=0.1)
