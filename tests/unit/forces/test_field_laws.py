"""Field and body laws of a user: against NumPy, with parameters for each particle, species and pair, in files, and
refused in one line where they make no sense."""

from __future__ import annotations

import math
import random
from collections import namedtuple
from typing import NamedTuple

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.forces import FORCES
from kickdrift.forces.seam import named

X = np.array([[0.1, 0.0, 0.0], [1.0, 0.5, 0.2], [0.3, -1.0, 0.4]])


@pytest.fixture(autouse=True)
def own(monkeypatch):
    """Remove a test's registrations after the test."""
    monkeypatch.setattr(named, "REGISTERED", dict(named.REGISTERED))
    before = dict(FORCES)
    yield
    FORCES.clear()
    FORCES.update(before)


def tweezer():
    class Tweezer(NamedTuple):
        depth: float
        width: float = 1.0
        centre: tuple[float, float, float] = (0.0, 0.0, 0.0)

        def law(p, x, v, m, t):
            d = x - p.centre
            energy = -p.depth * math.exp(-0.5 * (d @ d) / p.width**2)
            return energy, energy / p.width**2 * d

        def check(p):
            if np.min(list(p.depth.values()) if isinstance(p.depth, dict) else p.depth) < 0:
                raise ValueError("depth must be zero or more")

    return kd.field_law(Tweezer)


def charges():
    class Charges(NamedTuple):
        charge: float
        coupling: float = 1.0
        softening: float = 0.1

        varies = ("charge",)
        pairs = ("coupling",)

        def law(p, x, v, m, t, a):
            energy = virial = 0.0
            n = x.shape[1]
            for i in range(n):
                for j in range(i):
                    d = x[:, i] - x[:, j]
                    r2 = d[0] ** 2 + d[1] ** 2 + d[2] ** 2
                    s2 = r2 + p.softening**2
                    pair = p.coupling[i, j] * p.charge[i] * p.charge[j] / math.sqrt(s2)
                    energy += pair
                    virial += pair / s2 * r2
                    for k in range(3):
                        a[k, i] += pair / s2 * d[k] / m[i]
                        a[k, j] -= pair / s2 * d[k] / m[j]
            return energy, virial, n * (n - 1) // 2

    return kd.body_law(Charges)


def mine(law, **more):
    """A field law of one number k, with these attributes."""

    class Mine(NamedTuple):
        k: float = 1.0

    Mine.law = law
    for name, value in more.items():
        setattr(Mine, name, value)
    return kd.field_law(Mine)


# --- values ---


def drawn(n, seed=1):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(n, 3)), rng.normal(size=(n, 3)), rng.uniform(0.5, 1.5, n)


@pytest.mark.parametrize("n", [1, 3, 8, 13])
def test_a_field_law_is_its_formula_for_each_particle(n):
    """One value for all, a value for each particle, and a value for each species."""
    Tweezer = tweezer()
    x, v, m = drawn(n)
    depths, centres = np.linspace(1, 2, n), x[::-1] + 0.3
    species = ["AB"[k % 2] for k in range(n)]
    by_species = {"A": 1.5, "B": 0.5}
    for force, depth, centre in (
        (Tweezer(2.0, 1.5), np.full(n, 2.0), np.zeros((n, 3))),
        (Tweezer(depths, 1.5, centres), depths, centres),
        (Tweezer(by_species, 1.5), np.array([by_species[s] for s in species]), np.zeros((n, 3))),
    ):
        sim = kd.Simulation(kd.System(x, v, m, forces=[force], species=species), dt=0.01)
        d = x - centre
        energy = -depth * np.exp(-0.5 * (d * d).sum(axis=1) / 1.5**2)
        np.testing.assert_allclose(sim.forces(), energy[:, None] / 1.5**2 * d, rtol=0, atol=1e-14)
        assert sim.energy().potential == pytest.approx(energy.sum(), rel=1e-14)


