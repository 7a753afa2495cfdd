"""The barostat of Martyna, Tobias & Klein: the box moves like a piston, with a mass and thermostats of its own.

Martyna, Tobias & Klein 1994, J. Chem. Phys. 101, 4177, doi:10.1063/1.467468, with the corrections and the reversible
splitting of Martyna et al. 1996, doi:10.1080/00268979600100761, and Tuckerman et al. 2006, J. Phys. A 39, 5629,
doi:10.1088/0305-4470/39/19/S18. For f degrees of freedom in d dimensions and edges of velocity u (L' = u L)

x' = v + u x,   v' = F / m - (u + tr u / f) v,   W u' = sum over the group's edges of V (p - P) + 2 K / f,

with the mass W = n (f + d) k_B T tau^2 / d of a group of n edges. Conserved is the energy of the particles, P V, the
kinetic energy of the box and the energy of both chains. In a step the force on the box acts between two halves of each
kick, and the box stretches before and after each drift: exact flows in a symmetric order. With ``pressure_every`` the
force on the box acts only before and after so many steps, for the time of all of them (multiple time steps for a
barostat: Lippert et al. 2013, J. Chem. Phys. 139, 164106, doi:10.1063/1.4825247).

Molecules with constraints move as wholes: x, v, K and f are then those of their centres, and p is the pressure of the
centres. These flows change neither the shape of a molecule nor the motion within it, so velocities need no projection
for them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from kickdrift.forces.seam.kernel import OK
from kickdrift.integrators.options import PRESSURE_TAU
from kickdrift.integrators.splitting.barostats.piston import (
    Piston,
    add_motion_within,
    pressures,
    slow_centres,
    stretch,
    volume,
)
from kickdrift.integrators.splitting.baths.nose_hoover import STEPS, Chain, chain_energy, chain_step
from kickdrift.integrators.splitting.subflows import DRIFT, KICK
from kickdrift.integrators.stepping.subflow_code import BoundSubflow, subflow_body
from kickdrift.jit.compile import strict
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.integrators.options import Options

LETTERS = STRETCH, PUSH, THERMOSTAT = "XGM"  # of the box in words of this barostat
START = 7  # slot of the state: P V at the start; the first slots are the velocities of the groups


class Turns(NamedTuple):
    """When the force on the box acts."""

    every: int  # steps
    middle: int  # stages from this one on are in the second half of a step


class BoxPush(NamedTuple):
    """The force on the box."""

    piston: Piston
    masses: Floats  # (groups,)
    turns: Turns


class BoxStretch(NamedTuple):
    """The motion of the box with its particles."""

    piston: Piston


class BoxChain(NamedTuple):
    """The thermostats of the box."""

    piston: Piston
    masses: Floats  # (groups,)
    chain: Chain


@strict
def turn(turns, step, stage):
    """Number of steps for which the force on the box acts now; zero if its turn has not come."""
    if turns.every == 1:
        return 1.0
    return float(turns.every) if (step + int(stage >= turns.middle)) % turns.every == 0 else 0.0


@subflow_body(BoxPush)
def box_push(parts, t, x, v, span, step, stage):
    piston, steps = parts.piston, turn(parts.turns, step, stage)
    if steps == 0.0:
        return OK
    span *= steps
    found = piston.room[4:7]
    heat = pressures(piston, v, found)
    heat -= add_motion_within(piston.molecules, piston, x, v, found)
    v_now, per_freedom = volume(piston), 2.0 * heat / freedom_of(piston)
    for a in range(piston.sizes.size):
        push = piston.sizes[a] * (v_now * (found[a] - piston.pressure) + per_freedom)
        piston.state[a] += span * push / parts.masses[a]
    return OK


@subflow_body(BoxStretch)
def box_stretch(parts, t, x, v, span, step, stage):
    piston = parts.piston
    factors, trace = piston.room[1:4], 0.0
    for a in range(piston.sizes.size):
        trace += piston.sizes[a] * piston.state[a]
        factors[a] = math.exp(span * piston.state[a])
    status = stretch(piston, x, v, factors)
    if status == OK:
        slow_centres(piston.molecules, piston, v, math.exp(-span * trace / freedom_of(piston)))
    return status


@strict
def freedom_of(piston):
    """Degrees of freedom of particles and molecules that move on their own."""
    return piston.centres * piston.bath.axes


@strict
def box_kinetic(piston, masses):
    """Kinetic energy of the box."""
    total = 0.0
    for a in range(masses.size):
        total += 0.5 * masses[a] * piston.state[a] * piston.state[a]
    return total


@subflow_body(BoxChain)
def box_chain(parts, t, x, v, span, step, stage):
    piston, chain, factor = parts.piston, parts.chain, 1.0
    energy = box_kinetic(piston, parts.masses)
    for k in range(chain.steps.size):
        factor *= chain_step(chain, energy * factor * factor, chain.steps[k] * span)
    for a in range(parts.masses.size):
        piston.state[a] *= factor
    if piston.state[START] == 0.0:
        piston.state[START] = piston.pressure * volume(piston)
    box = piston.pressure * volume(piston) + box_kinetic(piston, parts.masses) + chain_energy(chain)
    piston.work[0] = piston.state[START] - box
    return OK


def flows(piston: Piston, options: Options, turns: Turns) -> dict[str, BoundSubflow]:
    """Return the flows of the box in a run, by letter; the box is at rest at the start."""
    bath, groups, tau = piston.bath, piston.sizes, float(options[PRESSURE_TAU.name])
    masses = groups * (freedom_of.py_func(piston) + bath.axes) / bath.axes * bath.thermal * tau**2
    of_chain = np.full(int(options["chain"]), bath.thermal * tau**2)
    of_chain[0] *= len(groups)
    own = bath._replace(freedom=float(len(groups)), heat=np.zeros(1))
    chain = Chain(own, of_chain, np.array(STEPS), np.zeros((2, len(of_chain))))
    return {
        STRETCH: BoundSubflow(BoxStretch(piston)),
        PUSH: BoundSubflow(BoxPush(piston, masses, turns)),
        THERMOSTAT: BoundSubflow(BoxChain(piston, masses, chain)),
    }


def word_with_box(word: str, weights: Sequence[float], every: int) -> tuple[str, tuple[float, ...]]:
    """Return the word and the weights of a method with the flows of the box. The force on the box acts in each kick, or
    with ``every`` above one in the first and in the last alone."""
    letters, parts, ends = "", list[float](), (word.find(KICK), word.rfind(KICK))
    for place, (letter, weight) in enumerate(zip(word, weights, strict=True)):
        if letter == KICK:
            push = weight if every == 1 else 0.5 * (place in ends)
            letters, parts = letters + KICK + PUSH + KICK, [*parts, 0.5 * weight, push, 0.5 * weight]
        elif letter == DRIFT:
            letters, parts = letters + STRETCH + DRIFT + STRETCH, [*parts, 0.5 * weight, weight, 0.5 * weight]
        else:
            letters, parts = letters + THERMOSTAT + letter, [*parts, weight, weight]
    return letters, tuple(parts)
