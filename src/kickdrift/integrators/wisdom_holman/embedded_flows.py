"""The two flows of `eos`: the motion under the star, by the drifts and kicks of its inner map, and the planets' kicks.

A kick may have a correction: v += h a + 2 c a'(x) a, where a'(x) a is the change of the accelerations along
themselves. So a modified kick costs two evaluations.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError
from kickdrift.forces.gravity.direct import Gravity
from kickdrift.forces.laws.central import gravitational_constant
from kickdrift.forces.seam.kernel import OK
from kickdrift.integrators.options import PHI0, SUBSTEPS
from kickdrift.integrators.splitting.subflows import DRIFT, KICK
from kickdrift.integrators.stepping.loops import advance
from kickdrift.integrators.stepping.subflow_code import BoundSubflow, subflow_body
from kickdrift.jit.compile import inlined, jit
from kickdrift.jit.lanes.functions import inverse_sqrt, splat
from kickdrift.jit.lanes.masks import select
from kickdrift.jit.lanes.memory import aligned, load
from kickdrift.jit.lanes.vector3 import dot, lane_sums, load3, store3, vector3
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.options import Options


FEW = 5  # planets up to which one after another takes less time than lanes


class Pull(NamedTuple):
    """Gravity between pairs of bodies."""

    gm: Floats  # (n,) G m
    pairs: NDArray[np.int64]  # (pairs, 2)
    a: Floats  # (3, n) accelerations of a kick
    change: Floats  # (3, n) their change along themselves


class UnderStar(NamedTuple):
    """The motion under the star as drifts and kicks by turns: rows of the parts of the flow's time."""

    pull: Pull
    rows: Floats  # (3, k): a drift, the kick behind it, and its correction in cubes of the time
    star: int
    planets: NDArray[np.int64]  # the other bodies
    few: bool  # whether the planets are few, and sums plain
    lanes: Floats  # (8, 8) positions and velocities of up to eight planets, G m, and 1 where a lane has a planet
    state: Floats  # (2, 3, n) rounding errors of compensated sums of positions and velocities, or (2, 3, 0)


class Mutual(NamedTuple):
    """Kicks by the gravity of the planets."""

    pull: Pull
    corrections: Floats  # (stages,) of the kick at a stage, in cubes of its time
    state: Floats  # as above, (1, 3, n) or (1, 3, 0)


def program(inner: Any, substeps: int) -> Floats:
    """Rows (3, k) of so many steps of a map, see `UnderStar`. Drifts that follow one another are one."""
    made = [[0.0, 0.0, 0.0]]
    for letter, weight, correction in inner.steps(substeps):
        if letter == DRIFT:
            if made[-1][1]:
                made.append([0.0, 0.0, 0.0])
            made[-1][0] += weight
        elif weight:
            if made[-1][1]:
                made.append([0.0, 0.0, 0.0])
            made[-1][1:] = weight, correction
    return np.array(made).T.copy()


def bind(under_star: bool, flow: Flow, options: Options, weights: Floats, maps: Mapping[str, Any]) -> BoundSubflow:
    """Bind the motion under the star, or the planets' kicks, of a flow's System. ``maps`` are those of `eos`."""
    system: Any = flow.subject
    if options.get(PHI0.name) is None:
        raise InputError("the letters S and I are flows of the integrator eos alone")
    gravity = next(force for force in system.forces if isinstance(force, Gravity))
    masses, n = system.state.masses, len(system)
    star = int(np.argmax(masses))
    gm = gravitational_constant(gravity.name, gravity.G, system) * masses
    pairs = [(i, j) for i in range(n) for j in range(i + 1, n) if (star in (i, j)) == under_star and (gm[i] or gm[j])]
    pull = Pull(gm, np.array(pairs, np.int64).reshape(-1, 2), np.zeros((3, n)), np.zeros((3, n)))
    kept = n if options.compensated else 0
    if under_star:
        rows = program(maps[options.phi1], options[SUBSTEPS.name])
        planets, lanes = np.delete(np.arange(n), star), aligned((8, WIDTH))
        few = len(planets) <= (FEW if rows[2].any() else WIDTH) and not kept
        if few:
            lanes[6, : len(planets)], lanes[7, : len(planets)] = gm[planets], 1.0
        return BoundSubflow(UnderStar(pull, rows, star, planets, few, lanes, np.zeros((2, 3, kept))))
    corrections = np.zeros(len(weights))
    kicks = [each for each in maps[options.phi0].steps(1) if each[0] == KICK and each[1]]
    corrections[weights != 0.0] = [correction / weight**3 for _, weight, correction in kicks]
    return BoundSubflow(Mutual(pull, corrections, np.zeros((1, 3, kept))))


