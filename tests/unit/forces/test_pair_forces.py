"""Pair forces on the cluster list against the plain oracle: truncations, boxes, arrangements, motion and threads."""

from __future__ import annotations

import importlib
import inspect
import json
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from kickdrift.errors import InputError
from kickdrift.forces import LennardJones
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.forces.pairs.ends import TRUNCATIONS
from kickdrift.forces.pairs.law import pair_law
from kickdrift.model.system import System
from kickdrift.run.simulation import Simulation
from kickdrift_validation.folders import DATA
from tests.long import rest
from tests.oracle.agreement import assert_right, round_off
from tests.oracle.forces import interacting_pairs, pair_oracle
from tests.systems import CUTOFF, GRID, fluid, make_system, moved, on_grid

NIST = DATA / "nist-lj"
SIZES = (1, 2, 7, 8, 9, 33, 200, 500)
COMBINATIONS = [(truncation, mixed) for truncation in TRUNCATIONS for mixed in (False, True)]
# The short set has each truncation once. Each combination compiles a loop of its own; these are in other tests too.
IN_SHORT = [("cut", False), ("shift", True), ("force-shift", False), ("switch", False)]
IN_SHORT += [("potential-switch", False)]
every_combination = pytest.mark.parametrize(
    ("truncation", "mixed"), [each if each in IN_SHORT else rest(*each) for each in COMBINATIONS]
)
# Lists do not know the truncation.
two_combinations = pytest.mark.parametrize(
    ("truncation", "mixed"), [each if each in IN_SHORT[:2] else rest(*each) for each in COMBINATIONS]
)


# --- arrangements: (rng, n) -> positions, box ---


def uniform(*edges):
    return lambda rng, n: (on_grid(rng.uniform(0, edges, (n, 3))), edges)


def far_away(rng, n):
    x, edges = fluid(rng, n)
    return x + rng.integers(-1000, 1001, (n, 3)) * np.array(edges), edges


def on_the_edges(rng, n):
    """Coordinates that are whole multiples of a quarter edge: on faces, edges, corners and column borders."""
    places = rng.permutation(np.indices((9, 9, 9)).reshape(3, -1).T - 2)[:n]
    _, first = np.unique(places % 4, axis=0, return_index=True)
    return places[first] * 2.0, (8.0, 8.0, 8.0)


def flat(axis, *edges):
    def arrange(rng, n):
        x, _ = uniform(*edges)(rng, n)
        x[:, axis] = 1.0
        return x, edges

    return arrange


def line(axis, length=40.0):
    def arrange(rng, n):
        edges = np.full(3, 5.0)
        edges[axis] = length
        x = np.full((n, 3), 2.0)
        x[:, axis] = on_grid(rng.uniform(0, length, n))
        return x, tuple(edges)

    return arrange


def part_of(*edges):
    """A dense fluid in one corner of a box, vacuum in the rest; or a slab, where only one edge is long."""

    def arrange(rng, n):
        return fluid(rng, n)[0], edges

    return arrange


def blobs(rng, n):
    """Tight clusters of points, far from each other, in a huge empty box."""
    centres = rng.uniform(0, 500, (4, 3))
    return on_grid(centres[rng.integers(0, 4, n)] + rng.normal(0, 1.0, (n, 3))), (512.0, 512.0, 512.0)


ARRANGEMENTS = {
    "fluid": fluid,
    "far away": far_away,
    "on the edges": on_the_edges,
    "dense": uniform(8.0, 8.0, 8.0),
    "smallest box": uniform(5.0, 5.0, 5.0),
    "gas": uniform(30.0, 30.0, 30.0),
    "nearly empty": uniform(3e3, 3e3, 3e3),
    "vacuum": uniform(1e4, 1e4, 1e4),
    "one corner": part_of(256.0, 256.0, 256.0),
    "slab": part_of(10.0, 10.0, 200.0),
    "two cells": uniform(5.5, 6.25, 7.0),
    "long in x": uniform(200.0, 5.0, 5.25),
    "long in y": uniform(5.0, 200.0, 5.25),
    "long in z": uniform(5.0, 5.25, 200.0),
    "flat in x": flat(0, 5.0, 20.0, 20.0),
    "flat in y": flat(1, 20.0, 5.0, 20.0),
    "flat in z": flat(2, 20.0, 20.0, 5.0),
    "line in x": line(0),
    "line in y": line(1),
    "line in z": line(2),
    "blobs": blobs,
}