def test_a_body_law_is_its_formula():
    Charges = charges()
    x, v, m = drawn(9)
    q, coupling = np.linspace(-1, 1, 9), np.add.outer(np.arange(9.0), np.arange(9.0))
    sim = kd.Simulation(kd.System(x, v, m, forces=[Charges(q, coupling)]), dt=0.01)
    d = x[:, None] - x[None]
    s2 = (d * d).sum(axis=2) + 0.1**2
    pair = coupling * np.outer(q, q) / np.sqrt(s2) * (1.0 - np.eye(9))
    np.testing.assert_allclose(sim.forces(), ((pair / s2)[:, :, None] * d).sum(axis=1), rtol=0, atol=1e-11)
    assert sim.energy().potential == pytest.approx(0.5 * pair.sum(), rel=1e-12)
    assert sim.sample().pairs == 36
    species, table = ["AB"[k % 2] for k in range(9)], {"A": {"A": 1.0, "B": 0.3}, "B": {"B": 2.0}}
    mixed = kd.System(x, v, m, forces=[Charges({"A": 1.0, "B": -1.0}, table)], species=species)
    strength = np.where(np.equal.outer(species, species), [1.0, 2.0, 1.0, 2.0, 1.0, 2.0, 1.0, 2.0, 1.0], -0.3)
    pair = strength / np.sqrt(s2) * (1.0 - np.eye(9))
    assert kd.Simulation(mixed, dt=0.01).energy().potential == pytest.approx(0.5 * pair.sum(), rel=1e-12)


def test_functions_of_lanes():
    """Sines, choices, the larger of two, powers, parts of vectors and vector products, as NumPy has them."""

    def law(p, x, v, m, t):
        s, c = math.sin(p.k * x[0]), math.cos(p.k * x[0])
        out = np.where(x[1] > 0.2, x[1] - 0.2, 0.0)
        deep, high = max(0.0, -0.1 - x[2]), min(x[2], 0.3)
        push = (-2.0 * p.k * s * c, -2.0 * out, 3.0 * deep**2 - np.where(x[2] < 0.3, 1.0, 0.0))
        return s * s + out * out + deep**3 + high, push

    x, v, _ = drawn(19)
    sim = kd.Simulation(kd.System(x, v, forces=[mine(law)(1.3)]), dt=0.01)
    found = [mine(law)(1.3).law.law(each, None, 1.0, 0.0) for each in x]
    np.testing.assert_allclose(sim.forces(), [force for _, force in found], rtol=0, atol=1e-14)
    assert sim.energy().potential == pytest.approx(sum(energy for energy, _ in found), rel=1e-14)

    def turn(p, x, v, m, t):
        b = x / math.sqrt(x @ x)
        return 0.0, np.cross(v, b) * p.k + b * b * 0.0

    sim = kd.Simulation(kd.System(x, v, forces=[mine(turn, velocity_dependent=True)(2.0)]), "rk4", dt=0.002)
    np.testing.assert_allclose(
        sim.forces(), 2.0 * np.cross(v, x / np.linalg.norm(x, axis=1)[:, None]), rtol=0, atol=1e-14
    )
    before = sim.energy().total
    sim.run(100)
    assert sim.energy().total == pytest.approx(before, rel=1e-9)  # such a force does no work


def test_a_users_law_has_the_bits_of_the_shipped_one():
    """The same formula makes the same paths, with every number of particles, and beside other forces."""

    def trap(p, x, v, m, t):
        return 0.5 * ((p.k * x) @ x), -(p.k * x)

    def drag(p, x, v, m, t):
        return None, -p.k * v

    drags = {"velocity_dependent": True, "works": True, "per_mass": True}
    for n in (1, 8, 21):
        x, v, m = drawn(n)
        ends = []
        for forces in (
            [kd.HarmonicTrap(1.7), kd.LinearDrag(0.3)],
            [mine(trap)(1.7), mine(drag, **drags)(0.3)],
        ):
            sim = kd.Simulation(kd.System(x, v, m, forces=forces), "rk4", dt=0.01)
            sim.run(50, every=7)
            ends.append(sim.state.phase)
        np.testing.assert_array_equal(*ends)


