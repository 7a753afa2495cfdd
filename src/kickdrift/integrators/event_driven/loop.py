"""Steps of hard spheres in compiled code: predicted hits, a tree of winners, and the hits in their order.

A step begins anew from positions and velocities. Each sphere has one next event: a hit with another sphere, a hit with
a wall, or its passage into another cell. Between its events a sphere keeps the place of its own last event, so that an
event costs only the spheres in the cells around it. A sphere whose partner has hit another one meanwhile is predicted
again when its event is due; every pair is predicted by the sphere that changed last.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.seam.kernel import BLOWN_UP, OK
from kickdrift.integrators.event_driven.spheres import Spheres, Whole
from kickdrift.integrators.stepping.loops import STEP
from kickdrift.integrators.stepping.stepper import STOPPED
from kickdrift.jit.compile import as_written, driver, strict
from kickdrift.model.events.collision import ratio
from kickdrift.model.state import Floats

NOTHING, PASSAGE, WALL = -1, -2, -10  # kinds of events; a partner is 0 or more, a wall is WALL less its number
FAR = 1e15  # edges from the origin, beyond which a place is lost
MOST_HITS = 1000  # at one time, beside one for each sphere: spheres at rest on each other would hit for ever
SAME = 1e-12  # of a step: hits so near each other are at one time
# Places in the totals; three numbers each from PUSHED on.
HITS, WALL_HITS, VIRIAL, TAKEN, PUSHED, TURNED, TOTALS = 0, 1, 2, 3, 4, 7, 10

ratio_of = as_written(ratio)


class Desk(NamedTuple):
    """Workspace of a step."""

    x: Floats  # (3, n) in the box, at the sphere's own time
    time: Floats  # (n,) since the begin of the step
    whole: Whole  # (3, n) edges from the place in the box to the sphere's own place
    cell: Whole  # (3, n)
    first: Whole  # (cells,) the first sphere in a cell, or -1
    links: Whole  # (2, n) the sphere before and the sphere after in the same cell
    kind: Whole  # (n,) of the next event
    image: Whole  # (3, n) of the partner; axis and direction of a passage
    known: Whole  # (n,) hits of the partner when it was predicted
    hits: Whole  # (n,) hits of a sphere in this step
    when: Floats  # (leaves,) time of the next event
    tree: Whole  # (2 leaves,) winners: the sphere with the earliest event below a node
    totals: Floats  # (TOTALS,)


def desk_of(spheres: Spheres) -> Desk:
    """An empty workspace."""
    n, leaves = spheres.radii.size, 1
    while leaves < n:
        leaves *= 2

    def whole(*shape: int) -> NDArray[np.int64]:
        return np.zeros(shape, np.int64)

    return Desk(
        np.zeros((3, n)), np.zeros(n), whole(3, n), whole(3, n), whole(int(np.prod(spheres.cells))), whole(2, n),
        whole(n), whole(3, n), whole(n), whole(n), np.full(leaves, np.inf), whole(2 * leaves), np.zeros(TOTALS),
    )  # fmt: skip


@as_written
def along(spheres, x, i, axis):
    """Fractional coordinate of column i of x (3, n)."""
    inverse = spheres.inverse
    return x[0, i] * inverse[0, axis] + x[1, i] * inverse[1, axis] + x[2, i] * inverse[2, axis]


@as_written
def place_in(spheres, desk, i):
    """Number of the cell of sphere i."""
    return (desk.cell[0, i] * spheres.cells[1] + desk.cell[1, i]) * spheres.cells[2] + desk.cell[2, i]


@as_written
def enter(spheres, desk, i):
    """Put sphere i into the list of its cell."""
    place = place_in(spheres, desk, i)
    after = desk.first[place]
    desk.links[0, i], desk.links[1, i] = -1, after
    if after >= 0:
        desk.links[0, after] = i
    desk.first[place] = i


@as_written
def leave(spheres, desk, i):
    """Take sphere i out of the list of its cell."""
    before, after = desk.links[0, i], desk.links[1, i]
    if before >= 0:
        desk.links[1, before] = after
    else:
        desk.first[place_in(spheres, desk, i)] = after
    if after >= 0:
        desk.links[0, after] = before


@strict
def fold(spheres, desk, y):
    """Put all spheres into the box and into their cells. Tell whether all places are known."""
    desk.first[:] = -1
    for i in range(y.shape[2] - 1, -1, -1):
        for k in range(3):
            desk.x[k, i] = y[0, k, i]
        for axis in range(2, -1, -1):
            f = along(spheres, y[0], i, axis)
            if not abs(f) < FAR:
                return False
            edges = math.floor(f) if spheres.periodic[axis] else 0.0
            desk.whole[axis, i] = int(edges)
            for k in range(3):
                desk.x[k, i] -= edges * spheres.edges[axis, k]
            number = math.floor((f - edges - spheres.low[axis]) / spheres.width[axis])
            desk.cell[axis, i] = int(min(max(number, 0.0), spheres.cells[axis] - 1.0))
        desk.time[i], desk.hits[i] = 0.0, 0
        enter(spheres, desk, i)
    return True


@as_written
def move(desk, v, i, now):
    """Fly sphere i to a time of the step."""
    span = now - desk.time[i]
    for k in range(3):
        desk.x[k, i] += v[k, i] * span
    desk.time[i] = now


@as_written
def settle(desk, i, time):
    """Note the time of the next event of sphere i, and let the winners be found again."""
    desk.when[i] = time
    node = (desk.when.size + i) // 2
    while node > 0:
        left, right = desk.tree[2 * node], desk.tree[2 * node + 1]
        desk.tree[node] = left if desk.when[left] <= desk.when[right] else right
        node //= 2


@strict
def predict(spheres, desk, v, i, begin):
    """Find the next event of sphere i, which is at its own time. ``begin`` is the time at the begin of the step."""
    now, best = desk.time[i], np.inf
    desk.kind[i] = NOTHING
    for axis in range(3):
        speed, number, last = along(spheres, v, i, axis), desk.cell[axis, i], spheres.cells[axis] - 1
        up = 1 if speed > 0.0 else 0
        if speed == 0.0 or not (spheres.periodic[axis] or 0 <= number + 2 * up - 1 <= last):
            continue
        side = spheres.low[axis] + (number + up) * spheres.width[axis]
        time = now + max(0.0, (side - along(spheres, desk.x, i, axis)) / speed)
        if time < best:
            best, desk.kind[i] = time, PASSAGE
            desk.image[0, i], desk.image[1, i] = axis, 2 * up - 1
    for wall in range(spheres.normals.shape[0]):
        gap, speed = -spheres.walls[0, wall] - spheres.radii[i], -spheres.walls[1, wall]
        for k in range(3):
            gap += spheres.normals[wall, k] * desk.x[k, i]
            speed += spheres.normals[wall, k] * v[k, i]
        gap -= spheres.walls[1, wall] * (begin + now)
        if speed < 0.0 and now - max(gap, 0.0) / speed < best:
            best, desk.kind[i] = now - max(gap, 0.0) / speed, WALL - wall
    for k in range(27):
        best = predict_in(spheres, desk, v, i, (k // 9 - 1, k // 3 % 3 - 1, k % 3 - 1), best)
    settle(desk, i, best)


@as_written
def predict_in(spheres, desk, v, i, beside, best):
    """Find the first hit of sphere i before the time ``best`` with a sphere in a neighbouring cell; return its time."""
    place, now = 0, desk.time[i]
    x, y, z = desk.x[0, i], desk.x[1, i], desk.x[2, i]
    over = (0, 0, 0)
    for axis in range(3):
        number, count, edges = desk.cell[axis, i] + beside[axis], spheres.cells[axis], 0
        if number < 0 or number >= count:
            if not spheres.periodic[axis]:
                return best
            edges = -1 if number < 0 else 1
            number -= edges * count
            x -= edges * spheres.edges[axis, 0]
            y -= edges * spheres.edges[axis, 1]
            z -= edges * spheres.edges[axis, 2]
        over = (over[1], over[2], edges)
        place = place * count + number
    j = desk.first[place]
    while j >= 0:
        if j != i and (spheres.masses[i] > 0.0 or spheres.masses[j] > 0.0):
            span = now - desk.time[j]
            dx = x - (desk.x[0, j] + v[0, j] * span)
            dy = y - (desk.x[1, j] + v[1, j] * span)
            dz = z - (desk.x[2, j] + v[2, j] * span)
            ux, uy, uz = v[0, i] - v[0, j], v[1, i] - v[1, j], v[2, i] - v[2, j]
            inwards = -(dx * ux + dy * uy + dz * uz)
            reach = spheres.radii[i] + spheres.radii[j]
            if inwards > 0.0 and reach > 0.0:
                over2 = dx * dx + dy * dy + dz * dz - reach * reach
                under = inwards * inwards - (ux * ux + uy * uy + uz * uz) * over2
                if over2 <= 0.0 or under > 0.0:
                    time = now if over2 <= 0.0 else now + over2 / (inwards + math.sqrt(under))
                    if time < best:
                        best, desk.kind[i], desk.known[i] = time, j, desk.hits[j]
                        for axis in range(3):
                            desk.image[axis, i] = over[axis] + desk.whole[axis, i] - desk.whole[axis, j]
        j = desk.links[1, j]
    return best


@strict
def hit(spheres, desk, v, i, j):
    """Let two spheres bounce, which are at the same time."""
    n0, n1, n2 = desk.x[0, i] - desk.x[0, j], desk.x[1, i] - desk.x[1, j], desk.x[2, i] - desk.x[2, j]
    for axis in range(3):
        edges = desk.image[axis, i] - desk.whole[axis, i] + desk.whole[axis, j]
        n0 -= edges * spheres.edges[axis, 0]
        n1 -= edges * spheres.edges[axis, 1]
        n2 -= edges * spheres.edges[axis, 2]
    inwards = -(n0 * (v[0, i] - v[0, j]) + n1 * (v[1, i] - v[1, j]) + n2 * (v[2, i] - v[2, j]))
    square = n0 * n0 + n1 * n1 + n2 * n2
    left = ratio_of(spheres.restitution, inwards / math.sqrt(square))
    masses, total = spheres.masses, spheres.masses[i] + spheres.masses[j]
    push = (1.0 + left) * inwards / square
    for k, apart in enumerate((n0, n1, n2)):
        v[k, i] += push * apart * (masses[j] / total)
        v[k, j] -= push * apart * (masses[i] / total)
    reduced = masses[i] * masses[j] / total
    desk.totals[HITS] += 1.0
    desk.totals[VIRIAL] += (1.0 + left) * inwards * reduced
    desk.totals[TAKEN] += 0.5 * reduced * (1.0 - left * left) * inwards * inwards / square
    desk.hits[i] += 1
    desk.hits[j] += 1


@strict
def bounce(spheres, desk, v, i, wall):
    """Let a sphere bounce off a wall."""
    speed = -spheres.walls[1, wall]
    before = 0.0
    for k in range(3):
        speed += spheres.normals[wall, k] * v[k, i]
        before += v[k, i] * v[k, i]
    push = -(1.0 + spheres.walls[2, wall]) * speed
    after = 0.0
    for k in range(3):
        v[k, i] += push * spheres.normals[wall, k]
        after += v[k, i] * v[k, i]
    mass, totals, normals = spheres.masses[i], desk.totals, spheres.normals
    totals[WALL_HITS] += 1.0
    if spheres.walls[1, wall] != 0.0 or spheres.walls[2, wall] != 1.0:
        totals[TAKEN] += 0.5 * mass * (before - after)
    for k in range(3):
        p, q = (k + 1) % 3, (k + 2) % 3
        totals[PUSHED + k] -= mass * push * normals[wall, k]
        totals[TURNED + k] -= mass * push * (desk.x[p, i] * normals[wall, q] - desk.x[q, i] * normals[wall, p])
    desk.hits[i] += 1


@as_written
def passage(spheres, desk, i):
    """Move sphere i into the next cell of its way."""
    axis, up = desk.image[0, i], desk.image[1, i]
    leave(spheres, desk, i)
    desk.cell[axis, i] += up
    if desk.cell[axis, i] < 0 or desk.cell[axis, i] == spheres.cells[axis]:
        desk.cell[axis, i] -= up * spheres.cells[axis]
        desk.whole[axis, i] += up
        for k in range(3):
            desk.x[k, i] -= up * spheres.edges[axis, k]
    enter(spheres, desk, i)


@strict
def step(spheres, desk, y, begin, dt):
    """Take one step. Return a status."""
    n, leaves, v = y.shape[2], desk.when.size, y[1]
    if not fold(spheres, desk, y):
        return BLOWN_UP
    for i in range(leaves):
        desk.tree[leaves + i] = i
        desk.when[i] = np.inf
    for node in range(leaves - 1, 0, -1):
        desk.tree[node] = desk.tree[2 * node]
    for i in range(n):
        predict(spheres, desk, v, i, begin)
    last, again = 0.0, 0
    while desk.when[desk.tree[1]] < dt:
        i = desk.tree[1]
        now, kind = desk.when[i], desk.kind[i]
        move(desk, v, i, now)
        if kind == PASSAGE:
            passage(spheres, desk, i)
        elif kind <= WALL or desk.hits[kind] == desk.known[i]:
            if kind <= WALL:
                bounce(spheres, desk, v, i, WALL - kind)
            else:
                move(desk, v, kind, now)
                hit(spheres, desk, v, i, kind)
                predict(spheres, desk, v, kind, begin)
            again = again + 1 if now <= last + SAME * dt else 0
            last = now
            if again > MOST_HITS + n:
                return STOPPED
        predict(spheres, desk, v, i, begin)
    for i in range(n):
        move(desk, v, i, dt)
        for k in range(3):
            place = desk.x[k, i]
            for axis in range(3):
                place += desk.whole[axis, i] * spheres.edges[axis, k]
            y[0, k, i] = place
    return OK


@driver
def hits_loop(forces, y, carry, work, stages, dt, start, first, steps, cursor):
    """Take steps; see ``loops``. ``stages`` are the spheres and the desk."""
    spheres, desk = stages
    while cursor[STEP] < steps:
        status = step(spheres, desk, y, start + (first + cursor[STEP]) * dt, dt)
        if status != OK:
            return status
        cursor[STEP] += 1
    return OK
