"""Frequencies of quasi-periodic series, on sums of known lines and beside rebound's transform."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import rebound

import kickdrift as kd

N, SPACING = 4096, 300.0
TIMES = 1234.5 + SPACING * np.arange(N)
ELEMENT = 2 * np.pi / (N * SPACING)
LINES = ELEMENT * np.array([12.3, -7.7, 20.1, 16.9, 33.3])
SIZES = np.array([1.0, 0.5, 0.2, 0.05, 0.01])
PHASES = np.array([0.3, 1.2, -2.0, 3.0, 0.1])


def series(times=TIMES, lines=LINES):
    return (SIZES * np.exp(1j * (np.outer(times, lines) + PHASES))).sum(axis=1)


@pytest.mark.parametrize(("window", "bound"), [("hann", 1e-11), ("hann2", 1e-9), ("hann3", 1e-6), ("box", 1e-3)])
def test_known_lines_come_back(window, bound):
    found = kd.frequencies(series(), TIMES, len(LINES), window)
    np.testing.assert_allclose(found.frequencies, LINES, rtol=0, atol=bound * ELEMENT)
    np.testing.assert_allclose(found.amplitudes, SIZES, rtol=0, atol=bound)
    np.testing.assert_allclose(found.phases, PHASES, rtol=0, atol=2e2 * bound)
    np.testing.assert_allclose(found.periods * found.frequencies, 2 * np.pi)


def test_each_correction_is_a_hundred_times_nearer():
    errors = [np.abs(kd.frequencies(series(), TIMES, 5, corrections=k).frequencies - LINES).max() for k in range(4)]
    assert errors[0] > 1e-4 * ELEMENT
    assert all(after < before / 50 for before, after in pairwise(errors))


@pytest.mark.parametrize(("theirs", "corrections", "bound"), [("mft", 0, 1e-4), ("fmft", 1, 1e-5), ("fmft2", 8, 1e-6)])
def test_rebound_finds_the_same(theirs, corrections, bound):
    z = series()
    pairs = np.column_stack([z.real, z.imag]).ravel()
    there = rebound.frequency_analysis(pairs, type=theirs, nfreq=5, minfreq=-0.1, maxfreq=0.1)
    found = kd.frequencies(z, TIMES, 5, corrections=corrections)
    assert np.abs(np.array(there[0]) / SPACING - found.frequencies).max() < bound * ELEMENT
    np.testing.assert_allclose(there[1], found.amplitudes, rtol=0, atol=1e-3)


def test_lines_that_share_a_peak_stay_finite_and_noise_does_not_move_a_line():
    near = kd.frequencies(
        np.exp(1j * TIMES * LINES[0]) + 0.4 * np.exp(1j * TIMES * (LINES[0] + 0.8 * ELEMENT)), TIMES, 3
    )
    assert np.isfinite(near).all()
    noise = np.random.default_rng(1).normal(size=(2, N)) * 0.1
    found = kd.frequencies(series() + noise[0] + 1j * noise[1], TIMES, 2)
    assert np.abs(found.frequencies - LINES[:2]).max() < 0.01 * ELEMENT


@pytest.mark.parametrize("seed", range(5))
def test_noise_alone_gives_finite_lines(seed):
    noise = np.random.default_rng(seed).normal(size=(2, 64))
    found = kd.frequencies(noise[0] + 1j * noise[1], np.arange(64.0), 30)
    assert np.isfinite(found).all()


def test_a_real_wave_is_two_lines_and_a_constant_is_one():
    found = kd.frequencies(3.0 + np.cos(TIMES * LINES[0]), TIMES, 3)
    np.testing.assert_allclose(sorted(found.frequencies / LINES[0]), [-1.0, 0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(found.amplitudes, [3.0, 0.5, 0.5])
    assert len(kd.frequencies(np.full(64, 2.0), np.arange(64.0)).frequencies) == 1  # the rest is rounding
    assert len(kd.frequencies(np.zeros(64), np.arange(64.0)).frequencies) == 0


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"times": np.sqrt(TIMES)}, "times: not evenly spaced; the largest departure, at sample"),
        ({"times": TIMES[::-1]}, "times: expected times that increase"),
        ({"times": TIMES[1:]}, "series and times: expected two arrays of one length"),
        ({"series": np.where(np.arange(N) == 7, np.nan, 1.0)}, "series: sample 7 is not finite"),
        ({"series": ["a"] * N}, "series: expected numbers"),
        ({"series": [1.0] * 15, "times": range(15)}, "series: 15 samples are too few for frequencies; 16 or more"),
        ({"window": "han"}, "window: expected one of box, hann, hann2, hann3, got 'han'; did you mean 'hann'?"),
        ({"count": 0}, "count must be a whole number, one or more, got 0"),
        ({"corrections": -1}, "corrections must be a whole number, zero or more, got -1"),
    ],
)
def test_bad_input_is_one_line(change, text):
    given = {"series": series(), "times": TIMES} | change
    with pytest.raises(kd.InputError, match=text.replace("?", r"\?")):
        kd.frequencies(**given)