def test_looks_do_not_change_the_bits_of_a_users_law():
    """The energy and the force share a product, which a compiler could fuse with a sum in one of two copies."""

    def law(p, x, v, m, t):
        push = p.k * x
        return 0.5 * (push @ x) + 0.25 * (x @ x) * (x @ x), -push - (x @ x) * x

    x, v, m = drawn(11)
    ends = []
    for every in (1, 100):
        sim = kd.Simulation(kd.System(x, v, m, forces=[mine(law)(0.7)]), dt=0.01)
        sim.run(100, every=every)
        ends.append(sim.state.phase)
    np.testing.assert_array_equal(*ends)


def test_two_laws_of_one_name_are_two_laws():
    """As when a cell of a notebook defines a law again."""

    def made(c):
        return mine(lambda p, x, v, m, t: (0.5 * c * p.k * (x @ x), -c * p.k * x))

    for c in (1.0, 2.0):
        sim = kd.Simulation(kd.System(X, forces=[made(c)()]), dt=0.1)
        np.testing.assert_allclose(sim.forces(), -c * X, rtol=1e-15)


def test_a_law_of_time_has_a_clock():
    def law(p, x, v, m, wave):
        return -p.k * wave * x[0], (p.k * wave, 0.0, 0.0)

    force = mine(law, clock=lambda p, t: math.cos(2.0 * t), time_dependent=True)(3.0)
    assert force.works
    sim = kd.Simulation(kd.System(X, forces=[force]), "rk4", dt=0.01)
    sim.run(until=2.0)
    moved = 3.0 / 4.0 * (1.0 - math.cos(4.0))  # x'' = 3 cos(2 t) from rest
    np.testing.assert_allclose(sim.state.positions, X + np.array([moved, 0.0, 0.0]), rtol=0, atol=1e-9)


def test_particles_with_values_of_their_own_stay():
    """A list of values is by particle, so no particle may leave."""
    event = kd.Escape(5.0, action="remove")
    kd.System(X, forces=[kd.Gravity(G=1.0), tweezer()(1.0)], events=[event])
    with pytest.raises(InputError, match="action 'remove' cannot act on bodies joined by tweezer"):
        kd.System(X, forces=[kd.Gravity(G=1.0), tweezer()([1.0, 2.0, 3.0])], events=[event])


# --- what is refused ---


def field(law, **more):
    return lambda: kd.System(X, forces=[mine(law, **more)()])


