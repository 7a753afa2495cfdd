"""The flow N: a chain of Nosé-Hoover thermostats, deterministic, with a conserved quantity.

Martyna, Klein & Tuckerman 1992, J. Chem. Phys. 97, 2635, doi:10.1063/1.463940; integrated by Suzuki and Yoshida's
fourth order (Martyna, Tuckerman, Tobias & Klein 1996, Mol. Phys. 87, 1117, doi:10.1080/00268979600100761). Masses are
f k_B T tau^2 and k_B T tau^2. The conserved quantity is the total energy and the energy of the chain. The motion of the
whole stays, see ``model.freedom``.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from kickdrift.forces.seam.kernel import OK
from kickdrift.integrators.options import TAU, TEMPERATURE
from kickdrift.integrators.splitting.baths.bath import Bathed, bathed, heat_now, rescale
from kickdrift.integrators.stepping.subflow_code import BoundSubflow, subflow_body
from kickdrift.jit.compile import strict
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.options import Options

_JUMP = 1.0 / (2.0 - 2.0 ** (1.0 / 3.0))
STEPS = (_JUMP, 1.0 - 2.0 * _JUMP, _JUMP)  # Suzuki and Yoshida's fourth order


class Chain(NamedTuple):
    """Numbers of the flow in compiled code."""

    bath: Bathed
    masses: Floats  # (chain,)
    steps: Floats  # (3,)
    state: Floats  # (2, chain) positions and velocities of the thermostats


@strict
def push(chain, twice, thermal, k):
    """Acceleration of thermostat k; ``twice`` is the excess of twice the kinetic energy over f k_B T."""
    if k == 0:
        return twice / chain.masses[0]
    velocity = chain.state[1, k - 1]
    return (chain.masses[k - 1] * velocity * velocity - thermal) / chain.masses[k]


@strict
def chain_step(chain, energy, h):
    """Advance the chain by h at the kinetic ``energy``; return the factor of the velocities."""
    velocity, last = chain.state[1], chain.masses.size - 1
    bath = chain.bath
    wanted, thermal = bath.freedom * bath.thermal, bath.thermal
    velocity[last] += 0.5 * h * push(chain, 2.0 * energy - wanted, thermal, last)
    for k in range(last - 1, -1, -1):
        damping = math.exp(-0.25 * h * velocity[k + 1])
        velocity[k] = damping * (damping * velocity[k] + 0.5 * h * push(chain, 2.0 * energy - wanted, thermal, k))
    factor = math.exp(-h * velocity[0])
    for k in range(last + 1):
        chain.state[0, k] += h * velocity[k]
    after = energy * factor * factor
    for k in range(last):
        damping = math.exp(-0.25 * h * velocity[k + 1])
        velocity[k] = damping * (damping * velocity[k] + 0.5 * h * push(chain, 2.0 * after - wanted, thermal, k))
    velocity[last] += 0.5 * h * push(chain, 2.0 * after - wanted, thermal, last)
    return factor


@strict
def chain_energy(chain):
    """Energy of the chain."""
    position, velocity = chain.state[0], chain.state[1]
    total = chain.bath.freedom * chain.bath.thermal * position[0]
    for k in range(chain.masses.size):
        total += 0.5 * chain.masses[k] * velocity[k] * velocity[k]
        if k:
            total += chain.bath.thermal * position[k]
    return total


def energy_of(chain: Chain) -> float:
    """Energy of the chain, outside compiled code."""
    places, velocities = chain.state
    thermal = chain.bath.thermal * (chain.bath.freedom * places[0] + places[1:].sum())
    return float(thermal + 0.5 * (chain.masses @ velocities**2))


@subflow_body(Chain)
def nose_hoover(parts, t, x, v, span, step, stage):
    bath, factor = parts.bath, 1.0
    energy = heat_now(bath, x, v)
    for k in range(parts.steps.size):
        factor *= chain_step(parts, energy * factor * factor, parts.steps[k] * span)
    rescale(bath, x, v, factor)
    bath.heat[0] = -chain_energy(parts)
    return OK


def bind(flow: Flow, options: Options, weights: Floats) -> BoundSubflow:
    """Return the flow for the particles of a run; the chain is at rest."""
    bath = bathed(flow, options, (TEMPERATURE, TAU), conserving=True)
    masses = np.full(int(options.chain), bath.thermal * options.tau**2)
    masses[0] *= bath.freedom
    return BoundSubflow(Chain(bath, masses, np.array(STEPS), np.zeros((2, len(masses)))))
