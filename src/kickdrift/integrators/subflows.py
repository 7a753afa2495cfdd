"""The flows that splitting methods are words over: drift, kick, and further ones by address.

A splitting integrates a sum of vector fields by the exact flow of each in turn (McLachlan & Quispel 2002,
doi:10.1017/S0962492902000053). Step loops have the drift and the kick built in. A further flow is machine code at an
address, so a loop is compiled once for all of them. A row of ``FLOWS`` makes its letter known.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from kickdrift.integrators.option import FRICTION, SEED, TEMPERATURE, Option

if TYPE_CHECKING:
    from kickdrift.integrators.flow import Flow
    from kickdrift.integrators.options import Options
    from kickdrift.integrators.subflow_code import BoundSubflow

DRIFT, KICK = "A", "B"


@dataclass(frozen=True)
class Subflow:
    """One letter of the words.

    Attributes
    ----------
    name : what the flow is called
    moves : whether it changes positions, so that forces must be evaluated anew
    symplectic, reversible : whether the flow keeps the symplectic form; whether -dt undoes dt
    random : whether the flow exchanges heat and momentum with a bath
    options : what the flow takes; every method whose word has the letter takes it
    bind : makes the BoundSubflow of a run from its Flow and Options; None for kick and drift, which loops have built in
    """

    name: str
    moves: bool
    symplectic: bool = True
    reversible: bool = True
    random: bool = False
    options: tuple[Option, ...] = ()
    bind: Callable[[Flow, Options], BoundSubflow] | None = None


def _bath(flow: Flow, options: Options) -> BoundSubflow:
    from kickdrift.integrators.ornstein_uhlenbeck import bind

    return bind(flow, options)


FLOWS = {
    DRIFT: Subflow("drift", moves=True),
    KICK: Subflow("kick", moves=False),
    "O": Subflow(
        "Ornstein-Uhlenbeck", moves=False, symplectic=False, reversible=False, random=True,
        options=(TEMPERATURE, FRICTION, SEED), bind=_bath,
    ),
}  # fmt: skip
