"""Lane widths of the pair loop: each gives the right forces on any processor, and the processor's features choose
one."""

from __future__ import annotations

import platform

import numpy as np
import pytest

from kickdrift.forces.bound.forces import BoundForces
from kickdrift.forces.lists import row_lanes
from kickdrift.forces.lists.clusters import N_CLUSTERS, SHIFTS, STRIDE, table_place
from kickdrift.forces.lists.pair_rows import in_float64
from kickdrift.forces.lists.row_lanes import LANES, Narrow, NarrowSingle, Wide, WideSingle, blocks, nothing
from kickdrift.forces.pairs import binding as pair_binding
from kickdrift.jit.compile import features, jit
from kickdrift.jit.lanes.functions import lanes_like, multiply_add
from kickdrift.jit.lanes.masks import select
from kickdrift.jit.lanes.memory import broadcast, load_like, store
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift_validation import processors
from tests.oracle.agreement import assert_right
from tests.processes import python
from tests.systems import fluid, make_system, moved

EVERY = (Wide(), Narrow(), WideSingle(), NarrowSingle())
OWN = {type(row_lanes.row_lanes(mixed)) for mixed in (False, True)}  # what this processor's runs compile
every_width = pytest.mark.parametrize(
    "lanes", [pytest.param(lanes, marks=[] if type(lanes) in OWN else [pytest.mark.long]) for lanes in EVERY],
    ids=lambda lanes: type(lanes).__name__,
)  # fmt: skip


def is_single(lanes):
    return isinstance(lanes, WideSingle | NarrowSingle)


def bound_with(monkeypatch, system, lanes):
    with monkeypatch.context() as patched:
        patched.setattr(pair_binding, "row_lanes", lambda mixed: lanes)
        return BoundForces(system, mixed=is_single(lanes))


def check(system, bound, single):
    """Check the forces against the oracle; in mixed precision, against float64 within rounding."""
    if not single:
        assert_right(system, bound)
        return
    right, got = (each.measure(0.0, system.state.phase) for each in (BoundForces(system), bound))
    largest = np.abs(right.accelerations).max()
    assert np.abs(got.accelerations - right.accelerations).max() <= 1e-4 * largest
    assert abs(got.pairs - right.pairs) <= 2  # pairs at the cutoff itself
    assert got.potential == pytest.approx(right.potential, rel=1e-5, abs=1e-6 * largest)
    assert got.virial == pytest.approx(right.virial, rel=1e-5, abs=1e-6 * largest)


@jit
def worked(lanes, a, b, out, wide):
    zero = nothing(lanes)
    x, y = load_like(a, 1, zero), broadcast(b, 2, zero)
    store(out[0], 3, multiply_add(x, y, x))
    store(out[1], 3, select(x < y, 1.0 / x, 0.0))
    store(out[2], 3, x**3 - lanes_like(2.0, x))
    store(wide, 0, in_float64(x))


@every_width
def test_the_lanes_of_every_width(lanes):
    vector, dtype = LANES[type(lanes)].vector, np.float32 if is_single(lanes) else np.float64
    count = vector.count
    a, b = np.linspace(0.5, 2.0, count + 2, dtype=dtype), np.linspace(0.25, 2.25, 5, dtype=dtype)
    out, wide = np.zeros((3, count + 6), dtype), np.zeros(WIDTH)
    worked(lanes, a, b, out, wide)
    x, y = a[1 : count + 1], b[2]
    expected = np.array([x * y + x, np.where(x < y, 1 / x, 0), x**3 - 2])
    np.testing.assert_allclose(out[:, 3 : count + 3], expected, rtol=0, atol=8 * np.finfo(dtype).eps)
    assert not out[:, :3].any()
    assert not out[:, count + 3 :].any()  # no other lane is written
    eight = np.append(x, np.zeros(max(WIDTH - count, 0))).astype(float)
    np.testing.assert_array_equal(wide, eight.reshape(-1, WIDTH).sum(axis=0))


@every_width
def test_forces_of_every_width_in_a_mixture(monkeypatch, lanes):
    for n in (2, 9, 33, 200):
        x, edges = fluid(np.random.default_rng(n), n)
        for box in (edges, None):
            system = make_system(x, box, "shift", True, n)  # a loop that other tests compile
            check(system, bound_with(monkeypatch, system, lanes), is_single(lanes))