@pytest.mark.parametrize("periodic", [True, False], ids=["periodic", "open"])
@two_combinations
def test_every_arrangement(truncation, mixed, periodic):
    for number, (name, arrange) in enumerate(ARRANGEMENTS.items()):
        for n in (2, 9, 33, 200) if mixed else SIZES:
            x, edges = arrange(np.random.default_rng([number, n]), n)
            system = make_system(x, edges if periodic else None, truncation, mixed, n)
            try:
                assert_right(system)
            except AssertionError as error:
                raise AssertionError(f"{name}, n = {n}: {error}") from error


@given(
    seed=st.integers(0, 2**32 - 1),
    n=st.integers(1, 300),
    edges=st.tuples(*[st.floats(5.0, 60.0).map(lambda x: float(on_grid(x))) for _ in range(3)]),
    spread=st.sampled_from([0.05, 0.3, 1.0, 3.0]),
    periodic=st.booleans(),
)
@settings(max_examples=60, deadline=None)
def test_any_box_and_density(seed, n, edges, spread, periodic):
    rng = np.random.default_rng(seed)
    x = on_grid(rng.uniform(0, 1, (n, 3)) * edges * spread + rng.uniform(-100, 100, 3))
    assert_right(make_system(x, edges if periodic else None, seed=seed))


@given(seed=st.integers(0, 2**32 - 1), n=st.integers(2, 300), cutoff=st.floats(0.5, 4.0))
@example(seed=0, n=300, cutoff=1.0001)
@settings(max_examples=50, deadline=None)
def test_any_cutoff(seed, n, cutoff):
    x, edges = fluid(np.random.default_rng(seed), n)
    edges = tuple(max(edge, on_grid(2 * cutoff) + GRID) for edge in edges)
    assert_right(make_system(x, edges, "switch", seed=seed, cutoff=cutoff, switch_start=0.6 * cutoff))


@every_combination
def test_coordinates_that_are_no_round_numbers(truncation, mixed):
    """For coordinates off the grid, both implementations round, and agree within rounding."""
    rng = np.random.default_rng(3)
    sites = np.indices((8, 8, 8)).reshape(3, -1).T
    edge = 8 * (1 / 0.8442) ** (1 / 3)
    x = (sites + rng.uniform(-0.2, 0.2, sites.shape)) * edge / 8
    assert_right(make_system(x, (edge,) * 3, truncation, mixed))
    assert_right(make_system(x, None, truncation, mixed))


# --- the law and its truncations ---


@every_combination
def test_every_distance(truncation, mixed):
    """Dimers far from each other, with lengths from 0.7 to beyond the cutoff."""
    lengths = on_grid(np.concatenate([np.linspace(0.7, 2.6, 200), 2.5 + np.linspace(-0.01, 0.01, 20), [2.0, 2.25]]))
    place = 16.0 * np.indices((6, 6, 7)).reshape(3, -1).T[: len(lengths)]
    x = np.concatenate([place, place + lengths[:, None] * [0.0, 0.0, 1.0]])
    system = make_system(x, None, truncation, mixed)
    measured = assert_right(system)
    assert measured.pairs == np.count_nonzero(lengths < CUTOFF)
    forces = (measured.accelerations * system.coherent_masses).T
    expected = pair_oracle(system)[0]
    pairs = interacting_pairs(system.forces[0], system)
    allowed = np.zeros(len(x))
    allowed[pairs.i] = allowed[pairs.j] = 2 * round_off(pairs, system)  # each dimer alone
    assert (np.abs(forces - expected).max(axis=1) <= allowed).all()


