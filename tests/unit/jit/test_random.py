"""Philox in lanes: the published known answers, and normal numbers."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from kickdrift.jit.compile import driver
from kickdrift.jit.lanes.memory import load, store
from kickdrift.jit.lanes.random import cosine, logarithm, normals, sine, uniforms


@driver
def draw(ids, stage, step, seed, out):
    for i in range(0, ids.size, 8):
        a, b, c, d = uniforms(ids, i, stage, step, seed)
        store(out[0], i, a)
        store(out[1], i, b)
        store(out[2], i, c)
        store(out[3], i, d)
        x, y, z = normals(a, b, c, d)
        store(out[4], i, x)
        store(out[5], i, y)
        store(out[6], i, z)


@driver
def functions(x, out):
    for i in range(0, x.size, 8):
        store(out[0], i, logarithm(load(x, i)))
        store(out[1], i, sine(load(x, i)))
        store(out[2], i, cosine(load(x, i)))


def drawn(ids, stage=0, step=0, seed=0):
    out = np.zeros((7, len(ids)))
    draw(np.asarray(ids, np.int64), stage, np.int64(step), np.int64(seed), out)
    return out


def signed(low: int, high: int) -> np.int64:
    return np.uint64(low | high << 32).astype(np.int64)


# Random123 1.14, tests/kat_vectors: counter, key, answer of philox4x32 with ten rounds.
KNOWN = [
    ((0, 0, 0, 0), (0, 0), "6627e8d5 e169c58d bc57ac4c 9b00dbd8"),
    ((0xFFFFFFFF,) * 4, (0xFFFFFFFF,) * 2, "408f276d 41c83b0e a20bc7c6 6d5451fd"),
    ((0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344), (0xA4093822, 0x299F31D0), "d16cfe09 94fdcceb 5001e420 24126ea1"),
]  # fmt: skip


@pytest.mark.parametrize(("counter", "key", "answer"), KNOWN)
def test_the_published_known_answers(counter, key, answer):
    out = drawn([counter[0]] * 8, counter[1], signed(*counter[2:]), signed(*key))
    for lane in range(8):
        assert " ".join(f"{int(value * 2**32 - 0.5):08x}" for value in out[:4, lane]) == answer


def test_a_number_depends_on_its_key_alone():
    ids = np.arange(64)
    order = np.random.default_rng(1).permutation(64)
    out = drawn(ids, 1, 5, 42)
    np.testing.assert_array_equal(drawn(ids[order], 1, 5, 42), out[:, order])
    others = [drawn(ids, 2, 5, 42), drawn(ids, 1, 6, 42), drawn(ids, 1, 5 + 2**32, 42), drawn(ids, 1, 5, 43)]
    others.append(drawn(ids + 2**32, 1, 5, 42))
    assert len({each.tobytes() for each in (out, *others)}) == 6


def test_normal_numbers_are_normal_and_uncorrelated():
    out = drawn(np.arange(80_000), 3, 7, 11)[4:]
    for row in out:
        assert stats.kstest(row, "norm").pvalue > 1e-3
        assert abs(stats.kurtosis(row)) * math.sqrt(len(row) / 24) < 4
    assert np.abs(np.corrcoef(out) - np.eye(3)).max() * math.sqrt(80_000) < 4
    following = drawn(np.arange(80_000), 3, 8, 11)[4:]
    assert abs(np.corrcoef(out[0], following[0])[0, 1]) * math.sqrt(80_000) < 4


def test_functions_of_lanes():
    x = np.linspace(1e-10, math.pi / 2, 8000)
    out = np.zeros((3, 8000))
    functions(x, out)
    np.testing.assert_allclose(out[0], np.log(x), rtol=0, atol=4e-15)
    np.testing.assert_allclose(out[1], np.sin(x), rtol=3e-16, atol=1e-16)
    np.testing.assert_allclose(out[2], np.cos(x), rtol=0, atol=3e-16)
