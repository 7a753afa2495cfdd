"""Compiled fixed-step loops for eight small systems at once, one system in each lane (see ``forces.gravity.batch``).

All take (bodies, y, work, weights, dt, counts, looks, watch, cursor): ``y`` (2, 3, rows, 8) positions and velocities,
``work`` the method's workspace, ``weights`` as in ``loops``, ``dt`` (8,), ``counts`` (k,) the steps before each of k
samples, and ``looks`` (k, LOOK, 8) the samples. With deviations, a sample is their length instead: see ``Watch``. The
whole run of a block stays in the nearest cache. A lane that blows up keeps non-finite numbers, and the others continue.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.bound.evaluate import EVALUATIONS
from kickdrift.forces.gravity.batch import accelerations_in_lanes, look_in_lanes
from kickdrift.integrators.stepping.loops import FRESH
from kickdrift.jit.compile import driver, in_order, jit
from kickdrift.jit.handle import handle, unowned
from kickdrift.jit.lanes.functions import splat
from kickdrift.jit.lanes.masks import any_lane
from kickdrift.jit.lanes.memory import load, store
from kickdrift.jit.lanes.vectors import WIDTH


class Watch(NamedTuple):
    """Sampling of deviations.

    ``inverse`` (2, 8) is one over the scales of positions and velocities. A length above ``largest``, or below its
    inverse, is rescaled by a power of two, whose exponents are in ``exponents`` (k, 8).
    """

    inverse: NDArray[np.float64]
    largest: float
    exponents: NDArray[np.float64]


@in_order
def look(bodies, y, k, looks, watch, cursor):
    """looks[k] <- the sample. For deviations, their length in row 0, after which they may be rescaled."""
    n, rows = bodies.gm.shape[0], y.shape[2]
    if rows == n:
        look_in_lanes(bodies, y[0], y[1], looks[k])
        return
    squares = splat(0.0)
    for half in range(2):
        inverse = load(watch.inverse, half * WIDTH)
        for axis in range(3):
            first = (half * 3 + axis) * rows
            for i in range(first + n, first + rows):
                u = load(y, i * WIDTH) * inverse
                squares = squares + u * u
    size = looks[k, 0]
    store(size, 0, math.sqrt(squares))
    if any_lane(load(size, 0) >= watch.largest) or any_lane(load(size, 0) <= 1.0 / watch.largest):
        scale_back(y, n, size, watch, k)
        cursor[FRESH] = 0


@jit
def scale_back(y, n, size, watch, k):
    for lane in range(WIDTH):
        if 0.0 < size[lane] < np.inf and not 1.0 / watch.largest < size[lane] < watch.largest:
            exponent = np.rint(np.log2(size[lane]))
            watch.exponents[k, lane] = exponent
            for half in range(2):
                for axis in range(3):
                    for i in range(n, y.shape[2]):
                        y[half, axis, i, lane] *= 2.0**-exponent  # exact: no digit changes


@in_order
def advance_in_lanes(y, factor, dy, size):
    """y <- y + factor dy, for ``size`` numbers; ``factor`` in lanes."""
    for p in range(0, size, WIDTH):
        store(y, p, load(y, p) + factor * load(dy, p))


@in_order
def copy_in_lanes(target, source):
    """target <- source, with equal sizes."""
    for p in range(0, source.size, WIDTH):
        store(target, p, load(source, p))


@driver
def batch_splitting_loop(bodies, y, work, weights, dt, counts, looks, watch, cursor):
    bound, watched = handle(bodies), handle(watch)
    y, work, weights, counts = unowned(y), unowned(work), unowned(weights), unowned(counts)
    looks, cursor, step = unowned(looks), unowned(cursor), load(unowned(dt), 0)
    x, v = y[0], y[1]
    kick, drift = weights[0], weights[1]
    for k in range(counts.size):
        for _ in range(counts[k]):
            for stage in range(kick.size):
                if kick[stage] != 0.0:
                    if not cursor[FRESH]:
                        accelerations_in_lanes(bound, x, work)
                        cursor[FRESH] = 1
                        cursor[EVALUATIONS] += 1
                    advance_in_lanes(v, kick[stage] * step, work, v.size)
                if drift[stage] != 0.0:
                    advance_in_lanes(x, drift[stage] * step, v, v.size)
                    cursor[FRESH] = 0
        look(bound, y, k, looks, watched, cursor)


@driver
def batch_runge_kutta_loop(bodies, y, work, weights, dt, counts, looks, watch, cursor):
    bound, watched = handle(bodies), handle(watch)
    y, work, weights, counts = unowned(y), unowned(work), unowned(weights), unowned(counts)
    looks, cursor, step = unowned(looks), unowned(cursor), load(unowned(dt), 0)
    stages, trial = weights.shape[1], work[0]
    for k in range(counts.size):
        for _ in range(counts[k]):
            for stage in range(stages + 1):  # the last row has the weights of the whole step
                target = trial if stage < stages else y
                if stage < stages:
                    copy_in_lanes(trial, y)
                for j in range(stage):
                    if weights[stage, j] != 0.0:
                        advance_in_lanes(target, weights[stage, j] * step, work[j + 1], y.size)
                if stage < stages:
                    copy_in_lanes(work[stage + 1, 0], trial[1])
                    accelerations_in_lanes(bound, trial[0], work[stage + 1, 1])
            cursor[EVALUATIONS] += stages
        look(bound, y, k, looks, watched, cursor)