def slope(p, x, v, m, t):
    return 0.5 * p.k * (x @ x), p.k * x


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (field(lambda p, x, v, m, t: 1.0), "mine: law(p, x, v, m, t) for particle 0 must return two values, energy"),
        (field(lambda p, x, v, m, t: (1.0, x, x)), "must return two values, energy and force; it returned (1.0, "),
        (field(lambda p, x, v, m, t: (1.0, (2.0, 1.0))), "force of three components; the force it returned is (2.0, 1"),
        (field(lambda p, x, v, m, t: (None, -x)), "a law without an energy says works = True in its class"),
        (field(slope), "mine: law must return energy and force, minus the energy's slope; for particle 2 at"),
        (field(lambda p, x, v, m, t: (0.0 * m, -v)), "depends on velocity; say velocity_dependent = True"),
        (field(lambda p, x, v, m, t: (-x[0] * t, (t, 0.0, 0.0))), "depends on time; say time_dependent = True"),
        (field(lambda p, x, v, m, t: (1 / 0, x)), "for particle 0 raised ZeroDivisionError: division by zero"),
        (field(lambda p, x, v, m, t: (math.nan, x)), "for particle 0 must return finite numbers; it returned (nan"),
        (lambda: mine(lambda p, x: 1), "Mine: law must take (p, x, v, m, t); it takes (p, x)"),
        (lambda: kd.field_law(3), "field_law: expected a NamedTuple class with law(p, x, v, m, t), got 3"),
        (lambda: kd.System(X, forces=[tweezer()([1.0, 2.0])]), "tweezer: depth: 2 values for 3 particles; particle 2"),
        (lambda: kd.System(X, forces=[tweezer()([1.0] * 4)]), "4 values for 3 particles; there is no particle 3"),
        (lambda: tweezer()([1.0, math.nan]), "tweezer: depth[1]: expected a finite number, got nan"),
        (lambda: tweezer()([[1.0, 2.0]]), "tweezer: depth[0]: expected a finite number, got [1.0, 2"),
        (lambda: tweezer()(1.0, 1.0, [[1, 2, 3], [1, 2]]), "tweezer: centre[1]: expected three numbers, got [1, 2]"),
        (lambda: tweezer()({"A": "q"}), "tweezer: depth['A']: expected a finite number, got 'q'"),
        (lambda: kd.System(X, forces=[tweezer()({"A": 1.0})], species="AAB"), "depth: particle 2 has species 'B', whi"),
        (lambda: tweezer()(-1.0), "tweezer: depth must be zero or more"),
        (lambda: tweezer()(1.0, widht=1.0), "Tweezer: no argument 'widht'; did you mean 'width'?"),
        (lambda: kd.System(X, masses=[1, 0, 1], forces=[tweezer()(1.0)]), "particle 1 has no mass"),
        (lambda: kd.System(X, forces=[charges()(1.0, [[1.0] * 3, [1.0] * 2, [1.0] * 3])]), "coupling[1]: 2 values for"),
        (lambda: kd.System(X, forces=[charges()(1.0, {"A": {}})]), "charges: coupling: the pair A-A has no value"),
        (lambda: kd.System(X, forces=[charges()("2")]), "charges: charge: expected numbers, got '2'"),
    ],
)
def test_a_wrong_law_or_parameter_is_one_line(make, message):
    with pytest.raises(InputError) as caught:
        make()
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def bodies(law, **more):
    class Mine(NamedTuple):
        k: float = 1.0

    Mine.law = law
    for name, value in more.items():
        setattr(Mine, name, value)
    return lambda: kd.System(X, forces=[kd.body_law(Mine)()])


def outward(p, x, v, m, t, a):
    a += p.k * x
    return 0.5 * p.k * (m * (x * x).sum(axis=0)).sum()


def dragged(p, x, v, m, t, a):
    a -= v


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (bodies(outward), "mine: mass times the law's acceleration must be minus the slope of its energy; for"),
        (bodies(dragged), "must return the energy; a law without an energy says works = True in its class"),
        (bodies(dragged, works=True), "the law's accelerations depend on velocity; say velocity_dependent = True"),
        (bodies(lambda p, x, v, m, t, a: "a"), "must return the energy, or energy and virial, or energy, virial and"),
        (bodies(lambda p, x, v, m, t, a: p.q), "raised AttributeError: 'Mine' object has no attribute 'q'"),
        (bodies(lambda p, x, v, m, t, a: random.random()), "Mine: law keeps state between calls: it uses random"),
    ],
)
def test_a_wrong_body_law_is_one_line(make, message):
    with pytest.raises(InputError) as caught:
        make()
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def branches(p, x, v, m, t):
    return 0.0 * m, -x if x[0] < -9.0 else 0.0 * x


def test_a_law_that_does_not_compile_is_shown_with_its_line():
    with pytest.raises(InputError, match=r"^Mine: law does not compile for SIMD lanes, line \d+: '.*if x\[0\] < -9\.0"):
        kd.Simulation(kd.System(X, forces=[mine(branches)()]), dt=0.1).run(1)


CODE = """
import math
from typing import NamedTuple

import kickdrift as kd


@kd.field_law
class Tweezer(NamedTuple):
    \"\"\"A Gaussian well.\"\"\"

    depth: float
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)

    dimensions = {"depth": "energy", "centre": "length"}

    def law(p, x, v, m, t):
        d = x - p.centre
        energy = -p.depth * math.exp(-0.5 * (d @ d))
        return energy, energy * d
"""
SYSTEM = """
units = "metal"
[particles]
positions = [[0.1, 0, 0], [1.5, 0.2, 0], [0.3, 0.4, -0.5]]
species = ["A", "B", "A"]
mass = "40 u"
[[force]]
type = "tweezer"
depth = { A = "2 eV", B = 1.0 }
centre = [[0, 0, 0], ["0.1 nm", 0, 0], [0, 0, 1]]
[run]
dt = 0.001
steps = 20
"""


