"""Arrays as text: nothing is lost, and positions come back within a step."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from kickdrift.errors import InputError
from kickdrift.view.packing import packed, quantised, restored, scaled, unpacked

SHAPES = st.tuples(st.integers(1, 5), st.integers(1, 7))


@settings(deadline=None, max_examples=40)
@given(st.sampled_from(["u1", "u2", "u4"]).flatmap(lambda kind: arrays(kind, SHAPES)), st.booleans())
def test_whole_numbers_come_back(values, delta):
    back = unpacked(packed(values, delta))
    assert back.dtype == values.dtype
    np.testing.assert_array_equal(back, values)


@pytest.mark.parametrize("kind", ["f4", "f8"])
def test_numbers_come_back_with_nan(kind):
    values = np.array([[1.5, np.nan], [-np.inf, 1e-300]]).astype(kind)
    np.testing.assert_array_equal(unpacked(packed(values)), values)


@settings(deadline=None, max_examples=40)
@given(arrays("f8", 9, elements=st.floats(0.0, 1.0)), st.sampled_from([8, 16, 32]))
def test_parts_come_back_within_a_step(parts, bits):
    assert np.max(np.abs(restored(quantised(parts, bits)) - parts)) <= 1.0 / (2**bits - 1)


def test_nothing_is_there_where_nan_is():
    level = quantised(np.array([0.0, 1.0, np.nan]), 16)
    assert level[2] == 65535 > level[1]
    assert np.isnan(restored(level)).tolist() == [False, False, True]


def test_bits_that_no_browser_has_are_refused():
    with pytest.raises(InputError, match="bits: expected 8, 16 or 32, got 12"):
        quantised(np.zeros(1), 12)


def test_an_empty_range_gives_zeros():
    assert scaled([3.0, 3.0], 3.0, 3.0).tolist() == [0.0, 0.0]