def test_where_truncations_end():
    x = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, np.nextafter(CUTOFF, 0.0)]])
    plain = assert_right(make_system(x, truncation="cut"))
    assert plain.potential == pytest.approx(4 * (2.5**-12 - 2.5**-6), rel=1e-12)
    for truncation in ("shift", "force-shift", "switch"):
        measured = BoundForces(make_system(x, truncation=truncation)).measure(0.0, make_system(x).state.phase)
        assert measured.pairs == 1
        assert measured.potential == pytest.approx(0.0, abs=1e-16)
        if truncation != "shift":
            assert np.abs(measured.accelerations).max() < 1e-14


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("box", [None, (5.0, 5.0, 5.0), (7.0, 8.0, 9.0)])
def test_at_exactly_the_cutoff_nothing_acts(axis, box):
    x = np.full((2, 3), 1.0)
    x[1, axis] += CUTOFF
    measured = assert_right(make_system(x, box))
    assert (measured.pairs, measured.potential, np.abs(measured.accelerations).max()) == (0, 0.0, 0.0)
    x[1, axis] = np.nextafter(x[1, axis], 0.0)
    assert assert_right(make_system(x, box)).pairs == 1


@pytest.mark.parametrize("axis", range(3))
def test_box_smaller_than_twice_the_cutoff_is_refused(axis):
    edges = np.array([9.0, 9.0, 9.0])
    edges[axis] = 4.99
    message = f"box edge {'xyz'[axis]} is 4.99, shorter than twice the cutoff, 2 x 2.5 = 5"
    with pytest.raises(InputError, match=message):
        make_system(np.zeros((1, 3)), edges)


# --- lists after motion ---


@pytest.mark.parametrize("periodic", [True, False], ids=["periodic", "open"])
@two_combinations
def test_lists_follow_the_particles(truncation, mixed, periodic):
    rng = np.random.default_rng(11)
    x, edges = fluid(rng, 200)
    system = make_system(x, edges if periodic else None, truncation, mixed)
    bound = BoundForces(system, jumps=False)
    steps = [0.01] * 25 + [0.1] * 15 + [0.6] * 10 + [0.01] * 10 + [1.4] * 10  # 1.4 sqrt(3) is just below the cutoff
    for number, step in enumerate(steps):
        x = on_grid(x + rng.uniform(-step, step, x.shape))
        assert_right(moved(system, x), bound)
        if number == 24:
            builds, prunes = bound.list_builds
            assert builds <= 3  # each list lasts for some evaluations
            assert prunes < 20
    assert bound.list_builds[0] >= 20


def test_drift_of_everything_and_of_one():
    """One fast particle makes a list invalid, and so does a common motion."""
    x, edges = fluid(np.random.default_rng(5), 150)
    system = make_system(x, edges)
    bound, one = BoundForces(system), np.zeros_like(x)
    one[17] = 0.125
    for k in range(30):
        assert_right(moved(system, x + 0.0625 * k), bound)
    bound.forget()
    for k in range(40):
        assert_right(moved(system, x + k * one), bound)


def test_thousands_of_small_steps_agree_with_fresh_lists():
    x, edges = fluid(np.random.default_rng(6), 500)
    system = make_system(x, edges)
    bound, rng = BoundForces(system), np.random.default_rng(7)
    velocity = rng.normal(0, 1.2, x.shape)
    for k in range(1, 2001):
        phase = make_system(x + 0.002 * k * velocity, edges).state.phase
        measured = bound.measure(0.0, phase)
        if k % 100 == 0:
            fresh = BoundForces(system).measure(0.0, phase)
            largest = np.abs(fresh.accelerations).max()
            np.testing.assert_allclose(measured.accelerations, fresh.accelerations, rtol=0, atol=1e-11 * largest)
            assert measured.pairs == fresh.pairs
    assert bound.list_builds[0] < 300


