"""Splitting methods: a method is a row of kick and drift weights, run by one loop."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from math import fsum
from typing import TYPE_CHECKING

import numpy as np

from kickdrift.errors import InputError
from kickdrift.integrators.method import Method
from kickdrift.state import Floats

if TYPE_CHECKING:
    from kickdrift.flow import Flow
    from kickdrift.integrators.stepping import Options, Stepper


@dataclass(frozen=True)
class Splitting(Method):
    """Kicks (v += b dt a) and drifts (x += a dt v) in turn.

    Attributes
    ----------
    kick, drift : the weights, each adding up to one
    first : "kick" or "drift"
    order : the power of dt in the global error
    source : author, year, journal, DOI
    """

    name: str
    kick: tuple[float, ...]
    drift: tuple[float, ...]
    first: str
    order: int
    source: str
    use: str = ""

    family = "splitting"
    symplectic = True
    separable = True
    rescalable = True

    def __post_init__(self) -> None:
        if self.first not in ("kick", "drift"):
            raise InputError(f"{self.name}: first must be kick or drift, got {self.first!r}")
        leading, other = (self.kick, self.drift) if self.first == "kick" else (self.drift, self.kick)
        if len(leading) - len(other) not in (0, 1):
            raise InputError(f"{self.name}: {len(self.kick)} kicks and {len(self.drift)} drifts cannot alternate")
        for key, weights in (("kick", self.kick), ("drift", self.drift)):
            if not abs(fsum(weights) - 1.0) <= 1e-14 * fsum(map(abs, weights)):
                raise InputError(f"{self.name}: {key} weights add up to {fsum(weights)!r}, not 1")

    @property
    def reversible(self) -> bool:
        """Whether the row reads the same from both ends, so that a step with -dt undoes one with dt."""
        return len(self.kick) != len(self.drift) and all(w == w[::-1] for w in (self.kick, self.drift))

    @property
    def evaluations(self) -> int:
        """Force evaluations per step: a last kick shares its force with the next step's first."""
        return len(self.drift) if self.first == "kick" else len(self.kick)

    @cached_property
    def stages(self) -> Floats:
        """(3, stages): the kick, then the drift, of each stage, and the part of dt that has passed at its kick."""
        kick, drift = list(self.kick), list(self.drift)
        if self.first == "drift":
            kick.insert(0, 0.0)
        drift += [0.0] * (len(kick) - len(drift))
        kick += [0.0] * (len(drift) - len(kick))
        return np.array([kick, drift, np.concatenate([[0.0], np.cumsum(drift)[:-1]])])

    def stepper(self, flow: Flow, options: Options) -> Stepper:
        from kickdrift.integrators.loops import splitting_loop
        from kickdrift.integrators.stepping import FixedStepper

        return FixedStepper(flow, splitting_loop, self.stages, lambda shape: np.zeros(shape[1:]), options)


def composed(weights: tuple[float, ...]) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Kicks and drifts of leapfrog steps of lengths ``weights``, read from the middle outwards, in a palindrome.

    ``weights`` leaves the middle step out: it is what the others leave of one.
    """
    row = [*reversed(weights), 1.0 - 2.0 * fsum(weights), *weights]
    return (row[0] / 2, *((p + q) / 2 for p, q in pairwise(row)), row[-1] / 2), tuple(row)


_YOSHIDA = "Yoshida 1990, Phys. Lett. A 150, 262, doi:10.1016/0375-9601(90)90092-3"
_VERLET = "Verlet 1967, Phys. Rev. 159, 98, doi:10.1103/PhysRev.159.98; Swope et al. 1982, doi:10.1063/1.442716"
_TRIPLE_JUMP = composed((1.0 / (2.0 - 2.0 ** (1.0 / 3.0)),))
_YOSHIDA6_A = composed((-1.17767998417887, 0.235573213359357, 0.784513610477560))
_YOSHIDA8_D = composed(
    (
        0.102799849391985,
        -1.96061023297549,
        1.93813913762276,
        -0.158240635368243,
        -1.44485223686048,
        0.253693336566229,
        0.914844246229740,
    )
)

ROWS = (
    Splitting(
        "symplectic-euler", (1.0,), (1.0,), "kick", 1,
        "de Vogelaere 1956; Hairer, Lubich & Wanner 2006, I.1.2, doi:10.1007/3-540-30666-8", "teaching",
    ),
    Splitting("velocity-verlet", (0.5, 0.5), (1.0,), "kick", 2, _VERLET, "the default of molecular dynamics"),
    Splitting(
        "leapfrog-dkd", (1.0,), (0.5, 0.5), "drift", 2,
        "Tuckerman, Berne & Martyna 1992, doi:10.1063/1.463137 (position Verlet)", "molecular dynamics, N-body",
    ),
    Splitting(
        "forest-ruth", _TRIPLE_JUMP[1], _TRIPLE_JUMP[0], "drift", 4,
        "Forest & Ruth 1990, Physica D 43, 105, doi:10.1016/0167-2789(90)90019-L", "smooth forces, long runs",
    ),
    Splitting("yoshida4", *_TRIPLE_JUMP, "kick", 4, _YOSHIDA, "smooth forces, long runs"),
    Splitting("yoshida6", *_YOSHIDA6_A, "kick", 6, f"{_YOSHIDA}, table 1, solution A", "smooth forces, high accuracy"),
    Splitting("yoshida8", *_YOSHIDA8_D, "kick", 8, f"{_YOSHIDA}, table 2, solution D", "smooth forces, round-off"),
)  # fmt: skip
ALIASES = {"leapfrog": "velocity-verlet"}
