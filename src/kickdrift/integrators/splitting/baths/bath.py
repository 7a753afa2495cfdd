"""Shared parts of heat baths: particles in compiled code, their heat, and checks of options."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError
from kickdrift.integrators.options import ALLOW_GRAVITY, FRICTION, RATE, SEED, TAU, TEMPERATURE, Option
from kickdrift.jit.compile import strict
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.looks.heat import (
    MOTION,
    heat_of,
    kinetic,
    kinetic_and_momentum,
    kinetic_apart,
    moves,
    scale,
    scale_heat,
)
from kickdrift.model.freedom import apart_of, free_masses, freedom_of
from kickdrift.model.state import Floats
from kickdrift.model.system import System

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.options import Options

SHORTEST_TAU = 10  # steps
MOST_DAMPING = 0.5  # friction times dt


class Bathed(NamedTuple):
    """The particles of a bath. Arrays are filled up with zeros to a multiple of eight."""

    ids: NDArray[np.int64]
    masses: Floats  # in the unit that makes force = mass x acceleration
    spread: Floats  # sqrt(k_B T / m)
    axes: int  # 3, or 2 in two dimensions
    freedom: float  # degrees of freedom
    thermal: float  # k_B T
    seed: int
    heat: Floats  # (1,) energy that the bath has given since the state was set
    apart: int  # the motion of the whole that is no heat, see `model.freedom`
    mass: float  # of all particles
    motion: Floats  # (9,) room for this motion, see `looks.heat`
    fixed: NDArray[np.int64]  # (f,) particles of the bath's System that it leaves alone; their masses are zero here
    given: Floats  # (3, f) their velocities


def bathed(flow: Flow, options: Options, needed: Sequence[Option], conserving: bool) -> Bathed:
    """Return the particles of a run with their bath. A ``conserving`` bath leaves the total momentum alone.

    Raises InputError for an option that is missing, for gravity, and for particles without mass."""
    system: Any = flow.subject
    if not isinstance(system, System):
        raise InputError(f"a heat bath needs particles, and {system.name!r} is an ODE")
    binding = [force.name for force in system.forces if hasattr(force, "G") and hasattr(force, "softening")]
    if binding and not options.get(ALLOW_GRAVITY.name):
        raise InputError(
            f"a heat bath makes no sense under {binding[0]}: gravity has no equilibrium; use an integrator without "
            "one, or set allow_gravity = true"
        )
    for option in needed:
        if options.get(option.name) is None:
            raise InputError(f"{option.name} is needed: a heat bath has no default {option.name}")
    masses, thermal = free_masses(system), system.units.boltzmann * options[TEMPERATURE.name]
    moving = np.ones(len(masses), bool)
    if system.virtual_sites is not None:
        moving[system.virtual_sites.particles] = False
    fixed, given = np.zeros(0, np.int64), np.zeros((3, 0))
    if system.fixed is not None:
        fixed, given = system.fixed.particles, system.fixed.velocities
        moving[fixed] = False
    if not np.all(masses[moving] > 0):
        i = int(np.argmin(np.where(moving, masses, np.inf)))
        raise InputError(f"a heat bath needs masses, and {system.body(i)} has none")
    spread = np.sqrt(np.divide(thermal, masses, out=np.zeros_like(masses), where=moving))
    freedom = freedom_of(system, drags=not conserving)
    if not freedom:
        if system.fixed is not None:
            raise InputError("a heat bath needs a particle that is not fixed")
        raise InputError("a heat bath that conserves momentum needs two particles or more")
    seed = options.get(SEED.name)
    return Bathed(
        filled(system.state.ids), filled(masses), filled(spread), system.dimensions,
        float(freedom), float(thermal), int((system.seed or 0) if seed is None else seed), np.zeros(1),
        apart_of(system, drags=not conserving), float(masses.sum()), np.zeros(MOTION), fixed, given,
    )  # fmt: skip


def bath_warnings(dt: float, options: Options) -> list[str]:
    """One line for each option of a bath that is too strong for the step."""
    found = []
    tau = options.get(TAU.name)
    if tau is not None and tau < SHORTEST_TAU * dt:
        found.append(f"tau = {tau:g} is {tau / dt:.3g} steps; use {SHORTEST_TAU} steps or more")
    for name in (FRICTION.name, RATE.name):
        rate = options.get(name)
        if rate is not None and rate * dt > MOST_DAMPING:
            found.append(f"{name} = {rate:g} times dt is {rate * dt:.3g}; use {MOST_DAMPING} or less")
    return found


def filled(values: NDArray) -> NDArray:
    """Return a copy with zeros at the end, of a multiple of eight in all."""
    return np.concatenate([values, np.zeros(-len(values) % WIDTH, values.dtype)])


@strict
def heat_now(bath, x, v):
    """Return the kinetic energy that the bath acts on, and fill ``bath.motion``."""
    energy, momentum = kinetic_and_momentum(bath.masses, v)
    return heat_of(bath.masses, bath.mass, x, v, bath.apart, bath.motion, energy, momentum)


@strict
def keep_fixed(bath, v):
    """Give fixed particles their velocities back."""
    for k in range(bath.fixed.size):
        for axis in range(3):
            v[axis, bath.fixed[k]] = bath.given[axis, k]


@strict
def rescale(bath, x, v, factor):
    """Scale the velocities relative to ``bath.motion``, but those of fixed particles."""
    if moves(bath.motion):
        scale_heat(x, v, bath.axes, bath.motion, factor)
    else:
        scale(v, bath.axes, factor)
    keep_fixed(bath, v)


@strict
def heat_left(bath, x, v):
    """Return the kinetic energy relative to ``bath.motion``."""
    return kinetic_apart(bath.masses, x, v, bath.motion) if moves(bath.motion) else kinetic(bath.masses, v)
