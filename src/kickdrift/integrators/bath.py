"""Shared parts of heat baths: particles in compiled code, kinetic energy, and checks of options."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError
from kickdrift.integrators.option import ALLOW_GRAVITY, FRICTION, RATE, SEED, TAU, TEMPERATURE, Option
from kickdrift.jit.compile import as_written
from kickdrift.jit.lanes import lane_sum, splat
from kickdrift.jit.memory import flat, load, masked_load, masked_store
from kickdrift.jit.vectors import WIDTH
from kickdrift.model.state import Floats
from kickdrift.model.system import System

if TYPE_CHECKING:
    from kickdrift.integrators.flow import Flow
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
    masses, thermal = system.coherent_masses, system.units.boltzmann * options[TEMPERATURE.name]
    if not np.all(masses > 0):
        raise InputError(f"a heat bath needs masses, and {system.body(int(np.argmin(masses)))} has none")
    freedom = freedom_of(system, drags=not conserving)
    if not freedom:
        raise InputError("a heat bath that conserves momentum needs two particles or more")
    seed = options.get(SEED.name)
    return Bathed(
        filled(system.state.ids), filled(masses), filled(np.sqrt(thermal / masses)), system.dimensions,
        float(freedom), float(thermal), int((system.seed or 0) if seed is None else seed), np.zeros(1),
    )  # fmt: skip


def freedom_of(system: System, drags: bool) -> int:
    """Degrees of freedom of a system in a bath: all, unless neither the bath nor a force changes the total momentum."""
    return system.dimensions * len(system) if drags or system.acting("external") else system.degrees_of_freedom


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


@as_written
def kinetic(masses, v, axes):
    """Return the kinetic energy of velocities (3, n), always summed in the same order."""
    row, n, total = flat(v), v.shape[1], splat(0.0)
    for i in range(0, n, WIDTH):
        count = min(WIDTH, n - i)
        squares = splat(0.0)
        for axis in range(axes):
            some = masked_load(row, axis * n + i, count)
            squares = squares + some * some
        total = total + load(masses, i) * squares
    return 0.5 * lane_sum(total)


@as_written
def scale(v, axes, factor):
    """v <- factor v, (3, n)."""
    row, n = flat(v), v.shape[1]
    for i in range(0, axes * n, WIDTH):
        count = min(WIDTH, axes * n - i)
        masked_store(row, i, factor * masked_load(row, i, count), count)