@subflow_body(UnderStar)
def move_under_star(parts, t, x, v, span, step, stage):
    rows, pull, lost_x, lost_v = parts.rows, parts.pull, parts.state[0], parts.state[1]
    if parts.few:
        if parts.planets.size > FEW:
            move_in_registers(parts, x, v, span)
        else:
            move_few(parts, x, v, span)
        return OK
    for k in range(rows.shape[1]):
        if rows[0, k] != 0.0:
            advance(x, lost_x, rows[0, k] * span, v)
        if rows[1, k] != 0.0:
            kick_by_pairs(pull, x, v, lost_v, rows[1, k] * span, rows[2, k] * span * span * span)
    return OK


@subflow_body(Mutual)
def kick_by_planets(parts, t, x, v, span, step, stage):
    kick_by_pairs(parts.pull, x, v, parts.state[0], span, parts.corrections[stage] * span * span * span)
    return OK


@inlined
def move_few(parts, x, v, span):
    """The motion under the star of few planets, one after another."""
    rows, planets, star, gm = parts.rows, parts.planets, parts.star, parts.pull.gm
    cx, cy, cz, ux, uy, uz = x[0, star], x[1, star], x[2, star], v[0, star], v[1, star], v[2, star]
    for row in range(rows.shape[1]):
        drift, h = rows[0, row] * span, rows[1, row] * span
        cx, cy, cz = cx + drift * ux, cy + drift * uy, cz + drift * uz
        if rows[2, row] != 0.0:
            for i in planets:
                for k in range(3):
                    x[k, i] += drift * v[k, i]
            x[0, star], x[1, star], x[2, star] = cx, cy, cz
            v[0, star], v[1, star], v[2, star] = ux, uy, uz
            kick_by_pairs(parts.pull, x, v, parts.state[1], h, rows[2, row] * span * span * span)
            ux, uy, uz = v[0, star], v[1, star], v[2, star]
            continue
        bx = by = bz = 0.0
        for s in range(planets.size):
            i = planets[s]
            px, py, pz = x[0, i] + drift * v[0, i], x[1, i] + drift * v[1, i], x[2, i] + drift * v[2, i]
            x[0, i], x[1, i], x[2, i] = px, py, pz
            dx, dy, dz = px - cx, py - cy, pz - cz
            r2 = dx * dx + dy * dy + dz * dz
            part = h / (r2 * math.sqrt(r2))
            dx, dy, dz = part * dx, part * dy, part * dz
            v[0, i] -= gm[star] * dx
            v[1, i] -= gm[star] * dy
            v[2, i] -= gm[star] * dz
            bx += gm[i] * dx
            by += gm[i] * dy
            bz += gm[i] * dz
        ux, uy, uz = ux + bx, uy + by, uz + bz
    x[0, star], x[1, star], x[2, star] = cx, cy, cz
    v[0, star], v[1, star], v[2, star] = ux, uy, uz