@every_width
def test_lists_of_every_width_follow_the_particles(monkeypatch, lanes):
    x, edges = fluid(np.random.default_rng(11), 200)
    system = make_system(x, edges, "switch")
    bound = bound_with(monkeypatch, system, lanes)
    for k in range(25):
        check(moved(system, x + 0.0625 * k * np.array([1.0, 0.5, -2.0])), bound, is_single(lanes))
    builds, prunes = bound.list_builds
    assert 1 < builds < prunes


def pairs_of_rows(pairs):
    """Number of times (slots, slots, shifts) that the rows contain each pair, by the shift of the first particle."""
    slots, per_row, width = WIDTH * pairs.counts[N_CLUSTERS], pairs.per_row, WIDTH // blocks(pairs.block)
    per_shift, apart = table_place.py_func(per_row, 1, 0), table_place.py_func(per_row, 0, 1)
    found = np.zeros((slots, slots, SHIFTS), int)
    for rows, start in zip(pairs.rows, pairs.row_start, strict=True):
        for row in range(slots // per_row):
            for other, place in rows[start[row] : start[row + 1]]:
                first = other // STRIDE * WIDTH + other % STRIDE
                assert place % per_shift // apart == row % (WIDTH // per_row)
                assert other % STRIDE in range(0, WIDTH, width)
                found[per_row * row : per_row * (row + 1), first : first + width, place // per_shift] += 1
    return found


@every_width
def test_every_pair_of_images_stands_in_the_rows_once(monkeypatch, lanes):
    x, edges = fluid(np.random.default_rng(7), 120)
    system = make_system(x, edges, "switch")
    bound = bound_with(monkeypatch, system, lanes)
    bound.measure(0.0, system.state.phase)
    pairs = bound.forces[0].pairs
    clusters = int(pairs.counts[N_CLUSTERS])
    found = pairs_of_rows(pairs)
    found += found[:, :, ::-1].transpose(1, 0, 2)  # each pair in both orders, by the other's shift
    places = pairs.x.reshape(-1, 3, WIDTH)[:clusters].transpose(0, 2, 1).reshape(-1, 3)
    there = (np.arange(WIDTH) < pairs.filled[:clusters, None]).ravel()
    of = np.arange(len(places)) // WIDTH
    for s in range(SHIFTS):
        near = ((places[:, None] - pairs.shifts[:, s] - places) ** 2).sum(axis=2) < pairs.cutoff**2
        near &= there[:, None] & there
        if s == SHIFTS // 2:
            near &= of[:, None] != of  # pairs inside a cluster are implied
        assert (found[near, s] == 1).all()
    assert found.max() == 1


def test_the_features_that_code_is_compiled_for_choose(monkeypatch):
    for known, expected in (
        (("avx2", "avx512f"), (Wide(), WideSingle())),
        (("avx2", "fma"), (Narrow(), NarrowSingle())),
        ((), (Narrow(), NarrowSingle())),
    ):
        monkeypatch.setattr(row_lanes, "features", lambda known=known: known)
        assert tuple(map(type, map(row_lanes.row_lanes, (False, True)))) == tuple(map(type, expected))


CHILD = (
    f"from {__name__} import *\n"
    + """

for mixture in (False, True):
    x, edges = fluid(np.random.default_rng(5), 200)
    system = make_system(x, edges, "switch", mixture)
    for single in (False, True):
        bound = BoundForces(system, mixed=single)
        assert not isinstance(bound.forces[0].parts.lanes, Wide | WideSingle)
        check(system, bound, single)
"""
)


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="code for processors of another kind")
@pytest.mark.long
@pytest.mark.parametrize("processor", processors.FEATURES)
def test_code_for_processors_without_avx_512(processor):
    """Such processors also have another packing of the rows."""
    if processor == "haswell" and "avx2" not in features():
        pytest.skip("the machine has no AVX2")
    settings = processors.settings(processor)
    done = python(CHILD, **settings)
    assert done.returncode == 0, done.stderr
