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
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.integrators.batch_stepping import LaneStepper, Members
    from kickdrift.integrators.flow import Flow
    from kickdrift.integrators.options import Options
    from kickdrift.integrators.stepping import Stepper


@dataclass(frozen=True)
class Splitting(Method):
    """Kicks (v += b dt a) and drifts (x += a dt v) in turn.

    Attributes
    ----------
    kick, drift : the weights, each adding up to one
    first : "kick" or "drift"
    order : the power of dt in the global error
    source : author, year, journal, DOI; digits that were published short are carried on by
        kickdrift_validation.polish_splittings
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

        return FixedStepper(flow, splitting_loop, self.stages, lambda shape: np.zeros(shape[1:]), options, kept=True)

    @property
    def batched(self) -> bool:
        return True

    def in_lanes(self, members: Members, options: Options) -> LaneStepper:
        from kickdrift.integrators.batch_loops import batch_splitting_loop
        from kickdrift.integrators.batch_stepping import FixedLanes

        return FixedLanes(members, batch_splitting_loop, self.stages, members.y.shape[2:])


def palindrome(half: tuple[float, ...], middle: int = 1) -> tuple[float, ...]:
    """A row that reads the same from both ends: ``half``, then once or twice (``middle``) the weight that is left of
    one, then ``half`` backwards.
    """
    rest = fsum((1.0, *(-2.0 * weight for weight in half))) / middle  # fsum: rounded once
    return (*half, *(rest,) * middle, *reversed(half))


def composed(weights: tuple[float, ...]) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Kicks and drifts of leapfrog steps of lengths ``weights``, read from the middle outwards, in a palindrome.

    ``weights`` leaves the middle step out: it is what the others leave of one.
    """
    row = palindrome(weights[::-1])
    return (row[0] / 2, *((p + q) / 2 for p, q in pairwise(row)), row[-1] / 2), row


_EULER = "de Vogelaere 1956; Hairer, Lubich & Wanner 2006, I.1.2, doi:10.1007/3-540-30666-8"
_VERLET = "Verlet 1967, Phys. Rev. 159, 98, doi:10.1103/PhysRev.159.98; Swope et al. 1982, doi:10.1063/1.442716"
_YOSHIDA = "Yoshida 1990, Phys. Lett. A 150, 262, doi:10.1016/0375-9601(90)90092-3"
_BLANES_MOAN = "Blanes & Moan 2002, J. Comput. Appl. Math. 142, 313, doi:10.1016/S0377-0427(01)00492-7"
_TRIPLE_JUMP = composed((1.3512071919596575,))  # 1 / (2 - 2^(1/3))
_YOSHIDA6_A = composed((-1.177679984178871, 0.23557321335935813, 0.7845136104775573))
_YOSHIDA8_D = composed(
    (
        0.10279984939179644,
        -1.9606102329753108,
        1.9381391376225259,
        -0.15824063536805016,
        -1.4448522368606052,
        0.25369333656621135,
        0.91484424622979155,
    )
)

ROWS = (
    Splitting("symplectic-euler", (1.0,), (1.0,), "kick", 1, _EULER, "teaching; kick first"),
    Splitting("symplectic-euler-dk", (1.0,), (1.0,), "drift", 1, _EULER, "teaching; drift first"),
    Splitting("velocity-verlet", (0.5, 0.5), (1.0,), "kick", 2, _VERLET, "the default of molecular dynamics"),
    Splitting(
        "leapfrog-dkd", (1.0,), (0.5, 0.5), "drift", 2,
        "Tuckerman, Berne & Martyna 1992, doi:10.1063/1.463137 (position Verlet)", "molecular dynamics, N-body",
    ),
    Splitting(
        "ruth3", (7 / 24, 3 / 4, -1 / 24), (2 / 3, -2 / 3, 1.0), "kick", 3,
        "Ruth 1983, IEEE Trans. Nucl. Sci. 30, 2669, doi:10.1109/TNS.1983.4332919", "comparisons; not reversible",
    ),
    Splitting(
        "forest-ruth", _TRIPLE_JUMP[1], _TRIPLE_JUMP[0], "drift", 4,
        "Forest & Ruth 1990, Physica D 43, 105, doi:10.1016/0167-2789(90)90019-L", "smooth forces, long runs",
    ),
    Splitting("yoshida4", *_TRIPLE_JUMP, "kick", 4, _YOSHIDA, "smooth forces, long runs"),
    Splitting(  # lambda = -0.2123418310626054 gives the outer kick, (1 - 2 lambda) / 2
        "pefrl", palindrome((0.7123418310626054,), 2), palindrome((0.17861789584480905, -0.066264582669818495)),
        "drift", 4, "Omelyan, Mryglod & Folk 2002, Comput. Phys. Commun. 146, 188, doi:10.1016/S0010-4655(02)00451-4",
        "smooth forces, long runs",
    ),
    Splitting(  # the kicks are (14 - sqrt(19)) / 108 and (20 - 7 sqrt(19)) / 108
        "mclachlan4", palindrome((0.089269454226475239, -0.097336042636895506), 2), palindrome((0.4, -0.1)), "kick", 4,
        "McLachlan 1995, SIAM J. Sci. Comput. 16, 151, doi:10.1137/0916010, method S of order 4 with 5 stages",
        "smooth forces, long runs",
    ),
    Splitting(
        "blanes-moan4", palindrome((0.082984406417405024, 0.39630980149836809, -0.039056304922348434)),
        palindrome((0.24529895718427117, 0.60487266571108), 2), "kick", 4, f"{_BLANES_MOAN}, table 3, SRKN_6^b",
        "smooth forces, small errors",
    ),
    Splitting("yoshida6", *_YOSHIDA6_A, "kick", 6, f"{_YOSHIDA}, table 1, solution A", "smooth forces, high accuracy"),
    Splitting(
        "blanes-moan6",
        palindrome(
            (0.041464998518262845, 0.19812867191806655, -0.040006192104152689, 0.07525398430158034,
             -0.011511387420687771), 2,
        ),
        palindrome(
            (0.12322977594627116, 0.29055379779955826, -0.12704921262541691, -0.24633176106207541, 0.35720887279592778)
        ),
        "kick", 6, f"{_BLANES_MOAN}, table 3, SRKN_11^b", "smooth forces, high accuracy",
    ),
    Splitting("yoshida8", *_YOSHIDA8_D, "kick", 8, f"{_YOSHIDA}, table 2, solution D", "smooth forces, round-off"),
)  # fmt: skip
ALIASES = {"leapfrog": "velocity-verlet"}
