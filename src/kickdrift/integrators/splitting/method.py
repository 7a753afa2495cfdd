"""Splitting methods: a method is a word over flows with its weights, run by one loop; and multiple time steps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise, zip_longest
from math import fsum
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError
from kickdrift.integrators.method import Method
from kickdrift.integrators.options import COMPENSATED, OF_PRESSURE, SUBSTEPS, Option
from kickdrift.integrators.splitting.subflows import (
    BESIDE,
    DRIFT,
    FLOWS,
    KICK,
    MIRROR,
    group_of,
    letters_of,
    nested,
    rows_of,
)
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.options import Options
    from kickdrift.integrators.stepping.batch_loops import LaneStepper, Members
    from kickdrift.integrators.stepping.stepper import Stepper


@dataclass(frozen=True)
class Splitting(Method):
    """A word over flows, which act one after another, each for its part of the step.

    word : letters of the flows in the order of their action: A drifts (x += w dt v), B kicks (v += w dt a), and other
        letters are in ``subflows.FLOWS``. B0, B1, … kick by the forces of one group. See ``subflows.letters_of``
    weights : parts of dt, one for each letter; the weights of one letter add up to one
    order : the power of dt in the global error
    source : author, year, journal, DOI; kickdrift_validation.polish_splittings adds digits to rows that were published
        with few digits
    """

    name: str
    word: str
    weights: tuple[float, ...]
    order: int
    source: str
    use: str = ""

    family = "splitting"
    separable = True
    rescalable = True
    reflects = True

    def __post_init__(self) -> None:
        letters = letters_of(self.name, self.word)
        if len(baths := [letter for letter in FLOWS if letter in letters and FLOWS[letter].bath]) > 1:
            names = " and ".join(f"{letter} ({FLOWS[letter].name})" for letter in baths)
            raise InputError(f"{self.name}: a word has one heat bath, not {len(baths)}: {names}")
        if len(letters) != len(self.weights):
            raise InputError(f"{self.name}: {len(letters)} letters and {len(self.weights)} weights")
        whole = any(FLOWS[letter[0]].whole for letter in letters)
        kicks = {letter for letter in letters if letter[0] == KICK} or {KICK}
        needed = {*letters} if whole else {*letters, *kicks, DRIFT}
        for letter in sorted(needed, key=lambda each: (list(FLOWS).index(each[0]), each)):
            total, size = fsum(self.of(letter)), fsum(map(abs, self.of(letter)))
            if not abs(total - 1.0) <= 1e-14 * size:
                group = group_of(letter)
                which = FLOWS[letter[0]].name + ("" if group is None else f" {letter}")
                raise InputError(f"{self.name}: {which} weights add up to {total!r}, not 1")

    @property
    def letters(self) -> tuple[str, ...]:
        """Letters of the word in the order of their action, B0, B1, … with their group."""
        return letters_of(self.name, self.word)

    @property
    def groups(self) -> int:
        """Number of groups of forces that the word kicks apart; 0 if each kick is by all forces."""
        return len({letter for letter in self.letters if group_of(letter) is not None})

    def of(self, letter: str) -> tuple[float, ...]:
        """Weights of one flow, in order."""
        return tuple(weight for each, weight in zip(self.letters, self.weights, strict=True) if each == letter)

    @property
    def kick(self) -> tuple[float, ...]:
        """Weights of the kicks."""
        return self.of(KICK)

    @property
    def drift(self) -> tuple[float, ...]:
        """Weights of the drifts."""
        return self.of(DRIFT)

    @property
    def first(self) -> str:
        """Name of the first flow."""
        return FLOWS[self.letters[0][0]].name

    @property
    def symplectic(self) -> bool:
        """Whether every flow keeps the symplectic form."""
        return all(FLOWS[letter[0]].symplectic for letter in self.letters)

    @property
    def reversible(self) -> bool:
        """Whether the word reads the same from both ends, so that a step with -dt undoes one with dt."""
        same = self.letters == self.letters[::-1] and self.weights == self.weights[::-1]
        return same and all(FLOWS[letter[0]].reversible for letter in self.letters)

    @property
    def bath(self) -> bool:
        return any(FLOWS[letter[0]].bath for letter in self.letters)

    @property
    def drags(self) -> bool:
        return any(FLOWS[letter[0]].drags for letter in self.letters)

    @property
    def slow_velocities(self) -> bool:
        """Whether velocities at the step's end are too slow by an error of the step that configurations hardly have: a
        Langevin bath between the drifts, and kicks at both ends."""
        return self.word in ("BAOAB", "BAGAB")

    @property
    def kinetic_bias(self) -> bool:
        return self.letters == ("B", "A", "B")

    @property
    def free_because(self) -> str:
        if "D" in self.letters:
            return "draws the velocities of single particles"
        if self.order > 2 and not self.in_steps:
            return f"is of order {self.order} with exact drifts alone"
        return ""

    @property
    def in_steps(self) -> bool:
        """Whether the word is a row of leapfrog steps, kick, drift and kick, so that its order is that of the row."""
        return self._steps_between(KICK, DRIFT)

    def _steps_between(self, outer: str, inner: str) -> bool:
        """Whether the word is a row of steps of half an ``outer``, a whole ``inner`` and half an ``outer``."""
        halves = [0.5 * weight for weight in self.of(inner)]
        ends = [a + b for a, b in zip([0.0, *halves], [*halves, 0.0], strict=True)]
        in_turn = self.letters == tuple((outer + inner) * len(halves) + outer)
        return in_turn and np.allclose(self.of(outer), ends, rtol=0.0, atol=1e-14)

    @property
    def carries_unknowns(self) -> bool:  # type: ignore[override]
        """Whether unknowns beside the bodies can advance in the word: an order above 2 must come from leapfrog
        steps alone."""
        steps = self.order <= 2 or self.in_steps or self._steps_between(DRIFT, KICK)
        return steps and not (self.groups or self.overdamped or BESIDE in self.letters)

    def beside(self) -> Any:
        """The word with unknowns beside the bodies: in the middle of each drift, or around each kick in a word that
        begins with a drift. A row of leapfrog steps keeps its order, up to the order 4 of the unknowns' own method."""
        first = next(letter for letter in self.letters if letter in (DRIFT, KICK))
        inner, outer = (KICK, BESIDE) if first == DRIFT else (BESIDE, DRIFT)
        parted = DRIFT if first == KICK else KICK
        letters: list[tuple[str, float]] = []
        for each, weight in zip(self.letters, self.weights, strict=True):
            halves = [(outer, 0.5 * weight), (inner, weight), (outer, 0.5 * weight)]
            letters += halves if each == parted else [(each, weight)]
        return replace(self, word=" ".join(each for each, _ in letters), weights=tuple(weight for _, weight in letters))

    @property
    def evaluations(self) -> int:
        """Force evaluations per step, one for each group of forces; a last kick shares its force with the first kick of
        the next step."""
        count, known = 0, {letter for letter in self._acting if letter[0] == KICK and self._fresh_after(letter)}
        for letter in self._acting:
            if letter[0] == KICK and letter not in known:
                count, known = count + 1, {*known, letter}
            elif FLOWS[letter[0]].moves:
                known = set()
        return count

    @property
    def ends_fresh(self) -> bool:
        """Whether positions stay fixed after a step's last kicks, so that their forces are those at the step's end."""
        kicks = [letter for letter in self._acting if letter[0] == KICK]
        return bool(kicks) and all(map(self._fresh_after, kicks))

    def _fresh_after(self, kick: str) -> bool:
        """Whether positions stay fixed after the last of these kicks."""
        last = len(self._acting) - self._acting[::-1].index(kick)
        return not any(FLOWS[letter[0]].moves for letter in self._acting[last:])

    @property
    def _acting(self) -> tuple[str, ...]:
        """Letters of the word without those of weight zero."""
        return tuple(letter for letter, weight in zip(self.letters, self.weights, strict=True) if weight)

    @property
    def further(self) -> str:
        """Letters of the flows other than kicks and drifts, in the order of ``subflows.FLOWS``."""
        return "".join(letter for letter in FLOWS if letter in self.letters and letter not in (KICK, DRIFT))

    @property
    def declared(self) -> tuple[Option, ...]:
        found = (option for letter in self.further for option in FLOWS[letter].options)
        return COMPENSATED, *(option for option in found if not (self.groups and option in OF_PRESSURE))

    @cached_property
    def stages(self) -> Floats:
        """Stages (3, stages) for compiled loops. A stage is a kick, then a drift, then a further flow; flows of weight
        zero are left out. Rows: weights of kick and drift, and the part of dt that has passed before the kick."""
        return self._rows[:3].copy()

    @cached_property
    def further_stages(self) -> Floats:
        """Further flows (3, stages): weight of each stage's flow, part of dt that has passed before it acts, and its
        index in ``further``."""
        return self._rows[3:6].copy()

    @cached_property
    def kick_groups(self) -> NDArray[np.int64]:
        """Group of forces of each stage's kick, (stages,)."""
        return self._rows[6].astype(np.int64)

    @cached_property
    def _rows(self) -> Floats:
        return rows_of(self.letters, self.weights, self.further)

    def mirrored(self) -> Any:
        """The word with bounces off hard walls after each drift."""
        letters = [(each, weight) for each, weight in zip(self.letters, self.weights, strict=True)]
        both = [(made, weight) for each, weight in letters for made in (each, MIRROR)[: 1 + (each == DRIFT)]]
        return replace(self, word=" ".join(each for each, _ in both), weights=tuple(weight for _, weight in both))

    def timed(self, options: Options) -> Any:
        """The rows for steps of ``options.dt``: these, where the parts of a step do not depend on its length."""
        return self

    def stepper(self, flow: Flow, options: Options) -> Stepper:
        from kickdrift.integrators.splitting.stepper import SplittingStepper

        return SplittingStepper(flow, self, options)

    @property
    def particles_only(self) -> bool:
        return bool(self.further or self.groups)

    @property
    def batched(self) -> bool:
        return not (self.further or self.groups)

    def in_lanes(self, members: Members, options: Options) -> LaneStepper:
        from kickdrift.integrators.stepping.batch_loops import FixedLanes, batch_splitting_loop

        return FixedLanes(members, batch_splitting_loop, self.stages, members.y.shape[2:])