def test_lists_grow():
    """From a gas to a drop, with all pairs within reach of each other."""
    rng = np.random.default_rng(8)
    x = on_grid(rng.uniform(-9.0, 9.0, (500, 3)))
    system = make_system(x)
    bound = BoundForces(system)
    room = bound.forces[0].pairs.near.shape[1]
    while np.abs(x).max() > 0.7:
        assert_right(moved(system, x), bound)
        x = on_grid(0.9 * x)
    assert bound.forces[0].pairs.near.shape[1] > 1.2 * room
    small = make_system(on_grid(rng.uniform(-0.7, 0.7, (500, 3))), mixed=True)
    assert assert_right(small).pairs == 500 * 499 // 2
    assert BoundForces(small).forces[0].pairs.near.shape[1] == room  # grown for this instance alone


@pytest.mark.parametrize("culprit", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("periodic", [True, False], ids=["periodic", "open"])
def test_positions_that_are_no_numbers(culprit, periodic):
    x, edges = fluid(np.random.default_rng(5), 33)
    system = make_system(x, edges if periodic else None)
    for axis in range(3):
        for particle in (0, 8, 32):
            phase = system.state.phase.copy()
            phase[0, axis, particle] = culprit
            bound = BoundForces(system)
            assert bound.measure(0.0, phase) is None
            assert assert_right(system, bound).pairs > 0
            assert bound.measure(0.0, phase) is None  # although a list exists
            assert_right(system, bound)


def test_jumps_past_the_cutoff_and_overlaps_are_blow_ups():
    x, edges = fluid(np.random.default_rng(5), 33)
    system = make_system(x, edges)
    run, observer = BoundForces(system, jumps=False), BoundForces(system)
    away = x.copy()
    away[3, 1] += 3.0
    for bound in (run, observer):
        assert_right(system, bound)
        away[3, 1] -= 1.0  # the molecule then has two lengths
        assert_right(moved(system, away), bound)
        assert_right(system, bound)
        away[3, 1] += 1.0
    assert run.measure(0.0, moved(system, away).state.phase) is None
    run.forget()
    assert_right(moved(system, away), run)
    assert_right(moved(system, away), observer)
    assert_right(moved(system, x[::-1] + 1000.0 * np.array(edges)), observer)
    for pair in ((0, 1), (0, 32)):
        together = x.copy()
        together[pair[0]] = together[pair[1]]
        assert BoundForces(system).measure(0.0, moved(system, together).state.phase) is None


# --- published values ---


def nist(number):
    lines = (NIST / f"lj_sample_config_periodic{number}.txt").read_text().splitlines()
    rows = [line.split() for line in lines[2:] if line.strip()]
    edges = tuple(float(edge) for edge in lines[0].split())
    return np.array([[float(v) for v in row[1:4]] for row in rows]), edges


def five_digits(value):
    return float(f"{value:.5g}")


@pytest.mark.parametrize("cutoff", [3, 4])
@pytest.mark.parametrize("number", [2, 4])
def test_nist_configurations(number, cutoff):
    x, edges = nist(number)
    expected = json.loads((NIST / "reference.json").read_text())[str(number)]
    assert len(x) == expected["N"]
    for truncation, key in (("cut", "cut"), ("shift", "shift"), ("force-shift", "lfs")):
        measured = assert_right(make_system(x, edges, truncation, cutoff=cutoff))
        right = expected[f"{key}{cutoff}"]
        assert measured.pairs == right["npairs"]
        assert measured.potential == pytest.approx(right["U"], rel=1e-10)
        assert measured.virial == pytest.approx(right["W"], rel=1e-10)
        published = expected["published"].get(f"{key}{cutoff}")
        if published:
            assert [five_digits(measured.potential), five_digits(measured.virial)] == published[:2]
    cut, tail = (assert_right(make_system(x, edges, "cut", cutoff=cutoff, tail=tail)) for tail in (False, True))
    correction = tail.potential - cut.potential
    right = expected[f"lrc{cutoff}"]
    assert correction == pytest.approx(right["U"], rel=1e-10)
    assert (tail.virial - cut.virial) / (3 * 8.0**3) == pytest.approx(right["P"], rel=1e-10)
    assert five_digits(correction) == expected["published"][f"cut{cutoff}"][2]


def test_face_centred_cubic_crystal():
    cells, density = 5, 0.8442
    edge = (4 / density) ** (1 / 3)
    corners = np.indices((cells,) * 3).reshape(3, -1).T
    basis = np.array([[0, 0, 0], [0, 0.5, 0.5], [0.5, 0, 0.5], [0.5, 0.5, 0]])
    x = ((corners[:, None] + basis) * edge).reshape(-1, 3)
    measured = BoundForces(make_system(x, (cells * edge,) * 3, "cut")).measure(0.0, make_system(x).state.phase)
    assert measured.potential / len(x) == pytest.approx(-6.77336805325309, rel=1e-13)
    assert measured.virial / (3 * (cells * edge) ** 3) == pytest.approx(-6.23531727, rel=1e-9)
    assert np.abs(measured.accelerations).max() < 1e-11


def test_a_species_with_one_particle():
    x, box = fluid(np.random.default_rng(3), 300)
    pair = {"A": {"epsilon": 1.0, "sigma": 1.0}, "B": {"epsilon": 1.1, "sigma": 0.97}}
    force = LennardJones(cutoff=CUTOFF, truncation="shift", species=pair)
    for at in (0, 150, 299):
        species = ["A"] * 300
        species[at] = "B"
        assert_right(System(x, box=box, forces=[force], species=species))


@pytest.mark.long
@pytest.mark.parametrize("count", [2, 4, 5])  # whose parameters lie in one register, in two, and in memory
def test_mixtures_of_any_number_of_species(count):
    rng = np.random.default_rng(count)
    x, box = fluid(rng, 300)
    parameters = {name: {"epsilon": 1.0 + 0.1 * k, "sigma": 1.0 - 0.03 * k} for k, name in enumerate("ABCDE"[:count])}
    force = LennardJones(cutoff=CUTOFF, truncation="shift", species=parameters)
    system = System(x, box=box, forces=[force], species=rng.choice(list(parameters), 300).tolist())
    exact = assert_right(system)
    mixed = BoundForces(system, mixed=True).measure(0.0, system.state.phase)
    np.testing.assert_allclose(mixed.potential, exact.potential, rtol=1e-6)
    scale = np.abs(exact.accelerations).max()
    np.testing.assert_allclose(mixed.accelerations, exact.accelerations, atol=3e-6 * scale)


@pytest.mark.parametrize("options", [{}, rest({"mixed": True}), {"threads": 2}], ids=["float64", "mixed", "threads"])
def test_sums_are_taken_again_only_at_the_same_positions(options):
    system = make_system(*fluid(np.random.default_rng(1), 300))
    start = system.state.phase
    elsewhere = start.copy()
    elsewhere[0, 2, 5] += 0.01  # less than the skin: the lists stay as they are at the start
    places = (start, start, elsewhere, elsewhere, start)
    bound = BoundForces(system, **options)
    found = [bound.measure(0.0, y) for y in places]
    for each, y in zip(found, places, strict=True):
        fresh = BoundForces(system, **options)
        fresh.measure(0.0, start)
        wanted = fresh.measure(0.0, y)
        np.testing.assert_array_equal(each.accelerations, wanted.accelerations)
        assert (each.potential, each.virial, each.pairs) == (wanted.potential, wanted.virial, wanted.pairs)
    assert found[0].potential == found[4].potential != found[2].potential


@pytest.mark.long
def test_tail_of_a_mixture():
    x, edges = fluid(np.random.default_rng(2), 200)
    assert_right(make_system(x, edges, "cut", mixed=True, tail=True))


def test_a_tail_needs_a_box():
    x, _ = fluid(np.random.default_rng(2), 20)
    with pytest.raises(InputError, match="tail corrections need a periodic box"):
        make_system(x, None, "cut", tail=True)


@pytest.mark.parametrize("threads", [0, -1, 10_000])
def test_threads_that_there_are_not(threads):
    with pytest.raises(InputError, match=r"threads must be 1 to \d+ here, got"):
        BoundForces(make_system(np.zeros((1, 3))), threads)


@pair_law
class Morse(NamedTuple):
    """U = depth ((1 - exp(-a (r - r0)))^2 - 1)."""

    depth: float
    a: float
    r0: float

    def law(p, r2):
        r = math.sqrt(r2)
        e = math.exp(p.a * (p.r0 - r))
        return p.depth * ((1.0 - e) ** 2 - 1.0), -2.0 * p.depth * p.a * e * (1.0 - e) / r


@pytest.mark.long
def test_a_users_copy_gives_the_same_bits(tmp_path, monkeypatch):
    source = Path(inspect.getfile(LennardJones.Parameters.law)).read_text()
    (tmp_path / "copied_law.py").write_text(source.replace("class LennardJones", "class Copied"))
    monkeypatch.syspath_prepend(tmp_path)
    copied = importlib.import_module("copied_law").Copied
    for n in (33, 500):
        x, edges = fluid(np.random.default_rng(n), n)
        for box in (edges, None):
            ours, theirs = (System(x, box=box, forces=[law(cutoff=CUTOFF)]) for law in (LennardJones, copied))
            a, b = (BoundForces(system).measure(0.0, system.state.phase) for system in (ours, theirs))
            np.testing.assert_array_equal(a.accelerations, b.accelerations)
            assert a[1:] == b[1:]


@pytest.mark.long
@pytest.mark.parametrize("periodic", [True, False], ids=["periodic", "open"])
def test_a_users_morse(periodic):
    x, edges = fluid(np.random.default_rng(1), 200)
    x = x[:150]
    force = Morse(depth=2.0, a=1.7, r0=1.1, cutoff=2.625)
    system = System(x, masses=3.0, box=edges if periodic else None, forces=[force])
    i, j = np.triu_indices(len(x), k=1)
    d = system.box.minimum_image(x[i] - x[j])
    r = np.sqrt((d**2).sum(axis=1))
    near = r < 2.625
    i, j, d, r = i[near], j[near], d[near], r[near]
    energy = 2.0 * ((1 - np.exp(-1.7 * (r - 1.1))) ** 2 - (1 - np.exp(-1.7 * (2.625 - 1.1))) ** 2)
    radial = -2 * 2.0 * 1.7 * np.exp(-1.7 * (r - 1.1)) * (1 - np.exp(-1.7 * (r - 1.1)))
    expected = np.zeros_like(x)
    np.add.at(expected, i, (radial / r)[:, None] * d)
    np.add.at(expected, j, -(radial / r)[:, None] * d)
    measured = BoundForces(system).measure(0.0, system.state.phase)
    assert measured.pairs == len(r)
    assert measured.potential == pytest.approx(energy.sum(), rel=1e-12)
    assert measured.virial == pytest.approx((radial * r).sum(), abs=1e-12 * np.abs(radial * r).sum())
    np.testing.assert_allclose(3.0 * measured.accelerations.T, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


@pair_law
class SoftDisc(NamedTuple):
    """A spring below the distance 1, by np.where in both results."""

    stiffness: float = 1.0

    def law(p, r2):
        r = math.sqrt(r2)
        energy, over_r = 0.5 * p.stiffness * (1.0 - r) ** 2, p.stiffness * (1.0 - r) / r
        return np.where(r < 1.0, energy, 0.0), np.where(r < 1.0, over_r, 0.0)


@pytest.mark.long
def test_a_pair_law_may_return_where():
    x = np.random.default_rng(0).random((40, 3)) * 4.0
    system = System(x, box=[4.0, 4.0, 4.0], forces=[SoftDisc(cutoff=1.5)])
    apart = x[:, None] - x[None]
    r = np.linalg.norm(apart - 4.0 * np.rint(apart / 4.0), axis=-1)[np.triu_indices(40, 1)]
    energy = 0.5 * (np.maximum(0.0, 1.0 - r) ** 2).sum()
    assert Simulation(system, dt=0.001).energy().potential == pytest.approx(energy, rel=1e-12)