@inlined
def move_in_registers(parts, x, v, span):
    """The motion under the star of up to eight planets, which stay in registers from kick to kick."""
    rows, lanes, planets, star = parts.rows, parts.lanes, parts.planets, parts.star
    for s in range(planets.size):
        for k in range(3):
            lanes[k, s], lanes[3 + k, s] = x[k, planets[s]], v[k, planets[s]]
    place, speed = load3(lanes, 0, WIDTH), load3(lanes, 3 * WIDTH, WIDTH)
    gm, live = load(lanes, 6 * WIDTH), load(lanes, 7 * WIDTH) > 0.0
    central, own = vector3(x[0, star], x[1, star], x[2, star]), vector3(v[0, star], v[1, star], v[2, star])
    for row in range(rows.shape[1]):
        drift, h = rows[0, row] * span, rows[1, row] * span
        place, central = place + splat(drift) * speed, central + drift * own
        d = place - central
        inverse = inverse_sqrt(select(live, dot(d, d), splat(1.0)))
        pull = select(live, inverse * inverse * inverse, splat(0.0)) * d
        speed = speed - splat(h * parts.pull.gm[star]) * pull
        own = own + h * lane_sums(gm * pull)
    store3(lanes, 0, WIDTH, place)
    store3(lanes, 3 * WIDTH, WIDTH, speed)
    for s in range(planets.size):
        for k in range(3):
            x[k, planets[s]], v[k, planets[s]] = lanes[k, s], lanes[3 + k, s]
    x[0, star], x[1, star], x[2, star] = central.x, central.y, central.z
    v[0, star], v[1, star], v[2, star] = own.x, own.y, own.z


@jit
def kick_by_pairs(pull, x, v, lost, h, correction):
    """v <- v + h a + 2 correction a'(x) a."""
    pairs, gm, a, change = pull.pairs, pull.gm, pull.a, pull.change
    if lost.size == 0 and correction == 0.0:
        for p in range(pairs.shape[0]):
            i, j = pairs[p, 0], pairs[p, 1]
            dx, dy, dz = x[0, j] - x[0, i], x[1, j] - x[1, i], x[2, j] - x[2, i]
            r2 = dx * dx + dy * dy + dz * dz
            part = h / (r2 * math.sqrt(r2))
            add_pair(v, i, j, gm, part * dx, part * dy, part * dz)
        return
    for k in range(3):
        for i in range(gm.size):
            a[k, i] = change[k, i] = 0.0
    for p in range(pairs.shape[0]):
        i, j = pairs[p, 0], pairs[p, 1]
        dx, dy, dz = x[0, j] - x[0, i], x[1, j] - x[1, i], x[2, j] - x[2, i]
        r2 = dx * dx + dy * dy + dz * dz
        part = 1.0 / (r2 * math.sqrt(r2))
        add_pair(a, i, j, gm, part * dx, part * dy, part * dz)
    if correction != 0.0:
        for p in range(pairs.shape[0]):
            i, j = pairs[p, 0], pairs[p, 1]
            dx, dy, dz = x[0, j] - x[0, i], x[1, j] - x[1, i], x[2, j] - x[2, i]
            ux, uy, uz = a[0, j] - a[0, i], a[1, j] - a[1, i], a[2, j] - a[2, i]
            r2 = dx * dx + dy * dy + dz * dz
            part = 1.0 / (r2 * math.sqrt(r2))
            along = 3.0 * (dx * ux + dy * uy + dz * uz) / r2
            add_pair(change, i, j, gm, part * (ux - along * dx), part * (uy - along * dy), part * (uz - along * dz))
        advance(v, lost, 2.0 * correction, change)
    advance(v, lost, h, a)


@inlined
def add_pair(a, i, j, gm, px, py, pz):
    """Add a pull from i to j, per G and mass of the other body."""
    a[0, i] += gm[j] * px
    a[1, i] += gm[j] * py
    a[2, i] += gm[j] * pz
    a[0, j] -= gm[i] * px
    a[1, j] -= gm[i] * py
    a[2, j] -= gm[i] * pz
