"""Hard walls in the drift: a particle that has crossed a wall is mirrored, with its velocity.

Between two kicks particles fly straight, so the motion with mirrors is exact: the flow of the kinetic energy in the
space before the walls. It keeps energy and phase space, and -dt undoes dt. A particle that crosses several walls in one
drift bounces in the order of its way: first off the wall that it crossed the longest time ago. Deviations, which follow
the particles, are mirrored alike.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.fields.walls import unit
from kickdrift.forces.seam.kernel import BLOWN_UP, OK
from kickdrift.integrators.stepping.subflow_code import BoundSubflow, subflow_body
from kickdrift.jit.compile import strict
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.options import Options

MOST = 1000  # bounces of a particle in one drift


class Mirrors(NamedTuple):
    """Walls as planes normal . x = offset."""

    normals: Floats  # (walls, 3) of length 1
    offsets: Floats  # (walls,)
    particles: int  # behind these, there may be deviations


def walls_of(subject: Any) -> list[Any]:
    """The hard walls of a System, or of one with deviations."""
    forces = (getattr(force, "force", force) for force in getattr(subject, "forces", ()))
    return [force for force in forces if getattr(force, "reflects", False)]


def bind(flow: Flow, options: Options, weights: Floats) -> BoundSubflow:
    """Bind the mirrors of a flow's System."""
    walls = walls_of(flow.subject)
    if any(wall.speed or wall.restitution != 1 for wall in walls):
        raise InputError("reflecting-wall: a wall that moves or loses energy needs the integrator 'event-driven'")
    normals = np.array([unit(wall) for wall in walls]).reshape(-1, 3)
    offsets = np.array([normal @ np.array(wall.point) for normal, wall in zip(normals, walls, strict=True)], float)
    carried = [force.system for force in getattr(flow.subject, "forces", ()) if hasattr(force, "force")]
    return BoundSubflow(Mirrors(normals, offsets, len(carried[0] if carried else flow.subject)))


@subflow_body(Mirrors)
def reflect(mirrors, t, x, v, span, step, stage):
    n = mirrors.particles
    each = x.shape[1] // n - 1
    for i in range(n):
        for bounce in range(MOST):
            wall = first_wall(mirrors, x, v, i, span)
            if wall < 0:
                break
            if bounce == MOST - 1:
                return BLOWN_UP
            normal = mirrors.normals[wall]
            mirror(normal, x, i, mirrors.offsets[wall])
            mirror(normal, v, i, 0.0)
            for j in range(n + i * each, n + (i + 1) * each):
                mirror(normal, x, j, 0.0)
                mirror(normal, v, j, 0.0)
    return OK


@strict
def first_wall(mirrors, x, v, i, span):
    """The wall that particle i crossed the longest time ago in a drift of this span, or -1."""
    first, longest = -1, 0.0
    for k in range(mirrors.offsets.size):
        normal = mirrors.normals[k]
        depth = normal[0] * x[0, i] + normal[1] * x[1, i] + normal[2] * x[2, i] - mirrors.offsets[k]
        if depth < 0.0:
            speed = normal[0] * v[0, i] + normal[1] * v[1, i] + normal[2] * v[2, i]
            if speed * span < 0.0 and abs(depth / speed) > longest:
                first, longest = k, abs(depth / speed)
    return first


@strict
def mirror(normal, x, i, offset):
    """Mirror column i of x (3, n) at a plane."""
    twice = 2.0 * (normal[0] * x[0, i] + normal[1] * x[1, i] + normal[2] * x[2, i] - offset)
    for k in range(3):
        x[k, i] -= twice * normal[k]