def test_a_file_names_a_field_law(kickdrift, tmp_path):
    load, system, run = (str(tmp_path / name) for name in ("tweezer.py", "well.toml", "run.h5md"))
    (tmp_path / "tweezer.py").write_text(CODE)
    (tmp_path / "well.toml").write_text(SYSTEM)
    status, _, err = kickdrift("--load", load, "run", system, "--output", run)
    assert (status, err) == (0, "")
    assert kickdrift("--load", load, "resume", run, "--steps", "25")[0] == 0
    with kd.open(run) as found:
        assert found.steps[-1] == 25
        energy = found.observables["potential_energy"][0]
    again = kd.load(system)
    assert again.forces[0].depth == {"A": 2.0, "B": 1.0}
    assert again.forces[0].centre[1] == (1.0, 0.0, 0.0)
    d = again.state.positions - np.array(again.forces[0].centre)
    assert energy == pytest.approx(-(np.array([2.0, 1.0, 2.0]) * np.exp(-0.5 * (d * d).sum(axis=1))).sum(), rel=1e-14)
    (tmp_path / "again.toml").write_text(again.to_toml())
    assert kd.load(tmp_path / "again.toml").forces == again.forces
    for wrong, message in (
        ('depth = { A = "2 m", B = 1.0 }', "force[0].depth.A: expected an energy"),
        ("depth = [1.0, true, 1.0]", "force[0].depth[1]: expected an energy"),
        ("depth = 1.0\ncentre = [[0, 0, 0], [1, 2]]", "force[0].centre[1]: expected 3 items, got 2"),
        ("depth = [1.0, 2.0]", "tweezer: depth: 2 values for 3 particles; particle 2 has none"),
    ):
        lines = [line for line in SYSTEM.splitlines() if not line.startswith(("depth", "centre"))]
        text = "\n".join(lines).replace('type = "tweezer"', f'type = "tweezer"\n{wrong}')
        (tmp_path / "wrong.toml").write_text(text)
        status, _, err = kickdrift("--load", load, "run", str(tmp_path / "wrong.toml"))
        assert status == 2
        assert message in err
        assert len(err.splitlines()) == 1


FORCE = """
import math
from typing import NamedTuple

import kickdrift as kd


@kd.pair_law
class Bell(NamedTuple):
    \"\"\"U(r) = height exp(-(r / width)^2 / 2); Stillinger 1976, doi:10.1063/1.432891.\"\"\"

    height: float = 1.0
    width: float = 1.0

    dimensions = {"height": "energy", "width": "length"}

    def law(p, r2):
        energy = p.height * math.exp(-0.5 * r2 / p.width**2)
        return energy, energy / p.width**2
"""
WITH_GAUSSIAN = """
units = "lj"

[particles]
positions = [[0, 0, 0], [1.5, 0, 0]]

[[force]]
type = "bell"
height = 2.0
cutoff = 3.0
truncation = "cut"

[run]
dt = 0.01
steps = 20
"""


@pytest.fixture
def files(tmp_path):
    (tmp_path / "gaussian_force.py").write_text(FORCE)
    (tmp_path / "pair.toml").write_text(WITH_GAUSSIAN)
    return tmp_path


def test_a_system_file_names_a_force_of_ones_own(kickdrift, files):
    load, system, run = (str(files / name) for name in ("gaussian_force.py", "pair.toml", "run.h5md"))
    status, out, err = kickdrift("--load", load, "run", system, "--output", run)
    assert (status, err) == (0, "")
    with kd.open(run) as found:
        first = found.observables["potential_energy"][0]
    assert first == pytest.approx(2.0 * 0.32465246735834974, rel=1e-14)  # exp(-1.125)
    status, out, _ = kickdrift("--load", load, "list", "forces")
    assert status == 0
    assert "bell" in out
    assert "height" in out
    assert kickdrift("--load", load, "resume", run, "--steps", "25")[0] == 0


