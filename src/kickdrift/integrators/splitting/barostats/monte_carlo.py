"""Monte Carlo moves of the volume at constant pressure.

McDonald 1972, Mol. Phys. 23, 41, doi:10.1080/00268977200100031; Frenkel & Smit 2002, section 5.4.2. A move scales the
edges of one group and the positions along them, and changes the logarithm of the volume by an even random number.
With f degrees of freedom in d dimensions it is accepted with the probability

min(1, exp(-(dU + P dV) / k_B T + (f / d + 1) ln(V' / V))).

Velocities stay, so f / d stands for the N particles of the books: N - 1 where the total momentum is conserved. A
molecule with constraints counts as one particle.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.seam.kernel import OK
from kickdrift.integrators.options import COMPRESSIBILITY, Options
from kickdrift.integrators.splitting.barostats.piston import Piston, stretch, volume
from kickdrift.integrators.stepping.subflow_code import PROPOSE, TAKEN_BACK, BoundSubflow, subflow_body
from kickdrift.jit.compile import strict
from kickdrift.jit.lanes.memory import store
from kickdrift.jit.lanes.random import uniforms
from kickdrift.model.state import Floats

STAGE = 1 << 11  # of the noise: beyond those of heat baths
WIDEST = 1.5  # largest change of ln V over its thermal spread
TRIED, ACCEPTED = 0, 1  # slots of the state


class Moves(NamedTuple):
    """Numbers of the barostat in compiled code."""

    piston: Piston
    most: float  # largest change of the logarithm of the volume
    places: NDArray[np.int64]  # (8,) numbers of the draws
    noise: Floats  # (3, 8) numbers between 0 and 1
    before: Floats  # (3, n) positions before a move
    lengths: Floats  # (3,) edge lengths before a move
    sums: Floats  # (3,) the piston's sums before a move


@strict
def draw(places, noise, step, seed):
    first, second, third, _ = uniforms(places, 0, STAGE, step, seed)
    store(noise[0], 0, first)
    store(noise[1], 0, second)
    store(noise[2], 0, third)


@strict
def keep(source, target):
    for k in range(target.shape[0]):
        for i in range(target.shape[1]):
            target[k, i] = source[k, i]


@subflow_body(Moves)
def monte_carlo(parts, t, x, v, span, step, stage):
    piston = parts.piston
    draw(parts.places, parts.noise, step, piston.bath.seed)
    groups, state = piston.sizes.size, piston.state
    change = parts.most * (2.0 * parts.noise[1, 0] - 1.0)
    if stage == PROPOSE:
        keep(x, parts.before)
        parts.lengths[:] = piston.lengths
        parts.sums[:] = piston.sums
        piston.room[0] = volume(piston)
        factors, chosen = piston.room[1:4], min(int(parts.noise[0, 0] * groups), groups - 1)
        for a in range(groups):
            factors[a] = math.exp(change / piston.sizes[a]) if a == chosen else 1.0
        return stretch(piston, x, None, factors)
    thermal, particles = piston.bath.thermal, piston.centres
    got = piston.sums[0] - parts.sums[0]
    cost = (got + piston.pressure * (volume(piston) - piston.room[0])) / thermal - (particles + 1.0) * change
    state[TRIED] += 1.0
    if math.log(parts.noise[2, 0]) < -cost:
        state[ACCEPTED] += 1.0
        piston.work[0] += got
        return OK
    keep(parts.before, x)
    piston.lengths[:] = parts.lengths
    piston.sums[:] = parts.sums
    return TAKEN_BACK


def action(piston: Piston, options: Options, particles: int) -> BoundSubflow:
    """Return the barostat of a run.

    The largest change of ln V is 1.5 times the thermal spread of ln V at the start, sqrt(k_B T b / V) for the
    compressibility b. A move without time to relax meets a stiffer fluid; in a Lennard-Jones liquid about half of the
    moves are accepted."""
    start = volume.py_func(piston)
    most = WIDEST * math.sqrt(piston.bath.thermal * options[COMPRESSIBILITY.name] / start)
    return BoundSubflow(
        Moves(piston, most, np.arange(8), np.zeros((3, 8)), np.zeros((3, particles)), np.zeros(3), np.zeros(3))
    )