def in_turn(word: str, first: tuple[float, ...], second: tuple[float, ...]) -> tuple[str, tuple[float, ...]]:
    """A word of two letters in turn, and its weights; ``first`` are the weights of the first letter."""
    if len(first) - len(second) not in (0, 1):
        names = [f"{len(row)} {FLOWS[letter].name}s" for letter, row in zip(word, (first, second), strict=True)]
        raise InputError(f"{' and '.join(names)} cannot alternate")
    weights = [weight for pair in zip_longest(first, second) for weight in pair if weight is not None]
    return (word * len(weights))[: len(weights)], tuple(weights)


def even_weights(word: str, name: str = "word") -> tuple[float, ...]:
    """Weights of a word in which each flow acts for equal parts of the step. ``name`` begins messages."""
    letters = letters_of(name, word)
    return tuple(1.0 / letters.count(letter) for letter in letters)


def palindrome(half: tuple[float, ...], middle: int = 1) -> tuple[float, ...]:
    """A palindrome: ``half``, then once or twice (``middle``) the remainder to one, then ``half`` backwards."""
    rest = fsum((1.0, *(-2.0 * weight for weight in half))) / middle  # fsum: rounded once
    return (*half, *(rest,) * middle, *reversed(half))


def composed(weights: tuple[float, ...]) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Kicks and drifts of a palindrome of leapfrog steps with lengths ``weights``, from the middle outwards. The middle
    step is not in ``weights``: its length is the remainder to one."""
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
    Splitting("symplectic-euler", "BA", (1.0, 1.0), 1, _EULER, "teaching; kick first"),
    Splitting("symplectic-euler-dk", "AB", (1.0, 1.0), 1, _EULER, "teaching; drift first"),
    Splitting("velocity-verlet", "BAB", (0.5, 1.0, 0.5), 2, _VERLET, "the default of molecular dynamics"),
    Splitting(
        "leapfrog-dkd", "ABA", (0.5, 1.0, 0.5), 2,
        "Tuckerman, Berne & Martyna 1992, doi:10.1063/1.463137 (position Verlet)", "molecular dynamics, N-body",
    ),
    Splitting(
        "ruth3", "BABABA", (7 / 24, 2 / 3, 3 / 4, -2 / 3, -1 / 24, 1.0), 3,
        "Ruth 1983, IEEE Trans. Nucl. Sci. 30, 2669, doi:10.1109/TNS.1983.4332919", "comparisons; not reversible",
    ),
    Splitting(
        "forest-ruth", *in_turn("AB", *_TRIPLE_JUMP), 4,
        "Forest & Ruth 1990, Physica D 43, 105, doi:10.1016/0167-2789(90)90019-L", "smooth forces, long runs",
    ),
    Splitting("yoshida4", *in_turn("BA", *_TRIPLE_JUMP), 4, _YOSHIDA, "smooth forces, long runs"),
    Splitting(  # lambda = -0.2123418310626054 gives the outer kick, (1 - 2 lambda) / 2
        "pefrl",
        *in_turn("AB", palindrome((0.17861789584480905, -0.066264582669818495)), palindrome((0.7123418310626054,), 2)),
        4, "Omelyan, Mryglod & Folk 2002, Comput. Phys. Commun. 146, 188, doi:10.1016/S0010-4655(02)00451-4",
        "smooth forces, long runs",
    ),
    Splitting(  # the kicks are (14 - sqrt(19)) / 108 and (20 - 7 sqrt(19)) / 108
        "mclachlan4",
        *in_turn("BA", palindrome((0.089269454226475239, -0.097336042636895506), 2), palindrome((0.4, -0.1))), 4,
        "McLachlan 1995, SIAM J. Sci. Comput. 16, 151, doi:10.1137/0916010, method S of order 4 with 5 stages",
        "smooth forces, long runs",
    ),
    Splitting(
        "blanes-moan4",
        *in_turn(
            "BA", palindrome((0.082984406417405024, 0.39630980149836809, -0.039056304922348434)),
            palindrome((0.24529895718427117, 0.60487266571108), 2),
        ),
        4, f"{_BLANES_MOAN}, table 3, SRKN_6^b",
        "smooth forces, small errors",
    ),
    Splitting(
        "yoshida6", *in_turn("BA", *_YOSHIDA6_A), 6, f"{_YOSHIDA}, table 1, solution A", "smooth forces, high accuracy",
    ),
    Splitting(
        "blanes-moan6",
        *in_turn(
            "BA",
            palindrome(
                (0.041464998518262845, 0.19812867191806655, -0.040006192104152689, 0.07525398430158034,
                 -0.011511387420687771), 2,
            ),
            palindrome(
                (0.12322977594627116, 0.29055379779955826, -0.12704921262541691, -0.24633176106207541,
                 0.35720887279592778)
            ),
        ),
        6, f"{_BLANES_MOAN}, table 3, SRKN_11^b", "smooth forces, high accuracy",
    ),
    Splitting(
        "yoshida8", *in_turn("BA", *_YOSHIDA8_D), 8, f"{_YOSHIDA}, table 2, solution D", "smooth forces, round-off",
    ),
)  # fmt: skip
ALIASES = {"leapfrog": "velocity-verlet"}


@dataclass(frozen=True)
class Respa(Splitting):
    """A splitting with groups of forces whose word depends on the option ``substeps`` and the number of groups.

    inner : palindrome of the fastest steps, with plain kicks
    """

    inner: str = "BAB"

    @property
    def declared(self) -> tuple[Option, ...]:
        return *super().declared, SUBSTEPS

    evaluations = 0

    def stepper(self, flow: Flow, options: Options) -> Stepper:
        subject: Any = flow.subject
        slowest = max((getattr(force, "group", 0) for force in getattr(subject, "forces", ())), default=0)
        row = _row(self.name, self.inner, options[SUBSTEPS.name], max(1, slowest) + 1, self.source, self.use)
        return Splitting.stepper(row, flow, options)


def _row(name: str, inner: str, substeps: int, groups: int, source: str, use: str) -> Respa:
    word = nested(inner, substeps, groups)
    return Respa(name, word, even_weights(word), 2, source, use, inner)


_SOURCE = "Tuckerman, Berne & Martyna 1992, J. Chem. Phys. 97, 1990, doi:10.1063/1.463137"
RESPA = (
    _row("respa", "BAB", SUBSTEPS.default, 2, _SOURCE, "fast and slow forces, such as bonds and pairs"),
    _row(
        "respa-baoab", "BAOAB", SUBSTEPS.default, 2,
        f"{_SOURCE}; Leimkuhler & Matthews 2013, doi:10.1093/amrx/abs010", "constant temperature; fast and slow forces",
    ),
)  # fmt: skip
