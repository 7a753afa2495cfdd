"""The flows that splitting methods are words over: drift, kick, and further ones by address.

A splitting integrates a sum of vector fields by the exact flow of each in turn (McLachlan & Quispel 2002,
doi:10.1017/S0962492902000053). Step loops have the drift and the kick built in. A further flow is machine code at an
address, so a loop is compiled once for all of them. A row of ``FLOWS`` makes its letter known.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from kickdrift.integrators.options.option import (
    ALLOW_GRAVITY,
    CHAIN,
    FRICTION,
    NOISE,
    OF_PRESSURE,
    RATE,
    SEED,
    TAU,
    TEMPERATURE,
    Option,
)
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.options.options import Options
    from kickdrift.integrators.stepping.subflow_code import BoundSubflow

DRIFT, KICK = "A", "B"


@dataclass(frozen=True)
class Subflow:
    """One letter of the words.

    Attributes
    ----------
    name : what the flow is called
    moves : whether it changes positions, so that forces must be evaluated anew
    symplectic, reversible : whether the flow keeps the symplectic form; whether -dt undoes dt
    bath : whether the flow exchanges heat with a bath
    drags : whether the bath changes the total momentum
    options : what the flow takes; every method whose word has the letter takes it
    bind : makes the BoundSubflow of a run from its Flow, its Options, and the flow's part of the step at each stage;
        None for kick and drift, which loops have built in
    """

    name: str
    moves: bool
    symplectic: bool = True
    reversible: bool = True
    bath: bool = False
    drags: bool = False
    options: tuple[Option, ...] = ()
    bind: Callable[[Flow, Options, Floats], BoundSubflow] | None = None


def _bath(letter: str, name: str, *options: Option, drags: bool) -> Subflow:
    """Return the row of a heat bath. Its module, which needs the compiler, is loaded when a run begins."""

    def bind(flow: Flow, options: Options, weights: Floats) -> BoundSubflow:
        from kickdrift.integrators.splitting.baths import andersen, csvr, nose_hoover, ornstein_uhlenbeck

        modules = {"C": csvr, "D": andersen, "N": nose_hoover}
        if letter in modules:
            bound: BoundSubflow = modules[letter].bind(flow, options, weights)
            return bound
        return ornstein_uhlenbeck.bind(letter, flow, options, weights)

    return Subflow(name, False, False, False, True, drags, (TEMPERATURE, *options, *OF_PRESSURE, ALLOW_GRAVITY), bind)


FLOWS = {
    DRIFT: Subflow("drift", moves=True),
    KICK: Subflow("kick", moves=False),
    "O": _bath("O", "Ornstein-Uhlenbeck", FRICTION, SEED, NOISE, drags=True),
    "G": _bath("G", "Ornstein-Uhlenbeck by the midpoint", FRICTION, SEED, NOISE, drags=True),
    "M": _bath("M", "velocities drawn anew", FRICTION, SEED, NOISE, drags=True),
    "C": _bath("C", "stochastic rescaling", TAU, SEED, drags=False),
    "D": _bath("D", "Andersen's collisions", RATE, SEED, drags=True),
    "N": _bath("N", "Nosé-Hoover chain", TAU, CHAIN, drags=False),
}