def test_without_its_file_the_line_says_what_to_load(kickdrift, files):
    status, _, err = kickdrift("run", str(files / "pair.toml"))
    assert status == 2
    assert "force[0].type: expected one of " in err
    assert "got 'bell'; a force of your own comes with --load FILE.py" in err
    assert len(err.splitlines()) == 1


def test_a_wrong_parameter_is_named(kickdrift, files):
    path = files / "pair.toml"
    path.write_text(WITH_GAUSSIAN.replace("height = 2.0", "heigth = 2.0"))
    status, _, err = kickdrift("--load", str(files / "gaussian_force.py"), "run", str(path))
    assert status == 2
    assert "force[0].heigth" in err
    assert len(err.splitlines()) == 1


def test_a_name_that_is_taken():
    def trap(**body):
        return type("Trap", (kd.HarmonicTrap,), {"__module__": "a", "__qualname__": "Trap", **body})

    assert kd.register_force(trap()) is named.REGISTERED["a", "Trap"]
    assert FORCES["harmonic-trap"] is kd.HarmonicTrap  # a class with an inherited name does not replace the force
    with pytest.raises(InputError, match=r"^force 'gravity' exists already: Gravity of kickdrift\.forces\.gravity"):
        kd.register_force(trap(name="gravity"))
    with pytest.raises(InputError, match=r"^force 'gravity' exists already"):
        kd.register_force(trap(name="gravity"), overwrite=True)
    first = kd.register_force(trap(name="steep trap"))
    assert FORCES["steep trap"] is first
    again = kd.register_force(trap(name="steep trap"))  # as when a module is loaded again
    assert FORCES["steep trap"] is again
    with pytest.raises(InputError, match=r"^force 'steep trap' exists already: Trap of a; overwrite=True replaces it"):
        kd.register_force(trap(name="steep trap", __module__="b"))
    other = kd.register_force(overwrite=True)(trap(name="steep trap", __module__="b"))
    assert FORCES["steep trap"] is other
    for name in ("", " x", 3, None):
        with pytest.raises(InputError, match=r"^register_force: a force's name must be a word, got "):
            kd.register_force(trap(name=name))


def test_a_kernel_that_does_not_compile(kickdrift, files):
    (files / "broken.py").write_text(
        FORCE.replace("return energy, energy / p.width**2", "return energy, energy / p.widht**2")
    )
    status, _, err = kickdrift("--load", str(files / "broken.py"), "run", str(files / "pair.toml"))
    assert status == 2
    assert len(err.splitlines()) == 1
    assert "widht" in err


def test_laws_of_one_name():
    """A system file's name means the last of a user's laws of that name, but kickdrift's own laws keep their names."""

    def law(cls, module):
        made = namedtuple(cls, ["k"], defaults=[1.0])
        made.__module__, made.law = module, lambda p, r2: (p.k * r2, -2.0 * p.k)
        return kd.pair_law(made)

    first, second = law("Square", "one"), law("Square", "two")
    assert FORCES["square"] is second
    assert named.registered("one", "Square") is first
    with pytest.raises(InputError, match=r"^force 'lennard-jones' exists already: LennardJones of kickdrift\."):
        law("LennardJones", "mine")
    assert FORCES["lennard-jones"] is kd.LennardJones


def test_a_law_whose_force_is_not_the_slope_of_its_energy_is_refused():
    class Wrong(NamedTuple):
        strength: float = 1.0

        def law(p, r2):
            return p.strength / r2, p.strength / (r2 * r2)  # the force lacks a factor 2

    made = kd.pair_law(Wrong)
    with pytest.raises(InputError, match=r"wrong: law\(p, r2\) must return energy and force over r.*at r = 2.85 "):
        made(cutoff=3.0)
    with pytest.raises(InputError, match="wrong of species A: law"):
        made(cutoff=3.0, species={"A": {"strength": 2.0}})


def test_a_law_may_jump():
    class Step(NamedTuple):
        height: float = 1.0

        def law(p, r2):
            inside = r2 < 3.8025  # the jump is at one of the distances where laws are checked
            return (p.height if inside else 0.0), 0.0

    assert kd.pair_law(Step)(cutoff=3.0).height == 1.0
