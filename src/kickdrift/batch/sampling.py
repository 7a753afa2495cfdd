"""Runs of a batch's members with samples: the steps of the samples, and the pieces of a long run."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kickdrift.integrators.stepping.batch_loops import LaneStepper
from kickdrift.model.state import Floats
from kickdrift.model.system import System

PAIR_STEPS = 200_000_000  # pairs and steps of one system between checks for Ctrl-C; some seconds
PIECE_SAMPLES = 100_000  # samples in one piece of memory
TRANSPOSED = 64  # samples of all members that are put in another order at once, within a cache


def momentum_scales(systems: Sequence[System]) -> tuple[Floats, Floats]:
    """Sums of m |v| and of m |x × v| (members,), as in ``Record.begin``."""
    phase = np.array([system.state.phase for system in systems])
    masses = np.array([system.coherent_masses for system in systems])
    x, v = np.moveaxis(phase, 1, 0)
    turning = np.linalg.norm(np.cross(x, v, axis=1), axis=1)
    return (masses * np.linalg.norm(v, axis=1)).sum(axis=1), (masses * turning).sum(axis=1)


def sampled_steps(done: int, steps: int, every: int) -> NDArray[np.int64]:
    """Steps of the samples: the present step, multiples of ``every``, and the last step."""
    inside = np.arange((done // every + 1) * every, done + steps, every)
    ends = [done, done + steps] if steps else [done]
    return np.unique(np.concatenate([ends, inside])).astype(np.int64)


def run_lanes(stepper: LaneStepper, counts: NDArray[np.int64], done: int, watch: Any = None) -> tuple[Floats, Floats]:
    """Take ``counts`` (k,) steps and sample after each, block by block.

    Returns samples (k, LOOK, members) and the factors (k, members) that rescaled deviations. The members include those
    that fill up the last block."""
    rows = stepper.y.shape[3]
    passed = np.cumsum(counts) * rows * rows
    pieces = np.searchsorted(passed, np.arange(PAIR_STEPS, passed[-1] if len(passed) else 0, PAIR_STEPS))
    pieces = np.unique(np.concatenate([pieces, np.arange(PIECE_SAMPLES, len(counts), PIECE_SAMPLES)]))
    found: list[tuple[Floats, Floats]] = []
    for block in range(len(stepper.y)):
        parts, at = [], done
        for some in np.split(counts, pieces):
            parts.append(stepper.run(block, some, at, watch))
            at += int(some.sum())
        looks, exponents = zip(*parts, strict=True)
        found.append((np.concatenate(looks), np.concatenate(exponents)))
    return np.concatenate([f[0] for f in found], axis=-1), np.concatenate([f[1] for f in found], axis=-1)


def by_member(looks: Sequence[Floats]) -> Floats:
    """Samples (members, LOOK, k) of runs with samples (k, LOOK, members) each, one after the other."""
    _, numbers, members = looks[0].shape
    found = np.empty((members, numbers, sum(map(len, looks))))
    at = 0
    for some in looks:
        for begin in range(0, len(some), TRANSPOSED):
            part = some[begin : begin + TRANSPOSED]
            found[:, :, at : at + len(part)] = part.transpose(2, 1, 0)
            at += len(part)
    return found
